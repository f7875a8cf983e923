//! The CM-5's bridge at work: a PC on one side, the servo bus on the other.
//!
//! ```text
//!   PC ───> receive ───┐             ┌─── bus ───> servos
//!                      ├── Bridge ───┤     ↑
//!   PC <── transmit ───┘             └─────┴────── servos, our own echo
//! ```
//!
//! Three loops share the bridge, and none of them waits for another.

use core::cell::RefCell;

use embassy_futures::join::join3;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::{NoopRawMutex, RawMutex};
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use embedded_io_async::{Read, Write};

use super::presence::{CHECK_IN_PERIOD, Presence};
use super::{CHUNK, LINE_DOWN};
use crate::personality::cm5::{Bridge, MAX_REQUEST};

/// Who must show signs of life, as bits.
const RECEIVE: u8 = 1 << 0;
const TRANSMIT: u8 = 1 << 1;
const BUS: u8 = 1 << 2;

/// For the three loops of [`bridge`].
pub const fn bridge_presence<M: RawMutex>() -> Presence<M> {
    Presence::new(RECEIVE | TRANSMIT | BUS)
}

/// Runs the bridge. What holds for the lines of [`link`](super::link) holds for both of these; a
/// failed line is counted, and used again after 1 ms.
///
/// The bus is one wire: what goes out on `bus_tx` must be heard on `bus_rx`, byte by byte before
/// whatever answers it, and a `write` there is complete when the last stop bit has left, or later.
/// The buffer below `bus_rx` holds the longest request and an answer:
/// [`MAX_REQUEST`] and 14 bytes.
///
/// Deadline: the bus is handed its next request within microseconds after an answer, or the cycle
/// gets longer by what it takes; nothing is lost.
pub async fn bridge<M: RawMutex>(
    (pc_rx, pc_tx): (&mut impl Read, &mut impl Write),
    (bus_rx, bus_tx): (&mut impl Read, &mut impl Write),
    bridge: &RefCell<Bridge>,
    presence: &Presence<M>,
) -> ! {
    let something_to_send = Signal::<NoopRawMutex, ()>::new();
    let notify = || {
        if bridge.borrow().sends_at() <= Instant::now() {
            something_to_send.signal(());
        }
    };

    let receive = async {
        let mut buffer = [0; CHUNK];
        loop {
            presence.check_in(RECEIVE);
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
    };

    let transmit = async {
        let mut buffer = [0; Bridge::MAX_PACKET];
        loop {
            presence.check_in(TRANSMIT);
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
                    select(Timer::at(at), something_to_send.wait()).await;
                }
            }
        }
    };

    let bus = async {
        let mut request = [0; MAX_REQUEST];
        let mut buffer = [0; CHUNK];
        loop {
            presence.check_in(BUS);
            let packet = bridge.borrow_mut().bus_sends(Instant::now(), &mut request);
            notify();
            if let Some(packet) = packet {
                if bus_tx.write_all(packet).await.is_err() {
                    bridge.borrow_mut().bus_failed();
                    Timer::after(LINE_DOWN).await;
                }
                continue;
            }
            let check_in_at = Instant::now() + CHECK_IN_PERIOD;
            let until = bridge.borrow().bus_acts_at().min(check_in_at);
            match select(bus_rx.read(&mut buffer), Timer::at(until)).await {
                Either::First(Ok(count)) if count > 0 => {
                    bridge.borrow_mut().bus_hears(&buffer[..count], Instant::now());
                }
                Either::First(_) => {
                    bridge.borrow_mut().bus_failed();
                    Timer::after(LINE_DOWN).await;
                }
                Either::Second(()) => {}
            }
        }
    };

    join3(receive, transmit, bus).await;
    unreachable!("all loops are endless")
}
