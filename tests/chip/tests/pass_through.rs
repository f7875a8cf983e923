//! The CM-5's image that is a pass-through: 1 Mbaud on both sides, and a PC that is the servos' master.

use chip::bench::line::Timed;
use chip::bench::{Bench, Make};
use hal_mock::plant::Ax12;
use hal_mock::servo_bus::{self, ServoBus};
use protocol::dynamixel::{Id, Instruction, MAX_PACKET, Packet, Register, SyncWriter};

const IMAGE: &str = "cm5-pass-through-f407";
/// On both sides.
const BYTE_NS: u64 = 10_000;
/// What a packet may be late by, each way.
const LATE_NS: u64 = 200_000;

/// A board with these servos, which answer as soon as servos can: after `return_delay`, in 2 us.
fn board(ids: &[u8], return_delay: u16) -> Bench {
    let servos = ids.iter().map(|&id| {
        let mut servo = Ax12::new(id);
        servo.set(Register::RETURN_DELAY, return_delay);
        servo.set(Register::MOVING_SPEED, 300);
        servo
    });
    let bus = servo_bus::Make { latency_us: 0, ..servo_bus::Make::default() };
    let make = Make { servos: ServoBus::new(bus, servos), ..Make::default() };
    let mut bench = Bench::boot_with(IMAGE, make);
    bench.run_for(50);
    bench
}

fn packet(id: u8, instruction: Instruction<'_>) -> Vec<u8> {
    instruction.encode(Id::new(id).unwrap(), &mut [0; MAX_PACKET]).unwrap().to_vec()
}

fn read(id: u8, address: u8, count: u8) -> Vec<u8> {
    packet(id, Instruction::Read { address, count })
}

fn write(id: u8, address: u8, data: &[u8]) -> Vec<u8> {
    packet(id, Instruction::Write { address, data })
}

/// New goals for 18 servos: 62 bytes that nobody answers.
fn goals(round: u16) -> Vec<u8> {
    let mut buffer = [0; MAX_PACKET];
    let mut goals = SyncWriter::new(&mut buffer, Register::GOAL_POSITION.address, 2).unwrap();
    for id in 1..=18 {
        goals.servo(Id::new(id).unwrap()).unwrap().copy_from_slice(&(round % 1024).to_le_bytes());
    }
    goals.finish().unwrap().to_vec()
}

fn bytes(timed: &[Timed]) -> Vec<u8> {
    timed.iter().map(|&(_, byte)| byte).collect()
}

/// What was on the bus since the last call, from the board.
fn sent(bench: &Bench) -> Vec<Timed> {
    std::mem::take(&mut *bench.servos.sent.lock().unwrap())
}

fn register(bench: &Bench, servo: usize, register: Register) -> u16 {
    bench.servos.bus.lock().unwrap().servo(servo).get(register)
}

/// How late each byte that the PC has sent was on the bus, at the most, in ns.
fn latest(bench: &Bench) -> u64 {
    let (left, sent) = (bench.line.left(), sent(bench));
    assert_eq!(bytes(&left), bytes(&sent), "what the PC has said, and nothing else");
    left.iter().zip(&sent).map(|(left, sent)| sent.0 - BYTE_NS - left.0).max().unwrap() - BYTE_NS
}

#[test]
fn a_ping_and_a_read_are_answered_without_echo_each_at_most_200_us_late() {
    // At the shortest return delay, 2 us, and with none at all.
    for return_delay in [1, 0] {
        let mut bench = board(&[1, 7], return_delay);
        let (mut out, mut back) = (0, 0);
        for phase in 0..60 {
            for (asked, params) in [(packet(7, Instruction::Ping), 0), (read(1, 0, 50), 50)] {
                bench.line.left();
                bench.line.send_at(bench.now_ns() + 1_000_000 + 1700 * phase, &asked);
                bench.run_for(4);
                let heard = bench.line.heard();
                let answer = bytes(&heard);
                let packet = Packet::parse(&answer).unwrap_or_else(|| panic!("{answer:?}"));
                assert_eq!((packet.id.number(), packet.params.len()), (asked[2], params));
                let last = bench.servos.sent.lock().unwrap().last().unwrap().0;
                out = out.max(latest(&bench));
                let answered =
                    last + 2000 * u64::from(return_delay) + BYTE_NS * answer.len() as u64;
                back = back.max(heard.last().unwrap().0 - answered);
            }
        }
        println!("late by {} us to the bus, {} us back", out / 1000, back / 1000);
        assert!(out <= LATE_NS && back <= LATE_NS, "{out} and {back} ns");
    }
}

#[test]
fn a_torrent_of_packets_back_to_back_goes_through_in_order_and_no_later() {
    let mut bench = board(&(1..=18).collect::<Vec<_>>(), 1);
    bench.line.left();
    sent(&bench);
    const ROUNDS: u16 = 800; // half a second
    (1..=ROUNDS).for_each(|round| bench.line.send(&goals(round)));
    bench.run_for(510);
    let late = latest(&bench);
    println!("late by {} us at the most", late / 1000);
    assert!(late <= LATE_NS, "{late} ns");
    for servo in 0..18 {
        assert_eq!(register(&bench, servo, Register::GOAL_POSITION), ROUNDS);
    }
    assert_eq!(bench.line.heard(), [], "no echo");
    // And behind it, a read.
    bench.line.send(&read(18, 30, 2));
    bench.run_for(2);
    assert_eq!(bytes(&bench.line.heard())[5..7], ROUNDS.to_le_bytes());
}

