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

use protocol::extension::{MachineState, Mode, Request};
use protocol::pms5005::{CHANNELS, Command, LcdFrame};

use super::stop::Stopped;
use super::{Client, TICK, driven};
use crate::error::Error;
use crate::motion::shafts::{STAND, STILL, Shafts};
use crate::motion::target::{self, Target};
use crate::motion::watch::{GRACE, Watch};
use crate::number::Number;
use crate::session::{Event, sign_of_life};
use crate::settings::LINK_TIMEOUT;
use crate::state::{RENEW, on};

/// A board that says nothing for so long is gone; it says something once a second.
const SILENCE: Duration = Duration::from_millis(2500);

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
        let now = self.now();
        // From here on the motor may run, and a drive that is dropped stops it.
        let mut drive = Drive {
            client: self,
            motor,
            watch: Watch::new(motor, target, time, now),
            on: before.map_or([false; CHANNELS], |state| on(&state)),
            others: before.map_or(Vec::new(), |state| driven(&state)),
            renew: now,
            shafts: Shafts::default(),
            over: false,
        };
        let command = target.command(motor, time);
        if !drive.client.is_to_end() {
            drive.client.command_unless_it_is_to_end(&command, "a motion command")?;
        }
        let now = drive.client.now();
        drive.client.session.drive(Some(life), now);
        drive.watch.begins(now);
        drive.renew = now;
        Ok(drive)
    }

    /// The machine state before something is driven. What a board tells may be older than the last stop: what is
    /// on is looked at again for a moment.
    ///
    /// # Errors
    /// As [`state`](Self::state).
    pub fn state_at_rest(&mut self) -> Result<Option<MachineState>, Error> {
        let end = self.now() + GRACE;
        loop {
            let state = self.state()?;
            if state.is_none_or(|state| on(&state) == [false; CHANNELS]) || self.now() >= end {
                return Ok(state);
            }
            self.pump(TICK)?;
        }
    }

    /// The same, with this motor off; `None` from a board that does not tell it.
    pub(super) fn state_off(&mut self, motor: Number) -> Result<Option<MachineState>, Error> {
        let state = self.state_at_rest()?;
        if state.is_some_and(|state| on(&state)[motor.index()]) {
            return Err(Error::Stopped(format!(
                "motor {motor} is driven already; `handwheel stop` first, or end the other host"
            )));
        }
        Ok(state)
    }

    /// How often a sign of life is due.
    fn sign_of_life(&mut self) -> Duration {
        let timeout = self.identity.and_then(|_| self.numbered(LINK_TIMEOUT).ok());
        sign_of_life(timeout.map(|setting| setting.value))
    }

    /// Moves a servo: a pulse in microseconds, 223 to 3111, in so much time. It holds, also when the host
    /// falls silent.
    ///
    /// # Errors
    /// [`Error::OutOfRange`]; as [`drive`](Self::drive).
    pub fn servo(&mut self, servo: Number, pulse_us: f64, time: Duration) -> Result<(), Error> {
        let command = target::servo(servo, pulse_us, time)?;
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

/// A motor that is driven: kept running for as long as this is held, and stopped when it ends.
pub struct Drive<'c> {
    client: &'c mut Client,
    motor: Number,
    watch: Watch,
    /// The channels that were on in the last machine state.
    on: [bool; CHANNELS],
    others: Vec<Number>,
    renew: Duration,
    /// What was seen of it since it is driven: only then is it told by the sensor that the command implies.
    shafts: Shafts,
    over: bool,
}

impl Drive<'_> {
    /// Time since the command was acknowledged.
    pub fn elapsed(&self) -> Duration {
        self.client.now() - self.watch.begun()
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
            if self.client.now() > self.client.heard.max(self.watch.begun()) + SILENCE {
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
        let now = self.client.now();
        self.watch.look(&state.channels[motor.index()], now).map_err(Error::Stopped)
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
        client.command(&target::neutral(self.motor), "a stop")?;
        client.wait_until_it_stands(&mut self.shafts, &[self.motor], begun + STAND)?;
        let stands = self.shafts.stand(&[self.motor], client.now());
        let waited = client.now() - begun;
        client.command(&target::suspend(self.motor), "a stop")?;
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
