//! Whether shafts stand, by what is heard of them.
//!
//! A shaft is watched by what the machine state tells of it; those of motors 1 and 2 also by their encoders in
//! the telemetry, which count whatever sensor the channel goes by, and which older boards tell too.

use std::time::Duration;

use protocol::extension::MachineState;
use protocol::pms5005::{CHANNELS, Report};

use super::target::unwrapped;
use crate::number::Number;
use crate::session::Event;
use crate::state::is_driven;

/// A shaft stands when it has kept within so many counts, which is a potentiometer's noise, for so long.
const STILL_COUNTS: i32 = 5;
pub(crate) const STILL: Duration = Duration::from_millis(150);
/// How long a stop waits for a shaft to stand.
pub(crate) const STAND: Duration = Duration::from_secs(1);

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
pub(crate) struct Shafts {
    told: [Option<Seen>; CHANNELS],
    encoders: [Option<Seen>; 2],
    /// The last machine state.
    pub(crate) state: Option<MachineState>,
    /// Whether a machine state has shown something driven.
    pub(crate) was_driven: bool,
}

impl Shafts {
    /// Takes what was heard.
    pub(crate) fn see(&mut self, event: &Event, now: Duration) {
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
                    Seen::see(seen, unwrapped(encoder.count.into(), last), now);
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
    pub(crate) fn stand(&self, motors: &[Number], now: Duration) -> Option<bool> {
        let stands = |motor: &Number| {
            let seen: Vec<_> = self.of(*motor).collect();
            let rests = seen.iter().all(|seen| now >= seen.rest.1 + STILL);
            (!seen.is_empty()).then_some(rests)
        };
        motors.iter().map(stands).try_fold(true, |all, one| Some(all && one?))
    }

    /// Where a shaft is, and how far it has turned, by a sensor that has seen it move, if one has.
    pub(crate) fn turned(&self, motor: Number) -> Option<(i32, i32)> {
        let moved = |seen: &&Seen| seen.turned().saturating_abs() > STILL_COUNTS;
        let best = self.of(motor).find(moved).or_else(|| self.of(motor).next());
        best.map(|seen| (seen.last, seen.turned()))
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
