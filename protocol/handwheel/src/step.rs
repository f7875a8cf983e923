//! A step's response: what a loop makes of a set-point that jumps, in the words of control.
//!
//! Vocabulary: the *step* is from where the shaft was to the target. *Rise* is the time from 10 % to 90 %
//! of it, *overshoot* how far beyond the target it goes, in percent of the step, *settling* the time after which it stays
//! within 5 % of the target, *steady error* what is left at the end (the mean of the last fifth).

use std::time::Duration;

use protocol::extension::{MachineState, Mode, Row, Setup, Trigger};

use crate::error::Error;
use crate::motion::target::{Target, unwrapped};
use crate::number::Number;
use crate::words;

/// A moment of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time since the command.
    pub time: Duration,
    /// What the target is of: counts, or counts per second.
    pub value: f64,
    /// -1 to 1 of full drive.
    pub duty: f64,
}

/// What is told of a response. Without a value: it never came so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// From 10 % to 90 % of the step.
    pub rise: Option<Duration>,
    /// In percent of the step; 0 is none.
    pub overshoot_percent: f64,
    /// After which it stays within 5 % of the target.
    pub settling: Option<Duration>,
    /// Target less value at the end, in the target's unit.
    pub steady_error: f64,
}

/// Within which share of the step a response counts as settled.
const SETTLED: f64 = 0.05;

/// Of fewer samples nothing is told.
const FEWEST: usize = 5;

/// Computes it. `start` is where the value was before the step. `None` of too few samples, or without a step.
pub fn response(samples: &[Sample], start: f64, target: f64) -> Option<Response> {
    let step = target - start;
    if samples.len() < FEWEST || step == 0.0 {
        return None;
    }
    let share = |sample: &Sample| (sample.value - start) / step;
    let reached = |part: f64| samples.iter().find(|s| share(s) >= part).map(|s| s.time);
    let rise = reached(0.1).zip(reached(0.9)).map(|(from, to)| to.saturating_sub(from));
    let highest = samples.iter().map(share).fold(f64::MIN, f64::max);
    let outside = |sample: &&Sample| (share(sample) - 1.0).abs() > SETTLED;
    let settling = match samples.iter().rposition(|sample| outside(&sample)) {
        None => samples.first().map(|sample| sample.time),
        Some(last) => samples.get(last + 1).map(|sample| sample.time),
    };
    let tail = samples.get(samples.len() * 4 / 5..).unwrap_or_default();
    let mean = tail.iter().map(|sample| sample.value).sum::<f64>() / tail.len() as f64;
    Some(Response {
        rise,
        overshoot_percent: ((highest - 1.0) * 100.0).max(0.0),
        settling,
        steady_error: target - mean,
    })
}

/// From where to where a position step went: the wire has a turn's counts, and which way round it went is
/// seen by where it came to.
fn way(samples: &[Sample], target: i16) -> (f64, f64) {
    let start = samples.first().map_or(0.0, |sample| sample.value);
    let end = samples.last().map_or(0.0, |sample| sample.value);
    (start, unwrapped(target.into(), end as i32).into())
}

/// A recording of one motor from its next motion command on, for so long, with so many rows at the most.
pub(crate) fn recording_of(motor: Number, time: Duration, rows: u16) -> Setup {
    let ms = u32::try_from(time.as_millis()).unwrap_or(u32::MAX).max(1);
    let decimation = u16::try_from(ms.div_ceil(rows.into())).unwrap_or(u16::MAX);
    let samples = u16::try_from(ms / u32::from(decimation)).unwrap_or(rows).clamp(1, rows);
    let channels = 1 << motor.index();
    Setup { channels, trigger: Trigger::Motion, decimation, samples, before: 0 }
}

/// A step that is being driven, as machine states tell of it, or a recording.
pub(crate) struct Course {
    motor: Number,
    target: Target,
    samples: Vec<Sample>,
    /// The board's time of the first state, and the time since the command then: the board's own clock counts
    /// on, as what the line adds is no part of the response.
    first: Option<(u16, Duration)>,
    /// What limited it in the last state.
    pub(crate) why: Option<String>,
}

impl Course {
    /// One that begins. The target is a velocity or a position.
    pub(crate) fn new(motor: Number, target: Target) -> Self {
        Self { motor, target, samples: Vec::new(), first: None, why: None }
    }

