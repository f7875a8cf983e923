//! What a shaft that does not move says: it is held fast, or nobody sees it move. And one that moves
//! as nothing can.

use crate::channel::Sensor;

use super::{Observed, reached};
use crate::control::axis::Deviation;
use crate::control::track::scale;
use crate::settings::ChannelFaultSettings;
use crate::units::{Counts, CountsPerSecond};

const LAST_COUNT: Counts = Counts::const_from_int(4095);

/// An encoder that stands on an edge trembles by less.
const TREMOR: Counts = Counts::const_from_int(2);

/// For how long a shaft has stood still, and how. Motion ends all of it, and so does being off. A
/// current that flickers about that of a held shaft ends neither, and the more frequent counts. A drive that turns round begins the stall anew, and the
/// rest too if the shaft has followed it ever so little: a heavy wheel that a host shakes does not
/// leave its place.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Stillness {
    /// Where the shaft was found.
    found: Option<Counts>,
    /// Held fast, although it is asked to move.
    stalled: u16,
    /// Without the current of one that is held, above the dead band; and driven.
    silent: u16,
    silent_driven: u16,
    /// Which way it was last driven above the dead band, and whether it has stirred since.
    driven_forward: bool,
    has_stirred: bool,
}

impl Stillness {
    /// Whether it has moved away from where it was found, which is here from now on.
    pub(super) fn has_moved(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let position = now.reading.position;
        let found = *self.found.get_or_insert(position);
        let way = scale(now.sensor).difference(position, found).saturating_abs();
        let has_moved = way > Counts::from(settings.still);
        self.has_stirred |= way >= TREMOR;
        if has_moved {
            *self =
                Self { found: Some(position), stalled: 0, silent: 0, silent_driven: 0, ..*self };
        }
        has_moved
    }

    /// `is_sensed` says whether the current can be believed.
    pub(super) fn step(
        &mut self,
        now: &Observed,
        is_sensed: bool,
        settings: &ChannelFaultSettings,
    ) {
        let duty = now.duty.raw().unsigned_abs();
        // The current of a shaft that is held fast is proportional to the drive.
        let of_full_drive = u32::from(now.current) << 14;
        let held = u32::from(settings.stall_current).saturating_mul(duty.into());
        let is_held = is_sensed && duty > 0 && of_full_drive >= held;
        // So little hurts nobody, and friction takes as much.
        let is_much = now.current >= settings.stall_current >> 2;
        let is_asked_to_move = match now.deviation {
            _ if now.is_at_soft_limit => false,
            None => true,
            Some(Deviation::Position(way)) => {
                way.saturating_abs() >= Counts::from(settings.stall_error)
            }
            Some(Deviation::Velocity(difference)) => {
                difference.saturating_abs() >= CountsPerSecond::from(settings.still)
            }
        };
        let is_above_dead_band = duty >= settings.dead_band.max(1);
        let is_forward = now.duty.raw() > 0;
        if is_above_dead_band && is_forward != self.driven_forward {
            self.stalled = 0;
            if self.has_stirred {
                (self.silent, self.silent_driven) = (0, 0);
            }
            (self.driven_forward, self.has_stirred) = (is_forward, false);
        }
        if !now.is_measured() {
            self.stalled = if is_held && is_much {
                self.stalled.saturating_add(1)
            } else {
                self.stalled.saturating_sub(1)
            };
            return;
        }
        if is_held && is_much && is_asked_to_move {
            self.stalled = self.stalled.saturating_add(1);
        } else if !is_asked_to_move {
            self.stalled = self.stalled.saturating_sub(1);
        }
        if !now.is_closed() {
            (self.silent, self.silent_driven) = (0, 0);
        } else if !is_above_dead_band || is_held {
            self.silent = self.silent.saturating_sub(1);
            self.silent_driven = self.silent_driven.saturating_sub(1);
        } else if is_sensed || is_asked_to_move {
            self.silent = self.silent.saturating_add(1);
            if duty >= settings.driven {
                self.silent_driven = self.silent_driven.saturating_add(1);
            }
        }
    }

    /// Whether it has been held fast for too long.
    pub(super) fn is_stalled(&self, settings: &ChannelFaultSettings) -> bool {
        reached(self.stalled, settings.stall_ms)
    }

    /// Whether a loop has seen no motion for too long.
    pub(super) fn is_lost(&self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let bearable = match is_at_rail(now, settings) {
            true => settings.rail_ms,
            false => settings.sensor_ms,
        };
        reached(self.silent_driven, bearable) || reached(self.silent, settings.lost_ms)
    }
}

/// Whether the one potentiometer of a channel is at an end of its track, or its wire is off.
fn is_at_rail(now: &Observed, settings: &ChannelFaultSettings) -> bool {
    let position = now.reading.position;
    let rail = Counts::from(settings.rail);
    now.sensor == Sensor::SinglePotentiometer
        && (position <= rail || position >= LAST_COUNT.saturating_sub(rail))
}

/// A potentiometer that reads what no shaft can have come to within a period.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Jump {
    /// The last position that the one before can have led to, and the periods since.
    plausible: Option<Counts>,
    lasts: u8,
}

impl Jump {
    pub(super) fn plausible(&self) -> Counts {
        self.plausible.unwrap_or_default()
    }

    /// Whether it has stayed there for too long.
    pub(super) fn step(&mut self, now: &Observed, settings: &ChannelFaultSettings) -> bool {
        let position = now.reading.position;
        let before = self.plausible.unwrap_or(position);
        let way = scale(now.sensor).difference(position, before).saturating_abs();
        let is_jump = now.sensor != Sensor::Encoder
            && settings.jump > 0
            && way >= Counts::from(settings.jump);
        self.lasts = if is_jump { self.lasts.saturating_add(1) } else { 0 };
        self.plausible = Some(if is_jump { before } else { position });
        self.lasts >= settings.jump_ms
    }
}
