//! The simulated servo bus against its facts: timing to the microsecond, rules of the registers,
//! collisions, faults. Times are in microseconds; a byte takes ten of them at 1 Mbaud.

use std::pin::pin;
use std::task::{Context, Poll, Waker};

use embassy_futures::join::join;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use hal_mock::clock;
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{Faults, Make, MasterEnd, ServoBus};
use proptest::prelude::*;
use protocol::deframe::Framing;
use protocol::dynamixel::{
    Dynamixel, Errors, Id, Instruction, MAX_PACKET, Packet, Register, StatusReceiver, SyncWriter,
};

fn id(number: u8) -> Id {
    Id::new(number).unwrap()
}

fn encoded(number: u8, instruction: Instruction) -> Vec<u8> {
    instruction.encode(id(number), &mut [0; MAX_PACKET]).unwrap().to_vec()
}

fn write(register: Register, value: u16) -> (u8, Vec<u8>) {
    (register.address, value.to_le_bytes()[..usize::from(register.size)].to_vec())
}

/// An answer, and when its first byte began and its last one ended.
#[derive(Debug, PartialEq)]
struct Answer {
    id: u8,
    errors: Errors,
    params: Vec<u8>,
    from_us: u64,
    to_us: u64,
}

/// A master that waits for everything to be over before it goes on.
struct Master {
    bus: ServoBus,
    now_us: u64,
}

impl Master {
    /// Servos with these IDs and no return delay, behind an adapter without echo.
    fn with(make: Make, ids: &[u8]) -> Self {
        let servos = ids.iter().map(|&id| {
            let mut servo = Ax12::new(id);
            servo.set(Register::RETURN_DELAY, 0);
            servo
        });
        Self { bus: ServoBus::new(Make { echo: false, ..make }, servos), now_us: 0 }
    }

    /// The same at the wire's own limit: servos without latency.
    fn at_the_limit(ids: &[u8]) -> Self {
        Self::with(Make { latency_us: 0, ..Make::default() }, ids)
    }

    /// Sends bytes and lets 5 ms pass. Answers the bytes heard, and when each ended.
    fn send(&mut self, bytes: &[u8]) -> Vec<(u64, u8)> {
        self.bus.send(self.now_us * 1000, bytes);
        self.run(5000);
        std::iter::from_fn(|| self.bus.receive()).collect()
    }

    fn run(&mut self, us: u64) {
        self.now_us += us;
        self.bus.advance_to(self.now_us * 1000);
    }

    /// Sends a packet, and answers the good answers to it.
    fn ask_raw(&mut self, packet: &[u8]) -> Vec<Answer> {
        let sent_us = self.now_us;
        let byte_us = 10;
        let mut receiver = StatusReceiver::new();
        let mut answers = vec![];
        for (at_ns, byte) in self.send(packet) {
            if let Some(packet) = receiver.receive(&mut &[byte][..]) {
                let length = packet.len() as u64;
                let Packet { id, code, params } = Packet::parse(packet).unwrap();
                let to_us = at_ns / 1000 - sent_us;
                let (id, params) = (id.number(), params.to_vec());
                answers.push(Answer {
                    id,
                    errors: Errors::from_bits(code),
                    params,
                    from_us: to_us - byte_us * length,
                    to_us,
                });
            }
        }
        answers
    }

    fn ask(&mut self, number: u8, instruction: Instruction) -> Option<Answer> {
        let mut answers = self.ask_raw(&encoded(number, instruction));
        assert!(answers.len() <= 1, "{answers:?}");
        answers.pop()
    }

    fn ping(&mut self, number: u8) -> bool {
        self.ask(number, Instruction::Ping).is_some()
    }

    /// Writes a register, and answers the errors.
    fn write(&mut self, number: u8, register: Register, value: u16) -> Option<Errors> {
        let (address, data) = write(register, value);
        self.ask(number, Instruction::Write { address, data: &data }).map(|answer| answer.errors)
    }

    fn read(&mut self, number: u8, register: Register) -> Option<Vec<u8>> {
        let (address, count) = (register.address, register.size);
        self.ask(number, Instruction::Read { address, count }).map(|answer| answer.params)
    }
}

