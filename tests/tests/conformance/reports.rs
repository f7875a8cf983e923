//! Tables II.2 to II.4 byte by byte, and no false end mark (section II.5) in any report.

use super::*;

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
    assert_eq!(data_of(&mut bench, 123)[6..8], [0x5D, 0x0D]);
    let data = data_of(&mut bench, 125);
    assert_eq!(data[..6], [0x5E, 0x0C, 0x0D, 1, 0x5D, 0x5E]);
    assert_eq!(data[6..14], [0x0C, 0x02, 0x5D, 0x0D, 0x5D, 0x0D, 0x5F, 0x0D]);
    assert_eq!(data[26..32], [0, 0, 0, 0x5E, 0x0C, 0x07]);
}

fn telemetry(report: Report) -> Vec<u8> {
    report.encode(&mut [0; Report::MAX_FRAME]).unwrap().to_vec()
}

#[test]
fn section_ii_5_counts_and_speeds_give_way_and_flags_and_key_codes_never_do() {
    let encoder = Encoder { count: 0x0D5E, speed: 0x0D5E, positive: true };
    let motors = MotorReport { encoders: [encoder; 2], ..MotorReport::default() };
    let frame = telemetry(Report::Motors(motors));
    assert_eq!(frame[30..39], [0x5D, 0x0D, 0x5D, 0x0D, 0x5D, 0x0D, 0x5D, 0x0D, 3]);
    // Over the border of two fields; and what is no A/D value is not limited to 4095.
    let encoder = Encoder { count: 0x5EFF, speed: 0x700D, positive: false };
    let motors = MotorReport { encoders: [encoder; 2], ..MotorReport::default() };
    let frame = telemetry(Report::Motors(motors));
    assert_eq!(frame[30..39], [0xFF, 0x5E, 0x0C, 0x70, 0xFF, 0x5E, 0x0C, 0x70, 0]);
    let ir_command = [0x5E, 0x0D, 0x5E, 0x0D];
    let frame = telemetry(Report::Sensors(SensorReport { ir_command, ..Default::default() }));
    assert_eq!(frame[32..36], ir_command);
}

#[test]
fn section_ii_5_a_wheel_that_rests_anywhere_blinds_no_host() {
    for count in 0..=32_767 {
        let encoder = Encoder { count, speed: 0, positive: true };
        let motors = MotorReport { encoders: [encoder; 2], ..MotorReport::default() };
        let frame = telemetry(Report::Motors(motors));
        assert_eq!(frame.windows(2).filter(|pair| *pair == ETX).count(), 1, "{count}");
        let sent = u16::from_le_bytes([frame[30], frame[31]]);
        assert!(sent.abs_diff(count) <= 1 && (count != 3422 || sent == 3421), "{count}: {sent}");
    }
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
