//! A TCP listener with places for [`MOST`] clients, for the board's line and for its inspector.
//!
//! Who comes and goes without a word gives its place back at once. When the places are full, a
//! newcomer takes that of the oldest client that has shut down its side, or else has said nothing
//! yet; among clients that all speak there is none. A web page can make a browser send bytes of its
//! choice to a port of this computer, but only behind an HTTP request line: that ends a connection.

use std::cell::Cell;
use std::io::{ErrorKind, Read, Write};
use std::net::{IpAddr, Ipv6Addr, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::rc::Rc;

use rustix::fd::{AsFd, BorrowedFd};
use rustix::net::sockopt::set_socket_send_buffer_size;

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
    place: String,
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
    pub fn open(whose: &'static str, address: Address<'_>) -> Result<Self, String> {
        let (listener, place) = address.listen(|address| {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let place = listener.local_addr()?;
            Ok((listener, place))
        })?;
        Ok(Self { listener, place, whose, refused: Rc::default() })
    }

    /// Where it is, for the user.
    pub fn place(&self) -> &str {
        &self.place
    }

    /// Where this computer reaches it.
    pub fn address(&self) -> Option<SocketAddr> {
        let mut address = self.listener.local_addr().ok()?;
        if address.ip().is_unspecified() {
            let loopback = if address.is_ipv4() {
                IpAddr::from([127, 0, 0, 1])
            } else {
                Ipv6Addr::LOCALHOST.into()
            };
            address.set_ip(loopback);
        }
        Some(address)
    }

    /// What tells that somebody comes.
    pub fn watch(&self) -> BorrowedFd<'_> {
        self.listener.as_fd()
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
    /// How many bytes may wait for a client that reads slowly.
    pub fn set_send_buffer(&self, bytes: usize) {
        // Without it such a client gets older bytes, and no other.
        let _ = set_socket_send_buffer_size(&self.stream, bytes);
    }

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

fn is_for_now(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Where to listen.
#[derive(Clone, Copy)]
pub struct Address<'a> {
    option: &'static str,
    text: &'a str,
    /// Nobody has asked for this one.
    is_default: bool,
}

impl<'a> Address<'a> {
    /// What was asked for with an option, or its default.
    pub fn new(option: &'static str, asked: Option<&'a str>, default: &'a str) -> Self {
        Self { option, text: asked.unwrap_or(default), is_default: asked.is_none() }
    }

    /// Binds something there, or in place of a default that is in use to a free port. Also answers
    /// where it is, for the user.
    pub fn listen<T>(
        &self,
        bind: impl Fn(&str) -> std::io::Result<(T, SocketAddr)>,
    ) -> Result<(T, String), String> {
        let Self { option, text, is_default } = *self;
        let error = match bind(text) {
            Ok((bound, place)) => return Ok((bound, place.to_string())),
            Err(error) => error,
        };
        let is_in_use = error.kind() == ErrorKind::AddrInUse;
        if is_in_use
            && is_default
            && let Some((host, _)) = text.rsplit_once(':')
            && let Ok((bound, place)) = bind(&format!("{host}:0"))
        {
            return Ok((bound, format!("{place}, because {text} is in use")));
        }
        let remedy = if is_in_use { "; port 0 takes a free one" } else { "" };
        Err(format!("{option} {text}: {error}{remedy}"))
    }
}

/// Whether no other computer reaches an address; also if it is none.
pub fn is_loopback(address: &str) -> bool {
    let mut addresses = address.to_socket_addrs().into_iter().flatten();
    addresses.all(|address| address.ip().is_loopback())
}
