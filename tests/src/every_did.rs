//! What a host sends to a PMS5005 that is to answer as the virtual board does, as an image or a module: every DID
//! of Table II.1 in all its forms, the recorder's two, and what goes wrong on a line.

use std::time::Duration;

use protocol::extension::did as extension;
use protocol::pms5005::{Frame, did};

/// Bytes that the host sends at once.
pub struct Step {
    /// Those.
    pub bytes: Vec<u8>,
    /// Then it waits.
    pub pause: Duration,
}

/// Frames to the board: DID, DATA, and ms to wait. Each is acknowledged.
const COMMANDS: &[(u8, &[u8], u64)] = &[
    // Telemetry as it is at boot, then none.
    (did::SETUP, &[0], 120),
    (did::ALL_REPORTS, &[0], 30),
    // Each report N times, and until further notice.
    (did::MOTORS, &[3], 170),
    (did::CUSTOM_IO, &[2], 120),
    (did::SENSORS, &[1], 70),
    (did::ALL_REPORTS, &[2], 120),
    (did::CUSTOM_IO, &[], 120),
    (did::SENSORS, &[], 70),
    (did::CUSTOM_IO, &[0], 0),
    (did::MOTORS, &[], 70),
    (did::ALL_REPORTS, &[], 70),
    // Sensor, method, polarity, collision protection; gains of both loops, alone and together.
    (did::PARAMETERS, &[0x0D, 0, 2], 0),
    (did::PARAMETERS, &[0x0D, 2, 1, 0x0D, 3, 0], 0),
    (did::PARAMETERS, &[0x0E, 5, 0, 0x0E, 4, 1], 0),
    (did::PARAMETERS, &[0x06, 1, 0xFF], 0),
    (did::PARAMETERS, &[0x13, 1], 10),
    (did::PARAMETERS, &[7, 0, 1, 60, 0, 2, 6, 0, 3, 0, 50], 0),
    (did::PARAMETERS, &[8, 1, 3, 1, 25], 0),
    (did::PARAMETERS, &[0x0D, 1, 2, 8, 1, 1, 20, 0, 0x13, 0], 10),
    // PWM: a list with and without a time, in the three forms of the time; all six.
    (did::PWM, &[0, 0, 0x60, 1, 0, 0x30], 100),
    (did::PWM, &[5, 0, 0x50, 28, 100, 0], 60),
    (did::PWM, &[3, 0, 0x50, 6, 50, 0], 60),
    (did::PWM, &[3, 0, 0x30, 50, 0], 60),
    (did::PWM_ALL, &[0, 0x48, 0, 0x80, 0, 0x38, 0, 0x80, 0, 0x80, 0, 0x40], 60),
    (did::PWM_ALL, &[0, 0x40, 0, 0x40, 0, 0x40, 0, 0x40, 0, 0x80, 0, 0x40, 80, 0], 100),
    // Velocity, forwards and backwards.
    (did::VELOCITY, &[0, 0x90, 0x01, 1, 0x70, 0xFE], 150),
    (did::VELOCITY, &[0, 0xD0, 0x07, 28, 100, 0], 150),
    (did::VELOCITY_ALL, &[0x70, 0xFE, 0x90, 0x01, 100, 0, 0, 0x80, 0, 0x80, 0, 0x80], 100),
    (did::VELOCITY_ALL, &[0, 0, 0, 0, 0, 0, 0, 0x80, 0, 0x80, 0, 0x80, 50, 0], 80),
    // Position: a wheel and a joint; all six.
    (did::POSITION, &[0, 0xE8, 0x03, 3, 0x00, 0x0A, 28, 200, 0], 250),
    (did::POSITION, &[4, 0x00, 0x07], 150),
    (did::POSITION_ALL, &[0, 0, 0, 0x80, 0, 8, 0, 8, 0, 8, 0, 0x80], 100),
    (did::POSITION_ALL, &[100, 0, 0, 0x80, 0, 9, 0, 9, 0, 9, 0, 0x80, 120, 0], 200),
    // Servos.
    (did::SERVO, &[0, 0xE8, 0x03, 5, 0x70, 0x17], 20),
    (did::SERVO, &[2, 0x2F, 0x0D, 28, 100, 0], 20),
    (did::SERVO_ALL, &[0x2F, 0x0D, 0, 0x80, 0, 0x80, 0x2F, 0x0D, 0, 0x80, 0, 0x80], 20),
    (did::SERVO_ALL, &[0, 8, 0, 8, 0, 8, 0, 8, 0, 8, 0, 8, 50, 0], 60),
    // Suspend and resume: all, a motor, a servo.
    (did::VELOCITY, &[0, 0x90, 0x01, 1, 0x90, 0x01], 50),
    (did::RUN, &[0, 1], 50),
    (did::RUN, &[1, 1], 50),
    (did::RUN, &[0, 8], 0),
    (did::RUN, &[1, 8], 0),
    (did::RUN, &[0], 80),
    (did::RUN, &[1], 80),
    // Output port and display.
    (did::GPIO, &[0xA5], 10),
    (did::LCD, &PICTURE, 10),
    // What the manual does not know.
    (31, &[1, 2, 3], 10),
    (80, &[], 10),
    // The recorder: none yet; no channel, no whole setup, no whole request for blocks; all rows, from a fault on
    // that does not come; no block of it, two before it ends.
    (extension::RECORDING, &[], 20),
    (extension::RECORDING, &[0, 0, 1, 0, 5, 0, 0, 0], 20),
    (extension::RECORDING, &[1, 0, 1], 20),
    (extension::BLOCK, &[0, 0], 20),
    (extension::RECORDING, &[1, 2, 1, 0, 0x88, 0x13, 0, 0], 60),
    (extension::RECORDING, &[], 20),
    (extension::BLOCK, &[0, 0, 2, 0], 30),
    // Bad channel, value, length, sub-command, flag, picture; a method that was not chosen.
    (did::PWM, &[9, 0, 0x50], 10),
    (did::VELOCITY, &[0, 0x00, 0x80], 10),
    (did::SERVO, &[0, 1, 0], 10),
    (did::POSITION_ALL, &[1, 2, 3], 10),
    (did::GPIO, &[], 10),
    (did::PARAMETERS, &[0x55, 0, 1], 10),
    (did::RUN, &[2], 10),
    (did::LCD, &[16], 10),
    (did::ALL_REPORTS, &[1, 2], 10),
    (did::SETUP, &[2], 10),
    (did::VELOCITY, &[5, 0x90, 0x01], 10),
];

