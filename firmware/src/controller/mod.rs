//! The controller: one pure step a control period.
//!
//! ```text
//!   (state, commands, inputs) -> (outputs, snapshot)
//! ```
//!
//! It has no clock, no I/O and no protocol of its own: what a period is worth is
//! [`CONTROL_PERIOD_MS`], commands are [`Command`]s, and the
//! [`Snapshot`] is all that a personality may tell its host.
//!
//! Promises: at boot the outputs are safe; a command is carried out whole or, if any part of it
//! is refused, not at all, and a channel that a fault keeps off takes no part; the same commands
//! and inputs give the same bits on every machine.

mod reason;
mod shaft;
mod snapshot;

use core::{array, mem};

use crate::channel::{CHANNELS, Channel, ChannelSet, ENCODERS, Method, Scope, Sensor};
use crate::command::{Command, Refused};
use crate::control::axis::{Axis, Halt, Reading, is_stop};
use crate::control::pid::Limits;
use crate::control::servo::Servo;
use crate::control::track::scale;
use crate::fmt::warning;
use crate::ports::{MotionInputs, MotorOutput, Outputs, Sensors};
use crate::safety::board::BoardMonitor;
use crate::safety::channel::{ChannelMonitor, Observed};
use crate::safety::faults::{Fault, FaultRecord, Stops, stops};
use crate::safety::latch::Faults;
use crate::safety::{CollisionGuard, LinkEvents, LinkWatch};
use crate::settings::ControlSettings;
use crate::units::{CONTROL_PERIOD_MS, CountsPerSecond};
pub use reason::Reason;
use reason::{RefusedCommand, reason};
use shaft::{Shaft, angle};
pub use snapshot::{
    ChannelSnapshot, ControlCounters, CountRefusal, CountSet, EncoderReading, Refusals, ShownFault,
    Snapshot,
};

/// The controller's state.
pub struct Controller {
    settings: ControlSettings,
    axes: [Axis; CHANNELS],
    servos: [Servo; CHANNELS],
    gpio: u8,
    /// The encoders' shafts, and what the potentiometers say of each channel's.
    encoders: [Shaft; ENCODERS],
    angles: [Shaft; CHANNELS],
    guard: CollisionGuard,
    link: LinkWatch,
    monitors: [ChannelMonitor; CHANNELS],
    board: BoardMonitor,
    faults: Faults,
    /// Of each channel, its last motion command, if that was refused.
    refused: [Option<RefusedCommand>; CHANNELS],
    shown_fault: u8,
    /// Those that have set out in this period.
    moved: ChannelSet,
    count_set: CountSet,
    counters: ControlCounters,
    /// Of the last period. Here, because it is large to be handed on.
    snapshot: Snapshot,
}

impl Controller {
    /// The controller at boot.
    pub fn new(settings: ControlSettings) -> Self {
        let mut axes: [Axis; CHANNELS] = array::from_fn(|_| Axis::new());
        for (channel, axis) in Channel::ALL.into_iter().zip(&mut axes) {
            let own = &settings.channels[channel.index()];
            if let Some(sensor) = own.sensor {
                axis.set_sensor(sensor, Reading::default());
            }
            axis.adopt(&settings, channel);
            axis.set_polarity(own.polarity, Reading::default());
            axis.set_method(own.method, Reading::default());
        }
        Self {
            settings,
            axes,
            servos: [Servo::new(); CHANNELS],
            gpio: 0,
            encoders: Default::default(),
            angles: Default::default(),
            guard: CollisionGuard::default(),
            link: LinkWatch::default(),
            monitors: Default::default(),
            board: BoardMonitor::default(),
            faults: Faults::default(),
            refused: [None; CHANNELS],
            shown_fault: 0,
            moved: ChannelSet::NONE,
            count_set: CountSet::NONE,
            counters: ControlCounters::default(),
            snapshot: Snapshot::BOOT,
        }
    }

    /// Keeps on record what only somebody else can see.
    pub fn record(&mut self, fault: Fault) {
        self.trip(fault, None, [0; 3]);
    }

