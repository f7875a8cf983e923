//! `step`: drives a step, tells what the loop made of it, and draws it.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Duration;

use protocol::extension::Mode;
use serde_json::{Value, json};

use super::{Context, Outcome, Quantity};
use crate::client::Target;
use crate::error::Error;
use crate::number::Number;
use crate::step::{Sample, draw, response};
use crate::words;

/// The wire's positions wrap here; the machine state's do not.
const TURN: f64 = 32_768.0;

impl Context<'_, '_> {
    /// The motor is stopped at the end, whatever happens.
    pub fn step(
        &mut self,
        motor: Number,
        quantity: Quantity,
        target: i16,
        svg: Option<&Path>,
        time: Duration,
    ) -> Outcome {
        if let Some(file) = svg {
            // Before anything turns.
            let opened = std::fs::OpenOptions::new().create(true).append(true).open(file);
            opened.map_err(|error| Error::File(format!("{}: {error}", file.display())))?;
        }
        let mut client = self.connect()?;
        let before = client.state()?.ok_or(Error::NotCarried(
            client.personality(),
            "machine state to sample",
            "; its firmware is older, or the line slower than 16,000 baud",
        ))?;
        let channel = before.channels[motor.index()];
        if channel.mode != Mode::Off {
            return Err(Error::Stopped(format!("motor {motor} is driven; `handwheel stop` first")));
        }
        let (what, unit) = match quantity {
            Quantity::Velocity => (Target::Velocity(target), "counts/s"),
            Quantity::Position if target < 0 => {
                return Err(Error::OutOfRange {
                    name: "position".into(),
                    value: target.into(),
                    low: 0,
                    high: i16::MAX.into(),
                });
            }
            Quantity::Position => (Target::Position(target), "counts"),
        };
        let mut samples = Vec::new();
        let mut why = None;
        self.holds();
        let interrupted = self.io.interrupt.wanted.clone();
        client.end_when(interrupted.clone());
        let mut drive = client.drive(motor, what, Duration::ZERO)?;
        // The board's own clock: what the line adds is no part of the response.
        let mut first = None;
        let held = drive.hold_while(|elapsed, state| {
            if let Some(state) = state {
                let channel = &state.channels[motor.index()];
                let (began, since) = *first.get_or_insert((state.time_ms, elapsed));
                let time = since + Duration::from_millis(state.time_ms.wrapping_sub(began).into());
                let value = match quantity {
                    Quantity::Velocity => channel.velocity,
                    Quantity::Position => channel.position,
                };
                why = words::reason(channel);
                let duty = words::percent(channel.duty) / 100.0;
                samples.push(Sample { time, value: value.into(), duty });
            }
            elapsed < time && !interrupted.load(Ordering::Relaxed)
        });
        let stopped = match held {
            Ok(()) => drive.stop()?,
            Err(why) => {
                // It is stopped in any case; why it does not run is what matters.
                let _ = drive.stop();
                return Err(why);
            }
        };
        let (start, aim) = match quantity {
            Quantity::Velocity => (0.0, f64::from(target)),
            Quantity::Position => way(&samples, target),
        };
        let found = response(&samples, start, aim).ok_or_else(|| {
            Error::Stopped(format!(
                "motor {motor}: no step; it was at the target, or the time was too short"
            ))
        })?;
        let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
        let said = |time: Option<Duration>| match ms(time) {
            Some(ms) => format!("{ms} ms"),
            None => "not within this time".into(),
        };
        if let Some(why) = why {
            self.remark(&format!("motor {motor}: at the end {why}"));
        }
        self.say(&format!("motor {motor}: step to {what}, {} samples", samples.len()));
        self.say(&format!("rise (10 to 90 %)     {}", said(found.rise)));
        self.say(&format!("overshoot             {:.1} %", found.overshoot_percent));
        self.say(&format!("settling (within 5 %) {}", said(found.settling)));
        self.say(&format!("steady error          {:.1} {unit}", found.steady_error));
        if let Some(file) = svg {
            let title = format!("motor {motor}: step to {what}");
            draw(file, &title, unit, &samples, aim).map_err(Error::File)?;
            self.say(&format!("drawn in {}", file.display()));
        }
        let list: Vec<Value> = samples
            .iter()
            .map(|s| {
                json!([s.time.as_millis() as u64, s.value, (s.duty * 1000.0).round() / 1000.0])
            })
            .collect();
        self.tell(&json!({
            "motor": motor.index() + 1,
            "target": aim,
            "unit": unit,
            "rise_ms": ms(found.rise),
            "overshoot_percent": found.overshoot_percent,
            "settling_ms": ms(found.settling),
            "steady_error": found.steady_error,
            "stands": stopped.stands,
            "samples_ms_value_duty": list,
        }));
        let json = std::mem::replace(&mut self.json, false);
        let status = if json {
            if stopped.stands == Some(false) { super::ANSWER_IS_NO } else { super::DONE }
        } else {
            self.tell_stopped(motor, what, &stopped)
        };
        self.json = json;
        Ok(status)
    }
}

/// From where to where a position step went: the wire has a turn's counts, and which way round it went is
/// seen by where it came to.
fn way(samples: &[Sample], target: i16) -> (f64, f64) {
    let start = samples.first().map_or(0.0, |sample| sample.value);
    let end = samples.last().map_or(0.0, |sample| sample.value);
    let off = (f64::from(target) - end).rem_euclid(TURN);
    (start, end + if off > TURN / 2.0 { off - TURN } else { off })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_steps_the_way_that_it_went() {
        let sample = |value| Sample { time: Duration::ZERO, value, duty: 0.0 };
        assert_eq!(way(&[sample(100.0), sample(5990.0)], 6000), (100.0, 6000.0));
        assert_eq!(way(&[sample(100.0), sample(-2750.0)], 30_000), (100.0, -2768.0));
        assert_eq!(way(&[sample(100.0), sample(29_990.0)], 30_000), (100.0, 30_000.0));
    }
}
