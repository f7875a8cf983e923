//! The session on virtual time, against frames written by hand.

use protocol::extension::{Action, Identity, Origin, Outcome, ResetCause, Verdict};
use protocol::pms5005::{ACK, PING, encode_answer};

use super::*;

const MS: Duration = Duration::from_millis(1);

fn ping() -> Vec<u8> {
    PING.encode(&mut [0; 20]).unwrap().to_vec()
}

fn session() -> Session {
    let mut session = Session::new();
    session.receive(&ping());
    assert_eq!(session.take_event(), Some(Event::Heard(Personality::Pms5005)));
    session
}

fn answer(answer: &Answer<'_>) -> Vec<u8> {
    encode_answer(answer, &mut [0; 300]).unwrap().to_vec()
}

const IDENTITY: Identity = Identity {
    version: [0, 1, 0],
    extension: 2,
    reset: ResetCause::Power,
    settings: Origin::Stored,
};

#[test]
fn nothing_is_written_unasked() {
    let mut session = session();
    for ms in 0..100 {
        session.advance(100 * MS * ms);
        session.receive(&ACK);
    }
    assert_eq!((session.take_output(), session.take_event()), (None, None));
}

#[test]
fn a_request_without_an_answer_is_sent_four_times_and_given_up() {
    let mut session = session();
    session.ask(&Request::Counters, Duration::ZERO).unwrap();
    let mut sent = 0;
    for ms in 0..2500 {
        session.advance(MS * ms);
        while session.take_output().is_some() {
            sent += 1;
            assert_eq!(ms, (sent - 1) * 500);
        }
        if session.take_event() == Some(Event::Failed(Failure::NoAnswer)) {
            assert_eq!((sent, ms), (4, 2000));
            return;
        }
    }
    panic!("not given up");
}

#[test]
fn an_answer_about_another_setting_is_another_hosts() {
    let told = |number| {
        let setting = Description {
            number,
            next: None,
            value: 1,
            range: (0, 2),
            default: 1,
            unit: Unit::Flag,
            name: "x",
            member: Some(2),
        };
        answer(&Answer::Setting(setting))
    };
    use protocol::extension::{Description, Unit};
    let mut session = session();
    session.ask(&Request::Setting(7), Duration::ZERO).unwrap();
    session.receive(&told(8));
    assert_eq!(session.take_event(), None);
    session.receive(&told(7));
    let Some(Event::Answered(Reply::Setting(setting))) = session.take_event() else { panic!() };
    assert_eq!((setting.name.as_str(), setting.number), ("x 2", 7));
}

#[test]
fn what_waits_is_sent_when_the_one_before_has_its_answer() {
    let mut session = session();
    session.ask(&Request::Identity, Duration::ZERO).unwrap();
    session.ask(&Request::Do(Action::Save), Duration::ZERO).unwrap();
    assert!(session.take_output().is_some());
    assert_eq!(session.take_output(), None);
    session.receive(&answer(&Answer::Identity(IDENTITY)));
    assert_eq!(session.take_event(), Some(Event::Answered(Reply::Identity(IDENTITY))));
    session.advance(MS);
    assert!(session.take_output().is_some());
    session
        .receive(&answer(&Answer::Outcome(Outcome::of_action(Action::Save, Verdict::OutputsOn))));
    let refused = Failure::Refused(Verdict::OutputsOn, 0);
    assert_eq!(session.take_event(), Some(Event::Failed(refused)));
}

#[test]
fn a_busy_board_is_asked_again_in_a_moment() {
    let mut session = session();
    session.ask(&Request::Do(Action::Save), Duration::ZERO).unwrap();
    session.take_output().unwrap();
    session.receive(&answer(&Answer::Outcome(Outcome::of_action(Action::Save, Verdict::Busy))));
    session.advance(10 * MS);
    session.advance(100 * MS);
    assert_eq!((session.take_output(), session.take_event()), (None, None));
    session.advance(110 * MS);
    assert!(session.take_output().is_some());
}

#[test]
fn signs_of_life_are_sent_only_while_it_drives() {
    let mut session = session();
    session.drive(Some(500 * MS), Duration::ZERO);
    let mut pings = 0;
    for ms in 0..2000 {
        session.advance(MS * ms);
        pings += u32::from(session.take_output().is_some());
    }
    assert_eq!(pings, 3);
    session.drive(None, 2000 * MS);
    session.advance(9000 * MS);
    assert_eq!(session.take_output(), None);
}

#[test]
fn a_command_is_sent_again_until_it_is_acknowledged() {
    let mut session = session();
    session.command(&Command::GpioOutputs(0xA5), Duration::ZERO).unwrap();
    let first = session.take_output().unwrap();
    session.advance(500 * MS);
    assert_eq!(session.take_output(), Some(first));
    session.receive(&ACK);
    assert_eq!(session.take_event(), Some(Event::Answered(Reply::Done)));
}

#[test]
fn what_is_forgotten_leaves_no_answer_behind() {
    let mut session = session();
    session.command(&Command::GpioOutputs(0xA5), Duration::ZERO).unwrap();
    session.receive(&ACK);
    session.forget();
    assert_eq!(session.take_event(), None);
}

#[test]
fn noise_other_hosts_and_half_frames_are_no_board() {
    let mut session = Session::new();
    let noise: Vec<u8> =
        (0..20_000u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    session.receive(&noise);
    session.receive(b"start\r\necho:Marlin 2.1\r\nok T:21.0 /0.0\r\n");
    let mut buffer = [0; 300];
    let other_host = Command::PingOrAck.encode(0, &mut buffer).unwrap().to_vec();
    session.receive(&other_host);
    session.receive(&[0xFF; 1000]);
    session.receive(&ping()[..6]);
    assert_eq!(session.take_event(), None);
    assert_eq!(session.personality(), None);
}

#[test]
fn each_personality_is_known_by_what_it_says() {
    let mut buffer = [0; 300];
    let hello = Hello { ids: &[1, 2] }.encode(&mut buffer).unwrap().to_vec();
    let mut session = Session::new();
    session.receive(&hello);
    assert_eq!(session.take_event(), Some(Event::Heard(Personality::Cm5)));
    assert_eq!(session.take_event(), Some(Event::Servos(vec![1, 2])));
    let report = cm5::Report::encode([None, Some(Feedback([0; 8]))], &mut buffer).unwrap().to_vec();
    session.receive(&report);
    let feedback = vec![None, Some(Feedback([0; 8]))];
    assert_eq!(session.take_event(), Some(Event::Feedback(feedback)));

    let standard = Standard::default().encode(&mut buffer).unwrap().to_vec();
    let mut session = Session::new();
    session.receive(&standard);
    assert_eq!(session.take_event(), Some(Event::Heard(Personality::Arcos)));
    assert_eq!(session.take_event(), Some(Event::Standard(Standard::default())));
}
