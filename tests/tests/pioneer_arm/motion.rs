//! Joints, power, parking, and the two timers.

use super::*;
use firmware::controller::{Controller, Snapshot};
use firmware::personality::{Boot, Effect, Session};
use firmware::ports::{MotionInputs, Sensors};
use firmware::settings::Settings;
use protocol::extension::{Action, Verdict};

#[test]
fn at_20_ms_a_step_a_joint_moves_50_ticks_in_a_second() {
    let mut host = Host::powered();
    host.speed(1, 20);
    host.run_ms(5);
    host.go(1, 227);
    let arrived = host.until(Alive, 1200, |host| host.pulses()[0] >= Some(pulse(177)));
    assert!((980..=1020).contains(&arrived), "{arrived} ms");
    // The simulated servo follows.
    host.run_alive_ms(1200);
    assert_eq!(host.ticks(1), 227);
    assert!((host.servo(1) - f32::from(pulse(227))).abs() < 1.0);
}

#[test]
fn every_joint_has_its_own_speed_and_all_move_together() {
    let mut host = Host::powered();
    for (joint, ms) in (1..=6).zip([5, 10, 20, 40, 80, 127]) {
        host.speed(joint, ms);
        host.go(joint, 255);
    }
    host.run_alive_ms(400);
    // 400 ms and what the commands took on the line (10 ms).
    let driven = host.pulses().map(Option::unwrap);
    let told = host.status_bytes();
    let later = host.pulses().map(Option::unwrap);
    for (i, ms) in [5, 10, 20, 40, 80, 127].into_iter().enumerate() {
        let expected = 127 + (400 / ms) as u8;
        let about = pulse(expected - 2)..=pulse(expected + 2);
        assert!(about.contains(&driven[i]), "joint {}: {driven:?}", i + 1);
        // The last tick that it had reached some time in these 10 ms.
        let ticks = told[2 + i];
        assert!(pulse(ticks + 1) > driven[i] && pulse(ticks) <= later[i], "{told:?}");
    }
}

#[test]
fn without_power_there_are_no_pulses_and_power_up_is_at_home() {
    let mut host = Host::opened();
    host.run_alive_ms(500);
    assert_eq!(host.pulses(), NO_PULSES);
    host.power_up();
    assert_eq!((host.pulses(), host.arm().positions), (AT_HOME, [127; 6]));
    // Off and on again where it stands: at home.
    host.send(ArmCommand::Power(false));
    host.run_ms(5);
    assert_eq!((host.pulses(), host.arm().powered), (NO_PULSES, false));
    host.power_up();
    assert_eq!(host.pulses(), AT_HOME);
}

#[test]
fn no_joint_ever_jumps() {
    let mut host = Host::opened();
    let mut watch = NoJump::new(&host);
    let script: [&dyn Fn(&mut Host); 12] = [
        &|host| host.send(ArmCommand::Power(true)),
        &|host| (1..=6).for_each(|joint| host.speed(joint, 0)),
        &|host| (1..=6).for_each(|joint| host.go(joint, 255)),
        &|host| (1..=6).for_each(|joint| host.go(joint, 0)),
        &|host| host.send(ArmCommand::Stop(ALL)),
        &|host| host.send(ArmCommand::Home(ALL)),
        &|host| (1..=6).for_each(|joint| host.go(joint, 20)),
        &|host| host.send(ArmCommand::Park),
        &|host| host.send(ArmCommand::Power(true)),
        &|host| (1..=6).for_each(|joint| host.go(joint, 230)),
        &|host| host.send(ArmCommand::Power(false)),
        &|host| host.send(ArmCommand::Init),
    ];
    for pause in [1, 7, 60, 800] {
        for act in script {
            act(&mut host);
            host.run_alive_with(pause, |host| watch.look(host));
        }
        host.run_alive_with(1000, |host| watch.look(host));
    }
    assert!(host.link().limited >= 24, "a speed of 0 is 1");
    assert!(watch.steps > 5000, "{} steps without a jump", watch.steps);
}