    /// Tells it that the period that comes begins so late that it missed others, and how many. Set-points
    /// stand still meanwhile; what must be over after a time counts them.
    pub fn periods_missed(&mut self, periods: u16, latency_us: u16) {
        self.counters.periods_missed = self.counters.periods_missed.wrapping_add(1);
        self.pass(periods);
        self.board.period_missed(latency_us);
        self.link.missed(periods);
        self.axes.iter_mut().for_each(|axis| axis.missed(periods));
    }

    fn pass(&mut self, periods: u16) {
        let ms = u32::from(periods).wrapping_mul(CONTROL_PERIOD_MS);
        self.counters.uptime_ms = self.counters.uptime_ms.wrapping_add(ms);
    }

    /// One control period: what may be told of it, which the caller may correct.
    ///
    /// `settings` takes what waits for a [`Command::Adopt`]. `signs_of_life` is a count that changes with
    /// every sign of life of the host. Commands that do not fit the channels' sensors or methods are
    /// refused whole and counted.
    pub fn step(
        &mut self,
        commands: impl IntoIterator<Item = Command>,
        mut settings: impl FnMut() -> Option<ControlSettings>,
        motion: &MotionInputs,
        sensors: &Sensors,
        signs_of_life: u32,
    ) -> &mut Snapshot {
        self.counters.periods = self.counters.periods.wrapping_add(1);
        self.pass(1);
        self.moved = ChannelSet::NONE;
        self.measure(motion);
        for command in commands {
            if let Err(refused) = self.apply(&command, &mut settings, motion) {
                self.counters.refused.count(refused.reason);
                warning!("command refused: {}", refused);
            }
        }
        let ControlSettings { link_timeout, longest_move, .. } = self.settings;
        let LinkEvents { lost, moves_end } =
            self.link.step(signs_of_life, link_timeout, longest_move);
        if lost {
            self.counters.links_lost = self.counters.links_lost.wrapping_add(1);
            warning!("the host is silent: {} ms", link_timeout);
            self.servos.iter_mut().for_each(Servo::link_lost);
            let silence = i16::try_from(link_timeout).unwrap_or(i16::MAX);
            self.trip(Fault::LinkLoss, None, [silence, 0, 0]);
        }
        // What was carried out only now, as behind a save, finds its host silent too.
        for channel in Channel::ALL {
            let is_silenced = lost || self.link.is_lost() && self.moved.has(channel);
            let ends = moves_end || is_silenced && self.link.moves_have_ended();
            if !is_silenced && !ends {
                continue;
            }
            let reading = self.reading(channel);
            let axis = &mut self.axes[channel.index()];
            if is_silenced {
                axis.link_lost(reading);
            }
            if ends {
                axis.end_move(reading);
            }
        }
        if let Some((fault, values)) = self.board.step(sensors, &self.settings.board_faults) {
            let [first, second] = values.map(|value| i16::try_from(value).unwrap_or(i16::MAX));
            self.trip(fault, None, [first, second, 0]);
        }
        let blocked = self.guard.step(sensors, &self.settings.collision);
        let outputs = self.drive(motion, blocked);
        self.tell(motion, sensors, outputs, blocked);
        &mut self.snapshot
    }

    /// Writes down what may be told of this period.
    fn tell(&mut self, motion: &MotionInputs, sensors: &Sensors, outputs: Outputs, blocked: bool) {
        let mut link_loss = self.link.is_lost();
        for channel in Channel::ALL {
            let i = channel.index();
            link_loss |= self.axes[i].halt() == Some(Halt::Silence);
            self.snapshot.channels[i] = self.channel(channel, blocked);
            self.snapshot.servos[i] = self.servos[i].set_point();
            self.snapshot.no_current_sensor[i] =
                !self.settings.current_sensors[i] || self.monitors[i].current_floats();
        }
        let snapshot = &mut self.snapshot;
        for (told, shaft) in snapshot.encoders.iter_mut().zip(&self.encoders) {
            let Reading { position, velocity } = shaft.reading;
            *told = EncoderReading { count: position.to_num(), velocity };
        }
        (snapshot.motion, snapshot.sensors, snapshot.outputs) = (*motion, *sensors, outputs);
        (snapshot.link_loss, snapshot.obstacle) = (link_loss, blocked);
        snapshot.faults = self.faults.latched();
        snapshot.shown_fault = ShownFault {
            place: self.shown_fault,
            total: self.faults.records(),
            record: self.faults.record(self.shown_fault),
        };
        (snapshot.count_set, snapshot.moved) = (self.count_set, self.moved);
        snapshot.counters = self.counters;
    }

