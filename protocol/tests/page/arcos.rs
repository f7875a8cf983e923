//! ARCOS, the Pioneer Arm and the extension there.

use protocol::arcos::extension::{encode_answer, encode_request, parse_request};
use protocol::arcos::{
    Argument, ArmCommand, ArmInfo, ArmStatus, Dialect, JointInfo, JointNumber, Joints, MotionBits,
    Names, Packet, Receiver, Refusal, SYNC, Standard, StatusRequest, command, encode_command,
};
use protocol::extension::{Action, Answer, Outcome, Request, Verdict};

use crate::fields::{fields, told};
use crate::text::{bytes, table};

const MANUAL: Dialect = Dialect::Manual(MotionBits::OneToSix);

#[test]
fn the_packets_are_what_the_crate_makes_of_their_meaning() {
    let mut out = [0; 200];
    let mut made = |write: &dyn Fn(&mut [u8]) -> usize| {
        let len = write(&mut out);
        out[..len].to_vec()
    };
    let joint_1 = JointNumber::new(1).unwrap();
    let names = Names { name: "Arm", class: "Pioneer", subclass: "p3dx" };
    let status =
        ArmStatus { powered: true, connected: true, positions: [127; 6], ..ArmStatus::default() };
    let saved = Answer::Outcome(Outcome::of_action(Action::Save, Verdict::Done));
    let arm = |command: ArmCommand| move |out: &mut [u8]| command.encode(out).unwrap().len();
    let expected = [
        (
            "host: SYNC0, or PULSE; the arm's echo of it",
            made(&|out| SYNC[0].encode(out).unwrap().len()),
        ),
        (
            "host: SYNC1, or OPEN; the arm's echo of it",
            made(&|out| SYNC[1].encode(out).unwrap().len()),
        ),
        ("host: SYNC2, or CLOSE", made(&|out| SYNC[2].encode(out).unwrap().len())),
        (
            "arm: the answer to SYNC2, names Arm, Pioneer, p3dx",
            made(&|out| names.encode(out).unwrap().len()),
        ),
        (
            "host: OPEN with the integer 1",
            made(&|out| {
                encode_command(command::OPEN, Some(Argument::Positive(1)), out).unwrap().len()
            }),
        ),
        ("host: POWER on", made(&arm(ArmCommand::Power(true)))),
        (
            "host: POS, joint 1 to 27",
            made(&arm(ArmCommand::Position { joint: joint_1, ticks: 27 })),
        ),
        ("host: STOP, all joints", made(&arm(ArmCommand::Stop(Joints::All)))),
        (
            "arm: ARMpac, dialect manual: power, connected, at rest, all joints at 127",
            made(&|out| status.encode(MANUAL, out).unwrap().len()),
        ),
        (
            "host: read setting 32",
            made(&|out| encode_request(&Request::Setting(32), out).unwrap().len()),
        ),
        (
            "host: save the settings",
            made(&|out| encode_request(&Request::Do(Action::Save), out).unwrap().len()),
        ),
        ("arm: saved", made(&|out| encode_answer(&saved, out).unwrap().len())),
    ];
    let rows = table("The packet", "packet");
    let told: Vec<_> = rows.iter().map(|row| (row[1], bytes(row[0]))).collect();
    assert_eq!(told, expected);
    for (meaning, packet) in told {
        assert_eq!(Receiver::new().receive(&mut &*packet), Some(&*packet), "{meaning}");
    }
}

#[test]
fn the_fields_of_a_packet_stand_where_the_page_says() {
    let packet = Packet { id: 0xA1, data: &[0x11, 0x22, 0x33] };
    let packet = packet.encode(&mut [0; 200]).unwrap().to_vec();
    let count = usize::from(packet[2]);
    let place = |text: &str| match text.split_once("count + ") {
        Some((_, more)) => count + more.parse::<usize>().unwrap(),
        None => text.parse().unwrap(),
    };
    let sum = packet[7..].to_vec();
    let expected: [(&str, &[u8]); 5] = [
        ("start", &[0xFA, 0xFB]),
        ("count", &[6]),
        ("id", &[0xA1]),
        ("data", &[0x11, 0x22, 0x33]),
        ("checksum", &sum),
    ];
    let rows = table("The packet", "byte");
    assert_eq!(rows.len(), expected.len());
    for (row, (name, bytes)) in rows.iter().zip(expected) {
        let (first, last) = row[0].split_once(" to ").unwrap_or((row[0], row[0]));
        assert_eq!((row[1], &packet[place(first) - 1..place(last)]), (name, bytes));
    }
}

