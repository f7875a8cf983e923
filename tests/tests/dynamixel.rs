//! Properties of the Dynamixel packets: what is written reads back; any bytes in any chunks neither
//! panic nor cost the good packet behind them.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use protocol::deframe::{Deframer, Reception};
use protocol::dynamixel::{
    Dynamixel, Errors, Id, Instruction, MAX_PACKET, MAX_PARAMS, MAX_STATUS, Packet, REGISTER_BYTES,
    StatusReceiver, SyncWriter,
};

/// Finds intact packets of any length.
type IntactReceiver = Deframer<Dynamixel, MAX_PACKET>;

/// What a receiver finds in these pieces and the silence after them, and what it counts.
fn hear<'a, const N: usize>(
    receiver: &mut Deframer<Dynamixel, N>,
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> (Vec<Vec<u8>>, Reception) {
    let mut packets = Vec::new();
    for mut piece in pieces {
        while let Some(packet) = receiver.receive(&mut piece) {
            packets.push(packet.to_vec());
        }
    }
    while let Some(packet) = receiver.give_up() {
        packets.push(packet.to_vec());
    }
    (packets, receiver.reception())
}

/// The packets of at most `longest` bytes in a stream, by the slowest method there is: try every
/// place. A packet has an ID other than 255, LEN counts the bytes behind it, and the bytes from ID
/// on add up to 255 with the checksum.
fn search(stream: &[u8], longest: usize) -> Vec<Vec<u8>> {
    let mut packets = Vec::new();
    let mut rest = stream;
    while !rest.is_empty() {
        let found = match rest {
            [0xFF, 0xFF, 0..=254, len @ 2..=255, ..] => rest.get(..usize::from(*len) + 4),
            _ => None,
        };
        let sum = |packet: &[u8]| packet[2..].iter().map(|byte| u32::from(*byte)).sum::<u32>();
        let found = found.filter(|packet| packet.len() <= longest && sum(packet) % 256 == 255);
        rest = &rest[found.map_or(1, <[u8]>::len)..];
        packets.extend(found.map(<[u8]>::to_vec));
    }
    packets
}

fn id() -> impl Strategy<Value = Id> {
    (0..=254u8).prop_map(|number| Id::new(number).unwrap())
}

/// Bytes among which those that begin a packet are frequent.
fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![2 => any::<u8>(), 1 => Just(0xFF)]
}

fn packet() -> impl Strategy<Value = Vec<u8>> {
    (id(), byte(), vec(byte(), 0..30)).prop_map(|(id, code, params)| {
        Packet { id, code, params: &params }.encode(&mut [0; MAX_PACKET]).unwrap().to_vec()
    })
}

/// A piece of a stream: a packet, one with a flipped bit or cut off, a false start, noise.
fn piece() -> impl Strategy<Value = Vec<u8>> {
    let flipped = (packet(), any::<Index>(), 0..8).prop_map(|(mut packet, at, bit)| {
        *at.get_mut(&mut packet) ^= 1u8 << bit;
        packet
    });
    let cut_off = (packet(), any::<Index>()).prop_map(|(p, at)| p[..at.index(p.len())].to_vec());
    let false_start = (any::<u8>(), any::<u8>()).prop_map(|(id, len)| vec![0xFF, 0xFF, id, len]);
    prop_oneof![3 => packet(), 2 => flipped, 1 => cut_off, 1 => false_start, 1 => vec(byte(), 0..40)]
}

