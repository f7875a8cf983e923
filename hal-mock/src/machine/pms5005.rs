//! The PMS5005 as a [`Machine`]: what it shows, tells and lets itself be told.

use std::collections::BTreeMap;
use std::fmt::Write;

use embassy_time::Instant;
use firmware::channel::Channel;
use firmware::controller::{ControlCounters, Snapshot};
use firmware::safety::faults::Fault;
use protocol::extension::Counters;
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::values::shown;
use super::{Machine, world};
use crate::board::VirtualBoard;
use crate::wire::Line;

impl Machine for VirtualBoard {
    fn name(&self) -> &'static str {
        "PMS5005"
    }

    fn line(&self) -> &Line {
        &self.line
    }

    fn run_until(&mut self, time: Instant) {
        VirtualBoard::run_until(self, time);
    }

    fn status(&self) -> String {
        let plant = self.plant.borrow();
        let link = self.link();
        let mut text = String::from("duty=");
        for (i, motor) in plant.outputs.motors.iter().enumerate() {
            let comma = if i > 0 { "," } else { "" };
            let _ = match motor.enabled {
                true => write!(text, "{comma}{:+.2}", f64::from(motor.duty.raw()) / 16384.0),
                false => write!(text, "{comma}off"),
            };
        }
        let _ = write!(
            text,
            " frames={} bad={} refused={}",
            link.frames_ok,
            link.bad_frames,
            self.refused(),
        );
        for (i, channel) in self.snapshot().channels.iter().enumerate() {
            if let Some(reason) = channel.reason {
                let _ = write!(text, "; motor {}: {reason}", i + 1);
            }
        }
        text
    }

    fn faults(&self) -> Vec<String> {
        faults(&self.snapshot())
    }

    fn state(&self) -> Value {
        json!(State::of(self))
    }

    fn settable(&self) -> &'static [&'static str] {
        world::SETTABLE
    }

    fn overridden(&self) -> Map<String, Value> {
        world::overridden(&self.plant.borrow())
    }

    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String> {
        world::set(&mut self.plant.borrow_mut(), changes)
    }
}

#[derive(Serialize)]
struct State {
    t_ms: u64,
    motors: [MotorState; 6],
    servos: [ServoState; 6],
    gpio_out: u8,
    lcd: String,
    /// What was counted, by name; `refused` with the commands that the controller has refused.
    link: BTreeMap<&'static str, u32>,
    faults: Vec<String>,
    /// How far the wall ahead is, if there is one.
    wall_cm: Option<Value>,
}

#[derive(Serialize)]
struct MotorState {
    /// -1 to 1.
    duty: f64,
    enabled: bool,
    /// Counts, unwrapped.
    position: i64,
    /// Counts per second.
    velocity: f32,
    current_a: f32,
    /// Why it does not do what was asked, if so.
    reason: Option<String>,
    /// Whether its current can be believed.
    current_sensor: bool,
}

#[derive(Serialize)]
struct ServoState {
    enabled: bool,
    pulse_us: f64,
}

impl State {
    fn of(board: &VirtualBoard) -> Self {
        let plant = board.plant.borrow();
        let snapshot = board.snapshot();
        let link = counted(board.link(), &snapshot);
        let outputs = &plant.outputs;
        Self {
            t_ms: embassy_time::Instant::now().as_millis(),
            motors: std::array::from_fn(|i| MotorState {
                duty: f64::from(outputs.motors[i].duty.raw()) / 16384.0,
                enabled: outputs.motors[i].enabled,
                position: plant.motors[i].position(),
                velocity: plant.motors[i].velocity(),
                current_a: plant.motors[i].current_a(),
                reason: snapshot.channels[i].reason.map(|reason| reason.to_string()),
                current_sensor: !snapshot.no_current_sensor[i],
            }),
            servos: outputs.servos.map(|pulse| ServoState {
                enabled: pulse.is_some(),
                pulse_us: pulse.map_or(0.0, |pulse| f64::from(pulse.raw()) / 2.25),
            }),
            gpio_out: outputs.gpio,
            lcd: plant.lcd.as_flattened().iter().map(|byte| format!("{byte:02x}")).collect(),
            link: link.named().chain([("refused", board.refused())]).collect(),
            faults: faults(&snapshot),
            wall_cm: plant.wall_cm().map(shown),
        }
    }
}

/// What the session has counted, with what the controller has.
pub(super) fn counted(link: Counters, snapshot: &Snapshot) -> Counters {
    let ControlCounters { refused, links_lost, .. } = snapshot.counters;
    Counters { commands_refused: refused.total(), links_lost, ..link }
}

/// What is latched, and `link_loss` for as long as it holds.
fn faults(snapshot: &Snapshot) -> Vec<String> {
    let link_loss = snapshot.link_loss.then(|| "link_loss".to_owned());
    link_loss.into_iter().chain(latched(snapshot)).collect()
}

/// What is latched (`stall 0` is channel 0's), but for the loss of the link.
pub(super) fn latched(snapshot: &Snapshot) -> impl Iterator<Item = String> {
    let name = |(fault, channel): (Fault, Option<Channel>)| {
        let mut name = String::new();
        for letter in format!("{fault:?}").chars() {
            if letter.is_uppercase() && !name.is_empty() {
                name.push('_');
            }
            name.push(letter.to_ascii_lowercase());
        }
        channel.map_or(name.clone(), |channel| format!("{name} {}", channel.index()))
    };
    snapshot.faults.iter().filter(|&(fault, _)| fault != Fault::LinkLoss).map(name)
}
