//! The CM-5's bridge between a PC and a bus of AX-12 servos.
//!
//! ```text
//!            ┌───────────── Bridge ─────────────┐
//!   PC ────> │ receive     Roster     bus_sends │ ────> bus
//!   PC <──── │ transmit  (the servos) bus_hears │ <──── bus
//!            └──────────────────────────────────┘
//! ```
//!
//! A [`Bridge`] has no I/O and no clock: bytes of both sides and the time go in, bytes for both come
//! out; [`tasks`] run it. The two sides meet in the roster of servos only, so neither waits for the
//! other: goals are taken once a cycle, whatever has come by then; a report is made when the PC's
//! line is free, from what is true then, and one that finds it busy for a whole cycle is skipped and
//! counted.
//!
//! | module | what it is |
//! |---|---|
//! | `exchange` | one instruction on the bus and its answer |
//! | `search` | who is on the bus, at boot and later |
//! | `bus_servo` | one servo: its setup, its strikes, its counters |
//! | `roster` | all servos, and what is written to the PC of them |
//! | `cycle` | the loop of work |
//! | `pc` | hello, answers, goals, reports, silence |
//! | `settings` | what an owner may choose |
//! | [`pass_through`] | no bridge at all: the PC is the bus's master |
//! | [`tasks`] | its three loops, where time passes |
//!
//! The walks of a byte through it, hop by hop, stand in the front page of the [crate].
//!
//! What the bridge looks at of what it passes on; all else goes through as it came:
//!
//! | what | where | why |
//! |---|---|---|
//! | of the fifteen bytes, whether a servo takes them | `Goals::parse` | one that does not take a value does nothing of its packet, not even stop, and cannot tell |
//! | lock | `BusServo::take_goal` | set, it bars limits and return delay until power-off: only if a setting allows it |
//! | torque enable | `BusServo::order` | to stop is allowed also while nothing else is |
//! | of an answer, overheat and overload | `BusServo::conclude` | the servo has switched itself off, and the same goal would switch it on again |
//! | of the eight bytes, nothing | | |
//!
//! Rules, where the page ("Communication protocol between PC and CM5") and the facts leave them to
//! us:
//! - up to 100 servos ([`MAX_SERVOS`]): 18 take 8 ms a cycle, 100 take 44 ms. Those that find no
//!   room are counted and left alone;
//! - no goal is sent before the PC's first goals, nor to a servo whose return delay and limits are
//!   not yet what the PC wants. To stop is always allowed: torque off is sent to whoever may hear;
//! - goals with one value that no servo takes are refused as a whole;
//! - a servo is driven only by a goal that is newer than whatever made the last one unsafe: a
//!   change between joint and endless turning, its own shutdown (heat, overload), silence for what
//!   turns endlessly, and being away while the PC is silent;
//! - registers 5 to 9 are written only where they differ, and read back;
//! - the first report after an answer waits until every servo has been read, a second at the most: one
//!   may be gone, or not take its limits;
//! - after the PC's first answer a hello is said again when a servo is new or back, and every 10 s (a
//!   setting) as long as that is not answered or the PC is silent;
//! - a servo that has not answered is stale in the report (8 x `FF`) from that cycle on; one that
//!   is missing or being set up is not sent goals, and one that turns endlessly is stopped then;
//! - a new servo becomes part of reports and goals when the PC has answered the hello that told of
//!   it; until then the others go on as before. A servo that is back takes part at once, with the
//!   limits it had to have, and the PC hears a hello;
//! - when the PC is silent, the goals stay as they are, and so does the torque, since a robot that
//!   goes limp falls: servos end the move that they were sent on, and hold. What turns endlessly
//!   has no such end, and its torque is switched off. A setting switches all torque off instead.
//!   Before the PC's first word silence counts from the end of the search, so what turned when the
//!   bridge began is stopped too.

mod bus_servo;
mod cycle;
mod exchange;
pub mod pass_through;
mod pc;
mod roster;
mod search;
mod settings;
pub mod tasks;

use embassy_time::Instant;
use protocol::cm5::Cm5;
use protocol::deframe::Reception;
use protocol::dynamixel::{Id, Instruction};

