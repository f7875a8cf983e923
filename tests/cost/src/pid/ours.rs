//! `firmware::control::pid`, with what its caller does for it: error and rate. Beyond the peers it
//! takes a feed-forward and limits that may change every tick, and has 54 bits behind the point of
//! its integral.

use firmware::control::pid::{Error, Gains, HostGains, Limits, Pid, Rate};
use firmware::units::{Counts, Drive};
use protocol::pms5005::Loop;

use super::{Bank, CHANNELS, GAIN_BITS, KD, KI, KP, for_each_channel};

#[derive(Clone, Copy)]
struct Channel {
    pid: Pid,
    gains: Gains,
    last: Counts,
}

pub struct Ours {
    channels: [Channel; CHANNELS],
    feed_forward: [Drive; CHANNELS],
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
            channels: [Channel { pid: Pid::new(), gains, last: Counts::ZERO }; CHANNELS],
            feed_forward: [Drive::ZERO; CHANNELS],
            limits: Limits::FULL,
        }
    }
}

impl Bank for Ours {
    type Count = Counts;
    type Drive = Drive;

    fn count(count: i16) -> Counts {
        Counts::from_num(count)
    }

    fn duty(drive: Drive) -> i32 {
        drive.to_bits()
    }

    fn tick(
        &mut self,
        set_points: &[Counts; CHANNELS],
        measured: &[Counts; CHANNELS],
        drives: &mut [Drive; CHANNELS],
    ) {
        let Self { channels, feed_forward, limits } = self;
        for_each_channel(|i| {
            let channel = &mut channels[i];
            let error = Error::of_position(set_points[i].saturating_sub(measured[i]));
            let rate = Rate::of_position(measured[i].saturating_sub(channel.last));
            channel.last = measured[i];
            drives[i] = channel.pid.step(&channel.gains, error, rate, feed_forward[i], limits);
        });
    }
}
