//! Pulses on timers' pins, as the timers' registers have them: a compare value that waits for its period
//! counts as in force, and no edge is looked at.

use rigless::mcu::Mcu;
use rigless::soc::stm32f427::generated::{tim1, tim2, tim9};

use super::Stm32f407;

/// What the timers of each bus count at under every image's clock tree.
pub(super) const APB1_HZ: f64 = 84e6;
const APB2_HZ: f64 = 168e6;

/// A timer's channel on a pin: port, pin, alternate function, timer, channel from 1.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// From 0, A.
    pub port: usize,
    /// 0 to 15.
    pub pin: u8,
    /// The alternate function that gives the pin to the timer.
    pub function: u8,
    /// Which timer.
    pub timer: Timer,
    /// 1 to 4.
    pub channel: u8,
}

/// The timers that make pulses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "their names say it")]
pub enum Timer {
    Tim1,
    Tim3,
    Tim8,
    Tim12,
}

/// Pulses as a pin repeats them, in ns; high for `width` of every `period`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pulses {
    /// High time.
    pub width_ns: f64,
    /// Period.
    pub period_ns: f64,
}

impl Pulses {
    /// High for this part of the time.
    pub fn duty(self) -> f64 {
        self.width_ns / self.period_ns
    }
}

impl Stm32f407 {
    /// The pulses on a timer's pin, `None` while it makes none there: the pin is not the timer's, the
    /// channel is off, the timer stands still. From the registers: the preloaded compare value counts
    /// as in force.
    pub fn pulses(&mut self, output: Output) -> Option<Pulses> {
        if self.function(output.port, output.pin) != Some(output.function) {
            return None;
        }
        use tim1::{bdtr, ccer, cr1};
        let index = usize::from(output.channel) - 1;
        let (name, hz) = match output.timer {
            Timer::Tim1 => ("TIM1", APB2_HZ),
            Timer::Tim8 => ("TIM8", APB2_HZ),
            Timer::Tim3 => ("TIM3", APB1_HZ),
            Timer::Tim12 => ("TIM12", APB1_HZ),
        };
        let registers = self.bus().registers(name)?;
        // The same registers in three layouts.
        let read = |of_tim1: tim1::Register, of_tim2: tim2::Register, of_tim9: tim9::Register| {
            match output.timer {
                Timer::Tim1 | Timer::Tim8 => registers.get(of_tim1),
                Timer::Tim3 => registers.get(of_tim2),
                Timer::Tim12 => registers.get(of_tim9),
            }
        };
        type One = tim1::Register;
        type Two = tim2::Register;
        type Nine = tim9::Register;
        let cr1 = read(One::Cr1, Two::Cr1, Nine::Cr1);
        let enabled = read(One::Ccer, Two::Ccer, Nine::Ccer);
        let modes = match index {
            0 | 1 => read(One::Ccmr1Output, Two::Ccmr1Output, Nine::Ccmr1Output),
            _ => read(One::Ccmr2Output, Two::Ccmr2Output, Nine::Ccmr1Output),
        };
        let compare = match index {
            0 => read(One::Ccr1, Two::Ccr1, Nine::Ccr1),
            1 => read(One::Ccr2, Two::Ccr2, Nine::Ccr2),
            2 => read(One::Ccr3, Two::Ccr3, Nine::Ccr1),
            _ => read(One::Ccr4, Two::Ccr4, Nine::Ccr1),
        } as f64;
        let (top, prescaler) =
            (read(One::Arr, Two::Arr, Nine::Arr), read(One::Psc, Two::Psc, Nine::Psc));
        let is_pwm = modes >> (8 * (index % 2)) & 0x70 == 0x60;
        let is_output = matches!(output.timer, Timer::Tim3 | Timer::Tim12)
            || bdtr::MOE.is_set(registers.get(One::Bdtr));
        let is_on = cr1::CEN.is_set(cr1) && ccer::CC1E.get(enabled >> (4 * index)) != 0;
        if !is_on || !is_pwm || !is_output {
            return None;
        }
        let tick = 1e9 * (prescaler + 1) as f64 / hz;
        let is_centred = cr1::CMS.get(cr1) != 0;
        let period = if is_centred { 2.0 * top as f64 } else { top as f64 + 1.0 };
        let width = (if is_centred { 2.0 * compare } else { compare }).min(period);
        Some(Pulses { width_ns: width * tick, period_ns: period * tick })
    }
}
