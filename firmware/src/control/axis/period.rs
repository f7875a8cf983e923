//! One period of a channel that is on: the limits, where its set-point goes, what its loop makes of
//! that, and what of it reaches the bridge.
//!
//! ```text
//!   limits from outside > soft limits > highest duty, slew
//!   set-point: goes on, waits, or is put back > loop > crossing over > limits > held at a soft limit
//! ```

use crate::channel::Method;
use crate::control::lead::{Following, Step};
use crate::control::pid::{Error, Gains, Limits};
use crate::control::{saturate, track};
use crate::ports::MotorOutput;
use crate::units::{Counts, CountsPerSecond, Drive, Duty};

use super::{
    Axis, Deviation, HANDOVER_SHIFT, HOLD_BAND, Halt, HeldBack, Reading, SetPoint, State, to_duty,
};

/// A drive so near to a limit stands at it.
const NEAR: Drive = Drive::from_bits(64);

impl Axis {
    /// One period of a channel that runs, or may again.
    #[inline(never)] // a channel that is off needs no room for this
    pub(super) fn step_on(&mut self, now: Reading, limits: &Limits) -> MotorOutput {
        match self.state {
            State::Stopping(0) => self.stopped(),
            State::Stopping(left) => self.state = State::Stopping(left.saturating_sub(1)),
            State::Running | State::Paused if self.oldest > 0 => {
                self.age = self.age.saturating_add(1);
                if self.age > self.oldest && !self.is_stop {
                    self.fall_silent(Halt::Age, now);
                }
                if self.age > self.oldest.max(self.longest_move) {
                    self.end_move(now);
                }
            }
            State::Off | State::Running | State::Paused => {}
        }
        let last = core::mem::replace(&mut self.last, now);
        if !self.is_on() {
            (self.drive, self.held_back) = (Drive::ZERO, None);
            return MotorOutput { duty: Duty::NEUTRAL, enabled: false };
        }
        let held_back = self.is_held_back();
        let outside = limits;
        self.limits = self.within_soft_limits(now, limits);
        let (soft, drive) = (&self.limits, self.drive);
        self.is_at_soft_limit = (soft.high < limits.high && drive >= soft.high)
            || (soft.low > limits.low && drive <= soft.low);
        let limits = &self.narrowed(now);
        if self.is_orphaned && (self.course.left() == 0 || held_back) {
            self.hold(Halt::Silence, now);
        }
        let slope = CountsPerSecond::from_bits(self.course.slope());
        let own = match self.method {
            Method::Pwm => {
                self.move_set_point();
                self.wanted = self.to_logical(Drive::from_bits(self.set_point));
                self.wanted
            }
            Method::Position => {
                let moved = self.track.difference(now.position, last.position);
                let goes_on = self.lead_shaft(now, moved, slope, held_back);
                let pid = self.pid;
                let own = self.position_loop(now, slope, limits);
                if !goes_on {
                    // What holds the shaft is not to be overcome by an integral that breaks loose with it.
                    self.pid = pid;
                }
                own
            }
            Method::Velocity => {
                self.move_set_point();
                let rate = now.velocity.saturating_sub(last.velocity);
                self.velocity_loop(now, rate, limits)
            }
        };
        if self.settings.integral_share < Duty::FULL.unsigned_abs() {
            self.pid.cut_integral(self.settings.integral_share);
        }
        let own = limits.apply(self.cross_over(own));
        let back = self.pushed_back(now);
        self.is_at_soft_limit |= back.is_some();
        self.drive = back.map_or(own, |back| limits.nearest(back));
        let held_back = match back {
            Some(_) => Some((HeldBack::SoftLimit, false)),
            None => self.what_holds_back(now, outside, limits),
        };
        let goes_on = held_back.is_some() && held_back == self.held_back;
        self.held_back_for = if goes_on { self.held_back_for.saturating_add(1) } else { 0 };
        self.held_back = held_back;
        MotorOutput { duty: to_duty(self.to_logical(self.drive)), enabled: true }
    }

