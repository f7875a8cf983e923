//! Checking and tuning against the virtual board, on virtual time.

use embassy_time::Duration;
use hal_mock::board::{Make, VirtualBoard};
use handwheel::Number;
use handwheel::session::Session;
use handwheel::tune::{Job, Options, Refused, Tuned, check, tune};

/// A board and a host's session on its line.
struct Bench {
    board: VirtualBoard,
    session: Session,
    ms: u64,
}

impl Bench {
    fn new() -> Self {
        Self::with(Make::default())
    }

    fn with(make: Make) -> Self {
        let (board, session) = (VirtualBoard::new(make), Session::new());
        let mut bench = Self { board, session, ms: 0 };
        // Until the session knows what is there.
        (0..200).for_each(|_| bench.exchange());
        bench
    }

    fn now(&self) -> std::time::Duration {
        std::time::Duration::from_millis(self.ms)
    }

    /// A millisecond of the line.
    fn exchange(&mut self) {
        self.ms += 1;
        while let Some(bytes) = self.session.take_output() {
            self.board.line.host_sends(&bytes);
        }
        self.board.run_for(Duration::from_millis(1));
        while let Some((_, bytes)) = self.board.line.host_receives() {
            self.session.receive(&bytes);
        }
    }

    /// Runs a job to its end, `look`ing every millisecond.
    fn run_with<T>(
        &mut self,
        mut job: Job<T>,
        mut look: impl FnMut(&mut Self, &mut Job<T>),
    ) -> Result<T, Refused> {
        for _ in 0..60_000 {
            let now = self.now();
            job.converse(&mut self.session, now);
            if let Some(outcome) = job.outcome() {
                (0..50).for_each(|_| self.exchange());
                return outcome;
            }
            look(self, &mut job);
            self.exchange();
        }
        panic!("it does not end: {}", job.doing());
    }

    fn run<T>(&mut self, job: Job<T>) -> Result<T, Refused> {
        self.run_with(job, |_, _| {})
    }

    fn is_on(&self, motor: usize) -> bool {
        self.board.plant.borrow().outputs.motors[motor].enabled
    }
}

fn options(motor: &str) -> Options {
    Options {
        motor: motor.parse().unwrap(),
        control_loop: None,
        highest_duty: Options::HIGHEST_DUTY,
        apply: true,
    }
}

#[test]
fn a_wheel_is_tuned() {
    let mut bench = Bench::new();
    let began = bench.ms;
    let tuned = bench.run(tune(options("1"))).unwrap();
    println!(
        "{} ms {:?} {:?} {:?} {:?}",
        bench.ms - began,
        tuned.fit,
        tuned.design.gains,
        tuned.design.response,
        tuned.response
    );
    panic!();
}

#[test]
fn a_joint_is_tuned() {
    let mut bench = Bench::new();
    let began = bench.ms;
    let tuned = bench.run(tune(options("3"))).unwrap();
    println!(
        "{} ms {:?} {:?} {:?} {:?}",
        bench.ms - began,
        tuned.fit,
        tuned.design.gains,
        tuned.design.response,
        tuned.response
    );
    panic!();
}
