//! How close the CM-5's loop of work comes to what its servo bus allows.
//!
//! The limit (facts): of each servo a request of 8 bytes, its answer of 14, the return delay of 2
//! us and its own latency tau; then two SYNC_WRITEs of 8 bytes and 13, 4 bytes a servo; 10 us a
//! byte.
//! `cargo bench -p hal-mock --bench bridge` prints cycles a second and their share of the limit
//! for 6, 10 and 18 servos, tau 0 and 22 us, over 30 s of virtual time with the watch for new
//! servos on and a PC that sends goals 100 times a second. It fails below 0.95, and above 1.

use embassy_time::Duration;
use hal_mock::cm5_board::{Cm5Board, Make};
use hal_mock::plant::Ax12;
use hal_mock::servo_bus;
use protocol::cm5::{Goals, HelloAnswer, Limits, MAX_PACKET, ServoGoal};

const GOAL: f64 = 0.95;

fn main() {
    println!("servos  tau    limit  reached  share");
    for latency_us in [0, 22] {
        for servos in [6, 10, 18] {
            let limit = 1e6 / limit_us(servos, latency_us);
            let reached = reached(servos as u8, latency_us);
            let share = reached / limit;
            println!("{servos:6} {latency_us:4} {limit:8.1} {reached:8.1}  {share:.3}");
            assert!((GOAL..=1.0).contains(&share), "not between {GOAL} and 1");
        }
    }
}

/// Shortest time of a cycle.
fn limit_us(servos: u32, tau: u32) -> f64 {
    let read = 10 * (8 + 14) + 2 + tau;
    let sync_write = |len: u32| 10 * (8 + servos * (len + 1));
    f64::from(servos * read + sync_write(12) + sync_write(3))
}

/// Cycles a second.
fn reached(servos: u8, latency_us: u32) -> f64 {
    let mut board = Cm5Board::new(Make {
        servos: (1..=servos).map(Ax12::new).collect(),
        bus: servo_bus::Make { latency_us, ..servo_bus::Make::default() },
        ..Make::default()
    });
    let mut buffer = [0; MAX_PACKET];
    board.run_for(Duration::from_secs(2));
    let all = [Limits::new(0, 1023).expect("limits")];
    board.line.host_sends(HelloAnswer::encode(1, &all, &mut buffer).expect("an answer"));
    board.run_for(Duration::from_secs(2));
    let goal = ServoGoal([1, 0, 0, 0, 32, 32, 0, 2, 0, 0, 0, 0, 0, 0, 0]);
    let goals = vec![goal; servos.into()];
    let mut second = |board: &mut Cm5Board| {
        for _ in 0..100 {
            board.line.host_sends(Goals::encode(&goals, &mut buffer).expect("goals"));
            board.run_for(Duration::from_millis(10));
            while board.line.host_receives().is_some() {}
        }
    };
    second(&mut board);
    let before = board.bridge().counters().cycles;
    const SECONDS: u32 = 30;
    (0..SECONDS).for_each(|_| second(&mut board));
    f64::from(board.bridge().counters().cycles - before) / f64::from(SECONDS)
}