#[test]
fn the_types_of_arguments_are_those_of_the_page() {
    let rows = table("The packet", "type");
    let kinds: Vec<_> = rows.iter().map(|row| u8::from_str_radix(row[0], 16).unwrap()).collect();
    let [positive, negative, text] = *kinds else { panic!("three types") };
    assert_eq!(Argument::parse(&[positive, 1, 2]), Ok(Some(Argument::Positive(0x0201))));
    assert_eq!(Argument::parse(&[negative, 1, 2]), Ok(Some(Argument::Negative(0x0201))));
    assert_eq!(Argument::parse(&[text, 2, 3, 4]), Ok(Some(Argument::Text(&[3, 4]))));
    let known: Vec<_> = (0..=255).filter(|kind| Argument::parse(&[*kind]).is_ok()).collect();
    let mut listed = kinds.clone();
    listed.sort_unstable();
    assert_eq!(listed, known);
}

#[test]
fn the_commands_of_the_arm_are_all_there_and_mean_what_the_page_says() {
    let joint = |number| JointNumber::new(number).unwrap();
    let expected = [
        ("INFO", ArmCommand::Info),
        ("STATUS", ArmCommand::Status(StatusRequest::Stream)),
        ("INIT", ArmCommand::Init),
        ("CHECK", ArmCommand::Check),
        ("POWER", ArmCommand::Power(true)),
        ("HOME", ArmCommand::Home(Joints::All)),
        ("PARK", ArmCommand::Park),
        ("POS", ArmCommand::Position { joint: joint(1), ticks: 27 }),
        ("SPEED", ArmCommand::Speed { joint: joint(3), ms_per_tick: 20 }),
        ("STOP", ArmCommand::Stop(Joints::All)),
        ("AUTOPARK", ArmCommand::AutoPark(600)),
        ("GRIPPARK", ArmCommand::GripPark(300)),
    ];
    let rows = table("Commands of the arm", "number");
    let number = |row: &Vec<&str>| row[0].parse::<u8>().unwrap();
    for (row, (name, command)) in rows.iter().zip(expected) {
        let data = bytes(row[3]);
        assert_eq!((row[1], ArmCommand::parse(number(row), &data)), (name, Ok(command)));
        let packet = command.encode(&mut [0; 9]).unwrap().to_vec();
        assert_eq!(Packet::parse(&packet), Some(Packet { id: number(row), data: &data }), "{name}");
        assert_eq!(row[2] == "none", data.is_empty(), "{name}");
    }
    let is_the_arms =
        |number: &u8| !matches!(ArmCommand::parse(*number, &[]), Err(Refusal::NotForTheArm(_)));
    let known: Vec<_> = (0..=255).filter(is_the_arms).collect();
    assert_eq!(rows.iter().map(number).collect::<Vec<_>>(), known);
}

/// Data of a packet that the crate has written.
fn data(id: u8, packet: &[u8]) -> Vec<u8> {
    let packet = Packet::parse(packet).unwrap();
    assert_eq!(packet.id, id);
    packet.data.to_vec()
}

#[test]
fn the_bytes_of_the_standard_packet_stand_where_the_page_says() {
    let mut expected = fields!(
        Standard::default(),
        |standard: &Standard| data(50, standard.encode(&mut [0; 40]).unwrap()),
        "x" = (x),
        "y" = (y),
        "heading" = (heading),
        "velocities" = (velocities),
        "battery dv" = (battery_dv),
        "stall" = (stall),
        "control" = (control),
        "flags" = (flags),
        "compass" = (compass),
    );
    expected.push(("19".into(), "sonar".into(), "u8".into()));
    assert_eq!(told("The standard packet"), expected);
    let whole = data(50, Standard::default().encode(&mut [0; 40]).unwrap());
    assert_eq!(whole, [0; 19], "no sonar readings");
}

