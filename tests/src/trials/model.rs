//! What holds of a controller in every period, whatever it is told and whatever its sensors say. The
//! model beside it is small: of each channel, what it was last asked for, and so what it may do.
//!
//! It goes by what the session has asked of the controller, a moment before the controller does: each
//! rule counts from [`SLACK`] periods on, and not while commands are held back.

use std::collections::VecDeque;

use firmware::channel::{CHANNELS, Channel, Method, Polarity, Scope};
use firmware::command::Command;
use firmware::control::axis::{SetPoint, is_stop};
use firmware::controller::{ChannelSnapshot, Snapshot};
use firmware::ports::MotorOutput;
use firmware::settings::{ControlSettings, SoftLimits};
use hal_mock::plant::Plant;

use super::asked::{Asked, Coming};

/// Periods from a command to what it does: it waits for its turn, and settings wait for theirs.
const SLACK: u32 = 12;
/// Periods in which silence stops what a PWM or a velocity drives, as the manual of ours says.
const STOPS_WITHIN: u32 = 100;
/// A latched channel's shaft is at rest after so many.
const COASTS: u32 = 5000;

#[derive(Clone, Copy, Debug)]
struct Motor {
    asked: Asked,
    /// The period of that.
    since: u32,
    /// The last that is still to come.
    coming: Option<Coming>,
    /// When it was last given, or a count set, while another was still coming. If one of them is refused,
    /// the one that moved the channel may be another than was thought.
    doubted: Option<u32>,
    latched_for: u32,
    /// A setting may have stopped it since, as silence would.
    may_age: bool,
    before: ChannelSnapshot,
}

#[derive(Clone, Copy, Debug, Default)]
struct Servo {
    may_be_on: bool,
    /// It was ever told where to be.
    has_a_place: bool,
    since: u32,
    /// It slews, whether its host speaks or not.
    slews: bool,
    /// It goes nowhere, since this period.
    rests: Option<u32>,
}

impl Servo {
    /// It was told to move.
    fn on(since: u32, slews: bool) -> Self {
        Self { may_be_on: true, has_a_place: true, since, slews, rests: None }
    }
}

/// See the [module](self).
pub struct Model {
    motors: [Motor; CHANNELS],
    servos: [Servo; CHANNELS],
    settings: ControlSettings,
    /// The ones before, which count for a while, and the period in which the last were replaced.
    old_settings: Vec<ControlSettings>,
    settled: u32,
    /// No command is carried out.
    pub is_held: bool,
    before: Snapshot,
    /// When motion commands were given lately.
    moves: Vec<u32>,
    /// What was asked last, and in which period.
    lately: VecDeque<(u32, Command)>,
}

impl Model {
    /// A controller that has just started.
    pub fn new(settings: ControlSettings) -> Self {
        let before = Snapshot::BOOT;
        let [motor, ..] = before.channels;
        let motor = Motor {
            asked: Asked::Nothing,
            since: 0,
            coming: None,
            doubted: None,
            latched_for: 0,
            may_age: false,
            before: motor,
        };
        Self {
            motors: [motor; CHANNELS],
            servos: Default::default(),
            settings,
            old_settings: Vec::new(),
            settled: 0,
            is_held: false,
            before,
            moves: Vec::new(),
            lately: VecDeque::new(),
        }
    }

    /// The session has asked for this, `now` being the newest snapshot.
    pub fn asked(&mut self, command: &Command, now: &Snapshot) {
        let period = now.counters.periods;
        self.lately.truncate(19);
        self.lately.push_front((period, *command));
        match *command {
            Command::MoveMotors { method, targets, periods, .. } => {
                self.moves.push(period);
                for (motor, target) in self.motors.iter_mut().zip(targets) {
                    if let Some(target) = target {
                        motor.doubted = motor.coming.map(|_| period).or(motor.doubted);
                        motor.coming = Some(Coming {
                            is_stop: is_stop(method, target),
                            periods,
                            at: period,
                            is_suspended: false,
                            is_resumed: false,
                        });
                    }
                }
            }
            Command::MoveServos { targets, .. } => {
                for (servo, _) in self.servos.iter_mut().zip(targets).filter(|(_, t)| t.is_some()) {
                    *servo = Servo::on(period, false);
                }
            }
            Command::SlewServos(slews) => {
                for (servo, _) in self.servos.iter_mut().zip(slews).filter(|(_, s)| s.is_some()) {
                    *servo = Servo::on(period, true);
                }
            }
            Command::Run { scope, run } => self.run(scope, run, period),
            Command::SetCount { channel, .. } => {
                let motor = &mut self.motors[channel.index()];
                // A move that is still to come may be paused before the count is set.
                let is_coming = motor.coming.take().is_some();
                motor.doubted = is_coming.then_some(period).or(motor.doubted);
                if is_coming || matches!(motor.asked, Asked::Pause { .. }) {
                    (motor.asked, motor.since) = (Asked::Unknown, period);
                }
            }
            Command::Adopt
            | Command::Gpio(_)
            | Command::ClearFaults(_)
            | Command::ShowFault(_)
            | Command::Record(_) => {}
        }
    }

