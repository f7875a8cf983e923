//! STM32F407VG (LQFP100), for example the STM32F4DISCOVERY: who owns which pin, timer and stream.
//!
//! | what | with |
//! |---|---|
//! | bridges 0 to 3, 4 and 5 | TIM1 CH1 to CH4, TIM8 CH1 and CH2, 20 kHz |
//! | servos 0 to 3, 4 and 5 | TIM3 CH1 to CH4, TIM12 CH1 and CH2, 50 Hz |
//! | encoders 0 and 1 | TIM2, TIM4 |
//! | analogue scan | ADC1, TIM8 CH4 and update, DMA2 streams 0 and 1 |
//! | host | USART2, DMA1 streams 5 and 6 |
//! | display | I2C1, polled |
//! | rangers, remote | EXTI 1, 4, 5, 7, 8, 10; 13 |
//! | embassy's clock | TIM5 |
//! | executors | the vectors of UART4 (control) and UART5 (sensing), otherwise unused |
//!
//! README.md beside this file is the wiring table for people. Everything is claimed from embassy's
//! tokens, so nothing can be claimed twice, and every pin's alternate function is checked by the
//! traits of the chip.
//!
//! Promises: the enable lines are driven low before any timer runs; registers are written only when
//! an output changes, a bridge's enable line first when it goes off and last when it goes on.

use embassy_stm32::adc::AdcChannel;
use embassy_stm32::exti::{self, ExtiInput};
use embassy_stm32::gpio::{AfType, Flex, Input, Level, Output, OutputType, Pull, Speed};
use embassy_stm32::i2c::{self, I2c};
use embassy_stm32::interrupt;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac;
use embassy_stm32::pac::gpio::regs::Bsrr;
use embassy_stm32::pac::timer::TimGp16;
use embassy_stm32::pac::timer::vals::Ocm;
use embassy_stm32::peripherals::{IWDG, TIM1, TIM2, TIM3, TIM4, TIM8, TIM12};
use embassy_stm32::rcc::{self, enable_and_reset};
use embassy_stm32::time::Hertz;
use embassy_stm32::timer::qei::{self, Qei};
use embassy_stm32::timer::{Ch1, Ch2, Ch3, Ch4, GeneralInstance4Channel, TimerChannel, TimerPin};
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_stm32::{Peri, bind_interrupts};
use embassy_time::Duration;

use super::analog::{self, Analog};
use super::line::{self, Receiver, Sender};
use super::sensing::{Bank, Ranger, Remote, Sensing};
use super::ssd1306::Ssd1306;
use super::{SERVO_PERIOD, SERVO_TICK_HZ, Stage, servo_compare};
use crate::app::WATCHDOG_PERIOD;
use crate::ports::{MotionInputs, MotionPort, Outputs, Sensors};
use crate::units::Duty;

/// How this board's bridges want their duty. Change it for drivers with a direction input.
pub const STAGE: Stage = Stage::LockedAntiPhase;

/// The processor's clock in MHz.
pub const CORE_MHZ: u32 = 168;
/// The board's crystal.
const CRYSTAL: Hertz = Hertz::mhz(8);
/// Timers of APB2 (TIM1, TIM8) count at 168 MHz: 8400 ticks are 20 kHz.
const PWM_PERIOD: u16 = 8400;
/// Timers of APB1 (TIM3, TIM12) count at 84 MHz.
const APB1_TIMER_HZ: u32 = 84_000_000;

/// The enable lines on port E: PE2, PE4, PE5, PE6, PE7, PE8.
const ENABLES: u16 = 0b1_1111_0100;
/// The output port: PD8 is GPIO0, PD15 is GPIO7.
const OUTPUTS_SHIFT: u32 = 8;

bind_interrupts!(struct Irqs {
    EXTI1 => exti::InterruptHandler<interrupt::typelevel::EXTI1>;
    EXTI4 => exti::InterruptHandler<interrupt::typelevel::EXTI4>;
    EXTI9_5 => exti::InterruptHandler<interrupt::typelevel::EXTI9_5>;
    EXTI15_10 => exti::InterruptHandler<interrupt::typelevel::EXTI15_10>;
});

/// Puts all outputs into their safe state, from wherever the program is: bridges disabled and
/// neutral, no servo pulse after the one under way, output port low.
///
/// Before [`start`] the peripherals have no clock and the pins are inputs: then this does nothing,
/// and the pull-downs on the enable lines hold the bridges off.
pub fn safe_state() {
    pac::GPIOE.bsrr().write_value(Bsrr(u32::from(ENABLES) << 16));
    for channel in 0..6 {
        set_compare(bridge(channel), neutral());
        set_compare(servo(channel), 0);
    }
    pac::GPIOD.bsrr().write_value(Bsrr(0xFF << (OUTPUTS_SHIFT + 16)));
}

