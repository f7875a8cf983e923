//! The Pioneer Arm as a [`Machine`]: what it shows, tells and lets itself be told.

use std::collections::BTreeMap;

use embassy_time::Instant;
use firmware::personality::pioneer_arm::PioneerArm;
use protocol::arcos::JOINTS;
use serde_json::{Map, Value, json};

use super::Machine;
use super::pms5005::{counted, latched};
use super::values::{numbers, that_are_set};
use crate::board::VirtualBoard;
use crate::wire::Line;

/// The input that tells that the arm is connected, when its cable is cut, and when it is not.
const CUT: u8 = 1;
const CONNECTED: u8 = 0;

impl Machine for VirtualBoard<PioneerArm> {
    fn name(&self) -> &'static str {
        "Pioneer Arm"
    }

    fn line(&self) -> &Line {
        &self.line
    }

    fn run_until(&mut self, time: Instant) {
        VirtualBoard::run_until(self, time);
    }

    fn status(&self) -> String {
        let link = self.link();
        let ticks = link.arm.positions.map(|ticks| ticks.to_string()).join(",");
        format!(
            "ticks={ticks} power={} packets={} bad={} refused={} ignored={}",
            if link.arm.powered { "on" } else { "off" },
            link.link.frames_ok,
            link.link.bad_frames,
            link.link.refused,
            link.ignored,
        )
    }

    fn faults(&self) -> Vec<String> {
        faults(self)
    }

    fn state(&self) -> Value {
        let plant = self.plant.borrow();
        let link = self.link();
        let joint = |i: usize| {
            let pulse = plant.outputs.servos[i];
            json!({
                "ticks": link.arm.positions[i],
                "moving": link.arm.moving[i],
                "powered": pulse.is_some(),
                "pulse_us": pulse.map_or(0.0, |pulse| f64::from(pulse.raw()) / 2.25),
                // Where the simulated servo is, as the pulse that would hold it there.
                "at_us": plant.servos[i].position() / 2.25,
            })
        };
        json!({
            "t_ms": Instant::now().as_millis(),
            "joints": std::array::from_fn::<_, JOINTS, _>(joint),
            "powered": link.arm.powered,
            "connected": link.arm.connected,
            "good": link.arm.good,
            "initialised": link.arm.initialised,
            "homing": link.arm.homing,
            "link": counted(link.link, &self.snapshot())
                .named()
                .chain([
                    ("opened", link.opened),
                    ("watchdogs", link.watchdogs),
                    ("out_of_turn", link.out_of_turn),
                    ("ignored", link.ignored),
                    ("limited", link.limited),
                    ("arms_lost", link.arms_lost),
                    ("power_lost", link.power_lost),
                ])
                .collect::<BTreeMap<_, _>>(),
            "faults": faults(self),
        })
    }

    fn settable(&self) -> &'static [&'static str] {
        &["arm_link", "battery"]
    }

    fn overridden(&self) -> Map<String, Value> {
        let overrides = &self.plant.borrow().overrides;
        that_are_set(json!({
            "arm_link": overrides.gpio_in.map(|input| input == CONNECTED),
            "battery": overrides.battery,
        }))
    }

    fn set(&mut self, changes: &Map<String, Value>) -> Result<(), String> {
        let mut overrides = self.plant.borrow().overrides.clone();
        for (key, value) in changes {
            match (key.as_str(), value) {
                ("arm_link", Value::Bool(true)) => overrides.gpio_in = Some(CONNECTED),
                ("arm_link", Value::Bool(false)) => overrides.gpio_in = Some(CUT),
                ("arm_link", Value::Null) => overrides.gpio_in = None,
                ("arm_link", _) => return Err(format!("{key}: expected true, false, or null")),
                ("battery", value) => overrides.battery = numbers(key, value, 4095)?,
                _ => return Err(format!("{key}: cannot be set")),
            }
        }
        self.plant.borrow_mut().overrides = overrides;
        Ok(())
    }
}

/// What is wrong with the arm, and what is latched on its board.
fn faults(board: &VirtualBoard<PioneerArm>) -> Vec<String> {
    let arm = board.link().arm;
    let of_the_arm = if !arm.connected {
        Some("no_arm")
    } else if !arm.initialised {
        Some("needs_init")
    } else {
        None
    };
    of_the_arm.map(str::to_owned).into_iter().chain(latched(&board.snapshot())).collect()
}
