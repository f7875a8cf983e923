//! The cases that need interrupts and executors: the firmware's own tasks, control on an interrupt
//! executor above the link's, as in the board's image. Only the ends differ: the motors' and the
//! line's.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering::Relaxed};

use cortex_m::peripheral::NVIC;
use cortex_m_semihosting::hprintln;
use embassy_executor::{InterruptExecutor, SpawnError, SpawnToken};
use embassy_futures::select::select;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use firmware::app;
use firmware::controller::Controller;
use firmware::personality::pms5005::{Boot, LinkCounters, Pms5005};
use firmware::ports::{MotionInputs, MotionPort, Outputs};
use firmware::settings::Settings;
use protocol::pms5005::{Frame, RID_PMS5005, did};
use static_cell::StaticCell;

use crate::machine::{Interrupt, TICKS_PER_US, ticks};

type Channels = app::Channels<CriticalSectionRawMutex, LinkCounters>;

unsafe extern "C" {
    /// See [`phase`].
    #[link_name = "phase"]
    static PHASE: u32;
}

/// By how many ticks the host's line is late: what QEMU was told to put there, or 0.
fn phase() -> u32 {
    // SAFETY: the linker script keeps the word for this, and nobody writes it.
    unsafe { (&raw const PHASE).read_volatile() }
}

/// Ticks of a control period, 1 ms.
const PERIOD: u32 = 1000 * TICKS_PER_US;
/// Control periods with the line silent, and with it saturated.
const SILENT_PERIODS: u32 = 5_000;
const SATURATED_PERIODS: u32 = 50_000;
/// How often a latency is measured.
const ROUNDS: u32 = 1000;

/// Time between two places in the program, added up.
pub struct Span {
    began: AtomicU32,
    sum: AtomicU32,
    count: AtomicU32,
    longest: AtomicU32,
}

impl Span {
    const fn new() -> Self {
        Self {
            began: AtomicU32::new(0),
            sum: AtomicU32::new(0),
            count: AtomicU32::new(0),
            longest: AtomicU32::new(0),
        }
    }

    pub fn begin(&self) {
        self.began.store(ticks(), Relaxed);
    }

    pub fn end(&self) {
        self.add(ticks().wrapping_sub(self.began.load(Relaxed)));
    }

    fn add(&self, ticks: u32) {
        self.sum.store(self.sum.load(Relaxed) + ticks, Relaxed);
        self.count.store(self.count.load(Relaxed) + 1, Relaxed);
        self.longest.store(self.longest.load(Relaxed).max(ticks), Relaxed);
    }

    fn reset(&self) {
        self.sum.store(0, Relaxed);
        self.count.store(0, Relaxed);
    }

    /// Says the mean since the last time, as a case.
    fn tell(&self, name: &str, units: u32) {
        hprintln!("{} {} {} {}", name, self.sum.load(Relaxed), self.count.load(Relaxed), units);
        self.reset();
    }
}

/// The interrupt of embassy's timers, which is above control.
pub static ALARM: Span = Span::new();
/// From an interrupt to what it is for.
static LATENCY: Span = Span::new();
/// When control read its inputs, against a period of exactly 1 ms since the first time: the
/// earliest and the latest, in ticks.
static EARLIEST: AtomicI32 = AtomicI32::new(0);
static LATEST: AtomicI32 = AtomicI32::new(0);
/// Control periods so far.
static PERIODS: AtomicU32 = AtomicU32::new(0);
/// The host sends as much as the line carries.
static SATURATED: AtomicBool = AtomicBool::new(false);

static CONTROL: InterruptExecutor = InterruptExecutor::new();
static LINK: InterruptExecutor = InterruptExecutor::new();
static BELL: Signal<CriticalSectionRawMutex, ()> = Signal::new();
static PIPE: Pipe<CriticalSectionRawMutex, 256> = Pipe::new();
/// The task of a latency's measurement is to end.
static END: Signal<CriticalSectionRawMutex, ()> = Signal::new();

static CHANNELS: StaticCell<Channels> = StaticCell::new();
static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static SESSION: StaticCell<Pms5005> = StaticCell::new();

