//! What the board tells: the telemetry frames of Tables II.2, II.3 and II.4, both directions.
//!
//! A/D values are 12 bits, sent low byte first. Conversions to volts, degrees and centimetres are
//! the host's; the fields here are what the converters and counters read.
//!
//! Hosts exist that find the end of a frame by searching for `5E 0D`. [`Report::encode`] keeps
//! these bytes out of DATA and checksum where a measured value would put them there, by sending
//! that value one least significant bit away. Counts and flags are sent as they are.

use super::did;
use super::frame::{DATA, ETX, Frame, RES_NO_ACK, RID_HOST, seal};
use crate::data::{EncodeError, Field};

/// The highest A/D value: converters have 12 bits.
const AD_MAX: u16 = 4095;

/// One encoder's fields in Table II.2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Encoder {
    /// Pulse count, 0 to 32767; wraps at 32768.
    pub count: u16,
    /// Magnitude of the speed in pulses per second.
    pub speed: u16,
    /// Direction: `true` is positive.
    pub positive: bool,
}

/// Motor control signals (DID 123, Table II.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct MotorReport {
    /// A/D values of the potentiometers.
    pub potentiometers: [u16; 6],
    /// A/D values of the motor currents.
    pub currents: [u16; 6],
    /// The two quadrature encoders.
    pub encoders: [Encoder; 2],
}

/// Custom GPIO and A/D (DID 124, Table II.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CustomIoReport {
    /// A/D values of the custom channels.
    pub custom_ad: [u16; 8],
    /// Input port: bit 0 is input 0.
    pub inputs: u8,
}

/// Sensors (DID 125, Table II.4).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SensorReport {
    /// Ultrasonic ranges in cm; 255 when nothing is in range.
    pub sonar_cm: [u8; 6],
    /// Human sensors: alarm 1, motion 1, alarm 2, motion 2 (A/D).
    pub human: [u16; 4],
    /// Tilt: X axis, Y axis (A/D).
    pub tilt: [u16; 2],
    /// Temperature of the two motor driver boards (A/D).
    pub overheat: [u16; 2],
    /// Ambient temperature (A/D).
    pub temperature: u16,
    /// Infrared range (A/D).
    pub ir_range: u16,
    /// Infrared remote control: three bytes of key code, then 255 while the key is held.
    pub ir_command: [u8; 4],
    /// Batteries: main board, DC motors, servos (A/D).
    pub battery: [u16; 3],
    /// Reference voltages: Vcc, Vref of the potentiometers (A/D).
    pub reference: [u16; 2],
}

/// A telemetry frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Report {
    /// DID 123: 42 bytes on the wire.
    Motors(MotorReport),
    /// DID 124: 26 bytes on the wire.
    CustomIo(CustomIoReport),
    /// DID 125: 49 bytes on the wire.
    Sensors(SensorReport),
}

/// Bytes of DATA: Tables II.2, II.3, II.4.
mod len {
    pub const MOTORS: usize = 33;
    pub const CUSTOM_IO: usize = 17;
    pub const SENSORS: usize = 40;
}

impl Report {
    /// Bytes of the longest telemetry frame.
    pub const MAX_FRAME: usize = super::OVERHEAD + len::SENSORS;

    /// Its DID.
    pub fn did(&self) -> u8 {
        match self {
            Self::Motors(_) => did::MOTORS,
            Self::CustomIo(_) => did::CUSTOM_IO,
            Self::Sensors(_) => did::SENSORS,
        }
    }

    /// Writes the whole frame (RID 0, RES 255) into `out` and answers the part it took. A/D
    /// values above 4095 are sent as 4095, counts and speeds above 32767 as they are.
    ///
    /// # Errors
    /// [`EncodeError::BufferTooShort`].
    pub fn encode<'b>(&self, out: &'b mut [u8]) -> Result<&'b mut [u8], EncodeError> {
        let mut data = Fields::default();
        match self {
            Self::Motors(report) => report.emit(&mut data),
            Self::CustomIo(report) => report.emit(&mut data),
            Self::Sensors(report) => report.emit(&mut data),
        }
        let frame = Frame { rid: RID_HOST, res: RES_NO_ACK, did: self.did(), data: &data.bytes };
        let frame = frame.encode(out)?;
        avoid_false_etx_in_checksum(frame, &data.measured);
        Ok(frame)
    }

    /// Reads DID and DATA of an intact frame. `None` if it is not telemetry.
    pub fn parse(did: u8, data: &[u8]) -> Option<Self> {
        match (did, data.len()) {
            (did::MOTORS, len::MOTORS) => MotorReport::read(data).map(Self::Motors),
            (did::CUSTOM_IO, len::CUSTOM_IO) => CustomIoReport::read(data).map(Self::CustomIo),
            (did::SENSORS, len::SENSORS) => SensorReport::read(data).map(Self::Sensors),
            _ => None,
        }
    }
}

