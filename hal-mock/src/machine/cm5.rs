//! The CM-5 as a [`Machine`]: the bridge, and the simulated servos on its bus. Servos are named by
//! the IDs they had in the beginning.

use embassy_time::Instant;
use firmware::bridge::{BridgeCounters, BusServo};
use protocol::dynamixel::Register;
use serde_json::{Map, Value, json};

use super::{Machine, servos};
use crate::cm5_board::{Cm5Board, Make};
use crate::wire::Line;

/// A CM-5 with its servos.
pub struct Cm5 {
    board: Cm5Board,
    servos: servos::Kept,
}

impl Cm5 {
    /// One that has just been switched on.
    pub fn new(make: Make) -> Self {
        let servos = servos::Kept::new(&make.servos, make.bus.faults);
        Self { board: Cm5Board::new(make), servos }
    }
}

impl Machine for Cm5 {
    fn name(&self) -> &'static str {
        "CM-5"
    }

    fn line(&self) -> &Line {
        &self.board.line
    }

    fn run_until(&mut self, time: Instant) {
        self.board.run_until(time);
    }

    fn status(&self) -> String {
        let bridge = self.board.bridge();
        let BridgeCounters { pc, .. } = bridge.counters();
        let (answering, known) = (bridge.servos().filter(answers).count(), bridge.servos().count());
        format!(
            "servos={answering}/{known} goals={} refused={} positions={}",
            pc.goals,
            pc.refused,
            servos::positions(self.board.bus.bus().servos()),
        )
    }

    fn faults(&self) -> Vec<String> {
        let bridge = self.board.bridge();
        let mut faults = servos::errors(self.board.bus.bus().servos());
        let missing = bridge.servos().filter(|servo| servo.is_missing());
        faults.extend(missing.map(|servo| format!("servo {} missing", servo.id.number())));
        if bridge.pc_is_silent() {
            faults.push("PC silent".into());
        }
        faults
    }

    fn state(&self) -> Value {
        let bridge = self.board.bridge();
        let bus = self.board.bus.bus();
        let servos = bus.servos().map(|(servo, plugged)| {
            let registers = Register::ALL
                .iter()
                .map(|register| (register.name.to_lowercase(), json!(servo.get(*register))));
            let mut state = servos::state(servo, plugged);
            state["registers"] = Value::Object(registers.collect());
            let known = bridge.servos().find(|known| known.id.number() == servo.id());
            state["bridge"] = known.map_or(Value::Null, of_servo);
            state
        });
        let servos: Vec<_> = servos.collect();
        json!({
            "t_ms": Instant::now().as_millis(),
            "servos": servos,
            "searching": bridge.is_searching(),
            "pc_silent": bridge.pc_is_silent(),
            "bridge": of_bridge(&bridge.counters()),
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

fn answers(servo: &&BusServo) -> bool {
    servo.feedback.is_some()
}

/// What the bridge knows of a servo.
fn of_servo(servo: &BusServo) -> Value {
    let counters = servo.counters;
    json!({
        "agreed": servo.is_agreed(),
        "missing": servo.is_missing(),
        "stale": servo.feedback.is_none(),
        "replies": counters.replies,
        "time_outs": counters.time_outs,
        "checksum_errors": counters.checksum_errors,
        "error_replies": counters.error_replies,
        "errors_seen": counters.errors_seen.to_string(),
        "latency_us": counters.latency_us,
        "longest_latency_us": counters.longest_latency_us,
        "returns": counters.returns,
        "eeprom_bytes": counters.eeprom_bytes,
    })
}

fn of_bridge(counters: &BridgeCounters) -> Value {
    let BridgeCounters { reception, pc, bus, cycles, newcomers, without_room } = counters;
    json!({
        "cycles": cycles,
        "newcomers": newcomers,
        "without_room": without_room,
        "pc": {
            "frames_ok": reception.frames_ok,
            "bad_frames": reception.bad_frames,
            "bytes_skipped": reception.bytes_skipped,
            "hellos_sent": pc.hellos_sent,
            "answers": pc.answers,
            "goals": pc.goals,
            "refused": pc.refused,
            "reports_sent": pc.reports_sent,
            "reports_skipped": pc.reports_skipped,
            "silences": pc.silences,
            "line_errors": pc.line_errors,
        },
        "bus": {
            "instructions": bus.instructions,
            "collisions": bus.collisions,
            "stray_bytes": bus.stray_bytes,
            "line_errors": bus.line_errors,
        },
    })
}
