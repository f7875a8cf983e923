//! One DC channel: what drives it, where it is going, and whether it may.
//!
//! Vocabulary: the *method* is what the set-point means (duty, position, velocity); the
//! *set-point* is what the loop is asked for now, the *target* what it will be asked for when
//! the ramp is over. *Logical* drive is positive when it makes the sensor's counts rise; the
//! polarity turns it into the bridge's. Direct PWM is the bridge's own, whatever the polarity.
//!
//! Promises:
//! - Disabled means neutral. A channel is enabled by a motion command or by a resume, by nothing
//!   else.
//! - A change of method, sensor or polarity takes over from where the shaft and the drive are: a
//!   loop starts with its set-point at the measurement, and what the drive differs from the
//!   loop's own output fades away with a time constant of 32 ms.
//! - A suspended move goes on where it was suspended: from where the shaft is then, to its
//!   target, in the periods that were left.
//! - After a stop by link loss nothing moves before the next motion command; a resume holds.

use fixed::{
    FixedI32,
    types::{I32F32, extra::U24},
};
use protocol::pms5005::{Loop, Method, Polarity, Sensor};

use super::pid::{Gains, HostGains, Limits, Pid};
use super::ring::Scale;
use super::trajectory::Ramp;
use crate::ports::MotorOutput;
use crate::units::{Counts, CountsPerSecond, Duty};

/// Periods in which a stop by link loss brings the set-point to rest, and after which the bridge
/// is switched off (a stop of category 1 in the sense of IEC 60204-1).
const STOP_RAMP: u16 = 60;
const STOP_OFF: u16 = 95;

/// A difference of drives fades by 1/32 a period.
const FADE_SHIFT: u32 = 5;

/// What the channel's sensor says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reading {
    /// Position on the sensor's scale.
    pub position: Counts,
    /// Velocity.
    pub velocity: CountsPerSecond,
}

/// Why a channel does not take a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum AxisRefusal {
    /// The target lies beyond the sensor's scale.
    BeyondScale,
    /// The channel was set to another method (sub-command 0E).
    OtherMethod,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// Disabled since boot.
    Idle,
    Running,
    Suspended,
    /// Coming to rest because the host is silent; so many periods until the bridge is off.
    Stopping(u16),
    /// Disabled because the host fell silent.
    Stopped,
}

/// One DC channel. See the [module](self).
#[derive(Clone, Debug)]
pub struct Axis {
    state: State,
    method: Method,
    /// What sub-command 0E chose; until then every motion command chooses for itself.
    chosen_method: Option<Method>,
    sensor: Sensor,
    sensor_chosen: bool,
    polarity: Polarity,

    host_gains: [HostGains; 2],
    position_gains: Gains,
    velocity_gains: Gains,
    /// Drive a count per second, in parts of full drive.
    feed_forward: FixedI32<U24>,

    /// Bits of [`Counts`], of [`CountsPerSecond`], or a raw [`Duty`], by method.
    set_point: i32,
    /// As the set-point; `None` when there is nowhere to go.
    target: Option<i32>,
    ramp: Ramp,
    pid: Pid,
    last_velocity: CountsPerSecond,
    /// Logical drive of the last period.
    drive: I32F32,
    /// What is left of the drive before the last take-over, beyond the loop's own.
    fading: I32F32,
    /// The next period has to measure what fades.
    taking_over: bool,
}

impl Axis {
    /// A channel at boot: disabled, one potentiometer, the original's gains.
    pub fn new() -> Self {
        let host_gains = HostGains::DEFAULT;
        Self {
            state: State::Idle,
            method: Method::Pwm,
            chosen_method: None,
            sensor: Sensor::SinglePotentiometer,
            sensor_chosen: false,
            polarity: Polarity::Positive,
            host_gains: [host_gains; 2],
            position_gains: Gains::new(Loop::Position, host_gains),
            velocity_gains: Gains::new(Loop::Velocity, host_gains),
            feed_forward: FixedI32::ZERO,
            set_point: 0,
            target: None,
            ramp: Ramp::NONE,
            pid: Pid::new(),
            last_velocity: CountsPerSecond::ZERO,
            drive: I32F32::ZERO,
            fading: I32F32::ZERO,
            taking_over: false,
        }
    }

