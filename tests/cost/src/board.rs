//! The board at work: the firmware's own tasks, control on an interrupt executor above the link's,
//! as in the board's image. Only the ends differ: the motors, the line and its host.
//!
//! The host sends servo commands of 12 bytes that ask for an acknowledgement, first as many as the
//! line carries, then each behind the acknowledgement of the one before. The machine does 15.6
//! million instructions a second, a tenth of the board's: times are longer here than there.

use core::cell::RefCell;
use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering::Relaxed};

use cortex_m_semihosting::hprintln;
use embassy_executor::SendSpawner;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use firmware::app;
use firmware::controller::Controller;
use firmware::personality::Boot;
use firmware::personality::pms5005::{LinkCounters, Pms5005};
use firmware::ports::{LcdPort, MotionInputs, MotionPort, Outputs, SensorPort, Sensors};
use firmware::recorder::{Recorder, Row};
use firmware::settings::Settings;
use protocol::pms5005::{ACK, Frame, RID_PMS5005, did};
use static_cell::{ConstStaticCell, StaticCell};

use crate::machine::{LONGEST_ALARM, TICKS_PER_US, ticks};

type Channels = app::Channels<CriticalSectionRawMutex, LinkCounters>;
type SharedRecorder = app::SharedRecorder<CriticalSectionRawMutex, &'static mut [Row; 64]>;

unsafe extern "C" {
    /// By how many ticks the host's line is late: what QEMU was told to put there, or 0.
    #[link_name = "phase"]
    static PHASE: u32;
}

fn phase() -> u32 {
    // SAFETY: the linker script keeps the word for this, and nobody writes it.
    unsafe { (&raw const PHASE).read_volatile() }
}

/// Ticks of a control period, 1 ms.
const PERIOD: u32 = 1000 * TICKS_PER_US;
/// Ticks of a byte at 115200 baud.
const BYTE: u32 = 25_000_000 / 11_520;

/// Control periods with the line saturated, and with a host that waits.
const SATURATED_PERIODS: u32 = 50_000;
const WAITING_PERIODS: u32 = 5_000;
/// Until telemetry is off and the answers to a saturated line are all sent.
const SETTLING_PERIODS: u32 = 50;

/// The servo that is commanded, its first pulse, and how many pulses take turns: by the pulse that
/// comes out one sees which command it was.
const SERVO: u8 = 2;
const FIRST_PULSE: u16 = 3000;
const PULSES: usize = 16;

/// When control read its inputs, against a period of exactly 1 ms since the first time: the
/// earliest and the latest, in ticks.
static EARLIEST: AtomicI32 = AtomicI32::new(0);
static LATEST: AtomicI32 = AtomicI32::new(0);
/// Control periods so far.
static PERIODS: AtomicU32 = AtomicU32::new(0);
/// The host waits for every acknowledgement.
static WAITS: AtomicBool = AtomicBool::new(false);
/// Commands sent, and acknowledged; when the last acknowledgement has left.
static SENT: AtomicU32 = AtomicU32::new(0);
static ACKNOWLEDGED: AtomicU32 = AtomicU32::new(0);
static ACK_LEFT: AtomicU32 = AtomicU32::new(0);
/// When the last byte of the command with each pulse came.
static CAME: [AtomicU32; PULSES] = [const { AtomicU32::new(0) }; PULSES];
/// The longest from there to the compare register, in ticks.
static LATENCY: AtomicU32 = AtomicU32::new(0);

static CHANNELS: StaticCell<Channels> = StaticCell::new();
static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static SESSION: StaticCell<Pms5005> = StaticCell::new();
static RECORDER: StaticCell<SharedRecorder> = StaticCell::new();
static ROWS: ConstStaticCell<[Row; 64]> = ConstStaticCell::new([Row::ZERO; 64]);

