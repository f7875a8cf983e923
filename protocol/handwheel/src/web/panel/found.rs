//! What a job has found, as pages are told.

use std::time::Duration;

use serde_json::{Value, json};

use super::tell::rounded;
use crate::Number;
use crate::session::Setting;
use crate::step::Response;
use crate::tune::{Checked, Loop, Tuned};

pub(super) enum Found {
    Checked(Checked),
    Tuned(Box<Tuned>),
}

impl Found {
    /// Of this motor; `settings` are those of before.
    pub(super) fn json(&self, motor: Number, settings: &[Setting]) -> Value {
        let mut told = match self {
            Self::Checked(found) => checked(found),
            Self::Tuned(found) => tuned(found, settings),
        };
        told["motor"] = (motor.index() + 1).into();
        told
    }
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
    let (name, unit) = match found.control_loop {
        Loop::Velocity => ("velocity", "counts/s"),
        Loop::Position => ("position", "counts"),
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
        "loop": name, "unit": unit,
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