#[test]
fn the_direction_line_is_high_exactly_around_what_is_sent_and_falls_at_tc() {
    let mut bench = board(&[1], 1);
    for round in 0..30 {
        bench.line.send(&goals(round));
        bench.line.send(&read(1, 36, 8));
        bench.run_for(2);
    }
    let turned = bench.with(|stand| stand.rig().world.turned.clone());
    let sent = sent(&bench);
    for &(end, byte) in &sent {
        let is_high =
            |at: u64| turned.iter().take_while(|turn| turn.0 <= at).last().is_some_and(|t| t.1);
        assert!(is_high(end - BYTE_NS), "{byte:#x} begins while the line is the servos'");
        assert!(is_high(end - 1), "{byte:#x} ends while the line is the servos'");
    }
    let mut falls = 0;
    for &(at, _) in turned.iter().filter(|turn| !turn.1) {
        if let Some(&(end, _)) = sent.iter().rev().find(|&&(end, _)| end <= at) {
            assert!(at - end < 10_000, "{} ns behind the last stop bit", at - end);
            falls += 1;
        }
    }
    assert!(falls >= 30, "{falls}");
}

#[test]
fn two_seconds_after_the_pcs_last_byte_only_what_turns_endlessly_is_stopped() {
    let mut bench = board(&[1, 2, 3], 1);
    bench.line.send(&write(2, 6, &[0; 4]));
    bench.run_for(60);
    bench.line.send(&read(2, 6, 4));
    bench.run_for(10);
    let last = bench.line.left().last().unwrap().0 + BYTE_NS;
    sent(&bench);
    bench.run_until_ns(last + 1_999_900_000);
    assert_eq!(sent(&bench), []);
    bench.run_for(3000);
    let own = sent(&bench);
    assert_eq!(bytes(&own), [0xFF, 0xFF, 0xFE, 7, 0x83, 32, 2, 2, 0, 0, 0x53]);
    let after = own[0].0 - BYTE_NS - last;
    assert!((2_000_000_000..2_000_200_000).contains(&after), "{after} ns");
    let speeds = [0, 1, 2].map(|servo| register(&bench, servo, Register::MOVING_SPEED));
    assert_eq!(speeds, [300, 0, 300]);
    bench.line.heard();
    // The PC speaks into the board's packet, and waits for its end.
    bench.line.send(&packet(1, Instruction::Ping));
    bench.run_for(1);
    let last = bench.line.left().last().unwrap().0 + BYTE_NS;
    bench.line.send_at(last + 2_000_060_000, &packet(3, Instruction::Ping));
    sent(&bench);
    bench.run_for(2010);
    let left = bench.line.left();
    let on_bus = sent(&bench);
    assert_eq!(bytes(&on_bus)[..11], bytes(&own)[..]);
    assert_eq!(bytes(&on_bus)[11..], bytes(&left)[..]);
    let late = on_bus.last().unwrap().0 - left.last().unwrap().0 - BYTE_NS;
    println!("behind the board's own packet late by {} us", late / 1000);
    assert!(late <= LATE_NS, "{late} ns");
    let heard = bytes(&bench.line.heard());
    assert_eq!(Packet::parse(&heard[6..]).unwrap().id.number(), 3);
}

#[test]
fn a_write_of_another_baud_is_refused() {
    let mut bench = board(&[1], 1);
    bench.line.send(&write(1, 4, &[34]));
    bench.run_for(3);
    let heard = bytes(&bench.line.heard());
    assert_eq!(Packet::parse(&heard).unwrap().code, 0x10, "the checksum error");
    assert_eq!(register(&bench, 0, Register::BAUD_RATE), 1);
}

#[test]
fn a_loop_that_hangs_silences_the_bus_and_the_watchdog_starts_the_board_again() {
    let mut bench = board(&[1], 1);
    bench.run_for(150); // fed more than once, so the watchdog has its usual period
    // `b .`: the thread's executor, and with it all loops.
    let code = bench.patch("send_task_inner_function0E4poll", &[0xE7FE]);
    let begun = bench.now_ns();
    bench.line.send(&packet(1, Instruction::Ping));
    bench.run_for(100);
    sent(&bench);
    bench.line.send(&packet(1, Instruction::Ping));
    bench.run_for(100);
    assert_eq!(sent(&bench), [], "the bus is silent");
    while bench.with(|stand| stand.session.resets().is_empty()) {
        bench.run_for(10);
        assert!(bench.now_ns() - begun < 500_000_000, "nobody restarts it");
    }
    bench.patch("send_task_inner_function0E4poll", &code);
    bench.run_for(100);
    bench.line.heard();
    bench.line.send(&packet(1, Instruction::Ping));
    bench.run_for(2);
    assert_eq!(bench.line.heard().len(), 6);
}
