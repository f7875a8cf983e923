//! ARCOS packets byte by byte, and properties of their receiver and codecs.
//!
//! Packets stand here as the facts and the manual's tables give them, so that encoder and receiver
//! are each held to the documents and not to each other.

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;
use protocol::arcos::{
    Argument, ArmCommand, ArmInfo, ArmStatus, BadArgument, Dialect, EncodeError, JOINTS, JointInfo,
    JointNumber, Joints, MAX_RECEIVED, MotionBits, Names, Packet, Receiver, Refusal, SYNC,
    Standard, StatusRequest, encode_command,
};

const MANUAL: Dialect = Dialect::Manual(MotionBits::OneToSix);
const MANUAL_B0: Dialect = Dialect::Manual(MotionBits::ZeroToFive);

/// The checksum as the facts describe it, a byte at a time.
fn checksum(counted: &[u8]) -> [u8; 2] {
    let mut sum = 0u32;
    let mut i = 0;
    while i + 1 < counted.len() {
        sum = (sum + 256 * u32::from(counted[i]) + u32::from(counted[i + 1])) % 65_536;
        i += 2;
    }
    if i < counted.len() {
        sum ^= u32::from(counted[i]);
    }
    [(sum / 256) as u8, (sum % 256) as u8]
}

/// A packet with this id and data, whatever its length.
fn packet(id: u8, data: &[u8]) -> Vec<u8> {
    let counted = [&[id], data].concat();
    [&[0xFA, 0xFB, counted.len() as u8 + 2], &counted[..], &checksum(&counted)].concat()
}

/// The packets that a receiver finds in these pieces; at the end the line falls silent.
fn hear<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> (Vec<Vec<u8>>, Receiver) {
    let mut receiver = Receiver::new();
    let mut packets = Vec::new();
    for mut piece in pieces {
        while let Some(packet) = receiver.receive(&mut piece) {
            packets.push(packet.to_vec());
        }
    }
    while let Some(packet) = receiver.give_up() {
        packets.push(packet.to_vec());
    }
    (packets, receiver)
}

fn parsed(bytes: &[u8]) -> Packet<'_> {
    Packet::parse(bytes).expect("long enough for a packet")
}

#[test]
fn the_vectors_of_the_facts() {
    let enable = [0xFA, 0xFB, 0x06, 0x04, 0x3B, 0x01, 0x00, 0x05, 0x3B];
    let mut out = [0; 200];
    assert_eq!(encode_command(4, Some(Argument::Positive(1)), &mut out).unwrap(), enable);
    let pos = [0xFA, 0xFB, 0x06, 0x4D, 0x3B, 0x1B, 0x01, 0x68, 0x3C];
    let command = ArmCommand::Position { joint: JointNumber::new(1).unwrap(), ticks: 0x1B };
    assert_eq!(command.encode(&mut out).unwrap(), pos);
    let (packets, _) = hear([&[enable, pos].concat()[..]]);
    assert_eq!(packets, [enable, pos]);
    let Packet { id, data } = parsed(&pos);
    assert_eq!(ArmCommand::parse(id, data), Ok(command));
}

#[test]
fn the_three_types_of_argument() {
    let mut out = [0; 200];
    let mut encode = |argument| encode_command(9, Some(argument), &mut out).unwrap().to_vec();
    assert_eq!(encode(Argument::Positive(0x1234)), packet(9, &[0x3B, 0x34, 0x12]));
    assert_eq!(encode(Argument::Negative(300)), packet(9, &[0x1B, 0x2C, 0x01]));
    assert_eq!(encode(Argument::Text(b"abc")), packet(9, &[0x2B, 3, b'a', b'b', b'c']));
    assert_eq!(encode_command(9, None, &mut out).unwrap(), packet(9, &[]));
    assert_eq!(
        encode_command(9, Some(Argument::Text(&[0; 193])), &mut out),
        Err(EncodeError::TooLong)
    );
    // A type with nothing behind it is no argument; a value cut short, or too long, is a bad one.
    for kind in [0x3B, 0x1B, 0x2B] {
        assert_eq!(Argument::parse(&[kind]), Ok(None));
    }
    for bad in [
        &[0x3B, 1][..],
        &[0x3B, 1, 0, 0],
        &[0x1B, 1],
        &[0x2B, 2, 0],
        &[0x2B, 1, 0, 0],
        &[0x00],
        &[0x3C, 1, 0],
    ] {
        assert_eq!(Argument::parse(bad), Err(BadArgument), "{bad:02x?}");
    }
}

