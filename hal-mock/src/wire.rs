//! The serial line between host and board, on virtual time.
//!
//! Both directions carry one byte in ten bit times, as a UART does with 8 data bits, no parity and
//! one stop bit; at 0 baud the line takes no time. The board's side is `embedded_io_async`'s
//! `Read` and `Write`; one `write` is one frame and arrives with its last stop bit. Bytes for
//! the board arrive in pieces of up to 16, as a DMA that reports its progress would tell, or in what a
//! board that looks more often finds.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{pending, poll_fn};
use std::rc::Rc;
use std::task::{Poll, Waker};

use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};

/// Bytes after which the receiver's side looks at what has come, unless it looks more often.
const PIECE: usize = 16;

/// A line. Clones are handles to the same line.
#[derive(Clone)]
pub struct Line(Rc<RefCell<State>>);

struct State {
    /// Nanoseconds a byte.
    byte_ns: u64,
    /// Bytes after which the board looks at what has come.
    piece: usize,
    to_board: VecDeque<u8>,
    /// The pieces of `to_board`: when the last byte of each arrives (ns), and its length.
    pieces: VecDeque<(u64, usize)>,
    /// Until when each direction is busy (ns).
    to_board_busy: u64,
    to_host_busy: u64,
    to_host: VecDeque<(Instant, Vec<u8>)>,
    reader: Option<Waker>,
    /// The board's receiver has lost bytes and is to say so.
    has_overrun: bool,
    /// The board's transmitter hangs.
    tx_hangs: bool,
    /// Nothing gets through.
    is_cut: bool,
}

impl Line {
    /// A line of `baud` bits a second; 0 takes no time.
    pub fn new(baud: u32) -> Self {
        Self::in_pieces(baud, |_| PIECE)
    }

    /// One whose board looks so often at what has come.
    pub fn looked_at(baud: u32, every: Duration) -> Self {
        Self::in_pieces(baud, |byte_ns| {
            let bytes = (every.as_micros() * 1000).checked_div(byte_ns);
            bytes.map_or(PIECE, |bytes| (bytes as usize).clamp(1, PIECE))
        })
    }

    fn in_pieces(baud: u32, piece: impl Fn(u64) -> usize) -> Self {
        let byte_ns = 10_000_000_000u64.checked_div(baud.into()).unwrap_or(0);
        let piece = piece(byte_ns);
        Self(Rc::new(RefCell::new(State {
            byte_ns,
            piece,
            to_board: VecDeque::new(),
            pieces: VecDeque::new(),
            to_board_busy: 0,
            to_host_busy: 0,
            to_host: VecDeque::new(),
            reader: None,
            has_overrun: false,
            tx_hangs: false,
            is_cut: false,
        })))
    }

    /// The host sends bytes; they follow those that are still on the line.
    pub fn host_sends(&self, bytes: &[u8]) {
        let mut state = self.0.borrow_mut();
        if state.is_cut {
            return;
        }
        for piece in bytes.chunks(state.piece) {
            let begin = begin(state.to_board_busy);
            state.to_board_busy = begin + state.byte_ns * piece.len() as u64;
            let arrival = (state.to_board_busy, piece.len());
            state.pieces.push_back(arrival);
            state.to_board.extend(piece);
        }
        if let Some(reader) = state.reader.take() {
            reader.wake();
        }
    }

    /// The board's receiver loses whatever is on the line, and says so once.
    pub fn overrun(&self) {
        let mut state = self.0.borrow_mut();
        state.to_board.clear();
        state.pieces.clear();
        state.has_overrun = true;
        if let Some(reader) = state.reader.take() {
            reader.wake();
        }
    }

    /// From now on what the board sends never leaves, and its `write` never ends; or all is right
    /// again for those that begin then.
    pub fn hang_transmitter(&self, hangs: bool) {
        self.0.borrow_mut().tx_hangs = hangs;
    }

    /// Cuts the line, with what is on its way to the board, or mends it.
    pub fn cut(&self, is_cut: bool) {
        let mut state = self.0.borrow_mut();
        state.is_cut = is_cut;
        if is_cut {
            state.to_board.clear();
            state.pieces.clear();
            state.to_host.clear();
        }
    }

