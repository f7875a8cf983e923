//! Three 16-way multiplexers (74HC4067) before ADC1, with what makes them less than ideal:
//! - a common pin approaches a new input's voltage with a time constant, from what it had;
//! - an open input leaves the charge that was there;
//! - an edge of a bridge rings, and a sample that falls near it reads that too.

use std::sync::{Arc, Mutex};

use rigless::device::Level;

use crate::part::converter::Front;
use crate::part::timers::Shared;

/// 2.7 kOhm of a potentiometer and the multiplexer, and 1 nF: the most that the board's README allows.
const SETTLING_NS: f64 = 2_700.0;
/// How far an edge throws a sample that falls on it, and how fast that dies away.
const RINGING_MV: f64 = 400.0;
const RINGING_NS: f64 = 400.0;

/// The inputs in millivolts, by multiplexer and address; `None` is open.
pub type Inputs = [[Option<f64>; 16]; 3];

/// The inputs, shared with whoever puts voltages on them.
#[derive(Clone, Debug, Default)]
pub struct Voltages(Arc<Mutex<Inputs>>);

impl Voltages {
    /// Puts millivolts on an input of multiplexer 0 to 2, or opens it.
    pub fn put(&self, multiplexer: usize, address: usize, millivolts: Option<f64>) {
        self.0.lock().unwrap()[multiplexer][address] = millivolts;
    }

    fn get(&self, multiplexer: usize, address: usize) -> Option<f64> {
        self.0.lock().unwrap()[multiplexer][address]
    }
}

/// The multiplexers.
#[derive(Debug)]
pub struct Multiplexers {
    /// What is on their inputs.
    pub voltages: Voltages,
    /// Pins S0 to S3: port, pin.
    select: [(usize, u8); 4],
    /// ADC1's inputs behind multiplexers A, B and C.
    channels: [u8; 3],
    bridges: [Shared; 2],
    address: usize,
    common_mv: [f64; 3],
    settled_ns: u64,
}

impl Multiplexers {
    /// With these lines, and the timers whose edges disturb them.
    pub fn new(select: [(usize, u8); 4], channels: [u8; 3], bridges: [Shared; 2]) -> Self {
        Self {
            voltages: Voltages::default(),
            select,
            channels,
            bridges,
            address: 0,
            common_mv: [0.0; 3],
            settled_ns: 0,
        }
    }

    fn settle(&mut self, now_ns: u64) {
        let passed = now_ns.saturating_sub(self.settled_ns) as f64;
        let left = (-passed / SETTLING_NS).exp();
        for (multiplexer, common) in self.common_mv.iter_mut().enumerate() {
            if let Some(target) = self.voltages.get(multiplexer, self.address) {
                *common = target + (*common - target) * left;
            }
        }
        self.settled_ns = self.settled_ns.max(now_ns);
    }

    /// What the bridges' edges add at this moment.
    fn ringing(&self, now_ns: u64) -> f64 {
        let since = |bridge: &Shared| bridge.lock().unwrap().since_edge(now_ns as f64);
        let of = |ns: f64| RINGING_MV * (-ns / RINGING_NS).exp();
        self.bridges.iter().filter_map(since).map(of).sum()
    }
}

impl Front for Multiplexers {
    fn pin(&mut self, port: usize, pin: u8, level: Level, now_ns: u64) {
        if let Some(bit) = self.select.iter().position(|&line| line == (port, pin)) {
            self.settle(now_ns);
            let mask = 1 << bit;
            self.address =
                if level == Level::High { self.address | mask } else { self.address & !mask };
        }
    }

    fn sample(&mut self, input: u8, now_ns: u64) -> u32 {
        let Some(multiplexer) = self.channels.iter().position(|&channel| channel == input) else {
            return 0;
        };
        self.settle(now_ns);
        (self.common_mv[multiplexer] + self.ringing(now_ns)).clamp(0.0, 3300.0).round() as u32
    }
}
