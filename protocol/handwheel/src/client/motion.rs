//! What moves something, and what stops it.
//!
//! [`Client::drive`] gives a motor its target and returns a [`Drive`], which keeps it running: only while one
//! is held are signs of life sent. However it ends, the motor is stopped: by [`Drive::stop`], which
//! also says whether the shaft stands, or when it is dropped.
//!
//! Sent again is only a command that was not acknowledged, and never one that has driven: a stop that another
//! host sends holds.
//!
//! Signs of life keep everything running, whoever drives it. So a drive looks for other hosts in every machine
//! state, and ends when one takes its motor, or starts another.

use std::time::Duration;

use protocol::extension::{ChannelState, MachineState, Mode, Reason, Request};
use protocol::pms5005::{Addressing, CHANNELS, Command, LcdFrame, Move, Quantity, Scope};

use super::stop::{STAND, STILL, Shafts, Stopped};
use super::streams::RENEW;
use super::{Client, TICK, driven, on};
use crate::error::Error;
use crate::number::Number;
use crate::session::{Event, SIGN_OF_LIFE};
use crate::words;

/// PWM without drive, and the most either way.
pub(super) const NEUTRAL: i16 = 16_384;
/// Servo pulses in counts of 1/2250 ms.
const COUNTS_PER_MS: f64 = 2250.0;
/// What a board tells may be older than the command.
const GRACE: Duration = Duration::from_millis(150);
/// A board that says nothing for so long is gone; it says something once a second.
const SILENCE: Duration = Duration::from_millis(2500);
/// How long a set-point may stand away from its target: it waits for a shaft, or for an acceleration.
const STANDS: Duration = Duration::from_secs(2);
/// A set-point is the target when it is so near: the wire rounds.
const ROUNDED: i32 = 1;
/// A shaft that is so near to its set-point does not keep it waiting.
const NEAR_COUNTS: i32 = 20;
/// Positions wrap here.
const TURN: i32 = 32_768;

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
    fn in_the_state(self) -> (Mode, i32) {
        match self.on_the_wire() {
            (Quantity::Pwm, word) => (Mode::Pwm, i32::from(word) - i32::from(NEUTRAL)),
            (Quantity::Velocity, velocity) => (Mode::Velocity, velocity.into()),
            (_, position) => (Mode::Position, position.into()),
        }
    }
}

/// How far apart two positions are, the shorter way.
fn apart(a: i32, b: i32) -> i32 {
    let way = a.wrapping_sub(b).rem_euclid(TURN);
    way.min(TURN - way)
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

impl Client {
    /// Gives a motor a target, to be reached in so much time (a ramp of the set-point; at most 65 s), and
    /// keeps it running. What [ends in good order](Self::end_when) ends the wait for the acknowledgement too:
    /// then the drive that is returned is to be stopped.
    ///
    /// # Errors
    /// [`Error::Stopped`] if it is driven already, [`Error::NoAnswer`] if it is not acknowledged,
    /// [`Error::NotCarried`], [`Error::Gone`].
    pub fn drive(
        &mut self,
        motor: Number,
        target: Target,
        time: Duration,
    ) -> Result<Drive<'_>, Error> {
        self.needs_a_pms5005("motors")?;
        let life = self.sign_of_life();
        let before = self.state_off(motor)?;
        let (quantity, value) = target.on_the_wire();
        let now = self.now();
        // From here on the motor may run, and a drive that is dropped stops it.
        let mut drive = Drive {
            client: self,
            motor,
            target,
            ramp: time,
            nearest: None,
            on: before.map_or([false; CHANNELS], |state| on(&state)),
            others: before.map_or(Vec::new(), |state| driven(&state)),
            command: move_of(motor, quantity, value, time).did(),
            begun: now,
            renew: now,
            shafts: Shafts::default(),
            over: false,
        };
        let command = move_of(motor, quantity, value, time);
        if !drive.client.is_to_end() {
            drive.client.command_unless_it_is_to_end(&command, "a motion command")?;
        }
        let now = drive.client.now();
        drive.client.session.drive(Some(life), now);
        (drive.begun, drive.renew) = (now, now);
        Ok(drive)
    }

    /// The machine state, with this motor off; `None` from a board that does not tell it.
    fn state_off(&mut self, motor: Number) -> Result<Option<MachineState>, Error> {
        let end = self.now() + GRACE;
        loop {
            let state = self.state()?;
            if state.is_none_or(|state| !on(&state)[motor.index()]) {
                return Ok(state);
            }
            if self.now() >= end {
                return Err(Error::Stopped(format!(
                    "motor {motor} is driven already; `handwheel stop` first, or end the other host"
                )));
            }
            self.pump(TICK)?;
        }
    }

    /// How often a sign of life is due: four times in the silence that the board allows.
    fn sign_of_life(&mut self) -> Duration {
        let timeout = self.identity.and_then(|_| self.numbered(LINK_TIMEOUT).ok());
        match timeout.map(|setting| setting.value) {
            Some(ms @ 1..) => {
                let quarter = Duration::from_millis(ms.unsigned_abs().into()) / 4;
                quarter.clamp(TICK, SIGN_OF_LIFE)
            }
            _ => SIGN_OF_LIFE,
        }
    }

    /// Moves a servo: a pulse in microseconds, 223 to 3111, in so much time. It holds, also when the host
    /// falls silent.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]; as [`drive`](Self::drive).
    pub fn servo(&mut self, servo: Number, pulse_us: f64, time: Duration) -> Result<(), Error> {
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
        let command = move_of(servo, Quantity::Servo, counts as i16, time);
        self.command(&command, "servos")
    }

    /// Sets the eight outputs; bit 0 is GPIO0.
    ///
    /// # Errors
    /// As [`drive`](Self::drive).
    pub fn gpio(&mut self, outputs: u8) -> Result<(), Error> {
        self.command(&Command::GpioOutputs(outputs), "GPIO")
    }

    /// Shows an image of 128 x 64 pixels: sixteen parts, as [`picture`](crate::picture) cuts them.
    ///
    /// # Errors
    /// As [`drive`](Self::drive).
    pub fn lcd(&mut self, image: &[[u8; LcdFrame::COLUMNS]; 16]) -> Result<(), Error> {
        (0..).zip(image).try_for_each(|(number, columns)| {
            self.command(&Command::Lcd(LcdFrame { number, columns }), "LCD")
        })
    }

    /// Sets the count of an encoder; only with its channel off.
    ///
    /// # Errors
    /// As all requests.
    pub fn set_count(&mut self, motor: Number, count: i32) -> Result<(), Error> {
        self.needs_a_pms5005("encoders to be set")?;
        let request = Request::SetCount { channel: motor.channel().number(), count };
        self.ask(&request, "a new count").map(drop)
    }
}

