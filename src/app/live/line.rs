//! A sender's connection to the daemon: over TCP, or over a WebSocket of its HTTP address.

use crate::wire::Frames;
use std::io;
use std::io::Read;
use std::io::Write;
use std::net::TcpStream;
use std::net::ToSocketAddrs;
use std::time::Duration;
use tungstenite::Message;
use tungstenite::WebSocket;

/// Longest wait for a connection, and for the daemon to take what is written.
const CONNECT: Duration = Duration::from_secs(5);
const WRITE: Duration = Duration::from_secs(30);

/// Where the daemon takes samples over HTTP.
const PATH: &str = "/api/v1/ingest";

/// Where a daemon is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// Its listener of senders, `host:port`.
    Tcp(String),
    /// Its HTTP address, `host:port`.
    Web(String),
}

impl Address {
    /// Reads `tcp://HOST:PORT`, `ws://HOST:PORT` or `http://HOST:PORT`; the path of the last two may be given or not.
    #[must_use]
    pub fn parse(url: &str) -> Option<Self> {
        let (scheme, rest) = url.split_once("://")?;
        let rest = rest.strip_suffix(PATH).unwrap_or(rest);
        let host = rest.strip_suffix('/').unwrap_or(rest);
        let (name, port) = host.rsplit_once(':')?;
        if name.is_empty() || name.contains(['/', '@', '?', '#']) || port.parse::<u16>().is_err() {
            return None;
        }
        match scheme {
            "tcp" => Some(Self::Tcp(host.to_owned())),
            "ws" | "http" => Some(Self::Web(host.to_owned())),
            _ => None,
        }
    }

    /// As it is written.
    #[must_use]
    pub fn url(&self) -> String {
        match self {
            Self::Tcp(host) => format!("tcp://{host}"),
            Self::Web(host) => format!("ws://{host}{PATH}"),
        }
    }
}

/// A connection.
#[derive(Debug)]
pub(super) enum Line {
    Tcp(TcpStream),
    Web(Box<WebSocket<TcpStream>>),
}

impl Line {
    /// Connects.
    pub(super) fn open(address: &Address) -> io::Result<Self> {
        let (Address::Tcp(host) | Address::Web(host)) = address;
        let found = host.to_socket_addrs()?.next().ok_or(io::ErrorKind::NotFound)?;
        let stream = TcpStream::connect_timeout(&found, CONNECT)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE))?;
        if matches!(address, Address::Tcp(_)) {
            return Ok(Self::Tcp(stream));
        }
        stream.set_read_timeout(Some(CONNECT))?;
        let (socket, _) = tungstenite::client(address.url(), stream)
            .map_err(|error| io::Error::other(error.to_string()))?;
        Ok(Self::Web(Box::new(socket)))
    }

    /// Sends a frame.
    pub(super) fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.write_all(frame),
            Self::Web(socket) => socket.send(Message::binary(frame.to_vec())).map_err(io_error),
        }
    }

    /// Takes in bytes, waiting for them; 0: none have come, `None`: none will.
    pub(super) fn receive(
        &mut self,
        frames: &mut Frames,
        wait: Duration,
    ) -> io::Result<Option<usize>> {
        let stream = match self {
            Self::Tcp(stream) => &*stream,
            Self::Web(socket) => socket.get_ref(),
        };
        if wait.is_zero() {
            stream.set_nonblocking(true)?;
        } else {
            stream.set_read_timeout(Some(wait))?;
        }
        let read = self.read(frames);
        let stream = match self {
            Self::Tcp(stream) => &*stream,
            Self::Web(socket) => socket.get_ref(),
        };
        if wait.is_zero() {
            stream.set_nonblocking(false)?;
        }
        match read {
            Ok(0) => Ok(None),
            Ok(n) => Ok(Some(n)),
            Err(error) => {
                use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
                let is_waiting = matches!(error.kind(), WouldBlock | TimedOut | Interrupted);
                if is_waiting { Ok(Some(0)) } else { Err(error) }
            }
        }
    }

    /// Reads once; 0: the daemon has closed.
    fn read(&mut self, frames: &mut Frames) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => {
                let n = stream.read(frames.space())?;
                frames.filled(n);
                Ok(n)
            }
            Self::Web(socket) => match socket.read().map_err(io_error)? {
                Message::Binary(bytes) if !bytes.is_empty() => {
                    frames.push(&bytes);
                    Ok(bytes.len())
                }
                Message::Close(_) => Ok(0),
                Message::Binary(_)
                | Message::Text(_)
                | Message::Ping(_)
                | Message::Pong(_)
                | Message::Frame(_) => Err(io::ErrorKind::WouldBlock.into()),
            },
        }
    }
}

fn io_error(error: tungstenite::Error) -> io::Error {
    if let tungstenite::Error::Io(error) = error {
        return error;
    }
    io::Error::other(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_those_that_the_daemon_prints() {
        let tcp = Address::Tcp("127.0.0.1:8081".to_owned());
        let web = Address::Web("127.0.0.1:8080".to_owned());
        assert_eq!(Address::parse("tcp://127.0.0.1:8081"), Some(tcp.clone()));
        for url in
            ["http://127.0.0.1:8080", "ws://127.0.0.1:8080/", "ws://127.0.0.1:8080/api/v1/ingest"]
        {
            assert_eq!(Address::parse(url), Some(web.clone()), "{url}");
        }
        for url in [
            "127.0.0.1:8081",
            "tcp://127.0.0.1",
            "https://h:1",
            "tcp://:1",
            "http://u@h:1",
            "http://h:1/x",
        ] {
            assert_eq!(Address::parse(url), None, "{url}");
        }
        assert_eq!(Address::parse(&tcp.url()), Some(tcp));
        assert_eq!(Address::parse(&web.url()), Some(web));
    }
}
