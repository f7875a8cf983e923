//! What an arm's session counts.

use protocol::arcos::ArmStatus;
use protocol::extension::Counters;

/// What a session has counted, and the arm as it last was. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ArmCounters {
    /// What any session counts. `unknown` are commands that are not the arm's, telemetry is standard
    /// information packets; what an arm does not have stays 0.
    pub link: Counters,
    /// Sessions opened.
    pub opened: u32,
    /// Times that the host of an open session fell silent.
    pub watchdogs: u32,
    /// Packets that the session was not at: SYNCs out of order, commands before OPEN.
    pub out_of_turn: u32,
    /// Arm commands that were ignored for the state that the arm was in.
    pub ignored: u32,
    /// Positions and speeds that had to be limited.
    pub limited: u32,
    /// Times that the arm was lost while it had power.
    pub arms_lost: u32,
    /// Times that the board took the servos' power, for a fault.
    pub power_lost: u32,
    /// The arm.
    pub arm: ArmStatus,
}

impl ArmCounters {
    /// What the extension tells of them: all packets are for us, and who reads only that must see
    /// what was ignored.
    pub(super) fn told(&self) -> Counters {
        let refused = self.link.refused.wrapping_add(self.ignored);
        Counters { frames_for_us: self.link.frames_ok, refused, ..self.link }
    }
}
