//! The receiver against the plainest one that keeps the same promises, for every format: whatever
//! comes, in whatever pieces, and whenever it is told to give up, both find the same frames at the
//! same time, count the same and wait for the same.

use std::cell::Cell;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;
use protocol::deframe::{Deframer, Framing, Reception};
use protocol::{arcos, cm5, dynamixel, pms5005};

/// What befalls a receiver.
#[derive(Clone, Debug)]
enum Event {
    /// So many more bytes of the stream come.
    Bytes(usize),
    Silence,
    /// The candidate at the front has had its time.
    FrontIsLate,
}

/// Holds what has come, and tries its first byte again whenever something happens.
#[derive(Default)]
struct Naive {
    held: Vec<u8>,
    reception: Reception,
}

impl Naive {
    fn drop_first(&mut self, is_bad: bool) {
        self.held.remove(0);
        self.reception.bytes_skipped += 1;
        self.reception.bad_frames += u32::from(is_bad);
    }

    /// The frames that can be told now, of at most `longest` bytes.
    fn frames<F: Framing>(&mut self, longest: usize, silent: bool) -> Vec<Vec<u8>> {
        let mut frames = Vec::new();
        while !self.held.is_empty() {
            let begins = self.held.iter().zip(F::START).all(|(byte, start)| *byte == start);
            let has_header = begins && self.held.len() >= F::HEADER;
            let length = if has_header { F::length(&self.held) } else { None };
            match length.filter(|&length| length <= longest) {
                _ if !begins => self.drop_first(false),
                Some(length) if length <= self.held.len() => {
                    if F::is_intact(&self.held[..length]) {
                        frames.push(self.held.drain(..length).collect());
                        self.reception.frames_ok += 1;
                    } else {
                        self.drop_first(true);
                    }
                }
                None if has_header => self.drop_first(true),
                _ if silent => self.drop_first(has_header),
                _ => break,
            }
        }
        frames
    }
}

/// Plays the events to both receivers.
fn play<F: Framing, const N: usize>(
    mut stream: &[u8],
    events: &[Event],
) -> Result<(), TestCaseError> {
    let (mut receiver, mut naive) = (Deframer::<F, N>::new(), Naive::default());
    for event in events {
        let (mut found, mut expected) = (Vec::new(), Vec::new());
        let mut piece: &[u8] = &[];
        match *event {
            Event::Bytes(count) => {
                (piece, stream) = stream.split_at(count.min(stream.len()));
                naive.held.extend(piece);
            }
            Event::Silence => {
                expected = naive.frames::<F>(N, true);
                while let Some(frame) = receiver.give_up() {
                    found.push(frame.to_vec());
                }
            }
            Event::FrontIsLate => {
                if !naive.held.is_empty() {
                    naive.drop_first(naive.held.len() >= F::HEADER);
                }
                found.extend(receiver.give_up_front().map(<[u8]>::to_vec));
            }
        }
        while let Some(frame) = receiver.receive(&mut piece) {
            found.push(frame.to_vec());
        }
        expected.extend(naive.frames::<F>(N, false));
        prop_assert_eq!(found, expected);
        prop_assert_eq!(receiver.reception(), naive.reception);
        prop_assert_eq!(receiver.pending(), naive.held.len());
    }
    Ok(())
}

/// A stream of frames, of frames that are flipped or cut off, of starts with any bytes behind, and
/// of bytes of which many could begin a frame.
fn stream<F: Framing>(frame: impl Fn(&[u8]) -> Vec<u8>) -> impl Strategy<Value = Vec<u8>> {
    let byte = || prop_oneof![any::<u8>(), 0..4u8, Just(F::START[0]), Just(F::START[1])];
    let kinds = (0..7u8, vec(byte(), 0..70), any::<Index>(), 0..8u8);
    let piece = kinds.prop_map(move |(kind, bytes, at, bit)| {
        let mut frame = frame(&bytes);
        match kind {
            0 => return bytes,
            1 => return [&F::START[..], &bytes].concat(),
            2 => frame.truncate(at.index(frame.len())),
            3 => *at.get_mut(&mut frame) ^= 1 << bit,
            _ => {}
        }
        frame
    });
    vec(piece, 0..10).prop_map(|pieces| pieces.concat())
}

