//! The controller's firmware as a library: everything that is not a pin.
//!
//! ```text
//!  bytes -> Deframer -> Personality -> Command -> Controller -> Outputs -> ports -> motors, servos
//!  bytes <- encode   <- Personality <- Snapshot <- Controller <- Inputs  <- ports <- encoders, A/D
//! ```
//!
//! | module | what it is |
//! |---|---|
//! | [`units`] | quantities, each with its unit in its type |
//! | [`ports`] | what hardware must offer |
//! | [`control`] | pure control: PID, trajectories, velocity, one channel, one servo |
//! | [`command`] | the controller's vocabulary |
//! | [`controller`] | one step a control period over six channels and six servos |
//! | [`safety`] | link silence, collision protection, faults |
//! | [`personality`] | sessions without I/O: how a controller of old presents itself |
//! | [`bridge`] | the CM-5, which has no controller: a session between a PC and a servo bus, and its tasks |
//! | [`settings`] | what an owner may choose |
//! | [`app`] | the tasks of a controller; only here and in [`bridge::tasks`] time passes |
//! | [`liveness`] | who feeds the watchdog, and when no more |
//! | `reception` | what all sessions and their tasks share in listening to a line |
//! | `board` | pins, timers, DMA: for the target only, and alone in using `unsafe` |
//!
//! It builds for the Cortex-M4 and for a computer; a board, QEMU and the virtual board differ in
//! their ports and their clock, in nothing else.
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

mod fmt;

pub mod app;
#[cfg(all(target_os = "none", feature = "stm32f4"))]
#[allow(unsafe_code)] // registers and interrupt vectors; every block says why it may
pub mod board;
pub mod bridge;
pub mod command;
pub mod control;
pub mod controller;
pub mod liveness;
pub mod personality;
pub mod ports;
mod reception;
pub mod safety;
pub mod settings;
pub mod units;
