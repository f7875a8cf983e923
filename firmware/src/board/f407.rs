//! STM32F407VG (LQFP100), for example the STM32F4DISCOVERY: who owns which pin, timer and stream.
//!
//! | what | with |
//! |---|---|
//! | bridges 0 to 3, 4 and 5 | TIM1 CH1 to CH4, TIM8 CH1 and CH2, 20 kHz |
//! | servos 0 to 3, 4 and 5 | TIM3 CH1 to CH4, TIM12 CH1 and CH2, 50 Hz |
//! | encoders 0 and 1 | TIM2, TIM4 |
//! | analogue scan | ADC1, TIM8 CH4 and update, DMA2 streams 0 and 1 |
//! | host | USART2, DMA1 streams 5 and 6 |
//! | servo bus, in the CM-5's image only | USART6, no DMA; its pins are DC channels' here |
//! | display | I2C1, polled |
//! | rangers, remote | EXTI 1, 4, 5, 7, 8, 10; 13 |
//! | embassy's clock | TIM5 |
//! | recorder | the core-coupled memory: 4096 rows, 4 s of one channel at the control rate |
//! | executors | the vectors of UART4 (control) and UART5 (sensing), otherwise unused |
//!
//! README.md beside this file is the wiring table for people.
//!
//! Promise: the enable lines are driven low before any timer runs.

use core::mem::forget;
use core::{ptr, slice};

use embassy_stm32::adc::AdcChannel;
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::gpio::{Input, Level, Output, Pull, Speed};
use embassy_stm32::i2c::I2c;
use embassy_stm32::interrupt::typelevel;
use embassy_stm32::peripherals::{DMA1_CH5, DMA1_CH6, TIM1, TIM2, TIM3, TIM4, TIM8, TIM12, USART2};
use embassy_stm32::rcc::{Hse, HseMode};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::qei::Qei;
use embassy_stm32::timer::{Ch1, Ch2, Ch3, Ch4};
use embassy_stm32::{bind_interrupts, dma, pac, usart};

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

/// The crystal.
pub(super) const CLOCK: Hse = Hse { freq: Hertz::mhz(8), mode: HseMode::Oscillator };

/// Whether the ROM's loader, which brings up more than USB, leaves the enable lines alone: none of
/// its lines is on port E (AN2606).
pub(super) const LOADER_IS_SAFE: bool = true;

pub(super) static DRIVES: Drives = Drives {
    // Change it for drivers with a direction input.
    stage: Stage::LockedAntiPhase,
    enables: Lines { port: pac::GPIOE, pins: &[2, 4, 5, 6, 7, 8] },
    bridges: &[
        Pulse::advanced(pac::TIM1, 0),
        Pulse::advanced(pac::TIM1, 1),
        Pulse::advanced(pac::TIM1, 2),
        Pulse::advanced(pac::TIM1, 3),
        Pulse::advanced(pac::TIM8, 0),
        Pulse::advanced(pac::TIM8, 1),
    ],
    servos: drives::SERVOS,
    outputs: Lines { port: pac::GPIOD, pins: &[8, 9, 10, 11, 12, 13, 14, 15] },
};

/// The wire is PC6.
pub(super) static BUS: Bus = Bus::new(pac::USART6, Lines { port: pac::GPIOC, pins: &[8] });

static ADDRESSES: Addresses = Addresses::new(Lines { port: pac::GPIOB, pins: &[10, 11, 12, 13] });

bind_interrupts!(pub(super) struct Irqs {
    EXTI1 => exti::InterruptHandler<typelevel::EXTI1>;
    EXTI4 => exti::InterruptHandler<typelevel::EXTI4>;
    EXTI9_5 => exti::InterruptHandler<typelevel::EXTI9_5>;
    EXTI15_10 => RemoteEdge<13>, exti::InterruptHandler<typelevel::EXTI15_10>;
    USART2 => usart::InterruptHandler<USART2>;
    DMA1_STREAM5 => dma::InterruptHandler<DMA1_CH5>;
    DMA1_STREAM6 => dma::InterruptHandler<DMA1_CH6>;
});

/// The motion hardware of this board.
pub type Motion = motion::Motion<TIM2, TIM4>;
/// Six rangers, eight inputs.
pub type Sensing = sensing::Sensing<6, 8>;

