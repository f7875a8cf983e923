//! Which servos the pass-through takes for wheels, and that it stops those alone when the PC is silent.

use super::*;

#[test]
fn two_seconds_after_the_pcs_last_byte_wheels_are_stopped_and_nobody_else_is_sent_anything() {
    let mut pc = Pc::new([1, 2, 3, 200]);
    for id in [2, 200] {
        pc.set_up(&write(id, LIMITS, &ZERO));
    }
    pc.set_up(&write(3, 8, &[0, 1])); // a joint of 256 positions
    let last = ping(1);
    let begun = Instant::now();
    pc.send(&last);
    let silent = begun + Duration::from_micros(BYTE_US * last.len() as u64) + SILENCE;
    pc.0.run_until(silent - Duration::from_micros(1));
    let sent = pc.0.bus.bus().sending_until_ns();
    assert_eq!(pc.counters().stops, 0);
    pc.run_ms(1);
    assert_eq!([0, 1, 2, 3].map(|k| pc.speed(k)), [300, 0, 300, 0]);
    assert_eq!(pc.counters().stops, 2);
    // 14 bytes, and nothing more, however long it takes.
    let stopped = silent.as_micros() * 1000 + 14 * 10_000;
    assert!(sent < stopped);
    assert_eq!(pc.0.bus.bus().sending_until_ns(), stopped);
    pc.run_ms(60_000);
    assert_eq!(pc.0.bus.bus().sending_until_ns(), stopped);
    assert_eq!(pc.heard(), status(1, Errors::NONE, &[]), "the answer to the PING");
    // And again when it has spoken again.
    pc.ask(&write(2, 32, &[44, 1]));
    pc.run_ms(1990);
    assert_eq!(pc.speed(1), 300);
    pc.run_ms(20);
    assert_eq!(pc.speed(1), 0);
}

#[test]
fn a_board_that_has_seen_no_limits_says_nothing() {
    let mut all = turning([1]);
    all[0].set(Register::CCW_LIMIT, 0);
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    pc.ask(&ping(1));
    let sent = pc.0.bus.bus().sending_until_ns();
    pc.run_ms(10_000);
    assert_eq!(pc.speed(0), 300);
    assert_eq!(pc.0.bus.bus().sending_until_ns(), sent);
    // Two reads show them, in halves.
    pc.ask(&read(1, 4, 4));
    pc.run_ms(3000);
    assert_eq!((pc.wheels(), pc.speed(0)), (vec![], 300));
    pc.ask(&read(1, 8, 2));
    pc.run_ms(3000);
    assert_eq!((pc.wheels(), pc.speed(0)), (vec![1], 0));
}

