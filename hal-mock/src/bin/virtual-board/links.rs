//! The ways to the board's serial line: a serial device (where the system has pseudo-terminals), TCP
//! clients, UDP peers.
//!
//! All of them carry the same session: what any of them sends goes onto the one line, what the
//! board sends goes to all. Nothing here waits for a client: one that does not read misses whole
//! frames, one that vanishes is forgotten.

use std::collections::VecDeque;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use hal_mock::wire::Line;
use rustix::fd::{AsFd, BorrowedFd};
use serde_json::{Value, json};

use crate::door::{self, Address, Door, Guest, Said};
use crate::follow::Follower;
use crate::machine::Served;

/// UDP peers at a time.
const MOST_PEERS: usize = door::MOST;
/// The longest datagram that there is.
const LONGEST_DATAGRAM: usize = 65_535;
/// Bytes on the line from which on clients have to wait with theirs: 89 ms at 115200 baud.
const BACKLOG: usize = 1024;
/// Bytes that a client may put onto the line before it is another one's turn.
const TURN: usize = 256;
/// A client that pauses within a frame for so long gives up its turn on the line.
const PATIENCE: Duration = Duration::from_millis(50);

/// What a host opens as its serial device.
pub trait Device {
    /// What to tell the user.
    fn place(&self) -> String;

    /// What tells that a host has sent something.
    fn watch(&self) -> BorrowedFd<'_>;

    /// Whether a host has it open.
    fn is_open(&self) -> bool;

    /// Forgets what the last host has not read.
    fn forget_unread(&self);

    /// Reads what a host has sent, without waiting; 0 when there is nothing.
    fn read(&mut self, buffer: &mut [u8]) -> usize;

    /// Writes what there is room for; 0 when there is none.
    fn write(&self, bytes: &[u8]) -> usize;
}

/// All links.
pub struct Links {
    serial: Option<Serial>,
    door: Door,
    clients: Vec<Client>,
    /// With where it is, for the user.
    udp: Option<(UdpSocket, String)>,
    /// The frames of the last datagram that have not had their turn.
    datagram: VecDeque<Vec<u8>>,
    datagrams_dropped: u32,
    /// Who has sent us a datagram, the latest last.
    peers: Vec<SocketAddr>,
    /// Whose turn on the line it is: 0 the serial device, 1 UDP, then the TCP clients.
    turn: usize,
}

/// The serial device and its host.
struct Serial {
    device: Box<dyn Device>,
    flow: Flow,
    was_open: bool,
}

/// A TCP client.
struct Client {
    guest: Guest,
    flow: Flow,
    is_there: bool,
}

impl AsRef<Guest> for Client {
    fn as_ref(&self) -> &Guest {
        &self.guest
    }
}

impl Links {
    /// Opens all of them, or says in one line what is in the way.
    pub fn open(
        serial: Option<Box<dyn Device>>,
        tcp: Address<'_>,
        udp: Option<Address<'_>>,
        machine: &dyn Served,
    ) -> Result<Self, String> {
        let bind = |address: &str| {
            let socket = UdpSocket::bind(address)?;
            socket.set_nonblocking(true)?;
            let place = socket.local_addr()?;
            Ok((socket, place))
        };
        Ok(Self {
            serial: serial.map(|device| Serial {
                device,
                flow: Flow::new(machine.follower()),
                was_open: false,
            }),
            door: Door::open("TCP", tcp)?,
            clients: Vec::new(),
            udp: udp.map(|udp| udp.listen(bind)).transpose()?,
            datagram: VecDeque::new(),
            datagrams_dropped: 0,
            peers: Vec::new(),
            turn: 0,
        })
    }

    /// Where they are, for the user.
    pub fn places(&self) -> Vec<String> {
        let mut places = Vec::new();
        places.extend(self.serial.iter().map(|serial| serial.device.place()));
        places.push(format!("TCP {}", self.door.place()));
        places.extend(self.udp.iter().map(|(_, place)| format!("UDP {place}")));
        places
    }

    /// Where this computer reaches the board by TCP.
    pub fn tcp(&self) -> Option<SocketAddr> {
        self.door.address()
    }

    /// How many are connected: whether the serial device is, TCP clients, UDP peers.
    pub fn connected(&self) -> (bool, usize, usize) {
        let serial_open = self.serial.as_ref().is_some_and(|serial| serial.was_open);
        (serial_open, self.clients.len(), self.peers.len())
    }

    /// The same for the inspector, with who and what was sent away.
    pub fn state(&self) -> Value {
        let (serial_open, tcp, udp) = self.connected();
        json!({
            "serial_open": serial_open,
            "tcp": tcp,
            "udp": udp,
            "refused": self.door.refused(),
            "datagrams_dropped": self.datagrams_dropped,
        })
    }

