//! One angle from two potentiometers (sensor 01 of sub-command 0D).
//!
//! A potentiometer spans 333 degrees in 0 to 4095; the other 27 degrees are its dead zone, where
//! its reading says nothing; the hardware pulls the open wiper to an end. Two of them on one shaft,
//! mounted half a turn (2214 counts) apart, are never both there. The angle is on the first one's
//! scale: 0 to 4427, where 4096 to 4427 is its dead zone.

use super::ring::Scale;
use crate::units::Counts;

/// Half a turn in counts.
const HALF_TURN: Counts = Counts::const_from_int(2214);
/// The highest reading.
const FULL_SCALE: u16 = 4095;
/// Readings nearer to an end than this are not trusted at all: the wiper may be leaving the track.
const MARGIN: u16 = 128;
/// Readings this much farther from the ends are trusted fully; in between the trust fades, so
/// that the angle does not jump when one takes over from the other.
const FADE: u16 = 256;

/// The two potentiometers of channels 0 to 2: indices from 0 (facts of the original's wiring).
pub const PAIRS: [(usize, usize); crate::channel::PAIRS] = [(0, 5), (1, 4), (2, 3)];

/// The angle of the shaft, 0 to 4427 counts (with fractions below).
///
/// `first` and `second` are A/D readings, 0 to 4095.
pub fn angle(first: u16, second: u16) -> Counts {
    let dual = Scale::DUAL_POTENTIOMETER;
    let first_angle = Counts::from(first.min(FULL_SCALE));
    let second_angle = dual.advance(Counts::from(second.min(FULL_SCALE)), HALF_TURN);
    let (first_trust, second_trust) = (trust(first), trust(second));
    let total = first_trust.saturating_add(second_trust);
    if total == 0 {
        // Both at an end: a wire is off. The first one's reading is as good as any.
        return first_angle;
    }
    let apart = dual.difference(second_angle, first_angle);
    // |apart| <= 2214 and trust <= FADE: the product is far below the range of the type.
    let part = apart.saturating_mul_int(second_trust).checked_div_int(total);
    dual.advance(first_angle, part.unwrap_or_default())
}

/// How much a reading is to be trusted: 0 to [`FADE`].
fn trust(reading: u16) -> i32 {
    let from_end = reading.min(FULL_SCALE.saturating_sub(reading));
    from_end.saturating_sub(MARGIN).min(FADE).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a potentiometer reads at an angle on its own scale; `dead` in the dead zone.
    fn reading(angle: i32, dead: u16) -> u16 {
        let angle = angle.rem_euclid(4428);
        u16::try_from(angle).ok().filter(|&a| a <= FULL_SCALE).unwrap_or(dead)
    }

    #[test]
    fn the_angle_is_right_all_the_way_round_whichever_end_the_dead_zone_reads() {
        for dead in [0, FULL_SCALE] {
            for shaft in 0..4428 {
                let angle =
                    angle(reading(shaft, dead), reading(shaft - HALF_TURN.to_num::<i32>(), dead));
                assert_eq!(angle, Counts::from_num(shaft), "at {shaft}, dead {dead}");
            }
        }
    }

    #[test]
    fn a_mismatch_of_the_two_fades_from_one_to_the_other_without_a_jump() {
        let mismatch = 40;
        let mut last = None;
        for shaft in 0..2 * 4428 {
            let second = reading(shaft - HALF_TURN.to_num::<i32>(), 0);
            let second = if second > 0 { (second + mismatch).min(FULL_SCALE) } else { 0 };
            let now = angle(reading(shaft, 0), second);
            if let Some(last) = last {
                let step = Scale::DUAL_POTENTIOMETER.difference(now, last);
                assert!((0..=2).contains(&step.to_num::<i32>()), "at {shaft}: {step}");
            }
            last = Some(now);
        }
    }
}
