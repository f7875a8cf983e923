//! What a board drives, told by registers and pin numbers alone: bridges, servos, output port.
//!
//! Vocabulary: a *compare value* is what a timer compares its counter with, in timer ticks: half the
//! length of the high part of a bridge's PWM period, the length of a servo's pulse. A *stage* is how
//! a bridge wants to be told its duty.
//!
//! The bridges' timers count up and down, so that the high part of every period lies around the
//! counter's *bottom*, 0, and the low part around its *top*, whatever the duty. All counters are at the
//! bottom together: TIM1 starts TIM8, and nothing stops either. So what is sampled at one
//! place of the period (`analog`) keeps its distance from the edges of all six lines.
//!
//! A board has one [`Drives`], a constant in flash. It needs no initialisation and no stack to
//! speak of, so [`Drives::make_safe`] works from a panic or a hard fault, whenever that comes.
//! The pins are claimed from embassy's tokens besides, and a token that is not the one that the
//! constant names panics at the first boot, before anything is driven.

use core::mem::forget;

use embassy_stm32::gpio::{AfType, AnyPin, Flex, Level, Output, OutputType, Pin, Speed};
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::regs::Bsrr;
use embassy_stm32::pac::timer::vals::{Cms, Mms, Ocm, Sms, Ts};
use embassy_stm32::pac::timer::{Tim2ch, TimAdv, TimGp16};
use embassy_stm32::peripherals::{TIM1, TIM3, TIM8, TIM12};
use embassy_stm32::rcc::enable_and_reset;
use embassy_stm32::timer::{GeneralInstance4Channel, TimerChannel, TimerPin};
use embassy_stm32::{Peri, pac};

use super::boot::APB1_TIMER_HZ;
use crate::units::{Duty, ServoPulse};

/// How the bridges want their duty.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// One PWM line: high drives forward, low drives in reverse, half and half is stop, as on the
    /// original's driver boards. The direction lines stay low.
    LockedAntiPhase,
    /// A direction line (high is forward) and a PWM line that is the magnitude.
    SignMagnitude,
}

impl Stage {
    /// The compare value for a duty.
    pub const fn compare(self, duty: Duty) -> u16 {
        const FULL: i32 = Duty::FULL as i32;
        const TOP: u32 = PWM_TOP as u32;
        let raw = duty.raw() as i32;
        // 32768 * 4200 fits 32 bits; a Duty is within -FULL..=FULL, so the sum is not negative and
        // the result is no more than the top, at which the line is high all the time.
        match self {
            Self::LockedAntiPhase => ((FULL + raw) as u32 * TOP / (2 * FULL as u32)) as u16,
            Self::SignMagnitude => (raw.unsigned_abs() * TOP / FULL as u32) as u16,
        }
    }

    /// Level of the direction line.
    pub const fn forward(self, duty: Duty) -> bool {
        matches!(self, Self::SignMagnitude) && duty.raw() > 0
    }
}

/// Where the counters of the bridges' timers turn. They are APB2's (TIM1, TIM8) and count at 168 MHz:
/// 4200 ticks up and 4200 down are 20 kHz.
pub(super) const PWM_TOP: u16 = 4200;

/// Servo timers count at 3 MHz: a third finer than the protocol's 1/2250 ms, 4 ticks for 3 of its
/// counts, and 20 ms are 60000 ticks, which fit 16 bits.
const SERVO_TICK_HZ: u32 = 3_000_000;
/// Ticks in a servo's period of 20 ms.
const SERVO_PERIOD: u16 = 60_000;
/// The servos' timers are APB1's.
const SERVO_PRESCALER: u16 = (APB1_TIMER_HZ / SERVO_TICK_HZ) as u16; // 28

/// The compare value for a servo's pulse; 0 is no pulse.
pub const fn servo_compare(pulse: Option<ServoPulse>) -> u16 {
    match pulse {
        Some(pulse) => (pulse.raw() as u32 * 4 / 3) as u16, // 7000 * 4 / 3 fits
        None => 0,
    }
}

