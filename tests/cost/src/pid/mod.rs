//! The PID kernel for six channels: from set-points and measurements to limited drives.
//!
//! Everyone has the same gains ([`KP`], [`KI`], [`KD`]), a derivative, an output limited to full
//! drive and an integral that does not wind up, and works on the numbers that suit it best.

mod floor;
mod ours;
mod peers;

use core::hint::black_box;

use crate::Meter;

/// Channels in a tick.
pub const CHANNELS: usize = 6;
/// Full drive in the units of the gains.
pub const FULL: i32 = 16384;
/// Bits behind the point in [`KP`], [`KI`] and [`KD`].
pub const GAIN_BITS: u32 = 8;
/// Drive a count of error: 24.
pub const KP: i16 = 24 << GAIN_BITS;
/// Drive a count of error and tick: 1/2.
pub const KI: i16 = 1 << (GAIN_BITS - 1);
/// Drive a count per tick: 16.
pub const KD: i16 = 16 << GAIN_BITS;

/// A gain as a real number, in parts of full drive.
fn part_of_full(gain: i16) -> f32 {
    f32::from(gain) / (FULL << GAIN_BITS) as f32
}

/// A bank of controllers.
pub trait Bank {
    /// What it takes for a count.
    type Count: Copy;
    /// What it gives for a drive.
    type Drive: Copy + Default;

    /// A count.
    fn count(count: i16) -> Self::Count;
    /// A drive in 1/16384 of full drive.
    fn duty(drive: Self::Drive) -> i32;
    /// One tick of all channels.
    fn tick(
        &mut self,
        set_points: &[Self::Count; CHANNELS],
        measured: &[Self::Count; CHANNELS],
        drives: &mut [Self::Drive; CHANNELS],
    );
}

/// Calls `one` for every channel, written out: a loop keeps its counters where the numbers should
/// be.
#[inline(always)]
fn for_each_channel(mut one: impl FnMut(usize)) {
    one(0);
    one(1);
    one(2);
    one(3);
    one(4);
    one(5);
}

/// All cases; the unit is a channel.
pub fn cases(meter: &mut impl Meter) {
    case(meter, "pid/ours", ours::Ours::new());
    case(meter, "pid/floor", floor::Floor::new());
    case(meter, "pid/i16", peers::PlainI16::default());
    case(meter, "pid/i64", peers::PlainI64::default());
    case(meter, "pid/idsp-i32", peers::IdspI32::new());
    case(meter, "pid/idsp-f32", peers::IdspF32::new());
    case(meter, "pid/fixed-wrapping", peers::FixedWrapping::default());
    case(meter, "pid/fixed-saturating", peers::FixedSaturating::default());
    case(meter, "pid/pid-f32", peers::PidCrate::new());
}

fn case<B: Bank>(meter: &mut impl Meter, name: &str, mut bank: B) {
    let set_points = [300, -300, 500, 0, 40, -2].map(B::count);
    let measured = [290, -280, 505, 4, 0, 1].map(B::count);
    let mut drives = [B::Drive::default(); CHANNELS];
    meter.case(name, CHANNELS, || {
        black_box(&mut bank).tick(black_box(&set_points), black_box(&measured), &mut drives);
        black_box(&drives);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs a bank on six plants that integrate the drive, and answers how far they have come
    /// after so many ticks, and the farthest they have been.
    fn run<B: Bank>(mut bank: B, set_point: i16, ticks: usize) -> (i32, i32) {
        let mut drives = [B::Drive::default(); CHANNELS];
        let (mut position, mut farthest) = (0.0_f32, 0);
        for _ in 0..ticks {
            let measured = [B::count(position as i16); CHANNELS];
            bank.tick(&[B::count(set_point); CHANNELS], &measured, &mut drives);
            let duties = drives.map(B::duty);
            assert!(duties.iter().all(|duty| duty.abs() <= FULL), "{duties:?}");
            position += duties[0] as f32 / FULL as f32 * 20.0;
            farthest = farthest.max(position as i32);
        }
        (position as i32, farthest)
    }

    fn controls<B: Bank>(name: &str, bank: fn() -> B) {
        let mut drives = [B::Drive::default(); CHANNELS];
        bank().tick(&[B::count(8000); CHANNELS], &[B::count(0); CHANNELS], &mut drives);
        let duties = drives.map(B::duty);
        assert!(duties.iter().all(|duty| *duty >= FULL - 1), "{name}: {duties:?} far away");
        let (position, farthest) = run(bank(), 8000, 3000);
        assert!((7990..=8010).contains(&position), "{name} is at {position}");
        // 400 ticks of full drive: an integral that had wound up would carry it far beyond.
        assert!(farthest < 8600, "{name} overshot to {farthest}");
    }

    #[test]
    fn everyone_reaches_full_drive_and_the_set_point_and_nobody_winds_up() {
        controls("ours", ours::Ours::new);
        controls("floor", floor::Floor::new);
        controls("i16", peers::PlainI16::default);
        controls("i64", peers::PlainI64::default);
        controls("idsp-i32", peers::IdspI32::new);
        controls("idsp-f32", peers::IdspF32::new);
        controls("fixed-wrapping", peers::FixedWrapping::default);
        controls("fixed-saturating", peers::FixedSaturating::default);
        controls("pid-f32", peers::PidCrate::new);
    }
}
