//! Properties of the receiver and of the codecs: what is written reads back; damage is refused,
//! counted, and never costs the good frame behind it.
//!
//! *Noise* is bytes that are no frame; a *false start* is noise that begins like one. Everything
//! random is either proptest's or comes from a fixed seed.

mod strategies;

use embassy_time::{Duration, Instant};
use firmware::ports::Outputs;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::{Index, select};
use proptest::test_runner::{RngAlgorithm, TestRng};
use protocol::extension::{
    Action, Answer, Assignments, BLOCK, Block, ChannelState, Counters, Description, Fault,
    FaultRecord, Health, Identity, Latched, MachineState, Mode, Origin, Outcome, Phase, Reason,
    Recording, Refusals, Request, ResetCause, Row, Setup, Trigger, Unit, Verdict,
};
use protocol::pms5005::{
    Addressing, CHANNELS, Channel, Command, CustomIoReport, Data, ETX, Encoder, Frame, Gain,
    LcdFrame, Loop, MAX_FRAME, Method, MotorReport, Move, OVERHEAD, Parameter, Parameters,
    Polarity, Quantity, Receiver, Repeat, Report, Reports, STX, Scope, Sensor, SensorReport,
    encode_answer,
};
use strategies::{answer, byte, command, parameter, plain_data, report};
use tests::Bench;

fn frame(rid: u8, res: u8, did: u8, data: &[u8]) -> Vec<u8> {
    Frame { rid, res, did, data }.encode(&mut [0; MAX_FRAME]).unwrap().to_vec()
}

/// The frames of section III.1, as the conformance tests have them byte by byte; then a picture,
/// and DATA that looks like the ends of frames.
fn examples() -> Vec<Vec<u8>> {
    let mut frames: Vec<_> = [
        (28, &[2, 0, 8][..]),
        (30, &[0, 7]),
        (5, &[4, 160, 15]),
        (123, &[3]),
        (7, &[13, 0, 2]),
        (7, &[14, 0, 1]),
        (3, &[0, 112, 23]),
        (7, &[0x5E, 0x02, 0x5E, 0x0D, 0x5E]),
    ]
    .map(|(did, data)| frame(1, 0, did, data))
    .into();
    frames.extend((0..16).map(|number| {
        let picture: Vec<u8> = (0..64).map(|column| (3 * column) ^ number).collect();
        frame(1, 0, 23, &[&[number], &picture[..]].concat())
    }));
    frames
}

/// The good frame behind the damage; not one of the examples.
fn good() -> Vec<u8> {
    frame(1, 0, 22, &[0x5E])
}

/// A start, and a header that claims 255 bytes.
const FALSE_START: [u8; 6] = [0x5E, 0x02, 1, 0, 5, 255];

/// The frames that a receiver finds in these pieces.
fn hear<'a>(receiver: &mut Receiver, pieces: impl IntoIterator<Item = &'a [u8]>) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    for mut piece in pieces {
        while let Some(frame) = receiver.receive(&mut piece) {
            frames.push(frame.to_vec());
        }
        assert!(piece.is_empty(), "all bytes are taken");
    }
    frames
}

/// The frames that a receiver finds when nothing more comes.
fn give_up(receiver: &mut Receiver) -> Vec<Vec<u8>> {
    let frames = std::iter::from_fn(|| receiver.give_up().map(<[u8]>::to_vec)).collect();
    assert_eq!(receiver.pending(), 0);
    frames
}

/// The frames in a stream that then falls silent.
fn hear_all(stream: &[u8], chunk: usize) -> Vec<Vec<u8>> {
    let mut receiver = Receiver::new();
    let mut frames = hear(&mut receiver, stream.chunks(chunk));
    frames.extend(give_up(&mut receiver));
    frames
}

/// The frames that a receiver must have found when this stream has come, by the slowest method
/// there is: try every place, and go on behind a frame or one byte further. Only a candidate that
/// is not yet complete is worth waiting for, and after silence not even that.
fn search(stream: &[u8], silent: bool) -> Vec<Vec<u8>> {
    let mut frames = Vec::new();
    let mut rest = stream;
    while !rest.is_empty() {
        let begins = rest.iter().zip(STX).all(|(byte, start)| *byte == start);
        let complete = rest.get(5).is_some_and(|&len| rest.len() >= usize::from(len) + OVERHEAD);
        if begins && !complete && !silent {
            break;
        }
        let found = Frame::parse(rest).filter(|_| begins);
        let found = found.map(|f| frame(f.rid, f.res, f.did, f.data));
        let found = found.filter(|frame| rest.starts_with(frame));
        rest = &rest[found.as_ref().map_or(1, Vec::len)..];
        frames.extend(found);
    }
    frames
}

