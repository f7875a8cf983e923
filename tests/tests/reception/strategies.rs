//! Any command, any parameter, any report, for proptest.

use std::num::NonZeroU8;

use super::*;

pub fn motion() -> impl Strategy<Value = Move> {
    let quantities = [Quantity::Position, Quantity::Pwm, Quantity::Velocity, Quantity::Servo];
    (select(quantities.to_vec()), select(vec![Addressing::List, Addressing::All])).prop_flat_map(
        |(quantity, addressing)| {
            let (low, high) = quantity.range();
            let target = prop::option::of(prop_oneof![Just(low), Just(high), low..=high]);
            (prop::array::uniform6(target), prop_oneof![Just(0), any::<u16>()])
                .prop_map(move |(targets, periods)| Move { quantity, addressing, targets, periods })
                .prop_filter("a list is not empty", |command| {
                    command.addressing == Addressing::All || command.targets != [None; CHANNELS]
                })
        },
    )
}

/// Every command that borrows nothing.
pub fn command() -> impl Strategy<Value = Command<'static>> {
    let scopes = [vec![Scope::All], ALL.map(Scope::Motor).into(), ALL.map(Scope::Servo).into()];
    let reports = [Reports::Motors, Reports::CustomIo, Reports::Sensors, Reports::All];
    let repeats = (0..=255).map(|n| NonZeroU8::new(n).map_or(Repeat::Stop, Repeat::Times));
    let repeats: Vec<_> = repeats.chain([Repeat::Continuous; 16]).collect();
    prop_oneof![
        8 => motion().prop_map(Command::Move),
        1 => any::<u8>().prop_map(Command::GpioOutputs),
        2 => (select(scopes.concat()), any::<bool>())
            .prop_map(|(scope, run)| Command::Run { scope, run }),
        2 => (select(reports.to_vec()), select(repeats))
            .prop_map(|(reports, repeat)| Command::Telemetry { reports, repeat }),
        1 => select(vec![Command::PingOrAck, Command::Ping]),
        2 => request().prop_map(Command::Extension),
    ]
}

/// Every request of the extension that borrows nothing.
fn request() -> impl Strategy<Value = Request<'static>> {
    let repeats = (0..=255).map(|n| NonZeroU8::new(n).map_or(Repeat::Stop, Repeat::Times));
    let repeats: Vec<_> = repeats.chain([Repeat::Continuous; 16]).collect();
    prop_oneof![
        select(Action::ALL.to_vec()).prop_map(Request::Do),
        any::<u16>().prop_map(Request::Setting),
        select(vec![Request::Identity, Request::Counters, Request::Refusals, Request::Recording]),
        select(repeats.clone()).prop_map(Request::Health),
        select(repeats).prop_map(Request::State),
        any::<(u8, i32)>().prop_map(|(channel, count)| Request::SetCount { channel, count }),
        any::<u8>().prop_map(Request::Fault),
        setup().prop_map(Request::Record),
        any::<(u16, u16)>().prop_map(|(first, count)| Request::Blocks { first, count }),
    ]
}

/// Every recording that can be asked for.
fn setup() -> impl Strategy<Value = Setup> {
    let numbers = (1..64u8, 1..=u16::MAX, 1..=u16::MAX, any::<u16>());
    (numbers, select(Trigger::ALL.to_vec())).prop_map(
        |((channels, decimation, samples, before), trigger)| {
            let before = if trigger == Trigger::Now { 0 } else { before % samples };
            Setup { channels, trigger, decimation, samples, before }
        },
    )
}

