//! The tasks of a controller: where time passes and I/O happens.
//!
//! ```text
//!            ┌───────── link ─────────┐  Command   ┌── control, 1 kHz ──┐
//!  UART ───> │ Session::receive       │ ─────────> │ Controller::step   │ <──> MotionPort
//!  UART <─── │ Session::transmit      │ <───────── │                    │
//!            └────────────────────────┘  Snapshot  └────────────────────┘
//!                      │ Picture                             ↑ Sensors
//!                      └────────> display ──> LcdPort        └── sensors <── SensorPort
//!
//!  control feeds the watchdog while all of the above come round (`liveness`)
//!  upkeep: saves settings and restarts the board, while control is held back with nothing driven
//! ```
//!
//! The CM-5 has no controller and other tasks: [`bridge::tasks`](crate::bridge::tasks).
//!
//! The functions are generic; an image wraps each in a thin task, `control` on an interrupt
//! executor above everything else. All channels are made by `main` ([`Channels`]) and passed by
//! reference, and so is whatever has a state, since a future would hold what it is given several
//! times over; there are no statics here.

mod latest;

use core::cell::RefCell;
use core::ops::Range;

use embassy_futures::join::join;
use embassy_futures::select::{Either3, select, select3};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_io_async::{Read, Write};
use embedded_storage::nor_flash::NorFlash;

use crate::command::Command;
use crate::controller::{Controller, Snapshot};
use crate::liveness::{CHECK_IN_PERIOD, LONGEST_SILENCE, Liveness, RollCall};
use crate::personality::{
    BlockRows, Effect, MAX_FRAME, Picture, Session, Upkeep, UpkeepRefused, View,
};
use crate::ports::{LcdPort, MotionPort, Outputs, SensorPort, Sensors, SystemPort};
use crate::reception::{CHUNK, LINE_DOWN};
use crate::recorder::{Recorder, Recording, Rows};
use crate::safety::faults::Fault;
use crate::settings::store::Store;
use crate::settings::{ControlSettings, Settings};
use crate::units::CONTROL_PERIOD_MS;
pub use latest::Latest;

/// Commands that may wait for the next control period. The shortest motion command takes 1 ms at
/// 115200 baud, so a period brings two at most. A full queue makes the link wait, and the line's buffer
/// bears that.
pub const COMMANDS: usize = 4;
/// Pictures that may wait for the display. They come every 6.4 ms at 115200 baud at the most; one
/// that finds no room is dropped and counted.
pub const PICTURES: usize = 2;
const CONTROL_PERIOD: Duration = Duration::from_millis(CONTROL_PERIOD_MS as u64);
/// How long the last answer of a program has to leave before another is started: an answer and an
/// acknowledgement behind the longest frame take 25 ms at 115200 baud.
const FAREWELL: Duration = Duration::from_millis(100);

/// Who must answer, for control to drive and to feed the watchdog.
const SENSORS: usize = 0;
const DISPLAY: usize = 1;
const RECEIVE: usize = 2;
const TRANSMIT: usize = 3;
const TASKS: usize = 4;

/// The recorder, which control and the link share. Interrupts are off while either uses it: control for the
/// rows of a period, the link for those of a block, some 2 us.
pub type SharedRecorder<M, R> = Mutex<M, RefCell<Recorder<R>>>;

/// What the tasks share: bounded, made once by `main`. `C` is what the session counts.
pub struct Channels<M: RawMutex, C: Copy> {
    commands: Channel<M, Command, COMMANDS>,
    /// What a [`Command::Adopt`] puts into force, one at a time: while it is copied interrupts are off,
    /// for 83 words, some 2 us.
    settings: Channel<M, ControlSettings, 1>,
    pictures: Channel<M, Picture, PICTURES>,
    roll_call: RollCall<M, TASKS>,
    /// The newest state of the controller.
    pub snapshot: Latest<M, Snapshot>,
    /// The newest reading of the slow sensors.
    pub sensors: Latest<M, Sensors>,
    /// What the session has counted.
    pub link: Latest<M, C>,
    /// The host's signs of life: [`Session::signs_of_life`].
    signs_of_life: Latest<M, u32>,
    /// One at a time: the session waits for what came of it.
    upkeep: Channel<M, (Upkeep, Settings), 1>,
    upkeep_done: Signal<M, Result<(), UpkeepRefused>>,
    /// No command is to be carried out.
    hold: Latest<M, bool>,
}

