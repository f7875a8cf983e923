//! The virtual board: the firmware's own tasks over the simulated ports, on virtual time.
//!
//! ```
//! use embassy_time::Duration;
//! use hal_mock::board::VirtualBoard;
//! use protocol::pms5005::Command;
//!
//! let mut board = VirtualBoard::default();
//! let mut buffer = [0; 16];
//! board.line.host_sends(Command::GpioOutputs(0x81).encode(0, &mut buffer).unwrap());
//! board.run_for(Duration::from_millis(10));
//! assert_eq!(board.plant.borrow().outputs.gpio, 0x81);
//! ```

use std::cell::RefCell;
use std::rc::Rc;

use embassy_futures::join::join;
use embassy_futures::select::{Either3, select3};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant};
use firmware::app;
use firmware::controller::{Controller, Snapshot};
use firmware::liveness::WATCHDOG_PERIOD;
use firmware::personality::Boot;
use firmware::personality::Session;
use firmware::personality::pms5005::Pms5005;
use firmware::ports::{Outputs, Program, ResetCause, SystemPort};
use firmware::recorder::{Recorder, Row};
use firmware::settings::Settings;
use firmware::settings::store::{Origin, Store};

use crate::clock;
use crate::flash::{self, Flash};
use crate::plant::{Plant, Scene};
use crate::running::Running;
use crate::tasks::{self, Channels, RECORDER_ROWS, Watchdog};
use crate::wire::Line;

/// What a virtual board is made of.
#[derive(Clone, Copy, Debug)]
pub struct Make {
    /// The world around it.
    pub scene: Scene,
    /// The firmware's settings while none are saved.
    pub settings: Settings,
    /// The line's speed in baud; 0 takes no time.
    pub line_rate: u32,
    /// Seed of every noise.
    pub seed: u64,
}

impl Default for Make {
    fn default() -> Self {
        Self { scene: Scene::default(), settings: Settings::DEFAULT, line_rate: 115_200, seed: 1 }
    }
}

/// A board on virtual time, a PMS5005 or with another session. There is one at a time in a thread:
/// making another sets the thread's clock back to zero.
pub struct VirtualBoard<S: Session = Pms5005> {
    running: Running,
    /// Those since the last start.
    channels: Rc<RefCell<Rc<Channels<S::Counters>>>>,
    restart: Rc<Restart>,
    /// What starts the firmware again when it hangs, and what makes it hang.
    pub watchdog: Rc<Watchdog>,
    /// The world around the board.
    pub plant: Rc<RefCell<Plant>>,
    /// The line to the host.
    pub line: Line,
    /// Where settings survive.
    pub flash: Flash,
}

/// Why the firmware is to start again.
type Restart = Signal<NoopRawMutex, ResetCause>;

impl VirtualBoard {
    /// A PMS5005 that has just been switched on for the first time.
    pub fn new(make: Make) -> Self {
        Self::with_flash(make, Flash::empty())
    }

    /// A PMS5005 that has just been switched on, with what this flash holds.
    pub fn with_flash(make: Make, flash: Flash) -> Self {
        Self::with_session(make, flash, Pms5005::new)
    }

    /// Frames and commands refused so far: by the session for what they say, by the controller for
    /// what they would do.
    pub fn refused(&self) -> u32 {
        self.link().refused.wrapping_add(self.snapshot().counters.refused.total())
    }
}

impl<S: Session + 'static> VirtualBoard<S> {
    /// A board that has just been switched on, with what this flash holds and a session made at
    /// each start.
    pub fn with_session(
        make: Make,
        flash: Flash,
        mut session: impl FnMut(Settings, Boot, Instant) -> S + 'static,
    ) -> Self {
        clock::reset();
        let plant = Rc::new(RefCell::new(Plant::new(make.scene, make.seed)));
        let line = Line::new(make.line_rate);
        line.cut(!make.scene.faults.link);
        let channels = Rc::new(RefCell::new(Rc::new(Channels::new())));
        let restart = Rc::new(Restart::new());
        let watchdog = Rc::new(Watchdog::new(WATCHDOG_PERIOD));
        let running = Running::new({
            let (mut rx, mut tx) = line.board_end();
            let mut store = Store::new(flash.clone(), 0..flash::SIZE as u32);
            let (plant, all_channels, restart) = (plant.clone(), channels.clone(), restart.clone());
            let watchdog = watchdog.clone();
            async move {
                let mut reset = ResetCause::Power;
                loop {
                    let channels = Rc::new(Channels::new());
                    all_channels.replace(channels.clone());
                    plant.borrow_mut().outputs = Outputs::default();
                    watchdog.feed();
                    let (settings, origin) = match store.load(|| {}) {
                        (settings, Origin::Stored) => (settings, Origin::Stored),
                        (_, origin) => (make.settings, origin),
                    };
                    let boot = Boot { reset, settings: origin, stack_used: || 0 };
                    let mut session = session(settings, boot, Instant::now());
                    let mut controller = Controller::new(settings.control);
                    let recorder = Recorder::new(vec![Row::ZERO; RECORDER_ROWS]);
                    let recorder = Mutex::new(RefCell::new(recorder));
                    boot.faults().for_each(|fault| controller.record(fault));
                    let mut system = System { restart: &restart, watchdog: &watchdog };
                    let tasks = join(
                        tasks::all(
                            &plant,
                            &mut controller,
                            &mut session,
                            &recorder,
                            (&mut rx, &mut tx),
                            &channels,
                            &watchdog,
                        ),
                        app::upkeep(&mut store, &mut system, &channels),
                    );
                    reset = match select3(tasks, restart.wait(), watchdog.bites()).await {
                        Either3::Second(cause) => cause,
                        Either3::First(_) | Either3::Third(()) => ResetCause::Watchdog,
                    };
                    watchdog.hung.set(None);
                }
            }
        });
        Self { running, channels, restart, watchdog, plant, line, flash }
    }

    /// Starts the firmware from its beginning: what it drove goes off, what it knew is lost. World,
    /// line and flash stay.
    pub fn start_again(&mut self, reset: ResetCause) {
        self.restart.signal(reset);
    }

    /// Runs until `time`.
    pub fn run_until(&mut self, time: Instant) {
        self.running.run_until(time);
        self.plant.borrow_mut().advance_to(time.as_millis());
    }

    /// Runs for some time.
    pub fn run_for(&mut self, time: Duration) {
        self.run_until(Instant::now() + time);
    }

    /// What the controller last knew.
    pub fn snapshot(&self) -> Snapshot {
        self.channels.borrow().snapshot.get()
    }

    /// What the session has counted.
    pub fn link(&self) -> S::Counters {
        self.channels.borrow().link.get()
    }
}

impl Default for VirtualBoard {
    fn default() -> Self {
        Self::new(Make::default())
    }
}

/// A processor that has no other program than the firmware.
struct System<'a> {
    restart: &'a Restart,
    watchdog: &'a Watchdog,
}

impl SystemPort for System<'_> {
    fn before_erase(&mut self) {
        self.watchdog.feed();
    }

    fn can_start(&self, program: Program) -> bool {
        program == Program::Firmware
    }

    fn start(&mut self, _program: Program) {
        self.restart.signal(ResetCause::Software);
    }
}
