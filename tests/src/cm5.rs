//! A CM-5, its PC and its simulated servos.

use std::ops::{Deref, DerefMut};

use embassy_time::{Duration, Instant};
use firmware::bridge::ServoCounters;
use hal_mock::cm5_board::{Cm5Board, Make};
use hal_mock::plant::Ax12;
use hal_mock::wire::Line;
use protocol::cm5::{
    Cm5, Feedback, Goals, Hello, HelloAnswer, Limits, MAX_PACKET, Report, ServoGoal, encode,
    params_of,
};
use protocol::dynamixel::Register;

use crate::host::{Board, Host};

/// What a PC hears.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// The IDs that it has found.
    Hello(Vec<u8>),
    /// What the servos say, `None` for a stale one.
    Report(Vec<Option<Feedback>>),
}

/// A board and its line to the PC.
pub type PcHost = Host<Cm5Board>;

/// A board and its PC.
pub struct Bench {
    host: PcHost,
    /// How many servos the PC has agreed on.
    pub agreed: usize,
}

impl Deref for Bench {
    type Target = PcHost;

    fn deref(&self) -> &PcHost {
        &self.host
    }
}

impl DerefMut for Bench {
    fn deref_mut(&mut self) -> &mut PcHost {
        &mut self.host
    }
}

impl Board for Cm5Board {
    type Framing = Cm5;
    type Received = (Instant, Vec<u8>);

    fn line(&self) -> &Line {
        &self.line
    }

    fn run_for(&mut self, time: Duration) {
        self.run_for(time);
    }

    /// When it came, and its parameters.
    fn received(at: Instant, packet: &[u8]) -> (Instant, Vec<u8>) {
        (at, params_of(packet).unwrap().to_vec())
    }

    /// Goals are the sign of life, and they have an effect.
    fn say_alive(_line: &Line) {}
}

/// Servos as from the factory, with these IDs.
pub fn servos(ids: impl IntoIterator<Item = u8>) -> Vec<Ax12> {
    ids.into_iter().map(Ax12::new).collect()
}

/// A goal that drives, and is told apart from others.
pub fn goal(position: u16) -> ServoGoal {
    [
        (Register::TORQUE_ENABLE, 1),
        (Register::CW_MARGIN, 1),
        (Register::CCW_MARGIN, 1),
        (Register::CW_SLOPE, 32),
        (Register::CCW_SLOPE, 32),
        (Register::GOAL_POSITION, position),
        (Register::MOVING_SPEED, 200),
        (Register::TORQUE_LIMIT, 1023),
        (Register::PUNCH, 32),
    ]
    .into_iter()
    .fold(ServoGoal::default(), |goal, (register, value)| goal.with(register, value))
}

/// Limits that are good ones.
pub fn limits(cw: u16, ccw: u16) -> Limits {
    Limits::new(cw, ccw).unwrap()
}

impl Bench {
    /// A board made so, about to search.
    pub fn with(make: Make) -> Self {
        Self { host: Host::of(Cm5Board::new(make)), agreed: 0 }
    }

    /// A board with these servos, about to search.
    pub fn new(servos: Vec<Ax12>) -> Self {
        Self::with(Make { servos, ..Make::default() })
    }

    /// A board at work: the PC has answered with the whole range, and all servos are set up.
    pub fn at_work(make: Make) -> Self {
        let count = make.servos.len();
        let mut bench = Self::with(make);
        bench.agree(1500, &[limits(0, 1023)], count);
        bench.said();
        bench
    }

    /// Lets the search pass, answers the hello for so many servos, and lets them be set up.
    pub fn agree(&mut self, search_ms: u64, limits: &[Limits], servos: usize) {
        self.run_ms(search_ms);
        self.answer(1, limits);
        self.agreed = servos;
        self.run_ms(300);
    }

    /// Sends a packet with these parameters.
    pub fn send(&mut self, params: &[u8]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(encode([params], &mut buffer).unwrap());
    }

    /// Answers a hello.
    pub fn answer(&mut self, return_delay: u8, limits: &[Limits]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(HelloAnswer::encode(return_delay, limits, &mut buffer).unwrap());
    }

    /// Sends goals, one a servo.
    pub fn send_goals(&mut self, goals: &[ServoGoal]) {
        let mut buffer = [0; MAX_PACKET];
        self.board.line.host_sends(Goals::encode(goals, &mut buffer).unwrap());
    }

    /// The same for all servos agreed on.
    pub fn send_goal(&mut self, goal: ServoGoal) {
        self.send_goals(&vec![goal; self.agreed]);
    }

    /// Lets time pass while the PC sends goals 20 times a second.
    pub fn run_alive_ms(&mut self, ms: u64, goal: ServoGoal) {
        for _ in 0..ms / 50 {
            self.send_goal(goal);
            self.run_ms(50);
        }
    }

    /// What the PC has heard since the last call.
    pub fn said(&mut self) -> Vec<(Instant, Said)> {
        let meaning = |params: &[u8]| {
            let report = Report::parse(params, self.agreed).filter(|_| self.agreed > 0);
            match (report, Hello::parse(params)) {
                (Some(report), _) => Said::Report(report.iter().collect()),
                (_, Some(hello)) => Said::Hello(hello.ids.to_vec()),
                _ => panic!("neither hello nor report: {params:?}"),
            }
        };
        let heard = self.host.received();
        heard.into_iter().map(|(at, params)| (at, meaning(&params))).collect()
    }

    /// The hellos among it: when, and the IDs.
    pub fn hellos(&mut self) -> Vec<(Instant, Vec<u8>)> {
        let said = self.said().into_iter();
        said.filter_map(|(at, said)| match said {
            Said::Hello(ids) => Some((at, ids)),
            Said::Report(_) => None,
        })
        .collect()
    }

    /// The reports among it.
    pub fn reports(&mut self) -> Vec<Vec<Option<Feedback>>> {
        let said = self.said().into_iter();
        said.filter_map(|(_, said)| match said {
            Said::Hello(_) => None,
            Said::Report(report) => Some(report),
        })
        .collect()
    }

    /// Cycles a second over a time.
    pub fn rate(&mut self, ms: u64) -> f64 {
        let before = self.board.bridge().counters().cycles;
        self.run_ms(ms);
        f64::from(self.board.bridge().counters().cycles - before) * 1000.0 / ms as f64
    }
}

impl PcHost {
    /// What a servo holds in a register.
    pub fn register(&self, servo: usize, register: Register) -> u16 {
        self.board.bus.bus().servo(servo).get(register)
    }

    /// Return delay and limits of a servo.
    pub fn setup(&self, servo: usize) -> [u16; 3] {
        [Register::RETURN_DELAY, Register::CW_LIMIT, Register::CCW_LIMIT]
            .map(|register| self.register(servo, register))
    }

    /// The goal that a servo holds in its registers.
    pub fn goal_of(&self, servo: usize) -> ServoGoal {
        ServoGoal::REGISTERS.into_iter().fold(ServoGoal::default(), |goal, register| {
            goal.with(register, self.register(servo, register))
        })
    }

    /// What the bridge has counted of a servo.
    pub fn counters(&self, servo: usize) -> ServoCounters {
        self.board.bridge().servos().nth(servo).expect("a known servo").counters
    }
}
