//! What the board prints while it runs, in plain lines: each fault as it comes and goes, and a status
//! line when something has changed, one a second at the most. To look at a board closely is what
//! hosts and the inspector are for.

use hal_mock::machine::Machine;

use crate::links::Links;
use crate::printer::say;

/// The least time between two status lines, in ms.
const PERIOD_MS: u64 = 1000;

/// What was said last.
#[derive(Default)]
pub struct Status {
    faults: Vec<String>,
    line: String,
    /// When the next line may be said, in ms of the board's time.
    next_ms: u64,
}

impl Status {
    /// Says what has changed.
    pub fn show(&mut self, machine: &dyn Machine, links: &Links) {
        let now_ms = embassy_time::Instant::now().as_millis();
        let seconds = now_ms as f64 / 1000.0;
        let faults = machine.faults();
        for fault in faults.iter().filter(|fault| !self.faults.contains(fault)) {
            say(&format!("t={seconds:.3}s fault: {fault}"));
        }
        for fault in self.faults.iter().filter(|fault| !faults.contains(fault)) {
            say(&format!("t={seconds:.3}s no longer: {fault}"));
        }
        self.faults = faults;
        if now_ms >= self.next_ms {
            let (serial, tcp, udp) = links.connected();
            let clients = usize::from(serial) + tcp + udp;
            let line = format!("clients={clients} {}", machine.status());
            if line != self.line {
                say(&format!("t={seconds:.3}s {line}"));
                self.line = line;
                self.next_ms = now_ms + PERIOD_MS;
            }
        }
    }
}
