//! TIM1 and TIM8 with what leaves them besides their pins, and TIM12, which rigless' F427 leaves out.
//!
//! | register or section | behaviour | source | test |
//! |---|---|---|---|
//! | TRGO | a request line, for the other timer and the converters | 17.4.2, 13.6 | `scan.rs` |
//! | ITR0 | TIM8 hears TIM1's TRGO; TIM1 hears no TRGO of TIM8 (table 93: TIM5, TIM2, TIM3, TIM4) | 17.4.3, table 93 | `scan.rs` |
//! | the update's DMA request | a request line, which DMA2 hears | 17.4.4, table 43 | `scan.rs` |
//! | TIM12 | the model of chapter 18 with two channels | chapter 19 | `motion.rs` |
//!
//! | left out | source | reason |
//! |---|---|---|
//! | ITR1 to ITR3 of both | table 93 | no image chains other timers |
//! | TIM8's other DMA requests | table 43 | no image uses them |
//! | TIM12's own clock enable for its counting | 7.3.13 | it counts as TIM3 does, which every image with servos starts with it; its registers are gated by its own |

use std::sync::{Arc, Mutex};

use rigless::device::{Device, DeviceContext, Level, RegisterFile, RequestChange};
use rigless::soc::RegisterSpec;
use rigless::soc::st::tim::{Errata, Kind, Part, Spelling, Wakeups};
use rigless::soc::stm32f427::generated::{tim1, tim2, tim9};
use rigless::soc::stm32f427::peripherals::tim::{Advanced, Counter, Family, Tim};
use rigless::time::EventId;

use super::RESET_HZ;

/// TRGO as a request line, above those of the model.
pub const TRGO: usize = 16;
/// The update's DMA request as a request line.
pub const UPDATE: usize = 17;

/// A PWM timer as whoever disturbs or samples needs it: where its edges are.
#[derive(Clone, Debug, Default)]
pub struct Waveform {
    /// When the counter was last known to be 0 and to count up, in ns.
    pub zero_ns: f64,
    /// Length of the PWM period in ns; 0 while the timer stands still.
    pub period_ns: f64,
    /// The output edges of channels that drive a pin, in ns after `zero_ns`.
    pub edges_ns: Vec<f64>,
}

impl Waveform {
    /// Nanoseconds from the last edge before `at` until then, if there are edges.
    pub fn since_edge(&self, at: f64) -> Option<f64> {
        if self.period_ns <= 0.0 {
            return None;
        }
        let since = |edge: &f64| (at - self.zero_ns - edge).rem_euclid(self.period_ns);
        self.edges_ns.iter().map(since).min_by(f64::total_cmp)
    }
}

/// What is known of a timer from outside, shared with the analogue inputs.
pub type Shared = Arc<Mutex<Waveform>>;

/// An advanced-control timer.
#[derive(Debug)]
pub struct Pwm {
    /// rigless' model.
    inner: Tim<Advanced>,
    /// Whose TRGO is this timer's ITR0, as an instance.
    master: Option<&'static str>,
    waveform: Shared,
    level: Level,
    pulses: u64,
    updates: u64,
    hz: u64,
    /// What was written to its first compare register, and when, in ns, while somebody wants to know.
    pub compared: Option<Vec<(u64, u64)>>,
    /// So many of its update requests are lost from now on, as a bus that is busy for too long would.
    pub lost_updates: u32,
}

impl Pwm {
    /// As it comes out of reset.
    pub fn new(master: Option<&'static str>, waveform: Shared) -> Self {
        let inner = Tim::with_clock(RESET_HZ, Counter::Narrow);
        *waveform.lock().unwrap() = Waveform::default();
        Self {
            inner,
            master,
            waveform,
            level: Level::Low,
            pulses: 0,
            updates: 0,
            hz: RESET_HZ,
            compared: None,
            lost_updates: 0,
        }
    }

    /// Tells others what has come of a call.
    fn tell(&mut self, registers: &RegisterFile, context: &mut DeviceContext<'_>) {
        let (level, pulses) = self.inner.trigger_output();
        if pulses != self.pulses {
            self.pulses = pulses;
            context.request(TRGO, Level::High);
            context.request(TRGO, Level::Low);
        } else if level != self.level {
            self.level = level;
            context.request(TRGO, level);
        }
        let updates = self.inner.dma_requests().update;
        if updates != self.updates {
            self.updates = updates;
            match self.lost_updates.checked_sub(1) {
                Some(left) => self.lost_updates = left,
                None => {
                    context.request(UPDATE, Level::High);
                    context.request(UPDATE, Level::Low);
                }
            }
        }
        *self.waveform.lock().unwrap() = self.waveform(registers, context);
    }

