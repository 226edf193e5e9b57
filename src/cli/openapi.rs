//! `rotorwatch openapi`: prints the API document.

use crate::api;
use std::io;
use std::io::Write;

/// Writes the OpenAPI 3.1 document of the HTTP API as indented JSON.
///
/// # Errors
/// When `out` cannot be written.
pub fn run(out: &mut dyn Write) -> io::Result<()> {
    out.write_all(api::openapi_text().as_bytes())?;
    out.flush()
}
