//! The PMS5005 manual, section by section and byte by byte.
//!
//! Frames stand here as the manual prints them, so that encoder, receiver and board are each held
//! to the manual and not to each other. A board that is given an example must acknowledge it with
//! the bytes of section III and do what the example says.

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
fn iii_1_1_servo_3_goes_to_2048() {
    let frame = [94, 2, 1, 0, 28, 3, 2, 0, 8, 101, 94, 13];
    assert_eq!(encoded(list(Quantity::Servo, 2, 2048)), frame);
    let mut bench = Bench::quiet();
    acknowledged(&mut bench, &frame);
    let mut expected = Outputs::default();
    expected.servos[2] = Some(ServoPulse::from_raw(2048));
    assert_eq!(outputs(&bench), expected);
}

#[test]
fn iii_1_2_servo_2_is_suspended() {
    let frame = [94, 2, 1, 0, 30, 2, 0, 7, 214, 94, 13];
    let servo_2 = Scope::Servo(Channel::ALL[1]);
    assert_eq!(encoded(Command::Run { scope: servo_2, run: false }), frame);
    let mut bench = Bench::quiet();
    bench.drive(Quantity::Servo, 0, 3000, 0);
    bench.drive(Quantity::Servo, 1, 4000, 0);
    bench.run_ms(20);
    assert_eq!((bench.acks(), bench.pulse(0), bench.pulse(1)), (2, Some(3000), Some(4000)));
    acknowledged(&mut bench, &frame);
    assert_eq!((bench.pulse(0), bench.pulse(1)), (Some(3000), None));
}

#[test]
fn iii_1_3_motor_5_gets_pwm_4000() {
    let frame = [94, 2, 1, 0, 5, 3, 4, 160, 15, 86, 94, 13];
    assert_eq!(encoded(list(Quantity::Pwm, 4, 4000)), frame);
    let mut bench = Bench::quiet();
    acknowledged(&mut bench, &frame);
    let mut expected = Outputs::default();
    expected.motors[4] = MotorOutput { duty: Duty::from_raw(4000 - 16384), enabled: true };
    assert_eq!(outputs(&bench), expected);
}

#[test]
fn iii_1_4_motor_control_signals_come_three_times() {
    let frame = [94, 2, 1, 0, 123, 1, 3, 197, 94, 13];
    let repeat = Repeat::Times(NonZeroU8::new(3).unwrap());
    assert_eq!(encoded(Command::Telemetry { reports: Reports::Motors, repeat }), frame);
    let mut bench = Bench::quiet();
    bench.board.line.host_sends(&frame);
    bench.run_ms(500);
    let [ack, reports @ ..] = &arrived(&bench)[..] else { panic!("no answer") };
    assert_eq!(ack, &ACK);
    assert_eq!(reports.len(), 3);
    for report in reports {
        assert_eq!(report.len(), 42);
        assert_eq!(report[..6], [94, 2, 0, 255, 123, 33]);
        assert_eq!(report[39..], [figure_ii_1(&report[2..39]), 94, 13]);
    }
}

#[test]
fn iii_1_5_motor_1_goes_to_6000_by_its_encoder() {
    let sensor = [94, 2, 1, 0, 7, 3, 13, 0, 2, 72, 94, 13];
    let method = [94, 2, 1, 0, 7, 3, 14, 0, 1, 78, 94, 13];
    let go = [94, 2, 1, 0, 3, 3, 0, 112, 23, 83, 94, 13];
    assert_eq!(encoded(Command::Parameters(Parameters::parse(&[13, 0, 2]).unwrap())), sensor);
    assert_eq!(encoded(Command::Parameters(Parameters::parse(&[14, 0, 1]).unwrap())), method);
    assert_eq!(encoded(list(Quantity::Position, 0, 6000)), go);
    let mut bench = Bench::quiet();
    acknowledged(&mut bench, &sensor);
    acknowledged(&mut bench, &method);
    assert_eq!(bench.position(0), 0);
    acknowledged(&mut bench, &go);
    assert!(bench.velocity(0) > 100.0, "it has set out: {} counts/s", bench.velocity(0));
    // 6000 counts take 366 ms at full speed.
    bench.run_ms(280);
    assert!(bench.position(0) < 5000, "faster than the motor can: {}", bench.position(0));
    bench.run_ms(1500);
    assert!((5980..=6020).contains(&bench.position(0)), "{}", bench.position(0));
    assert!(bench.velocity(0).abs() < 50.0, "{} counts/s", bench.velocity(0));
}

