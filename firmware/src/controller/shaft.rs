//! Shafts as their sensors see them: where they are, and how fast they turn.

use crate::channel::{Channel, Sensor};
use crate::control::axis::Reading;
use crate::control::potentiometer;
use crate::control::ring::Scale;
use crate::control::velocity::VelocityEstimator;
use crate::ports::MotionInputs;
use crate::units::Counts;

/// A sensor's position and the estimate of its velocity.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shaft {
    pub(super) reading: Reading,
    estimator: VelocityEstimator,
    known: bool,
}

impl Shaft {
    /// The position of a new period.
    pub(super) fn update(&mut self, position: Counts, scale: Scale) -> Reading {
        let moved = if self.known {
            scale.difference(position, self.reading.position)
        } else {
            Counts::ZERO
        };
        self.known = true;
        self.reading = Reading { position, velocity: self.estimator.update(moved) };
        self.reading
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
