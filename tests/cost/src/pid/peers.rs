//! What others do, at their best settings.

use dsp_fixedpoint::Q32;
use dsp_process::SplitProcess;
use fixed::types::I16F16;
use idsp::iir::{Biquad, BiquadClamp, DirectForm1};

use super::{Bank, CHANNELS, FULL, GAIN_BITS, KD, KI, KP, for_each_channel, part_of_full};

/// The highest drive here: one less than full, so that limiting is one instruction (SSAT).
const HIGHEST: i32 = FULL - 1;

/// The textbook's in 16-bit numbers: integral clamped, output clamped.
#[derive(Clone, Copy)]
pub struct PlainI16([I16Channel; CHANNELS]);

#[derive(Clone, Copy)]
struct I16Channel {
    kp: i16,
    ki: i16,
    kd: i16,
    last: i16,
    integral: i32,
}

impl Default for PlainI16 {
    fn default() -> Self {
        Self([I16Channel { kp: KP, ki: KI, kd: KD, last: 0, integral: 0 }; CHANNELS])
    }
}

impl Bank for PlainI16 {
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
        const LIMIT: i32 = FULL << GAIN_BITS;
        for_each_channel(|i| {
            let channel = &mut self.0[i];
            let error = i32::from(set_points[i].wrapping_sub(measured[i]));
            let rate = i32::from(measured[i].wrapping_sub(channel.last));
            channel.last = measured[i];
            let integral = channel.integral.wrapping_add(i32::from(channel.ki).wrapping_mul(error));
            channel.integral = integral.clamp(-LIMIT, LIMIT - 1);
            let drive = i32::from(channel.kp)
                .wrapping_mul(error)
                .wrapping_add(channel.integral)
                .wrapping_sub(i32::from(channel.kd).wrapping_mul(rate));
            drives[i] = (drive >> GAIN_BITS).clamp(-FULL, HIGHEST) as i16; // fits
        });
    }
}

/// The same with a 64-bit accumulator, saturation and conditional integration: the integral takes
/// no part that would drive deeper into the limit.
#[derive(Clone, Copy)]
pub struct PlainI64([I64Channel; CHANNELS]);

#[derive(Clone, Copy)]
struct I64Channel {
    kp: i32,
    ki: i32,
    kd: i32,
    last: i32,
    integral: i32,
}

/// Bits behind the point of its gains and integral.
const I64_BITS: u32 = 16;

impl Default for PlainI64 {
    fn default() -> Self {
        let gain = |gain: i16| i32::from(gain) << (I64_BITS - GAIN_BITS);
        let channel = I64Channel { kp: gain(KP), ki: gain(KI), kd: gain(KD), last: 0, integral: 0 };
        Self([channel; CHANNELS])
    }
}

impl Bank for PlainI64 {
    type Count = i32;
    type Drive = i32;

    fn count(count: i16) -> i32 {
        count.into()
    }

    fn duty(drive: i32) -> i32 {
        drive
    }

    fn tick(
        &mut self,
        set_points: &[i32; CHANNELS],
        measured: &[i32; CHANNELS],
        drives: &mut [i32; CHANNELS],
    ) {
        for_each_channel(|i| {
            let channel = &mut self.0[i];
            let error = set_points[i].wrapping_sub(measured[i]);
            let rate = measured[i].wrapping_sub(channel.last);
            channel.last = measured[i];
            let sum = (i64::from(channel.kp) * i64::from(error))
                .wrapping_sub(i64::from(channel.kd) * i64::from(rate))
                .wrapping_add(channel.integral.into());
            let wanted = (sum >> I64_BITS) as i32; // the gains leave room for 32 bits
            let drive = wanted.clamp(-FULL, HIGHEST);
            if drive == wanted {
                channel.integral = channel.integral.saturating_add(channel.ki.wrapping_mul(error));
            }
            drives[i] = drive;
        });
    }
}

