//! How a way to a board is written: `serial:/dev/ttyUSB0@115200`, `tcp:127.0.0.1:5005`,
//! `udp:127.0.0.1:10001`, `auto`.

use std::fmt;
use std::str::FromStr;

use crate::error::Error;

/// The baud rate of a serial link that names none.
pub const DEFAULT_BAUD: u32 = 115_200;
/// Where the virtual board listens.
pub const VIRTUAL_BOARD: &str = "127.0.0.1:5005";

/// A way to a board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Link {
    /// A serial device, and its baud rate.
    Serial(String, u32),
    /// A TCP address: host and port.
    Tcp(String),
    /// A UDP address: host and port.
    Udp(String),
    /// The only board that is found.
    Auto,
    /// Another, which the program itself carries: its name in messages.
    Other(String),
}

impl Link {
    /// Whether the line is too slow to be asked for the machine state: on less than 16,000 baud it would
    /// take longer than the board's tasks may be silent.
    pub fn is_slow(&self) -> bool {
        matches!(self, Self::Serial(_, baud) if *baud < 16_000)
    }
}

impl FromStr for Link {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let wrong = || Error::NoLink(text.into());
        let address = |address: &str| {
            let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
            let is_good = !host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0);
            if is_good { Ok(address.to_owned()) } else { Err(wrong()) }
        };
        match text.split_once(':') {
            None if text == "auto" => Ok(Self::Auto),
            Some(("tcp", rest)) => address(rest).map(Self::Tcp),
            Some(("udp", rest)) => address(rest).map(Self::Udp),
            Some(("serial", rest)) => {
                let (device, baud) = match rest.rsplit_once('@') {
                    Some((device, baud)) => (device, baud.parse().map_err(|_| wrong())?),
                    None => (rest, DEFAULT_BAUD),
                };
                if device.is_empty() || baud == 0 {
                    return Err(wrong());
                }
                Ok(Self::Serial(device.to_owned(), baud))
            }
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Link {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Serial(device, baud) => write!(f, "serial:{device}@{baud}"),
            Self::Tcp(address) => write!(f, "tcp:{address}"),
            Self::Udp(address) => write!(f, "udp:{address}"),
            Self::Auto => f.write_str("auto"),
            Self::Other(name) => f.write_str(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_is_read_as_it_is_written() {
        for text in [
            "serial:/dev/ttyUSB0@115200",
            "serial:COM3@9600",
            "tcp:[::1]:5005",
            "udp:robot:10001",
            "auto",
        ] {
            assert_eq!(text.parse::<Link>().unwrap().to_string(), text);
        }
        let link: Link = "serial:/dev/ttyACM0".parse().unwrap();
        assert_eq!(link, Link::Serial("/dev/ttyACM0".into(), 115_200));
    }

    #[test]
    fn what_a_program_carries_itself_has_its_name_and_cannot_be_asked_for() {
        let own = Link::Other("this page".into());
        assert_eq!(own.to_string(), "this page");
        assert!(own.to_string().parse::<Link>().is_err() && !own.is_slow());
    }

    #[test]
    fn what_is_no_link_is_answered_with_how_one_is_written() {
        for wrong in [
            "",
            "/dev/ttyUSB0",
            "tcp:",
            "tcp:5005",
            "tcp::5005",
            "udp:a:70000",
            "tcp:a:0",
            "serial:",
            "serial:x@",
            "serial:x@0",
            "usb:1",
        ] {
            let error = wrong.parse::<Link>().unwrap_err().to_string();
            assert!(error.contains("serial:/dev/ttyUSB0@115200"), "{wrong}: {error}");
        }
    }
}
