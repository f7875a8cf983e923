//! Frames found in a stream of bytes, and the checksums that this rests on.
//!
//! Two frames of the PMS5005: the longest that hosts send (DID 23, 74 bytes) and a typical one
//! (DID 28, 12 bytes), whole and in chunks, and behind noise. Whoever receives must answer the
//! fields RID, RES, DID and DATA of an intact frame.

mod peers;

use core::hint::black_box;

use crc::{CRC_8_MAXIM_DOW, Crc, NoTable, Table};
use protocol::arcos;
use protocol::dynamixel::{Id, Packet, StatusReceiver};
use protocol::pms5005::{Frame, Receiver, STX};

use crate::Meter;

/// The longest frame of these cases.
const LONGEST: usize = 74;

/// What a receiver has found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fields<'a> {
    rid: u8,
    res: u8,
    did: u8,
    data: &'a [u8],
}

/// Somebody's way to find frames.
trait Receive {
    /// Takes a chunk of the stream, and hands `found` every frame that is complete.
    fn receive(&mut self, chunk: &[u8], found: impl FnMut(Fields<'_>));
}

/// Ours.
struct Ours(Receiver);

impl Receive for Ours {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        while let Some(frame) = self.0.receive(&mut chunk) {
            if let Some(Frame { rid, res, did, data }) = Frame::parse(frame) {
                found(Fields { rid, res, did, data });
            }
        }
    }
}

/// DATA of the two frames.
const LONG: [u8; 65] = {
    let mut data = [0; 65];
    let mut i = 1;
    while i < data.len() {
        data[i] = (i * 7) as u8; // any pattern
        i += 1;
    }
    data
};
const TYPICAL: [u8; 3] = [2, 0xB8, 0x0B];

/// A frame with this DID and DATA, whole.
fn encode<'b>(did: u8, data: &[u8], out: &'b mut [u8; LONGEST]) -> &'b [u8] {
    Frame { rid: 1, res: 0, did, data }.encode(out).map_or(&[], |frame| frame)
}

/// All cases; the unit is a byte, of the noise a byte of noise and frame.
pub fn cases(meter: &mut impl Meter) {
    let mut buffer = [0; LONGEST];
    let long = encode(23, &LONG, &mut buffer);
    case(meter, "receive-74-whole/ours", long, usize::MAX, Ours(Receiver::new()));
    case(meter, "receive-74-by-64/ours", long, 64, Ours(Receiver::new()));
    case(meter, "receive-74-by-7/ours", long, 7, Ours(Receiver::new()));
    case(meter, "receive-74-by-1/ours", long, 1, Ours(Receiver::new()));
    case(meter, "receive-74-whole/machine-called", long, usize::MAX, peers::Called::default());
    case(meter, "receive-74-whole/machine-inlined", long, usize::MAX, peers::Inlined::default());
    case(meter, "receive-74-by-7/machine-inlined", long, 7, peers::Inlined::default());
    case(meter, "receive-74-by-1/machine-inlined", long, 1, peers::Inlined::default());
    case(meter, "receive-74-by-1/append-alone", long, 1, peers::Append::new(long.len()));
    case(meter, "receive-74-whole/scan", long, usize::MAX, peers::Scan);
    let mut cobs = [0; 2 * LONGEST];
    let long = peers::cobs(&LONG, &mut cobs);
    case(meter, "receive-74-whole/postcard", long, usize::MAX, peers::Postcard::default());
    case(meter, "receive-74-by-1/postcard", long, 1, peers::Postcard::default());

    let typical = encode(28, &TYPICAL, &mut buffer);
    case(meter, "receive-12-whole/ours", typical, usize::MAX, Ours(Receiver::new()));
    case(meter, "receive-12-by-7/ours", typical, 7, Ours(Receiver::new()));
    case(meter, "receive-12-by-1/ours", typical, 1, Ours(Receiver::new()));
    case(meter, "receive-12-whole/machine-called", typical, usize::MAX, peers::Called::default());
    case(meter, "receive-12-whole/machine-inlined", typical, usize::MAX, peers::Inlined::default());
    case(meter, "receive-12-by-1/machine-inlined", typical, 1, peers::Inlined::default());
    case(meter, "receive-12-whole/scan", typical, usize::MAX, peers::Scan);
    let mut cobs = [0; 2 * LONGEST];
    let typical = peers::cobs(&TYPICAL, &mut cobs);
    case(meter, "receive-12-whole/postcard", typical, usize::MAX, peers::Postcard::default());

    noise(meter);
    servo(meter);
    arm(meter);
    checksums(meter);
}

