//! The PC's side: hello, answers and goals, reports, silence.
//!
//! A *hello* is said when there is *news*: the search is over, a servo is new, or one is back. Until
//! the PC has answered for the first time it is said once a second. From then on reports go out
//! whether the PC speaks or not, and a PC may do no more than listen; so a hello is said again only
//! every `hello_period_s`, as long as the news is not answered or the PC is silent: a PC that was
//! restarted waits for one. A packet is a sign of life only if it was carried out. Silence counts
//! from the end of the search: a bridge that starts again under a robot at work finds servos that
//! still turn, and maybe nobody who would stop them.
//!
//! After an answer that has changed something the first report waits until every servo has been
//! read, since nothing on the page prepares a PC for a servo that is there and reads `FF`; but no
//! longer than [`READ_WITHIN`], since there may be one that does not take its limits.

use embassy_time::{Duration, Instant};
use protocol::cm5::{Goals, HelloAnswer, Refusal, params_of};

use super::bus_servo::{BusServo, Setup, Standing};
use super::roster::Roster;
use super::settings::{BridgeSettings, OnSilence};
use crate::fmt::warning;
use crate::reception::count;

/// "Send this packet once every second to the PC until get a reply" (page, "The PC Handshake").
const HELLO_PERIOD: Duration = Duration::from_secs(1);
/// How long the first report waits for servos that have not been read. 18 servos as from the factory
/// take 0.1 s, a hundred 0.5 s.
const READ_WITHIN: Duration = Duration::from_secs(1);
/// Servos that come together are told together: hellos are at least so far apart.
const HELLO_DISTANCE: Duration = Duration::from_millis(200);

/// What the PC's side has counted. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PcCounters {
    /// Hellos sent.
    pub hellos_sent: u32,
    /// Answers to a hello, carried out.
    pub answers: u32,
    /// Packets of goals, carried out.
    pub goals: u32,
    /// Intact packets for another number of servos, or with values that cannot be. Nothing of them
    /// was done.
    pub refused: u32,
    /// Reports sent.
    pub reports_sent: u32,
    /// Reports skipped because the line was busy for a whole cycle.
    pub reports_skipped: u32,
    /// How often the PC fell silent.
    pub silences: u32,
    /// Errors that the line itself reported.
    pub line_errors: u32,
}

/// What the PC is told.
pub enum Message {
    /// Which servos there are.
    Hello,
    /// What those that the PC has agreed on tell.
    Report,
}

/// What the bridge owes its PC, and what it has heard of it.
pub struct Pc {
    settings: BridgeSettings,
    /// There is something that the PC has not answered.
    news: bool,
    /// When the next hello is due, if there is news or silence.
    hello_at: Instant,
    /// When the last one was said.
    hello_said: Option<Instant>,
    report_due: bool,
    /// Until when reports wait for servos that have not been read; `None` before the first answer.
    reads_until: Option<Instant>,
    /// When the PC was last heard, or could first have been.
    heard: Option<Instant>,
    /// For too long.
    pub(super) silent: bool,
    pub(super) counters: PcCounters,
}

impl Pc {
    pub fn new(settings: BridgeSettings) -> Self {
        Self {
            settings,
            news: false,
            hello_at: Instant::MAX,
            hello_said: None,
            report_due: false,
            reads_until: None,
            heard: None,
            silent: false,
            counters: PcCounters::default(),
        }
    }

    /// The search is over: from now on the PC can make itself heard.
    pub fn begin(&mut self, now: Instant) {
        self.heard = Some(now);
        self.tell_news(now);
    }

    /// The list of servos has changed, or one of them was away: a hello is due.
    pub fn tell_news(&mut self, now: Instant) {
        self.news = true;
        let soonest = self.hello_said.map_or(now, |said| said.saturating_add(HELLO_DISTANCE));
        self.hello_at = self.hello_at.min(soonest.max(now));
    }

    /// A cycle is complete.
    pub fn tell_report(&mut self, roster: &Roster, now: Instant) {
        let Some(reads_until) = self.reads_until else { return };
        if now < reads_until && roster.iter().any(BusServo::is_to_be_read) {
            return;
        }
        self.reads_until = Some(Instant::MIN);
        if self.report_due {
            count(&mut self.counters.reports_skipped, 1);
        }
        self.report_due = true;
    }

