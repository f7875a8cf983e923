//! What is not done: every command with the wrong joint, the wrong value, the wrong argument or
//! none; and chaos, in which no joint jumps and no power goes off in mid-air.

use super::*;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

/// An arm with power and joint 1 at 137, so that whatever is carried out would show.
fn ready() -> Host {
    let mut host = Host::powered();
    host.go(1, 137);
    host.run_alive_ms(300);
    assert_eq!(host.ticks(1), 137);
    host
}

#[test]
fn commands_that_say_something_wrong_are_counted_and_change_nothing() {
    let positive = |value| Some(Argument::Positive(value));
    let mut wrong = Vec::new();
    let needs_an_argument = [
        command::STATUS,
        command::POWER,
        command::HOME,
        command::POS,
        command::SPEED,
        command::STOP,
        command::AUTOPARK,
        command::GRIPPARK,
    ];
    for number in needs_an_argument {
        wrong.push((number, None));
        wrong.push((number, Some(Argument::Negative(1))));
        wrong.push((number, Some(Argument::Text(b"\x01"))));
    }
    let joint = |number: u16, low: u16| positive(256 * number + low);
    for bad in [0, 7, 255] {
        wrong.push((command::POS, joint(bad, 10)));
        wrong.push((command::SPEED, joint(bad, 10)));
    }
    wrong.extend([0, 7, 254, 256].map(|value| (command::STOP, positive(value))));
    wrong.push((command::HOME, positive(0)));
    wrong.extend([3, 255, 256].map(|value| (command::STATUS, positive(value))));
    wrong.extend([2, 256].map(|value| (command::POWER, positive(value))));

    for (number, argument) in wrong {
        let mut host = ready();
        let (before, pulses) = (host.link(), host.pulses());
        host.received();
        host.send_bytes(encode_command(number, argument, &mut [0; 20]).unwrap());
        host.run_ms(500);
        let link = host.link();
        let what = format!("{number} with {argument:?}");
        assert_eq!((link.link.refused - before.link.refused, host.pulses()), (1, pulses), "{what}");
        assert_eq!((link.arm, link.ignored, link.limited), (before.arm, 0, 0), "{what}");
        assert_eq!(host.ids(), [Standard::ID; 5], "{what}");
    }
}

#[test]
fn arguments_that_are_none_are_refused_where_one_is_needed() {
    for data in [&[0x3B][..], &[0x3B, 1], &[0x3B, 1, 0, 0], &[0xAA, 1, 0]] {
        let mut host = ready();
        let packet = Packet { id: command::HOME, data };
        host.send_bytes(packet.encode(&mut [0; 20]).unwrap());
        host.run_ms(500);
        assert_eq!((host.link().link.refused, host.ticks(1)), (1, 137), "{data:02x?}");
    }
}

#[test]
fn an_argument_that_a_command_does_not_take_is_not_looked_at() {
    for argument in [Argument::Positive(9), Argument::Negative(9), Argument::Text(b"x")] {
        let mut host = ready();
        host.send_bytes(encode_command(command::PARK, Some(argument), &mut [0; 20]).unwrap());
        host.run_ms(500);
        assert_eq!((host.link().link.refused, host.arm().powered), (0, false), "{argument:?}");
    }
}

#[test]
fn without_power_nothing_moves_and_what_would_is_counted() {
    let mut host = Host::opened();
    host.send(ArmCommand::Home(ALL));
    host.go(1, 200);
    host.send(ArmCommand::Stop(ALL));
    host.run_alive_ms(1000);
    assert_eq!((host.link().ignored, host.pulses()), (3, NO_PULSES));
    assert_eq!(host.arm().positions, [127; 6]);
    // What is so already is no refusal.
    host.send(ArmCommand::Park);
    host.send(ArmCommand::Power(false));
    host.run_alive_ms(100);
    assert_eq!(host.link().ignored, 3);
    // What was asked without power is not made up for.
    host.send(ArmCommand::Power(true));
    host.run_alive_ms(1000);
    assert_eq!(host.pulses(), AT_HOME);
}

#[test]
fn speeds_are_limited_to_1_to_127_and_counted() {
    let mut host = Host::opened();
    for (asked, limited) in [(0, 1), (1, 1), (127, 1), (128, 2), (255, 3)] {
        host.speed(1, asked);
        host.run_ms(10);
        assert_eq!(host.link().limited, limited, "SPEED {asked}");
    }
}

/// What happens to an arm.
#[derive(Clone, Debug)]
enum Event {
    Command(ArmCommand),
    Packet(u8, Vec<u8>),
    Noise(Vec<u8>),
    Connected(bool),
    /// The servos' battery is low, or good.
    Battery(bool),
    Silence(u64),
    Alive(u64),
    /// All joints to here, each faster than its servo; after so many ms home, and power off.
    RushAndPark(u8, u64),
    Open,
}