/// All figures of the board.
pub fn measure(control: SendSpawner, link: SendSpawner) {
    let began = ticks();
    idle(u32::MAX, TRIAL);
    let trial = ticks().wrapping_sub(began);
    let channels = &*CHANNELS.init_with(Channels::new);
    let controller = CONTROLLER.init_with(|| Controller::new(Settings::DEFAULT.control));
    let session =
        SESSION.init_with(|| Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::now()));
    let recorder = &*RECORDER.init_with(|| Mutex::new(RefCell::new(Recorder::new(ROWS.take()))));
    control.spawn(
        controls(controller, recorder, channels).unwrap_or_else(|_| panic!("spawned twice")),
    );
    link.spawn(links(session, recorder, channels).unwrap_or_else(|_| panic!("spawned twice")));
    link.spawn(senses(channels).unwrap_or_else(|_| panic!("spawned twice")));
    link.spawn(displays(channels).unwrap_or_else(|_| panic!("spawned twice")));

    let busy = run(SATURATED_PERIODS, trial);
    let owed = SENT.load(Relaxed) - ACKNOWLEDGED.load(Relaxed);
    WAITS.store(true, Relaxed);
    run(SETTLING_PERIODS, trial);
    let before = SENT.load(Relaxed);
    run(WAITING_PERIODS, trial);
    let commands = SENT.load(Relaxed) - before;
    // Nothing is said before all is known: semihosting keeps interrupts off while it writes.
    // A frame comes every 1.0 ms; the longest telemetry frame holds up the answers for 4.3 ms.
    assert!(owed <= 6 && commands > 0, "acknowledgements were lost: {owed} {commands}");
    let jitter = LATEST.load(Relaxed) - EARLIEST.load(Relaxed);
    assert!(jitter < PERIOD as i32, "a control period was missed");
    hprintln!("board-saturated {} {}", busy, SATURATED_PERIODS);
    hprintln!("jitter {} 1", jitter);
    hprintln!("longest-interrupt {} 1", LONGEST_ALARM.load(Relaxed));
    hprintln!("stop-and-wait {} {}", WAITING_PERIODS * PERIOD, commands);
    hprintln!("motion-latency {} 1", LATENCY.load(Relaxed));
}

/// Turns by which the ticks of a turn are measured.
const TRIAL: u32 = 10_000;

/// Lets the tasks run for so many control periods, and returns for how many ticks they were busy.
fn run(periods: u32, trial: u32) -> u32 {
    let last = PERIODS.load(Relaxed) + periods;
    let began = ticks();
    let idle = u64::from(idle(last, u32::MAX)) * u64::from(trial) / u64::from(TRIAL);
    ticks().wrapping_sub(began) - idle as u32 // less than the whole, which fits
}

/// Loops until there have been so many control periods, or so many turns; returns the turns.
///
/// It does not sleep: QEMU moves the time of a sleeping machine in another thread, and two runs
/// then differ. Every turn takes the same, so the turns tell how long nobody else had work.
#[inline(never)]
fn idle(until_period: u32, turns: u32) -> u32 {
    let mut turned = 0;
    while turned < turns && PERIODS.load(Relaxed) < until_period {
        turned += 1;
    }
    turned
}

#[embassy_executor::task]
async fn controls(
    controller: &'static mut Controller,
    recorder: &'static SharedRecorder,
    channels: &'static Channels,
) {
    let motors = &mut Motors { due: None, pulse: None };
    app::control(motors, controller, recorder, channels, |_| {}).await;
}

#[embassy_executor::task]
async fn links(
    session: &'static mut Pms5005,
    recorder: &'static SharedRecorder,
    channels: &'static Channels,
) {
    app::link(&mut Host::new(), &mut Sender, session, recorder, channels).await;
}

#[embassy_executor::task]
async fn senses(channels: &'static Channels) {
    app::sensors(&mut Slow, channels).await;
}

#[embassy_executor::task]
async fn displays(channels: &'static Channels) {
    app::display(&mut Slow, channels).await;
}

/// Sensors that take a ranger's turn, and a display that nothing is sent to.
struct Slow;

impl SensorPort for Slow {
    async fn read(&mut self) -> Sensors {
        Timer::after_millis(40).await;
        Sensors::UNKNOWN
    }
}

impl LcdPort for Slow {
    async fn show(&mut self, _number: u8, _columns: &[u8; 64]) {}
}

/// The motors: still, and with an eye on the clock.
struct Motors {
    due: Option<u32>,
    pulse: Option<u16>,
}

