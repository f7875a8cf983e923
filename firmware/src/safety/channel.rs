//! The monitor of one DC channel: current, motion, sensor, set-point.
//!
//! Vocabulary: a channel is *driven* at half of full drive or more. Its shaft *stands still* as
//! long as it stays near (8 counts) to where it was found. A still shaft that draws the
//! current of one that is held fast is *stalled*; one that does not may be running away behind a
//! sensor that is not there, and that is sooner over. Times are control periods.
//!
//! What it costs: a few comparisons a period while the bridge is on, nothing while it is off.

use protocol::pms5005::extension::Fault;
use protocol::pms5005::{Method, Sensor};

use crate::control::axis::Reading;
use crate::control::pid::Limits;
use crate::control::track::scale;
use crate::settings::ChannelFaultSettings;
use crate::units::{Counts, CountsPerSecond, Drive, Duty};

const LAST_COUNT: Counts = Counts::const_from_int(4095);
/// What over-current takes from the drive a period, all of it within 128, and what is given back
/// when it is over, within a second.
const LIMIT_STEP: u16 = 128;
const RELEASE_STEP: u16 = 16;
const FULL: u16 = Duty::FULL.unsigned_abs();

/// What a period of a channel looks like, whose bridge is on.
#[derive(Clone, Copy, Debug)]
pub struct Observed {
    /// Motor current, A/D counts.
    pub current: u16,
    /// What the bridge does.
    pub duty: Duty,
    /// The sensor in use, and what it says.
    pub sensor: Sensor,
    /// Position and velocity.
    pub reading: Reading,
    /// What the loop is for; PWM is none.
    pub method: Method,
    /// The set-point less what is measured, in the method's unit.
    pub error: Counts,
    /// Whether the sensor was chosen for this channel; else nobody has said that there is one.
    pub sensor_is_chosen: bool,
}

/// A fault, and the values of [`Fault::values`].
pub type Tripped = (Fault, [i16; 3]);

/// The monitor's memory. The default is that of a channel that is off.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelMonitor {
    /// What over-current takes from the drive, in 1/16384 of full drive, and for how long already.
    reduction: u16,
    limited: u16,
    /// Where the shaft was found, and how long it has stood still there, held fast or not.
    found: Option<Counts>,
    stalled: u16,
    silent: u16,
    /// Up by two for a period that leads away from the set-point or in which the loop hunts, down
    /// by one for any other.
    astray: u16,
    /// Which way the loop last pushed, and for how long it still hunts.
    pushed_forward: Option<bool>,
    hunts: u8,
    /// The last position that the one before can have led to, and the periods since.
    plausible: Counts,
    jumped: u8,
}

impl ChannelMonitor {
    /// Narrows the drive that is allowed by what over-current takes.
    pub fn limit(&self, limits: &mut Limits) {
        if self.reduction > 0 {
            let most = Drive::from_bits(FULL.saturating_sub(self.reduction).into());
            limits.high = limits.high.min(most);
            limits.low = limits.low.max(most.saturating_neg());
        }
    }

