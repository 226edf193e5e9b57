//! `rotorwatch replay`: streams a capture into a running daemon, as acquisition hardware would.

use super::hints::HintArguments;
use super::secret;
use crate::app;
use crate::app::client::ClientError;
use crate::app::client::tls;
use crate::app::live::client;
use crate::app::live::client::SendError;
use crate::app::live::client::Sender;
use crate::app::live::line::Address;
use crate::capture::map::MapError;
use crate::capture::reader::CaptureReader;
use crate::capture::received::RawSamples;
use crate::ingest::outgoing;
use crate::ingest::outgoing::Outlet;
use crate::ingest::replay;
use crate::ingest::replay::ReplayError;
use crate::ingest::replay::Speed;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use crate::wire::Block;
use crate::wire::Bye;
use crate::wire::Hello;
use crate::wire::Samples;
use clap::Args;
use std::io;
use std::path::Path;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch replay run-7.h5 --to tcp://127.0.0.1:8081
  rotorwatch replay run-7.h5 --to tcp://127.0.0.1:8081 --machine rig-1 --speed max
  rotorwatch replay run-7.h5 --to http://127.0.0.1:8080 --speed max
  rotorwatch replay run-7.h5 --to tls://monitor:8081 --ca-file plant-ca.pem --token-file sender.token --speed 10
  rotorwatch replay run-7.h5 --to https://monitor:8080 --token-file sender.token

The daemon needs a [[source]] of kind \"tcp\" for the machine (docs/wire.md); the second line it prints is the address.
The samples are stamped as if they were measured now. A connection that breaks is made again, and nothing is lost.

Exit codes: 0 everything has come to the daemon; 2 an error.";

/// Bytes that may wait to be settled.
const MAX_KEPT_BYTES: usize = 4 << 20;

/// A machine that says nothing of any channel.
const NO_MACHINE: &str = "[machine]\nid = \"none\"\n[[shaft]]\nid = \"none\"\n";

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The capture: HDF5, CSV or WAV.
    #[arg(value_name = "CAPTURE")]
    pub capture: PathBuf,
    /// The daemon: `tcp://HOST:PORT` where it listens to senders, or `http://HOST:PORT`, over a WebSocket; encrypted: `tls` and `https`.
    #[arg(long, value_name = "URL")]
    pub to: String,
    /// Id of the machine; default: that of the machine file in the capture, else the only machine of the daemon.
    #[arg(long, value_name = "ID")]
    pub machine: Option<String>,
    /// Stream seconds a second, or `max`.
    #[arg(long, value_name = "1|N|max", default_value = "1", value_parser = speed)]
    pub speed: Speed,
    /// File whose first line is the access token.
    #[arg(long, value_name = "FILE")]
    pub token_file: Option<PathBuf>,
    /// Certificates (PEM) of the authorities to trust instead of the system's.
    #[arg(long, alias = "ca", value_name = "FILE")]
    pub ca_file: Option<PathBuf>,
    /// What the file does not say.
    #[command(flatten)]
    pub hints: HintArguments,
}

