//! What the host sends reaches the controller in the order of the line, whatever the board is doing.

use hal_mock::board::Make;
use protocol::pms5005::extension::{Answer, Assignments, Request};
use protocol::pms5005::{
    Addressing, Channel, Command, Data, Method, Move, Parameter, Quantity, did,
};
use tests::Bench;

/// A line without a speed limit, so that all that is sent comes in one chunk.
fn fast() -> Bench {
    Bench::with(Make { line_rate: 0, ..Make::default() })
}

fn methods(method: Method, channels: usize) -> Vec<Parameter> {
    Channel::ALL.into_iter().take(channels).map(|c| Parameter::Method(c, method)).collect()
}

#[test]
fn a_motion_command_behind_a_save_and_new_parameters_finds_them() {
    let mut bench = fast();
    bench.configure(&methods(Method::Velocity, 6));
    bench.run_ms(50);
    bench.send_raw(did::PARAMETERS, &[0x82]);
    bench.configure(&methods(Method::Pwm, 6));
    let targets = [Some(16384 + 2000); 6];
    let (quantity, addressing) = (Quantity::Pwm, Addressing::All);
    bench.send(Command::Move(Move { quantity, addressing, targets, periods: 0 }));
    bench.run_ms(100);
    assert_eq!(bench.board.refused(), 0);
    assert_eq!([0, 1, 2, 3, 4, 5].map(|motor| bench.bridge(motor)), [(2000, true); 6]);
}

#[test]
fn the_controller_keeps_to_the_settings_that_the_host_reads() {
    const LINK_TIMEOUT: u16 = 1;
    let mut bench = fast();
    bench.send_raw(did::PARAMETERS, &[0x83]);
    bench.configure(&methods(Method::Pwm, 5));
    let mut data = Data::new();
    Assignments::emit(LINK_TIMEOUT, 100, &mut data).unwrap();
    bench.send_raw(did::PARAMETERS, &data);
    bench.run_ms(50);
    bench.received();
    bench.send(Command::Extension(Request::Setting(LINK_TIMEOUT)));
    bench.run_ms(20);
    let told =
        bench.received().iter().find_map(|frame| match Answer::parse(frame.did, &frame.data) {
            Some(Answer::Setting(description)) => Some(description.value),
            _ => None,
        });
    bench.drive(Quantity::Pwm, 0, 16384 + 2000, 0);
    bench.run_ms(1500);
    let lost = bench.board.snapshot().counters.links_lost;
    assert_eq!((told, lost), if lost > 0 { (Some(100), 1) } else { (Some(2000), 0) });
}
