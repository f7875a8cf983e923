//! The machine state (DID 102): all that a person or a program wants to see of a board, of one moment.

use crate::data::{codes, record};

codes! {
    /// Why a channel does not do what was asked of it (byte 16 of a channel in DID 102). The next byte says more.
    Reason {
        /// It does, or nothing was asked.
        None = 0,
        /// A fault is latched; the next byte is its number.
        Fault = 1,
        /// The host fell silent: the channel was stopped, or its move broken off.
        Silence = 2,
        /// It is suspended.
        Suspended = 3,
        /// The last motion command was refused, as the channel, or another that it was for, was set to another method (sub-command 0E); the next byte is the command's DID.
        OtherMethod = 4,
        /// The last motion command was refused, as a target of it lies beyond the sensor's scale; the next byte is the command's DID.
        BeyondScale = 5,
        /// The collision protection forbids the way that it is driven.
        Obstacle = 6,
        /// It is held at a soft limit, or its target lies beyond one.
        SoftLimit = 7,
        /// Its current is too high: the drive is limited.
        OverCurrent = 8,
        /// Its current was too high for too long: the drive is limited.
        Overload = 9,
        /// Its slew time limits the drive.
        Slew = 10,
        /// Its highest duty limits the drive.
        HighestDuty = 11,
        /// It has all the drive that there is, and that is not enough.
        FullDrive = 12,
        /// Its last motion command grew too old (setting 6): it was stopped, or its move broken off.
        OldCommand = 13,
    }
}

codes! {
    /// What a channel is doing (byte 15 of a channel in DID 102), and so what its set-point counts.
    Mode {
        /// Nothing, for whatever reason: its bridge neither drives nor brakes. The set-point is 0.
        Off = 0,
        /// Open loop: the set-point is a duty in 1/16384.
        Pwm = 1,
        /// Closed loop on position: counts.
        Position = 2,
        /// Closed loop on velocity: counts per second.
        Velocity = 3,
    }
}

record! {
    /// A DC channel, 17 bytes.
    pub struct ChannelState {
        /// Counts of its sensor since boot, turn by turn; wraps. An encoder's can be set
        /// ([`Request::SetCount`](super::Request::SetCount)).
        pub position: i32,
        /// Counts of its sensor per second.
        pub velocity: i32,
        /// What it is asked for at this moment of its move, by [`mode`](Self::mode). A position is one of its
        /// sensor's scale, as in the commands: an encoder's [`position`](Self::position) modulo 32768.
        pub set_point: i16,
        /// What its bridge does, in 1/16384 of full drive.
        pub duty: i16,
        /// Motor current, A/D counts 0 to 4095.
        pub current: u16,
        /// What it is doing.
        pub mode: Mode,
        /// Why it does not do what was asked.
        pub reason: Reason,
        /// More of the reason, or 0.
        pub detail: u8,
    }
}

impl Default for ChannelState {
    fn default() -> Self {
        Self {
            position: 0,
            velocity: 0,
            set_point: 0,
            duty: 0,
            current: 0,
            mode: Mode::Off,
            reason: Reason::None,
            detail: 0,
        }
    }
}

record! {
    /// The machine state (DID 102), 124 bytes.
    #[derive(Default)]
    pub struct MachineState {
        /// The low 16 bits of the uptime in ms.
        pub time_ms: u16,
        /// Bits: 0 the host is silent, or channels that it left running were stopped for that; 1 an
        /// obstacle; 2 a fault is latched.
        pub flags: u8,
        /// Frames and commands refused since boot, whoever refused them; wraps.
        pub refused: u8,
        /// Main board, motor and servo batteries, A/D counts.
        pub battery: [u16; 3],
        /// DC channels 1 to 6.
        pub channels: [ChannelState; 6],
        /// Servos 1 to 6: pulse width in 1/2250 ms, 0 is no pulse.
        pub servos: [u16; 6],
    }
}

/// Bits of [`MachineState::flags`].
pub mod flag {
    /// The host is silent, or channels that it left running were stopped for that.
    pub const LINK_LOST: u8 = 1 << 0;
    /// The collision protection sees an obstacle.
    pub const OBSTACLE: u8 = 1 << 1;
    /// A fault is latched.
    pub const FAULT: u8 = 1 << 2;
}
