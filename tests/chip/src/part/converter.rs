//! ADC1 with its external trigger, and what is on its pins at the moment of a sample.
//!
//! | register or section | behaviour | source | test |
//! |---|---|---|---|
//! | `EXTEN`, `EXTSEL` | TIM8's TRGO (14) starts the regular group at its edge; of TIM1 no TRGO is among the choices | 13.6, table 69 | `scan.rs` |
//! | the sample | the voltage at the end of its sampling time, 12 `ADCCLK` cycles before the conversion ends | 13.5 | `scan.rs` |
//!
//! | left out | source | reason |
//! |---|---|---|
//! | the other triggers, the injected group's | 13.6 | no image uses them |
//! | the sampling capacitor's own charge | data sheet table 67 | 4 pF against a common pin's 100 |
//! | the time after `ADON` | 13.3.6 | as rigless: a conversion that is started at once is exact |

use std::fmt;

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::stm32f427::generated::adc1::{Register, cr2};
use rigless::soc::stm32f427::peripherals::adc::{Adc, Channel};
use rigless::time::EventId;

use super::RESET_HZ;
use super::timers::TRGO;

/// Millivolts on the part's analogue inputs. Whoever is around the part implements it.
pub trait Front: fmt::Debug + Send {
    /// A pin of a port has changed.
    fn pin(&mut self, port: usize, pin: u8, level: Level, now_ns: u64);
    /// Millivolts on an input, 0 to 15, at this moment.
    fn sample(&mut self, input: u8, now_ns: u64) -> u32;
}

/// The trigger's number for TIM8's TRGO.
const TIM8_TRGO: u64 = 14;
/// Cycles of a conversion behind its sampling time, at 12 bits.
const CONVERSION: u64 = 12;

/// ADC1.
#[derive(Debug)]
pub struct Converter {
    inner: Adc,
    adcclk_hz: u64,
    /// What is on its pins.
    front: Box<dyn Front>,
    /// Which of them are looked at.
    inputs: &'static [u8],
    /// When samples were taken, the newest last, while somebody wants to know.
    pub sampled_ns: Option<Vec<u64>>,
}

impl Converter {
    /// As it comes out of reset, with these inputs in use.
    pub fn new(front: Box<dyn Front>, inputs: &'static [u8], reference_mv: u32) -> Self {
        let inner = adc(reference_mv);
        Self { inner, adcclk_hz: RESET_HZ / 2, front, inputs, sampled_ns: None }
    }

    /// Puts it back as it comes out of reset.
    pub fn restart(&mut self, reference_mv: u32) {
        self.inner = adc(reference_mv);
    }
}

/// The model as it comes out of reset.
fn adc(reference_mv: u32) -> Adc {
    let mut adc = Adc::with_clock(RESET_HZ / 2);
    adc.set_reference(reference_mv);
    adc
}

impl Device for Converter {
    type Register = Register;

    fn read(
        &mut self,
        register: Self::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        Device::read(&mut self.inner, register, registers, context)
    }

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::write(&mut self.inner, register, value, registers, context);
    }

    /// A conversion's end.
    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let sampled = context.now().0 - CONVERSION * 1_000_000_000 / self.adcclk_hz.max(1);
        for &input in self.inputs {
            let millivolts = self.front.sample(input, sampled);
            if let Some(channel) = Channel::new(input) {
                self.inner.set_input(channel, millivolts);
            }
        }
        if let Some(times) = &mut self.sampled_ns {
            times.push(sampled);
        }
        Device::on_event(&mut self.inner, event, registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if let Some(port) = change.instance.strip_prefix("GPIO") {
            let port = usize::from(port.as_bytes()[0] - b'A');
            self.front.pin(port, change.request as u8, change.level, context.now().0);
        } else if change.instance == "TIM8" && change.request == TRGO {
            let control = registers.get(Register::Cr2);
            let edge = if change.level == Level::High { 1 } else { 2 };
            let wanted = cr2::EXTEN.get(control) & edge != 0;
            if wanted && cr2::EXTSEL.get(control) == TIM8_TRGO {
                // A trigger does what SWSTART does.
                let started = cr2::SWSTART.set(control, 1);
                registers.set(Register::Cr2, started);
                Device::write(&mut self.inner, Register::Cr2, started, registers, context);
            }
        } else {
            Device::on_request(&mut self.inner, change, registers, context);
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.adcclk_hz = hz;
        Device::on_clock(&mut self.inner, hz, registers, context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.inner);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::reset_line(&mut self.inner, registers, context);
    }
}
