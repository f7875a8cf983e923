//! The PMS5005 on the board that a cargo feature selects.
#![no_std]
#![no_main]

mod tasks;

use embassy_time::Instant;
use firmware::personality::Boot;
use firmware::personality::pms5005::Pms5005;
use firmware::settings::Settings;

type Host = Pms5005;

/// The manual: "115200kbps, N, 8, 1".
const HOST_BAUD: u32 = 115_200;

fn host(settings: Settings, boot: Boot, now: Instant) -> Host {
    Pms5005::new(settings, boot, now)
}
