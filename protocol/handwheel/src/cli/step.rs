//! `step`: drives a step, tells what the loop made of it, and draws it.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::Duration;

use protocol::extension::Mode;
use serde_json::json;

use super::plot::draw;
use super::{Context, Outcome, Quantity};
use crate::error::Error;
use crate::motion::target::Target;
use crate::number::Number;
use crate::step::{Course, Sample, recording_of};

/// Rows that are recorded at the most: they take some 4 s to be read at 115200 baud.
const ROWS: u16 = 2000;

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
        let before = client.state_at_rest()?.ok_or(Error::NotCarried(
            client.personality(),
            "machine state to sample",
            "; its firmware is older, or the line slower than 16,000 baud",
        ))?;
        let channel = before.channels[motor.index()];
        if channel.mode != Mode::Off {
            return Err(Error::Stopped(format!("motor {motor} is driven; `handwheel stop` first")));
        }
        let what = match quantity {
            Quantity::Velocity => Target::Velocity(target),
            Quantity::Position if target < 0 => {
                return Err(Error::OutOfRange {
                    name: "position".into(),
                    value: target.into(),
                    low: 0,
                    high: i16::MAX.into(),
                });
            }
            Quantity::Position => Target::Position(target),
        };
        let mut course = Course::new(motor, what);
        // What older boards tell is a machine state every 20 ms.
        let recording = match client.has_recorder() {
            true => Some(client.record(recording_of(motor, time, ROWS))?),
            false => None,
        };
        self.holds();
        let interrupted = self.io.interrupt.wanted.clone();
        client.end_when(interrupted.clone());
        let mut drive = client.drive(motor, what, Duration::ZERO)?;
        let held = drive.hold_while(|elapsed, state| {
            if let Some(state) = state {
                course.see(state, elapsed);
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
        // A step that was interrupted is still being recorded.
        if let Some(recording) = recording.filter(|_| !self.interrupted()) {
            // Without it the machine states tell of it.
            match client.recorded(&recording) {
                Ok(rows) => course.take(&rows, recording.decimation),
                Err(error) => self.remark(&error.to_string()),
            }
        }
        let (found, aim) = course.response()?;
        let unit = course.unit();
        let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
        let said = |time: Option<Duration>| match ms(time) {
            Some(ms) => format!("{ms} ms"),
            None => "not within this time".into(),
        };
        if let Some(why) = &course.why {
            self.remark(&format!("motor {motor}: at the end {why}"));
        }
        self.say(&format!("motor {motor}: step to {what}, {} samples", course.samples().len()));
        self.say(&format!("rise (10 to 90 %)     {}", said(found.rise)));
        self.say(&format!("overshoot             {:.1} %", found.overshoot_percent));
        self.say(&format!("settling (within 5 %) {}", said(found.settling)));
        self.say(&format!("steady error          {:.1} {unit}", found.steady_error));
        if let Some(file) = svg {
            let title = format!("motor {motor}: step to {what}");
            draw(file, &title, unit, course.samples(), aim).map_err(Error::File)?;
            self.say(&format!("drawn in {}", file.display()));
        }
        let thousandths = |duty: f64| (duty * 1000.0).round() / 1000.0;
        let row = |s: &Sample| json!([s.time.as_millis() as u64, s.value, thousandths(s.duty)]);
        let samples: Vec<_> = course.samples().iter().map(row).collect();
        self.tell(&json!({
            "motor": motor.index() + 1,
            "target": aim,
            "unit": unit,
            "rise_ms": ms(found.rise),
            "overshoot_percent": found.overshoot_percent,
            "settling_ms": ms(found.settling),
            "steady_error": found.steady_error,
            "stands": stopped.stands,
            "samples_ms_value_duty": samples,
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
