//! From boot to run to fault to recovery: the latch.
//!
//! ```text
//!   boot ───────> off ──motion command──> run
//!                  ^                       │ fault: off in the same period
//!                  │ clear                 v
//!                  └──────────────────── latched: no command moves it
//! ```
//!
//! Every DC channel stands in one of these, and so do the servos, all six together. A fault *trips*
//! when its monitor says so, and is *latched* then: it keeps off what it
//! [stops], and its record (when, which values) stands, until a host clears it.
//!
//! | arrow | where it is in [`controller`](crate::controller) |
//! |---|---|
//! | boot | `new`: nothing is enabled, nothing is latched |
//! | motion command | `go`: channels that are latched take no part |
//! | fault | `trip`: what it stops forgets where it was going. And `drive`: whatever a channel is about, what is latched has no output |
//! | clear | `apply`: [`ClearFaults`](crate::command::Command::ClearFaults) clears all. A resume (DID 30), which hosts of old know, clears before it resumes, and only what stops: of one channel that channel's, of all also the board's |
//!
//! An old host knows no resume, but stops (suspend, neutral PWM, velocity 0), and those clear too
//! ([`Faults::stopped`]): of a channel its own faults, a second or more after it has tripped and with
//! its current in bounds; of all channels the board's, once their cause has gone. A channel that has
//! tripped three times in a minute waits for a resume, the extension, or a restart.
//!
//! Clearing moves nothing: a channel is then off, and only a motion command moves it. What the
//! board suffers from still stays latched; the cause of a channel's fault trips again after its time,
//! with a new record.
//! Whether the host is there is [`link`](super::link)'s: its silence stops without a latch, and the
//! next motion command goes. A task that hangs is `app`'s: outputs off, and back to boot.

use super::faults::{Fault, FaultRecord, Stops, stops};
use crate::channel::{CHANNELS, Channel, ChannelSet, Scope};

/// The number of the board's first fault; those below are the channels'.
const FIRST_OF_BOARD: u8 = Fault::MotorBatteryLow.number();

/// The faults that are latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latched {
    /// Of each DC channel: bit 1 is fault 1.
    channels: [u8; CHANNELS],
    /// Of the board: bit 0 is fault 16.
    board: u16,
}

impl Latched {
    /// None at all.
    pub const NONE: Self = Self { channels: [0; CHANNELS], board: 0 };
    /// The board's faults that stop all DC channels, and those that stop the servos too.
    const MOTORS: u16 = Self::of_board(true);
    const SERVOS: u16 = Self::of_board(false);
    /// A channel's faults that stop it.
    const CHANNEL: u8 = Self::of_channel();

    const fn of_board(motors: bool) -> u16 {
        let (mut bits, mut faults) = (0, Fault::ALL);
        while let [fault, rest @ ..] = faults {
            match stops(*fault) {
                Stops::MotorsAndServos => bits |= board_bit(*fault),
                Stops::Motors if motors => bits |= board_bit(*fault),
                Stops::Motors | Stops::Channel | Stops::Nothing => {}
            }
            faults = rest;
        }
        bits
    }

    const fn of_channel() -> u8 {
        let (mut bits, mut faults) = (0, Fault::ALL);
        while let [fault, rest @ ..] = faults {
            if matches!(stops(*fault), Stops::Channel) {
                bits |= channel_bit(*fault);
            }
            faults = rest;
        }
        bits
    }

    /// Whether this one is.
    pub fn has(&self, fault: Fault, channel: Option<Channel>) -> bool {
        match channel {
            Some(channel) => self.channels[channel.index()] & channel_bit(fault) != 0,
            None => self.board & board_bit(fault) != 0,
        }
    }

    /// Each of them with its channel.
    pub fn iter(self) -> impl Iterator<Item = (Fault, Option<Channel>)> {
        let places = Channel::ALL.into_iter().map(Some).chain([None]);
        places.flat_map(move |channel| {
            let faults = Fault::ALL.iter().filter(move |&&fault| self.has(fault, channel));
            faults.map(move |&fault| (fault, channel))
        })
    }

