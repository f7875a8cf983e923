//! Who is on the bus: the search at boot, and the watch for newcomers afterwards.
//!
//! An ID is *asked* with PINGs. It has a servo when two of them were answered, so that noise which
//! happens to look like an answer invents none; it has none when more of them than allowed stayed
//! without answer.
//!
//! The search asks every ID from 1 to 253. The watch asks one of the IDs without a servo at a time,
//! spread over [`WATCH_PERIOD`], between two requests of the loop of work.

use core::ops::RangeInclusive;

use embassy_time::{Duration, Instant};
use protocol::dynamixel::Id;

/// The IDs that the search asks (page, "The Servo Search").
const IDS: RangeInclusive<u8> = 1..=253;
/// All IDs without a servo are asked once in this time, so that a new one is found within 5 s. One
/// PING takes 0.69 ms (60 us, and [`Patience::Brief`](super::exchange::Patience::Brief)): 3.5 % of
/// the bus.
const WATCH_PERIOD: Duration = Duration::from_millis(4800);
/// After an answer the search listens for more, so that a second one (two servos with one ID, or a
/// servo that stutters) does not fall into the next request.
const AFTER_ANSWER: Duration = Duration::from_micros(300);

/// What asking one ID has brought so far.
#[derive(Clone, Copy)]
struct Inquiry {
    id: u8,
    answers: u8,
    silences: u8,
}

impl Inquiry {
    const fn new(id: u8) -> Self {
        Self { id, answers: 0, silences: 0 }
    }

    /// Whether there is a servo, when that is known.
    fn conclude(&mut self, answered: bool, retries: u8) -> Option<bool> {
        let tally = if answered { &mut self.answers } else { &mut self.silences };
        *tally = tally.saturating_add(1);
        match (self.answers, self.silences) {
            (2.., _) => Some(true),
            (_, silences) if silences > retries => Some(false),
            _ => None,
        }
    }
}

/// The search at boot.
pub struct Search {
    inquiry: Inquiry,
    from: Instant,
    retries: u8,
}

impl Search {
    pub fn new(retries: u8, now: Instant) -> Self {
        Self { inquiry: Inquiry::new(*IDS.start()), from: now, retries }
    }

    /// When the next PING may go out.
    pub fn from(&self) -> Instant {
        self.from
    }

    /// Whom to ask next; `None` when all have been asked.
    pub fn next(&self) -> Option<Id> {
        Id::new(self.inquiry.id).filter(|id| IDS.contains(&id.number()))
    }

    /// Takes what came of the last PING. Answers a servo that was found.
    pub fn conclude(&mut self, answered: bool, now: Instant) -> Option<Id> {
        let id = self.next();
        if answered {
            self.from = now + AFTER_ANSWER;
        }
        let found = self.inquiry.conclude(answered, self.retries)?;
        self.inquiry = Inquiry::new(self.inquiry.id.saturating_add(1));
        id.filter(|_| found)
    }
}

/// The watch for newcomers.
pub struct Watch {
    inquiry: Inquiry,
    due: Instant,
    retries: u8,
}

impl Watch {
    pub fn new(retries: u8, now: Instant) -> Self {
        Self { inquiry: Inquiry::new(*IDS.start()), due: now, retries }
    }

    /// When the next PING is due.
    pub fn due(&self) -> Instant {
        self.due
    }

    /// Whom to ask: the ID in question, or the next one that is not `known`; `None` if all are.
    pub fn next(&mut self, known: impl Fn(Id) -> bool) -> Option<Id> {
        let first = self.inquiry.id;
        let id = (first..=*IDS.end())
            .chain(*IDS.start()..first)
            .filter_map(Id::new)
            .find(|id| !known(*id))?;
        if id.number() != first {
            self.inquiry = Inquiry::new(id.number());
        }
        Some(id)
    }

    /// Takes what came of the last PING; `known` servos are not asked. Answers one that was found.
    ///
    /// Silence is believed at once, unless the ID has answered before: it will be asked again.
    pub fn conclude(&mut self, answered: bool, known: usize, now: Instant) -> Option<Id> {
        let id = Id::new(self.inquiry.id);
        let retries = if self.inquiry.answers > 0 { self.retries } else { 0 };
        let Some(found) = self.inquiry.conclude(answered, retries) else {
            return None; // asked again at once
        };
        let next = if self.inquiry.id < *IDS.end() { self.inquiry.id + 1 } else { *IDS.start() };
        self.inquiry = Inquiry::new(next);
        let unknown = IDS.len().saturating_sub(known).max(1) as u32; // 253 at the most
        // A bus that was busy for long is not flooded afterwards.
        self.due = (self.due + WATCH_PERIOD / unknown).max(now);
        id.filter(|_| found)
    }
}
