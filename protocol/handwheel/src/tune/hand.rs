//! What a procedure does to a board, one thing after the other: ask, drive, watch, record.

use std::future::poll_fn;
use std::sync::{Arc, Mutex};
use std::task::Poll;
use std::time::Duration;

use protocol::extension::{
    BLOCK, ChannelState, MachineState, Mode, Phase, Reason, Recording, Request, Row,
};
use protocol::pms5005::CHANNELS;

use super::job::{Ask, Refused, Shared, look, refusal};
use crate::motion::shafts::STILL;
use crate::motion::target::{self, Target};
use crate::number::Number;
use crate::session::{Reply, sign_of_life};
use crate::state;
use crate::step::recording_of;
use crate::words;

/// A machine state may be older than a command that was just acknowledged.
const GRACE: Duration = Duration::from_millis(100);
/// A board that tells nothing for so long cannot be watched.
const SILENCE: Duration = Duration::from_millis(500);
/// Blocks that are asked for at once.
const RUN: u16 = 32;
/// How often what is lost of a recording is asked for.
const TRIES: usize = 8;

/// What a motor was asked for.
#[derive(Clone, Copy)]
struct Driven {
    mode: Mode,
    /// A set-point that is there at once and stays.
    set_point: Option<i32>,
    /// When that was acknowledged.
    since: Duration,
}

/// A procedure's hand on one motor.
pub(super) struct Hand {
    shared: Arc<Mutex<Shared>>,
    pub(super) motor: Number,
    /// It has been told to stop, and is ending.
    is_ending: bool,
    /// What the motor was last asked for.
    driven: Option<Driven>,
    /// Between what it has to stay: the least and the most.
    room: Option<(i32, i32)>,
    /// The motors that were on when it began.
    others: Option<[bool; CHANNELS]>,
}

impl Hand {
    pub(super) fn new(shared: Arc<Mutex<Shared>>, motor: Number) -> Self {
        Self { shared, motor, is_ending: false, driven: None, room: None, others: None }
    }

    pub(super) fn now(&self) -> Duration {
        look(&self.shared).now
    }

    /// How often signs of life are sent from now on: the board's link timeout, in ms, says how often.
    pub(super) fn lives(&self, link_timeout: i32) {
        look(&self.shared).life = sign_of_life(Some(link_timeout));
    }

    /// It is to be stopped again, if somebody wants that.
    pub(super) fn begin(&mut self, doing: &'static str) {
        self.is_ending = false;
        self.says(doing);
    }

    /// What it is about from now on.
    pub(super) fn says(&self, doing: &'static str) {
        look(&self.shared).doing = doing;
    }

    /// Why it is to end, if it is.
    fn stopped(&self) -> Option<Refused> {
        let why = look(&self.shared).stop.clone();
        why.filter(|_| !self.is_ending).map(Refused::Stopped)
    }

    /// Asks, and waits for what comes of it.
    async fn ask(&self, ask: Ask, what: &'static str) -> Result<Reply, Refused> {
        if let Some(stopped) = self.stopped() {
            return Err(stopped);
        }
        look(&self.shared).ask = Some(ask);
        let reply = poll_fn(|_| match look(&self.shared).reply.take() {
            Some(reply) => Poll::Ready(reply),
            None => Poll::Pending,
        });
        reply.await.map_err(|failure| refusal(failure, what))
    }

    /// Waits until a time.
    pub(super) async fn until(&self, time: Duration) -> Result<(), Refused> {
        poll_fn(|_| match self.stopped() {
            Some(stopped) => Poll::Ready(Err(stopped)),
            None if self.now() >= time => Poll::Ready(Ok(())),
            None => Poll::Pending,
        })
        .await
    }

    /// The value of a setting.
    pub(super) async fn get(&self, number: u16) -> Result<i32, Refused> {
        match self.ask(Ask::Request(Request::Setting(number)), "a setting").await? {
            Reply::Setting(setting) => Ok(setting.value),
            _ => Err(Refused::Line("the board's answer is another's: try again".into())),
        }
    }

    /// Sets settings, all or none.
    pub(super) async fn set(&self, values: &[(u16, i32)]) -> Result<(), Refused> {
        self.ask(Ask::Set(values.to_vec()), "settings").await.map(drop)
    }

