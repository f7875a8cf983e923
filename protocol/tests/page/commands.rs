//! What a host asks: DIDs, DATA, sub-commands of DID 7; and telemetry.

use protocol::extension::{Request, Verdict};
use protocol::pms5005::{
    Addressing, CHANNELS, Channel, Command, CustomIoReport, Data, Encoder, Frame, Gain, LcdFrame,
    Loop, MAX_FRAME, Method, MotorReport, Move, Parameter, Parameters, Polarity, Quantity, Refusal,
    Repeat, Report, Reports, Scope, Sensor, SensorReport,
};

use crate::fields::{fields, told};
use crate::frames::sent;
use crate::text::{bytes, table};

/// A motion command at once.
pub fn motion(quantity: Quantity, addressing: Addressing, set: &[(usize, i16)]) -> Move {
    let mut targets = [None; CHANNELS];
    set.iter().for_each(|&(channel, target)| targets[channel] = Some(target));
    Move { quantity, addressing, targets, periods: 0 }
}

/// Whether a host's frame with this DID is known, whatever its DATA is.
fn is_known(did: u8) -> bool {
    let data = [0; 70];
    let is_unknown = |parsed| {
        use Refusal::{Extension, UnknownDid};
        matches!(parsed, Err(UnknownDid(_) | Extension(Verdict::Unknown)))
    };
    (0..data.len()).any(|len| !is_unknown(Command::parse(did, &data[..len])))
}

#[test]
fn the_page_has_every_did_that_a_host_may_send() {
    let did = |row: &Vec<&str>| row[0].parse::<u8>().ok();
    let mut listed: Vec<_> = table("Commands", "DID").iter().filter_map(did).collect();
    listed.extend(table("Requests", "DID").iter().filter_map(did));
    listed.sort_unstable();
    listed.dedup();
    let known: Vec<_> = (0..=255).filter(|did| is_known(*did)).collect();
    assert_eq!(listed, known);
}

#[test]
fn the_examples_of_commands_mean_what_the_page_says() {
    use Addressing::{All, List};
    use Quantity::{Position, Pwm, Servo, Velocity};
    let moved = |quantity, addressing, set: &[_]| Command::Move(motion(quantity, addressing, set));
    let all = |target| [0, 1, 2, 3, 4, 5].map(|channel| (channel, target));
    let within_500_ms = Move { periods: 500, ..motion(Velocity, All, &[(0, 0), (1, 0)]) };
    let telemetry = |reports, repeat| Command::Telemetry { reports, repeat };
    let times = |n: u8| Repeat::Times(n.try_into().unwrap());
    let encoder = Parameters::parse(&[0x0D, 0, 2]).unwrap();
    let servo_2 = Scope::Servo(Channel::Channel1);
    let picture = LcdFrame { number: 0, columns: &[0; 64] };
    let expected = [
        ("motor 1 to position 6000 at once", moved(Position, List, &[(0, 6000)])),
        (
            "motor 1 to position 6000 at once, the others are left alone",
            moved(Position, All, &[(0, 6000)]),
        ),
        ("motor 5 at PWM 4000", moved(Pwm, List, &[(4, 4000)])),
        ("all motors neutral: a stop", moved(Pwm, All, &all(16384))),
        ("motor 1 has an encoder", Command::Parameters(encoder)),
        ("outputs 0 and 7 on, the others off", Command::GpioOutputs(0b1000_0001)),
        ("the upper left eight rows", Command::Lcd(picture)),
        ("motor 1 at -400 counts/s, motor 2 at 400", moved(Velocity, List, &[(0, -400), (1, 400)])),
        ("motors 1 and 2 to velocity 0 within 500 ms", Command::Move(within_500_ms)),
        ("servo 3 to 2048", moved(Servo, List, &[(2, 2048)])),
        ("all servos to 3375", moved(Servo, All, &all(3375))),
        ("suspend servo 2", Command::Run { scope: servo_2, run: false }),
        ("three times", telemetry(Reports::Motors, times(3))),
        ("no more", telemetry(Reports::CustomIo, Repeat::Stop)),
        ("until further notice", telemetry(Reports::Sensors, Repeat::Continuous)),
        ("once", telemetry(Reports::All, times(1))),
        ("ping", Command::PingOrAck),
    ];
    let rows = table("Commands", "DID");
    assert_eq!(rows.len(), expected.len());
    for (row, (meaning, command)) in rows.iter().zip(expected) {
        let did: u8 = row[0].parse().unwrap();
        let mut data = bytes(row[3]);
        if row[3].ends_with("` and 64 bytes") {
            data.extend([0; 64]);
        }
        assert_eq!((row[4], Command::parse(did, &data)), (meaning, Ok(command)));
        let frame = sent(command);
        assert_eq!((frame[4], &frame[6..frame.len() - 3]), (did, &*data), "{meaning}");
    }
}

/// The sub-commands of DID 7 that are known, those of the manual or those of the extension.
fn sub_commands(of_extension: bool) -> Vec<u8> {
    let known = |sub: &u8| {
        let parsed = Command::parse(7, std::slice::from_ref(sub));
        !matches!(parsed, Err(Refusal::UnknownSubCommand(_) | Refusal::Extension(Verdict::Unknown)))
    };
    (0..=255).filter(|sub| (*sub >= 0x80) == of_extension).filter(known).collect()
}