pub unsafe extern "C" fn on_control() {
    // SAFETY: this is the interrupt that CONTROL was started with.
    unsafe { CONTROL.on_interrupt() }
}

pub unsafe extern "C" fn on_link() {
    // SAFETY: this is the interrupt that LINK was started with.
    unsafe { LINK.on_interrupt() }
}

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
pub fn cases() {
    let control = CONTROL.start(Interrupt::Control);
    let link = LINK.start(Interrupt::Link);

    link.spawn(token(wakes()));
    ring(Interrupt::Bell, ROUNDS);
    LATENCY.tell("wake/executor", 1);
    over();

    link.spawn(token(takes_bytes()));
    ring(Interrupt::Byte, ROUNDS);
    LATENCY.tell("byte-path/interrupt-a-byte", 1);
    over();

    link.spawn(token(looks()));
    while LATENCY.count.load(Relaxed) < ROUNDS {
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

    let trial = trial();
    let channels = &*CHANNELS.init_with(Channels::new);
    let controller = CONTROLLER.init_with(|| Controller::new(Settings::DEFAULT.control));
    let session =
        SESSION.init_with(|| Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::now()));
    control.spawn(token(controls(controller, channels)));
    link.spawn(token(links(session, channels)));
    let silent = run(SILENT_PERIODS, trial);
    SATURATED.store(true, Relaxed);
    let saturated = run(SATURATED_PERIODS, trial);
    // Nothing is said before all is known: semihosting keeps interrupts off while it writes.
    let jitter = LATEST.load(Relaxed) - EARLIEST.load(Relaxed);
    let interrupt = ALARM.longest.load(Relaxed);
    let counters = channels.link.get();
    let owed = counters.frames_for_us - counters.acks_sent;
    // A frame comes every 1.0 ms; the longest telemetry frame holds up the answers for 4.3 ms.
    assert!(owed <= 6 && counters.acks_dropped == 0, "acknowledgements were lost: {counters:?}");
    assert_eq!((counters.bytes_skipped, counters.line_errors), (0, 0), "bytes were lost");
    let missed = channels.snapshot.get().counters.periods_missed;
    assert!(missed == 0 && jitter < PERIOD as i32, "a control period was missed");
    hprintln!("live-silent/ours {} {} 1", silent, SILENT_PERIODS);
    hprintln!("live-saturated/ours {} {} 1", saturated, SATURATED_PERIODS);
    hprintln!("jitter/ours {} 1 1", jitter);
    hprintln!("jitter/longest-interrupt-above {} 1 1", interrupt);
}

/// Turns that the cost of a turn is measured by.
const TRIAL: u32 = 10_000;

/// The ticks of [`TRIAL`] turns of an idle machine.
fn trial() -> u32 {
    let began = ticks();
    idle(u32::MAX, TRIAL);
    ticks().wrapping_sub(began)
}

/// Lets the tasks run for so many control periods, and answers for how many ticks they were busy.
fn run(periods: u32, trial: u32) -> u32 {
    let last = PERIODS.load(Relaxed) + periods;
    let began = ticks();
    let idle = u64::from(idle(last, u32::MAX)) * u64::from(trial) / u64::from(TRIAL);
    ticks().wrapping_sub(began) - idle as u32 // less than the whole, which fits
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
            ring.head += BYTES_A_LOOK as usize;
            ring.take(&mut buffer);
            LATENCY.add(ticks().wrapping_sub(ALARM.began.load(Relaxed)));
        }
    };
    select(looking, END.wait()).await;
}

/// A link whose host sends pings in two pieces, at the bell.
#[embassy_executor::task]
async fn answers() {
    let (mut rx, mut tx) = (Pieces::new(), Acknowledged);
    let mut session = Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::now());
    let channels = Channels::new();
    let link = app::link(&mut rx, &mut tx, &mut session, &channels);
    select(link, END.wait()).await;
}

#[embassy_executor::task]
async fn controls(controller: &'static mut Controller, channels: &'static Channels) {
    app::control(&mut Motors { due: None }, controller, channels).await;
}

