//! The shipped image says what the virtual board says, to a script with every DID in it.
//!
//! The chip's time is not the virtual board's to the microsecond, and its analogue values come through
//! a converter. So what is compared byte for byte is everything that answers: acknowledgements and
//! pings in their number and order; telemetry by its kinds, its lengths, and, at rest, its values.

#[path = "../../tests/qemu/script.rs"]
mod script;

use std::collections::BTreeSet;

use chip::bench::Make;
use chip::bench::pms5005::Host;
use embassy_time::{Duration, Instant};
use hal_mock::board::{self, VirtualBoard};
use hal_mock::plant::Scene;
use protocol::deframe::Deframer;
use protocol::pms5005::{Frame, MAX_FRAME, Pms5005, Report, did};

use script::{ACKS, script};

/// A frame: RES, DID, DATA.
type Said = (u8, u8, Vec<u8>);

fn quiet_scene() -> Scene {
    Scene { noise_lsb: 0.0, ..Scene::default() }
}

/// What the chip says to the script.
fn chip_says() -> Vec<Said> {
    let mut host =
        Host::boot_with("pms5005-f407", Make { scene: quiet_scene(), ..Make::default() });
    let mut said = Vec::new();
    for step in script() {
        host.bench.line.send(&step.bytes);
        while !host.bench.line.is_idle() {
            host.run_for(1);
        }
        host.run_for(step.pause.as_millis() as u64 + 1);
        said.extend(host.heard());
    }
    host.run_for(100);
    said.extend(host.heard());
    let reception = host.reception();
    assert_eq!((reception.bad_frames, reception.bytes_skipped), (0, 0), "whole frames, all intact");
    said.into_iter().map(|frame| (frame.res, frame.did, frame.data)).collect()
}

/// What a virtual board says to it.
fn virtual_board_says() -> Vec<Said> {
    let mut board =
        VirtualBoard::new(board::Make { scene: quiet_scene(), ..board::Make::default() });
    board.run_until(Instant::from_millis(60));
    let mut deframer: Deframer<Pms5005, MAX_FRAME> = Deframer::new();
    let mut said = Vec::new();
    let mut collect = |board: &mut VirtualBoard, said: &mut Vec<Said>| {
        while let Some((_, bytes)) = board.line.host_receives() {
            let mut bytes = &bytes[..];
            while let Some(frame) = deframer.receive(&mut bytes) {
                let Frame { res, did, data, .. } = Frame::parse(frame).unwrap();
                said.push((res, did, data.to_vec()));
            }
        }
    };
    collect(&mut board, &mut said);
    said.clear();
    for step in script() {
        board.line.host_sends(&step.bytes);
        let on_the_line = Duration::from_micros(step.bytes.len() as u64 * 87);
        board.run_for(on_the_line + Duration::from_micros(step.pause.as_micros() as u64));
        collect(&mut board, &mut said);
    }
    board.run_for(Duration::from_millis(100));
    collect(&mut board, &mut said);
    said
}

#[test]
fn every_did_is_answered_with_the_bytes_of_the_virtual_board() {
    let (chip, computer) = (chip_says(), virtual_board_says());
    let answers = |said: &[Said]| -> Vec<Said> {
        let answers = said.iter().filter(|(res, _, data)| *res == 0 && data[..] == [1]);
        answers.cloned().collect()
    };
    assert_eq!(answers(&chip).len(), ACKS);
    assert_eq!(answers(&chip), answers(&computer));
    let kinds = |said: &[Said]| -> BTreeSet<(u8, u8, usize)> {
        said.iter().map(|(res, did, data)| (*res, *did, data.len())).collect()
    };
    assert_eq!(kinds(&chip), kinds(&computer));
    // The same telemetry; the chip's host waits up to 2 ms longer for each of its steps.
    for number in [did::MOTORS, did::CUSTOM_IO, did::SENSORS] {
        let count = |said: &[Said]| said.iter().filter(|frame| frame.1 == number).count();
        let (here, there) = (count(&chip), count(&computer));
        assert!(here.abs_diff(there) * 20 <= there, "DID {number}: {here} here, {there} there");
    }
    // At rest the first reports say the same.
    let first = |said: &[Said], number| {
        let mut reports = said.iter().filter(|frame| frame.0 == 255 && frame.1 == number);
        reports.next().and_then(|(_, did, data)| Report::parse(*did, data)).expect("a report")
    };
    let (Report::CustomIo(here), Report::CustomIo(there)) =
        (first(&chip, did::CUSTOM_IO), first(&computer, did::CUSTOM_IO))
    else {
        panic!("another kind");
    };
    assert_eq!(here.inputs, there.inputs);
    for (here, there) in here.custom_ad.into_iter().zip(there.custom_ad) {
        assert!(here.abs_diff(there) <= 3, "{here} here, {there} there");
    }
}
