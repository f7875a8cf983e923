//! The servo bus: one wire, half duplex, 1 Mbaud 8N1, `embedded_io_async`'s `Read` and `Write`.
//!
//! Vocabulary: the *wire* is the UART's TX pin, open drain, which the UART releases when it is not
//! sending, and listens to all the time, also to itself: the *echo*. The *direction* line is high
//! from before the first start bit until the last stop bit has left (TC), for a buffer between wire
//! and bus; a bus that is on the wire itself does without. So one image serves both, and hears
//! its echo with both (README.md beside this file has the two wirings).
//!
//! Promises, shown on the modelled chip (`tests/chip/tests/cm5.rs`, `bus.rs`):
//! - A write returns when there is room for its bytes, which leave without a pause behind those before; the
//!   direction changes, and a flush is complete, at the TC behind the last of them. The receiver is never
//!   switched off, so a servo may answer at once.
//! - A reader is woken by every byte, and the bus waits for no pause to tell that an answer is
//!   complete. Nobody else reads the data register, and nobody ever writes the status register, so
//!   no byte is lost to a race (`line` says how that happens).
//! - A byte lost all the same is an error once. One that was damaged is handed over as it was
//!   read: echo and checksum judge it, and an error would cost the bus a millisecond.
//!
//! Deadlines: the interrupt comes twice in 10 us at the most, with some 120 instructions each, 1 us
//! out of the flash's cache and twice that past it, and must come within 10 us of a byte or the next one
//! is lost. In its way are embassy's clock and the PC's line, an estimated 2 us (3 past the
//! cache). As much later than TC may the direction change; a servo with a
//! return delay of 1 answers 2 us after TC, but a real AX-12 takes 22 us more (facts).

use core::sync::atomic::{AtomicBool, Ordering};

use embassy_stm32::Peri;
use embassy_stm32::gpio::{AnyPin, Speed};
use embassy_stm32::interrupt::typelevel::Interrupt;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::usart::{
    Config, HalfDuplexReadback, Instance, OutputConfig, TxPin, Uart, UartRx, UartTx,
};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use super::drives::Lines;
use crate::bridge::MAX_INSTRUCTION;

/// The servos' (AX-12, register 4 at 1).
const BAUD: u32 = 1_000_000;

/// Room for what is heard while the bridge is busy: the longest instruction, whose echo is read when
/// all of it has left, and an answer, 157 bytes in all.
const RING: usize = 256;

/// What the interrupt and both halves of a bus share. A board has one, a static.
pub struct Bus {
    registers: Usart,
    /// One line.
    direction: Lines,
    heard: Pipe<CriticalSectionRawMutex, RING>,
    /// Something was heard that is not there.
    lost: AtomicBool,
    outgoing: Pipe<CriticalSectionRawMutex, MAX_INSTRUCTION>,
    sent: Signal<CriticalSectionRawMutex, ()>,
}

impl Bus {
    /// On this UART, with this direction line.
    pub const fn new(registers: Usart, direction: Lines) -> Self {
        Self {
            registers,
            direction,
            heard: Pipe::new(),
            lost: AtomicBool::new(false),
            outgoing: Pipe::new(),
            sent: Signal::new(),
        }
    }

    /// Both halves, receiving. `usart` is the UART of `new`, whose interrupt must end in
    /// [`on_interrupt`](Self::on_interrupt), and `direction` its line.
    ///
    /// # Panics
    /// If `direction` is another line.
    pub fn start<T: Instance>(
        &'static self,
        usart: Peri<'static, T>,
        wire: Peri<'static, impl TxPin<T>>,
        direction: Peri<'static, AnyPin>,
    ) -> (Receiver, Sender) {
        self.direction.claim([direction], Speed::Medium);
        let mut config = Config::default();
        config.baudrate = BAUD;
        config.tx_config = OutputConfig::OpenDrain;
        let readback = HalfDuplexReadback::Readback;
        let uart = Uart::new_blocking_half_duplex(usart, wire, config, readback);
        let (tx, rx) = defmt::unwrap!(uart).split();
        self.registers.cr1().modify(|w| {
            w.set_te(true);
            w.set_re(true);
            w.set_rxneie(true);
        });
        // SAFETY: nobody relies on the interrupt being masked: what it shares with the halves is
        // atomic or behind a critical section.
        unsafe { T::Interrupt::enable() };
        (Receiver { bus: self, _uart: rx }, Sender { bus: self, _uart: tx })
    }

