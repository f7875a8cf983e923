//! The CM-5's bridge on the board that a cargo feature selects. It drives nothing: every enable
//! line and output is low.
//!
//! One executor, in the thread, and a task for each of the bridge's loops: a byte of the bus wakes the bus's
//! alone. Whatever the bridge does between two bytes takes microseconds, and the UARTs need nobody meanwhile.
#![no_std]
#![no_main]

use core::cell::RefCell;

use defmt_rtt as _;
use embassy_executor::Spawner;
use embassy_stm32::bind_interrupts;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_time::Instant;
use firmware::board::line::{Receiver, Sender};
use firmware::board::{self, BridgeBoard};
use firmware::bridge::tasks::{self, BridgeChannels};
use firmware::bridge::{Bridge, BridgeSettings};
use static_cell::StaticCell;

const SETTINGS: BridgeSettings = BridgeSettings::DEFAULT;

static BOARD: StaticCell<BridgeBoard> = StaticCell::new();
static BRIDGE: StaticCell<RefCell<Bridge>> = StaticCell::new();
static CHANNELS: StaticCell<Channels> = StaticCell::new();

// Here and not in the board's file, so that other images do not carry it.
bind_interrupts!(struct Irqs {
    USART6 => board::BusInterrupt;
});

type Channels = BridgeChannels<NoopRawMutex>;

#[embassy_executor::task]
async fn receive(
    rx: &'static mut Receiver,
    bridge: &'static RefCell<Bridge>,
    channels: &'static Channels,
) {
    tasks::receive(rx, bridge, channels).await;
}

#[embassy_executor::task]
async fn transmit(
    tx: &'static mut Sender,
    bridge: &'static RefCell<Bridge>,
    channels: &'static Channels,
) {
    tasks::transmit(tx, bridge, channels).await;
}

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let BridgeBoard { pc_rx, pc_tx, bus_rx, bus_tx, watchdog } =
        BOARD.init_with(|| board::start_bridge(SETTINGS.pc_baud, Irqs));
    let bridge = &*BRIDGE.init_with(|| RefCell::new(Bridge::new(SETTINGS, Instant::now())));
    let channels = &*CHANNELS.init_with(Channels::new);
    spawner.spawn(defmt::unwrap!(receive(pc_rx, bridge, channels)));
    spawner.spawn(defmt::unwrap!(transmit(pc_tx, bridge, channels)));
    tasks::bus(bus_rx, bus_tx, bridge, channels, || watchdog.feed(false)).await;
}
