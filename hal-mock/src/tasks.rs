//! The firmware's own tasks over the simulated world, and how time passes for them.
//!
//! This is what the virtual board and the image for QEMU have in common, so that the same bytes
//! at the same times get the same answers from both. Each adds a line to the host, and says how
//! far the clock may go.

use core::cell::{Cell, RefCell};
use core::future::poll_fn;
use core::pin::{Pin, pin};
use core::sync::atomic::{AtomicBool, Ordering};
use core::task::{Context, Poll, Waker};

use embassy_futures::join::join4;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use firmware::app::{self, SharedRecorder};
use firmware::controller::Controller;
use firmware::personality::Session;
use firmware::ports::{LcdPort, MotionInputs, MotionPort, Outputs, SensorPort, Sensors};
use firmware::recorder::Rows;

use crate::clock;
use crate::plant::Plant;

/// What the tasks share.
pub type Channels<C> = app::Channels<NoopRawMutex, C>;

/// Rows that the recorder holds: as many as in an F407's core-coupled memory, 64 KiB.
pub const RECORDER_ROWS: usize = 4096;

/// How long a reading of the slow sensors takes.
const SENSOR_PERIOD: Duration = Duration::from_millis(20);

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Task {
    /// [`app::control`].
    Control,
    /// [`app::sensors`].
    Sensors,
    /// [`app::display`].
    Display,
    /// [`app::link`].
    Link,
}

/// A watchdog that bites when it is not fed, and the hand that can make a task hang.
pub struct Watchdog<T = Task> {
    period: Duration,
    fed: Cell<Instant>,
    /// The task that hangs: it is not polled any more.
    pub hung: Cell<Option<T>>,
}

impl<T: Copy + PartialEq> Watchdog<T> {
    /// Fed just now, and nothing hangs. It bears so long without food.
    pub fn new(period: Duration) -> Self {
        Self { period, fed: Cell::new(Instant::now()), hung: Cell::new(None) }
    }

    /// Feeds it.
    pub fn feed(&self) {
        self.fed.set(Instant::now());
    }

    /// Until it bites.
    pub async fn bites(&self) {
        loop {
            let at = self.fed.get() + self.period;
            if Instant::now() >= at {
                return;
            }
            Timer::at(at).await;
        }
    }

    /// Runs a task, unless it hangs.
    pub async fn watch<U>(&self, task: T, future: impl Future<Output = U>) -> U {
        let mut future = pin!(future);
        poll_fn(|context| match self.hung.get() {
            Some(hung) if hung == task => Poll::Pending,
            _ => future.as_mut().poll(context),
        })
        .await
    }
}

/// The tasks of a board, as one task.
pub async fn all<S: Session>(
    plant: &RefCell<Plant>,
    controller: &mut Controller,
    session: &mut S,
    recorder: &SharedRecorder<NoopRawMutex, impl Rows>,
    (rx, tx): (&mut impl Read, &mut impl Write),
    channels: &Channels<S::Counters>,
    watchdog: &Watchdog,
) {
    let mut slow = SlowBench { plant, started: false };
    let mut bench = Bench(plant);
    let feed = |_| watchdog.feed();
    join4(
        watchdog
            .watch(Task::Control, app::control(&mut bench, controller, recorder, channels, feed)),
        watchdog.watch(Task::Sensors, app::sensors(&mut slow, channels)),
        watchdog.watch(Task::Display, app::display(&mut Bench(plant), channels)),
        watchdog.watch(Task::Link, app::link(rx, tx, session, recorder, channels)),
    )
    .await;
}

/// Runs `task` until `time`: whenever it has been woken, then at every alarm that it has set.
/// `waker` sets `woken`, which is set at the beginning too.
pub fn run_until(
    mut task: Pin<&mut (impl Future<Output = ()> + ?Sized)>,
    waker: &Waker,
    woken: &AtomicBool,
    time: Instant,
) {
    loop {
        while woken.swap(false, Ordering::Relaxed) {
            let _ = task.as_mut().poll(&mut Context::from_waker(waker)); // it never ends
        }
        match clock::next_alarm() {
            Some(alarm) if alarm <= time => clock::advance_to(alarm),
            _ => break,
        }
    }
    clock::advance_to(time);
}

/// The ports that answer at once.
struct Bench<'a>(&'a RefCell<Plant>);

impl MotionPort for Bench<'_> {
    fn sample(&mut self) -> MotionInputs {
        let mut plant = self.0.borrow_mut();
        plant.advance_to(Instant::now().as_millis());
        plant.motion_inputs()
    }

    fn drive(&mut self, outputs: &Outputs) {
        self.0.borrow_mut().outputs = *outputs;
    }
}

impl LcdPort for Bench<'_> {
    async fn show(&mut self, number: u8, columns: &[u8; 64]) {
        if self.0.borrow().overrides.lcd_hangs {
            core::future::pending::<()>().await;
        }
        if let Some(frame) = self.0.borrow_mut().lcd.get_mut(usize::from(number)) {
            *frame = *columns;
        }
    }
}

/// The sensors that take their time.
struct SlowBench<'a> {
    plant: &'a RefCell<Plant>,
    started: bool,
}

impl SensorPort for SlowBench<'_> {
    async fn read(&mut self) -> Sensors {
        if self.started {
            Timer::after(SENSOR_PERIOD).await;
        }
        self.started = true;
        self.plant.borrow_mut().sensors()
    }
}