    /// When there will be something to send; it may be now or past.
    pub fn sends_at(&self) -> Instant {
        match () {
            () if self.report_due => Instant::MIN,
            () if self.news || self.silent => self.hello_at,
            () => Instant::MAX,
        }
    }

    /// When a hello is said again, if nothing changes.
    fn next_hello(&self, now: Instant) -> Instant {
        match (self.reads_until, self.settings.hello_period_s) {
            (None, _) => now.saturating_add(HELLO_PERIOD),
            (Some(_), 0) => Instant::MAX,
            (Some(_), seconds) => now.saturating_add(Duration::from_secs(seconds.into())),
        }
    }

    /// What is to be sent now, if anything; from now on it counts as sent.
    pub fn next(&mut self, now: Instant) -> Option<Message> {
        if (self.news || self.silent) && now >= self.hello_at {
            self.hello_at = self.next_hello(now);
            self.hello_said = Some(now);
            count(&mut self.counters.hellos_sent, 1);
            Some(Message::Hello)
        } else if core::mem::take(&mut self.report_due) {
            count(&mut self.counters.reports_sent, 1);
            Some(Message::Report)
        } else {
            None
        }
    }

    /// Does what a packet that was found intact asks.
    pub fn respond(&mut self, packet: &[u8], roster: &mut Roster, now: Instant) {
        let Some(params) = params_of(packet) else { return };
        if let Err(refusal) = self.carry_out(params, roster, now) {
            count(&mut self.counters.refused, 1);
            warning!("packet not carried out: {}", refusal);
        } else {
            self.heard = Some(now);
            self.silent = false;
        }
    }

    fn carry_out(
        &mut self,
        params: &[u8],
        roster: &mut Roster,
        now: Instant,
    ) -> Result<(), Refusal> {
        let goals = Goals::parse(params, roster.agreed());
        let answer = match self.hello_said {
            Some(_) => HelloAnswer::parse(params, roster.told().count()),
            None => Err(Refusal::Length(params.len())),
        };
        match (answer, goals) {
            // Both at once are rare (see `protocol::cm5`): whom the bridge has asked may answer.
            (Ok(answer), goals) if self.news || goals.is_err() => {
                self.take_answer(answer, roster, now);
                Ok(())
            }
            (_, Ok(goals)) => {
                for (servo, goal) in roster.iter_mut().filter(|s| s.is_agreed()).zip(goals.iter()) {
                    servo.newest = Some(goal);
                }
                count(&mut self.counters.goals, 1);
                Ok(())
            }
            // The one of the right length tells what is wrong with it.
            (Err(Refusal::Length(_)) | Ok(_), Err(refusal)) | (Err(refusal), Err(_)) => {
                Err(refusal)
            }
        }
    }

    fn take_answer(&mut self, answer: HelloAnswer<'_>, roster: &mut Roster, now: Instant) {
        let told = roster.iter_mut().filter(|servo| servo.standing != Standing::Found);
        for (place, servo) in told.enumerate() {
            if let Some(setup) = answer.setup(place) {
                servo.agree(Setup(setup));
            }
        }
        self.report_due = false;
        self.reads_until = Some(now.saturating_add(READ_WITHIN));
        // A servo found since the hello still is news.
        self.news = roster.told().count() < roster.len();
        self.hello_at = self.hello_at.min(now.saturating_add(HELLO_PERIOD));
        count(&mut self.counters.answers, 1);
    }

    /// Brings the newest goals into force, and does what silence asks for.
    pub fn take_goals(&mut self, roster: &mut Roster, now: Instant) {
        let timeout = Duration::from_millis(self.settings.pc_timeout_ms.into());
        let silent = timeout.as_ticks() > 0
            && self.heard.is_some_and(|at| now.saturating_duration_since(at) >= timeout);
        if silent && !self.silent {
            self.silent = true;
            if !self.news {
                self.hello_at = self.next_hello(now);
            }
            count(&mut self.counters.silences, 1);
        }
        for servo in roster.iter_mut() {
            servo.take_goal(self.settings.pass_lock);
            if silent {
                servo.rest(self.settings.on_silence == OnSilence::TorqueOff);
            }
        }
    }
}
