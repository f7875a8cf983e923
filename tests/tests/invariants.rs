//! What holds in every control period, whatever hosts, sensors and lines do: a day of random
//! commands, damaged bytes, pulled plugs, jammed shafts, obstacles and silences, from fixed seeds.
//!
//! Bytes go through the session into the controller, and its outputs into the simulated world. The
//! model beside it is small: who may be enabled at all, and which way the wheels may turn.

use std::thread;

use embassy_time::Instant;
use firmware::channel::{Channel, Polarity, Scope};
use firmware::command::Command;
use firmware::controller::{Controller, Snapshot};
use firmware::personality::Boot;
use firmware::personality::pms5005::Pms5005;
use firmware::personality::{Effect, MAX_FRAME, Session};
use firmware::ports::Sensors;
use firmware::safety::faults::Fault;
use firmware::settings::{ControlSettings, Settings, SoftLimits};
use hal_mock::plant::{Overrides, Plant, Scene};
use protocol::extension::{Action, Request as Extension};
use protocol::pms5005::{
    self as wire, Addressing, CHANNELS, Data, Gain, Loop, Method, Move, Parameter, Parameters,
    Quantity, Repeat, Reports, Sensor,
};
use tests::At;

/// Four seeds of six hours are a day.
const SEEDS: u64 = 4;
/// Periods of 1 ms for each seed.
const PERIODS: u32 = 6 * 3_600_000;

/// The channel with soft limits: it has no sensor but its potentiometer.
const LIMITED: Channel = Channel::ALL[5];
const SOFT: SoftLimits = SoftLimits { low: 1000, high: 3000 };

/// A small generator, so that the sequence is the same for ever.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: u32) -> u32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as u32) % bound
    }

    fn one_in(&mut self, n: u32) -> bool {
        self.below(n) == 0
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len() as u32) as usize]
    }

    fn channel(&mut self) -> wire::Channel {
        self.of(&wire::Channel::ALL)
    }

    fn parameter(&mut self) -> Parameter {
        let channel = self.channel();
        match self.below(6) {
            0 => Parameter::Polarity(
                channel,
                self.of(&[wire::Polarity::Positive, wire::Polarity::Negative]),
            ),
            1 => {
                let sensors =
                    [Sensor::SinglePotentiometer, Sensor::DualPotentiometer, Sensor::Encoder];
                Parameter::Sensor(channel, self.of(&sensors))
            }
            2 => Parameter::Method(
                channel,
                self.of(&[Method::Pwm, Method::Position, Method::Velocity]),
            ),
            3 => Parameter::CollisionProtection(self.one_in(2)),
            _ => {
                let word = self.of(&[0, 1, 50, 50, 5000, u16::MAX]);
                let [integer, fraction] = word.to_le_bytes();
                let gain = match self.below(3) {
                    0 => Gain::Proportional(word),
                    1 => Gain::Derivative(word),
                    _ => Gain::Integral { integer, fraction },
                };
                Parameter::Gain(channel, self.of(&[Loop::Position, Loop::Velocity]), gain)
            }
        }
    }

    /// A frame of a host, with one parameter in it at most.
    fn frame<'b>(&mut self, buffer: &'b mut [u8]) -> Option<&'b mut [u8]> {
        let mut data = Data::new();
        let scopes = [
            wire::Scope::All,
            wire::Scope::Motor(self.channel()),
            wire::Scope::Servo(self.channel()),
        ];
        let command = match self.below(9) {
            0..4 => {
                let quantity = self.of(&[
                    Quantity::Pwm,
                    Quantity::Position,
                    Quantity::Velocity,
                    Quantity::Servo,
                ]);
                let mut targets = [None; CHANNELS];
                for target in &mut targets {
                    if self.one_in(2) {
                        let magnitude = self.below(32_768) as i16;
                        *target = Some(match quantity {
                            Quantity::Position => magnitude >> self.below(4),
                            Quantity::Servo => 500 + magnitude % 6501,
                            Quantity::Velocity if self.one_in(2) => -magnitude,
                            Quantity::Velocity | Quantity::Pwm => magnitude,
                        });
                    }
                }
                let periods = self.of(&[0, 1, 30, 500, u16::MAX]);
                let addressing = self.of(&[Addressing::List, Addressing::All]);
                wire::Command::Move(Move { quantity, addressing, targets, periods })
            }
            4 | 5 => {
                self.parameter().emit(&mut data).ok()?;
                wire::Command::Parameters(Parameters::parse(&data).ok()?)
            }
            6 => wire::Command::Run { scope: self.of(&scopes), run: !self.one_in(4) },
            7 => wire::Command::Telemetry { reports: Reports::All, repeat: Repeat::Continuous },
            _ if self.one_in(2) => wire::Command::Extension(Extension::Do(Action::ClearFaults)),
            _ => wire::Command::GpioOutputs(self.below(256) as u8),
        };
        command.encode(0, buffer).ok()
    }

    /// One more thing goes wrong in the world, or all of it is right again.
    fn disturb(&mut self, world: &mut Overrides, motor: usize, encoder: u16) {
        let reading = self.of(&[Some(0), Some(4095), Some(2047), Some(self.0 as u16 & 0xFFF)]);
        match self.below(12) {
            0 => world.encoders[motor % 2] = Some(encoder),
            1 => world.potentiometers[motor] = reading,
            2 => world.currents[motor] = reading,
            3 => world.jam[motor] = Some(true),
            4 => world.battery[motor % 3] = self.of(&[Some(800), Some(1800), Some(3500), reading]),
            5 => world.overheat[motor % 2] = self.of(&[Some(1000), reading]),
            6 => world.temperature = self.of(&[Some(3900), reading]),
            7 | 8 => world.sonar_cm = [self.of(&[Some(10), Some(33), None]); 6],
            _ => *world = Overrides::default(),
        }
    }
}

