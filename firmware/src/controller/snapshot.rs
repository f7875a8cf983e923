//! What a personality may tell of the controller: the state of things after a period.

use super::reason::Reason;
use crate::channel::{CHANNELS, ChannelSet, ENCODERS};
use crate::control::axis::{AxisRefusal, SetPoint};
use crate::ports::{MotionInputs, MotorOutput, Outputs, Sensors};
use crate::safety::faults::FaultRecord;
use crate::safety::latch::Latched;
use crate::units::{CountsPerSecond, Duty, ServoPulse};

/// What an encoder says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EncoderReading {
    /// 0 to 32767.
    pub count: u16,
    /// Counts per second.
    pub velocity: CountsPerSecond,
}

/// What the controller has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ControlCounters {
    /// Control periods since boot; wraps.
    pub periods: u32,
    /// The time since boot in ms, by those and what was missed between them; wraps after 49 days.
    pub uptime_ms: u32,
    /// Commands refused.
    pub refused: Refusals,
    /// Times the host fell silent; wraps.
    pub links_lost: u32,
    /// Control periods that began so late that others were missed; wraps.
    pub periods_missed: u32,
}

/// Commands refused, by reason. They wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refusals {
    /// The channel was set to another method.
    pub method: u32,
    /// The target lay beyond the sensor's scale.
    pub scale: u32,
}

impl Refusals {
    const NONE: Self = Self { method: 0, scale: 0 };

    pub(super) fn count(&mut self, reason: AxisRefusal) {
        let counter = match reason {
            AxisRefusal::OtherMethod => &mut self.method,
            AxisRefusal::BeyondScale => &mut self.scale,
        };
        *counter = counter.wrapping_add(1);
    }

    /// All of them.
    pub fn total(&self) -> u32 {
        self.method.wrapping_add(self.scale)
    }
}

/// What may be told of a DC channel after a period. What its bridge does is among the outputs, its current
/// among what was measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChannelSnapshot {
    /// Counts of its sensor, turn by turn since boot; wraps.
    pub position: i32,
    /// By its sensor.
    pub velocity: CountsPerSecond,
    /// What it is asked for at this moment of its move.
    pub set_point: SetPoint,
    /// Why it does not do what was asked of it, if so.
    pub reason: Option<Reason>,
}

impl ChannelSnapshot {
    const BOOT: Self = Self {
        position: 0,
        velocity: CountsPerSecond::ZERO,
        set_point: SetPoint::Duty(Duty::NEUTRAL),
        reason: None,
    };
}

/// The state of things after a period: what a personality may tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Snapshot {
    /// What was measured for this period.
    pub motion: MotionInputs,
    /// The encoders on the protocol's scale.
    pub encoders: [EncoderReading; ENCODERS],
    /// The newest reading of the slow sensors.
    pub sensors: Sensors,
    /// What was driven in this period.
    pub outputs: Outputs,
    /// Where each servo's set-point is, whether it has pulses or not; `None` before its first command.
    pub servos: [Option<ServoPulse>; CHANNELS],
    /// The host, once heard, is silent, or channels that it left running were stopped for that
    /// and have not been commanded since.
    pub link_loss: bool,
    /// The collision protection forbids forward drive.
    pub obstacle: bool,
    /// The DC channels.
    pub channels: [ChannelSnapshot; CHANNELS],
    /// Which DC channels have no current sensor that can be believed: a setting says so, or the input
    /// reads a current where none can be. Stall by current and overload are off there.
    pub no_current_sensor: [bool; CHANNELS],
    /// Counters.
    pub counters: ControlCounters,
    /// The longest time so far, in microseconds, from the tick that begins a control period until
    /// its outputs stood. The controller has no clock: whoever runs it fills this in.
    pub worst_latency_us: u16,
    /// The faults that are latched.
    pub faults: Latched,
    /// The record that [`Command::ShowFault`](crate::command::Command::ShowFault) asks for.
    pub shown_fault: ShownFault,
    /// What came of the last [`Command::SetCount`](crate::command::Command::SetCount).
    pub count_set: CountSet,
    /// Channels that have begun to carry out a motion command in this period.
    pub moved: ChannelSet,
}

/// A place in the list of fault records, and what stands there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShownFault {
    /// From 0, in the order in which they tripped.
    pub place: u8,
    /// Records that are kept.
    pub total: u8,
    /// `None` behind the last.
    pub record: Option<FaultRecord>,
}

/// Why an encoder's count was not set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CountRefusal {
    /// The channel has no encoder.
    NoEncoder,
    /// The channel is not off.
    NotOff,
}

/// What came of setting an encoder's count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountSet {
    /// The command's.
    pub serial: u8,
    /// Why it was not set, if so.
    pub refused: Option<CountRefusal>,
}

impl CountSet {
    pub(super) const NONE: Self = Self { serial: 0, refused: None };
}

impl Snapshot {
    /// Before the first period.
    pub const BOOT: Self = Self {
        motion: MotionInputs { potentiometers: [0; 6], currents: [0; 6], encoders: [0; 2] },
        encoders: [EncoderReading { count: 0, velocity: CountsPerSecond::ZERO }; ENCODERS],
        sensors: Sensors::UNKNOWN,
        outputs: Outputs {
            motors: [MotorOutput { duty: Duty::NEUTRAL, enabled: false }; CHANNELS],
            servos: [None; CHANNELS],
            gpio: 0,
        },
        servos: [None; CHANNELS],
        link_loss: false,
        obstacle: false,
        channels: [ChannelSnapshot::BOOT; CHANNELS],
        no_current_sensor: [false; CHANNELS],
        worst_latency_us: 0,
        faults: Latched::NONE,
        shown_fault: ShownFault { place: 0, total: 0, record: None },
        count_set: CountSet::NONE,
        moved: ChannelSet::NONE,
        counters: ControlCounters {
            periods: 0,
            uptime_ms: 0,
            refused: Refusals::NONE,
            links_lost: 0,
            periods_missed: 0,
        },
    };
}
