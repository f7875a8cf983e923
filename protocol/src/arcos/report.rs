//! What the arm tells: ARMpac and ARMINFOpac (Tables 3 and 4), both directions.
//!
//! The hosts of the field disagree about ARMpac's two status bytes, and no layout serves them all:
//! which one is spoken is a [`Dialect`]. Source: facts, "Contradictions".

use super::arm::JOINTS;
use super::packet::{Packet, append_text, take_text};
use crate::data::{Data, EncodeError, Field, append, record};

/// Which bits of a byte tell that joints 1 to 6 are in motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotionBits {
    /// Bits 1 to 6, as the manual says.
    OneToSix,
    /// Bits 0 to 5, as hosts exist that read them.
    ZeroToFive,
}

impl MotionBits {
    fn first(self) -> u8 {
        match self {
            Self::OneToSix => 1,
            Self::ZeroToFive => 0,
        }
    }

    fn emit(self, moving: [bool; JOINTS]) -> u8 {
        let bits = moving.iter().rev().fold(0u8, |bits, &moves| (bits << 1) | u8::from(moves));
        bits << self.first()
    }

    fn read(self, byte: u8) -> [bool; JOINTS] {
        let mut bits = byte >> self.first();
        [(); JOINTS].map(|()| {
            let moves = bits & 1 == 1;
            bits >>= 1;
            moves
        })
    }
}

/// What the two status bytes of ARMpac mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Dialect {
    /// The manual's: power and connection, then motion.
    Manual(MotionBits),
    /// ARIA's: motion in bits 1 to 6, then good, initialised, power and homing.
    Aria,
}

/// Bits of the status byte: Table 4, byte 2.
mod manual {
    pub const POWER: u8 = 1 << 0;
    pub const CONNECTED: u8 = 1 << 1;
}

/// Bits of the status byte as ARIA reads it: byte 3.
mod aria {
    pub const GOOD: u8 = 1 << 0;
    pub const INITIALISED: u8 = 1 << 1;
    pub const POWER: u8 = 1 << 2;
    pub const HOMING: u8 = 1 << 3;
}

/// The arm's state (ARMpac, Table 4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ArmStatus {
    /// The servos have power.
    pub powered: bool,
    /// The arm is connected. ARIA's dialect tells of it only as far as it is good.
    pub connected: bool,
    /// It is connected, and no fault keeps its servos off. The manual's dialect has no place for
    /// it, and whatever is connected reads back as good.
    pub good: bool,
    /// The arm needs no INIT before it takes power. The manual's dialect has no place for it, and
    /// it reads back as false.
    pub initialised: bool,
    /// Joints are on their way home. The same holds.
    pub homing: bool,
    /// Which joints are in motion.
    pub moving: [bool; JOINTS],
    /// Where the joints are, in ticks.
    pub positions: [u8; JOINTS],
}

impl ArmStatus {
    /// Its id: 160 in Table 4.
    pub const ID: u8 = 160;

    /// Writes the whole packet into `out` and answers the part it took: 14 bytes.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(
        &self,
        dialect: Dialect,
        out: &'b mut [u8],
    ) -> Result<&'b mut [u8], EncodeError> {
        let bit = |set: bool, bit: u8| if set { bit } else { 0 };
        let status = match dialect {
            Dialect::Manual(bits) => [
                bit(self.powered, manual::POWER) | bit(self.connected, manual::CONNECTED),
                bits.emit(self.moving),
            ],
            Dialect::Aria => [
                MotionBits::OneToSix.emit(self.moving),
                bit(self.good, aria::GOOD)
                    | bit(self.initialised, aria::INITIALISED)
                    | bit(self.powered, aria::POWER)
                    | bit(self.homing, aria::HOMING),
            ],
        };
        let mut data = Data::new();
        append(&mut data, &status)?;
        append(&mut data, &self.positions)?;
        Packet { id: Self::ID, data: &data }.encode(out)
    }

    /// Reads an intact packet; `None` if it is another.
    pub fn parse(packet: &Packet<'_>, dialect: Dialect) -> Option<Self> {
        let (&[first, second], positions) = match packet.id {
            Self::ID => packet.data.split_first_chunk::<2>()?,
            _ => return None,
        };
        let positions = positions.try_into().ok()?;
        Some(match dialect {
            Dialect::Manual(bits) => Self {
                powered: first & manual::POWER != 0,
                connected: first & manual::CONNECTED != 0,
                good: first & manual::CONNECTED != 0,
                initialised: false,
                homing: false,
                moving: bits.read(second),
                positions,
            },
            Dialect::Aria => Self {
                powered: second & aria::POWER != 0,
                connected: second & aria::GOOD != 0,
                good: second & aria::GOOD != 0,
                initialised: second & aria::INITIALISED != 0,
                homing: second & aria::HOMING != 0,
                moving: MotionBits::OneToSix.read(first),
                positions,
            },
        })
    }
}

record! {
    /// What a joint is like (ARMINFOpac, Table 3). Positions are in ticks.
    #[derive(Default)]
    pub struct JointInfo {
        /// Milliseconds a step of one tick, 1 to 127.
        pub ms_per_tick: u8,
        /// Home position.
        pub home: u8,
        /// Lowest position.
        pub min: u8,
        /// The position of 0 degrees.
        pub centre: u8,
        /// Highest position.
        pub max: u8,
        /// Ticks of 90 degrees, 1 to 255.
        pub ticks_per_90: u8,
    }
}

/// What the arm is like (ARMINFOpac, Table 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ArmInfo<'a> {
    /// None is connected.
    NoArm,
    /// An arm.
    Arm {
        /// Its version, at most 150 bytes.
        version: &'a str,
        /// Its joints.
        joints: [JointInfo; JOINTS],
    },
}

/// "or 'No arm' if not connected" (Table 3).
const NO_ARM: &str = "No arm";

impl<'a> ArmInfo<'a> {
    /// Its id: 161 in Table 3.
    pub const ID: u8 = 161;

    /// Writes the whole packet into `out` and answers the part it took. The count is that of the
    /// bytes: n+39 for a version whose NUL is byte n, not the n+53 that Table 3 prints.
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut data = Data::new();
        match self {
            Self::NoArm => {
                append_text(&mut data, NO_ARM)?;
                append(&mut data, &[0])?;
            }
            Self::Arm { version, joints } => {
                append_text(&mut data, version)?;
                append(&mut data, &[SIX])?;
                joints.put(&mut data)?;
            }
        }
        Packet { id: Self::ID, data: &data }.encode(out)
    }

    /// Reads an intact packet; `None` if it is another, or of an arm that has not six joints.
    pub fn parse(packet: &Packet<'a>) -> Option<Self> {
        let mut data = (packet.id == Self::ID).then_some(packet.data)?;
        let version = take_text(&mut data)?;
        match u8::take(&mut data)? {
            0 if data.is_empty() => Some(Self::NoArm),
            SIX => {
                let joints = Field::take(&mut data)?;
                data.is_empty().then_some(Self::Arm { version, joints })
            }
            _ => None,
        }
    }
}

/// [`JOINTS`] as a byte of the wire.
const SIX: u8 = 6;
