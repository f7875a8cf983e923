//! A TCP listener with places for [`MOST`] clients, for the board's line and for its inspector.
//!
//! Who comes and goes without a word gives its place back at once. When the places are full, a
//! newcomer takes that of the oldest client that has shut down its side, or else has said nothing
//! yet; among clients that all speak there is none. A web page can make a browser send bytes of its
//! choice to a port of this computer, but only behind an HTTP request line: that ends a connection.

use std::cell::Cell;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::rc::Rc;

/// Clients at a time.
pub const MOST: usize = 16;

/// What an HTTP request begins with. No frame and no question here begins like that.
const METHODS: [&[u8]; 9] = [
    b"GET ",
    b"HEAD ",
    b"POST ",
    b"PUT ",
    b"DELETE ",
    b"CONNECT ",
    b"OPTIONS ",
    b"TRACE ",
    b"PATCH ",
];

/// The listener.
pub struct Door {
    listener: TcpListener,
    /// What its clients are called in the log.
    whose: &'static str,
    refused: Rc<Cell<u32>>,
}

/// A client.
pub struct Guest {
    stream: TcpStream,
    name: String,
    /// It has said something, and not in HTTP.
    has_spoken: bool,
    /// What it has said may still become an HTTP request.
    is_doubtful: bool,
    /// It has nothing more to say; it may still listen.
    has_ended: bool,
    refused: Rc<Cell<u32>>,
}

/// What a client has to say.
pub enum Said {
    /// So many bytes.
    Bytes(usize),
    Nothing,
    /// Nothing any more.
    End,
    /// It is not there any more, or has no business here.
    Gone,
}

impl Door {
    pub fn open(whose: &'static str, address: &str) -> std::io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, whose, refused: Rc::default() })
    }

    /// Where it is, for the user.
    pub fn place(&self) -> String {
        self.listener.local_addr().map_or_else(|e| e.to_string(), |address| address.to_string())
    }

    /// Clients that were sent away so far.
    pub fn refused(&self) -> u32 {
        self.refused.get()
    }

    /// Lets in who waits, as a client of the caller's making.
    pub fn admit<C: AsRef<Guest>>(&self, clients: &mut Vec<C>, new: impl Fn(Guest) -> C) {
        while let Ok((stream, address)) = self.listener.accept() {
            let name = format!("{} client {address}", self.whose);
            if clients.len() >= MOST {
                let oldest =
                    |what: fn(&Guest) -> bool| clients.iter().position(|c| what(c.as_ref()));
                let Some(leaves) =
                    oldest(|guest| guest.has_ended).or_else(|| oldest(|guest| !guest.has_spoken))
                else {
                    self.refused.set(self.refused.get().wrapping_add(1));
                    log::warn!(
                        "{name} is refused: all {MOST} places are taken by clients that speak"
                    );
                    continue;
                };
                let left = clients.remove(leaves);
                log::warn!(
                    "{} has said nothing more and makes room for another",
                    left.as_ref().name
                );
            }
            if stream.set_nonblocking(true).is_ok() && stream.set_nodelay(true).is_ok() {
                clients.push(new(Guest {
                    stream,
                    name,
                    has_spoken: false,
                    is_doubtful: false,
                    has_ended: false,
                    refused: self.refused.clone(),
                }));
            }
        }
    }
}

impl Guest {
    /// Reads without waiting.
    pub fn read(&mut self, buffer: &mut [u8]) -> Said {
        if !self.has_spoken {
            let mut beginning = [0; 8];
            let begun = match self.stream.peek(&mut beginning) {
                // Nobody waits for an answer to nothing.
                Ok(0) => return Said::Gone,
                Ok(count) => &beginning[..count],
                Err(e) => return if is_for_now(&e) { Said::Nothing } else { Said::Gone },
            };
            if METHODS.iter().any(|method| begun.starts_with(method)) {
                self.refused.set(self.refused.get().wrapping_add(1));
                log::warn!("{} is refused: it speaks HTTP", self.name);
                return Said::Gone;
            }
            self.is_doubtful = METHODS.iter().any(|method| method.starts_with(begun));
            if self.is_doubtful {
                return Said::Nothing;
            }
            self.has_spoken = true;
        }
        match self.stream.read(buffer) {
            Ok(0) => {
                self.has_ended = true;
                Said::End
            }
            Ok(count) => Said::Bytes(count),
            Err(e) if is_for_now(&e) => Said::Nothing,
            Err(_) => Said::Gone,
        }
    }

    /// Writes what there is room for; `None` when the client has gone.
    pub fn write(&self, bytes: &[u8]) -> Option<usize> {
        match (&self.stream).write(bytes) {
            Ok(count) => Some(count),
            Err(e) if is_for_now(&e) => Some(0),
            Err(_) => None,
        }
    }

    /// What tells that it says something, if there is any use in waiting for it.
    pub fn watch(&self) -> Option<BorrowedFd<'_>> {
        (!self.has_ended && !self.is_doubtful).then(|| self.stream.as_fd())
    }
}

impl AsFd for Door {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.listener.as_fd()
    }
}

fn is_for_now(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Why an address will not do, and what would.
pub fn cannot_listen(option: &str, address: &str, error: &std::io::Error) -> String {
    let remedy = match error.kind() {
        ErrorKind::AddrInUse => "; port 0 takes a free one",
        ErrorKind::InvalidInput => "; expected an address and a port, as 127.0.0.1:5005",
        _ => "",
    };
    format!("{option} {address}: {error}{remedy}")
}
