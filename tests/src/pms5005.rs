//! The host of a PMS5005: typed commands of the manual, and the simulated truth to compare with.

use embassy_time::{Duration, Instant};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::wire::Line;
use protocol::pms5005::{
    Addressing, CHANNELS, Command, Data, Frame, Move, Parameter, Parameters, Pms5005, Quantity,
    Repeat, Report, Reports, did,
};

use crate::extension::Extended;
use crate::host::{Board, Host};

/// A PMS5005 and its host.
pub type Bench = Host<VirtualBoard>;

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

impl Board for VirtualBoard {
    type Framing = Pms5005;
    type Received = Received;

    fn line(&self) -> &Line {
        &self.line
    }

    fn run_for(&mut self, time: Duration) {
        self.run_for(time);
    }

    fn received(at: Instant, frame: &[u8]) -> Received {
        let Frame { rid, res, did, data } = Frame::parse(frame).unwrap();
        Received { at, rid, res, did, data: data.to_vec() }
    }

    fn say_alive(line: &Line) {
        line.host_sends(Command::Ping.encode(0, &mut [0; 10]).unwrap());
    }
}

impl Extended for VirtualBoard {
    const DO: u8 = did::PARAMETERS;

    /// The frame itself must be acknowledged.
    fn answers(host: &mut Bench, number: u8, data: &[u8]) -> Vec<(u8, Vec<u8>)> {
        host.received();
        host.send_raw(number, data);
        host.run_ms(40);
        let (acks, others): (Vec<_>, Vec<_>) =
            host.received().into_iter().partition(Received::is_ack);
        assert_eq!(acks.len(), 1, "{number} {data:?}");
        let is_ping = |frame: &Received| frame.did == did::SETUP;
        let others = others.into_iter().filter(|frame| !is_ping(frame) && frame.report().is_none());
        others.map(|frame| (frame.did, frame.data)).collect()
    }
}

impl Bench {
    /// A board with default settings in the default scene, 115200 baud.
    pub fn new() -> Self {
        Self::with(Make::default())
    }

    /// A board made otherwise.
    pub fn with(make: Make) -> Self {
        Self::of(VirtualBoard::new(make))
    }

    /// A board with this flash, whose telemetry is switched off.
    pub fn with_flash(flash: &Flash) -> Self {
        let mut bench = Self::of(VirtualBoard::with_flash(Make::default(), flash.clone()));
        bench.hush();
        bench
    }

    /// A board whose telemetry is switched off, so that only answers come.
    pub fn quiet() -> Self {
        let mut bench = Self::new();
        bench.hush();
        bench
    }

    /// Switches telemetry off, and drops what has come.
    pub fn hush(&mut self) {
        self.send(Command::Telemetry { reports: Reports::All, repeat: Repeat::Stop });
        self.run_ms(20);
        self.received();
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
