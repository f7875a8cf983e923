//! What stops everything, and how it is known that a shaft stands.
//!
//! A shaft is watched by what the machine state tells of it; those of motors 1 and 2 also by their encoders in
//! the telemetry, which count whatever sensor the channel goes by, and which older boards tell too.

use std::time::Duration;

use protocol::extension::{ChannelState, MachineState, Mode};
use protocol::pms5005::{Addressing, CHANNELS, Command, Move, Quantity, Report, Scope};

use super::motion::NEUTRAL;
use super::{Client, TICK};
use crate::error::Error;
use crate::number::Number;
use crate::session::{Event, Personality};

/// How long a stop waits for the shaft.
pub(super) const STAND: Duration = Duration::from_secs(1);
/// A shaft stands when it has kept within so many counts, which is a potentiometer's noise, for so long.
const STILL_COUNTS: i32 = 5;
pub(super) const STILL: Duration = Duration::from_millis(150);
/// For how long a stop of everything is repeated while another host drives on.
const REPEAT: Duration = Duration::from_secs(3);
/// An encoder's counts in the telemetry wrap here.
const WRAP: i32 = 32_768;

/// All off, at once.
const SUSPEND: Command<'static> = Command::Run { scope: Scope::All, run: false };
/// No drive: what is suspended would go on with its move when it is resumed.
const NEUTRAL_ALL: Command<'static> = Command::Move(Move {
    quantity: Quantity::Pwm,
    addressing: Addressing::All,
    targets: [Some(NEUTRAL); CHANNELS],
    periods: 0,
});

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

/// What one sensor has told of a shaft.
#[derive(Clone, Copy, Debug)]
struct Seen {
    first: i32,
    last: i32,
    /// Where it was when its rest began, and when that was.
    rest: (i32, Duration),
}

impl Seen {
    fn see(seen: &mut Option<Self>, at: i32, now: Duration) {
        let seen = seen.get_or_insert(Self { first: at, last: at, rest: (at, now) });
        seen.last = at;
        if at.wrapping_sub(seen.rest.0).saturating_abs() > STILL_COUNTS {
            seen.rest = (at, now);
        }
    }

    fn turned(&self) -> i32 {
        self.last.wrapping_sub(self.first)
    }
}

/// What was seen of all shafts.
#[derive(Debug, Default)]
pub(super) struct Shafts {
    told: [Option<Seen>; CHANNELS],
    encoders: [Option<Seen>; 2],
    /// The last machine state.
    pub(super) state: Option<MachineState>,
    /// Whether a machine state has shown something driven.
    was_driven: bool,
}

impl Shafts {
    /// Takes what was heard.
    pub(super) fn see(&mut self, event: &Event, now: Duration) {
        match event {
            Event::State(state) => {
                for (seen, channel) in self.told.iter_mut().zip(&state.channels) {
                    Seen::see(seen, channel.position, now);
                }
                self.was_driven |= is_driven(state);
                self.state = Some(*state);
            }
            Event::Report(Report::Motors(motors)) => {
                for (seen, encoder) in self.encoders.iter_mut().zip(&motors.encoders) {
                    // Turn by turn: from the last count the shorter way.
                    let last = seen.map_or(encoder.count.into(), |seen| seen.last);
                    let moved =
                        (i32::from(encoder.count) - last + WRAP / 2).rem_euclid(WRAP) - WRAP / 2;
                    Seen::see(seen, last + moved, now);
                }
            }
            _ => {}
        }
    }

    fn of(&self, motor: Number) -> impl Iterator<Item = &Seen> {
        let encoder = self.encoders.get(motor.index()).and_then(Option::as_ref);
        self.told[motor.index()].iter().chain(encoder)
    }

    /// Whether all of these stand; `None` if nothing tells of one.
    pub(super) fn stand(&self, motors: &[Number], now: Duration) -> Option<bool> {
        let stands = |motor: &Number| {
            let seen: Vec<_> = self.of(*motor).collect();
            let rests = seen.iter().all(|seen| now >= seen.rest.1 + STILL);
            (!seen.is_empty()).then_some(rests)
        };
        motors.iter().map(stands).try_fold(true, |all, one| Some(all && one?))
    }

    /// Where a shaft is, and how far it has turned, by a sensor that has seen it move, if one has.
    pub(super) fn turned(&self, motor: Number) -> Option<(i32, i32)> {
        let moved = |seen: &&Seen| seen.turned().saturating_abs() > STILL_COUNTS;
        let best = self.of(motor).find(moved).or_else(|| self.of(motor).next());
        best.map(|seen| (seen.last, seen.turned()))
    }
}

/// Whether all motors and servos are.
fn is_off(state: &MachineState) -> bool {
    state.channels.iter().all(|channel| channel.mode == Mode::Off) && state.servos == [0; 6]
}

/// Whether anything is. A neutral PWM is how another host ends its own drive.
fn is_driven(state: &MachineState) -> bool {
    let is_neutral = |c: &ChannelState| c.mode == Mode::Pwm && c.set_point == 0;
    let is_driven = |c: &ChannelState| c.mode != Mode::Off && !is_neutral(c);
    state.channels.iter().any(is_driven) || state.servos != [0; 6]
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

#[cfg(test)]
mod tests {
    use protocol::pms5005::{Encoder, MotorReport};

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn telemetry(count: u16) -> Event {
        let encoder = Encoder { count, speed: 0, positive: true };
        Event::Report(Report::Motors(MotorReport {
            encoders: [encoder; 2],
            ..MotorReport::default()
        }))
    }

    #[test]
    fn a_shaft_stands_when_every_sensor_that_sees_it_rests() {
        let (mut shafts, one) = (Shafts::default(), [Number::ONE]);
        assert_eq!(shafts.stand(&one, MS), None);
        shafts.see(&Event::State(MachineState::default()), Duration::ZERO);
        assert_eq!(shafts.stand(&one, 100 * MS), Some(false));
        assert_eq!(shafts.stand(&one, 150 * MS), Some(true));
        // Its encoder turns, though the channel goes by a potentiometer that is not there.
        shafts.see(&telemetry(32_760), 160 * MS);
        shafts.see(&telemetry(10), 200 * MS);
        assert_eq!(shafts.stand(&one, 349 * MS), Some(false));
        assert_eq!(shafts.stand(&one, 350 * MS), Some(true));
        assert_eq!(shafts.turned(Number::ONE), Some((32_778, 18)));
    }

    #[test]
    fn noise_is_no_motion_and_creeping_is() {
        let mut shafts = Shafts::default();
        for ms in 0..100u32 {
            shafts.see(&telemetry(100 + (ms % 2 * 4) as u16), 10 * MS * ms);
        }
        assert_eq!(shafts.stand(&[Number::ONE], 1000 * MS), Some(true));
        for ms in 100..200u32 {
            shafts.see(&telemetry(ms as u16), 10 * MS * ms);
        }
        assert_eq!(shafts.stand(&[Number::ONE], 2000 * MS), Some(false));
    }
}
