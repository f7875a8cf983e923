//! What the original never had: the board's own settings, health and faults, asked for in ARCOS
//! packets ([`protocol::arcos::extension`]).

use core::num::NonZeroU8;

use embassy_time::Instant;
use protocol::pms5005::Repeat;
use protocol::pms5005::extension::{Outcome, Request as Asked};

use super::super::extension::Owed;
use super::super::{Request, count};
use super::{Answer, Answers, Phase};

impl Answers {
    /// Does what a request of the extension asks of the session.
    pub(super) fn extend(
        &mut self,
        request: Result<Asked<'_>, Outcome>,
        now: Instant,
    ) -> Option<Request> {
        let (answer, request) = match request {
            Ok(Asked::Health(repeat)) => {
                // One that runs keeps its rhythm.
                if self.health == Repeat::Stop {
                    self.health_at = self.health_at.max(now);
                }
                self.health = repeat;
                (None, None)
            }
            Ok(request) => self.extension.respond(request, now),
            Err(outcome) => (Some(Owed::Outcome(outcome)), None),
        };
        self.settle(answer);
        request
    }

    /// Notes an answer of the extension, if there is room and somebody to hear it.
    pub(super) fn settle(&mut self, answer: Option<Owed>) {
        let Some(answer) = answer.filter(|_| self.phase == Phase::Open) else { return };
        if answer.is_refusal() {
            count(&mut self.counters.link.refused, 1);
        }
        if !self.extension.owe(answer) {
            count(&mut self.counters.link.answers_dropped, 1);
        }
    }

    /// When health is to be told next, if at all.
    pub(super) fn health_is_due_at(&self) -> Option<Instant> {
        (self.health != Repeat::Stop).then_some(self.health_at)
    }

    /// Health, and the next time in the next cycle.
    pub(super) fn say_health(&mut self) -> Answer {
        if let Repeat::Times(times) = self.health {
            let left = NonZeroU8::new(times.get() - 1);
            self.health = left.map_or(Repeat::Stop, Repeat::Times);
        }
        self.health_at = self.cycle_at;
        Answer::Health
    }
}