/// The board's parts, each for its task.
pub struct Board {
    /// For `app::control`.
    pub motion: Motion,
    /// Its own task.
    pub sensing: Sensing,
    /// For `app::display`.
    pub display: Ssd1306,
    /// For `app::link`, from the host.
    pub rx: Receiver,
    /// For `app::link`, to the host.
    pub tx: Sender,
    /// For `app::supervise`.
    pub watchdog: IndependentWatchdog<'static, IWDG>,
}

/// Starts the clocks, puts the outputs into their safe state, then starts everything else.
pub fn start() -> Board {
    let cause = pac::RCC.csr().read();
    let p = embassy_stm32::init(clocks());

    let low = Level::Low;
    let enables = [
        Output::new(p.PE2, low, Speed::Low),
        Output::new(p.PE4, low, Speed::Low),
        Output::new(p.PE5, low, Speed::Low),
        Output::new(p.PE6, low, Speed::Low),
        Output::new(p.PE7, low, Speed::Low),
        Output::new(p.PE8, low, Speed::Low),
    ];
    let mut watchdog = IndependentWatchdog::new(p.IWDG, WATCHDOG_PERIOD.as_micros() as u32);
    pac::DBGMCU.apb1fzr().modify(|w| w.set_iwdg(true)); // a debugger may halt the core
    watchdog.unleash();
    report_reset(cause);

    #[cfg(feature = "qemu")]
    if let Some(core) = cortex_m::Peripherals::take() {
        super::systick::start(core.SYST);
    }

    enable_and_reset::<TIM1>();
    enable_and_reset::<TIM8>();
    enable_and_reset::<TIM3>();
    enable_and_reset::<TIM12>();
    for (channel, count) in [(0, 4), (4, 2)] {
        run_pwm(bridge(channel).0, count, 1, PWM_PERIOD, neutral());
        let prescaler = (APB1_TIMER_HZ / SERVO_TICK_HZ) as u16; // 28
        run_pwm(servo(channel).0, count, prescaler, SERVO_PERIOD, 0);
    }
    pac::TIM1.bdtr().modify(|w| w.set_moe(true));
    pac::TIM8.bdtr().modify(|w| w.set_moe(true));
    let pulses = [
        timer_pin::<TIM1, Ch1>(p.PE9),
        timer_pin::<TIM1, Ch2>(p.PE11),
        timer_pin::<TIM1, Ch3>(p.PE13),
        timer_pin::<TIM1, Ch4>(p.PE14),
        timer_pin::<TIM8, Ch1>(p.PC6),
        timer_pin::<TIM8, Ch2>(p.PC7),
        timer_pin::<TIM3, Ch1>(p.PB4),
        timer_pin::<TIM3, Ch2>(p.PB5),
        timer_pin::<TIM3, Ch3>(p.PB0),
        timer_pin::<TIM3, Ch4>(p.PB1),
        timer_pin::<TIM12, Ch1>(p.PB14),
        timer_pin::<TIM12, Ch2>(p.PB15),
    ];
    let motion = Motion {
        analog: Analog::new(
            p.ADC1,
            [p.PC1.degrade_adc(), p.PC2.degrade_adc(), p.PC4.degrade_adc()],
            [
                Output::new(p.PB10, low, Speed::Medium),
                Output::new(p.PB11, low, Speed::Medium),
                Output::new(p.PB12, low, Speed::Medium),
                Output::new(p.PB13, low, Speed::Medium),
            ],
            p.DMA2_CH1,
            p.DMA2_CH0,
        ),
        encoders: (
            Qei::new(p.TIM2, p.PA15, p.PB3, encoder_inputs()),
            Qei::new(p.TIM4, p.PB6, p.PB7, encoder_inputs()),
        ),
        enables,
        directions: [
            Output::new(p.PE10, low, Speed::Low),
            Output::new(p.PE12, low, Speed::Low),
            Output::new(p.PE15, low, Speed::Low),
            Output::new(p.PC8, low, Speed::Low),
            Output::new(p.PC9, low, Speed::Low),
            Output::new(p.PC11, low, Speed::Low),
        ],
        _outputs: [
            Output::new(p.PD8, low, Speed::Low),
            Output::new(p.PD9, low, Speed::Low),
            Output::new(p.PD10, low, Speed::Low),
            Output::new(p.PD11, low, Speed::Low),
            Output::new(p.PD12, low, Speed::Low),
            Output::new(p.PD13, low, Speed::Low),
            Output::new(p.PD14, low, Speed::Low),
            Output::new(p.PD15, low, Speed::Low),
        ],
        _pulses: pulses,
        driven: Outputs::default(),
    };

    let ranger = |trigger, echo| Ranger { trigger, echo };
    let bank = Bank {
        rangers: [
            ranger(
                Output::new(p.PA5, low, Speed::Low),
                ExtiInput::new(p.PA1, p.EXTI1, Pull::Down, Irqs),
            ),
            ranger(
                Output::new(p.PA6, low, Speed::Low),
                ExtiInput::new(p.PA4, p.EXTI4, Pull::Down, Irqs),
            ),
            ranger(
                Output::new(p.PA10, low, Speed::Low),
                ExtiInput::new(p.PC5, p.EXTI5, Pull::Down, Irqs),
            ),
            ranger(
                Output::new(p.PB2, low, Speed::Low),
                ExtiInput::new(p.PA7, p.EXTI7, Pull::Down, Irqs),
            ),
            ranger(
                Output::new(p.PC12, low, Speed::Low),
                ExtiInput::new(p.PA8, p.EXTI8, Pull::Down, Irqs),
            ),
            ranger(
                Output::new(p.PC14, low, Speed::Low),
                ExtiInput::new(p.PC10, p.EXTI10, Pull::Down, Irqs),
            ),
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
        analog: slow_inputs,
    };
    let sensing =
        Sensing { remote: Remote(ExtiInput::new(p.PC13, p.EXTI13, Pull::Up, Irqs)), bank };

    let (rx, tx) = line::new(line::Parts {
        usart: p.USART2,
        rx: p.PA3,
        tx: p.PA2,
        rx_dma: p.DMA1_CH5,
        tx_dma: p.DMA1_CH6,
    });
    Board {
        motion,
        sensing,
        display: Ssd1306::new(display_bus(p.I2C1, p.PB8, p.PB9)),
        rx,
        tx,
        watchdog,
    }
}

/// 168 MHz from the crystal, APB1 42 MHz, APB2 84 MHz.
fn clocks() -> embassy_stm32::Config {
    let mut config = embassy_stm32::Config::default();
    config.rcc.hse = Some(rcc::Hse { freq: CRYSTAL, mode: rcc::HseMode::Oscillator });
    config.rcc.pll_src = rcc::PllSource::HSE;
    config.rcc.pll = Some(rcc::Pll {
        prediv: rcc::PllPreDiv::DIV4, // 2 MHz, the best for jitter (RM0090 7.3.2)
        mul: rcc::PllMul::MUL168,
        divp: Some(rcc::PllPDiv::DIV2),
        divq: Some(rcc::PllQDiv::DIV7),
        divr: None,
    });
    config.rcc.sys = rcc::Sysclk::PLL1_P;
    config.rcc.apb1_pre = rcc::APBPrescaler::DIV4;
    config.rcc.apb2_pre = rcc::APBPrescaler::DIV2;
    config
}

/// Says why the board has started, and forgets it.
fn report_reset(cause: pac::rcc::regs::Csr) {
    // A watchdog's reset sets PINRSTF too, a power-on all three of the last.
    let text = if cause.wdgrstf() {
        "watchdog"
    } else if cause.wwdgrstf() {
        "window watchdog"
    } else if cause.lpwrrstf() {
        "low power"
    } else if cause.sftrstf() {
        "software"
    } else if cause.porrstf() {
        "power"
    } else if cause.borrstf() {
        "brown-out"
    } else {
        "reset pin"
    };
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    defmt::info!("started by: {=str} (CSR {=u32:#010x})", text, cause.0);
}

/// Pull-ups for open collectors.
fn encoder_inputs() -> qei::Config {
    qei::Config { ch1_pull: Pull::Up, ch2_pull: Pull::Up, ..Default::default() }
}

fn display_bus(
    i2c1: Peri<'static, embassy_stm32::peripherals::I2C1>,
    clock: Peri<'static, embassy_stm32::peripherals::PB8>,
    data: Peri<'static, embassy_stm32::peripherals::PB9>,
) -> I2c<'static, Blocking, i2c::Master> {
    let mut config = i2c::Config::default();
    config.frequency = Hertz::khz(400);
    // 18 bytes take 0.41 ms.
    config.timeout = Duration::from_millis(2);
    I2c::new_blocking(i2c1, clock, data, config)
}

