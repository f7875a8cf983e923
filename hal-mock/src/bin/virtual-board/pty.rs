//! The board's pseudo-terminal: what a host program opens as its serial device.
//!
//! The device is raw (no echo, no line editing) for each who opens it, whether or not it asks for
//! that, and whatever the last one has left. As long as nobody has it open, nothing is written, and
//! what was not read is forgotten when it is closed, so that a host does not begin with old news.
//!
//! A host that flushes its output (`TCOFLUSH`) before a packet takes back what has not been read of
//! the packet before: a thread that does nothing else reads at once, up to 64 KiB ahead of a
//! line that is slower. What the kernel itself has not passed on by then, it can take back still.

use std::fs::{self, File};
use std::io::{ErrorKind, PipeReader, PipeWriter, Read, Write, pipe};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_setfl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, OutputModes, QueueSelector, tcflush, tcgetattr,
    tcsetattr,
};

use crate::links::Device;

/// How often it is looked whether somebody opens the device. What is written meanwhile waits.
const CLOSED: Duration = Duration::from_millis(1);

/// A pseudo-terminal, and perhaps a symbolic link to it, removed when it is dropped.
pub struct Pty {
    master: Arc<OwnedFd>,
    /// What the thread has read.
    read: PipeReader,
    device: PathBuf,
    link: Option<PathBuf>,
}

impl Pty {
    /// Opens a pseudo-terminal; `link` becomes a symbolic link to it, in place of one that a board
    /// has left behind.
    pub fn open(link: Option<&Path>) -> Result<Self, String> {
        let mut pty = Self::make().map_err(|e| format!("cannot open a pseudo-terminal: {e}"))?;
        if let Some(link) = link {
            let complain = |e: std::io::Error| {
                let remedy = match e.kind() {
                    ErrorKind::AlreadyExists => "; choose a name that is not in use",
                    _ => "",
                };
                format!("--pty {}: {e}{remedy}", link.display())
            };
            if is_left_behind(link) {
                fs::remove_file(link).map_err(complain)?;
            }
            std::os::unix::fs::symlink(&pty.device, link).map_err(complain)?;
            pty.link = Some(link.to_owned());
        }
        Ok(pty)
    }

    fn make() -> std::io::Result<Self> {
        let master = Arc::new(openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY)?);
        grantpt(&*master)?;
        unlockpt(&*master)?;
        fcntl_setfl(&*master, OFlags::NONBLOCK)?;
        let device = PathBuf::from(ptsname(&*master, Vec::new())?.to_string_lossy().into_owned());
        // Opening the device once also makes its closing visible from now on (see `is_open`).
        make_raw(File::options().read(true).write(true).open(&device)?)?;
        let (read, to_board) = pipe()?;
        fcntl_setfl(&read, OFlags::NONBLOCK)?;
        std::thread::Builder::new().name("pty".into()).spawn({
            let master = master.clone();
            move || read_at_once(&master, to_board)
        })?;
        Ok(Self { master, read, device, link: None })
    }
}

impl Device for Pty {
    fn place(&self) -> String {
        let device = self.device.display();
        match &self.link {
            None => format!("serial device {device}"),
            Some(link) => format!("serial device {device}, also {}", link.display()),
        }
    }

    fn watch(&self) -> BorrowedFd<'_> {
        self.read.as_fd()
    }

    fn is_open(&self) -> bool {
        let at_once = Timespec { tv_sec: 0, tv_nsec: 0 };
        is_open(&self.master, Some(&at_once))
    }

    fn forget_unread(&self) {
        if let Ok(slave) = File::options().read(true).write(true).open(&self.device) {
            let _ = tcflush(&slave, QueueSelector::IFlush);
        }
    }

    fn read(&mut self, buffer: &mut [u8]) -> usize {
        self.read.read(buffer).unwrap_or(0)
    }

    fn write(&self, bytes: &[u8]) -> usize {
        rustix::io::write(&*self.master, bytes).unwrap_or(0)
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

/// Waits for something to read, or for so long at the most. Whether a host has the device open.
fn is_open(master: &OwnedFd, time: Option<&Timespec>) -> bool {
    let mut fds = [PollFd::new(master, PollFlags::IN)];
    poll(&mut fds, time).is_ok() && !fds[0].revents().contains(PollFlags::HUP)
}

/// Reads what hosts send, for as long as the board runs.
fn read_at_once(master: &OwnedFd, mut to_board: PipeWriter) {
    let mut buffer = [0; 4096];
    loop {
        let is_open = is_open(master, None);
        // A host may have written something before it closed the device.
        if let Ok(count @ 1..) = rustix::io::read(master, &mut buffer) {
            if to_board.write_all(&buffer[..count]).is_err() {
                return; // The board has ended.
            }
        } else if !is_open {
            // However short it was open: `stty` is quick.
            let _ = make_raw(master);
            std::thread::sleep(CLOSED);
        }
    }
}

/// Makes the terminal raw, unless it is. Its master will do to tell it so, though nobody has it open.
fn make_raw(terminal: impl AsFd) -> std::io::Result<()> {
    let mut attributes = tcgetattr(&terminal)?;
    let line = LocalModes::ECHO | LocalModes::ICANON | LocalModes::ISIG | LocalModes::IEXTEN;
    if attributes.local_modes.intersects(line)
        || attributes.output_modes.contains(OutputModes::OPOST)
        || !attributes.input_modes.is_empty()
    {
        attributes.make_raw();
        // Not all of the input's are among those that make a terminal raw: IXOFF is not.
        attributes.input_modes = InputModes::empty();
        tcsetattr(&terminal, OptionalActions::Now, &attributes)?;
    }
    Ok(())
}

/// Whether a link is a board's that was killed: to a device that is gone, or whose number another
/// terminal has taken since. A board makes its device first, and then the link.
fn is_left_behind(link: &Path) -> bool {
    let Ok(of_link) = link.symlink_metadata() else { return false };
    let of_device = link.metadata();
    let is_younger = |device: fs::Metadata| {
        (device.ctime(), device.ctime_nsec()) > (of_link.ctime(), of_link.ctime_nsec())
    };
    of_link.is_symlink() && of_device.map_or(true, is_younger)
}
