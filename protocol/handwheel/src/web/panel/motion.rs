//! Arming, driving and stopping.

use std::time::Duration;

use protocol::arcos::{ArmCommand, Joints, Packet};
use protocol::extension::{Action, MachineState, Mode, Request};
use protocol::pms5005::{CHANNELS, Command, LcdFrame, Scope};
use serde_json::{Map, Value, json};

use super::{ALIVE, Asker, PageId, Panel, Purpose, member, number};
use crate::Number;
use crate::client::{Target, on};
use crate::motion::shafts::{STILL, Shafts, is_off};
use crate::motion::target::{self, NEUTRAL_ALL, SUSPEND};
use crate::motion::watch::Watch;
use crate::session::{Event, Personality, sign_of_life};
use crate::step::Course;

/// How long a stop waits for the shafts, and for how long it is repeated while another host drives on.
const STAND: Duration = Duration::from_secs(1);
const REPEAT: Duration = Duration::from_secs(3);
/// After which silence an armed page that drives nothing is disarmed.
const ABSENT: Duration = Duration::from_secs(3);

/// What moves, and for whom.
#[derive(Default)]
pub(super) struct Motion {
    /// The page that is armed, and when it was heard last.
    armed: Option<(PageId, Duration)>,
    ours: [Option<Watch>; CHANNELS],
    ending: [Option<Ending>; CHANNELS],
    /// The channels that were on in the last machine state.
    on: [bool; CHANNELS],
    shafts: Shafts,
    stop: Option<Stop>,
    step: Option<Step>,
    /// Signs of life are sent.
    lives: bool,
}

/// A motor that was ours and is being stopped: without drive until it stands, then off.
struct Ending {
    asker: Option<Asker>,
    begun: Duration,
    is_neutral: bool,
    is_suspended: bool,
}

/// A stop of everything.
struct Stop {
    askers: Vec<Asker>,
    begun: Duration,
    /// Acknowledgements that are missing, and when the last one came.
    missing: u8,
    acknowledged: Duration,
    shafts: Shafts,
    is_opposed: bool,
}

struct Step {
    asker: Asker,
    motor: Number,
    time: Duration,
    /// When it was acknowledged.
    begun: Option<Duration>,
    course: Course,
}

impl Motion {
    pub(super) fn armed_page(&self) -> Option<PageId> {
        self.armed.map(|(page, _)| page)
    }

    /// Whether a motor is driven from a page.
    pub(super) fn is_ours(&self, motor: Number) -> bool {
        self.ours[motor.index()].is_some()
    }

    /// Whether nothing is driven or being stopped.
    pub(super) fn is_at_rest(&self) -> bool {
        !self.is_driving() && self.ending.iter().all(Option::is_none) && self.stop.is_none()
    }

