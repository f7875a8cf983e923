//! The PID controller: from set-point and measurement to a limited drive, six channels in a row.
//!
//! Both have the same gains, a derivative, an output limited to full drive and an integral that does
//! not wind up, and use the numbers that suit them best.

use core::hint::black_box;

use dsp_fixedpoint::Q32;
use dsp_process::SplitProcess;
use firmware::control::pid::{Error, Gains, Limits, Pid};
use firmware::settings::HostGains;
use firmware::units::{Counts, Drive};
use idsp::iir::{Biquad, BiquadClamp, DirectForm1};

use crate::case;

/// Channels in a call.
const CHANNELS: usize = 6;
/// Full drive.
const FULL: i32 = 16384;
/// Drive a count of error.
const KP: f32 = 24.0;
/// Drive a count of error and period.
const KI: f32 = 0.5;
/// Drive a count per period.
const KD: f32 = 16.0;

/// The controllers of all channels.
struct Bank<C, D, F> {
    /// A position in their numbers.
    count: fn(i16) -> C,
    /// One period of a channel: from set-point and measurement to a drive.
    step: F,
    /// Their drive in 1/16384 of full drive.
    duty: fn(D) -> i32,
}

/// All cases; the unit is a channel.
pub fn cases() {
    measure("pid/ours", ours);
    measure("pid/idsp-i32", idsp_i32);
}

fn measure<C: Copy, D, F: FnMut(usize, C, C) -> D>(name: &str, bank: fn() -> Bank<C, D, F>) {
    let Bank { count, mut step, duty } = bank();
    // A plant that integrates, 400 periods of full drive away: an integral that had wound up would
    // carry it far beyond.
    let (mut position, mut farthest) = (0.0_f32, 0.0);
    for _ in 0..3000 {
        let duty = duty(step(0, count(8000), count(position as i16)));
        assert!((-FULL..=FULL).contains(&duty), "{name}: {duty}");
        position += duty as f32 / FULL as f32 * 20.0;
        farthest = position.max(farthest);
    }
    assert!((7990.0..8011.0).contains(&position) && farthest < 8600.0, "{name}: {position}");

    let inputs = [(300, 290), (-300, -280), (500, 505), (0, 4), (40, 0), (-2, 1)];
    let inputs = inputs.map(|(set_point, measured)| (count(set_point), count(measured)));
    let mut step = bank().step;
    case(name, CHANNELS, || {
        let (step, inputs) = (black_box(&mut step), black_box(&inputs));
        // Written out: what a loop takes is none of theirs.
        let mut one = |i: usize| _ = black_box(step(i, inputs[i].0, inputs[i].1));
        (one(0), one(1), one(2), one(3), one(4), one(5));
    });
}

/// `firmware::control::pid`, with what its caller does for it: error and rate. Beyond the peers it
/// has a feed-forward, limits that may change every period, and 54 bits behind the point of its
/// integral.
fn ours() -> Bank<Counts, Drive, impl FnMut(usize, Counts, Counts) -> Drive> {
    // In the original's numbers: Kp = 1 is 2^-15 of full drive a count, Kd = 1 is 2^-16 a count/s
    // (here a count per period), Ki = 0.01 is 2^-10/100 a count and second.
    let [kp, ki, kd] = [KP, KI, KD].map(|gain| gain / FULL as f32);
    let gains = HostGains {
        kp: (kp * 32768.0) as u16,
        kd: (kd * 65536.0) as u16,
        ki_hundredths: (ki * 1024.0 * 1000.0 * 100.0) as u16,
    };
    let gains = Gains::position(gains);
    let mut channels = [(Pid::new(), gains, Counts::ZERO, Drive::ZERO); CHANNELS];
    let limits = Limits::FULL;
    let step = move |i: usize, set_point: Counts, measured: Counts| {
        let (pid, gains, last, feed_forward) = &mut channels[i];
        let error = Error::of_position(set_point.saturating_sub(measured));
        let rate = measured.saturating_sub(*last);
        *last = measured;
        pid.step(gains, error, rate, *feed_forward, &limits)
    };
    Bank { count: Counts::from_num, step, duty: |drive| drive.to_bits() }
}

/// idsp's clamped biquad; limiting its output is the anti-windup. The error goes in, so that a jump
/// of the set-point kicks the derivative. Filters and states are apart, as in idsp's applications:
/// the filters are settings.
fn idsp_i32() -> Bank<i32, i32, impl FnMut(usize, i32, i32) -> i32> {
    const BITS: u32 = 12; // behind the point of input and output
    let coefficients = [KP + KI + KD, -(KP + 2.0 * KD), KD, 1.0, 0.0]; // a PID in the velocity form
    let mut filter: BiquadClamp<Q32<24>, i32> = Biquad::from(coefficients).into();
    (filter.min, filter.max) = (-FULL << BITS, FULL << BITS);
    let filters: [_; CHANNELS] = core::array::from_fn(|_| filter.clone());
    let mut states: [DirectForm1<i32>; CHANNELS] = Default::default();
    let step = move |i: usize, set_point: i32, measured| {
        filters[i].process(&mut states[i], set_point.wrapping_sub(measured))
    };
    Bank { count: |count| i32::from(count) << BITS, step, duty: |drive| drive >> BITS }
}