    /// One period of a channel that is on: what has tripped, if anything.
    pub fn step(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> Option<Tripped> {
        let values = |first| [first, now.duty.raw(), word(now.reading.position)];
        let current = i16::try_from(now.current).unwrap_or(i16::MAX);
        if self.is_over_current(now, settings) {
            return Some((Fault::OverCurrent, values(current)));
        }
        let is_closed = now.method != Method::Pwm;
        if !is_closed && !now.sensor_is_chosen {
            // Nobody has said that anything measures this shaft.
            return None;
        }
        if is_closed && self.has_jumped(now, settings) {
            let lost = [word(now.reading.position), now.duty.raw(), word(self.plausible)];
            return Some((Fault::SensorLost, lost));
        }
        let is_driven = now.duty.raw().unsigned_abs() >= settings.driven;
        self.stand_still(now, is_driven, settings);
        if reached(self.stalled, settings.stall_ms) {
            return Some((Fault::Stall, values(current)));
        }
        let bearable = match is_at_rail(now, settings) {
            true => settings.rail_ms,
            false => settings.sensor_ms,
        };
        if is_closed && reached(self.silent, bearable) {
            let position = word(now.reading.position);
            return Some((Fault::SensorLost, [position, now.duty.raw(), position]));
        }
        if is_closed && self.is_astray(now, settings) {
            return Some((Fault::TrackingError, values(word(now.error))));
        }
        None
    }

    fn is_over_current(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        if settings.over_current > 0 && now.current >= settings.over_current {
            self.reduction = self.reduction.saturating_add(LIMIT_STEP).min(FULL);
        } else {
            self.reduction = self.reduction.saturating_sub(RELEASE_STEP);
        }
        self.limited = if self.reduction > 0 { self.limited.saturating_add(1) } else { 0 };
        reached(self.limited, settings.over_current_ms)
    }

    fn has_jumped(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let position = now.reading.position;
        let known = self.found.is_some();
        let way = scale(now.sensor).difference(position, self.plausible).saturating_abs();
        let jump = Counts::from(settings.jump);
        if known && now.sensor != Sensor::Encoder && settings.jump > 0 && way >= jump {
            self.jumped = self.jumped.saturating_add(1);
        } else {
            self.jumped = 0;
            self.plausible = position;
        }
        self.jumped >= settings.jump_ms
    }

    fn stand_still(&mut self, now: &Observed, is_driven: bool, settings: &ChannelFaultSettings) {
        let position = now.reading.position;
        let found = *self.found.get_or_insert(position);
        if scale(now.sensor).difference(position, found).saturating_abs()
            > Counts::from(settings.still)
        {
            self.found = Some(position);
            (self.stalled, self.silent) = (0, 0);
        } else if is_driven {
            // The current of a shaft that is held fast is proportional to the drive.
            let of_full_drive = u32::from(now.current) << 14;
            let held = u32::from(settings.stall_current)
                .saturating_mul(now.duty.raw().unsigned_abs().into());
            if of_full_drive >= held {
                self.stalled = self.stalled.saturating_add(1);
                self.silent = 0;
            } else {
                self.silent = self.silent.saturating_add(1);
            }
        } else {
            (self.stalled, self.silent) = (0, 0);
        }
    }

    fn is_astray(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let most = Counts::from(match now.method {
            Method::Position => settings.tracking_position,
            Method::Velocity | Method::Pwm => settings.tracking_velocity,
        });
        let velocity = now.reading.velocity;
        let away = CountsPerSecond::from(settings.away);
        let is_away = (now.error > most && velocity < away.saturating_neg())
            || (now.error < most.saturating_neg() && velocity > away);
        self.hunts = self.hunts.saturating_sub(1);
        let pushes = now.duty.raw().unsigned_abs() >= settings.driven >> 1;
        if pushes {
            let forward = now.duty.raw() > 0;
            if self.pushed_forward == Some(!forward) {
                self.hunts = settings.hunt_ms;
            }
            self.pushed_forward = Some(forward);
        }
        self.astray = if (pushes && is_away) || self.hunts > 0 {
            self.astray.saturating_add(2)
        } else {
            self.astray.saturating_sub(1)
        };
        reached(self.astray, settings.tracking_ms.saturating_mul(2))
    }
}

/// Whether a counter has reached its setting; 0 is never.
fn reached(count: u16, setting: u16) -> bool {
    setting > 0 && count >= setting
}

/// Whether the one potentiometer of a channel is at an end of its track, or its wire is off.
fn is_at_rail(now: &Observed, settings: &ChannelFaultSettings) -> bool {
    let position = now.reading.position;
    let rail = Counts::from(settings.rail);
    now.sensor == Sensor::SinglePotentiometer
        && (position <= rail || position >= LAST_COUNT.saturating_sub(rail))
}

/// Whole counts for a record.
fn word(counts: Counts) -> i16 {
    counts.saturating_to_num()
}
