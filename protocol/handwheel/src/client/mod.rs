//! What a host program uses: a board behind a link, asked and driven, blocking.
//!
//! - here: the connection, and what a board is asked about itself;
//! - `settings`: settings by name;
//! - `jobs`: checks, tunings, recordings;
//! - `motion`: what moves something; `stop`: what stops it, and how a shaft is known to stand;
//! - `streams`: telemetry and machine state, one after the other;
//! - `arm`: the session of ARCOS that a Pioneer Arm wants around all of it.

mod arm;
mod jobs;
mod motion;
mod settings;
mod stop;
mod streams;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use protocol::extension::{
    Action, Counters, FaultRecord, Health, Identity, MachineState, Refusals, Request, flag,
};
use protocol::pms5005::Command;

use crate::auto;
use crate::error::Error;
use crate::link::Link;
use crate::number::Number;
use crate::session::{Event, Failure, Greeting, HEAR, Personality, Reply, Session};
use crate::state::on;
use crate::transport::{self, Transport};

pub use crate::servo::Servo;
pub use arm::Arm;
pub use motion::Drive;
pub use stop::Stopped;
pub use streams::{Reports, Servos, States};

/// How long one read waits; nothing is later than that.
const TICK: Duration = Duration::from_millis(10);
/// Within what time a board that is there says something.
const PING: Duration = Duration::from_millis(1300);

/// A connected board. Dropped, it ends what it has begun: streams, and a session of ARCOS.
pub struct Client {
    link: Link,
    transport: Box<dyn Transport>,
    session: Session,
    clock: Instant,
    /// When bytes came last.
    heard: Duration,
    identity: Option<Identity>,
    /// A session of ARCOS is open, and whether it is ours to close.
    arm: Option<arm::Opened>,
    state: Option<MachineState>,
    /// Becomes true when the user wants an end.
    end: Option<Arc<AtomicBool>>,
}

impl Client {
    /// Opens a link, and finds out what is there.
    ///
    /// # Errors
    /// What keeps the link from being opened, [`Error::NoBoard`], [`Error::Gone`].
    pub fn connect(link: &Link) -> Result<Self, Error> {
        match link {
            Link::Auto => auto::find(),
            link => Self::over(link.clone(), transport::open(link)?, Session::new()),
        }
    }

    /// Opens a link, and stops everything there before anything else is asked: on a link that is named, even
    /// before anything is heard.
    ///
    /// # Errors
    /// As [`connect`](Self::connect) and [`stop`](Self::stop).
    pub fn connect_and_stop(link: &Link) -> Result<(Self, Stopped), Error> {
        let mut client = match link {
            Link::Auto => auto::hear()?,
            link => {
                let mut client = Self::new(link.clone(), transport::open(link)?, Session::new());
                let found = client.stop_unheard().and_then(|()| client.find_out());
                found.map_err(Error::of_a_stop)?;
                client
            }
        };
        let stopped = client.stop_and_meet().map_err(Error::of_a_stop)?;
        Ok((client, stopped))
    }

    fn stop_and_meet(&mut self) -> Result<Stopped, Error> {
        if self.personality() == Personality::Pms5005 {
            self.stop_unheard()?;
        }
        self.meet()?;
        self.stop()
    }

    /// Finds out what is at the other end of an open transport. The link is for messages.
    ///
    /// # Errors
    /// [`Error::NoBoard`], [`Error::Gone`].
    pub fn over(
        link: Link,
        transport: Box<dyn Transport>,
        session: Session,
    ) -> Result<Self, Error> {
        let mut client = Self::new(link, transport, session);
        client.find_out()?;
        client.meet()?;
        Ok(client)
    }

    pub(crate) fn new(link: Link, transport: Box<dyn Transport>, session: Session) -> Self {
        Self {
            link,
            transport,
            session,
            clock: Instant::now(),
            heard: Duration::ZERO,
            identity: None,
            arm: None,
            state: None,
            end: None,
        }
    }

    /// Asks who it is, now that it is known what.
    pub(crate) fn meet(&mut self) -> Result<(), Error> {
        match self.personality() {
            Personality::Pms5005 => self.identity = self.asked_who()?,
            Personality::Arcos => {
                self.open_arm()?;
                self.identity = self.asked_who()?;
            }
            Personality::Cm5 => {}
        }
        Ok(())
    }

    /// What becomes true when the user wants an end, as by Ctrl-C: no [drive](Self::drive) waits on then.
    pub fn end_when(&mut self, wanted: Arc<AtomicBool>) {
        self.end = Some(wanted);
    }