    /// What may be told of a channel.
    fn channel(&self, channel: Channel, blocked: bool) -> ChannelSnapshot {
        let i = channel.index();
        let (axis, latched) = (&self.axes[i], self.faults.latched());
        let forward = self.settings.collision.forward_is_positive.get(i).copied();
        let obstacle = forward.filter(|_| blocked);
        let limiting = || self.monitors[i].limiting();
        let (position, velocity) = match self.shaft(channel, axis.sensor()) {
            Some(shaft) => (shaft.unwrapped(), shaft.reading.velocity),
            None => (0, CountsPerSecond::ZERO),
        };
        ChannelSnapshot {
            position,
            velocity,
            set_point: axis.set_point(),
            reason: reason(channel, axis, &latched, self.refused[i], obstacle, limiting),
        }
    }

    /// Where a channel is, by the sensor that it uses.
    fn reading(&self, channel: Channel) -> Reading {
        self.reading_by(channel, self.axes[channel.index()].sensor())
    }

    /// Where a channel is, by this sensor.
    fn reading_by(&self, channel: Channel, sensor: Sensor) -> Reading {
        self.shaft(channel, sensor).map(|shaft| shaft.reading).unwrap_or_default()
    }

    fn shaft(&self, channel: Channel, sensor: Sensor) -> Option<&Shaft> {
        match sensor {
            Sensor::Encoder => self.encoders.get(channel.index()),
            Sensor::SinglePotentiometer | Sensor::DualPotentiometer => {
                self.angles.get(channel.index())
            }
        }
    }

    fn measure(&mut self, motion: &MotionInputs) {
        for (shaft, count) in self.encoders.iter_mut().zip(motion.encoders) {
            shaft.update_count(count);
        }
        for channel in Channel::ALL {
            let sensor = self.axes[channel.index()].sensor();
            if let Some(angle) = angle(channel, sensor, motion) {
                self.angles[channel.index()].update(angle, scale(sensor));
            }
        }
    }

    fn drive(&mut self, motion: &MotionInputs, blocked: bool) -> Outputs {
        let mut outputs = Outputs { gpio: self.gpio, ..Outputs::default() };
        let latched = self.faults.latched();
        for channel in Channel::ALL {
            let i = channel.index();
            let (monitor, collision) = (&self.monitors[i], &self.settings.collision);
            let limits = || {
                let mut limits = Limits::FULL;
                if let Some(&positive) = collision.forward_is_positive.get(i)
                    && blocked
                {
                    let bound = if positive { &mut limits.high } else { &mut limits.low };
                    *bound = Default::default();
                }
                monitor.limit(&mut limits);
                limits
            };
            let reading = self.reading(channel);
            let output = self.axes[i].step(reading, limits);
            // Whatever channel and servo are about: what is latched is off.
            let output = match latched.stops_motor(channel) {
                true => MotorOutput::default(),
                false => output,
            };
            outputs.motors[i] = self.watch(channel, output, reading, motion);
            if !latched.stops_servos() {
                outputs.servos[i] = self.servos[i].step();
            }
        }
        outputs
    }

