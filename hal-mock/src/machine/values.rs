//! Numbers and lists of the inspector's questions, checked.

use serde_json::{Map, Value, json};

/// `N` numbers from 0 to `most`; null in place of one, or of all, is the simulation's own.
///
/// # Errors
/// One line that names the key and what is wanted, as all here.
pub fn numbers<T: TryFrom<u64>, const N: usize>(
    key: &str,
    value: &Value,
    most: u64,
) -> Result<[Option<T>; N], String> {
    list(value, |value| in_range(value, most))
        .ok_or(format!("{key}: expected {N} whole numbers from 0 to {most}, or null"))
}

/// A number from 0 to `most`, or null.
pub fn number<T: TryFrom<u64>>(key: &str, value: &Value, most: u64) -> Result<Option<T>, String> {
    match value {
        Value::Null => Ok(None),
        value => in_range(value, most)
            .map(Some)
            .ok_or(format!("{key}: expected a whole number from 0 to {most}, or null")),
    }
}

fn in_range<T: TryFrom<u64>>(value: &Value, most: u64) -> Option<T> {
    value.as_u64().filter(|&value| value <= most).and_then(|value| T::try_from(value).ok())
}

/// `N` decimal numbers from 0 to `most`; null in place of one, or of all.
pub fn decimals<const N: usize>(
    key: &str,
    value: &Value,
    most: f32,
) -> Result<[Option<f32>; N], String> {
    list(value, |value| decimal_in_range(value, most))
        .ok_or(format!("{key}: expected {N} numbers from 0 to {most}, or null"))
}

/// A decimal number from 0 to `most`, or null.
pub fn decimal(key: &str, value: &Value, most: f32) -> Result<Option<f32>, String> {
    match value {
        Value::Null => Ok(None),
        value => decimal_in_range(value, most)
            .map(Some)
            .ok_or(format!("{key}: expected a number from 0 to {most}, or null")),
    }
}

fn decimal_in_range(value: &Value, most: f32) -> Option<f32> {
    value.as_f64().map(|value| value as f32).filter(|value| (0.0..=most).contains(value))
}

/// A decimal number in as few digits as tell it: 11.1, not what is nearest to it in binary.
pub fn shown(decimal: f32) -> Value {
    json!(decimal.to_string().parse::<f64>().ok())
}

/// `N` booleans; null in place of one, or of all.
pub fn flags<const N: usize>(key: &str, value: &Value) -> Result<[Option<bool>; N], String> {
    list(value, Value::as_bool).ok_or(format!("{key}: expected {N} booleans, or null"))
}

/// `N` elements, or null in place of one or of all.
fn list<T, const N: usize>(
    value: &Value,
    element: impl Fn(&Value) -> Option<T>,
) -> Option<[Option<T>; N]> {
    let mut list = [const { None }; N];
    if !value.is_null() {
        let values = value.as_array().filter(|values| values.len() == N)?;
        for (slot, value) in list.iter_mut().zip(values).filter(|(_, value)| !value.is_null()) {
            *slot = Some(element(value)?);
        }
    }
    Some(list)
}

/// What of an object's values is set: not null, nor a list of nothing but null.
pub fn that_are_set(values: Value) -> Map<String, Value> {
    let is_set = |value: &Value| match value {
        Value::Array(list) => !list.iter().all(Value::is_null),
        value => !value.is_null(),
    };
    let Value::Object(values) = values else { return Map::new() };
    values.into_iter().filter(|(_, value)| is_set(value)).collect()
}
