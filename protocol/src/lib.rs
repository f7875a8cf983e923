#![doc = include_str!("../README.md")]
//!
//! # The crate
//! Both directions of all of it, typed.
//!
//! ```text
//!  bytes ──> Deframer<Framing> ──> Frame ──> Command      (what a host asks)
//!  bytes <── Frame::encode     <── Report <── values      (what a board tells)
//! ```
//!
//! The crate knows bytes and nothing else: no time, no I/O, no control. Boards decode commands
//! and encode reports with it; hosts and tests do the opposite with the same types. The tables above
//! stand nowhere else; the modules name the offsets and ranges that they use.
//!
//! - [`cm5`]: the link between a PC and a CM-5, as we reconstructed it;
//! - [`deframe`]: the resynchronising receiver, generic over a [`deframe::Framing`];
//! - [`pms5005`]: the WiRobot PMS5005 motion and sensing controller;
//! - [`extension`]: settings, health and faults by number, carried by the PMS5005's frames and by ARCOS;
//! - [`arcos`]: the packets of ARCOS, and the Pioneer Arm's among them;
//! - [`dynamixel`]: the servo bus of the CM-5 and its AX-12 servos.
//!
//! ## Promises
//! - Any bytes, in chunks of any size, never panic: there is no indexing, no `unwrap`, no
//!   arithmetic that can overflow, no lossy `as`, and the lints below hold us to it.
//! - No heap, no `unsafe`, no global state. Every buffer has a fixed bound.
//! - Numbers of the wire stand once, beside the figure of the manual they come from.
//!
//! ## Features of the package
//! - `defmt`: `defmt::Format` on the public types.
//! - `std`: nothing here needs it; hosts may switch it on to have the crate linked with `std`.
#![cfg_attr(not(any(test, feature = "std")), no_std)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::arithmetic_side_effects,
        clippy::cast_lossless,
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        clippy::expect_used,
        clippy::indexing_slicing,
        clippy::panic,
        clippy::unreachable,
        clippy::unwrap_used
    )
)]

pub mod arcos;
pub mod cm5;
mod data;
pub mod deframe;
pub mod dynamixel;
pub mod extension;
pub mod pms5005;
mod repeat;