#[test]
fn iii_1_6_sixteen_frames_are_an_image() {
    // Every column differs from its neighbours, and both marks of a frame occur in the image.
    let image: [[u8; 64]; 16] = std::array::from_fn(|frame| {
        let mut columns = std::array::from_fn(|column| (frame * 16 + column) as u8);
        columns[20..24].copy_from_slice(&[0x5E, 0x02, 0x5E, 0x0D]);
        columns
    });
    let mut bench = Bench::quiet();
    for (number, columns) in (0..).zip(&image) {
        let mut frame = vec![94, 2, 1, 0, 23, 65, number];
        frame.extend(columns);
        frame.extend([figure_ii_1(&frame[2..]), 94, 13]);
        assert_eq!(encoded(Command::Lcd(LcdFrame { number, columns })), frame);
        acknowledged(&mut bench, &frame);
    }
    assert_eq!(bench.board.plant.borrow().lcd, image);
}

/// DATA means the command.
fn reads(did: u8, data: &[u8], command: Command) {
    assert_eq!(Command::parse(did, data), Ok(command), "DID {did}, DATA {data:02X?}");
}

/// DATA means the command, and this is how the command is written.
fn both_ways(did: u8, data: &[u8], command: Command) {
    reads(did, data, command);
    let frame = encoded(command);
    assert_eq!(Frame::parse(&frame), Some(Frame { rid: 1, res: 0, did, data }));
}

#[test]
fn table_ii_1_lists_and_six_words_move_channels_in_a_time() {
    for (list_did, all_did, quantity) in [
        (3, 4, Quantity::Position),
        (5, 6, Quantity::Pwm),
        (26, 27, Quantity::Velocity),
        (28, 29, Quantity::Servo),
    ] {
        let did = list_did;
        let timed = |set: &[_], periods| motion(quantity, Addressing::List, set, periods);
        for (number, channel) in (0..6).zip(0..) {
            both_ways(did, &[number, 0xE8, 0x03], timed(&[(channel, 1000)], 0));
        }
        let six = [0, 0xE8, 3, 1, 0xE9, 3, 2, 0xEA, 3, 3, 0xEB, 3, 4, 0xEC, 3, 5, 0x70, 0x17];
        let set = [(0, 1000), (1, 1001), (2, 1002), (3, 1003), (4, 1004), (5, 6000)];
        both_ways(did, &six, timed(&set, 0));
        let two = [(1, 1000), (4, 6000)];
        both_ways(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17], timed(&two, 0));
        both_ways(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, 28, 0xF4, 0x01], timed(&two, 500));
        both_ways(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, 28, 0xFF, 0xFF], timed(&two, 65535));
        reads(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, 6, 0xF4, 0x01], timed(&two, 500));
        reads(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, 0xF4, 0x01], timed(&two, 500));
        reads(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, 28, 0, 0], timed(&two, 0));
        reads(did, &[4, 0x70, 0x17, 1, 0xE8, 0x03], timed(&two, 0));

        let did = all_did;
        let timed = |set: &[_], periods| motion(quantity, Addressing::All, set, periods);
        let words = [0xE8, 0x03, 0xE9, 0x03, 0xEA, 0x03, 0xEB, 0x03, 0xEC, 0x03, 0x70, 0x17];
        both_ways(did, &words, timed(&set, 0));
        both_ways(did, &[&words[..], &[0x2C, 0x01]].concat(), timed(&set, 300));
        reads(did, &[&words[..], &[0, 0]].concat(), timed(&set, 0));
        let two = [0, 0x80, 0xE9, 0x03, 0, 0x80, 0, 0x80, 0xEC, 0x03, 0, 0x80];
        both_ways(did, &two, timed(&[(1, 1001), (4, 1004)], 0));
        both_ways(did, &[0, 0x80].repeat(6), timed(&[], 0));
    }
}

#[test]
fn table_ii_1_targets_span_their_ranges_and_velocities_are_signed() {
    for (did, quantity, low_high, target) in [
        (3, Quantity::Position, [0, 0], 0),
        (3, Quantity::Position, [0xFF, 0x7F], 32767),
        (5, Quantity::Pwm, [0, 0], 0),
        (5, Quantity::Pwm, [0xFF, 0x7F], 32767),
        (26, Quantity::Velocity, [0x90, 0x01], 400),
        (26, Quantity::Velocity, [0x70, 0xFE], -400),
        (26, Quantity::Velocity, [0xFF, 0x7F], 32767),
        (26, Quantity::Velocity, [0x01, 0x80], -32767),
        (28, Quantity::Servo, [0xF4, 0x01], 500),
        (28, Quantity::Servo, [0x58, 0x1B], 7000),
    ] {
        both_ways(did, &[5, low_high[0], low_high[1]], list(quantity, 5, target));
    }
    for (did, low_high) in [
        (3, [0xFF, 0xFF]),
        (5, [0x00, 0x80]),
        (26, [0x00, 0x80]),
        (28, [0xF3, 0x01]),
        (28, [0x59, 0x1B]),
    ] {
        let refusal = Refusal::Value { did, value: u16::from_le_bytes(low_high) };
        assert_eq!(Command::parse(did, &[5, low_high[0], low_high[1]]), Err(refusal));
    }
}