fn joint(number: u8) -> JointNumber {
    JointNumber::new(number).unwrap()
}

#[test]
fn the_twelve_commands_byte_by_byte() {
    let table: [(ArmCommand, u8, &[u8]); 20] = [
        (ArmCommand::Info, 70, &[]),
        (ArmCommand::Status(StatusRequest::Stop), 71, &[0x3B, 0, 0]),
        (ArmCommand::Status(StatusRequest::Once), 71, &[0x3B, 1, 0]),
        (ArmCommand::Status(StatusRequest::Stream), 71, &[0x3B, 2, 0]),
        (ArmCommand::Init, 72, &[]),
        (ArmCommand::Check, 73, &[]),
        (ArmCommand::Power(false), 74, &[0x3B, 0, 0]),
        (ArmCommand::Power(true), 74, &[0x3B, 1, 0]),
        (ArmCommand::Home(Joints::One(joint(1))), 75, &[0x3B, 1, 0]),
        (ArmCommand::Home(Joints::One(joint(6))), 75, &[0x3B, 6, 0]),
        (ArmCommand::Home(Joints::All), 75, &[0x3B, 255, 0]),
        (ArmCommand::Park, 76, &[]),
        (ArmCommand::Position { joint: joint(3), ticks: 200 }, 77, &[0x3B, 200, 3]),
        (ArmCommand::Position { joint: joint(6), ticks: 0 }, 77, &[0x3B, 0, 6]),
        (ArmCommand::Speed { joint: joint(2), ms_per_tick: 40 }, 78, &[0x3B, 40, 2]),
        (ArmCommand::Stop(Joints::One(joint(4))), 79, &[0x3B, 4, 0]),
        (ArmCommand::Stop(Joints::All), 79, &[0x3B, 255, 0]),
        (ArmCommand::AutoPark(600), 80, &[0x3B, 0x58, 0x02]),
        (ArmCommand::GripPark(300), 81, &[0x3B, 0x2C, 0x01]),
        (ArmCommand::GripPark(0), 81, &[0x3B, 0, 0]),
    ];
    for (command, number, data) in table {
        assert_eq!(command.encode(&mut [0; 9]).unwrap(), packet(number, data), "{command:?}");
        assert_eq!(ArmCommand::parse(number, data), Ok(command));
    }
    // As hosts send it besides: all joints as 7; types with no value.
    assert_eq!(ArmCommand::parse(75, &[0x3B, 7, 0]), Ok(ArmCommand::Home(Joints::All)));
    assert_eq!(ArmCommand::parse(70, &[0x3B]), Ok(ArmCommand::Info));
}

#[test]
fn what_a_command_may_not_say_is_named() {
    use Refusal::{MissingArgument, NoSuchJoint, NotForTheArm, Value, WrongArgument};
    let int = |low, high| [0x3B, low, high];
    for (number, data, refusal) in [
        (69, &[][..], NotForTheArm(69)),
        (82, &[], NotForTheArm(82)),
        (71, &[], MissingArgument(71)),
        (71, &[0x3B], MissingArgument(71)),
        (71, &int(3, 0), Value { number: 71, value: 3 }),
        (74, &int(2, 0), Value { number: 74, value: 2 }),
        (74, &int(1, 1), Value { number: 74, value: 257 }),
        (74, &[0x1B, 1, 0], WrongArgument(74)),
        (74, &[0x2B, 1, 1], WrongArgument(74)),
        (75, &int(0, 0), NoSuchJoint(0)),
        (77, &int(100, 0), NoSuchJoint(0)),
        (77, &int(100, 7), NoSuchJoint(7)),
        (77, &[0x3B, 100], WrongArgument(77)),
        (78, &int(20, 0), NoSuchJoint(0)),
        (78, &int(20, 255), NoSuchJoint(255)),
        (79, &int(0, 0), NoSuchJoint(0)),
        (79, &int(7, 0), NoSuchJoint(7)),
        (79, &int(1, 1), NoSuchJoint(257)),
        (80, &[], MissingArgument(80)),
        (81, &[0x1B, 1, 0], WrongArgument(81)),
    ] {
        assert_eq!(ArmCommand::parse(number, data), Err(refusal), "{number} {data:02x?}");
    }
}

