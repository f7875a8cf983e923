//! Something sent that wants an answer: which answer is its own, how long it waits, what becomes of it.

use std::time::Duration;

use protocol::arcos;
use protocol::extension::{
    Action, Answer, Counters, Description, Health, Identity, Latched, MachineState, Recording,
    Refusals, Request, Unit, Verdict,
};
use protocol::pms5005::{Command, Frame, MAX_FRAME, RES_NO_ACK};

use super::Personality;

/// How long an answer may take before the question is sent again, and how often it is sent. A frame of
/// the machine state takes 70 ms at 19200 baud, and up to eight answers may stand before it.
const PATIENCE: Duration = Duration::from_millis(500);
const TRIES: u8 = 4;
/// The first question: an original never answers it, and its host is not to wait for long.
const TRIES_TO_MEET: u8 = 2;
/// The flash of a board takes up to 3 s for a save.
const LONG_PATIENCE: Duration = Duration::from_secs(5);
/// How long a board may be busy with something else.
const BUSY: Duration = Duration::from_millis(100);

/// A setting, told in full.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Its number on the wire.
    pub number: u16,
    /// The next one's number, `None` behind the last.
    pub next: Option<u16>,
    /// Its name, a channel's or a joint's number (1 to 6) behind it.
    pub name: String,
    /// Its value.
    pub value: i32,
    /// Its lowest and its highest value.
    pub range: (i32, i32),
    /// Its value until somebody says otherwise.
    pub default: i32,
    /// What the values count.
    pub unit: Unit,
}

impl From<&Description<'_>> for Setting {
    fn from(told: &Description<'_>) -> Self {
        Self {
            number: told.number,
            next: told.next,
            name: told.to_string(),
            value: told.value,
            range: told.range,
            default: told.default,
            unit: told.unit,
        }
    }
}

/// What a block of a recording takes at 19200 baud.
const BLOCK_TIME: Duration = Duration::from_millis(70);

/// What came of an exchange.
#[derive(Clone, Debug, PartialEq)]
#[expect(missing_docs, reason = "the types say it")]
pub enum Reply {
    /// Done, or acknowledged.
    Done,
    Setting(Setting),
    Identity(Identity),
    Health(Health),
    Counters(Counters),
    Fault(Latched),
    State(MachineState),
    Refusals(Refusals),
    Recording(Recording),
    /// A packet of ARCOS: its id and its data.
    Packet(u8, Vec<u8>),
}

/// Why an exchange came to nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// No answer, however often it was sent.
    NoAnswer,
    /// The board refuses, and of which setting; 0 is none.
    Refused(Verdict, u16),
    /// It has no form on this line.
    NotCarried,
}

/// Which answer an exchange waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wants {
    Acknowledgement,
    /// An answer with this DID; of a setting, a fault or a block, about this one.
    Answer(u8, Option<u16>),
    /// The outcome of a request with this DID and first byte.
    Outcome(u8, u8),
    /// A packet of ARCOS.
    Packet(u8),
}

pub(super) struct Exchange {
    bytes: Vec<u8>,
    pub(super) wants: Wants,
    /// The DID and the first byte that an outcome would name.
    asked: (u8, u8),
    /// How often it may still be sent, and how long each time waits.
    tries: u8,
    patience: Duration,
    /// When the answer is overdue; `None` until it was sent.
    deadline: Option<Duration>,
    /// The board was busy: send it again soon, without taking that for a try.
    busy: bool,
}

impl Exchange {
    pub(super) fn new(bytes: Vec<u8>, wants: Wants) -> Self {
        Self {
            bytes,
            wants,
            asked: (0, 0),
            tries: TRIES,
            patience: PATIENCE,
            deadline: None,
            busy: false,
        }
    }