    /// What can bring bytes, to wait for. A full line takes nothing.
    pub fn watch<'a>(&'a self, line: &Line, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.push(self.door.watch());
        if line.backlog() <= BACKLOG {
            if self.datagram.is_empty() {
                fds.extend(self.udp.iter().map(|(udp, _)| udp.as_fd()));
            }
            fds.extend(self.clients.iter().filter_map(|client| client.guest.watch()));
            fds.extend(self.serial.iter().map(|serial| serial.device.watch()));
        }
    }

    /// Puts what the clients have sent onto the line.
    pub fn receive(&mut self, machine: &dyn Served) {
        let line = machine.line();
        self.door.admit(&mut self.clients, |guest| {
            guest.set_send_buffer(machine.send_buffer());
            Client { guest, flow: Flow::new(machine.follower()), is_there: true }
        });
        self.serial.iter_mut().for_each(Serial::look);

        let sources = self.clients.len() + 2;
        let first = self.turn;
        for source in (0..sources).map(|k| (first + k) % sources) {
            if line.backlog() > BACKLOG {
                // It goes on here when there is room again.
                self.turn = source;
                break;
            }
            match source {
                0 => self.serial.iter_mut().for_each(|serial| serial.receive(line)),
                1 => self.receive_datagram(machine),
                _ => self.clients[source - 2].receive(line),
            }
        }
        self.serial.iter_mut().for_each(|serial| serial.flow.pass_held(line));
        self.clients.iter_mut().for_each(|client| client.flow.pass_held(line));
        self.clients.retain(|client| client.is_there);
    }

    /// Takes a turn's worth of whole frames of the last datagram, or the next one.
    fn receive_datagram(&mut self, machine: &dyn Served) {
        let mut passed = 0;
        while let Some(frame) = self.datagram.pop_front_if(|_| passed < TURN) {
            passed += frame.len();
            machine.line().host_sends(&frame);
        }
        let Some((udp, _)) = self.udp.as_ref().filter(|_| passed == 0) else { return };
        let mut buffer = [0; LONGEST_DATAGRAM];
        let Ok((count, peer)) = udp.recv_from(&mut buffer) else { return };
        let Some(frames) = machine.follower().whole(&buffer[..count]) else {
            self.datagrams_dropped = self.datagrams_dropped.wrapping_add(1);
            log::warn!("datagram from {peer} dropped: its {count} bytes are no whole frames");
            return;
        };
        self.datagram.extend(frames);
        self.peers.retain(|known| *known != peer);
        if self.peers.len() == MOST_PEERS {
            self.peers.remove(0);
        }
        self.peers.push(peer);
        self.receive_datagram(machine);
    }

    /// Sends a frame of the board to everybody.
    pub fn send(&mut self, frame: &[u8]) {
        self.serial.iter_mut().for_each(|serial| serial.send(frame));
        self.clients
            .retain_mut(|client| client.flow.send(frame, |bytes| client.guest.write(bytes)));
        for (udp, peer) in
            self.udp.iter().flat_map(|(udp, _)| self.peers.iter().map(move |p| (udp, p)))
        {
            // A datagram that finds no room, or nobody, is lost, as on the radio.
            let _ = udp.send_to(frame, peer);
        }
    }
}

impl Serial {
    /// Looks whether a host has come or gone.
    fn look(&mut self) {
        let is_open = self.device.is_open();
        if self.was_open && !is_open {
            self.device.forget_unread();
        }
        self.was_open = is_open;
    }

    /// Takes a turn's worth of what was sent. Whoever has closed the device may have sent it before.
    fn receive(&mut self, line: &Line) {
        let mut buffer = [0; TURN];
        let count = self.device.read(&mut buffer);
        self.flow.pass(&buffer[..count], line);
    }

    fn send(&mut self, frame: &[u8]) {
        if self.was_open {
            let device = &self.device;
            self.flow.send(frame, |bytes| Some(device.write(bytes)));
        } else {
            self.flow.unsent.clear();
        }
    }
}

impl Client {
    /// Takes a turn's worth of what it has sent.
    fn receive(&mut self, line: &Line) {
        let mut buffer = [0; TURN];
        match self.guest.read(&mut buffer) {
            Said::Bytes(count) => self.flow.pass(&buffer[..count], line),
            Said::Nothing | Said::End => {}
            Said::Gone => self.is_there = false,
        }
    }
}

/// One client's stream, kept in whole frames both ways.
struct Flow {
    /// Follows the client's frames.
    follower: Box<dyn Follower>,
    /// When something came last.
    since: Instant,
    /// The end of a frame that the client had no room for.
    unsent: Vec<u8>,
}

impl Flow {
    fn new(follower: Box<dyn Follower>) -> Self {
        Self { follower, since: Instant::now(), unsent: Vec::new() }
    }

    /// Passes bytes on, except for an incomplete frame at their end.
    fn pass(&mut self, bytes: &[u8], line: &Line) {
        if bytes.is_empty() {
            return;
        }
        self.since = Instant::now();
        line.host_sends(&self.follower.follow(bytes));
    }

    /// Passes on the incomplete frame of a client that has paused too long.
    fn pass_held(&mut self, line: &Line) {
        if self.follower.is_waiting() && self.since.elapsed() >= PATIENCE {
            line.host_sends(&self.follower.give_up());
        }
    }

    /// Sends a frame, or none of it if the last one is still in the way. `write` answers how much
    /// it took, `None` when the client has gone. Whether it is still there.
    fn send(&mut self, frame: &[u8], mut write: impl FnMut(&[u8]) -> Option<usize>) -> bool {
        if self.unsent.is_empty() {
            self.unsent.extend(frame);
            let Some(count) = write(&self.unsent) else { return false };
            // Nothing of it has gone: leave it out altogether.
            self.unsent.drain(..if count == 0 { frame.len() } else { count });
        } else {
            let Some(count) = write(&self.unsent) else { return false };
            self.unsent.drain(..count);
            if self.unsent.is_empty() {
                return self.send(frame, write);
            }
        }
        true
    }
}
