//! One joint: where it is, where it goes, how fast, and when its servo has caught up.
//!
//! A *tick* is the wire's unit of position. The controller slews a joint's pulse (`control::servo`)
//! a tick in so many milliseconds (SPEED); it never jumps. A joint's position is the last tick that
//! the pulse has reached; stopped, it goes back there, less than a tick, and holds. There is no feedback: the servo
//! itself may be slower and lag behind; when it must have caught up is reckoned from how far the
//! pulse has gone.

use core::mem;
use core::num::NonZeroU16;

use embassy_time::{Duration, Instant};
use protocol::arcos::JointInfo;

use crate::control::servo::Slew;
use crate::settings::JointSettings;
use crate::units::{CONTROL_PERIOD_MS, ServoPulse};

/// A servo gets a pulse every 20 ms; three of them are enough to begin and to end a way.
const SETTLING: Duration = Duration::from_millis(60);

/// The speeds that exist, in milliseconds a tick.
const SPEEDS: (u8, u8) = (1, 127);

/// A joint. See the [module](self).
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    calibration: JointSettings,
    servo_ms_per_60_deg: u16,
    /// SPEED.
    ms_per_tick: u8,
    /// On this way it is no faster than its calibrated speed, whatever SPEED says.
    unhurried: bool,
    /// In ticks.
    pub position: u8,
    /// `None` is where it is, which the next look tells.
    goal: Option<u8>,
    /// The pulse as it was when it was last looked at.
    pulse: ServoPulse,
    looked_at: Instant,
    /// When the servo will have gone all the way that the pulse has gone, also to and fro.
    servo_arrives: Instant,
}

impl Joint {
    /// A joint at home, on a servo that takes so long for 60 degrees.
    pub fn new(calibration: JointSettings, servo_ms_per_60_deg: u16) -> Self {
        let mut joint = Self {
            calibration,
            servo_ms_per_60_deg,
            ms_per_tick: 0,
            unhurried: false,
            position: 0,
            goal: None,
            pulse: ServoPulse::from_raw(0),
            looked_at: Instant::MIN,
            servo_arrives: Instant::MIN,
        };
        joint.set_speed(calibration.ms_per_tick);
        joint.position = joint.home_position();
        joint.pulse = joint.pulse_at(joint.position);
        joint
    }

    /// What it is like, with its speed as it is.
    pub fn info(&self) -> JointInfo {
        let JointSettings { home, min, centre, max, ticks_per_90, .. } = self.calibration;
        JointInfo { ms_per_tick: self.ms_per_tick, home, min, centre, max, ticks_per_90 }
    }

    /// Whether it is on its way.
    pub fn is_moving(&self) -> bool {
        self.position != self.goal()
    }

    /// Whether it is on its way home.
    pub fn is_homing(&self) -> bool {
        self.is_moving() && self.goal() == self.home_position()
    }

    /// Whether it stays on the side of home on which a gripper is closed: that of its minimum, as
    /// the host has it that drives the gripper. On its way home or open it is held closed no more.
    pub fn is_held_closed(&self) -> bool {
        self.position.max(self.goal()) < self.home_position()
    }

    /// Takes a speed, limited to 1 to 127 ms a tick, for the rest of its way too.
    pub fn set_speed(&mut self, ms_per_tick: u8) -> Limited {
        self.ms_per_tick = ms_per_tick.max(SPEEDS.0).min(SPEEDS.1);
        Limited(self.ms_per_tick != ms_per_tick)
    }

    /// Sets out for a position, limited to what it can reach.
    pub fn go(&mut self, ticks: u8) -> Limited {
        let goal = self.reachable(ticks);
        (self.goal, self.unhurried) = (Some(goal), false);
        Limited(goal != ticks)
    }

    /// Sets out for home; `unhurried` if nobody may be watching.
    pub fn home(&mut self, unhurried: bool) {
        (self.goal, self.unhurried) = (Some(self.home_position()), unhurried);
    }

    /// Stops where it is.
    pub fn stop(&mut self) {
        (self.goal, self.unhurried) = (None, false);
    }

