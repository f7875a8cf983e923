//! The tuner as the bench calls it: one function, in one place.

use handwheel::Number;
use handwheel::tune::{self, Options, Step};

use super::judge::STEP;
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
    /// In seconds, until a step from standstill to [`STEP`] of full speed stays within
    /// 5 %.
    pub settling: f64,
    /// In percent of that step.
    pub overshoot: f64,
}

/// Why it has not tuned the channel: a line for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused(pub String);

/// How long a tuner may take, in ms; the bench says when that was too long.
const LONGEST_MS: u32 = 60_000;

/// Tunes motor 1. Gains and whatever else it sets are in force when it returns, and the motor is off.
///
/// # Errors
/// Says why it has not.
pub fn tune(rig: &mut Rig) -> Result<Tuned, Refused> {
    let highest_duty = Options::HIGHEST_DUTY;
    let options = Options { motor: Number::ONE, control_loop: None, highest_duty, apply: true };
    let mut job = tune::tune(options);
    // Until the session has heard who is there.
    while rig.session.personality().is_none() {
        rig.step();
    }
    for _ in 0..LONGEST_MS {
        let now = rig.now();
        job.converse(&mut rig.session, now);
        let Some(outcome) = job.outcome() else {
            rig.step();
            continue;
        };
        let tuned = outcome.map_err(|refused| Refused(refused.to_string()))?;
        let motor = tuned.fit.motor;
        let target = (STEP * motor.steady(1.0)).min(i16::MAX.into()).round();
        let time = std::time::Duration::from_secs_f64(4.0 + 8.0 * motor.time_constant);
        let expected = tuned.expects(Step { target, most: 1.0 }, time);
        let expected = expected.ok_or(Refused("it predicts nothing".into()))?;
        let settling = expected.settling.ok_or(Refused("it predicts no settling".into()))?;
        return Ok(Tuned {
            gain: motor.gain,
            tau: Some(motor.time_constant),
            dead_time: motor.dead_time,
            settling: settling.as_secs_f64(),
            overshoot: expected.overshoot_percent,
        });
    }
    Err(Refused("it does not end".into()))
}
