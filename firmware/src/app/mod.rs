//! The tasks: the only place where time passes and I/O happens.
//!
//! ```text
//!            ┌───────── link ─────────┐  Command   ┌── control, 1 kHz ──┐
//!  UART ───> │ Session::receive       │ ─────────> │ Controller::step   │ <──> MotionPort
//!  UART <─── │ Session::transmit      │ <───────── │                    │
//!            └────────────────────────┘  Snapshot  └────────────────────┘
//!                      │ Picture                             ↑ Sensors
//!                      └────────> display ──> LcdPort        └── sensors <── SensorPort
//!
//!  supervise: feeds the watchdog when all of the above have checked in
//! ```
//!
//! The CM-5 has no controller and other tasks: [`bridge`].
//!
//! The functions are generic; an image wraps each in a thin task, `control` on an interrupt
//! executor above everything else. All channels are made by `main` ([`Channels`]) and passed by
//! reference, and so is whatever has a state, since a future would hold what it is given several
//! times over; there are no statics here.

mod bridge;
mod presence;

use core::cell::{Cell, RefCell};

use embassy_futures::join::join;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Ticker, Timer, with_timeout};
use embedded_io_async::{Read, Write};

use crate::command::Command;
use crate::controller::{Controller, Snapshot};
use crate::personality::{MAX_FRAME, Picture, Request, Session};
use crate::ports::{LcdPort, MotionPort, SensorPort, Sensors};
use crate::units::CONTROL_PERIOD_MS;
pub use bridge::{bridge, bridge_presence};
use presence::CHECK_IN_PERIOD;
pub use presence::{Presence, WATCHDOG_PERIOD};

/// Commands that may wait for the next control period. The shortest motion command takes 1 ms at
/// 115200 baud, so a period brings two at most; a full queue makes the link wait, nothing is
/// lost.
pub const COMMANDS: usize = 4;
/// Pictures that may wait for the display. They come every 6.4 ms at 115200 baud at the most; one
/// that finds no room is dropped and counted.
pub const PICTURES: usize = 2;
/// Bytes taken from the line at once. 64 bytes take 5.6 ms at 115200 baud.
const CHUNK: usize = 64;

/// Who must show signs of life, as bits.
#[derive(Clone, Copy)]
enum Task {
    Control = 1 << 0,
    Sensors = 1 << 1,
    Display = 1 << 2,
    Receive = 1 << 3,
    Transmit = 1 << 4,
}

impl Task {
    const ALL: u8 = (1 << 5) - 1;
}

/// The newest value of something, for readers that do not want to wait.
pub struct Latest<M: RawMutex, T: Copy>(Mutex<M, Cell<T>>);

impl<M: RawMutex, T: Copy> Latest<M, T> {
    /// With a value to begin with.
    pub const fn new(value: T) -> Self {
        Self(Mutex::new(Cell::new(value)))
    }

    /// The newest value.
    pub fn get(&self) -> T {
        self.0.lock(Cell::get)
    }

    /// Replaces the value.
    pub fn set(&self, value: T) {
        self.0.lock(|cell| cell.set(value));
    }
}

/// What the tasks share: bounded, made once by `main`. `C` is what the session counts.
pub struct Channels<M: RawMutex, C: Copy> {
    commands: Channel<M, Command, COMMANDS>,
    pictures: Channel<M, Picture, PICTURES>,
    presence: Presence<M>,
    /// The newest state of the controller.
    pub snapshot: Latest<M, Snapshot>,
    /// The newest reading of the slow sensors.
    pub sensors: Latest<M, Sensors>,
    /// What the session has counted.
    pub link: Latest<M, C>,
    /// The host's signs of life: [`Session::signs_of_life`].
    signs_of_life: Latest<M, u32>,
}

impl<M: RawMutex, C: Copy + Default> Channels<M, C> {
    /// Empty channels.
    pub fn new() -> Self {
        Self {
            commands: Channel::new(),
            pictures: Channel::new(),
            presence: Presence::new(Task::ALL),
            snapshot: Latest::new(Snapshot::BOOT),
            sensors: Latest::new(Sensors::UNKNOWN),
            link: Latest::new(C::default()),
            signs_of_life: Latest::new(0),
        }
    }
}

impl<M: RawMutex, C: Copy + Default> Default for Channels<M, C> {
    fn default() -> Self {
        Self::new()
    }
}

/// Runs the controller once every control period. Deadline: the period, 1 ms.
pub async fn control<M: RawMutex, C: Copy>(
    port: &mut impl MotionPort,
    controller: &mut Controller,
    channels: &Channels<M, C>,
) -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(CONTROL_PERIOD_MS.into()));
    loop {
        ticker.next().await;
        let motion = port.sample();
        let commands = core::iter::from_fn(|| channels.commands.try_receive().ok());
        let snapshot = controller.step(
            // No more than were waiting: a fast link must not stretch the period.
            commands.take(COMMANDS),
            &motion,
            &channels.sensors.get(),
            channels.signs_of_life.get(),
        );
        port.drive(&snapshot.outputs);
        channels.snapshot.set(snapshot);
        channels.presence.check_in(Task::Control as u8);
    }
}