    /// Takes where the board has its pulse now, if it has had one yet.
    pub fn look(&mut self, pulse: Option<ServoPulse>, now: Instant) {
        let since = mem::replace(&mut self.looked_at, now);
        let before = self.pulse;
        self.pulse = pulse.unwrap_or(before);
        self.position = self.reached();
        self.goal.get_or_insert(self.position);
        if self.pulse != before {
            // From one end to the other is as far as the servo can be behind.
            let ends = [self.calibration.min, self.calibration.max].map(|end| self.pulse_at(end));
            let farthest = now.saturating_add(self.servo_time(ends[0], ends[1]));
            let begins = self.servo_arrives.max(since);
            let arrives = begins.saturating_add(self.servo_time(before, self.pulse));
            self.servo_arrives = arrives.max(now).min(farthest);
        }
    }

    /// The way that it is on.
    pub fn slew(&self) -> Slew {
        let slowest = if self.unhurried { self.calibration.ms_per_tick } else { 0 };
        self.slew_to(self.goal(), self.ms_per_tick.max(slowest))
    }

    /// The way to its position, less than a tick and at once, wherever it is to go.
    pub fn hold(&self) -> Slew {
        self.slew_to(self.position, SPEEDS.0)
    }

    /// The board is told to [`slew`](Self::slew) now: a way that begins is not over before its
    /// pulse has been seen to move.
    pub fn set_out(&mut self, now: Instant) {
        if !self.has_arrived() {
            self.servo_arrives = self.servo_arrives.max(now);
        }
    }

    /// When its pulse will have arrived, as it seems now; `None` if it has.
    pub fn arrives_at(&self) -> Option<Instant> {
        let Slew { target, periods_per_ms } = self.slew();
        let way = u32::from(self.pulse.raw().abs_diff(target.unsigned_abs()));
        let periods = way.saturating_mul(periods_per_ms.get().into());
        // The period under way is not seen yet.
        let periods = periods.div_ceil(ServoPulse::PER_MS.into()).saturating_add(1);
        let time = Duration::from_millis(periods.saturating_mul(CONTROL_PERIOD_MS).into());
        (!self.has_arrived()).then(|| self.looked_at.saturating_add(time))
    }

    /// When its servo will be, or was, where it is; `None` while it is on its way.
    pub fn rests_at(&self) -> Option<Instant> {
        self.has_arrived().then(|| self.servo_arrives.saturating_add(SETTLING))
    }

    fn slew_to(&self, ticks: u8, ms_per_tick: u8) -> Slew {
        // A millisecond of pulse width is 90 degrees.
        let ms = u16::from(self.calibration.ticks_per_90).saturating_mul(ms_per_tick.into());
        Slew {
            target: self.pulse_at(ticks).raw() as i16, // 7000 at the most
            periods_per_ms: NonZeroU16::new(ms).unwrap_or(NonZeroU16::MIN),
        }
    }

    fn goal(&self) -> u8 {
        self.goal.unwrap_or(self.position)
    }

    fn has_arrived(&self) -> bool {
        self.pulse == self.pulse_at(self.goal())
    }

    /// The last tick that the pulse has reached.
    fn reached(&self) -> u8 {
        let Self { position, pulse, calibration, .. } = *self;
        let last = if self.has_arrived() {
            Some(self.goal())
        } else if pulse > self.pulse_at(position) {
            (position..=calibration.max).rev().find(|&ticks| self.pulse_at(ticks) <= pulse)
        } else {
            (calibration.min..=position).find(|&ticks| self.pulse_at(ticks) >= pulse)
        };
        last.unwrap_or(position)
    }

    /// The pulse that holds it at a position.
    fn pulse_at(&self, ticks: u8) -> ServoPulse {
        ServoPulse::from_raw(self.calibration.pulse(ticks))
    }

    /// What its servo needs from one pulse to another: 60 degrees are 2/3 ms of pulse width.
    fn servo_time(&self, from: ServoPulse, to: ServoPulse) -> Duration {
        let way = u64::from(from.raw().abs_diff(to.raw())).saturating_mul(1000);
        let us = way.saturating_mul(self.servo_ms_per_60_deg.into());
        Duration::from_micros(us / u64::from(ServoPulse::PER_MS * 2 / 3))
    }

