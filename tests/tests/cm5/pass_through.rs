//! The CM-5 as a pass-through: a PC that is the servo bus's master itself, on virtual time.

mod wheels;

use firmware::bridge::pass_through::{PassThrough, PassThroughCounters, SILENCE};
use hal_mock::pass_through_board::{Loop, Make, PassThroughBoard};
use hal_mock::servo_bus;
use proptest::collection::vec;
use proptest::prelude::*;
use protocol::dynamixel::{
    Errors, Id, Instruction, MAX_PACKET as LONGEST, Packet, StatusReceiver, SyncWriter,
};

use super::*;

/// A byte on either line, at 1 Mbaud.
const BYTE_US: u64 = 10;

struct Pc(PassThroughBoard);

impl Pc {
    fn with(make: Make) -> Self {
        let mut pc = Self(PassThroughBoard::new(make));
        pc.run_ms(10);
        pc
    }

    /// A board with these servos. They turn, and answer after 2 us and their 22.
    fn new(ids: impl IntoIterator<Item = u8>) -> Self {
        Self::with(Make { servos: turning(ids), ..Make::default() })
    }

    fn run_us(&mut self, us: u64) {
        self.0.run_for(Duration::from_micros(us));
    }

    fn run_ms(&mut self, ms: u64) {
        self.run_us(1000 * ms);
    }

    fn send(&mut self, bytes: &[u8]) {
        self.0.line.host_sends(bytes);
    }

    /// What has come since the last call.
    fn heard(&mut self) -> Vec<u8> {
        std::iter::from_fn(|| self.0.line.host_receives()).flat_map(|(_, bytes)| bytes).collect()
    }

    /// Sends, and what comes within 5 ms.
    fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.send(bytes);
        self.run_ms(5);
        self.heard()
    }

    /// Writes to EEPROM, and waits until the servo hears again.
    fn set_up(&mut self, bytes: &[u8]) {
        self.ask(bytes);
        self.run_ms(60);
    }

    fn speed(&self, servo: usize) -> u16 {
        self.0.bus.bus().servo(servo).get(Register::MOVING_SPEED)
    }

    fn counters(&self) -> PassThroughCounters {
        self.0.pass().counters()
    }

    fn wheels(&self) -> Vec<u8> {
        self.0.pass().wheels().collect()
    }
}

fn turning(ids: impl IntoIterator<Item = u8>) -> Vec<Ax12> {
    let mut all = servos(ids);
    for servo in &mut all {
        servo.set(Register::RETURN_DELAY, 1);
        servo.set(Register::MOVING_SPEED, 300);
    }
    all
}

fn packet(id: u8, instruction: Instruction<'_>) -> Vec<u8> {
    instruction.encode(Id::new(id).unwrap(), &mut [0; LONGEST]).unwrap().to_vec()
}

fn ping(id: u8) -> Vec<u8> {
    packet(id, Instruction::Ping)
}

fn read(id: u8, address: u8, count: u8) -> Vec<u8> {
    packet(id, Instruction::Read { address, count })
}

fn write(id: u8, address: u8, data: &[u8]) -> Vec<u8> {
    packet(id, Instruction::Write { address, data })
}

fn reg_write(id: u8, address: u8, data: &[u8]) -> Vec<u8> {
    packet(id, Instruction::RegWrite { address, data })
}

fn sync_write(address: u8, servos: &[(u8, &[u8])]) -> Vec<u8> {
    let mut buffer = [0; LONGEST];
    let mut packet = SyncWriter::new(&mut buffer, address, servos[0].1.len() as u8).unwrap();
    for (id, data) in servos {
        packet.servo(Id::new(*id).unwrap()).unwrap().copy_from_slice(data);
    }
    packet.finish().unwrap().to_vec()
}

fn status(id: u8, errors: Errors, params: &[u8]) -> Vec<u8> {
    let id = Id::new(id).unwrap();
    Packet { id, code: errors.bits(), params }.encode(&mut [0; LONGEST]).unwrap().to_vec()
}