#[test]
fn the_packets_of_the_session() {
    let mut out = [0; 200];
    let syncs = [[0xFA, 0xFB, 3, 0, 0, 0], [0xFA, 0xFB, 3, 1, 0, 1], [0xFA, 0xFB, 3, 2, 0, 2]];
    for (sync, bytes) in SYNC.iter().zip(syncs) {
        assert_eq!(sync.encode(&mut out).unwrap(), bytes);
    }
    let names = Names { name: "me", class: "Pioneer", subclass: "p3dx" };
    let bytes = packet(2, b"me\0Pioneer\0p3dx\0");
    assert_eq!(names.encode(&mut out).unwrap(), bytes);
    assert_eq!(Names::parse(&parsed(&bytes)), Some(names));
    let nul = Names { name: "m\0e", ..names };
    assert_eq!(nul.encode(&mut out), Err(EncodeError::NulInText));

    let standard = Standard {
        x: 0x0102,
        y: 0x0304,
        heading: -2,
        velocities: [-3, 4],
        battery_dv: 120,
        stall: 0x0506,
        control: -5,
        flags: 0x0708,
        compass: 90,
    };
    let bytes = packet(
        0x32,
        &[2, 1, 4, 3, 0xFE, 0xFF, 0xFD, 0xFF, 4, 0, 120, 6, 5, 0xFB, 0xFF, 8, 7, 90, 0],
    );
    assert_eq!(standard.encode(&mut out).unwrap(), bytes);
    assert_eq!(Standard::parse(&parsed(&bytes)), Some(standard));
}

#[test]
fn armpac_field_by_field_in_every_dialect() {
    let status = ArmStatus {
        powered: true,
        connected: true,
        good: true,
        initialised: true,
        homing: false,
        moving: [true, false, false, false, false, true],
        positions: [1, 2, 3, 4, 5, 255],
    };
    // Power, connected; joints 1 and 6 in bits 1 and 6, or 0 and 5; good, initialised, power.
    for (dialect, first, second) in [
        (MANUAL, 0b11, 0b100_0010),
        (MANUAL_B0, 0b11, 0b10_0001),
        (Dialect::Aria, 0b100_0010, 0b0111),
    ] {
        let mut out = [0; 14];
        let bytes = status.encode(dialect, &mut out).unwrap();
        assert_eq!(bytes[..4], [0xFA, 0xFB, 11, 160], "count and id of Table 4");
        assert_eq!(bytes, packet(160, &[first, second, 1, 2, 3, 4, 5, 255]), "{dialect:?}");
    }
    // Each bit by itself.
    let none = ArmStatus::default();
    let status_bytes = |status: ArmStatus, dialect| {
        let bytes = status.encode(dialect, &mut [0; 14]).unwrap().to_vec();
        [bytes[4], bytes[5]]
    };
    for (status, manual, aria) in [
        (none, [0, 0], [0, 0]),
        (ArmStatus { powered: true, ..none }, [1, 0], [0, 4]),
        (ArmStatus { connected: true, ..none }, [2, 0], [0, 0]),
        (ArmStatus { good: true, ..none }, [0, 0], [0, 1]),
        (ArmStatus { initialised: true, ..none }, [0, 0], [0, 2]),
        (ArmStatus { homing: true, ..none }, [0, 0], [0, 8]),
    ] {
        assert_eq!(status_bytes(status, MANUAL), manual, "{status:?}");
        assert_eq!(status_bytes(status, Dialect::Aria), aria, "{status:?}");
    }
    for i in 0..JOINTS {
        let mut status = none;
        status.moving[i] = true;
        assert_eq!(status_bytes(status, MANUAL), [0, 2 << i]);
        assert_eq!(status_bytes(status, MANUAL_B0), [0, 1 << i]);
        assert_eq!(status_bytes(status, Dialect::Aria), [2 << i, 0]);
    }
}

