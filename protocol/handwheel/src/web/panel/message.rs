//! What is in a page's message, checked.

use std::time::Duration;

use serde_json::{Map, Value};

use crate::Number;

/// A whole number of an object, in its range.
pub(super) fn number(
    object: &Map<String, Value>,
    key: &str,
    low: i64,
    high: i64,
) -> Result<i64, String> {
    let value = object.get(key).and_then(Value::as_i64);
    value
        .filter(|value| (low..=high).contains(value))
        .ok_or_else(|| format!("{key}: a whole number from {low} to {high} is wanted"))
}

/// The motor or the servo of a message.
pub(super) fn member(object: &Map<String, Value>, key: &str) -> Result<Number, String> {
    let number = number(object, key, 1, 6)?;
    let number = u8::try_from(number).ok().and_then(Number::new);
    number.ok_or_else(|| format!("{key}: 1 to 6"))
}

/// A time of an object, 0 without one.
pub(super) fn ms(
    object: &Map<String, Value>,
    key: &str,
    low: i64,
    high: i64,
) -> Result<Duration, String> {
    match object.get(key) {
        None | Some(Value::Null) => Ok(Duration::ZERO),
        Some(_) => {
            let ms = number(object, key, low, high)?;
            Ok(Duration::from_millis(ms.unsigned_abs()))
        }
    }
}

/// A text of an object.
pub(super) fn text<'a>(object: &'a Map<String, Value>, key: &str) -> Result<&'a str, String> {
    object.get(key).and_then(Value::as_str).ok_or_else(|| format!("{key}: a text is wanted"))
}
