//! What the board shows while it runs: a plain line a second, or on a terminal a small panel that
//! is drawn over itself.

use std::io::IsTerminal;

use crate::links::Links;
use crate::machine::Machine;
use crate::printer::say;

/// The display.
pub struct Status {
    panel: bool,
    /// When it is shown next, in ms of the board's time.
    next_ms: u64,
    /// Lines of the panel as it stands on the terminal.
    lines: usize,
}

impl Status {
    /// A display; `plain` even if it is a terminal.
    pub fn new(plain: bool) -> Self {
        let panel = !plain && std::io::stdout().is_terminal();
        Self { panel, next_ms: if panel { 0 } else { 1000 }, lines: 0 }
    }

    /// Shows the board, if it is time to.
    pub fn show(&mut self, machine: &dyn Machine, links: &Links) {
        let now = embassy_time::Instant::now().as_millis();
        if now < self.next_ms {
            return;
        }
        self.next_ms = now + if self.panel { 200 } else { 1000 };
        if self.panel {
            let text = panel(machine, links, now);
            // Up to the panel's first line, then over it, each line to its end.
            let up = if self.lines > 0 { format!("\x1b[{}A", self.lines) } else { String::new() };
            say(&format!("{up}{}", text.replace('\n', "\x1b[K\n") + "\x1b[K"));
            self.lines = text.lines().count();
        } else {
            say(&line(machine, links, now));
        }
    }
}

fn line(machine: &dyn Machine, links: &Links, now: u64) -> String {
    let (pty, tcp, udp) = links.connected();
    let clients = usize::from(pty) + tcp + udp;
    format!("t={:.0}s clients={clients} {}", now as f64 / 1000.0, machine.status())
}

fn panel(machine: &dyn Machine, links: &Links, now: u64) -> String {
    let (pty, tcp, udp) = links.connected();
    format!(
        "{:8.1} s   serial {}   TCP {tcp}   UDP {udp}\n{}",
        now as f64 / 1000.0,
        if pty { "open" } else { "closed" },
        machine.panel(),
    )
}
