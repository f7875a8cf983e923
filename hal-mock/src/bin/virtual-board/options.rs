//! The command line: what it says, what is wrong with it, and what holds where it says nothing.

use std::path::PathBuf;
use std::time::Duration;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, ValueEnum};
use hal_mock::flash::Flash;
use hal_mock::servo_bus::Faults;
use protocol::arcos::{Dialect, MotionBits};

use crate::door::{Address, is_loopback};
use crate::links::Device;
#[cfg(unix)]
use crate::pty::Pty;
use crate::servos;

/// A simulated motion and sensing controller that host programs of the original can talk to.
///
/// It prints where it listens, and then what happens, until it is interrupted. Exit codes: 0 when it
/// has ended as asked, 1 when it cannot run, 2 when the command line is wrong.
#[derive(Parser)]
#[command(name = "virtual-board", version)]
pub struct Options {
    /// Which controller to be.
    #[arg(value_enum, default_value_t = Personality::Pms5005)]
    pub personality: Personality,
    /// Also make LINK a symbolic link to the pseudo-terminal, as long as the board runs.
    #[cfg(unix)]
    #[arg(long, value_name = "LINK")]
    pty: Option<PathBuf>,
    /// Where to listen for TCP clients [default: 127.0.0.1:5005, or port 8101 for
    /// pioneer-arm, 5006 for cm5, 5012 for ax12-bus; a free port if that one is in use].
    #[arg(long, value_name = "ADDR")]
    tcp: Option<String>,
    /// Where to listen for UDP peers, whole frames in a datagram [default: 127.0.0.1:10001, or a
    /// free port].
    #[arg(long, value_name = "ADDR")]
    udp: Option<String>,
    /// Where to offer the simulated truth as JSON lines; loopback only. Off by default.
    #[arg(long, value_name = "ADDR")]
    pub inspect: Option<String>,
    /// Where to serve the page that shows, drives and tunes the board in a browser; `off` serves none
    /// [default: 127.0.0.1:5080, or a free port].
    #[arg(long, value_name = "ADDR")]
    web: Option<String>,
    /// The world to simulate; see the documentation of hal_mock::scene_file.
    #[arg(long, value_name = "FILE.toml")]
    pub scene: Option<PathBuf>,
    /// Where saved settings are kept; without it they are lost when the board ends.
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// The servos on the bus, by their IDs: numbers and ranges, as 1,2,5-7; 1 to 253, for ax12-bus and
    /// --pass-through 0 too.
    #[arg(long, value_name = "IDS", default_value = "1-6")]
    servos: String,
    /// What goes wrong on the servo bus, in parts of a million of its bytes: dropped, flipped and
    /// stalled, 0 to 1000000 each, as flipped=100,stalled=2000.
    #[arg(long, value_name = "RATES", default_value = "")]
    bus_faults: String,
    /// Be no bridge: the PC speaks Dynamixel 1.0 itself, and what it says goes to the servo bus as it comes.
    #[arg(long)]
    pub pass_through: bool,
    /// Pace both directions as a UART of that baud would, 9600 or more (a PMS5005's 19200); 0 does not [default: 115200, and 1000000
    /// for a CM-5 or a servo bus].
    #[arg(long, value_name = "BAUD")]
    line_rate: Option<u32>,
    /// How the Pioneer Arm tells its state: as its manual says, the same with joint 1's motion in
    /// bit 0, or as ARIA reads it [default: as its settings say, which is manual].
    #[arg(long, value_enum)]
    dialect: Option<DialectName>,
    /// Stop after N seconds.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Serve no page unless --web asks for it, as scripts want it.
    #[arg(long)]
    headless: bool,
    /// Seed of the simulated noise [default: the scene's, or 1].
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Personality {
    /// The WiRobot PMS5005.
    Pms5005,
    /// The Pioneer Arm behind ARCOS packets.
    PioneerArm,
    /// The CM-5 with a bus of AX-12 servos.
    Cm5,
    /// A bus of AX-12 servos behind a USB adapter.
    Ax12Bus,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum DialectName {
    Manual,
    ManualB0,
    Aria,
}

/// Options that are not for every personality, and for whom they are.
const PARTICULAR: [(&str, &[Personality]); 8] = [
    ("udp", &[Personality::Pms5005]),
    ("web", &[Personality::Pms5005, Personality::PioneerArm, Personality::Cm5]),
    ("scene", &[Personality::Pms5005]),
    ("dialect", &[Personality::PioneerArm]),
    ("servos", &[Personality::Cm5, Personality::Ax12Bus]),
    ("bus_faults", &[Personality::Cm5, Personality::Ax12Bus]),
    ("pass_through", &[Personality::Cm5]),
    ("settings", &[Personality::Pms5005, Personality::PioneerArm]),
];

/// What holds unless the user says otherwise.
struct Defaults {
    tcp: &'static str,
    udp: Option<&'static str>,
    line_rate: u32,
}

impl Personality {
    fn defaults(self) -> Defaults {
        match self {
            Self::Pms5005 => {
                Defaults { tcp: "127.0.0.1:5005", udp: Some("127.0.0.1:10001"), line_rate: 115_200 }
            }
            Self::PioneerArm => Defaults { tcp: "127.0.0.1:8101", udp: None, line_rate: 115_200 },
            Self::Cm5 => Defaults { tcp: "127.0.0.1:5006", udp: None, line_rate: 1_000_000 },
            Self::Ax12Bus => Defaults { tcp: "127.0.0.1:5012", udp: None, line_rate: 1_000_000 },
        }
    }
}

/// In place of the page's address.
const OFF: &str = "off";

/// A session gives up a frame that takes longer than half a second: 264 bytes take 275 ms here.
const SLOWEST_LINE: u32 = 9600;
/// And a task that sends for more than 90 ms counts as hung: the machine state takes 69 ms here.
const SLOWEST_PMS5005: u32 = 19_200;

impl Options {
    /// What the command line says. An error is what is wrong with it, or what the user wanted to
    /// know.
    pub fn parse() -> Result<Self, clap::Error> {
        let matches = Self::command().try_get_matches()?;
        let options = Self::from_arg_matches(&matches)?;
        let is_given =
            |option: &str| matches.value_source(option) == Some(ValueSource::CommandLine);
        options
            .check(is_given)
            .map_err(|text| Self::command().error(ErrorKind::ValueValidation, text))?;
        Ok(options)
    }

    /// Says in one line what is wrong.
    fn check(&self, is_given: impl Fn(&str) -> bool) -> Result<(), String> {
        let personality = self.personality;
        for (option, whose) in PARTICULAR {
            if is_given(option) && !whose.contains(&personality) {
                let name = |p: &Personality| p.to_possible_value().map(|v| v.get_name().to_owned());
                let whose: Vec<_> = whose.iter().filter_map(name).collect();
                let here = name(&personality).unwrap_or_default();
                let option = option.replace('_', "-");
                return Err(format!("--{option}: not for {here}, only for {}", whose.join(", ")));
            }
        }
        let rate = self.line_rate();
        let slowest = match personality {
            Personality::Pms5005 => SLOWEST_PMS5005,
            _ => SLOWEST_LINE,
        };
        if (1..slowest).contains(&rate) {
            return Err(format!("--line-rate {rate}: must be 0, or {slowest} or more"));
        }
        if personality == Personality::Ax12Bus && rate == 0 {
            return Err("--line-rate 0: a servo bus takes its time, give 9600 or more".into());
        }
        let web = self.web.clone().filter(|address| address != OFF);
        if self.pass_through && web.is_some() {
            return Err("--web: a pass-through has no page, its PC is the servos' master".into());
        }
        let addresses = [
            ("--tcp", &self.tcp),
            ("--udp", &self.udp),
            ("--inspect", &self.inspect),
            ("--web", &web),
        ];
        for (option, address) in addresses {
            let port = |text: &String| text.rsplit_once(':')?.1.parse::<u16>().ok();
            if let Some(text) = address.as_ref().filter(|text| port(text).is_none()) {
                return Err(format!(
                    "{option} {text}: expected an address and a port, as 127.0.0.1:5005"
                ));
            }
        }
        if let Some(address) = self.inspect.as_ref().filter(|address| !is_loopback(address)) {
            return Err(format!("--inspect {address}: only a loopback address will do"));
        }
        self.servos()?;
        self.bus_faults()?;
        self.end()?;
        Ok(())
    }

    /// The serial device for hosts, where the system has pseudo-terminals; or in one line why there is none.
    pub fn device(&self) -> Result<Option<Box<dyn Device>>, String> {
        #[cfg(unix)]
        return Ok(Some(Box::new(Pty::open(self.pty.as_deref())?)));
        #[cfg(not(unix))]
        Ok(None)
    }

    /// Where to listen for TCP clients.
    pub fn tcp(&self) -> Address<'_> {
        let default = self.personality.defaults().tcp;
        Address::new("--tcp", self.tcp.as_deref(), default)
    }

    /// Where to listen for UDP peers, if this personality does.
    pub fn udp(&self) -> Option<Address<'_>> {
        let default = self.personality.defaults().udp?;
        Some(Address::new("--udp", self.udp.as_deref(), default))
    }