#[embassy_executor::task]
async fn links(session: &'static mut Pms5005, channels: &'static Channels) {
    let mut frame = [0; 12];
    let servo = Frame { rid: RID_PMS5005, res: 0, did: did::SERVO, data: &[2, 0xB8, 0x0B] };
    let _ = servo.encode(&mut frame);
    let mut rx = Host { ring: Ring::new(), frame, at: 0, byte_at: None };
    app::link(&mut rx, &mut Paced, session, channels).await;
}

/// The motors: still, and with an eye on the clock.
struct Motors {
    due: Option<u32>,
}

impl MotionPort for Motors {
    fn sample(&mut self) -> MotionInputs {
        let now = ticks();
        let late = now.wrapping_sub(*self.due.get_or_insert(now)) as i32; // either sign
        self.due = self.due.map(|due| due.wrapping_add(PERIOD));
        EARLIEST.store(EARLIEST.load(Relaxed).min(late), Relaxed);
        LATEST.store(LATEST.load(Relaxed).max(late), Relaxed);
        PERIODS.store(PERIODS.load(Relaxed) + 1, Relaxed);
        MotionInputs::default()
    }

    fn drive(&mut self, _outputs: &Outputs) {}
}

/// How often the board looks into its ring (firmware/src/board/line.rs).
const LOOK_PERIOD: Duration = Duration::from_millis(1);
/// Ticks of a byte at 115200 baud.
const BYTE: u32 = 25_000_000 / 11_520;

/// The ring that the board's DMA fills, and its reader's loop.
struct Ring {
    bytes: [u8; 256],
    head: usize,
    tail: usize,
}

impl Ring {
    fn new() -> Self {
        Self { bytes: [0x55; 256], head: 0, tail: 0 }
    }

    fn take(&mut self, buffer: &mut [u8]) -> usize {
        let head = self.head % self.bytes.len();
        let mut count = 0;
        for byte in buffer {
            if self.tail == head {
                break;
            }
            *byte = self.bytes[self.tail];
            self.tail = (self.tail + 1) % self.bytes.len();
            count += 1;
        }
        count
    }
}

/// The receiving end of a line whose host sends a typical frame, which asks for an
/// acknowledgement, over and over.
struct Host {
    ring: Ring,
    frame: [u8; 12],
    /// What of the frame comes next.
    at: usize,
    /// When the last byte came.
    byte_at: Option<u32>,
}

impl ErrorType for Host {
    type Error = Infallible;
}

impl Read for Host {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        loop {
            if SATURATED.load(Relaxed) {
                self.fill();
            }
            match self.ring.take(buffer) {
                0 => Timer::after(LOOK_PERIOD).await,
                count => return Ok(count),
            }
        }
    }
}

impl Host {
    /// What the DMA would have done since the last time. It costs some instructions a byte.
    fn fill(&mut self) {
        let since = self.byte_at.get_or_insert_with(|| ticks().wrapping_add(phase()));
        // The first byte is still to come, and then nothing has.
        let bytes = (ticks().wrapping_sub(*since) as i32).max(0) as u32 / BYTE;
        *since = since.wrapping_add(bytes * BYTE);
        for _ in 0..bytes {
            let place = self.ring.head % self.ring.bytes.len();
            self.ring.bytes[place] = self.frame[self.at];
            self.ring.head += 1;
            self.at = (self.at + 1) % self.frame.len();
        }
    }
}

/// The sending end: a frame takes its time.
struct Paced;

impl ErrorType for Paced {
    type Error = Infallible;
}

impl Write for Paced {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        Timer::after(Duration::from_ticks((frame.len() as u32 * BYTE / TICKS_PER_US).into())).await;
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
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

fn token<S>(token: Result<SpawnToken<S>, SpawnError>) -> SpawnToken<S> {
    token.unwrap_or_else(|_| panic!("a task is spawned twice"))
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

/// Turns round until there have been so many control periods, or so many turns; answers the turns.
///
/// It does not sleep: QEMU moves the time of a sleeping machine in another thread, and two runs
/// then differ. Every turn costs the same, so the turns tell how long nobody else had work.
#[inline(never)]
fn idle(until_period: u32, turns: u32) -> u32 {
    let mut turned = 0;
    while turned < turns && PERIODS.load(Relaxed) < until_period {
        turned += 1;
    }
    turned
}
