//! The packet: `FF FF LenH LenL Param1..ParamN CHK`, where Len = N, high byte first, and CHK is
//! the complement of the sum of all bytes from LenH on.

use super::MAX_SERVOS;
use super::message::ServoGoal;
use crate::deframe::{Deframer, Framing};
use crate::dynamixel::{EncodeError, Writer, sums_up};

/// What begins every packet.
const START: [u8; 2] = [0xFF, 0xFF];
/// Where the fields stand, in bytes from the start of the packet.
const LEN: usize = 2;
const PARAMS: usize = 4;

/// Bytes of a packet that are not parameters: start 2, Len 2, CHK.
pub const OVERHEAD: usize = 5;
/// The longest packet: goals for [`MAX_SERVOS`]. Len could tell of 65,535 parameters.
pub const MAX_PACKET: usize = OVERHEAD + ServoGoal::BYTES * MAX_SERVOS;

/// The receiver's view of the packet.
pub enum Cm5 {}

impl Framing for Cm5 {
    const START: [u8; 2] = START;
    const HEADER: usize = PARAMS;

    fn length(header: &[u8]) -> Option<usize> {
        let len = header.get(LEN..)?.first_chunk()?;
        usize::from(u16::from_be_bytes(*len)).checked_add(OVERHEAD)
    }

    fn is_intact(candidate: &[u8]) -> bool {
        sums_up(candidate)
    }
}

/// Finds packets in a stream; nothing is longer than [`MAX_PACKET`].
pub type Receiver = Deframer<Cm5, MAX_PACKET>;

/// The parameters of an intact packet, as [`Receiver`] hands it out. `None` if it is too short to
/// be one; the checksum is the receiver's business.
pub fn params_of(packet: &[u8]) -> Option<&[u8]> {
    packet.get(PARAMS..)?.split_last().map(|(_checksum, params)| params)
}

/// Writes a packet, whose parameters come in parts, into `out` and answers the part it took.
pub fn encode(
    parts: impl IntoIterator<Item: AsRef<[u8]>>,
    out: &mut [u8],
) -> Result<&mut [u8], EncodeError> {
    let mut writer = Writer::new(out, &[START[0], START[1], 0, 0], MAX_PACKET)?;
    parts.into_iter().try_for_each(|part| writer.append(part.as_ref()))?;
    let len = u16::try_from(writer.params()).map_err(|_| EncodeError::TooLong)?;
    writer.finish(LEN, &len.to_be_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_the_low_byte_of_the_complemented_sum() {
        // NOT(0x00 + 0x03 + 0x02 + 0x01 + 0x02) = NOT 0x08.
        let bytes = [0xFF, 0xFF, 0x00, 0x03, 0x02, 0x01, 0x02, 0xF7];
        assert_eq!(encode([[2, 1, 2]], &mut [0; 8]).unwrap(), bytes);
        assert_eq!(params_of(&bytes), Some(&[2, 1, 2][..]));

        // Len counts in the sum, both bytes of it: NOT(0x01 + 0x02 + 258 * 0xFF).
        let mut buffer = [0; MAX_PACKET];
        let bytes = encode([[0xFF; 258]], &mut buffer).unwrap();
        assert_eq!((&bytes[..4], bytes[262]), (&[0xFF, 0xFF, 1, 2][..], 0xFE));
        assert_eq!(Receiver::new().receive(&mut &*bytes), Some(&*bytes));
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let longest = [[0; MAX_PACKET - OVERHEAD]];
        assert_eq!(encode(longest, &mut [0; MAX_PACKET]).unwrap().len(), MAX_PACKET);
        assert_eq!(encode(longest, &mut [0; MAX_PACKET - 1]), Err(EncodeError::BufferTooShort));
        let too_long = [[0; MAX_PACKET - OVERHEAD + 1]];
        assert_eq!(encode(too_long, &mut [0; 2 * MAX_PACKET]), Err(EncodeError::TooLong));
        assert_eq!(encode([[]; 1], &mut [0; 4]), Err(EncodeError::BufferTooShort));
    }
}
