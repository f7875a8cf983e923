//! The Pioneer Arm through the whole board: a host on one end of the line, six servos on the other.
//!
//! - `session`: SYNC to CLOSE, what comes when, a host that dies;
//! - `motion`: joints, power, parking, the timers;
//! - `arm_link`: the arm's own cable, INIT and CHECK;
//! - `faults`: a fault of the board that stops the servos;
//! - `extension`: the board's settings, health and faults over the wire;
//! - `refusals`: what is not done, and hours of chaos.
//!
//! The calibration is the default one: home and centre at 127, 140 ticks to 90 degrees, 20 ms a
//! tick.

mod arm_link;
mod extension;
mod faults;
mod motion;
mod refusals;
mod session;

use embassy_time::{Duration, Instant};
use firmware::personality::pioneer_arm::{ArmCounters, PioneerArm};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use protocol::arcos::{
    Argument, ArmCommand, ArmStatus, JOINTS, Joint, Joints, Packet, Receiver, SYNC, Standard,
    StatusRequest, command, encode_command,
};

/// A packet that a host has received.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Received {
    /// When its last stop bit came.
    at: Instant,
    id: u8,
    bytes: Vec<u8>,
}

impl Received {
    fn packet(&self) -> Packet<'_> {
        Packet::parse(&self.bytes).unwrap()
    }
}

/// An arm and its host.
struct Host {
    board: VirtualBoard<PioneerArm>,
    receiver: Receiver,
}

impl Host {
    /// An arm with default settings, 115200 baud, and no session yet.
    fn new() -> Self {
        Self::with(Make::default())
    }

    /// An arm made otherwise.
    fn with(make: Make) -> Self {
        Self::with_flash(make, Flash::empty())
    }

    /// An arm whose board has this flash.
    fn with_flash(make: Make, flash: Flash) -> Self {
        let board = VirtualBoard::with_session(make, flash, PioneerArm::new);
        Self { board, receiver: Receiver::new() }
    }

    /// An open session.
    fn opened() -> Self {
        let mut host = Self::new();
        host.open();
        host
    }

    /// An open session with servo power.
    fn powered() -> Self {
        let mut host = Self::opened();
        host.send(ArmCommand::Power(true));
        host.run_ms(5);
        assert!(host.arm().powered);
        host
    }

    fn send_bytes(&mut self, bytes: &[u8]) {
        self.board.line.host_sends(bytes);
    }

    fn send(&mut self, command: ArmCommand) {
        self.send_bytes(command.encode(&mut [0; 9]).unwrap());
    }

    fn send_int(&mut self, number: u8, value: u16) {
        let argument = Some(Argument::Positive(value));
        self.send_bytes(encode_command(number, argument, &mut [0; 9]).unwrap());
    }

    /// A command with no argument.
    fn send_bare(&mut self, number: u8) {
        self.send_bytes(Packet { id: number, data: &[] }.encode(&mut [0; 6]).unwrap());
    }

    fn go(&mut self, joint: u8, ticks: u8) {
        self.send(ArmCommand::Position { joint: number(joint), ticks });
    }

    fn speed(&mut self, joint: u8, ms_per_tick: u8) {
        self.send(ArmCommand::Speed { joint: number(joint), ms_per_tick });
    }

    /// From SYNC0 to OPEN, each step after the answer to the one before.
    fn open(&mut self) {
        for sync in SYNC {
            self.send_bare(sync.id);
            self.run_ms(10);
            assert_eq!(self.received().last().map(|packet| packet.id), Some(sync.id));
        }
        self.send_int(command::OPEN, 1);
        self.run_ms(10);
        assert_eq!(self.ids(), [Standard::ID]);
    }

    fn run_ms(&mut self, ms: u64) {
        self.board.run_for(Duration::from_millis(ms));
    }

    /// Lets time pass while the host stays alive: a PULSE every 500 ms.
    fn run_alive_ms(&mut self, ms: u64) {
        self.run_alive_with(ms, |_| {});
    }

    /// As [`run_alive_ms`](Self::run_alive_ms), looking at the board after every millisecond.
    fn run_alive_with(&mut self, ms: u64, mut look: impl FnMut(&Self)) {
        for k in 0..ms {
            if k % 500 == 0 {
                self.send_bare(command::PULSE);
            }
            self.run_ms(1);
            look(self);
        }
    }

