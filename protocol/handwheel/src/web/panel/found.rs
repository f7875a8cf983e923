//! What a job has found, as pages are told.

use std::time::Duration;

use serde_json::{Value, json};

use super::tell::rounded;
use crate::Number;
use crate::session::Setting;
use crate::step::{Course, Response, Sample};
use crate::tune::{Checked, Loop, Tuned};

pub(super) enum Found {
    Checked(Checked),
    Tuned(Box<Tuned>),
    Stepped(Box<Course>),
}

impl Found {
    /// Of this motor; `settings` are those of before.
    ///
    /// # Errors
    /// Of a step that was none.
    pub(super) fn json(&self, motor: Number, settings: &[Setting]) -> Result<Value, String> {
        let mut told = match self {
            Self::Checked(found) => checked(found),
            Self::Tuned(found) => tuned(found, settings),
            Self::Stepped(course) => return stepped(motor, course),
        };
        told["motor"] = (motor.index() + 1).into();
        Ok(told)
    }
}

/// A step, as pages are told.
///
/// # Errors
/// Of one that was none.
pub(super) fn stepped(motor: Number, course: &Course) -> Result<Value, String> {
    let (found, aim) = course.response().map_err(|error| error.to_string())?;
    let row =
        |s: &Sample| json!([s.time.as_millis() as u64, s.value, rounded(s.duty * 100.0, 10.0)]);
    let samples: Vec<_> = course.samples().iter().map(row).collect();
    let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
    Ok(json!({
        "motor": motor.index() + 1, "unit": course.unit(), "target": aim, "samples": samples,
        "rise_ms": ms(found.rise), "overshoot_percent": found.overshoot_percent,
        "settling_ms": ms(found.settling), "steady_error": found.steady_error, "why": course.why,
    }))
}

fn checked(found: &Checked) -> Value {
    let ways = found.ways.map(
        |way| json!({ "moved": way.moved, "current": way.current, "duty": percent(way.duty) }),
    );
    json!({ "ways": ways, "has_current": found.has_current, "turned_round": found.turned_round })
}

fn tuned(found: &Tuned, settings: &[Setting]) -> Value {
    let motor = &found.fit.motor;
    let gains = found.design.gains;
    let name = match found.control_loop {
        Loop::Velocity => "velocity",
        Loop::Position => "position",
    };
    let has_reset = found.control_loop == Loop::Velocity;
    let changes: Vec<_> = found
        .settings
        .iter()
        .filter_map(|(number, value)| {
            let was = settings.iter().find(|setting| setting.number == *number)?;
            Some(json!({ "number": number, "name": was.name, "before": was.value, "value": value }))
        })
        .collect();
    let curve = |values: &[f64]| values.iter().map(|v| rounded(*v, 10.0)).collect::<Vec<_>>();
    json!({
        "loop": name, "unit": found.control_loop.unit(),
        "fit": {
            "gain": rounded(motor.gain, 10.0),
            "time_constant_ms": rounded(motor.time_constant * 1000.0, 10.0),
            "dead_time_ms": rounded(motor.dead_time * 1000.0, 10.0),
            "dead_band": motor.dead_band.map(percent),
            "percent": rounded(found.fit.percent, 10.0),
        },
        "gains": {
            "kp": gains.kp, "kd": gains.kd, "reset_ms": has_reset.then_some(gains.reset_ms),
        },
        "settings": changes,
        "target": found.step.target,
        "predicted": response(&found.design.response),
        "measured": response(&found.response),
        "interval_ms": rounded(found.interval * 1000.0, 1000.0),
        "curves": { "measured": curve(&found.values), "predicted": curve(&found.predicted()) },
        "checked": checked(&found.checked),
    })
}

fn response(told: &Response) -> Value {
    let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
    json!({
        "rise_ms": ms(told.rise), "overshoot_percent": rounded(told.overshoot_percent, 10.0),
        "settling_ms": ms(told.settling), "steady_error": rounded(told.steady_error, 10.0),
    })
}

fn percent(part: f64) -> f64 {
    rounded(part * 100.0, 100.0)
}