    /// The sensor in use.
    pub fn sensor(&self) -> Sensor {
        self.sensor
    }

    /// The scale of the sensor in use.
    pub fn scale(&self) -> Scale {
        scale(self.sensor)
    }

    /// Whether the channel was stopped, or is being stopped, because the host fell silent.
    pub fn is_stopped_by_link_loss(&self) -> bool {
        matches!(self.state, State::Stopping(_) | State::Stopped)
    }

    /// Whether a motion command would be taken. `target` is as on the wire, a duty for PWM.
    ///
    /// # Errors
    /// Says why not. A neutral PWM is a stop and always taken.
    pub fn check(&self, method: Method, target: i16) -> Result<(), AxisRefusal> {
        let highest = match self.sensor {
            Sensor::SinglePotentiometer => 4095,
            Sensor::DualPotentiometer => 4428,
            Sensor::Encoder => i16::MAX,
        };
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
        if self.state != State::Running || self.method != method {
            self.engage(method, now);
        }
        let bits = match method {
            Method::Pwm => target.into(),
            // The full turn of two potentiometers is the same place as 0.
            Method::Position => match self.scale() {
                Scale::Circle(turn) if i32::from(target) == i32::from(turn) => 0,
                _ => Counts::from_num(target).to_bits(),
            },
            Method::Velocity => CountsPerSecond::from_num(target).to_bits(),
        };
        self.head_for(bits, periods, now);
        if method == Method::Pwm && periods == 0 {
            // What a host writes into the PWM stands there at once.
            self.fading = I32F32::ZERO;
            self.taking_over = false;
        }
    }

    /// Suspends the channel: neutral and disabled, the rest of its move kept.
    pub fn suspend(&mut self) {
        match self.state {
            State::Idle | State::Running => self.state = State::Suspended,
            State::Stopping(_) => self.stopped(),
            State::Suspended | State::Stopped => {}
        }
    }

    /// Resumes the channel: it goes on with its move, or holds where it is if it has none.
    pub fn resume(&mut self, now: Reading) {
        match self.state {
            State::Running | State::Stopping(_) => {}
            State::Idle | State::Suspended | State::Stopped => {
                let (target, left) = (self.target, self.ramp.left());
                self.engage(self.chosen_method.unwrap_or(self.method), now);
                if let Some(target) = target {
                    self.head_for(target, left, now);
                }
            }
        }
    }

    /// The host has fallen silent: PWM and velocity come to rest within 100 ms and switch off; a
    /// position is held where the set-point is now, a move in progress is broken off. Nothing is
    /// left that a resume could set in motion again.
    pub fn link_lost(&mut self) {
        match (self.state, self.method) {
            (State::Running, Method::Pwm | Method::Velocity) => {
                self.target = Some(0);
                self.ramp = Ramp::new(self.set_point.saturating_neg(), STOP_RAMP);
                self.state = State::Stopping(STOP_OFF);
            }
            (State::Running, Method::Position) => {
                self.target = Some(self.set_point);
                self.ramp = Ramp::NONE;
            }
            (State::Suspended, _) => {
                self.target = None;
                self.ramp = Ramp::NONE;
            }
            (State::Idle | State::Stopping(_) | State::Stopped, _) => {}
        }
    }

    /// Sub-command 0E. A running channel takes up the new method where it is.
    pub fn set_method(&mut self, method: Method, now: Reading) {
        self.chosen_method = Some(method);
        if method == self.method {
            return;
        }
        match self.state {
            State::Running => self.engage(method, now),
            State::Stopping(_) => self.stopped(),
            _ => {}
        }
        self.method = method;
        if self.state != State::Running {
            self.target = None;
            self.ramp = Ramp::NONE;
        }
    }

