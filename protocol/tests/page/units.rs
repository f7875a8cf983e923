//! The page's ranges of numbers.

use protocol::pms5005::Quantity;

use crate::text::table;

#[test]
fn numbers_have_the_ranges_that_the_wire_takes() {
    let rows = table("Numbers and units", "quantity");
    for (name, quantity) in [
        ("velocity asked for", Quantity::Velocity),
        ("PWM", Quantity::Pwm),
        ("position", Quantity::Position),
        ("servo position", Quantity::Servo),
    ] {
        let (low, high) = quantity.range();
        let row = rows.iter().find(|row| row[0] == name).expect(name);
        assert!(row[1].contains(&format!("{low} to {high}")), "{name}: {}", row[1]);
    }
}
