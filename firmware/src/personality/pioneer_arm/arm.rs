//! The arm behind the packets: six joints, their power, and the line that tells that it is there.
//!
//! Rules (facts, "Commands", and the manual's page where it speaks):
//! - power goes off only when all joints are home, whoever asks for it: POWER 0, PARK, INIT, the
//!   end of a session, or the arm's own link. Home are then the servos too, by the time that the
//!   settings give them. So no joint falls, and power-up moves none unless a hand has meanwhile;
//! - until it is off the latest command counts: a position, STOP or POWER 1 calls a park off;
//! - a host that falls silent stops the joints that move, and they hold; AUTOPARK parks them;
//! - the controller drives the joints, each way by one command, and takes no notice of the host's
//!   silence then (`control::servo`): it is the session that stops them;
//! - where nobody may be watching (the end of a session, AUTOPARK, the gripper's turn, a lost arm)
//!   a joint goes home no faster than its calibrated speed;
//! - an arm that is lost while it has power is parked, and takes orders again only after INIT has
//!   found it. One that is lost without power is forgotten until CHECK or INIT finds it;
//! - a fault of the board that stops the servos (`safety::faults`) takes the power at once,
//!   wherever the joints are. They count as standing there: nobody knows better. INIT clears the
//!   fault, and when its cause is gone POWER 1 gives each joint its power where it lost it. So it
//!   is with a fault that another has cleared before the arm could see it: the pulses are missing.

use embassy_time::{Duration, Instant};
use protocol::arcos::{ArmCommand, ArmInfo, ArmStatus, JOINTS, JointInfo, JointNumber, Joints};

use super::joint::{Joint, Limited};
use crate::channel::Scope;
use crate::command::Command;
use crate::control::servo::Slew;
use crate::settings::ArmSettings;
use crate::units::ServoPulse;

/// What INIT takes.
const RESET_TIME: Duration = Duration::from_millis(700);
/// What CHECK takes.
const CHECK_TIME: Duration = Duration::from_millis(200);
/// How often the arm is looked at; its line is read no faster.
const LOOK_PERIOD: Duration = Duration::from_millis(20);

/// From a command to the snapshot that shows it: two control periods.
const COMMAND_TAKES: Duration = Duration::from_millis(2);
/// How long a pulse that was told may be missing.
const PULSES_TAKE: Duration = Duration::from_millis(20);

/// What ARMINFOpac calls us.
const VERSION: &str = concat!("Open arm ", env!("CARGO_PKG_VERSION"));

/// Why a command is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) enum Ignored {
    /// A reset is under way.
    Resetting,
    /// No arm is connected.
    NotConnected,
    /// The arm was lost while it had power, or the board has taken it: it needs INIT.
    NeedsInit,
    /// A fault of the board keeps the servos off: its cause must go, then it needs INIT.
    Fault,
    /// The servos have no power.
    NoPower,
}

impl core::fmt::Display for Ignored {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Resetting => "a reset is under way",
            Self::NotConnected => "no arm is connected",
            Self::NeedsInit => "the arm needs INIT",
            Self::Fault => "a fault of the board keeps the servos off, then the arm needs INIT",
            Self::NoPower => "the servos have no power",
        })
    }
}

/// Servo power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Power {
    Off,
    On,
    /// On, and off as soon as all joints are home.
    Parking,
}

/// What the board tells of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Seen {
    /// The arm's line says that it is there.
    pub present: bool,
    /// A fault keeps the servos off.
    pub stopped: bool,
    /// All servos have pulses.
    pub has_pulses: bool,
    /// An upkeep keeps the board from giving them.
    pub is_held: bool,
    /// Where they are, or were last.
    pub pulses: [Option<ServoPulse>; JOINTS],
}

/// The arm. See the [module](self).
pub(super) struct Arm {
    settings: ArmSettings,
    joints: [Joint; JOINTS],
    power: Power,
    connected: bool,
    /// A fault keeps the servos off, as the board last told.
    stopped: bool,
    needs_init: bool,
    /// INIT has asked for the fault to be cleared, and the board has not been told yet.
    clears: bool,
    /// When INIT, and when CHECK, will be done, if one is under way.
    reset_until: Option<Instant>,
    check_until: Option<Instant>,
    looks_at: Instant,
    autopark_s: u16,
    grippark_s: u16,
    /// The last command, the end of the last way, or power-up.
    idle_since: Instant,
    closed_since: Option<Instant>,
    /// Where the board was last told to drive the servos.
    driven: [Option<Slew>; JOINTS],
    /// It has given pulses since power-up. Joints hold until then: none appears in mid-way.
    has_pulses: bool,
    /// Since when it has lacked some of them.
    lacking_since: Option<Instant>,
    /// Times that the arm was lost while it had power; wraps.
    pub lost: u32,
    /// Times that the board took the servos' power; wraps.
    pub power_lost: u32,
}

