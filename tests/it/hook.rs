//! A small real HTTP server that receives webhooks, and dies and lives as a test says.

use serde_json::Value;
use std::collections::BTreeMap;
use std::io::BufRead;
use std::io::BufReader;
use std::io::Read;
use std::io::Write;
use std::net::TcpListener;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::AtomicU16;
use std::sync::atomic::Ordering;
use std::thread;

/// One message as it was received.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    /// Headers, names in lower case.
    pub(crate) headers: BTreeMap<String, String>,
    /// Body as it was sent.
    pub(crate) body: String,
    /// Status that was answered.
    pub(crate) status: u16,
}

impl Message {
    /// The body.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }

    /// Its id.
    pub(crate) fn id(&self) -> String {
        self.json()["id"].as_str().unwrap().to_owned()
    }
}

/// The server; ends with the process.
#[derive(Debug, Clone)]
pub(crate) struct Hook {
    /// Such as `http://127.0.0.1:40123/hook`.
    pub(crate) url: String,
    /// Everything received, in its order.
    messages: Arc<Mutex<Vec<Message>>>,
    /// What is answered.
    status: Arc<AtomicU16>,
}

/// A server's side of TLS as `localhost`, and its certificate.
pub(crate) fn tls() -> (Arc<rustls::ServerConfig>, String) {
    let made = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    let key = rustls_pki_types::PrivatePkcs8KeyDer::from(made.signing_key.serialize_der());
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let config = rustls::ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_no_client_auth()
        .with_single_cert(vec![made.cert.der().clone()], key.into())
        .unwrap();
    (Arc::new(config), made.cert.pem())
}

impl Hook {
    /// Starts one that answers `status`.
    pub(crate) fn start(status: u16) -> Self {
        Self::listen(status, "http://127.0.0.1", |hook, stream| {
            hook.serve(stream);
        })
    }

    /// Starts one behind TLS, with its certificate.
    pub(crate) fn start_tls() -> (Self, String) {
        let (config, certificate) = tls();
        let hook = Self::listen(200, "https://localhost", move |hook, stream| {
            let connection = rustls::ServerConnection::new(Arc::clone(&config)).unwrap();
            hook.serve(rustls::StreamOwned::new(connection, stream));
        });
        (hook, certificate)
    }

    fn listen(
        status: u16,
        scheme_and_host: &str,
        serve: impl Fn(&Self, TcpStream) + Clone + Send + 'static,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let url = format!("{scheme_and_host}:{port}/hook");
        let status = Arc::new(AtomicU16::new(status));
        let hook = Self { url, messages: Arc::default(), status };
        let server = hook.clone();
        thread::spawn(move || {
            for stream in listener.incoming() {
                let (server, serve) = (server.clone(), serve.clone());
                thread::spawn(move || serve(&server, stream.unwrap()));
            }
        });
        hook
    }

    /// Answers this from now on.
    pub(crate) fn answer(&self, status: u16) {
        self.status.store(status, Ordering::SeqCst);
    }

    /// Everything received so far.
    pub(crate) fn messages(&self) -> Vec<Message> {
        self.messages.lock().unwrap().clone()
    }

    /// Ids of what was taken, in the order of their arrival.
    pub(crate) fn taken(&self) -> Vec<String> {
        let messages = self.messages();
        messages.iter().filter(|message| message.status < 300).map(Message::id).collect()
    }

    /// Serves requests until the client goes, or dies in the middle of one.
    fn serve(&self, stream: impl Read + Write) -> Option<()> {
        let mut reader = BufReader::new(stream);
        loop {
            let mut line = String::new();
            if reader.read_line(&mut line).ok()? == 0 {
                return None;
            }
            assert!(line.starts_with("POST /hook"), "{line}");
            let mut headers = BTreeMap::new();
            loop {
                let mut line = String::new();
                reader.read_line(&mut line).ok()?;
                let Some((name, value)) = line.trim_end().split_once(": ") else { break };
                headers.insert(name.to_lowercase(), value.to_owned());
            }
            let length = headers.get("content-length")?.parse().unwrap();
            let mut body = vec![0; length];
            reader.read_exact(&mut body).ok()?;
            let body = String::from_utf8(body).unwrap();
            // Noted before it is answered: who is killed now will send it again.
            let status = self.status.load(Ordering::SeqCst);
            self.messages.lock().unwrap().push(Message { headers, body, status });
            let location = if status == 307 { "location: /elsewhere\r\n" } else { "" };
            let answer = format!("HTTP/1.1 {status} X\r\n{location}content-length: 0\r\n\r\n");
            reader.get_mut().write_all(answer.as_bytes()).ok()?;
            reader.get_mut().flush().ok()?;
        }
    }
}
