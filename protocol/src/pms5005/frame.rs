//! The frame: `5E 02 | RID | RES | DID | LEN | DATA[LEN] | CRC | 5E 0D` (manual section II).
//!
//! There is no byte stuffing: DATA may hold both marks, so the length rules, never a search for
//! the end mark. [`Receiver`] finds frames in a stream; [`Frame`] is one of them, taken apart.

use crc::{CRC_8_MAXIM_DOW, Crc, Table};

use crate::data::EncodeError;
use crate::deframe::{Deframer, Framing};

/// Start of transmission (section II.1).
pub const STX: [u8; 2] = [0x5E, 0x02];
/// End of transmission (section II.5).
pub const ETX: [u8; 2] = [0x5E, 0x0D];

/// Where the fields stand, in bytes from the start of the frame (section II).
const RID: usize = 2;
const RES: usize = 3;
const DID: usize = 4;
const LEN: usize = 5;
pub(super) const DATA: usize = 6;

/// Bytes of a frame that are not DATA: STX 2, RID, RES, DID, LEN, CRC, ETX 2.
pub const OVERHEAD: usize = 9;
/// The longest DATA that LEN can tell.
pub const MAX_DATA: usize = 255;
/// The longest frame.
pub const MAX_FRAME: usize = OVERHEAD + MAX_DATA;

/// The checksum over RID to DATA. The code of Figure II.1 is CRC-8/MAXIM: x^8 + x^5 + x^4 + 1,
/// reflected (0x8C), initial value 0.
const CRC: Crc<u8, Table<1>> = Crc::<u8, Table<1>>::new(&CRC_8_MAXIM_DOW);

/// RID of the host (section II.2).
pub const RID_HOST: u8 = 0;
/// RID of the PMS5005 (section II.2).
pub const RID_PMS5005: u8 = 1;
/// The RES value that asks for no acknowledgement (section III), and that telemetry carries.
pub const RES_NO_ACK: u8 = 255;

/// The receiver's view of the frame.
pub enum Pms5005 {}

impl Framing for Pms5005 {
    const START: [u8; 2] = STX;
    const HEADER: usize = DATA;

    fn length(header: &[u8]) -> Option<usize> {
        let len = *header.get(LEN)?;
        usize::from(len).checked_add(OVERHEAD)
    }

    fn is_intact(candidate: &[u8]) -> bool {
        candidate.split_last_chunk::<3>().is_some_and(|(body, [crc, end @ ..])| {
            *end == ETX && CRC.checksum(body.get(RID..).unwrap_or_default()) == *crc
        })
    }
}

/// Finds PMS5005 frames in a stream of bytes.
pub type Receiver = Deframer<Pms5005, MAX_FRAME>;

/// A frame's fields. What they mean is [`Command`](super::Command)'s and
/// [`Report`](super::Report)'s business.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Frame<'a> {
    /// Robot ID: whom the frame is for.
    pub rid: u8,
    /// The reserved byte: 255 asks for no acknowledgement.
    pub res: u8,
    /// Data ID: what DATA holds.
    pub did: u8,
    /// 0 to 255 bytes.
    pub data: &'a [u8],
}

impl<'a> Frame<'a> {
    /// Takes an intact frame apart, as [`Receiver`] hands it out. `None` if it is too short for its DATA;
    /// what is behind that is the receiver's business.
    pub fn parse(frame: &'a [u8]) -> Option<Self> {
        let len = usize::from(*frame.get(LEN)?);
        Some(Self {
            rid: *frame.get(RID)?,
            res: *frame.get(RES)?,
            did: *frame.get(DID)?,
            data: frame.get(DATA..)?.get(..len)?,
        })
    }

    /// Writes the frame into `out` and answers the part it took.
    ///
    /// # Errors
    /// [`EncodeError::TooLong`], [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let len = u8::try_from(self.data.len()).map_err(|_| EncodeError::TooLong)?;
        let total = self.data.len().saturating_add(OVERHEAD);
        let frame = out.get_mut(..total).ok_or(EncodeError::BufferTooShort)?;
        let header = [STX[0], STX[1], self.rid, self.res, self.did, len];
        // The lengths agree by construction: header + data + crc + ETX = total.
        if let Some((head, rest)) = frame.split_at_mut_checked(header.len())
            && let Some((data, _tail)) = rest.split_at_mut_checked(self.data.len())
        {
            head.copy_from_slice(&header);
            data.copy_from_slice(self.data);
        }
        seal(frame);
        Ok(frame)
    }
}

/// Writes checksum and end mark over the last three bytes of a frame.
pub(super) fn seal(frame: &mut [u8]) {
    if let Some((body, tail)) = frame.split_last_chunk_mut::<3>() {
        let crc = CRC.checksum(body.get(RID..).unwrap_or_default());
        *tail = [crc, ETX[0], ETX[1]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The C code of Figure II.1, transcribed.
    fn figure_ii_1(bytes: &[u8]) -> u8 {
        bytes.iter().fold(0, |register, &byte| {
            (0..8).fold(register, |register, bit| {
                let feedback = (register ^ (byte >> bit)) & 1;
                (register >> 1) ^ (feedback * 0x8C)
            })
        })
    }

    #[test]
    fn the_checksum_is_that_of_figure_ii_1() {
        let bytes: Vec<u8> = (0..=255).collect();
        for start in 0..256 {
            assert_eq!(CRC.checksum(&bytes[start..]), figure_ii_1(&bytes[start..]));
        }
    }

    #[test]
    fn a_buffer_one_byte_short_is_an_error() {
        let frame = Frame { rid: 0, res: 0, did: 255, data: &[1] };
        assert_eq!(frame.encode(&mut [0; 9]), Err(EncodeError::BufferTooShort));
        assert_eq!(
            Frame { data: &[0; 256], ..frame }.encode(&mut [0; 300]),
            Err(EncodeError::TooLong)
        );
    }
}
