//! The whole controller, one period: measuring, velocity estimates, trajectories, loops, limits,
//! six DC channels and six servos.

use core::hint::black_box;

use firmware::command::Command;
use firmware::controller::Controller;
use firmware::ports::{MotionInputs, Sensors};
use firmware::settings::Settings;
use protocol::pms5005::Method;

use crate::Meter;

/// All cases; the unit is a period of all channels.
pub fn cases(meter: &mut impl Meter) {
    case(meter, "tick-at-rest/ours", Controller::new(Settings::DEFAULT.control));
    case(meter, "tick-moving/ours", moving());
}

/// As robots use it: two wheels at a speed, four joints and all servos on their way.
fn moving() -> Controller {
    const PERIODS: u16 = u16::MAX;
    let mut controller = Controller::new(Settings::DEFAULT.control);
    let wheels = [Some(1500), Some(-1500), None, None, None, None];
    let joints = [None, None, Some(3000), Some(1000), Some(2500), Some(100)];
    let commands = [
        Command::Drive { method: Method::Velocity, targets: wheels, periods: PERIODS },
        Command::Drive { method: Method::Position, targets: joints, periods: PERIODS },
        Command::MoveServos { targets: [Some(3375); 6], periods: 0 },
        Command::MoveServos { targets: [Some(5000); 6], periods: PERIODS },
    ];
    for command in commands {
        controller.step([command], &MotionInputs::default(), &Sensors::UNKNOWN, 1);
    }
    controller
}

fn case(meter: &mut impl Meter, name: &str, mut controller: Controller) {
    let sensors = Sensors::UNKNOWN;
    let mut motion = MotionInputs { potentiometers: [2000; 6], ..MotionInputs::default() };
    let mut frames = 1u32;
    meter.case(name, 1, || {
        frames = frames.wrapping_add(1);
        for count in &mut motion.encoders {
            *count = count.wrapping_add(1);
        }
        let snapshot = black_box(&mut controller).step(None, &motion, &sensors, frames);
        black_box(&snapshot);
    });
}