use crate::reception::{TimedReceiver, count};
use bus_servo::Stage;
use cycle::{Cycle, Job};
use exchange::{BRIEF_PATIENCE, Ending, Exchange, Expected, PATIENCE};
use pc::{Message, Pc};
use roster::Roster;
use search::Search;

pub use bus_servo::{BusServo, ServoCounters};
pub use exchange::{BusCounters, MAX_INSTRUCTION};
pub use pc::PcCounters;
pub use protocol::cm5::{MAX_PACKET, MAX_SERVOS};
pub use settings::{BridgeSettings, OnSilence};

/// What a bridge has counted. The counters wrap; those of a servo are with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeCounters {
    /// What was heard of the PC.
    pub reception: Reception,
    /// The PC's side.
    pub pc: PcCounters,
    /// The bus.
    pub bus: BusCounters,
    /// Cycles of the loop of work.
    pub cycles: u32,
    /// Servos found after the search.
    pub newcomers: u32,
    /// Servos that the search found and that there was no room for.
    pub without_room: u32,
}

/// What the exchange under way is for.
#[derive(Clone, Copy)]
enum Purpose {
    /// To find servos.
    Ping,
    Servo(Id, Stage),
    /// Goals, up to this servo.
    Goals(Id),
}

/// The bridge. See the [module](self). The time that it is told never runs backwards.
pub struct Bridge {
    receiver: TimedReceiver<Cm5, MAX_PACKET>,
    pc: Pc,
    exchange: Exchange,
    roster: Roster,
    search: Search,
    cycle: Cycle,
    purpose: Option<Purpose>,
    /// The exchange under way is sent again after a collision.
    again: bool,
    /// What no part of it counts.
    counters: BridgeCounters,
}

impl Bridge {
    /// A bridge at boot, about to search the bus.
    pub fn new(settings: BridgeSettings, now: Instant) -> Self {
        Self {
            receiver: TimedReceiver::new(),
            pc: Pc::new(settings),
            exchange: Exchange::new(),
            roster: Roster::new(),
            search: Search::new(settings.search_retries, now),
            cycle: Cycle::new(),
            purpose: None,
            again: false,
            counters: BridgeCounters::default(),
        }
    }

    /// Everything counted so far, except for the servos.
    pub fn counters(&self) -> BridgeCounters {
        BridgeCounters {
            reception: self.receiver.reception(),
            pc: self.pc.counters,
            bus: self.exchange.counters(),
            cycles: self.cycle.cycles,
            ..self.counters
        }
    }

    /// The servos found so far, in the order of their IDs.
    pub fn servos(&self) -> impl Iterator<Item = &BusServo> {
        self.roster.iter()
    }

    /// Whether the search at boot is still on.
    pub fn is_searching(&self) -> bool {
        !self.search.is_watch
    }

    /// Whether the PC is silent for too long; before its first word, since the search was over.
    pub fn pc_is_silent(&self) -> bool {
        self.pc.silent
    }

    /// Takes bytes of the PC, and gives up on those that have waited too long for the rest.
    pub fn receive(&mut self, mut bytes: &[u8], now: Instant) {
        while let Some(packet) = self.receiver.receive(&mut bytes, now) {
            self.pc.respond(packet, &mut self.roster, now);
        }
    }

    /// When [`receive`](Self::receive) has something to do even without bytes.
    pub fn gives_up_at(&self) -> Option<Instant> {
        self.receiver.gives_up_at()
    }

    /// Counts an error that the PC's line reported.
    pub fn line_failed(&mut self) {
        count(&mut self.pc.counters.line_errors, 1);
    }

    /// When there will be something to send to the PC; it may be now or past.
    pub fn sends_at(&self) -> Instant {
        self.pc.sends_at()
    }

