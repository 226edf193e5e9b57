//! Signatures of webhook messages as "Standard Webhooks" 1.0.0 has them, so that a receiver verifies them with
//! a library of its language or five lines of its own: HMAC-SHA-256 over `id.timestamp.body`, in base64.

use super::Secret;
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use hmac::Hmac;
use hmac::KeyInit;
use hmac::Mac;
use sha2::Sha256;

/// Beginning of a secret that is written in base64.
const ENCODED: &str = "whsec_";

/// Fewest bytes of a key.
pub const MIN_KEY_BYTES: usize = 16;

/// Reads a secret as it is written: `whsec_` and base64, or the key itself.
///
/// # Errors
/// What is wrong with it; it does not say the secret.
pub fn read_key(text: &str) -> Result<Secret, &'static str> {
    let key = match text.strip_prefix(ENCODED) {
        Some(encoded) => BASE64_STANDARD
            .decode(encoded)
            .map_err(|_| "a secret that begins with whsec_ goes on in base64")?,
        None => text.as_bytes().to_vec(),
    };
    if key.len() < MIN_KEY_BYTES {
        return Err("a secret has at least 16 bytes: make one with `openssl rand -hex 32`");
    }
    Ok(Secret::new(key))
}

/// The header `webhook-signature` of a message sent at `timestamp_s`, UTC seconds since 1970.
#[must_use]
pub fn sign(key: &Secret, id: &str, timestamp_s: i64, body: &str) -> String {
    // HMAC takes keys of any length.
    let Ok(mut mac) = Hmac::<Sha256>::new_from_slice(key.reveal()) else { return String::new() };
    for part in [id, ".", &timestamp_s.to_string(), ".", body] {
        mac.update(part.as_bytes());
    }
    format!("v1,{}", BASE64_STANDARD.encode(mac.finalize().into_bytes()))
}
