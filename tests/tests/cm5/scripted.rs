//! The bridge alone, without tasks: a bus that does what no servo would, step by step.

use firmware::bridge::{Bridge, BridgeSettings, MAX_INSTRUCTION};
use proptest::collection::vec;
use proptest::prelude::*;
use protocol::dynamixel::{Id, Packet};

use super::*;

/// A bridge, the time, and what the bus does.
struct Script {
    bridge: Bridge,
    now: Instant,
}

impl Script {
    fn new() -> Self {
        Self::with(BridgeSettings::DEFAULT)
    }

    fn with(settings: BridgeSettings) -> Self {
        let now = Instant::from_millis(1);
        Self { bridge: Bridge::new(settings, now), now }
    }

    fn wait_us(&mut self, us: u64) {
        self.now += Duration::from_micros(us);
    }

    /// The next request, however long it takes to come.
    fn request(&mut self) -> Vec<u8> {
        let mut out = [0; MAX_INSTRUCTION];
        for _ in 0..10 {
            if let Some(request) = self.bridge.bus_sends(self.now, &mut out) {
                return request.to_vec();
            }
            let at = self.bridge.bus_acts_at();
            assert!(at > self.now, "it would never wait");
            self.now = at;
        }
        panic!("no request");
    }

    fn hear(&mut self, bytes: &[u8]) {
        self.wait_us(10 * bytes.len() as u64);
        self.bridge.bus_hears(bytes, self.now);
    }

    /// The servos found when all IDs have been asked, by a bus that gives these bytes after the
    /// echo of the k-th PING to an ID.
    fn search(&mut self, mut bus: impl FnMut(u8, usize) -> Vec<u8>) -> Vec<u8> {
        let (mut id, mut k) = (0, 0);
        while self.bridge.is_searching() {
            let request = self.request();
            if !self.bridge.is_searching() {
                break;
            }
            k = if request[2] == id { k + 1 } else { 0 };
            id = request[2];
            self.hear(&request);
            self.hear(&bus(id, k));
        }
        self.bridge.servos().map(|servo| servo.id.number()).collect()
    }
}

fn status(id: u8, errors: u8) -> Vec<u8> {
    let id = Id::new(id).unwrap();
    Packet { id, code: errors, params: &[] }.encode(&mut [0; 8]).unwrap().to_vec()
}

#[test]
fn an_answer_that_comes_twice_is_one_servo() {
    let found = Script::new().search(|id, _| match id {
        8 | 9 => [status(id, 0), status(id, 0)].concat(),
        _ => vec![],
    });
    assert_eq!(found, [8, 9]);
}

#[test]
fn an_error_bit_that_makes_the_answer_look_like_the_echo_hides_no_servo() {
    // PING is instruction 1, and so is the voltage error.
    let found = Script::new().search(|id, _| if id == 33 { status(33, 1) } else { vec![] });
    assert_eq!(found, [33]);
}

#[test]
fn noise_that_looks_like_an_answer_once_invents_no_servo() {
    let found = Script::new().search(|id, k| match (id, k) {
        (50, 0) => status(50, 0),
        (60, _) => status(61, 0), // somebody else's
        (70, _) => vec![0xFF, 0xFF, 70, 2, 0, 0],
        (80, _) => vec![0xFF; 40],
        _ => vec![],
    });
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn one_lost_answer_misses_no_servo() {
    for lost in 0..3 {
        let found = Script::new().search(|id, k| match id {
            90 if k != lost => status(90, 0),
            _ => vec![],
        });
        assert_eq!(found, [90], "PING {lost}");
    }
}

#[test]
fn a_request_that_collides_is_sent_again_when_the_line_is_quiet() {
    // It does not count as one that was not answered, of which none is allowed here.
    let mut script = Script::with(BridgeSettings { search_retries: 0, ..BridgeSettings::DEFAULT });
    let request = script.request();
    script.hear(&request[..3]);
    script.hear(&[0x55, 0x55]);
    script.hear(&status(1, 0)); // not believed: nobody can have understood the request
    assert_eq!(script.bridge.bus_sends(script.now, &mut [0; MAX_INSTRUCTION]), None);
    assert_eq!(script.request(), request);
    let counters = script.bridge.counters().bus;
    assert_eq!((counters.instructions, counters.collisions, counters.stray_bytes), (2, 1, 8));
}

#[test]
fn a_bus_without_echo_finds_nobody_and_does_not_hang() {
    let mut script = Script::new();
    let mut collisions = 0;
    for _ in 0..100 {
        script.request();
        script.hear(&status(1, 0));
        collisions = script.bridge.counters().bus.collisions;
    }
    assert!(collisions > 90);
    assert_eq!(script.bridge.servos().count(), 0);
}

#[test]
fn a_bus_that_babbles_holds_no_request_for_longer_than_five_milliseconds() {
    let mut script = Script::new();
    let request = script.request();
    script.hear(&request);
    let since = script.now;
    let mut out = [0; MAX_INSTRUCTION];
    while script.bridge.bus_sends(script.now, &mut out).is_none() {
        script.hear(&[0x00]);
        assert!(script.now - since < Duration::from_millis(5));
    }
    assert!(script.now - since > Duration::from_millis(1), "{}", script.now - since);
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Nothing that comes on either side makes it panic, keeps it from going on, or from hearing
    /// its PC once that is sane again.
    #[test]
    fn any_bytes_on_both_sides_at_any_times_are_borne(
        events in vec((0..3u8, vec(prop_oneof![Just(0xFF), 0..4u8, any::<u8>()], 0..30), 0..3000u64), 0..200),
    ) {
        let mut script = Script::new();
        let mut out = [0; MAX_PACKET];
        for (what, bytes, us) in events {
            script.wait_us(us);
            match what {
                0 => script.bridge.receive(&bytes, script.now),
                1 => script.hear(&bytes),
                _ => {
                    if let Some(request) = script.bridge.bus_sends(script.now, &mut out) {
                        let request = request.to_vec();
                        script.hear(&request);
                        script.hear(&bytes);
                    }
                }
            }
            script.bridge.transmit(script.now, &mut out);
            if script.bridge.bus_sends(script.now, &mut out).is_none() {
                prop_assert!(script.bridge.bus_acts_at() > script.now);
            }
        }
        // To the end of the search, without servos.
        script.wait_us(200_000);
        script.search(|_, _| vec![]);
        script.bridge.receive(&[], script.now);
        prop_assert!(script.bridge.transmit(script.now, &mut out).is_some());
        let answers = script.bridge.counters().pc.answers;
        let short = [limits(0, 1023)];
        script.bridge.receive(HelloAnswer::encode(1, &short, &mut out).unwrap(), script.now);
        prop_assert_eq!(script.bridge.counters().pc.answers, answers + 1);
    }
}
