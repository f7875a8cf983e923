//! The firmware's ports on a computer.
//!
//! ```text
//!   Plant (motors, servos, sensors, LCD) <── ports ──> firmware::app <── Line ──> host, test
//!                                        Clock (virtual time)
//! ```
//!
//! - [`plant`]: the physics; no operating system needed, plain `f32` arithmetic, the same bits
//!   everywhere, every noise seeded;
//! - [`clock`]: virtual time, one clock a thread;
//! - [`wire`]: the serial line, paced like a UART;
//! - [`servo_bus`]: AX-12 servos on their one wire;
//! - [`board`]: the firmware's own tasks over all of these: a [`board::VirtualBoard`].
//!
//! Tests move the clock by hand; the program `virtual-board` moves it with the wall clock.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

pub mod plant;

#[cfg(feature = "std")]
pub mod board;
#[cfg(feature = "std")]
pub mod clock;
#[cfg(feature = "std")]
pub mod scene_file;
#[cfg(feature = "std")]
pub mod servo_bus;
#[cfg(feature = "std")]
pub mod wire;