#[test]
fn the_sub_commands_of_did_7_are_all_there_and_mean_what_the_page_says() {
    let one = Channel::Channel0;
    let gain = |control_loop, gain| Parameter::Gain(one, control_loop, gain);
    let expected: [(&str, &[Parameter]); 6] = [
        (
            "motor 1: its sensor falls when PWM is above neutral",
            &[Parameter::Polarity(one, Polarity::Negative)],
        ),
        (
            "motor 1: Kp 50, Kd 5, Ki 1.00",
            &[
                gain(Loop::Position, Gain::Proportional(50)),
                gain(Loop::Position, Gain::Derivative(5)),
                // 100 hundredths, low byte first.
                gain(Loop::Position, Gain::Integral { integer: 100, fraction: 0 }),
            ],
        ),
        (
            "motor 2: Kp 20",
            &[Parameter::Gain(Channel::Channel1, Loop::Velocity, Gain::Proportional(20))],
        ),
        ("motor 1 has an encoder", &[Parameter::Sensor(one, Sensor::Encoder)]),
        ("motor 1 is controlled by position", &[Parameter::Method(one, Method::Position)]),
        ("on", &[Parameter::CollisionProtection(true)]),
    ];
    let rows = table("System parameters (DID 7)", "sub-command");
    let number = |row: &Vec<&str>| u8::from_str_radix(row[0], 16).unwrap();
    assert_eq!(rows.iter().map(number).collect::<Vec<_>>(), sub_commands(false));
    for (row, (meaning, parameters)) in rows.iter().zip(expected) {
        let data = bytes(row[3]);
        assert_eq!((data[0], row[4]), (number(row), meaning));
        let parsed = Parameters::parse(&data).unwrap();
        assert_eq!(parsed.iter().collect::<Vec<_>>(), parameters, "{meaning}");
        if let [parameter] = parameters {
            let mut written = Data::new();
            parameter.emit(&mut written).unwrap();
            assert_eq!(&*written, &*data, "{meaning}");
        }
    }
    let in_requests = |row: &Vec<&str>| (row[0] == "7").then(|| bytes(row[3])[0]);
    let listed: Vec<_> = table("Requests", "DID").iter().filter_map(in_requests).collect();
    assert_eq!(listed, sub_commands(true));
}

#[test]
fn the_forms_of_motion_commands_are_taken_as_the_page_says() {
    let moved = |data: &[u8]| match Command::parse(3, data) {
        Ok(Command::Move(moved)) => moved.periods,
        other => panic!("{other:?}"),
    };
    // 28, 6, no flag; a flag with no time behind it.
    assert_eq!(moved(&[0, 0x70, 0x17, 0x1C, 0xD0, 7]), 2000);
    assert_eq!(moved(&[0, 0x70, 0x17, 6, 0xD0, 7]), 2000);
    assert_eq!(moved(&[0, 0x70, 0x17, 0xD0, 7]), 2000);
    assert_eq!(moved(&[0, 0x70, 0x17, 6]), 0);
    let twice = Command::parse(3, &[0, 0, 0, 0, 0, 0]);
    assert_eq!(twice, Err(Refusal::RepeatedChannel(0)));
    let settings = [0x80; 7].repeat(36);
    assert!(matches!(Command::parse(7, &settings), Ok(Command::Extension(Request::Set(_)))));
}

/// DATA of a report.
fn data(report: Report) -> Vec<u8> {
    let frame = report.encode(&mut [0; MAX_FRAME]).unwrap().to_vec();
    let frame = Frame::parse(&frame).unwrap();
    assert_eq!((frame.rid, frame.res, frame.did), (0, 255, report.did()));
    assert_eq!(Report::parse(frame.did, frame.data), Some(report));
    frame.data.to_vec()
}

#[test]
fn the_bytes_of_telemetry_stand_where_the_page_says() {
    let encode = |report: &MotorReport| data(Report::Motors(*report));
    let motors = fields!(
        MotorReport::default(),
        encode,
        "potentiometers" = (potentiometers),
        "currents" = (currents),
        "encoder 1 count" = (encoders[0].count),
        "encoder 1 speed" = (encoders[0].speed),
        "encoder 2 count" = (encoders[1].count),
        "encoder 2 speed" = (encoders[1].speed),
        "directions" = (encoders[0].positive),
    );
    assert_eq!(told("DID 123: motor control signals"), motors);
    let positive = Encoder { positive: true, ..Encoder::default() };
    for (bits, encoders) in
        [(1, [positive, Encoder::default()]), (2, [Encoder::default(), positive])]
    {
        assert_eq!(encode(&MotorReport { encoders, ..MotorReport::default() })[32], bits);
    }
    let custom_io = fields!(
        CustomIoReport::default(),
        |report: &CustomIoReport| data(Report::CustomIo(*report)),
        "custom ad" = (custom_ad),
        "inputs" = (inputs),
    );
    assert_eq!(told("DID 124: custom inputs"), custom_io);
    let sensors = fields!(
        SensorReport::default(),
        |report: &SensorReport| data(Report::Sensors(*report)),
        "sonar cm" = (sonar_cm),
        "human" = (human),
        "tilt" = (tilt),
        "overheat" = (overheat),
        "temperature" = (temperature),
        "ir range" = (ir_range),
        "ir command" = (ir_command),
        "battery" = (battery),
        "reference" = (reference),
    );
    assert_eq!(told("DID 125: sensors"), sensors);
}

#[test]
fn the_lengths_and_rates_of_telemetry_are_those_of_its_frames() {
    let reports = [
        Report::Motors(MotorReport::default()),
        Report::CustomIo(CustomIoReport::default()),
        Report::Sensors(SensorReport::default()),
    ];
    let expected = reports.map(|report| {
        let (len, wire) = (data(report).len(), report.encode(&mut [0; MAX_FRAME]).unwrap().len());
        [report.did().into(), len, wire, 11520 / wire].map(|number: usize| number.to_string())
    });
    assert_eq!(table("Telemetry", "DID"), expected);
}
