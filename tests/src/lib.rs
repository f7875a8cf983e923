//! A host at the other end of a virtual board's line, for the tests beside it.
//!
//! - `tests/conformance/`: the manual, example by example and table by table;
//! - `tests/reception/`: properties of the receiver and of every codec;
//! - `tests/session.rs`: acknowledgements, telemetry, a saturated line;
//! - `tests/extension.rs`: settings, upkeep, health and faults over the wire;
//! - `tests/store.rs`: settings in a flash that loses power at any byte;
//! - `tests/control.rs`: the loops against the simulated motors, with bounds on both sides;
//! - `tests/safety.rs`: silence, suspension, obstacles; `tests/refusals.rs`: what is not done;
//! - `tests/faults/`: every fault and its near miss, every setting of them;
//! - `tests/invariants.rs`: hours of chaos, and what holds in every period of them;
//! - `tests/same_bits.rs`: one digest of the controller for every machine;
//! - `tests/arcos.rs`: ARCOS packets; `tests/pioneer_arm/`: the arm behind them, as scenarios;
//! - `tests/dynamixel.rs`, `tests/servo_bus.rs`: the packets of the servo bus, and the bus;
//! - `tests/cm5/`: the CM-5's bridge between a PC and simulated servos;
//! - `tests/qemu/`: the images in QEMU;
//! - `cost/`: a crate of its own, what the code costs in instructions.

use embassy_time::{Duration, Instant};
use hal_mock::board::{Make, VirtualBoard};
use protocol::pms5005::{
    Addressing, CHANNELS, Command, Data, Frame, Move, Parameter, Parameters, Quantity, Receiver,
    Repeat, Report, Reports,
};

/// A frame that a host has received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// When its last stop bit came.
    pub at: Instant,
    /// Robot ID.
    pub rid: u8,
    /// Reserved byte.
    pub res: u8,
    /// Data ID.
    pub did: u8,
    /// DATA.
    pub data: Vec<u8>,
}

impl Received {
    /// Whether it is the acknowledgement of section III.
    pub fn is_ack(&self) -> bool {
        (self.rid, self.res, self.did, &self.data[..]) == (0, 0, 255, &[1])
    }

    /// The telemetry that it is.
    pub fn report(&self) -> Option<Report> {
        (self.rid == 0 && self.res == 255).then(|| Report::parse(self.did, &self.data)).flatten()
    }
}

/// A board and its host.
pub struct Bench {
    /// The board.
    pub board: VirtualBoard,
    receiver: Receiver,
}

impl Bench {
    /// A board with default settings in the default scene, 115200 baud.
    pub fn new() -> Self {
        Self::with(Make::default())
    }

    /// A board made otherwise.
    pub fn with(make: Make) -> Self {
        Self { board: VirtualBoard::new(make), receiver: Receiver::new() }
    }

    /// A board whose telemetry is switched off, so that only answers come.
    pub fn quiet() -> Self {
        let mut bench = Self::new();
        bench.send(Command::Telemetry { reports: Reports::All, repeat: Repeat::Stop });
        bench.run_ms(20);
        bench.received();
        bench
    }

    /// Sends a command in a frame with RES 0.
    pub fn send(&mut self, command: Command) {
        let mut buffer = [0; 264];
        let frame = command.encode(0, &mut buffer).expect("a command that can be encoded");
        self.board.line.host_sends(frame);
    }

    /// Sends parameters, all in one frame.
    pub fn configure(&mut self, parameters: &[Parameter]) {
        let mut data = Data::new();
        for parameter in parameters {
            parameter.emit(&mut data).expect("parameters that fit one frame");
        }
        self.send(Command::Parameters(Parameters::parse(&data).expect("what was just emitted")));
    }

    /// Sends a frame with whatever DID and DATA.
    pub fn send_raw(&mut self, did: u8, data: &[u8]) {
        let mut buffer = [0; 264];
        let frame = Frame { rid: 1, res: 0, did, data }.encode(&mut buffer).unwrap();
        self.board.line.host_sends(frame);
    }

    /// Sends a motion command for one channel, as a list.
    pub fn drive(&mut self, quantity: Quantity, channel: usize, target: i16, periods: u16) {
        let mut targets = [None; CHANNELS];
        targets[channel] = Some(target);
        self.send(Command::Move(Move { quantity, addressing: Addressing::List, targets, periods }));
    }

    /// Lets time pass.
    pub fn run_ms(&mut self, ms: u64) {
        self.board.run_for(Duration::from_millis(ms));
    }

    /// Lets time pass while the host stays alive: a command without effect every 500 ms.
    pub fn run_alive_ms(&mut self, ms: u64) {
        self.run_alive_with(ms, |_| {});
    }

    /// As [`run_alive_ms`](Self::run_alive_ms), looking at the board after every millisecond.
    pub fn run_alive_with(&mut self, ms: u64, mut look: impl FnMut(&Self)) {
        for k in 0..ms {
            if k % 500 == 0 {
                self.send(Command::Ping);
            }
            self.run_ms(1);
            look(self);
        }
    }

    /// The frames that have come since the last call, in order.
    pub fn received(&mut self) -> Vec<Received> {
        let mut frames = Vec::new();
        while let Some((at, bytes)) = self.board.line.host_receives() {
            let mut bytes = &bytes[..];
            while let Some(frame) = self.receiver.receive(&mut bytes) {
                let Frame { rid, res, did, data } = Frame::parse(frame).unwrap();
                frames.push(Received { at, rid, res, did, data: data.to_vec() });
            }
        }
        frames
    }

    /// How many acknowledgements have come since the last call; other frames are dropped.
    pub fn acks(&mut self) -> usize {
        self.received().iter().filter(|frame| frame.is_ack()).count()
    }

    /// True position of a motor's shaft in counts, unwrapped.
    pub fn position(&self, motor: usize) -> i64 {
        self.board.plant.borrow().motors[motor].position()
    }

    /// True velocity of a motor's shaft in counts per second.
    pub fn velocity(&self, motor: usize) -> f32 {
        self.board.plant.borrow().motors[motor].velocity()
    }

    /// What a motor's bridge does: raw duty, and whether it is enabled.
    pub fn bridge(&self, motor: usize) -> (i16, bool) {
        let output = self.board.plant.borrow().outputs.motors[motor];
        (output.duty.raw(), output.enabled)
    }

    /// A servo's pulse width in 1/2250 ms.
    pub fn pulse(&self, servo: usize) -> Option<u16> {
        self.board.plant.borrow().outputs.servos[servo].map(|pulse| pulse.raw())
    }
}

impl Default for Bench {
    fn default() -> Self {
        Self::new()
    }
}
