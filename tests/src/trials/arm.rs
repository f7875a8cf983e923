//! A Pioneer Arm and its host: sessions that open and close, all commands of the arm, requests of the
//! extension, silence, an arm that is pulled, over a line that damages what is sent.
//!
//! What must hold besides what `board` and `model` beside it say:
//! - what the board sends is whole packets that can be read;
//! - no DC motor is ever on; pulses lie within the joints' calibration, and without power there are none;
//! - a joint that ARMpac does not call moving stands;
//! - an open session has a standard packet every 100 ms.

use embassy_time::Instant;
use firmware::personality::pioneer_arm::PioneerArm;
use firmware::settings::{JointSettings, Settings};
use protocol::arcos::{
    Argument, ArmCommand, ArmInfo, ArmStatus, Dialect, JointNumber, Joints, MotionBits, Names,
    Packet, Receiver, SYNC, Standard, StatusRequest, command, encode_command, extension,
};
use protocol::extension::{Action, Answer, Assignments, Request};
use protocol::pms5005::{Data, Repeat};

use super::board::Board;
use super::{Choices, world};

/// A cycle of standard packets is 100 ms; an upkeep or a hang may hold one up.
const LONGEST_CYCLE: u64 = 105;
/// Milliseconds in which the board takes what was sent, and what stands behind something damaged.
const TAKEN_WITHIN: u64 = 20;
const DAMAGE_LASTS: u64 = 1100;

/// What befalls it.
#[derive(Clone, Copy, Debug)]
enum Befalls {
    Pause,
    Say,
    Open,
    Damage,
    Noise,
    World,
    WorldIsRight,
    Cable,
    Silence,
    Hang,
    PowerFails,
}

const ALL: [(u32, Befalls); 13] = [
    (4000, Befalls::Pause),
    (2500, Befalls::Say),
    (500, Befalls::Say),
    (200, Befalls::Open),
    (200, Befalls::Damage),
    (60, Befalls::Noise),
    (10, Befalls::World),
    (10, Befalls::WorldIsRight),
    (10, Befalls::Cable),
    (10, Befalls::Silence),
    (10, Befalls::Silence),
    (1, Befalls::Hang),
    (1, Befalls::PowerFails),
];

/// See the [module](self).
pub struct Trial {
    board: Board<PioneerArm>,
    receiver: Receiver,
    /// Since when a standard packet is awaited; `None` while nobody can say whether a session is open.
    awaited_since: Option<u64>,
    unsure_until: u64,
    starts: u32,
    /// How long no joint has moved, as ARMpac has it, nor has been told to.
    at_rest_for: u32,
    slews: u32,
}

impl Trial {
    /// An arm whose board has just been switched on.
    pub fn new(choices: &mut Choices) -> Self {
        let mut settings = Settings::DEFAULT;
        settings.arm.dialect = choices.below(3) as u8;
        settings.arm.autopark_s = choices.among(&[600, 1]);
        settings.arm.grippark_s = choices.among(&[300, 1]);
        let board = Board::new(settings, choices, PioneerArm::new);
        Self {
            board,
            receiver: Receiver::new(),
            awaited_since: None,
            unsure_until: 0,
            starts: 1,
            at_rest_for: 0,
            slews: 0,
        }
    }

    /// Milliseconds so far.
    pub fn ms(&self) -> u64 {
        self.board.ms
    }

    /// One more thing befalls it.
    pub fn go_on(&mut self, choices: &mut Choices) {
        match choices.weighed(&ALL) {
            Befalls::Pause => {
                let ms = match choices.are_a_fuzzers() {
                    true => choices.among(&[1, 2, 5, 20, 45, 110, 250, 710]),
                    false => 1 + choices.below(50),
                };
                self.pass(ms.into());
            }
            Befalls::Say => self.say(choices),
            Befalls::Open => self.open(choices),
            Befalls::Damage => {
                let mut packet = packet(choices);
                let at = choices.below(packet.len() as u32) as usize;
                match choices.below(3) {
                    0 => packet.truncate(at),
                    1 => drop(packet.drain(..at)),
                    _ => packet[at] ^= 1 << choices.below(8),
                }
                self.damage(&packet);
            }
            Befalls::Noise => self.damage(&choices.bytes(40)),
            Befalls::World => self.board.disturb(choices),
            Befalls::WorldIsRight => world::mend(&mut self.board.it.plant.borrow_mut()),
            Befalls::Cable => {
                let reads = choices.among(&[Some(0xFE), Some(0xFF), None]);
                self.board.it.plant.borrow_mut().overrides.gpio_in = reads;
            }
            Befalls::Silence => self.pass(choices.among(&[1990, 2100, 1000])),
            Befalls::Hang => {
                self.board.hang(choices);
                self.awaited_since = None;
                self.pass(200);
                assert!(self.board.has_started(), "a task hangs, and nobody starts the board");
            }
            Befalls::PowerFails => {
                self.board.power_fails();
                self.pass(1);
                assert!(self.board.has_started(), "power is back, and the board does not start");
            }
        }
    }

