//! The images that people flash, executed as they are: on an STM32F407 that others modelled
//! ([rigless](https://crates.io/crates/rigless)), on a bench with motors, sensors, servos and hosts.
//!
//! - [`part`]: the chip, with our models of what rigless leaves out;
//! - [`bench`]: what is around it, and how a test runs it.
//!
//! `.ci/chip` builds the images and runs the scenarios in `tests/`; `.ci/chip serve` offers a chip's
//! host line over TCP. What a model covers and what it leaves out stands at its head; nothing here is
//! silicon, and its time is a fixed number of instructions a second.

pub mod bench;
pub mod part;
