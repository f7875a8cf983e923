//! The core's words in the extension's.

use protocol::extension::{self as wire, ChannelState, Mode};

use crate::channel::{ChannelSet, Method};
use crate::control::axis::AxisRefusal;
use crate::controller::{ChannelSnapshot, Reason};
use crate::ports::{MotorOutput, ResetCause};
use crate::recorder;
use crate::safety::faults::FaultRecord;
use crate::settings::store::Origin;
use crate::settings::{Setting, Unit};

pub(super) fn description(setting: Setting) -> wire::Description<'static> {
    let Setting { number, next, value, range, default, unit, name, member } = setting;
    let unit = match unit {
        Unit::Choice => wire::Unit::Choice,
        Unit::Flag => wire::Unit::Flag,
        Unit::Bits => wire::Unit::Bits,
        Unit::Milliseconds => wire::Unit::Milliseconds,
        Unit::Centimetres => wire::Unit::Centimetres,
        Unit::AdCounts => wire::Unit::AdCounts,
        Unit::Counts => wire::Unit::Counts,
        Unit::CountsPerSecond => wire::Unit::CountsPerSecond,
        Unit::Duty => wire::Unit::Duty,
        Unit::Seconds => wire::Unit::Seconds,
        Unit::Ticks => wire::Unit::Ticks,
    };
    wire::Description { number, next, value, range, default, unit, name, member }
}

pub(super) fn channel_state(
    channel: &ChannelSnapshot,
    output: &MotorOutput,
    current: u16,
) -> ChannelState {
    let is_on = output.enabled;
    let set_point = if is_on { channel.set_point.rounded() } else { 0 };
    let (reason, detail) = match channel.reason {
        None => (wire::Reason::None, 0),
        Some(Reason::Fault(fault)) => (wire::Reason::Fault, fault.number()),
        Some(Reason::Silence) => (wire::Reason::Silence, 0),
        Some(Reason::OldCommand) => (wire::Reason::OldCommand, 0),
        Some(Reason::Suspended) => (wire::Reason::Suspended, 0),
        Some(Reason::Refused { why: AxisRefusal::OtherMethod, origin }) => {
            (wire::Reason::OtherMethod, origin)
        }
        Some(Reason::Refused { why: AxisRefusal::BeyondScale, origin }) => {
            (wire::Reason::BeyondScale, origin)
        }
        Some(Reason::Obstacle) => (wire::Reason::Obstacle, 0),
        Some(Reason::SoftLimit) => (wire::Reason::SoftLimit, 0),
        Some(Reason::OverCurrent) => (wire::Reason::OverCurrent, 0),
        Some(Reason::Overload) => (wire::Reason::Overload, 0),
        Some(Reason::HighestDuty) => (wire::Reason::HighestDuty, 0),
        Some(Reason::Slew) => (wire::Reason::Slew, 0),
        Some(Reason::FullDrive) => (wire::Reason::FullDrive, 0),
    };
    ChannelState {
        position: channel.position,
        velocity: channel.velocity.saturating_round().to_num(),
        set_point,
        duty: output.duty.raw(),
        current,
        mode: mode(is_on.then(|| channel.set_point.method())),
        reason,
        detail,
    }
}

fn mode(method: Option<Method>) -> Mode {
    match method {
        None => Mode::Off,
        Some(Method::Pwm) => Mode::Pwm,
        Some(Method::Position) => Mode::Position,
        Some(Method::Velocity) => Mode::Velocity,
    }
}

pub(super) fn setup(setup: wire::Setup) -> recorder::Setup {
    let wire::Setup { channels, trigger, decimation, samples, before } = setup;
    let trigger = match trigger {
        wire::Trigger::Now => recorder::Trigger::Now,
        wire::Trigger::Motion => recorder::Trigger::Motion,
        wire::Trigger::Fault => recorder::Trigger::Fault,
    };
    let channels = ChannelSet::from_bits(channels);
    recorder::Setup { channels, trigger, decimation, samples, before }
}

pub(super) fn recording(recording: recorder::Recording) -> wire::Recording {
    let recorder::Recording { serial, phase, setup, taken, before, triggered_ms, capacity } =
        recording;
    let phase = match phase {
        recorder::Phase::None => wire::Phase::None,
        recorder::Phase::Waiting => wire::Phase::Waiting,
        recorder::Phase::Recording => wire::Phase::Recording,
        recorder::Phase::Done => wire::Phase::Done,
    };
    let trigger = match setup.trigger {
        recorder::Trigger::Now => wire::Trigger::Now,
        recorder::Trigger::Motion => wire::Trigger::Motion,
        recorder::Trigger::Fault => wire::Trigger::Fault,
    };
    let recorder::Setup { channels, decimation, samples, .. } = setup;
    let channels = channels.bits();
    wire::Recording {
        serial,
        phase,
        channels,
        trigger,
        decimation,
        samples,
        taken,
        before,
        triggered_ms,
        capacity,
    }
}

pub(super) fn row(row: recorder::Row) -> wire::Row {
    let recorder::Row { position, velocity, set_point, duty, current, method } = row;
    wire::Row {
        position,
        velocity: velocity.saturating_round().to_num(),
        set_point,
        duty: duty.raw(),
        current,
        mode: mode(method),
    }
}

pub(super) fn reset_cause(cause: ResetCause) -> wire::ResetCause {
    match cause {
        ResetCause::Unknown => wire::ResetCause::Unknown,
        ResetCause::Power => wire::ResetCause::Power,
        ResetCause::Pin => wire::ResetCause::Pin,
        ResetCause::Software => wire::ResetCause::Software,
        ResetCause::Watchdog => wire::ResetCause::Watchdog,
    }
}

pub(super) fn origin(origin: Origin) -> wire::Origin {
    match origin {
        Origin::Defaults => wire::Origin::Defaults,
        Origin::Stored => wire::Origin::Stored,
        Origin::Corrupt => wire::Origin::Corrupt,
    }
}

/// Faults have the same numbers in both: a test says so.
pub(super) fn fault_record(record: FaultRecord) -> Option<wire::FaultRecord> {
    let FaultRecord { fault, channel, uptime_ms, values } = record;
    let channel = channel.map(|channel| channel.index() as u8);
    let fault = wire::Fault::from_number(fault.number())?;
    Some(wire::FaultRecord { fault, channel, uptime_ms, values })
}

#[cfg(test)]
mod tests {
    use protocol::extension::{Answer, did};

    use super::*;
    use crate::safety::faults::Fault;
    use crate::settings::Settings;

    #[test]
    fn every_fault_has_the_name_and_the_number_on_the_wire_that_it_has_in_the_core() {
        let names = |fault: &Fault| (fault.number(), format!("{fault:?}"));
        let wire_names = |fault: &wire::Fault| (fault.number(), format!("{fault:?}"));
        let core: Vec<_> = Fault::ALL.iter().map(names).collect();
        assert_eq!(core, wire::Fault::ALL.iter().map(wire_names).collect::<Vec<_>>());
    }

    #[test]
    fn every_setting_can_be_told() {
        for (number, _) in Settings::DEFAULT.iter() {
            let answer = Answer::Setting(description(Settings::DEFAULT.describe(number).unwrap()));
            let mut data = protocol::pms5005::Data::new();
            answer.emit(&mut data).unwrap();
            assert_eq!(Answer::parse(did::SETTING, &data), Some(answer));
        }
    }
}