/// idsp's clamped biquad as a PID, in the velocity form. Limiting its output is the anti-windup.
/// The error goes in, so that a jump of the set-point kicks the derivative.
pub struct IdspI32 {
    filters: [BiquadClamp<Q32<24>, i32>; CHANNELS],
    states: [DirectForm1<i32>; CHANNELS],
}

/// Bits behind the point of idsp's input and output.
const IDSP_BITS: u32 = 12;

/// A PID as the five coefficients of a biquad.
fn biquad(kp: f32, ki: f32, kd: f32) -> [f32; 5] {
    [kp + ki + kd, -(kp + 2.0 * kd), kd, 1.0, 0.0]
}

impl IdspI32 {
    pub fn new() -> Self {
        let [kp, ki, kd] = [KP, KI, KD].map(|gain| part_of_full(gain) * FULL as f32);
        let filter = || {
            let mut filter: BiquadClamp<Q32<24>, i32> =
                BiquadClamp::from(Biquad::from(biquad(kp, ki, kd)));
            (filter.min, filter.max) = (-FULL << IDSP_BITS, FULL << IDSP_BITS);
            filter
        };
        Self {
            filters: core::array::from_fn(|_| filter()),
            states: core::array::from_fn(|_| DirectForm1::default()),
        }
    }
}

impl Bank for IdspI32 {
    type Count = i32;
    type Drive = i32;

    fn count(count: i16) -> i32 {
        i32::from(count) << IDSP_BITS
    }

    fn duty(drive: i32) -> i32 {
        drive >> IDSP_BITS
    }

    fn tick(
        &mut self,
        set_points: &[i32; CHANNELS],
        measured: &[i32; CHANNELS],
        drives: &mut [i32; CHANNELS],
    ) {
        for_each_channel(|i| {
            drives[i] = self.filters[i]
                .process(&mut self.states[i], set_points[i].wrapping_sub(measured[i]));
        });
    }
}

/// As [`IdspI32`], in floating point.
pub struct IdspF32 {
    filters: [BiquadClamp<f32>; CHANNELS],
    states: [DirectForm1<f32>; CHANNELS],
}

impl IdspF32 {
    pub fn new() -> Self {
        let [kp, ki, kd] = [KP, KI, KD].map(part_of_full);
        let filter = || {
            let mut filter: BiquadClamp<f32> = BiquadClamp::from(Biquad::from(biquad(kp, ki, kd)));
            (filter.min, filter.max) = (-1.0, 1.0);
            filter
        };
        Self {
            filters: core::array::from_fn(|_| filter()),
            states: core::array::from_fn(|_| DirectForm1::default()),
        }
    }
}

impl Bank for IdspF32 {
    type Count = f32;
    type Drive = f32;

    fn count(count: i16) -> f32 {
        count.into()
    }

    fn duty(drive: f32) -> i32 {
        (drive * FULL as f32) as i32
    }

    fn tick(
        &mut self,
        set_points: &[f32; CHANNELS],
        measured: &[f32; CHANNELS],
        drives: &mut [f32; CHANNELS],
    ) {
        for_each_channel(|i| {
            drives[i] = self.filters[i].process(&mut self.states[i], set_points[i] - measured[i]);
        });
    }
}

/// The crate `fixed` as one comes to it first: I16F16 and the ordinary operators' wrapping kin,
/// integral and output clamped.
#[derive(Clone, Copy)]
pub struct FixedWrapping([FixedChannel; CHANNELS]);

/// As [`FixedWrapping`], every operation saturating.
#[derive(Clone, Copy)]
pub struct FixedSaturating([FixedChannel; CHANNELS]);

#[derive(Clone, Copy)]
struct FixedChannel {
    kp: I16F16,
    ki: I16F16,
    kd: I16F16,
    last: I16F16,
    integral: I16F16,
}