#[test]
fn no_period_of_a_day_of_chaos_breaks_a_promise() {
    let seen: Vec<_> = thread::scope(|scope| {
        let days: Vec<_> = (1..=SEEDS).map(|seed| scope.spawn(move || chaos(seed))).collect();
        days.into_iter().map(|day| day.join().unwrap()).collect()
    });
    for fault in Fault::ALL {
        let times: u32 = seen.iter().map(|seen| seen[usize::from(fault.number())]).sum();
        println!("{fault:?}: {times} times");
        let needs_a_line_or_a_start =
            matches!(fault, Fault::ReceiveOverrun | Fault::SettingsCorrupt | Fault::WatchdogReset);
        assert!(times >= 10 || needs_a_line_or_a_start, "no chaos: {fault:?} {times} times");
    }
}

/// What a host has asked for, and not taken back.
#[derive(Default)]
struct Model {
    /// Which DC channels may be on; which servos, and which ever had a pulse.
    motors: [bool; CHANNELS],
    servos: [bool; CHANNELS],
    pulsed: [bool; CHANNELS],
    reversed: [bool; CHANNELS],
    /// Periods since each DC channel was latched off; since a frame came.
    latched: [u32; CHANNELS],
    silence: u32,
    /// Periods in which a wheel could have driven towards an obstacle, and the limited channel
    /// farther beyond its limit.
    obstacles: u32,
    beyond: u32,
}

impl Model {
    /// A command that was taken: `before` is what was true when it came.
    fn take(&mut self, command: &Command, before: &Snapshot) {
        match *command {
            Command::MoveMotors { targets, .. } => {
                for (channel, target) in Channel::ALL.into_iter().zip(targets) {
                    self.motors[channel.index()] |=
                        target.is_some() && !before.faults.stops_motor(channel);
                }
            }
            Command::MoveServos { targets, .. } if !before.faults.stops_servos() => {
                for (i, _) in targets.iter().enumerate().filter(|(_, target)| target.is_some()) {
                    (self.servos[i], self.pulsed[i]) = (true, true);
                }
            }
            Command::Run { scope, run } => {
                for channel in Channel::ALL {
                    if scope == Scope::All || scope == Scope::Motor(channel) {
                        self.motors[channel.index()] = run;
                    }
                    if scope == Scope::All || scope == Scope::Servo(channel) {
                        self.servos[channel.index()] = run;
                    }
                }
            }
            _ => {}
        }
    }

    /// New settings were taken.
    fn take_settings(&mut self, settings: &ControlSettings) {
        for (reversed, channel) in self.reversed.iter_mut().zip(&settings.channels) {
            *reversed = channel.polarity == Polarity::Negative;
        }
    }

    /// A period is over.
    fn check(&mut self, now: &Snapshot, plant: &Plant, at: &dyn Fn() -> String) {
        for channel in Channel::ALL {
            let i = channel.index();
            let (motor, servo) = (now.outputs.motors[i], now.outputs.servos[i]);
            let duty = motor.duty.raw();
            let at = || format!("{}, channel {i}: {motor:?} {servo:?}", at());
            assert!(motor.enabled || duty == 0, "disabled is neutral: {}", at());
            assert!(duty.abs() <= 16_384, "beyond full drive: {}", at());
            assert!(!motor.enabled || self.motors[i], "nobody has enabled it: {}", at());
            let is_in_range = servo.is_none_or(|pulse| (500..=7000).contains(&pulse.raw()));
            assert!(is_in_range, "no pulse for a servo: {}", at());
            assert!(
                servo.is_none() || (self.servos[i] && self.pulsed[i]),
                "nobody has enabled it: {}",
                at()
            );
            if now.faults.stops_motor(channel) {
                assert!(!motor.enabled, "driven under a fault: {}", at());
                self.motors[i] = false;
                self.latched[i] += 1;
                let is_still = self.latched[i] < 5000 || plant.motors[i].velocity() == 0.0;
                assert!(is_still, "in motion under a fault: {}", at());
            } else {
                self.latched[i] = 0;
            }
            if now.faults.stops_servos() {
                assert!(servo.is_none(), "a pulse under a fault: {}", at());
                self.servos[i] = false;
            }
            let upwards = if self.reversed[i] { -duty } else { duty };
            self.obstacles += u32::from(now.obstacle && i <= 1 && self.motors[i]);
            assert!(!now.obstacle || i > 1 || upwards <= 0, "towards an obstacle: {}", at());
            if channel == LIMITED {
                let position = now.motion.potentiometers[i] as i16;
                let is_within =
                    (position < SOFT.high || upwards <= 0) && (position > SOFT.low || upwards >= 0);
                self.beyond +=
                    u32::from(motor.enabled && !(SOFT.low..SOFT.high).contains(&position));
                assert!(is_within, "beyond its soft limit {position}: {}", at());
            }
        }
        assert!(self.silence < 2000 || now.link_loss, "silence is noticed: {}", at());
    }
}

