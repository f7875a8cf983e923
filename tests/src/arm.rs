//! The host of a Pioneer Arm: typed ARCOS commands, and the simulated truth to compare with.

use embassy_time::{Duration, Instant};
use firmware::personality::pioneer_arm::{ArmCounters, PioneerArm};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::wire::Line;
use protocol::arcos::{
    Arcos, Argument, ArmCommand, ArmStatus, JOINTS, JointNumber, Packet, SYNC, Standard,
    StatusRequest, command, encode_command,
};

use crate::extension::Extended;
use crate::host::{Board, Host};

/// An arm and its host.
pub type Arm = Host<VirtualBoard<PioneerArm>>;

/// A packet that a host has received.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Received {
    /// When its last stop bit came.
    pub at: Instant,
    /// Its command or report.
    pub id: u8,
    /// All of it.
    pub bytes: Vec<u8>,
}

impl Received {
    /// It, taken apart.
    pub fn packet(&self) -> Packet<'_> {
        Packet::parse(&self.bytes).unwrap()
    }
}

impl Board for VirtualBoard<PioneerArm> {
    type Framing = Arcos;
    type Received = Received;

    fn line(&self) -> &Line {
        &self.line
    }

    fn run_for(&mut self, time: Duration) {
        self.run_for(time);
    }

    fn received(at: Instant, packet: &[u8]) -> Received {
        Received { at, id: Packet::parse(packet).unwrap().id, bytes: packet.to_vec() }
    }

    fn say_alive(line: &Line) {
        line.host_sends(&bare(command::PULSE));
    }
}

impl Extended for VirtualBoard<PioneerArm> {
    const DO: u8 = 101;

    fn answers(host: &mut Arm, number: u8, text: &[u8]) -> Vec<(u8, Vec<u8>)> {
        host.received();
        let argument = Some(Argument::Text(text));
        host.send_bytes(encode_command(number, argument, &mut [0; 200]).unwrap());
        host.run_ms(40);
        let answers = host.received().into_iter().filter(|packet| (96..112).contains(&packet.id));
        answers.map(|packet| (packet.id, packet.packet().data.to_vec())).collect()
    }
}

/// A packet without data.
fn bare(id: u8) -> Vec<u8> {
    Packet { id, data: &[] }.encode(&mut [0; 6]).unwrap().to_vec()
}

impl Arm {
    /// An arm with default settings, 115200 baud, and no session yet.
    pub fn new() -> Self {
        Self::with(Make::default())
    }

    /// An arm made otherwise.
    pub fn with(make: Make) -> Self {
        Self::with_flash(make, Flash::empty())
    }

    /// An arm whose board has this flash.
    pub fn with_flash(make: Make, flash: Flash) -> Self {
        Self::of(VirtualBoard::with_session(make, flash, PioneerArm::new))
    }

    /// An open session.
    pub fn opened() -> Self {
        let mut host = Self::new();
        host.open();
        host
    }

    /// An open session with servo power.
    pub fn powered() -> Self {
        let mut host = Self::opened();
        host.power_up();
        assert!(host.arm().powered);
        host
    }

    /// Asks for servo power, and lets 5 ms pass.
    pub fn power_up(&mut self) {
        self.send(ArmCommand::Power(true));
        self.run_ms(5);
    }

    /// Sends a command.
    pub fn send(&mut self, command: ArmCommand) {
        self.send_bytes(command.encode(&mut [0; 9]).unwrap());
    }

    /// Sends a command with a positive argument.
    pub fn send_int(&mut self, number: u8, value: u16) {
        let argument = Some(Argument::Positive(value));
        self.send_bytes(encode_command(number, argument, &mut [0; 9]).unwrap());
    }

    /// A command with no argument.
    pub fn send_bare(&mut self, number: u8) {
        self.send_bytes(&bare(number));
    }

    /// Sends POS.
    pub fn go(&mut self, joint: u8, ticks: u8) {
        self.send(ArmCommand::Position { joint: number(joint), ticks });
    }

    /// Sends SPEED.
    pub fn speed(&mut self, joint: u8, ms_per_tick: u8) {
        self.send(ArmCommand::Speed { joint: number(joint), ms_per_tick });
    }

    /// From SYNC0 to OPEN without waiting for an answer.
    pub fn open_blindly(&mut self) {
        SYNC.iter().for_each(|sync| self.send_bare(sync.id));
        self.send_int(command::OPEN, 1);
    }

    /// From SYNC0 to OPEN, each step after the answer to the one before.
    pub fn open(&mut self) {
        for sync in SYNC {
            self.send_bare(sync.id);
            self.run_ms(10);
            assert_eq!(self.received().last().map(|packet| packet.id), Some(sync.id));
        }
        self.send_int(command::OPEN, 1);
        self.run_ms(10);
        assert_eq!(self.ids(), [Standard::ID]);
    }

    /// The first packet with this id that has come since the last call.
    #[track_caller]
    pub fn heard(&mut self, id: u8) -> Received {
        self.received().into_iter().find(|packet| packet.id == id).expect("a packet with this id")
    }

    /// The ids of the packets that have come since the last call.
    pub fn ids(&mut self) -> Vec<u8> {
        self.received().iter().map(|packet| packet.id).collect()
    }

    /// Asks for an ARMpac; its two status bytes and the positions.
    pub fn status_bytes(&mut self) -> Vec<u8> {
        self.received();
        self.send(ArmCommand::Status(StatusRequest::Once));
        self.run_ms(10);
        self.heard(ArmStatus::ID).packet().data.to_vec()
    }

    /// What the session has counted.
    pub fn link(&self) -> ArmCounters {
        self.board.link()
    }

    /// What ARMpac would have told when the arm was last looked at: within 20 ms, and at every arrival.
    pub fn arm(&self) -> ArmStatus {
        self.link().arm
    }

    /// Where a joint is told to be.
    pub fn ticks(&self, joint: u8) -> u8 {
        self.arm().positions[number(joint).index()]
    }

    /// The pulses that the board gives, in 1/2250 ms.
    pub fn pulses(&self) -> [Option<u16>; JOINTS] {
        self.board.plant.borrow().outputs.servos.map(|pulse| pulse.map(|pulse| pulse.raw()))
    }

    /// Where the simulated servos are, as the pulses that would hold them there.
    pub fn servos(&self) -> [f32; JOINTS] {
        self.board.plant.borrow().servos.map(|servo| servo.position())
    }

    /// Where one of them is.
    pub fn servo(&self, joint: u8) -> f32 {
        self.servos()[number(joint).index()]
    }

    /// Cuts the arm's cable, or mends it; the board has seen it 30 ms later.
    pub fn connect(&mut self, connected: bool) {
        self.board.plant.borrow_mut().overrides.gpio_in = Some(if connected { 0xFE } else { 0xFF });
    }
}

/// A joint by its number from 1.
pub fn number(joint: u8) -> JointNumber {
    JointNumber::new(joint).unwrap()
}
