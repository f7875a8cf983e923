//! What an arm's session counts.

use protocol::arcos::ArmStatus;
use protocol::pms5005::extension::Counters;

use crate::controller::Snapshot;

/// What a session has counted, and the arm as it last was. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ArmCounters {
    /// Intact packets.
    pub packets_ok: u32,
    /// Packets that began well and were damaged.
    pub bad_packets: u32,
    /// Bytes that were part of no intact packet.
    pub bytes_skipped: u32,
    /// Sessions opened.
    pub opened: u32,
    /// Sessions that ended because the host fell silent.
    pub watchdogs: u32,
    /// Packets that the session was not at: SYNCs out of order, commands before OPEN.
    pub out_of_turn: u32,
    /// Commands that are not the arm's.
    pub not_for_the_arm: u32,
    /// Commands of the arm and of the extension that were refused for what they say.
    pub refused: u32,
    /// Arm commands that were ignored for the state that the arm was in.
    pub ignored: u32,
    /// Positions and speeds that had to be limited.
    pub limited: u32,
    /// Times that the arm was lost while it had power.
    pub arms_lost: u32,
    /// Times that the board took the servos' power, for a fault.
    pub power_lost: u32,
    /// Standard information packets sent.
    pub standard_sent: u32,
    /// Standard information packets skipped because the line was busy for a whole cycle.
    pub standard_skipped: u32,
    /// Errors that the line itself reported: overruns, framing.
    pub line_errors: u32,
    /// Answers of the extension sent, health apart.
    pub answers_sent: u32,
    /// Answers of the extension that found no more room to wait.
    pub answers_dropped: u32,
    /// The arm.
    pub arm: ArmStatus,
}

impl ArmCounters {
    /// What the extension tells of them; what an arm does not have stays 0.
    pub(super) fn told(&self, snapshot: &Snapshot) -> Counters {
        Counters {
            frames_ok: self.packets_ok,
            bad_frames: self.bad_packets,
            bytes_skipped: self.bytes_skipped,
            frames_for_us: self.packets_ok,
            unknown: self.not_for_the_arm,
            refused: self.refused.wrapping_add(self.ignored),
            telemetry_sent: self.standard_sent,
            telemetry_skipped: self.standard_skipped,
            line_errors: self.line_errors,
            answers_sent: self.answers_sent,
            answers_dropped: self.answers_dropped,
            commands_refused: snapshot.counters.refused,
            links_lost: snapshot.counters.links_lost,
            ..Counters::default()
        }
    }
}

/// Counters wrap.
pub(super) fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}
