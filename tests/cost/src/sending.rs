//! Telemetry put into frames.

use core::hint::black_box;

use protocol::pms5005::{CustomIoReport, Encoder, MotorReport, Report, SensorReport};
use serde::Serialize;

use crate::Meter;

/// All cases; the unit is a frame.
pub fn cases(meter: &mut impl Meter) {
    let encoder = Encoder { count: 1234, speed: 500, positive: true };
    let motors = MotorReport {
        potentiometers: [2000; 6],
        currents: [300; 6],
        encoders: [encoder, Encoder { positive: false, ..encoder }],
    };
    let custom_io = CustomIoReport { custom_ad: [2000; 8], inputs: 0x5A };
    let sensors = SensorReport {
        sonar_cm: [30, 40, 50, 60, 70, 255],
        human: [2000; 4],
        tilt: [2048; 2],
        overheat: [1500; 2],
        temperature: 1000,
        ir_range: 800,
        ir_command: [1, 2, 3, 255],
        battery: [3000; 3],
        reference: [4000; 2],
    };
    ours(meter, "encode-motors/ours", Report::Motors(motors));
    ours(meter, "encode-custom-io/ours", Report::CustomIo(custom_io));
    ours(meter, "encode-sensors/ours", Report::Sensors(sensors));
    postcard(
        meter,
        "encode-motors/postcard",
        &Motors {
            potentiometers: motors.potentiometers,
            currents: motors.currents,
            encoders: motors.encoders.map(|encoder| (encoder.count, encoder.speed)),
            directions: 1,
        },
    );
    postcard(meter, "encode-custom-io/postcard", &(custom_io.custom_ad, custom_io.inputs));
}

fn ours(meter: &mut impl Meter, name: &str, report: Report) {
    let mut out = [0; Report::MAX_FRAME];
    meter.case(name, 1, || {
        let _ = black_box(black_box(&report).encode(&mut out));
    });
}

/// [`MotorReport`] for postcard.
#[derive(Serialize)]
struct Motors {
    potentiometers: [u16; 6],
    currents: [u16; 6],
    encoders: [(u16, u16); 2],
    directions: u8,
}

/// Postcard with COBS. It does less than ours: no checksum, and no bytes to keep out of the frame.
fn postcard(meter: &mut impl Meter, name: &str, report: &impl Serialize) {
    let mut out = [0; 2 * Report::MAX_FRAME];
    meter.case(name, 1, || {
        let _ = black_box(postcard::to_slice_cobs(black_box(report), &mut out));
    });
}
