//! One DC channel: what drives it, where it is going, and whether it may.
//!
//! Vocabulary: the *method* is what the set-point means (duty, position, velocity); the
//! *set-point* is what the loop is asked for now, the *target* what it will be asked for when the
//! ramp is over. *Logical* drive is positive when it makes the sensor's counts rise; the
//! polarity turns it into the bridge's. Direct PWM is the bridge's own, whatever the polarity.
//!
//! Promises:
//! - Disabled means neutral. A channel is enabled by a motion command, or by the resume of one that
//!   was only paused; by nothing else.
//! - When method, sensor or polarity change under way, the new loop starts where the shaft is,
//!   and the drive crosses over from the old one to the new one in [`HANDOVER`] periods.
//! - A suspended move goes on where it was suspended: from where the shaft is then, to its target,
//!   in the periods that were left (at once, if it had no time or its time was over).
//! - A *stop* is a neutral PWM, a velocity of 0, a silent host, or a fault; and a suspension of a
//!   channel that one of these has stopped or is stopping. After it only a motion command moves the
//!   channel: another method, sensor or polarity switches it off, and a resume leaves it off.

mod period;

use crate::channel::{Channel, Method, Polarity, Sensor};
use fixed::{FixedI32, types::extra::U24};

use crate::control::lead::Lead;
use crate::control::pid::{Gains, Limits, Pid};
use crate::control::saturate;
use crate::control::track::{Track, last_count};
use crate::control::trajectory::{Course, Profile, Ramp};
use crate::ports::MotorOutput;
use crate::settings::{ChannelSettings, ControlSettings, SoftLimits};
use crate::settings::{HostGains, Reset};
use crate::units::{Counts, CountsPerSecond, Drive, Duty, PERIODS_PER_SECOND};

/// Periods in which a stop by link loss brings the set-point to rest, and after which the bridge
/// is switched off (a stop of category 1 in the sense of IEC 60204-1).
const STOP_RAMP: u16 = 50;
const STOP_OFF: u16 = 95;

/// When the host falls silent a position loop holds what is within so many counts of the shaft:
/// more than a loaded joint sags, less than a way worth speaking of.
const HOLD_BAND: Counts = Counts::const_from_int(128);

/// Counts of error that drive a position loop fully at Kp 1 ([`pid`](super::pid)).
const FULL_DRIVE_COUNTS: i32 = 1 << 15;

/// Periods in which the drive crosses over from one loop to another: 64 ms.
pub const HANDOVER: u8 = 1 << HANDOVER_SHIFT;
const HANDOVER_SHIFT: u32 = 6;

/// What the channel's sensor says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// Position on the sensor's scale.
    pub position: Counts,
    /// Velocity.
    pub velocity: CountsPerSecond,
}

/// What a channel is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPoint {
    /// Open loop.
    Duty(Duty),
    /// Of the position loop.
    Position(Counts),
    /// Of the velocity loop.
    Velocity(CountsPerSecond),
}

impl SetPoint {
    /// The method that it is one of.
    pub fn method(self) -> Method {
        match self {
            Self::Duty(_) => Method::Pwm,
            Self::Position(_) => Method::Position,
            Self::Velocity(_) => Method::Velocity,
        }
    }

    /// In the method's unit, as a motion command has it.
    pub fn rounded(self) -> i16 {
        match self {
            Self::Duty(duty) => duty.raw(),
            Self::Position(counts) => counts.saturating_round().saturating_to_num(),
            Self::Velocity(speed) => speed.saturating_round().saturating_to_num(),
        }
    }
}

/// The set-point of a closed loop less what is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deviation {
    /// The shorter way.
    Position(Counts),
    /// Too slow is positive, for a positive set-point.
    Velocity(CountsPerSecond),
}

/// Why a channel does not take a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AxisRefusal {
    /// The target lies beyond the sensor's scale.
    BeyondScale,
    /// The channel was set to another method.
    OtherMethod,
}

/// Why a channel stands still that was asked to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Halt {
    /// It is suspended.
    Suspension,
    /// The host fell silent.
    Silence,
    /// Its last motion command grew too old.
    Age,
}