#[test]
fn power_and_a_position_in_one_write_are_no_jump_either() {
    let mut host = Host::opened();
    host.run_ms(1);
    let mut watch = NoJump::new(&host);
    let mut both = Vec::new();
    for command in [ArmCommand::Power(true), ArmCommand::Position { joint: number(1), ticks: 0 }] {
        both.extend_from_slice(command.encode(&mut [0; 9]).unwrap());
    }
    host.speed(1, 1);
    host.send_bytes(&both);
    // The way of 127 ticks begins when the pulses are there.
    let mut arrived = 0;
    while host.pulses()[0] != Some(pulse(0)) && arrived < 200 {
        host.run_alive_with(1, |host| watch.look(host));
        arrived += 1;
    }
    assert!((127..=135).contains(&arrived), "{arrived} ms");
}

#[test]
fn a_new_speed_counts_at_once_for_a_joint_on_its_way_too() {
    let mut host = Host::powered();
    host.go(1, 227);
    host.run_alive_ms(1010);
    host.speed(1, 2);
    // Another half of the way, ten times as fast.
    let arrived = host.until(Alive, 200, |host| host.pulses()[0] == Some(pulse(227)));
    assert!((95..=105).contains(&arrived), "{arrived} ms");
}

#[test]
fn a_way_is_one_command_and_the_session_looks_at_it_no_more_than_every_20_ms() {
    let start = Instant::from_secs(1);
    let mut session = PioneerArm::new(Settings::DEFAULT, Boot::default(), start);
    let mut controller = Controller::new(Settings::DEFAULT.control);
    let mut snapshot = Snapshot::BOOT;
    let sensors = Sensors { gpio_in: 0xFE, ..Sensors::UNKNOWN };
    let mut bytes = Vec::new();
    for sync in SYNC {
        bytes.extend_from_slice(Packet { id: sync.id, data: &[] }.encode(&mut [0; 6]).unwrap());
    }
    bytes.extend_from_slice(encode_command(command::OPEN, None, &mut [0; 9]).unwrap());
    bytes.extend_from_slice(ArmCommand::Power(true).encode(&mut [0; 9]).unwrap());
    let (mut commands, mut looks) = (0, 0);
    for ms in 0..1200 {
        let now = start + Duration::from_millis(ms);
        if ms == 100 {
            let go = ArmCommand::Position { joint: number(1), ticks: 177 };
            bytes.extend_from_slice(go.encode(&mut [0; 9]).unwrap());
            (commands, looks) = (0, 0);
        }
        let mut queue = Vec::new();
        let mut received = &bytes[..];
        while session.receive(&mut received, now).is_some() {}
        bytes.clear();
        if session.wakes_at().is_some_and(|at| at <= now) {
            looks += 1;
            while let Some(Effect::Control(command)) = session.advance(now, || snapshot) {
                queue.push(command);
            }
        }
        commands += queue.len();
        let life = session.signs_of_life();
        snapshot = *controller.step(queue, || None, &MotionInputs::default(), &sensors, life);
    }
    assert_eq!(snapshot.outputs.servos[0].map(|pulse| pulse.raw()), Some(pulse(177)));
    assert_eq!(session.counters().arm.positions[0], 177);
    assert_eq!(commands, 1);
    assert!((50..60).contains(&looks), "{looks} in 1.1 s");
}

#[test]
fn a_save_that_is_refused_on_the_way_does_not_hold_a_joint_up() {
    let mut host = Host::powered();
    host.speed(1, 5);
    host.go(1, 227);
    host.run_alive_ms(100);
    assert_eq!(host.act(Action::Save), Verdict::OutputsOn);
    let arrived = host.until(Alive, 500, |host| host.pulses()[0] == Some(pulse(227)));
    assert!((355..=365).contains(&arrived), "{arrived} ms");
}

#[test]
fn positions_are_limited_to_what_a_joint_reaches() {
    let mut make = Make::default();
    make.settings.arm.joints[1].min = 100;
    make.settings.arm.joints[1].max = 140;
    let mut host = Host::with(make);
    host.open();
    host.send(ArmCommand::Power(true));
    host.speed(2, 1);
    for (asked, reached, limited) in [(0, 100, 1), (255, 140, 2), (141, 140, 3), (140, 140, 3)] {
        host.go(2, asked);
        host.run_alive_ms(100);
        assert_eq!((host.ticks(2), host.link().limited), (reached, limited), "POS {asked}");
        assert_eq!(host.pulses()[1], Some(pulse(reached)));
    }
}

