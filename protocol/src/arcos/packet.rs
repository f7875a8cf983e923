//! The packet, alike in both directions: `FA FB | count | id | data | checksum`.
//!
//! `count` is what follows itself, checksum included. What a host sends carries a command's number
//! in `id` and at most one [`Argument`] as data; what a robot sends is a *server information
//! packet* (SIP) whose data depends on `id`. Source: facts, "Packets".

use crate::data::{Data, EncodeError, Field, append};
use crate::deframe::{Deframer, Framing};

/// What every packet begins with.
pub const START: [u8; 2] = [0xFA, 0xFB];

/// Where the fields stand, in bytes from the start of the packet.
const COUNT: usize = 2;
const ID: usize = 3;
const DATA: usize = 4;
/// Bytes of the checksum, high byte first.
const CHECKSUM: usize = 2;

/// Bytes of a packet that are not data: start 2, count, id, checksum 2.
pub const OVERHEAD: usize = DATA + CHECKSUM;
/// Bytes of a packet that `count` does not count: start 2, count.
const NOT_COUNTED: usize = ID;
/// The counts that exist: from an id and its checksum to what the original robots accept.
const COUNTS: core::ops::RangeInclusive<usize> = 3..=249;
/// The longest packet that is accepted.
pub const MAX_RECEIVED: usize = NOT_COUNTED + 249;
/// The longest packet that is sent; hosts accept no more from a robot.
pub const MAX_SENT: usize = 200;
/// The longest data of a packet that is sent.
pub const MAX_DATA: usize = MAX_SENT - OVERHEAD;

/// The sum of the 16-bit words from the id on, high byte first, modulo 2^16; an odd last byte is
/// XORed into the low byte.
fn checksum(counted: &[u8]) -> u16 {
    let (words, odd) = counted.as_chunks::<2>();
    let sum = words.iter().fold(0u16, |sum, &word| sum.wrapping_add(u16::from_be_bytes(word)));
    odd.iter().fold(sum, |sum, &byte| sum ^ u16::from(byte))
}

/// The receiver's view of the packet.
pub enum Arcos {}

impl Framing for Arcos {
    const START: [u8; 2] = START;
    const HEADER: usize = ID;

    fn length(header: &[u8]) -> Option<usize> {
        let count = usize::from(*header.get(COUNT)?);
        COUNTS.contains(&count).then(|| count.saturating_add(NOT_COUNTED))
    }

    fn is_intact(candidate: &[u8]) -> bool {
        candidate
            .get(ID..)
            .and_then(<[u8]>::split_last_chunk::<CHECKSUM>)
            .is_some_and(|(counted, sum)| checksum(counted) == u16::from_be_bytes(*sum))
    }
}

/// Finds ARCOS packets in a stream of bytes.
pub type Receiver = Deframer<Arcos, MAX_RECEIVED>;

/// A packet's fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Packet<'a> {
    /// A command's number, or what kind of server information packet it is.
    pub id: u8,
    /// At most [`MAX_DATA`] bytes where it is to be sent.
    pub data: &'a [u8],
}

impl<'a> Packet<'a> {
    /// Takes an intact packet apart, as [`Receiver`] hands it out. `None` if it is too short to be
    /// one; the checksum is the receiver's business.
    pub fn parse(packet: &'a [u8]) -> Option<Self> {
        let (counted, _checksum) = packet.get(ID..)?.split_last_chunk::<CHECKSUM>()?;
        let (&id, data) = counted.split_first()?;
        Some(Self { id, data })
    }

    /// Writes the packet into `out` and answers the part it took.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`], [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let total = self.data.len().saturating_add(OVERHEAD);
        if total > MAX_SENT {
            return Err(EncodeError::TooLong);
        }
        let packet = out.get_mut(..total).ok_or(EncodeError::BufferTooShort)?;
        let count = total.saturating_sub(NOT_COUNTED);
        let count = u8::try_from(count).map_err(|_| EncodeError::TooLong)?;
        // The lengths agree by construction: header + data + checksum = total.
        if let Some((head, rest)) = packet.split_first_chunk_mut::<DATA>()
            && let Some((data, sum)) = rest.split_last_chunk_mut::<CHECKSUM>()
        {
            *head = [START[0], START[1], count, self.id];
            data.iter_mut().zip(self.data).for_each(|(to, from)| *to = *from);
            *sum = [0; CHECKSUM];
        }
        let sum = packet.get(ID..total.saturating_sub(CHECKSUM)).map_or(0, checksum);
        if let Some(at) = packet.last_chunk_mut::<CHECKSUM>() {
            *at = sum.to_be_bytes();
        }
        Ok(packet)
    }
}

