//! What a board tells again and again: machine states, telemetry, a CM-5's servos.
//!
//! A machine state is asked for in portions, so that the stream ends by itself if the program does.
//! Asking for it is no sign of life: who watches keeps nothing running.

use std::time::Duration;

use protocol::extension::{MachineState, Request};
use protocol::pms5005::{Command, Repeat, Report};

use super::{Client, TICK};
use crate::error::Error;
use crate::servo::Servo;
use crate::session::{Event, Personality};
use crate::state::{ASK, RENEW};

/// After which silence a stream has ended.
const SILENCE: Duration = Duration::from_secs(3);
/// A CM-5 whose PC is silent says hello every 10 s.
const HELLO: Duration = Duration::from_secs(12);

/// Machine states, one after the other, every period of setting "machine state period" (20 ms).
pub struct States<'c> {
    client: &'c mut Client,
    renew: Duration,
}

impl Client {
    /// The stream of machine states.
    ///
    /// # Errors
    /// [`Error::NotCarried`] by a board that does not tell it.
    pub fn states(&mut self) -> Result<States<'_>, Error> {
        if !self.has_state() {
            let why = "; its firmware is older, or the line slower than 16,000 baud";
            return Err(Error::NotCarried(self.personality(), "machine state", why));
        }
        Ok(States { renew: self.now(), client: self })
    }

    /// The stream of telemetry.
    ///
    /// # Errors
    /// [`Error::NotCarried`] by another board than a PMS5005.
    pub fn reports(&mut self) -> Result<Reports<'_>, Error> {
        self.needs_a_pms5005("telemetry")?;
        Ok(Reports(self))
    }

    /// The stream of a CM-5's servos. Nothing is written to it.
    ///
    /// # Errors
    /// [`Error::NotCarried`] by another board.
    pub fn servos(&mut self) -> Result<Servos<'_>, Error> {
        match self.personality() {
            Personality::Cm5 => Ok(Servos { client: self, ids: Vec::new(), reports: false }),
            other => Err(Error::NotCarried(other, "bus of AX-12 servos", "")),
        }
    }

    pub(super) fn ask_for_states(&mut self) {
        self.session.send(&ASK);
    }

    pub(super) fn end_states(&mut self) {
        self.session.send(&Command::Extension(Request::State(Repeat::Stop)));
        // The link may be gone; then the stream ends by itself.
        let _ = self.pump(Duration::ZERO);
    }

    /// Waits for an event that `wanted` takes.
    fn next<T>(
        &mut self,
        silence: Duration,
        what: &'static str,
        wanted: impl Fn(Event) -> Option<T>,
    ) -> Result<T, Error> {
        let end = self.now() + silence;
        loop {
            while let Some(event) = self.session.take_event() {
                if let Some(found) = wanted(event) {
                    return Ok(found);
                }
            }
            if self.now() >= end {
                return Err(Error::NoAnswer(what));
            }
            self.pump(TICK)?;
        }
    }
}

impl Iterator for States<'_> {
    type Item = Result<MachineState, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.client.now() >= self.renew {
            self.renew = self.client.now() + RENEW;
            self.client.ask_for_states();
        }
        let mut tries = 3;
        loop {
            // One portion may get lost.
            match self.client.next(SILENCE / 3, "its machine state", |event| match event {
                Event::State(state) => Some(state),
                _ => None,
            }) {
                Err(Error::NoAnswer(_)) if tries > 0 => {
                    tries -= 1;
                    self.client.ask_for_states();
                }
                result => return Some(result),
            }
        }
    }
}

impl Drop for States<'_> {
    fn drop(&mut self) {
        self.client.end_states();
    }
}

/// Telemetry, as it comes.
pub struct Reports<'c>(&'c mut Client);

impl Iterator for Reports<'_> {
    type Item = Result<Report, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        Some(self.0.next(SILENCE, "telemetry, which may be switched off", |event| match event {
            Event::Report(report) => Some(report),
            _ => None,
        }))
    }
}

/// A CM-5's servos, as often as it reports.
pub struct Servos<'c> {
    client: &'c mut Client,
    ids: Vec<u8>,
    /// It has reported.
    reports: bool,
}

impl Servos<'_> {
    /// The IDs of the servos; waits for the CM-5's hello, up to 12 s.
    ///
    /// # Errors
    /// [`Error::NoAnswer`] if there is none, [`Error::Gone`].
    pub fn ids(&mut self) -> Result<&[u8], Error> {
        if self.ids.is_empty() {
            self.ids = self.client.next(HELLO, "its servos", |event| match event {
                Event::Servos(ids) => Some(ids),
                _ => None,
            })?;
        }
        Ok(&self.ids)
    }
}

impl Iterator for Servos<'_> {
    type Item = Result<Vec<Servo>, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Err(error) = self.ids() {
            return Some(Err(error));
        }
        loop {
            let found = self.client.next(HELLO, "its servos", |event| match event {
                Event::Servos(_) | Event::Feedback(_) => Some(event),
                _ => None,
            });
            match found {
                Ok(Event::Feedback(feedback)) => {
                    self.reports = true;
                    let servos = self.ids.iter().zip(feedback);
                    return Some(Ok(servos.map(|(&id, told)| Servo::of(id, told)).collect()));
                }
                // It says hello until its host has answered, and reports nothing before.
                Ok(Event::Servos(ids)) => {
                    self.ids = ids;
                    if self.reports {
                        continue;
                    }
                    let silent = |&id| Servo { id, registers: None };
                    return Some(Ok(self.ids.iter().map(silent).collect()));
                }
                Ok(_) => {}
                Err(error) => return Some(Err(error)),
            }
        }
    }
}
