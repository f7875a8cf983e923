//! What the board shows while it runs: a plain line a second, or on a terminal a small panel that
//! is drawn over itself.

use std::fmt::Write;
use std::io::IsTerminal;

use hal_mock::board::VirtualBoard;

use crate::links::Links;
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
    pub fn show(&mut self, board: &VirtualBoard, links: &Links) {
        let now = embassy_time::Instant::now().as_millis();
        if now < self.next_ms {
            return;
        }
        self.next_ms = now + if self.panel { 200 } else { 1000 };
        if self.panel {
            let text = panel(board, links, now);
            // Up to the panel's first line, then over it, each line to its end.
            let up = if self.lines > 0 { format!("\x1b[{}A", self.lines) } else { String::new() };
            say(&format!("{up}{}", text.trim_end().replace('\n', "\x1b[K\n") + "\x1b[K"));
            self.lines = text.trim_end().lines().count();
        } else {
            say(&line(board, links, now));
        }
    }
}

fn line(board: &VirtualBoard, links: &Links, now: u64) -> String {
    let plant = board.plant.borrow();
    let link = board.link();
    let (pty, tcp, udp) = links.connected();
    let mut text =
        format!("t={:.0}s clients={} duty=", now as f64 / 1000.0, usize::from(pty) + tcp + udp);
    for (i, motor) in plant.outputs.motors.iter().enumerate() {
        let comma = if i > 0 { "," } else { "" };
        let _ = match motor.enabled {
            true => write!(text, "{comma}{:+.2}", f64::from(motor.duty.raw()) / 16384.0),
            false => write!(text, "{comma}off"),
        };
    }
    let _ = write!(
        text,
        " frames={} bad={} acks={} telemetry={} refused={}",
        link.frames_ok,
        link.bad_frames,
        link.acks_sent,
        link.telemetry_sent,
        board.refused(),
    );
    if board.snapshot().link_loss {
        text.push_str(" LINK-LOSS");
    }
    text
}

fn panel(board: &VirtualBoard, links: &Links, now: u64) -> String {
    let plant = board.plant.borrow();
    let link = board.link();
    let (pty, tcp, udp) = links.connected();
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{:8.1} s   serial {}   TCP {tcp}   UDP {udp}   {}",
        now as f64 / 1000.0,
        if pty { "open" } else { "closed" },
        if board.snapshot().link_loss { "host silent: LINK LOSS" } else { "" },
    );
    for (i, (motor, output)) in plant.motors.iter().zip(&plant.outputs.motors).enumerate() {
        let duty = match output.enabled {
            true => format!("{:+6.1} %", f64::from(output.duty.raw()) / 163.84),
            false => "     off".into(),
        };
        let servo = match plant.outputs.servos[i] {
            Some(pulse) => format!("{:6.0} us", f64::from(pulse.raw()) / 2.25),
            None => "      off".into(),
        };
        let at = plant.servos[i].position() / 2.25;
        let _ = writeln!(
            text,
            "motor {} {duty} {:9} {:7.0}/s {:5.2} A   servo {} {servo} at {at:4.0}",
            i + 1,
            motor.position(),
            motor.velocity(),
            motor.current_a(),
            i + 1,
        );
    }
    let _ = writeln!(
        text,
        "frames {} bad {} refused {}  acks {}  telemetry {}  out {:08b}",
        link.frames_ok,
        link.bad_frames,
        board.refused(),
        link.acks_sent,
        link.telemetry_sent,
        plant.outputs.gpio,
    );
    text
}
