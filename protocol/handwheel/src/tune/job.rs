//! A procedure as a session without I/O, for whoever has a line and a clock: a program that waits, a page, a
//! test on virtual time.

use std::num::NonZeroU8;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};
use std::time::Duration;

use protocol::extension::{Assignments, Block, MachineState, Request};
use protocol::pms5005::{Command, Data, Repeat};

use crate::error::Error;
use crate::session::{Event, Failure, Personality, Reply, Session};

/// Something to be asked of the board; one at a time.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask {
    /// A request of the extension.
    Request(Request<'static>),
    /// To set settings, all or none: their numbers and values.
    Set(Vec<(u16, i32)>),
    /// A command, to be acknowledged.
    Command(Command<'static>),
}

impl Ask {
    /// Has a session ask it.
    ///
    /// # Errors
    /// [`Failure::NotCarried`].
    pub fn begin(&self, session: &mut Session, now: Duration) -> Result<(), Failure> {
        match self {
            Self::Request(request) => session.ask(request, now),
            Self::Command(command) => session.command(command, now),
            Self::Set(values) => {
                let mut data = Data::new();
                for &(number, value) in values {
                    Assignments::emit(number, value, &mut data).map_err(|_| Failure::NotCarried)?;
                }
                let assignments = Assignments::parse(&data).map_err(|_| Failure::NotCarried)?;
                session.ask(&Request::Set(assignments), now)
            }
        }
    }
}

/// Why nothing was found, or nothing was changed. The motor is off, and the settings are as they were.
#[derive(Clone, Debug, PartialEq)]
pub enum Refused {
    /// Neither counts nor a current: not connected, not supplied, or not enabled.
    Dead,
    /// A current, and no counts.
    Stuck,
    /// Counts go against the duty.
    WrongWay,
    /// What was recorded is no motor's: the fit in percent.
    PoorFit(f64),
    /// Nothing was seen that a motor could be found in.
    NoMotion,
    /// A joint stands too near to an end of its travel: where, and between what it may be.
    NoRoom(i32, i32, i32),
    /// A joint's velocity loop would run it into its end.
    NotAJoint,
    /// No loop would be steady.
    NoLoop,
    /// The step was not what was predicted: in words.
    Unconfirmed(String),
    /// Stopped before its end, and why.
    Stopped(String),
    /// The board refused something, or did not answer.
    Line(String),
}

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Dead => f.write_str(
                "neither counts nor a current: check the motor's wires, its supply and the driver's enable line",
            ),
            Self::Stuck => f.write_str(
                "a current flows and nothing is counted: check whether the shaft is free, not at an end of its travel, and the sensor connected",
            ),
            Self::WrongWay => f.write_str(
                "the counts fall when they should rise: swap the motor's wires, or `handwheel check N --set-polarity`",
            ),
            Self::PoorFit(percent) => write!(
                f,
                "what was recorded is no motor's with a load (fit {percent:.0} %): check for slipping, play, a loose encoder; or allow more duty"
            ),
            Self::NoMotion => f.write_str(
                "it hardly moves at this duty: allow more with `--highest-duty`, or check what holds it",
            ),
            Self::NoRoom(at, low, high) => write!(
                f,
                "it stands at {at}, too near to an end of its travel, {low} to {high}: move it to the middle first"
            ),
            Self::NotAJoint => f.write_str(
                "a joint's velocity loop is not tuned, as its step would run it into an end: tune its position",
            ),
            Self::NoLoop => f.write_str(
                "no loop would be steady: the sensor has too few counts for such a motor, or the duty is too low",
            ),
            Self::Unconfirmed(why) => write!(f, "the step was not as predicted ({why}): nothing was changed"),
            Self::Stopped(why) | Self::Line(why) => f.write_str(why),
        }
    }
}

impl std::error::Error for Refused {}

/// What a job and its procedure share.
#[derive(Default)]
pub(super) struct Shared {
    pub(super) now: Duration,
    /// What is to be asked, and what came of it.
    pub(super) ask: Option<Ask>,
    pub(super) reply: Option<Result<Reply, Failure>>,
    /// The newest machine state, and how many there were.
    pub(super) state: Option<MachineState>,
    pub(super) states: u64,
    /// Blocks of a recording that nobody has taken yet.
    pub(super) blocks: Vec<Block>,
    /// Why it is to end.
    pub(super) stop: Option<String>,
    pub(super) is_driving: bool,
    /// How often signs of life are sent while it drives.
    pub(super) life: Duration,
    /// Machine states are waited for.
    pub(super) watches: bool,
    /// What it is about, for people.
    pub(super) doing: &'static str,
}