    fn is_driving(&self) -> bool {
        self.ours.iter().any(Option::is_some)
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
            return Err(format!("{} can be seen and stopped from here, not driven", self.title()));
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
            self.end_all_of_ours();
            self.motion.armed = None;
            self.tell_armed();
            if was_driving {
                self.note(&format!("{why}: what it drove is stopped"));
            }
        }
    }

    /// A page that is not heard any more is disarmed.
    pub(super) fn watch_pages(&mut self) {
        let limit = if self.motion.is_driving() { ALIVE } else { ABSENT };
        if let Some((page, heard)) = self.motion.armed
            && self.now > heard + limit
        {
            self.disarm_if(page, "its page did not answer");
        }
    }

    /// What an armed page asks for, but settings.
    pub(super) fn act(
        &mut self,
        what: &str,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        self.alive(asker.0);
        match what {
            "drive" => {
                let motor = member(object, "motor")?;
                let ramp = ms(object, "ms", 0, i64::from(u16::MAX))?;
                self.begin(motor, target(object)?, ramp, asker)?;
            }
            "off" => {
                let motor = member(object, "motor")?;
                self.end(motor, Some(asker));
            }
            "step" => self.step(asker, object)?,
            "servo" => {
                let servo = member(object, "servo")?;
                if object.get("us").is_some_and(Value::is_null) {
                    let off = Command::Run { scope: Scope::Servo(servo.channel()), run: false };
                    self.command(&off, Purpose::Page(asker, "servos"));
                    return Ok(());
                }
                let pulse = object.get("us").and_then(Value::as_f64);
                let pulse = pulse.ok_or("us: a pulse in microseconds is wanted")?;
                let time = ms(object, "ms", 0, i64::from(u16::MAX))?;
                let command =
                    target::servo(servo, pulse, time).map_err(|error| error.to_string())?;
                self.command(&command, Purpose::Page(asker, "servos"));
            }
            "gpio" => {
                let outputs = number(object, "outputs", 0, 255)? as u8;
                self.tells.gpio = Some(outputs);
                self.command(&Command::GpioOutputs(outputs), Purpose::Page(asker, "GPIO"));
                self.tell_outputs();
            }
            "lcd" => self.show(asker, object)?,
            "zero" => {
                let motor = member(object, "motor")?;
                let request = Request::SetCount { channel: motor.channel().number(), count: 0 };
                self.ask(&request, Purpose::Page(asker, "a new count"));
            }
            "clear" if object.contains_key("motor") => {
                let motor = member(object, "motor")?;
                // A resume of a motor that is only paused would move it.
                if !self.board.has_fault(motor) {
                    return Err(format!("motor {motor} has no fault on record"));
                }
                let resume = Command::Run { scope: Scope::Motor(motor.channel()), run: true };
                self.command(&resume, Purpose::Page(asker, "a clearing of its faults"));
                self.board.look_soon(self.now);
            }
            "clear" => {
                let what = "a clearing of its faults";
                self.ask(&Request::Do(Action::ClearFaults), Purpose::Page(asker, what));
                self.board.look_soon(self.now);
            }
            other => return Err(format!("{other}: nothing of this name can be done")),
        }
        Ok(())
    }

    fn begin(
        &mut self,
        motor: Number,
        target: Target,
        ramp: Duration,
        asker: Asker,
    ) -> Result<(), String> {
        let index = motor.index();
        if self.motion.stop.is_some() {
            return Err("a stop is under way".into());
        }
        if self.motion.step.as_ref().is_some_and(|step| step.motor == motor && step.asker != asker)
        {
            return Err(format!("motor {motor} makes a step: wait for its end, or stop it"));
        }
        let was_ours = self.motion.ours[index].is_some() || self.motion.ending[index].is_some();
        if self.motion.on[index] && !was_ours {
            return Err(format!(
                "motor {motor} is driven by another host: Stop first, or end that host"
            ));
        }
        if let Some(Ending { asker: Some(asker), .. }) = self.motion.ending[index].take() {
            self.answer(asker, Err("it is driven again".into()));
        }
        self.motion.ours[index] = Some(Watch::new(motor, target, ramp, self.now));
        self.live();
        self.command(&target.command(motor, ramp), Purpose::Drive(motor, asker));
        Ok(())
    }

    /// What came of a motion command.
    pub(super) fn driven(&mut self, motor: Number, asker: Asker, result: Result<(), String>) {
        let Some(watch) = &mut self.motion.ours[motor.index()] else {
            return self.answer(asker, Err("it was stopped meanwhile".into()));
        };
        watch.begins(self.now);
        match result {
            Err(error) => {
                self.end(motor, None);
                self.give_up_step(motor, &error);
                self.answer(asker, Err(error));
            }
            Ok(()) => match &mut self.motion.step {
                // Its answer comes at its end.
                Some(step) if step.asker == asker => step.begun = Some(self.now),
                _ => self.answer(asker, Ok(Value::Null)),
            },
        }
    }

    fn step(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        let motor = member(object, "motor")?;
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
        if self.motion.is_ours(motor) || self.motion.ending[motor.index()].is_some() {
            return Err(format!("motor {motor} still runs: a step begins at rest, switch it off"));
        }
        if !self.has_state() {
            return Err("this board tells no machine state to sample".into());
        }
        let course = Course::new(motor, target);
        self.motion.step = Some(Step { asker, motor, time, begun: None, course });
        let begun = self.begin(motor, target, Duration::ZERO, asker);
        if begun.is_err() {
            self.motion.step = None;
        }
        begun
    }

    fn give_up_step(&mut self, motor: Number, why: &str) {
        if let Some(step) = self.motion.step.take_if(|step| step.motor == motor) {
            self.answer(step.asker, Err(why.to_owned()));
        }
    }

    /// Stops one motor, if anybody drives it.
    fn end(&mut self, motor: Number, asker: Option<Asker>) {
        let index = motor.index();
        self.motion.ours[index] = None;
        // A command that is repeated would drive it again.
        let drives = |purpose: &Purpose| matches!(purpose, Purpose::Drive(of, _) if *of == motor);
        if self.purposes.iter().any(drives) {
            self.forget("it was stopped");
            let others: Vec<_> =
                Number::all().filter(|n| self.motion.ending[n.index()].is_some()).collect();
            others.into_iter().for_each(|other| self.send_end(other));
        }
        let before = self.motion.ending[index].take();
        for old in [before.and_then(|ending| ending.asker)].into_iter().flatten() {
            self.answer(old, Ok(Value::Null));
        }
        let (begun, is_neutral, is_suspended) = (self.now, false, false);
        self.motion.ending[index] = Some(Ending { asker, begun, is_neutral, is_suspended });
        self.send_end(motor);
        self.live();
    }

    /// At once, and then until it is acknowledged.
    fn send_end(&mut self, motor: Number) {
        if let Some(ending) = &mut self.motion.ending[motor.index()] {
            (ending.is_neutral, ending.is_suspended) = (false, false);
        }
        self.session.send(&target::neutral(motor));
        self.command(&target::neutral(motor), Purpose::End(motor));
    }

    pub(super) fn end_is_heard(&mut self, motor: Number, result: Result<(), String>) {
        let Some(ending) = &mut self.motion.ending[motor.index()] else { return };
        let is_over = match &result {
            Ok(()) if !ending.is_neutral => {
                ending.is_neutral = true;
                false
            }
            Ok(()) => ending.is_suspended,
            Err(_) => true,
        };
        if is_over {
            let asker = self.motion.ending[motor.index()].take().and_then(|ending| ending.asker);
            let result = result.map_err(|error| {
                format!(
                    "the stop of motor {motor} is NOT confirmed; cut the motors' supply: {error}"
                )
            });
            match (asker, result) {
                (Some(asker), result) => self.answer(asker, result.map(|()| Value::Null)),
                (None, Err(error)) => self.note(&error),
                (None, Ok(())) => {}
            }
        }
    }

    fn end_all_of_ours(&mut self) {
        let ours: Vec<_> = Number::all().filter(|motor| self.motion.is_ours(*motor)).collect();
        for motor in ours {
            self.end(motor, None);
            self.give_up_step(motor, "it was stopped");
        }
    }

    /// Signs of life while something is ours.
    fn live(&mut self) {
        let lives = self.motion.is_driving();
        if lives != self.motion.lives {
            self.motion.lives = lives;
            let period = lives.then(|| sign_of_life(self.board.link_timeout));
            self.session.drive(period, self.now);
        }
    }

    /// Stops everything, from any page.
    pub(super) fn stop(&mut self, asker: Asker) -> Result<(), String> {
        if !self.is_connected() {
            self.send_stop();
            self.needs_a_board().map_err(|error| {
                format!("the stop is NOT confirmed; cut the motors' supply: {error}")
            })?;
        }
        let steps = self.motion.step.take();
        let endings = std::mem::take(&mut self.motion.ending);
        self.motion.ours = Default::default();
        self.forget("a stop came first");
        self.live();
        if let Some(step) = steps.filter(|step| step.begun.is_some()) {
            self.answer(step.asker, Err("a stop came first".into()));
        }
        for ended in endings.into_iter().flatten().filter_map(|ending| ending.asker) {
            self.answer(ended, Ok(Value::Null));
        }
        let mut stop = self.motion.stop.take().unwrap_or(Stop {
            askers: Vec::new(),
            begun: self.now,
            missing: 0,
            acknowledged: self.now,
            shafts: Shafts::default(),
            is_opposed: false,
        });
        stop.askers.push(asker);
        match self.personality() {
            Personality::Pms5005 => {}
            Personality::Arcos => {
                stop.missing = 0;
                self.motion.stop = Some(stop);
                self.send_stop_of_arm();
                return Ok(());
            }
            Personality::Cm5 => {
                return Err("a CM-5 has no stop: switch its servos' supply off".into());
            }
        }
        self.motion.stop = Some(stop);
        self.send_all_off();
        Ok(())
    }

    /// Without waiting for anybody.
    fn send_stop(&mut self) {
        for command in [SUSPEND, NEUTRAL_ALL, SUSPEND] {
            self.session.send(&command);
        }
    }

    /// Off at once, and then without a move that a resume would go on with.
    fn send_all_off(&mut self) {
        if let Some(stop) = &mut self.motion.stop {
            stop.missing = 2;
            stop.shafts = Shafts::default();
        }
        self.session.send(&SUSPEND);
        self.command(&NEUTRAL_ALL, Purpose::Stop);
        self.command(&SUSPEND, Purpose::Stop);
    }

    fn send_stop_of_arm(&mut self) {
        let mut buffer = [0; 16];
        if let Ok(bytes) = ArmCommand::Stop(Joints::All).encode(&mut buffer)
            && let Some(packet) = Packet::parse(bytes)
        {
            // It has no acknowledgement; the joints tell.
            let _ = self.session.packet(&packet, None, self.now);
        }
    }

    pub(super) fn stop_is_heard(&mut self, result: Result<(), String>) {
        let Some(stop) = &mut self.motion.stop else { return };
        match result {
            Ok(()) => {
                stop.missing = stop.missing.saturating_sub(1);
                stop.acknowledged = self.now;
            }
            Err(error) => {
                let askers = std::mem::take(&mut stop.askers);
                self.motion.stop = None;
                let error = format!(
                    "the stop was sent and is NOT confirmed; cut the motors' supply: {error}"
                );
                askers.into_iter().for_each(|asker| self.answer(asker, Err(error.clone())));
            }
        }
    }

    fn stop_is_over(&mut self, confirmed: bool, stands: Option<bool>) {
        let Some(stop) = self.motion.stop.take() else { return };
        let opposed = stop.is_opposed;
        if opposed {
            self.note("another host drives on: end that host");
        }
        let told = json!({ "confirmed": confirmed, "stands": stands, "opposed": opposed });
        stop.askers.into_iter().for_each(|asker| self.answer(asker, Ok(told.clone())));
    }

    /// An arm has told whether a joint moves.
    pub(super) fn arm_moves(&mut self, moves: bool) {
        if let Some(stop) = &self.motion.stop
            && (!moves || self.now >= stop.begun + STAND)
        {
            self.stop_is_over(!moves, Some(!moves));
        }
    }

    /// Telemetry and machine states tell of shafts.
    pub(super) fn see(&mut self, event: &Event) {
        self.motion.shafts.see(event, self.now);
        if let Some(stop) = &mut self.motion.stop
            && stop.missing == 0
        {
            stop.shafts.see(event, self.now);
            // What is older than the stop counts for nothing.
            if self.now < stop.acknowledged + STILL {
                stop.shafts.was_driven = false;
            }
        }
        if let Event::State(state) = event {
            self.look(state);
        }
    }

    /// Whether what is ours still does what was asked, and nobody else has begun to drive.
    fn look(&mut self, state: &MachineState) {
        let now_on = on(state);
        let others_begin = Number::all().find(|motor| {
            let index = motor.index();
            let is_new = now_on[index] && !self.motion.on[index];
            is_new && !self.motion.is_ours(*motor) && self.motion.ending[index].is_none()
        });
        self.motion.on = now_on;
        if let Some(other) = others_begin.filter(|_| self.motion.is_driving()) {
            self.end_all_of_ours();
            self.note(&format!(
                "another host drives motor {other} now, which this page would keep running if that host died: \
                 what this page drove is stopped"
            ));
        }
        for motor in Number::all() {
            let channel = &state.channels[motor.index()];
            let now = self.now;
            let Some(watch) = &mut self.motion.ours[motor.index()] else { continue };
            if let Err(why) = watch.look(channel, now) {
                self.end(motor, None);
                self.give_up_step(motor, &why);
                self.note(&why);
            }
        }
        if let Some(step) = &mut self.motion.step
            && let Some(begun) = step.begun
            && state.channels[step.motor.index()].mode != Mode::Off
        {
            step.course.see(state, self.now - begun);
        }
    }

    pub(super) fn advance_motion(&mut self) {
        if let Some(step) = &self.motion.step
            && step.begun.is_some_and(|begun| self.now >= begun + step.time)
        {
            self.end_step();
        }
        for motor in Number::all() {
            let stands = self.motion.shafts.stand(&[motor], self.now) == Some(true);
            if let Some(ending) = &mut self.motion.ending[motor.index()]
                && ending.is_neutral
                && !ending.is_suspended
                && (stands || self.now >= ending.begun + STAND)
            {
                ending.is_suspended = true;
                self.command(&target::suspend(motor), Purpose::End(motor));
            }
        }
        self.advance_stop();
    }

    fn advance_stop(&mut self) {
        let is_arm = self.personality() == Personality::Arcos;
        let Some(stop) = &mut self.motion.stop else { return };
        if stop.missing > 0 || is_arm {
            return;
        }
        if !self.board.has_state() {
            return self.stop_is_over(true, None);
        }
        let all: Vec<_> = Number::all().collect();
        let stands = stop.shafts.stand(&all, self.now);
        let is_late = self.now >= stop.acknowledged + STAND;
        if stop.shafts.was_driven {
            stop.is_opposed = true;
            if self.now < stop.begun + REPEAT {
                return self.send_all_off();
            }
            self.stop_is_over(false, stands);
        } else if stands == Some(true) || is_late {
            let is_off = stop.shafts.state.is_some_and(|state| is_off(&state));
            let confirmed = is_off && !stop.is_opposed;
            self.stop_is_over(confirmed, stands);
        }
    }

    fn end_step(&mut self) {
        let Some(step) = self.motion.step.take() else { return };
        self.end(step.motor, None);
        let result = step.course.response().map_err(|error| error.to_string());
        let ms = |time: Option<Duration>| time.map(|time| time.as_millis() as u64);
        let told = result.map(|(found, aim)| {
            json!({
                "motor": step.motor.index() + 1, "unit": step.course.unit(), "target": aim,
                "samples": step.course.list(), "rise_ms": ms(found.rise),
                "overshoot_percent": found.overshoot_percent, "settling_ms": ms(found.settling),
                "steady_error": found.steady_error, "why": step.course.why,
            })
        });
        self.answer(step.asker, told);
    }

    fn show(&mut self, asker: Asker, object: &Map<String, Value>) -> Result<(), String> {
        let text = super::text(object, "image")?;
        let wanted = || format!("image: {} hex digits are wanted", 2 * 16 * LcdFrame::COLUMNS);
        let digits = text.as_bytes();
        let bytes: Option<Vec<u8>> = digits
            .chunks(2)
            .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok())
            .collect();
        let bytes = bytes.filter(|bytes| digits.len() == 2 * bytes.len()).ok_or_else(wanted)?;
        let parts: Vec<_> = bytes.as_chunks::<{ LcdFrame::COLUMNS }>().0.to_vec();
        if bytes.len() != 16 * LcdFrame::COLUMNS {
            return Err(wanted());
        }
        self.tells.lcd = Some(text.to_lowercase());
        for (number, columns) in (0u8..).zip(&parts) {
            // The last one's answer is the page's.
            let asker = if number == 15 { asker } else { Asker(asker.0, None) };
            let command = Command::Lcd(LcdFrame { number, columns });
            self.command(&command, Purpose::Page(asker, "LCD"));
        }
        self.tell_outputs();
        Ok(())
    }
}

