//! hal-mock's bus of AX-12 servos on USART6's wire, and the half duplex that rigless leaves out.
//!
//! | register or section | behaviour | source | test |
//! |---|---|---|---|
//! | `HDSEL` | one wire: what is sent is heard too; without it the board hears nothing at all | 30.3.10 | `cm5.rs` |
//! | the wire | servos answer after their return delay and latency; bytes that overlap collide | hal-mock's `servo_bus` | `cm5.rs` |
//!
//! | left out | source | reason |
//! |---|---|---|
//! | an echo that a servo's byte has garbled | | what is written to the data register is heard as it goes out: rigless is offered a byte at its beginning |
//! | a master that begins in a byte of a servo's | | that byte is heard as it was |
//! | a driver that holds the wire against another | 30.3.10 | bytes collide, levels do not |

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use hal_mock::servo_bus::ServoBus;
use rigless::chip::{Timeline, uart::Peer};
use rigless::snapshot::Store;
use rigless::time::VirtualNanos;

use super::line::Timed;

/// A byte on the wire, at 1 Mbaud.
const BYTE_NS: u64 = 10_000;

/// The bus's end of the wire. Handles are to the same bus.
#[derive(Clone)]
pub struct Servos {
    /// The servos.
    pub bus: Arc<Mutex<ServoBus>>,
    /// Whether the UART is on one wire.
    pub is_one_wire: Arc<AtomicBool>,
    /// What the master has sent: the end of the stop bit, the byte.
    pub sent: Arc<Mutex<Vec<Timed>>>,
    /// Written to the transmitter, and not heard yet.
    outgoing: Arc<Mutex<VecDeque<u8>>>,
    heard: VecDeque<Timed>,
}

impl Servos {
    /// On this bus.
    pub fn new(bus: ServoBus) -> Self {
        Self {
            bus: Arc::new(Mutex::new(bus)),
            is_one_wire: Arc::default(),
            sent: Arc::default(),
            outgoing: Arc::default(),
            heard: VecDeque::new(),
        }
    }
}

impl fmt::Debug for Servos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Servos")
    }
}

impl Servos {
    /// The master has written a byte to its transmitter: it is heard from its first bit on.
    pub fn master_writes(&self, byte: u8) {
        if self.bus.lock().unwrap().has_echo() {
            self.outgoing.lock().unwrap().push_back(byte);
        }
    }

    /// What is on the wire now is known; asks for a look when the next byte of a servo's begins.
    fn look_ahead(bus: &mut ServoBus, context: &mut Timeline<'_, '_>) {
        if let Some(next) = bus.next_ns() {
            context.schedule(VirtualNanos(context.now().0.max(next - BYTE_NS)));
        }
    }
}

impl Store for Servos {}

impl Peer for Servos {
    fn receive(&mut self, word: u16, context: &mut Timeline<'_, '_>) {
        let now = context.now().0;
        self.sent.lock().unwrap().push((now, word as u8)); // 8 data bits
        let mut bus = self.bus.lock().unwrap();
        bus.send(now - BYTE_NS, &[word as u8]);
        bus.advance_to(now);
        Self::look_ahead(&mut bus, context);
    }

    /// What the transmitter still had is gone.
    fn restarted(&mut self, _: &mut Timeline<'_, '_>) {
        self.outgoing.lock().unwrap().clear();
    }

    fn on_event(&mut self, _: rigless::time::EventId, context: &mut Timeline<'_, '_>) {
        let mut bus = self.bus.lock().unwrap();
        bus.advance_to(context.now().0 + BYTE_NS);
        Self::look_ahead(&mut bus, context);
    }

    fn transmit(&mut self, now: VirtualNanos) -> Option<u16> {
        let mut bus = self.bus.lock().unwrap();
        bus.advance_to(now.0 + BYTE_NS);
        let sent = self.sent.lock().unwrap();
        let is_echo = |end: u64| sent.iter().rev().take(4).any(|byte| byte.0 == end);
        self.heard.extend(std::iter::from_fn(|| bus.receive()).filter(|&(end, _)| !is_echo(end)));
        let echo = self.outgoing.lock().unwrap().pop_front();
        let byte = echo.or_else(|| self.heard.pop_front().map(|(_, byte)| byte))?;
        self.is_one_wire.load(Ordering::Relaxed).then_some(byte.into())
    }
}
