//! Control: pure steps, once a control period, in fixed point. No time, no I/O, no protocol.
//!
//! - [`ring`]: positions on a circle, and the shorter way between them;
//! - [`potentiometer`]: one angle from two potentiometers;
//! - [`velocity`]: a velocity estimate that is quiet at low speed;
//! - [`track`]: where a shaft may be, and the way from one place to another;
//! - [`trajectory`]: how a set-point gets from one value to another; [`lead`]: how far it may be ahead of
//!   its shaft;
//! - [`pid`]: the controller kernel, and what the gains of the wire mean;
//! - [`axis`]: one DC channel; [`servo`]: one servo channel.
//!
//! Nothing here panics: the lints below forbid indexing, unwrapping, arithmetic that can
//! overflow and casts that can lose.
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

pub mod axis;
pub mod lead;
pub mod pid;
pub mod potentiometer;
pub mod ring;
pub mod servo;
pub mod track;
pub mod trajectory;
pub mod velocity;

/// The number itself, or the nearest one of 32 bits.
fn saturate(number: i64) -> i32 {
    i32::try_from(number).unwrap_or(if number < 0 { i32::MIN } else { i32::MAX })
}
