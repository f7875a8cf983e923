//! Shafts as their sensors see them: where they are, and how fast they turn.

use fixed::FixedI64;
use fixed::types::extra::U8;

use crate::channel::{Channel, Sensor};
use crate::control::axis::Reading;
use crate::control::potentiometer;
use crate::control::ring::Scale;
use crate::control::track::scale;
use crate::control::velocity::VelocityEstimator;
use crate::ports::MotionInputs;
use crate::units::Counts;

/// A sensor's position and the estimate of its velocity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shaft {
    pub(super) reading: Reading,
    estimator: VelocityEstimator,
    known: bool,
    /// Turn by turn since boot.
    unwrapped: FixedI64<U8>,
    /// What the counter says less what it counts as: an encoder's may be set.
    offset: u16,
    /// What the counter last said.
    counter: u16,
}

impl Shaft {
    /// The position of a new period.
    pub(super) fn update(&mut self, position: Counts, scale: Scale) -> Reading {
        let moved = if self.known {
            scale.difference(position, self.reading.position)
        } else {
            Counts::ZERO
        };
        self.unwrapped = match self.known {
            true => self.unwrapped.wrapping_add(moved.into()),
            false => position.into(),
        };
        self.known = true;
        self.reading = Reading { position, velocity: self.estimator.update(moved) };
        self.reading
    }

    /// An encoder's counter in a new period. Its 65536 counts are two turns of the protocol's scale: the
    /// low 15 bits are the position on it.
    pub(super) fn update_count(&mut self, counter: u16) {
        self.counter = counter;
        let count = counter.wrapping_sub(self.offset) & 0x7FFF;
        self.update(Counts::from(count), scale(Sensor::Encoder));
    }

    /// Lets the encoder stand at this count.
    pub(super) fn set_count(&mut self, count: i32) {
        let low = count as u16; // the low 16 bits
        self.offset = self.counter.wrapping_sub(low);
        self.unwrapped = count.into();
        self.reading.position = Counts::from(low & 0x7FFF);
    }

    /// Whole counts, turn by turn since boot; wraps.
    pub(super) fn unwrapped(&self) -> i32 {
        self.unwrapped.wrapping_to_num()
    }
}

/// What the potentiometers say of a channel; `None` if it uses its encoder.
pub(super) fn angle(channel: Channel, sensor: Sensor, motion: &MotionInputs) -> Option<Counts> {
    let pots = &motion.potentiometers;
    match sensor {
        Sensor::Encoder => None,
        Sensor::SinglePotentiometer => pots.get(channel.index()).map(|&p| Counts::from(p)),
        Sensor::DualPotentiometer => {
            let (first, second) = *potentiometer::PAIRS.get(channel.index())?;
            Some(potentiometer::angle(*pots.get(first)?, *pots.get(second)?))
        }
    }
}
