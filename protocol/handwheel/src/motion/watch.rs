//! Whether a motor that is driven still does what was asked, by its machine states.

use std::time::Duration;

use protocol::extension::{ChannelState, Mode, Reason};

use super::target::{Target, unwrapped};
use crate::number::Number;
use crate::words;

/// What a board tells may be older than the command.
pub(crate) const GRACE: Duration = Duration::from_millis(150);
/// How long a set-point may stand away from its target: it waits for a shaft, or for an acceleration.
const STANDS: Duration = Duration::from_secs(2);
/// A set-point is the target when it is so near: the wire rounds.
const ROUNDED: i32 = 1;
/// A shaft that is so near to its set-point does not keep it waiting.
const NEAR_COUNTS: i32 = 20;
/// How far apart two positions are, the shorter way.
fn apart(a: i32, b: i32) -> i32 {
    unwrapped(a, b).wrapping_sub(b).abs()
}

/// A motor that is driven.
pub(crate) struct Watch {
    motor: Number,
    target: Target,
    ramp: Duration,
    /// The command's DID, as a refusal names it.
    command: u8,
    begun: Duration,
    /// The least way from set-point to target that was seen, and since when nothing but another host has kept it
    /// from shrinking.
    nearest: Option<(i32, Duration)>,
}

impl Watch {
    /// One that has just been asked for this, to be reached in so much time.
    pub(crate) fn new(motor: Number, target: Target, ramp: Duration, now: Duration) -> Self {
        let command = target.command(motor, ramp).did();
        Self { motor, target, ramp, command, begun: now, nearest: None }
    }

    /// It was acknowledged.
    pub(crate) fn begins(&mut self, now: Duration) {
        self.begun = now;
    }

    /// When it began.
    pub(crate) fn begun(&self) -> Duration {
        self.begun
    }

    /// Looks at its newest state.
    ///
    /// # Errors
    /// One line that says why it does not do what was asked any more.
    pub(crate) fn look(&mut self, channel: &ChannelState, now: Duration) -> Result<(), String> {
        let motor = self.motor;
        if now <= self.begun + GRACE {
            return Ok(());
        }
        let is_refused = matches!(channel.reason, Reason::OtherMethod | Reason::BeyondScale)
            && channel.detail == self.command;
        let differs = match channel.mode {
            Mode::Off => None,
            _ => self.differs(channel, now),
        };
        let is_halted = matches!(
            channel.reason,
            Reason::Fault | Reason::Silence | Reason::Suspended | Reason::OldCommand
        );
        let is_neutral = channel.set_point == 0 && channel.mode != Mode::Position;
        if channel.mode == Mode::Off || is_refused || differs.is_some() && (is_halted || is_neutral)
        {
            let why =
                words::reason(channel).unwrap_or_else(|| "another host has stopped it".into());
            return Err(format!("motor {motor} does not run: {why}"));
        }
        match differs {
            Some(differs) => Err(format!(
                "another host drives motor {motor}: {differs}; the motor is stopped: end that host"
            )),
            None => Ok(()),
        }
    }

    /// How the channel's mode or set-point shows that it is not this drive's any more. On the way to its target
    /// a set-point only comes nearer, except that a position waits for its shaft, or goes back with it.
    fn differs(&mut self, channel: &ChannelState, now: Duration) -> Option<String> {
        let (mode, target) = self.target.in_the_state();
        if channel.mode != mode {
            let words = [channel.mode, mode].map(words::mode);
            return Some(format!("its mode is {}, not {}", words[0], words[1]));
        }
        let (set_point, is_position) = (i32::from(channel.set_point), mode == Mode::Position);
        let way = match is_position {
            true => apart(set_point, target),
            false => (set_point - target).abs(),
        };
        let (nearest, since) = self.nearest.unwrap_or((way, now));
        let has_arrived = nearest <= ROUNDED;
        let is_away = way > nearest + ROUNDED && (has_arrived || !is_position);
        let is_hindered =
            channel.reason != Reason::None || apart(channel.position, set_point) > NEAR_COUNTS;
        let waits = is_position && is_hindered;
        let stands = way > ROUNDED && !waits && now > since.max(self.begun + self.ramp) + STANDS;
        let since = if way < nearest || waits { now } else { since };
        self.nearest = Some((way.min(nearest), since));
        (is_away || stands).then(|| format!("its set-point is {set_point}, not {target}"))
    }
}