const BROADCAST: u8 = 254;
const NOTHING: [u8; 0] = [];
/// Both limits.
const LIMITS: u8 = 6;
const ZERO: [u8; 4] = [0; 4];

#[test]
fn bytes_go_to_the_bus_and_answers_come_back_as_they_are_without_echo() {
    let mut pc = Pc::new([1, 7]);
    assert_eq!(pc.ask(&ping(7)), status(7, Errors::NONE, &[]));
    assert_eq!(pc.ask(&ping(3)), NOTHING);
    assert_eq!(pc.ask(&read(1, 36, 8)), status(1, Errors::NONE, &[0, 2, 0, 0, 0, 0, 120, 35]));
    assert_eq!(pc.ask(&read(1, 0, 50)).len(), 56);
    let mut damaged = ping(1);
    damaged[5] ^= 1;
    assert_eq!(pc.ask(&damaged), status(1, Errors::CHECKSUM, &[]));
    // What is no packet goes as well, and the next is heard.
    assert_eq!(pc.ask(&[0x00, 0x55, 0xFF]), NOTHING);
    assert_eq!(pc.ask(&ping(1)), status(1, Errors::NONE, &[]));
    pc.run_ms(1900);
    assert_eq!(pc.heard(), NOTHING);
    let counters = PassThroughCounters { instructions: 6, ..Default::default() };
    assert_eq!(pc.counters(), counters);
}

#[test]
fn a_packet_is_50_us_late_on_the_bus_and_its_answer_10_us_at_the_pc() {
    for (asked, answer) in [(ping(1), 6), (read(1, 36, 8), 14), (read(1, 0, 50), 56)] {
        for phase in 0..60 {
            let mut pc = Pc::new([1]);
            pc.run_us(phase);
            let begun = Instant::now().as_micros();
            pc.send(&asked);
            pc.run_ms(3);
            let (came, _) = std::iter::from_fn(|| pc.0.line.host_receives()).last().unwrap();
            let left_pc = begun + BYTE_US * asked.len() as u64;
            let left = pc.0.bus.bus().sending_until_ns() / 1000;
            assert_eq!(left - left_pc, 50, "{asked:?}");
            let answered = left + 2 + 22 + BYTE_US * answer;
            assert_eq!(came.as_micros() - answered, 10, "{asked:?}");
        }
    }
}

#[test]
fn a_long_packet_is_cut_through_and_reaches_the_bus_in_one_piece() {
    let mut pc = Pc::new(1..=18);
    let goals: Vec<_> = (1..=18).map(|id| (id, [id, 2, 44, 1])).collect();
    let list: Vec<_> = goals.iter().map(|(id, data)| (*id, &data[..])).collect();
    let asked = sync_write(30, &list);
    assert_eq!(asked.len(), 98);
    let begun = Instant::now().as_micros();
    pc.send(&asked);
    pc.run_us(60);
    let first = pc.0.bus.bus().sending_until_ns() / 1000 - begun;
    assert_eq!(first, 100, "the first five bytes, at once");
    pc.run_ms(3);
    let left = pc.0.bus.bus().sending_until_ns() / 1000 - begun;
    assert_eq!(left, 980 + 50, "no pause");
    assert!(
        (0..18).all(|k| pc.0.bus.bus().servo(k).get(Register::GOAL_POSITION) == 513 + k as u16)
    );
    assert_eq!(pc.heard(), NOTHING);
}

#[test]
fn a_write_of_another_baud_in_pieces_is_refused_whenever_servos_take_them_for_one() {
    for pause_us in (99_000..102_000).step_by(20) {
        let make = Make { servos: turning([1]), line_rate: 0, ..Make::default() };
        let mut pc = Pc::with(make);
        let asked = write(1, 4, &[34]);
        pc.send(&[&[0; 58][..], &asked[..6]].concat());
        pc.run_us(pause_us);
        pc.send(&asked[6..]);
        pc.run_ms(5);
        assert_eq!(pc.0.bus.bus().servo(0).get(Register::BAUD_RATE), 1, "{pause_us} us");
    }
}

