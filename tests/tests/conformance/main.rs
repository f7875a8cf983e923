//! The PMS5005 manual, section by section and byte by byte.
//!
//! Frames stand here as the manual prints them, so that encoder, receiver and board are each held
//! to the manual and not to each other. A board that is given an example must acknowledge it with
//! the bytes of section III and do what the example says.

mod examples;
mod reports;
mod table_ii_1;

use std::num::NonZeroU8;

use firmware::ports::{MotorOutput, Outputs};
use firmware::units::{Duty, ServoPulse};
use hal_mock::plant::Overrides;
use protocol::pms5005::{
    Addressing, CHANNELS, Channel, Command, CustomIoReport, ETX, Encoder, Frame, Gain, LcdFrame,
    Loop, Method, MotorReport, Move, Parameter, Parameters, Polarity, Quantity, Refusal, Repeat,
    Report, Reports, Scope, Sensor, SensorReport,
};
use tests::Bench;

/// "The acknowledge packet is shown as follows" (section III).
const ACK: [u8; 10] = [94, 2, 0, 0, 255, 1, 1, 72, 94, 13];

/// The C code of Figure II.1, transcribed.
fn figure_ii_1(body: &[u8]) -> u8 {
    body.iter().fold(0, |register, &byte| {
        (0..8).fold(register, |register, bit| {
            let feedback = (register ^ (byte >> bit)) & 1;
            (register >> 1) ^ (feedback * 0x8C)
        })
    })
}

fn encoded(command: Command) -> Vec<u8> {
    command.encode(0, &mut [0; 264]).expect("a command that can be encoded").to_vec()
}

fn motion(
    quantity: Quantity,
    addressing: Addressing,
    set: &[(usize, i16)],
    periods: u16,
) -> Command<'static> {
    let mut targets = [None; CHANNELS];
    for &(channel, target) in set {
        targets[channel] = Some(target);
    }
    Command::Move(Move { quantity, addressing, targets, periods })
}

fn list(quantity: Quantity, channel: usize, target: i16) -> Command<'static> {
    motion(quantity, Addressing::List, &[(channel, target)], 0)
}

/// What the board has sent since it was last asked, frame by frame, with every byte.
fn arrived(bench: &Bench) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| bench.board.line.host_receives()).map(|(_, bytes)| bytes).collect()
}

/// Sends bytes that the board must acknowledge, once and with nothing else.
fn acknowledged(bench: &mut Bench, frame: &[u8]) {
    bench.board.line.host_sends(frame);
    bench.run_ms(20);
    assert_eq!(arrived(bench), [ACK], "the answer to {frame:?}");
}

fn outputs(bench: &Bench) -> Outputs {
    bench.board.plant.borrow().outputs
}

#[test]
fn section_iii_other_dids_are_acknowledged_and_ignored() {
    let mut bench = Bench::quiet();
    let before = bench.board.link();
    // Friction compensation as hosts in the field send it, and another that they send.
    bench.send_raw(31, &[0, 1, 2]);
    bench.send_raw(80, &[]);
    bench.run_ms(20);
    assert_eq!(arrived(&bench), [ACK, ACK]);
    let after = bench.board.link();
    assert_eq!((after.unknown - before.unknown, after.refused - before.refused), (2, 0));
    assert_eq!(outputs(&bench), Outputs::default());
}

/// Example III.1.1 with another RID or RES.
fn servo_3(rid: u8, res: u8) -> Vec<u8> {
    let frame = Frame { rid, res, did: 28, data: &[2, 0, 8] };
    frame.encode(&mut [0; 264]).unwrap().to_vec()
}

#[test]
fn section_ii_2_frames_for_other_devices_are_ignored_silently() {
    let mut bench = Bench::quiet();
    let before = bench.board.link();
    bench.board.line.host_sends(&servo_3(8, 0));
    bench.run_ms(50);
    assert_eq!((arrived(&bench).len(), outputs(&bench)), (0, Outputs::default()));
    let after = bench.board.link();
    assert_eq!(after.not_for_us - before.not_for_us, 1);
    assert_eq!(after.frames_for_us, before.frames_for_us);
    assert_eq!(after.frames_ok - before.frames_ok, 1);
}

#[test]
fn section_iii_reserved_255_is_carried_out_without_acknowledgement() {
    let mut bench = Bench::quiet();
    bench.board.line.host_sends(&servo_3(1, 255));
    bench.run_ms(50);
    assert_eq!((arrived(&bench).len(), bench.pulse(2)), (0, Some(2048)));
    // Any other value of the reserved byte asks for one.
    acknowledged(&mut bench, &servo_3(1, 254));
}
