//! The judge: what a velocity loop makes of a step from standstill, by the shaft's true speed.
//!
//! What counts as speed. The encoder's own noise does not: only the true shaft is looked at. Its speed is the
//! mean over one *line* of the encoder at the speed asked for (four counts, at least 4 ms, at most 40 ms), with
//! the moment in its middle: no loop can know it finer, and so a plant with 12 counts a turn is asked for no
//! more than it can tell.
//!
//! What a plant does by itself is no fault of its loop: its friction wanders, its torque ripples. So before
//! the step the same plant runs with the same mean speed and a constant duty, and how far its speed (taken
//! in the same way) then is from its mean, at most, is its *ripple*: overshoot is counted from so far above the
//! target, and the band of 5 % is so much wider, up to 5 % of the target.
//!
//! What a tuning must be for the bench is in [`failures`].
//!
//! *Settling* is the time from the jump of the set-point until the speed stays in its band. *Steady error* is
//! the target less the mean of the last quarter, in percent of the target.

use super::motor::Drive;
use super::plant::{Plant, Truth};
use super::rig::{Moment, Rig};
use super::tuner::Tuned;

/// To which part of full speed the step goes.
pub const STEP: f64 = 0.4;
/// Of K and tau, in percent.
pub const MOST_OFF: f64 = 5.0;
/// In percent of the step.
pub const MOST_OVERSHOOT: f64 = 10.0;
/// Parts of what was predicted.
pub const MOST_SETTLING: f64 = 1.2;

/// Within which part of the target a speed counts as settled.
const SETTLED: f64 = 0.05;
/// The most of the target that ripple may excuse.
const EXCUSED: f64 = 0.05;
/// The highest velocity that the wire can ask for.
const HIGHEST: f64 = 32_767.0;

/// What a loop makes of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// counts/s.
    pub target: f64,
    /// In percent of the target; 0 is none.
    pub overshoot: f64,
    /// Seconds, if it settles within the time that it is watched.
    pub settling: Option<f64>,
    /// In percent of the target; positive is too slow.
    pub steady_error: f64,
    /// What the plant does by itself, in percent of the target.
    pub ripple: f64,
}

/// Has motor 1 step from standstill to [`STEP`] of its full speed, at most to what the wire can ask for, and
/// watches it for 4 s and eight time constants.
pub fn step(rig: &mut Rig, plant: &Plant) -> Response {
    let truth = plant.truth();
    let target = (truth.full_speed * STEP).min(HIGHEST).round();
    let half_line_ms = (2000.0 / target).clamp(2.0, 20.0).round() as usize;
    let ripple = ripple(plant, target, half_line_ms);

    rig.to_standstill();
    let before = rig.course().len();
    let watched_ms = (4000.0 + 8000.0 * truth.tau) as u32;
    rig.hold_velocity(target as i16, watched_ms);
    let course = rig.course();
    let Some(jump) = jump(&course[before..]).map(|at| before + at) else {
        // It never came into force: a fault, or a board that refuses.
        return Response {
            target,
            overshoot: 0.0,
            settling: None,
            steady_error: 100.0,
            ripple: 0.0,
        };
    };
    let positions: Vec<f64> = course[jump - half_line_ms..].iter().map(|m| m.position).collect();
    let response = respond(&smooth(&positions, half_line_ms), target, ripple);
    rig.to_standstill();
    response
}

/// Where the set-point jumps: the first moment at which it is in force.
fn jump(course: &[Moment]) -> Option<usize> {
    course.iter().position(|moment| moment.set_point.is_some_and(|velocity| velocity != 0.0))
}

/// By how much a number is off the truth, in percent.
pub fn off_percent(told: f64, truth: f64) -> f64 {
    (told / truth - 1.0) * 100.0
}

