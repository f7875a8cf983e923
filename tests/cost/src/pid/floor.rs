//! The least that a Cortex-M4 can do for six PID channels: 16-bit numbers, two to a register, the
//! velocity form
//!
//! ```text
//!   drive += b0 * e[0] + b1 * e[1] + b2 * e[2],  limited
//! ```
//!
//! whose accumulator is the drive itself, so that limiting it is the anti-windup. It does less than
//! everyone else: a jump of the set-point kicks the derivative, gains and errors have 16 bits, and
//! the caller must see to it that |b0| + |b1| + |b2| < 2^15, or the sum overflows.
//!
//! The assembly is for the image; [`portable`] is its twin, bit for bit, for everyone else.

use super::{Bank, CHANNELS, FULL, GAIN_BITS, KD, KI, KP};

/// One channel. The order of fields and halves is the assembly's: even channels keep what is newer
/// in the low half, odd channels in the high half.
#[repr(C)]
#[derive(Clone, Copy)]
struct Channel {
    /// Drive with [`GAIN_BITS`] behind the point.
    drive: i32,
    /// e\[1\], e\[2\].
    errors: u32,
    /// b0, b1 in the same halves as e\[0\], e\[1\].
    b01: u32,
    /// b2 in both halves.
    b2: u32,
}

pub struct Floor([Channel; CHANNELS]);

const B0: i16 = KP + KI + KD;
const B1: i16 = -(KP + 2 * KD);
const B2: i16 = KD;

/// Two halves of a register.
fn pack(low: i16, high: i16) -> u32 {
    u32::from(low as u16) | u32::from(high as u16) << 16 // the same bits
}

impl Floor {
    pub fn new() -> Self {
        let even = Channel { drive: 0, errors: 0, b01: pack(B0, B1), b2: pack(B2, B2) };
        let odd = Channel { b01: pack(B1, B0), ..even };
        Self([even, odd, even, odd, even, odd])
    }
}

impl Bank for Floor {
    type Count = i16;
    type Drive = i16;

    fn count(count: i16) -> i16 {
        count
    }

    fn duty(drive: i16) -> i32 {
        drive.into()
    }

    fn tick(
        &mut self,
        set_points: &[i16; CHANNELS],
        measured: &[i16; CHANNELS],
        drives: &mut [i16; CHANNELS],
    ) {
        #[cfg(target_arch = "arm")]
        assembly(&mut self.0, set_points, measured, drives);
        #[cfg(not(target_arch = "arm"))]
        portable(&mut self.0, set_points, measured, drives);
    }
}

#[cfg(target_arch = "arm")]
#[inline(always)]
fn assembly(
    channels: &mut [Channel; CHANNELS],
    set_points: &[i16; CHANNELS],
    measured: &[i16; CHANNELS],
    drives: &mut [i16; CHANNELS],
) {
    // SAFETY: three pairs of channels of 16 bytes, of counts and of drives of 2 bytes, are what the
    // pointers point at; LDR and STR may be unaligned on a Cortex-M4.
    unsafe {
        core::arch::asm!(
            ".rept 3",
            "ldr   {e}, [{set_points}], #4",
            "ldr   {t}, [{measured}], #4",
            "qsub16 {e}, {e}, {t}",
            // The even channel: e = (e0, e1).
            "ldrd  {even}, {t}, [{channels}]",
            "ldrd  {b01}, {b2}, [{channels}, #8]",
            "pkhbt {x}, {e}, {t}, lsl #16",
            "smlad {even}, {b01}, {x}, {even}",
            "smlatt {even}, {b2}, {t}, {even}",
            "ssat  {even}, #{bits}, {even}",
            "strd  {even}, {x}, [{channels}], #16",
            // The odd one: e = (e1, e0).
            "ldrd  {odd}, {t}, [{channels}]",
            "ldrd  {b01}, {b2}, [{channels}, #8]",
            "pkhtb {x}, {e}, {t}, asr #16",
            "smlad {odd}, {b01}, {x}, {odd}",
            "smlabb {odd}, {b2}, {t}, {odd}",
            "ssat  {odd}, #{bits}, {odd}",
            "strd  {odd}, {x}, [{channels}], #16",
            // Both drives.
            "asr   {even}, {even}, #{point}",
            "pkhbt {even}, {even}, {odd}, lsl #(16 - {point})",
            "str   {even}, [{drives}], #4",
            ".endr",
            set_points = inout(reg) set_points.as_ptr() => _,
            measured = inout(reg) measured.as_ptr() => _,
            channels = inout(reg) channels.as_mut_ptr() => _,
            drives = inout(reg) drives.as_mut_ptr() => _,
            e = out(reg) _, t = out(reg) _, x = out(reg) _,
            even = out(reg) _, odd = out(reg) _, b01 = out(reg) _, b2 = out(reg) _,
            bits = const SATURATE_BITS,
            point = const GAIN_BITS,
            options(nostack),
        );
    }
}

/// SSAT's width for [`FULL`]: it limits to -FULL and FULL less one unit of the accumulator.
const SATURATE_BITS: u32 = FULL.ilog2() + GAIN_BITS + 1;

#[cfg_attr(target_arch = "arm", allow(dead_code))] // what the image is compared with
fn portable(
    channels: &mut [Channel; CHANNELS],
    set_points: &[i16; CHANNELS],
    measured: &[i16; CHANNELS],
    drives: &mut [i16; CHANNELS],
) {
    let low = |word: u32| word as u16 as i16; // a half
    let high = |word: u32| (word >> 16) as u16 as i16;
    const LIMIT: i32 = 1 << (SATURATE_BITS - 1);
    for (i, channel) in channels.iter_mut().enumerate() {
        let error = set_points[i].saturating_sub(measured[i]);
        let odd = i % 2 == 1;
        let (before, oldest) = match odd {
            false => (low(channel.errors), high(channel.errors)),
            true => (high(channel.errors), low(channel.errors)),
        };
        channel.errors = if odd { pack(before, error) } else { pack(error, before) };
        let product = |b: i16, e: i16| i32::from(b) * i32::from(e);
        let sum = channel.drive
            + product(low(channel.b01), low(channel.errors))
            + product(high(channel.b01), high(channel.errors))
            + product(low(channel.b2), oldest);
        channel.drive = sum.clamp(-LIMIT, LIMIT - 1);
        drives[i] = (channel.drive >> GAIN_BITS) as i16; // within FULL
    }
}
