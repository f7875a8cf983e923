//! The rig: a plant under the firmware's own tasks, and a host at the other end of its line.
//!
//! ```text
//!   Session <── 1 ms ──> Line, 115200 baud <──> link, control, sensors, display <──> Machine
//! ```
//!
//! The plant is motor 1 (channel 0), with an encoder; the other channels have nothing. Settings are the
//! defaults, nothing is saved. Time is virtual, one clock a thread: **there is one rig at a time in a
//! thread**. Whoever has the rig has the host's [`Session`], and lets a millisecond pass with
//! [`step`](Rig::step); what is true meanwhile is in the [`course`](Rig::course), which no tuner may read.

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use embassy_futures::join::join5;
use embassy_sync::blocking_mutex::Mutex;
use embassy_time::{Instant, Timer};
use firmware::app;
use firmware::control::axis::SetPoint;
use firmware::controller::{Controller, Snapshot};
use firmware::personality::Boot;
use firmware::personality::pms5005::{LinkCounters, Pms5005};
use firmware::ports::{LcdPort, MotionInputs, MotionPort, Outputs, SensorPort, Sensors};
use firmware::recorder::{Recorder, Row};
use firmware::settings::Settings;
use firmware::units::Duty;
use hal_mock::clock;
use hal_mock::running::Running;
use hal_mock::tasks::Channels;
use hal_mock::wire::Line;
use handwheel::session::{Event, Reply, Session};
use protocol::extension::{Assignments, Fault, Request};
use protocol::pms5005::{Addressing, Channel, Command, Data, Move, Quantity, Scope};

use super::motor::Drive;
use super::plant::{Machine, Plant, Wrong};

/// The line's speed in baud.
const LINE_RATE: u32 = 115_200;
/// Rows that the board's recorder holds, as an F407's does.
const RECORDER_ROWS: usize = 4096;
/// How often the host shows that it is there while it drives.
const SIGN_OF_LIFE: Duration = Duration::from_millis(200);

/// What is true at the end of a control period, of motor 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Since the board was switched on.
    pub at: Duration,
    /// Counts, with their parts.
    pub position: f64,
    /// counts/s.
    pub speed: f64,
    /// A.
    pub current: f64,
    /// What drives it.
    pub drive: Drive,
    /// What its velocity loop is asked for, in counts/s, if that is what drives it.
    pub set_point: Option<f64>,
}

/// The most that was ever seen.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Greatest {
    /// Part of full duty, either way.
    pub duty: f64,
    /// A, either way.
    pub current: f64,
    /// counts/s, either way.
    pub speed: f64,
    /// Counts between the ends of where it was.
    pub travel: f64,
}

/// A plant, its board and its host.
pub struct Rig {
    /// The host's end of the line. What it is told to write is written with the next [`step`](Self::step).
    pub session: Session,
    running: Running,
    line: Line,
    world: Rc<RefCell<World>>,
    channels: Rc<Channels<LinkCounters>>,
    course: Vec<Moment>,
    faults: Vec<(Fault, Option<u8>)>,
}

impl Rig {
    /// A board that has been on for so long that its host knows it. Its motor is off.
    pub fn new(plant: &Plant, wrong: Option<Wrong>) -> Self {
        clock::reset();
        let world = Rc::new(RefCell::new(World::new(plant.build(wrong))));
        let line = Line::new(LINE_RATE);
        let channels = Rc::new(Channels::new());
        let running = Running::new(board(world.clone(), line.clone(), channels.clone()));
        let session = Session::new();
        let (course, faults) = (Vec::new(), Vec::new());
        let mut rig = Self { session, running, line, world, channels, course, faults };
        while rig.session.personality().is_none() && rig.now() < Duration::from_secs(2) {
            rig.step();
        }
        rig
    }

    /// Since the board was switched on: the session's time, too.
    pub fn now(&self) -> Duration {
        Duration::from_micros(Instant::now().as_micros())
    }

    /// Lets a millisecond pass: what the host has to say goes on the line, what has come by then is heard.
    pub fn step(&mut self) {
        self.session.advance(self.now());
        while let Some(bytes) = self.session.take_output() {
            self.line.host_sends(&bytes);
        }
        self.running.run_until(Instant::now() + embassy_time::Duration::from_millis(1));
        while let Some((_, bytes)) = self.line.host_receives() {
            self.session.receive(&bytes);
        }
        self.note();
    }

    /// Lets some time pass; what is heard is forgotten.
    pub fn run_ms(&mut self, ms: u32) {
        for _ in 0..ms {
            self.step();
            while self.session.take_event().is_some() {}
        }
    }

    /// What was true so far, a moment for each millisecond.
    pub fn course(&self) -> &[Moment] {
        &self.course
    }

