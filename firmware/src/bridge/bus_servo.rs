//! One servo as the bridge knows it: whether the PC knows of it too, what is to be asked of it
//! next, what it is to do, and what has been heard.
//!
//! A servo that the PC has given limits is *checked*: its return delay and limits (registers 5 to
//! 9) are read, what differs is *written*, and it is checked again, until nothing differs. Then it
//! is *at work*: read every cycle, and sent its goal. One that has not answered [`STRIKES`] times
//! in a row is *missing*: it is left out of the cycle, and checked after [`FIRST_PROBE`], then
//! after twice that, and so on up to [`LAST_PROBE`]. When it answers it may have lost its power, or
//! be another one with the same ID; the check takes care of both.
//!
//! Limits that are both 0 make a servo turn *endlessly*, and then its speed means something else: 0
//! stops it, while in a joint it is the greatest there is. So its torque is switched off, and seen
//! to be off, before it is written from one mode to the other. What it is sent
//! every cycle is its [`Order`], and there is one rule: **a servo is driven only by a goal that is newer than
//! whatever made the last one unsafe**.

use core::ops::Range;

use embassy_time::{Duration, Instant};
use protocol::cm5::{Feedback, ServoGoal};
use protocol::dynamixel::{EncodeError, Errors, Id, Instruction, Register};

use super::exchange::{Ending, Expected, PATIENCE, Status, patience_with};
use crate::reception::count;

/// So many times in a row a servo has not answered when it is missing: 60 ms of 18 servos' cycles.
/// With one byte of a hundred damaged every fifth exchange of 22 bytes fails, and eight of them in
/// a row once in 400,000.
const STRIKES: u8 = 8;
/// A missing servo is asked again after this time: with few servos eight strikes are over within a
/// glitch of the line.
const FIRST_PROBE: Duration = Duration::from_millis(10);
/// In the end it is asked this often. It costs 0.9 ms, so a hundred missing ones cost a fifth of
/// the time at the most.
const LAST_PROBE: Duration = Duration::from_millis(500);
/// A servo is mute this long for every byte written to its EEPROM (facts: about 6 ms).
const EEPROM_BYTE: Duration = Duration::from_millis(7);
/// Writes before a servo counts as one that does not take them (it is locked, say): it is then only
/// checked, since an EEPROM wears out. Only another wish of the PC renews them, and success.
const WRITES: u8 = 6;
/// Writes that a servo which was missing has at least, as power-off unlocks it: one of the return
/// delay, one of the limits.
const WRITES_AFTER_RETURN: u8 = 2;

/// Errors at which a servo switches its torque off, if its register 18 says so. To send the goal
/// again would switch it on again, every cycle.
const SHUTDOWN: [Errors; 2] = [Errors::OVERHEAT, Errors::OVERLOAD];

/// Whether the PC knows of a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Found; the next hello will tell.
    Found,
    /// The last hello has told.
    Told,
    /// The PC has answered with its limits: it is part of goals and reports.
    Agreed,
}

/// What there is to be asked of a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Its return delay and limits, to be compared with what the PC wants.
    Check,
    /// To take so many bytes of these, beginning with that register.
    Write {
        /// 5 to 9.
        address: u8,
        /// 1 to 4.
        count: u8,
    },
    /// To switch its torque off: what is to be written next makes a joint a wheel, or the reverse.
    Release,
    /// Its torque enable, to see whether that was done.
    Confirm,
    /// Its present state, every cycle.
    Work,
}

/// What a servo is sent every cycle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// It is left as it is: nothing is sent.
    Untouched,
    /// Its torque is switched off, again every cycle.
    Off,
    /// It is sent this goal every cycle.
    Goal(ServoGoal),
}

/// Return delay and limits, as the registers 5 to 9 hold them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup(pub [u8; 5]);

impl Setup {
    fn turns_endlessly(self) -> bool {
        matches!(self.0, [_, 0, 0, 0, 0])
    }

