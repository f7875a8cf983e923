//! The virtual board: an old controller on this computer, for host programs that know the original.
//!
//! It prints where it listens (a serial device, TCP, UDP), then what changes, until it is
//! interrupted or `--seconds` are over. Whatever a client does, the board goes on. Exit code 2 is for a
//! wrong command line, 1 for what else keeps it from running.

mod ax12_bus;
mod cm5;
mod door;
mod follow;
mod inspect;
mod links;
mod machine;
mod options;
mod page;
mod pioneer_arm;
mod pms5005;
mod printer;
#[cfg(unix)]
mod pty;
mod servos;
mod signals;
mod status;

use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use hal_mock::clock;
use hal_mock::machine::Machine;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use inspect::Inspector;
use links::Links;
use options::{Options, Personality};
use page::Page;
use printer::say;
use status::Status;

/// A board that is this far behind the wall clock (a machine that slept) does not catch up.
const FARTHEST_BEHIND: Duration = Duration::from_secs(1);

fn main() -> ExitCode {
    let options = Options::parse().unwrap_or_else(|error| error.exit());
    printer::start(log_level());
    let result = run(&options);
    printer::finish();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("virtual-board: {message}");
            ExitCode::FAILURE
        }
    }
}

/// Warnings, unless `RUST_LOG` says otherwise.
fn log_level() -> log::LevelFilter {
    std::env::var("RUST_LOG").ok().and_then(|l| l.parse().ok()).unwrap_or(log::LevelFilter::Warn)
}

fn run(options: &Options) -> Result<(), String> {
    let end = options.end()?;
    let stop = Arc::new(AtomicBool::new(false));
    signals::end(&stop).map_err(|e| format!("cannot catch signals: {e}"))?;
    let mut inspector = options.inspect.as_deref().map(Inspector::open).transpose()?;
    let mut machine = match options.personality {
        Personality::Pms5005 => pms5005::machine(options)?,
        Personality::PioneerArm => pioneer_arm::machine(options)?,
        Personality::Cm5 => cm5::machine(options)?,
        Personality::Ax12Bus => ax12_bus::machine(options)?,
    };
    let mut links = Links::open(options.device()?, options.tcp(), options.udp(), machine.as_ref())?;
    let page = match options.web().zip(links.tcp()) {
        Some((address, board)) => Some(Page::open(address, board, stop.clone())?),
        None => None,
    };

    say(&format!("{} at your service:", machine.name()));
    let places = links.places().into_iter().chain(page.as_ref().map(Page::place));
    for place in places.chain(inspector.as_ref().map(Inspector::place)) {
        say(&format!("  {place}"));
    }
    let mut status = Status::default();
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
        links.receive(machine.as_ref());
        if let Some(inspector) = &mut inspector {
            inspector.serve(machine.as_mut(), &links);
        }
        if let Some(page) = &page {
            page.serve(machine.as_mut(), &links);
        }
        machine.run_until(embassy_time::Instant::from_micros(now.as_micros() as u64));
        while let Some((_, frame)) = machine.line().host_receives() {
            links.send(&frame);
        }
        status.show(machine.as_ref(), &links);
        printer::tell_the_rest(false);
        wait(&links, inspector.as_ref(), machine.as_ref(), start);
    }
    printer::tell_the_rest(true);
    say("bye");
    Ok(())
}

/// Waits for bytes from somewhere, or for the board's next event.
fn wait(links: &Links, inspector: Option<&Inspector>, machine: &dyn Machine, start: Instant) {
    let next = clock::next_alarm().map_or(u64::MAX, |alarm| alarm.as_micros());
    let now = start.elapsed().as_micros() as u64;
    let micros = next.saturating_sub(now).clamp(50, 1000);
    if cfg!(windows) {
        // Its poll keeps time to 16 ms at worst, its sleep to one.
        return std::thread::sleep(Duration::from_micros(micros));
    }
    let time = Timespec { tv_sec: 0, tv_nsec: (micros * 1000) as _ };
    let mut fds = Vec::new();
    links.watch(machine.line(), &mut fds);
    if let Some(inspector) = inspector {
        inspector.watch(&mut fds);
    }
    let mut fds: Vec<_> =
        fds.iter().map(|fd| PollFd::from_borrowed_fd(*fd, PollFlags::IN)).collect();
    // A signal interrupts the wait; there is nothing else to go wrong.
    let _ = poll(&mut fds, Some(&time));
}
