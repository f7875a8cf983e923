//! Prints lines without ever waiting for their reader.
//!
//! A pipe that nobody reads, or a terminal that is held, must not hold up a board: lines go through
//! a bounded queue to a thread of their own, and those that find no room are left out.

use std::io::Write;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, OnceLock};
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

/// Lines of a kind in a second of the board's time. A host may send a thousand bad frames in one.
const MOST: u32 = 3;

/// What one place in the program has logged in this second.
struct Kind {
    place: (Option<&'static str>, Option<u32>),
    lines: u32,
    /// The last line that was left out.
    last: String,
}

/// The kinds of a second.
static KINDS: Mutex<(u64, Vec<Kind>)> = Mutex::new((0, Vec::new()));

impl log::Log for Printer {
    fn enabled(&self, _: &log::Metadata<'_>) -> bool {
        true
    }

    fn log(&self, record: &log::Record<'_>) {
        tell_the_rest(false);
        let place = (record.file_static(), record.line());
        let text = format!("{}: {}", record.level().as_str().to_lowercase(), record.args());
        let Ok(mut kinds) = KINDS.lock() else { return };
        let kinds = &mut kinds.1;
        let known = kinds.iter().position(|kind| kind.place == place);
        let index = known.unwrap_or_else(|| {
            kinds.push(Kind { place, lines: 0, last: String::new() });
            kinds.len() - 1
        });
        let kind = &mut kinds[index];
        kind.lines += 1;
        if kind.lines <= MOST {
            log_now(&text);
        } else {
            kind.last = text;
        }
    }

    fn flush(&self) {}
}

/// When a second is over, or at the `end`, tells how many lines of each kind were left out.
pub fn tell_the_rest(end: bool) {
    let second = embassy_time::Instant::now().as_secs();
    let Ok(mut kinds) = KINDS.lock() else { return };
    if kinds.0 == second && !end {
        return;
    }
    kinds.0 = second;
    for Kind { lines, last, .. } in kinds.1.drain(..).filter(|kind| kind.lines > MOST) {
        log_now(&format!("{} more like this one, {last}", lines - MOST));
    }
}

fn log_now(text: &str) {
    let ms = embassy_time::Instant::now().as_millis();
    queue(Job::Log(format!("t={:.3}s {text}", ms as f64 / 1000.0)));
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
