//! The command line: what it says, and the way from there to the commands. One module a group of them.
//!
//! [`run`] takes words and writes text, so that tests (and other programs) call it as the shell does.

mod files;
mod info;
mod motion;
mod outputs;
mod parse;
mod plot;
mod settings;
mod step;
mod tune;
mod upkeep;
mod watch;
mod web;

use std::ffi::OsString;
use std::io::{BufRead, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::error::ErrorKind;
use clap::{Args, Parser, Subcommand, ValueEnum};
use serde_json::{Value, json};

use crate::client::Client;
use crate::error::Error;
use crate::link::Link;
use crate::number::Number;
use crate::tune::Loop;
use crate::words;

/// Exit status: done.
pub const DONE: u8 = 0;
/// Exit status: it failed; one line says why.
pub const FAILED: u8 = 1;
/// Exit status: the command line is wrong.
pub const MISUSED: u8 = 2;
/// Exit status: it was done, and the answer is no: a stop that is not confirmed, a shaft that still turns, a
/// difference, a fault that stays.
pub const ANSWER_IS_NO: u8 = 3;

/// Drives, watches, tunes and backs up a motion controller.
///
/// Channels are 1 to 6 everywhere, as on the labels (the wire has 0 to 5). Exit status: 0 done, 1 failed,
/// 2 wrong command line, 3 done and the answer is no (a stop not confirmed, a shaft that still turns, files that differ).
#[derive(Parser)]
#[command(name = "handwheel", version, verbatim_doc_comment)]
struct Options {
    /// Where the board is: serial:/dev/ttyUSB0@115200 (on Windows serial:COM3), tcp:127.0.0.1:5005,
    /// udp:127.0.0.1:10001, or auto: the only board that speaks on a serial port, else 127.0.0.1:5005.
    #[arg(long, global = true, default_value = "auto", value_name = "LINK")]
    link: String,
    /// Answer in JSON: one object, of `watch` one a line.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// What it is, how long it is up and why it started, its health, faults with remedy.
    Info,
    /// The machine state, live, until Ctrl-C.
    Watch {
        /// As comma-separated values, a line a state.
        #[arg(long)]
        csv: bool,
        /// End after so long, as 2s or 500ms.
        #[arg(long = "for", value_name = "TIME", value_parser = parse::time, allow_hyphen_values = true)]
        time: Option<Duration>,
    },
    /// Drive a motor open loop until Ctrl-C: `pwm 1 50%`.
    Pwm {
        /// Motor, 1 to 6.
        motor: Number,
        /// -100% to 100% of full drive.
        #[arg(allow_hyphen_values = true, value_parser = parse::percent)]
        duty: f64,
        #[command(flatten)]
        hold: Hold,
    },
    /// Run a motor at a velocity until Ctrl-C: `velocity 1 -4000 --for 2s`.
    Velocity {
        /// Motor, 1 to 6.
        motor: Number,
        /// Counts of its sensor per second.
        #[arg(allow_negative_numbers = true, value_parser = parse::counts)]
        velocity: i16,
        #[command(flatten)]
        hold: Hold,
    },
    /// Move a motor to a position, and hold it there until Ctrl-C.
    Position {
        /// Motor, 1 to 6.
        motor: Number,
        /// Counts of its sensor.
        #[arg(allow_negative_numbers = true, value_parser = parse::position)]
        position: i16,
        #[command(flatten)]
        hold: Hold,
    },
    /// Set a servo's pulse; it holds by itself: `servo 3 1500us`.
    Servo {
        /// Servo, 1 to 6.
        servo: Number,
        /// Pulse, 223us to 3111us.
        #[arg(allow_hyphen_values = true, value_parser = parse::pulse)]
        pulse: f64,
        /// Move there in so long, as 500ms.
        #[arg(long = "in", value_name = "TIME", value_parser = parse::ramp, allow_hyphen_values = true)]
        ramp: Option<Duration>,
    },
    /// Set the eight outputs: `gpio 0xA5`; bit 0 is GPIO0.
    Gpio {
        /// 0 to 255; 0x and 0b are understood.
        #[arg(allow_hyphen_values = true, value_parser = parse::byte)]
        outputs: u8,
    },
    /// Show a picture on the LCD, 128 x 64; others are scaled.
    Lcd {
        /// A PNG file.
        picture: PathBuf,
    },
    /// Stop everything, at once; the exit status says whether it is confirmed.
    Stop,
    /// What tripped, when, the values then, what to check.
    Faults {
        /// `clear` clears them.
        action: Option<FaultsAction>,
    },
    /// Show settings: all, one by name, or those of a name.
    Get {
        /// As `telemetry period`, or `soft limit low 1` of channel 1.
        name: Vec<String>,
    },
    /// Set a setting: `set telemetry period 20`. In force at once; `save` keeps it.
    Set {
        /// The name, and last the value.
        #[arg(required = true, num_args = 1.., allow_negative_numbers = true, value_names = ["NAME", "VALUE"])]
        words: Vec<String>,
    },
    /// Save the settings that are in force.
    Save,
    /// Factory reset: the defaults, in force and saved.
    Reset,
    /// Write all settings into a new file.
    Backup {
        /// A TOML file, which must not exist.
        file: PathBuf,
    },
    /// Check a backup whole, then put it in force and save it.
    Restore {
        /// A TOML file.
        file: PathBuf,
    },
    /// Show where a backup and the board differ.
    Diff {
        /// A TOML file.
        file: PathBuf,
    },
    /// Set an encoder's count, to 0 unless told.
    Zero {
        /// Motor, 1 or 2.
        motor: Number,
        /// The count.
        #[arg(allow_negative_numbers = true, default_value_t = 0)]
        count: i32,
    },
    /// Drive a step and tell rise, overshoot, settling and steady error: `step 1 velocity 4000`.
    Step {
        /// Motor, 1 to 6.
        motor: Number,
        /// What steps.
        quantity: Quantity,
        /// Counts per second, or counts.
        #[arg(allow_negative_numbers = true, value_parser = parse::counts)]
        target: i16,
        /// Draw the response.
        #[arg(long, value_name = "FILE")]
        svg: Option<PathBuf>,
        /// How long it is driven.
        #[arg(long = "for", value_name = "TIME", value_parser = parse::time, allow_hyphen_values = true, default_value = "2s")]
        time: Duration,
    },
    /// Check a motor's wiring: a moment of a low duty each way, before any loop is closed.
    Check {
        /// Motor, 1 to 6.
        motor: Number,
        /// Turn its polarity round if the counts go the wrong way.
        #[arg(long)]
        set_polarity: bool,
        #[command(flatten)]
        may: May,
    },
    /// Tune a motor: find out what it is, choose gains, and confirm them by a step.
    Tune {
        /// Motor, 1 to 6.
        motor: Number,
        /// Which loop; that of velocities for an encoder, of positions for a potentiometer.
        quantity: Option<Quantity>,
        /// Leave the gains in force; without, everything is as it was again. Nothing is saved.
        #[arg(long)]
        apply: bool,
        /// Draw the step that confirmed it.
        #[arg(long, value_name = "FILE")]
        svg: Option<PathBuf>,
        #[command(flatten)]
        may: May,
    },
    /// Serve the page, in which a browser shows, drives and tunes the board, until Ctrl-C.
    Web {
        /// Where to serve it. Off this computer a token is part of the page's address.
        #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:5080")]
        listen: String,
        /// A name of this computer by which the page may be asked for, besides its addresses.
        #[arg(long = "allow-host", value_name = "NAME")]
        names: Vec<String>,
    },
    /// Enter the ROM's loader, and say what to type next.
    Dfu,
}

/// How a motion command begins and ends.
#[derive(Args, Clone, Copy)]
struct Hold {
    /// Go there in so long (a ramp), as 500ms; at once without.
    #[arg(long = "in", value_name = "TIME", value_parser = parse::ramp, allow_hyphen_values = true)]
    ramp: Option<Duration>,
    /// Stop after so long, as 2s; until Ctrl-C without.
    #[arg(long = "for", value_name = "TIME", value_parser = parse::time, allow_hyphen_values = true)]
    time: Option<Duration>,
}

/// What a check or a tuning may do.
#[derive(Args, Clone, Copy)]
struct May {
    /// The highest duty that is driven.
    #[arg(long, value_name = "DUTY", value_parser = parse::share, default_value = "50%")]
    highest_duty: f64,
    /// Do not ask whether it may move.
    #[arg(long)]
    yes: bool,
}

impl From<May> for tune::Permission {
    fn from(may: May) -> Self {
        Self { highest_duty: may.highest_duty, yes: may.yes }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FaultsAction {
    /// Clear what is latched.
    Clear,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Quantity {
    /// Counts per second.
    Velocity,
    /// Counts.
    Position,
}

/// How Ctrl-C comes to a command.
#[derive(Clone, Debug)]
pub struct Interrupt {
    /// Becomes true when the user wants an end.
    pub wanted: Arc<AtomicBool>,
    /// Whether the next Ctrl-C ends the program on the spot: true but while a command has something to end
    /// in good order.
    pub ends_program: Arc<AtomicBool>,
}

impl Default for Interrupt {
    fn default() -> Self {
        Self { wanted: Arc::default(), ends_program: Arc::new(AtomicBool::new(true)) }
    }
}

/// Where the command line's text goes, and what ends it.
pub struct Surroundings<'a> {
    /// Answers.
    pub out: &'a mut dyn Write,
    /// Errors and remarks.
    pub err: &'a mut dyn Write,
    /// Whether `out` is a terminal that can be drawn on.
    pub is_terminal: bool,
    /// Where somebody answers questions, if there is one.
    pub keyboard: Option<&'a mut dyn BufRead>,
    /// Ctrl-C.
    pub interrupt: Interrupt,
}

/// What the commands share.
struct Context<'a, 'b> {
    link: String,
    json: bool,
    io: &'a mut Surroundings<'b>,
}

/// What came of a command: its exit status, or why it failed.
type Outcome = Result<u8, Error>;

/// Runs a command line, the program's name first, and returns its exit status.
pub fn run<W: Into<OsString> + Clone>(
    words: impl IntoIterator<Item = W>,
    io: &mut Surroundings<'_>,
) -> u8 {
    let words: Vec<OsString> = words.into_iter().map(Into::into).collect();
    let is_json = words.iter().any(|word| word == "--json");
    let options = match Options::try_parse_from(words) {
        Ok(options) => options,
        Err(error) => return misused(&error, is_json, io),
    };
    let mut context = Context { link: options.link, json: options.json, io };
    let outcome = context.run(options.command);
    let status = outcome.unwrap_or_else(|error| {
        let text = error.to_string();
        if matches!(error, Error::NobodyReads) {
            return DONE;
        }
        if context.json {
            context.tell(&json!({ "error": text }));
        } else {
            let _ = writeln!(context.io.err, "handwheel: {text}");
        }
        FAILED
    });
    match context.io.out.flush() {
        Ok(()) => status,
        Err(_) => FAILED,
    }
}

/// Answers a command line that asks for help, or is wrong: one line with the remedy.
fn misused(error: &clap::Error, is_json: bool, io: &mut Surroundings<'_>) -> u8 {
    // Whoever is not there any more is not told.
    if matches!(error.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) {
        let _ = write!(io.out, "{error}");
        return DONE;
    }
    if error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        let _ = write!(io.err, "{error}");
        return MISUSED;
    }
    // What is wrong is clap's first paragraph.
    let text = error.to_string();
    let what = text.trim_start_matches("error: ").lines().take_while(|line| !line.is_empty());
    let what = what.map(str::trim).collect::<Vec<_>>().join(" ");
    let near = text.lines().find_map(|line| line.trim().strip_prefix("tip: a similar "));
    let near = near.map_or(String::new(), |near| format!("; a similar {near}"));
    let text = format!("{what}{near}; `handwheel --help` and `handwheel COMMAND --help` say how");
    let _ = match is_json {
        true => writeln!(io.out, "{}", json!({ "error": text })),
        false => writeln!(io.err, "handwheel: {text}"),
    };
    MISUSED
}

impl Context<'_, '_> {
    fn run(&mut self, command: Command) -> Outcome {
        match command {
            Command::Info => self.info(),
            Command::Watch { csv, time } => self.watch(csv, time),
            Command::Pwm { motor, duty, hold } => {
                self.motion(motor, crate::Target::Duty(duty), hold)
            }
            Command::Velocity { motor, velocity, hold } => {
                self.motion(motor, crate::Target::Velocity(velocity), hold)
            }
            Command::Position { motor, position, hold } => {
                self.motion(motor, crate::Target::Position(position), hold)
            }
            Command::Servo { servo, pulse, ramp } => self.servo(servo, pulse, ramp),
            Command::Gpio { outputs } => self.gpio(outputs),
            Command::Lcd { picture } => self.lcd(&picture),
            Command::Stop => self.stop(),
            Command::Faults { action } => self.faults(action.is_some()),
            Command::Get { name } => self.get(&name.join(" ")),
            Command::Set { words } => self.set(&words),
            Command::Save => self.save(),
            Command::Reset => self.reset(),
            Command::Backup { file } => self.backup(&file),
            Command::Restore { file } => self.restore(&file),
            Command::Diff { file } => self.diff(&file),
            Command::Zero { motor, count } => self.zero(motor, count),
            Command::Step { motor, quantity, target, svg, time } => {
                self.step(motor, quantity, target, svg.as_deref(), time)
            }
            Command::Check { motor, set_polarity, may } => {
                self.check(motor, set_polarity, may.into())
            }
            Command::Tune { motor, quantity, apply, svg, may } => {
                let control_loop = quantity.map(|quantity| match quantity {
                    Quantity::Velocity => Loop::Velocity,
                    Quantity::Position => Loop::Position,
                });
                self.tune(motor, control_loop, apply, svg.as_deref(), may.into())
            }
            Command::Web { listen, names } => self.web(&listen, &names),
            Command::Dfu => self.dfu(),
        }
    }

    fn connect(&self) -> Result<Client, Error> {
        Client::connect(&self.link.parse::<Link>()?)
    }

    /// From here on there is something to end in good order.
    fn holds(&self) {
        self.io.interrupt.ends_program.store(false, Ordering::Relaxed);
    }

    fn interrupted(&self) -> bool {
        self.io.interrupt.wanted.load(Ordering::Relaxed)
    }

    /// One line for people, unless the answer is JSON. Whoever closes the other end is not told.
    fn say(&mut self, text: &str) {
        if !self.json {
            let _ = writeln!(self.io.out, "{text}");
        }
    }

    /// A remark, which is no part of the answer.
    fn remark(&mut self, text: &str) {
        let _ = writeln!(self.io.err, "handwheel: {text}");
    }

    /// One object, if the answer is JSON.
    fn tell(&mut self, object: &Value) {
        if self.json {
            let _ = writeln!(self.io.out, "{object}");
        }
    }

    /// Says so when another host drives, in words; for an answer in JSON, the motors.
    fn others(&mut self, client: &mut Client) -> Result<Value, Error> {
        let driven = match client.state_at_rest()? {
            Some(state) => crate::client::driven(&state),
            None => Vec::new(),
        };
        if !driven.is_empty() && !self.json {
            self.remark(&drives(&driven));
        }
        Ok(numbers(&driven))
    }
}

/// That another host drives these.
fn drives(driven: &[Number]) -> String {
    let motors: Vec<_> = driven.iter().map(Number::to_string).collect();
    format!("another host drives motor {}", motors.join(", "))
}

fn numbers(numbers: &[Number]) -> Value {
    numbers.iter().map(|number| number.index() + 1).collect::<Vec<_>>().into()
}

/// A time in words, for people.
fn time(time: Duration) -> String {
    words::duration(u64::try_from(time.as_millis()).unwrap_or(u64::MAX))
}
