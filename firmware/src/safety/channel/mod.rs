//! The monitor of one DC channel.
//!
//! - `current`: over-current, overload, and a current input that nothing drives;
//! - `motion`: stall, lost sensor;
//! - `tracking`: a shaft that goes the wrong way, a loop that hunts.
//!
//! Vocabulary: a channel is *driven* at half of full drive or more. Its shaft *stands still* as
//! long as it stays near (8 counts) to where it was found. A still shaft that draws the current of
//! one that is held at this duty is *held*; one that draws less may be running away behind a sensor
//! that is not there, and that is sooner over. *Logical* drive is positive when it should make the
//! sensor's counts rise. Times are control periods: one that was missed has shown nothing, and does
//! not count.
//!
//! Promises: what a host asks is never a fault of the channel; limits only limit, and say so
//! ([`ChannelMonitor::limiting`]). A motor's heat outlives everything but a restart.
//!
//! What it costs: some comparisons a period while the bridge is on, fewer while it is off, and two
//! divisions every 64 ms.

mod current;
mod motion;
mod tracking;

use crate::channel::Sensor;
use crate::safety::faults::Fault;

use crate::control::axis::{Deviation, Reading, SetPoint};
use crate::control::pid::Limits;
use crate::settings::ChannelFaultSettings;
use crate::units::{Counts, Drive, Duty};
use current::{CurrentInput, OverCurrent, Overload};
use motion::{Jump, Stillness};
use tracking::{Hunting, WrongWay};

const FULL: u16 = Duty::FULL.unsigned_abs();

/// What a period of a channel looks like, whose bridge is on.
#[derive(Clone, Copy, Debug)]
pub struct Observed {
    /// Motor current, A/D counts.
    pub current: u16,
    /// Whether this channel has a current sensor, as the setting says.
    pub has_current_sensor: bool,
    /// What the bridge does.
    pub duty: Duty,
    /// The same as logical drive.
    pub drive: Drive,
    /// The sensor in use, and what it says.
    pub sensor: Sensor,
    /// Position and velocity.
    pub reading: Reading,
    /// Counts per second at full drive.
    pub full_speed: u32,
    /// What is asked for now.
    pub set_point: SetPoint,
    /// The set-point of a closed loop less what is measured.
    pub deviation: Option<Deviation>,
    /// Whether a soft limit holds the shaft: it is not asked to move.
    pub is_at_soft_limit: bool,
    /// Whether the sensor was chosen for this channel; else nobody has said that there is one.
    pub sensor_is_chosen: bool,
}

impl Observed {
    fn is_closed(&self) -> bool {
        self.deviation.is_some()
    }

    /// Whether anybody has said that something measures this shaft.
    fn is_measured(&self) -> bool {
        self.is_closed() || self.sensor_is_chosen
    }
}

/// A fault, and the values of the record of the fault.
pub type Tripped = (Fault, [i16; 3]);

/// Why a channel may not use all of its drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Limiting {
    /// Its current is too high now.
    OverCurrent,
    /// Its current was too high for too long: what is left keeps the motor at its continuous current.
    Overload,
}

/// The monitor's memory. The default is that of a channel that is off, with a cold motor.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelMonitor {
    input: CurrentInput,
    over_current: OverCurrent,
    overload: Overload,
    stillness: Stillness,
    jump: Jump,
    wrong_way: WrongWay,
    hunting: Hunting,
    /// The channel was on in the last period.
    has_watched: bool,
}

impl ChannelMonitor {
    /// Narrows the drive that is allowed by what over-current and overload take.
    pub fn limit(&self, limits: &mut Limits) {
        if self.limiting().is_some() {
            let taken = self.over_current.reduction().saturating_add(self.overload.reduction());
            let most = Drive::from_bits(FULL.saturating_sub(taken).into());
            limits.high = limits.high.min(most);
            limits.low = limits.low.max(most.saturating_neg());
        }
    }