/// A time of an object, 0 without one.
fn ms(object: &Map<String, Value>, key: &str, low: i64, high: i64) -> Result<Duration, String> {
    match object.get(key) {
        None | Some(Value::Null) => Ok(Duration::ZERO),
        Some(_) => {
            let ms = number(object, key, low, high)?;
            Ok(Duration::from_millis(ms.unsigned_abs()))
        }
    }
}

/// The one target of an object.
fn target(object: &Map<String, Value>) -> Result<Target, String> {
    const WANTED: &str = "one of velocity, position and duty is wanted";
    let given: Vec<_> = ["velocity", "position", "duty"]
        .into_iter()
        .filter(|key| object.contains_key(*key))
        .collect();
    let [key] = given[..] else { return Err(WANTED.into()) };
    match key {
        "velocity" => {
            let most = i64::from(i16::MAX);
            Ok(Target::Velocity(number(object, key, -most, most)? as i16))
        }
        "position" => Ok(Target::Position(number(object, key, 0, i64::from(i16::MAX))? as i16)),
        _ => {
            let percent = object.get(key).and_then(Value::as_f64);
            let percent = percent.filter(|percent| (-100.0..=100.0).contains(percent));
            percent
                .map(|percent| Target::Duty(percent / 100.0))
                .ok_or_else(|| "duty: -100 to 100 percent is wanted".into())
        }
    }
}