    fn is_to_end(&self) -> bool {
        self.end.as_ref().is_some_and(|wanted| wanted.load(Ordering::Relaxed))
    }

    /// The link it is at.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// What it is.
    pub fn personality(&self) -> Personality {
        self.session.personality().unwrap_or(Personality::Pms5005)
    }

    /// Who it is; `None` for an original, or a firmware that knows no extension.
    pub fn identity(&self) -> Option<Identity> {
        self.identity
    }

    /// Whether it tells its machine state: since version 2 of the extension, and on lines of 16,000 baud
    /// or more.
    pub fn has_state(&self) -> bool {
        let is_new = self.identity.is_some_and(|identity| identity.extension >= 2);
        is_new && self.personality() == Personality::Pms5005 && !self.link.is_slow()
    }

    /// How it is.
    ///
    /// # Errors
    /// As all requests: [`Error::NoAnswer`], [`Error::Refused`], [`Error::NotCarried`], [`Error::Gone`].
    pub fn health(&mut self) -> Result<Health, Error> {
        let once = protocol::pms5005::Repeat::Times(std::num::NonZeroU8::MIN);
        match self.ask(&Request::Health(once), "its health")? {
            Reply::Health(health) => Ok(health),
            _ => Err(Error::NoAnswer("its health")),
        }
    }

    /// What it has counted.
    ///
    /// # Errors
    /// As all requests.
    pub fn counters(&mut self) -> Result<Counters, Error> {
        match self.ask(&Request::Counters, "its counters")? {
            Reply::Counters(counters) => Ok(counters),
            _ => Err(Error::NoAnswer("its counters")),
        }
    }

    /// What it has refused, by reason; since version 2 of the extension.
    ///
    /// # Errors
    /// As all requests.
    pub fn refusals(&mut self) -> Result<Refusals, Error> {
        match self.ask(&Request::Refusals, "what it refused")? {
            Reply::Refusals(refusals) => Ok(refusals),
            _ => Err(Error::NoAnswer("what it refused")),
        }
    }

    /// The faults on record, 16 at the most.
    ///
    /// # Errors
    /// As all requests.
    pub fn faults(&mut self) -> Result<Vec<FaultRecord>, Error> {
        let mut faults = Vec::new();
        for place in 0..u8::MAX {
            match self.ask(&Request::Fault(place), "its faults")? {
                Reply::Fault(latched) => match latched.record {
                    Some(record) => faults.push(record),
                    None => break,
                },
                _ => return Err(Error::NoAnswer("its faults")),
            }
        }
        Ok(faults)
    }

    /// Clears the latched faults, but for those of the board whose cause is still there. Moves nothing.
    ///
    /// # Errors
    /// As all requests.
    pub fn clear_faults(&mut self) -> Result<(), Error> {
        self.act(Action::ClearFaults, "a clearing of its faults")
    }

    /// Restarts it in its ROM's loader.
    ///
    /// # Errors
    /// As all requests.
    pub fn reboot_into_dfu(&mut self) -> Result<(), Error> {
        self.act(Action::RebootIntoDfu, "its loader")
    }

    /// The machine state of this moment, `None` from a board that does not tell it.
    ///
    /// # Errors
    /// As all requests.
    pub fn state(&mut self) -> Result<Option<MachineState>, Error> {
        if !self.has_state() {
            return Ok(None);
        }
        let once = protocol::pms5005::Repeat::Times(std::num::NonZeroU8::MIN);
        match self.ask(&Request::State(once), "its machine state")? {
            Reply::State(state) => Ok(Some(state)),
            _ => Err(Error::NoAnswer("its machine state")),
        }
    }

    fn act(&mut self, action: Action, what: &'static str) -> Result<(), Error> {
        self.ask(&Request::Do(action), what).map(drop)
    }

    /// Sends a request and waits for what comes of it.
    fn ask(&mut self, request: &Request<'_>, what: &'static str) -> Result<Reply, Error> {
        if self.personality() == Personality::Cm5 {
            let instead = "; it carries `info` and `watch`";
            return Err(Error::NotCarried(Personality::Cm5, "answers to such questions", instead));
        }
        let begun = self.session.ask(request, self.now());
        begun.map_err(|failure| self.failed(failure, what))?;
        self.wait(what)
    }

    /// Sends a command and waits until it is acknowledged.
    fn command(&mut self, command: &Command<'_>, what: &'static str) -> Result<(), Error> {
        self.needs_a_pms5005(what)?;
        let begun = self.session.command(command, self.now());
        begun.map_err(|failure| self.failed(failure, what))?;
        self.wait(what).map(drop)
    }

