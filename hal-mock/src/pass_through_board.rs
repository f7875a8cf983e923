//! The virtual CM-5 as a pass-through: the firmware's loops between a PC's line and a bus of simulated
//! servos, on virtual time.
//!
//! ```
//! use embassy_time::Duration;
//! use hal_mock::pass_through_board::{Make, PassThroughBoard};
//! use hal_mock::plant::Ax12;
//!
//! let mut board = PassThroughBoard::new(Make { servos: vec![Ax12::new(7)], ..Make::default() });
//! board.line.host_sends(&[0xFF, 0xFF, 7, 2, 1, 0xF5]); // PING
//! board.run_for(Duration::from_millis(1));
//! let heard = std::iter::from_fn(|| board.line.host_receives()).flat_map(|(_, bytes)| bytes);
//! assert_eq!(heard.collect::<Vec<_>>(), [0xFF, 0xFF, 7, 2, 0, 0xF6]);
//! ```

use std::cell::{Cell, Ref, RefCell};
use std::rc::Rc;

use embassy_futures::join::join3;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_time::{Duration, Instant};
use firmware::bridge::pass_through::PassThrough;
use firmware::bridge::pass_through::tasks::{self, PC_LOOK};
use firmware::bridge::tasks::BridgeChannels;
use firmware::liveness::BRIDGE_WATCHDOG_PERIOD;

use crate::clock;
use crate::plant::Ax12;
use crate::running::Running;
use crate::servo_bus::{self, MasterEnd, ServoBus};
use crate::tasks::Watchdog;
use crate::wire::Line;

/// What a virtual pass-through is made of.
#[derive(Clone, Debug)]
pub struct Make {
    /// The servos, all plugged in.
    pub servos: Vec<Ax12>,
    /// Their bus.
    pub bus: servo_bus::Make,
    /// The speed of the PC's line in baud; 0 takes no time.
    pub line_rate: u32,
}

impl Default for Make {
    /// No servos, 1,000,000 baud on both sides.
    fn default() -> Self {
        Self { servos: Vec::new(), bus: servo_bus::Make::default(), line_rate: 1_000_000 }
    }
}

/// A loop of the pass-through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loop {
    /// [`tasks::send`].
    Send,
    /// [`tasks::hear`].
    Hear,
    /// [`tasks::transmit`].
    Transmit,
}

/// A pass-through on virtual time. There is one board at a time in a thread: making another sets the
/// thread's clock back to zero.
pub struct PassThroughBoard {
    running: Running,
    pass: Rc<RefCell<PassThrough>>,
    restarts: Rc<Cell<u32>>,
    /// What starts it again when it hangs, and what makes it hang.
    pub watchdog: Rc<Watchdog<Loop>>,
    /// The line to the PC.
    pub line: Line,
    /// The servos on their bus, in the order they were given.
    pub bus: MasterEnd,
}

impl PassThroughBoard {
    /// A board that has just been switched on.
    pub fn new(make: Make) -> Self {
        clock::reset();
        let line = Line::looked_at(make.line_rate, PC_LOOK);
        let bus = MasterEnd::new(ServoBus::new(make.bus, make.servos));
        let pass = Rc::new(RefCell::new(PassThrough::new()));
        let watchdog = Rc::new(Watchdog::new(BRIDGE_WATCHDOG_PERIOD));
        let restarts = Rc::new(Cell::new(0));
        let running = Running::new({
            let (mut pc_rx, mut pc_tx) = line.board_end();
            let (mut bus_rx, mut bus_tx) = bus.split();
            let (pass, watch, restarts) = (pass.clone(), watchdog.clone(), restarts.clone());
            async move {
                loop {
                    let all = BridgeChannels::<NoopRawMutex>::new();
                    let (rx, tx) = (&mut pc_rx, &mut bus_tx);
                    let feed = || watch.feed();
                    let loops = join3(
                        watch.watch(Loop::Send, tasks::send(rx, tx, &pass, &all)),
                        watch.watch(Loop::Hear, tasks::hear(&mut bus_rx, &pass, &all, feed)),
                        watch.watch(Loop::Transmit, tasks::transmit(&mut pc_tx, &pass, &all)),
                    );
                    select(loops, watch.bites()).await;
                    pass.replace(PassThrough::new());
                    watch.hung.set(None);
                    watch.feed();
                    restarts.set(restarts.get() + 1);
                }
            }
        });
        Self { running, pass, restarts, watchdog, line, bus }
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

    /// The pass-through, to look at.
    pub fn pass(&self) -> Ref<'_, PassThrough> {
        self.pass.borrow()
    }
}
