//! What is asked of the board, and what for: the session settles one exchange after the other.

use std::time::Duration;

use protocol::extension::{Action, Request};
use protocol::pms5005::Command;
use serde_json::Value;

use super::{Asker, Panel, board};
use crate::Number;
use crate::error::Error;
use crate::session::{Failure, Reply, Session};

/// What an exchange of the session is for; one each, in their order.
pub(super) enum Purpose {
    /// A page waits until it is done.
    Page(Asker, &'static str),
    /// The same of a save, or a reset.
    Keep(Asker, Action),
    Servo(Asker),
    /// A part of a picture; the last one's page waits.
    Lcd(Option<Asker>),
    /// That a step is to be recorded.
    Record,
    /// A motion command, numbered; of a step nobody waits for it.
    Drive(Number, u64, Option<Asker>),
    /// The acknowledged part of a stop of everything, and of one motor.
    Stop,
    End(Number),
    Board(board::Asked),
    /// Of this reading of all settings.
    ReadSetting(u64),
    Change,
    /// What a job asks.
    Job,
    /// Nobody waits.
    Quiet,
}

/// Exchanges that may wait; pages that ask for more are refused.
pub(super) const MOST: usize = 256;

impl Panel {
    /// What came of the oldest exchange.
    pub(super) fn settle_next(&mut self, result: Result<Reply, Failure>) {
        if let Some(purpose) = self.purposes.pop_front() {
            self.settle(purpose, result);
        }
    }

    fn settle(&mut self, purpose: Purpose, result: Result<Reply, Failure>) {
        let personality = self.personality();
        let done = |result: Result<Reply, Failure>, what| {
            result.map(drop).map_err(|failure| Error::of(failure, personality, what))
        };
        let said = |result: Result<(), Error>| {
            result.map(|()| Value::Null).map_err(|error| error.to_string())
        };
        match purpose {
            Purpose::Page(asker, what) => self.answer(asker, said(done(result, what))),
            Purpose::Servo(asker) => self.answer(asker, said(done(result, "servos"))),
            Purpose::Keep(asker, action) => {
                let result = done(result, "a save of its settings");
                if result.is_ok() {
                    self.was_kept(action);
                }
                self.answer(asker, said(result));
            }
            Purpose::Lcd(asker) => {
                self.lcd_is_heard(asker, done(result, "LCD").map_err(|e| e.to_string()));
            }
            Purpose::Drive(motor, command, asker) => {
                self.driven(motor, command, asker, done(result, "a motion command"));
            }
            Purpose::Stop => self.stop_is_heard(done(result, "a stop")),
            Purpose::End(motor) => self.end_is_heard(motor, done(result, "a stop")),
            Purpose::Board(asked) => self.board_tells(asked, result),
            Purpose::ReadSetting(reading) => self.setting_is_read(reading, result),
            Purpose::Change => self.change_goes_on(result),
            Purpose::Job => self.job_is_answered(result),
            Purpose::Record => self.step_is_recorded(result),
            Purpose::Quiet => {}
        }
    }

    /// Drops what has not been answered or sent; who waits for it is told why.
    pub(super) fn forget(&mut self, why: &str) {
        self.session.forget();
        for purpose in std::mem::take(&mut self.purposes) {
            self.tell_dropped(&purpose, why);
        }
        self.settings_were_interrupted(why);
        self.board.was_interrupted();
    }

    /// Drops what these are for, and tells who waits why.
    pub(super) fn withdraw(&mut self, which: impl Fn(&Purpose) -> bool, why: &str) {
        while let Some(place) = self.purposes.iter().position(&which) {
            self.session.withdraw(place);
            if let Some(purpose) = self.purposes.remove(place) {
                self.tell_dropped(&purpose, why);
            }
        }
    }

    fn tell_dropped(&mut self, purpose: &Purpose, why: &str) {
        if matches!(purpose, Purpose::Job) {
            self.job_is_dropped();
        }
        if let Purpose::Page(asker, _)
        | Purpose::Keep(asker, _)
        | Purpose::Servo(asker)
        | Purpose::Lcd(Some(asker))
        | Purpose::Drive(_, _, Some(asker)) = purpose
        {
            self.answer(*asker, Err(format!("not done: {why}")));
        }
    }

    pub(super) fn ask(&mut self, request: &Request<'_>, purpose: Purpose) {
        self.queue(purpose, |session, now| session.ask(request, now));
    }

    pub(super) fn command(&mut self, command: &Command<'_>, purpose: Purpose) {
        self.queue(purpose, |session, now| session.command(command, now));
    }

    pub(super) fn queue(
        &mut self,
        purpose: Purpose,
        begin: impl FnOnce(&mut Session, Duration) -> Result<(), Failure>,
    ) {
        // What the line does not carry has failed before anything was sent.
        match begin(&mut self.session, self.now) {
            Ok(()) => self.purposes.push_back(purpose),
            Err(failure) => self.settle(purpose, Err(failure)),
        }
    }
}
