//! The shaft of an AX-12: a ramp towards the goal, and what the motor has to do for it.
//!
//! Positions are 300/1023 degrees, speeds 0.111 rpm, torques 1/1023 of what the motor can do;
//! counter-clockwise is positive and makes positions greater. The motor is as fast as it is told:
//! there is no inertia. What it pushes with follows the compliance of the manual: nothing within
//! the margin, then proportional to the error until it is the torque limit at the end of the slope.

use super::super::STEP_S;

/// Positions of a whole turn: 300 degrees are 1023.
const TURN: f32 = 1227.6;
/// The end of the potentiometer's track.
const TRACK: f32 = 1023.0;
/// Positions a second at a speed of 1: 0.111 rpm.
const POSITIONS_PER_SPEED: f32 = 0.111 * 360.0 / 60.0 * 1023.0 / 300.0;
/// The fastest that the motor can at 12 V, without load: 59 rpm.
const FULL_SPEED: f32 = 531.0;
/// The torque that a turning gear takes.
const FRICTION: f32 = 60.0;
/// How long the torque limit must be too little for the load: the manual gives no time.
const OVERLOAD_MS: u32 = 500;
/// Direction bit of speed and load: clockwise.
const CLOCKWISE: u16 = 1 << 10;

/// The world around a servo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Supply in 0.1 V.
    pub supply_dv: u8,
    /// In degrees Celsius.
    pub temperature_c: u8,
    /// The shaft is blocked.
    pub jammed: bool,
    /// Torque that pulls at the shaft, in 1/1023 of what the motor can do, counter-clockwise.
    pub load: i16,
}

impl Default for Surroundings {
    fn default() -> Self {
        Self { supply_dv: 120, temperature_c: 35, jammed: false, load: 0 }
    }
}

/// What the registers tell the motor.
pub(super) struct Drive {
    /// Where to; `None` to turn without end.
    pub goal: Option<f32>,
    /// The moving speed register.
    pub speed: u16,
    /// 0 when the motor is not driven.
    pub torque_limit: f32,
    /// Clockwise, counter-clockwise.
    pub margins: [f32; 2],
    /// Clockwise, counter-clockwise.
    pub slopes: [f32; 2],
}

/// A shaft.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shaft {
    position: f32,
    speed: f32,
    /// What the motor pushes with.
    torque: f32,
    stalled_ms: u32,
}

impl Default for Shaft {
    fn default() -> Self {
        Self { position: 512.0, speed: 0.0, torque: 0.0, stalled_ms: 0 }
    }
}

impl Shaft {
    pub fn position(&self) -> f32 {
        self.position
    }

    pub fn is_moving(&self) -> bool {
        self.speed != 0.0
    }

    pub fn is_overloaded(&self) -> bool {
        self.stalled_ms >= OVERLOAD_MS
    }

    /// The motor is switched off.
    pub fn stop(&mut self) {
        *self = Self { position: self.position, ..Self::default() };
    }

    /// The potentiometer; in its dead zone it is pulled to the nearer end of its track.
    pub fn reading(&self) -> u16 {
        let middle_of_dead_zone = (TRACK + TURN) / 2.0;
        match self.position {
            position if position > middle_of_dead_zone => 0,
            position => (position.min(TRACK) + 0.5) as u16,
        }
    }

    /// In 0.111 rpm; clockwise is negative.
    pub fn signed_speed(&self) -> f32 {
        self.speed
    }

    /// The present speed register.
    pub fn speed(&self) -> u16 {
        with_direction(self.speed)
    }

    /// The present load register.
    pub fn load(&self) -> u16 {
        with_direction(self.torque)
    }

    /// One step.
    pub fn step(&mut self, drive: &Drive, world: &Surroundings) {
        let supply = f32::from(world.supply_dv) / 120.0;
        let fastest = match (drive.goal, drive.speed) {
            (Some(_), 0) => FULL_SPEED * supply,
            (_, speed) => f32::from(speed & (CLOCKWISE - 1)).min(FULL_SPEED * supply),
        };
        let direction = |value: f32| usize::from(value > 0.0);
        // How far beyond the margin the goal is; and what the motor pushes with because of it.
        let (error, push) = match drive.goal {
            Some(goal) => {
                let error = goal - self.position;
                let beyond = (error.abs() - drive.margins[direction(error)]).max(0.0);
                let part = (beyond / drive.slopes[direction(error)]).min(1.0);
                (beyond.copysign(error), (part * drive.torque_limit).copysign(error))
            }
            None => {
                let sign = if drive.speed & CLOCKWISE == 0 { 1.0 } else { -1.0 };
                let wanted = f32::from(u8::from(fastest > 0.0)) * sign;
                (wanted * TURN, wanted * drive.torque_limit)
            }
        };
        let load = f32::from(world.load);
        // What it takes to turn the gear against the load, and at rest to hold the load.
        let needed = if error == 0.0 { -load } else { FRICTION.copysign(error) - load };
        let too_weak = needed.abs() > drive.torque_limit;
        let driven = drive.torque_limit > 0.0;
        let blocked = world.jammed || too_weak;
        if !driven || blocked || error == 0.0 {
            self.speed = 0.0;
            self.torque = if !driven {
                0.0
            } else if world.jammed {
                push
            } else {
                needed.clamp(-drive.torque_limit, drive.torque_limit)
            };
        } else {
            let way = (fastest * POSITIONS_PER_SPEED * STEP_S).min(error.abs());
            self.speed = (way / STEP_S / POSITIONS_PER_SPEED).copysign(error);
            self.torque = needed;
            self.travel(way.copysign(error), drive.goal.is_none());
        }
        let stalled = driven && blocked && self.torque.abs() >= drive.torque_limit;
        self.stalled_ms = match self.stalled_ms {
            ms if stalled => ms.saturating_add(1),
            // Only a motor that is driven can tell that it is overloaded no more.
            ms if !driven && ms >= OVERLOAD_MS => ms,
            _ => 0,
        };
    }

    fn travel(&mut self, way: f32, endlessly: bool) {
        self.position += way;
        if endlessly && self.position >= TURN {
            self.position -= TURN;
        } else if endlessly && self.position < 0.0 {
            self.position += TURN;
        }
    }
}

/// Magnitude and direction bit.
fn with_direction(value: f32) -> u16 {
    let magnitude = (value.abs() + 0.5) as u16;
    magnitude.min(CLOCKWISE - 1) | if value < 0.0 && magnitude > 0 { CLOCKWISE } else { 0 }
}