/// What is wrong with a tuning: a few words for each.
pub fn failures(truth: &Truth, tuned: &Tuned, response: &Response) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut check = |what: &str, told: Option<f64>, truth: f64| match told
        .map(|told| off_percent(told, truth))
    {
        Some(off) if off.abs() <= MOST_OFF => {}
        Some(off) => wrong.push(format!("{what} {off:+.1} %")),
        None => wrong.push(format!("no {what}")),
    };
    check("K", Some(tuned.gain), truth.gain);
    if truth.is_tau_defined() {
        check("tau", tuned.tau, truth.tau);
    }
    if response.overshoot > MOST_OVERSHOOT {
        wrong.push(format!("overshoot {:.1} %", response.overshoot));
    }
    match response.settling {
        Some(settling) if settling <= MOST_SETTLING * tuned.settling => {}
        Some(settling) => {
            wrong.push(format!("settles in {settling:.3} s, predicted {:.3} s", tuned.settling));
        }
        None => wrong.push("never settles".into()),
    }
    wrong
}

/// By how much the speed of a plant that nobody controls is off its mean, at most, in 2 s.
fn ripple(plant: &Plant, target: f64, half_line_ms: usize) -> f64 {
    let truth = plant.truth();
    let mut machine = plant.build(None);
    let duty = (truth.dead_band + target / truth.gain).min(1.0);
    let mut step = || {
        machine.step(Drive { duty, enabled: true });
        machine.position()
    };
    let settle = (8000.0 * truth.tau) as usize;
    // Below breakaway it needs a push.
    let positions: Vec<f64> = (0..settle + 2000).map(|_| step()).skip(settle).collect();
    let speeds = smooth(&positions, half_line_ms);
    let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
    speeds.iter().map(|speed| (speed - mean).abs()).fold(0.0, f64::max)
}

/// Speeds in counts/s from positions a millisecond apart, each the mean over `half` ms before and behind it.
fn smooth(positions: &[f64], half: usize) -> Vec<f64> {
    let over_s = 2.0 * half as f64 / 1000.0;
    positions.windows(2 * half + 1).map(|w| (w[2 * half] - w[0]) / over_s).collect()
}