/// Number of the setting "link timeout".
const LINK_TIMEOUT: u16 = 1;

/// A motor that is driven: kept running for as long as this is held, and stopped when it ends.
pub struct Drive<'c> {
    client: &'c mut Client,
    motor: Number,
    target: Target,
    ramp: Duration,
    /// The least way from set-point to target that was seen, and since when nothing but another host has kept it
    /// from shrinking.
    nearest: Option<(i32, Duration)>,
    /// The channels that were on in the last machine state.
    on: [bool; CHANNELS],
    others: Vec<Number>,
    /// The command's DID, as a refusal names it.
    command: u8,
    begun: Duration,
    renew: Duration,
    /// What was seen of it since it is driven: only then is it told by the sensor that the command implies.
    shafts: Shafts,
    over: bool,
}

impl Drive<'_> {
    /// Time since the command was acknowledged.
    pub fn elapsed(&self) -> Duration {
        self.client.now() - self.begun
    }

    /// The motors that another host drove when this began. While this drive lasts, its signs of life keep them
    /// running too.
    pub fn others(&self) -> &[Number] {
        &self.others
    }

    /// Lets it run for so long.
    ///
    /// # Errors
    /// [`Error::Stopped`] says why it does not run any more; [`Error::Gone`].
    pub fn hold(&mut self, time: Duration) -> Result<(), Error> {
        self.hold_while(|elapsed, _| elapsed < time)
    }

    /// Lets it run for as long as `go_on` says, which is told the time since it began, and a new machine
    /// state of the motor driven if there is one.
    ///
    /// # Errors
    /// As [`hold`](Self::hold).
    pub fn hold_while(
        &mut self,
        mut go_on: impl FnMut(Duration, Option<&MachineState>) -> bool,
    ) -> Result<(), Error> {
        while go_on(self.elapsed(), None) {
            if self.client.has_state() && self.client.now() >= self.renew {
                self.renew = self.client.now() + RENEW;
                self.client.ask_for_states();
            }
            self.client.pump(TICK)?;
            while let Some(event) = self.client.session.take_event() {
                let Event::State(state) = event else {
                    self.shafts.see(&event, self.client.now());
                    continue;
                };
                self.look(&state)?;
                if state.channels[self.motor.index()].mode == Mode::Off {
                    continue; // The command has not come yet.
                }
                self.shafts.see(&event, self.client.now());
                if !go_on(self.elapsed(), Some(&state)) {
                    return Ok(());
                }
            }
            if self.client.now() > self.client.heard.max(self.begun) + SILENCE {
                return Err(self.client.silent());
            }
        }
        Ok(())
    }

    /// Whether it still does what was asked, and nobody else has begun to drive.
    fn look(&mut self, state: &MachineState) -> Result<(), Error> {
        let now = on(state);
        let is_new =
            |other: &Number| *other != self.motor && now[other.index()] && !self.on[other.index()];
        let (motor, other) = (self.motor, Number::all().find(is_new));
        self.on = now;
        if let Some(other) = other {
            return Err(Error::Stopped(format!(
                "another host drives motor {other} now, which this drive would keep running if that host died; motor {motor} is stopped: let one host drive both"
            )));
        }
        let channel = &state.channels[motor.index()];
        let is_refused = matches!(channel.reason, Reason::OtherMethod | Reason::BeyondScale)
            && channel.detail == self.command;
        if self.elapsed() <= GRACE {
            return Ok(());
        }
        let differs = match channel.mode {
            Mode::Off => None,
            _ => self.differs(channel),
        };
        let is_halted = matches!(
            channel.reason,
            Reason::Fault | Reason::Silence | Reason::Suspended | Reason::OldCommand
        );
        let is_neutral = channel.set_point == 0 && channel.mode != Mode::Position;
        if channel.mode == Mode::Off || is_refused || differs.is_some() && (is_halted || is_neutral)
        {
            let why =
                words::reason(channel).unwrap_or_else(|| "another host has stopped it".into());
            return Err(Error::Stopped(format!("motor {motor} does not run: {why}")));
        }
        match differs {
            Some(differs) => Err(Error::Stopped(format!(
                "another host drives motor {motor}: {differs}; the motor is stopped: end that host"
            ))),
            None => Ok(()),
        }
    }

    /// How the channel's mode or set-point shows that it is not this drive's any more. On the way to its target
    /// a set-point only comes nearer, except that a position waits for its shaft, or goes back with it.
    fn differs(&mut self, channel: &ChannelState) -> Option<String> {
        let (mode, target) = self.target.in_the_state();
        if channel.mode != mode {
            let words = [channel.mode, mode].map(words::mode);
            return Some(format!("its mode is {}, not {}", words[0], words[1]));
        }
        let (set_point, is_position) = (i32::from(channel.set_point), mode == Mode::Position);
        let way = match is_position {
            true => apart(set_point, target),
            false => (set_point - target).abs(),
        };
        let now = self.client.now();
        let (nearest, since) = self.nearest.unwrap_or((way, now));
        let has_arrived = nearest <= ROUNDED;
        let is_away = way > nearest + ROUNDED && (has_arrived || !is_position);
        let is_hindered =
            channel.reason != Reason::None || apart(channel.position, set_point) > NEAR_COUNTS;
        let waits = is_position && is_hindered;
        let stands = way > ROUNDED && !waits && now > since.max(self.begun + self.ramp) + STANDS;
        let since = if way < nearest || waits { now } else { since };
        self.nearest = Some((way.min(nearest), since));
        (is_away || stands).then(|| format!("its set-point is {set_point}, not {target}"))
    }

    /// Stops the motor, and waits until the shaft stands, a second at most. Then its bridge is off.
    ///
    /// # Errors
    /// [`Error::NotConfirmed`] when the stop is not acknowledged. The board then stops it by itself, 2 s after
    /// the last sign of life unless its settings say otherwise.
    pub fn stop(mut self) -> Result<Stopped, Error> {
        self.end().map_err(Error::of_a_stop)
    }

    fn end(&mut self) -> Result<Stopped, Error> {
        self.over = true;
        let client = &mut *self.client;
        let begun = client.now();
        client.session.drive(None, begun);
        client.session.forget();
        client.command(&move_of(self.motor, Quantity::Pwm, NEUTRAL, Duration::ZERO), "a stop")?;
        client.wait_until_it_stands(&mut self.shafts, &[self.motor], begun + STAND)?;
        let stands = self.shafts.stand(&[self.motor], client.now());
        let waited = client.now() - begun;
        let suspend = Command::Run { scope: Scope::Motor(self.motor.channel()), run: false };
        client.command(&suspend, "a stop")?;
        Ok(Stopped {
            stands,
            confirmed: true,
            is_opposed: false,
            after: if stands == Some(true) { waited.saturating_sub(STILL) } else { waited },
            position: self.shafts.turned(self.motor),
        })
    }
}

impl Drop for Drive<'_> {
    fn drop(&mut self) {
        if !self.over {
            // The link may be gone. Then silence stops it.
            let _ = self.end();
        }
    }
}
