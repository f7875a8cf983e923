//! How far the set-point of a timed position move may be ahead of its shaft.
//!
//! A set-point that runs on while something holds the shaft stores up a drive that is let loose
//! with it. So it *waits* when it leads by more than what the shaft was seen to *need* (its load, over
//! the gain), by 20 ms of the move, and by a tenth of the lead that drives fully, for friction. When the
//! shaft is free it goes on from there, at the rate asked.
//!
//! - A shaft that stands, and may be driven, may need more than before: a joint that is to lift a load.
//!   What it needs then grows, from nothing to full drive in 20 s, and is *proven* when the shaft moves.
//! - A shaft that breaks loose, and is fast at once, did not need it: it was jammed, and the
//!   set-point is put back to what was proven before.
//! - While limits take the drive away (an obstacle, a current, a soft limit) nothing grows, and the
//!   set-point is put back at once: even behind where it began, if the shaft rolls back.
//!
//! An encoder tells too late of a shaft that breaks loose slowly: a move of less than some 1000 counts/s
//! may be faster than asked for a moment, by some 300 counts/s.

use crate::channel::Sensor;

use crate::units::{Counts, CountsPerSecond, PERIODS_PER_SECOND};

/// What a free shaft needs to set out beside its share of drive: a 50th of a second of the move.
const SETTING_OUT: i32 = 50;
/// A shaft moves from 100 counts a second or an eighth of the rate on.
const MOVES: CountsPerSecond = CountsPerSecond::const_from_int(100);
/// It is fast from half of the rate on, if that is more than a sensor's noise: half a count a period
/// of an encoder, two of a potentiometer.
const FAST_BY_ENCODER: Counts = Counts::from_bits(128);
const FAST_BY_POTENTIOMETER: Counts = Counts::const_from_int(2);
/// What has moved a shaft for so many periods without making it fast is proven.
const PROOF: u8 = 32;

/// What the set-point is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Go on.
    Go,
    /// Stay for this period.
    Wait,
    /// Stay, but by so much nearer to the shaft.
    Back(Counts),
}

/// A period of a move. Ways and velocities are positive in its direction.
#[derive(Clone, Copy, Debug)]
pub struct Following {
    /// How far the set-point is ahead of the shaft.
    pub ahead: Counts,
    /// What the shaft has moved since the last period.
    pub moved: Counts,
    /// The estimate of its velocity.
    pub velocity: CountsPerSecond,
    /// What the move asks for, 0 or more.
    pub rate: CountsPerSecond,
    /// What measures it.
    pub sensor: Sensor,
}

/// The memory of one move. Ways are positive in its direction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lead {
    needed: Counts,
    proven: Counts,
    /// Counts a period, over the last few ms, times 4.
    pace: Counts,
    /// For how many periods the shaft has moved.
    moving: u8,
    /// The lead that drives fully, at most 32767.
    full_drive: Counts,
}

impl Lead {
    /// A move that sets out while the set-point is so much ahead already. A lead of `full_drive` drives
    /// fully.
    pub fn new(ahead: Counts, full_drive: Counts) -> Self {
        let needed = ahead.clamp(Counts::ZERO, full_drive);
        Self { needed, proven: needed, full_drive, ..Self::default() }
    }

