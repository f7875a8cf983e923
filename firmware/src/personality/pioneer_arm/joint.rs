//! One joint: where it is, where it goes, and when it takes its next step.
//!
//! A *tick* is the wire's unit of position; a *step* is one tick. A joint on its way takes one step
//! every so many milliseconds (SPEED) and never two at once, however late it is called: it does not
//! jump. There is no feedback: its position is where its servo was last sent. The servo itself may
//! be slower and lag behind; when it must have caught up is reckoned from what it was sent through.
//!
//! All joints take their steps on one grid of control periods, so that the board gets at most one
//! command a period, and no period brings a joint two ticks.

use embassy_time::{Duration, Instant};
use protocol::arcos::JointInfo;

use crate::settings::JointSettings;
use crate::units::{CONTROL_PERIOD_MS, ServoPulse};

/// The distance of the points at which steps are taken.
const GRID: Duration = Duration::from_millis(CONTROL_PERIOD_MS as u64);

/// A servo gets a pulse every 20 ms; three of them are enough to begin and to end a way.
const SETTLING: Duration = Duration::from_millis(60);

/// The speeds that exist, in milliseconds a step.
const SPEEDS: (u8, u8) = (1, 127);

/// A joint. See the [module](self).
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    calibration: JointSettings,
    /// SPEED.
    ms_per_tick: u8,
    /// In ticks.
    pub position: u8,
    goal: u8,
    /// On this way it is no faster than its calibrated speed, whatever SPEED says.
    unhurried: bool,
    /// When it takes its next step: a point of the grid.
    step_at: Instant,
    /// What its servo needs for a tick, and when the servo will have gone all the way that it was
    /// sent, every tick of it, also to and fro.
    servo_time: Duration,
    servo_arrives: Instant,
}

impl Joint {
    /// A joint at home, on a servo that takes so long for 60 degrees.
    pub fn new(calibration: JointSettings, servo_ms_per_60_deg: u16) -> Self {
        let us_per_90_deg = u64::from(servo_ms_per_60_deg) * 1500;
        let mut joint = Self {
            calibration,
            ms_per_tick: 0,
            position: 0,
            goal: 0,
            unhurried: false,
            step_at: Instant::MIN,
            servo_time: Duration::from_micros(
                us_per_90_deg / u64::from(calibration.ticks_per_90.max(1)),
            ),
            servo_arrives: Instant::MIN,
        };
        joint.set_speed(calibration.ms_per_tick);
        joint.goal = joint.home_position();
        joint.position = joint.goal;
        joint
    }

    /// What it is like, with its speed as it is.
    pub fn info(&self) -> JointInfo {
        let JointSettings { home, min, centre, max, ticks_per_90, .. } = self.calibration;
        JointInfo { ms_per_tick: self.ms_per_tick, home, min, centre, max, ticks_per_90 }
    }

    /// Whether it is on its way.
    pub fn is_moving(&self) -> bool {
        self.position != self.goal
    }

    /// Whether it is on its way home.
    pub fn is_homing(&self) -> bool {
        self.is_moving() && self.goal == self.home_position()
    }

    /// Whether it stays on the side of home on which a gripper is closed: that of its minimum, as
    /// the host has it that drives the gripper. On its way home or open it is held closed no more.
    pub fn is_held_closed(&self) -> bool {
        self.position.max(self.goal) < self.home_position()
    }

    /// Takes a speed, limited to 1 to 127 ms a step; the step under way keeps its time.
    pub fn set_speed(&mut self, ms_per_tick: u8) -> Limited {
        self.ms_per_tick = ms_per_tick.max(SPEEDS.0).min(SPEEDS.1);
        Limited(self.ms_per_tick != ms_per_tick)
    }

    /// Sets out for a position, limited to what it can reach.
    pub fn go(&mut self, ticks: u8, now: Instant) -> Limited {
        let goal = self.reachable(ticks);
        self.unhurried = false;
        self.set_out(goal, now);
        Limited(goal != ticks)
    }