/// How often each fault has tripped in six hours of this seed.
fn chaos(seed: u64) -> [u32; 32] {
    let mut random = Random(seed);
    let mut settings = Settings::DEFAULT;
    settings.control.board_faults.motor_battery_high = 3000;
    settings.control.channel_faults.thermal_s = 1; // or hardly any motor is hot before it is commanded anew
    settings.control.soft_limits[LIMITED.index()] = SOFT;
    let mut controller = Controller::new(settings.control);
    let mut session = Pms5005::new(settings, Boot::default(), Instant::from_millis(0));
    let mut plant = Plant::new(Scene::default(), seed);
    let mut sensors = Sensors::UNKNOWN;
    let mut model = Model::default();
    let mut snapshot = Snapshot::BOOT;
    let (mut buffer, mut out) = ([0; 264], [0; MAX_FRAME]);
    let mut host = wire::Receiver::new();
    let (mut silent, mut late) = (false, 0);
    let (mut damaged, mut sent, mut heard) = (0, 0, false);
    let mut tripped = [0; 32];

    for period in 1..=PERIODS {
        let now = Instant::from_millis(period.into());
        if random.one_in(4000) {
            silent = !silent;
        }
        if random.one_in(3000) {
            let motor = random.below(6) as usize;
            let encoder = plant.motors[motor].encoder();
            random.disturb(&mut plant.overrides, motor, encoder);
        }
        if random.one_in(1_000_000) {
            late = 200;
        }
        if late > 0 {
            late -= 1;
            controller.period_missed(1500);
        }

        // What the host sends arrives damaged, or something else does.
        let mut bytes: &[u8] = &[];
        if !silent && random.one_in(20) {
            if let Some(frame) = random.frame(&mut buffer) {
                if random.one_in(10) {
                    let at = random.below(frame.len() as u32) as usize;
                    frame[at] ^= 1 << random.below(8);
                    damaged += 1;
                }
                let lost = if random.one_in(50) { random.below(4) as usize } else { 0 };
                bytes = &frame[lost..];
            }
        } else if random.one_in(200) {
            let length = random.below(40) as usize;
            buffer[..length].fill_with(|| random.below(256) as u8);
            bytes = &buffer[..length];
        }

        // A frame at a time, so that it is known which of them was refused.
        let signs = session.signs_of_life();
        let mut adopted = None;
        let command = loop {
            match session.receive(&mut bytes, now) {
                Some(Effect::Control(command)) => {
                    if matches!(command, Command::Adopt) {
                        adopted = Some(session.settings().control);
                    }
                    break Some(command);
                }
                Some(_) => {}
                None => break None,
            }
        };
        assert!(bytes.is_empty() || command.is_some());
        model.silence = if session.signs_of_life() == signs { model.silence + 1 } else { 0 };
        heard |= session.signs_of_life() != 0;
        if !heard {
            model.silence = 0;
        }

        plant.advance_to(period.into());
        let motion = plant.motion_inputs();
        if period % 20 == 0 {
            sensors = plant.sensors();
        }
        let before = snapshot;
        if let Some(settings) = &adopted {
            model.take_settings(settings);
        }
        snapshot = *controller.step(
            command,
            || adopted.take(),
            &motion,
            &sensors,
            session.signs_of_life(),
        );
        plant.outputs = snapshot.outputs;

        if let Some(command) = command
            && snapshot.counters.refused == before.counters.refused
        {
            model.take(&command, &before);
        }
        model.check(&snapshot, &plant, &|| format!("seed {seed}, period {period}"));
        if snapshot.faults != before.faults {
            for (fault, channel) in snapshot.faults.iter() {
                if !before.faults.has(fault, channel) {
                    tripped[usize::from(fault.number())] += 1;
                }
            }
        }
        if period % 5 == 0
            && let Some(frame) = session.transmit(now, &At(snapshot), &mut out)
        {
            let mut whole = frame;
            assert_eq!(host.receive(&mut whole), Some(frame), "what is sent is intact");
            sent += 1;
        }
    }
    let refused = snapshot.counters.refused.total() + session.counters().refused;
    let commands = session.signs_of_life();
    println!("seed {seed}: {commands} frames, {damaged} damaged, {refused} refused, {sent} sent");
    assert!(refused > 1000 && commands > 300_000 && damaged > 30_000 && sent > 100_000);
    println!("{} periods before an obstacle, {} beyond a limit", model.obstacles, model.beyond);
    assert!(model.obstacles > 10_000 && model.beyond > 10_000);
    tripped
}