/// Stops a board whose constant and whose tokens name different pins, at its first boot.
fn expect_wired(agree: bool) {
    defmt::assert!(agree, "the board's file names two different pins or channels for one");
}

/// Output lines on one port; line k is `pins[k]`.
pub struct Lines {
    /// The port.
    pub port: Gpio,
    /// Its pins' numbers, 0 to 15.
    pub pins: &'static [u8],
}

impl Lines {
    /// What BSRR makes of the lines when it is written: line k gets bit k of `levels`. Its upper
    /// half resets, its lower half sets (RM0090 8.4.7).
    pub const fn word(&self, levels: u32) -> u32 {
        let (mut word, mut line) = (0, 0);
        while line < self.pins.len() {
            let pin = 1 << self.pins[line];
            word |= if levels >> line & 1 == 1 { pin } else { pin << 16 };
            line += 1;
        }
        word
    }

    /// Sets all lines at once.
    pub fn write(&self, levels: u32) {
        self.port.bsrr().write_value(Bsrr(self.word(levels)));
    }

    /// Sets one line; one that the board does not have is ignored.
    pub fn set(&self, line: usize, high: bool) {
        if let Some(pin) = self.pins.get(line) {
            self.port.bsrr().write_value(Bsrr(1 << pin << if high { 0 } else { 16 }));
        }
    }

    /// Makes the lines outputs, low, for ever.
    ///
    /// # Panics
    /// If `claimed` are not the pins.
    pub fn claim<const N: usize>(&self, claimed: [Peri<'static, AnyPin>; N], speed: Speed) {
        expect_wired(N == self.pins.len());
        for (pin, number) in claimed.into_iter().zip(self.pins) {
            expect_wired(pin.block() == self.port && pin.pin() == *number);
            forget(Output::new(pin, Level::Low, speed)); // dropped, it would be an input again
        }
    }
}

/// A timer's channel that makes pulses.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Pulse {
    timer: TimGp16,
    /// From 0: CH1 is 0.
    channel: usize,
}

impl Pulse {
    /// Of a general timer with four channels (TIM3, TIM4).
    pub const fn general(timer: TimGp16, channel: usize) -> Self {
        Self { timer, channel }
    }

    /// Of an advanced timer (TIM1, TIM8).
    pub const fn advanced(timer: TimAdv, channel: usize) -> Self {
        // SAFETY: CR1, EGR, CCMR, CCER, PSC, ARR and CCR are where the general timers have them
        // and mean the same (RM0090 17.4, 18.4).
        Self { timer: unsafe { TimGp16::from_ptr(timer.as_ptr()) }, channel }
    }

    /// Of a timer with two channels (TIM12).
    pub const fn two_channel(timer: Tim2ch, channel: usize) -> Self {
        // SAFETY: as above (RM0090 18.4, 19.4).
        Self { timer: unsafe { TimGp16::from_ptr(timer.as_ptr()) }, channel }
    }

    /// A compare value takes effect with the next period, a bridge's where its counter turns next.
    pub fn set(self, compare: u16) {
        self.timer.ccr(self.channel).write(|w| w.set_ccr(compare));
    }

    /// PWM with a first compare value, not running yet. The counter turns, or begins anew, after `top`.
    fn prepare(self, prescaler: u16, alignment: Cms, top: u16, compare: u16) {
        let Self { timer, channel } = self;
        timer.cr1().modify(|w| {
            w.set_cms(alignment);
            w.set_arpe(true);
        });
        timer.psc().write_value(prescaler - 1);
        timer.arr().write(|w| w.set_arr(top));
        timer.ccmr_output(channel / 2).modify(|w| {
            w.set_ocm(channel % 2, Ocm::PWM_MODE1);
            w.set_ocpe(channel % 2, true);
        });
        self.set(compare);
        timer.ccer().modify(|w| w.set_cce(channel, true));
        // Takes all of it over; again for each channel of a timer, which does no harm.
        timer.egr().write(|w| w.set_ug(true));
    }