/// What keeps a channel's drive from what its loop, or a PWM, asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldBack {
    /// The limits from outside, an obstacle or a current, in the drive that raises its counts or in the
    /// other.
    Outside {
        /// Rising counts.
        rising: bool,
    },
    /// A soft limit.
    SoftLimit,
    /// Its highest duty.
    HighestDuty,
    /// Its slew time.
    Slew,
    /// It has all the drive that there is.
    FullDrive,
}

/// For so many periods in a row the drive must have been held back, the same way, before that is told:
/// less is noise.
const HELD_BACK_FOR: u8 = 50;

impl core::fmt::Display for AxisRefusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::BeyondScale => "the target lies beyond the sensor's scale",
            Self::OtherMethod => "the channel was set to another method",
        })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Disabled, by a stop or since boot.
    Off,
    Running,
    /// Disabled by a suspension, of which a resume is the end.
    Paused,
    /// Coming to rest because the host is silent; so many periods until the bridge is off.
    Stopping(u16),
}

/// Where a channel is going: a value, and what it means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Target {
    method: Method,
    /// Bits of [`Counts`], of [`CountsPerSecond`], or a raw [`Duty`], by method.
    value: i32,
}

/// One DC channel. See the [module](self).
#[derive(Clone, Debug)]
pub struct Axis {
    state: State,
    /// The last that was asked of it is a stop.
    is_stop: bool,
    /// What has stopped it, or broken its move off, since its last motion command.
    halt: Option<Halt>,
    /// A timed move goes on to the end of its time although the host is silent.
    is_orphaned: bool,
    method: Method,
    /// What was chosen for all motion commands; else each chooses for itself.
    chosen_method: Option<Method>,
    sensor: Sensor,
    polarity: Polarity,

    position: Gains,
    velocity: Gains,
    /// Counts per second at full drive, and what is fed forward for one of them, in parts of full drive:
    /// nothing, if no setting knows the former.
    full_speed: i32,
    feed_forward: FixedI32<U24>,
    settings: ChannelSettings,
    track: Track,
    /// How old a motion command may get, 0 for ever, and how old the last one is; how old its timed move.
    oldest: u16,
    age: u16,
    longest_move: u16,

    /// In the units of a target of `method`.
    set_point: i32,
    /// `None` when there is nowhere to go but to stay.
    target: Option<Target>,
    course: Course,
    /// The move has a time of its own.
    is_timed: bool,
    /// What of a move that is to go at once lies beyond what the set-point may be ahead.
    rest: Counts,
    lead: Lead,
    pid: Pid,
    last: Reading,
    /// The shaft is held at the soft limit that it is driven against.
    is_at_soft_limit: bool,
    /// What the loop, or a PWM, would have driven in the last period if nothing limited it.
    wanted: Drive,
    /// What kept the drive from that, whether from more of it, and for how many periods in a row.
    held_back: Option<(HeldBack, bool)>,
    held_back_for: u8,
    /// The target lay beyond a soft limit.
    is_clamped: bool,
    /// Logical drive of the last period, and what it was limited to.
    drive: Drive,
    limits: Limits,
    /// The drive that the channel crosses over from, and the periods that are left to do so.
    old_drive: Drive,
    handover: u8,
}

impl Axis {
    /// A channel at boot: disabled, one potentiometer, the original's gains.
    pub fn new() -> Self {
        Self {
            state: State::Off,
            is_stop: true,
            halt: None,
            is_orphaned: false,
            method: Method::Pwm,
            chosen_method: None,
            sensor: Sensor::SinglePotentiometer,
            polarity: Polarity::Positive,
            position: Gains::position(HostGains::DEFAULT),
            velocity: Gains::velocity(HostGains::DEFAULT, Reset::DEFAULT),
            full_speed: 0,
            feed_forward: FixedI32::ZERO,
            settings: ChannelSettings::DEFAULT,
            track: Track::new(Sensor::SinglePotentiometer, &SoftLimits::NONE),
            oldest: 0,
            age: 0,
            longest_move: 0,
            set_point: 0,
            target: None,
            course: Course::NONE,
            is_timed: false,
            rest: Counts::ZERO,
            lead: Lead::default(),
            pid: Pid::new(),
            last: Reading { position: Counts::ZERO, velocity: CountsPerSecond::ZERO },
            drive: Drive::ZERO,
            is_at_soft_limit: false,
            wanted: Drive::ZERO,
            held_back: None,
            held_back_for: 0,
            is_clamped: false,
            limits: Limits::FULL,
            old_drive: Drive::ZERO,
            handover: 0,
        }
    }