    /// The same, but waits no longer when the user wants an end.
    fn command_unless_it_is_to_end(
        &mut self,
        command: &Command<'_>,
        what: &'static str,
    ) -> Result<(), Error> {
        let begun = self.session.command(command, self.now());
        begun.map_err(|failure| self.failed(failure, what))?;
        self.wait_while(what, |client| !client.is_to_end()).map(drop)
    }

    fn needs_a_pms5005(&self, what: &'static str) -> Result<(), Error> {
        match self.personality() {
            Personality::Pms5005 => Ok(()),
            other => {
                let instead = match other {
                    Personality::Cm5 => "; it carries `info` and `watch`",
                    _ => "; it carries `info`, `watch`, `stop`, faults and settings",
                };
                Err(Error::NotCarried(other, what, instead))
            }
        }
    }

    fn failed(&self, failure: Failure, what: &'static str) -> Error {
        Error::of(failure, self.personality(), what)
    }

    /// Waits for what comes of the exchange under way.
    fn wait(&mut self, what: &'static str) -> Result<Reply, Error> {
        self.wait_while(what, |_| true)?.ok_or(Error::NoAnswer(what))
    }

    /// The same for as long as `go_on` says; then `None`.
    fn wait_while(
        &mut self,
        what: &'static str,
        go_on: impl Fn(&Self) -> bool,
    ) -> Result<Option<Reply>, Error> {
        while go_on(self) {
            while let Some(event) = self.session.take_event() {
                match event {
                    Event::Answered(reply) => return Ok(Some(reply)),
                    Event::Failed(failure) => return Err(self.failed(failure, what)),
                    other => self.note(&other),
                }
            }
            self.pump(TICK)?;
        }
        Ok(None)
    }

    fn note(&mut self, event: &Event) {
        if let Event::State(state) = event {
            self.state = Some(*state);
        }
    }

    fn silent(&self) -> Error {
        let silent = std::io::Error::other("the board says nothing any more");
        Error::Gone(self.link.to_string(), silent)
    }

    /// Time since the connection was made.
    fn now(&self) -> Duration {
        self.clock.elapsed()
    }

    /// Writes what is to be written, and reads what has come.
    fn pump(&mut self, patience: Duration) -> Result<(), Error> {
        let gone = |link: &Link, error| Error::Gone(link.to_string(), error);
        self.session.advance(self.clock.elapsed());
        while let Some(frame) = self.session.take_output() {
            self.transport.write(&frame).map_err(|error| gone(&self.link, error))?;
        }
        let mut buffer = [0; 1024];
        let count = self.transport.read(&mut buffer, patience);
        let count = count.map_err(|error| gone(&self.link, error))?;
        if count > 0 {
            self.heard = self.now();
            self.session.receive(buffer.get(..count).unwrap_or_default());
        }
        Ok(())
    }

    /// Listens until it is known what is there.
    pub(crate) fn find_out(&mut self) -> Result<Personality, Error> {
        let mut greeting = Greeting::new(matches!(self.link, Link::Udp(_)), self.now());
        let end = self.now() + HEAR;
        loop {
            if let Some(personality) = self.session.personality() {
                return Ok(personality);
            }
            if self.now() >= end {
                return Err(Error::nobody(&self.link, self.session.received()));
            }
            if let Some(said) = greeting.say(self.now()) {
                let written = self.transport.write(&said);
                written.map_err(|error| Error::Gone(self.link.to_string(), error))?;
            }
            self.pump(TICK)?;
        }
    }

    /// `None` where there is no extension: the board refuses the question, or says other things and speaks on
    /// when the time for an answer is over.
    fn asked_who(&mut self) -> Result<Option<Identity>, Error> {
        match self.ask(&Request::Identity, "who it is") {
            Ok(Reply::Identity(identity)) => Ok(Some(identity)),
            Err(Error::NoAnswer(_)) => {
                let (frames, end) = (self.session.frames(), self.now() + PING);
                while self.session.frames() == frames {
                    if self.now() >= end {
                        return Err(self.silent());
                    }
                    self.pump(TICK)?;
                }
                Ok(None)
            }
            Err(gone @ Error::Gone(..)) => Err(gone),
            _ => Ok(None),
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.close_arm();
    }
}

/// The channels that somebody drives at this moment, and who is not silent.
pub fn driven(state: &MachineState) -> Vec<Number> {
    let is_silent = state.flags & flag::LINK_LOST != 0;
    let drives = |number: &Number| on(state)[number.index()];
    if is_silent { Vec::new() } else { Number::all().filter(drives).collect() }
}
