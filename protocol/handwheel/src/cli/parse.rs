//! Values as people write them: `500ms`, `50%`, `1500us`, `0xA5`. What cannot be read is answered with how
//! it is written.

use std::time::Duration;

/// `2s`, `1.5s`, `500ms`.
pub fn time(text: &str) -> Result<Duration, String> {
    let wrong = || format!("{text}: write a time as 2s or 500ms");
    let (number, scale) = match (text.strip_suffix("ms"), text.strip_suffix('s')) {
        (Some(number), _) => (number, 0.001),
        (None, Some(number)) => (number, 1.0),
        (None, None) => return Err(wrong()),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| wrong())? * scale;
    Duration::try_from_secs_f64(seconds).map_err(|_| wrong())
}

/// The time of a ramp: at most 65,535 ms on the wire.
pub fn ramp(text: &str) -> Result<Duration, String> {
    let time = time(text)?;
    match time.as_millis() {
        0..=0xFFFF => Ok(time),
        _ => Err(format!("{text}: 65s at the most")),
    }
}

/// `50%`, `-12.5%`: -1 to 1.
pub fn percent(text: &str) -> Result<f64, String> {
    let percent = text.strip_suffix('%').and_then(|number| number.trim().parse::<f64>().ok());
    let percent = percent.ok_or_else(|| format!("{text}: write a duty as 50% or -50%"))?;
    if (-100.0..=100.0).contains(&percent) {
        Ok(percent / 100.0)
    } else {
        Err(format!("{text}: -100% to 100%"))
    }
}

/// `50%`: more than nothing of full drive.
pub fn share(text: &str) -> Result<f64, String> {
    let share = percent(text)?;
    if share >= 0.01 { Ok(share) } else { Err(format!("{text}: 1% to 100%")) }
}

/// `-4000`: whole counts, or counts a second, of the wire's 16 bits.
pub fn counts(text: &str) -> Result<i16, String> {
    let number = text.parse::<i16>().ok().filter(|&number| number > i16::MIN);
    number.ok_or_else(|| "a whole number of -32767 to 32767 is wanted".into())
}

/// `6000`: a position, which is not negative on the wire.
pub fn position(text: &str) -> Result<i16, String> {
    let number = text.parse::<i16>().ok().filter(|&number| number >= 0);
    number.ok_or_else(|| "a whole number of 0 to 32767 is wanted".into())
}

/// `1500us`: microseconds.
pub fn pulse(text: &str) -> Result<f64, String> {
    let number = text.strip_suffix("us").or_else(|| text.strip_suffix("µs"));
    let number = number.and_then(|number| number.trim().parse::<f64>().ok());
    number.filter(|us| us.is_finite()).ok_or_else(|| format!("{text}: write a pulse as 1500us"))
}

/// `165`, `0xA5`, `0b10100101`.
pub fn byte(text: &str) -> Result<u8, String> {
    let number = match text.get(..2).zip(text.get(2..)) {
        Some(("0x" | "0X", digits)) => u8::from_str_radix(digits, 16),
        Some(("0b" | "0B", digits)) => u8::from_str_radix(digits, 2),
        _ => text.parse(),
    };
    number.map_err(|_| format!("{text}: 0 to 255, as 165, 0xA5 or 0b10100101"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_read_as_people_write_them() {
        assert_eq!(time("2s"), Ok(Duration::from_secs(2)));
        assert_eq!(time("1.5s"), Ok(Duration::from_millis(1500)));
        assert_eq!(time("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!((percent("50%"), percent("-12.5%")), (Ok(0.5), Ok(-0.125)));
        assert_eq!(pulse("1500us"), Ok(1500.0));
        assert_eq!((byte("0xA5"), byte("0b101"), byte("255")), (Ok(0xA5), Ok(5), Ok(255)));
    }

    #[test]
    fn counts_are_whole_and_the_wires() {
        assert_eq!((counts("-4000"), position("6000")), (Ok(-4000), Ok(6000)));
        for wrong in ["abc", "1.5", "-32768", "40000", ""] {
            assert!(counts(wrong).is_err(), "{wrong}");
        }
        assert!(position("-5").is_err());
    }

    #[test]
    fn what_cannot_be_read_is_answered_with_how_it_is_written() {
        for wrong in ["2", "-2s", "s", "xs", "infs", "nans", "1e300s", ""] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
        for wrong in ["50", "101%", "-101%", "%", "nan%", "--for"] {
            assert!(percent(wrong).is_err(), "{wrong}");
        }
        assert!(ramp("66s").is_err() && ramp("65535ms").is_ok());
        assert!(pulse("1500").is_err() && pulse("infus").is_err());
        assert!(
            byte("256").is_err()
                && byte("0xG").is_err()
                && byte("-1").is_err()
                && byte("é").is_err()
        );
    }
}