    /// Whether it is cut.
    pub fn is_cut(&self) -> bool {
        self.0.borrow().is_cut
    }

    /// Bytes of the host that have not reached the board yet.
    pub fn backlog(&self) -> usize {
        self.0.borrow().to_board.len()
    }

    /// The next frame that has arrived at the host, and when it did.
    pub fn host_receives(&self) -> Option<(Instant, Vec<u8>)> {
        self.0.borrow_mut().to_host.pop_front()
    }

    /// What has arrived at the board by now: the board's end for one without tasks.
    pub fn board_receives(&self, buffer: &mut [u8]) -> usize {
        self.0.borrow_mut().take_arrived(buffer)
    }

    /// A frame of the board that is at the host now: the board has paced it itself.
    pub fn board_sends(&self, frame: &[u8]) {
        self.0.borrow_mut().arrive(Instant::now(), frame);
    }

    /// The board's end.
    pub fn board_end(&self) -> (BoardRx, BoardTx) {
        (BoardRx(self.clone()), BoardTx(self.clone()))
    }
}

/// When a transmission can begin on a direction that is busy until `busy` (ns). The clock counts
/// microseconds: less than one of these after the end is the end itself, or every frame would
/// lose a fraction.
pub(crate) fn begin(busy: u64) -> u64 {
    let now = Instant::now().as_micros() * 1000;
    if now < busy + 1000 { busy } else { now }
}

/// The first microsecond at or after a time in ns.
pub(crate) fn instant(ns: u64) -> Instant {
    Instant::from_micros(ns.div_ceil(1000))
}

/// Waits for a time in ns. A timer would give way once even to what is already over, and a line
/// without a speed limit would get slower than the firmware.
pub(crate) async fn until(ns: u64) {
    if instant(ns) > Instant::now() {
        Timer::at(instant(ns)).await;
    }
}

/// The board's receiver.
pub struct BoardRx(Line);

impl ErrorType for BoardRx {
    type Error = ErrorKind;
}

impl Read for BoardRx {
    async fn read(&mut self, buffer: &mut [u8]) -> Result<usize, ErrorKind> {
        let line = &self.0.0;
        loop {
            let first = poll_fn(|context| {
                let mut state = line.borrow_mut();
                if std::mem::take(&mut state.has_overrun) {
                    return Poll::Ready(Err(ErrorKind::Other));
                }
                match state.pieces.front() {
                    Some(&(arrives, _)) => Poll::Ready(Ok(arrives)),
                    None => {
                        state.reader = Some(context.waker().clone());
                        Poll::Pending
                    }
                }
            })
            .await?;
            until(first).await;
            let count = line.borrow_mut().take_arrived(buffer);
            if count > 0 {
                return Ok(count);
            }
        }
    }
}

impl State {
    fn arrive(&mut self, at: Instant, frame: &[u8]) {
        if !self.is_cut {
            self.to_host.push_back((at, frame.to_vec()));
        }
    }

    fn take_arrived(&mut self, buffer: &mut [u8]) -> usize {
        let now = Instant::now();
        let mut count = 0;
        while let Some((arrives, length)) = self.pieces.front_mut() {
            if instant(*arrives) > now || count == buffer.len() {
                break;
            }
            let taken = (*length).min(buffer.len() - count);
            for (to, from) in buffer[count..].iter_mut().zip(self.to_board.drain(..taken)) {
                *to = from;
            }
            count += taken;
            *length -= taken;
            if *length == 0 {
                self.pieces.pop_front();
            }
        }
        count
    }
}

/// The board's transmitter.
pub struct BoardTx(Line);

impl ErrorType for BoardTx {
    type Error = Infallible;
}

impl Write for BoardTx {
    async fn write(&mut self, frame: &[u8]) -> Result<usize, Infallible> {
        let line = &self.0.0;
        if line.borrow().tx_hangs {
            pending::<()>().await;
        }
        let end = {
            let mut state = line.borrow_mut();
            state.to_host_busy = begin(state.to_host_busy) + state.byte_ns * frame.len() as u64;
            state.to_host_busy
        };
        until(end).await;
        line.borrow_mut().arrive(instant(end), frame);
        Ok(frame.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
