//! Frame, checksum, the ten frames.

use protocol::extension::{Answer, Outcome, Request, Verdict};
use protocol::pms5005::{
    ACK, Addressing, Command, Data, ETX, Frame, MAX_DATA, MAX_FRAME, Move, OVERHEAD, PING,
    Quantity, Receiver, Repeat, Reports, STX, Scope, encode_answer,
};

use crate::commands::motion;
use crate::text::{PAGE, bytes, table};

/// A host's frame.
pub fn sent(command: Command<'_>) -> Vec<u8> {
    command.encode(0, &mut [0; MAX_FRAME]).expect("it can be written").to_vec()
}

#[test]
fn the_ten_frames_are_what_the_crate_makes_of_their_meaning() {
    let mut set = Data::new();
    protocol::extension::Assignments::emit(32, 20, &mut set).unwrap();
    let set = protocol::extension::Assignments::parse(&set).unwrap();
    let outcome = Outcome { did: 7, first: 0x80, verdict: Verdict::Done, setting: 0 };
    let done = encode_answer(&Answer::Outcome(outcome), &mut [0; MAX_FRAME]).unwrap().to_vec();
    let in_2_s =
        Move { periods: 2000, ..motion(Quantity::Position, Addressing::List, &[(0, 6000)]) };
    let list = |quantity, channel, target| {
        sent(Command::Move(motion(quantity, Addressing::List, &[(channel, target)])))
    };
    let three = Repeat::Times(3.try_into().unwrap());
    let expected = [
        ("host: ping", sent(Command::PingOrAck)),
        ("board: acknowledgement", ACK.to_vec()),
        ("host: motor 1 at 4000 counts/s", list(Quantity::Velocity, 0, 4000)),
        ("host: stop motor 1, by velocity 0", list(Quantity::Velocity, 0, 0)),
        ("host: motor 1 to position 6000 in 2000 ms", sent(Command::Move(in_2_s))),
        ("host: servo 3 to 2048", list(Quantity::Servo, 2, 2048)),
        (
            "host: suspend all motors and servos",
            sent(Command::Run { scope: Scope::All, run: false }),
        ),
        (
            "host: motor control signals, 3 times",
            sent(Command::Telemetry { reports: Reports::Motors, repeat: three }),
        ),
        ("host: set setting 32 to 20", sent(Command::Extension(Request::Set(set)))),
        ("board: setting a setting is done", done),
    ];
    let rows = table("Ten frames", "frame");
    let told: Vec<_> = rows.iter().map(|row| (row[1], bytes(row[0]))).collect();
    assert_eq!(told, expected);
    // And back: each is found, and says what it was made of.
    for (meaning, frame) in told {
        let mut receiver = Receiver::new();
        let Frame { rid, did, data, .. } =
            Frame::parse(receiver.receive(&mut &*frame).expect(meaning)).unwrap();
        if meaning.starts_with("host") {
            assert_eq!((rid, sent(Command::parse(did, data).unwrap())), (1, frame.clone()));
        } else {
            assert_eq!(rid, 0, "{meaning}");
        }
    }
    assert_eq!(Answer::parse(101, &[7, 0x80, 0, 0, 0]), Some(Answer::Outcome(outcome)));
}

#[test]
fn every_frame_in_the_text_is_intact() {
    let shown = PAGE.split("`5E 02 ").skip(1).map(|rest| rest.split('`').next().unwrap());
    let mut frames = 0;
    for shown in shown.filter(|shown| shown.len() > 2) {
        let frame = bytes(&format!("`5E 02 {shown}`"));
        assert_eq!(Receiver::new().receive(&mut &*frame), Some(&*frame), "{shown}");
        frames += 1;
    }
    assert_eq!(frames, 11, "the ten, and the board's ping");
    let ping = PING.encode(&mut [0; 10]).unwrap().to_vec();
    let hex: Vec<_> = ping.iter().map(|byte| format!("{byte:02X}")).collect();
    assert!(PAGE.contains(&format!("`{}`", hex.join(" "))));
}

#[test]
fn the_fields_of_a_frame_stand_where_the_page_says() {
    let data = [0x11, 0x22, 0x33];
    let frame = Frame { rid: 0xA1, res: 0xA2, did: 0xA3, data: &data };
    let frame = frame.encode(&mut [0; MAX_FRAME]).unwrap().to_vec();
    let len = data.len();
    let crc = [frame[len + 6]];
    let rows = table("The frame", "byte");
    let expected: [(&str, &[u8]); 8] = [
        ("start", &STX),
        ("RID", &[0xA1]),
        ("RES", &[0xA2]),
        ("DID", &[0xA3]),
        ("LEN", &[3]),
        ("DATA", &data),
        ("checksum", &crc),
        ("end", &ETX),
    ];
    let place = |text: &str| match text.strip_prefix("LEN + ") {
        Some(more) => len + more.parse::<usize>().unwrap(),
        None => text.parse().unwrap(),
    };
    for (row, (name, bytes)) in rows.iter().zip(expected) {
        let (first, last) = row[0].split_once(" to ").unwrap_or((row[0], row[0]));
        assert_eq!((row[1], &frame[place(first) - 1..place(last)]), (name, bytes));
    }
    assert_eq!((rows.len(), frame.len()), (expected.len(), len + OVERHEAD));
    assert!(PAGE.contains(&format!("A frame is LEN + {OVERHEAD} bytes long.")));
    assert!(PAGE.contains(&format!("bytes of DATA, 0 to {MAX_DATA} |")));
    assert_eq!((bytes("`5E 02`"), bytes("`5E 0D`")), (STX.to_vec(), ETX.to_vec()));
}