#[test]
fn limits_are_followed_through_whatever_writes_them() {
    let mut pc = Pc::new([1, 2, 3, 4, 5]);
    pc.set_up(&write(2, LIMITS, &ZERO));
    assert_eq!(pc.wheels(), [2]);
    // What nobody answers to is seen when it is read.
    pc.set_up(&sync_write(LIMITS, &[(3, &ZERO), (4, &[0, 0, 255, 3])]));
    assert_eq!(pc.wheels(), [2]);
    pc.ask(&read(3, 0, 50));
    pc.ask(&read(4, LIMITS, 4));
    assert_eq!(pc.wheels(), [2, 3]);
    pc.set_up(&reg_write(4, LIMITS, &ZERO));
    pc.set_up(&packet(BROADCAST, Instruction::Action));
    assert_eq!(pc.wheels(), [2, 3]);
    pc.ask(&read(4, LIMITS, 4));
    assert_eq!(pc.wheels(), [2, 3, 4]);
    // An ACTION to other registers changes nothing.
    pc.set_up(&reg_write(4, 32, &[44, 1]));
    pc.set_up(&packet(BROADCAST, Instruction::Action));
    assert_eq!(pc.wheels(), [2, 3, 4]);
    // Half of them makes a joint, in a packet with others too.
    pc.set_up(&write(2, 5, &[1, 10, 0]));
    assert_eq!(pc.wheels(), [3, 4]);
    pc.set_up(&write(2, 6, &[0, 0]));
    assert_eq!(pc.wheels(), [2, 3, 4]);
    pc.set_up(&sync_write(LIMITS, &[(2, &[10, 0])]));
    assert_eq!(pc.wheels(), [3, 4]);
    pc.set_up(&write(2, 6, &[0, 0]));
    pc.set_up(&write(2, 3, &[9])); // now it is 9
    assert_eq!(pc.wheels(), [3, 4]);
    pc.ask(&read(9, LIMITS, 4));
    assert_eq!(pc.wheels(), [3, 4, 9]);
    pc.set_up(&packet(4, Instruction::Reset)); // now it is 1 too
    assert_eq!(pc.wheels(), [3, 9]);
    pc.run_ms(3000);
    assert_eq!(
        [0, 1, 2, 3, 4].map(|k| pc.speed(k)),
        [300, 0, 0, 0, 300],
        "RESET itself has made it 0"
    );
    let all: Vec<_> = {
        let bus = pc.0.bus.bus();
        bus.servos().map(|(servo, _)| (servo.id(), servo.get(Register::CCW_LIMIT))).collect()
    };
    assert_eq!(all, [(1, 1023), (9, 0), (3, 0), (1, 1023), (5, 1023)], "as the servos have it");
}

#[test]
fn a_write_that_its_servo_refuses_makes_no_wheel_and_leaves_none() {
    let mut all = turning([1, 2]);
    all.iter_mut().for_each(|servo| servo.set(Register::LOCK, 1));
    all[1].set(Register::CCW_LIMIT, 0);
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    assert_eq!(pc.ask(&write(1, LIMITS, &ZERO)), status(1, Errors::RANGE, &[]));
    assert_eq!(pc.wheels(), NOTHING);
    pc.ask(&read(2, LIMITS, 4));
    assert_eq!(pc.ask(&write(2, LIMITS, &[0, 0, 255, 3])), status(2, Errors::RANGE, &[]));
    assert_eq!(pc.wheels(), NOTHING, "until it is read again");
    pc.ask(&read(2, LIMITS, 4));
    assert_eq!(pc.wheels(), [2]);
    // A damaged one is no write at all.
    let mut damaged = write(1, LIMITS, &ZERO);
    *damaged.last_mut().unwrap() ^= 0x80;
    pc.ask(&damaged);
    assert_eq!(pc.wheels(), [2]);
    // Nor is what another servo says an answer.
    pc.send(&read(1, LIMITS, 4));
    pc.run_ms(5);
    pc.0.bus.bus().servo(0).set(Register::CCW_LIMIT, 0);
    pc.ask(&read(1, LIMITS, 3));
    assert_eq!(pc.wheels(), [2]);
}

/// Servos that are joints, and know it better than the board may.
#[test]
fn a_write_of_zero_limits_that_its_servo_has_not_answered_makes_nobody_a_wheel() {
    let mut all = turning([1, 2, 3]);
    all[0].set(Register::LOCK, 1); // takes no limits
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    pc.set_up(&sync_write(LIMITS, &[(1, &ZERO)]));
    pc.set_up(&write(BROADCAST, LIMITS, &[0, 0, 0, 0]));
    assert_eq!(pc.wheels(), NOTHING);
    // One that is not heard, because the servo is busy with its EEPROM.
    let mut pc = Pc::new([1, 2]);
    pc.send(&write(1, 5, &[1]));
    pc.run_us(500);
    pc.send(&write(1, LIMITS, &ZERO));
    pc.run_ms(2100);
    assert_eq!(pc.heard(), status(1, Errors::NONE, &[]), "to the first");
    assert_eq!((pc.wheels(), pc.speed(0)), (vec![], 300));
    // One that does not say whether it obeys.
    pc.set_up(&write(1, 16, &[1]));
    pc.set_up(&write(1, LIMITS, &ZERO));
    assert_eq!(pc.wheels(), NOTHING);
    pc.ask(&read(1, LIMITS, 4));
    assert_eq!(pc.wheels(), [1]);
}

