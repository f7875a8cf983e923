//! What this implementation adds to ARCOS: settings, health, faults and upkeep of the board.
//!
//! It is the [extension](crate::extension) in ARCOS packets, off ARCOS's map: a
//! host that never sends one sees an original. Requests and answers, their bytes, verdicts and
//! units are those of Tables E.1 and E.2 there, and so is when one is busy or finds no room; only
//! what is around them differs. A request counts in an open session only, and is a sign of life,
//! but no arm command. It has one answer; health (98) comes at once, and then once a cycle.
//!
//! | command | argument: `2B`, length, and these bytes | answer: packet |
//! |---|---|---|
//! | 96 | DATA of DID 96: number of a setting (2 bytes) | 96, or 101 |
//! | 97 | none: who are you? | 97 |
//! | 98 | DATA of DID 98: health N times (1 byte), 0 is stop; none is continuously, one a cycle | 98 |
//! | 99 | none: counters | 99 |
//! | 100 | DATA of DID 100: place of a latched fault (1 byte) | 100, or 101 |
//! | 101 | DATA of DID 7 from sub-command 0x80 on: set settings (`[0x80 + number + value]+`, 34 of them at most), clear faults (`0x81`), save, reset, reboot, set an encoder's count (`0x86`) | 101 |
//! | 103 | none: what was refused, by reason | 103 |
//!
//! The machine state (102) and the recorder (104, 105) are not carried: an arm drives no DC channel, and
//! ARMpac tells its joints.
//!
//! "None" is no argument, or a text of no bytes; an argument of another type is refused as one of a
//! bad length. An answer's data are the DATA of the answer of that DID, and in an outcome (101) the
//! first byte is the DID: 7 for what command 101 has asked.
//!
//! | packet | bytes |
//! |---|---|
//! | read setting 32 | `FA FB 07 60 2B 02 20 00 62 4B` |
//! | save | `FA FB 06 65 2B 01 82 66 AD` |
//! | saved | `FA FB 08 65 07 82 00 00 00 E7 07` |
//!
//! Of the counters (99) those of the PMS5005's pings, acknowledgements, pictures and other devices
//! stay 0; "unknown" are commands that are not the arm's, "refused" those that were refused or
//! ignored.

use super::packet::{Argument, OVERHEAD, Packet, encode_command};
use crate::data::{Data, EncodeError};
use crate::extension::{Answer, Counters, Outcome, Request, Verdict, did};

/// The command whose argument is DATA of DID 7.
const CHANGE: u8 = did::OUTCOME;

/// Bytes of the longest answer: the counters.
pub const MAX_ANSWER: usize = OVERHEAD + size_of::<Counters>();

/// What a command asks of the extension, or what it is told because it asks nothing; `None` if it
/// is not the extension's.
pub fn parse_request<'a>(packet: &Packet<'a>) -> Option<Result<Request<'a>, Outcome>> {
    let did = match packet.id {
        CHANGE => did::PARAMETERS,
        did::SETTING..=did::FAULT | did::REFUSALS => packet.id,
        _ => return None,
    };
    let data = match Argument::parse(packet.data) {
        Ok(None) => &[],
        Ok(Some(Argument::Text(data))) => data,
        _ => return Some(Err(Outcome::of(did, &[], Verdict::BadLength))),
    };
    Some(match Request::parse(did, data) {
        Some(Ok(request)) => Ok(request),
        Some(Err(verdict)) => Err(Outcome::of(did, data, verdict)),
        // The manual's sub-commands of DID 7 are not an arm's.
        None => Err(Outcome::of(did, data, Verdict::Unknown)),
    })
}

/// Writes a request's packet into `out` and answers the part it took.
///
/// # Errors
/// [`EncodeError::TooLong`] for more than 27 settings at once, [`EncodeError::NotRepresentable`] for the
/// machine state and the recorder, [`EncodeError::BufferTooShort`].
pub fn encode_request<'b>(
    request: &Request<'_>,
    out: &'b mut [u8],
) -> Result<&'b mut [u8], EncodeError> {
    let not_carried = [did::STATE, did::RECORDING, did::BLOCK];
    if not_carried.contains(&request.did()) {
        return Err(EncodeError::NotRepresentable);
    }
    let mut data = Data::new();
    request.emit(&mut data).map_err(|_| EncodeError::TooLong)?;
    let number = match request.did() {
        did::PARAMETERS => CHANGE,
        did => did,
    };
    encode_command(number, Some(Argument::Text(&data)), out)
}

/// Writes an answer's packet into `out` and answers the part it took: 78 bytes at the most.
/// [`Answer::parse`] reads it, from id and data.
///
/// # Errors
/// [`EncodeError::BufferTooShort`], and [`EncodeError::NotRepresentable`] where
/// [`Answer::emit`] says so.
pub fn encode_answer<'b>(
    answer: &Answer<'_>,
    out: &'b mut [u8],
) -> Result<&'b mut [u8], EncodeError> {
    let mut data = Data::new();
    answer.emit(&mut data).map_err(|_| EncodeError::NotRepresentable)?;
    Packet { id: answer.did(), data: &data }.encode(out)
}
