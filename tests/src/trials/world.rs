//! What can befall a board's world: sensors that read anything, shafts that jam, batteries that run
//! down, something in the way.

use firmware::settings::SoftLimits;
use hal_mock::plant::{Overrides, Plant};

use super::Choices;

/// The channel with soft limits.
pub(super) const LIMITED: usize = 5;
/// Its limits.
pub(super) const SOFT: SoftLimits = SoftLimits { low: 1000, high: 3000 };

/// One more thing goes wrong.
pub(super) fn disturb(plant: &mut Plant, choices: &mut Choices) {
    let motor = choices.below(6) as usize;
    let encoder = plant.motors[motor % 2].encoder();
    let readings = [Some(0), Some(4095), Some(2047), Some(choices.word() & 0xFFF)];
    let reading = choices.among(&readings);
    let world = &mut plant.overrides;
    match choices.below(11) {
        0 => world.encoders[motor % 2] = Some(encoder),
        1 => world.potentiometers[motor] = reading,
        2 => world.currents[motor] = reading,
        3 => world.jam[motor] = Some(true),
        4 => {
            world.battery[motor % 3] = choices.among(&[Some(800), Some(1800), Some(3500), reading]);
        }
        5 => world.overheat[motor % 2] = choices.among(&[Some(1000), reading]),
        6 => world.temperature = choices.among(&[Some(3900), reading]),
        7 => world.sonar_cm = [choices.among(&[Some(10), Some(33), None]); 6],
        8 => world.unplugged[motor] = Some(true),
        9 => world.battery_v[1] = choices.among(&[Some(0.0), Some(5.0), Some(30.0)]),
        _ => world.gpio_in = choices.among(&[Some(0), Some(1), Some(0xFF)]),
    }
}

/// All is right again.
pub(super) fn mend(plant: &mut Plant) {
    plant.overrides = Overrides::default();
}
