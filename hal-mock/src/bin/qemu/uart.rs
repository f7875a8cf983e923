//! The host's line and the trace on the registers of two USARTs (RM0090 section 30.6).
//!
//! Received bytes go into a ring by interrupt; sending is polled. Neither clocks, pins nor bit
//! rates are set up: QEMU asks for none of them. While the ring is full the interrupt is masked,
//! and QEMU keeps what the host sends until there is room, so that no byte is ever lost.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::fmt;
use core::future::poll_fn;
use core::task::Poll;

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::waitqueue::WakerRegistration;
use embedded_io_async::{ErrorType, Read, Write};

/// A USART, by its address.
#[derive(Clone, Copy)]
pub struct Usart(usize);

/// USART1: the line to the host.
pub const HOST: Usart = Usart(0x4001_1000);
/// USART2: the trace.
pub const TRACE: Usart = Usart(0x4000_4400);

/// The host line's interrupt.
pub const INTERRUPT: i16 = 37;

/// Offsets of the registers.
const SR: usize = 0x00;
const DR: usize = 0x04;
const CR1: usize = 0x0C;

/// SR: there is a byte to read; there is room for a byte to send.
const RXNE: u32 = 1 << 5;
const TXE: u32 = 1 << 7;
/// CR1: on, with interrupts for received bytes, sending, receiving.
const UE_RXNEIE_TE_RE: u32 = 1 << 13 | 1 << 5 | 1 << 3 | 1 << 2;

impl Usart {
    fn read(self, offset: usize) -> u32 {
        // SAFETY: an aligned register of a USART, of which only this file knows the addresses.
        unsafe { ((self.0 + offset) as *const u32).read_volatile() }
    }

    fn write(self, offset: usize, value: u32) {
        // SAFETY: as above; none of these registers reaches memory.
        unsafe { ((self.0 + offset) as *mut u32).write_volatile(value) }
    }

    /// Switches it on.
    pub fn start(self) {
        self.write(CR1, UE_RXNEIE_TE_RE);
    }

    fn send(self, bytes: &[u8]) {
        for &byte in bytes {
            while self.read(SR) & TXE == 0 {}
            self.write(DR, byte.into());
        }
    }
}

impl fmt::Write for Usart {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.send(text.as_bytes());
        Ok(())
    }
}

/// What has been received and not been read. A millisecond brings 11.5 bytes at 115200 baud; a host
/// that is faster waits.
static RECEIVED: Pipe<CriticalSectionRawMutex, 16> = Pipe::new();

#[derive(Clone, Copy)]
struct HostInterrupt;

// SAFETY: it is USART1's number, and there is no other type with it.
unsafe impl InterruptNumber for HostInterrupt {
    fn number(self) -> u16 {
        INTERRUPT.unsigned_abs()
    }
}

/// Lets the host's bytes come.
pub fn listen() {
    // SAFETY: the handler shares nothing with the program but the ring, which is made for it.
    unsafe { NVIC::unmask(HostInterrupt) }
}

/// The interrupt's work.
pub fn receive() {
    while HOST.read(SR) & RXNE != 0 {
        if RECEIVED.is_full() {
            return NVIC::mask(HostInterrupt);
        }
        let byte = HOST.read(DR) as u8; // 8 data bits
        let _ = RECEIVED.try_write(&[byte]); // there is room
    }
}

/// The line, from the board's side. A byte that has been received is in the ring; the board has it
/// only when it has been handed over, at a time that is known.
#[derive(Default)]
pub struct Line {
    /// Bytes of the ring that the board may read.
    handed_over: Cell<usize>,
    reader: RefCell<WakerRegistration>,
}

impl Line {
    /// Hands over what has been received, and says how many bytes that is.
    pub fn hand_over(&self) -> usize {
        let received = RECEIVED.len();
        let count = received - self.handed_over.replace(received);
        if count > 0 {
            self.reader.borrow_mut().wake();
        }
        count
    }

    /// The board's end.
    pub fn board_end(&self) -> (Receiver<'_>, Sender) {
        (Receiver(self), Sender)
    }
}

/// The board's receiver.
pub struct Receiver<'a>(&'a Line);

impl ErrorType for Receiver<'_> {
    type Error = Infallible;
}

impl Read for Receiver<'_> {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        let line = self.0;
        poll_fn(|context| {
            if line.handed_over.get() > 0 {
                return Poll::Ready(());
            }
            line.reader.borrow_mut().register(context.waker());
            Poll::Pending
        })
        .await;
        let wanted = buffer.len().min(line.handed_over.get());
        let mut count = 0;
        // The ring gives what is contiguous in it.
        while let Ok(more @ 1..) = RECEIVED.try_read(&mut buffer[count..wanted]) {
            count += more;
        }
        line.handed_over.set(line.handed_over.get() - count);
        listen();
        Ok(count)
    }
}

/// The board's transmitter.
pub struct Sender;

impl ErrorType for Sender {
    type Error = Infallible;
}

impl Write for Sender {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        HOST.send(frame);
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