    /// Whether one of these channels, or the board, has a fault here that it did not have `before`.
    pub fn is_news(&self, before: &Self, channels: ChannelSet) -> bool {
        let of_board = self.board & !before.board != 0;
        let is_news = |i: usize| self.channels[i] & !before.channels[i] != 0;
        of_board || channels.iter().any(|channel| is_news(channel.index()))
    }

    /// How many there are.
    pub fn count(&self) -> u32 {
        let channels: u32 = self.channels.iter().map(|bits| bits.count_ones()).sum();
        channels.saturating_add(self.board.count_ones())
    }

    /// Which fault keeps this DC channel off: one of its own before one of the board's, the lowest number
    /// first.
    pub fn stopping(&self, channel: Channel) -> Option<Fault> {
        let stops_it = |fault: &Fault| match stops(*fault) {
            Stops::Nothing => false,
            Stops::Channel => self.has(*fault, Some(channel)),
            Stops::Motors | Stops::MotorsAndServos => self.has(*fault, None),
        };
        // To search is dear, and seldom needed.
        self.stops_motor(channel).then(|| Fault::ALL.iter().copied().find(stops_it)).flatten()
    }

    /// Whether this DC channel must stay off.
    pub fn stops_motor(&self, channel: Channel) -> bool {
        self.channels[channel.index()] & Self::CHANNEL != 0 || self.board & Self::MOTORS != 0
    }

    /// Whether the servos must stay off.
    pub fn stops_servos(&self) -> bool {
        self.board & Self::SERVOS != 0
    }
}

/// What has gone wrong and was not cleared: the latch, and the records.
#[derive(Debug, Default)]
pub struct Faults {
    latched: Latched,
    /// In the order in which they tripped, without gaps.
    records: [Option<FaultRecord>; RECORDS],
    kept: u8,
    /// When each channel has last tripped, the newest first; uptime in ms.
    trips: [[Option<u32>; TRIPS]; CHANNELS],
    /// When the board has last tripped, and which channels have been stopped since: bit 0 is channel 0.
    board_tripped: u32,
    stopped: u8,
}

/// How long a latch must have stood before a stop clears it.
const REARMS_AFTER_MS: u32 = 1000;
/// So many trips of a channel in so short a time are more than a stop clears.
const TRIPS: usize = 3;
const TRIPS_WITHIN_MS: u32 = 60_000;
const ALL_STOPPED: u8 = (1 << CHANNELS) - 1;

/// Records that are kept. When so many stand, the later ones are latched without: the first
/// tell the cause.
const RECORDS: usize = 16;

impl Faults {
    /// The latch alone.
    pub fn latched(&self) -> Latched {
        self.latched
    }

    /// The record at this place, from 0, in the order in which they tripped.
    pub fn record(&self, place: u8) -> Option<FaultRecord> {
        self.records.get(usize::from(place)).copied().flatten()
    }

    /// How many records are kept.
    pub fn records(&self) -> u8 {
        self.kept
    }

    /// Latches a fault. Whether it was not latched before: a record keeps the first time.
    pub fn trip(&mut self, record: FaultRecord) -> bool {
        if self.latched.has(record.fault, record.channel) {
            return false;
        }
        match record.channel {
            Some(channel) => {
                self.latched.channels[channel.index()] |= channel_bit(record.fault);
                if stops(record.fault) != Stops::Nothing {
                    let trips = &mut self.trips[channel.index()];
                    trips.rotate_right(1);
                    trips[0] = Some(record.uptime_ms);
                }
            }
            None => {
                self.latched.board |= board_bit(record.fault);
                if stops(record.fault) != Stops::Nothing {
                    (self.board_tripped, self.stopped) = (record.uptime_ms, 0);
                }
            }
        }
        if let Some(free) = self.records.get_mut(usize::from(self.kept)) {
            *free = Some(record);
            self.kept = self.kept.saturating_add(1);
        }
        true
    }

