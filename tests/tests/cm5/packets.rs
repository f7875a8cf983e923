//! Properties of the PC link's packets: what is written reads back; damage is refused, counted, and
//! never costs the good packet behind it.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use super::*;

fn packet(params: &[u8]) -> Vec<u8> {
    encode([params], &mut [0; MAX_PACKET]).unwrap().to_vec()
}

/// The packets found in a stream that then falls silent.
fn hear_all(stream: &[u8], chunk: usize) -> Vec<Vec<u8>> {
    let mut receiver = Receiver::new();
    let mut packets = Vec::new();
    for mut piece in stream.chunks(chunk) {
        while let Some(packet) = receiver.receive(&mut piece) {
            packets.push(packet.to_vec());
        }
    }
    while let Some(packet) = receiver.give_up() {
        packets.push(packet.to_vec());
    }
    let found: usize = packets.iter().map(Vec::len).sum();
    assert_eq!(found + receiver.reception().bytes_skipped as usize, stream.len());
    packets
}

/// The packets that must be found: try every place, and go on behind a packet or one byte further.
fn search(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut packets = Vec::new();
    let mut rest = stream;
    while !rest.is_empty() {
        let total = match rest {
            [0xFF, 0xFF, high, low, ..] => usize::from(*high) * 256 + usize::from(*low) + 5,
            _ => usize::MAX,
        };
        let sums =
            |packet: &&[u8]| packet[2..].iter().map(|b| u32::from(*b)).sum::<u32>() & 255 == 255;
        let found = rest.get(..total).filter(|_| total <= MAX_PACKET).filter(sums);
        packets.extend(found.map(<[u8]>::to_vec));
        rest = &rest[found.map_or(1, <[u8]>::len)..];
    }
    packets
}

fn piece() -> impl Strategy<Value = Vec<u8>> {
    let intact = || vec(any::<u8>(), 0..60).prop_map(|params| packet(&params));
    let flipped = (intact(), any::<Index>(), 0..8).prop_map(|(mut packet, at, bit)| {
        *at.get_mut(&mut packet) ^= 1u8 << bit;
        packet
    });
    let cut_off = (intact(), any::<Index>()).prop_map(|(p, at)| p[..at.index(p.len())].to_vec());
    let false_start = (0..3u8, any::<u8>()).prop_map(|(high, low)| vec![0xFF, 0xFF, high, low]);
    let noise = vec(prop_oneof![Just(0xFF), 0..3u8, any::<u8>()], 0..40);
    prop_oneof![3 => intact(), 2 => flipped, 1 => cut_off, 1 => false_start, 1 => noise]
}

fn any_goal() -> impl Strategy<Value = ServoGoal> {
    let values = ServoGoal::REGISTERS.map(|register| register.min..=register.max);
    values.prop_map(|values| {
        let fields = ServoGoal::REGISTERS.into_iter().zip(values);
        fields.fold(ServoGoal::default(), |goal, (register, value)| goal.with(register, value))
    })
}

fn feedback() -> impl Strategy<Value = Option<Feedback>> {
    // 8 x FF is no feedback of a servo.
    any::<[u8; 8]>().prop_map(|bytes| (bytes != [0xFF; 8]).then_some(Feedback(bytes)))
}

