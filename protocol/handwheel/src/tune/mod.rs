//! Checking and tuning that ask the machine, as a session without I/O.
//!
//! Vocabulary: a [`Job`] is such a session: it says what to [`Ask`] the board next, is told what came of it and what
//! the board tells, and the time; it ends with an outcome. A *procedure* is what it does, written one thing
//! after the other.
//!
//! - [`check()`]: does the sensor move, which way, does a current flow; before any loop is closed;
//! - [`tune()`]: what the motor is ([`Motor`], by least squares from what the board has recorded), gains for it by
//!   rules, and one step that confirms what was predicted.
//!
//! # Promises
//! - No more than the duty that was allowed; a joint that leaves its travel is switched off.
//! - However it ends (a fault, an obstacle, silence, another host, a stop), the motor is off, and what was
//!   set meanwhile is set back. If the line is gone, the board's own watch stops the motor, and a restart brings
//!   back what was saved.
//! - Nothing is saved.

mod check;
mod fit;
mod gains;
mod hand;
mod job;
mod model;
mod procedure;

pub use check::{Checked, Way, check};
pub use fit::Fit;
pub use gains::{Design, Gains, Loop, Step};
#[cfg(feature = "io")]
pub(crate) use job::LEFT;
pub use job::{Ask, Job, Refused};
pub use model::Motor;
pub use procedure::{
    Options, Plan, Tuned, full_speed_set, highest_duty_of, plan, read, sensor_of, tune,
};

/// Since this version of the extension a board has a recorder.
pub(crate) const RECORDER: u8 = 3;
