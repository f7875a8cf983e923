//! The Pioneer Arm on the board that a cargo feature selects: its joints are the servo outputs.
#![no_std]
#![no_main]

mod tasks;

use embassy_time::Instant;
use firmware::personality::Boot;
use firmware::personality::pioneer_arm::PioneerArm;
use firmware::settings::Settings;

type Host = PioneerArm;

/// What the hosts of ARCOS robots open by default. 115200 here would need the same of the host.
const HOST_BAUD: u32 = 9600;

fn host(settings: Settings, boot: Boot, now: Instant) -> Host {
    PioneerArm::new(settings, boot, now)
}