    fn waveform(&self, registers: &RegisterFile, context: &DeviceContext<'_>) -> Waveform {
        use tim1::Register as R;
        use tim1::{bdtr, ccer, cr1};
        let control = registers.get(R::Cr1);
        if !cr1::CEN.is_set(control) || self.hz == 0 {
            return Waveform::default();
        }
        let now = context.now();
        let count = Device::peek(&self.inner, R::Cnt, registers, now).unwrap_or(0);
        let down =
            cr1::DIR.is_set(Device::peek(&self.inner, R::Cr1, registers, now).unwrap_or(control));
        let (top, centred) = (registers.get(R::Arr), cr1::CMS.get(control) != 0);
        let tick = 1e9 * (registers.get(R::Psc) + 1) as f64 / self.hz as f64;
        let period = if centred { 2 * top } else { top + 1 };
        let place = if centred && down { 2 * top - count } else { count };
        let enables = [ccer::CC1E, ccer::CC2E, ccer::CC3E, ccer::CC4E];
        let compares = [R::Ccr1, R::Ccr2, R::Ccr3, R::Ccr4];
        let mut edges = Vec::new();
        if bdtr::MOE.is_set(registers.get(R::Bdtr)) {
            for (enable, compare) in enables.iter().zip(compares) {
                let compare = registers.get(compare);
                if !enable.is_set(registers.get(R::Ccer)) || compare == 0 || compare > top {
                    continue; // no edge: low or high all the time
                }
                edges.push(compare as f64 * tick);
                edges.push(if centred { (period - compare) as f64 * tick } else { 0.0 });
            }
        }
        Waveform {
            zero_ns: now.0 as f64 - place as f64 * tick,
            period_ns: period as f64 * tick,
            edges_ns: edges,
        }
    }
}

impl Device for Pwm {
    type Register = tim1::Register;

    fn layout(&self) -> &'static [RegisterSpec] {
        Device::layout(&self.inner)
    }

    fn read(
        &mut self,
        register: Self::Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let value = Device::read(&mut self.inner, register, registers, context);
        self.tell(registers, context);
        value
    }

    fn write(
        &mut self,
        register: Self::Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if let (Some(compared), tim1::Register::Ccr1) = (&mut self.compared, register) {
            compared.push((context.now().0, value));
        }
        Device::write(&mut self.inner, register, value, registers, context);
        self.tell(registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_event(&mut self.inner, event, registers, context);
        self.tell(registers, context);
    }

    fn on_request(
        &mut self,
        change: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        // Every pin of every port comes by here.
        if change.instance == "RCC" {
            Device::on_request(&mut self.inner, change, registers, context);
        } else if Some(change.instance) == self.master && change.request == TRGO {
            self.inner.drive_internal_trigger(0, change.level, registers, context);
        } else {
            return;
        }
        self.tell(registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.hz = hz;
        Device::on_clock(&mut self.inner, hz, registers, context);
        self.tell(registers, context);
    }

    fn reset(&mut self) {
        Device::reset(&mut self.inner);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::reset_line(&mut self.inner, registers, context);
        self.tell(registers, context);
    }
}

/// A timer with two channels.
#[derive(Debug, Clone, Copy)]
pub struct TwoChannels;

static PART: Part = Part {
    tables: &[&tim9::REGISTERS, &tim2::REGISTERS, &tim1::REGISTERS],
    spellings: &[
        Spelling { register: "CCMR1_Input", manual: "IC1PSC", file: "ICPCS" },
        Spelling { register: "CCMR1_Input", manual: "IC2PSC", file: "IC2PCS" },
    ],
    wakeups: Wakeups::WhenSeen,
    break_pin: Some(Level::Low),
    acknowledged: None,
    errata: Errata {
        consecutive_compare_missed: false,
        clear_outlasts_reset: false,
        trigger_lost_at_reload: false,
    },
};

impl Family for TwoChannels {
    type Register = tim9::Register;
    type Instance = Counter;
    const PART: &'static Part = &PART;
    const KINDS: &'static [Kind] = &[Kind::TwoChannelSlave];
}

/// TIM12 as it comes out of reset.
pub fn tim12() -> Tim<TwoChannels> {
    Tim::with_clock(RESET_HZ, Counter::Narrow)
}
