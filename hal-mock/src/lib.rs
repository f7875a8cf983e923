//! The firmware's ports on a computer.
//!
//! ```text
//!   Plant (motors, servos, sensors, LCD) <── ports ──> firmware::app <── Line ──> host, test
//!                                        Clock (virtual time)
//! ```
//!
//! - [`plant`]: the physics; plain `f32` arithmetic, the same bits everywhere, every noise seeded;
//! - [`clock`]: virtual time, one clock a thread;
//! - [`tasks`]: the firmware's own tasks over the plant and the clock;
//! - [`wire`]: the serial line, paced like a UART;
//! - [`flash`]: the memory for the settings, which may lose power at any byte;
//! - [`servo_bus`]: AX-12 servos on their one wire;
//! - [`board`]: all of these but the servo bus: a [`board::VirtualBoard`];
//! - [`cm5_board`]: the CM-5's bridge over a line and a servo bus: a [`cm5_board::Cm5Board`];
//! - [`pass_through_board`]: the same as a pass-through;
//! - [`machine`]: any of them, as JSON shows and sets it, and [`scene_file`]: a world in TOML.
//!
//! Tests move the clock by hand; the program `virtual-board` moves it with the wall clock. The
//! first three need no operating system: the image `src/bin/qemu` runs the same tasks over the
//! same plant on a Cortex-M, with SysTick to move the clock.
#![cfg_attr(not(feature = "std"), no_std)]
#![forbid(unsafe_code)]

pub mod clock;
pub mod plant;
pub mod tasks;

#[cfg(feature = "std")]
pub mod board;
#[cfg(feature = "std")]
pub mod cm5_board;
#[cfg(feature = "std")]
pub mod flash;
#[cfg(feature = "json")]
pub mod machine;
#[cfg(feature = "std")]
pub mod pass_through_board;
#[cfg(feature = "std")]
pub mod running;
#[cfg(feature = "json")]
pub mod scene_file;
#[cfg(feature = "std")]
pub mod servo_bus;
#[cfg(feature = "std")]
pub mod wire;