    /// The shaft has to stay between these places from now on.
    pub(super) fn stays(&mut self, low: i32, high: i32) {
        self.room = Some((low, high));
    }

    /// The next machine state's channel. Signs of life would keep others running too: nobody else may begin
    /// to drive meanwhile.
    pub(super) async fn state(&mut self) -> Result<ChannelState, Refused> {
        let state = self.whole_state().await?;
        let on = state::on(&state);
        let before = *self.others.get_or_insert(on);
        let begins = |other: &Number| {
            let index = other.index();
            *other != self.motor && on[index] && !before[index]
        };
        match Number::all().find(begins).filter(|_| !self.is_ending) {
            None => Ok(state.channels[self.motor.index()]),
            Some(other) => Err(Refused::Stopped(format!(
                "another host drives motor {other} now, which this would keep running if that host died: let it end first"
            ))),
        }
    }

    async fn whole_state(&self) -> Result<MachineState, Refused> {
        let (seen, began) = {
            let mut shared = look(&self.shared);
            shared.watches = true;
            (shared.states, shared.now)
        };
        poll_fn(|_| {
            if let Some(stopped) = self.stopped() {
                return Poll::Ready(Err(stopped));
            }
            let shared = look(&self.shared);
            match shared.state.filter(|_| shared.states != seen) {
                Some(state) => Poll::Ready(Ok(state)),
                None if shared.now > began + SILENCE => Poll::Ready(Err(Refused::Stopped(
                    "the board tells no machine state any more: check the line".into(),
                ))),
                None => Poll::Pending,
            }
        })
        .await
    }

    /// Drives the motor; a duty is reached in so long.
    pub(super) async fn drive(&mut self, target: Target, ramp: Duration) -> Result<(), Refused> {
        look(&self.shared).is_driving = true;
        let command = target.command(self.motor, ramp);
        self.ask(Ask::Command(command), "a motion command").await?;
        let (mode, set_point) = target.in_the_state();
        let stays = ramp == Duration::ZERO && mode != Mode::Position;
        let set_point = stays.then_some(set_point);
        self.driven = Some(Driven { mode, set_point, since: self.now() });
        Ok(())
    }

    /// Watches the motor until a time, or until `is_enough` of what it does.
    pub(super) async fn watch(
        &mut self,
        until: Duration,
        mut is_enough: impl FnMut(&ChannelState) -> bool,
    ) -> Result<(), Refused> {
        while self.now() < until {
            let channel = self.state().await?;
            self.look(&channel)?;
            if is_enough(&channel) {
                break;
            }
        }
        Ok(())
    }

    /// Whether it still does what was asked.
    fn look(&self, channel: &ChannelState) -> Result<(), Refused> {
        if let Some((low, high)) = self.room
            && !(low..=high).contains(&channel.position)
        {
            return Err(Refused::Stopped(format!(
                "it went to {}, beyond the {low} to {high} that it was to stay within: allow less duty",
                channel.position
            )));
        }
        let Some(Driven { mode, set_point, since }) = self.driven else { return Ok(()) };
        let stopped = |why: String| Err(Refused::Stopped(why));
        let is_new = self.now() <= since + GRACE;
        let apart = set_point.map_or(0, |asked| (i32::from(channel.set_point) - asked).abs());
        let is_asked = apart <= 1; // the wire rounds
        match channel.reason {
            Reason::OtherMethod | Reason::BeyondScale if is_new => Ok(()),
            Reason::Obstacle | Reason::SoftLimit | Reason::OverCurrent | Reason::Overload => {
                stopped(words::reason(channel).unwrap_or_default())
            }
            _ if is_new || channel.mode == mode && is_asked => Ok(()),
            _ if channel.mode == Mode::Off => stopped(
                words::reason(channel).unwrap_or_else(|| "another host has stopped it".into()),
            ),
            _ => stopped("another host drives it: end that host".into()),
        }
    }