    fn run(&mut self, scope: Scope, run: bool, period: u32) {
        for channel in Channel::ALL {
            let (motor, servo) =
                (&mut self.motors[channel.index()], &mut self.servos[channel.index()]);
            if scope == Scope::All || scope == Scope::Motor(channel) {
                if let Some(coming) = &mut motor.coming {
                    coming.is_suspended |= !run;
                    coming.is_resumed = run;
                }
                let asked = if run { motor.asked.resumed() } else { motor.asked.suspended() };
                if asked != motor.asked {
                    (motor.asked, motor.since) = (asked, period);
                }
            }
            if scope == Scope::All || scope == Scope::Servo(channel) {
                // A resume goes on with what there was.
                let may_be_on = run && servo.has_a_place;
                if may_be_on != servo.may_be_on {
                    (servo.may_be_on, servo.since) = (may_be_on, period);
                }
            }
        }
    }

    /// The controller is to go by these settings.
    pub fn adopted(&mut self, settings: &ControlSettings, now: &Snapshot) {
        self.old_settings.push(self.settings);
        (self.settings, self.settled) = (*settings, now.counters.periods);
        self.asked(&Command::Adopt, now);
    }

    /// Whether what was asked in this period has long been done.
    fn is_done(&self, since: u32, now: &Snapshot) -> bool {
        !self.is_held && now.counters.periods.saturating_sub(since) > SLACK
    }

    /// Looks at the newest period, once.
    ///
    /// # Panics
    /// If a promise is broken.
    pub fn look(&mut self, now: &Snapshot, plant: &Plant) {
        match now.counters.periods - self.before.counters.periods {
            0 => return,
            news => assert_eq!(news, 1, "a period that nobody has looked at"),
        }
        if self.is_held {
            // What waits is done later.
            let period = now.counters.periods;
            for motor in &mut self.motors {
                motor.since = period;
                motor.coming = motor.coming.map(|coming| Coming { at: period, ..coming });
                motor.doubted = motor.doubted.map(|_| period);
            }
            self.moves.fill(period);
            self.servos.iter_mut().for_each(|servo| servo.since = period);
            self.settled = period;
        }
        if self.is_done(self.settled, now) {
            self.old_settings.clear();
        }
        self.follow(now);
        for channel in Channel::ALL {
            self.check_motor(channel, now, plant);
            self.check_servo(channel, now, plant);
        }
        let (old, new) = (&self.before.counters, &now.counters);
        let counted = [
            (old.refused.method, new.refused.method),
            (old.refused.scale, new.refused.scale),
            (old.links_lost, new.links_lost),
            (old.periods_missed, new.periods_missed),
        ];
        assert!(counted.iter().all(|(old, new)| old <= new), "a counter runs backwards: {new:?}");
        self.before = *now;
    }

    /// Those that may be in force.
    fn all_settings(&self) -> impl Iterator<Item = &ControlSettings> {
        self.old_settings.iter().chain([&self.settings])
    }

