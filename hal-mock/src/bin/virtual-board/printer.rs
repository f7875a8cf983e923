//! Prints lines without ever waiting for their reader.
//!
//! A pipe that nobody reads, or a terminal that is held, must not hold up a board: lines go through
//! a bounded queue to a thread of their own, and those that find no room are left out.

use std::io::Write;
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// Lines that may wait.
const QUEUE: usize = 64;
/// How long the end waits for the last lines.
const PATIENCE: Duration = Duration::from_millis(500);

enum Job {
    Say(String),
    Log(String),
    Finish(SyncSender<()>),
}

static QUEUE_IN: OnceLock<SyncSender<Job>> = OnceLock::new();

/// Starts the thread, and a log of this level on standard error.
pub fn start(level: log::LevelFilter) {
    let (jobs_in, jobs) = sync_channel(QUEUE);
    let _ = QUEUE_IN.set(jobs_in);
    std::thread::spawn(move || print(jobs));
    log::set_max_level(level);
    let _ = log::set_logger(&Printer);
}

/// The log's way to the queue; a logger that writes itself would wait for its reader.
struct Printer;

impl log::Log for Printer {
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &log::Record<'_>) {
        queue(Job::Log(record.args().to_string()));
    }

    fn flush(&self) {}
}

/// Prints a line on standard output.
pub fn say(line: &str) {
    queue(Job::Say(line.to_owned()));
}

/// Waits for the lines so far, but not for a reader that does not read.
pub fn finish() {
    let (done_in, done) = sync_channel(1);
    queue(Job::Finish(done_in));
    let _ = done.recv_timeout(PATIENCE);
}

fn queue(job: Job) {
    if let Some(queue) = QUEUE_IN.get() {
        let _ = queue.try_send(job);
    }
}

fn print(jobs: Receiver<Job>) {
    // A reader that has gone is no error of ours.
    for job in jobs {
        let _ = match job {
            Job::Say(line) => writeln!(std::io::stdout(), "{line}"),
            Job::Log(line) => writeln!(std::io::stderr(), "{line}"),
            Job::Finish(done) => done.send(()).map_err(std::io::Error::other),
        };
    }
}