#[test]
fn an_answer_to_an_earlier_instruction_is_none_to_the_last() {
    let mut all = turning([1]);
    all[0].set(Register::RETURN_DELAY, 250);
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    // A joint at rest: no speed, no load. It hears nothing before it has answered.
    for hasty in [read(1, LIMITS, 4), write(1, 30, &[0, 2])] {
        pc.send(&read(1, 38, 4));
        pc.run_us(250);
        pc.send(&hasty);
        pc.run_ms(5);
        assert_eq!(pc.heard(), status(1, Errors::NONE, &ZERO));
        assert_eq!(pc.wheels(), NOTHING);
    }
    pc.send(&[read(1, 38, 4), read(1, LIMITS, 4)].concat());
    pc.run_ms(2100);
    assert_eq!((pc.heard(), pc.wheels()), (status(1, Errors::NONE, &ZERO), vec![]));
    pc.send(&ping(1));
    pc.run_us(250);
    pc.send(&write(1, LIMITS, &ZERO));
    pc.run_ms(2100);
    assert_eq!((pc.wheels(), pc.speed(0)), (vec![], 300));
}

#[test]
fn whoever_may_have_been_given_an_id_is_no_wheel_until_it_is_seen() {
    let mut all = turning([1, 9]);
    all[0].set(Register::CCW_LIMIT, 0);
    all[0].set(Register::LOCK, 1);
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    pc.ask(&read(1, LIMITS, 4));
    assert_eq!(pc.wheels(), [1]);
    assert_eq!(pc.ask(&write(1, 3, &[9])), status(1, Errors::RANGE, &[]));
    pc.run_ms(2100);
    assert!(!pc.wheels().contains(&9));
    assert_eq!(pc.speed(1), 300, "a joint");
}

#[test]
fn an_action_makes_a_wheel_a_joint_however_often_it_is_said() {
    let mut all = turning([1]);
    all[0].set(Register::CCW_LIMIT, 0);
    let mut pc = Pc::with(Make { servos: all, ..Make::default() });
    pc.ask(&reg_write(1, LIMITS, &[0, 0, 255, 3]));
    pc.send(&write(1, 5, &[1]));
    pc.run_us(500);
    pc.ask(&packet(BROADCAST, Instruction::Action)); // it is busy, and does not hear it
    pc.run_ms(20);
    pc.ask(&read(1, LIMITS, 4));
    assert_eq!(pc.wheels(), [1]);
    pc.set_up(&packet(BROADCAST, Instruction::Action));
    assert_eq!(pc.0.bus.bus().servo(0).get(Register::CCW_LIMIT), 1023);
    assert_eq!(pc.wheels(), NOTHING);
}

#[test]
fn what_the_pc_has_left_unfinished_is_not_mixed_with_the_boards_own_packet() {
    for part in 1..12 {
        let mut pc = Pc::new([1, 2]);
        pc.set_up(&write(1, LIMITS, &ZERO));
        pc.send(&write(2, 30, &[0, 1, 100, 0])[..part.min(10)]);
        if part == 11 {
            pc.send(&[0xFF, 0xFF, 0xFF, 2, 250]);
        }
        pc.run_ms(2100);
        assert_eq!(pc.speed(0), 0, "{part} bytes");
        // Nor with what it says next.
        pc.heard();
        assert_eq!(pc.ask(&ping(2)), status(2, Errors::NONE, &[]), "{part} bytes");
        pc.ask(&write(2, LIMITS, &ZERO));
        assert_eq!(pc.wheels(), [1, 2]);
    }
}

