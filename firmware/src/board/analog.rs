//! 48 analogue inputs on three pins, scanned by hardware alone.
//!
//! Three 16-way multiplexers (74HC4067) share four address lines. TIM8 makes the bridges' PWM, and
//! on the side, once every 50 us period:
//!
//! ```text
//!   counter 0 ......... TRIGGER ............. period
//!     │ update           │ OC4REF rises
//!     └> DMA: next       └> ADC1: one sample of each multiplexer ─> DMA: SAMPLES
//!        address
//! ```
//!
//! Sixteen periods are a scan: every input is 0.8 ms old at most, fresher than the control period,
//! and sampled at one fixed place of the PWM period, away from its edges at moderate duties. The
//! CPU only reads [`SAMPLES`].
//!
//! Two streams step side by side, and neither can lose a step unnoticed: a sample that the DMA is
//! too late for sets the ADC's overrun flag, which stops its requests; a bus error stops a stream.
//! [`Analog::check`] looks for both and starts the two anew, together.
//!
//! ADC1, TIM8 and DMA2's streams 0 and 1 are the chip's choice more than ours: of the timers that
//! make a bridge's PWM only TIM8's TRGO starts ADC1, and only stream 1 hears its update (RM0090
//! table 43, "External trigger for regular channels"; RM0390 has the same).

use core::sync::atomic::{AtomicU16, Ordering};

use crate::channel::CHANNELS;
use embassy_stm32::Peri;
use embassy_stm32::adc::{AnyAdcChannel, RxDma};
use embassy_stm32::gpio::{AnyPin, Speed};
use embassy_stm32::pac::adc::vals::{Dds, Exten, SampleTime};
use embassy_stm32::pac::adccommon::vals::Adcpre;
use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::pac::timer::vals::{Mms, Ocm};
use embassy_stm32::pac::{self, ADC1, TIM8};
use embassy_stm32::peripherals::{self, DMA2_CH0, DMA2_CH1};
use embassy_stm32::timer::UpDma;

use super::dma::{Round, Stream};
use super::drives::Lines;
use crate::ports::Sensors;

/// Multiplexers.
const MULTIPLEXERS: usize = 3;
/// Their names in the wiring table.
const A: usize = 0;
const B: usize = 1;
const C: usize = 2;
/// Addresses of each.
const ADDRESSES: usize = 16;

/// Scan by scan: address 0 of each multiplexer, address 1 of each, and so on. The DMA writes it.
static SAMPLES: [AtomicU16; MULTIPLEXERS * ADDRESSES] =
    [const { AtomicU16::new(0) }; MULTIPLEXERS * ADDRESSES];

/// The four address lines S0 to S3, and the way round all addresses.
pub struct Addresses {
    lines: Lines,
    /// What is written to BSRR to go to the next address, the DMA's source.
    next: [u32; ADDRESSES],
}

impl Addresses {
    /// On these four lines.
    pub const fn new(lines: Lines) -> Self {
        let mut next = [0; ADDRESSES];
        let mut i = 0;
        while i < ADDRESSES {
            next[i] = lines.word(((i + 1) % ADDRESSES) as u32); // below 16
            i += 1;
        }
        Self { lines, next }
    }
}

/// Timer ticks (168 MHz) from the change of the address to the samples: 30 us for the multiplexer
/// and a potentiometer's 2.5 kOhm to settle. The three conversions take (84 + 12) cycles of
/// 21 MHz each, 13.7 us together, and end 6 us before the next change.
const TRIGGER: u16 = 5040;

/// External trigger 14 of the regular group is TIM8_TRGO (RM0090 table "External trigger for
/// regular channels").
const TIM8_TRGO: u8 = 0b1110;

/// The newest samples of a multiplexer's inputs, 0 to 4095.
///
/// # Panics
/// If there are not that many from `first` on.
fn samples<const N: usize>(multiplexer: usize, first: usize) -> [u16; N] {
    core::array::from_fn(|i| {
        SAMPLES[(first + i) * MULTIPLEXERS + multiplexer].load(Ordering::Relaxed)
    })
}

/// The scan.
pub struct Analog {
    addresses: &'static Addresses,
    select: Round,
    sample: Round,
    /// How often the scan was started anew.
    restarts: u32,
}

