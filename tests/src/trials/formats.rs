//! Every parser with any bytes, and both directions of every format: what is read means the same when
//! it is written and read again, and what is written arrives whole.

use protocol::arcos::{
    self, Argument, ArmCommand, ArmInfo, ArmStatus, Dialect, MotionBits, Names, Standard,
    encode_command,
};
use protocol::cm5::{self, Goals, Hello, HelloAnswer, params_of};
use protocol::deframe::{Deframer, Framing};
use protocol::dynamixel::{self, Id, Instruction};
use protocol::extension::{Answer, Request};
use protocol::pms5005::{
    self, Command, Frame, MAX_DATA, MAX_FRAME, OVERHEAD, Pms5005, Report, encode_answer,
};

use super::Choices;

/// A receiver finds this frame, and nothing else.
fn arrives<F: Framing, const N: usize>(sent: &[u8]) {
    let (mut receiver, mut bytes) = (Deframer::<F, N>::new(), sent);
    assert_eq!(receiver.receive(&mut bytes), Some(sent), "{sent:02X?}");
}

fn command(did: u8, data: &[u8]) {
    let Ok(command) = Command::parse(did, data) else { return };
    let mut buffer = [0; MAX_FRAME];
    let frame = command.encode(0, &mut buffer).expect("what was read can be written");
    arrives::<Pms5005, MAX_FRAME>(frame);
    let told = Frame::parse(frame).unwrap();
    assert_eq!((told.did, Command::parse(did, told.data)), (did, Ok(command)));
    match command {
        Command::Parameters(parameters) => {
            let mut again = pms5005::Data::new();
            // Short forms are written as long ones, which may be too long for a frame.
            if parameters.iter().try_for_each(|parameter| parameter.emit(&mut again)).is_ok() {
                let again = pms5005::Parameters::parse(&again).unwrap();
                assert!(parameters.iter().eq(again.iter()));
            }
        }
        Command::Extension(Request::Set(assignments)) => {
            assert_eq!(assignments.iter().count() * 7, data.len());
        }
        _ => {}
    }
}

fn frame([rid, res, did]: [u8; 3], data: &[u8]) {
    let data = &data[..data.len().min(MAX_DATA)];
    let frame = Frame { rid, res, did, data };
    let mut buffer = [0; MAX_FRAME];
    let sent = frame.encode(&mut buffer).expect("DATA that fits");
    arrives::<Pms5005, MAX_FRAME>(sent);
    assert_eq!(Frame::parse(sent), Some(frame));
    let short = &mut [0; MAX_FRAME][..sent.len() - 1];
    assert!(frame.encode(short).is_err(), "no frame is cut short");
}

fn report(did: u8, data: &[u8]) {
    let Some(report) = Report::parse(did, data) else { return };
    let mut buffer = [0; Report::MAX_FRAME];
    let sent = report.encode(&mut buffer).unwrap();
    arrives::<Pms5005, MAX_FRAME>(sent);
    let told = Frame::parse(sent).unwrap().data;
    assert_eq!(told.len(), data.len());
    let again = Report::parse(did, told).expect("a report");
    let mut buffer = [0; Report::MAX_FRAME];
    assert_eq!(again.encode(&mut buffer).unwrap(), sent, "what gave way once stays");
}

fn answer(did: u8, data: &[u8]) {
    let Some(answer) = Answer::parse(did, data) else { return };
    let mut buffer = [0; MAX_FRAME];
    let Ok(sent) = encode_answer(&answer, &mut buffer) else {
        panic!("what was read can be written: {answer:?}");
    };
    arrives::<Pms5005, MAX_FRAME>(sent);
    assert_eq!(Answer::parse(did, Frame::parse(sent).unwrap().data), Some(answer));
    assert!(sent.len() <= OVERHEAD + Answer::MAX_DATA);
}

fn arcos_packet(id: u8, data: &[u8]) {
    let data = &data[..data.len().min(arcos::MAX_SENT - arcos::OVERHEAD)];
    let packet = arcos::Packet { id, data };
    let mut buffer = [0; arcos::MAX_SENT];
    let sent = packet.encode(&mut buffer).expect("data that fits");
    arrives::<arcos::Arcos, { arcos::MAX_RECEIVED }>(sent);
    assert_eq!(arcos::Packet::parse(sent), Some(packet));
    let mut buffer = [0; arcos::MAX_SENT];
    let out = &mut buffer[..];
    let again =
        |sent: &[u8]| arcos::Packet::parse(sent).map(|packet| packet.data.to_vec()).unwrap();
    if let Ok(Some(argument)) = Argument::parse(data) {
        let sent = encode_command(id, Some(argument), out).unwrap();
        assert_eq!(Argument::parse(&again(sent)), Ok(Some(argument)));
    }
    if let Ok(command) = ArmCommand::parse(id, data) {
        let sent = command.encode(out).unwrap();
        assert_eq!(ArmCommand::parse(id, &again(sent)), Ok(command));
    }
    if let Some(Ok(request)) = arcos::extension::parse_request(&packet) {
        let sent = arcos::extension::encode_request(&request, out).unwrap();
        let told = arcos::Packet::parse(sent).unwrap();
        assert_eq!(arcos::extension::parse_request(&told), Some(Ok(request)));
    }
    for dialect in [
        Dialect::Manual(MotionBits::OneToSix),
        Dialect::Manual(MotionBits::ZeroToFive),
        Dialect::Aria,
    ] {
        if let Some(status) = ArmStatus::parse(&packet, dialect) {
            let sent = status.encode(dialect, out).unwrap();
            let told = arcos::Packet::parse(sent).unwrap();
            assert_eq!(ArmStatus::parse(&told, dialect), Some(status));
        }
    }
    if let Some(info) = ArmInfo::parse(&packet) {
        let told = info.encode(out).unwrap();
        assert_eq!(ArmInfo::parse(&arcos::Packet::parse(told).unwrap()), Some(info));
    }
    if let Some(names) = Names::parse(&packet) {
        let told = names.encode(out).unwrap();
        assert_eq!(Names::parse(&arcos::Packet::parse(told).unwrap()), Some(names));
    }
    if let Some(standard) = Standard::parse(&packet) {
        assert_eq!(standard.encode(out).unwrap(), &*sent);
    }
}

