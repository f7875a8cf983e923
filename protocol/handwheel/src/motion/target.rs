//! What a motor is asked for, in people's units, on the wire, and as the machine state shows it.

use std::time::Duration;

use protocol::extension::Mode;
use protocol::pms5005::{Addressing, CHANNELS, Command, Move, Quantity, Scope};

use crate::error::Error;
use crate::number::Number;

/// Positions of the wire wrap here; the machine state's do not.
pub(crate) const TURN: i32 = 32_768;
/// PWM without drive, and the most either way.
const NEUTRAL: i16 = 16_384;
/// Servo pulses in counts of 1/2250 ms.
const COUNTS_PER_MS: f64 = 2250.0;

/// All off, at once.
pub(crate) const SUSPEND: Command<'static> = Command::Run { scope: Scope::All, run: false };
/// No drive: what is suspended would go on with its move when it is resumed.
pub(crate) const NEUTRAL_ALL: Command<'static> = Command::Move(Move {
    quantity: Quantity::Pwm,
    addressing: Addressing::All,
    targets: [Some(NEUTRAL); CHANNELS],
    periods: 0,
});

/// For how long a stop of everything is repeated while another host drives on.
pub(crate) const REPEAT: Duration = Duration::from_secs(3);

/// A position of the wire, on the turn on which it is nearest to this one.
pub(crate) fn unwrapped(wire: i32, near: i32) -> i32 {
    let way = wire.wrapping_sub(near).wrapping_add(TURN / 2).rem_euclid(TURN) - TURN / 2;
    near.wrapping_add(way)
}

/// One motor without drive.
pub(crate) fn neutral(motor: Number) -> Command<'static> {
    move_of(motor, Quantity::Pwm, NEUTRAL, Duration::ZERO)
}

/// One motor off.
pub(crate) fn suspend(motor: Number) -> Command<'static> {
    Command::Run { scope: Scope::Motor(motor.channel()), run: false }
}

/// What a motor is to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Open loop: -1 to 1 of full drive.
    Duty(f64),
    /// Counts of its sensor per second, -32767 to 32767.
    Velocity(i16),
    /// A position in counts of its sensor, 0 to 32767; a potentiometer has 4096 of them.
    Position(i16),
}

impl Target {
    /// The command that asks for it, to be reached in so much time; at most 65 s.
    pub(crate) fn command(self, motor: Number, time: Duration) -> Command<'static> {
        let (quantity, value) = self.on_the_wire();
        move_of(motor, quantity, value, time)
    }

    fn on_the_wire(self) -> (Quantity, i16) {
        match self {
            Self::Duty(duty) => {
                let word = f64::from(NEUTRAL) * (1.0 + duty.clamp(-1.0, 1.0));
                (Quantity::Pwm, word.round().clamp(0.0, f64::from(i16::MAX)) as i16)
            }
            Self::Velocity(velocity) => (Quantity::Velocity, velocity),
            Self::Position(position) => (Quantity::Position, position),
        }
    }

    /// What the machine state shows when it is reached.
    pub(crate) fn in_the_state(self) -> (Mode, i32) {
        match self.on_the_wire() {
            (Quantity::Pwm, word) => (Mode::Pwm, i32::from(word) - i32::from(NEUTRAL)),
            (Quantity::Velocity, velocity) => (Mode::Velocity, velocity.into()),
            (_, position) => (Mode::Position, position.into()),
        }
    }
}

impl std::fmt::Display for Target {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Duty(duty) => write!(f, "PWM {} %", duty * 100.0),
            Self::Velocity(velocity) => write!(f, "velocity {velocity} counts/s"),
            Self::Position(position) => write!(f, "position {position} counts"),
        }
    }
}

fn targets(number: Number, value: i16) -> [Option<i16>; CHANNELS] {
    let mut targets = [None; CHANNELS];
    targets[number.index()] = Some(value);
    targets
}

fn move_of(number: Number, quantity: Quantity, value: i16, time: Duration) -> Command<'static> {
    let periods = u16::try_from(time.as_millis()).unwrap_or(u16::MAX);
    let targets = targets(number, value);
    Command::Move(Move { quantity, addressing: Addressing::List, targets, periods })
}

/// The command that moves a servo: a pulse in microseconds, 223 to 3111, in so much time.
///
/// # Errors
/// [`Error::OutOfRange`].
pub(crate) fn servo(
    servo: Number,
    pulse_us: f64,
    time: Duration,
) -> Result<Command<'static>, Error> {
    let counts = (pulse_us * COUNTS_PER_MS / 1000.0).round();
    let (low, high) = Quantity::Servo.range();
    if !(f64::from(low)..=f64::from(high)).contains(&counts) {
        let us = |counts: i16| f64::from(counts) * 1000.0 / COUNTS_PER_MS;
        return Err(Error::OutOfRange {
            name: format!("servo {servo}, in us"),
            value: pulse_us.round() as i64,
            low: us(low).ceil() as i32,
            high: us(high).floor() as i32,
        });
    }
    Ok(move_of(servo, Quantity::Servo, counts as i16, time))
}