    /// Which limit the drive stands at, if its loop, or a PWM, wants more than it has; and whether that is
    /// more of positive drive.
    fn what_holds_back(
        &self,
        now: Reading,
        outside: &Limits,
        narrowed: &Limits,
    ) -> Option<(HeldBack, bool)> {
        let missing = self.wanted.saturating_sub(self.drive);
        let is_asked_to_move = match (self.set_point(), self.deviation(now)) {
            (SetPoint::Velocity(set_point), _) => set_point != CountsPerSecond::ZERO,
            // Less is a load that is held.
            (_, Some(Deviation::Position(way))) => way.saturating_abs() > HOLD_BAND,
            _ => true,
        };
        if missing == Drive::ZERO || !is_asked_to_move {
            return None;
        }
        let more = missing > Drive::ZERO;
        // Both as if the drive were positive.
        let drive = if more { self.drive } else { self.drive.saturating_neg() };
        let limit_of = |limits: &Limits| match more {
            true => limits.high,
            false => limits.low.saturating_neg(),
        };
        let stands_at = |limit: Drive| drive >= limit.saturating_sub(NEAR);
        let is_limit = |limit: Drive| limit < Drive::ONE && stands_at(limit);
        let by = if is_limit(limit_of(outside)) {
            HeldBack::Outside { rising: more }
        } else if is_limit(limit_of(&self.limits)) {
            HeldBack::SoftLimit
        } else if is_limit(Drive::from_bits(self.settings.highest_duty.into())) {
            HeldBack::HighestDuty
        } else if stands_at(Drive::ONE) {
            HeldBack::FullDrive
        } else if drive >= limit_of(narrowed) && missing.saturating_abs() > NEAR {
            HeldBack::Slew
        } else {
            return None;
        };
        Some((by, more))
    }

    /// The limits from outside, and what the soft limits forbid.
    fn within_soft_limits(&self, now: Reading, limits: &Limits) -> Limits {
        let mut limits = *limits;
        self.track.hold_within(now, self.full_speed, &mut limits);
        if self.method == Method::Pwm && self.set_point == 0 {
            // Neutral is a stop: nothing is braked, or a sensor that jumps would drive it.
            limits.low = limits.low.min(Drive::ZERO);
            limits.high = limits.high.max(Drive::ZERO);
        }
        limits
    }

    /// The limits, less what the channel's own settings forbid: its highest duty, and its slew limit.
    fn narrowed(&self, now: Reading) -> Limits {
        let most = Drive::from_bits(self.settings.highest_duty.into());
        let mut limits = Limits {
            low: self.limits.low.clamp(most.saturating_neg(), most),
            high: self.limits.high.clamp(most.saturating_neg(), most),
        };
        if self.settings.slew_ms > 0 {
            let step = Drive::ONE.wrapping_div_int(self.settings.slew_ms.into()).max(Drive::DELTA);
            let (mut low, mut high) = (self.drive.min(Drive::ZERO), self.drive.max(Drive::ZERO));
            if self.is_stop && self.method != Method::Position {
                // What stops may brake with all it has, and drives no harder than before.
                let (speed, slow) = (now.velocity, track::creep(self.full_speed));
                low = if speed > slow { Drive::NEG_ONE } else { low };
                high = if speed < slow.saturating_neg() { Drive::ONE } else { high };
            } else {
                (low, high) = (low.saturating_sub(step), high.saturating_add(step));
            }
            limits.low = limits.nearest(low);
            limits.high = limits.nearest(high);
        }
        limits
    }

    /// The drive that holds a shaft at the soft limit that it is driven against, if it is.
    fn pushed_back(&self, now: Reading) -> Option<Drive> {
        let set_point = match self.method {
            Method::Pwm => self.to_logical(Drive::from_bits(self.set_point)).to_bits(),
            Method::Velocity => self.set_point,
            Method::Position => 0,
        };
        let full_speed = self.full_speed;
        (set_point != 0).then(|| self.track.pushed_back(now, set_point > 0, full_speed)).flatten()
    }

    /// Whether an obstacle, a current or a soft limit has kept the last drive from going the way that the
    /// set-point moves.
    fn is_held_back(&self) -> bool {
        let (slope, limits) = (self.course.slope(), &self.limits);
        (slope > 0 && limits.high < Limits::FULL.high && self.drive >= limits.high)
            || (slope < 0 && limits.low > Limits::FULL.low && self.drive <= limits.low)
    }