impl MotionPort for Motors {
    fn sample(&mut self) -> MotionInputs {
        let now = ticks();
        let late = now.wrapping_sub(*self.due.get_or_insert(now)) as i32; // either sign
        self.due = self.due.map(|due| due.wrapping_add(PERIOD));
        EARLIEST.fetch_min(late, Relaxed);
        LATEST.fetch_max(late, Relaxed);
        PERIODS.fetch_add(1, Relaxed);
        MotionInputs::default()
    }

    fn drive(&mut self, outputs: &Outputs) {
        let pulse = outputs.servos[usize::from(SERVO)].map(|pulse| pulse.raw());
        if let Some(pulse) = pulse.filter(|_| pulse != self.pulse) {
            let came = CAME[usize::from(pulse - FIRST_PULSE)].load(Relaxed);
            LATENCY.fetch_max(ticks().wrapping_sub(came), Relaxed);
        }
        self.pulse = pulse;
    }
}

/// The receiving end of the line: the host, the ring that the board's DMA fills, its reader.
struct Host {
    commands: [[u8; 12]; PULSES],
    no_reports: [u8; 10],
    reports_are_off: bool,
    /// The command that is being sent, what of it comes next, and when that has come.
    command: usize,
    at: usize,
    next: u32,
    ring: [u8; 256],
    head: usize,
    tail: usize,
}

impl Host {
    fn new() -> Self {
        let (mut commands, mut no_reports) = ([[0; 12]; PULSES], [0; 10]);
        let encode = |did, data: &[u8], out: &mut [u8]| {
            assert!(Frame { rid: RID_PMS5005, res: 0, did, data }.encode(out).is_ok());
        };
        for (pulse, command) in (FIRST_PULSE..).zip(&mut commands) {
            let [low, high] = pulse.to_le_bytes();
            encode(did::SERVO, &[SERVO, low, high], command);
        }
        encode(did::ALL_REPORTS, &[0], &mut no_reports);
        let (ring, next) = ([0; 256], ticks().wrapping_add(BYTE + phase()));
        let (head, tail, command, at) = (0, 0, 0, 0);
        Self { commands, no_reports, reports_are_off: false, command, at, next, ring, head, tail }
    }

    /// What the DMA would have done since the last time. It takes some instructions a byte.
    fn fill(&mut self) {
        loop {
            if self.at == 0 && WAITS.load(Relaxed) {
                if !self.reports_are_off {
                    self.reports_are_off = true;
                    self.no_reports.into_iter().for_each(|byte| self.put(byte)); // at once
                    SENT.fetch_add(1, Relaxed);
                }
                if ACKNOWLEDGED.load(Relaxed) != SENT.load(Relaxed) {
                    return;
                }
                self.next = ACK_LEFT.load(Relaxed).wrapping_add(BYTE);
            }
            if (ticks().wrapping_sub(self.next) as i32) < 0 {
                return; // still to come
            }
            self.put(self.commands[self.command][self.at]);
            self.at += 1;
            if self.at == self.commands[self.command].len() {
                CAME[self.command].store(self.next, Relaxed);
                self.at = 0;
                self.command = (self.command + 1) % PULSES;
                SENT.fetch_add(1, Relaxed);
            }
            self.next = self.next.wrapping_add(BYTE);
        }
    }

    fn put(&mut self, byte: u8) {
        self.ring[self.head] = byte;
        self.head = (self.head + 1) % self.ring.len();
    }
}

impl ErrorType for Host {
    type Error = Infallible;
}

impl Read for Host {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        loop {
            self.fill();
            let mut count = 0;
            while count < buffer.len() && self.tail != self.head {
                buffer[count] = self.ring[self.tail];
                self.tail = (self.tail + 1) % self.ring.len();
                count += 1;
            }
            match count {
                0 => Timer::at(app::next_look(Instant::now())).await, // as board/line.rs does
                count => return Ok(count),
            }
        }
    }
}

/// The sending end: a frame takes its time.
struct Sender;

impl ErrorType for Sender {
    type Error = Infallible;
}

impl Write for Sender {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        let lasts = frame.len() as u32 * BYTE;
        if frame.len() == ACK.len() && (frame[4], frame[6]) == (ACK[4], ACK[6]) {
            ACK_LEFT.store(ticks().wrapping_add(lasts), Relaxed);
            ACKNOWLEDGED.fetch_add(1, Relaxed);
        }
        Timer::after(Duration::from_ticks((lasts / TICKS_PER_US).into())).await;
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
