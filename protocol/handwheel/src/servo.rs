//! A servo of a CM-5, as its reports tell of it.

use protocol::cm5::Feedback;
use protocol::dynamixel::Register;
use serde_json::{Value, json};

/// A servo of a CM-5, as it tells of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Its ID on the bus.
    pub id: u8,
    /// Position 0 to 1023 (0 to 300 degrees), speed and load as the registers have them, voltage in 0.1 V,
    /// temperature in degrees Celsius; `None` if it does not answer, or the CM-5 reports nothing yet: it waits
    /// for its host's answer to its hello, which would set the servos' limits, and so is not given here.
    pub registers: Option<[u16; 5]>,
}

impl Servo {
    /// What a report tells of the servo with this ID.
    pub(crate) fn of(id: u8, told: Option<Feedback>) -> Self {
        let registers = [
            Register::PRESENT_POSITION,
            Register::PRESENT_SPEED,
            Register::PRESENT_LOAD,
            Register::PRESENT_VOLTAGE,
            Register::PRESENT_TEMPERATURE,
        ];
        Self { id, registers: told.map(|told| registers.map(|register| told.get(register))) }
    }

    /// For programs; without a report its ID alone.
    pub(crate) fn json(&self) -> Value {
        let mut told = json!({ "id": self.id });
        if let Some([position, speed, load, voltage, temperature]) = self.registers {
            told["position"] = position.into();
            told["speed"] = speed.into();
            told["load"] = load.into();
            told["voltage_v"] = (f64::from(voltage) / 10.0).into();
            told["temperature_c"] = temperature.into();
        }
        told
    }
}
