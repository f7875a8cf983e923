//! The PMS5005 on an STM32F407: the library's tasks over the board's parts.
//!
//! Three executors: control on an interrupt above sensing on another, so that a control period
//! never waits; link, display and supervision in the thread.
#![no_std]
#![no_main]

use defmt_rtt as _;
use embassy_executor::{InterruptExecutor, Spawner};
use embassy_stm32::interrupt;
use embassy_stm32::interrupt::{InterruptExt, Priority};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Instant;
use firmware::app;
use firmware::board::f407::{self, Motion};
use firmware::board::line::{Receiver, Sender};
use firmware::board::sensing::Sensing;
use firmware::board::ssd1306::Ssd1306;
use firmware::controller::Controller;
use firmware::personality::pms5005::Session;
use firmware::settings::Settings;
use static_cell::StaticCell;

type Channels = app::Channels<CriticalSectionRawMutex>;

static CHANNELS: StaticCell<Channels> = StaticCell::new();
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
async fn control(motion: Motion, channels: &'static Channels) {
    app::control(motion, Controller::new(Settings::DEFAULT.control), channels).await;
}

#[embassy_executor::task]
async fn sensing(sensing: Sensing, channels: &'static Channels) {
    sensing.run(channels).await;
}

#[embassy_executor::task]
async fn display(display: Ssd1306, channels: &'static Channels) {
    app::display(display, channels).await;
}

#[embassy_executor::task]
async fn link(line: (Receiver, Sender), channels: &'static Channels) {
    let session = Session::new(Settings::DEFAULT.link, Instant::now());
    app::link(line.0, line.1, session, channels).await;
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let mut board = f407::start();
    let channels = &*CHANNELS.init(Channels::new());
    interrupt::UART4.set_priority(Priority::P6);
    interrupt::UART5.set_priority(Priority::P7);
    let tasks = (
        control(board.motion, channels),
        sensing(board.sensing, channels),
        display(board.display, channels),
        link(board.line, channels),
    );
    CONTROL.start(interrupt::UART4).spawn(defmt::unwrap!(tasks.0));
    SENSING.start(interrupt::UART5).spawn(defmt::unwrap!(tasks.1));
    spawner.spawn(defmt::unwrap!(tasks.2));
    spawner.spawn(defmt::unwrap!(tasks.3));
    app::supervise(|| board.watchdog.pet(), channels).await;
}
