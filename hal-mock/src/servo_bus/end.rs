//! The master's end of the bus on virtual time: a UART whose pin both sends and receives.
//!
//! A `write` returns when there is room for its bytes, as a board's does; a `flush` completes when the last
//! stop bit has left, which is when a half duplex driver turns the line round. What was written appears in
//! what is read, byte by byte, when its stop bits pass (unless the bus is made without echo); then the
//! servos' answers do.

use std::cell::{RefCell, RefMut};
use std::convert::Infallible;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_futures::select::select;
use embassy_time::Instant;
use embedded_io_async::{ErrorType, Read, Write};
use firmware::bridge::MAX_INSTRUCTION;

use super::ServoBus;
use crate::wire::{begin, until};

/// A bus on virtual time. Clones are handles to the same bus.
#[derive(Clone)]
pub struct MasterEnd(Rc<RefCell<State>>);

struct State {
    bus: ServoBus,
    /// Writes so far, wrapping: whoever waits looks again when there are more.
    sent: u32,
    reader: Option<Waker>,
}

impl MasterEnd {
    /// Puts a bus on this thread's clock.
    pub fn new(bus: ServoBus) -> Self {
        Self(Rc::new(RefCell::new(State { bus, sent: 0, reader: None })))
    }

    /// The bus at this moment.
    pub fn bus(&self) -> RefMut<'_, ServoBus> {
        RefMut::map(self.0.borrow_mut(), |state| {
            state.bus.advance_to(now_ns());
            &mut state.bus
        })
    }

    /// The master's receiver and transmitter.
    pub fn split(&self) -> (MasterRx, MasterTx) {
        (MasterRx(self.clone()), MasterTx(self.clone()))
    }

    /// Waits until the master sends once more.
    async fn sent(&self) {
        let before = self.0.borrow().sent;
        poll_fn(|context| {
            let mut state = self.0.borrow_mut();
            if state.sent != before {
                return Poll::Ready(());
            }
            state.reader = Some(context.waker().clone());
            Poll::Pending
        })
        .await;
    }
}

fn now_ns() -> u64 {
    Instant::now().as_micros() * 1000
}

/// The master's receiver.
pub struct MasterRx(MasterEnd);

impl ErrorType for MasterRx {
    type Error = Infallible;
}

impl Read for MasterRx {
    /// What has been heard since the last call; waits for one byte at least.
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, Infallible> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            let (count, next) = {
                let mut bus = self.0.bus();
                let heard = buffer.iter_mut().map_while(|place| {
                    let (_, byte) = bus.receive()?;
                    *place = byte;
                    Some(())
                });
                (heard.count(), bus.next_ns())
            };
            match next {
                _ if count > 0 => return Ok(count),
                // What is sent meanwhile may be heard earlier.
                Some(next) => {
                    select(until(next), self.0.sent()).await;
                }
                None => self.0.sent().await,
            }
        }
    }
}

/// Bytes that the transmitter holds, the one that is leaving among them: a board has room for its longest
/// instruction.
const ROOM: u64 = MAX_INSTRUCTION as u64;

/// The master's transmitter.
pub struct MasterTx(MasterEnd);

impl ErrorType for MasterTx {
    type Error = Infallible;
}

impl Write for MasterTx {
    /// Takes what there is room for, and waits for room for a byte at least.
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let byte_ns = self.0.bus().byte_ns();
        let until_room = self.0.bus().sending_until_ns().saturating_sub((ROOM - 1) * byte_ns);
        until(until_room).await;
        let count = {
            let mut bus = self.0.bus();
            let start = begin(bus.sending_until_ns());
            let waiting = bus.sending_until_ns().saturating_sub(now_ns()).div_ceil(byte_ns);
            let count = bytes.len().min(ROOM.saturating_sub(waiting) as usize);
            bus.send(start, &bytes[..count]);
            count
        };
        let mut state = self.0.0.borrow_mut();
        state.sent = state.sent.wrapping_add(1);
        if let Some(reader) = state.reader.take() {
            reader.wake();
        }
        Ok(count)
    }

    /// Waits until the last stop bit has left.
    async fn flush(&mut self) -> Result<(), Infallible> {
        let end = self.0.bus().sending_until_ns();
        until(end).await;
        Ok(())
    }
}
