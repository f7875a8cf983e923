//! The CM-5's bridge: a PC on one side, simulated AX-12 servos on the other, on virtual time.
//!
//! - `packets.rs`: properties of the PC link's receiver and packets;
//! - `startup.rs`: search, hello, setup;
//! - `work.rs`: goals, reports, silence;
//! - `faults.rs`: servos that go and come, noise;
//! - `watchdog.rs`: loops that hang;
//! - `scripted.rs`: the bridge alone, on a bus that does what no servo would.

mod faults;
mod packets;
mod scripted;
mod startup;
mod watchdog;
mod work;

use embassy_time::{Duration, Instant};
use firmware::personality::cm5::ServoCounters;
use hal_mock::cm5_board::{Cm5Board, Make};
use hal_mock::plant::Ax12;
use protocol::cm5::{
    Answer, Feedback, Goal, Goals, Hello, Limits, MAX_PACKET, Packet, Receiver, Report,
};
use protocol::dynamixel::Register;

/// What a PC hears.
#[derive(Clone, Debug, PartialEq)]
enum Said {
    Hello(Vec<u8>),
    Report(Vec<Option<Feedback>>),
}

/// A board and its PC.
struct Bench {
    board: Cm5Board,
    receiver: Receiver,
    /// How many servos the PC has agreed on.
    agreed: usize,
}

/// Servos as from the factory, with these IDs.
fn servos(ids: impl IntoIterator<Item = u8>) -> Vec<Ax12> {
    ids.into_iter().map(Ax12::new).collect()
}

/// A goal that drives, and is told apart from others.
fn goal(position: u16) -> Goal {
    Goal {
        torque_enable: 1,
        margin: [1, 1],
        slope: [32, 32],
        position,
        speed: 200,
        torque_limit: 1023,
        punch: 32,
        ..Goal::default()
    }
}

fn limits(cw: u16, ccw: u16) -> Limits {
    Limits::new(cw, ccw).unwrap()
}

impl Bench {
    fn with(make: Make) -> Self {
        Self { board: Cm5Board::new(make), receiver: Receiver::new(), agreed: 0 }
    }

    /// A board with these servos, about to search.
    fn new(servos: Vec<Ax12>) -> Self {
        Self::with(Make { servos, ..Make::default() })
    }

    /// A board at work: the PC has answered with the whole range, and all servos are set up.
    fn at_work(make: Make) -> Self {
        let count = make.servos.len();
        let mut bench = Self::with(make);
        bench.run_ms(1500);
        bench.answer(1, &[limits(0, 1023)]);
        bench.agreed = count;
        bench.run_ms(300);
        bench.said();
        bench
    }

    fn run_ms(&mut self, ms: u64) {
        self.board.run_for(Duration::from_millis(ms));
    }

    fn send(&mut self, params: &[u8]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(Packet { params }.encode(&mut buffer).unwrap());
    }

    fn answer(&mut self, return_delay: u8, limits: &[Limits]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(Answer::encode(return_delay, limits, &mut buffer).unwrap());
    }

    fn send_goals(&mut self, goals: &[Goal]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(Goals::encode(goals, &mut buffer).unwrap());
    }

    /// The same for all servos agreed on.
    fn send_goal(&mut self, goal: Goal) {
        self.send_goals(&vec![goal; self.agreed]);
    }

    /// Lets time pass while the PC sends goals 20 times a second.
    fn run_alive_ms(&mut self, ms: u64, goal: Goal) {
        for _ in 0..ms / 50 {
            self.send_goal(goal);
            self.run_ms(50);
        }
    }

    /// What the PC has heard since the last call.
    fn said(&mut self) -> Vec<(Instant, Said)> {
        let mut said = Vec::new();
        while let Some((at, packet)) = self.board.line.host_receives() {
            let packet = self.receiver.receive(&mut &packet[..]).expect("whole packets").to_vec();
            let params = Packet::parse(&packet).unwrap().params;
            let report = Report::parse(params, self.agreed).filter(|_| self.agreed > 0);
            said.push(match (report, Hello::parse(params)) {
                (Some(report), _) => (at, Said::Report(report.iter().collect())),
                (_, Some(hello)) => (at, Said::Hello(hello.ids.to_vec())),
                _ => panic!("neither hello nor report: {params:?}"),
            });
        }
        said
    }

    fn hellos(&mut self) -> Vec<(Instant, Vec<u8>)> {
        let said = self.said().into_iter();
        said.filter_map(|(at, said)| match said {
            Said::Hello(ids) => Some((at, ids)),
            Said::Report(_) => None,
        })
        .collect()
    }

    fn reports(&mut self) -> Vec<Vec<Option<Feedback>>> {
        let said = self.said().into_iter();
        said.filter_map(|(_, said)| match said {
            Said::Hello(_) => None,
            Said::Report(report) => Some(report),
        })
        .collect()
    }

    fn register(&self, servo: usize, register: Register) -> u16 {
        self.board.bus.bus().servo(servo).get(register)
    }

    /// Return delay and limits of a servo.
    fn setup(&self, servo: usize) -> [u16; 3] {
        [Register::RETURN_DELAY, Register::CW_LIMIT, Register::CCW_LIMIT]
            .map(|register| self.register(servo, register))
    }

    /// The goal that a servo holds in its registers.
    fn goal_of(&self, servo: usize) -> Goal {
        let [torque_enable, led, lock] = [Register::TORQUE_ENABLE, Register::LED, Register::LOCK]
            .map(|register| self.register(servo, register) as u8);
        let pair = |registers: [Register; 2]| registers.map(|r| self.register(servo, r) as u8);
        Goal {
            torque_enable,
            led,
            margin: pair([Register::CW_MARGIN, Register::CCW_MARGIN]),
            slope: pair([Register::CW_SLOPE, Register::CCW_SLOPE]),
            position: self.register(servo, Register::GOAL_POSITION),
            speed: self.register(servo, Register::MOVING_SPEED),
            torque_limit: self.register(servo, Register::TORQUE_LIMIT),
            lock,
            punch: self.register(servo, Register::PUNCH),
        }
    }

    fn counters(&self, servo: usize) -> ServoCounters {
        self.board.bridge().servos().nth(servo).expect("a known servo").counters()
    }

    /// Cycles a second over a time.
    fn rate(&mut self, ms: u64) -> f64 {
        let before = self.board.bridge().counters().cycles;
        self.run_ms(ms);
        f64::from(self.board.bridge().counters().cycles - before) * 1000.0 / ms as f64
    }
}