/// Cuts a stream into pieces of these sizes, over and over.
fn cut<'a>(mut stream: &'a [u8], sizes: &'a [usize]) -> impl Iterator<Item = &'a [u8]> {
    sizes.iter().cycle().map_while(move |&size| {
        let (piece, rest) = stream.split_at(size.min(stream.len()));
        stream = rest;
        (!piece.is_empty()).then_some(piece)
    })
}

const ALL: [Channel; CHANNELS] = Channel::ALL;

fn config() -> ProptestConfig {
    ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() }
}

/// A piece of a stream: a frame, one with a flipped bit or cut off, a false start, noise.
fn piece() -> impl Strategy<Value = Vec<u8>> {
    let intact =
        || (byte(), vec(any::<u8>(), 0..80)).prop_map(|(did, data)| frame(1, 0, did, &data));
    let flipped = (intact(), any::<Index>(), 0..8).prop_map(|(mut frame, at, bit)| {
        *at.get_mut(&mut frame) ^= 1u8 << bit;
        frame
    });
    let cut_off = (intact(), any::<Index>()).prop_map(|(f, at)| f[..at.index(f.len())].to_vec());
    let false_start = any::<u8>().prop_map(|len| vec![STX[0], STX[1], 1, 0, 5, len]);
    let noise = vec(prop_oneof![Just(STX[0]), Just(STX[1]), any::<u8>()], 0..40);
    prop_oneof![3 => intact(), 2 => flipped, 1 => cut_off, 1 => false_start, 1 => noise]
}

