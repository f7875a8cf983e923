//! The master's end of the bus on virtual time: a UART whose pin both sends and receives.
//!
//! One `write` is one packet; it completes when the last stop bit has left, which is when a half
//! duplex driver turns the line round. What was written appears in what is read, byte by byte, when
//! its stop bits pass (unless the bus is made without echo); then the servos' answers do.

use std::cell::{RefCell, RefMut};
use std::convert::Infallible;
use std::future::poll_fn;
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_futures::select::select;
use embassy_time::Instant;
use embedded_io_async::{ErrorType, Read, Write};

use super::ServoBus;
use crate::wire::{begin, until};

/// A bus on virtual time. Clones are handles to the same bus.
#[derive(Clone)]
pub struct MasterEnd(Rc<RefCell<State>>);

struct State {
    bus: ServoBus,
    /// Packets sent so far, wrapping: whoever waits looks again when there are more.
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

/// The master's transmitter.
pub struct MasterTx(MasterEnd);

impl ErrorType for MasterTx {
    type Error = Infallible;
}

impl Write for MasterTx {
    /// Sends one packet; complete when its last stop bit has left. Sent it is, even if the caller
    /// does not wait for that.
    async fn write(&mut self, packet: &[u8]) -> Result<usize, Infallible> {
        let end = {
            let mut bus = self.0.bus();
            let start = begin(bus.sending_until_ns());
            bus.send(start, packet)
        };
        {
            let mut state = self.0.0.borrow_mut();
            state.sent = state.sent.wrapping_add(1);
            if let Some(reader) = state.reader.take() {
                reader.wake();
            }
        }
        until(end).await;
        Ok(packet.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
