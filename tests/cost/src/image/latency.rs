//! From an interrupt to what it is for: a task that wakes, bytes in a task's hands, an answer.

use core::convert::Infallible;

use cortex_m::peripheral::NVIC;
use embassy_executor::SendSpawner;
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use firmware::app;
use firmware::personality::Boot;
use firmware::personality::pms5005::Pms5005;
use firmware::settings::Settings;
use protocol::pms5005::{Frame, RID_PMS5005, did};

use crate::line::{LOOK_PERIOD, Ring};
use crate::machine::Interrupt;
use crate::span::{ALARM, Span};
use crate::token;

/// How often a latency is measured.
const ROUNDS: u32 = 1000;

static LATENCY: Span = Span::new();
static BELL: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static PIPE: Pipe<CriticalSectionRawMutex, 256> = Pipe::new();
/// The task of a latency's measurement is to end.
static END: Signal<CriticalSectionRawMutex, ()> = Signal::new();

/// Something has happened that a task waits for.
pub unsafe extern "C" fn on_bell() {
    LATENCY.begin();
    BELL.signal(());
}

/// A byte has come, and is given to a task at once.
pub unsafe extern "C" fn on_byte() {
    LATENCY.begin();
    let _ = PIPE.try_write(&[0x55]); // the task has emptied it
}

/// All cases.
pub fn cases(link: SendSpawner) {
    link.spawn(token(wakes()));
    ring(Interrupt::Bell, ROUNDS);
    LATENCY.tell("wake/executor", 1);
    over();

    link.spawn(token(takes_bytes()));
    ring(Interrupt::Byte, ROUNDS);
    LATENCY.tell("byte-path/interrupt-a-byte", 1);
    over();

    link.spawn(token(looks()));
    while LATENCY.count() < ROUNDS {
        core::hint::spin_loop();
    }
    LATENCY.tell("byte-path/ours", BYTES_A_LOOK);
    over();

    link.spawn(token(answers()));
    // Every frame comes in two pieces, and the first frame stops the telemetry.
    ring(Interrupt::Bell, 2);
    LATENCY.reset();
    ring(Interrupt::Bell, 2 * ROUNDS);
    LATENCY.tell("answer/ours", 1);
    over();
}

/// Requests an interrupt so many times. Everything that it entails is done before the next.
fn ring(interrupt: Interrupt, times: u32) {
    for _ in 0..times {
        NVIC::pend(interrupt);
        cortex_m::asm::isb();
    }
}

/// Ends the task of a phase.
fn over() {
    END.signal(());
}

/// A task that waits for the bell: the least that an interrupt can cause.
#[embassy_executor::task]
async fn wakes() {
    let ringing = async {
        loop {
            BELL.wait().await;
            LATENCY.end();
        }
    };
    select(ringing, END.wait()).await;
}

/// A task that is given every byte by an interrupt.
#[embassy_executor::task]
async fn takes_bytes() {
    let taking = async {
        let mut buffer = [0; 64];
        loop {
            PIPE.read(&mut buffer).await;
            LATENCY.end();
        }
    };
    select(taking, END.wait()).await;
}

/// What a look takes at 115200 baud.
const BYTES_A_LOOK: u32 = 12;

/// A task that looks into the ring, as the board's does: from the alarm until it has the bytes.
#[embassy_executor::task]
async fn looks() {
    let looking = async {
        let mut ring = Ring::new();
        let mut buffer = [0; 64];
        loop {
            Timer::after(LOOK_PERIOD).await;
            ring.advance(BYTES_A_LOOK as usize);
            ring.take(&mut buffer);
            LATENCY.add(ALARM.lasts());
        }
    };
    select(looking, END.wait()).await;
}

/// A link whose host sends pings in two pieces, at the bell.
#[embassy_executor::task]
async fn answers() {
    let (mut rx, mut tx) = (Pieces::new(), Acknowledged);
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::now());
    let channels = app::Channels::<CriticalSectionRawMutex, _>::new();
    let link = app::link(&mut rx, &mut tx, &mut session, &channels);
    select(link, END.wait()).await;
}

/// The receiving end of a line that brings a piece of a frame a ring of the bell: all but the last
/// byte, then that.
struct Pieces {
    /// Stops the telemetry; after it come pings.
    frame: [u8; 10],
    ping: [u8; 10],
    first: bool,
}

impl Pieces {
    fn new() -> Self {
        let frame = |did| {
            let mut frame = [0; 10];
            let _ = Frame { rid: RID_PMS5005, res: 0, did, data: &[0] }.encode(&mut frame);
            frame
        };
        Self { frame: frame(did::ALL_REPORTS), ping: frame(did::SETUP), first: true }
    }
}

impl ErrorType for Pieces {
    type Error = Infallible;
}

impl Read for Pieces {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        BELL.wait().await;
        let (before, last) = self.frame.split_at(9);
        let piece = if self.first { before } else { last };
        buffer[..piece.len()].copy_from_slice(piece);
        let count = piece.len();
        if !self.first {
            self.frame = self.ping;
        }
        self.first = !self.first;
        Ok(count)
    }
}

/// The sending end that sees the first byte of an acknowledgement.
struct Acknowledged;

impl ErrorType for Acknowledged {
    type Error = Infallible;
}

impl Write for Acknowledged {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        LATENCY.end();
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