impl<M: RawMutex, C: Copy + Default> Channels<M, C> {
    /// Empty channels.
    pub fn new() -> Self {
        Self {
            commands: Channel::new(),
            settings: Channel::new(),
            pictures: Channel::new(),
            roll_call: RollCall::new(LONGEST_SILENCE),
            snapshot: Latest::new(Snapshot::BOOT),
            sensors: Latest::new(Sensors::UNKNOWN),
            link: Latest::new(C::default()),
            signs_of_life: Latest::new(0),
            upkeep: Channel::new(),
            upkeep_done: Signal::new(),
            hold: Latest::new(false),
        }
    }
}

impl<M: RawMutex, C: Copy + Default> Default for Channels<M, C> {
    fn default() -> Self {
        Self::new()
    }
}

/// Runs the controller once every control period, and feeds the watchdog: `feed` is told whether
/// anything is driven. The watchdog must bear
/// [`WATCHDOG_PERIOD`](crate::liveness::WATCHDOG_PERIOD). Deadline: the period, 1 ms.
pub async fn control<M: RawMutex, C: Copy>(
    port: &mut impl MotionPort,
    controller: &mut Controller,
    recorder: &SharedRecorder<M, impl Rows>,
    channels: &Channels<M, C>,
    mut feed: impl FnMut(bool),
) -> ! {
    let mut due = period_before(Instant::now());
    let mut worst_latency_us = 0;
    loop {
        due += CONTROL_PERIOD;
        Timer::at(due).await;
        let begun = due;
        let late = Instant::now().saturating_duration_since(begun);
        if late >= CONTROL_PERIOD {
            // What was missed is not made up for: no shaft has moved for it.
            let mut missed = 0_u16;
            while due + CONTROL_PERIOD <= Instant::now() {
                due += CONTROL_PERIOD;
                missed = missed.saturating_add(1);
            }
            controller.periods_missed(missed, microseconds(late));
        }
        let motion = port.sample();
        // No more than were waiting: a fast link must not stretch the period.
        let is_held = channels.hold.get();
        let most = if is_held { 0 } else { COMMANDS };
        let commands = core::iter::from_fn(|| channels.commands.try_receive().ok());
        let snapshot = controller.step(
            commands.take(most),
            || channels.settings.try_receive().ok(),
            &motion,
            &channels.sensors.get(),
            channels.signs_of_life.get(),
        );
        let liveness = channels.roll_call.check(CONTROL_PERIOD_MS as u16, is_held);
        if liveness != Liveness::Alive {
            snapshot.outputs = Outputs::default();
        }
        port.drive(&snapshot.outputs);
        if liveness != Liveness::Hung {
            feed(!snapshot.outputs.are_off());
        }
        // Saturating: where its timer's counter wraps, a clock may be behind for a moment.
        let latency = Instant::now().saturating_duration_since(begun);
        worst_latency_us = microseconds(latency).max(worst_latency_us);
        snapshot.worst_latency_us = worst_latency_us;
        channels.snapshot.set(snapshot);
        recorder.lock(|recorder| recorder.borrow_mut().step(snapshot));
    }
}

/// Control periods begin at whole milliseconds of the clock: when the newest did.
fn period_before(now: Instant) -> Instant {
    Instant::from_ticks(now.as_ticks() / CONTROL_PERIOD.as_ticks() * CONTROL_PERIOD.as_ticks())
}

/// How long before a control period the line is looked at: from the look to the queued command it
/// takes some 20 us, and as much again if an answer is just being made.
const LOOK_LEAD: Duration = Duration::from_micros(150);

/// When a line that does not wake anybody is looked at next: once a control period, shortly before
/// it. From the last byte of a command to control it takes a period and `LOOK_LEAD` at most.
pub fn next_look(now: Instant) -> Instant {
    period_before(now + LOOK_LEAD) + CONTROL_PERIOD - LOOK_LEAD
}