impl Arm {
    /// The arm at boot: without power. Nobody can know where its joints stand; they count as home.
    pub fn new(settings: ArmSettings, now: Instant) -> Self {
        Self {
            joints: settings.joints.map(|joint| Joint::new(joint, settings.servo_ms_per_60_deg)),
            power: Power::Off,
            // The first look tells.
            connected: true,
            stopped: false,
            needs_init: false,
            clears: false,
            reset_until: None,
            check_until: None,
            looks_at: now,
            autopark_s: settings.autopark_s,
            grippark_s: settings.grippark_s,
            idle_since: now,
            closed_since: None,
            driven: [None; JOINTS],
            has_pulses: false,
            lacking_since: None,
            lost: 0,
            power_lost: 0,
            settings,
        }
    }

    /// For ARMpac.
    pub fn status(&self) -> ArmStatus {
        ArmStatus {
            powered: self.power != Power::Off,
            connected: self.connected,
            good: self.connected && !self.stopped,
            initialised: self.connected && !self.needs_init && self.reset_until.is_none(),
            homing: self.joints.iter().any(Joint::is_homing),
            moving: self.joints.each_ref().map(Joint::is_moving),
            positions: self.joints.each_ref().map(|joint| joint.position),
        }
    }

    /// For ARMINFOpac.
    pub fn info(&self) -> ArmInfo<'static> {
        if self.connected {
            let joints: [JointInfo; JOINTS] = self.joints.each_ref().map(Joint::info);
            ArmInfo::Arm { version: VERSION, joints }
        } else {
            ArmInfo::NoArm
        }
    }

    /// Carries a command out, or says why not. What it asks of the board comes from
    /// [`advance`](Self::advance), INFO and STATUS are the session's to answer; they too keep the
    /// arm from parking itself.
    pub fn carry_out(&mut self, command: ArmCommand, now: Instant) -> Result<Limited, Ignored> {
        self.idle_since = now;
        let is_question = matches!(command, ArmCommand::Info | ArmCommand::Status(_));
        if self.reset_until.is_some() && !is_question {
            return Err(Ignored::Resetting);
        }
        let mut limited = Limited(false);
        match command {
            ArmCommand::Info | ArmCommand::Status(_) => {}
            ArmCommand::Init => {
                self.park(false);
                self.check_until = None;
                self.clears = true;
                self.reset_until = Some(now.saturating_add(RESET_TIME));
            }
            ArmCommand::Check => self.check_until = Some(now.saturating_add(CHECK_TIME)),
            ArmCommand::Power(true) => {
                self.obeys()?;
                self.power = Power::On;
            }
            ArmCommand::Power(false) | ArmCommand::Park => self.park(false),
            ArmCommand::Home(joints) => {
                self.moves()?;
                self.each(joints, |joint| joint.home(false));
            }
            ArmCommand::Position { joint, ticks } => {
                self.moves()?;
                self.power = Power::On;
                self.each(Joints::One(joint), |joint| limited = joint.go(ticks));
            }
            ArmCommand::Speed { joint, ms_per_tick } => {
                self.each(Joints::One(joint), |joint| limited = joint.set_speed(ms_per_tick));
            }
            ArmCommand::Stop(joints) => {
                self.moves()?;
                self.power = Power::On;
                self.each(joints, Joint::stop);
            }
            ArmCommand::AutoPark(seconds) => self.autopark_s = seconds,
            ArmCommand::GripPark(seconds) => self.grippark_s = seconds,
        }
        Ok(limited)
    }

    /// The host has closed its session.
    pub fn park_unhurried(&mut self) {
        self.park(true);
    }

    /// The host is silent: joints that move stop where they are, unless they go home to be switched
    /// off.
    pub fn hold(&mut self) {
        if self.power == Power::On {
            self.each(Joints::All, Joint::stop);
        }
    }

    /// The times are again what the settings say. Speeds stay.
    pub fn forget_times(&mut self) {
        self.autopark_s = self.settings.autopark_s;
        self.grippark_s = self.settings.grippark_s;
    }

    /// When [`advance`](Self::advance) has something to do.
    pub fn wakes_at(&self) -> Instant {
        let ends = [self.reset_until, self.check_until, self.parks_at()];
        let earliest = ends.into_iter().flatten().fold(self.looks_at, Instant::min);
        // A command may have asked for something to be done now.
        let is_told = !self.clears && self.slews() == self.driven;
        if is_told { earliest } else { Instant::MIN }
    }

    /// Lets time pass, and tells what that asks of the board. Call it until it answers `None`.
    pub fn advance(&mut self, now: Instant, seen: Seen) -> Option<Command> {
        self.heed(now, seen);
        self.watch(now, seen.present);
        self.keep_times(now);
        self.look(now, &seen.pulses);
        if self.parks_at().is_some_and(|at| at <= now) {
            self.power = Power::Off;
        }
        let is_on = self.power != Power::Off;
        self.has_pulses = is_on && (self.has_pulses || seen.has_pulses);
        let arrivals = self.joints.iter().filter_map(Joint::arrives_at).filter(|_| is_on);
        let rises = (is_on && !self.has_pulses).then(|| now.saturating_add(COMMAND_TAKES));
        self.looks_at = arrivals.chain(rises).fold(now.saturating_add(LOOK_PERIOD), Instant::min);
        if core::mem::take(&mut self.clears) && seen.stopped {
            return Some(Command::ClearFaults(Scope::All));
        }
        self.drive(now)
    }

    /// Takes where the servos' pulses are.
    pub fn look(&mut self, now: Instant, pulses: &[Option<ServoPulse>; JOINTS]) {
        for (joint, pulse) in self.joints.iter_mut().zip(pulses) {
            joint.look(*pulse, now);
        }
    }

    /// A fault stops the servos, or does no more, or did between two looks.
    fn heed(&mut self, now: Instant, seen: Seen) {
        let lacks_pulses = self.power != Power::Off && !seen.has_pulses && !seen.is_held;
        self.lacking_since = lacks_pulses.then_some(self.lacking_since.unwrap_or(now));
        let has_tripped =
            self.lacking_since.is_some_and(|since| now >= since.saturating_add(PULSES_TAKE));
        let is_taken = seen.stopped || has_tripped;
        if is_taken && self.power != Power::Off {
            // The board is told too: a pulse that was on its way to it may have come after a clear.
            self.power = Power::Off;
            self.power_lost = self.power_lost.wrapping_add(1);
            self.each(Joints::All, Joint::stop);
        }
        self.needs_init |= is_taken;
        self.stopped = seen.stopped;
    }

    /// Whether the arm is there, and what a probe has found.
    fn watch(&mut self, now: Instant, present: bool) {
        if self.connected && !present {
            self.connected = false;
            if self.power != Power::Off {
                self.needs_init = true;
                self.lost = self.lost.wrapping_add(1);
                self.park(true);
            }
        }
        if self.reset_until.take_if(|until| *until <= now).is_some() {
            self.connected = present;
            self.needs_init = self.stopped || (self.needs_init && !present);
        }
        if self.check_until.take_if(|until| *until <= now).is_some() {
            self.connected = present;
        }
    }

    /// AUTOPARK and GRIPPARK.
    fn keep_times(&mut self, now: Instant) {
        let is_over = |since: Instant, seconds: u16| {
            seconds > 0 && now >= since.saturating_add(Duration::from_secs(seconds.into()))
        };
        let [.., gripper] = &mut self.joints;
        if self.power == Power::Off || !gripper.is_held_closed() {
            // So a position or a STOP on the way home gives it its time again.
            self.closed_since = None;
        } else if is_over(*self.closed_since.get_or_insert(now), self.grippark_s) {
            gripper.home(true);
        }
        if self.joints.iter().any(Joint::is_moving) {
            self.idle_since = now;
        }
        if self.power == Power::On && is_over(self.idle_since, self.autopark_s) {
            self.park(true);
        }
    }

    /// The next command that has the board drive the joints as they need it.
    fn drive(&mut self, now: Instant) -> Option<Command> {
        let mut slews = self.slews();
        if slews == self.driven {
            return None;
        }
        let driven = core::mem::replace(&mut self.driven, slews);
        if self.power == Power::Off {
            return Some(Command::Run { scope: Scope::All, run: false });
        }
        for ((joint, slew), driven) in self.joints.iter_mut().zip(&mut slews).zip(driven) {
            // One that goes on as before is left alone.
            if *slew == driven {
                *slew = None;
            } else {
                joint.set_out(now);
            }
        }
        Some(Command::SlewServos(slews))
    }

    /// The ways that the joints are on; none without power.
    fn slews(&self) -> [Option<Slew>; JOINTS] {
        self.joints.each_ref().map(|joint| match self.power {
            Power::Off => None,
            _ if self.has_pulses => Some(joint.slew()),
            _ => Some(joint.hold()),
        })
    }

    /// All joints home, then power off.
    fn park(&mut self, unhurried: bool) {
        if self.power != Power::Off {
            self.power = Power::Parking;
            self.each(Joints::All, |joint| joint.home(unhurried));
        }
    }

    /// When the power goes off: all joints are home, and their servos too.
    fn parks_at(&self) -> Option<Instant> {
        if self.power != Power::Parking {
            return None;
        }
        self.joints.iter().try_fold(Instant::MIN, |last, joint| Some(last.max(joint.rests_at()?)))
    }

    /// Whether the arm takes orders.
    fn obeys(&self) -> Result<(), Ignored> {
        if !self.connected {
            Err(Ignored::NotConnected)
        } else if self.stopped {
            Err(Ignored::Fault)
        } else if self.needs_init {
            Err(Ignored::NeedsInit)
        } else {
            Ok(())
        }
    }

    /// Whether it takes orders to move.
    fn moves(&self) -> Result<(), Ignored> {
        self.obeys()?;
        if self.power == Power::Off { Err(Ignored::NoPower) } else { Ok(()) }
    }

    fn each(&mut self, joints: Joints, mut act: impl FnMut(&mut Joint)) {
        let all = self.joints.iter_mut().zip(JointNumber::ALL);
        all.filter(|&(_, number)| joints.include(number)).for_each(|(joint, _)| act(joint));
    }
}
