//! Numbers that stand for something.

use std::fmt::Debug;

use protocol::extension::{Fault, Mode, Origin, Phase, Reason, ResetCause, Trigger, Unit, Verdict};

use crate::text::{table, words};

/// Numbers and names of the table under this heading, and of the crate.
fn compare<T: Debug + Copy>(title: &str, all: &[T], number: impl Fn(T) -> u8) {
    let told: Vec<_> =
        table(title, "number").iter().map(|row| format!("{} {}", row[0], row[1])).collect();
    let code = |code: &T| format!("{} {}", number(*code), words(&format!("{code:?}")));
    assert_eq!(told, all.iter().map(code).collect::<Vec<_>>());
}

#[test]
fn codes_have_the_numbers_and_names_of_the_page() {
    compare("Verdict", Verdict::ALL, Verdict::number);
    compare("Mode", Mode::ALL, Mode::number);
    compare("Reason", Reason::ALL, Reason::number);
    compare("Trigger", Trigger::ALL, Trigger::number);
    compare("Phase", Phase::ALL, Phase::number);
    compare("Reset cause", ResetCause::ALL, ResetCause::number);
    compare("Origin", Origin::ALL, Origin::number);
    compare("Unit", Unit::ALL, Unit::number);
}

/// "none" for nothing.
fn listed(items: &[String]) -> String {
    if items.is_empty() { "none".into() } else { items.join(", ") }
}

#[test]
fn faults_have_the_numbers_and_values_of_the_page() {
    let told: Vec<_> = table("Faults by number", "number")
        .iter()
        .map(|row| [row[0], row[2], row[4]].map(str::to_owned))
        .collect();
    let expected = |&fault: &Fault| {
        let of = if fault.number() < 16 { "a channel" } else { "the board" };
        let values: Vec<_> = fault.values().iter().map(|value| (*value).to_owned()).collect();
        [fault.number().to_string(), of.into(), listed(&values)]
    };
    assert_eq!(told, Fault::ALL.iter().map(expected).collect::<Vec<_>>());
}

/// The faults that "faults 2, 4: ..." and "faults 16 to 21: ..." are about.
fn faults_of(what: &str) -> Vec<u16> {
    let Some((faults, _)) = what.split_once(':') else { return Vec::new() };
    let Some(numbers) = faults.strip_prefix("fault") else { return Vec::new() };
    numbers_of(numbers.trim_start_matches('s').trim())
}

/// "1, 3 to 5".
fn numbers_of(text: &str) -> Vec<u16> {
    let range = |part: &str| {
        let (first, last) = part.split_once(" to ").unwrap_or((part, part));
        first.parse::<u16>().unwrap()..=last.parse().unwrap()
    };
    text.split(", ").flat_map(range).collect()
}

#[test]
fn faults_name_the_settings_that_are_about_them() {
    let settings = table("Settings by number", "number");
    for row in table("Faults by number", "number") {
        let fault: u16 = row[0].parse().unwrap();
        let mut about: Vec<u16> = settings
            .iter()
            .filter(|setting| faults_of(setting[5]).contains(&fault))
            .map(|setting| setting[0].parse().unwrap())
            .collect();
        match fault {
            6 => about.extend(100..=105), // whether a channel has a current sensor
            22 => about.push(1),          // the link's timeout
            _ => {}
        }
        about.sort_unstable();
        let told = if row[5] == "none" { Vec::new() } else { numbers_of(row[5]) };
        assert_eq!(told, about, "fault {fault}");
    }
}

#[test]
fn settings_have_units_that_there_are() {
    for row in table("Settings by number", "number") {
        let is_known = |unit: &Unit| format!("{unit:?}") == row[2];
        assert!(Unit::ALL.iter().any(is_known), "{}", row[2]);
    }
}