impl MotorReport {
    fn emit(&self, out: &mut Fields) {
        out.measured_words(&self.potentiometers);
        out.measured_words(&self.currents);
        for encoder in &self.encoders {
            out.exact(&encoder.count.to_le_bytes());
            out.exact(&encoder.speed.to_le_bytes());
        }
        let directions = self
            .encoders
            .iter()
            .rev()
            .fold(0, |bits: u8, encoder| (bits << 1) | u8::from(encoder.positive));
        out.exact(&[directions]);
    }

    fn read(mut data: &[u8]) -> Option<Self> {
        let [potentiometers, currents] = Field::take(&mut data)?;
        let [count_1, speed_1, count_2, speed_2] = Field::take(&mut data)?;
        let directions = u8::take(&mut data)?;
        let encoder = |count, speed, bit| Encoder { count, speed, positive: directions & bit != 0 };
        let encoders = [encoder(count_1, speed_1, 1), encoder(count_2, speed_2, 2)];
        Some(Self { potentiometers, currents, encoders })
    }
}

impl CustomIoReport {
    fn emit(&self, out: &mut Fields) {
        out.measured_words(&self.custom_ad);
        out.exact(&[self.inputs]);
    }

    fn read(mut data: &[u8]) -> Option<Self> {
        Some(Self { custom_ad: Field::take(&mut data)?, inputs: Field::take(&mut data)? })
    }
}

impl SensorReport {
    fn emit(&self, out: &mut Fields) {
        for &range in &self.sonar_cm {
            out.measured_byte(range);
        }
        out.measured_words(&self.human);
        out.measured_words(&self.tilt);
        out.measured_words(&self.overheat);
        out.measured_words(&[self.temperature, self.ir_range]);
        out.exact(&self.ir_command);
        out.measured_words(&self.battery);
        out.measured_words(&self.reference);
    }

    fn read(mut data: &[u8]) -> Option<Self> {
        Some(Self {
            sonar_cm: Field::take(&mut data)?,
            human: Field::take(&mut data)?,
            tilt: Field::take(&mut data)?,
            overheat: Field::take(&mut data)?,
            temperature: Field::take(&mut data)?,
            ir_range: Field::take(&mut data)?,
            ir_command: Field::take(&mut data)?,
            battery: Field::take(&mut data)?,
            reference: Field::take(&mut data)?,
        })
    }
}

/// DATA under construction, kept free of false end marks. The tables' lengths are below the
/// capacity, so nothing is ever cut off; the conformance tests hold every byte to its place.
#[derive(Default)]
struct Fields {
    bytes: heapless::Vec<u8, { len::SENSORS }>,
    /// Where the low bytes of measured values stand.
    measured: heapless::Vec<u8, { len::SENSORS }>,
}

impl Fields {
    /// Appends bytes that must be sent as they are.
    fn exact(&mut self, bytes: &[u8]) {
        let _ = self.bytes.extend_from_slice(bytes);
    }

    /// Appends a measured value of one byte.
    fn measured_byte(&mut self, value: u8) {
        let completes = self.bytes.last() == Some(&ETX[0]) && value == ETX[1];
        self.mark();
        self.exact(&[value ^ u8::from(completes)]);
    }

    /// Appends measured values of 12 bits.
    fn measured_words(&mut self, values: &[u16]) {
        for value in values {
            let [low, high] = value.min(&AD_MAX).to_le_bytes();
            let completes = self.bytes.last() == Some(&ETX[0]) && low == ETX[1];
            let contains = [low, high] == ETX;
            self.mark();
            self.exact(&[low ^ u8::from(completes || contains), high]);
        }
    }

    /// What comes next is measured.
    fn mark(&mut self) {
        if let Ok(at) = u8::try_from(self.bytes.len()) {
            let _ = self.measured.push(at);
        }
    }
}

/// The last byte of DATA and the checksum can be a false end mark too. The last byte is then a
/// flag (inputs = 0x5E), so the first measured value that can give way without making another
/// false mark changes the checksum instead.
fn avoid_false_etx_in_checksum(frame: &mut [u8], measured: &[u8]) {
    if !matches!(frame, [.., before, crc, _, _] if [*before, *crc] == ETX) {
        return;
    }
    let marks = |frame: &[u8]| frame.windows(ETX.len()).filter(|pair| *pair == ETX).count();
    let before = marks(frame);
    for at in measured.iter().map(|&at| usize::from(at)) {
        nudge(frame, at);
        if marks(frame) < before {
            return;
        }
        nudge(frame, at);
    }
}

/// Moves the measured value at this place of DATA by one least significant bit, there and back.
fn nudge(frame: &mut [u8], at: usize) {
    if let Some(byte) = frame.get_mut(DATA..).and_then(|data| data.get_mut(at)) {
        *byte ^= 1;
    }
    seal(frame);
}
