//! How brokers of MQTT are reached, for what is published and what is subscribed to.

use super::client;
use super::client::ClientError;
use crate::notify::settings::Connection;
use rumqttc::ConnectionError;
use rumqttc::MqttOptions;
use rumqttc::TlsConfiguration;
use rumqttc::Transport;

/// Longest message that is read or written, bytes.
const MAX_PACKET_BYTES: usize = 256 * 1024;

/// Silence after which the broker is asked whether it is there, s.
const KEEP_ALIVE_S: u16 = 30;

/// Longest time to connect, s.
pub(super) const CONNECT_S: u64 = 10;

/// How bytes get there.
///
/// # Errors
/// When the certificates cannot be read.
pub(super) fn transport(connection: &Connection) -> Result<Transport, ClientError> {
    if !connection.tls {
        return Ok(Transport::tcp());
    }
    let tls = client::tls(connection.ca_file.as_deref())?;
    Ok(Transport::tls_with_config(TlsConfiguration::Rustls(tls)))
}

/// What a connection is made with.
pub(super) fn options(connection: &Connection, transport: Transport) -> MqttOptions {
    let broker = (connection.host.clone(), connection.port);
    let mut options = MqttOptions::new(connection.client_id.clone(), broker);
    options.set_keep_alive(KEEP_ALIVE_S);
    options.set_max_packet_size(MAX_PACKET_BYTES, MAX_PACKET_BYTES);
    options.set_transport(transport);
    if let Some((user, password)) = &connection.credentials {
        options.set_credentials(user.clone(), password.reveal().to_vec());
    }
    options
}

/// Nothing of an address or a secret is in what a failure says.
#[expect(clippy::wildcard_enum_match_arm, reason = "a library's errors may become more")]
pub(super) fn why(error: &ConnectionError) -> &'static str {
    match error {
        ConnectionError::NetworkTimeout | ConnectionError::FlushTimeout => {
            "does not answer in time"
        }
        ConnectionError::ConnectionRefused(_) => {
            "refuses the connection: client id, user or password"
        }
        ConnectionError::Tls(_) => "its certificate or TLS is not accepted",
        ConnectionError::Io(error) => client::why_io(error.kind()),
        _ => "the connection broke",
    }
}