/// The shared part, for as long as one side looks at it.
pub(super) fn look(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

type Procedure<T> = Pin<Box<dyn Future<Output = Result<T, Refused>> + Send>>;

/// A procedure under way: a session without I/O, for whoever has a line and a clock.
pub struct Job<T> {
    shared: Arc<Mutex<Shared>>,
    procedure: Option<Procedure<T>>,
    outcome: Option<Result<T, Refused>>,
    /// When machine states are asked for anew, if nobody else does.
    renew: Duration,
    life: Option<Duration>,
}

/// So many machine states are asked for at once, and so often: when nobody looks at them any more, the line is
/// soon free for a recording.
const STATES: NonZeroU8 = NonZeroU8::new(30).unwrap();
const RENEW: Duration = Duration::from_millis(400);

impl<T> Job<T> {
    pub(super) fn new<P>(procedure: impl FnOnce(Arc<Mutex<Shared>>) -> P) -> Self
    where
        P: Future<Output = Result<T, Refused>> + Send + 'static,
    {
        let shared = Arc::<Mutex<Shared>>::default();
        let procedure: Procedure<T> = Box::pin(procedure(shared.clone()));
        let procedure = Some(procedure);
        Self { shared, procedure, outcome: None, renew: Duration::ZERO, life: None }
    }

    /// Goes on at this time as far as it can. What is returned is to be asked of the board, and what comes of
    /// it to be [told](Self::answer).
    pub fn advance(&mut self, now: Duration) -> Option<Ask> {
        look(&self.shared).now = now;
        if let Some(procedure) = &mut self.procedure {
            let mut context = Context::from_waker(Waker::noop());
            if let Poll::Ready(outcome) = procedure.as_mut().poll(&mut context) {
                (self.procedure, self.outcome) = (None, Some(outcome));
            }
        }
        look(&self.shared).ask.take()
    }

    /// What came of what was asked.
    pub fn answer(&mut self, result: Result<Reply, Failure>) {
        look(&self.shared).reply = Some(result);
    }

    /// Takes what the board tells: machine states and blocks of the recording count.
    pub fn see(&mut self, event: &Event) {
        let mut shared = look(&self.shared);
        match event {
            Event::State(state) => {
                shared.state = Some(*state);
                shared.states += 1;
            }
            Event::Block(block) => shared.blocks.push(*block),
            _ => {}
        }
    }

    /// Ends it in good order: the motor is switched off, and what was set is set back.
    pub fn stop(&mut self, why: &str) {
        look(&self.shared).stop.get_or_insert_with(|| why.to_owned());
    }

    /// Whether it drives, and signs of life are to be sent.
    pub fn is_driving(&self) -> bool {
        look(&self.shared).is_driving
    }

    /// Whether it waits for machine states.
    pub fn watches(&self) -> bool {
        look(&self.shared).watches
    }

    /// What asks for machine states, when that is due: send it, without waiting for an answer.
    pub fn renewal(&mut self, now: Duration) -> Option<Command<'static>> {
        if !self.watches() || now < self.renew {
            return None;
        }
        self.renew = now + RENEW;
        Some(Command::Extension(Request::State(Repeat::Times(STATES))))
    }

    /// The same job with another kind of outcome. To be called before it begins.
    pub fn map<U>(self, change: impl FnOnce(T) -> U + Send + 'static) -> Job<U>
    where
        T: Send + 'static,
    {
        let Self { shared, procedure, outcome, renew, life } = self;
        let procedure: Procedure<U> = Box::pin(async move {
            let outcome = match procedure {
                Some(procedure) => Some(procedure.await),
                None => outcome,
            };
            outcome.unwrap_or_else(|| Err(Refused::Stopped("it is over".into()))).map(change)
        });
        Job { shared, procedure: Some(procedure), outcome: None, renew, life }
    }

    /// What it is about, for people.
    pub fn doing(&self) -> &'static str {
        look(&self.shared).doing
    }

    /// Whether it is over.
    pub fn is_over(&self) -> bool {
        self.procedure.is_none()
    }

    /// What came of it, once it is over.
    pub fn outcome(&mut self) -> Option<Result<T, Refused>> {
        self.outcome.take()
    }

    /// Goes on over a session that nobody else uses meanwhile. Call it whenever bytes were received, and every
    /// 10 ms at the least; then write what the session has to say.
    pub fn converse(&mut self, session: &mut Session, now: Duration) {
        look(&self.shared).now = now;
        session.advance(now);
        while let Some(event) = session.take_event() {
            match event {
                Event::Answered(reply) => self.answer(Ok(reply)),
                Event::Failed(failure) => self.answer(Err(failure)),
                event => self.see(&event),
            }
        }
        if let Some(command) = self.renewal(now) {
            session.send(&command);
        }
        if let Some(ask) = self.advance(now)
            && let Err(failure) = ask.begin(session, now)
        {
            self.answer(Err(failure));
        }
        let life = self.is_driving().then_some(look(&self.shared).life);
        if life != self.life {
            self.life = life;
            session.drive(life, now);
        }
    }
}

/// What came of a procedure, and of setting everything back behind it.
pub(super) fn set_back<T>(
    found: Result<T, Refused>,
    back: Result<(), Refused>,
) -> Result<T, Refused> {
    match (found, back) {
        (found, Ok(())) => found,
        (Ok(_), Err(why)) => Err(Refused::Line(format!("{why}; {LEFT}"))),
        (Err(refused), Err(why)) => Err(Refused::Line(format!("{refused}; {why}; {LEFT}"))),
    }
}

/// What is to be done when it was not.
pub(crate) const LEFT: &str = "its settings were not set back: restart the board, or restore them";

/// In words, what a board refused.
pub(super) fn refusal(failure: Failure, what: &'static str) -> Refused {
    Refused::Line(Error::of(failure, Personality::Pms5005, what).to_string())
}