#[test]
fn arminfopac_field_by_field_with_the_count_that_its_bytes_have() {
    let joints = core::array::from_fn(|i| {
        let k = 6 * i as u8;
        JointInfo {
            ms_per_tick: k + 1,
            home: k + 2,
            min: k + 3,
            centre: k + 4,
            max: k + 5,
            ticks_per_90: k + 6,
        }
    });
    let info = ArmInfo::Arm { version: "V1.2", joints };
    let mut out = [0; 200];
    let bytes = info.encode(&mut out).unwrap().to_vec();
    let data: Vec<u8> = b"V1.2\0\x06".iter().copied().chain(1..=36).collect();
    assert_eq!(bytes, packet(161, &data));
    // The version's NUL is byte n = 6 of Table 3's numbering; the count is n+39, not n+53.
    assert_eq!((bytes[2 + 6], usize::from(bytes[2])), (0, 6 + 39));
    assert_eq!(bytes.len(), 3 + 6 + 39);
    assert_eq!(ArmInfo::parse(&parsed(&bytes)), Some(info));

    let bytes = ArmInfo::NoArm.encode(&mut out).unwrap().to_vec();
    assert_eq!(bytes, packet(161, b"No arm\0\0"));
    assert_eq!(ArmInfo::parse(&parsed(&bytes)), Some(ArmInfo::NoArm));
}

#[test]
fn counts_outside_their_bounds_do_not_cost_the_packet_behind_them() {
    let good = packet(70, &[]);
    for (count, found) in [(0, 1), (1, 1), (2, 1), (250, 1), (255, 1)] {
        let stream = [&[0xFA, 0xFB, count], &good[..]].concat();
        let mut receiver = Receiver::new();
        let mut bytes = &stream[..];
        assert_eq!(receiver.receive(&mut bytes), Some(&good[..]), "count {count}");
        assert_eq!(receiver.reception().frames_ok, found);
    }
    let longest = packet(1, &[7; 246]);
    assert_eq!((longest[2], longest.len()), (249, MAX_RECEIVED));
    assert_eq!(hear([&longest[..]]).0, [longest]);
}

fn joints() -> impl Strategy<Value = Joints> {
    prop_oneof![Just(Joints::All), select(JointNumber::ALL.to_vec()).prop_map(Joints::One)]
}

fn command() -> impl Strategy<Value = ArmCommand> {
    let one = || select(JointNumber::ALL.to_vec());
    let requests = vec![StatusRequest::Stop, StatusRequest::Once, StatusRequest::Stream];
    prop_oneof![
        select(vec![ArmCommand::Info, ArmCommand::Init, ArmCommand::Check, ArmCommand::Park]),
        select(requests).prop_map(ArmCommand::Status),
        any::<bool>().prop_map(ArmCommand::Power),
        joints().prop_map(ArmCommand::Home),
        joints().prop_map(ArmCommand::Stop),
        (one(), any::<u8>()).prop_map(|(joint, ticks)| ArmCommand::Position { joint, ticks }),
        (one(), any::<u8>())
            .prop_map(|(joint, ms_per_tick)| ArmCommand::Speed { joint, ms_per_tick }),
        any::<u16>().prop_map(ArmCommand::AutoPark),
        any::<u16>().prop_map(ArmCommand::GripPark),
    ]
}

/// Bytes among which those that begin a packet are frequent.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    vec(prop_oneof![2 => Just(0xFA), 2 => Just(0xFB), 2 => 0u8..8, 1 => any::<u8>()], 0..60)
}

fn encoded(command: ArmCommand) -> Vec<u8> {
    command.encode(&mut [0; 9]).unwrap().to_vec()
}

/// The packets of a whole stream, found by trying every place in it in turn.
fn scan(stream: &[u8]) -> Vec<Vec<u8>> {
    let mut packets = Vec::new();
    let mut at = 0;
    while at < stream.len() {
        match &stream[at..] {
            [0xFA, 0xFB, count @ 3..=249, rest @ ..]
                if rest.get(..usize::from(*count)).is_some_and(|counted| {
                    let (counted, sum) = counted.split_at(counted.len() - 2);
                    checksum(counted) == sum
                }) =>
            {
                let end = at + 3 + usize::from(*count);
                packets.push(stream[at..end].to_vec());
                at = end;
            }
            _ => at += 1,
        }
    }
    packets
}

