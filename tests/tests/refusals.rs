//! Frames that arrive intact and ask for what cannot be: acknowledged, counted, and nothing of
//! them is done.

use protocol::pms5005::{Quantity, did};
use tests::Bench;

/// Runs a bad frame and shows that it was acknowledged, counted, and did nothing.
fn refused(bench: &mut Bench, did: u8, data: &[u8]) {
    let before = (bench.board.plant.borrow().outputs, bench.board.refused());
    bench.send_raw(did, data);
    bench.run_ms(40);
    assert_eq!(bench.acks(), 1, "{did} {data:?} arrived intact");
    let after = (bench.board.plant.borrow().outputs, bench.board.refused());
    assert_eq!(after, (before.0, before.1 + 1), "{did} {data:?}");
}

#[test]
fn a_list_with_one_bad_entry_does_nothing() {
    let mut bench = Bench::quiet();
    let bad: &[(u8, &[u8])] = &[
        (did::PWM, &[0, 0x00, 0x50, 6, 0x00, 0x50, 1, 0x00, 0x50]), // flag in the middle
        (did::PWM, &[0, 0x00, 0x50, 9, 0x00, 0x50]),                // no channel 9
        (did::PWM, &[0, 0x00, 0x50, 1, 0x00, 0x80]),                // out of range
        (did::PWM, &[0, 0x00, 0x50, 0, 0x00, 0x60]),                // twice the same
        (did::PWM, &[0, 0x00, 0x50, 1]),                            // cut short
        (did::PWM, &[28, 100, 0]),                                  // time for nothing
        (did::PWM, &[]),
        (did::PWM_ALL, &[0; 11]),
        (did::PWM_ALL, &[0, 0x50, 0, 0x50, 0, 0x50, 0, 0x50, 0, 0x50, 1, 0x80]),
        (did::POSITION, &[0, 0x00, 0x01, 2, 0x00, 0x10]), // 4096 is beyond a potentiometer
        (did::VELOCITY, &[0, 0x10, 0x00, 1, 0x00, 0x80]), // -32768
        (did::SERVO, &[0, 0x00, 0x08, 1, 0x00, 0x00]),    // no servo takes 0
        (did::SERVO, &[0, 0x00, 0x08, 1, 0x00, 0x40]),
        (did::RUN, &[1, 12]),
        (did::RUN, &[2]),
        (did::RUN, &[]),
        (did::LCD, &[16; 65]),
        (did::LCD, &[0; 64]),
        (did::GPIO, &[1, 2]),
        (did::MOTORS, &[1, 2]),
        (did::SETUP, &[2]),
        (did::SETUP, &[]),
        (did::PARAMETERS, &[]),
        (did::PARAMETERS, &[0x06, 0, 2]),
        (did::PARAMETERS, &[0x0D, 2, 2]), // channel 2 has no encoder
        (did::PARAMETERS, &[0x0D, 3, 1]), // channel 3 has no pair of potentiometers
        (did::PARAMETERS, &[0x0E, 0, 3]),
        (did::PARAMETERS, &[0x13, 1, 0x42]),
        (did::PARAMETERS, &[0x07, 0, 4, 1, 1]),
        (did::PARAMETERS, &[0x07, 0]),
        (did::PARAMETERS, &[0x07, 0, 1, 1]),
    ];
    for (did, data) in bad {
        refused(&mut bench, *did, data);
    }
}

#[test]
fn a_compound_of_parameters_with_one_bad_one_changes_nothing() {
    let mut bench = Bench::quiet();
    // Both potentiometers and position method for channel 2, then a method that does not exist.
    refused(&mut bench, did::PARAMETERS, &[0x0D, 2, 1, 0x0E, 2, 1, 0x0E, 1, 9]);
    // So the DID still implies the method, and one potentiometer's range still holds: not 4200.
    refused(&mut bench, did::POSITION, &[2, 0x68, 0x10]);
    bench.drive(Quantity::Pwm, 2, 20_000, 0);
    bench.run_ms(20);
    assert_eq!(bench.bridge(2), (3616, true));
}