#[test]
fn a_write_of_another_baud_is_refused_and_the_bus_stays_at_1_mbaud() {
    let mut pc = Pc::new([1, 2]);
    let baud = |pc: &Pc| [0, 1].map(|k| pc.0.bus.bus().servo(k).get(Register::BAUD_RATE));
    let refused = status(1, Errors::CHECKSUM, &[]);
    assert_eq!(pc.ask(&write(1, 4, &[34])), refused);
    assert_eq!(pc.ask(&write(1, 3, &[1, 34, 250])), refused, "between others");
    assert_eq!(pc.ask(&reg_write(1, 4, &[0])), refused);
    assert_eq!(pc.ask(&write(BROADCAST, 4, &[34])), NOTHING);
    assert_eq!(pc.ask(&sync_write(4, &[(1, &[1]), (2, &[34])])), NOTHING);
    assert_eq!(pc.ask(&packet(BROADCAST, Instruction::Action)), NOTHING);
    assert_eq!((baud(&pc), pc.counters().refused_bauds), ([1, 1], 5));
    // The same baud, and all else: 3 is no baud in register 5.
    assert_eq!(pc.ask(&write(1, 4, &[1])), status(1, Errors::NONE, &[]));
    pc.run_ms(20);
    assert_eq!(pc.ask(&write(1, 5, &[3])), status(1, Errors::NONE, &[]));
    // One that is damaged so that it would be right the other way round.
    let mut damaged = write(2, 4, &[34]);
    let checksum = damaged.last_mut().unwrap();
    *checksum = !*checksum;
    assert_eq!(pc.ask(&damaged), status(2, Errors::CHECKSUM, &[]));
    // One in three pieces, and two in one.
    let asked = write(2, 4, &[34]);
    for piece in [&asked[..6], &asked[6..7], &asked[7..]] {
        pc.send(piece);
        pc.run_ms(50);
    }
    assert_eq!(pc.heard(), status(2, Errors::CHECKSUM, &[]));
    pc.ask(&[sync_write(4, &[(1, &[2])]), write(2, 4, &[2])].concat());
    assert_eq!((baud(&pc), pc.counters().refused_bauds), ([1, 1], 8));
}

#[test]
fn a_pc_that_speaks_into_an_answer_hears_no_echo_and_all_is_well_when_the_bus_is_quiet() {
    for into in 0..165 {
        let mut pc = Pc::new([1, 2]);
        pc.send(&read(1, 0, 50));
        // 80 us on the line, 50 late, 24 until the servo begins.
        pc.run_us(80 + 50 + 24 + 3 * into);
        let asked = sync_write(32, &[(1, &[0x21, 0x01]), (2, &[0x21, 0x01])]);
        pc.send(&asked);
        pc.run_ms(5);
        let heard = pc.heard();
        assert!(heard.len() < 56, "{into}: {}", heard.len());
        let as_asked = |part: &[u8]| asked.windows(4).any(|echo| echo == part);
        assert!(!heard.windows(4).any(as_asked), "{into}: {heard:?}");
        assert!(pc.counters().collisions > 0, "{into}");
        assert_eq!(pc.ask(&ping(2)), status(2, Errors::NONE, &[]), "{into}");
        assert_eq!(pc.ask(&read(1, 0, 50)).len(), 56, "{into}");
    }
}

