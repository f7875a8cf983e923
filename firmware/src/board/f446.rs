//! NUCLEO-F446RE (STM32F446RE, LQFP64): who owns which pin, timer and stream.
//!
//! It has run on no silicon; on a modelled F407 as far as the two chips are alike (README.md).
//!
//! | what | with | of the PMS5005's |
//! |---|---|---|
//! | bridges 0 to 2, 3 to 5 | TIM1 CH1 to CH3, TIM8 CH1 to CH3, 20 kHz | 6 of 6, locked anti-phase only |
//! | servos 0 to 3, 4 and 5 | TIM3 CH1 to CH4, TIM12 CH1 and CH2, 50 Hz | 6 of 6 |
//! | encoders 0 and 1 | TIM2, TIM4 | 2 of 2 |
//! | analogue scan | ADC1, TIM8 CH4 and update, DMA2 streams 0 and 1 | all |
//! | host | USART2, DMA1 streams 5 and 6: the ST-LINK's virtual COM port | |
//! | servo bus, in the CM-5's image only | USART6, no DMA; its pins are DC channels' here | |
//! | display | I2C1, polled | yes |
//! | rangers 0 to 2 | EXTI 1, 7, 12 | 3 of 6, the others read 255: nothing in range |
//! | remote | EXTI 2 | yes |
//! | inputs 0 and 1 | the blue button PC13, PC12 | 2 of 8, the others read 0 |
//! | outputs 0 and 1 | LD2 on PA5, PA4 | 2 of 8, the others are ignored |
//! | embassy's clock | TIM5 | |
//! | recorder | 32 KiB of SRAM: 2048 rows, 2 s of one channel at the control rate | |
//! | executors | the vectors of UART4 (control) and UART5 (sensing), otherwise unused | |
//!
//! What the board has on its pins is left alone: SWD (PA13, PA14), the 32 kHz crystal (PC14,
//! PC15), the ST-LINK's 8 MHz (PH0) and the pin beside it (PH1). README.md beside this file is the
//! wiring table for people.
//!
//! Promise: the enable lines are driven low before any timer runs.

use crate::channel::CHANNELS;
use embassy_stm32::adc::AdcChannel;
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::gpio::{Input, Pull, Speed};
use embassy_stm32::i2c::I2c;
use embassy_stm32::interrupt::typelevel;
use embassy_stm32::peripherals::{DMA1_CH5, DMA1_CH6, TIM1, TIM2, TIM3, TIM4, TIM8, TIM12, USART2};
use embassy_stm32::rcc::{Hse, HseMode};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::qei::Qei;
use embassy_stm32::timer::{Ch1, Ch2, Ch3, Ch4};
use embassy_stm32::{bind_interrupts, dma, pac, usart};
use static_cell::ConstStaticCell;

use super::analog::{self, Addresses};
use super::bus::Bus;
use super::drives::{Drives, Lines, Pulse, Stage};
use super::flash::Flash;
use super::sensing::{Ranger, Remote, RemoteEdge};
use super::ssd1306::{self, Ssd1306};
use super::system::System;
use super::watchdog::Watchdog;
use super::{Board, boot, drives, flash, line, motion, sensing, system};
use crate::liveness::WATCHDOG_PERIOD;
use crate::recorder::Row;
use crate::settings::store::Store;

/// The ST-LINK's MCO drives OSC_IN.
pub(super) const CLOCK: Hse = Hse { freq: Hertz::mhz(8), mode: HseMode::Bypass };

/// Not while PC10 and PC11 are enable lines: the ROM's loader brings up USART3 on them. (And the
/// USB that it would listen on has no socket.)
pub(super) const LOADER_IS_SAFE: bool = false;

pub(super) static DRIVES: Drives = Drives {
    // No pins are left for direction lines.
    stage: Stage::LockedAntiPhase,
    enables: Lines { port: pac::GPIOC, pins: &[0, 3, 5, 9, 10, 11] },
    bridges: &[
        Pulse::advanced(pac::TIM1, 0),
        Pulse::advanced(pac::TIM1, 1),
        Pulse::advanced(pac::TIM1, 2),
        Pulse::advanced(pac::TIM8, 0),
        Pulse::advanced(pac::TIM8, 1),
        Pulse::advanced(pac::TIM8, 2),
    ],
    servos: drives::SERVOS,
    outputs: Lines { port: pac::GPIOA, pins: &[5, 4] },
};