    /// Gives the channel its pin for ever, if the chip can.
    ///
    /// # Panics
    /// If this is not channel `C` of timer `T`.
    pub fn claim<T: GeneralInstance4Channel, C: TimerChannel>(
        self,
        pin: Peri<'static, impl TimerPin<T, C>>,
    ) {
        let function = pin.af_num();
        self.claim_any(T::regs(), C::CHANNEL.index(), pin.into(), function);
    }

    /// Apart, so that it is compiled once.
    fn claim_any(self, timer: *mut (), channel: usize, pin: Peri<'static, AnyPin>, function: u8) {
        expect_wired(self.timer.as_ptr() == timer && self.channel == channel);
        let mut pin = Flex::new(pin);
        pin.set_as_af_unchecked(function, AfType::output(OutputType::PushPull, Speed::Low));
        forget(pin); // dropped, it would be an input again
    }
}

/// Everything that a board drives. A channel or an output that the board does not have is absent
/// from the end of its list, and what is sent to it has no effect.
pub struct Drives {
    /// How the bridges want their duty.
    pub stage: Stage,
    /// Enable lines of DC channels 0 to 5.
    pub enables: Lines,
    /// PWM of DC channels 0 to 5.
    pub bridges: &'static [Pulse],
    /// Servos 0 to 5.
    pub servos: &'static [Pulse],
    /// Output port, GPIO0 to GPIO7.
    pub outputs: Lines,
}

impl Drives {
    /// Bridges disabled and neutral, no servo pulse after the one under way, outputs low.
    ///
    /// Before the board's start the peripherals have no clock and the pins are inputs: then this
    /// does nothing, and the pull-downs on the enable lines hold the bridges off.
    pub fn make_safe(&self) {
        self.enables.write(0);
        for bridge in self.bridges {
            bridge.set(self.stage.compare(Duty::NEUTRAL));
        }
        for servo in self.servos {
            servo.set(0);
        }
        self.outputs.write(0);
    }

    /// Enables the timers, which are the same on every board, and starts them: bridges neutral,
    /// servos without pulses.
    pub fn start(&self) {
        enable_and_reset::<TIM1>();
        enable_and_reset::<TIM8>();
        enable_and_reset::<TIM3>();
        enable_and_reset::<TIM12>();
        let neutral = self.stage.compare(Duty::NEUTRAL);
        for bridge in self.bridges {
            bridge.prepare(1, Cms::CENTER_ALIGNED1, PWM_TOP, neutral);
        }
        for servo in self.servos {
            servo.prepare(SERVO_PRESCALER, Cms::EDGE_ALIGNED, SERVO_PERIOD - 1, 0);
            servo.timer.cr1().modify(|w| w.set_cen(true));
        }
        pac::TIM1.bdtr().modify(|w| w.set_moe(true));
        pac::TIM8.bdtr().modify(|w| w.set_moe(true));
        // ITR0 of TIM8 is TIM1's trigger output (RM0090 table 97), which is its enable bit here. TIM8
        // follows within some ticks, always the same.
        pac::TIM8.smcr().write(|w| w.set_ts(Ts::ITR0));
        pac::TIM8.smcr().modify(|w| w.set_sms(Sms::TRIGGER_MODE));
        pac::TIM1.cr2().modify(|w| w.set_mms(Mms::ENABLE));
        pac::TIM1.cr1().modify(|w| w.set_cen(true));
    }
}

/// Servos 0 to 5, on the same timers of every board.
pub const SERVOS: &[Pulse] = &[
    Pulse::general(pac::TIM3, 0),
    Pulse::general(pac::TIM3, 1),
    Pulse::general(pac::TIM3, 2),
    Pulse::general(pac::TIM3, 3),
    Pulse::two_channel(pac::TIM12, 0),
    Pulse::two_channel(pac::TIM12, 1),
];
