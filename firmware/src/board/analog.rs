//! 48 analogue inputs on three pins, scanned by hardware alone.
//!
//! Three 16-way multiplexers (74HC4067) share four address lines. TIM8 makes the bridges' PWM, and
//! on the side, once every 50 us period, counted here in its ticks from its *bottom* (`drives`):
//!
//! | tick | what |
//! |---|---|
//! | -4200, the top | update, DMA: next address |
//! | -40 | OC4REF rises, ADC1 begins |
//! | -24 to 200 | B is sampled: a motor's current in the middle of the line's high part |
//! | 296 to 2792 | A and C |
//! | 2792 to 3016 | B is sampled again: for high parts that are short, in the low part |
//! | 3112 | the last of four samples is ready, DMA: [`SAMPLES`] |
//! | 4200, the top | update, DMA: next address |
//!
//! The address settles for 25 us before the first sample: 10 time constants of a potentiometer's 2.5
//! kOhm with 1 nF. Sixteen periods are a scan: every input is 0.8 ms old at most, fresher than the
//! control period. The CPU only reads [`SAMPLES`].
//!
//! The timer asks for an address at its bottom too, and is given a word that changes nothing: which
//! of the two a repetition counter would leave out depends on how it was started.
//!
//! Of the two samples of a current one is always [away from](Moment) the edges of its own line. The
//! first is away from all six lines' while each of them is high for 9 % of the period or more, or never.
//!
//! Two streams step side by side. A sample that the DMA is too late for sets the ADC's overrun flag,
//! which stops its requests; a bus error stops a stream; a request too many or too few puts the
//! two out of step. [`Analog::check`] looks for all three once a control period and starts the two anew,
//! together. The addresses lie in RAM as the samples do, since flash that is erased answers nobody. TIM8
//! never stops for it.
//!
//! ADC1, TIM8 and DMA2's streams 0 and 1 are the chip's choice more than ours: of the timers that
//! make a bridge's PWM only TIM8's TRGO starts ADC1, and only stream 1 hears its update (RM0090
//! table 43, "External trigger for regular channels"; RM0390 has the same).

use core::ops::Range;
use core::sync::atomic::{AtomicU16, AtomicU32, Ordering};

use crate::channel::CHANNELS;
use embassy_stm32::Peri;
use embassy_stm32::adc::{AnyAdcChannel, RxDma};
use embassy_stm32::gpio::{AnyPin, Speed};
use embassy_stm32::pac::adc::vals::{Dds, Exten, SampleTime};
use embassy_stm32::pac::adccommon::vals::Adcpre;
use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::pac::timer::vals::{Dir as Count, Mms, Ocm};
use embassy_stm32::pac::{self, ADC1, TIM8};
use embassy_stm32::peripherals::{self, DMA2_CH0, DMA2_CH1};
use embassy_stm32::timer::UpDma;

use super::dma::{Round, Stream};
use super::drives::{Lines, PWM_TOP};
use crate::ports::Sensors;

/// Multiplexers.
const MULTIPLEXERS: usize = 3;
/// Addresses of each.
const ADDRESSES: usize = 16;
/// What the DMA is asked for in a scan: twice a period.
const WORDS: usize = 2 * ADDRESSES;

/// Samples of an address, in order: multiplexer B, A, C, and B again.
const CONVERSIONS: usize = 4;
const B: usize = 0;
const A: usize = 1;
const C: usize = 2;
const B_AGAIN: usize = 3;

/// Scan by scan: the samples of address 0, those of address 1, and so on. The DMA writes it.
static SAMPLES: [AtomicU16; CONVERSIONS * ADDRESSES] =
    [const { AtomicU16::new(0) }; CONVERSIONS * ADDRESSES];

/// How often the scan was started anew; for whoever looks into memory.
static RESTARTS: AtomicU32 = AtomicU32::new(0);

/// The four address lines S0 to S3, and the way round all addresses.
pub struct Addresses {
    lines: Lines,
    /// What is written to BSRR, the DMA's source: at the top to go to the next address, at the bottom
    /// nothing. Atomic, because such a static lies in RAM.
    words: [AtomicU32; WORDS],
}