    /// What must be written next of `self` to a servo that holds `held`: the first register, and
    /// how many bytes.
    fn differs_from(self, held: Self) -> Option<(Register, u8)> {
        let differs = |bytes: Range<usize>| self.0.get(bytes.clone()) != held.0.get(bytes);
        match (differs(0..1), differs(1..3), differs(3..5)) {
            (true, ..) => Some((Register::RETURN_DELAY, 1)),
            // Both at once: with one of them alone the servo might turn endlessly for a while.
            (_, true, true) => Some((Register::CW_LIMIT, 4)),
            (_, true, false) => Some((Register::CW_LIMIT, 2)),
            (_, false, true) => Some((Register::CCW_LIMIT, 2)),
            (_, false, false) => None,
        }
    }
}

/// What was counted of one servo. The counters wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ServoCounters {
    /// Intact answers.
    pub replies: u32,
    /// Instructions that nothing came back to.
    pub time_outs: u32,
    /// Answers that came damaged.
    pub checksum_errors: u32,
    /// Answers with error bits, or without what was asked for.
    pub error_replies: u32,
    /// All error bits that were ever set.
    pub errors_seen: Errors,
    /// Time from the end of the last instruction to the end of its answer, in microseconds.
    pub latency_us: u32,
    /// The longest such time.
    pub longest_latency_us: u32,
    /// How often it came back after it had been missing.
    pub returns: u32,
    /// Bytes written to its EEPROM.
    pub eeprom_bytes: u32,
}

/// A servo on the bus.
pub struct BusServo {
    /// Whom it takes itself for.
    pub id: Id,
    pub(super) standing: Standing,
    /// What the PC wants of it, once agreed.
    wanted: Option<Setup>,
    /// What it held when it was last checked.
    held: Option<Setup>,
    pub(super) stage: Stage,
    /// Not before this time is it asked again.
    from: Instant,
    writes_left: u8,
    strikes: u8,
    /// How long it is left alone, once it is missing.
    probe: Duration,
    /// The newest goal of the PC, for the next cycle.
    pub(super) newest: Option<ServoGoal>,
    order: Order,
    /// It has not been read since the PC has changed its limits.
    is_unread: bool,
    /// What it told when it was last asked; `None` if it did not answer.
    pub feedback: Option<Feedback>,
    /// What was counted.
    pub counters: ServoCounters,
}

impl BusServo {
    pub(super) fn new(id: Id) -> Self {
        Self {
            id,
            standing: Standing::Found,
            wanted: None,
            held: None,
            stage: Stage::Check,
            from: Instant::MIN,
            writes_left: 0,
            strikes: 0,
            probe: FIRST_PROBE,
            newest: None,
            order: Order::Untouched,
            is_unread: false,
            feedback: None,
            counters: ServoCounters::default(),
        }
    }

    /// Whether the PC has agreed on it.
    pub fn is_agreed(&self) -> bool {
        self.standing == Standing::Agreed
    }

    /// Whether it has fallen silent.
    pub fn is_missing(&self) -> bool {
        self.strikes >= STRIKES
    }

    /// The PC wants it so. Nothing happens if it has wanted that before.
    pub(super) fn agree(&mut self, wanted: Setup) {
        let before = self.wanted.replace(wanted);
        if self.is_agreed() && before == Some(wanted) {
            return;
        }
        if before.is_some_and(|before| before.turns_endlessly() != wanted.turns_endlessly()) {
            // Its goals were meant for the other mode.
            self.newest = None;
            self.order = Order::Off;
        }
        self.standing = Standing::Agreed;
        self.writes_left = WRITES;
        self.stage = Stage::Check;
        self.is_unread = true;
        self.feedback = None;
    }

    /// Whether a report had better wait for it.
    pub(super) fn is_to_be_read(&self) -> bool {
        self.is_unread && !self.is_missing()
    }