    /// The next packet to the PC, written into `out`; `None` if there is nothing to say now. Call
    /// it whenever the line is free. `out` holds at least [`MAX_PACKET`] bytes.
    pub fn transmit<'b>(&mut self, now: Instant, out: &'b mut [u8]) -> Option<&'b [u8]> {
        let packet = match self.pc.next(now)? {
            Message::Hello => self.roster.hello(out),
            Message::Report => self.roster.report(out),
        };
        packet.ok().map(|packet| &*packet)
    }

    /// Takes bytes that were heard on the bus: the echo of what was sent, and what followed.
    pub fn bus_hears(&mut self, mut bytes: &[u8], now: Instant) {
        while !bytes.is_empty() {
            if let Some(ending) = self.exchange.receive(&mut bytes, now) {
                self.conclude(ending, now);
            }
        }
    }

    /// Counts an error that the bus's receiver or transmitter reported.
    pub fn bus_failed(&mut self) {
        self.exchange.line_failed();
    }

    /// When [`bus_sends`](Self::bus_sends) has something to do although nothing was heard; asked
    /// after that has answered `None`.
    pub fn bus_acts_at(&self) -> Instant {
        match self.exchange.waits_until() {
            Some(until) => until,
            None if self.is_searching() => self.search.due,
            None if self.roster.is_full() => self.cycle.rests_until(),
            None => self.cycle.rests_until().min(self.search.due),
        }
    }

    /// The next packet for the bus, written into `out`; `None` while one waits for an answer, or
    /// when there is nothing to do. Call it whenever something was heard, and at
    /// [`bus_acts_at`](Self::bus_acts_at). `out` holds at least [`MAX_INSTRUCTION`] bytes.
    pub fn bus_sends<'b>(&mut self, now: Instant, out: &'b mut [u8]) -> Option<&'b [u8]> {
        if let Some(ending) = self.exchange.expire(now) {
            self.conclude(ending, now);
        }
        if self.exchange.waits_until().is_some() {
            return None;
        }
        if let Some(id) = self.whom_to_ping(now) {
            self.purpose = Some(Purpose::Ping);
            let patience = if self.is_searching() { PATIENCE } else { BRIEF_PATIENCE };
            let expected = Expected { id, data: 0, patience };
            return self.exchange.send(
                Instruction::Ping.encode(id, out).ok()?,
                Some(expected),
                now,
            );
        }
        if self.is_searching() {
            return None;
        }
        match self.cycle.next(&mut self.roster, &mut self.pc, now)? {
            Job::Servo(id) => {
                let servo = self.roster.get_mut(id)?;
                let (packet, expected) = servo.instruction(out).ok()?;
                self.purpose = Some(Purpose::Servo(id, servo.stage));
                self.exchange.send(packet, Some(expected), now)
            }
            Job::Goals(block) => {
                let (packet, last) = self.cycle.goals(block, &self.roster, out).ok()?;
                self.purpose = last.map(Purpose::Goals);
                self.exchange.send(packet, None, now)
            }
        }
    }

    /// Who is to be sent a PING now, if anybody.
    fn whom_to_ping(&mut self, now: Instant) -> Option<Id> {
        if now < self.search.due {
            return None;
        }
        if self.search.ends() {
            self.pc.begin(now);
        }
        if self.search.is_watch && self.roster.is_full() {
            return None;
        }
        self.search.next(|id| self.roster.knows(id))
    }

    /// Does what the end of an exchange asks for.
    fn conclude(&mut self, ending: Ending, now: Instant) {
        let Some(purpose) = self.purpose.take() else { return };
        // Nothing has moved on yet, so the same instruction comes again.
        self.again = ending == Ending::Collided && !self.again;
        if self.again {
            return;
        }
        let answered = matches!(ending, Ending::Answered(_));
        match purpose {
            Purpose::Ping => {
                let Some(id) = self.search.conclude(answered, self.roster.len(), now) else {
                    return;
                };
                match (self.roster.add(id), self.is_searching()) {
                    (false, true) => count(&mut self.counters.without_room, 1),
                    (true, false) => {
                        count(&mut self.counters.newcomers, 1);
                        self.pc.tell_news(now);
                    }
                    _ => {}
                }
            }
            Purpose::Servo(id, asked) => {
                self.cycle.served(id);
                let Some(servo) = self.roster.get_mut(id) else { return };
                if servo.conclude(asked, ending, now) {
                    if self.pc.silent {
                        servo.withdraw_goal();
                    }
                    self.pc.tell_news(now);
                }
            }
            Purpose::Goals(last) => self.cycle.served(last),
        }
    }
}
