//! The sensors that take their time: ultrasonic rangers, infrared remote, inputs, slow A/D values.
//!
//! An echo is timed by the interrupt that its edge makes, on the sensing executor, above
//! everything but control: a control period's 50 us in its way are less than a centimetre. They are as
//! much as the remote's decoder bears, so the time of its edges is taken above control ([`RemoteEdge`]).

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use embassy_futures::join::join;
use embassy_stm32::Peri;
use embassy_stm32::exti::ExtiInput;
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Speed};
use embassy_stm32::interrupt::typelevel::{Handler, Interrupt};
use embassy_stm32::mode::Async;
use embassy_stm32::pac::EXTI;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use infrared::protocol::Nec;
use infrared::protocol::nec::Nec16Command;
use infrared::receiver::{DecoderFactory, ProtocolDecoder, State};

use super::analog::Analog;
use super::boot::CORE_MHZ;
use crate::app::{self, Channels};
use crate::ports::{SensorPort, Sensors};

/// Between two rangers, so that no echo of the one is heard by the next: sound goes 6.8 m and back
/// in 40 ms. Six take turns in 240 ms.
const TURN: Duration = Duration::from_millis(40);
/// An echo line that has not risen by then belongs to no ranger: they take 0.1 to 1 ms.
const RISES_WITHIN: Duration = Duration::from_millis(3);
/// Sound needs 58 us a centimetre, out and back.
const US_PER_CM: u64 = 58;
/// Beyond the protocol's 254 cm.
const FALLS_WITHIN: Duration = Duration::from_micros(255 * US_PER_CM);
/// What the protocol says of nothing in range.
const NOTHING: u8 = 255;

/// An ultrasonic ranger with a trigger and an echo line (the original's, HC-SR04, SRF05).
pub struct Ranger {
    /// 10 us high fires it.
    pub trigger: Output<'static>,
    /// High for as long as the sound travels.
    pub echo: ExtiInput<'static, Async>,
}

impl Ranger {
    /// A ranger on these pins.
    pub fn new(trigger: Peri<'static, AnyPin>, echo: ExtiInput<'static, Async>) -> Self {
        Self { trigger: Output::new(trigger, Level::Low, Speed::Low), echo }
    }

    /// One range in cm.
    async fn range(&mut self) -> u8 {
        self.trigger.set_high();
        cortex_m::asm::delay(10 * CORE_MHZ);
        self.trigger.set_low();
        if with_timeout(RISES_WITHIN, self.echo.wait_for_rising_edge()).await.is_err() {
            return NOTHING;
        }
        let risen = Instant::now();
        match with_timeout(FALLS_WITHIN, self.echo.wait_for_falling_edge()).await {
            Ok(()) => u8::try_from(risen.elapsed().as_micros() / US_PER_CM).unwrap_or(NOTHING),
            Err(_) => NOTHING,
        }
    }
}

/// A held key repeats every 110 ms.
const HELD: Duration = Duration::from_millis(130);

/// The key that the remote last sent.
#[derive(Clone, Copy)]
struct Key {
    code: [u8; 3],
    until: Instant,
}

impl Key {
    const NONE: Self = Self { code: [0; 3], until: Instant::MIN };

    /// On the wire (Table II.4, bytes 27 to 30): the key code, and 255 while it is held.
    fn report(self) -> [u8; 4] {
        let [a, b, c] = self.code;
        [a, b, c, if Instant::now() < self.until { 255 } else { 0 }]
    }
}

/// When the remote's line has last changed, in us.
static EDGE_AT: AtomicU32 = AtomicU32::new(0);

/// Takes the time of the edges on the remote's EXTI line, in its interrupt, before embassy's handler
/// clears the flag. That one is above control, and so late by some us at the most: the decoder wants a
/// zero's 1120 us within 56, of which a remote's own clock takes its part.
pub struct RemoteEdge<const LINE: usize>;

