//! The CM-5's bridge at work: a PC on one side, the servo bus on the other.
//!
//! ```text
//!   PC ───> receive ───┐             ┌─── bus ───> servos
//!                      ├── Bridge ───┤     ↑
//!   PC <── transmit ───┘             └─────┴────── servos, our own echo
//! ```
//!
//! Three loops share the bridge, and none of them waits for another. The bus's feeds the watchdog
//! while the others come round (`liveness`).
//!
//! A bridge has no outputs of its own: when one of its loops hangs nobody can be switched off,
//! since an AX-12 listens to nothing but its bus. What holds then:
//!
//! | hangs | until the reset, within 500 ms with the nominal LSI | from the reset on |
//! |---|---|---|
//! | `bus` | the bus is silent: joints end the move that they were sent on, and hold; what turns endlessly goes on turning | as at any start: joints are left alone until the PC has answered a hello; what turns endlessly is stopped when the bus is searched and the PC is silent for its time-out |
//! | `receive`, `transmit` | the bus goes on with the goals that it has | the same |
//!
//! The PC's time-out is longer than the reset takes, so a hang never makes a robot go limp.

use core::cell::RefCell;

use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};

use super::{Bridge, MAX_INSTRUCTION, MAX_PACKET};
use crate::liveness::{BRIDGE_SILENCE, CHECK_IN_PERIOD, Liveness, RollCall};
use crate::reception::{CHUNK, LINE_DOWN};

/// Who must answer, for the bus's loop to feed the watchdog.
pub(super) const RECEIVE: usize = 0;
pub(super) const TRANSMIT: usize = 1;
const TASKS: usize = 2;

/// How often the bus's loop looks at the others, at the least while bytes come.
pub(super) const LOOK: Duration = Duration::from_millis(1);

/// What the loops of a bridge share, made once by `main`.
pub struct BridgeChannels<M: RawMutex> {
    pub(super) roll_call: RollCall<M, TASKS>,
    pub(super) something_to_send: Signal<NoopRawMutex, ()>,
}

impl<M: RawMutex> BridgeChannels<M> {
    /// Nobody has come round yet.
    pub const fn new() -> Self {
        Self { roll_call: RollCall::new(BRIDGE_SILENCE), something_to_send: Signal::new() }
    }

    /// Calls `feed` as long as all loops come round; they were `checked` last then.
    pub(super) fn check(&self, checked: &mut Instant, now: Instant, feed: &mut impl FnMut()) {
        let passed_ms = (now - *checked).as_millis();
        *checked += Duration::from_millis(passed_ms); // what is less counts the next time
        let passed_ms = u16::try_from(passed_ms).unwrap_or(u16::MAX);
        if self.roll_call.check(passed_ms, false) != Liveness::Hung {
            feed();
        }
    }
}

impl<M: RawMutex> Default for BridgeChannels<M> {
    fn default() -> Self {
        Self::new()
    }
}

/// Listens to the PC. What holds for the lines of [`link`](crate::app::link) holds for both lines of a bridge; a
/// failed line is counted, and used again after 1 ms.
pub async fn receive<M: RawMutex>(
    pc_rx: &mut impl Read,
    bridge: &RefCell<Bridge>,
    channels: &BridgeChannels<M>,
) -> ! {
    let mut buffer = [0; CHUNK];
    loop {
        channels.roll_call.answer(RECEIVE);
        let check_in_at = Instant::now() + CHECK_IN_PERIOD;
        let until = bridge.borrow().gives_up_at().unwrap_or(Instant::MAX).min(check_in_at);
        let bytes: &[u8] = match select(pc_rx.read(&mut buffer), Timer::at(until)).await {
            Either::First(Ok(count)) if count > 0 => &buffer[..count],
            Either::First(_) => {
                bridge.borrow_mut().line_failed();
                Timer::after(LINE_DOWN).await;
                &[]
            }
            Either::Second(()) => &[],
        };
        bridge.borrow_mut().receive(bytes, Instant::now());
        // On a line without a speed limit the bus would else wait for a pause.
        yield_now().await;
    }
}