#[test]
fn an_answer_comes_after_return_delay_and_latency_to_the_microsecond() {
    for (return_delay, latency_us) in [(0, 0), (1, 0), (1, 22), (250, 22), (254, 22)] {
        let mut master = Master::with(Make { latency_us, ..Make::default() }, &[1, 2]);
        let delay = 2 * u64::from(return_delay) + u64::from(latency_us);
        for number in [1, 2] {
            master.bus.servo(usize::from(number - 1)).set(Register::RETURN_DELAY, return_delay);
            // PING: 6 bytes, and 6 in the answer.
            let answer = master.ask(number, Instruction::Ping).unwrap();
            assert_eq!((answer.from_us, answer.to_us), (60 + delay, 120 + delay));
            // The bridge's read: 8 bytes, and 6 + 8 in the answer.
            let read = Instruction::Read { address: 36, count: 8 };
            let answer = master.ask(number, read).unwrap();
            assert_eq!((answer.from_us, answer.to_us), (80 + delay, 220 + delay));
            assert_eq!(answer.params, [0, 2, 0, 0, 0, 0, 120, 35]);
        }
    }
    // Half the rate, twice the time.
    let mut master = Master::with(Make { baud: 500_000, ..Make::default() }, &[1]);
    let last = master.send(&encoded(1, Instruction::Ping)).pop().unwrap();
    assert_eq!(last.0, 120_000 + 22_000 + 120_000);
}

#[test]
fn the_examples_of_the_facts_are_answered_byte_for_byte() {
    let mut master = Master::at_the_limit(&[0, 1, 2, 3]);
    let goals = [
        0xFF, 0xFF, 0xFE, 0x18, 0x83, 0x1E, 0x04, 0x00, 0x10, 0x00, 0x50, 0x01, 0x01, 0x20, 0x02,
        0x60, 0x03, 0x02, 0x30, 0x00, 0x70, 0x01, 0x03, 0x20, 0x02, 0x80, 0x03, 0x12,
    ];
    assert_eq!(master.send(&goals), []);
    for (index, (goal, speed)) in
        [(0x010, 0x150), (0x220, 0x360), (0x030, 0x170), (0x220, 0x380)].into_iter().enumerate()
    {
        let servo = master.bus.servo(index);
        assert_eq!(servo.get(Register::GOAL_POSITION), goal);
        assert_eq!(servo.get(Register::MOVING_SPEED), speed);
    }
    let mut answer = |bytes: &[u8]| -> Vec<u8> {
        master.send(bytes).into_iter().map(|(_, byte)| byte).collect()
    };
    let lock = [0xFF, 0xFF, 0x00, 0x04, 0x03, 0x2F, 0x01, 0xC8];
    assert_eq!(answer(&lock), [0xFF, 0xFF, 0x00, 0x02, 0x00, 0xFD]);
    // Locked, the punch cannot be written any more: a range error.
    let punch = [0xFF, 0xFF, 0x00, 0x05, 0x03, 0x30, 0x40, 0x00, 0x87];
    assert_eq!(answer(&punch), [0xFF, 0xFF, 0x00, 0x02, 0x08, 0xF5]);
}

#[test]
fn what_a_servo_refuses_it_names_in_its_answer_and_does_not_do() {
    let mut master = Master::at_the_limit(&[5]);
    assert_eq!(master.write(5, Register::GOAL_POSITION, 1023), Some(Errors::NONE));
    assert_eq!(master.write(5, Register::GOAL_POSITION, 1024), Some(Errors::RANGE));
    assert_eq!(master.write(5, Register::PRESENT_POSITION, 1), Some(Errors::RANGE));
    assert_eq!(master.read(5, Register::GOAL_POSITION), Some(vec![0xFF, 3]));
    let beyond = Instruction::Read { address: 49, count: 2 };
    let answer = master.ask(5, beyond).unwrap();
    assert_eq!((answer.errors, answer.params), (Errors::RANGE, vec![]));
    assert_eq!(master.ask(5, Instruction::Action).unwrap().errors, Errors::INSTRUCTION);
    let unknown = Packet { id: id(5), code: 0x42, params: &[] };
    let answers = master.ask_raw(unknown.encode(&mut [0; 6]).unwrap());
    assert_eq!(answers[0].errors, Errors::INSTRUCTION);
    let mut damaged = encoded(5, Instruction::Ping);
    *damaged.last_mut().unwrap() ^= 1;
    assert_eq!(master.ask_raw(&damaged)[0].errors, Errors::CHECKSUM);
    // Nobody feels meant.
    assert!(!master.ping(6));
}

#[test]
fn a_broadcast_ping_tells_the_id_of_a_lonely_servo_and_makes_several_collide() {
    let ping = encoded(Id::BROADCAST.number(), Instruction::Ping);
    let answers = |servos: &[u8]| Master::at_the_limit(servos).ask_raw(&ping);
    assert_eq!(answers(&[7]).iter().map(|answer| answer.id).collect::<Vec<_>>(), [7]);
    assert!(answers(&[7, 9]).is_empty(), "no answer is left whole");
}