    /// Does what the UART asks for. Status first, then data: that order clears the flags
    /// (RM0090 30.6.1).
    pub fn on_interrupt(&self) {
        let status = self.registers.sr().read();
        if status.rxne() || status.ore() {
            let byte = self.registers.dr().read().dr() as u8; // 8 data bits
            let is_full = status.rxne() && self.heard.try_write(&[byte]).is_err();
            if is_full || status.ore() {
                self.lost.store(true, Ordering::Relaxed);
            }
        }
        let enabled = self.registers.cr1().read();
        if enabled.txeie() && status.txe() {
            let mut byte = [0];
            if self.outgoing.try_read(&mut byte).is_ok() {
                self.registers.dr().write(|w| w.set_dr(byte[0].into()));
            } else {
                self.registers.cr1().modify(|w| {
                    w.set_txeie(false);
                    w.set_tcie(true);
                });
            }
        } else if enabled.tcie() && status.tc() {
            self.direction.write(0);
            self.registers.cr1().modify(|w| w.set_tcie(false));
            self.sent.signal(());
        }
    }

    /// Sends an instruction's first byte, if the bus is free; whether it was. So no interrupt stands before it,
    /// and what follows it is wanted 10 us later. Status first, then data, clears the TC of the last time.
    fn begin(&self, first: u8) -> bool {
        critical_section::with(|_| {
            if self.is_sending() {
                return false;
            }
            self.direction.write(1);
            let _ = self.registers.sr().read();
            self.registers.dr().write(|w| w.set_dr(first.into()));
            true
        })
    }

    /// Goes on with what is in `outgoing`. What waits for the last stop bit waits for the new one.
    fn go_on(&self, has_begun: bool) {
        critical_section::with(|_| {
            if !has_begun && self.outgoing.is_empty() {
                return; // it has left already, behind what was being sent
            }
            self.direction.write(1);
            self.registers.cr1().modify(|w| {
                w.set_txeie(true);
                w.set_tcie(false);
            });
        });
    }

    /// Whether the last stop bit has still to leave.
    fn is_sending(&self) -> bool {
        let enabled = self.registers.cr1().read();
        enabled.txeie() || enabled.tcie()
    }
}

/// Hears the bus.
pub struct Receiver {
    bus: &'static Bus,
    /// Owns the UART.
    _uart: UartRx<'static, Blocking>,
}

impl ErrorType for Receiver {
    type Error = ErrorKind;
}

impl Read for Receiver {
    /// An error: bytes were heard that nobody can have any more, and those before them are dropped.
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        if self.bus.lost.swap(false, Ordering::Relaxed) {
            self.bus.heard.clear();
            return Err(ErrorKind::Other);
        }
        Ok(self.bus.heard.read(buffer).await)
    }
}

/// Sends on the bus.
pub struct Sender {
    bus: &'static Bus,
    /// Owns the UART and its pin.
    _uart: UartTx<'static, Blocking>,
}

impl ErrorType for Sender {
    type Error = core::convert::Infallible;
}

impl Write for Sender {
    /// Waits for room for a byte at least; there is room for [`MAX_INSTRUCTION`].
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        let Some((&first, rest)) = bytes.split_first() else { return Ok(0) };
        let has_begun = self.bus.begin(first);
        let count = if has_begun {
            1 + self.bus.outgoing.try_write(rest).unwrap_or(0) // it is empty: there is room
        } else {
            self.bus.outgoing.write(bytes).await
        };
        self.bus.go_on(has_begun);
        Ok(count)
    }

    /// Waits until the last stop bit has left.
    async fn flush(&mut self) -> Result<(), Self::Error> {
        while self.bus.is_sending() {
            self.bus.sent.wait().await;
        }
        Ok(())
    }
}
