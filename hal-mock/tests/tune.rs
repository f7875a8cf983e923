//! Checking and tuning against the virtual board, on virtual time.

use embassy_time::Duration;
use firmware::channel::Method;
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::plant::Scene;
use handwheel::Number;
use handwheel::session::{Event, Reply, Session};
use handwheel::tune::{Ask, Job, Loop, Options, Refused, Tuned, check, tune};
use protocol::extension::{Request, did};
use protocol::pms5005::{Addressing, Command, Frame, Move, Quantity, Scope as CommandScope};

/// A board and a host's session on its line.
struct Bench {
    board: VirtualBoard,
    session: Session,
    ms: u64,
    /// Of blocks of a recording, which one of so many is lost.
    loses: Option<u32>,
    blocks: u32,
}

impl Bench {
    fn new() -> Self {
        Self::with(Make::default())
    }

    fn with(make: Make) -> Self {
        let (board, session) = (VirtualBoard::new(make), Session::new());
        let mut bench = Self { board, session, ms: 0, loses: None, blocks: 0 };
        // Until the session knows what is there.
        (0..200).for_each(|_| bench.exchange());
        bench
    }

    fn now(&self) -> std::time::Duration {
        std::time::Duration::from_millis(self.ms)
    }

    /// A millisecond of the line.
    fn exchange(&mut self) {
        self.ms += 1;
        while let Some(bytes) = self.session.take_output() {
            self.board.line.host_sends(&bytes);
        }
        self.board.run_for(Duration::from_millis(1));
        while let Some((_, bytes)) = self.board.line.host_receives() {
            let is_block = Frame::parse(&bytes).is_some_and(|frame| frame.did == did::BLOCK);
            self.blocks += u32::from(is_block);
            let is_lost = self.loses.is_some_and(|every| self.blocks.is_multiple_of(every));
            if !(is_block && is_lost) {
                self.session.receive(&bytes);
            }
        }
    }

    /// Another host's command.
    fn send(&mut self, command: Command<'_>) {
        self.board.line.host_sends(command.encode(255, &mut [0; 64]).unwrap());
    }

    fn set(&mut self, values: &[(u16, i32)]) {
        let now = self.now();
        Ask::Set(values.to_vec()).begin(&mut self.session, now).unwrap();
        (0..50).for_each(|_| self.exchange());
        assert!(self.session.take_event().is_some());
        while self.session.take_event().is_some() {}
    }

    /// Runs a job to its end, `look`ing every millisecond.
    fn run_with<T>(
        &mut self,
        mut job: Job<T>,
        mut look: impl FnMut(&mut Self, &mut Job<T>),
    ) -> Result<T, Refused> {
        for _ in 0..60_000 {
            let now = self.now();
            job.converse(&mut self.session, now);
            if let Some(outcome) = job.outcome() {
                (0..50).for_each(|_| self.exchange());
                return outcome;
            }
            look(self, &mut job);
            self.exchange();
        }
        panic!("it does not end: {}", job.doing());
    }

    fn run<T>(&mut self, job: Job<T>) -> Result<T, Refused> {
        self.run_with(job, |_, _| {})
    }

    fn is_on(&self, motor: usize) -> bool {
        self.board.plant.borrow().outputs.motors[motor].enabled
    }
}

/// What of the settings of motors is not as it is by default.
fn changed(bench: &mut Bench) -> Vec<String> {
    let is_motors = |number: u16| (180..=203).contains(&number) || (208..=279).contains(&number);
    let mut changed = Vec::new();
    let mut next = Some(180);
    while let Some(number) = next {
        let now = bench.now();
        bench.session.ask(&Request::Setting(number), now).unwrap();
        let setting = loop {
            bench.exchange();
            let now = bench.now();
            bench.session.advance(now);
            let event = bench.session.take_event();
            if let Some(Event::Answered(Reply::Setting(setting))) = event {
                break setting;
            }
        };
        if is_motors(number) && setting.value != setting.default {
            changed.push(format!("{} {}", setting.name, setting.value));
        }
        next = setting.next;
    }
    changed
}

fn options(motor: &str) -> Options {
    Options {
        motor: motor.parse().unwrap(),
        control_loop: None,
        highest_duty: Options::HIGHEST_DUTY,
        apply: true,
    }
}

