//! Arming and driving: who may write, what runs for it, and how that ends.

use std::time::Duration;

use protocol::extension::{MachineState, Mode, Recording, Request};
use protocol::pms5005::CHANNELS;
use serde_json::{Map, Value};

use super::exchanges::Purpose;
use super::found::stepped;
use super::job::Running;
use super::message::{member, ms, number};
use super::stop::{Ending, Stop};
use super::{ALIVE, Asker, PageId, Panel};
use crate::Number;
use crate::error::Error;
use crate::motion::shafts::Shafts;
use crate::motion::target::Target;
use crate::motion::watch::Watch;
use crate::session::{Event, Failure, Personality, Reply, sign_of_life};
use crate::state::on;
use crate::step::{Course, recording_of};

/// After which silence an armed page that drives nothing is disarmed.
const ABSENT: Duration = Duration::from_secs(3);

/// What moves, and for whom.
#[derive(Default)]
pub(super) struct Motion {
    /// The page that is armed, and when it was heard last.
    armed: Option<(PageId, Duration)>,
    pub(super) ours: [Option<Ours>; CHANNELS],
    pub(super) ending: [Option<Ending>; CHANNELS],
    /// The channels that were on in the last machine state.
    pub(super) on: [bool; CHANNELS],
    pub(super) shafts: Shafts,
    pub(super) stop: Option<Stop>,
    pub(super) step: Option<Step>,
    pub(super) job: Option<Running>,
    /// Until when servos are on the way where a page has sent them.
    pub(super) ramps: [Duration; CHANNELS],
    /// Counts the motion commands, so that each knows its own acknowledgement.
    commands: u64,
    /// How often signs of life are sent, if at all.
    life: Option<Duration>,
}

/// A motor that is driven for a page.
pub(super) struct Ours {
    watch: Watch,
    /// The newest command, and whether it was acknowledged.
    command: u64,
    acknowledged: bool,
}

/// A step that is under way. Its page's answer comes at its end.
pub(super) struct Step {
    asker: Asker,
    pub(super) motor: Number,
    time: Duration,
    /// When it was acknowledged.
    begun: Option<Duration>,
    course: Course,
    /// Its recording, if the board makes one.
    recording: Option<Recording>,
}

/// Rows of a step that are recorded at the most: they take a second to be read at 115200 baud.
const ROWS: u16 = 500;

impl Motion {
    pub(super) fn armed_page(&self) -> Option<PageId> {
        self.armed.map(|(page, _)| page)
    }

    /// Whether a motor is driven from a page, or a job has it.
    pub(super) fn is_ours(&self, motor: Number) -> bool {
        let is_its = self.job.as_ref().is_some_and(|running| running.motor == motor);
        self.ours[motor.index()].is_some() || is_its
    }

    fn is_driving(&self) -> bool {
        self.ours.iter().any(Option::is_some) || self.job.as_ref().is_some_and(Running::is_driving)
    }

    /// Whether nothing is driven or being stopped.
    pub(super) fn is_at_rest(&self) -> bool {
        !self.is_driving()
            && self.ending.iter().all(Option::is_none)
            && self.stop.is_none()
            && self.job.is_none()
    }

    /// What is driven from a page, or being stopped for one.
    pub(super) fn all_of_ours(&self) -> Vec<Number> {
        let is_one = |motor: &Number| self.is_ours(*motor) || self.ending[motor.index()].is_some();
        Number::all().filter(is_one).collect()
    }
}

impl Panel {
    pub(super) fn alive(&mut self, page: PageId) {
        if let Some((armed, heard)) = &mut self.motion.armed
            && *armed == page
        {
            *heard = self.now;
        }
    }

    pub(super) fn arm(&mut self, asker: Asker) -> Result<(), String> {
        self.needs_a_board()?;
        if let Some(other) = self.motion.armed_page().filter(|page| *page != asker.0) {
            let name = self.page_name(other);
            return Err(format!("{name} is armed: disarm it there first, or close it"));
        }
        if self.personality() != Personality::Pms5005 {
            return Err(format!("{} can be seen from here, not driven", self.title()));
        }
        // Whether another host drives is to be known before anything is.
        if !self.board.is_met() || self.has_state() && self.tells.state.is_none() {
            return Err("the board is still being asked how it is: wait a moment".into());
        }
        self.motion.armed = Some((asker.0, self.now));
        self.tell_armed();
        self.answer(asker, Ok(Value::Null));
        Ok(())
    }

    pub(super) fn needs_armed(&self, page: PageId) -> Result<(), String> {
        match self.motion.armed_page() {
            Some(armed) if armed == page => Ok(()),
            Some(other) => Err(format!("{} is armed, this page is not", self.page_name(other))),
            None => Err("this page is not armed: switch Arm on first".into()),
        }
    }

