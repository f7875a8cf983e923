//! What stops everything, and how it is known that a shaft stands.

use std::time::Duration;

use super::{Client, TICK};
use crate::error::Error;
use crate::motion::shafts::{STAND, STILL, Shafts};
use crate::motion::target::{NEUTRAL_ALL, REPEAT, SUSPEND};
use crate::number::Number;
use crate::session::Personality;
use crate::state::is_off;

/// How a stop came out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stopped {
    /// Whether the shaft, or all of them, stands; `None` if the board does not tell.
    pub stands: Option<bool>,
    /// Whether the board has confirmed the stop: acknowledged, and nothing has driven since.
    pub confirmed: bool,
    /// Whether something was driven again after a stop that was acknowledged: another host commands.
    pub is_opposed: bool,
    /// How long it took, or was waited for.
    pub after: Duration,
    /// Where the shaft is, in counts, and how far it has turned since the drive began.
    pub position: Option<(i32, i32)>,
}

impl Client {
    /// Stops everything at once: motors and servos off, joints of an arm where they are. Only a new motion
    /// command moves anything again.
    ///
    /// # Errors
    /// [`Error::NotConfirmed`] when it was not acknowledged; [`Error::NotCarried`].
    pub fn stop(&mut self) -> Result<Stopped, Error> {
        self.stop_all().map_err(Error::of_a_stop)
    }

    fn stop_all(&mut self) -> Result<Stopped, Error> {
        let begun = self.now();
        self.session.drive(None, begun);
        self.session.forget();
        if self.personality() == Personality::Arcos {
            let mut stands = self.stop_arm()?;
            while !stands && self.now() < begun + STAND {
                stands = self.arm_status()?.moving == [false; 6];
            }
            return Ok(Stopped {
                stands: Some(stands),
                confirmed: stands,
                is_opposed: false,
                after: self.now() - begun,
                position: None,
            });
        }
        self.needs_a_pms5005("motors to be stopped")?;
        let all: Vec<_> = Number::all().collect();
        let mut stopped = Stopped {
            stands: None,
            confirmed: false,
            is_opposed: false,
            after: Duration::ZERO,
            position: None,
        };
        loop {
            // Off at once, and then without a move that a resume would go on with.
            self.session.send(&SUSPEND);
            self.command(&NEUTRAL_ALL, "a stop")?;
            self.command(&SUSPEND, "a stop")?;
            let mut shafts = Shafts::default();
            if !self.has_state() {
                stopped.confirmed = true;
                break;
            }
            let is_over =
                |shafts: &Shafts, now| shafts.was_driven || shafts.stand(&all, now) == Some(true);
            self.watch_until(&mut shafts, is_over, begun + STAND)?;
            stopped.stands = shafts.stand(&all, self.now());
            stopped.is_opposed |= shafts.was_driven;
            let holds = !shafts.was_driven && shafts.state.is_some_and(|state| is_off(&state));
            stopped.confirmed = holds && !stopped.is_opposed;
            if holds || self.now() >= begun + REPEAT {
                break;
            }
        }
        stopped.after = self.now() - begun;
        Ok(stopped)
    }

    /// Sends a PMS5005's stop, and does not wait.
    pub(super) fn stop_unheard(&mut self) -> Result<(), Error> {
        for command in [SUSPEND, NEUTRAL_ALL, SUSPEND] {
            self.session.send(&command);
        }
        self.pump(Duration::ZERO)
    }

    /// Watches until these shafts stand, or until `end`.
    pub(super) fn wait_until_it_stands(
        &mut self,
        shafts: &mut Shafts,
        motors: &[Number],
        end: Duration,
    ) -> Result<(), Error> {
        self.watch_until(shafts, |shafts, now| shafts.stand(motors, now) == Some(true), end)
    }

    /// Watches until it is over, or until `end`.
    fn watch_until(
        &mut self,
        shafts: &mut Shafts,
        is_over: impl Fn(&Shafts, Duration) -> bool,
        end: Duration,
    ) -> Result<(), Error> {
        let has_state = self.has_state();
        // What was heard before the stop counts for nothing; enough is heard behind it, however late it is.
        let from = self.now() + STILL;
        let end = end.max(from + STILL);
        if has_state {
            self.ask_for_states();
        }
        while self.now() < end {
            self.pump(TICK)?;
            let now = self.now();
            while let Some(event) = self.session.take_event() {
                shafts.see(&event, now);
            }
            if now < from {
                shafts.was_driven = false;
            } else if is_over(shafts, now) {
                break;
            }
        }
        if has_state {
            self.end_states();
        }
        Ok(())
    }
}