impl Addresses {
    /// On these four lines.
    pub const fn new(lines: Lines) -> Self {
        let mut words = [const { AtomicU32::new(0) }; WORDS];
        let mut address = 0;
        while address < ADDRESSES {
            words[2 * address] = AtomicU32::new(lines.word(address as u32)); // below 16
            address += 1;
        }
        Self { lines, words }
    }
}

/// TIM8's count, on its way down, at which the ADC begins. It takes two of its cycles to do so, and has
/// 21 MHz, 8 ticks a cycle.
const TRIGGER: u16 = 40;
/// B is sampled for 28 cycles, enough for 25 kOhm, A and C for 144; each conversion takes 12 more.
const CURRENT_TIME: SampleTime = SampleTime::CYCLES28;
const OTHER_TIME: SampleTime = SampleTime::CYCLES144;
/// When B is sampled and converted for the second time, from the bottom: -40 + 8 * (2 + 40 + 156 + 156).
const SECOND: Range<u16> = 2792..3112;
const _: () = assert!(SECOND.end < PWM_TOP && START.end < PWM_TOP);
/// From an edge of a PWM line until the bridge has followed and a current's signal is quiet again: 2 us.
const SETTLING: u16 = 336;
/// Behind the first sample of a period, which is ready at 296, and before the second, at 1544.
const MIDDLE: u16 = 1000;

/// The two samples of a current in a period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// In the middle of the high part, where a current is at its mean.
    High,
    /// In the low part, of a line whose high part is short.
    Low,
}

impl Moment {
    /// Whether a line with this compare value has an edge in the sample, or so shortly before that
    /// something is left of it. It rises that many ticks before the bottom and falls as many
    /// behind it; at 0 and at the top it has no edges.
    pub fn has_edge(self, compare: u16) -> bool {
        match self {
            Self::High => (1..TRIGGER + SETTLING).contains(&compare),
            Self::Low => (SECOND.start - SETTLING..SECOND.end).contains(&compare),
        }
    }
}

/// External trigger 14 of the regular group is TIM8_TRGO (RM0090 table "External trigger for
/// regular channels").
const TIM8_TRGO: u8 = 0b1110;

/// The newest samples of a multiplexer's inputs, 0 to 4095.
///
/// # Panics
/// If there are not that many from `first` on.
fn samples<const N: usize>(conversion: usize, first: usize) -> [u16; N] {
    core::array::from_fn(|i| {
        SAMPLES[(first + i) * CONVERSIONS + conversion].load(Ordering::Relaxed)
    })
}

/// Where the scan is started: while the counter goes up, OC4REF being low again, with time to do it
/// before the top. It is 28 us away at the most.
const START: Range<u16> = 200..4000;
/// How often the counter is looked at for that, at the most. A look takes 20 cycles or more, 400 of them
/// 48 us; a timer that stands still holds nobody up.
const LOOKS: u32 = 400;

/// The scan.
pub struct Analog {
    select: Round,
    sample: Round,
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
        ADC1.sqr1().write(|w| w.set_l(CONVERSIONS as u8 - 1));
        let [a, b, c] = inputs.each_ref().map(AnyAdcChannel::get_hw_channel);
        for (place, input) in [b, a, c, b].into_iter().enumerate() {
            ADC1.sqr3().modify(|w| w.set_sq(place, input));
            let time = if input == b { CURRENT_TIME } else { OTHER_TIME };
            // Inputs 10 and up are in SMPR1, the others in SMPR2.
            match input.checked_sub(10) {
                Some(n) => ADC1.smpr1().modify(|w| w.set_smp(n.into(), time)),
                None => ADC1.smpr2().modify(|w| w.set_smp(input.into(), time)),
            }
        }
        TIM8.ccmr_output(1).modify(|w| {
            // Active up to the compare value: on the way down OC4REF rises at TRIGGER.
            w.set_ocm(1, Ocm::PWM_MODE1);
        });
        TIM8.ccr(3).write(|w| w.set_ccr(TRIGGER));
        TIM8.cr2().modify(|w| w.set_mms(Mms::COMPARE_OC4));

