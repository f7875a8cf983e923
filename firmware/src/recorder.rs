//! The recorder: what channels did, period by period, kept in memory until somebody asks.
//!
//! Vocabulary: a *row* is a sample of one channel; a *sample* is the rows of all channels that are
//! recorded, of one control period. The *trigger* begins a recording; what comes *before* it is kept as
//! well, as far as was asked. *Decimation* is how many control periods lie from one sample to the next.
//!
//! ```text
//!   none ──start──> waiting ──trigger──> recording ──all samples──> done
//! ```
//!
//! Promises: a period costs the same whatever was recorded before; the period of the trigger is itself
//! sampled; what is done stays until the next start.

use crate::channel::{Channel, ChannelSet, Method};
use crate::controller::Snapshot;
use crate::safety::latch::Latched;
use crate::units::{CountsPerSecond, Duty};

/// A sample of one channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Counts of its sensor, turn by turn since boot; wraps.
    pub position: i32,
    /// By its sensor.
    pub velocity: CountsPerSecond,
    /// What it is asked for at this moment of its move, in the method's unit; 0 when it is off.
    pub set_point: i16,
    /// What its bridge does.
    pub duty: Duty,
    /// A/D counts.
    pub current: u16,
    /// How it is run; `None` when it is off.
    pub method: Option<Method>,
}

const _: () = assert!(size_of::<Row>() == 16, "so memory.x and the boards count");

impl Row {
    /// Zeros, so that memory full of them takes no flash.
    pub const ZERO: Self = Self {
        position: 0,
        velocity: CountsPerSecond::ZERO,
        set_point: 0,
        duty: Duty::NEUTRAL,
        current: 0,
        method: Some(Method::Pwm),
    };

    fn of(snapshot: &Snapshot, channel: Channel) -> Self {
        let i = channel.index();
        let (told, output) = (&snapshot.channels[i], &snapshot.outputs.motors[i]);
        let is_on = output.enabled;
        Self {
            position: told.position,
            velocity: told.velocity,
            set_point: if is_on { told.set_point.rounded() } else { 0 },
            duty: output.duty,
            current: snapshot.motion.currents[i],
            method: is_on.then(|| told.set_point.method()),
        }
    }
}

/// Memory for rows: on a board a part of it that nothing else uses.
pub trait Rows: AsRef<[Row]> + AsMut<[Row]> {}

impl<T: AsRef<[Row]> + AsMut<[Row]>> Rows for T {}

/// What begins a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// The next period.
    Now,
    /// A motion command that one of its channels carries out.
    Motion,
    /// A fault of one of its channels, or of the board.
    Fault,
}

/// What is to be recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setup {
    /// Whose.
    pub channels: ChannelSet,
    /// What begins it.
    pub trigger: Trigger,
    /// Control periods from one sample to the next; 0 is as 1.
    pub decimation: u16,
    /// Samples in all; more than fit are cut to what fits.
    pub samples: u16,
    /// How many of them are from before the trigger: fewer than all.
    pub before: u16,
}

/// How far a recording is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// There was none since boot.
    None,
    /// It waits for its trigger, and keeps what comes before.
    Waiting,
    /// It has begun.
    Recording,
    /// It is all there.
    Done,
}

/// What may be told of the recorder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Recording {
    /// The recording's number, 1 to 255 and round again; 0 before the first.
    pub serial: u8,
    /// How far it is.
    pub phase: Phase,
    /// What is recorded, cut to what fits.
    pub setup: Setup,
    /// Samples taken so far.
    pub taken: u16,
    /// How many of them are from before the trigger: fewer than asked, if that came early.
    pub before: u16,
    /// Uptime at the trigger; 0 before it.
    pub triggered_ms: u32,
    /// Rows that the memory holds.
    pub capacity: u16,
}

/// The recorder over its memory.
pub struct Recorder<R> {
    rows: R,
    recording: Recording,
    /// Where in the ring the next sample goes, 0 to `setup.samples` less 1.
    next: u16,
    /// Control periods until the next sample.
    wait: u16,
    /// What was latched a period ago.
    latched: Latched,
}

impl<R: Rows> Recorder<R> {
    /// One that has recorded nothing.
    pub fn new(rows: R) -> Self {
        let capacity = u16::try_from(rows.as_ref().len()).unwrap_or(u16::MAX);
        let setup = Setup {
            channels: ChannelSet::NONE,
            trigger: Trigger::Now,
            decimation: 1,
            samples: 0,
            before: 0,
        };
        let recording = Recording {
            serial: 0,
            phase: Phase::None,
            setup,
            taken: 0,
            before: 0,
            triggered_ms: 0,
            capacity,
        };
        Self { rows, recording, next: 0, wait: 0, latched: Latched::NONE }
    }

