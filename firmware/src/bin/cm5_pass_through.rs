//! The CM-5 as a pass-through, on the board that a cargo feature selects: the PC is the servo bus's master.
//! It drives nothing: every enable line and output is low.
//!
//! One executor, in the thread, and a task for each of the pass-through's loops, as in `cm5.rs`.
#![no_std]
#![no_main]

use core::cell::RefCell;

use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::bind_interrupts;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware::board::line::{Receiver, Sender};
use firmware::board::{self, BridgeBoard, bus};
use firmware::bridge::BridgeSettings;
use firmware::bridge::pass_through::PassThrough;
use firmware::bridge::pass_through::tasks::{self, PC_LOOK};
use firmware::bridge::tasks::BridgeChannels;
use static_cell::StaticCell;

static BOARD: StaticCell<BridgeBoard> = StaticCell::new();
static PASS: StaticCell<RefCell<PassThrough>> = StaticCell::new();
static CHANNELS: StaticCell<Channels> = StaticCell::new();

bind_interrupts!(struct Irqs {
    USART6 => board::BusInterrupt;
});

type Channels = BridgeChannels<NoopRawMutex>;

#[embassy_executor::task]
async fn send(
    rx: &'static mut Receiver,
    tx: &'static mut bus::Sender,
    pass: &'static RefCell<PassThrough>,
    channels: &'static Channels,
) {
    tasks::send(rx, tx, pass, channels).await;
}

#[embassy_executor::task]
async fn transmit(
    tx: &'static mut Sender,
    pass: &'static RefCell<PassThrough>,
    channels: &'static Channels,
) {
    tasks::transmit(tx, pass, channels).await;
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let BridgeBoard { pc_rx, pc_tx, bus_rx, bus_tx, watchdog } =
        BOARD.init_with(|| board::start_bridge(BridgeSettings::DEFAULT.pc_baud, Irqs));
    pc_rx.look_every(PC_LOOK);
    let pass = &*PASS.init_with(|| RefCell::new(PassThrough::new()));
    let channels = &*CHANNELS.init_with(Channels::new);
    spawner.spawn(defmt::unwrap!(send(pc_rx, bus_tx, pass, channels)));
    spawner.spawn(defmt::unwrap!(transmit(pc_tx, pass, channels)));
    tasks::hear(bus_rx, pass, channels, || watchdog.feed(false)).await;
}