    /// The sensor in use.
    pub fn sensor(&self) -> Sensor {
        self.sensor
    }

    /// What it is asked for now.
    pub fn set_point(&self) -> SetPoint {
        match self.method {
            Method::Pwm => SetPoint::Duty(Duty::from_raw(self.set_point)),
            Method::Position => SetPoint::Position(Counts::from_bits(self.set_point)),
            Method::Velocity => SetPoint::Velocity(CountsPerSecond::from_bits(self.set_point)),
        }
    }

    /// Logical drive of the last period.
    pub fn drive(&self) -> Drive {
        self.drive
    }

    /// Whether the shaft is held at the soft limit that it is driven against.
    pub fn is_at_soft_limit(&self) -> bool {
        self.is_at_soft_limit
    }

    /// The set-point less what is measured; PWM has none.
    pub fn deviation(&self, now: Reading) -> Option<Deviation> {
        match self.set_point() {
            SetPoint::Duty(_) => None,
            SetPoint::Position(set_point) => {
                Some(Deviation::Position(self.track.difference(set_point, now.position)))
            }
            SetPoint::Velocity(set_point) => {
                Some(Deviation::Velocity(set_point.saturating_sub(now.velocity)))
            }
        }
    }

    /// What has stopped the channel, or broken its move off, since its last motion command.
    pub fn halt(&self) -> Option<Halt> {
        self.halt
    }

    /// Whether its bridge is on.
    pub fn is_on(&self) -> bool {
        matches!(self.state, State::Running | State::Stopping(_))
    }

    /// What has kept its drive from what was asked for, for some periods already, or its target where it is.
    pub fn held_back(&self) -> Option<HeldBack> {
        let held_back = self.held_back.filter(|_| self.held_back_for >= HELD_BACK_FOR);
        let is_clamped = self.is_clamped && self.state == State::Running;
        held_back.map(|(by, _)| by).or(is_clamped.then_some(HeldBack::SoftLimit))
    }

    /// Whether a motion command would be taken, if this sensor measures it. `target` is as on the
    /// wire, a duty for PWM.
    ///
    /// # Errors
    /// Says why not. A neutral PWM is a stop and always taken.
    pub fn check(&self, method: Method, target: i16, sensor: Sensor) -> Result<(), AxisRefusal> {
        let highest = last_count(sensor);
        match self.chosen_method {
            _ if method == Method::Pwm && target == 0 => Ok(()),
            Some(chosen) if chosen != method => Err(AxisRefusal::OtherMethod),
            _ if method == Method::Position && target > highest => Err(AxisRefusal::BeyondScale),
            _ => Ok(()),
        }
    }

    /// A motion command that [`check`](Self::check) has passed: enables the channel and goes to
    /// the target, in the method's unit, in so many periods.
    pub fn go(&mut self, method: Method, target: i16, periods: u16, now: Reading) {
        self.is_stop = is_stop(method, target);
        self.age = 0;
        self.halt = None;
        self.is_orphaned = false;
        if self.state != State::Running || self.method != method {
            self.engage(method, now);
        }
        let value = match method {
            Method::Pwm => target.into(),
            Method::Position => self.track.clamp(self.track.target(target)).to_bits(),
            Method::Velocity => CountsPerSecond::from(target).to_bits(),
        };
        self.is_clamped =
            method == Method::Position && value != self.track.target(target).to_bits();
        self.head_for(Target { method, value }, periods, now);
        if method == Method::Pwm && periods == 0 {
            // What a host writes into the PWM stands there at once: it may be a stop.
            self.handover = 0;
        }
    }