/// The wire is PC6.
pub(super) static BUS: Bus = Bus::new(pac::USART6, Lines { port: pac::GPIOC, pins: &[8] });

static ADDRESSES: Addresses = Addresses::new(Lines { port: pac::GPIOB, pins: &[2, 10, 12, 13] });

bind_interrupts!(pub(super) struct Irqs {
    EXTI1 => exti::InterruptHandler<typelevel::EXTI1>;
    EXTI2 => RemoteEdge<2>, exti::InterruptHandler<typelevel::EXTI2>;
    EXTI9_5 => exti::InterruptHandler<typelevel::EXTI9_5>;
    EXTI15_10 => exti::InterruptHandler<typelevel::EXTI15_10>;
    USART2 => usart::InterruptHandler<USART2>;
    DMA1_STREAM5 => dma::InterruptHandler<DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<DMA1_CH6>;
});

/// The motion hardware of this board.
pub type Motion = motion::Motion<TIM2, TIM4>;
/// Three rangers, two inputs.
pub type Sensing = sensing::Sensing<3, 2>;

/// The enable lines' pins, and the outputs'. Macros, since a function cannot take some tokens and
/// leave the others.
macro_rules! enables {
    ($p:ident) => {
        [$p.PC0.into(), $p.PC3.into(), $p.PC5.into(), $p.PC9.into(), $p.PC10.into(), $p.PC11.into()]
    };
}
pub(super) use enables;
macro_rules! outputs {
    ($p:ident) => {
        [$p.PA5.into(), $p.PA4.into()]
    };
}
pub(super) use outputs;

/// The recorder's: 32 KiB of SRAM, as there is no core-coupled memory. To be called once.
fn recorder_rows() -> &'static mut [Row] {
    static ROWS: ConstStaticCell<[Row; 2048]> = ConstStaticCell::new([Row::ZERO; 2048]);
    ROWS.take()
}

/// Starts the clocks, puts the outputs into their safe state, then starts everything else, the
/// host's line at `baud`.
pub fn start(baud: u32) -> Board {
    system::begin();
    let p = boot::clocks(CLOCK);
    DRIVES.enables.claim(enables!(p), Speed::Low);
    let watchdog = Watchdog::start(p.IWDG, WATCHDOG_PERIOD);
    let reset = boot::reset_cause();

    DRIVES.start();
    DRIVES.bridges[0].claim::<TIM1, Ch1>(p.PA8);
    DRIVES.bridges[1].claim::<TIM1, Ch2>(p.PA9);
    DRIVES.bridges[2].claim::<TIM1, Ch3>(p.PA10);
    DRIVES.bridges[3].claim::<TIM8, Ch1>(p.PC6);
    DRIVES.bridges[4].claim::<TIM8, Ch2>(p.PC7);
    DRIVES.bridges[5].claim::<TIM8, Ch3>(p.PC8);
    claim_servos!(p);
    DRIVES.outputs.claim(outputs!(p), Speed::Low);
    let motion = Motion::new(
        &DRIVES,
        analog!(p, [PB2, PB10, PB12, PB13]),
        encoders!(p),
        [const { None }; CHANNELS],
    );

    let sensing = Sensing {
        remote: Remote(ExtiInput::new(p.PD2, p.EXTI2, Pull::Up, Irqs)),
        rangers: [
            Ranger::new(p.PA0.into(), ExtiInput::new(p.PA1, p.EXTI1, Pull::Down, Irqs)),
            Ranger::new(p.PA6.into(), ExtiInput::new(p.PA7, p.EXTI7, Pull::Down, Irqs)),
            Ranger::new(p.PA11.into(), ExtiInput::new(p.PA12, p.EXTI12, Pull::Down, Irqs)),
        ],
        inputs: [Input::new(p.PC13, Pull::Up), Input::new(p.PC12, Pull::Up)],
    };

    let (rx, tx) = host_line!(p, baud);
    let display = display!(p);
    let store = Store::new(Flash::new(p.FLASH), 0..flash::SIZE as u32);
    let (system, rows) = (System(watchdog), recorder_rows());
    Board { motion, sensing, display, rx, tx, watchdog, system, store, rows, reset }
}