#[test]
fn a_pc_at_57600_baud_loses_nothing_of_answers_that_are_faster_than_its_line() {
    let make = Make { servos: turning([1]), line_rate: 57_600, ..Make::default() };
    let mut pc = Pc::with(make);
    for _ in 0..20 {
        pc.send(&read(1, 0, 50));
        pc.run_ms(15);
        let heard = pc.heard();
        let mut receiver = StatusReceiver::new();
        assert!(receiver.receive(&mut &heard[..]).is_some_and(|answer| answer.len() == 56));
    }
    // A PC that does not wait: its line takes 56 bytes in 9.7 ms.
    for (every_us, is_lost) in [(9800, false), (3000, true)] {
        for _ in 0..300 {
            pc.send(&read(1, 0, 50));
            pc.run_us(every_us);
        }
        assert_eq!(pc.counters().lost_bytes > 0, is_lost, "{:?}", pc.counters());
    }
    // What is lost is counted, and no more than that.
    pc.run_ms(100);
    let heard = pc.heard().len() + pc.counters().lost_bytes as usize;
    assert_eq!((heard, pc.counters().collisions), (600 * 56, 0));
    pc.send(&read(1, 0, 50));
    pc.run_ms(15);
    assert_eq!(pc.heard().len(), 56);
}

#[test]
fn a_pc_that_is_faster_than_the_bus_waits_and_loses_nothing() {
    let make = Make { servos: turning(1..=18), line_rate: 0, ..Make::default() };
    let mut pc = Pc::with(make);
    for round in 0..100u16 {
        let value = (200 + round).to_le_bytes();
        let list: Vec<_> = (1..=18).map(|id| (id, &value[..])).collect();
        pc.send(&sync_write(30, &list));
    }
    pc.send(&read(18, 30, 2));
    pc.run_ms(61);
    assert_eq!(pc.heard(), NOTHING, "100 times 62 bytes take 62 ms");
    pc.run_ms(2);
    assert_eq!(pc.heard(), status(18, Errors::NONE, &[43, 1]));
    let counters = PassThroughCounters { instructions: 101, ..Default::default() };
    assert_eq!(pc.counters(), counters);
}

#[test]
fn a_loop_that_hangs_silences_the_bus_at_the_latest_when_it_restarts_the_board_within_500_ms() {
    // The watchdog's 250 ms, for another loop than `hear` behind the 200 that it may be silent. An idle loop has
    // had up to 50 of them.
    let late = 350..=452;
    for (task, period) in
        [(Loop::Send, late.clone()), (Loop::Hear, 199..=251), (Loop::Transmit, late)]
    {
        let mut pc = Pc::new([1, 2]);
        pc.set_up(&write(1, LIMITS, &ZERO));
        pc.0.watchdog.hung.set(Some(task));
        let sent = pc.0.bus.bus().sending_until_ns();
        let mut reset = None;
        for ms in 1..=1000 {
            if ms % 10 == 0 && reset.is_none() {
                pc.send(&ping(2));
            }
            pc.run_ms(1);
            if pc.0.restarts() > 0 {
                reset.get_or_insert(ms);
            } else if task == Loop::Send {
                assert_eq!(pc.0.bus.bus().sending_until_ns(), sent, "the bus is silent");
            }
        }
        let reset = reset.expect("a reset");
        assert!(period.contains(&reset), "{task:?}: {reset} ms");
        // As after any start: nobody is known, and nobody is sent anything.
        pc.heard();
        assert_eq!(pc.wheels(), NOTHING);
        assert_eq!(pc.ask(&ping(2)), status(2, Errors::NONE, &[]), "{task:?}");
        let sent = pc.0.bus.bus().sending_until_ns();
        pc.run_ms(5000);
        assert_eq!((pc.0.bus.bus().sending_until_ns(), pc.0.restarts()), (sent, 1));
    }
}

#[test]
fn a_pass_through_that_is_idle_or_late_is_not_restarted() {
    let mut pc = Pc::new([1]);
    pc.run_ms(10_000);
    for task in [Loop::Send, Loop::Hear, Loop::Transmit] {
        for _ in 0..5 {
            pc.0.watchdog.hung.set(Some(task));
            pc.run_ms(145);
            pc.0.watchdog.hung.set(None);
            pc.send(&ping(1)); // whatever wakes a loop
            pc.run_ms(500);
        }
    }
    assert_eq!(pc.0.restarts(), 0);
}

