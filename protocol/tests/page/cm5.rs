//! The CM-5's packets.

use protocol::cm5::{
    Feedback, Goals, Hello, HelloAnswer, Limits, MAX_PACKET, MAX_SERVOS, Receiver, Report,
    ServoGoal, encode, params_of,
};
use protocol::dynamixel::Register;

use crate::text::{PAGE, bytes, table, words};

#[test]
fn the_packets_are_what_the_crate_makes_of_their_meaning() {
    let mut out = [0; MAX_PACKET];
    let goal = [
        (Register::TORQUE_ENABLE, 1),
        (Register::CW_MARGIN, 1),
        (Register::CCW_MARGIN, 1),
        (Register::CW_SLOPE, 32),
        (Register::CCW_SLOPE, 32),
        (Register::GOAL_POSITION, 512),
        (Register::MOVING_SPEED, 256),
        (Register::TORQUE_LIMIT, 1023),
        (Register::PUNCH, 32),
    ];
    let goal = goal.into_iter().fold(ServoGoal::default(), |goal, (r, value)| goal.with(r, value));
    let heard = Feedback([0, 2, 0, 0, 0, 0, 120, 30]);
    assert_eq!(heard.get(Register::PRESENT_POSITION), 512);
    let expected = [
        ("CM-5: hello, servos 1 and 2", Hello { ids: &[1, 2] }.encode(&mut out).unwrap().to_vec()),
        (
            "PC: answer, return delay 1, limits 0 and 1023 for all",
            HelloAnswer::encode(1, &[Limits::new(0, 1023).unwrap()], &mut out).unwrap().to_vec(),
        ),
        (
            "PC: goals of one servo: torque on, position 512, speed 256",
            Goals::encode(&[goal], &mut out).unwrap().to_vec(),
        ),
        (
            "CM-5: report of one servo: position 512, 12.0 V, 30 degrees",
            Report::encode([Some(heard)], &mut out).unwrap().to_vec(),
        ),
    ];
    let rows = table("Its packet", "packet");
    let told: Vec<_> = rows.iter().map(|row| (row[1], bytes(row[0]))).collect();
    assert_eq!(told, expected);
    for (meaning, packet) in &told {
        assert_eq!(Receiver::new().receive(&mut &**packet), Some(&**packet), "{meaning}");
    }
    let params = |place: usize| params_of(&told[place].1).unwrap();
    assert_eq!(Hello::parse(params(0)), Some(Hello { ids: &[1, 2] }));
    assert_eq!(HelloAnswer::parse(params(1), 2).unwrap().return_delay, 1);
    assert_eq!(Goals::parse(params(2), 1).unwrap().iter().collect::<Vec<_>>(), [goal]);
    assert!(Report::parse(params(3), 1).unwrap().iter().eq([Some(heard)]));
}

#[test]
fn the_fields_of_a_packet_stand_where_the_page_says() {
    let mut out = [0; MAX_PACKET];
    let packet = encode([[0x11, 0x22, 0x33]], &mut out).unwrap();
    let checksum = [!(3u8 + 0x11 + 0x22 + 0x33)];
    let place = |text: &str| match text.strip_prefix("Len + ") {
        Some(more) => 3 + more.parse::<usize>().unwrap(),
        None => text.parse().unwrap(),
    };
    let expected: [(&str, &[u8]); 4] = [
        ("start", &[0xFF, 0xFF]),
        ("Len", &[0, 3]),
        ("parameters", &[0x11, 0x22, 0x33]),
        ("checksum", &checksum),
    ];
    let rows = table("Its packet", "byte");
    assert_eq!(rows.len(), expected.len());
    for (row, (name, bytes)) in rows.iter().zip(expected) {
        let (first, last) = row[0].split_once(" to ").unwrap_or((row[0], row[0]));
        assert_eq!((row[1], &packet[place(first) - 1..place(last)]), (name, bytes));
    }
    assert!(PAGE.contains(&format!("Up to {MAX_SERVOS} servos take part.")));
}

/// Which bytes some registers are, one behind the other: bytes, name, address.
fn placed(registers: impl Iterator<Item = Register>) -> Vec<[String; 3]> {
    let mut next = 1;
    let row = |register: Register| {
        let (first, last) = (next, next + register.size - 1);
        next = last + 1;
        let bytes = if first == last { format!("{first}") } else { format!("{first} to {last}") };
        [bytes, words(&register.name.to_lowercase()), register.address.to_string()]
    };
    registers.map(row).collect()
}

#[test]
fn goals_and_reports_have_the_bytes_of_the_page() {
    let told = |title| -> Vec<_> {
        table(title, "bytes")
            .iter()
            .map(|row| [row[0], row[1], row[2]].map(str::to_owned))
            .collect()
    };
    assert_eq!(told("Goals of a servo"), placed(ServoGoal::REGISTERS.into_iter()));
    for (row, register) in table("Goals of a servo", "bytes").iter().zip(ServoGoal::REGISTERS) {
        assert_eq!(row[3], format!("{} to {}", register.min, register.max), "{}", register.name);
        // The place that the page tells is the one that is written.
        let first: usize = row[0].split(' ').next().unwrap().parse().unwrap();
        assert_eq!(ServoGoal::default().with(register, 1).0[first - 1], 1, "{}", register.name);
    }
    let read = Register::ALL.iter().copied().filter(|r| (36..=43).contains(&r.address));
    assert_eq!(told("Report of a servo"), placed(read));
}
