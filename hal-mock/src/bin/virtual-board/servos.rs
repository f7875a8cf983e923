//! The servos that the options ask for, and what goes wrong on their bus.

use hal_mock::servo_bus::Faults;

/// The highest ID of a servo.
const HIGHEST_ID: u8 = 253;
/// A fault rate of one.
const CERTAIN_PPM: u32 = 1_000_000;

/// The IDs from `lowest` on in a list of numbers and ranges, as from the option `--servos`.
pub fn ids(list: &str, lowest: u8) -> Result<Vec<u8>, String> {
    let part = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (first, last): (u8, u8) = (first.trim().parse().ok()?, last.trim().parse().ok()?);
        (lowest <= first && first <= last && last <= HIGHEST_ID).then_some(first..=last)
    };
    let ranges: Option<Vec<_>> = list.split(',').map(part).collect();
    let ids = ranges.map(|ranges| ranges.into_iter().flatten().collect());
    let wrong = || {
        format!("--servos {list}: expected IDs from {lowest} to {HIGHEST_ID}, as 1-6 or 1,2,5-7")
    };
    ids.ok_or_else(wrong)
}

/// The rates in a list like `dropped=100,stalled=2000`, as from the option `--bus-faults`.
pub fn faults(list: &str) -> Result<Faults, String> {
    let mut faults = Faults::default();
    for part in list.split(',').filter(|part| !part.is_empty()) {
        let rate = |value: &str| value.parse().ok().filter(|ppm| *ppm <= CERTAIN_PPM);
        let named = part.split_once('=').and_then(|(name, value)| {
            let place = match name.trim() {
                "dropped" => &mut faults.dropped_ppm,
                "flipped" => &mut faults.flipped_ppm,
                "stalled" => &mut faults.stalled_ppm,
                _ => return None,
            };
            *place = rate(value.trim())?;
            Some(())
        });
        named.ok_or(format!(
            "--bus-faults {list}: expected dropped=, flipped= or stalled= and parts of a million, \
             as flipped=100,stalled=2000"
        ))?;
    }
    Ok(faults)
}
