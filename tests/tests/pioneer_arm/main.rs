//! The Pioneer Arm through the whole board: a host on one end of the line, six servos on the other.
//!
//! - `session`: SYNC to CLOSE, what comes when, a host that dies;
//! - `motion`: joints, power, parking, the timers;
//! - `arm_link`: the arm's own cable, INIT and CHECK;
//! - `faults`: a fault of the board that stops the servos;
//! - `extension`: the board's settings, health and faults over the wire;
//! - `refusals`: what is not done, and hours of chaos.
//!
//! The calibration is the default one: home and centre at 127, 140 ticks to 90 degrees, 20 ms a
//! tick.

mod arm_link;
mod extension;
mod faults;
mod motion;
mod refusals;
mod session;

use embassy_time::{Duration, Instant};
use firmware::personality::pioneer_arm::PioneerArm;
use hal_mock::board::Make;
use protocol::arcos::{
    Argument, ArmCommand, ArmStatus, JOINTS, JointNumber, Joints, Packet, SYNC, Standard,
    StatusRequest, command, encode_command,
};
use tests::Link::{Alive, Silent};
use tests::arm::{Arm as Host, number};

/// The pulse of a position by the default calibration: 1.5 ms at 127, 1 ms more 140 ticks up.
fn pulse(ticks: u8) -> u16 {
    (3375 + (i32::from(ticks) - 127) * 2250 / 140) as u16
}

/// All joints at home, with power.
const AT_HOME: [Option<u16>; JOINTS] = [Some(3375); JOINTS];
const NO_PULSES: [Option<u16>; JOINTS] = [None; JOINTS];

/// Watches the pulses, and does not allow a joint more than a tick from one look to the next, nor
/// power to come or go while a servo is not at home. A fault may take it anywhere, and then it
/// comes back where it went.
struct NoJump {
    pulses: [Option<u16>; JOINTS],
    /// Where a fault has taken the power.
    lost_at: [Option<u16>; JOINTS],
    /// How many steps it has seen.
    steps: u32,
}

impl NoJump {
    /// A tick is 16.07 counts.
    const TICK: i32 = 17;

    fn new(host: &Host) -> Self {
        Self { pulses: host.pulses(), lost_at: NO_PULSES, steps: 0 }
    }

    fn look(&mut self, host: &Host) {
        let now = host.pulses();
        let servos = host.servos();
        let fault = host.board.snapshot().faults.stops_servos();
        for (joint, (before, now)) in self.pulses.iter().zip(now).enumerate() {
            let lost_at = &mut self.lost_at[joint];
            let before = match (*before, now) {
                (Some(_), None) if fault => {
                    *lost_at = *before;
                    continue;
                }
                (None, Some(_)) if lost_at.is_some() => lost_at.take(),
                _ => *before,
            };
            if let (Some(before), Some(now)) = (before, now) {
                let step = i32::from(now) - i32::from(before);
                self.steps += u32::from(step != 0);
                assert!(step.abs() <= Self::TICK, "joint {} jumps by {step}", joint + 1);
            }
            if let (None, Some(now)) | (Some(now), None) = (before, now) {
                assert_eq!(now, pulse(127), "joint {}: power comes and goes at home", joint + 1);
                let from_home = (servos[joint] - f32::from(now)).abs();
                assert!(from_home < 1.0, "servo {}: {from_home} from home", joint + 1);
            }
        }
        self.pulses = now;
    }
}

/// What the whole arm is asked to do.
const ALL: Joints = Joints::All;
