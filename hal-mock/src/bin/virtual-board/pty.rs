//! The board's pseudo-terminal: what a host program opens as its serial device.
//!
//! The device is raw (no echo, no line editing) whether or not the host program asks for it. As
//! long as nobody has it open, nothing is written, and what was not read is forgotten when it is
//! closed, so that a host does not begin with old news.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

/// A pseudo-terminal, and perhaps a symbolic link to it, removed when it is dropped.
pub struct Pty {
    master: OwnedFd,
    device: PathBuf,
    link: Option<PathBuf>,
}

impl Pty {
    /// Opens a pseudo-terminal; `link` becomes a symbolic link to it, in place of one that a board
    /// has left behind.
    pub fn open(link: Option<&Path>) -> Result<Self, String> {
        let (master, device) =
            Self::make().map_err(|e| format!("cannot open a pseudo-terminal: {e}"))?;
        let mut pty = Self { master, device, link: None };
        if let Some(link) = link {
            let complain = |e: std::io::Error| {
                let remedy = match e.kind() {
                    ErrorKind::AlreadyExists => "; choose a name that is not in use",
                    _ => "",
                };
                format!("--pty {}: {e}{remedy}", link.display())
            };
            let left_behind =
                fs::read_link(link).is_ok_and(|to| to == pty.device) || !link.exists();
            if link.is_symlink() && left_behind {
                fs::remove_file(link).map_err(complain)?;
            }
            std::os::unix::fs::symlink(&pty.device, link).map_err(complain)?;
            pty.link = Some(link.to_owned());
        }
        Ok(pty)
    }

    fn make() -> std::io::Result<(OwnedFd, PathBuf)> {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?;
        grantpt(&master)?;
        unlockpt(&master)?;
        fcntl_setfl(&master, OFlags::NONBLOCK)?;
        let device = PathBuf::from(ptsname(&master, Vec::new())?.to_string_lossy().into_owned());
        // Opening the device once also makes its closing visible from now on (see `is_open`).
        let slave = File::options().read(true).write(true).open(&device)?;
        let mut attributes = tcgetattr(&slave)?;
        attributes.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &attributes)?;
        Ok((master, device))
    }

    /// What to tell the user.
    pub fn place(&self) -> String {
        let device = self.device.display();
        match &self.link {
            None => format!("serial device {device}"),
            Some(link) => format!("serial device {device}, also {}", link.display()),
        }
    }

    /// Whether a host has the device open.
    pub fn is_open(&self) -> bool {
        let mut fds = [PollFd::new(&self.master, PollFlags::IN)];
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        poll(&mut fds, Some(&at_once)).is_ok() && !fds[0].revents().contains(PollFlags::HUP)
    }

    /// Forgets what the last host has not read.
    pub fn forget_unread(&self) {
        if let Ok(slave) = File::options().read(true).write(true).open(&self.device) {
            let _ = tcflush(&slave, QueueSelector::IFlush);
        }
    }

    /// Reads what a host has sent, without waiting; 0 when there is nothing.
    pub fn read(&self, buffer: &mut [u8]) -> usize {
        rustix::io::read(&self.master, buffer).unwrap_or(0)
    }

    /// Writes what there is room for; 0 when there is none.
    pub fn write(&self, bytes: &[u8]) -> usize {
        rustix::io::write(&self.master, bytes).unwrap_or(0)
    }
}

impl AsFd for Pty {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        if let Some(link) = &self.link
            && fs::read_link(link).is_ok_and(|to| to == self.device)
        {
            let _ = fs::remove_file(link);
        }
    }
}
