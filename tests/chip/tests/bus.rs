//! The CM-5's servo bus when something is wrong with it, and how fast it is. Whatever happens on the chip
//! happens to the virtual board too (hal-mock), on the same bus of the same servos: what they say is the
//! same, and so are search, loop and re-scan, within 3 %. What the chip takes longer are the 9 us from an
//! answer's last bit to the next instruction's first, eighteen times a cycle, and what it takes to write goals.

use chip::bench::{self, Bench};
use embassy_time::Duration;
use hal_mock::cm5_board::{Cm5Board, Make};
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{self, Faults, ServoBus};
use protocol::cm5::{
    Goals, Hello, HelloAnswer, Limits, MAX_PACKET, Receiver, Report, ServoGoal, params_of,
};

/// A CM-5 with its PC and its servos.
trait Cm5 {
    fn run_for(&mut self, us: u64);
    fn send(&mut self, packet: &[u8]);
    /// Parameters of the packets heard since the last call.
    fn packets(&mut self) -> Vec<Vec<u8>>;
    fn with_bus<T>(&mut self, act: impl FnOnce(&mut ServoBus) -> T) -> T;
    /// When the bus was used for the first time, in us.
    fn begun(&mut self) -> u64;
    /// Cycles of the loop of work so far.
    fn cycles(&mut self) -> u32;

    /// Runs until a packet comes of which `wanted` makes something, and for how many us that was.
    fn until<T>(&mut self, mut wanted: impl FnMut(&[u8]) -> Option<T>) -> (T, u64) {
        for passed in 1..=60_000 {
            self.run_for(250);
            let found = self.packets().iter().find_map(|params| wanted(params));
            if let Some(found) = found {
                return (found, passed * 250);
            }
        }
        panic!("the bridge does not say that within 15 s");
    }

    /// Waits for a hello and answers it; whom it names.
    fn greet(&mut self) -> Vec<u8> {
        let (ids, _) = self.until(|params| Hello::parse(params).map(|hello| hello.ids.to_vec()));
        let all = [Limits::new(0, 1023).unwrap()];
        self.send(HelloAnswer::encode(1, &all, &mut [0; 64]).unwrap());
        ids
    }

    /// Who is heard in the next report of so many.
    fn report(&mut self, servos: usize) -> Vec<bool> {
        let report = |params: &[u8]| {
            let report = Report::parse(params, servos)?;
            Some(report.iter().map(|servo| servo.is_some()).collect())
        };
        self.until(report).0
    }
}

/// The chip's.
struct Chip(Bench, Receiver);

impl Chip {
    fn new(bus: ServoBus) -> Self {
        let make = bench::Make { servos: bus, ..bench::Make::default() };
        Self(Bench::boot_with("cm5-f407", make), Receiver::new())
    }
}

impl Cm5 for Chip {
    fn run_for(&mut self, us: u64) {
        self.0.run_until_ns(self.0.now_ns() + 1000 * us);
    }

    fn send(&mut self, packet: &[u8]) {
        self.0.line.send(packet);
    }

    fn packets(&mut self) -> Vec<Vec<u8>> {
        let heard = self.0.line.heard().into_iter();
        let packets = heard.filter_map(|(_, byte)| {
            self.1.receive(&mut &[byte][..]).map(|packet| params_of(packet).unwrap().to_vec())
        });
        packets.collect()
    }

    fn with_bus<T>(&mut self, act: impl FnOnce(&mut ServoBus) -> T) -> T {
        act(&mut self.0.servos.bus.lock().unwrap())
    }

    fn begun(&mut self) -> u64 {
        self.0.servos.sent.lock().unwrap()[0].0 / 1000 - 10
    }

    /// By the first READ of each: of servo 1, from register 36 on.
    fn cycles(&mut self) -> u32 {
        let sent = self.0.servos.sent.lock().unwrap();
        let bytes: Vec<u8> = sent.iter().map(|&(_, byte)| byte).collect();
        let is_one = |bytes: &&[u8]| bytes[..] == [0xFF, 0xFF, 1, 4, 2, 36];
        bytes.windows(6).filter(is_one).count() as u32
    }
}

impl Cm5 for Cm5Board {
    fn run_for(&mut self, us: u64) {
        Cm5Board::run_for(self, Duration::from_micros(us));
    }

    fn send(&mut self, packet: &[u8]) {
        self.line.host_sends(packet);
    }

    fn packets(&mut self) -> Vec<Vec<u8>> {
        let packets = std::iter::from_fn(|| self.line.host_receives());
        packets.map(|(_, packet)| params_of(&packet).unwrap().to_vec()).collect()
    }

    fn with_bus<T>(&mut self, act: impl FnOnce(&mut ServoBus) -> T) -> T {
        act(&mut self.bus.bus())
    }

    fn begun(&mut self) -> u64 {
        0
    }

    fn cycles(&mut self) -> u32 {
        self.bridge().counters().cycles
    }
}

/// Both, with these servos on a bus like this.
fn both(ids: &[u8], bus: servo_bus::Make) -> (Chip, Cm5Board) {
    let servos = || ids.iter().map(|&id| Ax12::new(id));
    let chip = Chip::new(ServoBus::new(bus, servos()));
    (chip, Cm5Board::new(Make { servos: servos().collect(), bus, ..Make::default() }))
}