    /// A host has stopped this DC channel: clears what that clears, see the [module](self). `is_calm`
    /// says whether the channel's current is in bounds, and `lasts` what the board still suffers from.
    pub fn stopped(
        &mut self,
        channel: Channel,
        uptime_ms: u32,
        is_calm: bool,
        lasts: impl Fn(Fault) -> bool,
    ) {
        let has_stood = |since: u32| uptime_ms.wrapping_sub(since) >= REARMS_AFTER_MS;
        let trips = self.trips[channel.index()];
        if let [Some(newest), ..] = trips
            && is_calm
            && has_stood(newest)
            && !is_too_often(&trips)
        {
            self.forget(|record| {
                record.channel == Some(channel) && stops(record.fault) != Stops::Nothing
            });
            self.latched.channels[channel.index()] &= !Latched::CHANNEL;
        }
        // What was stopped while the board still suffered must be stopped again.
        if Fault::ALL.iter().any(|&fault| self.latched.has(fault, None) && lasts(fault)) {
            self.stopped = 0;
        } else if has_stood(self.board_tripped) {
            self.stopped |= 1 << channel.index();
        }
        if self.stopped == ALL_STOPPED {
            let clears = |fault| stops(fault) != Stops::Nothing && !lasts(fault);
            self.forget(|record| record.channel.is_none() && clears(record.fault));
            for &fault in Fault::ALL.iter().filter(|&&fault| clears(fault)) {
                self.latched.board &= !board_bit(fault);
            }
        }
    }

    /// Drops these records, and closes the gaps.
    fn forget(&mut self, which: impl Fn(&FaultRecord) -> bool) {
        let all = core::mem::take(&mut self.records);
        self.kept = 0;
        let kept = all.into_iter().flatten().filter(|record| !which(record));
        for (place, record) in self.records.iter_mut().zip(kept) {
            *place = Some(record);
            self.kept = self.kept.saturating_add(1);
        }
    }

    /// Clears what a host has asked for: all, or one DC channel's own. With `only_stops`, what
    /// stops nothing stays on record. What of the board `lasts` stays latched: or a host that clears
    /// again and again would drive in between.
    pub fn clear(&mut self, scope: Scope, only_stops: bool, lasts: impl Fn(Fault) -> bool) {
        let stops_nothing = |fault| only_stops && stops(fault) == Stops::Nothing;
        let stays = |fault, channel: Option<Channel>| match (scope, channel) {
            (Scope::All, None) if lasts(fault) => true,
            (Scope::All, _) => stops_nothing(fault),
            (Scope::Motor(of), Some(channel)) => of != channel || stops_nothing(fault),
            (Scope::Motor(_), None) | (Scope::Servo(_), _) => true,
        };
        let cleared = if only_stops { Latched::CHANNEL } else { u8::MAX };
        match scope {
            Scope::All => {
                self.latched.channels.iter_mut().for_each(|bits| *bits &= !cleared);
                self.trips = Default::default();
                for &fault in Fault::ALL.iter().filter(|&&fault| !stays(fault, None)) {
                    self.latched.board &= !board_bit(fault);
                }
            }
            Scope::Motor(channel) => {
                self.latched.channels[channel.index()] &= !cleared;
                self.trips[channel.index()] = Default::default();
            }
            Scope::Servo(_) => {}
        }
        self.forget(|record| !stays(record.fault, record.channel));
    }
}

/// Whether a channel has tripped more often than stops may clear.
fn is_too_often(trips: &[Option<u32>; TRIPS]) -> bool {
    match trips {
        [Some(newest), .., Some(oldest)] => newest.wrapping_sub(*oldest) <= TRIPS_WITHIN_MS,
        _ => false,
    }
}

// Every fault has a place.
const _: () = {
    let mut faults = Fault::ALL;
    while let [fault, rest @ ..] = faults {
        assert!(channel_bit(*fault) != 0 || board_bit(*fault) != 0);
        faults = rest;
    }
};

const fn channel_bit(fault: Fault) -> u8 {
    match 1_u8.checked_shl(fault.number() as u32) {
        Some(bit) => bit,
        None => 0,
    }
}

const fn board_bit(fault: Fault) -> u16 {
    match fault.number().checked_sub(FIRST_OF_BOARD) {
        Some(place) => 1 << place,
        None => 0,
    }
}