    /// Why the drive is limited, if it is.
    pub fn limiting(&self) -> Option<Limiting> {
        if self.over_current.reduction() > 0 {
            Some(Limiting::OverCurrent)
        } else {
            (self.overload.reduction() > 0).then_some(Limiting::Overload)
        }
    }

    /// Whether the current input says something although no current can flow. Until it is quiet again
    /// it counts as none.
    pub fn current_floats(&self) -> bool {
        self.input.floats()
    }

    /// Another sensor measures this shaft from now on. The motor is as hot as it was.
    pub fn forget_motion(&mut self) {
        let Self { input, overload, .. } = *self;
        *self = Self { input, overload, ..Self::default() };
    }

    /// One period of a channel that is off: what has tripped, if anything.
    pub fn step_off(
        &mut self,
        current: u16,
        has_current_sensor: bool,
        settings: &ChannelFaultSettings,
    ) -> Option<Tripped> {
        if core::mem::take(&mut self.has_watched) {
            self.forget_motion();
        }
        self.overload.cool(settings);
        let begins_to_float = self.input.step(has_current_sensor, true, current);
        begins_to_float.then_some((Fault::CurrentSensor, [ad_word(current), 0, 0]))
    }

    /// One period of a channel that is on: what has tripped, if anything.
    #[inline(never)] // a channel that is off needs no room for this
    pub fn step(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> Option<Tripped> {
        self.has_watched = true;
        let position = word(now.reading.position);
        let values = |first| [first, now.duty.raw(), position];
        let current = ad_word(now.current);

        let has_moved = now.is_measured() && self.stillness.has_moved(now, settings);
        // A shaft that turns makes a current of its own; and a current that has the drive limited to
        // nothing is what it is limited for.
        let is_at_rest = now.is_measured() && !has_moved;
        let is_quiet = now.duty == Duty::NEUTRAL && is_at_rest && self.limiting().is_none();
        if self.input.step(now.has_current_sensor, is_quiet, now.current) {
            return Some((Fault::CurrentSensor, [current, 0, 0]));
        }
        let is_sensed = now.has_current_sensor && !self.input.floats();

        if self.over_current.step(now.current, settings) {
            return Some((Fault::OverCurrent, values(current)));
        }
        let heating = if is_sensed { now.current } else { 0 };
        if self.overload.step(heating, now.duty, settings) {
            return Some((Fault::Overload, values(current)));
        }
        if now.is_closed() && self.jump.step(now, settings) {
            let lost = [position, now.duty.raw(), word(self.jump.plausible())];
            return Some((Fault::SensorLost, lost));
        }
        self.stillness.step(now, is_sensed, settings);
        if self.stillness.is_stalled(settings) {
            return Some((Fault::Stall, values(current)));
        }
        if !now.is_closed() {
            if !now.is_at_soft_limit {
                self.wrong_way = WrongWay::default();
                return None;
            }
            let is_astray = self.wrong_way.step(now, settings);
            return is_astray.then_some((Fault::TrackingError, values(0)));
        }
        if self.stillness.is_lost(now, settings) {
            return Some((Fault::SensorLost, [position, now.duty.raw(), position]));
        }
        let is_astray = self.wrong_way.step(now, settings) | self.hunting.step(now, settings);
        let error = match now.deviation {
            Some(Deviation::Position(way)) => word(way),
            Some(Deviation::Velocity(difference)) => difference.saturating_to_num(),
            None => 0,
        };
        is_astray.then_some((Fault::TrackingError, values(error)))
    }
}

/// Whether a counter has reached its setting; 0 is never.
fn reached(count: u16, setting: u16) -> bool {
    setting > 0 && count >= setting
}

/// Whole counts for a record.
fn word(counts: Counts) -> i16 {
    counts.saturating_to_num()
}

/// A reading of the converter for a record.
fn ad_word(reading: u16) -> i16 {
    i16::try_from(reading).unwrap_or(i16::MAX)
}