fn any_limits() -> impl Strategy<Value = Limits> {
    (0..=1023u16, 0..=1023u16).prop_map(|(a, b)| limits(a.min(b), a.max(b)))
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 2000,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn packets_are_found_in_any_chunks_and_every_byte_is_accounted_for(
        stream in vec(piece(), 0..12).prop_map(|pieces| pieces.concat()),
        chunk in 1..100usize,
    ) {
        prop_assert_eq!(hear_all(&stream, chunk), search(&stream));
    }

    #[test]
    fn hellos_answers_goals_and_reports_read_back_as_they_were_written(
        ids in vec(1..=253u8, 0..=100),
        return_delay in 0..=254u8,
        pairs in vec(any_limits(), 1..=100),
        goals in vec(any_goal(), 1..=100),
        report in vec(feedback(), 0..=100),
    ) {
        let mut buffer = [0; MAX_PACKET];
        let hello = Hello { ids: &ids };
        let bytes = hello.encode(&mut buffer).unwrap();
        prop_assert_eq!(Hello::parse(params_of(bytes).unwrap()), Some(hello));

        let bytes = HelloAnswer::encode(return_delay, &pairs, &mut buffer).unwrap();
        let answer = HelloAnswer::parse(params_of(bytes).unwrap(), pairs.len()).unwrap();
        prop_assert_eq!(answer.return_delay, return_delay);
        let read: Vec<_> = (0..pairs.len()).filter_map(|k| answer.limits(k)).collect();
        prop_assert_eq!(read, pairs);

        let bytes = Goals::encode(&goals, &mut buffer).unwrap();
        let read = Goals::parse(params_of(bytes).unwrap(), goals.len()).unwrap();
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), goals);

        let bytes = Report::encode(report.iter().copied(), &mut buffer).unwrap();
        let read = Report::parse(params_of(bytes).unwrap(), report.len()).unwrap();
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), report);
    }

    #[test]
    fn any_parameters_are_refused_or_mean_the_same_when_written_again(
        params in vec(prop_oneof![0..4u8, any::<u8>()], 0..70),
        servos in 0..6usize,
    ) {
        let mut buffer = [0; MAX_PACKET];
        if let Ok(answer) = HelloAnswer::parse(&params, servos) {
            let pairs: Vec<_> = (0..(params.len() - 1) / 4).filter_map(|k| answer.limits(k)).collect();
            let again = HelloAnswer::encode(answer.return_delay, &pairs, &mut buffer).unwrap();
            prop_assert_eq!(params_of(again).unwrap(), &params[..]);
        }
        if let Ok(goals) = Goals::parse(&params, servos) {
            let goals: Vec<_> = goals.iter().collect();
            let again = Goals::encode(&goals, &mut buffer).unwrap();
            prop_assert_eq!(params_of(again).unwrap(), &params[..]);
        }
    }
}

#[test]
fn every_bit_flip_and_every_truncation_is_rejected_and_the_next_packet_is_found() {
    let good = packet(&[0x5E; 7]);
    // Lengths whose last two bits are set. One that grows by 1 or 2 takes in FF or FF FF of the
    // next packet, and the sum is right again: no receiver can tell, only silence between them
    // helps.
    let examples = [packet(&[2, 1, 2]), packet(&[0xFE; 15]), packet(&[7; 303])];
    for example in examples {
        let flips = (0..example.len() * 8).map(|bit| {
            let mut flipped = example.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            flipped
        });
        let cuts = (0..example.len()).map(|length| example[..length].to_vec());
        for damaged in flips.chain(cuts) {
            let stream = [&damaged[..], &good].concat();
            let found = hear_all(&stream, 64);
            assert_eq!(found.last(), Some(&good), "{damaged:02X?}");
            assert!(!found.contains(&example));
        }
    }
}

#[test]
fn behind_a_false_start_full_of_starts_the_good_packet_is_found() {
    // 1505 bytes: itself, and every FF FF in it with two bytes behind, is a candidate.
    let mut stream = vec![0xFF, 0xFF, 0x05, 0xDC];
    stream.resize(MAX_PACKET, 0xFF);
    let mut receiver = Receiver::new();
    assert_eq!(receiver.receive(&mut &stream[..1000]), None);
    assert_eq!(receiver.reception().bad_frames, 0);
    assert_eq!(receiver.receive(&mut &stream[1000..]), None);
    assert_eq!((receiver.reception().bad_frames, receiver.pending()), (1 + 1498, 3));
    // They end in FF FF FF: the packet's own start comes after one FF more than it needs.
    let good = packet(&[2, 1, 2]);
    assert_eq!(receiver.receive(&mut &good[..]), Some(&good[..]));
}