    /// The host opens a session from the beginning, as all do that find one open.
    fn open(&mut self, choices: &mut Choices) {
        if choices.one_in(2) {
            self.send(&bare(command::CLOSE));
        }
        for sync in SYNC {
            self.send(&bare(sync.id));
            self.pass(choices.below(4).into());
        }
        let argument = Some(Argument::Positive(1));
        self.send(encode_command(command::OPEN, argument, &mut [0; 9]).expect("it fits"));
    }

    fn say(&mut self, choices: &mut Choices) {
        self.send(&packet(choices));
    }

    fn send(&mut self, bytes: &[u8]) {
        self.board.it.line.host_sends(bytes);
        self.awaited_since = None;
        self.unsure_until = self.unsure_until.max(Instant::now().as_millis() + TAKEN_WITHIN);
    }

    fn damage(&mut self, bytes: &[u8]) {
        self.send(bytes);
        self.unsure_until = Instant::now().as_millis() + DAMAGE_LASTS;
    }

    /// Lets time pass, and looks at the board after every millisecond.
    fn pass(&mut self, ms: u64) {
        for _ in 0..ms {
            self.board.pass();
            if self.starts != self.board.starts {
                self.at_rest_for = 0;
            }
            self.look();
            self.hear();
            if self.starts != self.board.starts {
                // What was heard in this millisecond may be of the session before.
                (self.starts, self.awaited_since) = (self.board.starts, None);
            }
            self.board.looked();
        }
    }

    fn look(&mut self) {
        let now = &self.board.now;
        assert_eq!(self.board.moves, 0, "an arm has no motors");
        assert!(now.outputs.motors.iter().all(|motor| !motor.enabled), "a motor is on");
        let arm = self.board.it.link().arm;
        for (i, pulse) in now.outputs.servos.iter().enumerate() {
            let Some(pulse) = pulse.map(|pulse| i32::from(pulse.raw())) else { continue };
            let joint = &self.board.settings.arm.joints[i];
            let (low, high) = (pulse_at(joint, joint.min), pulse_at(joint, joint.max));
            assert!((low..=high).contains(&pulse), "joint {i} at {pulse}, not {low} to {high}");
        }
        let is_told = std::mem::replace(&mut self.slews, self.board.slews) != self.board.slews;
        let is_at_rest = !is_told && !arm.moving.iter().any(|moves| *moves);
        self.at_rest_for = if is_at_rest { self.at_rest_for + 1 } else { 0 };
        // A look is 20 ms old at the most, and a stopped joint goes back to its tick.
        if self.at_rest_for > 200 && !self.board.model.is_held {
            let places = self.board.before.servos.iter().zip(&now.servos);
            // One that is given its power for the first time has had no place.
            let stays = |(before, now): (&Option<_>, _)| before.is_none() || before == now;
            assert!(places.clone().all(stays), "a joint at rest moves: {places:?}");
        }
    }

