//! The packet: `FF FF ID LEN CODE P1..Pn CHK`, where LEN = n + 2 counts CODE, parameters and
//! checksum, and CHK is the complement of the sum of all bytes from ID on.
//!
//! CODE is an instruction from the master and the error bits from a servo: nothing else tells the
//! two directions apart.

use super::register::REGISTER_BYTES;
use crate::data::EncodeError;
use crate::deframe::{Deframer, Framing};

/// What begins every packet.
const START: [u8; 2] = [0xFF, 0xFF];

/// Where the fields stand, in bytes from the start of the packet.
const ID: usize = 2;
const LEN: usize = 3;
const CODE: usize = 4;
const PARAMS: usize = 5;

/// Bytes of a packet that are not parameters: start 2, ID, LEN, CODE, CHK.
pub const OVERHEAD: usize = 6;
/// What LEN counts besides the parameters: CODE and CHK.
const COUNTED: usize = 2;
/// Bytes of a packet that LEN does not count: start 2, ID, LEN.
const UNCOUNTED: usize = 4;
/// The most parameters that LEN can tell.
pub const MAX_PARAMS: usize = 253;
/// The longest packet.
pub const MAX_PACKET: usize = OVERHEAD + MAX_PARAMS;
/// The longest answer of an AX-12: all of its registers.
pub const MAX_STATUS: usize = OVERHEAD + REGISTER_BYTES;

/// Whom a packet is for, or who answers: 0 to 253, or [`Id::BROADCAST`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Id(u8);

impl Id {
    /// All servos. They answer to nothing but PING, and then all at once.
    pub const BROADCAST: Self = Self(0xFE);

    /// 0xFF is no ID: it could not be told from the start of a packet.
    pub const fn new(number: u8) -> Option<Self> {
        if number == 0xFF { None } else { Some(Self(number)) }
    }

    /// 0 to 254, as on the wire.
    pub const fn number(self) -> u8 {
        self.0
    }
}

/// The receiver's view of the packet.
pub enum Dynamixel {}

impl Framing for Dynamixel {
    const START: [u8; 2] = START;
    const HEADER: usize = CODE;

    fn length(header: &[u8]) -> Option<usize> {
        let len = usize::from(*header.get(LEN)?);
        Id::new(*header.get(ID)?).filter(|_| len >= COUNTED)?;
        len.checked_add(UNCOUNTED)
    }

    fn is_intact(candidate: &[u8]) -> bool {
        candidate.strip_prefix(&START).is_some_and(|body| sum(body) == 0xFF)
    }
}

/// Finds instructions in a stream, as a servo must: nothing is longer than [`MAX_PACKET`].
pub type InstructionReceiver = Deframer<Dynamixel, MAX_PACKET>;

/// Finds answers in a stream, as a master must: nothing longer than [`MAX_STATUS`]. The echo of the
/// master's own instructions is not for it.
pub type StatusReceiver = Deframer<Dynamixel, MAX_STATUS>;

/// A packet's fields. What they mean is [`Instruction`](super::Instruction)'s and
/// [`Status`](super::Status)'s business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Packet<'a> {
    /// Whom it is for, or who answers.
    pub id: Id,
    /// The instruction, or the error bits.
    pub code: u8,
    /// 0 to [`MAX_PARAMS`] bytes.
    pub params: &'a [u8],
}

/// Why bytes are not a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PacketError {
    /// They do not begin with `FF FF ID LEN`, or LEN does not fit their number.
    Malformed,
    /// The checksum is wrong; a servo whose ID this is says so in its answer.
    Checksum(Id),
}

impl core::fmt::Display for PacketError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Malformed => f.write_str("not a packet"),
            Self::Checksum(id) => write!(f, "wrong checksum in a packet with ID {}", id.number()),
        }
    }
}

impl core::error::Error for PacketError {}

impl<'a> Packet<'a> {
    /// Takes one whole packet apart.
    ///
    /// # Errors
    /// [`PacketError`]; never for what a receiver has handed out.
    pub fn parse(packet: &'a [u8]) -> Result<Self, PacketError> {
        let total = packet.get(..CODE).and_then(Dynamixel::length);
        if !packet.starts_with(&START) || total != Some(packet.len()) {
            return Err(PacketError::Malformed);
        }
        let fields = || {
            let id = Id::new(*packet.get(ID)?)?;
            let (_checksum, params) = packet.get(PARAMS..)?.split_last()?;
            Some(Self { id, code: *packet.get(CODE)?, params })
        };
        let packet_fields = fields().ok_or(PacketError::Malformed)?;
        if !Dynamixel::is_intact(packet) {
            return Err(PacketError::Checksum(packet_fields.id));
        }
        Ok(packet_fields)
    }

