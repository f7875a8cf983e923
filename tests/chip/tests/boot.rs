//! From power on to the first frames.

use chip::bench::pms5005::Host;
use protocol::pms5005::{Command, Quantity, Report};

#[test]
fn it_boots_talks_and_drives() {
    let mut host = Host::boot("pms5005-f407");
    println!("telemetry at {} us", host.bench.now_ns() / 1000);
    host.order(Command::Ping);
    host.go(Quantity::Pwm, [Some(24_576), None, None, None, None, None]);
    host.live_for(600);
    let report = host.motors();
    println!("{report:?}");
    let speed = host.bench.with(|stand| stand.rig().world.plant.motors[0].velocity());
    println!("{speed} {}", host.bench.now_ns());
    let gaps = host.bench.with(|stand| {
        let s = &stand.session;
        format!("unmapped {:?}\nrefused {:?}\nunimplemented {:#?}\nundefined {:?}\nunrouted {:?}\ntold {:?}\nresets {:?}",
            s.unmapped(), s.refused(), s.unimplemented(), s.undefined(), s.unrouted(), s.told().collect::<Vec<_>>(), s.resets())
    });
    println!("{gaps}");
    println!("display {:?}", host.bench.display.panel.lock().unwrap().unknown);
    let _: Option<Report> = None;
}