    /// Sub-command 0D, or what a command implies until then. `now` is the new sensor's reading;
    /// a running loop holds there.
    pub fn set_sensor(&mut self, sensor: Sensor, chosen: bool, now: Reading) {
        self.sensor_chosen |= chosen;
        if sensor == self.sensor {
            return;
        }
        self.sensor = sensor;
        if self.method != Method::Pwm {
            if self.state == State::Running {
                self.engage(self.method, now);
            } else {
                self.target = None;
                self.ramp = Ramp::NONE;
            }
        }
    }

    /// Whether sub-command 0D has chosen the sensor.
    pub fn sensor_is_chosen(&self) -> bool {
        self.sensor_chosen
    }

    /// Sub-command 06. The bridge's drive does not jump.
    pub fn set_polarity(&mut self, polarity: Polarity, now: Reading) {
        if polarity == self.polarity {
            return;
        }
        self.polarity = polarity;
        self.drive = self.drive.saturating_neg();
        if self.state == State::Running && self.method != Method::Pwm {
            self.engage(self.method, now);
        }
    }

    /// Sub-commands 07 and 08.
    pub fn set_gains(&mut self, control_loop: Loop, gains: HostGains) {
        match control_loop {
            Loop::Position => {
                self.host_gains = [gains, self.gains(Loop::Velocity)];
                self.position_gains = Gains::new(control_loop, gains);
            }
            Loop::Velocity => {
                self.host_gains = [self.gains(Loop::Position), gains];
                self.velocity_gains = Gains::new(control_loop, gains);
            }
        }
    }

    /// The gains in use, as the host numbers them.
    pub fn gains(&self, control_loop: Loop) -> HostGains {
        let [position, velocity] = self.host_gains;
        match control_loop {
            Loop::Position => position,
            Loop::Velocity => velocity,
        }
    }

    /// Tells the channel how many counts per second its motor makes at full drive.
    pub fn set_full_speed(&mut self, counts_per_second: u32) {
        self.feed_forward = FixedI32::<U24>::ONE
            .checked_div_int(i32::try_from(counts_per_second).unwrap_or(i32::MAX))
            .unwrap_or(FixedI32::ZERO);
    }

    /// One period: what the bridge is to do. `limits` bound the logical drive.
    pub fn step(&mut self, now: Reading, limits: &Limits) -> MotorOutput {
        let off = match self.state {
            State::Running => false,
            State::Stopping(0) => {
                self.stopped();
                true
            }
            State::Stopping(left) => {
                self.state = State::Stopping(left.saturating_sub(1));
                false
            }
            State::Idle | State::Suspended | State::Stopped => true,
        };
        let rate = now.velocity.saturating_sub(self.last_velocity);
        self.last_velocity = now.velocity;
        if off {
            self.drive = I32F32::ZERO;
            return MotorOutput { duty: Duty::NEUTRAL, enabled: false };
        }
        let slope = CountsPerSecond::from_bits(self.ramp.slope());
        self.move_set_point();
        let fading = self.fade(now, rate, slope);
        let drive = match self.method {
            Method::Pwm => {
                let bridge = I32F32::from_bits(i64::from(self.set_point) << 18);
                self.to_logical(bridge).saturating_add(fading).clamp(limits.low, limits.high)
            }
            _ => self.closed_loop(now, rate, slope, fading, limits),
        };
        self.drive = drive;
        MotorOutput { duty: to_duty(self.to_logical(drive)), enabled: true }
    }