    /// Begins a recording, and forgets the one before.
    pub fn start(&mut self, setup: Setup) {
        let Recording { serial, capacity, .. } = self.recording;
        let most = usize::from(capacity).checked_div(setup.channels.count()).unwrap_or(0);
        let samples = setup.samples.min(most as u16); // not above the capacity
        let before = setup.before.min(samples.saturating_sub(1));
        self.recording = Recording {
            serial: serial.checked_add(1).unwrap_or(1),
            phase: if samples == 0 { Phase::Done } else { Phase::Waiting },
            setup: Setup { samples, before, ..setup },
            taken: 0,
            before: 0,
            triggered_ms: 0,
            capacity,
        };
        (self.next, self.wait) = (0, 0);
    }

    /// What may be told of it.
    pub fn recording(&self) -> Recording {
        self.recording
    }

    /// One control period.
    pub fn step(&mut self, snapshot: &Snapshot) {
        let before = core::mem::replace(&mut self.latched, snapshot.faults);
        match self.recording.phase {
            Phase::None | Phase::Done => return,
            Phase::Waiting if self.is_triggered(snapshot, &before) => {
                let recording = &mut self.recording;
                recording.phase = Phase::Recording;
                recording.before = recording.taken;
                recording.triggered_ms = snapshot.counters.uptime_ms;
                self.wait = 0;
            }
            Phase::Waiting | Phase::Recording => {}
        }
        if let Some(wait) = self.wait.checked_sub(1) {
            self.wait = wait;
            return;
        }
        self.wait = self.recording.setup.decimation.saturating_sub(1);
        self.take(snapshot);
    }

    fn is_triggered(&self, snapshot: &Snapshot, latched: &Latched) -> bool {
        let Setup { channels, trigger, .. } = self.recording.setup;
        match trigger {
            Trigger::Now => true,
            Trigger::Motion => channels.bits() & snapshot.moved.bits() != 0,
            Trigger::Fault => snapshot.faults.is_news(latched, channels),
        }
    }

    fn take(&mut self, snapshot: &Snapshot) {
        let Recording { setup, phase, taken, before, .. } = self.recording;
        let is_waiting = phase == Phase::Waiting;
        if is_waiting && setup.before == 0 {
            return;
        }
        let first = usize::from(self.next) * setup.channels.count();
        let places = self.rows.as_mut().get_mut(first..).unwrap_or_default();
        for (place, channel) in places.iter_mut().zip(setup.channels.iter()) {
            *place = Row::of(snapshot, channel);
        }
        self.next = self.next.saturating_add(1);
        if self.next >= setup.samples {
            self.next = 0;
        }
        if is_waiting {
            self.recording.taken = taken.saturating_add(1).min(setup.before);
            return;
        }
        self.recording.taken = taken.saturating_add(1);
        let asked_behind = setup.samples.saturating_sub(setup.before);
        if taken.saturating_sub(before) >= asked_behind.saturating_sub(1) {
            self.recording.phase = Phase::Done;
        }
    }

