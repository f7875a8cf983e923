//! Gains by the lambda rules: how fast a loop is to be is one number, lambda, the time constant that it is
//! given; all gains follow from that and the motor's numbers.
//!
//! ```text
//!   velocity   kp = T / (K (lambda + L)), reset time T
//!   position   kp = T / (K lambda^2), kd = (2 T / lambda - 1) / K
//! ```
//!
//! with the motor's gain K, time constant T and dead time L. The velocity loop looks ahead by nothing then: a loop that
//! is made for its motor gains nothing by that, and a coarse encoder's counts would make its drive restless.
//!
//! The fastest lambda is taken for which the board's own loop, in whole counts and with the gains rounded to the
//! numbers that the firmware uses, is predicted to be steady: with this motor, and with one that differs.

use std::time::Duration;

use super::model::{Expected, Motor, PERIOD, step_of};
use crate::step::{Response, Sample, response};

/// Which loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loop {
    /// That of velocities.
    Velocity,
    /// That of positions.
    Position,
}

impl Loop {
    /// What its set-points count.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Velocity => "counts/s",
            Self::Position => "counts",
        }
    }
}

/// Gains as the settings have them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Gains {
    /// Kp.
    pub kp: u16,
    /// Kd.
    pub kd: u16,
    /// Reset time in ms, of a velocity loop.
    pub reset_ms: u16,
}

/// A step from rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Counts per second, or counts.
    pub target: f64,
    /// The highest duty, 0 to 1.
    pub most: f64,
}

/// Gains, and what is expected of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Design {
    /// The gains.
    pub gains: Gains,
    /// The time constant that the loop was given, in seconds.
    pub lambda: f64,
    /// What the shaft is expected to make of the step.
    pub response: Response,
    /// What the board is to see of it, a value a control period.
    pub(super) seen: Vec<f64>,
}

/// The largest Kp that counts, and the largest Kd of a position loop.
const MOST_KP: f64 = 32_767.0;
const MOST_KD: f64 = 511.0;
/// The board's velocity estimate is so late, in seconds.
const ESTIMATE: f64 = 0.016;
/// The fastest lambda, in parts of all that is late; how much slower each next one is, and how many are tried.
const FASTEST: f64 = 1.5;
const SLOWER: f64 = 1.15;
const TRIES: i32 = 40;
/// Overshoot in percent of the motor that was found, and of one that differs from it.
const OVERSHOOT: f64 = 3.0;
const OVERSHOOT_OF_OTHERS: f64 = 7.0;
/// How another may differ: gain and time constant in parts, dead time in seconds more.
const OTHERS: [(f64, f64, f64); 3] = [(1.15, 1.0, 0.0), (0.9, 1.2, 0.0), (1.1, 0.85, 0.003)];
/// How far the duty of a steady shaft may swing, rms, in parts of full drive.
const RESTLESS: f64 = 0.05;
/// The longest that a step is looked at, in seconds.
const LONGEST: f64 = 15.0;

/// Gains for a motor, and what they make of a step of this size with no more duty than `most`; `None` if no loop
/// would be steady.
pub(super) fn design(motor: &Motor, control_loop: Loop, step: Step) -> Option<Design> {
    let fastest = (motor.dead_time + ESTIMATE) * FASTEST;
    let lambdas = (0..TRIES).map(|n| fastest * SLOWER.powi(n));
    lambdas.into_iter().find_map(|lambda| {
        let gains = rule(motor, control_loop, lambda)?;
        judge(motor, control_loop, step, lambda, gains)
    })
}

/// The rule of the [module](self), rounded to what the firmware takes; `None` where its numbers end.
fn rule(motor: &Motor, control_loop: Loop, lambda: f64) -> Option<Gains> {
    let Motor { gain, time_constant, dead_time, .. } = *motor;
    let two_to_the = |power: i32| 2_f64.powi(power);
    let (kp, kd) = match control_loop {
        Loop::Velocity => (time_constant / (gain * (lambda + dead_time)) * two_to_the(19), 0.0),
        Loop::Position => (
            time_constant / (gain * lambda * lambda) * two_to_the(15),
            ((2.0 * time_constant / lambda - 1.0) / gain).max(0.0) * two_to_the(16),
        ),
    };
    let is_known = (1.0..=MOST_KP).contains(&kp) && kd <= MOST_KD;
    let reset_ms = (time_constant * 1000.0).round().max(1.0) as u16; // 10 s at the most
    is_known.then_some(Gains { kp: kp.round() as u16, kd: kd.round() as u16, reset_ms })
}

