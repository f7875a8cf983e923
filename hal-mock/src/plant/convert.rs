//! What the converters read for a physical value: the inverses of the formulas by which hosts
//! convert A/D counts (facts on Tables II.2 to II.4). 12 bits, 0 to 4095.

/// The middle of the range: an open potentiometer input, a human sensor at rest.
pub const MID_SCALE: f32 = 2047.5;
const FULL_SCALE: f32 = 4095.0;

/// Motor current: 728 counts an ampere.
pub fn current(ampere: f32) -> f32 {
    ampere * 728.0
}

/// A voltage on an input that reads `full` volts at full scale.
pub fn volts(volts: f32, full: f32) -> f32 {
    volts / full * FULL_SCALE
}

/// Ambient temperature.
pub fn temperature(celsius: f32) -> f32 {
    1256.0 + celsius * 34.8
}

/// Temperature of a motor driver: 980 at 100 degrees, more when cooler.
pub fn driver_temperature(celsius: f32) -> f32 {
    980.0 + (100.0 - celsius) * 11.6
}

/// Acceleration along an axis of the tilt sensor, in g.
pub fn tilt(g: f32) -> f32 {
    2048.0 + g * 1250.0
}

/// Infrared range; the sensor measures 10 to 80 cm.
pub fn ir_range(cm: f32) -> f32 {
    (21.6 / cm.clamp(10.0, 80.0) + 0.17) * 4028.0 / 3.0
}

/// Rounds to the nearest count within the range.
pub fn quantise(counts: f32) -> u16 {
    (counts.clamp(0.0, FULL_SCALE) + 0.5) as u16
}