#[test]
fn table_ii_1_gpio_suspension_and_setup() {
    both_ways(22, &[0xA5], Command::GpioOutputs(0xA5));
    for (mode, run) in [(0, false), (1, true)] {
        both_ways(30, &[mode], Command::Run { scope: Scope::All, run });
        for channel in Channel::ALL {
            let number = channel.number();
            both_ways(30, &[mode, number], Command::Run { scope: Scope::Motor(channel), run });
            both_ways(30, &[mode, number + 6], Command::Run { scope: Scope::Servo(channel), run });
        }
    }
    both_ways(255, &[0], Command::Ping);
    both_ways(255, &[1], Command::PingOrAck);
}

#[test]
fn table_ii_1_telemetry_comes_continuously_n_times_or_no_more() {
    for (did, reports) in [
        (123, Reports::Motors),
        (124, Reports::CustomIo),
        (125, Reports::Sensors),
        (127, Reports::All),
    ] {
        both_ways(did, &[], Command::Telemetry { reports, repeat: Repeat::Continuous });
        both_ways(did, &[0], Command::Telemetry { reports, repeat: Repeat::Stop });
        for times in 1..=255 {
            let repeat = Repeat::Times(NonZeroU8::new(times).unwrap());
            both_ways(did, &[times], Command::Telemetry { reports, repeat });
        }
    }
}