/// The design, if the loop is steady.
fn judge(
    motor: &Motor,
    control_loop: Loop,
    step: Step,
    lambda: f64,
    gains: Gains,
) -> Option<Design> {
    let seconds = (6.0 * lambda + 4.0 * motor.time_constant + 0.4).min(LONGEST);
    let periods = (seconds / PERIOD) as usize;
    let curve = step_of(motor, control_loop, gains, step, periods);
    let response = told(&curve, step)?;
    let tail = curve.get(periods * 3 / 4..)?;
    let mean = tail.iter().map(|at| at.duty).sum::<f64>() / tail.len() as f64;
    let swing = tail.iter().map(|at| (at.duty - mean).powi(2)).sum::<f64>() / tail.len() as f64;
    // What friction holds short of its target, within 5 % or not, is all that a loop without Ki can do.
    let friction = motor.dead_band[0] / f64::from(gains.kp.max(1)) * 2_f64.powi(15);
    let is_good = |told: &Response, overshoot| {
        let is_there = match control_loop {
            Loop::Velocity => told.settling.is_some(),
            Loop::Position => told.steady_error.abs() <= friction + 2.0,
        };
        is_there && told.overshoot_percent <= overshoot
    };
    let bears = |motor: &Motor, step, overshoot| {
        let told = told(&step_of(motor, control_loop, gains, step, periods), step);
        told.is_some_and(|told| is_good(&told, overshoot))
    };
    let others = OTHERS.map(|(gain, slow, late)| Motor {
        gain: motor.gain * gain,
        time_constant: motor.time_constant * slow,
        dead_time: motor.dead_time + late,
        ..*motor
    });
    let is_steady = swing.sqrt() <= RESTLESS
        && is_good(&response, OVERSHOOT)
        && others.iter().all(|other| bears(other, step, OVERSHOOT_OF_OTHERS))
        && other_steps(motor, control_loop, step)
            .into_iter()
            .all(|step| bears(motor, step, OVERSHOOT));
    let seen = curve.iter().map(|at| at.seen).collect();
    is_steady.then_some(Design { gains, lambda, response, seen })
}

/// Steps that a loop which is made by one has to bear as well: smaller ones, and with all the drive that there is.
fn other_steps(motor: &Motor, control_loop: Loop, step: Step) -> Vec<Step> {
    let half = Step { target: step.target / 2.0, ..step };
    match control_loop {
        Loop::Position => vec![half],
        Loop::Velocity => {
            let whole = motor.steady(1.0).min(i16::MAX.into());
            let of = |part: f64| Step { target: part * whole, most: 1.0 };
            vec![half, of(0.2), of(0.4), of(0.8)]
        }
    }
}

/// What a loop with these gains is expected to make of a step, in this time; `None` if it is no step.
pub(super) fn expect(
    motor: &Motor,
    control_loop: Loop,
    gains: Gains,
    step: Step,
    time: Duration,
) -> Option<Response> {
    let periods = (time.as_secs_f64() / PERIOD) as usize;
    told(&step_of(motor, control_loop, gains, step, periods), step)
}

fn told(curve: &[Expected], step: Step) -> Option<Response> {
    let values: Vec<_> = curve.iter().map(|at| at.value).collect();
    response(&every_period(&values), 0.0, step.target)
}

/// Values of one control period after the other, as samples.
pub(super) fn every_period(values: &[f64]) -> Vec<Sample> {
    let time = |n| Duration::from_secs_f64(f64::from(n) * PERIOD);
    (1u32..).zip(values).map(|(n, &value)| Sample { time: time(n), value, duty: 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From coarse to fine, from quick to slow, with little friction and with much.
    fn motors() -> impl Iterator<Item = Motor> {
        [480.0, 2000.0, 8000.0, 60_000.0].into_iter().flat_map(|gain| {
            [0.02, 0.05, 0.1, 0.3, 1.0, 2.5].into_iter().flat_map(move |time_constant| {
                [0.03, 0.2].map(|band| Motor {
                    gain,
                    time_constant,
                    dead_time: 0.003,
                    dead_band: [band; 2],
                })
            })
        })
    }

    #[test]
    fn every_motor_gets_a_loop_that_is_no_slower_than_the_motor_itself() {
        for motor in motors() {
            let target = (0.5 * motor.steady(0.5)).min(32_767.0).round();
            let Design { response, gains, lambda, .. } =
                design(&motor, Loop::Velocity, Step { target, most: 0.5 })
                    .unwrap_or_else(|| panic!("{motor:?}"));
            let (settling, case) =
                (response.settling.unwrap().as_secs_f64(), format!("{motor:?} {gains:?} {lambda}"));
            // Which settles within 5 % in three time constants; a coarse encoder's counts want more time.
            let more = if motor.gain < 1000.0 { 0.4 } else { 0.2 };
            assert!(settling < 3.0 * motor.time_constant + more, "{case}: {settling}");
            assert!(response.steady_error.abs() < 0.02 * target, "{case}: {response:?}");
        }
    }
}
