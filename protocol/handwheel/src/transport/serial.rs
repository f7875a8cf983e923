//! A serial device. What keeps one from being opened is told with the remedy.

use std::io::{self, ErrorKind, Read, Write};
use std::time::Duration;

use serialport::SerialPort;

use super::holder::holders_for_long;
use super::{Transport, nothing_yet};
use crate::error::Error;

/// How long a write may take: a device that takes nothing any more is gone.
const WRITE: Duration = Duration::from_secs(1);

struct Serial(Box<dyn SerialPort>);

/// The serial devices of this computer.
pub fn ports() -> Vec<String> {
    let ports = serialport::available_ports().unwrap_or_default();
    ports.into_iter().map(|port| port.port_name).collect()
}

/// Opens one, raw, 8N1, for this program alone. Opening raises DTR on Linux, whoever opens it: nothing
/// a program does can prevent that.
///
/// # Errors
/// [`Error::Busy`] names who has it; [`Error::CannotOpen`] says what to do.
pub fn open(device: &str, baud: u32) -> Result<Box<dyn Transport>, Error> {
    // Many programs do not lock a port. Two that read from one take each other's bytes.
    let others = holders_for_long(device);
    if !others.is_empty() {
        return Err(busy(device, &others));
    }
    match serialport::new(device, baud).timeout(Duration::from_millis(10)).open() {
        Ok(port) => Ok(Box::new(Serial(port))),
        Err(error) => Err(explained(device, &error)),
    }
}

fn busy(device: &str, others: &[String]) -> Error {
    let who = if others.is_empty() { "another program".into() } else { others.join(", ") };
    Error::Busy(format!("{device}: {who} has it; end that program first"))
}

fn explained(device: &str, error: &serialport::Error) -> Error {
    // COM3 is no file's name.
    let exists = std::path::Path::new(device).exists() || ports().iter().any(|port| port == device);
    let kind = match error.kind() {
        // What serialport makes of a port that another program has locked.
        serialport::ErrorKind::NoDevice if exists => {
            return busy(device, &holders_for_long(device));
        }
        serialport::ErrorKind::NoDevice => ErrorKind::NotFound,
        serialport::ErrorKind::Io(kind) => kind,
        _ => ErrorKind::Other,
    };
    let remedy = match kind {
        ErrorKind::PermissionDenied => {
            "no permission; join the group that owns it (`sudo usermod -aG dialout $USER`) and log in again".into()
        }
        _ if !exists => match ports() {
            ports if ports.is_empty() => "no such device; this computer has no serial ports".into(),
            ports => format!("no such device; there are {}", ports.join(", ")),
        },
        _ => format!("{error}; see that it is a serial device, and the baud rate one of its own"),
    };
    Error::CannotOpen(format!("{device}: {remedy}"))
}

impl Transport for Serial {
    fn read(&mut self, buffer: &mut [u8], patience: Duration) -> io::Result<usize> {
        self.0.set_timeout(patience)?;
        match self.0.read(buffer) {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "the device has gone")),
            Ok(count) => Ok(count),
            Err(error) => nothing_yet(error),
        }
    }

    fn write(&mut self, frame: &[u8]) -> io::Result<()> {
        self.0.set_timeout(WRITE)?;
        self.0.write_all(frame)
    }
}