#[test]
fn home_is_for_one_joint_or_for_all() {
    let mut host = Host::powered();
    let away = |host: &mut Host| {
        for joint in 1..=6 {
            host.speed(joint, 1);
            host.go(joint, 147);
        }
        host.run_alive_ms(100);
        assert_eq!(host.arm().positions, [147; 6]);
    };
    away(&mut host);
    host.send_int(75, 3);
    host.run_alive_ms(100);
    assert_eq!(host.arm().positions, [147, 147, 127, 147, 147, 147]);
    for all in [7, 255] {
        away(&mut host);
        host.send_int(75, all);
        host.run_alive_ms(100);
        assert_eq!((host.arm().positions, host.arm().powered), ([127; 6], true), "HOME {all}");
    }
}

#[test]
fn stop_is_for_one_joint_or_for_all_and_they_stay_where_they_are() {
    let mut host = Host::powered();
    for joint in 1..=6 {
        host.go(joint, 227);
    }
    host.run_alive_ms(500);
    host.send_int(79, 2);
    host.run_alive_ms(500);
    let moving = host.arm().moving;
    assert_eq!(moving, [true, false, true, true, true, true]);
    assert!((150..=152).contains(&host.ticks(2)) && host.ticks(1) >= 175);
    host.send_int(79, 255);
    host.run_ms(5);
    let stopped = host.arm().positions;
    host.run_alive_ms(500);
    assert_eq!((host.arm().positions, host.arm().moving), (stopped, [false; 6]));
    assert_eq!(host.pulses(), stopped.map(|ticks| Some(pulse(ticks))), "they are held");
}

#[test]
fn park_and_power_0_take_the_joints_home_before_power_goes_off() {
    for command in [ArmCommand::Park, ArmCommand::Power(false)] {
        let mut host = Host::powered();
        host.speed(1, 5);
        host.go(1, 227);
        host.run_alive_ms(600);
        host.send(command);
        // At the joint's own speed: 100 ticks of 5 ms; then the servos settle.
        host.see(
            Alive,
            |host| (host.arm().powered, host.arm().homing),
            [(490, (true, true)), (550, (true, false)), (570, (false, false))],
        );
        assert_eq!((host.pulses(), host.arm().positions), (NO_PULSES, [127; 6]), "{command:?}");
    }
}

/// From PARK to power-off, in ms. Whatever the servos were told, they are at home then, and stay
/// there when power comes back.
fn park_and_power_up(host: &mut Host, home: u8) -> u64 {
    let all_at_home = |host: &Host| {
        for (i, servo) in host.servos().into_iter().enumerate() {
            let short = (servo - f32::from(pulse(home))) / 16.07;
            assert!(short.abs() < 0.1, "servo {} is {short} ticks from home {home}", i + 1);
        }
    };
    host.send(ArmCommand::Park);
    let took = host.until(Alive, 6000, |host| !host.arm().powered);
    all_at_home(host);
    host.run_alive_ms(50);
    host.send(ArmCommand::Power(true));
    host.run_alive_with(100, all_at_home);
    assert_eq!(host.pulses(), [Some(pulse(home)); JOINTS]);
    took
}

/// An arm with power, all its homes at `home`.
fn powered_with_home(home: u8) -> Host {
    let mut make = Make::default();
    make.settings.arm.joints.iter_mut().for_each(|joint| joint.home = home);
    let mut host = Host::with(make);
    host.open();
    host.send(ArmCommand::Power(true));
    // Simulated servos stand at 127 before their first pulse.
    host.run_alive_ms(1000);
    host
}

