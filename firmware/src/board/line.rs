//! The host's line: a UART, 8N1 at the image's baud, `embedded_io_async`'s `Read` and `Write`.
//!
//! Receiving is DMA into a ring that nobody has to empty in a hurry, looked at shortly before each
//! control period ([`next_look`]), or as often as [`Receiver::look_every`] says. embassy's own receivers
//! are not used, because each of their looks reads the data register, and a byte that arrives at that
//! moment is lost to the DMA. What is lost or damaged all the same is an error once, which the session
//! counts; reading goes on after it.
//! Sending is DMA by embassy's transmitter, which touches only the transmit side.

use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use embassy_stm32::Peri;
use embassy_stm32::dma;
use embassy_stm32::gpio::Pull;
use embassy_stm32::interrupt::typelevel::Binding;
use embassy_stm32::mode::Async;
use embassy_stm32::pac::dma::vals::{Dir, Size};
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::usart::{
    self, Config, Instance, InterruptHandler, RxDma, RxPin, TxDma, TxPin, Uart, UartRx, UartTx,
};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

use super::dma::{Round, Stream};
use crate::app::next_look;

/// Room for what arrives while nobody looks. At 115200 baud 256 bytes take 22 ms, and the longest
/// hold-up of the link's task is a picture's 2 ms on the display. At 1 Mbaud, the CM-5's, they take
/// 2.56 ms: a look comes after 1 ms, another 1 ms after an error (`reception::LINE_DOWN`), and the
/// only task has no picture to show; 0.5 ms are to spare. The length of a packet does not matter,
/// since a reader that finds bytes comes back for more at once.
const RING: usize = 256;

/// Written by the DMA.
static BYTES: [AtomicU8; RING] = [const { AtomicU8::new(0) }; RING];

/// The core has stood still, for longer perhaps than it takes to fill the ring more than once.
pub(super) static CORE_STOOD_STILL: AtomicBool = AtomicBool::new(false);

/// What the line is made of. The compiler checks each pin and stream against the chip.
pub struct Parts<T: Instance, Rx: RxPin<T>, Tx: TxPin<T>, RxD: RxDma<T>, TxD: TxDma<T>> {
    /// The UART.
    pub usart: Peri<'static, T>,
    /// Its registers.
    pub registers: Usart,
    /// From the host.
    pub rx: Peri<'static, Rx>,
    /// To the host.
    pub tx: Peri<'static, Tx>,
    /// Fills the ring.
    pub rx_dma: Peri<'static, RxD>,
    /// Sends.
    pub tx_dma: Peri<'static, TxD>,
}

/// Both halves of the line, receiving. `interrupts` are those of the UART and of both streams.
pub fn new<T: Instance, RxD: RxDma<T>, TxD: TxDma<T>>(
    parts: Parts<T, impl RxPin<T>, impl TxPin<T>, RxD, TxD>,
    baud: u32,
    interrupts: impl Binding<T::Interrupt, InterruptHandler<T>>
    + Binding<RxD::Interrupt, dma::InterruptHandler<RxD>>
    + Binding<TxD::Interrupt, dma::InterruptHandler<TxD>>
    + 'static,
) -> (Receiver, Sender) {
    let Parts { usart, registers, rx, tx, rx_dma, tx_dma } = parts;
    let ring = Round {
        stream: Stream::of(&rx_dma),
        request: rx_dma.request(),
        direction: Dir::PERIPHERAL_TO_MEMORY,
        width: Size::BITS8,
        register: registers.dr().as_ptr() as u32, // addresses: 32 bits
        memory: BYTES.as_ptr() as u32,
        items: RING as u16,
    };
    let mut config = Config::default(); // 8N1
    config.baudrate = baud;
    config.rx_pull = Pull::Up; // a line without a host is at rest
    let uart = Uart::new(usart, rx, tx, tx_dma, rx_dma, interrupts, config);
    let (tx, rx) = defmt::unwrap!(uart).split();
    // SAFETY: BYTES is a static of RING atomic bytes; the stream is ours through `_uart`.
    unsafe { ring.start() };
    registers.cr3().modify(|w| w.set_dmar(true));
    let stream = ring.stream;
    let receiver =
        Receiver { registers, stream, tail: 0, damaged: false, look_every: None, _uart: rx };
    (receiver, Sender(tx))
}

/// The receiving half.
pub struct Receiver {
    registers: Usart,
    /// Fills the ring.
    stream: Stream,
    /// Where the next byte is read.
    tail: usize,
    /// The error flags stand, and have been reported.
    damaged: bool,
    /// Looks at the ring so often; `None` as control needs it.
    look_every: Option<Duration>,
    /// Owns the pin, the UART and the stream.
    _uart: UartRx<'static, Async>,
}

impl Receiver {
    /// From now on looks so often for what has come.
    pub fn look_every(&mut self, period: Duration) {
        self.look_every = Some(period);
    }

    fn next_look(&self) -> Instant {
        let now = Instant::now();
        self.look_every.map_or_else(|| next_look(now), |period| now + period)
    }

    /// Takes what has arrived. Errors are noise, a framing error or a byte that the DMA was too
    /// late for, and a ring that was full: what was in it is dropped.
    fn take(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        // Reading the status alone clears nothing; the DMA's next reading of the data does.
        let status = self.registers.sr().read();
        let damaged = status.fe() || status.ne() || status.ore();
        if damaged && !core::mem::replace(&mut self.damaged, damaged) {
            return Err(ErrorKind::InvalidData);
        }
        self.damaged = damaged;
        // The flag first: if the DMA comes round in between, the flag stays for the next look,
        // which then finds the head behind the tail.
        let came_round = self.stream.came_round();
        let head = (RING - usize::from(self.stream.remaining())) % RING;
        // How often, the flag does not tell: once, if the ring is looked at as it should be.
        let often = came_round && CORE_STOOD_STILL.load(Ordering::Relaxed);
        CORE_STOOD_STILL.store(false, Ordering::Relaxed);
        if head < self.tail && !often {
            self.stream.clear_flags();
        } else if came_round {
            self.stream.clear_flags();
            self.tail = head;
            return Err(ErrorKind::OutOfMemory);
        }
        let mut count = 0;
        for byte in buffer {
            if self.tail == head {
                break;
            }
            *byte = BYTES[self.tail].load(Ordering::Relaxed);
            self.tail = (self.tail + 1) % RING;
            count += 1;
        }
        Ok(count)
    }
}

impl ErrorType for Receiver {
    type Error = ErrorKind;
}

impl Read for Receiver {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        loop {
            match self.take(buffer)? {
                0 => Timer::at(self.next_look()).await,
                count => return Ok(count),
            }
        }
    }
}

/// The sending half.
pub struct Sender(UartTx<'static, Async>);

impl ErrorType for Sender {
    type Error = usart::Error;
}

impl Write for Sender {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, usart::Error> {
        self.0.write(frame).await?;
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), usart::Error> {
        self.0.flush().await
    }
}
