//! Who may do what: tokens, their roles, and the door that lets them in.
//!
//! A token is 256 random bits, known by its SHA-256 only. Without a file of tokens the door is open, which only an
//! address of this computer may have. Must not know HTTP, sockets, files or what is behind the door.

mod token;
mod list;
mod buckets;
mod door;

pub use door::Counters;
pub use door::Denied;
pub use door::Door;
pub use door::Now;
pub use door::REQUESTS_A_SECOND;
pub use list::ListError;
pub use list::MAX_TOKENS;
pub use list::Tokens;
pub use token::Role;
pub use token::Secret;
pub use token::Token;
pub use token::TokenError;

#[cfg(test)]
mod tests;