/// The enable lines' pins, and the outputs'. Macros, since a function cannot take some tokens and
/// leave the others.
macro_rules! enables {
    ($p:ident) => {
        [$p.PE2.into(), $p.PE4.into(), $p.PE5.into(), $p.PE6.into(), $p.PE7.into(), $p.PE8.into()]
    };
}
pub(super) use enables;
macro_rules! outputs {
    ($p:ident) => {
        [
            $p.PD8.into(),
            $p.PD9.into(),
            $p.PD10.into(),
            $p.PD11.into(),
            $p.PD12.into(),
            $p.PD13.into(),
            $p.PD14.into(),
            $p.PD15.into(),
        ]
    };
}
pub(super) use outputs;

/// The recorder's: all of the core-coupled memory, 64 KiB that DMA cannot reach and nothing is linked into
/// (RM0090, section 2.3.1; its clock runs after a reset). To be called once.
fn recorder_rows() -> &'static mut [Row] {
    const CCM: usize = 0x1000_0000;
    const ROWS: usize = 64 * 1024 / size_of::<Row>();
    let first = ptr::with_exposed_provenance_mut::<Row>(CCM);
    // SAFETY: it is memory, aligned, of this size, and nobody else's; every row is written before it is
    // anybody's to read.
    unsafe {
        (0..ROWS).for_each(|row| first.add(row).write(Row::ZERO));
        slice::from_raw_parts_mut(first, ROWS)
    }
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
    DRIVES.bridges[0].claim::<TIM1, Ch1>(p.PE9);
    DRIVES.bridges[1].claim::<TIM1, Ch2>(p.PE11);
    DRIVES.bridges[2].claim::<TIM1, Ch3>(p.PE13);
    DRIVES.bridges[3].claim::<TIM1, Ch4>(p.PE14);
    DRIVES.bridges[4].claim::<TIM8, Ch1>(p.PC6);
    DRIVES.bridges[5].claim::<TIM8, Ch2>(p.PC7);
    claim_servos!(p);
    DRIVES.outputs.claim(outputs!(p), Speed::Low);
    // Deselects the accelerometer of an STM32F4DISCOVERY, whose data output is PA6: a trigger.
    forget(Output::new(p.PE3, Level::High, Speed::Low));
    let motion = Motion::new(
        &DRIVES,
        analog!(p, [PB10, PB11, PB12, PB13]),
        encoders!(p),
        [
            Some(Output::new(p.PE10, Level::Low, Speed::Low)),
            Some(Output::new(p.PE12, Level::Low, Speed::Low)),
            Some(Output::new(p.PE15, Level::Low, Speed::Low)),
            Some(Output::new(p.PC8, Level::Low, Speed::Low)),
            Some(Output::new(p.PC9, Level::Low, Speed::Low)),
            Some(Output::new(p.PC11, Level::Low, Speed::Low)),
        ],
    );

    let sensing = Sensing {
        remote: Remote(ExtiInput::new(p.PC13, p.EXTI13, Pull::Up, Irqs)),
        rangers: [
            Ranger::new(p.PA5.into(), ExtiInput::new(p.PA1, p.EXTI1, Pull::Down, Irqs)),
            Ranger::new(p.PA6.into(), ExtiInput::new(p.PA4, p.EXTI4, Pull::Down, Irqs)),
            Ranger::new(p.PA10.into(), ExtiInput::new(p.PC5, p.EXTI5, Pull::Down, Irqs)),
            Ranger::new(p.PB2.into(), ExtiInput::new(p.PA7, p.EXTI7, Pull::Down, Irqs)),
            Ranger::new(p.PC12.into(), ExtiInput::new(p.PA8, p.EXTI8, Pull::Down, Irqs)),
            Ranger::new(p.PC14.into(), ExtiInput::new(p.PC10, p.EXTI10, Pull::Down, Irqs)),
        ],
        inputs: [
            Input::new(p.PD0, Pull::Up),
            Input::new(p.PD1, Pull::Up),
            Input::new(p.PD2, Pull::Up),
            Input::new(p.PD3, Pull::Up),
            Input::new(p.PD4, Pull::Up),
            Input::new(p.PD5, Pull::Up),
            Input::new(p.PD6, Pull::Up),
            Input::new(p.PD7, Pull::Up),
        ],
    };

    let (rx, tx) = host_line!(p, baud);
    let display = display!(p);
    let store = Store::new(Flash::new(p.FLASH), 0..flash::SIZE as u32);
    let (system, rows) = (System(watchdog), recorder_rows());
    Board { motion, sensing, display, rx, tx, watchdog, system, store, rows, reset }
}
