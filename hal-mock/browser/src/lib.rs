//! The virtual board, with handwheel's page behind it, as one WebAssembly module: for a page without a server
//! (`.ci/page`), and for Node (`board.mjs`).
//!
//! ```text
//!  page ──says──> Panel ──bytes──> Line ──> firmware's tasks ──> Plant       all on the board's time,
//!       <─hears──       <──────         <──────                              which `advance` moves
//! ```
//! It imports nothing; of what it exports, what stands below is for its host. Bytes and texts (UTF-8) go both ways through one buffer:
//! [`room`] makes it so long and says where it is; who gives bytes then tells how many they are, and what
//! answers with bytes answers how many they are, 0 for none.
//!
//! - [`start`] comes first. An instance of the module is one board.
//! - Its line has one host: whoever [`feed`]s and [`take`]s, or a page from [`open_page`] on.
//! - A panic, from the first [`start`] on, leaves an instance of which [`panic_text`] alone can be called.

mod board;

use std::cell::{Cell, RefCell};

use board::Board;

thread_local! {
    static BUFFER: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
    static BOARD: RefCell<Option<Board>> = const { RefCell::new(None) };
    /// What the board's settings are to be found in, once it starts.
    static FLASH: Cell<Vec<u8>> = const { Cell::new(Vec::new()) };
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Does something with the board.
///
/// # Panics
/// If none was started.
fn with<T>(act: impl FnOnce(&mut Board) -> T) -> T {
    BOARD.with_borrow_mut(|board| act(board.as_mut().expect("`start` comes first")))
}

/// The first `length` bytes of the buffer.
fn given(length: usize) -> Vec<u8> {
    let mut bytes = BUFFER.take();
    bytes.truncate(length);
    bytes
}

fn given_text(length: usize) -> String {
    String::from_utf8_lossy(&given(length)).into_owned()
}

/// Puts an answer into the buffer: its length.
fn answer(bytes: Vec<u8>) -> usize {
    let length = bytes.len();
    BUFFER.set(bytes);
    length
}

/// Makes the buffer `length` bytes long, and says where it is. What is in it stays. Where the memory is may
/// change with every call: it is to be looked for afterwards.
#[unsafe(no_mangle)]
pub extern "C" fn room(length: usize) -> *mut u8 {
    let mut buffer = BUFFER.take();
    buffer.resize(length, 0);
    let place = buffer.as_mut_ptr();
    BUFFER.set(buffer);
    place
}

/// Takes what the flash of the board that starts next holds, as [`flash_out`] has told it.
#[unsafe(no_mangle)]
pub extern "C" fn flash_in(length: usize) {
    FLASH.set(given(length));
}

/// Switches a board on: `pms5005`, `pioneer-arm`, `cm5` or `cm5-pass-through`, and behind a space the speed of its
/// host's line in baud if that is not the usual; 0 takes no time. The answer is what is wrong with it, in one line.
#[unsafe(no_mangle)]
pub extern "C" fn start(length: usize) -> usize {
    std::panic::set_hook(Box::new(|panic| PANIC.set(panic.to_string())));
    match Board::start(&given_text(length), &FLASH.take()) {
        Ok(board) => {
            BOARD.set(Some(board));
            0
        }
        Err(error) => answer(error.into_bytes()),
    }
}

/// Lets time pass, until so many microseconds after the start.
#[unsafe(no_mangle)]
pub extern "C" fn advance(until_us: f64) {
    with(|board| board.advance(until_us as u64));
}

/// Takes bytes of the host, which begin to arrive at the board now.
#[unsafe(no_mangle)]
pub extern "C" fn feed(length: usize) {
    with(|board| board.feed(&given(length)));
}

/// How many bytes of the host have not arrived at the board yet.
#[unsafe(no_mangle)]
pub extern "C" fn backlog() -> usize {
    with(|board| board.backlog())
}

/// The next frame that has arrived at the host.
#[unsafe(no_mangle)]
pub extern "C" fn take() -> usize {
    answer(with(Board::take).unwrap_or_default())
}

/// What the flash holds, if it has changed since the last time.
#[unsafe(no_mangle)]
pub extern "C" fn flash_out() -> usize {
    answer(with(Board::new_flash).unwrap_or_default())
}

/// Answers an inspector's question, JSON to JSON: `{"get":"state"}`, `{"set":{...}}`.
#[unsafe(no_mangle)]
pub extern "C" fn ask(length: usize) -> usize {
    let question = given_text(length);
    answer(with(|board| board.ask(&question)).into_bytes())
}

/// A page is the line's host from now on.
#[unsafe(no_mangle)]
pub extern "C" fn open_page() {
    with(Board::open_page);
}

/// Takes one message of the page, as `handwheel::web` describes them.
#[unsafe(no_mangle)]
pub extern "C" fn page_says(length: usize) {
    let message = given_text(length);
    with(|board| board.page_says(&message));
}

/// The next message to the page.
#[unsafe(no_mangle)]
pub extern "C" fn page_hears() -> usize {
    answer(with(Board::page_hears).unwrap_or_default().into_bytes())
}

/// Why the instance has ended, and where.
#[unsafe(no_mangle)]
pub extern "C" fn panic_text() -> usize {
    answer(PANIC.take().into_bytes())
}
