//! Senders of samples over a WebSocket: moves messages, and speaks JSON or CBOR with those who do.
//!
//! Binary messages are the frames of `docs/wire.md` as they are. A sender whose first message is a text speaks JSON, one
//! whose first is a map in CBOR that; what it says becomes frames, and frames become what it is told. Must not know what becomes of them.

use super::entry::peer;
use super::error::ApiError;
use super::extract::State;
use super::guard::is_own_page;
use super::handles::{IngestPipe, NotUnderstood};
use super::state::ApiState;
use super::wire::ingest::{Language, Translator};
use super::wire::problem::ProblemWire;
use crate::ingest::live::Refusal;
use crate::wire::ErrorCode;
use axum::extract::Request;
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade, close_code};
use axum::response::Response;
use std::sync::mpsc::TrySendError;
use std::time::Duration;

/// Longest message: a frame, or as much JSON.
const MAX_MESSAGE_BYTES: usize = 2 << 20;

/// Wait before a message is offered again to a conversation that is busy.
const RETRY: Duration = Duration::from_millis(2);

/// Takes samples over a WebSocket, as frames or as JSON (docs/wire.md).
#[utoipa::path(
    get,
    path = "/api/v1/ingest",
    tag = "ingest",
    responses(
        (status = SWITCHING_PROTOCOLS, description = "Frames, or JSON, in both directions"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json",
         description = "No WebSocket"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No machine has live senders"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Too many senders"),
    )
)]
pub(super) async fn connect(
    State(state): State<ApiState>,
    upgrade: Result<WebSocketUpgrade, axum::extract::ws::rejection::WebSocketUpgradeRejection>,
    request: Request,
) -> Result<Response, ApiError> {
    let open = state.ingest.clone().ok_or_else(|| {
        ApiError::NotFound(
            "no machine has a source that takes samples; see docs/wire.md".to_owned(),
        )
    })?;
    // Browsers let any page open a WebSocket, and say which page it is.
    if !is_own_page(request.headers(), &state.settings) {
        let why = "a page of another server must not send samples; server.cors_origins names those that may";
        return Err(ApiError::ForeignOrigin(why.to_owned()));
    }
    let upgrade = upgrade
        .map_err(|_| ApiError::Invalid("this path takes WebSocket connections only".to_owned()))?;
    let from = peer(&request).map(|peer| format!("a WebSocket of {peer}"));
    let pipe = open(from.unwrap_or_else(|| "a WebSocket".to_owned()), state.caller.clone())
        .map_err(|_| ApiError::Busy("as many senders as are allowed are connected"))?;
    let upgrade = upgrade.max_message_size(MAX_MESSAGE_BYTES).max_frame_size(MAX_MESSAGE_BYTES);
    Ok(upgrade.on_upgrade(|socket| converse(socket, pipe)))
}

/// Moves messages until one side ends.
async fn converse(mut socket: WebSocket, pipe: IngestPipe) {
    let IngestPipe { to_daemon, mut from_daemon } = pipe;
    let mut translator: Option<Translator> = None;
    let mut is_first = true;
    let mut to_daemon = Some(to_daemon);
    loop {
        tokio::select! {
            // Behind what was refused nothing is read.
            come = socket.recv(), if to_daemon.is_some() => {
                // What is not understood goes the way of all else: it is told behind what was said before.
                let mut waiting = match heard(come, is_first) {
                    Heard::Said(language, bytes) => {
                        if let (None, Some(language)) = (&translator, language) {
                            translator = Some(Translator::new(language));
                        }
                        match &mut translator {
                            None => Ok(bytes),
                            Some(translator) => translator.frame(&bytes),
                        }
                    }
                    Heard::TooLong(refused) => Err(refused),
                    Heard::Nothing => continue,
                    Heard::Gone => return,
                };
                is_first = false;
                let is_last = waiting.is_err();
                while let Some(sender) = &to_daemon {
                    match sender.try_send(waiting) {
                        Ok(()) => break,
                        Err(TrySendError::Disconnected(_)) => to_daemon = None,
                        Err(TrySendError::Full(back)) => {
                            waiting = back;
                            // What the daemon says goes out meanwhile.
                            if let Ok(frame) = from_daemon.try_recv() {
                                if tell(&mut socket, &translator, frame).await.is_none() {
                                    return;
                                }
                            } else {
                                tokio::time::sleep(RETRY).await;
                            }
                            continue;
                        }
                    }
                    break;
                }
                if is_last {
                    to_daemon = None;
                }
            }
            said = from_daemon.recv() => {
                let Some(frame) = said else { break };
                if tell(&mut socket, &translator, frame).await.is_none() {
                    return;
                }
            }
        }
    }
    let frame = CloseFrame { code: close_code::NORMAL, reason: "".into() };
    let _gone = socket.send(Message::Close(Some(frame))).await;
}

/// What comes over a socket.
enum Heard {
    /// A message; in which language, if it tells.
    Said(Option<Language>, Vec<u8>),
    /// One that is too long to be read.
    TooLong(NotUnderstood),
    /// Nothing that matters here.
    Nothing,
    /// The other side is gone.
    Gone,
}

fn heard(come: Option<Result<Message, axum::Error>>, is_first: bool) -> Heard {
    match come {
        Some(Ok(Message::Binary(bytes))) => {
            let is_cbor = is_first && Language::is_cbor(&bytes);
            Heard::Said(is_cbor.then_some(Language::Cbor), Vec::from(bytes))
        }
        Some(Ok(Message::Text(text))) => {
            Heard::Said(Some(Language::Json), text.as_bytes().to_vec())
        }
        Some(Ok(Message::Ping(_) | Message::Pong(_))) => Heard::Nothing,
        Some(Err(error)) if is_too_long(&error) => {
            let text =
                format!("a message is longer than {MAX_MESSAGE_BYTES} bytes; send shorter blocks");
            let refusal = Refusal::new(ErrorCode::TooLarge, text);
            Heard::TooLong(NotUnderstood { refusal, n_samples: 0 })
        }
        Some(Ok(Message::Close(_)) | Err(_)) | None => Heard::Gone,
    }
}

fn is_too_long(error: &axum::Error) -> bool {
    let cause = std::error::Error::source(error).and_then(|cause| cause.downcast_ref());
    matches!(cause, Some(tungstenite::Error::Capacity(_)))
}

/// Tells the sender what the daemon says; `None`: it is gone.
async fn tell(
    socket: &mut WebSocket,
    translator: &Option<Translator>,
    frame: Vec<u8>,
) -> Option<()> {
    let told = match translator {
        None => frame,
        Some(translator) => translator.told(&frame)?,
    };
    socket.send(message(translator.as_ref(), told)).await.ok()
}

/// A message in what the sender speaks.
fn message(translator: Option<&Translator>, told: Vec<u8>) -> Message {
    match translator.map(Translator::language) {
        Some(Language::Json) => Message::Text(String::from_utf8_lossy(&told).into_owned().into()),
        Some(Language::Cbor) | None => Message::Binary(told.into()),
    }
}