/// The status of an arm of which only this is true.
fn status(what: &str) -> ArmStatus {
    let mut status = ArmStatus::default();
    match what {
        "power" => status.powered = true,
        "connected" => status.connected = true,
        "good" => status.good = true,
        "initialised" => status.initialised = true,
        "homing" => status.homing = true,
        other => panic!("{other}"),
    }
    status
}

#[test]
fn armpac_is_as_the_page_says_in_every_dialect() {
    let dialects = [MANUAL, Dialect::Manual(MotionBits::ZeroToFive), Dialect::Aria];
    let encoded =
        |status: ArmStatus, dialect| data(160, status.encode(dialect, &mut [0; 14]).unwrap());
    let rows = table("ARMpac", "bytes");
    assert_eq!(rows.iter().map(|row| row[0]).collect::<Vec<_>>(), ["1", "2", "3 to 8"]);
    for (byte, row) in rows[..2].iter().enumerate() {
        for (dialect, cell) in dialects.into_iter().zip(&row[2..]) {
            let cell = if *cell == "the same" { row[2] } else { cell };
            if let Some((_, bits)) = cell.split_once("bits ") {
                let first: u8 = bits.split(' ').next().unwrap().parse().unwrap();
                for joint in 0..6 {
                    let mut status = ArmStatus::default();
                    status.moving[joint] = true;
                    let told = encoded(status, dialect)[byte];
                    assert_eq!(told, 1 << (usize::from(first) + joint), "{cell}, joint {joint}");
                }
                continue;
            }
            for part in cell.split(", ") {
                let (bit, name) = part.strip_prefix("bit ").unwrap().split_once(' ').unwrap();
                let told = encoded(status(name), dialect)[byte];
                assert_eq!(told, 1 << bit.parse::<u8>().unwrap(), "{cell}");
            }
        }
    }
    let positions = [1, 2, 3, 4, 5, 6];
    let status = ArmStatus { positions, ..ArmStatus::default() };
    assert_eq!(encoded(status, MANUAL)[2..], positions);
}

#[test]
fn the_bytes_of_a_joint_stand_where_the_page_says() {
    let encode = |joint: &JointInfo| {
        let mut joints = [JointInfo::default(); 6];
        joints[0] = *joint;
        let info = ArmInfo::Arm { version: "1", joints };
        let whole = data(161, info.encode(&mut [0; 60]).unwrap());
        assert_eq!((&whole[..3], whole.len()), (&[b'1', 0, 6][..], 3 + 36));
        whole[3..9].to_vec()
    };
    let joint = fields!(
        JointInfo::default(),
        encode,
        "ms per tick" = (ms_per_tick),
        "home" = (home),
        "min" = (min),
        "centre" = (centre),
        "max" = (max),
        "ticks per 90" = (ticks_per_90),
    );
    assert_eq!(told("ARMINFOpac"), joint);
    let no_arm = data(161, ArmInfo::NoArm.encode(&mut [0; 60]).unwrap());
    assert_eq!(no_arm, *b"No arm\0\0");
}

#[test]
fn the_commands_that_carry_the_extension_are_those_of_the_page() {
    let rows = table("The extension in ARCOS", "command");
    let listed: Vec<u8> = rows.iter().map(|row| row[0].parse().unwrap()).collect();
    let carries = |id: &u8| parse_request(&Packet { id: *id, data: &[] }).is_some();
    assert_eq!(listed, (0..=255).filter(carries).collect::<Vec<_>>());
    for (row, number) in rows.iter().zip(listed) {
        let did = if number == 101 { 7 } else { number };
        assert!(row[1].starts_with(&format!("DATA of DID {did}")), "{}", row[1]);
    }
}
