//! The virtual CM-5: the firmware's bridge between a PC's line and a bus of simulated servos, on
//! virtual time.
//!
//! ```
//! use embassy_time::Duration;
//! use hal_mock::cm5_board::{Cm5Board, Make};
//! use hal_mock::plant::Ax12;
//! use protocol::cm5::{Hello, params_of};
//!
//! let mut board = Cm5Board::new(Make { servos: vec![Ax12::new(7)], ..Make::default() });
//! board.run_for(Duration::from_secs(1));
//! let (_, packet) = board.line.host_receives().unwrap();
//! assert_eq!(Hello::parse(params_of(&packet).unwrap()), Some(Hello { ids: &[7] }));
//! ```

use std::cell::{Cell, Ref, RefCell};
use std::rc::Rc;

use embassy_futures::join::join3;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_time::{Duration, Instant};
use firmware::bridge::tasks::{self, BridgeChannels};
use firmware::bridge::{Bridge, BridgeSettings};
use firmware::liveness::BRIDGE_WATCHDOG_PERIOD;

use crate::clock;
use crate::plant::Ax12;
use crate::running::Running;
use crate::servo_bus::{self, MasterEnd, ServoBus};
use crate::tasks::Watchdog;
use crate::wire::Line;

/// What a virtual CM-5 is made of.
#[derive(Clone, Debug)]
pub struct Make {
    /// The servos, all plugged in.
    pub servos: Vec<Ax12>,
    /// Their bus.
    pub bus: servo_bus::Make,
    /// The firmware's settings.
    pub settings: BridgeSettings,
    /// The speed of the PC's line in baud; 0 takes no time.
    pub line_rate: u32,
}

impl Default for Make {
    /// No servos, 1,000,000 baud on both sides.
    fn default() -> Self {
        Self {
            servos: Vec::new(),
            bus: servo_bus::Make::default(),
            settings: BridgeSettings::DEFAULT,
            line_rate: 1_000_000,
        }
    }
}

/// A loop of the bridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loop {
    /// [`tasks::receive`].
    Receive,
    /// [`tasks::transmit`].
    Transmit,
    /// [`tasks::bus`].
    Bus,
}

/// A CM-5 on virtual time. There is one board at a time in a thread: making another sets the
/// thread's clock back to zero.
pub struct Cm5Board {
    running: Running,
    bridge: Rc<RefCell<Bridge>>,
    restarts: Rc<Cell<u32>>,
    /// What starts the bridge again when it hangs, and what makes it hang.
    pub watchdog: Rc<Watchdog<Loop>>,
    /// The line to the PC.
    pub line: Line,
    /// The servos on their bus, in the order they were given.
    pub bus: MasterEnd,
}

impl Cm5Board {
    /// A board that has just been switched on.
    pub fn new(make: Make) -> Self {
        clock::reset();
        let line = Line::new(make.line_rate);
        let bus = MasterEnd::new(ServoBus::new(make.bus, make.servos));
        let new_bridge = move || Bridge::new(make.settings, Instant::now());
        let bridge = Rc::new(RefCell::new(new_bridge()));
        let watchdog = Rc::new(Watchdog::new(BRIDGE_WATCHDOG_PERIOD));
        let restarts = Rc::new(Cell::new(0));
        let running = Running::new({
            let (mut pc_rx, mut pc_tx) = line.board_end();
            let (mut bus_rx, mut bus_tx) = bus.split();
            let (bridge, watchdog, restarts) = (bridge.clone(), watchdog.clone(), restarts.clone());
            async move {
                loop {
                    let all = BridgeChannels::<NoopRawMutex>::new();
                    let (rx, tx) = (&mut bus_rx, &mut bus_tx);
                    let feed = || watchdog.feed();
                    let watch = &watchdog;
                    let loops = join3(
                        watch.watch(Loop::Receive, tasks::receive(&mut pc_rx, &bridge, &all)),
                        watch.watch(Loop::Transmit, tasks::transmit(&mut pc_tx, &bridge, &all)),
                        watch.watch(Loop::Bus, tasks::bus(rx, tx, &bridge, &all, feed)),
                    );
                    select(loops, watchdog.bites()).await;
                    bridge.replace(new_bridge());
                    watchdog.hung.set(None);
                    watchdog.feed();
                    restarts.set(restarts.get() + 1);
                }
            }
        });
        Self { running, bridge, restarts, watchdog, line, bus }
    }

    /// Runs until `time`.
    pub fn run_until(&mut self, time: Instant) {
        self.running.run_until(time);
    }

    /// Runs for some time.
    pub fn run_for(&mut self, time: Duration) {
        self.run_until(Instant::now() + time);
    }

    /// Times that the watchdog has started it again.
    pub fn restarts(&self) -> u32 {
        self.restarts.get()
    }

    /// The bridge, to look at.
    pub fn bridge(&self) -> Ref<'_, Bridge> {
        self.bridge.borrow()
    }
}