#[test]
fn table_ii_1_system_parameters_come_alone_or_many_to_a_frame() {
    let is = |data: &[u8], expected: &[Parameter]| {
        let Ok(Command::Parameters(parameters)) = Command::parse(7, data) else {
            panic!("DATA {data:02X?} is refused");
        };
        assert_eq!(parameters.iter().collect::<Vec<_>>(), expected, "DATA {data:02X?}");
        both_ways(7, data, Command::Parameters(parameters));
    };
    let kp = Gain::Proportional(300);
    let kd = Gain::Derivative(5);
    let ki = Gain::Integral { integer: 1, fraction: 25 };
    for (n, channel) in (0..).zip(Channel::ALL) {
        let position = |gain| Parameter::Gain(channel, Loop::Position, gain);
        let velocity = |gain| Parameter::Gain(channel, Loop::Velocity, gain);
        let sensor = |sensor| Parameter::Sensor(channel, sensor);
        let method = |method| Parameter::Method(channel, method);
        let polarity = |polarity| Parameter::Polarity(channel, polarity);
        is(&[0x06, n, 1], &[polarity(Polarity::Positive)]);
        is(&[0x06, n, 0xFF], &[polarity(Polarity::Negative)]);
        is(&[7, n, 1, 44, 1, 2, 5, 0, 3, 1, 25], &[position(kp), position(kd), position(ki)]);
        is(&[8, n, 1, 44, 1, 2, 5, 0, 3, 1, 25], &[velocity(kp), velocity(kd), velocity(ki)]);
        is(&[7, n, 2, 5, 0], &[position(kd)]);
        is(&[8, n, 3, 1, 25, 1, 44, 1], &[velocity(ki), velocity(kp)]);
        is(&[0x0D, n, 0], &[sensor(Sensor::SinglePotentiometer)]);
        is(&[0x0D, n, 1], &[sensor(Sensor::DualPotentiometer)]);
        is(&[0x0D, n, 2], &[sensor(Sensor::Encoder)]);
        is(&[0x0E, n, 0], &[method(Method::Pwm)]);
        is(&[0x0E, n, 1], &[method(Method::Position)]);
        is(&[0x0E, n, 2], &[method(Method::Velocity)]);
        let stray = [7, n, 1, 44, 1, 0x0D, n, 2, 2, 5, 0];
        assert!(Command::parse(7, &stray).is_err(), "a gain that belongs to no sub-command");
        let bumper = Parameter::CollisionProtection;
        is(&[0x13, 0], &[bumper(false)]);
        is(
            &[0x0D, n, 2, 7, n, 3, 1, 25, 8, n, 1, 44, 1, 2, 5, 0, 0x13, 1, 6, n, 0xFF],
            &[
                sensor(Sensor::Encoder),
                position(ki),
                velocity(kp),
                velocity(kd),
                bumper(true),
                polarity(Polarity::Negative),
            ],
        );
    }
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

/// A quiet board whose sensors have read what `set` puts in their place.
fn board_reading(set: impl FnOnce(&mut Overrides)) -> Bench {
    let mut bench = Bench::quiet();
    set(&mut bench.board.plant.borrow_mut().overrides);
    bench.run_ms(45);
    bench
}

/// Asks for one report and answers its DATA.
fn data_of(bench: &mut Bench, did: u8) -> Vec<u8> {
    bench.send_raw(did, &[1]);
    bench.run_ms(20);
    let mut reports = bench.received();
    reports.retain(|frame| !frame.is_ack());
    let [report] = &reports[..] else { panic!("{} reports", reports.len()) };
    assert_eq!((report.rid, report.res, report.did), (0, 255, did));
    report.data.clone()
}

#[test]
fn table_ii_2_motor_control_signals_byte_by_byte() {
    for (pwm, directions) in [([24576, 12288], 0b01), ([12288, 24576], 0b10)] {
        let mut bench = board_reading(|set| {
            set.potentiometers = [0x0121, 0x0222, 0x0323, 0x0424, 0x0525, 0x0626].map(Some);
            set.currents = [0x0727, 0x0828, 0x0929, 0x0A2A, 0x0B2B, 0x0C2C].map(Some);
        });
        bench.drive(Quantity::Pwm, 0, pwm[0], 0);
        bench.drive(Quantity::Pwm, 1, pwm[1], 0);
        bench.run_ms(500);
        bench.received();
        let before = [0, 1].map(|motor| bench.position(motor));
        let data = data_of(&mut bench, 123);
        assert_eq!(data.len(), 33);
        assert_eq!(
            data[..24],
            [
                0x21, 1, 0x22, 2, 0x23, 3, 0x24, 4, 0x25, 5, 0x26, 6, //
                0x27, 7, 0x28, 8, 0x29, 9, 0x2A, 10, 0x2B, 11, 0x2C, 12,
            ]
        );
        for (motor, bytes) in data[24..32].chunks(4).enumerate() {
            let &[count_low, count_high, speed_low, speed_high] = bytes else { unreachable!() };
            let count = u16::from_le_bytes([count_low, count_high]);
            // How far it came since, on the counter's ring of 32768.
            let way = (bench.position(motor) - before[motor]).abs();
            let moved = i64::from(count) - before[motor];
            let moved = if pwm[motor] > 16384 { moved } else { -moved }.rem_euclid(32768);
            assert!((0..=way).contains(&moved), "encoder {motor}: {moved} of {way}");
            let speed = f32::from(u16::from_le_bytes([speed_low, speed_high]));
            let truth = bench.velocity(motor).abs();
            assert!((0.98..1.02).contains(&(speed / truth)), "encoder {motor}: {speed}, {truth}");
        }
        assert_eq!(data[32], directions);
    }
}

#[test]
fn table_ii_3_custom_io_byte_by_byte() {
    let mut bench = board_reading(|set| {
        set.custom_ad = [0x0121, 0x0222, 0x0323, 0x0424, 0x0525, 0x0626, 0x0727, 0x0828].map(Some);
        set.gpio_in = Some(0xA6);
    });
    assert_eq!(
        data_of(&mut bench, 124),
        [0x21, 1, 0x22, 2, 0x23, 3, 0x24, 4, 0x25, 5, 0x26, 6, 0x27, 7, 0x28, 8, 0xA6]
    );
}

#[test]
fn table_ii_4_sensors_byte_by_byte() {
    let mut bench = board_reading(|set| {
        set.sonar_cm = [101, 102, 103, 104, 105, 106].map(Some);
        set.human = [0x0121, 0x0222, 0x0323, 0x0424].map(Some);
        set.tilt = [0x0525, 0x0626].map(Some);
        set.overheat = [0x0727, 0x0828].map(Some);
        set.temperature = Some(0x0929);
        set.ir_range = Some(0x0A2A);
        set.ir_command = [0xC1, 0xC2, 0xC3, 0xFF].map(Some);
        set.battery = [0x0B2B, 0x0C2C, 0x0D2D].map(Some);
        set.reference = [0x0E2E, 0x0F2F].map(Some);
    });
    assert_eq!(
        data_of(&mut bench, 125),
        [
            101, 102, 103, 104, 105, 106, // ultrasonic ranges 1 to 6
            0x21, 1, 0x22, 2, 0x23, 3, 0x24, 4, // human sensors
            0x25, 5, 0x26, 6, // tilt X, Y
            0x27, 7, 0x28, 8, // overheat 1, 2
            0x29, 9, 0x2A, 10, // temperature, infrared range
            0xC1, 0xC2, 0xC3, 0xFF, // infrared command
            0x2B, 11, 0x2C, 12, 0x2D, 13, // batteries: board, motors, servos
            0x2E, 14, 0x2F, 15, // Vcc, Vref
        ]
    );
}

#[test]
fn section_ii_5_measured_values_give_way_before_they_make_an_end_mark() {
    let mut bench = board_reading(|set| {
        set.potentiometers[3] = Some(0x0D5E);
        set.sonar_cm = [0x5E, 0x0D, 0x0D, 1, 0x5D, 0x5E].map(Some);
        set.human = [0x020D, 0x0D5D, 0x0D5E, 0x0D5F].map(Some);
        set.ir_command = [0, 0, 0, 0x5E].map(Some);
        set.battery[0] = Some(0x070D);
    });
    assert_eq!(data_of(&mut bench, 123)[6..8], [0x5F, 0x0D]);
    let data = data_of(&mut bench, 125);
    assert_eq!(data[..6], [0x5E, 0x0C, 0x0D, 1, 0x5D, 0x5E]);
    assert_eq!(data[6..14], [0x0C, 0x02, 0x5D, 0x0D, 0x5F, 0x0D, 0x5F, 0x0D]);
    assert_eq!(data[26..32], [0, 0, 0, 0x5E, 0x0C, 0x07]);
}

fn telemetry(report: Report) -> Vec<u8> {
    report.encode(&mut [0; Report::MAX_FRAME]).unwrap().to_vec()
}

#[test]
fn section_ii_5_counts_speeds_flags_and_key_codes_are_never_altered() {
    let encoder = Encoder { count: 0x0D5E, speed: 0x0D5E, positive: true };
    let motors = MotorReport { encoders: [encoder; 2], ..MotorReport::default() };
    let frame = telemetry(Report::Motors(motors));
    assert_eq!(frame[30..39], [0x5E, 0x0D, 0x5E, 0x0D, 0x5E, 0x0D, 0x5E, 0x0D, 3]);
    let ir_command = [0x5E, 0x0D, 0x5E, 0x0D];
    let frame = telemetry(Report::Sensors(SensorReport { ir_command, ..Default::default() }));
    assert_eq!(frame[32..36], ir_command);
}

#[test]
fn section_ii_5_inputs_0x5e_and_a_checksum_of_0x0d_do_not_meet() {
    // Channel 1 one LSB from making an end mark itself: it cannot be the one to give way.
    for first in [0, 0x0D5F] {
        let mut met = 0;
        for second in 0..4096 {
            let mut custom_ad = [first; 8];
            custom_ad[1] = second;
            let report = CustomIoReport { custom_ad, inputs: 0x5E };
            let mut plain: Vec<u8> = custom_ad.iter().flat_map(|v| v.to_le_bytes()).collect();
            plain.push(0x5E);
            let checksum = figure_ii_1(&[&[0, 255, 124, 17], &plain[..]].concat());
            if checksum != 0x0D || second == 0x0D5E {
                continue;
            }
            met += 1;
            let frame = telemetry(Report::CustomIo(report));
            let marks = frame.windows(2).filter(|pair| *pair == ETX).count();
            assert_eq!(marks, 1, "{report:?} gives {frame:02X?}");
            assert_eq!(frame[23], figure_ii_1(&frame[2..23]));
            let changed: Vec<_> = frame[6..23].iter().zip(&plain).filter(|(a, b)| a != b).collect();
            let [(sent, read)] = changed[..] else { panic!("{changed:?} for {report:?}") };
            assert_eq!(sent.abs_diff(*read), 1);
            assert_eq!(frame[22], 0x5E, "flags stay");
        }
        assert!((8..=32).contains(&met), "about one checksum in 256: {met} of 4096");
    }
}

#[test]
fn section_iii_at_boot_all_sensor_data_comes_unasked() {
    let mut bench = Bench::new();
    bench.run_ms(1000);
    let frames = arrived(&bench);
    for head in [[94, 2, 0, 255, 123, 33], [94, 2, 0, 255, 124, 17], [94, 2, 0, 255, 125, 40]] {
        let count = frames.iter().filter(|frame| frame.starts_with(&head)).count();
        // Every 50 ms, of which the last may still be on the line.
        assert!((18..=20).contains(&count), "DID {}: {count} in the first second", head[4]);
    }
}
