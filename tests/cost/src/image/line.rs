//! The board's end of a line at 115200 baud: the ring that the DMA fills, and a sender that takes
//! its time.

use core::convert::Infallible;

use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Write};

use crate::machine::TICKS_PER_US;

/// How often the board looks into its ring (firmware/src/board/line.rs).
pub const LOOK_PERIOD: Duration = Duration::from_millis(1);
/// Ticks of a byte at 115200 baud.
pub const BYTE: u32 = 25_000_000 / 11_520;

/// The ring that the board's DMA fills, and its reader's loop.
pub struct Ring {
    bytes: [u8; 256],
    head: usize,
    tail: usize,
}

impl Ring {
    /// Full of the same byte, and nothing of it received.
    pub fn new() -> Self {
        Self { bytes: [0x55; 256], head: 0, tail: 0 }
    }

    /// A byte comes.
    pub fn put(&mut self, byte: u8) {
        self.bytes[self.head % self.bytes.len()] = byte;
        self.head += 1;
    }

    /// So many bytes come, whatever they are.
    pub fn advance(&mut self, count: usize) {
        self.head += count;
    }

    /// What has come since the last time, as the board's reader takes it.
    pub fn take(&mut self, buffer: &mut [u8]) -> usize {
        let head = self.head % self.bytes.len();
        let mut count = 0;
        for byte in buffer {
            if self.tail == head {
                break;
            }
            *byte = self.bytes[self.tail];
            self.tail = (self.tail + 1) % self.bytes.len();
            count += 1;
        }
        count
    }
}

/// The sending end: a frame takes its time.
pub struct Paced;

impl ErrorType for Paced {
    type Error = Infallible;
}

impl Write for Paced {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        Timer::after(Duration::from_ticks((frame.len() as u32 * BYTE / TICKS_PER_US).into())).await;
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