/// Tunes, and looks at what the shaft really did: the highest duty, and how far from its start it was.
fn tuned(bench: &mut Bench, options: Options) -> (Tuned, f64, i64) {
    let motor = options.motor.index();
    let start = bench.board.plant.borrow().motors[motor].position();
    let (mut duty, mut travel) = (0, 0);
    let tuned = bench.run_with(tune(options), |bench, _| {
        let plant = bench.board.plant.borrow();
        duty = duty.max(plant.outputs.motors[motor].duty.raw().abs());
        travel = travel.max((plant.motors[motor].position() - start).abs());
    });
    assert!(!bench.is_on(motor), "it is off when it is done");
    (tuned.unwrap(), f64::from(duty) / 16_384.0, travel)
}

#[test]
fn a_wheel_s_velocity_loop_is_tuned_and_its_step_is_what_was_predicted() {
    let mut bench = Bench::new();
    let (tuned, duty, _) = tuned(&mut bench, options("1"));
    // The scene's motor: 16,384 counts/s, 60 ms.
    let motor = tuned.fit.motor;
    assert!((16_000.0..16_700.0).contains(&motor.gain), "{motor:?}");
    assert!((0.057..0.063).contains(&motor.time_constant), "{motor:?}");
    assert!((0.49..=0.501).contains(&duty), "{duty}");
    let (was, was_to_be) = (tuned.response, tuned.design.response);
    assert!((was.overshoot_percent - was_to_be.overshoot_percent).abs() < 3.0, "{tuned:?}");
    let ratio = was.settling.unwrap().as_secs_f64() / was_to_be.settling.unwrap().as_secs_f64();
    assert!((0.7..1.4).contains(&ratio), "{was:?} {was_to_be:?}");
    // What it says is in force, and nothing else.
    let names = [
        "velocity Kp 1",
        "velocity Kd 1",
        "full speed 1",
        "velocity reset 1",
        "velocity look-ahead 1",
    ];
    let changed = changed(&mut bench);
    let is_named = |text: &String| names.iter().any(|name| text.starts_with(name));
    assert!(changed.iter().all(is_named) && changed.len() == names.len(), "{changed:?}");
    assert!(bench.ms < 30_000, "{} ms", bench.ms);
}

#[test]
fn a_joint_s_position_loop_is_tuned_within_its_travel() {
    let mut bench = Bench::new();
    let (tuned, _, travel) = tuned(&mut bench, options("3"));
    assert!((40..=480).contains(&travel), "{travel} counts");
    assert_eq!((tuned.control_loop, tuned.step.target), (Loop::Position, 160.0));
    assert!(tuned.response.overshoot_percent < 10.0 && tuned.response.settling.is_some());
    assert!(tuned.response.steady_error.abs() < 10.0, "{:?}", tuned.response);
}

#[test]
fn the_position_loop_of_a_wheel_can_be_tuned_too() {
    let mut bench = Bench::new();
    let position = Options { control_loop: Some(Loop::Position), ..options("2") };
    let (tuned, ..) = tuned(&mut bench, position);
    assert!(tuned.step.target > 500.0 && tuned.response.overshoot_percent < 10.0, "{tuned:?}");
}

#[test]
fn without_apply_everything_is_as_it_was() {
    let mut bench = Bench::new();
    bench.set(&[(182, 12_000), (180, 50), (215, 3)]);
    let before = changed(&mut bench);
    assert_eq!(before.len(), 3);
    let (tuned, duty, _) = tuned(&mut bench, Options { apply: false, ..options("1") });
    assert!(!tuned.settings.is_empty() && duty < 0.51);
    assert_eq!(changed(&mut bench), before);
}

#[test]
fn the_channel_s_own_highest_duty_holds() {
    let mut bench = Bench::new();
    bench.set(&[(182, 6000)]);
    let (_, duty, _) = tuned(&mut bench, options("1"));
    assert!((0.36..0.367).contains(&duty), "{duty}");
    assert!(changed(&mut bench).contains(&"highest duty 1 6000".into()));
}

