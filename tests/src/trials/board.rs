//! A board under trial, whatever its personality: its tasks, its world and its flash on virtual time,
//! the [model](super::model) beside it, and the books of its starts and saves.
//!
//! - It starts again only when its power failed, a task hung or its host has asked for it, and then with
//!   the settings that were saved last or were just being saved.
//! - Settings are saved only while nothing is driven.

use embassy_time::{Duration, Instant};
use firmware::command::Command;
use firmware::controller::Snapshot;
use firmware::personality::{Boot, Session};
use firmware::ports::ResetCause;
use firmware::settings::Settings;
use firmware::settings::store::Origin;
use hal_mock::board::{Make, VirtualBoard};
use hal_mock::flash::Flash;
use hal_mock::tasks::Task;

use super::model::Model;
use super::watched::{Event, Log, Watched};
use super::{Choices, world};

/// See the [module](self).
pub(super) struct Board<S: Session> {
    pub it: VirtualBoard<Watched<S>>,
    log: Log,
    pub model: Model,
    /// The newest snapshot, and the one before; between them another, if a period came late.
    pub now: Snapshot,
    pub between: Snapshot,
    pub before: Snapshot,
    pub settings: Settings,
    /// What the flash holds, and what was being saved when power failed or a task hung.
    saved: Option<Settings>,
    being_saved: Option<Settings>,
    /// What is being saved, and whether a program is being started.
    saving: Option<Settings>,
    is_starting: bool,
    /// Why the board is about to start.
    reset: Option<ResetCause>,
    /// Motion commands for motors that the session has asked for.
    pub moves: u32,
    /// And commands that let servos slew.
    pub slews: u32,
    /// Times that the flash was written.
    writes: u32,
    /// Milliseconds, and times that each fault has tripped, by its number.
    pub ms: u64,
    pub faults: [u32; 32],
    pub starts: u32,
    /// When it last did: what its line had brought by then is of the session before.
    pub started: Instant,
    pub saves: u32,
}