/// Every answer of the extension.
pub fn answer() -> impl Strategy<Value = Answer<'static>> {
    let channel = proptest::option::of(0..6u8);
    let record = (select(Fault::ALL.to_vec()), channel, any::<u32>(), any::<[i16; 3]>()).prop_map(
        |(fault, channel, uptime_ms, values)| FaultRecord { fault, channel, uptime_ms, values },
    );
    let members = proptest::option::of(0..10u8);
    let names = select(vec!["", "a", "telemetry period", "full speed potentiometer"]);
    let setting = (
        1..=u16::MAX,
        any::<u16>(),
        any::<[i32; 4]>(),
        select(Unit::ALL.to_vec()),
        (names, members),
    )
        .prop_map(|(number, next, [value, low, high, default], unit, (name, member))| {
            Description {
                number,
                next: Some(next).filter(|&next| next != 0),
                value,
                range: (low, high),
                default,
                unit,
                name,
                member,
            }
        });
    let causes = select(ResetCause::ALL.to_vec());
    let identity = (any::<[u8; 4]>(), causes, select(Origin::ALL.to_vec())).prop_map(
        |([major, minor, patch, extension], reset, settings)| Identity {
            version: [major, minor, patch],
            extension,
            reset,
            settings,
        },
    );
    let health = (any::<[u32; 2]>(), any::<[u16; 2]>(), any::<u8>()).prop_map(
        |([uptime_ms, periods_missed], [worst_latency_us, stack_used], faults)| Health {
            uptime_ms,
            worst_latency_us,
            stack_used,
            faults,
            periods_missed,
        },
    );
    let latched = (any::<[u8; 2]>(), record).prop_map(|([place, total], record)| Latched {
        place,
        total,
        record: (place < total).then_some(record),
    });
    let outcome = (any::<[u8; 2]>(), select(Verdict::ALL.to_vec()), any::<u16>())
        .prop_map(|([did, first], verdict, setting)| Outcome { did, first, verdict, setting });
    let counters = any::<[u32; 4]>().prop_map(|[frames_ok, refused, acks_sent, links_lost]| {
        Counters { frames_ok, refused, acks_sent, links_lost, ..Counters::default() }
    });
    let refusals = any::<[u32; 2]>().prop_map(|[length, scale]| Refusals {
        length,
        scale,
        ..Refusals::default()
    });
    let (modes, reasons) = (select(Mode::ALL.to_vec()), select(Reason::ALL.to_vec()));
    let channel = (any::<[i32; 2]>(), any::<[i16; 2]>(), any::<[u8; 3]>(), modes, reasons)
        .prop_map(
            |([position, velocity], [set_point, duty], [low, high, detail], mode, reason)| {
                ChannelState {
                    position,
                    velocity,
                    set_point,
                    duty,
                    current: u16::from_le_bytes([low, high]),
                    mode,
                    reason,
                    detail,
                }
            },
        );
    let state = (any::<[u16; 4]>(), any::<u8>(), prop::array::uniform6(channel), any::<[u16; 6]>())
        .prop_map(|([time_ms, battery @ ..], flags, channels, servos)| MachineState {
            time_ms,
            flags,
            refused: flags,
            battery,
            channels,
            servos,
        });
    let recording = (any::<[u8; 2]>(), any::<[u16; 5]>(), any::<u32>());
    let codes = (select(Phase::ALL.to_vec()), select(Trigger::ALL.to_vec()));
    let recording = (recording, codes).prop_map(
        |(([serial, channels], numbers, triggered_ms), (phase, trigger))| {
            let [decimation, samples, taken, before, capacity] = numbers;
            Recording {
                serial,
                phase,
                channels,
                trigger,
                decimation,
                samples,
                taken,
                before,
                triggered_ms,
                capacity,
            }
        },
    );
    let row = (any::<[i32; 2]>(), any::<[i16; 2]>(), any::<u16>(), select(Mode::ALL.to_vec()))
        .prop_map(|([position, velocity], [set_point, duty], current, mode)| Row {
            position,
            velocity,
            set_point,
            duty,
            current,
            mode,
        });
    let block = (any::<(u8, u16)>(), prop::collection::vec(row, 0..=BLOCK))
        .prop_map(|((serial, number), rows)| Block::new(serial, number, rows));
    prop_oneof![
        recording.prop_map(Answer::Recording),
        block.prop_map(Answer::Block),
        state.prop_map(Answer::State),
        refusals.prop_map(Answer::Refusals),
        setting.prop_map(Answer::Setting),
        identity.prop_map(Answer::Identity),
        health.prop_map(Answer::Health),
        counters.prop_map(Answer::Counters),
        latched.prop_map(Answer::Fault),
        outcome.prop_map(Answer::Outcome),
    ]
}

