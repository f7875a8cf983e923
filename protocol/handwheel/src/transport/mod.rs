//! The ways to a board: serial, TCP, UDP. Two methods each.

mod holder;
mod serial;

use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs, UdpSocket};
use std::time::Duration;

use crate::error::Error;
use crate::link::Link;

pub use serial::{open as open_serial, ports};

/// How long a TCP connection may take to be made.
const CONNECT: Duration = Duration::from_secs(3);

/// A line to a board.
pub trait Transport: Send {
    /// Reads what has come, and waits for at most `patience` if there is nothing; then 0.
    ///
    /// # Errors
    /// When the line is gone.
    fn read(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize>;

    /// Writes all of it: a whole frame, which is one datagram on UDP.
    ///
    /// # Errors
    /// When the line is gone.
    fn write(&mut self, frame: &[u8]) -> io::Result<()>;
}

/// Opens a link.
///
/// # Errors
/// [`Error::CannotOpen`] and [`Error::Busy`], with the remedy; [`Error::NoLink`] for `auto`, which is
/// [`auto::find`](crate::auto::find)'s, and for what the program itself carries.
pub fn open(link: &Link) -> Result<Box<dyn Transport>, Error> {
    match link {
        Link::Serial(device, baud) => open_serial(device, *baud),
        Link::Tcp(address) => {
            let stream = connect(address).map_err(|e| cannot(link, &e))?;
            stream.set_nodelay(true).map_err(|e| cannot(link, &e))?;
            Ok(Box::new(Tcp(stream)))
        }
        Link::Udp(address) => {
            let socket = dial(address).map_err(|e| cannot(link, &e))?;
            Ok(Box::new(Udp(socket)))
        }
        Link::Auto | Link::Other(_) => Err(Error::NoLink(link.to_string())),
    }
}

fn cannot(link: &Link, error: &io::Error) -> Error {
    let remedy = match error.kind() {
        ErrorKind::ConnectionRefused => {
            "nobody listens there; start the board (a virtual one: `cargo run --release -p hal-mock`), or see that the port is right"
        }
        ErrorKind::TimedOut => "no answer; see that the board is on, and that the address is right",
        _ => return Error::CannotOpen(format!("{link}: {error}; see that the address is right")),
    };
    Error::CannotOpen(format!("{link}: {remedy}"))
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "no such host; look at the name");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn dial(address: &str) -> io::Result<UdpSocket> {
    let mut last = io::Error::new(ErrorKind::NotFound, "no such host");
    for address in address.to_socket_addrs()? {
        let any = if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        match UdpSocket::bind(any).and_then(|socket| socket.connect(address).map(|()| socket)) {
            Ok(socket) => return Ok(socket),
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// What a read that brought nothing is.
fn nothing_yet(error: io::Error) -> io::Result<usize> {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => Ok(0),
        _ => Err(error),
    }
}

/// The least time that a socket waits: none would be for ever.
const LEAST: Duration = Duration::from_millis(1);

struct Tcp(TcpStream);

impl Transport for Tcp {
    fn read(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
        self.0.set_read_timeout(Some(patience.max(LEAST)))?;
        match self.0.read(buffer) {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "the other side has closed it")),
            Ok(count) => Ok(count),
            Err(error) => nothing_yet(error),
        }
    }

    fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        self.0.set_write_timeout(Some(CONNECT))?;
        self.0.write_all(frame)
    }
}

struct Udp(UdpSocket);

impl Transport for Udp {
    fn read(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
        self.0.set_read_timeout(Some(patience.max(LEAST)))?;
        match self.0.recv(buffer) {
            Err(error) => nothing_yet(nobody(error)),
            Ok(count) => Ok(count),
        }
    }

    fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        self.0.send(frame).map(drop).map_err(nobody)
    }
}

/// A computer without a program at that port says so; Windows calls it a reset.
fn nobody(error: io::Error) -> io::Error {
    match error.kind() {
        ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset => {
            io::Error::new(error.kind(), "nobody listens there")
        }
        _ => error,
    }
}
