//! A sender's connection to the daemon: over TCP, or over a WebSocket of its HTTP address.

use crate::wire::Frames;
use rustls::ClientConfig;
use rustls::ClientConnection;
use rustls::StreamOwned;
use rustls_pki_types::ServerName;
use std::io;
use std::io::Read;
use std::io::Write;
use std::net::TcpStream;
use std::net::ToSocketAddrs;
use std::sync::Arc;
use std::time::Duration;
use tungstenite::ClientHandshake;
use tungstenite::ClientRequestBuilder;
use tungstenite::HandshakeError;
use tungstenite::Message;
use tungstenite::WebSocket;

/// Longest wait for a connection, and for the daemon to take what is written.
const CONNECT: Duration = Duration::from_secs(5);
const WRITE: Duration = Duration::from_secs(30);

/// Where the daemon takes samples over HTTP.
const PATH: &str = "/api/v1/ingest";

/// Where a daemon is, and whether what is said there is encrypted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Address {
    /// Its listener of senders, `host:port`.
    Tcp(String, bool),
    /// Its HTTP address, `host:port`.
    Web(String, bool),
}

impl Address {
    /// Reads `tcp://HOST:PORT`, `ws://HOST:PORT` or `http://HOST:PORT`; encrypted `tls`, `wss` and `https`. The path may be given or not.
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
            "tcp" => Some(Self::Tcp(host.to_owned(), false)),
            "tls" => Some(Self::Tcp(host.to_owned(), true)),
            "ws" | "http" => Some(Self::Web(host.to_owned(), false)),
            "wss" | "https" => Some(Self::Web(host.to_owned(), true)),
            _ => None,
        }
    }

    /// As it is written.
    #[must_use]
    pub fn url(&self) -> String {
        match self {
            Self::Tcp(host, false) => format!("tcp://{host}"),
            Self::Tcp(host, true) => format!("tls://{host}"),
            Self::Web(host, false) => format!("ws://{host}{PATH}"),
            Self::Web(host, true) => format!("wss://{host}{PATH}"),
        }
    }

    /// Whether what is said there is encrypted.
    #[must_use]
    pub fn encrypts(&self) -> bool {
        let (Self::Tcp(_, encrypts) | Self::Web(_, encrypts)) = self;
        *encrypts
    }

    /// Its host and port.
    fn host(&self) -> &str {
        let (Self::Tcp(host, _) | Self::Web(host, _)) = self;
        host
    }

    /// The name its certificate must have.
    fn server_name(&self) -> io::Result<ServerName<'static>> {
        let name = self.host().rsplit_once(':').map_or("", |(name, _)| name);
        let literal = name.strip_prefix('[').and_then(|n| n.strip_suffix(']')).unwrap_or(name);
        ServerName::try_from(literal.to_owned()).map_err(io::Error::other)
    }
}

/// A stream, encrypted or not.
#[derive(Debug)]
pub(super) enum Socket {
    Plain(TcpStream),
    Encrypted(Box<StreamOwned<ClientConnection, TcpStream>>),
}

impl Socket {
    fn tcp(&self) -> &TcpStream {
        match self {
            Self::Plain(stream) => stream,
            Self::Encrypted(stream) => stream.get_ref(),
        }
    }
}

impl Read for Socket {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(bytes),
            Self::Encrypted(stream) => stream.read(bytes),
        }
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.write(bytes),
            Self::Encrypted(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.flush(),
            Self::Encrypted(stream) => stream.flush(),
        }
    }
}

/// A connection.
#[derive(Debug)]
pub(super) enum Line {
    Tcp(Socket),
    Web(Box<WebSocket<Socket>>),
}

impl Line {
    /// Connects; `trust`: whose certificates are accepted, needed where it is encrypted. `token`: who connects, where that
    /// is said before the hello.
    pub(super) fn open(
        address: &Address,
        trust: Option<&Arc<ClientConfig>>,
        token: &str,
    ) -> io::Result<Self> {
        let found = address.host().to_socket_addrs()?.next().ok_or(io::ErrorKind::NotFound)?;
        let stream = TcpStream::connect_timeout(&found, CONNECT)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE))?;
        stream.set_read_timeout(Some(CONNECT))?;
        let mut socket = match (address.encrypts(), trust) {
            (false, _) => Socket::Plain(stream),
            (true, None) => return Err(io::Error::other("nobody is trusted")),
            (true, Some(trust)) => {
                let config = Arc::clone(trust);
                let connection = ClientConnection::new(config, address.server_name()?);
                let connection = connection.map_err(io::Error::other)?;
                Socket::Encrypted(Box::new(StreamOwned::new(connection, stream)))
            }
        };
        if let Socket::Encrypted(stream) = &mut socket {
            // The handshake now, so that what is wrong with it is told as that.
            while stream.conn.is_handshaking() {
                stream.conn.complete_io(&mut stream.sock)?;
            }
        }
        if matches!(address, Address::Tcp(..)) {
            return Ok(Self::Tcp(socket));
        }
        let mut request =
            ClientRequestBuilder::new(address.url().parse().map_err(io::Error::other)?);
        if !token.is_empty() {
            request = request.with_header("authorization", format!("Bearer {token}"));
        }
        let (socket, _) = tungstenite::client(request, socket).map_err(refused)?;
        Ok(Self::Web(Box::new(socket)))
    }

    /// Sends a frame.
    pub(super) fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                stream.write_all(frame)?;
                stream.flush()
            }
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
            Self::Tcp(socket) => socket.tcp(),
            Self::Web(socket) => socket.get_ref().tcp(),
        };
        if wait.is_zero() {
            stream.set_nonblocking(true)?;
        } else {
            stream.set_read_timeout(Some(wait))?;
        }
        let read = self.read(frames);
        let stream = match self {
            Self::Tcp(socket) => socket.tcp(),
            Self::Web(socket) => socket.get_ref().tcp(),
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

/// Why a WebSocket was not opened: what the daemon says, if it does.
fn refused(error: HandshakeError<ClientHandshake<Socket>>) -> io::Error {
    let HandshakeError::Failure(tungstenite::Error::Http(response)) = error else {
        return io::Error::other(error.to_string());
    };
    match response.status().as_u16() {
        401 | 403 => {
            let kind = io::ErrorKind::PermissionDenied;
            io::Error::new(kind, "the token is missing, unknown or not for sending samples")
        }
        status => io::Error::other(format!("the daemon answers with status {status}")),
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
        let tcp = Address::Tcp("127.0.0.1:8081".to_owned(), false);
        let web = Address::Web("127.0.0.1:8080".to_owned(), false);
        let encrypted = Address::Web("h:1".to_owned(), true);
        assert_eq!(Address::parse("https://h:1"), Some(encrypted.clone()));
        assert_eq!(Address::parse(&encrypted.url()), Some(encrypted));
        let encrypted = Address::Tcp("[::1]:1".to_owned(), true);
        assert_eq!(Address::parse(&encrypted.url()), Some(encrypted.clone()));
        assert_eq!(encrypted.server_name().unwrap(), ServerName::try_from("::1").unwrap());
        assert_eq!(Address::parse("tcp://127.0.0.1:8081"), Some(tcp.clone()));
        for url in
            ["http://127.0.0.1:8080", "ws://127.0.0.1:8080/", "ws://127.0.0.1:8080/api/v1/ingest"]
        {
            assert_eq!(Address::parse(url), Some(web.clone()), "{url}");
        }
        for url in [
            "127.0.0.1:8081",
            "tcp://127.0.0.1",
            "ftp://h:1",
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
