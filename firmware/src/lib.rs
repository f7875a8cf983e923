//! The controller's firmware as a library: everything that is not a pin.
//!
//! ```text
//!  bytes -> Deframer -> Personality -> Command -> Controller -> Outputs -> ports -> motors, servos
//!  bytes <- encode   <- Personality <- Snapshot <- Controller <- Inputs  <- ports <- encoders, A/D
//! ```
//!
//! | module | what it is |
//! |---|---|
//! | [`units`], [`channel`] | the core's words: quantities, channels and how they are run |
//! | [`ports`] | what hardware must offer |
//! | [`settings`] | what an owner may choose |
//! | [`control`] | pure control: PID, trajectories, velocity, one channel, one servo |
//! | [`safety`] | link silence, collision protection, faults |
//! | [`command`] | what may be asked of the controller |
//! | [`controller`] | one step a control period over six channels and six servos |
//! | [`recorder`] | what channels did, period by period |
//! | [`liveness`] | who feeds the watchdog, and when no more |
//! | `reception` | what all sessions and their tasks share in listening to a line |
//! | [`personality`] | sessions without I/O: how a controller of old presents itself |
//! | [`app`] | the tasks of a controller; only here and in [`bridge::tasks`] time passes |
//! | [`bridge`] | the CM-5, which has no controller: a session between a PC and a servo bus, and its tasks |
//! | `board` | pins, timers, DMA: for the target only, and alone in using `unsafe` |
//!
//! Each imports only from those above it, and only `reception`, `personality` and `bridge` know a wire
//! format; `tests/tests/rooms.rs` reads the sources and says so. How to add a setting, a DID, a board or a
//! personality: `firmware/README.md`.
//!
//! # From the ring to the compare register: a byte of DID 27
//! 1. `board::line`'s DMA puts it into a ring;
//! 2. `board::line::Receiver::read` looks there 0.15 ms before each control period, for [`app::link`];
//! 3. [`Pms5005::receive`](personality::Session::receive) finds the frame: start, length, sum, end;
//! 4. `pms5005::Answers::respond` reads it as a `Move`, six targets and a time, and owes the
//!    acknowledgement;
//! 5. `translate::motion` makes the core's [`Command::MoveMotors`](command::Command) of it: a method and
//!    its unit;
//! 6. [`app::link`] queues it for the next period, which is [`app::control`]'s;
//! 7. [`Controller::step`](controller::Controller::step) checks all six targets, then each
//!    [`Axis::go`](control::axis::Axis::go)es;
//! 8. [`Axis::step`](control::axis::Axis::step) makes a duty of it, within all limits, in this period and
//!    all that follow;
//! 9. `board::motion::Motion::drive` writes the compare register, if the duty has changed.
//!
//! # To a pulse: an arm's POS
//! 1. and 2. as above;
//! 3. [`PioneerArm::receive`](personality::Session::receive) finds the packet: start, length, sum;
//! 4. `pioneer_arm::Answers::obey` reads it as a joint and ticks;
//! 5. `Arm::carry_out` sees whether the arm takes orders, and `Joint::go` where the joint may go;
//! 6. `Arm::advance` makes one [`Command::SlewServos`](command::Command) of where all joints go, and how
//!    fast: pulses;
//! 7. [`app::link`] queues it for the next period;
//! 8. [`Controller::step`](controller::Controller::step) has [`Servo::slew`](control::servo::Servo::slew)
//!    set out, unless a fault stops the servos;
//! 9. [`Servo::step`](control::servo::Servo::step) moves the pulse, period by period;
//! 10. `board::motion::Motion::drive` writes the compare register, if the pulse has changed.
//!
//! # From the servo bus to the PC: a byte that an AX-12 tells
//! 1. `board::bus::Bus::on_interrupt` takes it from the UART into a pipe, or marks it as lost;
//! 2. [`bridge::tasks::bus`] reads what has come, and hands it on with the time;
//! 3. `Bridge::bus_hears` goes on until all bytes are taken: there may be more than an answer;
//! 4. `Exchange::receive` takes the echo away, and its receiver finds the packet: start, ID, length, sum;
//! 5. `Expected::judge` compares with what was asked, who and how much: now it is a `Status`;
//! 6. `Bridge::conclude` finds the servo that was asked, or has the instruction sent again;
//! 7. `BusServo::conclude` keeps the eight bytes until the next answer, or forgets them if none came;
//! 8. `Roster::report` writes all servos' bytes, or 8 x `FF`, when `Bridge::transmit` finds it due;
//! 9. [`bridge::tasks::transmit`] waits for the PC's line, and gives the packet to `board::line`'s DMA.
//!
//! # From the PC to a servo of the bus: a goal
//! 1. `board::line`'s DMA puts it into a ring;
//! 2. [`bridge::tasks::receive`] reads what has come, and hands it on with the time;
//! 3. `Bridge::receive` finds the packet: start, length, sum, or gives up on it in time;
//! 4. `Pc::respond` finds that the goals are good, for as many servos as there are, and leaves each its
//!    fifteen bytes;
//! 5. `BusServo::take_goal` brings the newest of them into force, once a cycle;
//! 6. `Cycle::goals` writes them into SYNC_WRITEs, 12 and 3, for those servos whose order they are;
//! 7. `Exchange::send` keeps the packet, to know its echo;
//! 8. [`bridge::tasks::bus`] gives it to `board::bus`, which turns the line round and sends it.
//!
//! It builds for the Cortex-M4 and for a computer; a board, QEMU and the virtual board differ in
//! their ports and their clock, in nothing else.
#![cfg_attr(not(test), no_std)]
#![deny(unsafe_code)]

mod fmt;

pub mod app;
#[cfg(all(target_os = "none", feature = "stm32f4"))]
#[allow(unsafe_code)] // registers and interrupt vectors; every block says why it may
pub mod board;
pub mod bridge;
pub mod channel;
pub mod command;
pub mod control;
pub mod controller;
pub mod liveness;
pub mod personality;
pub mod ports;
mod reception;
pub mod recorder;
pub mod safety;
pub mod settings;
pub mod units;