        let mut analog = Self {
            select: Round {
                stream: Stream::of(&select),
                request: UpDma::<peripherals::TIM8>::request(&*select),
                direction: Dir::MEMORY_TO_PERIPHERAL,
                width: Size::BITS32,
                register: addresses.lines.port.bsrr().as_ptr() as u32, // 32 bits
                memory: addresses.words.as_ptr() as u32,
                items: WORDS as u16,
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
        };
        analog.start();
        analog
    }

    /// Starts a scan: the next top of the counter selects address 0. Takes 28 us at the most.
    fn start(&mut self) {
        TIM8.dier().modify(|w| w.set_ude(false));
        ADC1.cr2().write(|_| {});
        ADC1.sr().write(|_| {}); // the overrun flag blocks DMA until it is cleared
        // SAFETY: both buffers are statics of the lengths given; the DMA writes only SAMPLES,
        // which is atomic.
        unsafe {
            self.select.start();
            self.sample.start();
        }
        for look in 1..=LOOKS {
            let is_started = critical_section::with(|_| {
                let is_place = !is_counting_down() && START.contains(&TIM8.cnt().read().cnt());
                let starts = is_place || look == LOOKS;
                if starts {
                    // The trigger is 25 us away: the ADC needs 3 us to wake.
                    ADC1.cr2().write(|w| {
                        w.set_adon(true);
                        w.set_dma(true);
                        w.set_dds(Dds::CONTINUOUS);
                        w.set_extsel(TIM8_TRGO);
                        w.set_exten(Exten::RISING_EDGE);
                    });
                    TIM8.dier().modify(|w| w.set_ude(true));
                }
                starts
            });
            if is_started {
                break;
            }
        }
    }

    /// Starts the scan anew if it has stopped or slipped. Called once a control period.
    pub fn check(&mut self) {
        let overrun = ADC1.sr().read().ovr();
        let failed = [&self.select, &self.sample].map(Round::failed).contains(&true);
        if overrun || failed || self.has_slipped() {
            let restarts = RESTARTS.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
            if restarts.is_power_of_two() {
                defmt::warn!("analogue scan: {} restarts (overrun: {})", restarts, overrun);
            }
            self.start();
        }
    }

    /// Whether addresses and samples are out of step. A look while one of them steps may be wrong;
    /// steps are 1.7 us apart at least, and so not all of three looks are.
    fn has_slipped(&self) -> bool {
        (0..3).all(|_| !critical_section::with(|_| self.is_in_step()))
    }

    /// Whether the streams are where the counter says.
    fn is_in_step(&self) -> bool {
        let words = done(WORDS, self.select.stream);
        let sampled = done(SAMPLES.len(), self.sample.stream);
        if (words, sampled) == (0, 0) {
            return true; // about to begin, or at the end of the scan
        }
        let (is_down, count) = (is_counting_down(), TIM8.cnt().read().cnt());
        if is_down != (words % 2 == 1) {
            return false; // a request of the timer has been lost, or was one too many
        }
        // So many samples are there of the newest address, 0 to 4. After a slip it is four more or less.
        let before = (words + WORDS - 1) / 2 % ADDRESSES * CONVERSIONS;
        let of_address = (sampled + SAMPLES.len() - before) % SAMPLES.len();
        match (is_down, count < MIDDLE) {
            (true, _) => of_address == 0,
            (false, true) => of_address < CONVERSIONS,
            (false, false) => (1..=CONVERSIONS).contains(&of_address),
        }
    }

    /// Potentiometers 1 to 6.
    pub fn potentiometers() -> [u16; CHANNELS] {
        samples(A, 0)
    }

    /// Motor currents 1 to 6.
    pub fn currents(moment: Moment) -> [u16; CHANNELS] {
        samples(if moment == Moment::High { B } else { B_AGAIN }, 0)
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

/// Which way TIM8 counts.
fn is_counting_down() -> bool {
    TIM8.cr1().read().dir() == Count::DOWN
}

/// How many of a buffer's items a stream has done in this round.
fn done(items: usize, stream: Stream) -> usize {
    (items - usize::from(stream.remaining()).min(items)) % items
}