    fn hear(&mut self) {
        let dialect = match self.board.settings.arm.dialect {
            1 => Dialect::Manual(MotionBits::ZeroToFive),
            2 => Dialect::Aria,
            _ => Dialect::Manual(MotionBits::OneToSix),
        };
        let time = Instant::now().as_millis();
        while let Some((_, bytes)) = self.board.it.line.host_receives() {
            let mut rest = &bytes[..];
            let whole = self.receiver.receive(&mut rest).expect("a whole packet");
            assert!(rest.is_empty() && whole == bytes, "one packet at once");
            let packet = Packet::parse(&bytes).expect("it is whole");
            match packet.id {
                0 | 1 => assert!(packet.data.is_empty(), "an echo of a SYNC"),
                2 => assert!(Names::parse(&packet).is_some(), "the answer to SYNC2"),
                Standard::ID => {
                    assert!(Standard::parse(&packet).is_some());
                    // What was sent a moment ago may be about to close the session.
                    self.awaited_since = (time > self.unsure_until).then_some(time);
                }
                ArmStatus::ID => {
                    let status = ArmStatus::parse(&packet, dialect).expect("an ARMpac");
                    for (joint, at) in self.board.settings.arm.joints.iter().zip(status.positions) {
                        assert!((joint.min..=joint.max).contains(&at), "{at} of {joint:?}");
                    }
                }
                ArmInfo::ID => assert!(ArmInfo::parse(&packet).is_some(), "an ARMINFOpac"),
                id => {
                    let answer = Answer::parse(id, packet.data);
                    assert!(answer.is_some(), "{id}: nothing that an arm says");
                }
            }
        }
        let is_late = self.awaited_since.is_some_and(|since| time > since + LONGEST_CYCLE);
        assert!(!is_late || self.board.model.is_held, "no standard packet for {LONGEST_CYCLE} ms");
    }

    /// The host has said all.
    pub fn end(&mut self) {
        self.pass(50);
    }
}

/// The pulse at a position, in 1/2250 ms: 1.5 ms at the centre, 1 ms more or less 90 degrees from there.
fn pulse_at(joint: &JointSettings, ticks: u8) -> i32 {
    let way = i32::from(ticks) - i32::from(joint.centre);
    3375 + way * 2250 / i32::from(joint.ticks_per_90)
}

fn bare(id: u8) -> Vec<u8> {
    Packet { id, data: &[] }.encode(&mut [0; 6]).expect("it fits").to_vec()
}

/// A packet of a host.
fn packet(choices: &mut Choices) -> Vec<u8> {
    let mut buffer = [0; 200];
    let joint = choices.among(&JointNumber::ALL);
    let joints = choices.among(&[Joints::One(joint), Joints::All]);
    let command = match choices.below(24) {
        0 => ArmCommand::Info,
        1 => ArmCommand::Status(choices.among(StatusRequest::ALL)),
        2 => ArmCommand::Init,
        3 => ArmCommand::Check,
        4 | 5 => ArmCommand::Power(true),
        6 => ArmCommand::Power(false),
        7 => ArmCommand::Home(joints),
        8 => ArmCommand::Park,
        9..13 => ArmCommand::Position { joint, ticks: choices.byte() },
        13 | 14 => ArmCommand::Speed { joint, ms_per_tick: choices.among(&[1, 20, 127, 0, 255]) },
        15 | 16 => ArmCommand::Stop(joints),
        17 => ArmCommand::AutoPark(choices.among(&[0, 1, 600])),
        18 => ArmCommand::GripPark(choices.among(&[0, 1, 300])),
        19 => return bare(choices.among(&[0, 0, 1, 2])),
        20 => return bare(choices.byte()),
        _ => {
            let mut data = Data::new();
            let request = request(choices, &mut data);
            let bytes = extension::encode_request(&request, &mut buffer).expect("it fits");
            return bytes.to_vec();
        }
    };
    command.encode(&mut buffer).expect("it fits").to_vec()
}

/// A request of the extension; what it borrows stands in `data`.
fn request<'a>(choices: &mut Choices, data: &'a mut Data) -> Request<'a> {
    match choices.below(8) {
        0 => {
            let settings =
                [(112, 2), (112, 0), (66, 1820), (114, 1), (121, 100), (128, 1), (1, 100)];
            let (number, value) = choices.among(&settings);
            Assignments::emit(number, value, data).expect("it fits");
            Request::Set(Assignments::parse(data).expect("what was just emitted"))
        }
        1 => Request::Do(Action::ClearFaults),
        2 if choices.are_a_fuzzers() || choices.one_in(200) => {
            Request::Do(choices.among(Action::ALL))
        }
        3 => Request::Health(choices.among(&[Repeat::Stop, Repeat::Continuous])),
        4 => Request::Fault(choices.below(3) as u8),
        5 => Request::Setting(choices.among(&[0, 112, 167])),
        6 => choices.among(&[Request::Counters, Request::Refusals]),
        _ => Request::Identity,
    }
}

/// A fuzzer's session: some hundred events, a few seconds.
pub(super) fn trial(choices: &mut Choices) {
    let mut trial = Trial::new(choices);
    for _ in 0..300 {
        trial.go_on(choices);
        if choices.are_over() || trial.ms() > 6000 {
            break;
        }
    }
    trial.end();
}
