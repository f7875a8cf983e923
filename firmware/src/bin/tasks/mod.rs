//! What the images over the controller have in common: the library's tasks over the parts of the
//! board that a cargo feature selects. The image names its session, `Host`, made by `host`, and how
//! fast its host talks, `HOST_BAUD`.
//!
//! Three executors: control on an interrupt above sensing on another, so that a control period
//! never waits; link, display and upkeep in the thread.

use core::cell::RefCell;
use core::mem;

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Instant;
use firmware::app::{self, SharedRecorder};
use firmware::board::flash::Flash;
use firmware::board::line::{Receiver, Sender};
use firmware::board::ssd1306::Ssd1306;
use firmware::board::system::System;
use firmware::board::watchdog::Watchdog;
use firmware::board::{self, Board, Motion, Sensing};
use firmware::controller::Controller;
use firmware::personality::{Boot, Session};
use firmware::ports::SystemPort;
use firmware::recorder::{self, Row};
use firmware::settings::store::Store;
use static_cell::StaticCell;

use crate::{HOST_BAUD, Host, host};

type Recorder = SharedRecorder<CriticalSectionRawMutex, &'static mut [Row]>;
type Channels = app::Channels<CriticalSectionRawMutex, <Host as Session>::Counters>;

static CHANNELS: StaticCell<Channels> = StaticCell::new();
static BOARD: StaticCell<Board> = StaticCell::new();
static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static SESSION: StaticCell<Host> = StaticCell::new();
static RECORDER: StaticCell<Recorder> = StaticCell::new();
static CONTROL: InterruptExecutor = InterruptExecutor::new();
static SENSING: InterruptExecutor = InterruptExecutor::new();

#[interrupt]
unsafe fn UART4() {
    // SAFETY: this is the interrupt that CONTROL was started with.
    unsafe { CONTROL.on_interrupt() }
}

#[interrupt]
unsafe fn UART5() {
    // SAFETY: this is the interrupt that SENSING was started with.
    unsafe { SENSING.on_interrupt() }
}

#[embassy_executor::task]
async fn control(
    port: &'static mut Motion,
    core: &'static mut Controller,
    recorder: &'static Recorder,
    all: &'static Channels,
    watchdog: &'static mut Watchdog,
) {
    app::control(port, core, recorder, all, |is_driven| watchdog.feed(is_driven)).await;
}

#[embassy_executor::task]
async fn sensing(sensing: &'static mut Sensing, all: &'static Channels) {
    sensing.run(all).await;
}

#[embassy_executor::task]
async fn display(display: &'static mut Ssd1306, all: &'static Channels) {
    display.begin().await;
    app::display(display, all).await;
}

#[embassy_executor::task]
async fn link(
    rx: &'static mut Receiver,
    tx: &'static mut Sender,
    session: &'static mut Host,
    recorder: &'static Recorder,
    all: &'static Channels,
) {
    app::link(rx, tx, session, recorder, all).await;
}

/// Starts the board and its tasks, and yields what is left for `main` to do. Apart from `main`, whose
/// future would keep what is needed here only.
fn start(spawner: Spawner) -> (&'static mut Store<Flash>, &'static mut System, &'static Channels) {
    let Board {
        motion,
        sensing: sensors,
        display: lcd,
        rx,
        tx,
        watchdog,
        system,
        store,
        rows,
        reset,
    } = BOARD.init_with(|| board::start(HOST_BAUD));
    let all = &*CHANNELS.init_with(Channels::new);
    let (settings, origin) = store.load(|| system.before_erase());
    let boot = Boot { reset: *reset, settings: origin, stack_used: board::stack_used };
    let core = CONTROLLER.init_with(|| Controller::new(settings.control));
    boot.faults().for_each(|fault| core.record(fault));
    let session = SESSION.init_with(|| host(settings, boot, Instant::now()));
    let recorder = recorder::Recorder::new(mem::take(rows));
    let recorder = &*RECORDER.init_with(|| Mutex::new(RefCell::new(recorder)));
    interrupt::UART4.set_priority(Priority::P6);
    interrupt::UART5.set_priority(Priority::P7);
    CONTROL
        .start(interrupt::UART4)
        .spawn(defmt::unwrap!(control(motion, core, recorder, all, watchdog)));
    SENSING.start(interrupt::UART5).spawn(defmt::unwrap!(sensing(sensors, all)));
    spawner.spawn(defmt::unwrap!(display(lcd, all)));
    spawner.spawn(defmt::unwrap!(link(rx, tx, session, recorder, all)));
    (store, system, all)
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let (store, system, all) = start(spawner);
    app::upkeep(store, system, all).await;
}