fn cm5_packet(servos: usize, params: &[u8]) {
    let mut buffer = [0; cm5::MAX_PACKET];
    let params = &params[..params.len().min(300)];
    let sent = cm5::encode([params], &mut buffer).expect("parameters that fit");
    arrives::<cm5::Cm5, { cm5::MAX_PACKET }>(sent);
    assert_eq!(params_of(sent), Some(params));
    let mut buffer = [0; cm5::MAX_PACKET];
    let out = &mut buffer[..];
    if let Some(hello) = Hello::parse(params)
        && hello.ids.len() <= cm5::MAX_SERVOS
    {
        assert_eq!(hello.encode(out).unwrap(), &*sent);
    }
    if let Ok(answer) = HelloAnswer::parse(params, servos) {
        let limits: Vec<_> = (0..).map_while(|place| answer.limits(place)).take(servos).collect();
        assert_eq!(limits.len(), servos);
        let sent = HelloAnswer::encode(answer.return_delay, &limits, out).unwrap();
        let told = HelloAnswer::parse(params_of(sent).unwrap(), servos).unwrap();
        assert!((0..servos).all(|place| told.setup(place) == answer.setup(place)));
    }
    if let Ok(goals) = Goals::parse(params, servos) {
        let goals: Vec<_> = goals.iter().collect();
        assert_eq!(Goals::encode(&goals, out).unwrap(), &*sent);
        for goal in goals {
            let registers = cm5::ServoGoal::REGISTERS.into_iter();
            let again = registers.fold(cm5::ServoGoal::default(), |again, register| {
                again.with(register, goal.get(register))
            });
            assert_eq!(again, goal);
        }
    }
    if let Some(report) = cm5::Report::parse(params, servos) {
        assert_eq!(cm5::Report::encode(report.iter(), out).unwrap(), &*sent);
    }
}

fn servo_packet(id: u8, code: u8, params: &[u8]) {
    let Some(id) = Id::new(id) else { return };
    let params = &params[..params.len().min(dynamixel::MAX_PARAMS)];
    let packet = dynamixel::Packet { id, code, params };
    let mut buffer = [0; dynamixel::MAX_PACKET];
    let sent = packet.encode(&mut buffer).expect("parameters that fit");
    arrives::<dynamixel::Dynamixel, { dynamixel::MAX_PACKET }>(sent);
    assert_eq!(dynamixel::Packet::parse(sent), Some(packet));
    if let Some(instruction) = Instruction::parse(packet) {
        let mut again = [0; dynamixel::MAX_PACKET];
        let again = instruction.encode(id, &mut again).unwrap();
        let told = dynamixel::Packet::parse(again).unwrap();
        assert_eq!(Instruction::parse(told), Some(instruction));
        if let Instruction::SyncWrite(write) = instruction {
            let bytes: usize = write.servos().map(|(_, bytes)| bytes.len() + 1).sum();
            assert_eq!(bytes + 2, params.len());
        }
    }
}

/// What takes a whole frame apart takes any bytes for one.
fn not_frames(bytes: &[u8]) {
    let mut buffer = [0; MAX_FRAME];
    if let Some(frame) = Frame::parse(bytes) {
        assert!(bytes[6..].starts_with(frame.data));
    }
    if let Some(packet) = arcos::Packet::parse(bytes)
        && packet.data.len() <= arcos::MAX_SENT - arcos::OVERHEAD
    {
        assert_eq!(packet.encode(&mut buffer).unwrap().len(), bytes.len());
    }
    if let Some(packet) = dynamixel::Packet::parse(bytes) {
        assert_eq!(dynamixel::Packet::received(bytes), Some(packet));
    }
    if let Some(params) = params_of(bytes) {
        assert!(params.len() < bytes.len());
    }
}

pub(super) fn trial(choices: &mut Choices) {
    let kind = choices.below(8);
    let [first, second, third] = [choices.byte(), choices.byte(), choices.byte()];
    let bytes = choices.rest(255);
    match kind {
        0 => command(first, &bytes),
        1 => frame([first, second, third], &bytes),
        2 => report(first, &bytes),
        3 => answer(first, &bytes),
        4 => arcos_packet(first, &bytes),
        5 => cm5_packet(usize::from(first % 101), &bytes),
        6 => servo_packet(first, second, &bytes),
        _ => not_frames(&bytes),
    }
}
