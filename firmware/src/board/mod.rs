//! Boards: what the ports are made of on an STM32F4. Target only.
//!
//! One file a board: its pins, timers, DMA streams and interrupts, and who owns them. Everything
//! is claimed from embassy's tokens, so nothing can be claimed twice, and every pin's alternate
//! function is checked by the traits of the chip. The file stands over parts that know only what
//! it gives them:
//!
//! | part | what it is |
//! |---|---|
//! | `boot` | 168 MHz, why the board was reset |
//! | [`watchdog`] | the independent watchdog |
//! | [`system`] | restarts, the ROM's loader, the stack's depth |
//! | [`flash`] | where the settings survive |
//! | [`drives`] | bridges, servos, output port by registers alone, and their safe state |
//! | [`motion`] | those, the encoders and the fast inputs as one port |
//! | [`analog`] | 48 analogue inputs through three multiplexers, scanned without the CPU |
//! | [`line`] | the host's UART |
//! | [`bus`] | the bus of AX-12 servos, for the CM-5's image |
//! | [`sensing`] | ultrasonic rangers, infrared remote, the slow sensors' port |
//! | [`ssd1306`] | the display |
//! | `fault` | panic and hard fault: outputs safe first |
//!
//! Promise: whatever happens, [`safe_state`] disables every bridge, ends every servo pulse and
//! lowers every output; it needs no stack to speak of and no initialisation.
//!
//! How to add a board: `firmware/README.md`.

mod boot;
mod dma;
mod fault;

pub mod analog;
pub mod bus;
pub mod drives;
pub mod flash;
pub mod line;
pub mod motion;
pub mod sensing;
pub mod ssd1306;
pub mod system;
pub mod watchdog;

// What all boards have on the same pins so far. Macros, since a function cannot take some tokens and leave
// the others.

/// The host's line.
macro_rules! host_line {
    ($p:ident, $baud:ident) => {
        line::new(
            line::Parts {
                usart: $p.USART2,
                registers: embassy_stm32::pac::USART2,
                rx: $p.PA3,
                tx: $p.PA2,
                rx_dma: $p.DMA1_CH5,
                tx_dma: $p.DMA1_CH6,
            },
            $baud,
            Irqs,
        )
    };
}

/// Gives the servos' pins to their timers.
macro_rules! claim_servos {
    ($p:ident) => {
        DRIVES.servos[0].claim::<TIM3, Ch1>($p.PB4);
        DRIVES.servos[1].claim::<TIM3, Ch2>($p.PB5);
        DRIVES.servos[2].claim::<TIM3, Ch3>($p.PB0);
        DRIVES.servos[3].claim::<TIM3, Ch4>($p.PB1);
        DRIVES.servos[4].claim::<TIM12, Ch1>($p.PB14);
        DRIVES.servos[5].claim::<TIM12, Ch2>($p.PB15);
    };
}

/// The analogue scan, with the multiplexers' address lines on these pins.
macro_rules! analog {
    ($p:ident, [$($address:ident),+]) => {
        analog::Analog::new(
            $p.ADC1,
            [$p.PC1.degrade_adc(), $p.PC2.degrade_adc(), $p.PC4.degrade_adc()],
            &ADDRESSES,
            [$($p.$address.into()),+],
            $p.DMA2_CH1,
            $p.DMA2_CH0,
        )
    };
}

/// The encoders' timers.
macro_rules! encoders {
    ($p:ident) => {
        (
            Qei::new($p.TIM2, $p.PA15, $p.PB3, motion::encoder_inputs()),
            Qei::new($p.TIM4, $p.PB6, $p.PB7, motion::encoder_inputs()),
        )
    };
}

/// The display on its bus.
macro_rules! display {
    ($p:ident) => {
        Ssd1306::new(
            I2c::new_blocking($p.I2C1, $p.PB8, $p.PB9, ssd1306::bus_config()),
            ssd1306::Wires {
                registers: embassy_stm32::pac::I2C1,
                lines: Lines { port: embassy_stm32::pac::GPIOB, pins: &[8, 9] },
            },
        )
    };
}

#[cfg_attr(feature = "board-f407", path = "f407.rs")]
#[cfg_attr(feature = "board-f446", path = "f446.rs")]
mod selected;

pub use selected::{Motion, Sensing, start};

use crate::ports::ResetCause;
use embassy_stm32::gpio::Speed;
use embassy_stm32::interrupt::typelevel::{Binding, Handler, USART6};

use crate::liveness::BRIDGE_WATCHDOG_PERIOD;
use crate::recorder::Row;
use crate::settings::store::Store;
use selected::{BUS, CLOCK, DRIVES, Irqs, enables, outputs};
pub use system::stack_used;

/// The parts of a board with motors, each for its task.
pub struct Board {
    /// For `app::control`.
    pub motion: Motion,
    /// Its own task.
    pub sensing: Sensing,
    /// For `app::display`.
    pub display: ssd1306::Ssd1306,
    /// For `app::link`, from the host.
    pub rx: line::Receiver,
    /// For `app::link`, to the host.
    pub tx: line::Sender,
    /// For `app::control`.
    pub watchdog: watchdog::Watchdog,
    /// For `app::upkeep`.
    pub system: system::System,
    /// Where the settings are, for `app::upkeep`.
    pub store: Store<flash::Flash>,
    /// Memory for the recorder.
    pub rows: &'static mut [Row],
    /// Why it has started.
    pub reset: ResetCause,
}

/// The parts of a board between a PC and a servo bus, for `bridge::tasks`. The outputs are in their
/// safe state, and nobody can change it.
pub struct BridgeBoard {
    /// From the PC.
    pub pc_rx: line::Receiver,
    /// To the PC.
    pub pc_tx: line::Sender,
    /// Hears the bus.
    pub bus_rx: bus::Receiver,
    /// Sends on the bus.
    pub bus_tx: bus::Sender,
    /// For `bridge::tasks`.
    pub watchdog: watchdog::Watchdog,
}

/// Puts all outputs into their safe state, from wherever the program is.
pub fn safe_state() {
    DRIVES.make_safe();
}

/// The servo bus's interrupt, for an image that calls [`start_bridge`].
pub struct BusInterrupt;

impl Handler<USART6> for BusInterrupt {
    unsafe fn on_interrupt() {
        BUS.on_interrupt();
    }
}

/// Starts the clocks, puts the outputs into their safe state, then starts what the CM-5's bridge
/// takes, the PC's line at `baud`. Bridges and servos have no timer.
pub fn start_bridge(baud: u32, _interrupt: impl Binding<USART6, BusInterrupt>) -> BridgeBoard {
    let p = boot::clocks(CLOCK);
    DRIVES.enables.claim(enables!(p), Speed::Low);
    let watchdog = watchdog::Watchdog::start(p.IWDG, BRIDGE_WATCHDOG_PERIOD);
    boot::reset_cause();
    DRIVES.outputs.claim(outputs!(p), Speed::Low);
    let (pc_rx, pc_tx) = host_line!(p, baud);
    let (bus_rx, bus_tx) = BUS.start(p.USART6, p.PC6, p.PC8.into());
    BridgeBoard { pc_rx, pc_tx, bus_rx, bus_tx, watchdog }
}