    /// The packets that have come since the last call, in order.
    fn received(&mut self) -> Vec<Received> {
        let mut packets = Vec::new();
        while let Some((at, bytes)) = self.board.line.host_receives() {
            let mut bytes = &bytes[..];
            while let Some(packet) = self.receiver.receive(&mut bytes) {
                let id = Packet::parse(packet).unwrap().id;
                packets.push(Received { at, id, bytes: packet.to_vec() });
            }
        }
        packets
    }

    /// The ids of the packets that have come since the last call.
    fn ids(&mut self) -> Vec<u8> {
        self.received().iter().map(|packet| packet.id).collect()
    }

    /// Asks for an ARMpac; its two status bytes and the positions.
    fn status_bytes(&mut self) -> Vec<u8> {
        self.received();
        self.send(ArmCommand::Status(StatusRequest::Once));
        self.run_ms(10);
        let packets = self.received();
        let status = packets.iter().find(|packet| packet.id == ArmStatus::ID).unwrap();
        status.packet().data.to_vec()
    }

    fn link(&self) -> ArmCounters {
        self.board.link()
    }

    fn arm(&self) -> ArmStatus {
        self.link().arm
    }

    fn ticks(&self, joint: u8) -> u8 {
        self.arm().positions[number(joint).index()]
    }

    /// The pulses that the board gives, in 1/2250 ms.
    fn pulses(&self) -> [Option<u16>; JOINTS] {
        self.board.plant.borrow().outputs.servos.map(|pulse| pulse.map(|pulse| pulse.raw()))
    }

    /// Where the simulated servos are, as the pulses that would hold them there.
    fn servos(&self) -> [f32; JOINTS] {
        self.board.plant.borrow().servos.map(|servo| servo.position())
    }

    /// Where one of them is.
    fn servo(&self, joint: u8) -> f32 {
        self.servos()[number(joint).index()]
    }

    /// Cuts the arm's cable, or mends it; the board has seen it 30 ms later.
    fn connect(&mut self, connected: bool) {
        self.board.plant.borrow_mut().overrides.gpio_in = Some(if connected { 0xFE } else { 0xFF });
    }
}

fn number(joint: u8) -> Joint {
    Joint::new(joint).unwrap()
}

/// The pulse of a position by the default calibration: 1.5 ms at 127, 1 ms more 140 ticks up.
fn pulse(ticks: u8) -> u16 {
    (3375 + (i32::from(ticks) - 127) * 2250 / 140) as u16
}

/// All joints at home, with power.
const AT_HOME: [Option<u16>; JOINTS] = [Some(3375); JOINTS];
const NO_PULSES: [Option<u16>; JOINTS] = [None; JOINTS];

/// Watches the pulses, and does not allow a joint more than a tick from one look to the next, nor
/// power to come or go while a servo is not at home. A fault may take it anywhere, and then it
/// comes back where it went.
struct NoJump {
    pulses: [Option<u16>; JOINTS],
    /// Where a fault has taken the power.
    lost_at: [Option<u16>; JOINTS],
}

impl NoJump {
    /// A tick is 16.07 counts.
    const TICK: i32 = 17;

    fn new(host: &Host) -> Self {
        Self { pulses: host.pulses(), lost_at: NO_PULSES }
    }

    fn look(&mut self, host: &Host) {
        let now = host.pulses();
        let servos = host.servos();
        let fault = host.board.snapshot().faults.stops_servos();
        for (joint, (before, now)) in self.pulses.iter().zip(now).enumerate() {
            let lost_at = &mut self.lost_at[joint];
            let before = match (*before, now) {
                (Some(_), None) if fault => {
                    *lost_at = *before;
                    continue;
                }
                (None, Some(_)) if lost_at.is_some() => lost_at.take(),
                _ => *before,
            };
            if let (Some(before), Some(now)) = (before, now) {
                let step = i32::from(now) - i32::from(before);
                assert!(step.abs() <= Self::TICK, "joint {} jumps by {step}", joint + 1);
            }
            if let (None, Some(now)) | (Some(now), None) = (before, now) {
                assert_eq!(now, pulse(127), "joint {}: power comes and goes at home", joint + 1);
                let from_home = (servos[joint] - f32::from(now)).abs();
                assert!(from_home < 1.0, "servo {}: {from_home} from home", joint + 1);
            }
        }
        self.pulses = now;
    }
}

/// What the whole arm is asked to do.
const ALL: Joints = Joints::All;