    /// Takes a state that came so long after the command.
    pub(crate) fn see(&mut self, state: &MachineState, elapsed: Duration) {
        let channel = &state.channels[self.motor.index()];
        let (began, since) = *self.first.get_or_insert((state.time_ms, elapsed));
        let time = since + Duration::from_millis(state.time_ms.wrapping_sub(began).into());
        let value = match self.target {
            Target::Position(_) => channel.position,
            _ => channel.velocity,
        };
        self.why = words::reason(channel);
        let duty = words::percent(channel.duty) / 100.0;
        self.samples.push(Sample { time, value: value.into(), duty });
    }

    /// Goes by what was recorded of it, which is finer: from the command on, a row every so many ms.
    pub(crate) fn take(&mut self, rows: &[Row], every: u16) {
        let on = (0u32..).zip(rows).filter(|(_, row)| row.mode != Mode::Off);
        let sample = |(n, row): (u32, &Row)| Sample {
            time: Duration::from_millis(every.into()) * n,
            value: match self.target {
                Target::Position(_) => row.position,
                _ => row.velocity,
            }
            .into(),
            duty: words::percent(row.duty) / 100.0,
        };
        self.samples = on.map(sample).collect();
    }

    /// What was seen.
    pub(crate) fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// What the values count.
    pub(crate) fn unit(&self) -> &'static str {
        if matches!(self.target, Target::Position(_)) { "counts" } else { "counts/s" }
    }

    /// What the loop made of it, and the target in the samples' scale.
    ///
    /// # Errors
    /// [`Error::Stopped`] if there was no step.
    pub(crate) fn response(&self) -> Result<(Response, f64), Error> {
        let (start, aim) = match self.target {
            Target::Position(target) => way(&self.samples, target),
            Target::Velocity(target) => (0.0, target.into()),
            Target::Duty(duty) => (0.0, duty),
        };
        let found = response(&self.samples, start, aim).ok_or_else(|| {
            Error::Stopped(format!(
                "motor {}: no step; it was at the target, or the time was too short",
                self.motor
            ))
        })?;
        Ok((found, aim))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A response sampled every 20 ms.
    fn samples(value: impl Fn(f64) -> f64) -> Vec<Sample> {
        let sample = |k: u32| {
            let time = Duration::from_millis(20) * k;
            Sample { time, value: value(time.as_secs_f64()), duty: 0.5 }
        };
        (1..=100).map(sample).collect()
    }

    #[test]
    fn a_first_order_response_rises_in_2_2_and_settles_in_3_time_constants() {
        let response =
            response(&samples(|t| 1000.0 * (1.0 - (-t / 0.2).exp())), 0.0, 1000.0).unwrap();
        let near = |time: Option<Duration>, s: f64| (time.unwrap().as_secs_f64() - s).abs() <= 0.03;
        assert!(near(response.rise, 0.44) && near(response.settling, 0.6), "{response:?}");
        assert_eq!(response.overshoot_percent, 0.0);
        assert!(response.steady_error.abs() < 1.0);
    }

    #[test]
    fn overshoot_is_told_either_way_and_from_anywhere() {
        let swing = |t: f64| 1.0 - (-t / 0.2).exp() * (15.0 * t).cos();
        for (start, target) in [(0.0, 1000.0), (500.0, -3000.0)] {
            let values = samples(|t| start + (target - start) * swing(t));
            let found = response(&values, start, target).unwrap();
            assert!((30.0..45.0).contains(&found.overshoot_percent), "{found:?}");
        }
    }

    #[test]
    fn what_does_not_arrive_has_an_error_and_no_settling() {
        let found = response(&samples(|_| 600.0), 0.0, 1000.0).unwrap();
        assert_eq!((found.rise, found.settling, found.steady_error), (None, None, 400.0));
        assert_eq!(response(&[], 0.0, 1.0), None);
        assert_eq!(response(&samples(|_| 0.0), 1.0, 1.0), None);
    }

    #[test]
    fn a_position_steps_the_way_that_it_went() {
        let sample = |value| Sample { time: Duration::ZERO, value, duty: 0.0 };
        assert_eq!(way(&[sample(100.0), sample(5990.0)], 6000), (100.0, 6000.0));
        assert_eq!(way(&[sample(100.0), sample(-2750.0)], 30_000), (100.0, -2768.0));
        assert_eq!(way(&[sample(100.0), sample(29_990.0)], 30_000), (100.0, 30_000.0));
    }
}