    /// A request of the extension.
    pub(super) fn of_request(
        request: &Request<'_>,
        personality: Personality,
    ) -> Result<Self, Failure> {
        let mut buffer = [0; MAX_FRAME];
        let frame = Command::Extension(*request).encode(RES_NO_ACK, &mut buffer);
        let frame = frame.map_err(|_| Failure::NotCarried)?.to_vec();
        let parsed = Frame::parse(&frame).ok_or(Failure::NotCarried)?;
        let asked = (parsed.did, parsed.data.first().copied().unwrap_or(0));
        let wants = match *request {
            Request::Set(_) | Request::Do(_) | Request::SetCount { .. } => {
                Wants::Outcome(asked.0, asked.1)
            }
            Request::Setting(number) => {
                Wants::Answer(asked.0, Some(number).filter(|&number| number != 0))
            }
            Request::Fault(place) => Wants::Answer(asked.0, Some(place.into())),
            // The last of them, behind which none will come.
            Request::Blocks { first, count } => {
                Wants::Answer(asked.0, Some(first.wrapping_add(count).wrapping_sub(1)))
            }
            _ => Wants::Answer(asked.0, None),
        };
        let bytes = match personality {
            Personality::Pms5005 => frame,
            Personality::Arcos => arcos::extension::encode_request(request, &mut buffer)
                .map_err(|_| Failure::NotCarried)?
                .to_vec(),
            Personality::Cm5 => return Err(Failure::NotCarried),
        };
        let mut exchange = Self { asked, ..Self::new(bytes, wants) };
        if *request == Request::Identity {
            exchange.tries = TRIES_TO_MEET;
        }
        if let Request::Blocks { count, .. } = request {
            exchange.patience += BLOCK_TIME * u32::from(*count);
        }
        if let Request::Do(action) = request
            && *action != Action::ClearFaults
        {
            exchange.patience = LONG_PATIENCE;
            // Once may have been enough, and twice would be another.
            let restarts = matches!(action, Action::Reboot | Action::RebootIntoDfu);
            exchange.tries = if restarts { 1 } else { 2 };
        }
        Ok(exchange)
    }

    /// What is to be sent now, if anything.
    pub(super) fn advance(&mut self, now: Duration) -> Option<Result<Vec<u8>, Failure>> {
        match self.deadline {
            Some(deadline) if now < deadline => return None,
            Some(_) if self.tries == 0 => return Some(Err(Failure::NoAnswer)),
            _ => {}
        }
        if self.busy && self.deadline.is_none() {
            // Whoever keeps it busy gets a moment.
            self.busy = false;
            self.deadline = Some(now + BUSY);
            return None;
        }
        self.tries -= 1;
        self.deadline = Some(now + self.patience);
        Some(Ok(self.bytes.clone()))
    }

    /// What an answer means for it; `None` if it is another's.
    pub(super) fn judge(&mut self, answer: &Answer<'_>) -> Option<Result<Reply, Failure>> {
        if let Answer::Outcome(outcome) = answer {
            if (outcome.did, outcome.first) != self.asked
                || matches!(self.wants, Wants::Acknowledgement | Wants::Packet(_))
            {
                return None;
            }
            return match outcome.verdict {
                Verdict::Done => Some(Ok(Reply::Done)),
                Verdict::Busy if self.tries > 0 => {
                    (self.busy, self.deadline) = (true, None);
                    None
                }
                verdict => Some(Err(Failure::Refused(verdict, outcome.setting))),
            };
        }
        let about = match answer {
            Answer::Setting(setting) => Some(setting.number),
            Answer::Fault(latched) => Some(latched.place.into()),
            Answer::Block(block) => Some(block.number),
            _ => None,
        };
        let is_it = match self.wants {
            Wants::Answer(did, None) => did == answer.did(),
            Wants::Answer(did, asked) => did == answer.did() && asked == about,
            _ => false,
        };
        is_it.then(|| {
            Ok(match answer {
                Answer::Setting(setting) => Reply::Setting(setting.into()),
                Answer::Identity(identity) => Reply::Identity(*identity),
                Answer::Health(health) => Reply::Health(*health),
                Answer::Counters(counters) => Reply::Counters(*counters),
                Answer::Fault(latched) => Reply::Fault(*latched),
                Answer::State(state) => Reply::State(*state),
                Answer::Refusals(refusals) => Reply::Refusals(*refusals),
                Answer::Recording(recording) => Reply::Recording(*recording),
                Answer::Outcome(_) | Answer::Block(_) => Reply::Done,
            })
        })
    }
}