    /// What a channel's monitor leaves of its drive: all of it, or nothing.
    fn watch(
        &mut self,
        channel: Channel,
        output: MotorOutput,
        reading: Reading,
        motion: &MotionInputs,
    ) -> MotorOutput {
        let i = channel.index();
        let (axis, monitor) = (&self.axes[i], &mut self.monitors[i]);
        let (current, has_current_sensor) = (motion.currents[i], self.settings.current_sensors[i]);
        let faults = &self.settings.channel_faults;
        let tripped = if output.enabled {
            let observed = Observed {
                current,
                has_current_sensor,
                duty: output.duty,
                drive: axis.drive(),
                sensor: axis.sensor(),
                reading,
                full_speed: self.settings.known_full_speed(channel, axis.sensor()),
                set_point: axis.set_point(),
                deviation: axis.deviation(reading),
                is_at_soft_limit: axis.is_at_soft_limit(),
                sensor_is_chosen: self.settings.channels[i].sensor.is_some(),
            };
            monitor.step(&observed, faults)
        } else {
            monitor.step_off(current, has_current_sensor, faults)
        };
        let Some((fault, values)) = tripped else { return output };
        self.trip(fault, Some(channel), values);
        match stops(fault) {
            Stops::Nothing => output,
            Stops::Channel | Stops::Motors | Stops::MotorsAndServos => MotorOutput::default(),
        }
    }

    /// Latches a fault, and stops what it stops.
    fn trip(&mut self, fault: Fault, channel: Option<Channel>, values: [i16; 3]) {
        let uptime_ms = self.counters.uptime_ms;
        if !self.faults.trip(FaultRecord { fault, channel, uptime_ms, values }) {
            return;
        }
        warning!("fault: {:?}", fault);
        let latched = self.faults.latched();
        for channel in Channel::ALL {
            if latched.stops_motor(channel) {
                self.axes[channel.index()].trip();
            }
        }
        if latched.stops_servos() {
            self.servos.iter_mut().for_each(Servo::trip);
        }
    }

    /// A host has stopped this channel, which clears its latch as a resume would.
    fn stopped_by_host(&mut self, channel: Channel, motion: &MotionInputs) {
        let over_current = self.settings.channel_faults.over_current;
        let is_calm = over_current == 0 || motion.currents[channel.index()] < over_current;
        let (board, settings) = (&self.board, &self.settings.board_faults);
        let lasts = |fault| board.lasts(fault, settings);
        self.faults.stopped(channel, self.counters.uptime_ms, is_calm, lasts);
    }

    fn clear_faults(&mut self, scope: Scope, only_stops: bool) {
        let (board, settings) = (&self.board, &self.settings.board_faults);
        self.faults.clear(scope, only_stops, |fault| board.lasts(fault, settings));
    }

    /// Goes by these settings from now on. What of a channel has not changed stays as it is.
    fn adopt(&mut self, settings: &ControlSettings, motion: &MotionInputs) {
        let before = mem::replace(&mut self.settings, *settings);
        if settings.board_faults != before.board_faults {
            self.board.forget_looks();
        }
        for channel in Channel::ALL {
            let i = channel.index();
            let (old, new) = (&before.channels[i], &settings.channels[i]);
            if let Some(sensor) = new.sensor
                && new.sensor != old.sensor
            {
                self.set_sensor(channel, sensor, motion);
            }
            let reading = self.reading(channel);
            let axis = &mut self.axes[i];
            axis.adopt(settings, channel);
            axis.set_polarity(new.polarity, reading);
            if new.method != old.method {
                axis.set_method(new.method, reading);
            }
        }
    }

