//! What a motor's current says: too much now, too much for too long, or nothing at all.

use super::{FULL, reached};
use crate::settings::ChannelFaultSettings;
use crate::units::Duty;

/// What over-current takes from the drive a period, all of it within 128, and what is given back
/// when it is over, within a second.
const LIMIT_STEP: u16 = 128;
const RELEASE_STEP: u16 = 16;

/// Over-current: the current is limited at once, and may not be for long.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct OverCurrent {
    /// What is taken from the drive, in 1/16384 of full drive, and for how long already.
    reduction: u16,
    limited: u16,
}

impl OverCurrent {
    pub(super) fn reduction(&self) -> u16 {
        self.reduction
    }

    /// Whether it has been limited for too long.
    pub(super) fn step(&mut self, current: u16, settings: &ChannelFaultSettings) -> bool {
        if settings.over_current > 0 && current >= settings.over_current {
            self.reduction = self.reduction.saturating_add(LIMIT_STEP).min(FULL);
        } else {
            self.reduction = self.reduction.saturating_sub(RELEASE_STEP);
        }
        self.limited = if self.reduction > 0 { self.limited.saturating_add(1) } else { 0 };
        reached(self.limited, settings.over_current_ms)
    }
}

/// Periods that are looked at together: the motor's heat needs no more, and so it costs no 64-bit
/// division a period.
const BLOCK_SHIFT: u32 = 6;
const BLOCK: u16 = 1 << BLOCK_SHIFT;
/// Fraction bits of the heat. A square of 12 bits leaves 7 of 31.
const HEAT_SHIFT: u32 = 7;
/// The highest reading of the converter.
const LAST_AD: u16 = 4095;
/// The drive that is taken a period, in 1/16384, where the square of the current is twice the one
/// that is allowed; and never more. The loop that this closes has a time constant of half a second,
/// against 0.1 s of `recent`: it does not swing.
const GAIN: u32 = 8;
const FASTEST: u32 = 64;
/// What is given back a period: all of it within four seconds.
const RETURNED: i16 = -4;

/// Overload: a model of the motor's heat (I2t), and a drive that keeps it where it may be for ever.
///
/// The heat is a first-order filter of the square of the current. Above the square of the continuous
/// current the motor is *hot*, until it is a tenth below. While it is hot, drive is taken as long as
/// the current is above the continuous one, and given back when it is 5 % below; in between nothing
/// moves, and nothing is heard.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Overload {
    /// Squares of this block so far, and their number.
    sum: u32,
    periods: u16,
    /// The mean square of late (time constant some 90 ms), and the heat.
    recent: u32,
    heat: u32,
    is_hot: bool,
    /// The current of late is more than 5 % above the continuous one.
    is_over: bool,
    /// What is taken from the drive, in 1/16384 of full drive, and what more a period.
    reduction: u16,
    rate: i16,
    /// For how long the current has not followed a drive that is limited.
    unheeded: u16,
}

impl Overload {
    pub(super) fn reduction(&self) -> u16 {
        self.reduction
    }

    /// Whether the current stays too high although the drive is limited. `current` is 0 where nothing
    /// flows or nobody knows.
    pub(super) fn step(
        &mut self,
        current: u16,
        duty: Duty,
        settings: &ChannelFaultSettings,
    ) -> bool {
        let current = u32::from(current.min(LAST_AD));
        self.sum = self.sum.saturating_add(current.saturating_mul(current));
        self.periods = self.periods.saturating_add(1);
        if self.periods >= BLOCK {
            self.end_block(settings);
        }
        let is_limited =
            self.reduction > 0 && duty.raw().unsigned_abs() >= FULL.saturating_sub(self.reduction);
        if !(self.is_hot && self.is_over) {
            self.unheeded = 0;
        } else if is_limited {
            self.unheeded = self.unheeded.saturating_add(1);
        }
        self.reduction = self.reduction.saturating_add_signed(self.rate).min(FULL);
        reached(self.unheeded, settings.over_current_ms)
    }

    /// A period without current. A motor that is cold stays cold; what it drew of late counts for one
    /// that is hot.
    pub(super) fn cool(&mut self, settings: &ChannelFaultSettings) {
        if self.heat > 0 {
            let _ = self.step(0, Duty::NEUTRAL, settings);
        }
    }

    fn end_block(&mut self, settings: &ChannelFaultSettings) {
        let mean = self.sum >> BLOCK_SHIFT;
        (self.sum, self.periods) = (0, 0);
        self.recent = self.recent.saturating_add(mean) >> 1;
        let blocks = u32::from(settings.thermal_s).saturating_mul(1000) >> BLOCK_SHIFT;
        // Both are below 2^31.
        let apart = (mean << HEAT_SHIFT).cast_signed().saturating_sub(self.heat.cast_signed());
        let blocks = blocks.cast_signed().max(1);
        self.heat = self.heat.saturating_add_signed(apart.checked_div(blocks).unwrap_or(0));

        let continuous = u32::from(settings.continuous_current);
        let allowed = continuous.saturating_mul(continuous);
        let (tenth, heat) = (allowed / 10, self.heat >> HEAT_SHIFT);
        let hot_from = if self.is_hot { allowed.saturating_sub(tenth) } else { allowed };
        self.is_hot = allowed > 0 && heat > hot_from;
        self.is_over = self.recent > allowed.saturating_add(tenth);
        let excess = self.recent.saturating_sub(allowed);
        self.rate = if self.is_hot && excess > 0 {
            let rate = excess.saturating_mul(GAIN).checked_div(allowed).unwrap_or(FASTEST);
            rate.clamp(1, FASTEST) as i16 // 64 at the most
        } else if self.is_hot && self.recent > allowed.saturating_sub(tenth) {
            0
        } else {
            RETURNED
        };
    }
}

/// From here on an input reads a current: a quarter of an ampere.
const NEAR_ZERO: u16 = 182;
/// For so long it must do so, or must not, while none can flow.
const QUIET: u16 = 500;

/// Whether the current input is wired to anything: while no current can flow it must read none.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CurrentInput {
    floats: bool,
    /// For how long it has read the opposite.
    otherwise: u16,
}

impl CurrentInput {
    pub(super) fn floats(&self) -> bool {
        self.floats
    }

    /// Whether it is now known to float, and was not before. `is_quiet` says that no current can flow.
    pub(super) fn step(&mut self, has_sensor: bool, is_quiet: bool, current: u16) -> bool {
        if !has_sensor {
            *self = Self::default();
            return false;
        }
        let reads_some = current >= NEAR_ZERO;
        if !is_quiet || reads_some == self.floats {
            self.otherwise = 0;
            return false;
        }
        self.otherwise = self.otherwise.saturating_add(1);
        let has_turned = self.otherwise >= QUIET;
        if has_turned {
            *self = Self { floats: reads_some, otherwise: 0 };
        }
        has_turned && reads_some
    }
}