impl<I: Interrupt, const LINE: usize> Handler<I> for RemoteEdge<LINE> {
    unsafe fn on_interrupt() {
        if EXTI.pr(0).read().line(LINE) && EXTI.imr(0).read().line(LINE) {
            EDGE_AT.store(Instant::now().as_micros() as u32, Ordering::Relaxed); // the low 32 bits
        }
    }
}

/// The infrared receiver: a demodulator whose output is low while it sees the carrier, NEC frames.
pub struct Remote(pub ExtiInput<'static, Async>);

impl Remote {
    /// Decodes for ever. Edges are 560 us apart or more, so control may run between an edge and the look
    /// at its level. Key codes are the two bytes of the NEC address and the command.
    async fn listen(&mut self, key: &Cell<Key>) {
        let mut decoder = <Nec<Nec16Command> as DecoderFactory<u32>>::decoder(1_000_000);
        let mut last = 0;
        loop {
            self.0.wait_for_any_edge().await;
            let at = EDGE_AT.load(Ordering::Relaxed);
            let since = at.wrapping_sub(last).min(u32::MAX / 2); // the decoder adds two
            last = at;
            match ProtocolDecoder::<u32, _>::event(&mut decoder, self.0.is_low(), since) {
                State::Done => {
                    let until = Instant::now() + HELD;
                    match ProtocolDecoder::<u32, Nec16Command>::command(&decoder) {
                        Some(Nec16Command { repeat: true, .. }) => {
                            key.set(Key { until, ..key.get() });
                        }
                        Some(Nec16Command { addr, cmd, .. }) => {
                            let [low, high] = addr.to_le_bytes();
                            key.set(Key { code: [low, high, cmd], until });
                        }
                        None => {}
                    }
                    ProtocolDecoder::<u32, Nec16Command>::reset(&mut decoder);
                }
                State::Error(_) => ProtocolDecoder::<u32, Nec16Command>::reset(&mut decoder),
                State::Idle | State::Receiving => {}
            }
        }
    }
}

/// Everything that senses slowly; the slow A/D values come from the scan. Rangers and inputs that the
/// board does not have read as nothing in range and low.
pub struct Sensing<const RANGERS: usize, const INPUTS: usize> {
    /// Infrared remote control.
    pub remote: Remote,
    /// Fired in turn, the first up to six.
    pub rangers: [Ranger; RANGERS],
    /// Input port, bit 0 is input 0, up to eight.
    pub inputs: [Input<'static>; INPUTS],
}

impl<const RANGERS: usize, const INPUTS: usize> Sensing<RANGERS, INPUTS> {
    /// The task: readings into `channels`, for ever.
    pub async fn run<M: RawMutex, C: Copy>(&mut self, channels: &Channels<M, C>) -> ! {
        let key = Cell::new(Key::NONE);
        let Self { remote, rangers, inputs } = self;
        let mut port = Port { rangers, inputs, key: &key, turn: 0, last: Sensors::UNKNOWN };
        join(app::sensors(&mut port, channels), remote.listen(&key)).await;
        unreachable!("both are endless")
    }
}

struct Port<'a> {
    rangers: &'a mut [Ranger],
    inputs: &'a [Input<'static>],
    key: &'a Cell<Key>,
    turn: usize,
    last: Sensors,
}

impl SensorPort for Port<'_> {
    /// One ranger's turn, and everything else as it is then.
    async fn read(&mut self) -> Sensors {
        let turn_ends = Timer::after(TURN);
        let ranger = self.rangers.iter_mut().zip(&mut self.last.sonar_cm).nth(self.turn);
        if let Some((ranger, cm)) = ranger {
            *cm = ranger.range().await;
        }
        self.turn = if self.turn + 1 < self.rangers.len() { self.turn + 1 } else { 0 };
        turn_ends.await;
        self.last.ir_command = self.key.get().report();
        let bit = |bits, input: &Input<'_>| bits << 1 | u8::from(input.is_high());
        self.last.gpio_in = self.inputs.iter().rev().fold(0, bit);
        Analog::read(&mut self.last);
        self.last
    }
}