#[test]
fn two_servos_with_one_id_collide_and_cost_nobody_else() {
    fn seen(board: &mut impl Cm5) -> Vec<u8> {
        let ids = board.greet();
        for _ in 0..100 {
            assert_eq!(board.report(ids.len()), vec![true; ids.len()]);
        }
        ids
    }
    let (mut chip, mut board) = both(&[5, 7, 7, 9], servo_bus::Make::default());
    assert_eq!(seen(&mut chip), [5, 9]);
    assert_eq!(seen(&mut board), [5, 9]);
}

#[test]
fn servos_that_stall_before_every_byte_are_heard_all_the_same() {
    fn seen(board: &mut impl Cm5) -> Vec<u8> {
        board.with_bus(|bus| {
            bus.set_faults(Faults { stalled_ppm: 1_000_000, ..Faults::default() });
        });
        let ids = board.greet();
        for _ in 0..50 {
            assert_eq!(board.report(ids.len()), vec![true; ids.len()]);
        }
        ids
    }
    let (mut chip, mut board) = both(&[5, 7, 9], servo_bus::Make::default());
    assert_eq!(seen(&mut chip), [5, 7, 9]);
    assert_eq!(seen(&mut board), [5, 7, 9]);
}

#[test]
fn a_servo_that_stops_in_its_answer_is_missed_and_comes_back_without_a_word_of_the_others_lost() {
    fn seen(board: &mut impl Cm5) {
        assert_eq!(board.greet(), [5, 7, 9]);
        board.report(3);
        for into_us in [15, 65, 135] {
            // 60 us into what only the second one can say: its plug is pulled.
            while board.with_bus(|bus| !bus.is_talking(1)) {
                board.run_for(1);
            }
            board.run_for(into_us);
            board.with_bus(|bus| bus.unplug(1));
            while board.report(3) != [true, false, true] {}
            (0..20).for_each(|_| assert_eq!(board.report(3), [true, false, true]));
            board.with_bus(|bus| bus.plug(1));
            while board.report(3) != [true; 3] {}
            (0..20).for_each(|_| assert_eq!(board.report(3), [true; 3]));
        }
    }
    let (mut chip, mut board) = both(&[5, 7, 9], servo_bus::Make::default());
    seen(&mut chip);
    seen(&mut board);
}

#[test]
fn a_board_that_does_not_hear_itself_believes_nobody() {
    fn seen(board: &mut impl Cm5) -> Vec<u8> {
        board.greet()
    }
    let (mut chip, mut board) =
        both(&[5, 7, 9], servo_bus::Make { echo: false, ..servo_bus::Make::default() });
    assert_eq!(seen(&mut chip), [0; 0]);
    assert_eq!(seen(&mut board), [0; 0]);
}

/// How fast a bridge is, in us and cycles a second.
#[derive(Debug)]
struct Pace {
    search: f64,
    cycles: f64,
    rescan: f64,
}

/// Of 18 servos, and a nineteenth that comes later, with a PC that sends goals 100 times a second.
fn pace(board: &mut impl Cm5) -> Pace {
    const SECONDS: u32 = 5;
    let (_, search) =
        board.until(|params| Hello::parse(params).map(|hello| assert_eq!(hello.ids.len(), 18)));
    board.greet();
    board.run_for(500_000);
    let goal = ServoGoal([1, 0, 0, 0, 32, 32, 0, 2, 0, 0, 0, 0, 0, 0, 0]);
    let goals = Goals::encode(&[goal; 18], &mut [0; MAX_PACKET]).unwrap().to_vec();
    let before = board.cycles();
    for _ in 0..100 * SECONDS {
        board.send(&goals);
        board.run_for(10_000);
    }
    let cycles = f64::from(board.cycles() - before) / f64::from(SECONDS);
    board.packets();
    board.with_bus(|bus| bus.plug(18));
    let nineteen =
        |params: &[u8]| Hello::parse(params).filter(|hello| hello.ids.len() == 19).map(|_| ());
    let ((), rescan) = board.until(nineteen);
    let search = search - board.begun();
    Pace { search: search as f64, cycles, rescan: rescan as f64 }
}

#[test]
fn search_loop_and_rescan_of_18_servos_are_as_fast_as_on_virtual_time_within_3_percent() {
    let ids: Vec<u8> = (1..=18).chain([100]).collect();
    let (mut chip, mut board) = both(&ids, servo_bus::Make::default());
    chip.with_bus(|bus| bus.unplug(18));
    board.with_bus(|bus| bus.unplug(18));
    let (chip, board) = (pace(&mut chip), pace(&mut board));
    println!("chip {chip:?}\nvirtual {board:?}");
    // The bench of hal-mock has 126 cycles a second of the 131 that the bus allows.
    assert!((124.0..131.4).contains(&board.cycles), "{board:?}");
    let is_near =
        |chip: f64, board: f64| assert!((chip / board - 1.0).abs() <= 0.03, "{chip} and {board}");
    is_near(chip.search, board.search);
    is_near(chip.rescan, board.rescan);
    is_near(chip.cycles, board.cycles);
}