pub fn parameter() -> impl Strategy<Value = Parameter> {
    let channel = || select(ALL.to_vec());
    let polarity = select(vec![Polarity::Positive, Polarity::Negative]);
    let sensors = [Sensor::SinglePotentiometer, Sensor::DualPotentiometer, Sensor::Encoder];
    let methods = [Method::Pwm, Method::Position, Method::Velocity];
    let control_loop = select(vec![Loop::Position, Loop::Velocity]);
    let gain = prop_oneof![
        any::<u16>().prop_map(Gain::Proportional),
        any::<u16>().prop_map(Gain::Derivative),
        any::<[u8; 2]>().prop_map(|[integer, fraction]| Gain::Integral { integer, fraction }),
    ];
    prop_oneof![
        (channel(), polarity).prop_map(|(c, p)| Parameter::Polarity(c, p)),
        (channel(), control_loop, gain).prop_map(|(c, l, g)| Parameter::Gain(c, l, g)),
        (channel(), select(sensors.to_vec())).prop_map(|(c, s)| Parameter::Sensor(c, s)),
        (channel(), select(methods.to_vec())).prop_map(|(c, m)| Parameter::Method(c, m)),
        any::<bool>().prop_map(Parameter::CollisionProtection),
    ]
}

/// Bytes and A/D values among which those that could make an end mark are frequent.
pub fn byte() -> impl Strategy<Value = u8> {
    prop_oneof![2 => any::<u8>(), 1 => Just(ETX[0]), 1 => Just(ETX[1])]
}

pub fn analogue() -> impl Strategy<Value = u16> {
    let end_like = vec![0x0D5E, 0x0D5F, 0x0D0D, 0x000D, 0x000C, 0x0E5E];
    prop_oneof![2 => 0u16..4096, 1 => select(end_like)]
}

pub fn encoder() -> impl Strategy<Value = Encoder> {
    let word = || (byte(), byte()).prop_map(|(low, high)| u16::from_le_bytes([low, high]) & 0x7FFF);
    (word(), word(), any::<bool>()).prop_map(|(count, speed, positive)| Encoder {
        count,
        speed,
        positive,
    })
}

pub fn report() -> impl Strategy<Value = Report> {
    let motors = (vec(analogue(), 12), encoder(), encoder()).prop_map(|(ad, first, second)| {
        Report::Motors(MotorReport {
            potentiometers: ad[..6].try_into().unwrap(),
            currents: ad[6..].try_into().unwrap(),
            encoders: [first, second],
        })
    });
    let custom_io = (vec(analogue(), 8), byte()).prop_map(|(ad, inputs)| {
        Report::CustomIo(CustomIoReport { custom_ad: ad.try_into().unwrap(), inputs })
    });
    let sensors = (vec(byte(), 10), vec(analogue(), 15)).prop_map(|(bytes, ad)| {
        Report::Sensors(SensorReport {
            sonar_cm: bytes[..6].try_into().unwrap(),
            human: ad[..4].try_into().unwrap(),
            tilt: ad[4..6].try_into().unwrap(),
            overheat: ad[6..8].try_into().unwrap(),
            temperature: ad[8],
            ir_range: ad[9],
            ir_command: bytes[6..].try_into().unwrap(),
            battery: ad[10..13].try_into().unwrap(),
            reference: ad[13..].try_into().unwrap(),
        })
    });
    prop_oneof![motors, custom_io, sensors]
}

/// DATA as Tables II.2 to II.4 have it, and which of its bytes may never be altered.
pub fn plain_data(report: &Report) -> (Vec<u8>, std::ops::Range<usize>) {
    let words = |words: &[&[u16]]| {
        words.concat().iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>()
    };
    match report {
        Report::Motors(m) => {
            let [a, b] = m.encoders;
            let encoders = [a.count, a.speed, b.count, b.speed];
            let directions = u8::from(a.positive) + 2 * u8::from(b.positive);
            let ad = words(&[&m.potentiometers, &m.currents, &encoders]);
            ([ad, vec![directions]].concat(), 32..33)
        }
        Report::CustomIo(c) => ([words(&[&c.custom_ad]), vec![c.inputs]].concat(), 16..17),
        Report::Sensors(s) => {
            let before = [&s.human[..], &s.tilt, &s.overheat, &[s.temperature, s.ir_range]];
            let after = words(&[&s.battery, &s.reference]);
            ([&s.sonar_cm[..], &words(&before), &s.ir_command, &after].concat(), 26..30)
        }
    }
}