/// The answer of an AX-12 to READ of its eight present values, beside the sum that it is checked
/// by.
fn servo(meter: &mut impl Meter) {
    let params = [0x00, 0x02, 0x20, 0x00, 0x10, 0x00, 0x78, 0x1E];
    let mut buffer = [0; 14];
    let status = Packet { id: Id::BROADCAST, code: 0, params: &params }.encode(&mut buffer);
    let status: &[u8] = status.map_or(&[], |status| status);
    case(meter, "receive-ax12-whole/ours", status, usize::MAX, Servo(StatusReceiver::new()));
    case(meter, "receive-ax12-by-1/ours", status, 1, Servo(StatusReceiver::new()));
    meter.case("receive-ax12-whole/sum-alone", status.len(), || {
        let body = black_box(status).get(2..).unwrap_or_default();
        black_box(body.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte)));
    });
}

/// An ARCOS command with a number, as hosts send for every joint: 9 bytes.
fn arm(meter: &mut impl Meter) {
    let mut buffer = [0; 9];
    let command = arcos::Packet { id: 74, data: &[0x3B, 0x80, 0x01] }.encode(&mut buffer);
    let command: &[u8] = command.map_or(&[], |command| command);
    case(meter, "receive-arcos-whole/ours", command, usize::MAX, Arm(arcos::Receiver::new()));
    case(meter, "receive-arcos-by-1/ours", command, 1, Arm(arcos::Receiver::new()));
}

/// Ours, for ARCOS.
struct Arm(arcos::Receiver);

impl Receive for Arm {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        while let Some(packet) = self.0.receive(&mut chunk) {
            if let Some(arcos::Packet { id, data }) = arcos::Packet::parse(packet) {
                found(Fields { rid: 0, res: 0, did: id, data });
            }
        }
    }
}

/// Ours, for the servo bus.
struct Servo(StatusReceiver);

