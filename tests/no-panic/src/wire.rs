//! Every wire format: what any bytes are read as, and what is read written again.

use core::hint::black_box;

use protocol::arcos::{
    ArmCommand, ArmInfo, ArmStatus, Dialect, MotionBits, Names, Packet, Standard, encode_command,
    extension,
};
use protocol::cm5::{self, Feedback, Goals, Hello, HelloAnswer, Limits, ServoGoal};
use protocol::deframe::{Deframer, Framing};
use protocol::dynamixel::{self, Dynamixel, Instruction};
use protocol::extension::{Answer, Request};
use protocol::pms5005::{self, Command, Frame, Report};

use crate::any;

pub fn run() {
    let received: [u8; 300] = black_box([0; 300]);
    let bytes = &received[..usize::from(any::<u8>())];
    frames_of::<pms5005::Pms5005, { pms5005::MAX_FRAME }>(bytes);
    frames_of::<protocol::arcos::Arcos, { protocol::arcos::MAX_RECEIVED }>(bytes);
    frames_of::<cm5::Cm5, { cm5::MAX_PACKET }>(bytes);
    frames_of::<Dynamixel, { dynamixel::MAX_PACKET }>(bytes);
    pms5005(bytes);
    arcos(bytes);
    cm5(bytes);
    dynamixel(bytes);
}

/// Whatever a receiver makes of bytes, in whatever pieces they come.
fn frames_of<F: Framing, const N: usize>(bytes: &[u8]) {
    let mut deframer: Deframer<F, N> = Deframer::new();
    while any::<u8>() == 0 {
        deframer = black_box(deframer);
        let mut rest = bytes;
        while let Some(frame) = deframer.receive(&mut rest) {
            black_box(frame);
        }
        black_box(deframer.give_up());
        black_box(deframer.give_up_front());
        black_box((deframer.frame(), deframer.pending(), deframer.reception()));
    }
}

fn pms5005(bytes: &[u8]) {
    let mut out = [0; pms5005::MAX_FRAME];
    let Some(frame) = Frame::parse(bytes) else { return };
    let _ = black_box(frame.encode(&mut out));
    if let Ok(command) = Command::parse(frame.did, frame.data) {
        let _ = black_box(command.encode(any(), &mut out));
    }
    if let Some(report) = Report::parse(frame.did, frame.data) {
        let _ = black_box(report.encode(&mut out));
    }
    if let Some(answer) = Answer::parse(frame.did, frame.data) {
        let _ = black_box(pms5005::encode_answer(&answer, &mut out));
        let _ = black_box(extension::encode_answer(&answer, &mut out));
    }
}

fn arcos(bytes: &[u8]) {
    let mut out = [0; protocol::arcos::MAX_RECEIVED];
    let Some(packet) = Packet::parse(bytes) else { return };
    let _ = black_box(packet.encode(&mut out));
    if let Ok(command) = ArmCommand::parse(packet.id, packet.data) {
        let _ = black_box(command.encode(&mut out));
    }
    if let Some(Ok(request)) = extension::parse_request(&packet) {
        let _ = black_box(extension::encode_request(&request, &mut out));
        if let Request::Set(assignments) = request {
            assignments.iter().for_each(|assignment| _ = black_box(assignment));
        }
    }
    let dialects = [
        Dialect::Manual(MotionBits::OneToSix),
        Dialect::Manual(MotionBits::ZeroToFive),
        Dialect::Aria,
    ];
    for dialect in dialects {
        if let Some(status) = ArmStatus::parse(&packet, dialect) {
            let _ = black_box(status.encode(dialect, &mut out));
        }
    }
    if let Some(info) = ArmInfo::parse(&packet) {
        let _ = black_box(info.encode(&mut out));
    }
    if let Some(standard) = Standard::parse(&packet) {
        let _ = black_box(standard.encode(&mut out));
    }
    if let Some(names) = Names::parse(&packet) {
        let _ = black_box(names.encode(&mut out));
    }
    let _ = black_box(encode_command(packet.id, None, &mut out));
}

fn cm5(bytes: &[u8]) {
    let mut out = [0; cm5::MAX_PACKET];
    let Some(params) = cm5::params_of(bytes) else { return };
    let servos = usize::from(any::<u8>());
    if let Some(hello) = Hello::parse(params) {
        let _ = black_box(hello.encode(&mut out));
    }
    if let Ok(answer) = HelloAnswer::parse(params, servos) {
        let limits: heapless::Vec<Limits, { cm5::MAX_SERVOS }> =
            (0..cm5::MAX_SERVOS).map_while(|servo| answer.limits(servo)).collect();
        let _ = black_box(HelloAnswer::encode(any(), &limits, &mut out));
        black_box(answer.setup(servos));
    }
    if let Ok(goals) = Goals::parse(params, servos) {
        let all: heapless::Vec<ServoGoal, { cm5::MAX_SERVOS }> =
            goals.iter().take(cm5::MAX_SERVOS).collect();
        let _ = black_box(Goals::encode(&all, &mut out));
    }
    if let Some(report) = cm5::Report::parse(params, servos) {
        let all: heapless::Vec<Option<Feedback>, { cm5::MAX_SERVOS }> =
            report.iter().take(cm5::MAX_SERVOS).collect();
        let _ = black_box(cm5::Report::encode(all.iter().copied(), &mut out));
    }
}

fn dynamixel(bytes: &[u8]) {
    let mut out = [0; dynamixel::MAX_PACKET];
    let Some(packet) = dynamixel::Packet::parse(bytes) else { return };
    let _ = black_box(packet.encode(&mut out));
    if let Some(instruction) = Instruction::parse(packet) {
        let _ = black_box(instruction.encode(packet.id, &mut out));
        if let Instruction::SyncWrite(write) = instruction {
            write.servos().for_each(|servo| _ = black_box(servo));
        }
    }
}