    /// Moves the set-point of a position loop on, unless it would run away from its shaft: whether it
    /// did.
    fn lead_shaft(
        &mut self,
        now: Reading,
        moved: Counts,
        slope: CountsPerSecond,
        held_back: bool,
    ) -> bool {
        if slope == 0 {
            self.move_set_point();
            self.follow_up(now);
            return true;
        }
        let along = |way: Counts| if slope < 0 { way.saturating_neg() } else { way };
        let following = Following {
            ahead: along(self.track.difference(Counts::from_bits(self.set_point), now.position)),
            moved: along(moved),
            velocity: along(now.velocity),
            rate: along(slope),
            sensor: self.sensor,
        };
        match self.lead.step(&following, held_back) {
            Step::Go => {
                self.move_set_point();
                return true;
            }
            Step::Wait => self.course.stand(),
            Step::Back(by) => {
                self.course.stand();
                let back = along(by).saturating_neg();
                let set_point = self.track.advance(Counts::from_bits(self.set_point), back);
                self.set_point = set_point.to_bits();
                self.course.lengthen(along(by).to_bits());
            }
        }
        false
    }

    /// The set-point of a move that is to go at once goes on as its shaft does.
    fn follow_up(&mut self, now: Reading) {
        let most = self.track.farthest_ahead();
        let ahead = self.track.difference(Counts::from_bits(self.set_point), now.position);
        let room = most.saturating_sub(ahead.saturating_abs()).max(Counts::ZERO);
        let way = self.rest.clamp(room.saturating_neg(), room);
        self.rest = self.rest.saturating_sub(way);
        self.set_point = self.track.advance(Counts::from_bits(self.set_point), way).to_bits();
    }

    fn move_set_point(&mut self) {
        let increment = self.course.advance();
        self.set_point = if self.method == Method::Position {
            let (position, way) = (Counts::from_bits(self.set_point), Counts::from_bits(increment));
            self.track.advance(position, way).to_bits()
        } else {
            self.set_point.saturating_add(increment)
        };
    }

    fn position_loop(&mut self, now: Reading, slope: CountsPerSecond, limits: &Limits) -> Drive {
        let error = self.track.difference(Counts::from_bits(self.set_point), now.position);
        // On a ramp the shaft is meant to move: only what differs from the slope is damped.
        let rate = now.velocity.saturating_sub(slope);
        let error = Error::of_position(error);
        let gains = self.position;
        self.step_pid(&gains, error, rate, self.forward(slope), limits)
    }

    fn velocity_loop(&mut self, now: Reading, rate: CountsPerSecond, limits: &Limits) -> Drive {
        let set_point = CountsPerSecond::from_bits(self.set_point);
        let error = Error::of_velocity(set_point.saturating_sub(now.velocity));
        // Half of it: the motor may be faster than the setting says, and the loop adds what is missing.
        let forward = self.forward(set_point).wrapping_shr(1);
        let gains = self.velocity;
        self.step_pid(&gains, error, rate, forward, limits)
    }

    /// The loop's drive within the limits, and what it wants without.
    fn step_pid(
        &mut self,
        gains: &Gains,
        error: Error,
        rate: CountsPerSecond,
        forward: Drive,
        limits: &Limits,
    ) -> Drive {
        let mut unlimited = self.pid;
        let own = self.pid.step(gains, error, rate, forward, limits);
        // An integral that fills the limit leaves a little of it.
        let is_free =
            own > limits.low.saturating_add(NEAR) && own < limits.high.saturating_sub(NEAR);
        self.wanted = match is_free {
            true => own,
            false => unlimited.step(gains, error, rate, forward, &Limits::NONE),
        };
        own
    }

    /// The drive that makes this velocity, as far as is known.
    fn forward(&self, velocity: CountsPerSecond) -> Drive {
        const MOST: i64 = 1 << 27;
        let bits = self.feed_forward.wide_mul(velocity).to_bits() >> 18;
        Drive::from_bits(saturate(bits.clamp(-MOST, MOST)))
    }

    /// The loop's own drive, or on the way there from the old one.
    fn cross_over(&mut self, own: Drive) -> Drive {
        if self.handover == 0 {
            return own;
        }
        // At most 2 * 64: far from the type's limits.
        let apart = self.old_drive.saturating_sub(own).saturating_mul_int(self.handover.into());
        self.handover = self.handover.saturating_sub(1);
        own.saturating_add(apart.wrapping_shr(HANDOVER_SHIFT))
    }
}