fn event() -> impl Strategy<Value = Event> {
    let joint = || select(JointNumber::ALL.to_vec());
    let joints = || prop_oneof![Just(Joints::All), joint().prop_map(Joints::One)];
    let arm_command = prop_oneof![
        2 => Just(ArmCommand::Power(true)),
        4 => (joint(), any::<u8>()).prop_map(|(joint, ticks)| ArmCommand::Position { joint, ticks }),
        3 => (joint(), 0u8..10)
            .prop_map(|(joint, ms_per_tick)| ArmCommand::Speed { joint, ms_per_tick }),
        1 => joints().prop_map(ArmCommand::Home),
        1 => joints().prop_map(ArmCommand::Stop),
        1 => select(vec![
            ArmCommand::Park,
            ArmCommand::Power(false),
            ArmCommand::Init,
            ArmCommand::Check,
            ArmCommand::AutoPark(1),
            ArmCommand::GripPark(1),
            ArmCommand::Status(StatusRequest::Stream),
            ArmCommand::Info,
        ]),
    ];
    prop_oneof![
        12 => arm_command.prop_map(Event::Command),
        1 => (65u8..85, vec(any::<u8>(), 0..5)).prop_map(|(id, data)| Event::Packet(id, data)),
        1 => vec(select(vec![0xFA, 0xFB, 3, 6, 70, 0]), 0..20).prop_map(Event::Noise),
        1 => any::<bool>().prop_map(Event::Connected),
        1 => any::<bool>().prop_map(Event::Battery),
        1 => (1u64..3000).prop_map(Event::Silence),
        6 => (1u64..1500).prop_map(Event::Alive),
        2 => (any::<u8>(), 1u64..1000).prop_map(|(ticks, ms)| Event::RushAndPark(ticks, ms)),
        1 => Just(Event::Open),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn in_chaos_no_joint_jumps_and_power_goes_off_only_at_home(events in vec(event(), 1..150)) {
        let mut host = Host::opened();
        let mut watch = NoJump::new(&host);
        let mut look = |host: &Host| {
            watch.look(host);
            let (link, arm) = (host.link(), host.link().arm);
            assert!(arm.powered || arm.moving == [false; 6]);
            assert!(arm.powered || link.power_lost > 0 || arm.positions == [127; 6]);
            assert!(!arm.initialised || arm.connected);
            assert!(!arm.good || arm.connected);
        };
        for event in events {
            match event {
                Event::Command(command) => host.send(command),
                Event::Packet(id, data) => {
                    host.send_bytes(Packet { id, data: &data }.encode(&mut [0; 20]).unwrap());
                }
                Event::Noise(bytes) => host.send_bytes(&bytes),
                Event::Connected(connected) => host.connect(connected),
                Event::Battery(good) => {
                    let battery = (!good).then_some(1700);
                    host.board.plant.borrow_mut().overrides.battery[2] = battery;
                }
                Event::Silence(ms) => host.run_with(Silent, ms, &mut look),
                Event::Alive(ms) => host.run_alive_with(ms, &mut look),
                Event::RushAndPark(ticks, ms) => {
                    for joint in 1..=6 {
                        host.speed(joint, 1);
                        host.go(joint, ticks);
                    }
                    host.run_alive_with(ms, &mut look);
                    host.send(ArmCommand::Park);
                }
                Event::Open => {
                    host.open_blindly();
                }
            }
        }
        // When the host has gone, the arm comes to rest and holds; parked it is off after 255 ticks
        // of 20 ms.
        host.run_with(Silent, 8000, &mut look);
        prop_assert_eq!(host.arm().moving, [false; 6]);
        host.open_blindly();
        host.send_bare(command::CLOSE);
        host.run_with(Silent, 8000, &mut look);
        prop_assert_eq!((host.arm().powered, host.pulses()), (false, NO_PULSES));
        // And it can be had again, each joint where it lost its power.
        host.connect(true);
        host.board.plant.borrow_mut().overrides.battery[2] = None;
        host.received();
        host.open();
        host.run_alive_with(30, &mut look);
        host.send(ArmCommand::Init);
        host.run_alive_with(710, &mut look);
        host.send(ArmCommand::Power(true));
        host.run_alive_with(5, &mut look);
        prop_assert_eq!(host.pulses(), host.arm().positions.map(|ticks| Some(pulse(ticks))));
        prop_assert!(host.link().power_lost > 0 || host.pulses() == AT_HOME);
    }
}
