//! The receiver against the plainest one that keeps the same promises, for every format: whatever
//! comes, in whatever pieces, and whenever it is told to give up, both find the same frames at the
//! same time, count the same and wait for the same.

use protocol::deframe::{Deframer, Framing, Reception};
use protocol::{arcos, cm5, dynamixel, pms5005};

use super::Choices;

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

    /// The next frame that can be told now, of at most `longest` bytes.
    fn frame<F: Framing>(&mut self, longest: usize, silent: bool) -> Option<Vec<u8>> {
        while !self.held.is_empty() {
            let begins = self.held.iter().zip(F::START).all(|(byte, start)| *byte == start);
            let has_header = begins && self.held.len() >= F::HEADER;
            let length = if has_header { F::length(&self.held) } else { None };
            match length.filter(|&length| length <= longest) {
                _ if !begins => self.drop_first(false),
                Some(length) if length <= self.held.len() => {
                    if F::is_intact(&self.held[..length]) {
                        self.reception.frames_ok += 1;
                        return Some(self.held.drain(..length).collect());
                    }
                    self.drop_first(true);
                }
                None if has_header => self.drop_first(true),
                _ if silent => self.drop_first(has_header),
                _ => break,
            }
        }
        None
    }
}

/// What befalls a receiver.
#[derive(Clone, Copy)]
enum Event {
    /// So many bytes more of what was sent come, or all of it.
    Bytes(usize),
    Silence,
    /// The candidate at the front has had its time.
    FrontIsLate,
}

/// Sends frames, damaged ones and noise, and plays what befalls them to both receivers.
fn play<F: Framing, const N: usize>(choices: &mut Choices, frame: impl Fn(&[u8]) -> Vec<u8>) {
    let (mut receiver, mut naive) = (Deframer::<F, N>::new(), Naive::default());
    let mut sent: Vec<u8> = Vec::new();
    for _ in 0..40 {
        let event = match choices.below(12) {
            0..6 => {
                send::<F>(choices, &mut sent, &frame);
                continue;
            }
            6 => Event::Bytes(sent.len()),
            7 | 8 => Event::Bytes(1 + choices.below(8) as usize),
            9 => Event::Bytes(choices.below(256) as usize),
            10 => Event::Silence,
            _ => Event::FrontIsLate,
        };
        befall(event, &mut sent, &mut receiver, &mut naive);
        if choices.are_over() {
            break;
        }
    }
    befall(Event::Bytes(sent.len()), &mut sent, &mut receiver, &mut naive);
    befall(Event::Silence, &mut sent, &mut receiver, &mut naive);
    assert_eq!(receiver.pending(), 0, "nothing is pending after silence");
}

/// A frame, one that is flipped or cut off, a start with any bytes behind it, or bytes of which many
/// could begin a frame.
fn send<F: Framing>(choices: &mut Choices, sent: &mut Vec<u8>, frame: &impl Fn(&[u8]) -> Vec<u8>) {
    let kind = choices.below(6);
    let bytes = choices.bytes(70);
    let mut frame = match kind {
        0 => bytes,
        1 => [&F::START[..], &bytes].concat(),
        _ => frame(&bytes),
    };
    match kind {
        2 => frame.truncate(choices.below(frame.len() as u32) as usize),
        3 => {
            let at = choices.below(frame.len() as u32) as usize;
            frame[at] ^= 1 << choices.below(8);
        }
        _ => {}
    }
    sent.extend(frame);
}

fn befall<F: Framing, const N: usize>(
    event: Event,
    sent: &mut Vec<u8>,
    receiver: &mut Deframer<F, N>,
    naive: &mut Naive,
) {
    let arrived: Vec<u8> = match event {
        Event::Bytes(count) => sent.drain(..count.min(sent.len())).collect(),
        Event::Silence | Event::FrontIsLate => Vec::new(),
    };
    let mut piece = &arrived[..];
    naive.held.extend(piece);
    match event {
        Event::Bytes(_) => {}
        Event::Silence => {
            while let Some(frame) = receiver.give_up() {
                assert_eq!(naive.frame::<F>(N, true).as_deref(), Some(frame));
            }
            assert_eq!(naive.frame::<F>(N, true), None);
        }
        Event::FrontIsLate => {
            if !naive.held.is_empty() {
                naive.drop_first(naive.held.len() >= F::HEADER);
            }
            if let Some(frame) = receiver.give_up_front() {
                assert_eq!(naive.frame::<F>(N, false).as_deref(), Some(frame));
            }
        }
    }
    while let Some(frame) = receiver.receive(&mut piece) {
        assert_eq!(naive.frame::<F>(N, false).as_deref(), Some(frame));
    }
    assert_eq!(naive.frame::<F>(N, false), None);
    assert!(piece.is_empty(), "all bytes are taken");
    assert_eq!(receiver.reception(), naive.reception);
    assert_eq!(receiver.pending(), naive.held.len());
}

/// The four formats, and receivers that are shorter than a format's longest.
pub(super) fn trial(choices: &mut Choices) {
    let pms5005 = |data: &[u8]| {
        let frame = pms5005::Frame { rid: 1, res: 0, did: 7, data };
        frame.encode(&mut [0; pms5005::MAX_FRAME]).unwrap().to_vec()
    };
    let servos = |params: &[u8]| {
        let packet = dynamixel::Packet { id: dynamixel::Id::BROADCAST, code: 3, params };
        packet.encode(&mut [0; dynamixel::MAX_PACKET]).unwrap().to_vec()
    };
    match choices.below(6) {
        0 => play::<pms5005::Pms5005, { pms5005::MAX_FRAME }>(choices, pms5005),
        1 => play::<pms5005::Pms5005, 40>(choices, pms5005),
        2 => play::<arcos::Arcos, { arcos::MAX_RECEIVED }>(choices, |data| {
            arcos::Packet { id: 4, data }.encode(&mut [0; 200]).unwrap().to_vec()
        }),
        3 => play::<dynamixel::Dynamixel, { dynamixel::MAX_PACKET }>(choices, servos),
        4 => play::<dynamixel::Dynamixel, { dynamixel::MAX_STATUS }>(choices, servos),
        _ => play::<cm5::Cm5, { cm5::MAX_PACKET }>(choices, |params| {
            cm5::encode([params], &mut [0; cm5::MAX_PACKET]).unwrap().to_vec()
        }),
    }
}