/// Why it did not all come to the daemon.
#[derive(Debug, thiserror::Error)]
enum Failure {
    #[error(
        "{to:?} is no address of a daemon: tcp://HOST:PORT or tls://HOST:PORT, as the second line of `rotorwatch serve` says, or its http://HOST:PORT or https://HOST:PORT"
    )]
    Address { to: String },
    #[error("{}: the token cannot be read", file.display())]
    Token { file: PathBuf, source: io::Error },
    #[error(transparent)]
    Map(#[from] MapError),
    #[error(transparent)]
    Machine(#[from] MachineFileErrors),
    #[error(transparent)]
    Replay(#[from] ReplayError),
    #[error("no connection can be tried")]
    Client(#[from] ClientError),
    #[error("sending failed")]
    Send(#[from] SendError),
}

/// Streams the capture; exit code 0 when all of it has come to the daemon, else 2.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    match stream(arguments) {
        Ok(text) => super::print(text.as_bytes()),
        Err(failure) => super::fail(&failure),
    }
}

fn stream(arguments: &Arguments) -> Result<String, Failure> {
    let address = Address::parse(&arguments.to);
    let address = address.ok_or_else(|| Failure::Address { to: arguments.to.clone() })?;
    let trust = address.encrypts().then(|| tls(arguments.ca_file.as_deref())).transpose()?;
    let token = arguments.token_file.as_deref().map(token).transpose()?.unwrap_or_default();
    let hints = arguments.hints.hints()?;
    let path = &arguments.capture;
    let failed = |source| ReplayError::Open { file: path.clone(), source: Box::new(source) };
    let about = CaptureReader::open(path, None, &hints).map_err(failed)?;
    let of_capture = about.info().machine.as_deref().and_then(|text| {
        let parsed = file::parse(text, "the capture's machine file");
        parsed.map_err(|mistakes| tracing::warn!(%mistakes, "the machine file in the capture")).ok()
    });
    let duration_s = about.info().duration_s;
    // Units and sensitivities are the daemon's business: it has the machine file.
    let known = of_capture.as_ref().map(|machine| machine.id.clone());
    let id = arguments.machine.clone().or(known).unwrap_or_default();
    let machine = match of_capture {
        Some(machine) => machine,
        None => file::parse(NO_MACHINE, "no machine file")?,
    };
    let opened = replay::open_with_received(path, &machine, &hints)?;
    let (shaft_speed, load) = (opened.info.shaft_speed, opened.info.load);
    let mut outlet = Outlet::new(opened);
    let hello = Hello {
        machine: id,
        token,
        epoch: app::wall_clock().0.cast_unsigned(),
        shaft_speed_hz: shaft_speed.map(|speed| speed.0),
        load,
        channels: outlet.channels(),
    };
    let n_channels = hello.channels.len();
    // No sample shall be of the future, however fast it comes.
    let ahead_s = match arguments.speed {
        Speed::Max => duration_s,
        Speed::Times(factor) => duration_s * (1.0 - factor.recip()).max(0.0),
    };
    let mut sender = Sender::connect(&address, trust, hello)?;
    let begun = app::now();
    let start = app::wall_clock().plus_seconds(-ahead_s);
    let mut n_samples = 0_u64;
    while let Some(out) = outlet.take()? {
        if let Speed::Times(factor) = arguments.speed {
            let due = Duration::try_from_secs_f64(out.time_s.1 / factor).unwrap_or_default();
            client::wait_until(begun + due);
        }
        n_samples += out.raw.len() as u64;
        let bytes = outgoing::bytes_of(&out.raw);
        let kind = outgoing::sample_type(RawSamples::number_type(&out.raw));
        let Some(samples) = Samples::new(kind, &bytes) else { continue };
        let time_ns = start.plus_seconds(out.time_s.0).0;
        let (stream, sequence, first) = (out.stream, out.sequence, out.first);
        sender.send(&Block { stream, sequence, first, time_ns, samples }, MAX_KEPT_BYTES)?;
    }
    let n_reconnects = sender.n_reconnects();
    sender.finish(Bye::End)?;
    let took_s = app::now().saturating_duration_since(begun).as_secs_f64();
    Ok(format!(
        "{}: {n_samples} samples of {n_channels} channels sent in {took_s:.1} s, {n_reconnects} reconnects\n",
        path.display()
    ))
}

fn token(file: &Path) -> Result<String, Failure> {
    secret::read(file).map_err(|source| Failure::Token { file: file.to_owned(), source })
}

fn speed(text: &str) -> Result<Speed, String> {
    match text.parse::<f64>() {
        _ if text == "max" => Ok(Speed::Max),
        Ok(factor) if factor > 0.0 && factor.is_finite() => Ok(Speed::Times(factor)),
        Ok(_) | Err(_) => Err("not \"max\" or a number above 0".to_owned()),
    }
}
