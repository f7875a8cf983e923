//! The host's side of a board: a library and a command line that drive, watch, tune and trust it.
//!
//! ```text
//!  cli ──> Client ──> Session ──> protocol         (requests, commands, signs of life)
//!            │  ^        │ ^
//!            v  │        v │  bytes and the time
//!          Transport: serial, TCP, UDP
//! ```
//!
//! - [`session`]: what is said on a line and when, without I/O: bytes and the time go in, bytes and
//!   events come out. Tests run it on virtual time; anything with a clock and a line can run it;
//! - [`transport`] and [`link`]: the ways to a board, and how they are written; [`auto`] finds one;
//! - [`client`]: what a program uses: connect, ask, drive, watch; blocking;
//! - [`words`]: faults, reasons and units for people, with the remedy;
//! - [`backup`], [`step`], [`picture`]: settings in a file, a step's response, an image for the LCD;
//! - [`cli`]: the commands;
//! - [`web`]: the page, and the session without I/O behind it, beside the blocking client.
//!
//! **People see channels 1 to 6** here, as in setting names and on the board's labels; the wire has 0 to
//! 5. [`Number`] is the people's, and is turned into the wire's in one place.
//!
//! # Promises
//! - Only while it drives does it send signs of life: who only asks and watches keeps nothing running.
//! - What it drives it stops, however the driving ends: by its time, by an error, by Ctrl-C. If the
//!   program itself is killed, the board's own watch over silence does.
//! - Every failure is one line that says what is wrong and what to do.
//!
//! ```no_run
//! # fn main() -> Result<(), handwheel::Error> {
//! use handwheel::{Client, Number, Target};
//! use std::time::Duration;
//!
//! let mut board = Client::connect(&"tcp:127.0.0.1:5005".parse()?)?;
//! let mut drive = board.drive(Number::ONE, Target::Velocity(4000), Duration::ZERO)?;
//! drive.hold(Duration::from_secs(2))?;
//! println!("{:?}", drive.stop()?);
//! # Ok(())
//! # }
//! ```
#![forbid(unsafe_code)]
#![deny(missing_docs)]

pub mod auto;
pub mod backup;
#[cfg(feature = "cli")]
pub mod cli;
pub mod client;
mod error;
pub mod link;
mod motion;
mod number;
#[cfg(feature = "cli")]
pub mod picture;
pub mod session;
pub mod step;
pub mod transport;
pub mod tune;
pub mod web;
pub mod words;

pub use client::{Client, Target};
pub use error::Error;
pub use link::Link;
pub use number::Number;