/// What arrives after encoding, framing and reception.
fn arrives(command: Command, res: u8) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    let sent = command.encode(res, &mut buffer).expect("a command that can be encoded");
    let mut frames = hear(&mut Receiver::new(), [&*sent]);
    assert_eq!(frames.len(), 1);
    frames.remove(0)
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn every_command_reads_back_as_it_was_written(command in command(), res: u8) {
        let frame = arrives(command, res);
        let Frame { rid, res: reserved, did, data } = Frame::parse(&frame).unwrap();
        prop_assert_eq!((rid, reserved), (1, res));
        prop_assert_eq!(Command::parse(did, data), Ok(command));
    }

    #[test]
    fn parameters_and_pictures_read_back_as_they_were_written(
        parameters in vec(parameter(), 1..=51), // 51 of the longest, 5 bytes, fill DATA
        number in 0u8..16,
        columns: [[u8; 32]; 2],
    ) {
        let mut data = Data::new();
        parameters.iter().for_each(|parameter| parameter.emit(&mut data).unwrap());
        let frame = arrives(Command::Parameters(Parameters::parse(&data).unwrap()), 0);
        let frame = Frame::parse(&frame).unwrap();
        let Ok(Command::Parameters(read)) = Command::parse(frame.did, frame.data) else {
            return Err(TestCaseError::fail("no parameters"));
        };
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), parameters);

        let picture = Command::Lcd(LcdFrame { number, columns: columns.as_flattened().try_into()? });
        let frame = arrives(picture, 0);
        let frame = Frame::parse(&frame).unwrap();
        prop_assert_eq!(Command::parse(frame.did, frame.data), Ok(picture));
    }

    #[test]
    fn assignments_read_back_as_they_were_written(
        assignments in vec(any::<(u16, i32)>(), 1..=36), // 36 of 7 bytes fill DATA
    ) {
        let mut data = Data::new();
        for &(number, value) in &assignments {
            Assignments::emit(number, value, &mut data).unwrap();
        }
        let request = Request::Set(Assignments::parse(&data).unwrap());
        let frame = arrives(Command::Extension(request), 0);
        let frame = Frame::parse(&frame).unwrap();
        let Ok(Command::Extension(Request::Set(read))) = Command::parse(frame.did, frame.data)
        else {
            return Err(TestCaseError::fail("no assignments"));
        };
        prop_assert_eq!(read.iter().collect::<Vec<_>>(), assignments);
    }

    #[test]
    fn every_answer_reads_back_as_it_was_written(answer in answer()) {
        let mut buffer = [0; MAX_FRAME];
        let sent = encode_answer(&answer, &mut buffer).unwrap().to_vec();
        let frames = hear(&mut Receiver::new(), [&sent[..]]);
        let frame = Frame::parse(&frames[0]).unwrap();
        prop_assert_eq!((frame.rid, frame.res, frames.len()), (0, 255, 1));
        prop_assert_eq!(Answer::parse(frame.did, frame.data), Some(answer));
    }

    #[test]
    fn any_data_is_no_answer_or_means_the_same_when_written_again_but_for_what_later_versions_add(
        did in 96..=103u8,
        data in vec(prop_oneof![4 => 0..10u8, 1 => any::<u8>()], 0..80),
    ) {
        if let Some(answer) = Answer::parse(did, &data) {
            let mut buffer = [0; MAX_FRAME];
            let frame = encode_answer(&answer, &mut buffer).unwrap();
            let told = Frame::parse(frame).unwrap().data;
            let lacks_counters = did == 99 && told.starts_with(&data);
            prop_assert!(data.starts_with(told) || lacks_counters);
        }
    }

    #[test]
    fn any_data_is_refused_or_means_the_same_when_written_again(
        did in prop_oneof![3..=7u8, 22..=31u8, 96..=101u8, 123..=127u8, Just(255), any::<u8>()],
        data in vec(prop_oneof![4 => 0..8u8, 1 => Just(28), 1 => any::<u8>()], 0..20),
    ) {
        if let Ok(command) = Command::parse(did, &data) {
            let frame = arrives(command, 0);
            let frame = Frame::parse(&frame).unwrap();
            prop_assert_eq!(frame.did, did);
            prop_assert_eq!(Command::parse(did, frame.data), Ok(command));
        }
    }

    #[test]
    fn every_report_reads_back_and_holds_no_end_mark_that_could_be_avoided(report in report()) {
        let mut buffer = [0; Report::MAX_FRAME];
        let sent = report.encode(&mut buffer).unwrap().to_vec();
        prop_assert_eq!(hear(&mut Receiver::new(), [&sent[..]]), std::slice::from_ref(&sent));
        let data = Frame::parse(&sent).unwrap().data;
        let read = Report::parse(report.did(), data).expect("a report");
        prop_assert_eq!(&plain_data(&read).0, data);

        let (plain, exact) = plain_data(&report);
        let plain_frame = frame(0, 255, report.did(), &plain);
        prop_assert_eq!(data.len(), plain.len());
        let marks = |bytes: &[u8]| -> Vec<usize> {
            (0..bytes.len() - 2).filter(|&at| bytes[at..at + 2] == ETX).collect()
        };
        // Measured values, and only they, give way, by one: one for each
        // mark, and one more if the checksum then makes another.
        let mut altered = 0;
        for at in (0..plain.len()).filter(|&at| data[at] != plain[at]) {
            let is_low_byte = at % 2 == 0 || report.did() == 125 && at < 6;
            prop_assert!(is_low_byte && !exact.contains(&at) && data[at].abs_diff(plain[at]) == 1);
            altered += 1;
        }
        match marks(&plain_frame).len() {
            0 => prop_assert_eq!(&sent, &plain_frame),
            marks => prop_assert!(altered <= marks + 1, "{} values for {} marks", altered, marks),
        }
        for at in marks(&sent) {
            let unalterable = exact.contains(&(at - 6)) && exact.contains(&(at - 5));
            prop_assert!(unalterable, "a false end mark at {} of {:02X?}", at, sent);
        }
    }

    #[test]
    fn frames_are_found_at_once_in_any_chunks_and_every_byte_is_accounted_for(
        stream in vec(piece(), 0..12).prop_map(|pieces| pieces.concat()),
        sizes in vec(1..100usize, 1..6),
    ) {
        let mut receiver = Receiver::new();
        let (mut found, mut fed) = (vec![], 0);
        for piece in cut(&stream, &sizes) {
            found.extend(hear(&mut receiver, [piece]));
            fed += piece.len();
            prop_assert_eq!(&found, &search(&stream[..fed], false));
            let accepted: usize = found.iter().map(Vec::len).sum();
            let reception = receiver.reception();
            prop_assert_eq!(reception.frames_ok as usize, found.len());
            prop_assert_eq!(accepted + reception.bytes_skipped as usize + receiver.pending(), fed);
        }
        prop_assert_eq!(fed, stream.len());
        let mut whole = Receiver::new();
        prop_assert_eq!(&hear(&mut whole, [&stream[..]]), &found);
        prop_assert_eq!(whole.reception(), receiver.reception());

        found.extend(give_up(&mut receiver));
        let accepted: usize = found.iter().map(Vec::len).sum();
        prop_assert_eq!(accepted + receiver.reception().bytes_skipped as usize, stream.len());
        prop_assert_eq!(found, search(&stream, true));
    }
}

