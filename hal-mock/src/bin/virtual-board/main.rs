//! The virtual board: a PMS5005 on this computer, for host programs that know the original.
//!
//! It prints where it listens (a pseudo-terminal, TCP, UDP), then a status line a second, until
//! it is interrupted or `--seconds` are over. Whatever a client does, the board goes on. What is
//! wrong with the command line is said in one line, with exit code 2.

mod inspect;
mod links;
mod printer;
mod pty;
mod status;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::{clock, scene_file};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use inspect::Inspector;
use links::Links;
use printer::say;
use status::Status;

/// A simulated motion and sensing controller that host programs of the original can talk to.
#[derive(Parser)]
#[command(version, about)]
struct Options {
    /// Which controller to be.
    #[arg(value_enum, default_value_t = Personality::Pms5005)]
    personality: Personality,
    /// Also make LINK a symbolic link to the pseudo-terminal, as long as the board runs.
    #[arg(long, value_name = "LINK")]
    pty: Option<PathBuf>,
    /// Where to listen for TCP clients.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:5005")]
    tcp: String,
    /// Where to listen for UDP peers, one frame a datagram.
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:10001")]
    udp: String,
    /// Where to offer the simulated truth as JSON lines; loopback only. Off by default.
    #[arg(long, value_name = "ADDR")]
    inspect: Option<String>,
    /// The world to simulate; see the documentation of hal_mock::scene_file.
    #[arg(long, value_name = "FILE.toml")]
    scene: Option<PathBuf>,
    /// Pace both directions as a UART of that baud would; 0 does not.
    #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
    line_rate: u32,
    /// Stop after N seconds.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    seconds: Option<f64>,
    /// Print plain lines only, even on a terminal.
    #[arg(long)]
    headless: bool,
    /// Seed of the simulated noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, ValueEnum)]
enum Personality {
    Pms5005,
}

/// A board that is this far behind the wall clock (a machine that slept) does not catch up.
const FARTHEST_BEHIND: Duration = Duration::from_secs(1);
/// The session gives up a frame that takes longer than half a second: 264 bytes take 275 ms here.
const SLOWEST_LINE: u32 = 9600;

fn main() -> ExitCode {
    let options = match Options::try_parse() {
        Ok(options) => options,
        Err(error) if !error.use_stderr() => {
            let _ = error.print(); // --help, --version
            return ExitCode::SUCCESS;
        }
        Err(error) => {
            // What is wrong, and what would be right; then come usage and tips.
            let text = error.render().to_string();
            let said: Vec<_> = text.lines().take_while(|line| !line.is_empty()).collect();
            let line = said.join("").replace("  ", " ");
            return refuse(line.strip_prefix("error: ").unwrap_or(&line));
        }
    };
    printer::start(log_level());
    let result = run(&options);
    printer::finish();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => refuse(&message),
    }
}

/// `RUST_LOG=warn` shows why frames are refused; without it the log is off, since a host may send
/// a thousand bad frames a second.
fn log_level() -> log::LevelFilter {
    std::env::var("RUST_LOG").ok().and_then(|l| l.parse().ok()).unwrap_or(log::LevelFilter::Off)
}

fn refuse(message: &str) -> ExitCode {
    eprintln!("virtual-board: {message}");
    ExitCode::from(2)
}

fn run(options: &Options) -> Result<(), String> {
    let Personality::Pms5005 = options.personality;
    let scene = match &options.scene {
        None => Default::default(),
        Some(path) => {
            let shown = path.display();
            let text =
                std::fs::read_to_string(path).map_err(|e| format!("--scene {shown}: {e}"))?;
            scene_file::parse(&text).map_err(|e| format!("--scene {shown}: {e}"))?
        }
    };
    let end = match options.seconds {
        None => None,
        Some(seconds) => Some(
            Duration::try_from_secs_f64(seconds)
                .map_err(|_| format!("--seconds {seconds}: must be 0 or more"))?,
        ),
    };
    if (1..SLOWEST_LINE).contains(&options.line_rate) {
        let rate = options.line_rate;
        return Err(format!("--line-rate {rate}: must be 0, or {SLOWEST_LINE} or more"));
    }
    let stop = Arc::new(AtomicBool::new(false));
    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        signal_hook::flag::register(signal, stop.clone())
            .map_err(|e| format!("cannot catch signals: {e}"))?;
    }
    let mut inspector = options.inspect.as_deref().map(Inspector::open).transpose()?;
    let mut links = Links::open(options.pty.as_deref(), &options.tcp, &options.udp)?;
    let mut board = VirtualBoard::new(Make {
        scene,
        line_rate: options.line_rate,
        seed: options.seed,
        ..Make::default()
    });

    say("PMS5005 at your service:");
    for place in links.places().into_iter().chain(inspector.as_ref().map(Inspector::place)) {
        say(&format!("  {place}"));
    }
    let mut status = Status::new(options.headless);
    let mut start = Instant::now();
    while !stop.load(Ordering::Relaxed) {
        let mut now = start.elapsed();
        if end.is_some_and(|end| now >= end) {
            break;
        }
        let behind =
            now.saturating_sub(Duration::from_micros(embassy_time::Instant::now().as_micros()));
        if behind > FARTHEST_BEHIND {
            start += behind;
            now -= behind;
            say(&format!(
                "the board was held up for {:.1} s and goes on from there",
                behind.as_secs_f32()
            ));
        }
        links.receive(&board.line);
        if let Some(inspector) = &mut inspector {
            inspector.serve(&board);
        }
        board.run_until(embassy_time::Instant::from_micros(now.as_micros() as u64));
        while let Some((_, frame)) = board.line.host_receives() {
            links.send(&frame);
        }
        status.show(&board, &links);
        wait(&links, inspector.as_ref(), &board, start);
    }
    say("bye");
    Ok(())
}

/// Waits for bytes from somewhere, or for the board's next event.
fn wait(links: &Links, inspector: Option<&Inspector>, board: &VirtualBoard, start: Instant) {
    let next = clock::next_alarm().map_or(u64::MAX, |alarm| alarm.as_micros());
    let now = start.elapsed().as_micros() as u64;
    let micros = next.saturating_sub(now).clamp(50, 1000);
    let time = Timespec { tv_sec: 0, tv_nsec: micros as i64 * 1000 };
    let mut fds = Vec::new();
    links.watch(&board.line, &mut fds);
    if let Some(inspector) = inspector {
        inspector.watch(&mut fds);
    }
    let mut fds: Vec<_> =
        fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)).collect();
    // A signal interrupts the wait; there is nothing else to go wrong.
    let _ = poll(&mut fds, Some(&time));
}
