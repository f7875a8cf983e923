//! The controller on a plant that it was not written beside ([`tests::foreign`]): stiction, backlash,
//! cogging. Beside it a textbook PID in floating point with the same physical gains, which is fed the
//! same set-points on a plant of its own.

use firmware::channel::Method;
use firmware::command::Command;
use firmware::controller::Controller;
use firmware::ports::{MotionInputs, MotorOutput, Sensors};
use firmware::settings::Settings;
use tests::foreign::{Motor, Parameters, TextbookPid};

const FULL_SPEED: f64 = 16_384.0;
/// Of the filter through which the textbook's loop sees its velocity.
const FILTER_S: f64 = 8e-3;

/// Whole numbers from a seed (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, most: u64) -> i64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % most) as i64
    }
}

/// What is asked of a wheel: a method's target, and the periods until it is there.
struct Asked {
    target: i64,
    periods: i64,
    lasts: i64,
}

/// Steps of all sizes; and in between a sine, as a host sends it.
fn velocity(random: &mut Random, ms: i64) -> Asked {
    if ms % 20_000 < 10_000 {
        let target = [300, 3000, 12_000][random.below(3) as usize];
        let target = random.below(2 * target as u64) - target;
        Asked { target, periods: 0, lasts: 500 + random.below(2000) }
    } else {
        let phase = ms as f64 / 1000.0 * std::f64::consts::TAU * 0.5;
        Asked { target: (6000.0 * phase.sin()) as i64, periods: 0, lasts: 20 }
    }
}

/// Timed moves, slow and fast, with a rest behind each.
fn position(random: &mut Random, from: i64) -> Asked {
    let target = (from + random.below(8001) - 4000).clamp(8000, 24_000);
    let periods = 500 + random.below(3500);
    Asked { target, periods, lasts: periods + 300 }
}

/// A wheel under one of the two controllers, and how far it was from what was asked.
struct Run {
    motor: Motor,
    squares: f64,
    periods: u64,
}

impl Run {
    fn new(seed: u64) -> Self {
        let noise = Parameters { adc_noise: 2.0, ..Parameters::wheel(FULL_SPEED) };
        Self { motor: Motor::new(noise, seed), squares: 0.0, periods: 0 }
    }

    fn step(&mut self, drive: f64, enabled: bool, error: f64) {
        self.squares += error * error;
        self.periods += 1;
        self.motor.step(drive, enabled, 1e-3);
    }

    fn rms(&self) -> f64 {
        (self.squares / self.periods as f64).sqrt()
    }
}

fn drive(output: MotorOutput) -> f64 {
    f64::from(output.duty.raw()) / 16_384.0
}

/// Ours and the textbook's rms error over so many seconds, for the velocity (counts/s) of wheel 0 and
/// the position (counts) of wheel 1.
fn compare(seconds: i64) -> [(f64, f64); 2] {
    let mut random = Random(15);
    let mut controller = Controller::new(Settings::DEFAULT.control);
    let mut ours = [Run::new(1), Run::new(2)];
    let mut textbooks = [Run::new(1), Run::new(2)];
    let mut pids =
        [TextbookPid::velocity(50, 5, 0, FULL_SPEED), TextbookPid::position(50, 5, 0, FULL_SPEED)];
    let (mut last_count, mut filtered) = (0.0, 0.0);
    let (mut asked_velocity, mut velocity_until) = (0, 0);
    // Wheel 1 begins at count 0; so that nothing wraps it is brought to 16,000 first.
    let (mut from, mut target, mut began, mut periods, mut position_until) =
        (0, 16_000, 0, 4000, 4300);
    for ms in 0..seconds * 1000 {
        let mut commands = Vec::new();
        let mut ask = |channel: usize, method, target: i64, periods: i64| {
            let mut targets = [None; 6];
            targets[channel] = Some(target as i16);
            commands.push(Command::MoveMotors {
                method,
                targets,
                periods: periods as u16,
                origin: 0,
            });
        };
        if ms == velocity_until {
            let Asked { target, lasts, .. } = velocity(&mut random, ms);
            asked_velocity = target;
            velocity_until = ms + lasts;
            ask(0, Method::Velocity, target, 0);
        }
        if ms == position_until {
            (from, began) = (target, ms);
            let asked = position(&mut random, from);
            (target, periods, position_until) = (asked.target, asked.periods, ms + asked.lasts);
            ask(1, Method::Position, target, periods);
        } else if ms == 0 {
            ask(1, Method::Position, target, periods);
        }
        // Where the set-point of wheel 1 should be, and how fast.
        let part = ((ms - began + 1) as f64 / periods as f64).min(1.0);
        let line = from as f64 + (target - from) as f64 * part;
        let slope = if part < 1.0 { (target - from) as f64 * 1000.0 / periods as f64 } else { 0.0 };

        let motion = MotionInputs {
            encoders: [ours[0].motor.encoder(), ours[1].motor.encoder()],
            currents: [ours[0].motor.current_adc(), ours[1].motor.current_adc(), 0, 0, 0, 0],
            ..MotionInputs::default()
        };
        let snapshot = *controller.step(commands, || None, &motion, &Sensors::UNKNOWN, ms as u32);
        assert_eq!(snapshot.faults.count(), 0, "after {ms} ms: {:?}", snapshot.shown_fault);
        let errors = |runs: &[Run; 2]| {
            [asked_velocity as f64 - runs[0].motor.velocity(), line - runs[1].motor.counts()]
        };
        let (ours_off, textbooks_off) = (errors(&ours), errors(&textbooks));
        for ((run, error), output) in ours.iter_mut().zip(ours_off).zip(snapshot.outputs.motors) {
            run.step(drive(output), output.enabled, error);
        }
        let count = textbooks[0].motor.counts().floor();
        filtered += ((count - last_count) * 1000.0 - filtered) * 1e-3 / FILTER_S;
        last_count = count;
        let fed = asked_velocity as f64;
        let drives = [
            pids[0].step(fed, filtered, fed),
            pids[1].step(line, textbooks[1].motor.counts().floor(), slope),
        ];
        for ((run, error), drive) in textbooks.iter_mut().zip(textbooks_off).zip(drives) {
            run.step(drive, true, error);
        }
    }
    [0, 1].map(|i| (ours[i].rms(), textbooks[i].rms()))
}

fn no_worse_than_the_textbook(seconds: i64) {
    for (name, (ours, textbook)) in ["velocity", "position"].iter().zip(compare(seconds)) {
        println!("{name}: ours {ours:.1}, textbook {textbook:.1}, ratio {:.3}", ours / textbook);
        assert!(textbook > 1.0 && ours <= 1.05 * textbook, "{name}: {ours} against {textbook}");
    }
}

#[test]
fn two_minutes_on_a_foreign_plant_are_tracked_as_by_the_textbook_and_nothing_trips() {
    no_worse_than_the_textbook(120);
}

/// `cargo test --release -p tests --test foreign_plant -- --ignored --nocapture`
#[test]
#[ignore = "an hour of simulated time takes a minute"]
fn an_hour_on_a_foreign_plant_is_tracked_as_by_the_textbook_and_nothing_trips() {
    no_worse_than_the_textbook(3600);
}
