//! Stopping: one motor, everything, and what is said of it.
//!
//! Acknowledgements carry no number, so that one of before may be taken for a stop's: where the board tells its
//! state, a stop is over when that shows it.

use std::time::Duration;

use protocol::arcos::{ArmCommand, Joints};
use protocol::extension::Mode;
use serde_json::{Value, json};

use super::exchanges::Purpose;
use super::{Asker, Panel};
use crate::Number;
use crate::error::Error;
use crate::motion::shafts::{STAND, STILL, Shafts};
use crate::motion::target::{self, NEUTRAL_ALL, REPEAT, SUSPEND};
use crate::session::{Event, Personality};
use crate::state::is_off;

/// A motor that was ours and is being stopped: without drive until it stands, then off.
pub(super) struct Ending {
    pub(super) askers: Vec<Asker>,
    begun: Duration,
    phase: Phase,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// A neutral PWM was sent.
    Neutral,
    /// It was acknowledged: the shaft comes to rest.
    Resting,
    /// A suspension was sent.
    Suspended,
    /// It was acknowledged then: the state is to show it.
    Shown(Duration),
}

/// A stop of everything.
pub(super) struct Stop {
    askers: Vec<Asker>,
    begun: Duration,
    /// Acknowledgements that are missing, and when the last one came.
    missing: u8,
    acknowledged: Duration,
    shafts: Shafts,
    is_opposed: bool,
}

impl Stop {
    pub(super) fn see(&mut self, event: &Event, now: Duration) {
        if self.missing == 0 {
            self.shafts.see(event, now);
            // What is older than the stop counts for nothing.
            if now < self.acknowledged + STILL {
                self.shafts.was_driven = false;
            }
        }
    }
}

impl Panel {
    /// Stops one motor, whoever drives it, and says why to who waits for it.
    pub(super) fn end(&mut self, motor: Number, asker: Option<Asker>, why: &str) {
        let index = motor.index();
        self.motion.ours[index] = None;
        // A command that is repeated would drive it again.
        self.withdraw(|purpose| matches!(purpose, Purpose::Drive(of, ..) if *of == motor), why);
        self.give_up_step(motor, why);
        if self.motion.job.as_ref().is_some_and(|running| running.motor == motor) {
            self.withdraw(|purpose| matches!(purpose, Purpose::Job), why);
            self.stop_job(why);
        }
        let mut askers =
            self.motion.ending[index].take().map_or(Vec::new(), |ending| ending.askers);
        askers.extend(asker);
        let ending = Ending { askers, begun: self.now, phase: Phase::Neutral };
        self.motion.ending[index] = Some(ending);
        self.send_neutral(motor);
        self.live();
    }

    pub(super) fn end_all_of_ours(&mut self, why: &str) {
        let ours: Vec<_> = Number::all().filter(|motor| self.motion.is_ours(*motor)).collect();
        ours.into_iter().for_each(|motor| self.end(motor, None, why));
    }

    /// At once, and then until it is acknowledged.
    fn send_neutral(&mut self, motor: Number) {
        self.withdraw(|purpose| matches!(purpose, Purpose::End(of) if *of == motor), "");
        self.session.send(&target::neutral(motor));
        self.command(&target::neutral(motor), Purpose::End(motor));
    }

    pub(super) fn end_is_heard(&mut self, motor: Number, result: Result<(), Error>) {
        let Some(ending) = &mut self.motion.ending[motor.index()] else { return };
        match (result, ending.phase) {
            (Ok(()), Phase::Neutral) => ending.phase = Phase::Resting,
            (Ok(()), Phase::Suspended) => ending.phase = Phase::Shown(self.now),
            (Ok(()), _) => {}
            (Err(error), _) => self.end_is_over(motor, Err(error)),
        }
    }

    fn end_is_over(&mut self, motor: Number, result: Result<(), Error>) {
        let Some(ending) = self.motion.ending[motor.index()].take() else { return };
        let result = result.map(|()| Value::Null);
        let result = result.map_err(|error| format!("motor {motor}: {}", error.of_a_stop()));
        if let Err(error) = &result {
            // Signs of life for others would keep it running.
            self.end_all_of_ours(error);
            self.note(error);
        }
        self.answer_all(ending.askers, &result);
    }