#[test]
fn servos_that_are_slower_than_their_joints_are_at_home_when_power_goes_off() {
    for (home, ms_per_tick) in
        [127, 0, 255].into_iter().flat_map(|home| [1, 2, 20].map(|ms| (home, ms)))
    {
        for end in [0, 255] {
            let mut host = powered_with_home(home);
            for joint in 1..=6 {
                host.speed(joint, ms_per_tick);
                host.go(joint, end);
            }
            host.run_alive_ms(6000);
            let took = park_and_power_up(&mut host, home);
            // No sooner than the steps, no later than servos of half the simulated ones' rate:
            // 140 ticks in 450 ms. The pulses settle in 60 ms, PARK is on the line for 1.
            let ticks = u64::from(home.abs_diff(end));
            let (steps, slew) = (ticks * ms_per_tick as u64, ticks * 450 / 140);
            let what = format!("{took} ms from {end} to {home} at SPEED {ms_per_tick}");
            let most = if ticks == 0 { 5 } else { steps.max(slew) + 70 };
            assert!((steps..=most).contains(&took), "{what}");
            // Twice the simulated servo's time is the assumption, and it is used.
            assert!(took + 2 >= slew, "{what}");
        }
    }
}

#[test]
fn a_park_in_mid_move_and_after_a_long_chase_ends_with_the_servos_at_home() {
    for (chases, parks_after) in
        [0, 1, 20].into_iter().flat_map(|n| [5, 64, 125, 135, 255].map(|ms| (n, ms)))
    {
        let mut host = powered_with_home(127);
        (1..=6).for_each(|joint| host.speed(joint, 1));
        (1..=6).for_each(|joint| host.go(joint, 255));
        host.run_alive_ms(1000);
        // Each time the joints arrive the servos are far behind.
        for end in [0, 255].repeat(chases) {
            (1..=6).for_each(|joint| host.go(joint, end));
            host.run_alive_ms(256);
        }
        (1..=6).for_each(|joint| host.go(joint, 0));
        host.run_alive_ms(parks_after);
        // However long they were chased, they are never further than from end to end.
        let took = park_and_power_up(&mut host, 127);
        assert!(took <= 128 + 255 * 450 / 140 + 70, "{took} ms");
    }
}

#[test]
fn until_power_is_off_the_latest_command_counts() {
    let calls_off: [&dyn Fn(&mut Host); 3] = [
        &|host| host.send(ArmCommand::Power(true)),
        &|host| host.send(ArmCommand::Stop(ALL)),
        &|host| host.go(2, 140),
    ];
    for (i, act) in calls_off.into_iter().enumerate() {
        let mut host = Host::powered();
        host.go(1, 157);
        host.run_alive_ms(700);
        host.send(ArmCommand::Park);
        host.run_alive_ms(100);
        act(&mut host);
        host.run_alive_ms(2000);
        assert!(host.arm().powered, "{i}");
        // STOP holds joint 1 where it was then; the others let it go home.
        let at = host.ticks(1);
        assert!(if i == 1 { (150..=153).contains(&at) } else { at == 127 }, "{i}: {at}");
    }
}

#[test]
fn speeds_are_taken_without_power_and_survive_power_and_sessions() {
    let mut host = Host::opened();
    host.speed(1, 5);
    host.run_ms(5);
    host.send(ArmCommand::Power(true));
    host.send(ArmCommand::Park);
    host.run_ms(5);
    host.send_bare(command::CLOSE);
    host.run_ms(100);
    host.received();
    host.open();
    host.send(ArmCommand::Power(true));
    host.go(1, 227);
    host.run_alive_ms(250);
    let now = host.pulses()[0];
    assert!((Some(pulse(176))..=Some(pulse(178))).contains(&now), "{now:?}");
    assert_eq!(host.link().ignored, 0);
}

#[test]
fn an_idle_arm_parks_itself_after_ten_minutes_and_every_arm_command_starts_them_anew() {
    let mut host = Host::powered();
    host.go(1, 147);
    host.run_alive_ms(300_000);
    host.send(ArmCommand::Status(StatusRequest::Once));
    host.run_alive_ms(599_900);
    assert_eq!(host.ticks(1), 147);
    let seen = |host: &Host| (host.arm().powered, host.arm().homing);
    host.see(Alive, seen, [(0, (true, false)), (200, (true, true)), (700, (false, false))]);
    assert_eq!(host.ticks(1), 127);
}

