//! Section III.1: each example with its bytes, its acknowledgement and its effect.

use super::*;

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
