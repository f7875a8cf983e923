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

use embassy_time::{Duration, Instant};
use firmware::controller::{Controller, Snapshot};
use firmware::personality::Session;
use firmware::personality::pms5005::Pms5005;
use firmware::settings::Settings;

use crate::clock;
use crate::plant::{Plant, Scene};
use crate::running::Running;
use crate::tasks::{self, Channels};
use crate::wire::Line;

/// What a virtual board is made of.
#[derive(Clone, Copy, Debug)]
pub struct Make {
    /// The world around it.
    pub scene: Scene,
    /// The firmware's settings.
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
    channels: Rc<Channels<S::Counters>>,
    /// The world around the board.
    pub plant: Rc<RefCell<Plant>>,
    /// The line to the host.
    pub line: Line,
}

impl VirtualBoard {
    /// A PMS5005 that has just been switched on.
    pub fn new(make: Make) -> Self {
        Self::with_session(make, |now| Pms5005::new(make.settings.link, now))
    }

    /// Frames and commands refused so far: by the session for what they say, by the controller for
    /// what they would do.
    pub fn refused(&self) -> u32 {
        self.link().refused.wrapping_add(self.snapshot().counters.refused)
    }
}

impl<S: Session + 'static> VirtualBoard<S> {
    /// A board that has just been switched on, with a session made for that time.
    pub fn with_session(make: Make, session: impl FnOnce(Instant) -> S) -> Self {
        clock::reset();
        let plant = Rc::new(RefCell::new(Plant::new(make.scene, make.seed)));
        let line = Line::new(make.line_rate);
        let channels = Rc::new(Channels::new());
        let running = Running::new({
            let (mut rx, mut tx) = line.board_end();
            let (plant, channels) = (plant.clone(), channels.clone());
            let mut session = session(Instant::now());
            async move {
                let mut controller = Controller::new(make.settings.control);
                let line = (&mut rx, &mut tx);
                tasks::all(&plant, &mut controller, &mut session, line, &channels).await;
            }
        });
        Self { running, channels, plant, line }
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
        self.channels.snapshot.get()
    }

    /// What the session has counted.
    pub fn link(&self) -> S::Counters {
        self.channels.link.get()
    }
}

impl Default for VirtualBoard {
    fn default() -> Self {
        Self::new(Make::default())
    }
}