/// What stands before an argument's value.
mod kind {
    pub const POSITIVE: u8 = 0x3B;
    pub const NEGATIVE: u8 = 0x1B;
    pub const TEXT: u8 = 0x2B;
}

/// A command's argument. Integers are sent as sign and magnitude, low byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Argument<'a> {
    /// An integer that is not negative.
    Positive(u16),
    /// A negative integer; this is its magnitude.
    Negative(u16),
    /// Text, or any bytes: 192 at the most where they are to be sent.
    Text(&'a [u8]),
}

/// Data that is neither empty nor one whole argument: an unknown type, a value cut short, or bytes
/// behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BadArgument;

impl<'a> Argument<'a> {
    /// Reads a command's data. A type with no value behind it counts as no argument: hosts exist
    /// that send it so.
    pub fn parse(data: &'a [u8]) -> Result<Option<Self>, BadArgument> {
        match *data {
            [] | [kind::POSITIVE | kind::NEGATIVE | kind::TEXT] => Ok(None),
            [kind::POSITIVE, low, high] => {
                Ok(Some(Self::Positive(u16::from_le_bytes([low, high]))))
            }
            [kind::NEGATIVE, low, high] => {
                Ok(Some(Self::Negative(u16::from_le_bytes([low, high]))))
            }
            [kind::TEXT, length, ref text @ ..] if text.len() == usize::from(length) => {
                Ok(Some(Self::Text(text)))
            }
            _ => Err(BadArgument),
        }
    }

    fn emit(&self, data: &mut Data) -> Result<(), EncodeError> {
        match self {
            Self::Positive(value) => kind::POSITIVE.put(data).and_then(|()| value.put(data)),
            Self::Negative(value) => kind::NEGATIVE.put(data).and_then(|()| value.put(data)),
            Self::Text(text) => {
                let length = u8::try_from(text.len()).map_err(|_| EncodeError::TooLong)?;
                append(data, &[kind::TEXT, length])?;
                append(data, text)
            }
        }
    }
}

/// Writes a command's packet into `out` and answers the part it took.
pub fn encode_command<'b>(
    number: u8,
    argument: Option<Argument<'_>>,
    out: &'b mut [u8],
) -> Result<&'b mut [u8], EncodeError> {
    let mut data = Data::new();
    if let Some(argument) = argument {
        argument.emit(&mut data)?;
    }
    Packet { id: number, data: &data }.encode(out)
}

/// Appends a text and the NUL that ends it.
pub(super) fn append_text(data: &mut Data, text: &str) -> Result<(), EncodeError> {
    if text.as_bytes().contains(&0) {
        return Err(EncodeError::NulInText);
    }
    append(data, text.as_bytes())?;
    append(data, &[0])
}

/// Takes a text and the NUL behind it from the front of `data`.
pub(super) fn take_text<'a>(data: &mut &'a [u8]) -> Option<&'a str> {
    let end = data.iter().position(|&byte| byte == 0)?;
    let (text, rest) = data.split_at_checked(end)?;
    *data = rest.get(1..)?;
    core::str::from_utf8(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_of_200_bytes_is_sent_and_one_of_201_is_not() {
        let mut out = [0; 300];
        let packet = |data| Packet { id: 1, data };
        assert_eq!(packet(&[0; 194]).encode(&mut out).unwrap().len(), 200);
        assert_eq!(packet(&[0; 195]).encode(&mut out), Err(EncodeError::TooLong));
        assert_eq!(packet(&[0; 4]).encode(&mut out[..9]), Err(EncodeError::BufferTooShort));
    }
}