    /// Takes the drive away, and waits until the shaft stands, so long at the most. The motor stays on: so the
    /// board saves nothing that is set for the moment, and nobody else takes it for free.
    pub(super) async fn rest(&mut self, most: Duration) -> Result<(), Refused> {
        self.drive(Target::Duty(0.0), Duration::ZERO).await?;
        let (end, mut still) = (self.now() + most, (i32::MIN, self.now()));
        while self.now() < end && self.now() < still.1 + STILL {
            let channel = self.state().await?;
            self.look(&channel)?;
            if channel.position.wrapping_sub(still.0).saturating_abs() > 4 {
                still = (channel.position, self.now());
            }
        }
        Ok(())
    }

    /// Off, so that what comes next begins without a crossing over from another method.
    pub(super) async fn afresh(&mut self) -> Result<(), Refused> {
        self.driven = None;
        self.ask(Ask::Command(target::suspend(self.motor)), "a stop").await.map(drop)
    }

    /// Switches the motor off, whatever has happened.
    pub(super) async fn end(&mut self) -> Result<(), Refused> {
        self.is_ending = true;
        self.driven = None;
        let neutral = self.ask(Ask::Command(target::neutral(self.motor)), "a stop").await;
        let off = self.ask(Ask::Command(target::suspend(self.motor)), "a stop").await;
        look(&self.shared).is_driving = false;
        neutral.and(off).map(drop)
    }

    /// Begins a recording of the motor, at the next motion command, for so long, with so many rows at the most.
    /// Who has stopped it meanwhile, while nobody looked, has stopped it.
    pub(super) async fn record(&mut self, time: Duration, rows: u16) -> Result<Recording, Refused> {
        let channel = self.state().await?;
        self.look(&channel)?;
        self.recording(Request::Record(recording_of(self.motor, time, rows))).await
    }

    /// How the recorder is.
    async fn recording(&self, request: Request<'static>) -> Result<Recording, Refused> {
        match self.ask(Ask::Request(request), "a recorder").await? {
            Reply::Recording(recording) => Ok(recording),
            _ => Err(Refused::Line("the board's answer is another's: try again".into())),
        }
    }

    /// Reads a recording, once it is done.
    pub(super) async fn rows(&self, serial: u8) -> Result<Vec<Row>, Refused> {
        let other = || Refused::Stopped("another host uses the recorder: end that host".into());
        look(&self.shared).watches = false;
        let recording = loop {
            let recording = self.recording(Request::Recording).await?;
            if recording.phase == Phase::None {
                return Err(Refused::Stopped("the board has been restarted".into()));
            }
            if recording.serial != serial {
                return Err(other());
            }
            if recording.phase == Phase::Done {
                break recording;
            }
            self.until(self.now() + Duration::from_millis(50)).await?;
        };
        let count = usize::from(recording.taken) * recording.channels.count_ones() as usize;
        let mut blocks: Vec<Option<Vec<Row>>> = vec![None; count.div_ceil(BLOCK)];
        for _ in 0..TRIES {
            let mut at = 0;
            // All of it, or what was lost of it, run by run.
            while let Some(gap) = blocks.iter().skip(at).position(Option::is_none) {
                let first = at + gap;
                let missing = blocks.iter().skip(first).take_while(|block| block.is_none()).count();
                let count = u16::try_from(missing).unwrap_or(RUN).min(RUN);
                at = first + usize::from(count);
                look(&self.shared).blocks.clear();
                let request = Request::Blocks { first: first as u16, count };
                let asked = self.ask(Ask::Request(request), "a recording").await;
                let came = std::mem::take(&mut look(&self.shared).blocks);
                if let Err(stopped @ Refused::Stopped(_)) = asked {
                    return Err(stopped);
                }
                if asked.is_err() && came.is_empty() {
                    let silent = "the recording does not come through: check the line";
                    return Err(Refused::Line(silent.into()));
                }
                for block in came {
                    if block.serial != serial {
                        return Err(other());
                    }
                    if let Some(place) = blocks.get_mut(usize::from(block.number)) {
                        *place = Some(block.rows().to_vec());
                    }
                }
                self.until(self.now()).await?;
            }
        }
        let rows: Option<Vec<_>> = blocks.into_iter().collect();
        let lost =
            || Refused::Line("parts of the recording do not come through: check the line".into());
        Ok(rows.ok_or_else(lost)?.concat())
    }
}