impl<S: Session + 'static> Board<S> {
    /// A board that has just been switched on, whose line takes no time.
    pub fn new(
        settings: Settings,
        choices: &mut Choices,
        session: impl Fn(Settings, Boot, Instant) -> S + 'static,
    ) -> Self {
        let seed = choices.byte().into();
        let make = Make { settings, line_rate: 0, seed, ..Make::default() };
        let log = Log::default();
        let listens = log.clone();
        let it = VirtualBoard::with_session(make, Flash::empty(), move |settings, boot, now| {
            Watched::new(session(settings, boot, now), boot, now, &listens)
        });
        let mut board = Self {
            it,
            log,
            model: Model::new(settings.control),
            now: Snapshot::BOOT,
            between: Snapshot::BOOT,
            before: Snapshot::BOOT,
            settings,
            saved: None,
            being_saved: None,
            saving: None,
            is_starting: false,
            reset: Some(ResetCause::Power),
            moves: 0,
            slews: 0,
            writes: 0,
            ms: 0,
            faults: [0; 32],
            starts: 0,
            started: Instant::MIN,
            saves: 0,
        };
        board.pass();
        board
    }

    /// A millisecond passes.
    pub fn pass(&mut self) {
        let end = Instant::now() + Duration::from_millis(1);
        // A period that comes late is looked at by itself: those on time begin with a millisecond.
        for time in [end - Duration::from_ticks(1), end] {
            self.it.run_until(time);
            self.look();
        }
        self.ms += 1;
    }

    fn look(&mut self) {
        let mut last = std::mem::replace(&mut self.now, self.it.snapshot());
        // A command that has waited for the save may drive again in the next period.
        let is_off = last.outputs.are_off() || self.now.outputs.are_off();
        let writes = self.it.flash.writes();
        assert!(is_off || writes == self.writes, "saved while something is driven");
        self.writes = writes;
        while let Some(event) = { self.log.borrow_mut().pop_front() } {
            self.heed(event);
        }
        // A start and a period may fall into the same millisecond.
        if self.now.counters.periods < last.counters.periods {
            (last, self.before) = (Snapshot::BOOT, Snapshot::BOOT);
        }
        self.between = last;
        let now = &self.now;
        self.model.look(now, &self.it.plant.borrow());
        if now.faults != last.faults {
            let news = now.faults.iter().filter(|&(fault, of)| !last.faults.has(fault, of));
            news.for_each(|(fault, _)| self.faults[usize::from(fault.number())] += 1);
        }
    }

    /// The newest snapshot is one of before.
    pub fn looked(&mut self) {
        self.before = self.now;
    }

    /// What has come of the session.
    fn heed(&mut self, event: Event) {
        match event {
            Event::Started(settings, boot, at) => {
                (self.starts, self.started) = (self.starts + 1, at);
                let is_expected = match boot.reset {
                    ResetCause::Software => self.is_starting,
                    reset => self.reset == Some(reset),
                };
                assert!(is_expected, "the board starts again: {:?}", boot.reset);
                // A board that starts in the middle of a save never says what came of it.
                self.being_saved = self.being_saved.or(self.saving.take());
                self.check_stored(&settings, boot.settings);
                (self.reset, self.is_starting) = (None, false);
                self.settings = *settings;
                self.model = Model::new(settings.control);
            }
            Event::Asked(command) => {
                self.moves += u32::from(matches!(command, Command::MoveMotors { .. }));
                self.slews += u32::from(matches!(command, Command::SlewServos(_)));
                self.model.asked(&command, &self.now);
            }
            Event::Adopted(settings) => {
                self.settings.control = *settings;
                self.model.adopted(&settings, &self.now);
            }
            Event::Saving(settings) => {
                self.model.is_held = true;
                self.saving = Some(*settings);
            }
            Event::Starting => (self.model.is_held, self.is_starting) = (true, true),
            Event::Done(result) => match (result, self.saving.take()) {
                (Ok(()), Some(settings)) => {
                    (self.saved, self.being_saved) = (Some(settings), None);
                    self.saves += 1;
                    self.model.is_held = !self.has_started();
                }
                // What a flash without power has taken of them is known after the next start.
                (Err(_), Some(settings)) => {
                    (self.being_saved, self.model.is_held) = (Some(settings), !self.has_started());
                }
                (Ok(()), None) => {} // until it starts
                (Err(_), None) => {
                    (self.is_starting, self.model.is_held) = (false, !self.has_started());
                }
            },
        }
    }

    /// The settings of a start are those that were saved last, or were just being saved.
    fn check_stored(&mut self, settings: &Settings, origin: Origin) {
        let being_saved = self.being_saved.take();
        match origin {
            Origin::Defaults => assert_eq!(self.saved, None, "what was saved is lost"),
            Origin::Stored if being_saved == Some(*settings) => self.saved = being_saved,
            Origin::Stored => assert_eq!(self.saved, Some(*settings), "nobody has saved these"),
            Origin::Corrupt => panic!("what was saved is damaged"),
        }
    }

    /// Power is gone and comes back, in the middle of a save if [`lose_power_after`](Flash) said so. The
    /// board starts in the next millisecond.
    pub fn power_fails(&mut self) {
        self.it.flash.restore_power();
        self.reset = Some(ResetCause::Power);
        self.it.start_again(ResetCause::Power);
    }

    /// A task hangs. The board starts again in the next 200 ms: [`has_started`](Self::has_started).
    pub fn hang(&mut self, choices: &mut Choices) {
        let tasks = [Task::Control, Task::Sensors, Task::Display, Task::Link];
        self.it.watchdog.hung.set(Some(choices.among(&tasks)));
        self.reset = Some(ResetCause::Watchdog);
        self.model.is_held = true;
    }

    /// Whether it has started since its power failed or a task hung.
    pub fn has_started(&self) -> bool {
        self.reset.is_none()
    }

    /// One more thing goes wrong in its world, or all of it is right again.
    pub fn disturb(&self, choices: &mut Choices) {
        world::disturb(&mut self.it.plant.borrow_mut(), choices);
    }

    /// Frames and commands refused since the start, by the controller.
    pub fn refused(&self) -> u32 {
        self.now.counters.refused.total()
    }
}
