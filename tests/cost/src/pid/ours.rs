//! `firmware::control::pid`, with what its caller does for it: error and rate. Beyond the peers it
//! takes a feed-forward and limits that may change every tick, and has 40 bits behind the point of
//! its integral.

use firmware::control::pid::{Gains, HostGains, Limits, Pid};
use fixed::types::{I24F8, I32F32};
use protocol::pms5005::Loop;

use super::{Bank, CHANNELS, GAIN_BITS, KD, KI, KP};

#[derive(Clone, Copy)]
struct Channel {
    pid: Pid,
    gains: Gains,
    last: I24F8,
}

pub struct Ours {
    channels: [Channel; CHANNELS],
    feed_forward: [I32F32; CHANNELS],
    limits: Limits,
}

impl Ours {
    pub fn new() -> Self {
        // In the original's numbers: Kp = 1 is 2^-15 of full drive a count, Kd = 1 is 2^-16 a
        // count/s (here: a count per tick), Ki = 0.01 is 2^-10/100 a count and second.
        let gains = HostGains {
            kp: (KP >> (GAIN_BITS - 1)).unsigned_abs(),
            kd: (KD >> (GAIN_BITS - 2)).unsigned_abs(),
            ki_hundredths: (f32::from(KI) / 256.0 / 16384.0 * 1024.0 * 1000.0 * 100.0) as u16,
        };
        let gains = Gains::new(Loop::Position, gains);
        Self {
            channels: [Channel { pid: Pid::new(), gains, last: I24F8::ZERO }; CHANNELS],
            feed_forward: [I32F32::ZERO; CHANNELS],
            limits: Limits::FULL,
        }
    }
}

impl Bank for Ours {
    type Count = I24F8;
    type Drive = I32F32;

    fn count(count: i16) -> I24F8 {
        I24F8::from_num(count)
    }

    fn duty(drive: I32F32) -> i32 {
        drive.saturating_mul_int(super::FULL.into()).to_num()
    }

    fn tick(
        &mut self,
        set_points: &[I24F8; CHANNELS],
        measured: &[I24F8; CHANNELS],
        drives: &mut [I32F32; CHANNELS],
    ) {
        for (i, channel) in self.channels.iter_mut().enumerate() {
            let error = set_points[i].saturating_sub(measured[i]);
            let rate = measured[i].saturating_sub(channel.last);
            channel.last = measured[i];
            let forward = self.feed_forward[i];
            drives[i] = channel.pid.step(&channel.gains, error, rate, forward, &self.limits);
        }
    }
}
