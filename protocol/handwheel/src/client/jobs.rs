//! What takes a while and is done by a [`Job`]: checks, tunings, recordings.

use protocol::extension::{Recording, Request, Row, Setup};

use super::{Client, TICK};
use crate::error::Error;
use crate::number::Number;
use crate::session::Reply;
use crate::tune::{self, Job, Refused};

impl Client {
    /// Whether the board has a recorder: since version 3 of the extension.
    pub fn has_recorder(&self) -> bool {
        self.has_state() && self.identity().is_some_and(|who| who.extension >= tune::RECORDER)
    }

    /// Runs a job on a motor that is off to its end. What [ends in good order](Self::end_when) stops it.
    ///
    /// # Errors
    /// [`Error::NotCarried`] by a board without a recorder; [`Error::Stopped`] with the refusal, the motor off
    /// and the settings as they were unless it says otherwise; when the link is gone the board's own watch stops the
    /// motor, and what was set meanwhile lasts until it is restarted.
    pub fn run<T>(
        &mut self,
        motor: Number,
        job: Job<T>,
        look: impl FnMut(&'static str),
    ) -> Result<T, Error> {
        self.needs_a_recorder()?;
        self.state_off(motor)?;
        let outcome = self.finish(job, look).map_err(|gone| {
            Error::Stopped(format!(
                "{gone}; motor {motor} is left to the board's own watch, and {}",
                tune::LEFT
            ))
        })?;
        outcome.map_err(|refused| Error::Stopped(format!("motor {motor}: {refused}")))
    }

    /// Lets a job go on to its end; `look` is told what it is about, whenever that changes.
    fn finish<T>(
        &mut self,
        mut job: Job<T>,
        mut look: impl FnMut(&'static str),
    ) -> Result<Result<T, Refused>, Error> {
        let mut said = "";
        loop {
            if self.is_to_end() {
                job.stop("stopped by Ctrl-C");
            }
            let now = self.now();
            job.converse(&mut self.session, now);
            if job.doing() != said {
                said = job.doing();
                look(said);
            }
            if let Some(outcome) = job.outcome() {
                return Ok(outcome);
            }
            self.pump(TICK)?;
        }
    }

    /// Begins a recording.
    ///
    /// # Errors
    /// As all requests; [`Error::NotCarried`] by a board without a recorder.
    pub fn record(&mut self, setup: Setup) -> Result<Recording, Error> {
        self.needs_a_recorder()?;
        match self.ask(&Request::Record(setup), "a recording")? {
            Reply::Recording(recording) => Ok(recording),
            _ => Err(Error::NoAnswer("a recording")),
        }
    }

    /// Reads a recording, when it is done: its rows, sample by sample, and within a sample channel by channel.
    ///
    /// # Errors
    /// [`Error::Stopped`] when another host has begun another, or parts are lost again and again; [`Error::Gone`].
    pub fn recorded(&mut self, recording: &Recording) -> Result<Vec<Row>, Error> {
        let outcome = self.finish(tune::read(recording.serial), |_| ())?;
        outcome.map_err(|refused| Error::Stopped(refused.to_string()))
    }

    pub(crate) fn needs_a_recorder(&self) -> Result<(), Error> {
        self.needs_a_pms5005("a recorder")?;
        let why = "; its firmware is older, or the line slower than 16,000 baud";
        match self.has_recorder() {
            true => Ok(()),
            false => Err(Error::NotCarried(self.personality(), "recorder", why)),
        }
    }
}