    /// Ends a page's right to write, and what it drives.
    pub(super) fn disarm_if(&mut self, page: PageId, why: &str) {
        if self.motion.armed_page() == Some(page) {
            let was_driving = self.motion.is_driving();
            self.end_all_of_ours(why);
            self.hold_servos();
            self.motion.armed = None;
            self.tell_armed();
            if was_driving {
                self.note(&format!("{why}: what it drove is stopped, and it is disarmed"));
            }
        }
    }

    /// A stop from another page: what the armed one still has to say is older than that.
    pub(super) fn disarm_others(&mut self, page: PageId) {
        if self.motion.armed_page().is_some_and(|armed| armed != page) {
            self.motion.armed = None;
            self.tell_armed();
            let name = self.page_name(page);
            self.note(&format!("{name} has stopped everything: disarmed"));
        }
    }

    /// A page that is not heard any more is disarmed.
    pub(super) fn watch_pages(&mut self) {
        let limit = if self.motion.is_driving() { ALIVE } else { ABSENT };
        if let Some((page, heard)) = self.motion.armed
            && self.now > heard + limit
        {
            let why = format!("{} did not answer (a busy computer?)", self.page_name(page));
            self.disarm_if(page, &why);
        }
    }

    pub(super) fn drive(
        &mut self,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        let motor = member(object, "motor")?;
        self.needs_no_job()?;
        let (target, ramp) = (target(object)?, ms(object, "ms", 0, i64::from(u16::MAX))?);
        if self.motion.step.as_ref().is_some_and(|step| step.motor == motor) {
            return Err(format!("motor {motor} makes a step: wait for its end, or stop it"));
        }
        self.begin(motor, target, ramp, Some(asker))
    }

    fn begin(
        &mut self,
        motor: Number,
        target: Target,
        ramp: Duration,
        asker: Option<Asker>,
    ) -> Result<(), String> {
        let index = motor.index();
        let was_ours = self.motion.ours[index].is_some() || self.motion.ending[index].is_some();
        if self.motion.on[index] && !was_ours {
            return Err(format!(
                "motor {motor} is driven by another host: Stop first, or end that host"
            ));
        }
        if !self.motion.is_driving() {
            self.tell_others();
        }
        if let Some(ending) = self.motion.ending[index].take() {
            self.answer_all(ending.askers, &Err("it is driven again".into()));
        }
        self.motion.commands += 1;
        let command = self.motion.commands;
        let watch = Watch::new(motor, target, ramp, self.now);
        self.motion.ours[index] = Some(Ours { watch, command, acknowledged: false });
        self.live();
        self.command(&target.command(motor, ramp), Purpose::Drive(motor, command, asker));
        Ok(())
    }

    /// Signs of life keep everything running, whoever drives it.
    pub(super) fn tell_others(&mut self) {
        let ours = self.motion.all_of_ours();
        let others: Vec<_> = Number::all()
            .filter(|motor| self.motion.on[motor.index()] && !ours.contains(motor))
            .map(|motor| motor.to_string())
            .collect();
        if !others.is_empty() {
            self.note(&format!(
                "another host drives motor {}: while this page drives too, it runs on even if that host dies",
                others.join(", ")
            ));
        }
    }

    /// What came of a motion command.
    pub(super) fn driven(
        &mut self,
        motor: Number,
        command: u64,
        asker: Option<Asker>,
        result: Result<(), Error>,
    ) {
        let result = result.map(|()| Value::Null).map_err(|error| error.to_string());
        let ours = self.motion.ours[motor.index()].as_mut();
        if let Some(ours) = ours.filter(|ours| ours.command == command) {
            ours.acknowledged = true;
            ours.watch.begins(self.now);
            if let Some(step) = self.motion.step.as_mut().filter(|step| step.motor == motor) {
                step.begun = Some(self.now);
            }
            if let Err(error) = &result {
                self.end(motor, None, error);
            }
        }
        if let Some(asker) = asker {
            self.answer(asker, result);
        }
    }

    pub(super) fn step(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        let motor = member(object, "motor")?;
        self.needs_no_job()?;
        let target = target(object)?;
        let time = match object.get("ms") {
            None => Duration::from_secs(2),
            Some(_) => ms(object, "ms", 100, 60_000)?,
        };
        if matches!(target, Target::Duty(_)) {
            return Err("a step is to a velocity or a position".into());
        }
        if self.motion.step.is_some() {
            return Err("another step is under way".into());
        }
        if self.motion.all_of_ours().contains(&motor) {
            return Err(format!("motor {motor} still runs: a step begins at rest, switch it off"));
        }
        if !self.has_state() {
            return Err("this board tells no machine state to sample".into());
        }
        // While a recording is read nothing else is watched.
        if self.has_recorder() && self.motion.all_of_ours().is_empty() {
            let setup = recording_of(motor, time, ROWS);
            self.ask(&Request::Record(setup), Purpose::Record);
        }
        self.begin(motor, target, Duration::ZERO, None)?;
        let course = Course::new(motor, target);
        let recording = None;
        self.motion.step = Some(Step { asker, motor, time, begun: None, course, recording });
        Ok(())
    }