/// What is told of speeds a millisecond apart, from the jump on.
fn respond(speeds: &[f64], target: f64, ripple: f64) -> Response {
    let excused = ripple.min(EXCUSED * target);
    let highest = speeds.iter().copied().fold(f64::MIN, f64::max);
    let band = SETTLED * target + excused;
    let settled = speeds.iter().rposition(|v| (v - target).abs() > band).map_or(0, |last| last + 1);
    let tail = &speeds[speeds.len() * 3 / 4..];
    let mean = tail.iter().sum::<f64>() / tail.len() as f64;
    Response {
        target,
        overshoot: ((highest - target - excused) / target * 100.0).max(0.0),
        settling: (settled < speeds.len() * 9 / 10).then_some(settled as f64 / 1000.0),
        steady_error: (target - mean) / target * 100.0,
        ripple: ripple / target * 100.0,
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn near(value: f64, to: f64, off: f64) {
        assert!((value - to).abs() <= off, "{value}, not {to}");
    }

    #[test]
    fn time_begins_when_the_set_point_is_in_force() {
        let moment = |set_point| Moment {
            at: Duration::ZERO,
            position: 0.0,
            speed: 0.0,
            current: 0.0,
            drive: Drive::default(),
            set_point,
        };
        let course = [None, None, Some(0.0), Some(500.0), Some(500.0)].map(moment);
        assert_eq!((jump(&course), jump(&course[..3])), (Some(3), None));
    }

    /// Where a shaft is whose speed swings about 1000 counts/s, after a jump at 10 ms.
    fn positions(speed: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut at = 0.0;
        let mut step = |k: u32| {
            let time = f64::from(k) * 1e-5 - 0.01;
            at += if time > 0.0 { 1000.0 * speed(time) * 1e-5 } else { 0.0 };
            at
        };
        let all: Vec<f64> = (0..200_000).map(&mut step).collect();
        all.into_iter().step_by(100).collect()
    }

    #[test]
    fn a_first_order_response_settles_in_three_time_constants_without_overshoot() {
        let speeds = smooth(&positions(|t| 1.0 - (-t / 0.2_f64).exp()), 10);
        let told = respond(&speeds, 1000.0, 0.0);
        near(told.settling.unwrap(), 0.599, 0.003);
        near(told.overshoot, 0.0, 0.0);
        near(told.steady_error, 0.0, 0.1);
    }

    #[test]
    fn a_swinging_response_has_the_overshoot_of_its_damping() {
        // Damping 0.5: 16.3 %, after which it stays within 5 % from 5.3 / natural frequency on.
        let (natural, damped) = (20.0, 20.0 * 0.75_f64.sqrt());
        let swing = |t: f64| {
            1.0 - (-0.5 * natural * t).exp()
                * ((damped * t).cos() + 0.5 * natural / damped * (damped * t).sin())
        };
        let told = respond(&smooth(&positions(swing), 10), 1000.0, 0.0);
        near(told.overshoot, 16.3, 0.4);
        near(told.settling.unwrap(), 0.265, 0.01);
        // With a ripple of 20 counts/s both are counted from there.
        let excused = respond(&smooth(&positions(swing), 10), 1000.0, 20.0);
        near(excused.overshoot, told.overshoot - 2.0, 0.01);
        assert!(excused.settling < told.settling);
        // It cannot excuse everything.
        let most = respond(&smooth(&positions(swing), 10), 1000.0, 500.0);
        near(most.overshoot, told.overshoot - 5.0, 0.01);
    }

    #[test]
    fn what_swings_for_ever_or_stays_away_never_settles() {
        let swings = |t: f64| 1.0 + 0.2 * (t * 40.0).sin();
        let told = respond(&smooth(&positions(swings), 10), 1000.0, 0.0);
        assert_eq!(told.settling, None);
        let told = respond(&smooth(&positions(|_| 0.9), 10), 1000.0, 0.0);
        assert_eq!(told.settling, None);
        near(told.steady_error, 10.0, 0.1);
    }

    #[test]
    fn ripple_of_the_shaft_that_is_quicker_than_a_line_of_the_encoder_is_none() {
        let ripples = |t: f64| 1.0 - (-t / 0.05_f64).exp() + 0.3 * (t * 314.159).sin(); // 50 Hz
        assert_eq!(respond(&smooth(&positions(ripples), 2), 1000.0, 0.0).settling, None);
        let told = respond(&smooth(&positions(ripples), 10), 1000.0, 0.0);
        near(told.settling.unwrap(), 0.15, 0.02);
        assert!(told.overshoot < 1.0);
    }

    #[test]
    fn a_tuning_fails_for_each_thing_that_is_wrong_with_it_and_for_nothing_else() {
        let truth = Plant::number(0).truth();
        let right = Tuned {
            gain: truth.gain * 1.049,
            tau: Some(truth.tau * 0.951),
            dead_time: 0.0,
            settling: 0.5,
            overshoot: 0.0,
        };
        let response = Response {
            target: 1000.0,
            overshoot: 9.9,
            settling: Some(0.599),
            steady_error: 0.0,
            ripple: 0.0,
        };
        assert_eq!(failures(&truth, &right, &response), [""; 0]);
        let wrong = |tuned: Tuned| failures(&truth, &tuned, &response).join(", ");
        assert_eq!(wrong(Tuned { gain: truth.gain * 0.94, ..right }), "K -6.0 %");
        assert_eq!(wrong(Tuned { gain: f64::NAN, ..right }), "K NaN %");
        assert_eq!(wrong(Tuned { tau: Some(truth.tau * 1.06), ..right }), "tau +6.0 %");
        assert_eq!(wrong(Tuned { tau: None, ..right }), "no tau");
        let predicted = "settles in 0.599 s, predicted 0.490 s";
        assert_eq!(wrong(Tuned { settling: 0.49, ..right }), predicted);
        let wrong = |response: Response| failures(&truth, &right, &response).join(", ");
        assert_eq!(wrong(Response { overshoot: 10.1, ..response }), "overshoot 10.1 %");
        assert_eq!(wrong(Response { settling: None, ..response }), "never settles");
        let undefined = Truth { tau: 0.009, ..truth };
        assert_eq!(failures(&undefined, &Tuned { tau: None, ..right }, &response), [""; 0]);
    }

    #[test]
    fn a_plant_is_given_its_own_ripple_and_no_more() {
        for number in 0..8 {
            let plant = Plant::number(number);
            let target = plant.truth().full_speed * 0.4;
            let own = ripple(&plant, target, (2000.0 / target).clamp(2.0, 20.0) as usize) / target;
            assert!((0.0001..0.05).contains(&own), "plant {number}: {own}");
        }
    }
}
