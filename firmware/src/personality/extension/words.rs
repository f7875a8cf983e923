//! The core's words in the extension's.

use protocol::extension::{self as wire, ChannelState, Mode};

use crate::control::axis::{AxisRefusal, SetPoint};
use crate::controller::{ChannelSnapshot, Reason};
use crate::ports::{MotorOutput, ResetCause};
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
    let (mode, set_point) = match channel.set_point {
        _ if !output.enabled => (Mode::Off, 0),
        SetPoint::Duty(duty) => (Mode::Pwm, duty.raw()),
        SetPoint::Position(counts) => {
            (Mode::Position, counts.saturating_round().saturating_to_num())
        }
        SetPoint::Velocity(speed) => (Mode::Velocity, speed.saturating_round().saturating_to_num()),
    };
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
        mode,
        reason,
        detail,
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