    /// What the period did to what was asked.
    fn follow(&mut self, now: &Snapshot) {
        let period = now.counters.periods;
        let refused = now.counters.refused.total() != self.before.counters.refused.total();
        self.moves.retain(|at| period - at <= SLACK);
        // Of several motion commands at once, nobody can say from here which was refused, nor which wait until
        // commands are carried out again.
        let is_ambiguous = (refused || self.is_held) && self.moves.len() > 1;
        if refused && self.moves.len() == 1 && !self.is_held {
            assert_eq!(now.moved.bits(), 0, "a command that was refused moves something");
        }
        let lost = now.counters.links_lost != self.before.counters.links_lost;
        for channel in Channel::ALL {
            let i = channel.index();
            let accelerates = self.all_settings().any(|all| all.channels[i].acceleration > 0);
            let ages = self.all_settings().any(|all| all.oldest_command > 0);
            let may_go_on = self.all_settings().any(|all| all.longest_move > 0);
            let motor = &mut self.motors[i];
            let has_moved = now.moved.has(channel);
            motor.may_age = ages || motor.may_age && !has_moved;
            if has_moved {
                motor.asked = match motor.coming.take() {
                    _ if is_ambiguous => Asked::Unknown,
                    Some(Coming { is_stop, periods, is_suspended, is_resumed, .. }) => {
                        let by = period + u32::from(periods) + SLACK;
                        let asked = match is_stop {
                            true => Asked::Stop { by: Some(by).filter(|_| !accelerates) },
                            false => Asked::Motion { timed: periods > 0 },
                        };
                        match (is_suspended, is_resumed) {
                            (false, _) => asked,
                            (true, false) => asked.suspended(),
                            (true, true) => asked.suspended().resumed(),
                        }
                    }
                    // One that was told with the one before, and came after it; or after a fault that
                    // stopped that.
                    None if period - motor.since <= SLACK => match motor.asked {
                        Asked::Nothing => Asked::Unknown,
                        asked => asked,
                    },
                    None => Asked::Motion { timed: true },
                };
                motor.since = period;
            } else if is_ambiguous && motor.doubted.is_some_and(|at| period - at <= SLACK) {
                (motor.asked, motor.since) = (Asked::Unknown, period);
            }
            motor.coming = motor.coming.filter(|coming| period - coming.at <= SLACK);
            if lost {
                motor.asked = match (motor.asked, now.channels[i].set_point) {
                    (Asked::Nothing | Asked::Pause { .. }, _) => Asked::Nothing,
                    (Asked::Unknown, _) => Asked::Unknown,
                    (silence @ Asked::Silence { .. }, _) => silence,
                    // It is held anew, within the band around the shaft.
                    (Asked::Hold { by, .. }, _) => Asked::Hold { by, at: None },
                    // It goes on to the end of its time, for as long as the host gives signs of life.
                    (Asked::Motion { timed: true }, SetPoint::Position(_)) if may_go_on => {
                        Asked::Unknown
                    }
                    (_, SetPoint::Position(_)) => Asked::Hold { by: period + SLACK, at: None },
                    (asked, _) => Asked::Silence {
                        by: period + STOPS_WITHIN,
                        under_way: matches!(asked, Asked::Motion { .. }),
                    },
                };
                motor.since = period;
            }
            if now.faults.stops_motor(channel) {
                (motor.asked, motor.since) = (Asked::Nothing, period);
                motor.latched_for += 1;
            } else {
                motor.latched_for = 0;
            }
        }
        if now.faults.stops_servos() {
            // What was asked a moment ago may come behind the fault's end.
            for servo in self.servos.iter_mut().filter(|servo| period - servo.since > SLACK) {
                (servo.may_be_on, servo.since) = (false, period);
                servo.rests = Some(servo.rests.unwrap_or(period));
            }
        }
        if lost {
            // What was asked a moment ago may come behind the loss, with a sign of life.
            let moving = |servo: &&mut Servo| !servo.slews && period - servo.since > SLACK;
            for servo in self.servos.iter_mut().filter(moving) {
                servo.rests = Some(servo.rests.unwrap_or(period));
            }
        }
    }

