//! Who is on the bus: the search at boot, and the watch for newcomers afterwards.
//!
//! An ID is *asked* with PINGs. It has a servo when two of them were answered, so that noise which
//! happens to look like an answer invents none; it has none when more of them than allowed stayed
//! without answer.
//!
//! The search asks every ID from 1 to 253. The watch asks one of the IDs without a servo at a time,
//! spread over [`WATCH_PERIOD`], between two instructions of the loop of work.

use core::ops::RangeInclusive;

use embassy_time::{Duration, Instant};
use protocol::dynamixel::Id;

/// The IDs that the search asks (page, "The Servo Search").
const IDS: RangeInclusive<u8> = 1..=253;
/// All IDs without a servo are asked once in this time, so that a new one is found within 5 s. One
/// PING takes 0.69 ms (60 us, and [`BRIEF_PATIENCE`](super::exchange::BRIEF_PATIENCE)): 3.5 % of
/// the bus.
const WATCH_PERIOD: Duration = Duration::from_millis(4800);
/// After an answer the search listens for more, so that a second one (two servos with one ID, or a
/// servo that stutters) does not fall into the next instruction.
const AFTER_ANSWER: Duration = Duration::from_micros(300);

/// The search at boot, and the watch that it becomes.
pub struct Search {
    pub is_watch: bool,
    /// Whom to ask; behind the last one when the search is over.
    id: u8,
    /// What asking has brought so far.
    answers: u8,
    silences: u8,
    /// When the next PING may go out.
    pub due: Instant,
    retries: u8,
}

impl Search {
    pub fn new(retries: u8, now: Instant) -> Self {
        Self { is_watch: false, id: *IDS.start(), answers: 0, silences: 0, due: now, retries }
    }

    /// Becomes the watch if all have been asked; `true` when it does.
    pub fn ends(&mut self) -> bool {
        let ends = !self.is_watch && !IDS.contains(&self.id);
        if ends {
            self.is_watch = true;
            self.id = *IDS.start();
            self.due = Instant::MIN;
        }
        ends
    }

    /// Whom to ask: the ID in question, or the next one that is not `known`; `None` if all are.
    pub fn next(&mut self, known: impl Fn(Id) -> bool) -> Option<Id> {
        let mut ids = (self.id..=*IDS.end()).chain(*IDS.start()..self.id).filter_map(Id::new);
        let id = ids.find(|id| !known(*id))?;
        if id.number() != self.id {
            self.go_on_with(id.number());
        }
        Some(id)
    }

    /// Takes what came of the last PING; `known` servos are not asked. Answers one that was found.
    ///
    /// The watch believes silence at once, unless the ID has answered before: it will be asked
    /// again.
    pub fn conclude(&mut self, answered: bool, known: usize, now: Instant) -> Option<Id> {
        let tally = if answered { &mut self.answers } else { &mut self.silences };
        *tally = tally.saturating_add(1);
        if answered && !self.is_watch {
            self.due = now.saturating_add(AFTER_ANSWER);
        }
        let retries = if self.is_watch && self.answers == 0 { 0 } else { self.retries };
        let found = self.answers >= 2;
        if !found && self.silences <= retries {
            return None; // asked again
        }
        let id = Id::new(self.id).filter(|_| found);
        self.go_on_with(self.id.saturating_add(1));
        if self.is_watch {
            if !IDS.contains(&self.id) {
                self.id = *IDS.start();
            }
            let unknown = IDS.len().saturating_sub(known).max(1) as u32; // 253 at the most
            // A bus that was busy for long is not flooded afterwards.
            self.due = self.due.saturating_add(WATCH_PERIOD / unknown).max(now);
        }
        id
    }

    fn go_on_with(&mut self, id: u8) {
        (self.id, self.answers, self.silences) = (id, 0, 0);
    }
}