fn events() -> impl Strategy<Value = Vec<Event>> {
    let event = prop_oneof![
        8 => (1..8usize).prop_map(Event::Bytes),
        4 => (1..100usize).prop_map(Event::Bytes),
        1 => Just(Event::Silence),
        1 => Just(Event::FrontIsLate),
    ];
    vec(event, 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 3000, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn frames_of_the_pms5005_are_found_as_by_the_plainest_receiver(
        stream in stream::<pms5005::Pms5005>(|data| {
            let frame = pms5005::Frame { rid: 1, res: 0, did: 7, data };
            frame.encode(&mut [0; pms5005::MAX_FRAME]).unwrap().to_vec()
        }),
        events in events(),
    ) {
        play::<pms5005::Pms5005, { pms5005::MAX_FRAME }>(&stream, &events)?;
        // What is longer than the receiver is noise.
        play::<pms5005::Pms5005, 40>(&stream, &events)?;
    }

    #[test]
    fn packets_of_arcos_are_found_as_by_the_plainest_receiver(
        stream in stream::<arcos::Arcos>(|data| {
            arcos::Packet { id: 4, data }.encode(&mut [0; 200]).unwrap().to_vec()
        }),
        events in events(),
    ) {
        play::<arcos::Arcos, { arcos::MAX_RECEIVED }>(&stream, &events)?;
    }

    #[test]
    fn packets_of_servos_are_found_as_by_the_plainest_receiver(
        stream in stream::<dynamixel::Dynamixel>(|params| {
            let id = dynamixel::Id::BROADCAST;
            let packet = dynamixel::Packet { id, code: 3, params };
            packet.encode(&mut [0; dynamixel::MAX_PACKET]).unwrap().to_vec()
        }),
        events in events(),
    ) {
        play::<dynamixel::Dynamixel, { dynamixel::MAX_PACKET }>(&stream, &events)?;
        play::<dynamixel::Dynamixel, { dynamixel::MAX_STATUS }>(&stream, &events)?;
    }

    #[test]
    fn packets_of_the_cm5_are_found_as_by_the_plainest_receiver(
        stream in stream::<cm5::Cm5>(|params| {
            cm5::encode([params], &mut [0; cm5::MAX_PACKET]).unwrap().to_vec()
        }),
        events in events(),
    ) {
        play::<cm5::Cm5, { cm5::MAX_PACKET }>(&stream, &events)?;
    }
}

/// A format of which every byte of a run of FF begins a candidate, and none is a frame.
enum Flood {}

thread_local!(static JUDGED: Cell<usize> = const { Cell::new(0) });

impl Framing for Flood {
    const START: [u8; 2] = [0xFF; 2];
    const HEADER: usize = 3;

    fn length(header: &[u8]) -> Option<usize> {
        Some(header[2].into())
    }

    fn is_intact(_: &[u8]) -> bool {
        JUDGED.set(JUDGED.get() + 1);
        false
    }
}

#[test]
fn every_candidate_is_judged_as_a_whole_once() {
    let stream = [0xFF; 10_000];
    for chunk in [1, 7, 64, stream.len()] {
        JUDGED.set(0);
        let mut receiver = Deframer::<Flood, 255>::new();
        for mut piece in stream.chunks(chunk) {
            assert_eq!(receiver.receive(&mut piece), None);
        }
        assert_eq!(receiver.pending(), 254);
        assert_eq!(JUDGED.get(), stream.len() - 254, "in chunks of {chunk}");
        assert_eq!(receiver.reception().bad_frames as usize, JUDGED.get());
    }
}

#[test]
fn what_follows_a_frame_is_left_to_the_caller() {
    let stream = [pms5005::ACK; 3].concat();
    let (mut receiver, mut bytes) = (pms5005::Receiver::new(), &stream[..]);
    for behind in [20, 10, 0] {
        assert_eq!(receiver.receive(&mut bytes), Some(&pms5005::ACK[..]));
        assert_eq!((bytes.len(), receiver.pending()), (behind, 0));
    }
    assert_eq!(receiver.receive(&mut bytes), None);
}
