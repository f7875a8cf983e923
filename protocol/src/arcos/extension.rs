//! What this implementation adds to ARCOS: settings, health, faults and upkeep of the board.
//!
//! It is the [extension](crate::extension) in ARCOS packets, off ARCOS's map: a
//! host that never sends one sees an original. What is around requests and answers stands on the
//! [page of the wire](crate#the-extension-in-arcos).

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
