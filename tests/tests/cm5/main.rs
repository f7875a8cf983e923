//! The CM-5's bridge: a PC on one side, simulated AX-12 servos on the other, on virtual time.
//!
//! - `packets.rs`: properties of the PC link's receiver and packets;
//! - `startup.rs`: search, hello, setup;
//! - `work.rs`: goals, reports, silence;
//! - `faults.rs`: servos that go and come, noise;
//! - `watchdog.rs`: loops that hang;
//! - `scripted.rs`: the bridge alone, on a bus that does what no servo would;
//! - `pass_through.rs`: no bridge at all, the PC is the bus's master; `pass_through/wheels.rs`: what it stops.

mod faults;
mod packets;
mod pass_through;
mod scripted;
mod startup;
mod watchdog;
mod work;

use embassy_time::{Duration, Instant};
use firmware::bridge::ServoCounters;
use hal_mock::plant::Ax12;
use protocol::cm5::{
    Feedback, Goals, Hello, HelloAnswer, Limits, MAX_PACKET, Receiver, Report, ServoGoal, encode,
    params_of,
};
use protocol::dynamixel::Register;
use tests::Link::Silent;
use tests::cm5::{Bench, PcHost, Said, goal, limits, servos};