fn microseconds(time: Duration) -> u16 {
    u16::try_from(time.as_micros()).unwrap_or(u16::MAX)
}

/// Saves settings and starts programs, while control is held back and if nothing is driven: flash
/// that is written or erased stalls the core, and with it everything that keeps a motor in check.
///
/// Order: what the host has asked for before is carried out, and commands wait from then on
/// ([`link`]); two control periods later the outputs are what they will stay; if they are off it is
/// done, the watchdog being fed before each erase; then commands go on. What the host sends
/// meanwhile waits in the line's buffer, or is lost and counted there.
pub async fn upkeep<M: RawMutex, C: Copy>(
    store: &mut Store<impl NorFlash>,
    system: &mut impl SystemPort,
    channels: &Channels<M, C>,
) -> ! {
    loop {
        // It stays in the channel: in this future it would be a second time.
        channels.upkeep.ready_to_receive().await;
        let periods = || channels.snapshot.get().counters.periods;
        let before = periods();
        while periods().wrapping_sub(before) < 2 {
            Timer::after(CONTROL_PERIOD).await;
        }
        let is_off = channels.snapshot.get().outputs.are_off();
        let (result, program) = match channels.upkeep.try_receive() {
            Err(_) => continue,
            Ok(_) if !is_off => (Err(UpkeepRefused::OutputsOn), None),
            Ok((Upkeep::Start(program), _)) if !system.can_start(program) => {
                (Err(UpkeepRefused::NotAvailable), None)
            }
            Ok((Upkeep::Start(program), _)) => (Ok(()), Some(program)),
            Ok((Upkeep::Save, settings)) => {
                let saved = store.save(&settings, || system.before_erase());
                (saved.map_err(|_| UpkeepRefused::FlashFailed), None)
            }
        };
        channels.upkeep_done.signal(result);
        if let Some(program) = program {
            Timer::after(FAREWELL).await;
            system.start(program);
        }
        channels.hold.set(&false);
    }
}

/// The upkeep of a board that cannot do any.
pub async fn no_upkeep<M: RawMutex, C: Copy>(channels: &Channels<M, C>) -> ! {
    loop {
        channels.upkeep.receive().await;
        channels.upkeep_done.signal(Err(UpkeepRefused::NotAvailable));
        channels.hold.set(&false);
    }
}

/// Reads the slow sensors, one reading after the other. Deadline: a reading takes 80 ms at most.
pub async fn sensors<M: RawMutex, C: Copy>(
    port: &mut impl SensorPort,
    channels: &Channels<M, C>,
) -> ! {
    loop {
        channels.sensors.set(&port.read().await);
        channels.roll_call.answer(SENSORS);
    }
}

/// Shows what the host draws.
pub async fn display<M: RawMutex, C: Copy>(
    port: &mut impl LcdPort,
    channels: &Channels<M, C>,
) -> ! {
    loop {
        channels.roll_call.answer(DISPLAY);
        let waited = with_timeout(CHECK_IN_PERIOD, channels.pictures.receive()).await;
        if let Ok(picture) = waited {
            port.show(picture.number, &picture.columns).await;
        }
    }
}

/// What a session looks at.
struct Looks<'a, M: RawMutex, R> {
    snapshot: &'a Latest<M, Snapshot>,
    recorder: &'a SharedRecorder<M, R>,
}