#[test]
fn an_arm_on_its_way_is_not_idle() {
    let mut host = Host::powered();
    host.speed(1, 100);
    host.send(ArmCommand::AutoPark(2));
    host.go(1, 177);
    // 5 s on the way, 2 s at rest.
    let seen = |host: &Host| (host.arm().homing, host.ticks(1) == 177);
    host.see(Alive, seen, [(6900, (false, true)), (7100, (true, true))]);
}

#[test]
fn autopark_is_in_seconds_and_0_is_never() {
    let mut host = Host::powered();
    host.send(ArmCommand::AutoPark(3));
    // It is at home already.
    host.see(Alive, |host| host.arm().powered, [(2950, true), (3050, false)]);

    host.send(ArmCommand::Power(true));
    host.send(ArmCommand::AutoPark(0));
    host.run_alive_ms(3_600_000);
    assert!(host.arm().powered);
}

#[test]
fn a_gripper_that_is_closed_for_too_long_goes_home_alone() {
    let mut host = Host::powered();
    host.speed(6, 1);
    host.send(ArmCommand::GripPark(3));
    // Towards its maximum it is open, and may stay so.
    host.go(6, 177);
    host.go(1, 147);
    host.run_alive_ms(5000);
    assert_eq!((host.ticks(6), host.ticks(1)), (177, 147));
    // Repeating the command that closes it does not help its servo.
    host.go(6, 77);
    for _ in 0..28 {
        host.run_alive_ms(100);
        host.go(6, 77);
    }
    host.run_alive_ms(200);
    assert_eq!(host.ticks(6), 77);
    host.run_alive_ms(200);
    assert!(host.arm().homing && host.ticks(6) > 77);
    // Slowly: 50 ticks of 20 ms.
    host.run_alive_ms(700);
    assert!(host.ticks(6) < 127);
    host.run_alive_ms(400);
    assert_eq!((host.ticks(6), host.ticks(1), host.arm().powered), (127, 147, true));

    // Closed again, it has its time again.
    host.go(6, 77);
    host.run_alive_ms(2900);
    assert_eq!(host.ticks(6), 77);

    // 0 is never, and 300 s is what holds unless a host says otherwise.
    host.send(ArmCommand::GripPark(0));
    host.go(6, 77);
    host.run_alive_ms(400_000);
    assert_eq!(host.ticks(6), 77);
    let mut host = Host::powered();
    host.go(6, 117);
    host.see(Alive, |host| host.ticks(6), [(299_900, 117), (300_900, 127)]);
}

#[test]
fn the_host_may_stop_or_send_back_a_gripper_that_goes_home_and_its_time_begins_anew() {
    let closing = |host: &mut Host| {
        host.speed(6, 1);
        host.send(ArmCommand::GripPark(3));
        host.go(6, 27);
        host.run_alive_ms(3300);
        assert!(host.arm().homing && (30..50).contains(&host.ticks(6)), "{}", host.ticks(6));
    };
    for all_or_one in [255, 6] {
        let mut host = Host::powered();
        closing(&mut host);
        host.send_int(command::STOP, all_or_one);
        host.run_alive_ms(5);
        let stopped = host.ticks(6);
        host.run_alive_ms(2900);
        assert_eq!((host.ticks(6), host.arm().moving), (stopped, [false; 6]));
        host.run_alive_ms(200);
        assert!(host.arm().homing, "closed for three seconds more");
    }

    let mut host = Host::powered();
    closing(&mut host);
    host.go(6, 27);
    // At SPEED 1 again.
    let seen = |host: &Host| (host.arm().homing, host.ticks(6) == 27);
    host.see(Alive, seen, [(100, (false, true)), (2900, (false, true)), (3100, (true, false))]);
    // One that is on its way open is held closed by nobody.
    let mut host = Host::powered();
    host.speed(6, 1);
    host.send(ArmCommand::GripPark(3));
    host.go(6, 27);
    host.run_alive_ms(1500);
    host.speed(6, 40);
    host.go(6, 177);
    host.run_alive_ms(8000);
    assert_eq!(host.ticks(6), 177);
}