    /// Suspends the channel: neutral and disabled. One that runs is paused, and the rest of its move
    /// kept.
    pub fn suspend(&mut self) {
        match self.state {
            State::Running if !self.is_stop => self.switch_off(State::Paused),
            State::Running | State::Stopping(_) => return self.stopped(),
            State::Off | State::Paused => return,
        }
        self.halt = Some(Halt::Suspension);
    }

    /// Forgets a move that is paused: a resume goes nowhere then.
    pub fn forget_paused(&mut self) {
        if self.state == State::Paused {
            self.stopped();
        }
    }

    /// A fault: off, with nowhere to go.
    pub fn trip(&mut self) {
        self.stopped();
    }

    /// Resumes a channel that is paused: it goes on with its move, or holds where it is if it has
    /// none.
    pub fn resume(&mut self, now: Reading) {
        self.halt = self.halt.filter(|&halt| halt != Halt::Suspension);
        if self.state == State::Paused {
            // One without a time may be under way for long too, by its acceleration.
            let left = if self.is_timed { self.course.left() } else { 0 };
            let target = self.target;
            self.engage(self.chosen_method.unwrap_or(self.method), now);
            if let Some(target) = target {
                self.head_for(target, left, now);
            }
        }
    }

    /// The host has fallen silent: PWM and velocity come to rest within 100 ms and switch off; a
    /// position loop breaks off its move and holds where the shaft is. A timed move that is under way
    /// goes on to the end of its time and holds then, unless something keeps it back on its way or
    /// [`end_move`](Self::end_move) comes before.
    pub fn link_lost(&mut self, now: Reading) {
        self.fall_silent(Halt::Silence, now);
    }

    fn fall_silent(&mut self, why: Halt, now: Reading) {
        let was_stopped = self.is_stop;
        match (self.state, self.method) {
            (State::Running, Method::Pwm | Method::Velocity) => {
                self.course = Course::Ramp(Ramp::new(self.set_point.saturating_neg(), STOP_RAMP));
                self.state = State::Stopping(STOP_OFF);
                self.halt = if was_stopped { self.halt } else { Some(why) };
            }
            (State::Running, Method::Position) if self.is_timed && self.course.left() > 0 => {
                self.is_orphaned = true;
            }
            (State::Running, Method::Position) => self.hold(why, now),
            (State::Paused, _) => {
                self.stopped();
                self.halt = Some(why);
            }
            (State::Off | State::Stopping(_), _) => {}
        }
        self.is_stop = true;
        self.target = None;
    }

    /// Breaks off a timed move of a host that has been silent for too long.
    pub fn end_move(&mut self, now: Reading) {
        if self.is_orphaned {
            self.hold(Halt::Silence, now);
        }
    }

    /// A position loop breaks off the move that is under way, and holds within the band around the shaft.
    fn hold(&mut self, why: Halt, now: Reading) {
        let ahead = self.track.difference(Counts::from_bits(self.set_point), now.position);
        let held = ahead.clamp(HOLD_BAND.saturating_neg(), HOLD_BAND);
        if self.course.left() > 0 || self.rest != Counts::ZERO || held != ahead {
            self.halt = Some(why);
        }
        self.set_point = self.track.advance(now.position, held).to_bits();
        self.course = Course::NONE;
        self.rest = Counts::ZERO;
        self.is_orphaned = false;
    }

    /// Chooses the method of all motion commands to come, or leaves it to them. A running channel takes up
    /// the new method where it is: a velocity that it was driven at is kept, a position is held, a PWM
    /// stays as it is, and is neutral behind a position loop.
    pub fn set_method(&mut self, chosen: Option<Method>, now: Reading) {
        self.chosen_method = chosen;
        let Some(method) = chosen.filter(|&method| method != self.method) else { return };
        let driven = self.method == Method::Pwm && self.set_point != 0;
        self.start_over(method, now);
        if self.state == State::Running && method == Method::Velocity && !driven {
            self.head_for(Target { method, value: 0 }, 0, now);
        }
    }