#[test]
fn a_pc_that_speaks_while_the_board_does_is_late_by_200_us_at_the_most_and_stops_it() {
    let mut latest = 0;
    for phase in (0..500).step_by(3) {
        let mut pc = Pc::new([1, 2, 3, 4, 5, 6]);
        for id in 1..=5 {
            pc.set_up(&write(id, LIMITS, &ZERO));
        }
        let spoke = Instant::now();
        pc.send(&ping(6));
        let asked = ping(6);
        // The board begins 2 s after the PING's last byte; its three packets take 140, 140 and 110 us.
        let begin = spoke + Duration::from_micros(60) + SILENCE - Duration::from_micros(80);
        pc.0.run_until(begin + Duration::from_micros(phase));
        pc.heard();
        let left_pc = Instant::now().as_micros() + BYTE_US * asked.len() as u64;
        assert_eq!(pc.ask(&asked), status(6, Errors::NONE, &[]), "{phase}");
        let left = pc.0.bus.bus().sending_until_ns() / 1000;
        latest = latest.max(left - left_pc);
        let stopped = (0..5).filter(|&k| pc.speed(k) == 0).count();
        assert_eq!(stopped, pc.counters().stops as usize);
        assert_eq!(stopped, [0, 2, 4, 5][stopped.div_ceil(2)], "whole packets, in order");
        // What is left, when it is silent again.
        pc.run_ms(1980);
        assert_eq!((0..5).filter(|&k| pc.speed(k) == 0).count(), stopped);
        pc.run_ms(30);
        assert_eq!((0..6).map(|k| pc.speed(k)).collect::<Vec<_>>(), [0, 0, 0, 0, 0, 300]);
        assert_eq!(pc.counters().collisions, 0);
    }
    println!("late by {latest} us at the most");
    assert!((150..=200).contains(&latest), "{latest} us");
}

#[test]
fn only_the_answer_that_was_asked_for_makes_a_wheel() {
    let wheels_after = |asked: &[u8], echo: &[u8], answer: &[u8]| {
        let mut pass = PassThrough::new();
        let at = |us: u64| Instant::from_micros(1_000_000 + us);
        pass.receive(&mut asked.to_vec(), at(0));
        pass.bus_hears(echo, at(100));
        pass.bus_hears(answer, at(400));
        assert!(pass.has_answers(), "whatever it is, the PC hears it");
        pass.wheels().collect::<Vec<_>>()
    };
    let ok = |params| status(1, Errors::NONE, params);
    let (reads, writes) = (read(1, LIMITS, 4), write(1, LIMITS, &ZERO));
    assert_eq!(wheels_after(&reads, &reads, &ok(&ZERO)), [1]);
    assert_eq!(wheels_after(&writes, &writes, &ok(&[])), [1]);
    let alarmed = status(1, Errors::OVERHEAT | Errors::ANGLE, &[]);
    assert_eq!(wheels_after(&writes, &writes, &alarmed), [1], "it obeys all the same");
    let mut damaged = ok(&ZERO);
    *damaged.last_mut().unwrap() ^= 1;
    let refused = status(1, Errors::CHECKSUM, &ZERO);
    for answer in [damaged, refused, status(2, Errors::NONE, &ZERO), ok(&[0; 3]), ok(&[0; 5])] {
        assert_eq!(wheels_after(&reads, &reads, &answer), NOTHING, "{answer:?}");
    }
    assert_eq!(wheels_after(&writes, &writes, &ok(&ZERO)), NOTHING);
    let to_all = read(BROADCAST, LIMITS, 4);
    assert_eq!(wheels_after(&to_all, &to_all, &ok(&ZERO)), NOTHING);
    // After a collision nobody knows what was heard.
    assert_eq!(wheels_after(&reads, &[0x55; 8], &ok(&ZERO)), NOTHING);
    assert_eq!(wheels_after(&writes, &writes[..10], &ok(&[])), NOTHING);
}