    fn check_motor(&mut self, channel: Channel, now: &Snapshot, plant: &Plant) {
        let i = channel.index();
        let period = now.counters.periods;
        let motor = self.motors[i];
        let (output, told) = (now.outputs.motors[i], now.channels[i]);
        let MotorOutput { duty, enabled } = output;
        let duty = duty.raw();
        let context = Context { channel: i, period, motor, output, told };
        let lately = &self.lately;
        let at = || format!("{context:#?}\n{lately:#?}");

        assert!(enabled || duty == 0, "disabled is neutral: {}", at());
        assert!(plant.motors[i].velocity().is_finite(), "a motor of nowhere: {}", at());
        let is_settled = self.is_done(self.settled, now);
        let highest = self.all_settings().map(|all| all.channels[i].highest_duty).max();
        let highest = highest.unwrap_or(0);
        assert!(duty.unsigned_abs() <= highest, "beyond its highest duty {highest}: {}", at());
        if now.faults.stops_motor(channel) {
            assert!(!enabled, "driven under a fault: {}", at());
            let is_still = motor.latched_for < COASTS || plant.motors[i].velocity() == 0.0;
            assert!(is_still, "in motion under a fault: {}", at());
            assert!(told.reason.is_some(), "latched without a reason: {}", at());
        }
        if is_settled {
            let collision = &self.settings.collision;
            let reversed = self.settings.channels[i].polarity == Polarity::Negative;
            let upwards = if reversed { -duty } else { duty };
            let forward = collision.forward_is_positive.get(i);
            let is_towards =
                forward.is_some_and(|&rises| if rises { upwards > 0 } else { upwards < 0 });
            assert!(!now.obstacle || !is_towards, "towards an obstacle: {}", at());
            let SoftLimits { low, high } = self.settings.soft_limits[i];
            if low < high {
                // No trial gives this channel another sensor than one potentiometer.
                let position = now.motion.potentiometers[i].cast_signed();
                let is_within =
                    (position < high || upwards <= 0) && (position > low || upwards >= 0);
                assert!(is_within, "beyond its soft limit, at {position}: {}", at());
            }
        }

        let is_done = self.is_done(motor.since, now);
        let magnitude = |told: &ChannelSnapshot| match told.set_point {
            SetPoint::Duty(duty) => Some(i64::from(duty.raw().unsigned_abs())),
            SetPoint::Velocity(speed) => Some(i64::from(speed.to_bits()).abs()),
            SetPoint::Position(_) => None,
        };
        let is_same_method = told.set_point.method() == motor.before.set_point.method();
        let grows = is_same_method && magnitude(&told) > magnitude(&motor.before);
        let mut holds = None;
        match motor.asked {
            Asked::Nothing | Asked::Pause { .. } if is_done => {
                assert!(!enabled, "nobody has asked it to move: {}", at());
            }
            Asked::Motion { .. } if is_done && !enabled && !motor.may_age => {
                assert!(told.reason.is_some(), "it stands without a reason: {}", at());
            }
            Asked::Stop { by } if is_done && enabled => {
                assert_ne!(told.set_point.method(), Method::Position, "it was stopped: {}", at());
                assert!(!grows, "it was stopped, and goes faster: {}", at());
                let is_over = !self.is_held && by.is_some_and(|by| period > by);
                assert!(
                    !is_over || magnitude(&told) == Some(0),
                    "it was to stand by now: {}",
                    at()
                );
                let is_pwm = told.set_point.method() == Method::Pwm;
                let has_crossed_over = by.is_some_and(|by| period > by + 64);
                assert!(
                    !(is_pwm && has_crossed_over && is_over) || duty == 0,
                    "not neutral: {}",
                    at()
                );
            }
            Asked::Silence { by, under_way } => {
                let is_off = !enabled;
                assert!(is_off || period <= by, "silence stops it by {by}: {}", at());
                assert!(
                    is_off || !grows || !is_done,
                    "its host is silent, and it goes faster: {}",
                    at()
                );
                let is_told = enabled || !under_way || motor.may_age || told.reason.is_some();
                assert!(is_told, "it stands without a reason: {}", at());
            }
            Asked::Hold { by, at: place } if is_done && period > by && enabled => {
                let held = place.unwrap_or(told.set_point);
                assert_eq!(told.set_point, held, "it was to hold: {}", at());
                holds = Some(Asked::Hold { by, at: Some(held) });
            }
            _ => {}
        }
        self.motors[i].before = told;
        self.motors[i].asked = holds.unwrap_or(motor.asked);
    }

    fn check_servo(&self, channel: Channel, now: &Snapshot, plant: &Plant) {
        let i = channel.index();
        let servo = self.servos[i];
        let pulse = now.outputs.servos[i];
        let at = || format!("servo {i}, period {}: {pulse:?}, {servo:?}", now.counters.periods);
        let is_in_range = pulse.is_none_or(|pulse| (500..=7000).contains(&pulse.raw()));
        assert!(is_in_range, "no pulse for a servo: {}", at());
        assert!(plant.servos[i].position().is_finite(), "a servo of nowhere: {}", at());
        assert!(pulse.is_none() || !now.faults.stops_servos(), "a pulse under a fault: {}", at());
        let may_be_on = servo.may_be_on || !self.is_done(servo.since, now);
        assert!(pulse.is_none() || may_be_on, "nobody has enabled it: {}", at());
        let moves = now.servos[i] != self.before.servos[i];
        let rests = servo.rests.is_some_and(|since| self.is_done(since, now));
        assert!(!(moves && rests), "a fault or silence has stopped it: {}", at());
    }
}

/// What is told when a promise is broken.
#[derive(Debug)]
#[expect(dead_code, reason = "all of it is read by whoever looks for the cause")]
struct Context {
    channel: usize,
    period: u32,
    motor: Motor,
    output: MotorOutput,
    told: ChannelSnapshot,
}
