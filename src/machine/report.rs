//! The machine and its lines as aligned text for people.