#[test]
fn the_status_return_level_says_what_is_answered() {
    for (level, ping, read, write) in
        [(0, true, false, false), (1, true, true, false), (2, true, true, true)]
    {
        let mut master = Master::at_the_limit(&[1]);
        master.bus.servo(0).set(Register::STATUS_RETURN_LEVEL, level);
        assert_eq!(master.ping(1), ping);
        assert_eq!(master.read(1, Register::LED).is_some(), read);
        assert_eq!(master.write(1, Register::LED, 1).is_some(), write);
        assert_eq!(master.bus.servo(0).get(Register::LED), 1);
    }
}

#[test]
fn a_broadcast_write_is_done_by_all_and_answered_by_none() {
    let mut master = Master::at_the_limit(&[1, 2]);
    for number in [1, 2] {
        let goal = Instruction::RegWrite { address: 30, data: &[0, u8::from(number == 1)] };
        assert_eq!(master.ask(number, goal).unwrap().errors, Errors::NONE);
    }
    assert_eq!(master.ask(254, Instruction::Action), None);
    assert_eq!(master.read(1, Register::GOAL_POSITION), Some(vec![0, 1]));
    assert_eq!(master.read(2, Register::GOAL_POSITION), Some(vec![0, 0]));
    assert_eq!(master.read(2, Register::REGISTERED), Some(vec![0]));
}

#[test]
fn an_eeprom_write_is_answered_and_mutes_for_6_ms_a_byte() {
    // From the last byte of the write until the ping begins: one byte, and a word.
    for (register, value, mute_us) in
        [(Register::RETURN_DELAY, 1, 6000), (Register::CW_LIMIT, 9, 12_000)]
    {
        for (wait_us, answered) in [(mute_us - 1, false), (mute_us, true)] {
            let mut master = Master::at_the_limit(&[1]);
            let (address, data) = write(register, value);
            let packet = encoded(1, Instruction::Write { address, data: &data });
            let end_us = master.bus.send(0, &packet) / 1000;
            master.run(end_us + wait_us);
            let heard: Vec<_> = std::iter::from_fn(|| master.bus.receive()).collect();
            assert_eq!(heard.len(), 6, "the write itself is answered");
            assert_eq!(master.ping(1), answered, "{wait_us} us after writing {register:?}");
        }
    }
    // A write to RAM takes no time.
    let mut master = Master::at_the_limit(&[1]);
    master.write(1, Register::LED, 1).unwrap();
    assert!(master.ping(1));
}

#[test]
fn a_new_id_and_a_reset_are_answered_with_the_old_id() {
    let mut master = Master::at_the_limit(&[9]);
    assert_eq!(master.write(9, Register::ID, 20), Some(Errors::NONE));
    master.run(6000);
    assert!(master.ping(20) && !master.ping(9));
    let answer = master.ask(20, Instruction::Reset).unwrap();
    assert_eq!((answer.id, answer.errors), (20, Errors::NONE));
    // 15 bytes of EEPROM.
    assert!(!master.ping(1));
    master.run(15 * 6000);
    assert_eq!(master.read(1, Register::RETURN_DELAY), Some(vec![250]));
}

#[test]
fn an_unplugged_servo_is_silent_and_comes_back_without_its_ram() {
    let mut master = Master::at_the_limit(&[1, 2]);
    master.write(1, Register::TORQUE_ENABLE, 1).unwrap();
    master.write(1, Register::CCW_LIMIT, 900).unwrap();
    master.run(12_000);
    master.write(1, Register::LOCK, 1).unwrap();
    // In the middle of its answer: the rest never comes.
    master.bus.send(master.now_us * 1000, &encoded(1, Instruction::Ping));
    master.run(60 + 35);
    master.bus.unplug(0);
    master.run(5000);
    assert_eq!(std::iter::from_fn(|| master.bus.receive()).count(), 3);
    assert!(!master.ping(1) && master.ping(2));
    master.bus.plug(0);
    assert_eq!(master.read(1, Register::TORQUE_ENABLE), Some(vec![0]));
    assert_eq!(master.read(1, Register::CCW_LIMIT), Some(vec![0x84, 3]));
    assert_eq!(master.write(1, Register::PUNCH, 64), Some(Errors::NONE), "no longer locked");
}