/// Calls `feed` whenever all tasks have shown signs of life: [`Presence::supervise`].
pub async fn supervise<M: RawMutex, C: Copy>(feed: impl FnMut(), channels: &Channels<M, C>) -> ! {
    channels.presence.supervise(feed).await
}

/// Reads the slow sensors, one reading after the other. Deadline: a reading takes 100 ms at most.
pub async fn sensors<M: RawMutex, C: Copy>(
    port: &mut impl SensorPort,
    channels: &Channels<M, C>,
) -> ! {
    loop {
        channels.sensors.set(port.read().await);
        channels.presence.check_in(Task::Sensors as u8);
    }
}

/// Shows what the host draws.
pub async fn display<M: RawMutex, C: Copy>(
    port: &mut impl LcdPort,
    channels: &Channels<M, C>,
) -> ! {
    loop {
        channels.presence.check_in(Task::Display as u8);
        let waited = with_timeout(CHECK_IN_PERIOD, channels.pictures.receive()).await;
        if let Ok(picture) = waited {
            port.show(picture.number, &picture.columns).await;
        }
    }
}

/// Talks to the host. One `write` is one frame, and takes at least a byte of it; a `read` that is
/// dropped before it is done must not lose what has arrived. Deadline: the buffer below `rx` must
/// hold what arrives while a command waits for the next control period (1 ms), or after an error.
///
/// A line that reports an error (an overrun, a framing error) or its end is counted, and used
/// again after 1 ms.
pub async fn link<M: RawMutex, S: Session>(
    rx: &mut impl Read,
    tx: &mut impl Write,
    session: &mut S,
    channels: &Channels<M, S::Counters>,
) -> ! {
    let session = RefCell::new(session);
    let something_to_send = Signal::<NoopRawMutex, ()>::new();
    let publish = || {
        let session = session.borrow();
        channels.link.set(session.counters());
        channels.signs_of_life.set(session.signs_of_life());
    };

    let receive = async {
        let mut buffer = [0; CHUNK];
        loop {
            channels.presence.check_in(Task::Receive as u8);
            let check_in_at = Instant::now() + CHECK_IN_PERIOD;
            let until = session.borrow().wakes_at().unwrap_or(Instant::MAX).min(check_in_at);
            let mut bytes: &[u8] = match select(rx.read(&mut buffer), Timer::at(until)).await {
                Either::First(Ok(count)) if count > 0 => &buffer[..count],
                Either::First(_) => {
                    session.borrow_mut().line_failed();
                    Timer::after(LINE_DOWN).await;
                    &[]
                }
                Either::Second(()) => &[],
            };
            loop {
                let now = Instant::now();
                let request = {
                    let mut session = session.borrow_mut();
                    session.receive(&mut bytes, now).or_else(|| {
                        // A snapshot is only copied for a session that has its time.
                        session.wakes_at().filter(|&at| at <= now)?;
                        session.advance(now, &channels.snapshot.get())
                    })
                };
                publish();
                match request {
                    Some(Request::Control(command)) => channels.commands.send(command).await,
                    Some(Request::Show(picture)) => {
                        // A display that hangs must not hold up the command that stops a motor.
                        if channels.pictures.try_send(picture).is_err() {
                            session.borrow_mut().picture_dropped();
                        }
                    }
                    None => break,
                }
            }
            something_to_send.signal(());
            // On a line without a speed limit the answers would else wait for a pause.
            yield_now().await;
        }
    };

    let transmit = async {
        let mut buffer = [0; MAX_FRAME];
        loop {
            channels.presence.check_in(Task::Transmit as u8);
            // A frame may take long to send; a snapshot is not kept for so long.
            let frame = {
                let snapshot = channels.snapshot.get();
                session.borrow_mut().transmit(Instant::now(), &snapshot, &mut buffer)
            };
            match frame {
                Some(frame) => {
                    publish();
                    if tx.write_all(frame).await.is_err() {
                        session.borrow_mut().line_failed();
                        Timer::after(LINE_DOWN).await;
                    }
                }
                None => {
                    let check_in_at = Instant::now() + CHECK_IN_PERIOD;
                    let at = session.borrow().sends_at().min(check_in_at);
                    select(Timer::at(at), something_to_send.wait()).await;
                }
            }
        }
    };

    join(receive, transmit).await;
    unreachable!("both loops are endless")
}

/// How long a line that failed is left alone.
const LINE_DOWN: Duration = Duration::from_millis(1);
