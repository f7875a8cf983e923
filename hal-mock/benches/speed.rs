//! How much faster than real time a whole board is simulated: the firmware's tasks, the line at
//! 115200 baud, the plant, with all telemetry on, two wheels and two joints moving, and a host
//! that commands 20 times a second.
//!
//! `cargo bench -p hal-mock` prints the ratio, the best of five runs of a minute of the board's
//! time, and fails below 300.

use std::time::Instant;

use embassy_time::Duration;
use hal_mock::board::VirtualBoard;
use protocol::pms5005::{Addressing, Command, Move, Quantity};

const GOAL: f64 = 300.0;

fn main() {
    let simulated = Duration::from_secs(60);
    let best =
        (0..5).map(|_| simulated.as_millis() as f64 / 1000.0 / run(simulated)).fold(0.0, f64::max);
    println!("a board runs {best:.0} times faster than real time (goal: {GOAL:.0})");
    assert!(best >= GOAL, "too slow");
}

/// Seconds that a run takes.
fn run(simulated: Duration) -> f64 {
    let mut board = VirtualBoard::default();
    let mut buffer = [0; 64];
    let start = Instant::now();
    for step in 0..simulated.as_millis() / 50 {
        let forward = if step / 20 % 2 == 0 { 1 } else { -1 };
        let (quantity, targets) = match step % 2 {
            0 => (
                Quantity::Velocity,
                [Some(2000 * forward), Some(-900 * forward), None, None, None, None],
            ),
            _ => {
                let joint = Some(2048 + 700 * forward);
                (Quantity::Position, [None, None, joint, joint, None, None])
            }
        };
        let command =
            Command::Move(Move { quantity, addressing: Addressing::All, targets, periods: 50 });
        board.line.host_sends(command.encode(0, &mut buffer).expect("a valid command"));
        board.run_for(Duration::from_millis(50));
        while board.line.host_receives().is_some() {}
    }
    assert!(board.link().telemetry_sent as u64 >= simulated.as_millis() / 50 * 3 - 6);
    start.elapsed().as_secs_f64()
}