    /// All faults that were ever latched, with their channels from 0.
    pub fn faults(&self) -> &[(Fault, Option<u8>)] {
        &self.faults
    }

    /// What the controller last knew.
    pub fn snapshot(&self) -> Snapshot {
        self.channels.snapshot.get()
    }

    /// From when to when motor 1 was driven, if ever: the first and the last moment with a duty.
    pub fn driven(&self) -> Option<(Duration, Duration)> {
        let mut driven = self.course.iter().filter(|m| m.drive.enabled && m.drive.duty != 0.0);
        let first = driven.next()?.at;
        Some((first, driven.next_back().map_or(first, |last| last.at)))
    }

    /// Whether motor 1 is off now.
    pub fn is_off(&self) -> bool {
        !self.snapshot().outputs.motors[0].enabled
    }

    /// The most that was ever seen.
    pub fn greatest(&self) -> Greatest {
        let most = |of: fn(&Moment) -> f64| self.course.iter().map(of).fold(f64::MIN, f64::max);
        Greatest {
            duty: most(|m| m.drive.duty.abs()),
            current: most(|m| m.current.abs()),
            speed: most(|m| m.speed.abs()),
            travel: most(|m| m.position) + most(|m| -m.position),
        }
    }

    /// Sets settings by number, and waits until they are in force: for those who know what they want.
    ///
    /// # Panics
    /// If the board refuses.
    pub fn set(&mut self, settings: &[(u16, i32)]) {
        let mut data = Data::new();
        for (number, value) in settings {
            Assignments::emit(*number, *value, &mut data).expect("there is room");
        }
        let assignments = Assignments::parse(&data).expect("they are some");
        self.session.ask(&Request::Set(assignments), self.now()).expect("the line carries it");
        for _ in 0..1000 {
            self.step();
            match self.session.take_event() {
                Some(Event::Answered(Reply::Done)) => return,
                Some(Event::Failed(failure)) => panic!("{settings:?}: {failure:?}"),
                _ => {}
            }
        }
        panic!("{settings:?}: no answer");
    }

    /// Switches motor 1 off, stops its shaft by hand and waits until the board has seen that.
    pub fn to_standstill(&mut self) {
        self.session.send(&Command::Run { scope: Scope::Motor(Channel::Channel0), run: false });
        let is_off = (0..500).any(|_| {
            self.run_ms(1);
            self.is_off()
        });
        assert!(is_off, "a suspended motor is off");
        for _ in 0..300 {
            self.world.borrow_mut().machine.stop_by_hand();
            self.run_ms(1);
        }
    }

    /// Asks for a velocity in counts/s and stays with it for so long.
    pub fn hold_velocity(&mut self, velocity: i16, ms: u32) {
        let mut targets = [None; 6];
        targets[0] = Some(velocity);
        let (quantity, addressing) = (Quantity::Velocity, Addressing::List);
        self.session.send(&Command::Move(Move { quantity, addressing, targets, periods: 0 }));
        self.session.drive(Some(SIGN_OF_LIFE), self.now());
        self.run_ms(ms);
        self.session.drive(None, self.now());
    }

    fn note(&mut self) {
        let snapshot = self.snapshot();
        if snapshot.faults.count() > 0 {
            for fault in crate::latched(&snapshot) {
                if !self.faults.contains(&fault) {
                    self.faults.push(fault);
                }
            }
        }
        let set_point = match snapshot.channels[0].set_point {
            SetPoint::Velocity(velocity) => Some(velocity.to_num()),
            _ => None,
        };
        let (at, world) = (self.now(), self.world.borrow());
        let machine = &world.machine;
        self.course.push(Moment {
            at,
            position: machine.position(),
            speed: machine.speed(),
            current: machine.current(),
            drive: world.drive,
            set_point,
        });
    }
}

/// The firmware's tasks. What they are wired with is here and nowhere else.
async fn board(world: Rc<RefCell<World>>, line: Line, channels: Rc<Channels<LinkCounters>>) {
    let settings = Settings::DEFAULT;
    let mut session = Pms5005::new(settings, Boot::default(), Instant::now());
    let mut controller = Controller::new(settings.control);
    let recorder = Recorder::new(vec![Row::ZERO; RECORDER_ROWS]);
    let recorder = Mutex::new(RefCell::new(recorder));
    let (mut rx, mut tx) = line.board_end();
    let mut motion = Bench(world);
    join5(
        app::control(&mut motion, &mut controller, &recorder, &channels, |_| {}),
        app::link(&mut rx, &mut tx, &mut session, &recorder, &channels),
        app::sensors(&mut Idle, &channels),
        app::display(&mut Idle, &channels),
        app::no_upkeep(&channels),
    )
    .await;
}