/// What arrives after encoding and reception.
fn arrives(sent: &[u8]) -> Vec<u8> {
    let (mut packets, _) = hear(&mut IntactReceiver::new(), [sent]);
    assert_eq!(packets.len(), 1);
    packets.remove(0)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 4000, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn every_instruction_reads_back_as_it_was_written(
        id in id(),
        address: u8,
        count: u8,
        data in vec(byte(), 1..=MAX_PARAMS - 1),
    ) {
        for instruction in [
            Instruction::Ping,
            Instruction::Read { address, count },
            Instruction::Write { address, data: &data },
            Instruction::RegWrite { address, data: &data },
            Instruction::Action,
            Instruction::Reset,
        ] {
            let packet = arrives(instruction.encode(id, &mut [0; MAX_PACKET]).unwrap());
            let packet = Packet::parse(&packet).unwrap();
            prop_assert_eq!(packet.id, id);
            prop_assert_eq!(Instruction::parse(packet), Some(instruction));
        }
    }

    #[test]
    fn a_sync_write_gives_every_servo_its_own_bytes(
        address: u8,
        len in 1..=12u8,
        servos in vec((id(), [byte(), byte(), byte(), byte(), byte(), byte()]), 0..=19),
    ) {
        let data = |bytes: &[u8; 6]| bytes.repeat(2)[..usize::from(len)].to_vec();
        let mut buffer = [0; MAX_PACKET];
        let mut writer = SyncWriter::new(&mut buffer, address, len).unwrap();
        for (id, bytes) in &servos {
            writer.servo(*id).unwrap().copy_from_slice(&data(bytes));
        }
        let packet = arrives(writer.finish().unwrap());
        // FF FF FE LEN 83 ADDRESS L, then L + 1 bytes a servo, and the checksum.
        prop_assert_eq!(packet.len(), 8 + servos.len() * (usize::from(len) + 1));
        let packet = Packet::parse(&packet).unwrap();
        prop_assert_eq!(packet.id, Id::BROADCAST);
        let Some(Instruction::SyncWrite(read)) = Instruction::parse(packet) else {
            return Err(TestCaseError::fail("no SYNC_WRITE"));
        };
        prop_assert_eq!(read.address(), address);
        let read: Vec<_> = read.servos().map(|(id, data)| (id, data.to_vec())).collect();
        let sent: Vec<_> = servos.iter().map(|(id, bytes)| (id.number(), data(bytes))).collect();
        prop_assert_eq!(read, sent);
    }

    #[test]
    fn every_answer_reads_back_as_it_was_written(
        id in id(),
        errors: u8,
        params in vec(byte(), 0..=REGISTER_BYTES),
    ) {
        let status = Packet { id, code: Errors::from_bits(errors).bits(), params: &params };
        let mut buffer = [0; MAX_STATUS];
        let sent = status.encode(&mut buffer).unwrap();
        let (packets, _) = hear(&mut StatusReceiver::new(), [&*sent]);
        prop_assert_eq!(Packet::parse(&packets[0]), Some(status));
    }

    #[test]
    fn any_parameters_are_refused_or_mean_the_same_when_written_again(
        id in id(),
        code in prop_oneof![4 => 1..=7u8, 2 => Just(0x83), 1 => any::<u8>()],
        params in vec(prop_oneof![0..4u8, any::<u8>()], 0..20),
    ) {
        if let Some(instruction) = Instruction::parse(Packet { id, code, params: &params }) {
            let packet = arrives(instruction.encode(id, &mut [0; MAX_PACKET]).unwrap());
            let packet = Packet::parse(&packet).unwrap();
            prop_assert_eq!((packet.code, packet.params), (code, &params[..]));
        }
    }

    #[test]
    fn packets_are_found_in_any_chunks_and_every_byte_is_accounted_for(
        stream in vec(piece(), 0..12).prop_map(|pieces| pieces.concat()),
        size in 1..80usize,
    ) {
        let expected = search(&stream, MAX_PACKET);
        let (found, reception) = hear(&mut IntactReceiver::new(), stream.chunks(size));
        prop_assert_eq!(&found, &expected);
        let accepted: usize = found.iter().map(Vec::len).sum();
        prop_assert_eq!(accepted + reception.bytes_skipped as usize, stream.len());
        prop_assert_eq!(reception.frames_ok as usize, found.len());
        // A master looks for the short ones only.
        let short = search(&stream, MAX_STATUS);
        prop_assert_eq!(hear(&mut StatusReceiver::new(), stream.chunks(size)).0, short);
    }
}
