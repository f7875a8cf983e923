//! What the board tells: the telemetry frames of Tables II.2, II.3 and II.4, both directions.
//!
//! A/D values are 12 bits, sent low byte first. Conversions to volts, degrees and centimetres are
//! the host's; the fields here are what the converters and counters read.
//!
//! Hosts exist that find the end of a frame by searching for `5E 0D`. [`Report::encode`] keeps
//! these bytes out of DATA and checksum where a measured value would put them there, by sending
//! that value one less, or one more. Encoder counts and sonar centimetres give way too: a host that
//! searches is otherwise blind for as long as a wheel rests at 3422. Flags and key codes are sent as
//! they are, and so is a speed whose sign would change: none does, since 0 and 1 hold no end mark.

use super::did;
use super::frame::{DATA, ETX, Frame, RES_NO_ACK, RID_HOST, seal};
use crate::data::{Data, EncodeError, Field, record};

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

record! {
    /// Custom GPIO and A/D (DID 124, Table II.3).
    #[derive(Default)]
    pub struct CustomIoReport {
        /// A/D values of the custom channels.
        pub custom_ad: [u16; 8],
        /// Input port: bit 0 is input 0.
        pub inputs: u8,
    }
}

record! {
    /// Sensors (DID 125, Table II.4).
    #[derive(Default)]
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

/// Where the encoders' counts and speeds begin in Table II.2, behind the A/D values.
const FIRST_COUNT: usize = 24;

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
        let mut data = Data::new();
        match self {
            Self::Motors(report) => report.put(&mut data)?,
            Self::CustomIo(report) => report.put(&mut data)?,
            Self::Sensors(report) => report.put(&mut data)?,
        }
        for (at, size) in self.measured() {
            if matches!(self, Self::Motors(_)) && at >= FIRST_COUNT {
                give_way(&mut data, at, size, u16::MAX);
            } else {
                give_way(&mut data, at, size, AD_MAX);
            }
        }
        let frame = Frame { rid: RID_HOST, res: RES_NO_ACK, did: self.did(), data: &data };
        let frame = frame.encode(out)?;
        avoid_false_etx_in_checksum(frame, self.measured().map(|(at, _)| at));
        Ok(frame)
    }

    /// Where the measured values stand in DATA, and how many bytes each has.
    fn measured(&self) -> impl Iterator<Item = (usize, usize)> {
        let (bytes, words) = match self {
            Self::Motors(_) => (0..0, [0..FIRST_COUNT, FIRST_COUNT..32]),
            Self::CustomIo(_) => (0..0, [0..16, 0..0]),
            Self::Sensors(_) => (0..6, [6..26, 30..40]),
        };
        let words = words.into_iter().flat_map(|words| words.step_by(2));
        bytes.map(|at| (at, 1)).chain(words.map(|at| (at, 2)))
    }

    /// Reads DID and DATA of an intact frame. `None` if it is not telemetry.
    pub fn parse(did: u8, mut data: &[u8]) -> Option<Self> {
        match (did, data.len()) {
            (did::MOTORS, len::MOTORS) => Field::take(&mut data).map(Self::Motors),
            (did::CUSTOM_IO, len::CUSTOM_IO) => Field::take(&mut data).map(Self::CustomIo),
            (did::SENSORS, len::SENSORS) => Field::take(&mut data).map(Self::Sensors),
            _ => None,
        }
    }
}

impl Field for MotorReport {
    fn put(&self, data: &mut Data) -> Result<(), EncodeError> {
        [self.potentiometers, self.currents].put(data)?;
        let mut directions = 0;
        for (bit, encoder) in [1, 2].into_iter().zip(self.encoders) {
            [encoder.count, encoder.speed].put(data)?;
            directions |= if encoder.positive { bit } else { 0u8 };
        }
        directions.put(data)
    }

    fn take(data: &mut &[u8]) -> Option<Self> {
        let [potentiometers, currents] = Field::take(data)?;
        let [count_1, speed_1, count_2, speed_2] = Field::take(data)?;
        let directions = u8::take(data)?;
        let encoder = |count, speed, bit| Encoder { count, speed, positive: directions & bit != 0 };
        let encoders = [encoder(count_1, speed_1, 1), encoder(count_2, speed_2, 2)];
        Some(Self { potentiometers, currents, encoders })
    }
}

/// Limits a measured value of this many bytes to `most`, and keeps it from making a false end mark
/// with its own bytes or with the byte before it, by sending one less.
fn give_way(data: &mut Data, at: usize, size: usize, most: u16) {
    let before = at.checked_sub(1).and_then(|before| data.get(before)).copied();
    let Some(value) = data.get_mut(at..).and_then(|rest| rest.get_mut(..size)) else { return };
    if let [low, high] = value {
        [*low, *high] = u16::from_le_bytes([*low, *high]).min(most).to_le_bytes();
    }
    let contains = *value == ETX;
    if let [low, ..] = value {
        let completes = before == Some(ETX[0]) && *low == ETX[1];
        *low = low.wrapping_sub(u8::from(completes || contains)); // 0x5D or 0x0C
    }
}

/// The last byte of DATA and the checksum can be a false end mark too. The last byte is then a
/// flag (inputs = 0x5E), so the first measured value that can give way without making another
/// false mark changes the checksum instead; none that may have given way already.
fn avoid_false_etx_in_checksum(frame: &mut [u8], measured: impl Iterator<Item = usize>) {
    if !matches!(frame, [.., before, crc, _, _] if [*before, *crc] == ETX) {
        return;
    }
    let marks = |frame: &[u8]| frame.windows(ETX.len()).filter(|pair| *pair == ETX).count();
    let before = marks(frame);
    for at in measured {
        let has_given_way =
            match frame.get(DATA..).and_then(|data| data.get(at.saturating_sub(1)..)) {
                Some([_, 0x5D, 0x0D, ..] | [0x5E, 0x0C, ..]) => true,
                Some([0x5D, 0x0D, ..]) => at == 0,
                _ => false,
            };
        if has_given_way {
            continue;
        }
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