/// The machine, and how far it has come.
struct World {
    machine: Machine,
    drive: Drive,
    /// Milliseconds.
    now: u64,
}

impl World {
    fn new(machine: Machine) -> Self {
        Self { machine, drive: Drive::default(), now: 0 }
    }
}

/// What the controller sees of it.
struct Bench(Rc<RefCell<World>>);

impl MotionPort for Bench {
    fn sample(&mut self) -> MotionInputs {
        let mut world = self.0.borrow_mut();
        while world.now < Instant::now().as_millis() {
            let drive = world.drive;
            world.machine.step(drive);
            world.now += 1;
        }
        MotionInputs {
            potentiometers: [2048; 6],
            currents: [world.machine.current_adc(), 0, 0, 0, 0, 0],
            encoders: [world.machine.counter(), 0],
        }
    }

    fn drive(&mut self, outputs: &Outputs) {
        let [motor, ..] = outputs.motors;
        let duty = f64::from(motor.duty.raw()) / f64::from(Duty::FULL);
        self.0.borrow_mut().drive = Drive { duty, enabled: motor.enabled };
    }
}

/// Sensors in a room without anything, with 12 V for the motors; no display.
struct Idle;

impl SensorPort for Idle {
    async fn read(&mut self) -> Sensors {
        Timer::after_millis(20).await;
        Sensors {
            overheat: [1850; 2],
            temperature: 2022,
            battery: [3367, 2048, 2730],
            reference: [3412, 2048],
            ..Sensors::UNKNOWN
        }
    }
}

impl LcdPort for Idle {
    async fn show(&mut self, _number: u8, _columns: &[u8; 64]) {}
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workshop::judge;

    /// A plant that the default settings are made for: some 16,000 counts/s at full duty, not too slow.
    fn ordinary() -> Plant {
        let fits = |plant: &Plant| {
            let truth = plant.truth();
            (12_000.0..20_000.0).contains(&truth.full_speed) && truth.tau < 0.15
        };
        (0..).map(Plant::number).find(fits).expect("there are enough")
    }

    #[test]
    fn the_default_gains_bring_an_ordinary_plant_to_its_set_point() {
        let plant = ordinary();
        let mut rig = Rig::new(&plant, None);
        let response = judge::step(&mut rig, &plant);
        assert!(response.settling.is_some_and(|s| (0.03..2.0).contains(&s)), "{response:?}");
        assert!(response.steady_error.abs() < 1.0 && response.overshoot < 40.0, "{response:?}");
        assert_eq!(rig.faults(), []);
        let greatest = rig.greatest();
        assert!((0.3..=1.0).contains(&greatest.duty) && greatest.speed >= response.target * 0.99);
        // The same again is the same, to the bit.
        let mut again = Rig::new(&plant, None);
        assert_eq!(judge::step(&mut again, &plant), response);
    }

    #[test]
    fn the_host_hears_what_the_shaft_does() {
        let plant = ordinary();
        let mut rig = Rig::new(&plant, None);
        assert!(rig.now() < Duration::from_millis(100) && rig.is_off() && rig.driven().is_none());
        rig.hold_velocity(6000, 1000);
        let (first, last) = rig.driven().expect("it is driven");
        assert!(last > first + Duration::from_millis(990));
        let tail = &rig.course()[rig.course().len() - 300..];
        let duty = tail.iter().map(|m| m.drive.duty).sum::<f64>() / 300.0;
        let needs = plant.truth().dead_band + 6000.0 / plant.truth().gain;
        assert!((duty / needs - 1.0).abs() < 0.03, "{duty}, but this plant needs {needs}");
        let snapshot = rig.snapshot();
        let true_speed = rig.course().last().unwrap().speed;
        let told: f64 = snapshot.channels[0].velocity.to_num();
        assert!((told / true_speed - 1.0).abs() < 0.05, "{told} of {true_speed}");
        let count = f64::from(snapshot.channels[0].position);
        assert!((count - rig.course().last().unwrap().position).abs() < 4.0);
        rig.to_standstill();
        assert!(rig.is_off() && rig.course().last().unwrap().speed == 0.0);
        // A host that falls silent does not leave it running.
        rig.hold_velocity(6000, 100);
        rig.run_ms(2500);
        assert!(rig.is_off());
    }

    #[test]
    fn swapped_wires_run_away_until_the_board_notices_and_a_fault_is_told() {
        let mut rig = Rig::new(&ordinary(), Some(Wrong::SwappedWires));
        rig.hold_velocity(3000, 1000);
        assert_eq!(rig.faults(), [(Fault::TrackingError, Some(0))]);
        assert!(rig.is_off() && rig.greatest().travel > 100.0);
    }
}