    /// Sets out for home; `unhurried` if nobody may be watching.
    pub fn home(&mut self, unhurried: bool, now: Instant) {
        self.unhurried = unhurried;
        self.set_out(self.home_position(), now);
    }

    /// Stops where it is.
    pub fn stop(&mut self) {
        self.goal = self.position;
    }

    /// When its next step is due, if it is on its way.
    pub fn steps_at(&self) -> Option<Instant> {
        self.is_moving().then_some(self.step_at)
    }

    /// Takes the step that is due, if one is. One that is late does not delay those behind it,
    /// unless their time has passed too: nothing is caught up in haste.
    pub fn step(&mut self, now: Instant) {
        let Some(due) = self.steps_at().filter(|&due| due <= now) else { return };
        let up = self.position < self.goal;
        self.position =
            if up { self.position.saturating_add(1) } else { self.position.saturating_sub(1) };
        // Each tick costs the servo its time, but from one end to the other is as far as it can be.
        let reach = self.calibration.max.saturating_sub(self.calibration.min);
        let farthest = now.saturating_add(self.servo_time * reach.into());
        let arrives = self.servo_arrives.max(now).saturating_add(self.servo_time);
        self.servo_arrives = arrives.min(farthest);
        let is_late = due.saturating_add(self.step_time()) <= now;
        self.start_step(if is_late { last_grid_point(now) } else { due });
    }

    /// When its servo will be, or was, where it is; `None` while it is on its way.
    pub fn rests_at(&self) -> Option<Instant> {
        (!self.is_moving()).then(|| self.servo_arrives.saturating_add(SETTLING))
    }

    /// The pulse that holds it where it is, in 1/2250 ms.
    pub fn pulse(&self) -> i16 {
        let pulse = self.calibration.pulse(self.position);
        ServoPulse::from_raw(pulse).raw() as i16 // 7000 at the most
    }

    /// A joint that is on its way keeps the time of its next step, so that no flood of commands
    /// makes it faster or holds it up.
    fn set_out(&mut self, goal: u8, now: Instant) {
        let was_moving = self.is_moving();
        self.goal = goal;
        if self.is_moving() && !was_moving {
            let just_before = GRID - Duration::from_ticks(1);
            self.start_step(last_grid_point(now.saturating_add(just_before)));
        }
    }

    fn start_step(&mut self, since: Instant) {
        self.step_at = since.saturating_add(self.step_time());
    }

    fn step_time(&self) -> Duration {
        let slowest = if self.unhurried { self.calibration.ms_per_tick } else { 0 };
        Duration::from_millis(self.ms_per_tick.max(slowest).into())
    }

    fn home_position(&self) -> u8 {
        self.reachable(self.calibration.home)
    }

    /// The nearest position that it can reach; the calibration's bounds may be in any order.
    fn reachable(&self, ticks: u8) -> u8 {
        ticks.max(self.calibration.min).min(self.calibration.max)
    }
}

/// The last point of the grid, which may be now. Its points lie half way between full milliseconds,
/// where control periods begin on the virtual board, so that none is near the border of two
/// periods.
fn last_grid_point(now: Instant) -> Instant {
    let half = GRID.as_ticks() / 2;
    let since_a_point = (now.as_ticks() + half) % GRID.as_ticks();
    Instant::from_ticks(now.as_ticks().saturating_sub(since_a_point))
}

