//! The controller, the recorder, and the two sessions over it.

use core::hint::black_box;
use core::ops::Range;

use embassy_time::Instant;
use firmware::command::Command;
use firmware::controller::{Controller, Snapshot};
use firmware::personality::pioneer_arm::PioneerArm;
use firmware::personality::pms5005::Pms5005;
use firmware::personality::{BlockRows, Boot, Effect, MAX_FRAME, Session, UpkeepRefused, View};
use firmware::ports::{MotionInputs, Sensors};
use firmware::recorder::{Recorder, Recording, Row};
use firmware::settings::Settings;

use crate::any;

struct Board {
    snapshot: Snapshot,
    recorder: Recorder<[Row; 512]>,
}

impl View for Board {
    fn snapshot(&self) -> Snapshot {
        black_box(self.snapshot)
    }

    fn recording(&self) -> Recording {
        self.recorder.recording()
    }

    fn rows(&self, numbers: Range<usize>) -> (u8, BlockRows) {
        (any(), numbers.map_while(|number| self.recorder.row(number)).collect())
    }
}

pub fn run() {
    let settings = black_box(Settings::DEFAULT);
    let mut controller = Controller::new(settings.control);
    black_box(Boot::default()).faults().for_each(|fault| controller.record(fault));
    settings.iter().for_each(|setting| _ = black_box(setting));
    talk(Pms5005::new(settings, Boot::default(), Instant::now()), &mut controller);
    talk(PioneerArm::new(settings, Boot::default(), Instant::now()), &mut controller);
}

/// A turn of a session and the controller. Whatever came before is what nobody knows.
fn talk(mut session: impl Session, controller: &mut Controller) {
    let recorder = Recorder::new([Row::ZERO; 512]);
    let mut board = Board { snapshot: Snapshot::BOOT, recorder };
    let mut commands: [Option<Command>; 4] = [None; 4];
    while any::<u8>() == 0 {
        session = black_box(session);
        black_box((&mut *controller, &mut board.recorder));
        let received: [u8; 256] = black_box([0; 256]);
        let mut bytes = &received[..];
        let mut places = commands.iter_mut();
        let mut carry_out = |effect, board: &mut Board| match effect {
            Effect::Control(command) => {
                if let Some(place) = places.next() {
                    *place = Some(command);
                }
            }
            Effect::Record(setup) => board.recorder.start(setup),
            other => drop(black_box(other)),
        };
        while let Some(effect) = session.receive(&mut bytes, Instant::now()) {
            carry_out(effect, &mut board);
        }
        while let Some(effect) = session.advance(Instant::now(), || board.snapshot()) {
            carry_out(effect, &mut board);
        }
        if let Some(effect) = session.upkeep_done(black_box(Err(UpkeepRefused::FlashFailed))) {
            carry_out(effect, &mut board);
        }
        let (motion, sensors): (MotionInputs, Sensors) =
            black_box((MotionInputs::default(), Sensors::UNKNOWN));
        if any::<u8>() == 1 {
            controller.periods_missed(any(), any());
        }
        let control = session.settings().control;
        let snapshot = controller.step(
            commands.iter_mut().filter_map(Option::take),
            || Some(control),
            &motion,
            &sensors,
            session.signs_of_life(),
        );
        board.recorder.step(snapshot);
        board.snapshot = *snapshot;
        let mut out = [0; MAX_FRAME];
        black_box(session.transmit(Instant::now(), &board, &mut out));
        black_box((session.sends_at(), session.wakes_at(), session.to_save(), session.counters()));
        session.line_failed();
        session.picture_dropped();
    }
}