/// A bridge's timer and its channel's index.
fn bridge(channel: usize) -> (TimGp16, usize) {
    match channel {
        0..4 => (general(pac::TIM1.as_ptr()), channel),
        _ => (general(pac::TIM8.as_ptr()), channel % 4),
    }
}

/// A servo's timer and its channel's index.
fn servo(channel: usize) -> (TimGp16, usize) {
    match channel {
        0..4 => (pac::TIM3, channel),
        _ => (general(pac::TIM12.as_ptr()), channel % 4),
    }
}

/// Advanced and two-channel timers have the registers that we use where the general ones do.
fn general(timer: *mut ()) -> TimGp16 {
    // SAFETY: called with the addresses of TIM1, TIM8 and TIM12 only; CR1, EGR, CCMR, CCER, PSC,
    // ARR and CCR have the same offsets and the same meaning there (RM0090 17.4, 18.4, 19.4).
    unsafe { TimGp16::from_ptr(timer) }
}

fn set_compare((timer, channel): (TimGp16, usize), compare: u16) {
    timer.ccr(channel).write(|w| w.set_ccr(compare));
}

/// The bridges' compare value at rest.
const fn neutral() -> u16 {
    STAGE.compare(Duty::NEUTRAL, PWM_PERIOD as u32) as u16 // no more than the period
}

