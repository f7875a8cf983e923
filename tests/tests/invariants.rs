//! What holds in every control period, whatever hosts, sensors and lines do: hours of random
//! commands, readings, obstacles and silences from fixed seeds, straight into the controller.
//!
//! The model beside it is small: who may be enabled at all, and which way the wheels may turn.

use firmware::command::{Command, Configuration};
use firmware::controller::Controller;
use firmware::ports::{MotionInputs, Sensors};
use firmware::settings::Settings;
use protocol::pms5005::{
    CHANNELS, Channel, Gain, Loop, Method, Parameter, Polarity, Scope, Sensor,
};

/// Periods of 1 ms for each seed: an hour.
const PERIODS: u32 = 3_600_000;

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

    fn channel(&mut self) -> Channel {
        Channel::ALL[self.below(6) as usize]
    }

    fn method(&mut self) -> Method {
        [Method::Pwm, Method::Position, Method::Velocity][self.below(3) as usize]
    }

    fn periods(&mut self) -> u16 {
        [0, 1, 30, 500, u16::MAX][self.below(5) as usize]
    }

    fn parameter(&mut self) -> Parameter {
        let channel = self.channel();
        match self.below(6) {
            0 => Parameter::Polarity(
                channel,
                if self.one_in(2) { Polarity::Positive } else { Polarity::Negative },
            ),
            1 => {
                let sensors =
                    [Sensor::SinglePotentiometer, Sensor::DualPotentiometer, Sensor::Encoder];
                Parameter::Sensor(channel, sensors[self.below(3) as usize])
            }
            2 => Parameter::Method(channel, self.method()),
            3 => Parameter::CollisionProtection(self.one_in(2)),
            _ => {
                let word = [0, 1, 50, 5000, u16::MAX][self.below(5) as usize];
                let [integer, fraction] = word.to_le_bytes();
                let gain = match self.below(3) {
                    0 => Gain::Proportional(word),
                    1 => Gain::Derivative(word),
                    _ => Gain::Integral { integer, fraction },
                };
                let control_loop = if self.one_in(2) { Loop::Position } else { Loop::Velocity };
                Parameter::Gain(channel, control_loop, gain)
            }
        }
    }

    /// A command, and the parameter that is in it.
    fn command(&mut self) -> (Command, Option<Parameter>) {
        let mut targets = [None; CHANNELS];
        for target in &mut targets {
            if self.one_in(2) {
                *target = Some(self.below(32_768) as i16);
            }
        }
        let mut parameter = None;
        let command = match self.below(8) {
            0..3 => {
                let method = self.method();
                let targets = targets.map(|target| {
                    target.map(|target| match method {
                        Method::Pwm => target - 16_384,
                        Method::Position => target >> self.below(4),
                        Method::Velocity => {
                            if self.one_in(2) {
                                target
                            } else {
                                -target
                            }
                        }
                    })
                });
                Command::Drive { method, targets, periods: self.periods() }
            }
            3 => {
                let targets = targets.map(|t| t.map(|t: i16| 500 + t % 6501));
                Command::MoveServos { targets, periods: self.periods() }
            }
            4 | 5 => {
                let mut configuration = Configuration::default();
                // A parameter that does not fit is refused and leaves nothing behind.
                parameter = Some(self.parameter()).filter(|&p| configuration.add(p).is_ok());
                Command::Configure(configuration)
            }
            6 => {
                let channel = self.channel();
                let scope = [Scope::All, Scope::Motor(channel), Scope::Servo(channel)];
                Command::Run { scope: scope[self.below(3) as usize], run: self.one_in(2) }
            }
            _ => Command::Gpio(self.below(256) as u8),
        };
        (command, parameter)
    }
}

#[test]
fn no_period_of_hours_of_chaos_breaks_a_promise() {
    for seed in 1..=3 {
        chaos(seed);
    }
}

fn chaos(seed: u64) {
    let mut random = Random(seed);
    let mut controller = Controller::new(Settings::DEFAULT.control);
    let mut motion = MotionInputs::default();
    let mut sensors = Sensors::UNKNOWN;
    let mut frames = 0;
    let mut refused = 0;
    // Which channels a host has enabled and not suspended since.
    let mut wanted = [false; CHANNELS];
    let mut pulsed = [false; CHANNELS];
    let mut polarity = [Polarity::Positive; 2];
    let mut silent = false;
    let mut silence = 0u32;

    for period in 0..PERIODS {
        for count in &mut motion.encoders {
            let most = if random.one_in(5000) { 60_000 } else { 17 };
            *count = count.wrapping_add(random.below(most) as u16).wrapping_sub(8);
        }
        for reading in &mut motion.potentiometers {
            let jump = if random.one_in(5000) { 4095 } else { 9 };
            *reading = (*reading + random.below(jump) as u16).saturating_sub(4).min(4095);
        }
        if random.one_in(300) {
            sensors.sonar_cm = [if random.one_in(2) { 255 } else { random.below(60) as u8 }; 6];
        }
        if random.one_in(4000) {
            silent = !silent;
        }
        let (command, parameter) = match !silent && random.one_in(20) {
            true => {
                let (command, parameter) = random.command();
                (Some(command), parameter)
            }
            false => (None, None),
        };
        if command.is_some() {
            frames += 1;
        }
        silence = if command.is_some() { 0 } else { silence + 1 };

        let snapshot = controller.step(command, &motion, &sensors, frames);

        let accepted = snapshot.counters.refused == refused;
        refused = snapshot.counters.refused;
        match command {
            Some(Command::Drive { targets, .. }) if accepted => {
                wanted.iter_mut().zip(targets).for_each(|(w, t)| *w |= t.is_some());
            }
            Some(Command::MoveServos { targets, .. }) => {
                pulsed.iter_mut().zip(targets).for_each(|(p, t)| *p |= t.is_some());
            }
            Some(Command::Run { scope, run }) => {
                for channel in Channel::ALL {
                    if scope == Scope::All || scope == Scope::Motor(channel) {
                        wanted[channel.index()] = run;
                    }
                }
            }
            _ => {}
        }
        if let Some(Parameter::Polarity(channel, new)) = parameter
            && let Some(known) = polarity.get_mut(channel.index())
        {
            *known = new;
        }
        for (i, motor) in snapshot.outputs.motors.iter().enumerate() {
            let at = || format!("seed {seed}, period {period}, channel {i}: {motor:?}");
            assert!(motor.enabled || motor.duty.raw() == 0, "disabled is neutral: {}", at());
            assert!(!motor.enabled || wanted[i], "nobody has enabled it: {}", at());
            if let Some(polarity) = polarity.get(i)
                && snapshot.obstacle
            {
                let forward = match polarity {
                    Polarity::Positive => motor.duty.raw(),
                    Polarity::Negative => -motor.duty.raw(),
                };
                assert!(forward <= 0, "towards an obstacle: {}", at());
            }
        }
        for (pulse, pulsed) in snapshot.outputs.servos.iter().zip(pulsed) {
            assert!(pulse.is_none() || pulsed, "a servo that was never commanded");
        }
        assert!(silence < 2000 || frames == 0 || snapshot.link_loss, "silence is noticed");
    }
    assert!(refused > 1000 && frames > 50_000, "the chaos was not chaotic: {refused}, {frames}");
}
