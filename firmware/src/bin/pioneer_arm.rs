//! The Pioneer Arm on the board that a cargo feature selects: its joints are the servo outputs.
#![no_std]
#![no_main]

mod tasks;

use embassy_time::Instant;
use firmware::app;
use firmware::board::flash::Flash;
use firmware::board::system::System;
use firmware::personality::pioneer_arm::PioneerArm;
use firmware::personality::pms5005::Boot;
use firmware::settings::Settings;
use firmware::settings::store::Store;

type Host = PioneerArm;

/// What the hosts of ARCOS robots open by default. 115200 here would need the same of the host.
const HOST_BAUD: u32 = 9600;

fn host(settings: Settings, _boot: Boot, now: Instant) -> Host {
    PioneerArm::new(settings.arm, now)
}

/// ARCOS has no words for any: what another image has saved is in force, and stays.
async fn upkeep(_: &mut Store<Flash>, _: &mut System, all: &tasks::Channels) -> ! {
    app::no_upkeep(all).await
}