    fn apply(
        &mut self,
        command: &Command,
        settings: &mut impl FnMut() -> Option<ControlSettings>,
        motion: &MotionInputs,
    ) -> Result<(), Refused> {
        match *command {
            Command::MoveMotors { method, targets, periods, origin } => {
                self.go(method, &targets, periods, origin, motion)
            }
            Command::MoveServos { .. } | Command::SlewServos(_)
                if self.faults.latched().stops_servos() =>
            {
                Ok(())
            }
            Command::MoveServos { targets, periods } => {
                for (servo, target) in self.servos.iter_mut().zip(targets) {
                    if let Some(target) = target {
                        servo.go(target, periods);
                    }
                }
                Ok(())
            }
            Command::SlewServos(slews) => {
                for (servo, slew) in self.servos.iter_mut().zip(slews) {
                    if let Some(slew) = slew {
                        servo.slew(slew);
                    }
                }
                Ok(())
            }
            Command::Adopt => {
                if let Some(settings) = settings() {
                    self.adopt(&settings, motion);
                }
                Ok(())
            }
            Command::Run { scope, run } => {
                if run {
                    self.clear_faults(scope, true);
                }
                let latched = self.faults.latched();
                for channel in Channel::ALL {
                    if scope == Scope::All || scope == Scope::Motor(channel) {
                        let reading = self.reading(channel);
                        let axis = &mut self.axes[channel.index()];
                        // What a fault has stopped is not paused: to resume it moves nothing.
                        if run {
                            axis.resume(reading);
                        } else {
                            axis.suspend();
                            self.stopped_by_host(channel, motion);
                        }
                    }
                    if scope == Scope::All || scope == Scope::Servo(channel) {
                        let servo = &mut self.servos[channel.index()];
                        match run {
                            true if latched.stops_servos() => {}
                            true => servo.resume(),
                            false => servo.suspend(),
                        }
                    }
                }
                Ok(())
            }
            Command::Gpio(outputs) => {
                self.gpio = outputs;
                Ok(())
            }
            Command::ClearFaults(scope) => {
                self.clear_faults(scope, false);
                Ok(())
            }
            Command::ShowFault(place) => {
                self.shown_fault = place;
                Ok(())
            }
            Command::Record(fault) => {
                self.record(fault);
                Ok(())
            }
            Command::SetCount { channel, count, serial } => {
                let refused = self.set_count(channel, count).err();
                self.count_set = CountSet { serial, refused };
                Ok(())
            }
        }
    }

    fn go(
        &mut self,
        method: Method,
        targets: &[Option<i16>; CHANNELS],
        periods: u16,
        origin: u8,
        motion: &MotionInputs,
    ) -> Result<(), Refused> {
        let moves = || {
            Channel::ALL.into_iter().zip(targets).filter_map(|(c, target)| Some((c, (*target)?)))
        };
        let refused = moves().find_map(|(channel, target)| {
            let sensor = self.sensor_for(channel, method);
            let reason = self.axes[channel.index()].check(method, target, sensor).err()?;
            Some(Refused { channel, reason })
        });
        for (channel, _) in moves() {
            let why = refused.map(|Refused { reason: why, .. }| RefusedCommand { why, origin });
            self.refused[channel.index()] = why;
        }
        if let Some(refused) = refused {
            return Err(refused);
        }
        // A stop that clears a latch does no more.
        let latched = self.faults.latched();
        for (channel, _) in moves().filter(|&(_, target)| is_stop(method, target)) {
            self.stopped_by_host(channel, motion);
        }
        for (channel, target) in moves().filter(|&(channel, _)| !latched.stops_motor(channel)) {
            self.set_sensor(channel, self.sensor_for(channel, method), motion);
            let reading = self.reading(channel);
            self.axes[channel.index()].go(method, target, periods, reading);
            self.moved = self.moved.with(channel);
        }
        Ok(())
    }

    fn set_count(&mut self, channel: Channel, count: i32) -> Result<(), CountRefusal> {
        let axis = &mut self.axes[channel.index()];
        let shaft = self.encoders.get_mut(channel.index()).ok_or(CountRefusal::NoEncoder)?;
        if axis.sensor() == Sensor::Encoder {
            axis.forget_paused();
        }
        if axis.is_on() {
            return Err(CountRefusal::NotOff);
        }
        shaft.set_count(count);
        Ok(())
    }

    /// What a motion command of this method is measured by. Hosts exist that never choose a sensor and
    /// expect closed loops over the encoders.
    fn sensor_for(&self, channel: Channel, method: Method) -> Sensor {
        let i = channel.index();
        let is_implied = self.settings.channels[i].sensor.is_none() && i < ENCODERS;
        if is_implied && method != Method::Pwm { Sensor::Encoder } else { self.axes[i].sensor() }
    }

    fn set_sensor(&mut self, channel: Channel, sensor: Sensor, motion: &MotionInputs) {
        let i = channel.index();
        if sensor != self.axes[i].sensor() {
            self.angles[i] = Shaft::default();
            self.monitors[i].forget_motion();
            if let Some(angle) = angle(channel, sensor, motion) {
                self.angles[i].update(angle, scale(sensor));
            }
            let reading = self.reading_by(channel, sensor);
            self.axes[i].set_sensor(sensor, reading);
            self.axes[i].adopt(&self.settings, channel);
        }
    }
}
