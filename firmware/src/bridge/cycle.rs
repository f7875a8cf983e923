//! The loop of work: read every servo, take the newest goals, send them, report; and again.
//!
//! Goals go out every cycle, new or not, in two SYNC_WRITEs (registers 24 to 35, and 47 to 49,
//! since those between are read-only), and servos whose torque is to be off are told so in a third;
//! each in packets of [`MAX_INSTRUCTION`](super::exchange::MAX_INSTRUCTION) bytes at the most.

use embassy_time::{Duration, Instant};
use protocol::dynamixel::{EncodeError, Id, Register, SyncWriter};

use super::bus_servo::{BusServo, Order};
use super::exchange::MAX_INSTRUCTION;
use super::pc::Pc;
use super::roster::Roster;

/// A cycle in which nobody was asked or told anything is followed by this pause, so that a PC still
/// hears a hundred times a second that all its servos are silent.
const IDLE: Duration = Duration::from_millis(10);

/// Which of the SYNC_WRITEs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// Torque enable alone, 0.
    Off,
    /// Torque enable to torque limit.
    Motion,
    /// Lock and punch.
    Lock,
}

impl Block {
    /// The first register, and how many bytes of each servo.
    const fn registers(self) -> (Register, u8) {
        match self {
            Self::Off => (Register::TORQUE_ENABLE, 1),
            Self::Motion => (Register::TORQUE_ENABLE, 12),
            Self::Lock => (Register::LOCK, 3),
        }
    }

    /// What it has for this servo, if anything.
    fn data(self, servo: &BusServo) -> Option<&[u8]> {
        match (self, servo.order()) {
            (Self::Off, Order::Off) => Some(&[0]),
            (Self::Motion, Order::Goal(goal)) => Some(goal.blocks().0),
            (Self::Lock, Order::Goal(goal)) => Some(goal.blocks().1),
            _ => None,
        }
    }
}

/// What is to be sent next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Job {
    /// What is due of a servo.
    Servo(Id),
    /// One of the SYNC_WRITEs, to the servos behind the one that was served last.
    Goals(Block),
}

enum Turn {
    Servos,
    Goals(Block),
    Rest(Instant),
}

/// Where in the cycle we are.
pub struct Cycle {
    turn: Turn,
    /// The servo that was served last in this turn.
    behind: Option<Id>,
    /// Whether anything was sent in this cycle.
    worked: bool,
    /// Complete cycles; wraps.
    pub(super) cycles: u32,
}

impl Cycle {
    pub const fn new() -> Self {
        Self { turn: Turn::Servos, behind: None, worked: false, cycles: 0 }
    }

    /// When there is something to do again, if it is resting.
    pub fn rests_until(&self) -> Instant {
        if let Turn::Rest(until) = self.turn { until } else { Instant::MIN }
    }

    /// A servo was served; goals count for all up to this one.
    pub fn served(&mut self, id: Id) {
        self.behind = Some(id);
    }

    /// What is to be sent next; `None` while resting. Ends: a cycle without work is followed by
    /// rest.
    pub fn next(&mut self, roster: &mut Roster, pc: &mut Pc, now: Instant) -> Option<Job> {
        loop {
            let behind = self.behind;
            let job = match self.turn {
                Turn::Servos => {
                    let servo = roster.behind(behind).find(|servo| servo.is_due(now));
                    servo.map(|servo| Job::Servo(servo.id))
                }
                Turn::Goals(block) => {
                    let any = roster.behind(behind).any(|servo| block.data(servo).is_some());
                    any.then_some(Job::Goals(block))
                }
                Turn::Rest(until) if now < until => return None,
                Turn::Rest(_) => None,
            };
            if job.is_some() {
                self.worked = true;
                return job;
            }
            self.behind = None;
            self.turn = match self.turn {
                Turn::Servos => {
                    pc.take_goals(roster, now);
                    Turn::Goals(Block::Off)
                }
                Turn::Goals(Block::Off) => Turn::Goals(Block::Motion),
                Turn::Goals(Block::Motion) => Turn::Goals(Block::Lock),
                Turn::Goals(Block::Lock) => {
                    self.cycles = self.cycles.wrapping_add(1);
                    if roster.agreed() > 0 {
                        pc.tell_report(roster, now);
                    }
                    if core::mem::take(&mut self.worked) {
                        Turn::Servos
                    } else {
                        Turn::Rest(now.saturating_add(IDLE))
                    }
                }
                Turn::Rest(_) => Turn::Servos,
            };
        }
    }

    /// Writes the goals of as many servos as one packet takes, and answers it and the last of them.
    pub fn goals<'b>(
        &self,
        block: Block,
        roster: &Roster,
        out: &'b mut [u8],
    ) -> Result<(&'b mut [u8], Option<Id>), EncodeError> {
        let (register, len) = block.registers();
        let room = out.get_mut(..MAX_INSTRUCTION).unwrap_or_default();
        let mut writer = SyncWriter::new(room, register.address, len)?;
        let mut last = None;
        for servo in roster.behind(self.behind) {
            let Some(data) = block.data(servo) else { continue };
            let Ok(room) = writer.servo(servo.id) else { break };
            room.iter_mut().zip(data).for_each(|(to, from)| *to = *from); // of one length
            last = Some(servo.id);
        }
        Ok((writer.finish()?, last))
    }
}
