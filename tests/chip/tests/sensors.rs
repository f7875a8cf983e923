//! What the board senses, from the pin to the host's report.

use chip::bench::Make;
use chip::bench::pms5005::Host;
use chip::bench::world::F407;
use hal_mock::plant::Scene;
use protocol::pms5005::{Command, CustomIoReport, LcdFrame, Quantity, Report, SensorReport};
use rigless::device::Level;

const IMAGE: &str = "pms5005-f407";

fn with_scene(change: impl FnOnce(&mut Scene)) -> Host {
    let mut scene = Scene::default();
    change(&mut scene);
    Host::boot_with(IMAGE, Make { scene, ..Make::default() })
}

fn sensors(host: &mut Host) -> SensorReport {
    host.heard();
    host.wait("sensor report", |frame| match frame.report() {
        Some(Report::Sensors(report)) => Some(report),
        _ => None,
    })
}

fn custom(host: &mut Host) -> CustomIoReport {
    host.heard();
    host.wait("custom report", |frame| match frame.report() {
        Some(Report::CustomIo(report)) => Some(report),
        _ => None,
    })
}

#[test]
fn six_rangers_take_turns_and_are_told_apart() {
    let ranges = [10, 50, 100, 150, 253, 255]; // the last has nothing in range
    let mut host = with_scene(|scene| scene.environment.sonar_cm = ranges);
    host.live_for(600);
    let told = sensors(&mut host).sonar_cm;
    for (ranger, (told, range)) in told.iter().zip(ranges).enumerate() {
        assert!(told.abs_diff(range) <= 1, "ranger {ranger}: {told} for {range} cm");
    }
}

#[test]
fn every_key_of_the_remote_is_heard_while_control_runs_and_the_line_is_full() {
    const KEYS: u8 = 10;
    let mut host = Host::boot(IMAGE);
    host.go(Quantity::Velocity, [Some(3000), Some(-3000), None, None, None, None]);
    let mut heard = Vec::new();
    for key in 0..KEYS {
        let at = host.bench.now_ns();
        host.bench.with(move |stand| stand.rig().world.press(at, 0xBF40, 0x10 + key));
        for _ in 0..30 {
            (0..4).for_each(|_| host.send(Command::Ping));
            host.run_for(4);
        }
        let report = sensors(&mut host).ir_command;
        heard.push((report[..3].to_vec(), report[3]));
    }
    let pressed = |key: u8| (vec![0x40, 0xBF, 0x10 + key], 255);
    assert_eq!(heard, (0..KEYS).map(pressed).collect::<Vec<_>>());
    host.live_for(300);
    assert_eq!(sensors(&mut host).ir_command[3], 0, "it is not held any more");
}

#[test]
fn inputs_outputs_and_the_slow_analogue_values_are_what_is_on_the_pins() {
    let mut host = with_scene(|scene| {
        scene.environment.gpio_in = 0b1010_0110;
        scene.environment.custom_v = [0.1, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8];
        scene.noise_lsb = 0.0;
    });
    host.order(Command::GpioOutputs(0x5A));
    host.live_for(200);
    let report = custom(&mut host);
    assert_eq!(report.inputs, 0b1010_0110);
    for (input, told) in report.custom_ad.into_iter().enumerate() {
        let put = [0.1, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4, 2.8][input] / 3.0 * 4095.0;
        assert!((f64::from(told) - put).abs() <= 3.0, "custom input {input}: {told} for {put}");
    }
    let driven = host.bench.with(|stand| {
        let chip = &mut stand.rig().chip;
        let level = |&(port, pin)| chip.level(port, pin) == Level::High;
        F407.outputs.iter().map(level).collect::<Vec<_>>()
    });
    assert_eq!(driven, [false, true, false, true, true, false, true, false], "0x5A, bit 0 first");
}

#[test]
fn a_picture_is_on_the_display_and_nothing_else_is() {
    let mut host = Host::boot(IMAGE);
    let picture: [u8; 64] = std::array::from_fn(|column| column as u8 ^ 0x5E);
    host.order(Command::Lcd(LcdFrame { number: 7, columns: &picture }));
    host.run_for(20);
    let panel = host.bench.display.panel.lock().unwrap().clone();
    assert!(panel.is_on);
    assert_eq!(panel.unknown, [0; 0], "every command is one of the data sheet");
    // Frame 7 is the right half of page 3; everything else was cleared.
    for (page, row) in panel.pages.iter().enumerate() {
        for (column, &bits) in row.iter().enumerate() {
            let is_its = page == 3 && column >= 64;
            let wanted = if is_its { picture[column - 64] } else { 0 };
            assert_eq!(bits, wanted, "page {page}, column {column}");
        }
    }
}