/// PWM on a timer's first channels. A compare value takes effect with the next period.
fn run_pwm(timer: TimGp16, channels: usize, prescaler: u16, period: u16, compare: u16) {
    timer.psc().write_value(prescaler - 1);
    timer.arr().write(|w| w.set_arr(period - 1));
    for channel in 0..channels {
        timer.ccmr_output(channel / 2).modify(|w| {
            w.set_ocm(channel % 2, Ocm::PWM_MODE1);
            w.set_ocpe(channel % 2, true);
        });
        set_compare((timer, channel), compare);
        timer.ccer().modify(|w| w.set_cce(channel, true));
    }
    timer.egr().write(|w| w.set_ug(true));
    timer.cr1().modify(|w| {
        w.set_arpe(true);
        w.set_cen(true);
    });
}

/// Gives a pin to a timer's channel, if the chip can.
fn timer_pin<T: GeneralInstance4Channel, C: TimerChannel>(
    pin: Peri<'static, impl TimerPin<T, C>>,
) -> Flex<'static> {
    let function = pin.af_num();
    let mut pin = Flex::new(pin);
    pin.set_as_af_unchecked(function, AfType::output(OutputType::PushPull, Speed::Low));
    pin
}

/// Bridges, servos, encoders, and what is sampled for control.
pub struct Motion {
    analog: Analog,
    encoders: (Qei<'static, TIM2>, Qei<'static, TIM4>),
    enables: [Output<'static>; 6],
    directions: [Output<'static>; 6],
    /// Kept, or the pins would fall back to inputs.
    _outputs: [Output<'static>; 8],
    _pulses: [Flex<'static>; 12],
    /// What the registers hold.
    driven: Outputs,
}

impl MotionPort for Motion {
    fn sample(&mut self) -> MotionInputs {
        self.analog.check();
        MotionInputs {
            potentiometers: core::array::from_fn(|i| analog::sample(A, i)),
            currents: core::array::from_fn(|i| analog::sample(B, i)),
            encoders: [self.encoders.0.count(), self.encoders.1.count()],
        }
    }

    fn drive(&mut self, outputs: &Outputs) {
        let motors = outputs.motors.iter().zip(&self.driven.motors);
        let lines = self.enables.iter_mut().zip(&mut self.directions);
        for (channel, ((motor, driven), (enable, direction))) in motors.zip(lines).enumerate() {
            if motor == driven {
                continue;
            }
            if !motor.enabled {
                enable.set_low();
            }
            let compare = STAGE.compare(motor.duty, PWM_PERIOD.into()) as u16; // up to the period
            set_compare(bridge(channel), compare);
            direction.set_level(Level::from(STAGE.forward(motor.duty)));
            if motor.enabled {
                enable.set_high();
            }
        }
        let servos = outputs.servos.iter().zip(&self.driven.servos);
        for (channel, (pulse, driven)) in servos.enumerate() {
            if pulse != driven {
                set_compare(servo(channel), servo_compare(*pulse));
            }
        }
        if outputs.gpio != self.driven.gpio {
            // One write: the upper half of BSRR resets, the lower sets.
            let (set, reset) = (u32::from(outputs.gpio), u32::from(!outputs.gpio));
            let word = (set | reset << 16) << OUTPUTS_SHIFT;
            pac::GPIOD.bsrr().write_value(Bsrr(word));
        }
        self.driven = *outputs;
    }
}

/// The multiplexers, on PC1, PC2 and PC4.
const A: usize = 0;
const B: usize = 1;
const C: usize = 2;

/// The other analogue inputs. Potentiometers are A0 to A5, currents B0 to B5.
fn slow_inputs(sensors: &mut Sensors) {
    let bank = |multiplexer, first| move |i| analog::sample(multiplexer, first + i);
    sensors.custom_ad = core::array::from_fn(bank(A, 6));
    sensors.reference = core::array::from_fn(bank(A, 14));
    sensors.human = core::array::from_fn(bank(B, 6));
    sensors.tilt = core::array::from_fn(bank(B, 10));
    sensors.overheat = core::array::from_fn(bank(B, 12));
    sensors.temperature = analog::sample(B, 14);
    sensors.ir_range = analog::sample(B, 15);
    sensors.battery = core::array::from_fn(bank(C, 0));
}
