//! One servo channel: a pulse width that jumps or moves linearly.
//!
//! - A *move* takes a given time. A silent host breaks it off.
//! - A *slew* goes at a given pace. It goes on to its end, or until another takes its place: who asks
//!   for it minds the host. No flood of slews is faster, or slower, than one of them, since the
//!   set-point keeps its fractions.
//!
//! A servo gets no pulse before its first command. That command cannot move it slowly, since
//! nobody knows where it stands; every later one can.

use core::num::NonZeroU16;

use super::trajectory::Ramp;
use crate::units::ServoPulse;

/// A way at a steady pace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slew {
    /// In 1/2250 ms.
    pub target: i16,
    /// The pace: control periods in which the pulse width changes by 1 ms. A way that takes more
    /// than 65,535 of them takes these.
    pub periods_per_ms: NonZeroU16,
}

/// Bits of a set-point behind the point. The difference of any two targets fits in 32 bits.
const FRACTION: u32 = 14;

/// One servo channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Servo {
    /// In 1/2250 ms with [`FRACTION`]; `None` before the first command.
    set_point: Option<i32>,
    ramp: Ramp,
    /// The ramp is a slew.
    slews: bool,
    enabled: bool,
}

impl Servo {
    /// A servo at boot: no pulse.
    pub const fn new() -> Self {
        Self { set_point: None, ramp: Ramp::NONE, slews: false, enabled: false }
    }

    /// Enables the servo and moves the pulse width to `target` (1/2250 ms) in so many periods. In
    /// 0 it is there at once: there is no move left for a silent host to break off.
    pub fn go(&mut self, target: i16, periods: u16) {
        let way = self.way_to(target);
        if periods == 0 {
            self.set_point = self.set_point.map(|from| from.saturating_add(way));
            self.ramp = Ramp::NONE;
        } else {
            self.ramp = Ramp::new(way, periods);
        }
        self.slews = false;
        self.enabled = true;
    }

    /// Enables the servo and slews.
    pub fn slew(&mut self, Slew { target, periods_per_ms }: Slew) {
        let way = self.way_to(target);
        let ms = u64::from(ServoPulse::PER_MS) << FRACTION;
        let ways = u64::from(way.unsigned_abs()).saturating_mul(periods_per_ms.get().into());
        self.ramp = Ramp::new(way, u16::try_from(ways.div_ceil(ms)).unwrap_or(u16::MAX));
        self.slews = true;
        self.enabled = true;
    }

    /// How far it is to a target, in the set-point's unit; the first one is where it stands.
    fn way_to(&mut self, target: i16) -> i32 {
        let target = i32::from(target) << FRACTION;
        target.saturating_sub(*self.set_point.get_or_insert(target))
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
        if !self.slews {
            self.ramp = Ramp::NONE;
        }
    }

    /// Where it is, whether it has pulses or not; `None` before the first command.
    pub fn set_point(&self) -> Option<ServoPulse> {
        self.set_point.map(|set_point| ServoPulse::from_raw(set_point >> FRACTION))
    }

    /// One period: the pulse width.
    pub fn step(&mut self) -> Option<ServoPulse> {
        if !self.enabled {
            return None;
        }
        let set_point = self.set_point.as_mut()?;
        *set_point = set_point.saturating_add(self.ramp.advance());
        self.set_point()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_3000() -> Servo {
        let mut servo = Servo::new();
        servo.go(3000, 0);
        servo
    }

    fn slew(target: i16, periods_per_ms: u16) -> Slew {
        Slew { target, periods_per_ms: NonZeroU16::new(periods_per_ms).unwrap() }
    }

    #[test]
    fn a_jump_is_no_move_that_a_lost_link_could_break_off() {
        let mut servo = at_3000();
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

    #[test]
    fn a_slew_keeps_its_pace_arrives_and_is_broken_off_by_a_command_but_by_no_lost_link() {
        let mut servo = at_3000();
        // 500 counts at 2250 in 900 periods.
        servo.slew(slew(3500, 900));
        for period in 1..=200 {
            if period == 100 {
                servo.link_lost();
            }
            let pulse = ServoPulse::from_raw(3000 + period * 500 / 200);
            assert_eq!(servo.step(), Some(pulse), "{period}");
        }
        assert_eq!(servo.step(), Some(ServoPulse::from_raw(3500)));
        servo.slew(slew(3000, 900));
        (0..100).for_each(|_| _ = servo.step());
        servo.slew(slew(3250, 1));
        servo.step();
        assert_eq!(servo.step(), Some(ServoPulse::from_raw(3250)));
        // A move in its place is broken off as any.
        servo.slew(slew(3000, 900));
        servo.go(3000, 100);
        servo.link_lost();
        servo.step();
        assert_eq!(servo.step(), Some(ServoPulse::from_raw(3250)));
    }

    #[test]
    fn a_flood_of_slews_makes_a_servo_neither_faster_nor_slower() {
        // One count in 14.4 periods, either way, to targets that change every period.
        for (far, end) in [(5000, 3069), (1000, 2930)] {
            let mut servo = at_3000();
            let periods = 32_400..32_410;
            for per_ms in periods.cycle().take(1000) {
                servo.slew(slew(far + per_ms as i16 % 7, per_ms));
                servo.step();
            }
            assert_eq!(servo.set_point(), Some(ServoPulse::from_raw(end)));
        }
    }
}
