//! The board at work: the firmware's own tasks, control on an interrupt executor above the link's,
//! as in the board's image, with the line silent and with it full. Only the ends differ: the
//! motors' and the line's.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering::Relaxed};

use cortex_m_semihosting::hprintln;
use embassy_executor::SendSpawner;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Instant, Timer};
use embedded_io_async::{ErrorType, Read};
use firmware::app;
use firmware::controller::Controller;
use firmware::personality::Boot;
use firmware::personality::pms5005::{LinkCounters, Pms5005};
use firmware::ports::{MotionInputs, MotionPort, Outputs};
use firmware::settings::Settings;
use protocol::pms5005::{Frame, RID_PMS5005, did};
use static_cell::StaticCell;

use crate::line::{BYTE, LOOK_PERIOD, Paced, Ring};
use crate::machine::{TICKS_PER_US, ticks};
use crate::span::{ALARM, Span};
use crate::token;

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

/// From the alarm's interrupt to control's reading of its inputs, with the line saturated.
static WAKE: Span = Span::new();
/// When control read its inputs, against a period of exactly 1 ms since the first time: the
/// earliest and the latest, in ticks.
static EARLIEST: AtomicI32 = AtomicI32::new(0);
static LATEST: AtomicI32 = AtomicI32::new(0);
/// Control periods so far.
static PERIODS: AtomicU32 = AtomicU32::new(0);
/// The host sends as much as the line carries.
static SATURATED: AtomicBool = AtomicBool::new(false);

static CHANNELS: StaticCell<Channels> = StaticCell::new();
static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static SESSION: StaticCell<Pms5005> = StaticCell::new();

/// All cases.
pub fn cases(control: SendSpawner, link: SendSpawner) {
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
    let interrupt = ALARM.longest();
    let counters = channels.link.get();
    let owed = counters.frames_for_us - counters.acks_sent;
    // A frame comes every 1.0 ms; the longest telemetry frame holds up the answers for 4.3 ms.
    assert!(owed <= 6 && counters.acks_dropped == 0, "acknowledgements were lost: {counters:?}");
    assert_eq!((counters.bytes_skipped, counters.line_errors), (0, 0), "bytes were lost");
    let missed = channels.snapshot.get().counters.periods_missed;
    assert!(missed == 0 && jitter < PERIOD as i32, "a control period was missed");
    WAKE.tell("wake-control/saturated", 1);
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
        if SATURATED.load(Relaxed) {
            WAKE.add(ALARM.lasts());
        }
        PERIODS.store(PERIODS.load(Relaxed) + 1, Relaxed);
        MotionInputs::default()
    }

    fn drive(&mut self, _outputs: &Outputs) {}
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
            self.ring.put(self.frame[self.at]);
            self.at = (self.at + 1) % self.frame.len();
        }
    }
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