    /// One period. `held_back`: limits keep the drive from going that way.
    pub fn step(&mut self, now: &Following, held_back: bool) -> Step {
        let Following { ahead, moved, velocity, rate, sensor } = *now;
        let quarter: Counts = self.pace.wrapping_shr(2);
        self.pace = self.pace.saturating_add(moved).saturating_sub(quarter);
        let a_period = rate.wrapping_div_int(PERIODS_PER_SECOND);
        let pace: Counts = self.pace.wrapping_shr(2);
        let moves = velocity > MOVES.max(rate.wrapping_shr(3));
        let noise = match sensor {
            Sensor::Encoder => FAST_BY_ENCODER,
            Sensor::SinglePotentiometer | Sensor::DualPotentiometer => FAST_BY_POTENTIOMETER,
        };
        let is_fast = pace > noise.max(a_period.wrapping_shr(1));

        self.moving = if moves { self.moving.saturating_add(1) } else { 0 };
        if held_back || (is_fast && self.moving < PROOF && self.needed > self.proven) {
            self.needed = self.proven;
            let back =
                ahead.saturating_sub(self.needed.saturating_add(self.full_drive.wrapping_shr(6)));
            return if back > 0 { Step::Back(back) } else { Step::Go };
        }
        if self.moving >= PROOF {
            self.proven = self.needed;
        }
        if moves {
            self.needed = self.needed.min(ahead.max(Counts::ZERO));
        }
        let friction = self.full_drive.wrapping_div_int(10);
        let margin = friction.saturating_add(rate.wrapping_div_int(SETTING_OUT));
        if ahead < self.needed.saturating_add(margin) {
            return Step::Go;
        }
        let more = self.full_drive.wrapping_div_int(20_000).max(Counts::DELTA);
        self.needed = self.needed.saturating_add(more).min(self.full_drive);
        Step::Wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At Kp 50.
    const FULL: Counts = Counts::const_from_int(655);

    /// A move of 1000 counts/s whose shaft stands, at so much behind.
    fn standing(ahead: Counts) -> Following {
        let (moved, velocity) = (Counts::ZERO, CountsPerSecond::ZERO);
        let rate = CountsPerSecond::from_num(1000);
        Following { ahead, moved, velocity, rate, sensor: Sensor::Encoder }
    }

    /// Where the set-point of a shaft that stands is after so many periods.
    fn pushed(lead: &mut Lead, periods: usize, held_back: bool) -> Counts {
        let mut ahead = Counts::ZERO;
        for _ in 0..periods {
            match lead.step(&standing(ahead), held_back) {
                Step::Go => ahead += Counts::ONE,
                Step::Wait => {}
                Step::Back(by) => ahead -= by,
            }
        }
        ahead
    }

    #[test]
    fn a_set_point_waits_85_counts_ahead_of_a_shaft_that_stands_and_31_a_second_more() {
        for (ms, least, most) in [(10, 10, 10), (100, 85, 88), (1085, 115, 122), (60_000, 655, 742)]
        {
            let ahead = pushed(&mut Lead::new(Counts::ZERO, FULL), ms, false);
            assert!((least..=most).contains(&ahead.to_num::<i32>()), "{ms} ms: {ahead}");
        }
    }

    #[test]
    fn limits_bring_it_back_to_what_was_proven() {
        let mut lead = Lead::new(Counts::from_num(100), FULL);
        assert_eq!(
            lead.step(&standing(Counts::from_num(150)), true),
            Step::Back(Counts::from_num(40) - Counts::from_bits(60))
        );
        assert_eq!(lead.step(&standing(Counts::from_num(110)), true), Step::Go);
    }

    #[test]
    fn a_shaft_that_breaks_loose_gets_no_more_than_was_proven_and_one_that_sets_out_keeps_it() {
        for (speed, is_jam) in [(3, true), (0, false)] {
            let mut lead = Lead::new(Counts::ZERO, FULL);
            let ahead = pushed(&mut lead, 3000, false);
            let mut fell_back = false;
            for ms in 0..100 {
                // A count every 4 ms, or three a ms.
                let moved = if is_jam { speed } else { i32::from(ms % 4 == 0) };
                let moving = Following {
                    moved: Counts::from_num(moved),
                    velocity: CountsPerSecond::from_num(if ms > 20 { 250 } else { 0 }),
                    ..standing(ahead)
                };
                fell_back |= matches!(lead.step(&moving, false), Step::Back(_));
            }
            assert_eq!(fell_back, is_jam);
        }
    }
}