    /// Where to serve the page, if at all.
    pub fn web(&self) -> Option<Address<'_>> {
        let is_asked = self.web.is_some();
        let has_page = self.has_personality() && !self.headless;
        let is_on = self.web.as_deref() != Some(OFF) && (is_asked || has_page);
        is_on.then(|| Address::new("--web", self.web.as_deref(), "127.0.0.1:5080"))
    }

    /// Whether a host speaks to a firmware, and not to the servos themselves.
    fn has_personality(&self) -> bool {
        self.personality != Personality::Ax12Bus && !self.pass_through
    }

    /// The servos on the bus. A CM-5 searches no ID 0.
    pub fn servos(&self) -> Result<Vec<u8>, String> {
        servos::ids(&self.servos, u8::from(self.has_personality()))
    }

    /// What goes wrong on the bus.
    pub fn bus_faults(&self) -> Result<Faults, String> {
        servos::faults(&self.bus_faults)
    }

    /// The line's speed in baud; 0 takes no time.
    pub fn line_rate(&self) -> u32 {
        self.line_rate.unwrap_or(self.personality.defaults().line_rate)
    }

    /// The seed of the noise: the one asked for, or else the scene's.
    pub fn seed(&self, of_scene: Option<u64>) -> u64 {
        self.seed.or(of_scene).unwrap_or(1)
    }

    /// How the Pioneer Arm tells its state, if that is asked for.
    pub fn dialect(&self) -> Option<Dialect> {
        self.dialect.map(|name| match name {
            DialectName::Manual => Dialect::Manual(MotionBits::OneToSix),
            DialectName::ManualB0 => Dialect::Manual(MotionBits::ZeroToFive),
            DialectName::Aria => Dialect::Aria,
        })
    }

    /// Where settings are kept.
    pub fn flash(&self) -> Result<Flash, String> {
        match &self.settings {
            None => Ok(Flash::empty()),
            Some(path) => {
                Flash::open(path).map_err(|e| format!("--settings {}: {e}", path.display()))
            }
        }
    }

    /// When to stop.
    pub fn end(&self) -> Result<Option<Duration>, String> {
        let duration = |seconds| {
            Duration::try_from_secs_f64(seconds).map_err(|_| {
                format!("--seconds {seconds:e}: expected seconds from 0 to 1e9, as 2.5")
            })
        };
        self.seconds.map(duration).transpose()
    }
}