    /// Brings the newest goal into force. Its lock is looked at, since one that is set outlives the
    /// PC's wish: it goes out only if a setting says so.
    pub(super) fn take_goal(&mut self, pass_lock: bool) {
        if let Some(goal) = self.newest.take() {
            self.order = Order::Goal(if pass_lock { goal } else { goal.with(Register::LOCK, 0) });
        }
    }

    /// The PC is silent: what turns endlessly stops, and with `torque_off` all torque goes.
    pub(super) fn rest(&mut self, torque_off: bool) {
        if torque_off || self.turns_endlessly() {
            self.order = Order::Off;
        }
    }

    /// Its goal is not sent again: whatever drives it next is newer. What it does meanwhile is left
    /// to itself.
    pub(super) fn withdraw_goal(&mut self) {
        if let Order::Goal(_) = self.order {
            self.order = Order::Untouched;
        }
    }

    /// Whether it is to be asked now: also before the PC has agreed, but only until its limits have
    /// been read, since silence must stop what was turning endlessly before the bridge began.
    pub(super) fn is_due(&self, now: Instant) -> bool {
        (self.is_agreed() || self.held.is_none()) && now >= self.from
    }

    /// What it is to be sent now. No goal before its limits hold, but to stop is always allowed, and
    /// so a goal's torque enable is looked at: a servo that is not heard may hear. One that turns
    /// endlessly is stopped while it is missing, since its move has no end.
    pub(super) fn order(&self) -> &Order {
        match &self.order {
            Order::Goal(goal) if self.stage != Stage::Work => {
                let stops = goal.get(Register::TORQUE_ENABLE) == 0 || self.turns_endlessly();
                if stops { &Order::Off } else { &Order::Untouched }
            }
            drive => drive,
        }
    }

    /// Also of a servo that has never told: it will not be heard to stop.
    fn turns_endlessly(&self) -> bool {
        self.held.map_or(self.is_missing(), Setup::turns_endlessly)
    }

