//! The tuner as the bench calls it: one function, in one place.

use super::rig::Rig;

/// What a tuner has found, and what it promises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuned {
    /// K: counts/s of steady speed for full duty beyond the dead band.
    pub gain: f64,
    /// The mechanical time constant in seconds, if it tells one.
    pub tau: Option<f64>,
    /// In seconds.
    pub dead_time: f64,
    /// In seconds, until a step from standstill to [`STEP`](super::judge::STEP) of full speed stays within
    /// 5 %.
    pub settling: f64,
    /// In percent of that step.
    pub overshoot: f64,
}

/// Why it has not tuned the channel: a line for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused(pub String);

/// Tunes motor 1. Gains and whatever else it sets are in force when it returns, and the motor is off.
///
/// # Errors
/// Says why it has not.
pub fn tune(_rig: &mut Rig) -> Result<Tuned, Refused> {
    Err(Refused("there is no tuner yet".into()))
}