    /// What measures the shaft from now on. `now` is the new sensor's reading; a running loop holds there.
    /// What goes by the sensor comes with [`adopt`](Self::adopt).
    pub fn set_sensor(&mut self, sensor: Sensor, now: Reading) {
        if sensor != self.sensor {
            self.sensor = sensor;
            self.last = now;
            if self.method != Method::Pwm {
                self.start_over(self.method, now);
            }
        }
    }

    /// Which way the bridge is wired. A running velocity loop goes on to its target, a position loop holds.
    pub fn set_polarity(&mut self, polarity: Polarity, now: Reading) {
        if polarity != self.polarity {
            self.polarity = polarity;
            // The bridge's drive is what crosses over, and that is the other way round now.
            self.drive = self.drive.saturating_neg();
            self.old_drive = self.old_drive.saturating_neg();
            let (target, left) = (self.target, self.course.left());
            if self.method != Method::Pwm {
                self.start_over(self.method, now);
            }
            if let Some(target) = target.filter(|target| target.method == Method::Velocity)
                && self.state == State::Running
            {
                self.head_for(target, left, now);
            }
        }
    }

    /// Goes by these gains, limits and speeds from now on, as this channel. What an integral
    /// has gathered goes with its gain, over [`HANDOVER`] periods.
    pub fn adopt(&mut self, settings: &ControlSettings, channel: Channel) {
        let whole = |speed: u32| i32::try_from(speed).unwrap_or(i32::MAX);
        self.full_speed = whole(settings.known_full_speed(channel, self.sensor));
        self.feed_forward = FixedI32::<U24>::ONE
            .checked_div_int(whole(settings.full_speed(channel, self.sensor)))
            .unwrap_or(FixedI32::ZERO);
        let own = settings.channels.get(channel.index());
        self.settings = own.copied().unwrap_or(ChannelSettings::DEFAULT);
        self.position = Gains::position(self.settings.position);
        self.velocity = Gains::velocity(self.settings.velocity, self.settings.velocity_reset);
        let has_integral = match self.method {
            Method::Pwm => true,
            Method::Position => self.position.has_integral(),
            Method::Velocity => self.velocity.has_integral(),
        };
        if !has_integral && self.pid != Pid::new() {
            self.pid = Pid::new();
            self.old_drive = self.drive;
            self.handover = HANDOVER;
        }
        let soft_limits = settings.soft_limits.get(channel.index()).unwrap_or(&SoftLimits::NONE);
        self.track = Track::new(self.sensor, soft_limits);
        self.oldest = settings.oldest_command;
        self.longest_move = settings.longest_move;
    }

    /// So many control periods have passed without a step.
    pub fn missed(&mut self, periods: u16) {
        match &mut self.state {
            State::Stopping(left) => *left = left.saturating_sub(periods),
            State::Running | State::Paused if self.oldest > 0 => {
                self.age = self.age.saturating_add(periods);
            }
            State::Off | State::Running | State::Paused => {}
        }
    }

    /// One period: what the bridge is to do. `limits` bound the logical drive.
    pub fn step(&mut self, now: Reading, limits: impl FnOnce() -> Limits) -> MotorOutput {
        if self.state == State::Off {
            (self.last, self.drive, self.held_back) = (now, Drive::ZERO, None);
            return MotorOutput::default();
        }
        self.step_on(now, &limits())
    }

    /// Starts a method from where shaft and drive are, staying there.
    fn engage(&mut self, method: Method, now: Reading) {
        let was_driven = self.is_on();
        self.old_drive = self.drive;
        self.handover = if was_driven { HANDOVER } else { 0 };
        self.state = State::Running;
        let before = core::mem::replace(&mut self.method, method);
        self.forget();
        self.set_point = match method {
            // A PWM that was chosen under way of a position loop is nobody's: neutral.
            Method::Pwm if before == Method::Position => 0,
            Method::Pwm => to_duty(self.to_logical(self.drive)).raw().into(),
            Method::Position => now.position.to_bits(),
            Method::Velocity if was_driven => now.velocity.to_bits(),
            Method::Velocity => 0,
        };
    }