/// What is wrong with motor 1, and what is said of it: before any loop is closed, and within half a second.
#[test]
fn wrong_wiring_is_named_before_any_loop_is_closed() {
    let swapped = |scene: &mut Scene| scene.motors[0].reversed = true;
    let unplugged = |scene: &mut Scene| scene.faults.unplugged[0] = true;
    let blocked = |scene: &mut Scene| scene.faults.jam[0] = true;
    type Wrong = fn(&mut Scene);
    let cases: [(Wrong, Refused); 3] =
        [(swapped, Refused::WrongWay), (unplugged, Refused::Stuck), (blocked, Refused::Stuck)];
    for (wrong, refused) in cases {
        let mut scene = Scene::default();
        wrong(&mut scene);
        for is_check in [true, false] {
            let mut bench = Bench::with(Make { scene, ..Make::default() });
            let (mut driven, mut closed) = (0, false);
            let mut look = |bench: &mut Bench| {
                driven += i32::from(bench.is_on(0));
                let set_point = bench.board.snapshot().channels[0].set_point;
                closed |= bench.is_on(0) && set_point.method() != Method::Pwm;
            };
            let found = match is_check {
                true => bench.run_with(check(Number::ONE, 0.5, false), |b, _| look(b)).err(),
                false => bench.run_with(tune(options("1")), |b, _| look(b)).err(),
            };
            assert_eq!(found, Some(refused.clone()));
            assert!(!closed && driven <= 500, "{refused:?}: driven for {driven} ms");
            assert!(!bench.is_on(0));
            assert_eq!(changed(&mut bench), Vec::<String>::new(), "{refused:?}");
        }
    }
}

#[test]
fn a_polarity_that_is_wrong_is_turned_round_if_that_is_wanted_and_tuned_then() {
    let mut scene = Scene::default();
    scene.motors[0].reversed = true;
    let mut bench = Bench::with(Make { scene, ..Make::default() });
    let checked = bench.run(check(Number::ONE, 0.5, true)).unwrap();
    assert!(checked.turned_round && checked.ways.iter().all(|way| way.moved > 0), "{checked:?}");
    assert_eq!(changed(&mut bench), ["polarity 1 1"]);
    let (tuned, ..) = tuned(&mut bench, options("1"));
    assert!((16_000.0..16_700.0).contains(&tuned.fit.motor.gain), "{:?}", tuned.fit);
}

#[test]
fn a_motor_that_is_well_wired_passes_and_moves_little() {
    let mut bench = Bench::new();
    let start = bench.board.plant.borrow().motors[2].position();
    let checked = bench.run(check("3".parse().unwrap(), 0.5, false)).unwrap();
    assert!(checked.has_current && !checked.turned_round, "{checked:?}");
    let way = bench.board.plant.borrow().motors[2].position() - start;
    assert!(way.abs() < 200, "{way}");
    assert_eq!(changed(&mut bench), Vec::<String>::new());
}

#[test]
fn a_joint_stays_within_its_travel_whatever_its_motor_is() {
    for (full_speed, time_constant_s) in [(4096.0, 0.06), (8000.0, 0.2), (12_000.0, 0.3)] {
        let mut scene = Scene::default();
        scene.motors[2].full_speed = full_speed;
        scene.motors[2].time_constant_s = time_constant_s;
        let mut bench = Bench::with(Make { scene, ..Make::default() });
        let start = bench.board.plant.borrow().motors[2].position();
        let mut travel = 0;
        let outcome = bench.run_with(tune(options("3")), |bench, _| {
            let at = bench.board.plant.borrow().motors[2].position();
            travel = travel.max((at - start).abs());
        });
        let told = outcome.map(|tuned| tuned.response);
        println!("{full_speed} {time_constant_s}: {travel} {told:?}");
        assert!(travel <= 500, "{full_speed} {time_constant_s}: {travel} counts, {told:?}");
    }
    let mut bench = Bench::new();
    let velocity = Options { control_loop: Some(Loop::Velocity), ..options("3") };
    assert_eq!(bench.run(tune(velocity)).err(), Some(Refused::NotAJoint));
    assert_eq!(changed(&mut bench), Vec::<String>::new());
}

#[test]
fn a_joint_whose_sensor_comes_off_in_the_middle_is_not_pushed_on() {
    let mut bench = Bench::new();
    let start = bench.board.plant.borrow().motors[2].position();
    let outcome = bench.run_with(tune(options("3")), |bench, job| {
        if job.doing() == "finds out what it is" {
            bench.board.plant.borrow_mut().overrides.unplugged[2] = Some(true);
        }
    });
    assert!(outcome.is_err(), "{outcome:?}");
    let travel = (bench.board.plant.borrow().motors[2].position() - start).abs();
    assert!(travel < 480, "{travel} counts");
}