/// Frame number and 64 columns; both marks are in it.
const PICTURE: [u8; 65] = {
    let mut picture = [0x5E; 65];
    picture[0] = 7;
    picture[10] = 0x02;
    picture[20] = 0x0D;
    picture
};

/// How many frames come without a pause, faster than the board can follow them.
const FLOOD: usize = 300;

/// Acknowledgements that the script must get.
pub const ACKS: usize = COMMANDS.len() + FLOOD + 5;

fn frame(rid: u8, res: u8, did: u8, data: &[u8]) -> Vec<u8> {
    let mut buffer = [0; 264];
    Frame { rid, res, did, data }.encode(&mut buffer).unwrap().to_vec()
}

/// The script.
pub fn script() -> Vec<Step> {
    let step = |bytes, ms| Step { bytes, pause: Duration::from_millis(ms) };
    let mut steps: Vec<_> =
        COMMANDS.iter().map(|&(did, data, ms)| step(frame(1, 0, did, data), ms)).collect();

    // To another device, and without the wish to be acknowledged: no answer.
    steps.push(step(frame(8, 0, did::GPIO, &[1]), 20));
    steps.push(step(frame(1, 255, did::PWM, &[0, 0, 0x50]), 60));
    // What may be acknowledgements: one answer in 200 ms.
    steps.push(step(frame(1, 0, did::SETUP, &[1]).repeat(3), 20));
    // A damaged frame and garbage before a good frame; a frame that never ends, then a good one.
    let mut damaged = frame(1, 0, did::PWM, &[1, 0, 0x50]);
    damaged[7] ^= 0x10;
    steps.push(step(damaged, 10));
    let garbage = [&[0x00, 0x5E, 0xFF, 0x5E, 0x02, 1][..], &frame(1, 0, did::GPIO, &[2])].concat();
    steps.push(step(garbage, 700));
    steps.push(step(frame(1, 0, did::LCD, &PICTURE)[..30].to_vec(), 300));
    steps.push(step(frame(1, 0, did::GPIO, &[3]), 20));
    // A flood; silence, in which the motor stops and pings come for want of telemetry; a last word.
    steps.push(step(frame(1, 0, did::ALL_REPORTS, &[0]), 20));
    let flood = (0..FLOOD as u16).flat_map(|k| {
        let [low, high] = (k * 16).to_le_bytes();
        frame(1, 0, did::VELOCITY, &[0, low, high, 28, 20, 0])
    });
    steps.push(step(flood.collect(), 2400));
    steps.push(step(frame(1, 0, did::ALL_REPORTS, &[]), 0));
    steps
}