impl<M: RawMutex, R: Rows> View for Looks<'_, M, R> {
    fn snapshot(&self) -> Snapshot {
        self.snapshot.get()
    }

    fn recording(&self) -> Recording {
        self.recorder.lock(|recorder| recorder.borrow().recording())
    }

    fn rows(&self, numbers: Range<usize>) -> (u8, BlockRows) {
        self.recorder.lock(|recorder| {
            let recorder = recorder.borrow();
            let rows = numbers.map_while(|number| recorder.row(number)).collect();
            (recorder.recording().serial, rows)
        })
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
    recorder: &SharedRecorder<M, impl Rows>,
    channels: &Channels<M, S::Counters>,
) -> ! {
    let session = RefCell::new(session);
    let board = Looks { snapshot: &channels.snapshot, recorder };
    let something_to_send = Signal::<NoopRawMutex, ()>::new();
    let receive = async {
        let mut buffer = [0; CHUNK];
        loop {
            channels.roll_call.answer(RECEIVE);
            let check_in_at = Instant::now() + CHECK_IN_PERIOD;
            let until = session.borrow().wakes_at().unwrap_or(Instant::MAX).min(check_in_at);
            // Upkeep first: a line that always has bytes must not keep it waiting. And here: whoever
            // else handed commands on, these would overtake the ones before them.
            let upkeep_done = channels.upkeep_done.wait();
            let event = select3(upkeep_done, rx.read(&mut buffer), Timer::at(until)).await;
            let mut due = None;
            let mut more_may_wait = false;
            let mut bytes: &[u8] = match event {
                Either3::First(result) => {
                    due = session.borrow_mut().upkeep_done(result);
                    &[]
                }
                Either3::Second(Ok(count)) if count > 0 => {
                    more_may_wait = count == CHUNK;
                    &buffer[..count]
                }
                Either3::Second(end_or_error) => {
                    session.borrow_mut().line_failed();
                    if end_or_error.is_err() {
                        // It is on record, or the queue is full and commands go before it.
                        let record = Command::Record(Fault::ReceiveOverrun);
                        let _ = channels.commands.try_send(record);
                    }
                    Timer::after(LINE_DOWN).await;
                    &[]
                }
                Either3::Third(()) => &[],
            };
            loop {
                let now = Instant::now();
                let request = due.take().or_else(|| {
                    let mut session = session.borrow_mut();
                    let asked = session.receive(&mut bytes, now);
                    asked.or_else(|| session.advance(now, || channels.snapshot.get()))
                });
                channels.signs_of_life.set(&session.borrow().signs_of_life());
                match request {
                    Some(Effect::Control(command)) => {
                        if matches!(command, Command::Adopt) {
                            // There is room when the ones before are in force.
                            while !channels.settings.is_empty() {
                                Timer::after(CONTROL_PERIOD).await;
                            }
                            let settings = session.borrow().settings().control;
                            let _ = channels.settings.try_send(settings);
                        }
                        channels.commands.send(command).await;
                    }
                    Some(Effect::Record(setup)) => {
                        recorder.lock(|recorder| recorder.borrow_mut().start(setup));
                    }
                    Some(Effect::Upkeep(upkeep)) => {
                        while !channels.commands.is_empty() {
                            Timer::after(CONTROL_PERIOD).await;
                        }
                        channels.hold.set(&true); // until it is done
                        let task = (upkeep, *session.borrow().to_save());
                        // There is room: the session has been told of the one before.
                        if channels.upkeep.try_send(task).is_err() {
                            channels.hold.set(&false);
                        }
                    }
                    Some(Effect::Show(picture)) => {
                        // A display that hangs must not hold up the command that stops a motor.
                        if channels.pictures.try_send(picture).is_err() {
                            session.borrow_mut().picture_dropped();
                        }
                    }
                    None => break,
                }
            }
            something_to_send.signal(());
            if more_may_wait {
                yield_now().await; // or on a line without a speed limit answers waited for a pause
            }
        }
    };

    let transmit = async {
        let mut buffer = [0; MAX_FRAME];
        loop {
            channels.roll_call.answer(TRANSMIT);
            channels.link.set(&session.borrow().counters());
            let frame = session.borrow_mut().transmit(Instant::now(), &board, &mut buffer);
            match frame {
                Some(frame) => {
                    if tx.write_all(frame).await.is_err() {
                        session.borrow_mut().line_failed();
                        Timer::after(LINE_DOWN).await;
                    }
                }
                None => {
                    let check_in_at = Instant::now() + CHECK_IN_PERIOD;
                    let at = session.borrow().sends_at().min(check_in_at);
                    select(something_to_send.wait(), Timer::at(at)).await;
                }
            }
        }
    };

    join(receive, transmit).await;
    unreachable!("both loops are endless")
}