    /// The row with this number, sample by sample and within a sample channel by channel; `None` behind the
    /// last, or while the recording is not done.
    pub fn row(&self, number: usize) -> Option<Row> {
        let Recording { setup, phase, taken, .. } = self.recording;
        let channels = setup.channels.count();
        let (sample, channel) = (number.checked_div(channels)?, number.checked_rem(channels)?);
        if phase != Phase::Done || sample >= usize::from(taken) {
            return None;
        }
        // The newest lies before `next`, the oldest `taken` before that.
        let ring = usize::from(setup.samples);
        let ahead = usize::from(self.next) + ring - usize::from(taken) + sample;
        let place = ahead.checked_rem(ring)?;
        self.rows.as_ref().get(place * channels + channel).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::faults::{Fault, FaultRecord};
    use crate::safety::latch::Faults;

    const ONE: ChannelSet = ChannelSet::from_bits(1);

    fn setup(trigger: Trigger, decimation: u16, samples: u16, before: u16) -> Setup {
        Setup { channels: ONE, trigger, decimation, samples, before }
    }

    /// Periods of a shaft that is where the time is, in ms; from `events` on what a period holds.
    struct Bench {
        recorder: Recorder<Vec<Row>>,
        snapshot: Snapshot,
    }

    impl Bench {
        fn new(rows: usize, setup: Setup) -> Self {
            let mut recorder = Recorder::new(vec![Row::ZERO; rows]);
            recorder.start(setup);
            Self { recorder, snapshot: Snapshot::BOOT }
        }

        fn run(&mut self, periods: u32) {
            for _ in 0..periods {
                self.snapshot.counters.uptime_ms += 1;
                let now = self.snapshot.counters.uptime_ms as i32;
                for (i, channel) in (0..).zip(&mut self.snapshot.channels) {
                    channel.position = now + 1000 * i;
                }
                self.recorder.step(&self.snapshot);
                self.snapshot.moved = ChannelSet::NONE;
            }
        }

        fn positions(&self) -> Vec<i32> {
            (0..).map_while(|number| self.recorder.row(number)).map(|row| row.position).collect()
        }
    }

    #[test]
    fn at_once_it_takes_as_many_samples_as_were_asked_so_far_apart_and_ends() {
        let mut bench = Bench::new(100, setup(Trigger::Now, 3, 4, 0));
        bench.run(9);
        assert_eq!(bench.recorder.recording().phase, Phase::Recording);
        assert!(bench.positions().is_empty(), "not before it is done");
        bench.run(100);
        assert_eq!(bench.recorder.recording().phase, Phase::Done);
        assert_eq!(bench.positions(), [1, 4, 7, 10]);
        assert_eq!(bench.recorder.recording().triggered_ms, 1);
    }

    #[test]
    fn what_came_before_a_motion_command_is_kept_and_its_period_is_sampled() {
        let mut bench = Bench::new(100, setup(Trigger::Motion, 5, 6, 3));
        bench.run(32);
        bench.snapshot.moved = ChannelSet::from_bits(0b10);
        bench.run(1); // another channel's
        bench.snapshot.moved = ONE;
        bench.run(20);
        // 1, 6, .. 31 were sampled; the command came in 34.
        assert_eq!(bench.positions(), [21, 26, 31, 34, 39, 44]);
        let Recording { taken, before, triggered_ms, .. } = bench.recorder.recording();
        assert_eq!((taken, before, triggered_ms), (6, 3, 34));
    }

    #[test]
    fn a_trigger_that_comes_early_has_less_before_it() {
        let mut bench = Bench::new(100, setup(Trigger::Motion, 1, 6, 3));
        bench.run(1);
        bench.snapshot.moved = ONE;
        bench.run(20);
        assert_eq!(bench.positions(), [1, 2, 3, 4]);
        assert_eq!(bench.recorder.recording().before, 1);
    }

    #[test]
    fn a_fault_of_a_channel_or_of_the_board_begins_it_once_it_trips() {
        for (fault, channel, begins) in [
            (Fault::Stall, Some(Channel::Channel0), true),
            (Fault::Stall, Some(Channel::Channel1), false),
            (Fault::MotorBatteryLow, None, true),
        ] {
            let mut bench = Bench::new(100, setup(Trigger::Fault, 1, 4, 2));
            bench.run(5);
            let mut faults = Faults::default();
            faults.trip(FaultRecord { fault, channel, uptime_ms: 0, values: [0; 3] });
            bench.snapshot.faults = faults.latched();
            bench.run(1);
            let is_waiting = bench.recorder.recording().phase == Phase::Waiting;
            assert_eq!(is_waiting, !begins, "{fault:?} {channel:?}");
            bench.run(1);
            // One that stands when the recording starts is no news.
            bench.recorder.start(setup(Trigger::Fault, 1, 4, 2));
            bench.run(5);
            assert_eq!(bench.recorder.recording().phase, Phase::Waiting);
        }
    }

    #[test]
    fn several_channels_share_the_memory_and_what_does_not_fit_is_cut() {
        let channels = ChannelSet::from_bits(0b100_101);
        let mut bench = Bench::new(10, Setup { channels, ..setup(Trigger::Now, 1, 9, 0) });
        bench.run(9);
        assert_eq!(bench.positions(), [1, 2001, 5001, 2, 2002, 5002, 3, 2003, 5003]);
        let Recording { setup, capacity, .. } = bench.recorder.recording();
        assert_eq!((setup.samples, capacity), (3, 10));
        let mut bench = Bench::new(2, Setup { channels, ..setup_of_one() });
        bench.run(9);
        assert_eq!((bench.recorder.recording().phase, bench.positions()), (Phase::Done, vec![]));
    }

    fn setup_of_one() -> Setup {
        setup(Trigger::Now, 1, 1, 0)
    }

    #[test]
    fn every_start_has_another_number_and_forgets_the_recording_before() {
        let mut bench = Bench::new(10, setup_of_one());
        bench.run(1);
        assert_eq!((bench.recorder.recording().serial, bench.positions()), (1, vec![1]));
        for serial in (2..=255).chain([1, 2]) {
            bench.recorder.start(setup_of_one());
            assert_eq!((bench.recorder.recording().serial, bench.positions()), (serial, vec![]));
        }
        bench.run(1);
        assert_eq!(bench.positions(), [2]);
    }

    #[test]
    fn a_row_tells_what_a_channel_that_is_on_is_asked_for() {
        use crate::control::axis::SetPoint;
        use crate::ports::MotorOutput;
        let mut snapshot = Snapshot::BOOT;
        snapshot.channels[0].set_point = SetPoint::Velocity(CountsPerSecond::from_num(-300.75));
        snapshot.motion.currents[0] = 77;
        let row = Row::of(&snapshot, Channel::Channel0);
        assert_eq!((row.set_point, row.method, row.current), (0, None, 77));
        snapshot.outputs.motors[0] = MotorOutput { duty: Duty::from_raw(-5), enabled: true };
        let row = Row::of(&snapshot, Channel::Channel0);
        assert_eq!((row.set_point, row.method), (-301, Some(Method::Velocity)));
        assert_eq!(row.duty, Duty::from_raw(-5));
    }
}
