//! Table II.1: every DID with its forms, from literal DATA to the typed command and back.

use super::*;

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
        // A flag with no time behind it, as some hosts send it.
        for flag in [28, 6] {
            reads(did, &[1, 0xE8, 0x03, 4, 0x70, 0x17, flag], timed(&two, 0));
        }
        reads(did, &[4, 0x70, 0x17, 1, 0xE8, 0x03], timed(&two, 0));

        let did = all_did;
        let timed = |set: &[_], periods| motion(quantity, Addressing::All, set, periods);
        let words = [0xE8, 0x03, 0xE9, 0x03, 0xEA, 0x03, 0xEB, 0x03, 0xEC, 0x03, 0x70, 0x17];
        both_ways(did, &words, timed(&set, 0));
        both_ways(did, &[&words[..], &[0x2C, 0x01]].concat(), timed(&set, 300));
        reads(did, &[&words[..], &[0, 0]].concat(), timed(&set, 0));
        for flag in [28, 6] {
            reads(did, &[&words[..], &[flag, 0x2C, 0x01]].concat(), timed(&set, 300));
            reads(did, &[&words[..], &[flag]].concat(), timed(&set, 0));
        }
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