    /// The instruction that is due, and what answers it.
    pub(super) fn instruction<'b>(
        &self,
        out: &'b mut [u8],
    ) -> Result<(&'b mut [u8], Expected), EncodeError> {
        const TORQUE_ENABLE: u8 = Register::TORQUE_ENABLE.address;
        let read = |address, count| Instruction::Read { address, count };
        let write = |address, data| Instruction::Write { address, data };
        let (instruction, data, patience) = match self.stage {
            Stage::Check => (read(Register::RETURN_DELAY.address, 5), 5, PATIENCE),
            Stage::Write { address, count } => {
                (write(address, self.part_of_wanted(address, count)), 0, PATIENCE)
            }
            Stage::Release => (write(TORQUE_ENABLE, &[0]), 0, PATIENCE),
            Stage::Confirm => (read(TORQUE_ENABLE, 1), 1, PATIENCE),
            Stage::Work => (
                read(Register::PRESENT_POSITION.address, Feedback::BYTES as u8), // 8
                Feedback::BYTES,
                self.wanted.map_or(PATIENCE, |wanted| patience_with(wanted.0[0])),
            ),
        };
        Ok((instruction.encode(self.id, out)?, Expected { id: self.id, data, patience }))
    }

    fn part_of_wanted(&self, address: u8, count: u8) -> &[u8] {
        let begin = usize::from(address.saturating_sub(Register::RETURN_DELAY.address));
        let wanted = self.wanted.as_ref().map_or(&[][..], |wanted| &wanted.0);
        wanted.get(begin..begin + usize::from(count)).unwrap_or_default()
    }

    /// Takes what came of the instruction of stage `asked`. Answers whether the servo is back after it
    /// was missing.
    pub(super) fn conclude(&mut self, asked: Stage, ending: Ending, now: Instant) -> bool {
        self.note(ending);
        match (asked, ending) {
            // Whether it was answered depends on the servo's status return level; the check that
            // follows tells whether it was done.
            (Stage::Write { count: bytes, .. }, _) => {
                count(&mut self.counters.eeprom_bytes, bytes.into());
                self.writes_left = self.writes_left.saturating_sub(1);
                self.from = now.saturating_add(EEPROM_BYTE * bytes.into());
                self.stage = Stage::Check;
                false
            }
            // So does the reading.
            (Stage::Release, _) if self.stage == Stage::Release => {
                self.stage = Stage::Confirm;
                false
            }
            // The PC has asked for another setup meanwhile, and this does not tell of it.
            _ if asked != self.stage => false,
            (stage, Ending::Answered(status)) => {
                let returned = self.is_missing();
                self.strikes = 0;
                self.probe = FIRST_PROBE;
                if SHUTDOWN.into_iter().any(|error| status.errors.contains(error)) {
                    self.withdraw_goal();
                }
                match stage {
                    Stage::Work => {
                        self.is_unread = false;
                        self.feedback = Some(Feedback(status.data));
                    }
                    Stage::Confirm if status.data[0] == 0 => self.write_what_differs(now),
                    Stage::Confirm => self.stage = Stage::Release,
                    _ => self.compare(&status, now),
                }
                if returned {
                    count(&mut self.counters.returns, 1);
                }
                returned
            }
            _ => {
                self.feedback = None;
                self.strikes = self.strikes.saturating_add(1);
                if self.is_missing() {
                    self.stage = Stage::Check;
                    self.writes_left = self.writes_left.max(WRITES_AFTER_RETURN);
                    self.from = now.saturating_add(self.probe);
                    self.probe = self.probe.checked_mul(2).unwrap_or(LAST_PROBE).min(LAST_PROBE);
                }
                false
            }
        }
    }

    fn note(&mut self, ending: Ending) {
        let counters = &mut self.counters;
        let errors = match ending {
            Ending::Answered(status) => {
                counters.latency_us = status.latency.as_micros() as u32; // 5 ms at the most
                counters.longest_latency_us = counters.longest_latency_us.max(counters.latency_us);
                count(&mut counters.replies, 1);
                status.errors
            }
            Ending::Refused(errors) => {
                count(&mut counters.replies, 1);
                errors
            }
            Ending::TimedOut => return count(&mut counters.time_outs, 1),
            Ending::Damaged => return count(&mut counters.checksum_errors, 1),
            Ending::Collided | Ending::Sent => return, // the bus has counted it
        };
        counters.errors_seen |= errors;
        if errors != Errors::NONE || matches!(ending, Ending::Refused(_)) {
            count(&mut counters.error_replies, 1);
        }
    }

    /// Compares what was read with what is wanted, and decides what comes next.
    fn compare(&mut self, status: &Status, now: Instant) {
        let Some((held, _)) = status.data.split_first_chunk() else { return };
        let held = Setup(*held);
        self.held = Some(held);
        let Some(wanted) = self.wanted else { return };
        let limits_differ = wanted
            .differs_from(held)
            .is_some_and(|(register, _)| register != Register::RETURN_DELAY);
        if limits_differ && wanted.turns_endlessly() != held.turns_endlessly() {
            self.stage = Stage::Release;
        } else {
            self.write_what_differs(now);
        }
    }

    /// Decides what is to be written, of what differed when it was checked.
    fn write_what_differs(&mut self, now: Instant) {
        let (Some(wanted), Some(held)) = (self.wanted, self.held) else { return };
        self.stage = match wanted.differs_from(held) {
            None => {
                self.writes_left = WRITES;
                Stage::Work
            }
            Some((Register { address, .. }, count)) if self.writes_left > 0 => {
                Stage::Write { address, count }
            }
            Some(_) => {
                self.from = now.saturating_add(LAST_PROBE);
                Stage::Check
            }
        };
    }
}
