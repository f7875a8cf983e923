//! One servo channel: a pulse width that jumps or moves linearly.
//!
//! A servo gets no pulse before its first command. That command cannot move it slowly, since
//! nobody knows where it stands; every later one can.

use super::trajectory::Ramp;
use crate::units::ServoPulse;

/// One servo channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo {
    /// Set-point in 1/2250 ms; `None` before the first command.
    set_point: Option<i32>,
    ramp: Ramp,
    enabled: bool,
}

impl Servo {
    /// A servo at boot: no pulse.
    pub const fn new() -> Self {
        Self { set_point: None, ramp: Ramp::NONE, enabled: false }
    }

    /// Enables the servo and moves the pulse width to `target` (1/2250 ms) in so many periods. In
    /// 0 it is there at once: there is no move left for a silent host to break off.
    pub fn go(&mut self, target: i16, periods: u16) {
        let target = i32::from(target);
        let from = *self.set_point.get_or_insert(target);
        if periods == 0 {
            self.set_point = Some(target);
            self.ramp = Ramp::NONE;
        } else {
            self.ramp = Ramp::new(target.saturating_sub(from), periods);
        }
        self.enabled = true;
    }

    /// Stops the pulses; a move is interrupted.
    pub fn suspend(&mut self) {
        self.enabled = false;
    }

    /// A fault: off as if suspended, with nowhere to go.
    pub fn trip(&mut self) {
        self.suspend();
        self.ramp = Ramp::NONE;
    }

    /// Starts the pulses again, if there ever were any, and goes on with the move.
    pub fn resume(&mut self) {
        self.enabled = true;
    }

    /// The host has fallen silent: a move is broken off where it is.
    pub fn link_lost(&mut self) {
        self.ramp = Ramp::NONE;
    }

    /// One period: the pulse width.
    pub fn step(&mut self) -> Option<ServoPulse> {
        if !self.enabled {
            return None;
        }
        let set_point = self.set_point.as_mut()?;
        *set_point = set_point.saturating_add(self.ramp.advance());
        Some(ServoPulse::from_raw(*set_point))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_is_no_move_that_a_lost_link_could_break_off() {
        let mut servo = Servo::new();
        servo.go(3000, 0);
        servo.step();
        servo.go(3016, 0);
        servo.link_lost();
        assert_eq!(servo.step(), Some(ServoPulse::from_raw(3016)));
        // A move is.
        servo.go(4016, 100);
        servo.step();
        servo.link_lost();
        assert_eq!(servo.step(), Some(ServoPulse::from_raw(3026)));
    }
}
