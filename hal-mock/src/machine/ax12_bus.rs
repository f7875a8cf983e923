//! A bus of AX-12 servos as a [`Machine`]: what a host finds behind a USB adapter for the bus.
//!
//! The adapter keeps the echo to itself, and takes no time of its own; the bus is paced. Servos are
//! named by the IDs they had in the beginning, whatever a host makes of them.

use std::task::Waker;

use embassy_time::Instant;
use serde_json::{Map, Value, json};

use super::{Machine, servos};
use crate::clock;
use crate::plant::Ax12;
use crate::servo_bus::{Make, ServoBus};
use crate::wire::Line;

/// How much the adapter takes from its host in advance. The rest waits on the line.
const AHEAD_NS: u64 = 5_000_000;

/// A bus, and the adapter's line.
pub struct Ax12Bus {
    bus: ServoBus,
    servos: servos::Kept,
    line: Line,
}

fn ns(time: Instant) -> u64 {
    time.as_micros() * 1000
}

impl Ax12Bus {
    /// A bus of these servos. Its echo is the adapter's.
    pub fn new(make: Make, servos: Vec<Ax12>) -> Self {
        clock::reset();
        let kept = servos::Kept::new(&servos, make.faults);
        let bus = ServoBus::new(Make { echo: false, ..make }, servos);
        Self { bus, servos: kept, line: Line::new(0) }
    }

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
}

impl Machine for Ax12Bus {
    fn name(&self) -> &'static str {
        "AX-12 bus"
    }

    fn line(&self) -> &Line {
        &self.line
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
        format!("positions={}", servos::positions(self.bus.servos()))
    }

    fn faults(&self) -> Vec<String> {
        servos::errors(self.bus.servos())
    }

    fn state(&self) -> Value {
        let servos = self.bus.servos().map(|(servo, plugged)| servos::state(servo, plugged));
        json!({ "t_ms": Instant::now().as_millis(), "servos": servos.collect::<Vec<_>>() })
    }

    fn settable(&self) -> &'static [&'static str] {
        &servos::SETTABLE
    }

    fn overridden(&self) -> Map<String, Value> {
        self.servos.overridden(&self.bus)
    }

    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String> {
        self.servos.set(&mut self.bus, changes)
    }
}
