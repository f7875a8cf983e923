//! A bus of AX-12 servos as a [`Machine`]: what a host finds behind a USB adapter for the bus.
//!
//! The adapter keeps the echo to itself, and takes no time of its own; the bus is paced. Servos are
//! named by the IDs they had in the beginning, whatever a host makes of them.

use std::task::Waker;

use embassy_time::Instant;
use hal_mock::clock;
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{Faults, Make, ServoBus};
use hal_mock::wire::Line;
use protocol::dynamixel::{InstructionReceiver, Register};
use serde_json::{Map, Value, json};

use crate::machine::{Follower, Machine};
use crate::options::Options;
use crate::values;

/// How much the adapter takes from its host in advance. The rest waits on the line.
const AHEAD_NS: u64 = 5_000_000;
/// The highest ID of a servo.
const HIGHEST_ID: u8 = 253;
/// A fault rate of one.
const CERTAIN_PPM: u64 = 1_000_000;

struct Ax12Bus {
    bus: ServoBus,
    faults: Faults,
    /// The IDs in the beginning.
    ids: Vec<u8>,
    line: Line,
}

/// The bus that the options ask for, or in one line what is wrong with them.
pub fn machine(options: &Options) -> Result<Box<dyn Machine>, String> {
    let ids = ids(&options.servos).ok_or_else(|| {
        format!("--servos {}: expected IDs from 0 to 253, as 1-6 or 1,2,5-7", options.servos)
    })?;
    if options.line_rate() == 0 {
        return Err("--line-rate 0: a servo bus takes its time, give 9600 or more".into());
    }
    clock::reset();
    let make =
        Make { baud: options.line_rate(), echo: false, seed: options.seed, ..Make::default() };
    Ok(Box::new(Ax12Bus {
        bus: ServoBus::new(make, ids.iter().copied().map(Ax12::new)),
        faults: make.faults,
        ids,
        line: Line::new(0),
    }))
}

/// The IDs in a list of numbers and ranges.
fn ids(list: &str) -> Option<Vec<u8>> {
    let mut ids = Vec::new();
    for part in list.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u8, u8) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
        if first > last || last > HIGHEST_ID {
            return None;
        }
        ids.extend(first..=last);
    }
    Some(ids)
}

fn ns(time: Instant) -> u64 {
    time.as_micros() * 1000
}

impl Ax12Bus {
    /// Lets the adapter take what its host has sent, as far as the bus can follow.
    fn take(&mut self, now_ns: u64) {
        let mut buffer = [0; 64];
        while self.bus.sending_until_ns() < now_ns + AHEAD_NS {
            let count = self.line.board_receives(&mut buffer);
            if count == 0 {
                break;
            }
            self.bus.send(now_ns, &buffer[..count]);
        }
    }

    /// The places of the servos that a list of IDs names.
    fn places(&self, key: &str, value: &Value) -> Result<Vec<bool>, String> {
        let named = |value: &Value| {
            let id = u8::try_from(value.as_u64()?).ok()?;
            self.ids.contains(&id).then_some(id)
        };
        let named: Option<Vec<_>> =
            value.as_array().and_then(|ids| ids.iter().map(named).collect());
        let named = named.ok_or(format!("{key}: expected a list of IDs out of {:?}", self.ids))?;
        Ok(self.ids.iter().map(|id| named.contains(id)).collect())
    }
}

impl Machine for Ax12Bus {
    fn name(&self) -> &'static str {
        "AX-12 bus"
    }

    fn line(&self) -> &Line {
        &self.line
    }

    fn follower(&self) -> Box<dyn Follower> {
        Box::new(InstructionReceiver::new())
    }

    fn run_until(&mut self, time: Instant) {
        self.take(ns(Instant::now()));
        clock::advance_to(time);
        self.bus.advance_to(ns(time));
        let heard: Vec<u8> =
            std::iter::from_fn(|| self.bus.receive()).map(|(_, byte)| byte).collect();
        if !heard.is_empty() {
            self.line.board_sends(&heard);
        }
        if let Some(next) = self.bus.next_ns() {
            // Nobody is woken: the program sleeps until the next alarm.
            embassy_time_driver::schedule_wake(next.div_ceil(1000), Waker::noop());
        }
    }

    fn status(&self) -> String {
        let positions = self.bus.servos().map(|(servo, plugged)| match plugged {
            true => servo.get(Register::PRESENT_POSITION).to_string(),
            false => "-".into(),
        });
        format!("positions={}", positions.collect::<Vec<_>>().join(","))
    }

    fn panel(&self) -> String {
        let servos = self.bus.servos().map(|(servo, plugged)| {
            format!(
                "servo {:3} {:4} goal {:4} torque {} {}",
                servo.id(),
                servo.get(Register::PRESENT_POSITION),
                servo.get(Register::GOAL_POSITION),
                if servo.get(Register::TORQUE_ENABLE) == 1 { " on" } else { "off" },
                if plugged { servo.errors().to_string() } else { "unplugged".into() },
            )
        });
        servos.collect::<Vec<_>>().join("\n")
    }

    fn state(&self) -> Value {
        let servos = self.bus.servos().map(|(servo, plugged)| {
            json!({
                "id": servo.id(),
                "plugged": plugged,
                "position": servo.position(),
                "goal": servo.get(Register::GOAL_POSITION),
                "speed": servo.get(Register::MOVING_SPEED),
                "torque": servo.get(Register::TORQUE_ENABLE) == 1,
                "load": servo.get(Register::PRESENT_LOAD),
                "errors": servo.errors().to_string(),
            })
        });
        json!({ "t_ms": Instant::now().as_millis(), "servos": servos.collect::<Vec<_>>() })
    }

    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String> {
        let mut faults = self.faults;
        let (mut unplugged, mut jammed) = (None, None);
        let rate =
            |key, value| Ok::<_, String>(values::number(key, value, CERTAIN_PPM)?.unwrap_or(0));
        for (key, value) in changes {
            match key.as_str() {
                "unplugged" => unplugged = Some(self.places(key, value)?),
                "jammed" => jammed = Some(self.places(key, value)?),
                "dropped_ppm" => faults.dropped_ppm = rate(key, value)?,
                "flipped_ppm" => faults.flipped_ppm = rate(key, value)?,
                "stalled_ppm" => faults.stalled_ppm = rate(key, value)?,
                _ => return Err(format!("{key}: nothing of this name can be set")),
            }
        }
        self.faults = faults;
        self.bus.set_faults(faults);
        for (index, unplugged) in unplugged.into_iter().flatten().enumerate() {
            if unplugged { self.bus.unplug(index) } else { self.bus.plug(index) }
        }
        for (index, jammed) in jammed.into_iter().flatten().enumerate() {
            self.bus.servo(index).surroundings.jammed = jammed;
        }
        Ok(())
    }
}