impl Receive for Servo {
    fn receive(&mut self, mut chunk: &[u8], mut found: impl FnMut(Fields<'_>)) {
        while let Some(packet) = self.0.receive(&mut chunk) {
            if let Ok(Packet { id, code, params }) = Packet::parse(packet) {
                found(Fields { rid: id.number(), res: 0, did: code, data: params });
            }
        }
    }
}

/// Noise: bytes of all values but the first of a start mark, and one start mark with a length that
/// holds up the frame behind it until it is rejected.
fn noise(meter: &mut impl Meter) {
    let mut stream = [0; 64 + 32 + LONGEST];
    let (noise, rest) = stream.split_at_mut(64);
    for (i, byte) in noise.iter_mut().enumerate() {
        *byte = (i * 3) as u8 | 0x80; // any pattern above 0x5E
    }
    let (false_start, frame) = rest.split_at_mut(32);
    false_start[..6].copy_from_slice(&[STX[0], STX[1], 1, 0, 28, 40]);
    let mut buffer = [0; LONGEST];
    frame.copy_from_slice(encode(23, &LONG, &mut buffer));
    case(meter, "receive-noise-whole/ours", &stream, usize::MAX, Ours(Receiver::new()));
    case(meter, "receive-noise-by-7/ours", &stream, 7, Ours(Receiver::new()));
    case(meter, "receive-noise-whole/scan", &stream, usize::MAX, peers::Scan);
}

fn case(
    meter: &mut impl Meter,
    name: &str,
    stream: &[u8],
    chunk: usize,
    mut receiver: impl Receive,
) {
    meter.case(name, stream.len(), || {
        for chunk in black_box(stream).chunks(chunk) {
            receiver.receive(chunk, |fields| _ = black_box(fields));
        }
    });
}

/// The checksum of Figure II.1 over what it covers of both frames: RID to DATA.
fn checksums(meter: &mut impl Meter) {
    const TABLE_1: Crc<u8, Table<1>> = Crc::<u8, Table<1>>::new(&CRC_8_MAXIM_DOW);
    const TABLE_16: Crc<u8, Table<16>> = Crc::<u8, Table<16>>::new(&CRC_8_MAXIM_DOW);
    const NO_TABLE: Crc<u8, NoTable> = Crc::<u8, NoTable>::new(&CRC_8_MAXIM_DOW);
    let mut buffer = [0; LONGEST];
    for (did, data, names) in [
        (
            23,
            &LONG[..],
            ["crc-74/crc-table-1", "crc-74/crc-table-16", "crc-74/crc", "crc-74/bitwise"],
        ),
        (
            28,
            &TYPICAL,
            ["crc-12/crc-table-1", "crc-12/crc-table-16", "crc-12/crc", "crc-12/bitwise"],
        ),
    ] {
        let frame = encode(did, data, &mut buffer);
        let body = &frame[STX.len()..frame.len() - 3];
        let mut case = |name, checksum: fn(&[u8]) -> u8| {
            meter.case(name, body.len(), || _ = black_box(checksum(black_box(body))));
        };
        case(names[0], |body| TABLE_1.checksum(body));
        case(names[1], |body| TABLE_16.checksum(body));
        case(names[2], |body| NO_TABLE.checksum(body));
        case(names[3], peers::figure_ii_1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finds(name: &str, mut receiver: impl Receive, stream: &[u8], data: &[u8]) {
        for chunk in [1, 7, 64, usize::MAX] {
            for round in 0..2 {
                let mut count = 0;
                for chunk in stream.chunks(chunk) {
                    receiver.receive(chunk, |fields| {
                        assert_eq!(fields.data, data, "{name}");
                        count += 1;
                    });
                }
                assert_eq!(count, 1, "{name} in chunks of {chunk}, round {round}");
            }
        }
    }

    #[test]
    fn everyone_finds_the_frame_in_chunks_of_any_size() {
        for (did, data) in [(23, &LONG[..]), (28, &TYPICAL)] {
            let mut buffer = [0; LONGEST];
            let frame = encode(did, data, &mut buffer);
            assert_eq!(frame.len(), data.len() + 9);
            finds("ours", Ours(Receiver::new()), frame, data);
            finds("machine-called", peers::Called::default(), frame, data);
            finds("machine-inlined", peers::Inlined::default(), frame, data);
            let mut cobs = [0; 2 * LONGEST];
            finds("postcard", peers::Postcard::default(), peers::cobs(data, &mut cobs), data);
            let mut count = 0;
            peers::Scan.receive(frame, |fields| {
                assert_eq!(fields.data, data);
                count += 1;
            });
            assert_eq!(count, 1, "scan, which knows whole frames only");
        }
    }

    #[test]
    fn the_other_receivers_find_their_packets_too() {
        let (mut servo, mut arm) = ([0; 14], [0; 9]);
        let status = Packet { id: Id::BROADCAST, code: 0, params: &[1; 8] };
        finds("servo", Servo(StatusReceiver::new()), status.encode(&mut servo).unwrap(), &[1; 8]);
        let command = arcos::Packet { id: 74, data: &[0x3B, 1, 0] }.encode(&mut arm).unwrap();
        finds("arm", Arm(arcos::Receiver::new()), command, &[0x3B, 1, 0]);
    }

    #[test]
    fn nobody_takes_a_damaged_frame_but_postcard_which_has_no_checksum() {
        let mut buffer = [0; LONGEST];
        let mut frame = encode(23, &LONG, &mut buffer).to_vec();
        frame[20] ^= 1;
        fn refuses(mut receiver: impl Receive, frame: &[u8]) {
            receiver.receive(frame, |fields| panic!("{fields:?}"));
        }
        refuses(Ours(Receiver::new()), &frame);
        refuses(peers::Called::default(), &frame);
        refuses(peers::Inlined::default(), &frame);
        refuses(peers::Scan, &frame);
    }
}