/// A thousand times: a thousand bytes of noise, a good frame directly behind it, silence, and a
/// good frame behind that. Answers how many of the first and of the second good ones were found,
/// and how many false ones.
fn storm(mut noise: impl FnMut(&mut TestRng) -> u8, sizes: &[usize]) -> [usize; 3] {
    let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    let mut receiver = Receiver::new();
    let good = good();
    let mut found = [0; 3];
    for _ in 0..1000 {
        let mut stream: Vec<u8> = (0..1000).map(|_| noise(&mut rng)).collect();
        stream.extend(&good);
        let mut frames = hear(&mut receiver, cut(&stream, sizes));
        frames.extend(give_up(&mut receiver));
        let first = frames.iter().filter(|frame| **frame == good).count();
        let second = usize::from(hear(&mut receiver, cut(&good, sizes)) == [good.clone()]);
        found = [found[0] + first, found[1] + second, found[2] + frames.len() - first];
    }
    found
}

#[test]
fn a_million_random_bytes_hide_no_good_frame_and_make_hardly_any_false_one() {
    let sizes: Vec<usize> = (0..997).map(|k| 1 + k * k % 131).collect();
    for sizes in [&[1][..], &[7], &[64], &sizes] {
        // A false frame needs two start bytes, two end bytes and the checksum: 2^-40 for each of
        // the million places where it could begin, one in a million in all.
        assert_eq!(storm(|rng| rng.next_u32() as u8, sizes), [1000, 1000, 0]);

        // Noise of nearly nothing but marks. Each of their four bytes comes with p = 1/4 + 1/1024
        // and the checksum with 1/256: p^4 / 256 of a million places make 15.5 false frames,
        // standard deviation 3.9; four of these either way are 0 to 31, and none at all would
        // mean that the noise was harmless. One that ends with the good frame's end mark (places
        // for it: 3, for LEN 2, 13 and 94) may swallow that: p^2 * 3/4 / 256 of a thousand, 0.2.
        let mark_like = |rng: &mut TestRng| match rng.next_u32().to_le_bytes() {
            [byte, choice, ..] => [byte, 0x5E, 0x02, 0x0D][usize::from(choice % 4)],
        };
        let [first, second, false_frames] = storm(mark_like, sizes);
        assert!((997..=1000).contains(&first), "{first} good frames in the noise");
        assert_eq!(second, 1000, "good frames behind the silence");
        assert!((1..=31).contains(&false_frames), "{false_frames} false frames");
    }
}

/// The good frame, and nothing else, is found behind the damage.
fn only_good_is_found(damaged: &[u8], what: &str) {
    let stream = [damaged, &good()].concat();
    for chunk in [1, 3, stream.len()] {
        assert_eq!(hear_all(&stream, chunk), [good()], "{what}: {stream:02X?} by {chunk}");
    }
}

/// Every frame that differs from this one in a single bit, with the place of its byte.
fn single_bit_flips(frame: &[u8]) -> impl Iterator<Item = (usize, Vec<u8>)> {
    (0..frame.len() * 8).map(|bit| {
        let mut flipped = frame.to_vec();
        flipped[bit / 8] ^= 1 << (bit % 8);
        (bit / 8, flipped)
    })
}

#[test]
fn every_single_bit_flip_is_rejected_and_the_next_frame_is_found() {
    for example in examples() {
        assert_eq!(hear_all(&example, 1), std::slice::from_ref(&example));
        for (_, flipped) in single_bit_flips(&example) {
            only_good_is_found(&flipped, "flip");
        }
    }
}

// A frame that loses as many bytes as the next one has ends with that one's end mark, and its
// checksum is right by chance once in 256: no receiver can tell. None of these is such a case.
#[test]
fn every_truncation_is_rejected_and_the_next_frame_is_found() {
    for example in examples() {
        for length in 0..example.len() {
            only_good_is_found(&example[..length], "truncation");
        }
    }
}

