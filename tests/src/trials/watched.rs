//! A session that is listened to: all that it asks of its board, in order. So a trial knows what the
//! controller was told, on a board whose tasks are those of every other.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use embassy_time::Instant;
use firmware::command::Command;
use firmware::controller::Snapshot;
use firmware::personality::{Boot, Effect, MAX_FRAME, Session, Upkeep, UpkeepRefused, View};
use firmware::settings::{ControlSettings, Settings};

/// What has come of a session.
pub enum Event {
    /// The board has started then, with these settings.
    Started(Box<Settings>, Boot, Instant),
    /// The controller is to do something.
    Asked(Command),
    /// The controller is to go by these settings.
    Adopted(Box<ControlSettings>),
    /// Settings are to be saved.
    Saving(Box<Settings>),
    /// A program is to be started.
    Starting,
    /// What came of either.
    Done(Result<(), UpkeepRefused>),
}

/// A list of them, which a trial empties.
pub type Log = Rc<RefCell<VecDeque<Event>>>;

/// A session, and where it is written down what it asks.
pub struct Watched<S> {
    session: S,
    log: Log,
}

impl<S: Session> Watched<S> {
    /// A board's session that has just been made.
    pub fn new(session: S, boot: Boot, now: Instant, log: &Log) -> Self {
        let settings = Box::new(*session.settings());
        log.borrow_mut().push_back(Event::Started(settings, boot, now));
        Self { session, log: log.clone() }
    }

    fn note(&self, effect: Option<Effect>) -> Option<Effect> {
        let event = match effect? {
            Effect::Control(Command::Adopt) => {
                Event::Adopted(Box::new(self.session.settings().control))
            }
            Effect::Control(command) => Event::Asked(command),
            Effect::Upkeep(Upkeep::Save) => Event::Saving(Box::new(*self.session.to_save())),
            Effect::Upkeep(Upkeep::Start(_)) => Event::Starting,
            Effect::Show(_) | Effect::Record(_) => return effect,
        };
        self.log.borrow_mut().push_back(event);
        effect
    }
}

impl<S: Session> Session for Watched<S> {
    type Counters = S::Counters;

    fn receive(&mut self, bytes: &mut &[u8], now: Instant) -> Option<Effect> {
        let effect = self.session.receive(bytes, now);
        self.note(effect)
    }

    fn settings(&self) -> &Settings {
        self.session.settings()
    }

    fn to_save(&self) -> &Settings {
        self.session.to_save()
    }

    fn advance(&mut self, now: Instant, snapshot: impl FnOnce() -> Snapshot) -> Option<Effect> {
        let effect = self.session.advance(now, snapshot);
        self.note(effect)
    }

    fn wakes_at(&self) -> Option<Instant> {
        self.session.wakes_at()
    }

    fn transmit<'b>(
        &mut self,
        now: Instant,
        board: &impl View,
        out: &'b mut [u8; MAX_FRAME],
    ) -> Option<&'b [u8]> {
        self.session.transmit(now, board, out)
    }

    fn sends_at(&self) -> Instant {
        self.session.sends_at()
    }

    fn line_failed(&mut self) {
        self.session.line_failed();
    }

    fn upkeep_done(&mut self, result: Result<(), UpkeepRefused>) -> Option<Effect> {
        self.log.borrow_mut().push_back(Event::Done(result));
        let effect = self.session.upkeep_done(result);
        self.note(effect)
    }

    fn picture_dropped(&mut self) {
        self.session.picture_dropped();
    }

    fn counters(&self) -> S::Counters {
        self.session.counters()
    }

    fn signs_of_life(&self) -> u32 {
        self.session.signs_of_life()
    }
}
