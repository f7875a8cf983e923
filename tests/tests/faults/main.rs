//! Every fault: its cause, how long until nothing is driven (not later, and not sooner), its
//! record, what a host must do to go on; and its near miss, which must not trip.
//!
//! - `channel`: over-current, overload, stall, tracking error, lost sensor, a current input that
//!   floats, soft limits;
//! - `board`: batteries, temperatures, control periods, and what is only on record;
//! - `settings`: every threshold and time moves its fault.

mod board;
mod channel;
mod settings;

use embassy_time::{Duration, Instant};
use firmware::controller::Reason;
use firmware::ports::ResetCause;
use firmware::settings::{Settings, SoftLimits};
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::clock;
use hal_mock::flash::Flash;
use hal_mock::plant::{MotorScene, Overrides, Scene, ShaftSensor};
use protocol::extension::{Answer, Fault, FaultRecord};
use protocol::pms5005::{
    Channel, Command, Gain, Loop, Method, Parameter, Polarity, Quantity, Scope, Sensor, did,
};
use tests::Bench;
use tests::Link::Alive;

const WHEEL: Channel = Channel::ALL[0];
const JOINT: usize = 2;

/// The latched faults, with their channels.
fn latched(bench: &Bench) -> Vec<(Fault, Option<u8>)> {
    tests::latched(&bench.board.snapshot())
}

/// What a host reads of the first latched fault (DID 100).
fn first_record(bench: &mut Bench) -> FaultRecord {
    bench.send(Command::Ping);
    bench.run_ms(20);
    bench.fault(0).record.expect("a record")
}

fn change(bench: &Bench, change: impl FnOnce(&mut Overrides)) {
    change(&mut bench.board.plant.borrow_mut().overrides);
}

/// How many ms pass until this bridge is off; the host is alive.
fn until_off(bench: &mut Bench, motor: usize, most: u64) -> u64 {
    let passed = bench.until(Alive, most, |bench| !bench.bridge(motor).1);
    assert_eq!(bench.bridge(motor).0, 0, "off is neutral");
    passed
}

/// Under a latch no command moves the motor; cleared, it stays off until it is commanded, and runs.
fn off_until_cleared_and_then_runs_again(bench: &mut Bench, motor: usize, by: fn(&mut Bench)) {
    for quantity in [Quantity::Pwm, Quantity::Velocity, Quantity::Position] {
        bench.drive(quantity, motor, 3000, 0);
        bench.run_alive_with(200, |bench| assert_eq!(bench.bridge(motor), (0, false)));
    }
    change(bench, |all| *all = Overrides::default());
    bench.run_alive_with(200, |bench| assert_eq!(bench.bridge(motor), (0, false)));
    by(bench);
    bench.run_alive_ms(50);
    assert_eq!(latched(bench), []);
    bench.run_alive_ms(2000);
    let at = bench.position(motor);
    bench.run_alive_ms(300);
    assert!((bench.position(motor) - at).abs() <= 2, "nothing moves");
    bench.drive(Quantity::Pwm, motor, 16384 + 8000, 0);
    bench.run_alive_ms(300);
    assert_eq!((bench.bridge(motor), latched(bench)), ((8000, true), vec![]));
}

fn by_clearing(bench: &mut Bench) {
    bench.send_raw(did::PARAMETERS, &[0x81]);
}

fn by_resuming_all(bench: &mut Bench) {
    bench.send(Command::Run { scope: Scope::All, run: true });
}

fn by_resuming_the_wheel(bench: &mut Bench) {
    bench.send(Command::Run { scope: Scope::Motor(WHEEL), run: true });
}

const WAYS: [fn(&mut Bench); 3] = [by_clearing, by_resuming_all, by_resuming_the_wheel];
