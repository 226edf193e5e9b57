//! The daemon as a user meets it: the built program, its port, its signals.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]
#![expect(clippy::panic, reason = "a test may panic; clippy exempts only #[test] functions")]

mod support;
#[path = "../fences/mod.rs"]
mod fences;
mod examples;
mod access;
mod secrets;
mod tools;
mod scene;
mod impulses;
mod command_line;
mod replay;
mod live;
mod startup;
mod shutdown;
mod damaged_bearing;
mod slow;
mod gaps;
mod hook;
mod mqtt;
mod values;
mod neighbours;
mod notify;
mod event_stream;
mod reload;
mod silences;
mod maintenance;
mod foreign;
mod rubbish;
mod recordings;
mod recorder;
mod backup;
mod kill;
mod survive;
mod disk_full;
mod trends;
mod captures;
mod baseline;
mod browser;
mod page;
mod page_acts;
mod page_tokens;
mod page_figures;
mod pictures;
mod diagnose;
mod evaluate;
mod text_and_sound;
mod check;
mod demo;
mod simulated;
mod combinations;
mod bench;
mod load;
mod ends;