/// Talks to the PC.
pub async fn transmit<M: RawMutex>(
    pc_tx: &mut impl Write,
    bridge: &RefCell<Bridge>,
    channels: &BridgeChannels<M>,
) -> ! {
    let mut buffer = [0; MAX_PACKET];
    loop {
        channels.roll_call.answer(TRANSMIT);
        let packet = bridge.borrow_mut().transmit(Instant::now(), &mut buffer);
        match packet {
            Some(packet) => {
                if pc_tx.write_all(packet).await.is_err() {
                    bridge.borrow_mut().line_failed();
                    Timer::after(LINE_DOWN).await;
                }
            }
            None => {
                let check_in_at = Instant::now() + CHECK_IN_PERIOD;
                let at = bridge.borrow().sends_at().min(check_in_at);
                select(Timer::at(at), channels.something_to_send.wait()).await;
            }
        }
    }
}

/// Talks to the servos, and calls `feed` as long as all loops come round: the watchdog must bear
/// [`BRIDGE_WATCHDOG_PERIOD`](crate::liveness::BRIDGE_WATCHDOG_PERIOD).
///
/// The bus is one wire: what goes out on `bus_tx` must be heard on `bus_rx`, byte by byte before
/// whatever answers it, and a `flush` there is complete when the last stop bit has left, or later.
/// The buffer below `bus_rx` holds the longest instruction and an answer:
/// [`MAX_INSTRUCTION`] and 14 bytes.
///
/// Deadline: the bus is handed its next instruction within microseconds after an answer, or the cycle
/// gets longer by what it takes; nothing is lost.
pub async fn bus<M: RawMutex>(
    bus_rx: &mut impl Read,
    bus_tx: &mut impl Write,
    bridge: &RefCell<Bridge>,
    channels: &BridgeChannels<M>,
    mut feed: impl FnMut(),
) -> ! {
    let mut instruction = [0; MAX_INSTRUCTION];
    let mut buffer = [0; CHUNK];
    let mut checked = Instant::now();
    let mut look = |now: Instant| {
        channels.check(&mut checked, now, &mut feed);
        if bridge.borrow().sends_at() <= now {
            channels.something_to_send.signal(());
        }
        now + LOOK
    };
    let mut now = Instant::now();
    let mut look_at = now;
    loop {
        let packet = bridge.borrow_mut().bus_sends(now, &mut instruction);
        if let Some(packet) = packet {
            // The bus waits for nothing: the rest is looked at, and the echo heard, while the packet leaves.
            let meanwhile = async {
                look_at = look(now);
                loop {
                    let read = bus_rx.read(&mut buffer).await;
                    if !hear(bridge, read, &buffer, Instant::now()) {
                        Timer::after(LINE_DOWN).await;
                    }
                }
            };
            let send = async {
                bus_tx.write_all(packet).await?;
                bus_tx.flush().await
            };
            let (Either::First(sent) | Either::Second(sent)) = select(send, meanwhile).await;
            if sent.is_err() {
                bridge.borrow_mut().bus_failed();
                Timer::after(LINE_DOWN).await;
            }
            now = Instant::now();
            continue;
        }
        // Nor between the bytes of an answer.
        if now >= look_at {
            look_at = look(now);
        }
        let until = bridge.borrow().bus_acts_at().min(now + CHECK_IN_PERIOD);
        let woken = select(bus_rx.read(&mut buffer), Timer::at(until)).await;
        now = Instant::now();
        if let Either::First(read) = woken
            && !hear(bridge, read, &buffer, now)
        {
            Timer::after(LINE_DOWN).await;
            now = Instant::now();
        }
    }
}

/// Hands the bridge what was read from the bus; whether the line is up.
fn hear<E>(bridge: &RefCell<Bridge>, read: Result<usize, E>, buffer: &[u8], now: Instant) -> bool {
    match read {
        Ok(count) if count > 0 => bridge.borrow_mut().bus_hears(&buffer[..count], now),
        _ => {
            bridge.borrow_mut().bus_failed();
            return false;
        }
    }
    true
}