#[test]
fn nobody_else_s_motor_is_kept_running_by_it() {
    let mut bench = Bench::new();
    let outcome = bench.run_with(tune(options("1")), |bench, job| {
        if job.doing() == "finds out what it is" && !bench.is_on(1) {
            let mut targets = [None; 6];
            targets[1] = Some(3000);
            let (quantity, addressing) = (Quantity::Velocity, Addressing::List);
            bench.send(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
        }
    });
    assert!(outcome.unwrap_err().to_string().contains("drives motor 2"));
    assert!(!bench.is_on(0));
}

#[test]
fn a_polarity_that_was_turned_in_vain_is_turned_back() {
    let mut scene = Scene::default();
    scene.motors[0].reversed = true;
    let mut bench = Bench::with(Make { scene, ..Make::default() });
    let mut turned = false;
    let outcome = bench.run_with(check(Number::ONE, 0.5, true), |bench, job| {
        turned |= job.doing() == "turns its polarity round";
        if turned && job.doing() == "checks its wiring" {
            bench.board.plant.borrow_mut().overrides.jam[0] = Some(true);
        }
    });
    assert_eq!(outcome.err(), Some(Refused::Stuck));
    bench.board.plant.borrow_mut().overrides.jam[0] = None;
    assert_eq!(changed(&mut bench), Vec::<String>::new());
}

/// What goes wrong in the middle, what is said of it, and that the motor is off then and nothing has changed.
#[test]
fn whatever_ends_it_the_motor_is_off_and_the_settings_are_as_they_were() {
    type Trouble = fn(&mut Bench, &mut Job<Tuned>);
    let troubles: [(Trouble, &str); 4] = [
        (|_, job| job.stop("stopped by hand"), "stopped by hand"),
        (|bench, _| bench.board.plant.borrow_mut().overrides.jam[0] = Some(true), "motor"),
        (
            |bench, _| bench.send(Command::Run { scope: CommandScope::All, run: false }),
            "", // "suspended" of a move, "another host has stopped it" of a duty
        ),
        (
            |bench, _| {
                let mut targets = [None; 6];
                targets[0] = Some(3000);
                let quantity = Quantity::Velocity;
                let addressing = Addressing::List;
                bench.send(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
            },
            "another host",
        ),
    ];
    for after in [700, 2200, 5000, 9000] {
        for (n, (trouble, words)) in troubles.iter().enumerate() {
            let mut bench = Bench::new();
            let (began, mut over) = (bench.ms, false);
            let outcome = bench.run_with(tune(options("1")), |bench, job| {
                // In the middle of something that turns.
                if !over && bench.ms > began + after && bench.is_on(0) {
                    over = true;
                    trouble(bench, job);
                }
            });
            let outcome = outcome.map(|_| "tuned");
            let case = format!("trouble {n} after {after} ms: {outcome:?}");
            let refused = outcome.err().unwrap_or_else(|| panic!("{case}")).to_string();
            assert!(refused.contains(words) || n == 1, "{case}");
            assert!(!bench.is_on(0), "{case}");
            bench.board.plant.borrow_mut().overrides.jam[0] = None;
            assert_eq!(changed(&mut bench), Vec::<String>::new(), "{case}");
        }
    }
}

#[test]
fn a_line_that_is_cut_leaves_the_motor_to_the_board_s_own_watch() {
    let mut bench = Bench::new();
    let began = bench.ms;
    let mut cut = None;
    let outcome = bench.run_with(tune(options("1")), |bench, _| {
        if cut.is_none() && bench.ms > began + 5000 && bench.is_on(0) {
            bench.board.line.cut(true);
            cut = Some(bench.ms);
        }
    });
    assert!(matches!(outcome, Err(Refused::Stopped(_) | Refused::Line(_))), "{outcome:?}");
    while bench.ms < cut.unwrap() + 2100 {
        bench.exchange();
    }
    assert!(!bench.is_on(0));
}

#[test]
fn telemetry_that_fills_the_line_keeps_no_recording_from_its_host() {
    let mut make = Make::default();
    make.settings.link.telemetry_period_ms = 1;
    let mut bench = Bench::with(make);
    bench.run(check(Number::ONE, 0.5, false)).unwrap();
}

#[test]
fn parts_of_a_recording_that_are_lost_are_asked_for_again() {
    let mut bench = Bench::new();
    bench.loses = Some(7);
    let (tuned, ..) = tuned(&mut bench, options("1"));
    assert!(tuned.fit.percent > 95.0, "{:?}", tuned.fit);
}