    pub(super) fn advance_endings(&mut self) {
        for motor in Number::all() {
            let index = motor.index();
            let stands = self.motion.shafts.stand(&[motor], self.now) == Some(true);
            let is_off = match self.has_state() {
                true => self.tells.state.map(|state| state.channels[index].mode == Mode::Off),
                false => Some(true),
            };
            let Some(ending) = &mut self.motion.ending[index] else { continue };
            match ending.phase {
                Phase::Neutral | Phase::Suspended => {}
                Phase::Resting if stands || self.now >= ending.begun + STAND => {
                    ending.phase = Phase::Suspended;
                    self.command(&target::suspend(motor), Purpose::End(motor));
                }
                Phase::Resting => {}
                Phase::Shown(_) if is_off == Some(true) => self.end_is_over(motor, Ok(())),
                Phase::Shown(_) if self.now >= ending.begun + REPEAT => {
                    self.end_is_over(motor, Err(Error::NoAnswer("a stop")));
                }
                // Another host may have driven it, or an answer was an older one's.
                Phase::Shown(since) if self.now >= since + STILL => {
                    ending.phase = Phase::Neutral;
                    self.send_neutral(motor);
                }
                Phase::Shown(_) => {}
            }
        }
    }

    /// Stops everything, from any page.
    pub(super) fn stop(&mut self, asker: Asker) -> Result<(), String> {
        self.disarm_others(asker.0);
        if !self.is_connected() {
            self.send_stop();
            let unknown = |why: String| Error::NoBoard(why).of_a_stop().to_string();
            return self.needs_a_board().map_err(unknown);
        }
        if self.personality() == Personality::Cm5 {
            return Err("a CM-5 has no stop: switch its servos' supply off".into());
        }
        self.forget("a stop came first");
        self.drop_motion(&Ok(Value::Null));
        let mut askers = self.motion.stop.take().map_or(Vec::new(), |stop| stop.askers);
        askers.push(asker);
        let stop = Stop {
            askers,
            begun: self.now,
            missing: 0,
            acknowledged: self.now,
            shafts: Shafts::default(),
            is_opposed: false,
        };
        self.motion.stop = Some(stop);
        match self.personality() {
            // It has no acknowledgement; the joints tell.
            Personality::Arcos => {
                let _ = self.session.arm(ArmCommand::Stop(Joints::All), None, self.now);
            }
            _ => self.send_all_off(),
        }
        Ok(())
    }

    /// Ends all that is ours without a word to the board, and says why to who waits.
    pub(super) fn drop_motion(&mut self, result: &Result<Value, String>) {
        let ours = self.motion.ours.iter_mut().map(Option::take);
        ours.for_each(drop);
        if let Some(motor) = self.motion.step.as_ref().map(|step| step.motor) {
            self.give_up_step(motor, "a stop came first");
        }
        self.stop_job("a stop came first");
        let endings: Vec<_> = self.motion.ending.iter_mut().filter_map(Option::take).collect();
        endings.into_iter().for_each(|ending| self.answer_all(ending.askers, result));
        self.live();
    }

    /// The board is gone: nobody knows what became of what was being stopped.
    pub(super) fn lose_motion(&mut self, why: &str) {
        let unknown = Err(Error::NoBoard(why.to_owned()).of_a_stop().to_string());
        self.drop_motion(&unknown);
        self.lose_job(why);
        if let Some(stop) = self.motion.stop.take() {
            self.answer_all(stop.askers, &unknown);
        }
    }

    /// Without waiting for anybody.
    pub(super) fn send_stop(&mut self) {
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

    pub(super) fn stop_is_heard(&mut self, result: Result<(), Error>) {
        let Some(stop) = &mut self.motion.stop else { return };
        match result {
            Ok(()) => {
                stop.missing = stop.missing.saturating_sub(1);
                stop.acknowledged = self.now;
            }
            Err(error) => {
                let askers = std::mem::take(&mut stop.askers);
                self.motion.stop = None;
                self.answer_all(askers, &Err(error.of_a_stop().to_string()));
            }
        }
    }

    fn stop_is_over(&mut self, confirmed: bool, stands: Option<bool>) {
        let Some(stop) = self.motion.stop.take() else { return };
        if stop.is_opposed {
            self.note("another host drives on: end that host");
        }
        let told = json!({ "confirmed": confirmed, "stands": stands, "opposed": stop.is_opposed });
        self.answer_all(stop.askers, &Ok(told));
    }

    /// An arm has told whether a joint moves.
    pub(super) fn arm_moves(&mut self, moves: bool) {
        if !moves && self.motion.stop.is_some() {
            self.stop_is_over(true, Some(true));
        }
    }

    pub(super) fn advance_stop(&mut self) {
        let has_state = self.has_state();
        let is_arm = self.personality() == Personality::Arcos;
        let Some(stop) = &mut self.motion.stop else { return };
        let is_late = self.now >= stop.acknowledged + STAND;
        if is_arm {
            if is_late {
                self.stop_is_over(false, None);
            }
            return;
        }
        if stop.missing > 0 {
            return;
        }
        if !has_state {
            return self.stop_is_over(true, None);
        }
        let all: Vec<_> = Number::all().collect();
        let stands = stop.shafts.stand(&all, self.now);
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
}
