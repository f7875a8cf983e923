//! What a master asks for (manual 3-2 and 4), typed, both directions.

use super::packet::{Id, Packet, Writer, begin, finish, write};
use crate::data::EncodeError;

/// Instruction codes (manual 4).
mod code {
    pub const PING: u8 = 0x01;
    pub const READ: u8 = 0x02;
    pub const WRITE: u8 = 0x03;
    pub const REG_WRITE: u8 = 0x04;
    pub const ACTION: u8 = 0x05;
    pub const RESET: u8 = 0x06;
    pub const SYNC_WRITE: u8 = 0x83;
}

/// An instruction. Addresses and counts are as they came: which registers there are is the servo's
/// business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Instruction<'a> {
    /// Answer.
    Ping,
    /// Answer with the registers' bytes.
    Read {
        /// The first register.
        address: u8,
        /// How many bytes.
        count: u8,
    },
    /// Write registers.
    Write {
        /// The first register.
        address: u8,
        /// One byte or more.
        data: &'a [u8],
    },
    /// Write registers when ACTION comes.
    RegWrite {
        /// The first register.
        address: u8,
        /// One byte or more.
        data: &'a [u8],
    },
    /// Do what the last REG_WRITE said.
    Action,
    /// All registers back to their defaults, the ID included.
    Reset,
    /// Write the same registers of several servos; nobody answers.
    SyncWrite(SyncWrite<'a>),
}

impl<'a> Instruction<'a> {
    /// Reads code and parameters of an intact packet. `None` if there is no such instruction, or the
    /// parameters do not fit it: a servo answers [`Errors::INSTRUCTION`](super::Errors::INSTRUCTION).
    pub fn parse(Packet { code, params, .. }: Packet<'a>) -> Option<Self> {
        Some(match (code, params) {
            (code::PING, []) => Self::Ping,
            (code::READ, &[address, count]) => Self::Read { address, count },
            (code::WRITE, [address, data @ ..]) if !data.is_empty() => {
                Self::Write { address: *address, data }
            }
            (code::REG_WRITE, [address, data @ ..]) if !data.is_empty() => {
                Self::RegWrite { address: *address, data }
            }
            (code::ACTION, []) => Self::Action,
            (code::RESET, []) => Self::Reset,
            (code::SYNC_WRITE, _) => Self::SyncWrite(SyncWrite::parse(params)?),
            _ => return None,
        })
    }

    /// Writes a whole packet for `id` into `out` and answers the part it took. A SYNC_WRITE goes
    /// to [`Id::BROADCAST`] whatever `id` is.
    pub fn encode<'b>(&self, id: Id, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        match *self {
            Self::Ping => write(id, code::PING, &[], out),
            Self::Read { address, count } => write(id, code::READ, &[&[address, count]], out),
            Self::Write { address, data } => write(id, code::WRITE, &[&[address], data], out),
            Self::RegWrite { address, data } => {
                write(id, code::REG_WRITE, &[&[address], data], out)
            }
            Self::Action => write(id, code::ACTION, &[], out),
            Self::Reset => write(id, code::RESET, &[], out),
            Self::SyncWrite(SyncWrite { params }) => {
                write(Id::BROADCAST, code::SYNC_WRITE, &[params], out)
            }
        }
    }
}

/// A SYNC_WRITE that was found well formed: the first register, how many bytes each servo gets (one
/// or more), then ID and bytes of each servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SyncWrite<'a> {
    params: &'a [u8],
}

impl<'a> SyncWrite<'a> {
    fn parse(params: &'a [u8]) -> Option<Self> {
        let (&[_address, len], servos) = params.split_first_chunk()?;
        let each = usize::from(len).checked_add(1)?;
        (len > 0 && servos.len().is_multiple_of(each)).then_some(Self { params })
    }

    /// The first register.
    pub fn address(&self) -> u8 {
        self.params.first().copied().unwrap_or_default()
    }

    /// The number of each servo listed, and the bytes for it, in the order of the packet. Numbers
    /// are as they came: 254 and 255 are no servo's.
    pub fn servos(&self) -> impl Iterator<Item = (u8, &'a [u8])> + use<'a> {
        let len = self.params.get(1).copied().unwrap_or_default();
        let servos = self.params.get(2..).unwrap_or_default();
        servos
            .chunks_exact(usize::from(len).saturating_add(1))
            .filter_map(|servo| servo.split_first().map(|(id, data)| (*id, data)))
    }
}

/// Writes a SYNC_WRITE where it will be sent from, servo by servo.
///
/// ```
/// use protocol::dynamixel::{Id, Register, SyncWriter};
///
/// let mut buffer = [0; 64];
/// let mut goals = SyncWriter::new(&mut buffer, Register::GOAL_POSITION.address, 2).unwrap();
/// for (id, goal) in [(1, 0x200u16), (2, 0x3FF)] {
///     goals.servo(Id::new(id).unwrap()).unwrap().copy_from_slice(&goal.to_le_bytes());
/// }
/// let packet = goals.finish().unwrap();
/// assert_eq!(packet[..8], [0xFF, 0xFF, 0xFE, 10, 0x83, 30, 2, 1]);
/// ```
pub struct SyncWriter<'b> {
    packet: Writer<'b>,
    len: u8,
}

