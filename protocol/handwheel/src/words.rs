//! Faults, reasons, units and states for people, each with the remedy.

use protocol::extension::{
    ChannelState, Fault, FaultRecord, Mode, Origin, Reason, ResetCause, Unit, Verdict,
};

use crate::number::Number;

/// A fault's name.
pub fn fault(fault: Fault) -> &'static str {
    explained(fault).0
}

/// What to check when a fault has tripped.
pub fn remedy(fault: Fault) -> &'static str {
    explained(fault).1
}

/// Name and remedy.
fn explained(fault: Fault) -> (&'static str, &'static str) {
    match fault {
        Fault::OverCurrent => (
            "over current",
            "the motor drew too much for 2 s: a jam, a short, or too small a bridge",
        ),
        Fault::Stall => ("stall", "the shaft was held fast while it was driven: free it"),
        Fault::TrackingError => (
            "tracking error",
            "the shaft went the wrong way or the loop hunted: see the polarity, the sensor's wires, and Kp",
        ),
        Fault::SensorLost => (
            "sensor lost",
            "driven, and the sensor saw nothing: see its plug, its wires, and which sensor is set",
        ),
        Fault::Overload => ("overload", "too much current for too long: less load, or pauses"),
        Fault::CurrentSensor => (
            "current sensor",
            "a current where none can be: see the sensor, or set \"current sensor\" of the channel to 0",
        ),
        Fault::MotorBatteryLow => ("motor battery low", "charge the motors' battery"),
        Fault::MotorBatteryHigh => ("motor battery high", "see the motors' supply"),
        Fault::ServoBatteryLow => ("servo battery low", "charge the servos' battery"),
        Fault::MainBatteryLow => ("main battery low", "charge the board's battery"),
        Fault::DriverTooHot => ("driver too hot", "let the motor drivers cool, and give them air"),
        Fault::AmbientTooHot => ("ambient too hot", "let it cool"),
        Fault::LinkLoss => (
            "link loss",
            "on record only: the host fell silent, and what moved was stopped; so does every host that ends",
        ),
        Fault::PeriodMissed => ("control period missed", "the board has too much to do: report it"),
        Fault::ReceiveOverrun => ("receive overrun", "bytes were lost: see the baud rate"),
        Fault::SettingsCorrupt => (
            "settings corrupt",
            "what was stored was damaged, and the defaults are in force: `restore` a backup",
        ),
        Fault::WatchdogReset => {
            ("watchdog reset", "the program had hung and was restarted: report it")
        }
    }
}

/// Whose fault it is: `motor 1`, or `the board`.
pub fn whose(record: &FaultRecord) -> String {
    match record.channel.and_then(|channel| Number::new(channel.saturating_add(1))) {
        Some(motor) => format!("motor {motor}"),
        None => "the board".into(),
    }
}

/// What was true when it tripped, each with its name and unit.
pub fn values(record: &FaultRecord) -> Vec<(&'static str, i16)> {
    record.fault.values().iter().copied().zip(record.values).collect()
}

/// What a channel is doing.
pub fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Off => "off",
        Mode::Pwm => "PWM",
        Mode::Position => "position",
        Mode::Velocity => "velocity",
    }
}