#[test]
fn servos_with_one_id_answer_together_and_nothing_good_is_heard() {
    let mut master = Master::at_the_limit(&[3, 3, 4]);
    let heard = master.send(&encoded(3, Instruction::Ping));
    assert_eq!(heard.len(), 6, "as many bytes as a receiver can take: {heard:02X?}");
    assert!(heard.iter().all(|(_, byte)| *byte != 0xFF));
    assert!(!master.ping(3) && master.ping(4));
    // One of them later: only where they overlap is it damaged, and that is enough.
    master.bus.servo(0).set(Register::RETURN_DELAY, 15);
    assert_eq!(master.ask(3, Instruction::Ping), None);
    // Much later: two answers.
    master.bus.servo(0).set(Register::RETURN_DELAY, 30);
    assert_eq!(master.ask_raw(&encoded(3, Instruction::Ping)).len(), 2);
}

#[test]
fn a_master_that_talks_into_an_answer_spoils_both() {
    let mut master = Master::at_the_limit(&[1, 2]);
    // The second packet begins with the answer's third byte.
    master.bus.send(0, &encoded(1, Instruction::Ping));
    master.run(80);
    assert_eq!(master.ask_raw(&encoded(2, Instruction::Ping)), []);
    // Nothing is left of it.
    assert!(master.ping(2) && master.ping(1));
    // A single byte from the middle of the answer's second to that of its third.
    let sent_us = master.now_us;
    master.bus.send(sent_us * 1000, &encoded(1, Instruction::Ping));
    master.run(75);
    let heard: Vec<_> = master.send(&[0]).into_iter().map(|(_, byte)| byte).collect();
    let sound = [0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC];
    assert_eq!(heard.len(), 6);
    let spoilt: Vec<_> = (0..6).filter(|&at| heard[at] != sound[at]).collect();
    assert_eq!(spoilt, [1, 2]);
}

#[test]
fn an_incomplete_instruction_waits_for_its_rest_for_100_ms() {
    for (pause_ms, answered) in [(99, true), (101, false)] {
        let mut master = Master::at_the_limit(&[1]);
        let ping = encoded(1, Instruction::Ping);
        let (begin, rest) = ping.split_at(4);
        assert_eq!(master.send(begin), []);
        master.run(1000 * pause_ms - 5000);
        assert_eq!(!master.send(rest).is_empty(), answered, "after {pause_ms} ms");
    }
}

#[test]
fn faults_come_at_their_rate_and_the_same_again_with_the_same_seed() {
    // 2000 reads of 50 bytes: 16,000 bytes to the servo, 112,000 back.
    let storm = |faults, seed| {
        let mut master = Master::with(Make { faults, seed, ..Make::default() }, &[1]);
        let (mut heard, mut good) = (vec![], 0);
        for _ in 0..2000 {
            let read = encoded(1, Instruction::Read { address: 0, count: 50 });
            let bytes = master.send(&read);
            let answer: Vec<_> = bytes.iter().map(|(_, byte)| *byte).collect();
            let intact = Dynamixel::is_intact(&answer)
                && Packet::parse(&answer).is_some_and(|packet| packet.code == 0);
            good += u32::from(intact);
            heard.push(bytes);
            master.run(100_000);
        }
        (heard, good)
    };
    let (sound, all) = storm(Faults::default(), 1);
    assert_eq!((sound.concat().len(), all), (112_000, 2000));

    // A read is good if none of 64 bytes is struck: 0.999^64 = 0.938 of 2000 are 1876, standard
    // deviation 10.8; five of these either way.
    for faults in [
        Faults { dropped_ppm: 1000, ..Faults::default() },
        Faults { flipped_ppm: 1000, ..Faults::default() },
    ] {
        let (heard, good) = storm(faults, 1);
        assert!((1822..=1930).contains(&good), "{good} good with {faults:?}");
        assert_eq!(storm(faults, 1), (heard.clone(), good));
        assert_ne!(storm(faults, 2).0, heard);
    }

    // Stalls: nothing is lost, every pause is 150 us at most, and some are nearly that.
    let (heard, good) = storm(Faults { stalled_ppm: 10_000, ..Faults::default() }, 1);
    assert_eq!(good, 2000);
    let pauses = heard.iter().flat_map(|bytes| bytes.windows(2).map(|w| w[1].0 - w[0].0 - 10_000));
    let stalls: Vec<_> = pauses.filter(|pause| *pause > 0).collect();
    // 2000 * 55 gaps, 1 in 100: 1100, standard deviation 33.
    assert!((935..=1265).contains(&stalls.len()), "{} stalls", stalls.len());
    assert!((140_000..=150_000).contains(stalls.iter().max().unwrap()));
}

