//! The pass-through at work: a PC on one side, the servo bus on the other.
//!
//! ```text
//!   PC ───> send ───────┬──────────────────── bus ───> servos
//!                  PassThrough                 ↑
//!   PC <── transmit ────┴────── hear <─────────┴────── servos, our own echo
//! ```
//!
//! Three loops, and none of them waits for another. `hear` feeds the watchdog while the others come round.
//! The board drives nothing itself: whichever loop hangs, the watchdog restarts it within 500 ms with the
//! nominal LSI. If `send` hangs, or all do, the bus is silent until then. From the reset on nobody is a
//! wheel until it is seen again: one that goes on turning meanwhile is the PC's to stop.
//!
//! Deadline: what a packet is late by, in all 0.2 ms in each direction. To the bus that is a look at the
//! PC's line, every [`PC_LOOK`], and behind a packet of the board's own 140 us; back it is a byte.

use core::cell::RefCell;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};

use super::super::tasks::{BridgeChannels, LOOK, RECEIVE, TRANSMIT};
use super::{MAX_OWN_PACKET, PassThrough};
use crate::liveness::CHECK_IN_PERIOD;
use crate::reception::{CHUNK, LINE_DOWN};

/// How often the PC's line is to be looked at: five bytes at 1 Mbaud.
pub const PC_LOOK: Duration = Duration::from_micros(50);

/// Listens to the PC, and sends on the bus: what the PC says, and when it is silent what the board says. A
/// failed line is counted, and used again after 1 ms.
///
/// A `write` on `bus_tx` returns when there is room, a `flush` when the last stop bit has left.
pub async fn send<M: RawMutex>(
    pc_rx: &mut impl Read,
    bus_tx: &mut impl Write,
    pass: &RefCell<PassThrough>,
    channels: &BridgeChannels<M>,
) -> ! {
    let mut buffer = [0; CHUNK];
    let mut own = [0; MAX_OWN_PACKET];
    loop {
        channels.roll_call.answer(RECEIVE);
        let check_in_at = Instant::now() + CHECK_IN_PERIOD;
        let until = pass.borrow().stops_at().unwrap_or(Instant::MAX).min(check_in_at);
        let woken = select(pc_rx.read(&mut buffer), Timer::at(until)).await;
        let now = Instant::now();
        let sent = match woken {
            Either::First(Ok(count)) if count > 0 => {
                let bytes = &mut buffer[..count];
                pass.borrow_mut().receive(bytes, now);
                bus_tx.write_all(bytes).await
            }
            Either::First(_) => {
                pass.borrow_mut().pc_failed();
                Timer::after(LINE_DOWN).await;
                Ok(())
            }
            Either::Second(()) => {
                let packet = pass.borrow_mut().stop(now, &mut own);
                let sent = bus_tx.write_all(packet.unwrap_or_default()).await;
                // The PC may speak before the next one.
                if sent.is_ok() { bus_tx.flush().await } else { sent }
            }
        };
        if sent.is_err() {
            Timer::after(LINE_DOWN).await;
            pass.borrow_mut().bus_failed(Instant::now());
        }
    }
}

/// Listens to the bus, and calls `feed` as long as all loops come round: the watchdog must bear
/// [`BRIDGE_WATCHDOG_PERIOD`](crate::liveness::BRIDGE_WATCHDOG_PERIOD).
///
/// What goes out on the bus must be heard on `bus_rx`, byte by byte before whatever answers it.
pub async fn hear<M: RawMutex>(
    bus_rx: &mut impl Read,
    pass: &RefCell<PassThrough>,
    channels: &BridgeChannels<M>,
    mut feed: impl FnMut(),
) -> ! {
    let mut buffer = [0; CHUNK];
    let mut now = Instant::now();
    let mut checked = now;
    let mut look_at = now;
    loop {
        // Not between the bytes of a packet.
        if now >= look_at {
            channels.check(&mut checked, now, &mut feed);
            look_at = now + LOOK;
        }
        let woken = select(bus_rx.read(&mut buffer), Timer::at(now + CHECK_IN_PERIOD)).await;
        now = Instant::now();
        match woken {
            Either::First(Ok(count)) if count > 0 => {
                let mut pass = pass.borrow_mut();
                pass.bus_hears(&buffer[..count], now);
                if pass.has_answers() {
                    channels.something_to_send.signal(());
                }
            }
            Either::First(_) => {
                Timer::after(LINE_DOWN).await;
                now = Instant::now();
                pass.borrow_mut().bus_failed(now);
            }
            Either::Second(()) => {}
        }
    }
}

/// Talks to the PC: whatever has been heard by the time its line is free.
pub async fn transmit<M: RawMutex>(
    pc_tx: &mut impl Write,
    pass: &RefCell<PassThrough>,
    channels: &BridgeChannels<M>,
) -> ! {
    let mut buffer = [0; CHUNK];
    loop {
        channels.roll_call.answer(TRANSMIT);
        let bytes = pass.borrow_mut().transmit(&mut buffer);
        match bytes {
            Some(bytes) => {
                if pc_tx.write_all(bytes).await.is_err() {
                    pass.borrow_mut().pc_failed();
                    Timer::after(LINE_DOWN).await;
                }
            }
            None => {
                let check_in = Timer::after(CHECK_IN_PERIOD);
                select(check_in, channels.something_to_send.wait()).await;
            }
        }
    }
}