/// Why a channel does not do what was asked, `None` if it does.
pub fn reason(state: &ChannelState) -> Option<String> {
    Some(match state.reason {
        Reason::None => return None,
        Reason::Fault => match Fault::from_number(state.detail) {
            Some(of) => {
                format!("fault {}, {}: {}; then clear it", state.detail, fault(of), remedy(of))
            }
            None => format!("fault {}", state.detail),
        },
        Reason::Silence => "the host fell silent".into(),
        Reason::Suspended => "suspended".into(),
        Reason::OtherMethod => {
            format!("command {} refused: the channel's \"method\" is set to another", state.detail)
        }
        Reason::BeyondScale => {
            format!("command {} refused: the target is beyond the sensor's scale", state.detail)
        }
        Reason::Obstacle => "an obstacle is in the way".into(),
        Reason::SoftLimit => "held at a soft limit".into(),
        Reason::OverCurrent => "the current is too high: the drive is limited".into(),
        Reason::Overload => "the current was too high for too long: the drive is limited".into(),
        Reason::Slew => "its slew time limits the drive".into(),
        Reason::HighestDuty => "its highest duty limits the drive".into(),
        Reason::FullDrive => {
            "it has all the drive there is, and that is not enough: held fast, or too weak".into()
        }
        Reason::OldCommand => {
            "its last motion command grew too old (`handwheel set oldest command 0` allows any age)"
                .into()
        }
    })
}

/// A unit behind a value, empty where the value says it all.
pub fn unit(unit: Unit) -> &'static str {
    match unit {
        Unit::Choice => "",
        Unit::Flag => "0 no, 1 yes",
        Unit::Bits => "bits",
        Unit::Milliseconds => "ms",
        Unit::Centimetres => "cm",
        Unit::AdCounts => "A/D counts",
        Unit::Counts => "counts",
        Unit::CountsPerSecond => "counts/s",
        Unit::Duty => "1/16384 of full drive",
        Unit::Microseconds => "us",
        Unit::Seconds => "s",
        Unit::Ticks => "ticks",
    }
}

/// How a setting is called whose name is not known.
pub(crate) fn setting(number: u16) -> String {
    format!("setting {number}")
}

/// Why a board refuses, and what to do.
pub fn verdict(verdict: Verdict) -> String {
    let remedy = match verdict {
        Verdict::OutputsOn => "; `handwheel stop` does that",
        Verdict::Unknown => "; bring its firmware up to date",
        Verdict::Contradiction => "; set both in one `restore`, or the other one first",
        Verdict::Busy => ", or another host's is",
        _ => "",
    };
    format!("{verdict}{remedy}")
}

/// Why a board has started.
pub fn reset(cause: ResetCause) -> &'static str {
    match cause {
        ResetCause::Unknown => "for an unknown reason",
        ResetCause::Power => "when power came",
        ResetCause::Pin => "by its reset pin",
        ResetCause::Software => "by itself, as it was told",
        ResetCause::Watchdog => "by its watchdog: the program had hung",
    }
}

/// Where its settings came from when it started.
pub fn origin(origin: Origin) -> &'static str {
    match origin {
        Origin::Defaults => "the defaults: nothing had ever been saved",
        Origin::Stored => "as saved",
        Origin::Corrupt => "the defaults, as what was stored was damaged: `restore` a backup",
    }
}

/// Motor current in A.
pub fn amperes(counts: u16) -> f64 {
    f64::from(counts) / 728.0
}

/// The batteries in V: main board, motors, servos.
pub fn volts(battery: [u16; 3]) -> [f64; 3] {
    let [main, motors, servos] = battery.map(f64::from);
    [9.0 * main / 4095.0, 24.0 * motors / 4095.0, 9.0 * servos / 4095.0]
}

/// A duty in percent of full drive.
pub fn percent(duty: i16) -> f64 {
    f64::from(duty) * 100.0 / 16384.0
}

/// `1 d 2 h`, `3 min 12 s`, `12.3 s`.
pub fn duration(ms: u64) -> String {
    let seconds = ms / 1000;
    match seconds {
        0..60 => format!("{}.{} s", seconds, ms % 1000 / 100),
        60..3600 => format!("{} min {} s", seconds / 60, seconds % 60),
        3600..86_400 => format!("{} h {} min", seconds / 3600, seconds / 60 % 60),
        _ => format!("{} d {} h", seconds / 86_400, seconds / 3600 % 24),
    }
}

