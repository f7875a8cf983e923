//! Checking and tuning: a job of [`tune`](crate::tune) between its page and the board.
//!
//! A job runs alone: nothing else is driven from pages and no setting is set meanwhile, since machine states, by which
//! driven motors are watched, do not come while it reads a recording. Its motor counts as ours: what stops a
//! driven motor stops it, at once and by the panel's own stop. Only then does the job go on, to its end in good
//! order: it sets back what it has set.

use std::time::Duration;

use protocol::extension::Recording;
use protocol::pms5005::Command;
use serde_json::{Map, Value, json};

use super::exchanges::Purpose;
use super::found::Found;
use super::message::member;
use super::{Asker, Panel};
use crate::Number;
use crate::session::{Event, Failure, Reply};
use crate::step::Course;
use crate::tune::{self, Ask, Job, Loop, Options, Plan};

/// A job under way. Its page's answer comes at its end.
pub(super) struct Running {
    asker: Asker,
    pub(super) motor: Number,
    /// `check`, `tune` or `step`.
    what: &'static str,
    job: Job<Found>,
    /// Why it was stopped.
    stopped: Option<String>,
    /// What it has asked, without an answer yet.
    asked: Option<Ask>,
    /// That was dropped, and is to be asked again when the stop is over.
    is_dropped: bool,
    /// What it has set so far, each number's newest value last.
    set: Vec<(u16, i32)>,
    /// Nobody knows whether the last of that is in force.
    is_unsure: bool,
    /// What pages were told last.
    told: (&'static str, bool),
}

impl Running {
    /// Whether it drives, and signs of life are due.
    pub(super) fn is_driving(&self) -> bool {
        !self.is_stopped() && self.job.is_driving()
    }

    pub(super) fn is_stopped(&self) -> bool {
        self.stopped.is_some()
    }

    /// What asks for machine states, when the job wants some.
    pub(super) fn renewal(&mut self, now: Duration) -> Option<Command<'static>> {
        self.job.renewal(now)
    }

    fn name(&self) -> String {
        let motor = self.motor;
        match self.what {
            "check" => format!("motor {motor} is being checked"),
            "tune" => format!("motor {motor} is being tuned"),
            _ => format!("what motor {motor} did is being read"),
        }
    }
}

impl Panel {
    /// Begins to check or to tune.
    pub(super) fn begin_job(
        &mut self,
        what: &str,
        asker: Asker,
        object: &Map<String, Value>,
    ) -> Result<(), String> {
        let motor = member(object, "motor")?;
        let duty = duty(object)?;
        let control_loop = control_loop(object)?;
        if !self.has_recorder() {
            return Err(
                "checking and tuning need a board that records and tells its machine state: newer firmware, \
                 or a faster line"
                    .into(),
            );
        }
        self.needs_no_job()?;
        self.needs_list()?;
        if let Some(runs) = self.motion.all_of_ours().first() {
            return Err(format!("motor {runs} still runs: switch it off first"));
        }
        if self.motion.on[motor.index()] {
            return Err(format!(
                "motor {motor} is driven by another host: Stop first, or end that host"
            ));
        }
        let (what, job) = match what {
            "check" => {
                let may_turn = object.get("set_polarity").and_then(Value::as_bool);
                let check = tune::check(motor, duty, may_turn.unwrap_or_default());
                ("check", check.map(Found::Checked))
            }
            _ => {
                let options = Options { motor, control_loop, highest_duty: duty, apply: false };
                ("tune", tune::tune(options).map(|tuned| Found::Tuned(Box::new(tuned))))
            }
        };
        self.tell_others();
        self.run_job(asker, motor, what, job);
        Ok(())
    }

    /// Reads what was recorded of a step that is over.
    pub(super) fn read_step(
        &mut self,
        asker: Asker,
        motor: Number,
        mut course: Course,
        recording: &Recording,
    ) {
        let every = recording.decimation;
        let job = tune::read(recording.serial).map(move |rows| {
            course.take(&rows, every);
            Found::Stepped(Box::new(course))
        });
        self.run_job(asker, motor, "step", job);
    }

    fn run_job(&mut self, asker: Asker, motor: Number, what: &'static str, job: Job<Found>) {
        self.motion.job = Some(Running {
            asker,
            motor,
            what,
            job,
            stopped: None,
            asked: None,
            is_dropped: false,
            set: Vec::new(),
            is_unsure: false,
            told: Default::default(),
        });
    }

    /// Whether the board records, and tells its machine state.
    pub(super) fn has_recorder(&self) -> bool {
        let identity = self.board.identity;
        self.has_state() && identity.is_some_and(|id| id.extension >= tune::RECORDER)
    }

    /// What tuning a motor will do to it at the most.
    pub(super) fn plan_of(&self, object: &Map<String, Value>) -> Result<Value, String> {
        let motor = member(object, "motor")?;
        self.needs_list()?;
        let sensor = self.settings.value_of(&format!("sensor {motor}")).unwrap_or_default();
        Ok(match tune::plan(motor, sensor) {
            Plan::Turns(time) => json!({ "moves": "turns", "seconds": time.as_secs() }),
            Plan::Stays(counts) => json!({ "moves": "stays", "counts": counts }),
        })
    }

    /// Refuses what a job would be disturbed by.
    pub(super) fn needs_no_job(&self) -> Result<(), String> {
        match &self.motion.job {
            None => Ok(()),
            Some(running) => Err(format!("{}: wait for its end, or stop it", running.name())),
        }
    }

