//! The server: a thread for each connection, and one for the board.

use std::io;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::Value;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Message, WebSocket};

use super::PageId;
use super::host::{self, Call};
use super::http::{Gate, Request, answer, is_for_now, refuse};
use crate::error::Error;
use crate::link::Link;

/// Connections at a time, pages and files.
const MOST: usize = 32;
/// The longest message of a page: a backup is some 20 KB.
const LONGEST: usize = 1 << 18;
/// Messages that may wait for a page, which is closed when it takes none, and for the board's thread, which lets
/// pages wait.
const QUEUE: usize = 512;
/// How long a page's connection listens before it looks what there is to say, and how long one takes to write.
const TICK: Duration = Duration::from_millis(5);
const WRITE: Duration = Duration::from_secs(2);

/// The world around a virtual board: takes what the inspector takes, and answers as it.
pub type World = Box<dyn Fn(&Value) -> Result<Value, String> + Send>;

/// What is served, and where.
pub struct Serve {
    /// Where to listen. Off loopback a token is wanted in the page's address.
    pub listen: TcpListener,
    /// The board.
    pub link: Link,
    /// Names of this computer by which the page may be asked for, besides addresses and loopback.
    pub names: Vec<String>,
    /// Of a virtual board.
    pub world: Option<World>,
}

/// A page that is being served.
pub struct Page {
    /// Where, for a browser.
    pub address: String,
    board: JoinHandle<()>,
}

impl Page {
    /// Waits until what it drove is stopped, once it was told to end.
    pub fn wait(self) {
        // A panic of its thread has been told.
        let _ = self.board.join();
    }
}

/// Serves the page from threads of its own, until `end` becomes true.
///
/// # Errors
/// What is wrong with the listener.
pub fn serve(serve: Serve, end: Arc<AtomicBool>) -> Result<Page, Error> {
    let Serve { listen, link, names, world } = serve;
    let cannot = |error: io::Error| Error::CannotOpen(format!("the page: {error}"));
    let place = listen.local_addr().map_err(cannot)?;
    listen.set_nonblocking(true).map_err(cannot)?;
    let token = match place.ip().is_loopback() {
        true => None,
        false => Some(token()?),
    };
    // Seen from this computer; elsewhere its own address stands in place of localhost.
    let host = match place.ip().is_unspecified() {
        true => format!("localhost:{}", place.port()),
        false => place.to_string(),
    };
    let address = match &token {
        None => format!("http://{host}/"),
        Some(token) => format!("http://{host}/?token={token}"),
    };
    let (calls, heard) = sync_channel(QUEUE);
    let gate = Arc::new(Gate { names, token });
    let board = std::thread::spawn({
        let end = end.clone();
        move || host::run(link, world, &heard, &end)
    });
    std::thread::spawn(move || accept(&listen, &gate, &calls, &end));
    Ok(Page { address, board })
}

/// What nobody guesses.
fn token() -> Result<String, Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)
        .map_err(|error| Error::CannotOpen(format!("no token for the page: {error}")))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

fn accept(listen: &TcpListener, gate: &Arc<Gate>, calls: &SyncSender<Call>, end: &Arc<AtomicBool>) {
    let open = Arc::new(AtomicUsize::new(0));
    let pages = Arc::new(AtomicU64::new(0));
    while !end.load(Ordering::Relaxed) {
        let Ok((stream, _)) = listen.accept() else {
            std::thread::sleep(TICK);
            continue;
        };
        if open.load(Ordering::Relaxed) >= MOST || stream.set_nonblocking(false).is_err() {
            continue;
        }
        open.fetch_add(1, Ordering::Relaxed);
        let (gate, calls, open, end) = (gate.clone(), calls.clone(), open.clone(), end.clone());
        let pages = pages.clone();
        std::thread::spawn(move || {
            // Whoever has gone needs no answer.
            let _ = connection(stream, &gate, &calls, &pages, &end);
            open.fetch_sub(1, Ordering::Relaxed);
        });
    }
}

fn connection(
    mut stream: TcpStream,
    gate: &Gate,
    calls: &SyncSender<Call>,
    pages: &AtomicU64,
    end: &AtomicBool,
) -> io::Result<()> {
    let Some(request) = Request::read(&mut stream)? else {
        return refuse(&mut stream, ("400 Bad Request", "this is the page of a motion controller"));
    };
    if let Err(refusal) = gate.check(&request) {
        return refuse(&mut stream, refusal);
    }
    match (&request.key, request.path.as_str()) {
        (Some(key), "/socket") => {
            io::Write::write_all(&mut stream, format!(
                "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {}\r\n\r\n",
                derive_accept_key(key.as_bytes())
            ).as_bytes())?;
            let page = pages.fetch_add(1, Ordering::Relaxed) + 1;
            let (says, said) = sync_channel(QUEUE);
            let _ = calls.send(Call::Open(page, says));
            let result = talk(stream, calls, page, &said, end);
            let _ = calls.send(Call::Closed(page));
            result
        }
        _ => answer(&mut stream, &request.path),
    }
}

/// Carries messages both ways until one side ends.
fn talk(
    stream: TcpStream,
    calls: &SyncSender<Call>,
    page: PageId,
    said: &Receiver<String>,
    end: &AtomicBool,
) -> io::Result<()> {
    stream.set_nodelay(true)?;
    stream.set_read_timeout(Some(TICK))?;
    stream.set_write_timeout(Some(WRITE))?;
    let config =
        WebSocketConfig::default().max_message_size(Some(LONGEST)).max_frame_size(Some(LONGEST));
    let mut socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
    while !end.load(Ordering::Relaxed) {
        match socket.read() {
            Ok(Message::Text(text)) => {
                let _ = calls.send(Call::Said(page, text.to_string()));
            }
            Ok(Message::Close(_)) => break,
            Ok(_) => {}
            Err(tungstenite::Error::Io(error)) if is_for_now(&error) => {}
            Err(_) => break,
        }
        loop {
            match said.try_recv() {
                Ok(text) => socket.write(Message::text(text)).map_err(io::Error::other)?,
                Err(TryRecvError::Empty) => break,
                // It took nothing for too long.
                Err(TryRecvError::Disconnected) => return Ok(()),
            }
        }
        match socket.flush() {
            Ok(()) => {}
            Err(tungstenite::Error::Io(error)) if is_for_now(&error) => {}
            Err(error) => return Err(io::Error::other(error)),
        }
    }
    let _ = socket.close(None);
    let _ = socket.flush();
    Ok(())
}

/// Says something to a page. Whether it has room for it.
pub(super) fn say(to: &SyncSender<String>, text: String) -> bool {
    !matches!(to.try_send(text), Err(TrySendError::Full(_) | TrySendError::Disconnected(_)))
}