    /// What the loop rests on has changed: a running channel engages anew, one that was stopped or is
    /// being stopped is off at once, and no target of before counts any more.
    fn start_over(&mut self, method: Method, now: Reading) {
        match self.state {
            State::Running if !self.is_stop => self.engage(method, now),
            State::Running | State::Stopping(_) => self.stopped(),
            State::Off | State::Paused => self.forget(),
        }
        self.method = method;
    }

    /// Sets out for a target of the engaged method from the set-point; positions go the shorter way
    /// from the shaft. A target of another method means nothing here.
    fn head_for(&mut self, target: Target, periods: u16, now: Reading) {
        if target.method != self.method {
            return;
        }
        let set_point = Counts::from_bits(self.set_point);
        let mut way = target.value.saturating_sub(self.set_point);
        self.rest = Counts::ZERO;
        if self.method == Method::Position {
            let ahead = self.track.difference(set_point, now.position);
            let whole = self.track.way(Counts::from_bits(target.value), now.position);
            let whole = whole.saturating_sub(ahead);
            let full_drive = Counts::saturating_from_num(
                FULL_DRIVE_COUNTS.checked_div(self.settings.position.kp.into()).unwrap_or(i32::MAX),
            );
            let full_drive = full_drive.min(Counts::from(i16::MAX));
            self.lead =
                Lead::new(if whole < 0 { ahead.saturating_neg() } else { ahead }, full_drive);
            let most = self.track.farthest_ahead();
            let at_once = if periods == 0 && self.settings.acceleration == 0 {
                whole.clamp(most.saturating_neg(), most)
            } else {
                whole
            };
            self.rest = whole.saturating_sub(at_once);
            way = at_once.to_bits();
        }
        self.target = Some(target);
        self.is_timed = periods > 0;
        self.course = self.course_of(way, periods);
    }

    /// How the set-point gets over a way in so many periods, and within the channel's acceleration.
    fn course_of(&self, way: i32, periods: u16) -> Course {
        let most = i64::from(self.settings.acceleration) << 8; // bits of counts per second and second
        let a_second =
            i64::from(PERIODS_PER_SECOND).saturating_mul(i64::from(way).saturating_abs());
        match self.method {
            Method::Velocity => {
                // Without a limit, none.
                let least = a_second.checked_div(most).unwrap_or(0);
                let least = u16::try_from(least).unwrap_or(u16::MAX);
                Course::Ramp(Ramp::new(way, periods.max(least)))
            }
            Method::Position if most > 0 => {
                let slope = match periods {
                    0 => i64::from(self.full_speed) << 8,
                    periods => a_second.checked_div(periods.into()).unwrap_or(0),
                };
                Course::Profile(Profile::new(way, saturate(slope), most, &self.course))
            }
            Method::Pwm | Method::Position => Course::Ramp(Ramp::new(way, periods)),
        }
    }

    /// Off, with nowhere to go.
    fn stopped(&mut self) {
        self.switch_off(State::Off);
        self.is_stop = true;
        self.is_orphaned = false;
        self.set_point = 0;
        self.forget();
    }

    /// Disabled from this period on: no drive is left that could be taken up again in it.
    fn switch_off(&mut self, state: State) {
        self.state = state;
        self.drive = Drive::ZERO;
        self.handover = 0;
    }

    fn forget(&mut self) {
        self.target = None;
        self.course = Course::NONE;
        self.rest = Counts::ZERO;
        self.pid = Pid::new();
    }

    /// Bridge drive to logical drive, and back.
    fn to_logical(&self, drive: Drive) -> Drive {
        match self.polarity {
            Polarity::Positive => drive,
            Polarity::Negative => drive.saturating_neg(),
        }
    }
}

impl Default for Axis {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether a motion command is a stop: a neutral PWM, or a velocity of 0.
pub fn is_stop(method: Method, target: i16) -> bool {
    method != Method::Position && target == 0
}

fn to_duty(drive: Drive) -> Duty {
    Duty::from_raw(drive.to_bits())
}