/// Whether a value had to be limited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Limited(pub bool);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::ArmSettings;

    fn joint() -> Joint {
        Joint::new(ArmSettings::DEFAULT.joints[0], 300)
    }

    /// A point of the grid.
    fn at(ms: u64) -> Instant {
        Instant::from_micros(1000 * ms + 500)
    }

    /// Calls a joint every `period` ms until `end`; its positions.
    fn run(joint: &mut Joint, period: usize, end: u64) -> Vec<u8> {
        (0..=end).step_by(period).map(|ms| (joint.step(at(ms)), joint.position).1).collect()
    }

    #[test]
    fn fifty_ticks_at_20_ms_take_a_second() {
        let mut joint = joint();
        // It sets out with the next point of the grid.
        joint.go(177, Instant::from_millis(0));
        assert_eq!(run(&mut joint, 1, 999).last(), Some(&176));
        joint.step(at(1000));
        assert_eq!((joint.position, joint.is_moving()), (177, false));
        // A tick takes the servo 450 ms / 140.
        assert_eq!(joint.rests_at(), Some(at(1060) + Duration::from_micros(3214)));
    }

    #[test]
    fn a_joint_that_is_faster_than_its_servo_rests_when_that_has_gone_all_the_way() {
        let tick = Duration::from_micros(3214);
        let mut joint = joint();
        joint.set_speed(1);
        joint.go(227, at(0));
        run(&mut joint, 1, 100);
        // The servo has had 1 ms less than the joint.
        assert_eq!(joint.rests_at(), Some(at(1) + tick * 100 + SETTLING));
        // To and fro it is never further behind than from end to end.
        for k in 1..100 {
            joint.go(if k % 2 == 0 { 227 } else { 27 }, at(200 * k));
            (0..=200).for_each(|ms| joint.step(at(200 * k + ms)));
        }
        let farthest = at(20_000) + tick * 255 + SETTLING;
        assert_eq!(joint.rests_at(), Some(farthest));
    }

    #[test]
    fn called_too_rarely_it_is_slow_and_still_takes_one_tick_at_a_time() {
        let mut joint = joint();
        joint.go(227, at(0));
        let positions = run(&mut joint, 50, 1000);
        assert!(positions.windows(2).all(|pair| pair[1] - pair[0] <= 1), "{positions:?}");
        assert_eq!(positions.last(), Some(&147), "a step a call");
    }

    #[test]
    fn no_flood_of_commands_makes_it_faster_or_holds_it_up() {
        let mut joint = joint();
        for ms in 0..=1000 {
            joint.go(200, at(ms));
            joint.step(at(ms));
        }
        assert_eq!(joint.position, 177);
        let mut joint = super::tests::joint();
        for ms in 0..1000 {
            joint.stop();
            joint.go(200, at(ms));
            joint.step(at(ms));
        }
        assert_eq!(joint.position, 127, "stopped for ever");
    }

    #[test]
    fn an_unhurried_way_home_is_no_faster_than_the_calibrated_speed() {
        for (speed, unhurried, steps) in [(1, true, 5), (1, false, 100), (50, true, 2)] {
            let mut joint = joint();
            joint.position = 27;
            joint.goal = 27;
            joint.set_speed(speed);
            joint.home(unhurried, at(0));
            assert!(joint.is_homing());
            assert_eq!(*run(&mut joint, 1, 100).last().unwrap() - 27, steps);
        }
    }

    #[test]
    fn by_the_default_calibration_no_pulse_is_wider_or_narrower_than_hobby_servos_bear() {
        for calibration in ArmSettings::DEFAULT.joints {
            let mut joint = Joint::new(calibration, 300);
            let mut pulses_us = [calibration.min, calibration.max].map(|end| {
                joint.go(end, at(0));
                joint.position = joint.goal;
                i32::from(joint.pulse()) * 1000 / i32::from(ServoPulse::PER_MS)
            });
            pulses_us.sort();
            // As the settings and the README say: 0.59 to 2.41 ms, of the 0.5 to 2.5 that are
            // borne.
            assert_eq!(pulses_us, [592, 2414]);
        }
    }

    #[test]
    fn ticks_become_pulses_by_the_calibration_and_a_bad_one_stays_within_what_the_board_gives() {
        let mut joint = joint();
        let calibration = JointSettings { ticks_per_90: 100, centre: 120, ..joint.calibration };
        joint.calibration = calibration;
        for (ticks, pulse) in [(120, 3375), (220, 5625), (20, 1125), (121, 3397), (119, 3353)] {
            joint.position = ticks;
            assert_eq!(joint.pulse(), pulse, "{ticks} ticks");
        }
        joint.calibration.ticks_per_90 = 0;
        joint.position = 255;
        assert_eq!(joint.pulse(), 7000);
        joint.position = 0;
        assert_eq!(joint.pulse(), 500);
    }
}
