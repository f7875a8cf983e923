//! The virtual board's image in QEMU: a Cortex-M says what the computer says, byte for byte.
//!
//!     .ci/images && cargo test -p tests --test qemu -- --ignored
//!
//! The image runs in real time, so it depends on the machine when it gets which bytes. It tells
//! that on its second serial line (the trace), and then a virtual board is given the same bytes
//! at the same times of its virtual clock. No version of QEMU is asked for; 7.2 has been tried.

mod process;

use std::collections::BTreeSet;
use std::io::Write;
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};

use hal_mock::board::{Make, VirtualBoard};
use protocol::extension::did as extension;
use protocol::pms5005::{self, Frame, did};

use process::{Qemu, bytes_from, image};
use tests::every_did::{ACKS, Step, script};

/// A piece of what the host sent: when the board was given it (ms of the board's time), its bytes.
type Piece = (u64, usize);

/// The board's time after the last piece that is compared too, in ms: a round of telemetry or two.
const AFTERWARDS_MS: u64 = 100;

/// What the image says to a script, for so long that the last step's answers are in it; and when
/// it was given what.
fn image_says(script: &[Step], enough: impl Fn(&[Piece]) -> usize) -> (Vec<u8>, Vec<Piece>) {
    let sockets = [("-serial", "host"), ("-serial", "trace")];
    let qemu = Qemu::start(&image("pms5005-sim"), &sockets);
    let mut host = qemu.connect("host");
    let (from_image, trace) = (bytes_from(&host), bytes_from(&qemu.connect("trace")));

    // It is ready when it has said something.
    let mut said = vec![next(&from_image, &trace)];
    for Step { bytes, pause } in script {
        host.write_all(bytes).unwrap();
        std::thread::sleep(*pause);
    }

    let sent: usize = script.iter().map(|step| step.bytes.len()).sum();
    let mut pieces = Vec::new();
    let mut handed_over = 0;
    while handed_over < sent {
        let line: Vec<u8> = std::iter::repeat_with(|| next(&trace, &trace))
            .take_while(|&byte| byte != b'\n')
            .collect();
        let (at, count) = piece(&line).unwrap_or_else(|| {
            let more: Vec<u8> = trace.try_iter().collect();
            panic!("the image says {}", String::from_utf8_lossy(&[line, more].join(&b'\n')));
        });
        handed_over += count;
        pieces.push((at, count));
    }
    assert_eq!(handed_over, sent, "the trace tells of bytes that were never sent");
    let enough = enough(&pieces);
    while said.len() < enough {
        said.push(next(&from_image, &trace));
    }
    (said, pieces)
}

/// The next byte that the image sends.
fn next(from: &Receiver<u8>, trace: &Receiver<u8>) -> u8 {
    from.recv_timeout(Duration::from_secs(5)).unwrap_or_else(|error| {
        let trace: Vec<u8> = trace.try_iter().collect();
        panic!("the image: {error}; its trace ends with {}", String::from_utf8_lossy(&trace))
    })
}

/// A line of the trace, unless it is something else.
fn piece(line: &[u8]) -> Option<Piece> {
    let (at, count) = std::str::from_utf8(line).ok()?.split_once(' ')?;
    Some((at.parse().ok()?, count.parse().ok()?))
}

/// What a virtual board says when it is given `bytes` in these pieces.
fn computer_says(bytes: &[u8], pieces: &[Piece], seed: u64) -> Vec<u8> {
    let mut board = VirtualBoard::new(Make { line_rate: 0, seed, ..Make::default() });
    let mut rest = bytes;
    for &(at, count) in pieces {
        let (piece, after) = rest.split_at(count);
        board.run_until(embassy_time::Instant::from_millis(at));
        board.line.host_sends(piece);
        rest = after;
    }
    board.run_for(embassy_time::Duration::from_millis(AFTERWARDS_MS));
    std::iter::from_fn(|| board.line.host_receives()).flat_map(|(_, frame)| frame).collect()
}

#[test]
#[ignore = "needs QEMU and the image that .ci/images builds"]
fn a_cortex_m_answers_every_did_with_the_bytes_of_the_virtual_clock() {
    let begin = Instant::now();
    let script = script();
    let sent: Vec<u8> = script.iter().flat_map(|step| step.bytes.clone()).collect();
    let seed = Make::default().seed;
    let (said, pieces) = image_says(&script, |pieces| computer_says(&sent, pieces, seed).len());
    let expected = computer_says(&sent, &pieces, seed);

    let said = &said[..expected.len()];
    if let Some(at) = (0..expected.len()).find(|&at| said[at] != expected[at]) {
        let near = at.saturating_sub(16)..(at + 16).min(expected.len());
        panic!(
            "byte {at} of {} differs: the image says {:02X?}, the computer {:02X?}",
            expected.len(),
            &said[near.clone()],
            &expected[near]
        );
    }

    // It was worth comparing: every acknowledgement, every kind of frame.
    let mut receiver = pms5005::Receiver::new();
    let (mut acks, mut kinds) = (0, BTreeSet::new());
    let mut bytes = said;
    while let Some(frame) = receiver.receive(&mut bytes) {
        let Frame { res, did, data, .. } = Frame::parse(frame).unwrap();
        acks += usize::from((res, did, data) == (0, did::SETUP, &[1]));
        kinds.insert((res, did, (res == 0).then(|| data.to_vec())));
    }
    assert_eq!(acks, ACKS);
    let answers = [extension::OUTCOME, extension::RECORDING, extension::BLOCK];
    let telemetry = [did::MOTORS, did::CUSTOM_IO, did::SENSORS];
    let not_acknowledged = telemetry.into_iter().chain(answers).map(|did| (255, did, None));
    let pings_and_acks = [0, 1].map(|kind| (0, did::SETUP, Some(vec![kind])));
    assert_eq!(kinds, not_acknowledged.chain(pings_and_acks).collect());

    // And it can differ: by one bit of what was sent, by another noise.
    let mut damaged = sent.clone();
    damaged[sent.len() / 2] ^= 1;
    assert_ne!(computer_says(&damaged, &pieces, seed), expected);
    assert_ne!(computer_says(&sent, &pieces, seed + 1), expected);
    println!(
        "{} bytes of the host in {} pieces, {} bytes of the image, all as expected, {acks} \
         acknowledgements, in {:.1} s",
        sent.len(),
        pieces.len(),
        expected.len(),
        begin.elapsed().as_secs_f32()
    );
}
