//! Finds the only board there is.
//!
//! It listens to every serial port at once and writes nothing to one on which nobody has spoken our
//! language: there may be a 3D printer. (That opening a port raises DTR, which resets some Arduinos, is the
//! operating system's doing; a named `--link` opens no other port.) A Pioneer Arm that nobody has spoken to is
//! silent, and so is not found: its link has to be named. Without a serial board the virtual one's address
//! is tried.

use std::time::{Duration, Instant};

use crate::client::Client;
use crate::error::Error;
use crate::link::{DEFAULT_BAUD, Link, VIRTUAL_BOARD};
use crate::session::Session;
use crate::transport::{self, Transport};

/// A board says something at least once a second.
const LISTEN: Duration = Duration::from_millis(1300);

/// The only board among this computer's serial ports, or the virtual one.
///
/// # Errors
/// [`Error::NoBoard`] names what was found; what keeps the board from being used.
pub fn find() -> Result<Client, Error> {
    find_among(&transport::ports(), VIRTUAL_BOARD)
}

/// The same, heard and not asked anything yet.
pub(crate) fn hear() -> Result<Client, Error> {
    hear_among(&transport::ports(), VIRTUAL_BOARD)
}

/// What listening to a port came to.
enum Found {
    Board(Box<dyn Transport>, Box<Session>),
    /// So many bytes, none of a board.
    Noise(u64),
    Closed(Error),
}

/// The same among these serial ports, or at this TCP address.
///
/// # Errors
/// As [`find`].
pub fn find_among(ports: &[String], tcp: &str) -> Result<Client, Error> {
    let mut client = hear_among(ports, tcp)?;
    client.meet()?;
    Ok(client)
}

fn hear_among(ports: &[String], tcp: &str) -> Result<Client, Error> {
    let found = std::thread::scope(|scope| {
        let listeners: Vec<_> =
            ports.iter().map(|port| (port, scope.spawn(move || listen(port)))).collect();
        let joined =
            listeners.into_iter().filter_map(|(port, thread)| Some((port, thread.join().ok()?)));
        joined.collect::<Vec<_>>()
    });
    let (mut boards, mut others) = (Vec::new(), Vec::new());
    for (port, found) in found {
        match found {
            Found::Board(transport, session) => boards.push((port, transport, session)),
            Found::Noise(0) => others.push(format!("{port} (silent)")),
            Found::Noise(_) => others.push(format!("{port} (no language of ours)")),
            Found::Closed(Error::Busy(text)) => others.push(text),
            Found::Closed(_) => {}
        }
    }
    match boards.len() {
        0 => {}
        1 => {
            if let Some((port, transport, session)) = boards.pop() {
                let link = Link::Serial(port.clone(), DEFAULT_BAUD);
                return Ok(Client::new(link, transport, *session));
            }
        }
        count => {
            let names: Vec<_> =
                boards.iter().map(|(port, ..)| format!("serial:{port}@{DEFAULT_BAUD}")).collect();
            return Err(Error::NoBoard(format!(
                "{count} boards are there; name one with --link: {}",
                names.join(", ")
            )));
        }
    }
    let link = Link::Tcp(tcp.into());
    match transport::open(&link) {
        Ok(transport) => {
            let mut client = Client::new(link, transport, Session::new());
            client.find_out()?;
            Ok(client)
        }
        Err(_) => {
            others.push(format!("{link} (nobody listens)"));
            Err(Error::NoBoard(format!(
                "no board found: {}; name the link with --link, or start a virtual board with `cargo run --release -p hal-mock`",
                others.join(", ")
            )))
        }
    }
}

/// Listens to a serial port, and writes nothing.
fn listen(port: &str) -> Found {
    let mut transport = match transport::open_serial(port, DEFAULT_BAUD) {
        Ok(transport) => transport,
        Err(error) => return Found::Closed(error),
    };
    let (mut session, mut buffer) = (Session::new(), [0; 1024]);
    let begun = Instant::now();
    while begun.elapsed() < LISTEN {
        match transport.read(&mut buffer, Duration::from_millis(20)) {
            Ok(count) => session.receive(buffer.get(..count).unwrap_or_default()),
            Err(_) => break,
        }
        if session.personality().is_some() {
            return Found::Board(transport, Box::new(session));
        }
    }
    Found::Noise(session.received())
}