#[test]
fn a_good_frame_inside_a_bad_one_is_found_wherever_it_begins() {
    // A false start that claims 255 bytes, and the good frame at every place among them. When as
    // many bytes have come the receiver needs no silence to find it.
    for at in 6..=MAX_FRAME {
        for filler in [0, STX[0]] {
            let mut stream = vec![filler; at];
            stream[..6].copy_from_slice(&FALSE_START);
            stream.extend(good());
            only_good_is_found(&stream[..at], "false start");
            stream.resize(stream.len().max(MAX_FRAME), filler);
            for chunk in [1, 3, stream.len()] {
                let frames = hear(&mut Receiver::new(), stream.chunks(chunk));
                assert_eq!(frames, [good()], "at {at} by {chunk}");
            }
        }
    }
    // A whole frame around it, with its checksum or its end mark damaged; and a sound one, of
    // which it is but the DATA.
    let around = frame(1, 0, 7, &[&[0x5E][..], &good(), &[0x5E]].concat());
    assert_eq!(hear_all(&around, 1), std::slice::from_ref(&around));
    for from_end in 1..=3 {
        let mut bad = around.clone();
        *bad.iter_mut().nth_back(from_end - 1).unwrap() ^= 0x10;
        assert_eq!(hear_all(&bad, 1), [good()]);
        assert_eq!(hear_all(&bad, bad.len()), [good()]);
    }
}

#[test]
fn a_damaged_command_moves_nothing_and_the_next_frame_is_acknowledged() {
    let examples = examples();
    for example in [&examples[0], &examples[2]] {
        for (at, flipped) in single_bit_flips(example) {
            let mut bench = Bench::quiet();
            let before = bench.board.link();
            bench.board.line.host_sends(&flipped);
            bench.send(Command::Ping);
            // 2 ms on the line, 100 ms of silence at most, and the acknowledgement's 1 ms.
            bench.run_ms(110);
            assert_eq!(bench.acks(), 1, "{flipped:02X?}");
            bench.run_ms(490);
            assert_eq!(bench.acks(), 0, "{flipped:02X?}");
            assert_eq!(bench.board.plant.borrow().outputs, Outputs::default());
            let after = bench.board.link();
            assert_eq!(after.frames_ok - before.frames_ok, 1);
            assert_eq!(after.bytes_skipped - before.bytes_skipped, flipped.len() as u32);
            // Without its start it is no bad frame, but noise.
            assert_eq!(after.bad_frames - before.bad_frames, u32::from(at >= 2), "{flipped:02X?}");
        }
    }
}

#[test]
fn a_false_start_holds_up_a_frame_for_100_ms_of_silence() {
    let mut bench = Bench::quiet();
    let sent = Instant::now();
    bench.board.line.host_sends(&FALSE_START);
    bench.send(Command::Ping);
    bench.run_ms(300);
    let frames = bench.received();
    let [ack] = &frames[..] else { panic!("{frames:?}") };
    assert!(ack.is_ack());
    // 16 bytes on the line, the silence, and the 10 bytes of the acknowledgement: 102.26 ms.
    let delay = ack.at - sent;
    assert!(delay >= Duration::from_micros(102_200), "{delay}: too impatient");
    assert!(delay <= Duration::from_micros(103_300), "{delay}: too patient");
    assert_eq!(bench.board.link().bad_frames, 1);
}

#[test]
fn a_false_start_holds_up_a_busy_line_for_half_a_second() {
    let mut bench = Bench::quiet();
    let sent = Instant::now();
    bench.board.line.host_sends(&FALSE_START);
    // A frame every 50 ms: the line never pauses for long enough, and 255 bytes take 1.3 s.
    for _ in 0..12 {
        bench.send(Command::Ping);
        bench.run_ms(50);
    }
    let frames = bench.received();
    assert_eq!(frames.iter().filter(|frame| frame.is_ack()).count(), 12);
    let delay = frames[0].at - sent;
    assert!(delay >= Duration::from_millis(500), "{delay}: too impatient");
    assert!(delay <= Duration::from_millis(505), "{delay}: too patient");
}

#[test]
fn a_frame_that_begins_late_is_not_given_up_with_the_false_start_before_it() {
    // The bytes of the false start trickle in, and a good frame begins behind them: once when
    // all 264 have come and it has been rejected, once when some are still missing. When the false
    // start's half second is over, the good frame is 2 ms old; its rest comes 10 ms later.
    for (trickle, bad_frames) in [(26, 1), (20, 0)] {
        let mut bench = Bench::quiet();
        bench.board.line.host_sends(&FALSE_START);
        for _ in 0..9 {
            bench.run_ms(50);
            bench.board.line.host_sends(&vec![0; trickle]);
        }
        bench.run_ms(45);
        let (begin, rest) = (&good()[..4], &good()[4..]);
        bench.board.line.host_sends(&[&[0; 24], begin].concat());
        bench.run_ms(4);
        assert_eq!(bench.board.link().bad_frames, bad_frames);
        bench.run_ms(11);
        bench.board.line.host_sends(rest);
        bench.run_ms(200);
        assert_eq!(bench.acks(), 1, "trickle of {trickle}");
    }
}