    /// The loop's own output, with what fades on top.
    fn closed_loop(
        &mut self,
        now: Reading,
        rate: CountsPerSecond,
        slope: CountsPerSecond,
        fading: I32F32,
        limits: &Limits,
    ) -> I32F32 {
        let set_point = Counts::from_bits(self.set_point);
        if self.method == Method::Position {
            let error = self.scale().difference(set_point, now.position);
            // On a ramp the shaft is meant to move: only what differs from the slope is damped.
            let rate = now.velocity.saturating_sub(slope);
            let forward = self.feed_forward.wide_mul(slope).saturating_add(fading);
            self.pid.step(&self.position_gains, error, rate, forward, limits)
        } else {
            let error = set_point.saturating_sub(now.velocity);
            let forward = self.feed_forward.wide_mul(set_point).saturating_add(fading);
            self.pid.step(&self.velocity_gains, error, rate, forward, limits)
        }
    }

    /// What is left of the drive from before the last take-over.
    fn fade(&mut self, now: Reading, rate: CountsPerSecond, slope: CountsPerSecond) -> I32F32 {
        if self.taking_over {
            self.taking_over = false;
            let own = if self.method == Method::Pwm {
                self.to_logical(I32F32::from_bits(i64::from(self.set_point) << 18))
            } else {
                let mut trial = self.clone();
                trial.closed_loop(now, rate, slope, I32F32::ZERO, &Limits::FULL)
            };
            self.fading = self.drive.saturating_sub(own);
        } else {
            self.fading = self.fading.saturating_sub(self.fading.wrapping_shr(FADE_SHIFT));
        }
        self.fading
    }

    /// Starts a method from where shaft and drive are, holding there.
    fn engage(&mut self, method: Method, now: Reading) {
        self.taking_over = matches!(self.state, State::Running | State::Stopping(_));
        self.fading = I32F32::ZERO;
        self.method = method;
        self.state = State::Running;
        self.pid = Pid::new();
        self.ramp = Ramp::NONE;
        self.target = None;
        self.set_point = match method {
            Method::Pwm => to_duty(self.to_logical(self.drive)).raw().into(),
            Method::Position => now.position.to_bits(),
            Method::Velocity if self.taking_over => now.velocity.to_bits(),
            Method::Velocity => 0,
        };
    }

    /// Sets out for a target from the set-point; positions go the shorter way from the shaft.
    fn head_for(&mut self, target: i32, periods: u16, now: Reading) {
        let way = if self.method == Method::Position {
            let from_shaft =
                |bits| self.scale().difference(Counts::from_bits(bits), now.position).to_bits();
            from_shaft(target).saturating_sub(from_shaft(self.set_point))
        } else {
            target.saturating_sub(self.set_point)
        };
        self.target = Some(target);
        self.ramp = Ramp::new(way, periods);
    }

    fn move_set_point(&mut self) {
        let increment = self.ramp.advance();
        self.set_point = if self.method == Method::Position {
            let (position, way) = (Counts::from_bits(self.set_point), Counts::from_bits(increment));
            self.scale().advance(position, way).to_bits()
        } else {
            self.set_point.saturating_add(increment)
        };
    }

    fn stopped(&mut self) {
        self.state = State::Stopped;
        self.target = None;
        self.ramp = Ramp::NONE;
        self.set_point = 0;
        self.pid = Pid::new();
        self.fading = I32F32::ZERO;
        self.taking_over = false;
    }

    /// Bridge drive to logical drive, and back.
    fn to_logical(&self, drive: I32F32) -> I32F32 {
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

/// The scale of a sensor.
pub fn scale(sensor: Sensor) -> Scale {
    match sensor {
        Sensor::SinglePotentiometer => Scale::Line,
        Sensor::DualPotentiometer => Scale::DUAL_POTENTIOMETER,
        Sensor::Encoder => Scale::ENCODER,
    }
}

/// Drive in parts of full drive to a duty, rounded to the nearest.
fn to_duty(drive: I32F32) -> Duty {
    let rounded = drive.to_bits().saturating_add(1 << 17) >> 18;
    Duty::from_raw(i32::try_from(rounded).unwrap_or(if rounded < 0 { i32::MIN } else { i32::MAX }))
}