impl FixedChannel {
    fn new() -> Self {
        let [kp, ki, kd] = [KP, KI, KD].map(|gain| I16F16::from_num(part_of_full(gain)));
        Self { kp, ki, kd, last: I16F16::ZERO, integral: I16F16::ZERO }
    }
}

impl Default for FixedWrapping {
    fn default() -> Self {
        Self([FixedChannel::new(); CHANNELS])
    }
}

impl Default for FixedSaturating {
    fn default() -> Self {
        Self([FixedChannel::new(); CHANNELS])
    }
}

fn fixed_duty(drive: I16F16) -> i32 {
    drive.to_bits() >> 2
}

impl Bank for FixedWrapping {
    type Count = I16F16;
    type Drive = I16F16;

    fn count(count: i16) -> I16F16 {
        count.into()
    }

    fn duty(drive: I16F16) -> i32 {
        fixed_duty(drive)
    }

    fn tick(
        &mut self,
        set_points: &[I16F16; CHANNELS],
        measured: &[I16F16; CHANNELS],
        drives: &mut [I16F16; CHANNELS],
    ) {
        let limit = |value: I16F16| value.clamp(I16F16::NEG_ONE, I16F16::ONE);
        for_each_channel(|i| {
            let channel = &mut self.0[i];
            let error = set_points[i].wrapping_sub(measured[i]);
            let rate = measured[i].wrapping_sub(channel.last);
            channel.last = measured[i];
            channel.integral = limit(channel.integral.wrapping_add(channel.ki.wrapping_mul(error)));
            drives[i] = limit(
                channel
                    .kp
                    .wrapping_mul(error)
                    .wrapping_add(channel.integral)
                    .wrapping_sub(channel.kd.wrapping_mul(rate)),
            );
        });
    }
}

impl Bank for FixedSaturating {
    type Count = I16F16;
    type Drive = I16F16;

    fn count(count: i16) -> I16F16 {
        count.into()
    }

    fn duty(drive: I16F16) -> i32 {
        fixed_duty(drive)
    }

    fn tick(
        &mut self,
        set_points: &[I16F16; CHANNELS],
        measured: &[I16F16; CHANNELS],
        drives: &mut [I16F16; CHANNELS],
    ) {
        let limit = |value: I16F16| value.clamp(I16F16::NEG_ONE, I16F16::ONE);
        for_each_channel(|i| {
            let channel = &mut self.0[i];
            let error = set_points[i].saturating_sub(measured[i]);
            let rate = measured[i].saturating_sub(channel.last);
            channel.last = measured[i];
            channel.integral =
                limit(channel.integral.saturating_add(channel.ki.saturating_mul(error)));
            drives[i] = limit(
                channel
                    .kp
                    .saturating_mul(error)
                    .saturating_add(channel.integral)
                    .saturating_sub(channel.kd.saturating_mul(rate)),
            );
        });
    }
}

/// The crate `pid`, in `f32`: every term limited, the output limited.
pub struct PidCrate([pid::Pid<f32>; CHANNELS]);

impl PidCrate {
    pub fn new() -> Self {
        let [kp, ki, kd] = [KP, KI, KD].map(part_of_full);
        let mut channel = pid::Pid::new(0.0, 1.0);
        // The proportional term far from its own limit: only the sum is to be limited.
        channel.p(kp, f32::MAX).i(ki, 1.0).d(kd, f32::MAX);
        Self([channel; CHANNELS])
    }
}

impl Bank for PidCrate {
    type Count = f32;
    type Drive = f32;

    fn count(count: i16) -> f32 {
        count.into()
    }

    fn duty(drive: f32) -> i32 {
        (drive * FULL as f32) as i32
    }

    fn tick(
        &mut self,
        set_points: &[f32; CHANNELS],
        measured: &[f32; CHANNELS],
        drives: &mut [f32; CHANNELS],
    ) {
        for_each_channel(|i| {
            let channel = &mut self.0[i];
            channel.setpoint = set_points[i];
            drives[i] = channel.next_control_output(measured[i]).output;
        });
    }
}