proptest! {
    #[test]
    fn commands_read_back(command in command()) {
        let mut out = [0; 9];
        let bytes = command.encode(&mut out).unwrap();
        let (packets, _) = hear([&*bytes]);
        prop_assert_eq!(&packets, &[bytes.to_vec()]);
        let Packet { id, data } = parsed(&packets[0]);
        prop_assert_eq!(ArmCommand::parse(id, data), Ok(command));
    }

    #[test]
    fn arguments_read_back(number: u8, value: u16, text in vec(any::<u8>(), 0..=192)) {
        for argument in
            [Argument::Positive(value), Argument::Negative(value), Argument::Text(&text)]
        {
            let mut out = [0; 200];
            let bytes = encode_command(number, Some(argument), &mut out).unwrap().to_vec();
            let (packets, _) = hear([&bytes[..]]);
            prop_assert_eq!(&packets, &[bytes]);
            let Packet { id, data } = parsed(&packets[0]);
            prop_assert_eq!((id, Argument::parse(data)), (number, Ok(Some(argument))));
        }
    }

    #[test]
    fn reports_read_back(
        bits: [bool; 4],
        moving: [bool; 6],
        positions: [u8; 6],
        rows: [[u8; 6]; 6],
        version in "[ -~]{0,60}",
        words: [u16; 6],
    ) {
        let mut out = [0; 200];
        let [powered, connected, initialised, homing] = bits;
        // Neither dialect has a place for both.
        let good = connected;
        let status = ArmStatus { powered, connected, good, initialised, homing, moving, positions };
        let bytes = status.encode(Dialect::Aria, &mut out).unwrap();
        prop_assert_eq!(ArmStatus::parse(&parsed(bytes), Dialect::Aria), Some(status));
        // The manual's dialect has no place for two of them.
        let status = ArmStatus { initialised: false, homing: false, ..status };
        for dialect in [MANUAL, MANUAL_B0] {
            let bytes = status.encode(dialect, &mut out).unwrap();
            prop_assert_eq!(ArmStatus::parse(&parsed(bytes), dialect), Some(status));
        }

        let joints = rows.map(|[ms_per_tick, home, min, centre, max, ticks_per_90]| {
            JointInfo { ms_per_tick, home, min, centre, max, ticks_per_90 }
        });
        let info = ArmInfo::Arm { version: &version, joints };
        let bytes = info.encode(&mut out).unwrap();
        prop_assert_eq!(ArmInfo::parse(&parsed(bytes)), Some(info));

        let names = Names { name: &version, class: "a", subclass: "" };
        let bytes = names.encode(&mut out).unwrap();
        prop_assert_eq!(Names::parse(&parsed(bytes)), Some(names));

        let [x, y, heading, velocity, stall, flags] = words;
        let standard = Standard {
            x,
            y,
            heading: heading as i16,
            velocities: [velocity as i16, -(velocity as i16 / 2)],
            battery_dv: positions[0],
            stall,
            control: heading as i16,
            flags,
            compass: positions[1],
        };
        let bytes = standard.encode(&mut out).unwrap();
        prop_assert_eq!(Standard::parse(&parsed(bytes)), Some(standard));
    }

    #[test]
    fn any_bytes_in_any_chunks_are_accounted_for_and_cost_no_good_packet(
        pieces in vec(prop_oneof![noise(), command().prop_map(encoded)], 0..8),
        cut in 1usize..20,
    ) {
        let stream = pieces.concat();
        let (found, receiver) = hear(stream.chunks(cut));
        prop_assert_eq!(&found, &scan(&stream));
        let in_packets: usize = found.iter().map(Vec::len).sum();
        let skipped = receiver.reception().bytes_skipped as usize;
        prop_assert_eq!((receiver.pending(), in_packets + skipped), (0, stream.len()));
    }

    #[test]
    fn a_damaged_byte_is_noticed(command in command(), at in 0usize..9, flip in 1u8..=255) {
        let mut bytes = encoded(command);
        let at = at % bytes.len();
        bytes[at] ^= flip;
        prop_assert!(hear([&bytes[..]]).0.is_empty());
    }
}