    /// The step of this motor is over before its time.
    pub(super) fn give_up_step(&mut self, motor: Number, why: &str) {
        if let Some(step) = self.motion.step.take_if(|step| step.motor == motor) {
            self.answer(step.asker, Err(why.to_owned()));
        }
    }

    fn end_step(&mut self) {
        let Some(Step { asker, motor, course, recording, .. }) = self.motion.step.take() else {
            return;
        };
        self.end(motor, None, "");
        match recording.filter(|_| !self.motion.is_driving()) {
            None => self.answer(asker, stepped(motor, &course)),
            Some(recording) => self.read_step(asker, motor, course, &recording),
        }
    }

    /// What came of the question for a recording of the step; without one machine states tell of it.
    pub(super) fn step_is_recorded(&mut self, result: Result<Reply, Failure>) {
        if let (Some(step), Ok(Reply::Recording(recording))) = (&mut self.motion.step, result) {
            step.recording = Some(recording);
        }
    }

    /// Signs of life while something is ours, as often as the board wants them.
    pub(super) fn live(&mut self) {
        let life = self.motion.is_driving().then(|| sign_of_life(self.board.link_timeout));
        if life != self.motion.life {
            self.motion.life = life;
            self.session.drive(life, self.now);
        }
    }

    /// Telemetry and machine states tell of shafts.
    pub(super) fn see(&mut self, event: &Event) {
        self.motion.shafts.see(event, self.now);
        if let Some(stop) = &mut self.motion.stop {
            stop.see(event, self.now);
        }
        if let Event::State(state) = event {
            self.look(state);
        }
    }

    /// Whether what is ours still does what was asked, and nobody else has begun to drive.
    fn look(&mut self, state: &MachineState) {
        let now_on = on(state);
        let ours = self.motion.all_of_ours();
        let begins = |motor: &Number| {
            let index = motor.index();
            now_on[index] && !self.motion.on[index] && !ours.contains(motor)
        };
        let other = Number::all().find(begins).filter(|_| self.motion.is_driving());
        self.motion.on = now_on;
        if let Some(other) = other {
            let why = format!(
                "another host drives motor {other} now, which this page would keep running if that host died: \
                 what this page drove is stopped"
            );
            self.end_all_of_ours(&why);
            self.note(&why);
        }
        for motor in Number::all() {
            let (channel, now) = (&state.channels[motor.index()], self.now);
            // Before it is acknowledged it may not have come yet.
            let ours = self.motion.ours[motor.index()].as_mut().filter(|ours| ours.acknowledged);
            if let Some(Err(why)) = ours.map(|ours| ours.watch.look(channel, now)) {
                self.end(motor, None, &why);
                self.note(&why);
            }
        }
        if let Some(step) = &mut self.motion.step
            && let Some(begun) = step.begun
            && state.channels[step.motor.index()].mode != Mode::Off
        {
            step.course.see(state, self.now.saturating_sub(begun));
        }
    }

    pub(super) fn advance_motion(&mut self) {
        if let Some(step) = &self.motion.step
            && step.begun.is_some_and(|begun| self.now >= begun + step.time)
        {
            self.end_step();
        }
        self.advance_endings();
        self.advance_stop();
        self.advance_job();
    }
}

/// The one target of an object.
fn target(object: &Map<String, Value>) -> Result<Target, String> {
    let keys = ["velocity", "position", "duty"];
    let given: Vec<_> = keys.into_iter().filter(|key| object.contains_key(*key)).collect();
    let [key] = given[..] else {
        return Err("one of velocity, position and duty is wanted".into());
    };
    let most = i64::from(i16::MAX);
    match key {
        "velocity" => Ok(Target::Velocity(number(object, key, -most, most)? as i16)),
        "position" => Ok(Target::Position(number(object, key, 0, most)? as i16)),
        _ => {
            let percent = object.get(key).and_then(Value::as_f64);
            let percent = percent.filter(|percent| (-100.0..=100.0).contains(percent));
            let wanted = "duty: -100 to 100 percent is wanted";
            percent.map(|percent| Target::Duty(percent / 100.0)).ok_or(wanted.into())
        }
    }
}