    fn home_position(&self) -> u8 {
        self.reachable(self.calibration.home)
    }

    /// The nearest position that it can reach; the calibration's bounds may be in any order.
    fn reachable(&self, ticks: u8) -> u8 {
        ticks.max(self.calibration.min).min(self.calibration.max)
    }
}

/// Whether a value had to be limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Limited(pub bool);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::servo::Servo;
    use crate::settings::ArmSettings;

    /// A joint with power, and what the controller makes of it.
    struct Driven {
        joint: Joint,
        servo: Servo,
        told: Slew,
        ms: u64,
    }

    impl Driven {
        fn new() -> Self {
            let joint = Joint::new(ArmSettings::DEFAULT.joints[0], 300);
            let mut servo = Servo::new();
            servo.slew(joint.slew());
            Self { told: joint.slew(), joint, servo, ms: 0 }
        }

        /// At this position for a long time.
        fn at(ticks: u8) -> Self {
            let mut driven = Self::new();
            driven.joint.go(ticks);
            driven.run(1, 10_000);
            assert_eq!(driven.joint.position, ticks);
            driven
        }

        fn now(&self) -> Instant {
            Instant::from_millis(self.ms)
        }

        /// As the arm does it: looks, and tells the board what is new.
        fn look(&mut self) {
            let now = self.now();
            self.joint.look(self.servo.set_point(), now);
            if self.joint.slew() != self.told {
                self.told = self.joint.slew();
                self.servo.slew(self.told);
                self.joint.set_out(now);
            }
        }

        /// Looks now, and lets `ms` pass, looked at every `period` ms; the positions.
        fn run(&mut self, period: usize, ms: u64) -> Vec<u8> {
            self.look();
            let mut positions = Vec::new();
            for ms in 1..=ms {
                self.servo.step();
                self.ms += 1;
                if ms % period as u64 == 0 {
                    self.look();
                    positions.push(self.joint.position);
                }
            }
            positions
        }
    }

    #[test]
    fn fifty_ticks_at_20_ms_take_a_second() {
        let mut driven = Driven::new();
        driven.joint.go(177);
        assert_eq!(driven.run(1, 20)[18..], [127, 128], "a tick counts when it is reached");
        assert_eq!(driven.joint.arrives_at(), Some(driven.now() + Duration::from_millis(981)));
        assert_eq!(driven.run(1, 979).last(), Some(&176));
        assert_eq!(driven.joint.rests_at(), None);
        driven.run(1, 1);
        assert_eq!((driven.joint.position, driven.joint.is_moving()), (177, false));
        assert_eq!(driven.joint.arrives_at(), None);
        assert_eq!(driven.joint.rests_at(), Some(driven.now() + SETTLING));
    }

    #[test]
    fn a_joint_that_is_faster_than_its_servo_rests_when_that_has_gone_all_the_way() {
        // 100 ticks are 1607 counts of 0.2 ms each.
        let mut driven = Driven::new();
        driven.joint.set_speed(1);
        driven.joint.go(227);
        driven.run(20, 100);
        let rests_at = Instant::from_micros(1607 * 200) + SETTLING;
        assert_eq!(driven.joint.rests_at(), Some(rests_at));
        // To and fro it is never further behind than from end to end.
        for k in 1..100 {
            driven.joint.go(if k % 2 == 0 { 227 } else { 27 });
            driven.run(20, 200);
        }
        let farthest = driven.now() + Duration::from_micros(4098 * 200) + SETTLING;
        assert_eq!(driven.joint.rests_at(), Some(farthest));
    }

    #[test]
    fn looked_at_rarely_it_goes_on_and_its_position_is_true() {
        let mut driven = Driven::new();
        driven.joint.go(227);
        let positions: Vec<u8> = (1..=20).map(|looks| 127 + (looks * 5) / 2).collect();
        assert_eq!(driven.run(50, 1000), positions);
    }

    #[test]
    fn no_flood_of_commands_makes_it_faster_or_holds_it_up() {
        let mut driven = Driven::new();
        for odd in [0, 1].repeat(500) {
            driven.joint.go(200 + odd);
            driven.joint.set_speed(20 + odd);
            driven.run(1, 1);
        }
        // At 20.5 ms a tick.
        assert_eq!(driven.joint.position, 127 + 48);
        // A STOP takes it back for as long as it counts, at its speed too.
        for (stops_every, position) in [(2, 127), (10, 167), (19, 171)] {
            let mut driven = Driven::new();
            for _ in 0..1000 / stops_every {
                driven.joint.stop();
                driven.run(1, 1);
                driven.joint.go(200);
                driven.run(1, stops_every - 1);
            }
            assert_eq!(driven.joint.position, position, "every {stops_every} ms");
        }
    }

    #[test]
    fn stopped_it_holds_the_last_tick_that_it_has_reached() {
        for (goal, position) in [(227, 132), (27, 122)] {
            let mut driven = Driven::new();
            driven.joint.go(goal);
            driven.run(20, 118);
            driven.joint.stop();
            driven.run(1, 1);
            assert_eq!((driven.joint.position, driven.joint.is_moving()), (position, false));
            assert_eq!(driven.joint.rests_at(), None, "back at its speed");
            driven.run(20, 19);
            assert_eq!((driven.joint.position, driven.joint.is_moving()), (position, false));
            assert_eq!(driven.servo.set_point(), Some(driven.joint.pulse_at(position)));
        }
    }

    #[test]
    fn a_speed_that_changes_on_the_way_is_that_of_the_rest() {
        let mut driven = Driven::new();
        driven.joint.go(227);
        driven.run(20, 1010);
        assert_eq!(driven.joint.position, 177);
        driven.joint.set_speed(2);
        driven.run(1, 101);
        assert_eq!((driven.joint.position, driven.joint.is_moving()), (227, false));
    }

    #[test]
    fn an_unhurried_way_home_is_no_faster_than_the_calibrated_speed() {
        for (speed, unhurried, ticks) in [(1, true, 5), (1, false, 100), (50, true, 2)] {
            let mut driven = Driven::at(27);
            driven.joint.set_speed(speed);
            driven.joint.home(unhurried);
            assert!(driven.joint.is_homing());
            // Whole counts of pulse make a tick up to a count, 1.2 ms, longer.
            assert_eq!(*driven.run(1, 102).last().unwrap() - 27, ticks);
        }
    }

    #[test]
    fn by_the_default_calibration_no_pulse_is_wider_or_narrower_than_hobby_servos_bear() {
        for calibration in ArmSettings::DEFAULT.joints {
            let joint = Joint::new(calibration, 300);
            let mut pulses_us = [calibration.min, calibration.max].map(|end| {
                i32::from(joint.pulse_at(end).raw()) * 1000 / i32::from(ServoPulse::PER_MS)
            });
            pulses_us.sort();
            // As the settings and the README say: 0.59 to 2.41 ms, of the 0.5 to 2.5 that are
            // borne.
            assert_eq!(pulses_us, [592, 2414]);
        }
    }

    #[test]
    fn ticks_become_pulses_by_the_calibration_and_back_and_a_bad_one_stays_within_what_the_board_gives()
     {
        let calibration =
            JointSettings { ticks_per_90: 100, centre: 120, ..ArmSettings::DEFAULT.joints[0] };
        let mut joint = Joint::new(calibration, 300);
        for (ticks, pulse) in [(120, 3375), (220, 5625), (20, 1125), (121, 3397), (119, 3353)] {
            assert_eq!(joint.pulse_at(ticks).raw(), pulse, "{ticks} ticks");
            joint.look(Some(ServoPulse::from_raw(pulse.into())), Instant::MIN);
            assert_eq!(joint.position, ticks);
        }
        joint.calibration.ticks_per_90 = 0;
        for (ticks, pulse) in [(255, 7000), (0, 500)] {
            joint.go(ticks);
            assert_eq!(joint.slew().target, pulse);
            joint.look(Some(ServoPulse::from_raw(pulse.into())), Instant::MIN);
            assert_eq!((joint.position, joint.is_moving()), (ticks, false));
        }
    }
}
