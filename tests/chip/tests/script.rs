//! The shipped image says what the virtual board says, to a script with every DID in it.
//!
//! The chip's time is not the virtual board's to the microsecond, and its analogue values come through
//! a converter. So what is compared byte for byte is everything that answers, in its order; telemetry by
//! its kinds, its lengths, how often it comes and, at rest, every one of its values.

#[path = "../../src/every_did.rs"]
mod every_did;

use std::collections::BTreeSet;

use chip::bench::Make;
use chip::bench::pms5005::Host;
use embassy_time::{Duration, Instant};
use hal_mock::board::{self, VirtualBoard};
use hal_mock::plant::Scene;
use protocol::deframe::Deframer;
use protocol::pms5005::{Frame, MAX_FRAME, Pms5005, Report, did};

use every_did::{ACKS, script};

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
    // Everything that is neither telemetry nor a ping, whose moments are the clock's.
    let answers = |said: &[Said]| -> Vec<Said> {
        let is_telemetry = |did: u8| [did::MOTORS, did::CUSTOM_IO, did::SENSORS].contains(&did);
        let is_ping = |(_, did, data): &Said| *did == did::SETUP && data[..] == [0];
        let answers = said.iter().filter(|frame| !is_telemetry(frame.1) && !is_ping(frame));
        answers.cloned().collect()
    };
    let acks = answers(&chip).iter().filter(|(_, _, data)| data[..] == [1]).count();
    assert_eq!(acks, ACKS);
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
    // At rest, before the script moves anything, all reports say the same.
    let first = |said: &[Said], number| -> Report {
        let mut reports = said.iter().filter(|frame| frame.0 == 255 && frame.1 == number);
        reports.next().and_then(|(_, did, data)| Report::parse(*did, data)).expect("a report")
    };
    for number in [did::MOTORS, did::CUSTOM_IO, did::SENSORS] {
        let (here, there) = (values(&first(&chip, number)), values(&first(&computer, number)));
        assert_eq!(here.len(), there.len());
        for (place, (here, there)) in here.into_iter().zip(there).enumerate() {
            assert!(here.abs_diff(there) <= 3, "DID {number}, {place}: {here} here, {there} there");
        }
    }
}

/// What a report tells, value by value.
fn values(report: &Report) -> Vec<u16> {
    let bytes = |bytes: &[u8]| bytes.iter().map(|&byte| byte.into()).collect::<Vec<u16>>();
    match report {
        Report::Motors(report) => {
            let encoders =
                report.encoders.iter().flat_map(|encoder| [encoder.count, encoder.speed]);
            let analog = report.potentiometers.iter().chain(&report.currents).copied();
            analog.chain(encoders).collect()
        }
        Report::CustomIo(report) => [&report.custom_ad[..], &[report.inputs.into()]].concat(),
        Report::Sensors(report) => [
            bytes(&report.sonar_cm),
            bytes(&report.ir_command),
            report.human.to_vec(),
            report.tilt.to_vec(),
            report.overheat.to_vec(),
            vec![report.temperature, report.ir_range],
            report.battery.to_vec(),
            report.reference.to_vec(),
        ]
        .concat(),
    }
}
