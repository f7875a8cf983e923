//! The host's side of a board: a library and a command line that drive, watch, tune and trust it.
//!
//! ```text
//!  feature cli    cli ─────────────┐
//!                  v               v
//!  feature io    Client      web::serve            (a line, a clock, sockets, threads)
//!                  │ ^             │ ^
//!  ────────────────│─│─────────────│─│───────────────────────────────────────────────
//!                  v │             v │             bytes, messages and the time
//!  the core      Session <──── web::Panel          (requests, commands, signs of life)
//!                  v
//!               protocol
//! ```
//!
//! The core needs no operating system, only an allocator: bytes and the time go in, bytes and events come
//! out. Tests run it on virtual time; anything with a clock and a line can run it, a browser too.
//! - [`session`]: what is said on a line and when;
//! - [`tune`]: checks and tunings, as jobs over a session;
//! - [`web`]: the page, and the [`Panel`](web::Panel) behind it;
//! - [`link`]: how a way to a board is written;
//! - [`settings`], [`backup`], [`step`]: settings by name and in a file, a step's response;
//! - [`words`]: faults, reasons and units for people, with the remedy.
//!
//! Feature `io` is the core on a computer:
//! - [`transport`]: the ways to a board; [`auto`] finds one;
//! - [`client`]: what a program uses: connect, ask, drive, watch; blocking;
//! - [`web::serve`]: the page's server.
//!
//! Feature `cli`, the default, is the program: [`cli`] has the commands, [`picture`] makes images for the LCD.
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

#[cfg(feature = "io")]
pub mod auto;
pub mod backup;
#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "io")]
pub mod client;
mod error;
pub mod link;
mod motion;
mod number;
#[cfg(feature = "cli")]
pub mod picture;
mod servo;
pub mod session;
pub mod settings;
mod state;
pub mod step;
#[cfg(feature = "io")]
pub mod transport;
pub mod tune;
pub mod web;
pub mod words;

#[cfg(feature = "io")]
pub use client::Client;
pub use error::Error;
pub use link::Link;
pub use motion::target::Target;
pub use number::Number;
