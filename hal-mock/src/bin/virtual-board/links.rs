//! The ways to the board's serial line: a pseudo-terminal, TCP clients, UDP peers.
//!
//! All of them carry the same session: what any of them sends goes onto the one line, what the
//! board sends goes to all. Nothing here waits for a client: one that does not read misses whole
//! frames, one that vanishes is forgotten.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};
use std::path::Path;
use std::time::{Duration, Instant};

use hal_mock::wire::Line;
use protocol::pms5005::Receiver;

use crate::pty::Pty;

/// TCP clients, and UDP peers, at a time.
const MOST_CLIENTS: usize = 16;
/// Bytes on the line from which on clients have to wait with theirs.
const BACKLOG: usize = 4096;
/// A client that pauses within a frame for so long gives up its turn on the line.
const PATIENCE: Duration = Duration::from_millis(50);

/// All links.
pub struct Links {
    pty: Pty,
    pty_flow: Flow,
    listener: TcpListener,
    clients: Vec<(TcpStream, Flow)>,
    udp: UdpSocket,
    /// Who has sent us a datagram, the latest last.
    peers: Vec<SocketAddr>,
}

impl Links {
    /// Opens all of them, or says in one line what is in the way.
    pub fn open(pty_link: Option<&Path>, tcp: &str, udp: &str) -> Result<Self, String> {
        let listener = TcpListener::bind(tcp).map_err(|e| format!("--tcp {tcp}: {e}"))?;
        let udp_socket = UdpSocket::bind(udp).map_err(|e| format!("--udp {udp}: {e}"))?;
        listener.set_nonblocking(true).map_err(|e| format!("--tcp {tcp}: {e}"))?;
        udp_socket.set_nonblocking(true).map_err(|e| format!("--udp {udp}: {e}"))?;
        Ok(Self {
            pty: Pty::open(pty_link)?,
            pty_flow: Flow::new(),
            listener,
            clients: Vec::new(),
            udp: udp_socket,
            peers: Vec::new(),
        })
    }

    /// Where they are, for the user.
    pub fn places(&self) -> Vec<String> {
        let shown = |address: std::io::Result<SocketAddr>| {
            address.map_or_else(|e| e.to_string(), |address| address.to_string())
        };
        vec![
            self.pty.place(),
            format!("TCP {}", shown(self.listener.local_addr())),
            format!("UDP {}", shown(self.udp.local_addr())),
        ]
    }

    /// How many are connected: the pseudo-terminal, TCP clients, UDP peers.
    pub fn connected(&self) -> (bool, usize, usize) {
        (self.pty.is_open(), self.clients.len(), self.peers.len())
    }

    /// What can bring bytes, to wait for. A closed pseudo-terminal would end every wait at once,
    /// and a full line takes nothing.
    pub fn watch<'a>(&'a self, line: &Line, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.push(self.listener.as_fd());
        if line.backlog() <= BACKLOG {
            fds.push(self.udp.as_fd());
            fds.extend(self.clients.iter().map(|(stream, _)| stream.as_fd()));
            if self.pty.is_open() {
                fds.push(self.pty.as_fd());
            }
        }
    }

    /// Puts what the clients have sent onto the line.
    pub fn receive(&mut self, line: &Line) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.clients.len() < MOST_CLIENTS
                && stream.set_nonblocking(true).is_ok()
                && stream.set_nodelay(true).is_ok()
            {
                self.clients.push((stream, Flow::new()));
            }
        }
        let mut buffer = [0; 2048];
        if self.pty.is_open() && line.backlog() <= BACKLOG {
            let count = self.pty.read(&mut buffer);
            self.pty_flow.pass(&buffer[..count], line);
        }
        self.pty_flow.pass_held(line);
        self.clients.retain_mut(|(stream, flow)| {
            let alive = line.backlog() > BACKLOG
                || match stream.read(&mut buffer) {
                    Ok(0) => false,
                    Ok(count) => {
                        flow.pass(&buffer[..count], line);
                        true
                    }
                    Err(e) => matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
                };
            flow.pass_held(line);
            alive
        });
        while line.backlog() <= BACKLOG
            && let Ok((count, peer)) = self.udp.recv_from(&mut buffer)
        {
            line.host_sends(&buffer[..count]);
            self.peers.retain(|known| *known != peer);
            if self.peers.len() == MOST_CLIENTS {
                self.peers.remove(0);
            }
            self.peers.push(peer);
        }
    }

    /// Sends a frame of the board to everybody.
    pub fn send(&mut self, frame: &[u8]) {
        if self.pty.is_open() {
            let pty = &self.pty;
            self.pty_flow.send(frame, |bytes| Some(pty.write(bytes)));
        } else {
            self.pty_flow.unsent.clear();
        }
        self.clients.retain_mut(|(stream, flow)| {
            flow.send(frame, |bytes| match stream.write(bytes) {
                Ok(count) => Some(count),
                Err(e) if e.kind() == ErrorKind::WouldBlock => Some(0),
                Err(_) => None,
            })
        });
        for peer in &self.peers {
            // A datagram that finds no room, or nobody, is lost, as on the radio.
            let _ = self.udp.send_to(frame, peer);
        }
    }
}

/// One client's stream, kept in whole frames both ways.
struct Flow {
    /// Follows the client's frames, so that those of two clients do not mix on the line.
    receiver: Receiver,
    /// The beginning of a frame whose rest has not come yet, and since when.
    held: Vec<u8>,
    since: Instant,
    /// The end of a frame that the client had no room for.
    unsent: Vec<u8>,
}

impl Flow {
    fn new() -> Self {
        Self {
            receiver: Receiver::new(),
            held: Vec::new(),
            since: Instant::now(),
            unsent: Vec::new(),
        }
    }

    /// Passes bytes on, except for an incomplete frame at their end.
    fn pass(&mut self, bytes: &[u8], line: &Line) {
        if bytes.is_empty() {
            return;
        }
        self.held.extend(bytes);
        self.since = Instant::now();
        let mut unseen = bytes;
        while self.receiver.receive(&mut unseen).is_some() {}
        let complete = self.held.len().saturating_sub(self.receiver.pending());
        line.host_sends(&self.held[..complete]);
        self.held.drain(..complete);
    }

    /// Passes on the incomplete frame of a client that has paused too long.
    fn pass_held(&mut self, line: &Line) {
        if !self.held.is_empty() && self.since.elapsed() >= PATIENCE {
            line.host_sends(&self.held);
            self.held.clear();
            self.receiver = Receiver::new();
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
