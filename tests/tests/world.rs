//! A wall to drive towards, and what breaks on the way: the firmware in the virtual board's world.

use firmware::controller::Reason;
use hal_mock::board::Make;
use protocol::extension::Fault;
use protocol::pms5005::{Addressing, Command, Move, Parameter, Quantity};
use tests::Link::Alive;
use tests::{Bench, latched};

/// A vehicle so far before a wall.
fn before(wall_cm: f32) -> Bench {
    let mut make = Make::default();
    make.scene.environment.wall_cm = Some(wall_cm);
    Bench::with(make)
}

/// Both wheels at this velocity.
fn drive(bench: &mut Bench, velocity: i16) {
    let mut targets = [None; 6];
    targets[..2].fill(Some(velocity));
    let (quantity, addressing) = (Quantity::Velocity, Addressing::List);
    bench.send(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
}

fn wall_cm(bench: &Bench) -> f32 {
    bench.board.plant.borrow().wall_cm().expect("a wall")
}

fn reasons(bench: &Bench) -> [Option<Reason>; 2] {
    let channels = bench.board.snapshot().channels;
    [channels[0].reason, channels[1].reason]
}

#[test]
fn the_collision_protection_stops_a_drive_before_the_wall_and_says_why() {
    let mut bench = before(100.0);
    bench.configure(&[Parameter::CollisionProtection(true)]);
    drive(&mut bench, 8000);
    bench.run_alive_ms(1500);
    assert_eq!(reasons(&bench), [None; 2]);
    bench.run_alive_ms(3500);
    // It is blocked at 30 cm, and rolls for some time constants from 32 cm/s.
    let stopped = wall_cm(&bench);
    assert!((24.0..=30.5).contains(&stopped), "{stopped}");
    assert_eq!((bench.velocity(0), bench.velocity(1)), (0.0, 0.0));
    assert_eq!(reasons(&bench), [Some(Reason::Obstacle); 2]);
    assert_eq!(latched(&bench.board.snapshot()), []);

    drive(&mut bench, -4000);
    bench.run_alive_ms(2000);
    assert!(wall_cm(&bench) > stopped + 25.0, "{}", wall_cm(&bench));
    assert_eq!(reasons(&bench), [None; 2]);
}

#[test]
fn without_it_the_wheels_stall_at_the_wall_and_drive_back_when_that_is_cleared() {
    let mut bench = before(30.0);
    drive(&mut bench, 4000);
    let off = bench.until(Alive, 15_000, |bench| latched(&bench.board.snapshot()).len() == 2);
    assert!((6000..10_000).contains(&off), "{off}");
    let stalled = [(Fault::Stall, Some(0)), (Fault::Stall, Some(1))];
    assert_eq!(latched(&bench.board.snapshot()), stalled);
    let stands = wall_cm(&bench);
    assert!((2.9..=3.0).contains(&stands), "{stands}");
    bench.send_raw(protocol::pms5005::did::PARAMETERS, &[0x81]);
    drive(&mut bench, -4000);
    bench.run_alive_ms(2000);
    assert!((28.0..40.0).contains(&wall_cm(&bench)), "{}", wall_cm(&bench));
}

#[test]
fn a_wheel_whose_encoder_is_pulled_is_off_with_fault_4() {
    let mut bench = Bench::new();
    drive(&mut bench, 2000);
    bench.run_alive_ms(1000);
    bench.board.plant.borrow_mut().overrides.unplugged[1] = Some(true);
    bench.until(Alive, 3000, |bench| !bench.bridge(1).1);
    assert_eq!(latched(&bench.board.snapshot()), [(Fault::SensorLost, Some(1))]);
    assert!(bench.bridge(0).1);
}

#[test]
fn a_scene_may_begin_with_a_link_that_is_cut() {
    let mut make = Make::default();
    make.scene.faults.link = false;
    let mut bench = Bench::with(make);
    bench.run_alive_ms(100);
    assert_eq!((bench.received().len(), bench.board.link().frames_ok), (0, 0));
    bench.board.line.cut(false);
    bench.run_alive_ms(100);
    assert!(bench.board.link().frames_ok > 0);
}