    /// Writes the packet into `out` and answers the part it took.
    ///
    /// # Errors
    /// [`EncodeError`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut writer = PacketWriter::new(out, self.id, self.code)?;
        writer.append(self.params.len())?.copy_from_slice(self.params);
        writer.finish()
    }
}

/// A packet that is being written where it will be sent from.
pub(super) struct PacketWriter<'b> {
    out: &'b mut [u8],
    params: usize,
}

impl<'b> PacketWriter<'b> {
    /// Begins a packet without parameters.
    pub(super) fn new(out: &'b mut [u8], id: Id, code: u8) -> Result<Self, EncodeError> {
        let header = out.first_chunk_mut().ok_or(EncodeError::BufferTooShort)?;
        *header = [START[0], START[1], id.number(), 0, code];
        Ok(Self { out, params: 0 })
    }

    /// Room for the next `count` parameters, to be filled by the caller. After an error the packet
    /// is as it was.
    pub(super) fn append(&mut self, count: usize) -> Result<&mut [u8], EncodeError> {
        let params = self.params.saturating_add(count);
        if params > MAX_PARAMS {
            return Err(EncodeError::TooLong);
        }
        let total = params.saturating_add(OVERHEAD);
        let begin = self.params.saturating_add(PARAMS);
        let room = self.out.get_mut(..total).and_then(|packet| packet.get_mut(begin..));
        let (room, _checksum) = room
            .and_then(|room| room.split_at_mut_checked(count))
            .ok_or(EncodeError::BufferTooShort)?;
        self.params = params;
        Ok(room)
    }

    /// Writes LEN and checksum.
    pub(super) fn finish(self) -> Result<&'b mut [u8], EncodeError> {
        let len = u8::try_from(self.params.saturating_add(COUNTED));
        let len = len.map_err(|_| EncodeError::TooLong)?;
        let total = self.params.saturating_add(OVERHEAD);
        let packet = self.out.get_mut(..total).ok_or(EncodeError::BufferTooShort)?;
        if let Some(place) = packet.get_mut(LEN) {
            *place = len;
        }
        if let Some((checksum, before)) = packet.split_last_mut() {
            *checksum = !sum(before.get(ID..).unwrap_or_default());
        }
        Ok(packet)
    }
}

/// The low byte of the sum.
fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, &byte| sum.wrapping_add(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_ends_where_its_length_says_and_its_sum_is_all_ones() {
        let packet = [0xFF, 0xFF, 0x00, 0x02, 0x00, 0xFD];
        let id = Id::new(0).unwrap();
        assert_eq!(Packet::parse(&packet), Ok(Packet { id, code: 0, params: &[] }));
        assert_eq!(Packet::parse(&packet[..5]), Err(PacketError::Malformed));
        assert_eq!(
            Packet::parse(&[0xFF, 0xFF, 0x00, 0x02, 0x00, 0xFC]),
            Err(PacketError::Checksum(id))
        );
    }

    #[test]
    fn no_packet_is_shorter_than_its_code_and_checksum_or_has_id_255() {
        for len in 0..=255u8 {
            let total = (len >= 2).then_some(usize::from(len) + 4);
            assert_eq!(Dynamixel::length(&[0xFF, 0xFF, 1, len]), total);
            assert_eq!(Dynamixel::length(&[0xFF, 0xFF, 0xFF, len]), None);
        }
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let id = Id::new(7).unwrap();
        let longest = Packet { id, code: 3, params: &[0; MAX_PARAMS] };
        assert_eq!(longest.encode(&mut [0; MAX_PACKET]).unwrap().len(), MAX_PACKET);
        assert_eq!(longest.encode(&mut [0; MAX_PACKET - 1]), Err(EncodeError::BufferTooShort));
        let too_long = Packet { params: &[0; MAX_PARAMS + 1], ..longest };
        assert_eq!(too_long.encode(&mut [0; MAX_PACKET + 1]), Err(EncodeError::TooLong));
        for short in 0..OVERHEAD {
            let ping = Packet { id, code: 1, params: &[] };
            assert_eq!(ping.encode(&mut [0; OVERHEAD][..short]), Err(EncodeError::BufferTooShort));
        }
    }
}