/// Runs a future on this thread's clock, and answers how long it took.
fn timed(future: impl Future<Output = ()>) -> Duration {
    let start = Instant::now();
    let mut future = pin!(future);
    while future.as_mut().poll(&mut Context::from_waker(Waker::noop())) == Poll::Pending {
        clock::advance_to(clock::next_alarm().expect("something to wait for"));
    }
    Instant::now() - start
}

/// The bytes that come next.
async fn read_exactly(rx: &mut impl Read, count: usize) -> Vec<u8> {
    let mut bytes = vec![0; count];
    rx.read_exact(&mut bytes).await.unwrap();
    bytes
}

#[test]
fn a_cycle_of_the_bridge_takes_what_the_formula_says() {
    // Facts, "The bus limit": reads of 8 registers with a return delay of 1, both SYNC_WRITEs.
    for (servos, latency_us, cycle_us) in
        [(18, 0, 7216), (18, 22, 7612), (10, 0, 4080), (10, 22, 4300), (6, 0, 2512), (6, 22, 2644)]
    {
        clock::reset();
        let numbers = 1..=servos;
        let bus = ServoBus::new(
            Make { latency_us, ..Make::default() },
            numbers.clone().map(|number| {
                let mut servo = Ax12::new(number);
                servo.set(Register::RETURN_DELAY, 1);
                servo
            }),
        );
        let master = MasterEnd::new(bus);
        let (mut rx, mut tx) = master.split();
        let cycle = timed(async {
            for number in numbers.clone() {
                let read = encoded(number, Instruction::Read { address: 36, count: 8 });
                tx.write_all(&read).await.unwrap();
                assert_eq!(read_exactly(&mut rx, 8).await, read, "the echo");
                let answer = read_exactly(&mut rx, 14).await;
                assert_eq!(Packet::parse(&answer).unwrap().id, id(number));
            }
            for (address, len) in [(24, 12), (47, 3)] {
                let mut buffer = [0; MAX_PACKET];
                let mut writer = SyncWriter::new(&mut buffer, address, len).unwrap();
                for number in numbers.clone() {
                    let values = [1, 1, 0, 0, 32, 32, 0, 2, 0, 1, 0xFF, 3];
                    let values = if len == 3 { &[0, 40, 0][..] } else { &values };
                    writer.servo(id(number)).unwrap().copy_from_slice(values);
                }
                tx.write_all(writer.finish().unwrap()).await.unwrap();
                tx.flush().await.unwrap();
            }
        });
        assert_eq!(cycle, Duration::from_micros(cycle_us), "{servos} servos, {latency_us} us");
        for index in 0..usize::from(servos) {
            assert_eq!(master.bus().servo(index).get(Register::MOVING_SPEED), 256);
            assert_eq!(master.bus().servo(index).get(Register::PUNCH), 40);
        }
    }
}

#[test]
fn a_waiting_reader_hears_what_is_sent_meanwhile_before_the_answer_it_waits_for() {
    clock::reset();
    // A return delay of 500 us: the answer's first byte ends 60 + 500 + 22 + 10 us after the
    // beginning. What the master says at 100 us is heard at 110 us.
    let master = MasterEnd::new(ServoBus::new(Make::default(), [Ax12::new(1)]));
    let (mut rx, mut tx) = master.split();
    let mut heard = vec![];
    let sender = async {
        tx.write_all(&encoded(1, Instruction::Ping)).await.unwrap();
        assert_eq!(Instant::now(), Instant::from_micros(0), "there is room");
        tx.flush().await.unwrap();
        assert_eq!(Instant::now(), Instant::from_micros(60), "the last stop bit has left");
        Timer::at(Instant::from_micros(100)).await;
        tx.write_all(&[0]).await.unwrap();
    };
    let listener = async {
        for _ in 0..13 {
            let byte = read_exactly(&mut rx, 1).await[0];
            heard.push((Instant::now().as_micros(), byte));
        }
    };
    timed(async {
        join(sender, listener).await;
    });
    let times: Vec<_> = heard.iter().map(|(at, _)| *at).collect();
    assert_eq!(times, [10, 20, 30, 40, 50, 60, 110, 592, 602, 612, 622, 632, 642]);
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: 500, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn any_bytes_leave_the_servos_answering(
        bytes in proptest::collection::vec(
            prop_oneof![Just(0xFFu8), Just(0xFE), 0..8u8, any::<u8>()], 0..300),
    ) {
        let mut master = Master::at_the_limit(&[1, 2]);
        master.send(&bytes);
        // Longer than an incomplete instruction waits, and than a reset mutes.
        master.run(101_000);
        let (first, second) = (master.bus.servo(0).id(), master.bus.servo(1).id());
        if first != second {
            prop_assert!(master.ping(first) && master.ping(second));
        }
    }
}