impl Analog {
    /// Prepares ADC1 and TIM8's side of the scan, and starts it. TIM8 runs at the PWM's rate
    /// already. `pins` are those of the address lines, `inputs` the common pins of A, B and C.
    ///
    /// # Panics
    /// If `pins` are others than `addresses` names.
    pub fn new(
        _adc: Peri<'static, peripherals::ADC1>,
        inputs: [AnyAdcChannel<'static, peripherals::ADC1>; MULTIPLEXERS],
        addresses: &'static Addresses,
        pins: [Peri<'static, AnyPin>; 4],
        select: Peri<'static, DMA2_CH1>,
        sample: Peri<'static, DMA2_CH0>,
    ) -> Self {
        addresses.lines.claim(pins, Speed::Medium);
        pac::RCC.apb2enr().modify(|w| w.set_adc1en(true));
        pac::ADC123_COMMON.ccr().modify(|w| w.set_adcpre(Adcpre::DIV4));
        ADC1.cr1().write(|w| w.set_scan(true));
        ADC1.sqr1().write(|w| w.set_l(MULTIPLEXERS as u8 - 1));
        for (place, input) in inputs.iter().map(AnyAdcChannel::get_hw_channel).enumerate() {
            ADC1.sqr3().modify(|w| w.set_sq(place, input));
            // Inputs 10 and up are in SMPR1, the others in SMPR2.
            match input.checked_sub(10) {
                Some(n) => ADC1.smpr1().modify(|w| w.set_smp(n.into(), SampleTime::CYCLES84)),
                None => ADC1.smpr2().modify(|w| w.set_smp(input.into(), SampleTime::CYCLES84)),
            }
        }
        TIM8.ccmr_output(1).modify(|w| {
            // Inactive below the compare value, active from there on: OC4REF rises at TRIGGER.
            w.set_ocm(1, Ocm::PWM_MODE2);
        });
        TIM8.ccr(3).write(|w| w.set_ccr(TRIGGER));
        TIM8.cr2().modify(|w| w.set_mms(Mms::COMPARE_OC4));

        let mut analog = Self {
            addresses,
            select: Round {
                stream: Stream::of(&select),
                request: UpDma::<peripherals::TIM8>::request(&*select),
                direction: Dir::MEMORY_TO_PERIPHERAL,
                width: Size::BITS32,
                register: addresses.lines.port.bsrr().as_ptr() as u32, // 32 bits
                memory: addresses.next.as_ptr() as u32,
                items: ADDRESSES as u16,
            },
            sample: Round {
                stream: Stream::of(&sample),
                request: RxDma::<peripherals::ADC1>::request(&*sample),
                direction: Dir::PERIPHERAL_TO_MEMORY,
                width: Size::BITS16,
                register: ADC1.dr().as_ptr() as u32,
                memory: SAMPLES.as_ptr() as u32,
                items: SAMPLES.len() as u16,
            },
            restarts: 0,
        };
        analog.start();
        analog
    }

    /// Starts a scan at address 0. The PWM stands still for some 2 us.
    fn start(&mut self) {
        TIM8.cr1().modify(|w| w.set_cen(false));
        TIM8.dier().modify(|w| w.set_ude(false));
        ADC1.cr2().write(|_| {});
        ADC1.sr().write(|_| {}); // the overrun flag blocks DMA until it is cleared
        self.addresses.lines.write(0);
        // SAFETY: both buffers are statics of the lengths given; the DMA writes only SAMPLES,
        // which is atomic.
        unsafe {
            self.select.start();
            self.sample.start();
        }
        ADC1.cr2().write(|w| {
            w.set_adon(true);
            w.set_dma(true);
            w.set_dds(Dds::CONTINUOUS);
            w.set_extsel(TIM8_TRGO);
            w.set_exten(Exten::RISING_EDGE);
        });
        TIM8.cnt().write(|w| w.set_cnt(0)); // 30 us to the trigger: the ADC needs 3 us to wake
        TIM8.dier().modify(|w| w.set_ude(true));
        TIM8.cr1().modify(|w| w.set_cen(true));
    }

    /// Starts the scan anew if it has stopped. Called once a control period.
    pub fn check(&mut self) {
        let overrun = ADC1.sr().read().ovr();
        let failed = [&self.select, &self.sample].map(Round::failed).contains(&true);
        if overrun || failed {
            self.restarts = self.restarts.wrapping_add(1);
            defmt::warn!("analogue scan: {} restarts (overrun: {})", self.restarts, overrun);
            self.start();
        }
    }

    /// Potentiometers 1 to 6.
    pub fn potentiometers() -> [u16; CHANNELS] {
        samples(A, 0)
    }

    /// Motor currents 1 to 6.
    pub fn currents() -> [u16; CHANNELS] {
        samples(B, 0)
    }

    /// Fills in the other inputs.
    pub fn read(sensors: &mut Sensors) {
        sensors.custom_ad = samples(A, 6);
        sensors.reference = samples(A, 14);
        sensors.human = samples(B, 6);
        sensors.tilt = samples(B, 10);
        sensors.overheat = samples(B, 12);
        [sensors.temperature, sensors.ir_range] = samples(B, 14);
        sensors.battery = samples(C, 0);
    }
}