    /// It is to end; what stops the motor is sent beside this.
    pub(super) fn stop_job(&mut self, why: &str) {
        if let Some(running) = &mut self.motion.job {
            running.stopped.get_or_insert_with(|| why.to_owned());
            running.job.stop(why);
            self.board.renew = self.now;
        }
    }

    /// The board is gone: what it has set cannot be set back.
    pub(super) fn lose_job(&mut self, why: &str) {
        let Some(running) = self.motion.job.take() else { return };
        let mut set = running.set;
        if let Some(Ask::Set(values)) = running.asked {
            set.extend(values);
        }
        let newest = |number| set.iter().rfind(|(set, _)| *set == number).map(|(_, value)| *value);
        let was = self.settings.list().iter().filter_map(|known| {
            let differs = newest(known.number).is_some_and(|value| value != known.value);
            differs.then(|| format!("{} {}", known.name, known.value))
        });
        let was: Vec<_> = was.collect();
        let left = match was.is_empty() {
            true => String::new(),
            false => format!(
                "; until it restarts it has other settings than before, which were: {}",
                was.join(", ")
            ),
        };
        let motor = running.motor;
        let error = format!("{why}: its own watch over silence stops motor {motor}{left}");
        self.answer(running.asker, Err(error));
        self.tell_job();
    }

    pub(super) fn job_sees(&mut self, event: &Event) {
        if let Some(running) = &mut self.motion.job {
            running.job.see(event);
        }
    }

    pub(super) fn job_is_answered(&mut self, result: Result<Reply, Failure>) {
        let Some(running) = &mut self.motion.job else { return };
        if let Some(Ask::Set(values)) = running.asked.take() {
            match result {
                Ok(_) => {
                    running.set.extend(values);
                    running.is_unsure = false;
                }
                Err(Failure::NoAnswer) => running.is_unsure = true,
                Err(_) => {}
            }
        }
        running.job.answer(result);
    }

    /// A stop came first. What is to be set may be what was before, and is said again; nothing else is.
    pub(super) fn job_is_dropped(&mut self) {
        let Some(running) = &mut self.motion.job else { return };
        match running.asked {
            Some(Ask::Set(_)) => running.is_dropped = true,
            _ => self.job_is_answered(Err(Failure::NoAnswer)),
        }
    }

    pub(super) fn advance_job(&mut self) {
        let is_stopping = self.motion.stop.is_some();
        let Some(running) = &mut self.motion.job else { return };
        if is_stopping || self.motion.ending[running.motor.index()].is_some() {
            return;
        }
        let ask = match std::mem::take(&mut running.is_dropped) {
            true => running.asked.take(),
            false => running.job.advance(self.now),
        };
        let outcome = running.job.outcome();
        let tells = (running.job.doing(), running.job.watches());
        let has_news = running.told != tells;
        running.told = tells;
        running.asked = ask.clone().or(running.asked.take());
        if let Some(ask) = ask {
            self.queue(Purpose::Job, |session, now| ask.begin(session, now));
        }
        if let Some(outcome) = outcome {
            self.end_job(outcome);
        } else if has_news {
            self.tell_job();
        }
        self.live();
    }

    fn end_job(&mut self, outcome: Result<Found, tune::Refused>) {
        let Some(running) = self.motion.job.take() else { return };
        let motor = running.motor;
        let result = match outcome {
            Ok(found) => found.json(motor, self.settings.list()),
            Err(refused) => {
                // A stop that was not acknowledged is told of, and gone on with.
                if !running.is_stopped() {
                    self.end(motor, None, "");
                }
                let why = running.stopped.map(|why| format!("stopped before its end: {why}"));
                Err(why.unwrap_or_else(|| refused.to_string()))
            }
        };
        let differs = self.settings.put_values(&running.set);
        self.settings.unsaved |= differs || running.is_unsure;
        if running.is_unsure || self.settings.is_reading() {
            self.read_settings();
        }
        let left = match () {
            () if running.is_unsure => {
                "; whether its settings are as before is not known: see what is in force"
            }
            () if differs => "; some of its settings are not as before: see what is in force",
            () => "",
        };
        self.tell_settings();
        self.board.renew = self.now;
        self.tell_job();
        self.answer(running.asker, result.map_err(|why| format!("{why}{left}")));
    }

    pub(super) fn job_json(&self) -> Value {
        let running = self.motion.job.as_ref();
        json!({
            "tell": "job", "motor": running.map(|running| running.motor.index() + 1),
            "what": running.map(|running| running.what),
            "doing": running.map(|running| running.job.doing()),
            "has_state": running.is_none_or(|running| running.job.watches()),
        })
    }

    fn tell_job(&mut self) {
        let job = self.job_json();
        self.tell(&job);
    }
}

/// The highest duty of an object, 0 to 1.
fn duty(object: &Map<String, Value>) -> Result<f64, String> {
    let Some(value) = object.get("duty") else { return Ok(Options::HIGHEST_DUTY) };
    let percent = value.as_f64().filter(|percent| (1.0..=100.0).contains(percent));
    percent.map(|percent| percent / 100.0).ok_or("duty: 1 to 100 percent is wanted".into())
}

/// The loop of an object, if it names one.
fn control_loop(object: &Map<String, Value>) -> Result<Option<Loop>, String> {
    match object.get("loop").map(Value::as_str) {
        None => Ok(None),
        Some(Some("velocity")) => Ok(Some(Loop::Velocity)),
        Some(Some("position")) => Ok(Some(Loop::Position)),
        Some(_) => Err("loop: velocity or position is wanted".into()),
    }
}
