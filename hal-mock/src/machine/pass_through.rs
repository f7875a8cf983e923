//! The CM-5 as a pass-through, as a [`Machine`]: its host is the servos' master. Servos are named by the IDs
//! they had in the beginning.

use embassy_time::Instant;
use firmware::bridge::pass_through::PassThroughCounters;
use serde_json::{Map, Value, json};

use super::{Machine, servos};
use crate::pass_through_board::{Make, PassThroughBoard};
use crate::wire::Line;

/// A pass-through with its servos.
pub struct PassThrough {
    board: PassThroughBoard,
    servos: servos::Kept,
}

impl PassThrough {
    /// One that has just been switched on.
    pub fn new(make: Make) -> Self {
        let servos = servos::Kept::new(&make.servos, make.bus.faults);
        Self { board: PassThroughBoard::new(make), servos }
    }
}

impl Machine for PassThrough {
    fn name(&self) -> &'static str {
        "CM-5 as a pass-through"
    }

    fn line(&self) -> &Line {
        &self.board.line
    }

    fn run_until(&mut self, time: Instant) {
        self.board.run_until(time);
    }

    fn status(&self) -> String {
        let PassThroughCounters { refused_bauds, stops, .. } = self.board.pass().counters();
        let positions = servos::positions(self.board.bus.bus().servos());
        format!("stops={stops} refused={refused_bauds} positions={positions}")
    }

    fn faults(&self) -> Vec<String> {
        servos::errors(self.board.bus.bus().servos())
    }

    fn state(&self) -> Value {
        let bus = self.board.bus.bus();
        let servos = bus.servos().map(|(servo, plugged)| servos::state(servo, plugged));
        let servos: Vec<_> = servos.collect();
        let pass = self.board.pass();
        let wheels: Vec<u8> = pass.wheels().collect();
        let counters = pass.counters();
        json!({
            "t_ms": Instant::now().as_millis(),
            "servos": servos,
            "wheels": wheels,
            "pass_through": {
                "instructions": counters.instructions,
                "refused_bauds": counters.refused_bauds,
                "stops": counters.stops,
                "collisions": counters.collisions,
                "collided_bytes": counters.collided_bytes,
                "lost_bytes": counters.lost_bytes,
                "pc_line_errors": counters.pc_line_errors,
                "bus_line_errors": counters.bus_line_errors,
            },
        })
    }

    fn settable(&self) -> &'static [&'static str] {
        &servos::SETTABLE
    }

    fn overridden(&self) -> Map<String, Value> {
        self.servos.overridden(&self.board.bus.bus())
    }

    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String> {
        self.servos.set(&mut self.board.bus.bus(), changes)
    }
}