impl<'b> SyncWriter<'b> {
    /// Begins a SYNC_WRITE of `len` bytes a servo, from register `address` on. With `len` 0 it is
    /// one that servos refuse.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooShort`].
    pub fn new(out: &'b mut [u8], address: u8, len: u8) -> Result<Self, EncodeError> {
        let mut packet = begin(out, Id::BROADCAST, code::SYNC_WRITE)?;
        packet.append(&[address, len])?;
        Ok(Self { packet, len })
    }

    /// Room for the next servo's `len` bytes, to be filled by the caller. After an error the packet
    /// is as it was: finish it, and go on in another.
    pub fn servo(&mut self, id: Id) -> Result<&mut [u8], EncodeError> {
        let each = usize::from(self.len).saturating_add(1);
        let (first, data) =
            self.packet.room(each)?.split_first_mut().ok_or(EncodeError::BufferTooShort)?;
        *first = id.number();
        Ok(data)
    }

    /// Writes LEN and checksum, and answers the whole packet.
    ///
    /// # Errors
    /// [`EncodeError`]; not when every call before it went well.
    pub fn finish(self) -> Result<&'b mut [u8], EncodeError> {
        finish(self.packet)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{InstructionReceiver, MAX_PACKET};
    use super::*;

    /// The packet of the manual's SYNC_WRITE example (facts): positions and speeds of four servos.
    const SYNC_WRITE: [u8; 28] = [
        0xFF, 0xFF, 0xFE, 0x18, 0x83, 0x1E, 0x04, 0x00, 0x10, 0x00, 0x50, 0x01, 0x01, 0x20, 0x02,
        0x60, 0x03, 0x02, 0x30, 0x00, 0x70, 0x01, 0x03, 0x20, 0x02, 0x80, 0x03, 0x12,
    ];
    /// What it says: goal position and moving speed of servos 0 to 3.
    const GOALS: [(u16, u16); 4] = [(0x010, 0x150), (0x220, 0x360), (0x030, 0x170), (0x220, 0x380)];

    fn received(bytes: &[u8]) -> Vec<u8> {
        let mut receiver = InstructionReceiver::new();
        receiver.receive(&mut &bytes[..]).expect("a packet").to_vec()
    }

    #[test]
    fn the_manuals_sync_write_is_written_and_read_byte_for_byte() {
        let mut buffer = [0; MAX_PACKET];
        let mut writer = SyncWriter::new(&mut buffer, 0x1E, 4).unwrap();
        for (id, (position, speed)) in (0..).zip(GOALS) {
            let data = writer.servo(Id::new(id).unwrap()).unwrap();
            data[..2].copy_from_slice(&position.to_le_bytes());
            data[2..].copy_from_slice(&speed.to_le_bytes());
        }
        assert_eq!(writer.finish().unwrap(), SYNC_WRITE);

        let packet = received(&SYNC_WRITE);
        let packet = Packet::parse(&packet).unwrap();
        assert_eq!(packet.id, Id::BROADCAST);
        let Some(Instruction::SyncWrite(sync_write)) = Instruction::parse(packet) else {
            panic!("no SYNC_WRITE");
        };
        assert_eq!(sync_write.address(), 30);
        let read: Vec<_> = sync_write.servos().collect();
        assert_eq!(read[1], (1, &[0x20, 0x02, 0x60, 0x03][..]));
        assert_eq!(read.iter().map(|(id, _)| *id).collect::<Vec<_>>(), [0, 1, 2, 3]);
        let again = Instruction::SyncWrite(sync_write);
        assert_eq!(again.encode(Id::BROADCAST, &mut [0; 64]).unwrap(), SYNC_WRITE);
    }

    #[test]
    fn instructions_with_too_few_or_too_many_parameters_are_refused() {
        let refused: [(u8, &[u8]); 12] = [
            (0x01, &[0]),
            (0x02, &[0]),
            (0x02, &[0, 1, 2]),
            (0x03, &[]),
            (0x03, &[30]),
            (0x04, &[30]),
            (0x05, &[0]),
            (0x06, &[0]),
            (0x83, &[]),
            (0x83, &[30]),
            (0x83, &[30, 0]),             // nothing for anyone
            (0x83, &[30, 2, 1, 0, 2, 2]), // half of the second servo
        ];
        for (code, params) in refused {
            let packet = Packet { id: Id::BROADCAST, code, params };
            assert_eq!(Instruction::parse(packet), None, "{code:#04x} {params:?}");
        }
        for code in [0x00, 0x07, 0x82, 0x84, 0xFF] {
            let packet = Packet { id: Id::BROADCAST, code, params: &[] };
            assert_eq!(Instruction::parse(packet), None);
        }
    }

    #[test]
    fn a_full_sync_write_refuses_the_next_servo_and_stays_whole() {
        let mut buffer = [0; MAX_PACKET];
        let mut writer = SyncWriter::new(&mut buffer, 24, 12).unwrap();
        let mut servos = 0;
        while let Ok(data) = writer.servo(Id::new(servos).unwrap()) {
            data.fill(servos);
            servos += 1;
        }
        // 253 parameters: 2, and 13 a servo.
        assert_eq!(servos, 19);
        let packet = writer.finish().unwrap();
        let Some(Instruction::SyncWrite(read)) = Instruction::parse(Packet::parse(packet).unwrap())
        else {
            panic!("no SYNC_WRITE");
        };
        assert_eq!(read.servos().count(), 19);
        assert!(read.servos().all(|(id, data)| data == [id; 12]));
    }
}
