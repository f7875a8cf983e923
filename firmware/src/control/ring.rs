//! Positions as sensors give them: on a circle, or on a line that ends.

use crate::units::Counts;

/// The scale of a position sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// A line: one potentiometer.
    Line,
    /// A circle of so many counts: an encoder, or two potentiometers.
    Circle(u16),
}

impl Scale {
    /// The encoder's count: 0 to 32767.
    pub const ENCODER: Self = Self::Circle(32768);
    /// The angle of two potentiometers: one turn is 4428 counts of a potentiometer that spans 333
    /// degrees in 4096.
    pub const DUAL_POTENTIOMETER: Self = Self::Circle(4428);

    /// The difference `to - from`, on a circle by the shorter way round. Both lie on the scale.
    pub fn difference(self, to: Counts, from: Counts) -> Counts {
        let straight = to.saturating_sub(from);
        match self {
            Self::Line => straight,
            Self::Circle(turn) => {
                let turn = Counts::from(turn);
                let half: Counts = turn.wrapping_shr(1);
                if straight >= half {
                    straight.saturating_sub(turn)
                } else if straight < half.saturating_neg() {
                    straight.saturating_add(turn)
                } else {
                    straight
                }
            }
        }
    }

    /// `position + way` on the scale, for ways of less than a turn.
    pub fn advance(self, position: Counts, way: Counts) -> Counts {
        let there = position.saturating_add(way);
        match self {
            Self::Line => there,
            Self::Circle(turn) => {
                let turn = Counts::from(turn);
                if there >= turn {
                    there.saturating_sub(turn)
                } else if there < Counts::ZERO {
                    there.saturating_add(turn)
                } else {
                    there
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(n: i32) -> Counts {
        Counts::from_num(n)
    }

    #[test]
    fn the_shorter_way_round_is_taken() {
        let encoder = Scale::ENCODER;
        assert_eq!(encoder.difference(counts(10), counts(32760)), counts(18));
        assert_eq!(encoder.difference(counts(32760), counts(10)), counts(-18));
        assert_eq!(encoder.difference(counts(6000), counts(0)), counts(6000));
        assert_eq!(Scale::Line.difference(counts(4095), counts(0)), counts(4095));
        let dual = Scale::DUAL_POTENTIOMETER;
        assert_eq!(dual.difference(counts(4400), counts(100)), counts(-128));
    }

    #[test]
    fn advancing_undoes_the_difference_for_every_pair() {
        for scale in [Scale::ENCODER, Scale::DUAL_POTENTIOMETER] {
            let Scale::Circle(turn) = scale else { unreachable!() };
            for from in (0..turn).step_by(61) {
                for to in (0..turn).step_by(97) {
                    let (from, to) = (counts(from.into()), counts(to.into()));
                    let way = scale.difference(to, from);
                    assert!(way.unsigned_abs() <= turn / 2);
                    assert_eq!(scale.advance(from, way), to);
                }
            }
        }
    }
}