#[test]
fn a_board_that_does_not_hear_itself_passes_late_answers_on() {
    let mut all = turning([1]);
    all[0].set(Register::RETURN_DELAY, 250);
    let bus = servo_bus::Make { echo: false, ..servo_bus::Make::default() };
    let mut pc = Pc::with(Make { servos: all, bus, ..Make::default() });
    assert_eq!(pc.ask(&ping(1)), status(1, Errors::NONE, &[]));
    assert_eq!(pc.counters().collisions, 1);
}

#[test]
fn a_failed_line_is_counted_and_used_again() {
    let mut pc = Pc::new([1]);
    pc.send(&ping(1));
    pc.0.line.overrun();
    pc.run_ms(5);
    assert_eq!((pc.heard(), pc.counters().pc_line_errors), (vec![], 1));
    assert_eq!(pc.ask(&ping(1)), status(1, Errors::NONE, &[]));

    // The session alone: what was heard of an echo is gone with the error.
    let mut pass = PassThrough::new();
    let at = |us: u64| Instant::from_micros(1_000_000 + us);
    let mut out = [0; 64];
    pass.receive(&mut ping(1), at(0));
    pass.bus_failed(at(1040));
    pass.bus_hears(&ping(1)[3..], at(1050));
    assert_eq!(pass.transmit(&mut out), None);
    pass.bus_hears(&[1, 2, 3], at(1300));
    assert_eq!(pass.transmit(&mut out), Some(&[1, 2, 3][..]));
    assert_eq!(pass.counters().bus_line_errors, 1);
}

#[test]
fn an_echo_that_is_late_because_the_bus_is_slower_than_the_pc_is_no_collision() {
    let mut pass = PassThrough::new();
    let mut now = Instant::from_micros(1_000_000);
    let mut asked = [write(1, 30, &[0, 1]), read(1, 30, 2)].concat();
    pass.receive(&mut asked, now);
    for byte in &asked {
        now += Duration::from_micros(150); // a board that was busy, and less than a stall
        pass.bus_hears(&[*byte], now);
    }
    pass.bus_hears(&status(1, Errors::NONE, &[0, 1]), now);
    assert_eq!(pass.transmit(&mut [0; 64]), Some(&status(1, Errors::NONE, &[0, 1])[..]));
    assert_eq!(pass.counters().collisions, 0);
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 300,
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    /// Nothing that comes on either side makes it panic, is altered but for a refused checksum, or keeps it
    /// from passing on what comes when all is quiet again.
    #[test]
    fn any_bytes_on_both_sides_at_any_times_are_borne(
        events in vec((0..4u8, vec(prop_oneof![Just(0xFF), 0..10u8, any::<u8>()], 0..40), 0..3000u64), 0..200),
    ) {
        let mut pass = PassThrough::new();
        let mut now = Instant::from_millis(1);
        let mut out = [0; 64];
        for (what, bytes, us) in events {
            now += Duration::from_micros(us);
            match what {
                0 | 1 => {
                    let mut sent = bytes.clone();
                    let refused = pass.counters().refused_bauds;
                    pass.receive(&mut sent, now);
                    let altered = sent.iter().zip(&bytes).filter(|(sent, byte)| sent != byte).count();
                    prop_assert_eq!(altered as u32, pass.counters().refused_bauds - refused);
                    if what == 1 {
                        now += Duration::from_micros(10 * sent.len() as u64);
                        pass.bus_hears(&sent, now);
                    }
                }
                2 => pass.bus_hears(&bytes, now),
                _ => now += SILENCE,
            }
            if let Some(packet) = pass.stop(now, &mut out) {
                prop_assert!(packet.len() <= 14);
            }
            pass.transmit(&mut out);
        }
        now += SILENCE;
        while pass.transmit(&mut out).is_some() {}
        let mut sent = ping(1);
        pass.receive(&mut sent, now);
        prop_assert_eq!(&sent, &ping(1));
        now += Duration::from_micros(60);
        pass.bus_hears(&[sent, status(1, Errors::NONE, &[])].concat(), now);
        prop_assert_eq!(pass.transmit(&mut out), Some(&status(1, Errors::NONE, &[])[..]));
    }
}