/// Infrared range in cm, 10 to 80 (Table II.4).
pub fn infrared_cm(counts: u16) -> f64 {
    let volts = 3.0 * f64::from(counts) / 4028.0 - 0.17;
    if volts > 0.0 { (21.6 / volts).clamp(10.0, 80.0) } else { 80.0 }
}

/// What a setting is about, by its name.
pub fn group(name: &str) -> &'static str {
    let stem = match name.rsplit_once(' ') {
        Some((stem, member)) if member.parse::<u8>().is_ok() => stem,
        _ => name,
    };
    match stem {
        "position Kp" | "position Kd" | "position Ki" | "velocity Kp" | "velocity Kd"
        | "velocity Ki" | "Ki reading" => "gains",
        "sensor" | "method" | "polarity" | "full speed encoder" | "full speed potentiometer" => {
            "sensors and motors"
        }
        "slew time" | "acceleration" | "highest duty" | "integral share" | "soft limit low"
        | "soft limit high" => "limits",
        "link timeout"
        | "longest move"
        | "oldest command"
        | "telemetry period"
        | "machine state period" => "host",
        _ if stem.starts_with("sonar")
            || stem.starts_with("infrared")
            || stem.starts_with("wheel")
            || stem.starts_with("collision") =>
        {
            "collision protection"
        }
        _ if stem.starts_with("arm ") || stem.starts_with("joint ") => "arm",
        _ if stem.contains("battery")
            || stem.contains("driver")
            || stem.contains("hot")
            || stem.contains("thermometer") =>
        {
            "supply and heat"
        }
        _ => "protection",
    }
}

/// The nearest of some names, if one is near enough to be meant: the shortest in which words begin as these
/// do, else the one that is spelled most like it.
pub fn nearest<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let name = name.to_lowercase();
    let names: Vec<&str> = names.into_iter().collect();
    let begins = |other: &&&str| {
        let other = other.to_lowercase();
        let begun = |word: &str| other.split(' ').any(|its| its.starts_with(word));
        !name.trim().is_empty() && name.split_whitespace().all(begun)
    };
    if let Some(found) = names.iter().filter(begins).min_by_key(|other| other.len()) {
        return Some((*found).to_owned());
    }
    let scored = names
        .into_iter()
        .map(|other| (strsim::normalized_damerau_levenshtein(&name, &other.to_lowercase()), other));
    let best = scored.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (best.0 >= 0.4).then(|| best.1.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_name_is_the_one_that_was_meant() {
        let names = ["telemetry period", "link timeout", "soft limit low 1", "soft limit high 1"];
        assert_eq!(nearest("telemetri period", names).as_deref(), Some("telemetry period"));
        assert_eq!(nearest("softlimit low 1", names).as_deref(), Some("soft limit low 1"));
        assert_eq!(nearest("soft", names).as_deref(), Some("soft limit low 1"));
        assert_eq!(nearest("tele per", names).as_deref(), Some("telemetry period"));
        assert_eq!(nearest("xyzzy", names), None);
    }

    #[test]
    fn every_fault_says_what_to_check() {
        for &number in Fault::ALL {
            assert!(!fault(number).is_empty() && !remedy(number).is_empty());
        }
    }

    /// For people who read no Rust.
    const PAGE: &str = include_str!("../../README.md");

    #[test]
    fn the_page_of_the_wire_has_the_same_names_and_remedies() {
        for &number in Fault::ALL {
            let begins = format!("| {} | {} | ", number.number(), fault(number));
            let ends = format!(" | {} |", remedy(number));
            let is_row = |line: &str| line.starts_with(&begins) && line.ends_with(&ends);
            assert!(PAGE.lines().any(is_row), "{begins}...{ends}");
        }
    }

    #[test]
    fn times_are_said_as_people_say_them() {
        assert_eq!(duration(12_345), "12.3 s");
        assert_eq!(duration(192_000), "3 min 12 s");
        assert_eq!(duration(90_000_000), "1 d 1 h");
    }
}
