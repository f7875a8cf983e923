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
        sums_up(candidate)
    }
}

/// The packet as an AX-12 receives it: it believes LEN, and looks at the checksum when all is there. So
/// nothing is found inside a packet that is damaged.
pub enum ByLength {}

impl Framing for ByLength {
    const START: [u8; 2] = START;
    const HEADER: usize = Dynamixel::HEADER;

    fn length(header: &[u8]) -> Option<usize> {
        Dynamixel::length(header)
    }

    fn is_intact(_: &[u8]) -> bool {
        true
    }
}

/// Finds instructions in a stream, as an AX-12 does: nothing is longer than [`MAX_PACKET`]. Whether one is
/// intact is still to be asked.
pub type InstructionReceiver = Deframer<ByLength, MAX_PACKET>;

/// Finds answers in a stream, as a master must: nothing longer than [`MAX_STATUS`]. The echo of the
/// master's own instructions is not for it.
pub type StatusReceiver = Deframer<Dynamixel, MAX_STATUS>;

/// A packet's fields. What they mean is [`Instruction`](super::Instruction)'s and
/// [`Errors`](super::Errors)'s business.
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

impl<'a> Packet<'a> {
    /// Takes one whole packet apart. `None` if it does not begin with `FF FF ID LEN`, or LEN does
    /// not fit its length; the checksum is the receiver's business.
    pub fn parse(packet: &'a [u8]) -> Option<Self> {
        let total = Dynamixel::length(packet.strip_prefix(&START).and(packet.get(..CODE))?)?;
        Self::received(packet).filter(|_| total == packet.len())
    }

    /// The same for what a receiver has handed out, and so has checked: only taken apart. `None` if
    /// it is too short to be a packet.
    pub fn received(packet: &'a [u8]) -> Option<Self> {
        let &[_, _, id, _len, code, ref params @ .., _checksum] = packet else { return None };
        Some(Self { id: Id::new(id)?, code, params })
    }

    /// Writes the packet into `out` and answers the part it took.
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        write(self.id, self.code, &[self.params], out)
    }
}

/// Writes a packet whose parameters come in parts.
pub(super) fn write<'b>(
    id: Id,
    code: u8,
    parts: &[&[u8]],
    out: &'b mut [u8],
) -> Result<&'b mut [u8], EncodeError> {
    let mut writer = begin(out, id, code)?;
    parts.iter().try_for_each(|part| writer.append(part))?;
    finish(writer)
}

/// Begins a packet without parameters.
pub(super) fn begin(out: &mut [u8], id: Id, code: u8) -> Result<Writer<'_>, EncodeError> {
    Writer::new(out, &[START[0], START[1], id.number(), 0, code], MAX_PACKET)
}

/// Writes LEN and checksum.
pub(super) fn finish(writer: Writer<'_>) -> Result<&mut [u8], EncodeError> {
    let len = u8::try_from(writer.params().saturating_add(COUNTED));
    writer.finish(LEN, &[len.map_err(|_| EncodeError::TooLong)?])
}

/// A packet that is being written where it will be sent from: `FF FF` in front, and behind it the
/// complement of the sum. The servo bus and the CM-5's link to its PC have that in common.
pub(crate) struct Writer<'b> {
    out: &'b mut [u8],
    header: usize,
    end: usize,
    max: usize,
}

impl<'b> Writer<'b> {
    /// Begins a packet of at most `max` bytes.
    pub(crate) fn new(out: &'b mut [u8], header: &[u8], max: usize) -> Result<Self, EncodeError> {
        let mut writer = Self { out, header: header.len(), end: 0, max };
        writer.append(header)?;
        Ok(writer)
    }

    /// Bytes behind the header.
    pub(crate) fn params(&self) -> usize {
        self.end.saturating_sub(self.header)
    }

    /// Appends these bytes.
    pub(crate) fn append(&mut self, bytes: &[u8]) -> Result<(), EncodeError> {
        self.room(bytes.len()).map(|room| room.copy_from_slice(bytes))
    }

    /// Room for the next `count` bytes, to be filled by the caller. After an error the packet is as
    /// it was.
    pub(crate) fn room(&mut self, count: usize) -> Result<&mut [u8], EncodeError> {
        let (begin, end) = (self.end, self.end.saturating_add(count));
        if end >= self.max {
            return Err(EncodeError::TooLong);
        }
        // One more, for the checksum.
        let room = self.out.get_mut(begin..=end).ok_or(EncodeError::BufferTooShort)?;
        self.end = end;
        room.get_mut(..count).ok_or(EncodeError::BufferTooShort)
    }

    /// Writes the length at its place, and the checksum.
    pub(crate) fn finish(self, at: usize, len: &[u8]) -> Result<&'b mut [u8], EncodeError> {
        let packet = self.out.get_mut(..=self.end).ok_or(EncodeError::BufferTooShort)?;
        packet.iter_mut().skip(at).zip(len).for_each(|(to, from)| *to = *from);
        if let Some((checksum, before)) = packet.split_last_mut() {
            *checksum = !sum(before.get(START.len()..).unwrap_or_default());
        }
        Ok(packet)
    }
}

/// Whether it begins with `FF FF`, and its checksum is right.
pub(crate) fn sums_up(packet: &[u8]) -> bool {
    packet.strip_prefix(&START).is_some_and(|body| sum(body) == 0xFF)
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
        assert_eq!(Packet::parse(&packet), Some(Packet { id, code: 0, params: &[] }));
        assert_eq!(Packet::parse(&packet[..5]), None);
        assert_eq!(Packet::received(&packet), Packet::parse(&packet));
        assert_eq!(Packet::received(&packet[..5]), None);
        assert!(Dynamixel::is_intact(&packet));
        assert!(!Dynamixel::is_intact(&[0xFF, 0xFF, 0x00, 0x02, 0x00, 0xFC]));
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
