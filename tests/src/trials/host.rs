//! What a PMS5005's host can say: Table II.1 and the extension, well formed throughout, with values that
//! matter.

use protocol::extension::{Action, Assignments, Request, Setup, Trigger};
use protocol::pms5005::{
    Addressing, CHANNELS, Channel, Command, Data, Gain, LcdFrame, Loop, Method, Move, Parameter,
    Parameters, Polarity, Quantity, Repeat, Reports, Scope, Sensor,
};
use std::num::NonZeroU8;

use super::Choices;

/// Settings that a host changes under way, and their values.
const SETTINGS: [(u16, &[i32]); 12] = [
    (1, &[100, 2000, 40]),
    (3, &[16_384, 0, 300]),
    (5, &[0, 10_000, 150]),
    (6, &[0, 0, 60, 700]),
    (32, &[50, 5, 100]),
    (33, &[20, 5, 1]),
    (180, &[0, 500, 20]),
    (181, &[0, 2000, 100_000]),
    (182, &[16_384, 9000, 1]),
    (214, &[0, 1, 2, 3]),
    (215, &[0, 1, 2, 3]),
    (48, &[3640, 900, 0]),
];

fn channel(choices: &mut Choices) -> Channel {
    // Two wheels and a joint are enough to meet each other.
    choices.weighed(&[
        (1, Channel::Channel0),
        (1, Channel::Channel1),
        (1, Channel::Channel0),
        (1, Channel::Channel5),
        (1, Channel::Channel2),
        (1, Channel::Channel3),
        (1, Channel::Channel4),
    ])
}

fn parameter(choices: &mut Choices) -> Parameter {
    let channel = channel(choices);
    match choices.below(6) {
        0 => Parameter::Polarity(channel, choices.among(&[Polarity::Positive, Polarity::Negative])),
        1 => {
            let sensors = [Sensor::SinglePotentiometer, Sensor::DualPotentiometer, Sensor::Encoder];
            Parameter::Sensor(channel, choices.among(&sensors))
        }
        2 => {
            let methods = [Method::Pwm, Method::Position, Method::Velocity];
            Parameter::Method(channel, choices.among(&methods))
        }
        3 => Parameter::CollisionProtection(choices.one_in(2)),
        _ => {
            let word = choices.among(&[0, 1, 50, 50, 5000, u16::MAX]);
            let [integer, fraction] = word.to_le_bytes();
            let gain = match choices.below(3) {
                0 => Gain::Proportional(word),
                1 => Gain::Derivative(word),
                _ => Gain::Integral { integer, fraction },
            };
            Parameter::Gain(channel, choices.among(&[Loop::Position, Loop::Velocity]), gain)
        }
    }
}

fn target(quantity: Quantity, choices: &mut Choices) -> i16 {
    let (low, high) = quantity.range();
    let stop = match quantity {
        Quantity::Pwm => 16_384,
        Quantity::Velocity => 0,
        Quantity::Position | Quantity::Servo => 2048,
    };
    match choices.below(6) {
        0 | 1 => stop,
        2 => choices.among(&[low, high, stop + 1, stop + 3000]),
        _ => {
            let span = i32::from(high) - i32::from(low) + 1;
            (i32::from(low) + i32::from(choices.word()) % span) as i16
        }
    }
}

fn motion(choices: &mut Choices) -> Move {
    let quantities = [Quantity::Pwm, Quantity::Position, Quantity::Velocity, Quantity::Servo];
    let quantity = choices.among(&quantities);
    let mut targets = [None; CHANNELS];
    if choices.one_in(3) {
        for target_of in &mut targets {
            *target_of = choices.one_in(2).then(|| target(quantity, choices));
        }
    }
    targets[channel(choices).index()] = Some(target(quantity, choices));
    let periods = choices.among(&[0, 0, 0, 1, 30, 500, 3000, u16::MAX]);
    let addressing = choices.among(&[Addressing::List, Addressing::All]);
    Move { quantity, addressing, targets, periods }
}

fn repeat(choices: &mut Choices) -> Repeat {
    let times = NonZeroU8::new(choices.among(&[1, 3, 200])).map_or(Repeat::Stop, Repeat::Times);
    choices.among(&[Repeat::Stop, Repeat::Continuous, times])
}

fn scope(choices: &mut Choices) -> Scope {
    let channel = channel(choices);
    choices.among(&[Scope::All, Scope::Motor(channel), Scope::Servo(channel)])
}

/// A request of the extension; what it borrows stands in `data`.
fn request<'a>(choices: &mut Choices, data: &'a mut Data) -> Request<'a> {
    match choices.below(16) {
        0..4 => {
            for _ in 0..1 + choices.below(3) {
                let (number, values) = choices.among(&SETTINGS);
                let value = choices.among(values);
                Assignments::emit(number, value, data).expect("three fit");
            }
            Request::Set(Assignments::parse(data).expect("what was just emitted"))
        }
        4 => Request::Do(Action::ClearFaults),
        5 if choices.are_a_fuzzers() => Request::Do(choices.among(Action::ALL)),
        // A generator's board is not to spend its days in upkeep.
        5 => Request::Do(match choices.below(200) {
            0 => Action::Save,
            1 => Action::FactoryReset,
            2 => choices.among(&[Action::Reboot, Action::RebootIntoDfu]),
            _ => Action::ClearFaults,
        }),
        6 => Request::Setting(choices.among(&[0, 1, 32, 279, 280, 63])),
        7 => choices.among(&[Request::Identity, Request::Counters, Request::Refusals]),
        8 => Request::Health(repeat(choices)),
        9 | 10 => Request::State(repeat(choices)),
        11 => Request::Fault(choices.below(4) as u8),
        12 => Request::Recording,
        13 => Request::Record(Setup {
            channels: 1 + choices.below(63) as u8,
            trigger: choices.among(Trigger::ALL),
            decimation: choices.among(&[1, 2, 50]),
            samples: choices.among(&[1, 40, 4096, u16::MAX]),
            before: 0,
        }),
        14 => Request::Blocks { first: choices.below(4) as u16, count: choices.below(4) as u16 },
        _ => Request::SetCount {
            channel: choices.below(3) as u8,
            count: choices.among(&[0, 1, -1, 32_767, i32::MAX, i32::MIN]),
        },
    }
}

/// A command; what it borrows stands in `data`.
pub(super) fn command<'a>(choices: &mut Choices, data: &'a mut Data) -> Command<'a> {
    match choices.below(18) {
        0..7 => Command::Move(motion(choices)),
        7..9 => {
            for _ in 0..1 + choices.below(3) {
                parameter(choices).emit(data).expect("three fit");
            }
            Command::Parameters(Parameters::parse(data).expect("what was just emitted"))
        }
        9..12 => Command::Run { scope: scope(choices), run: choices.one_in(2) },
        12 => {
            let reports = [Reports::Motors, Reports::CustomIo, Reports::Sensors, Reports::All];
            Command::Telemetry { reports: choices.among(&reports), repeat: repeat(choices) }
        }
        13 => Command::GpioOutputs(choices.byte()),
        14 => choices.among(&[Command::Ping, Command::PingOrAck]),
        15 if choices.one_in(8) => {
            Command::Lcd(LcdFrame { number: choices.below(16) as u8, columns: &[0x55; 64] })
        }
        _ => Command::Extension(request(choices, data)),
    }
}

/// Whether it moves motors.
pub(super) fn moves_motors(command: &Command) -> bool {
    matches!(command, Command::Move(motion) if motion.quantity != Quantity::Servo)
}
