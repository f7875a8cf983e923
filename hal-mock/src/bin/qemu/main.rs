//! The virtual board as an image: the firmware's tasks over the simulated plant, on a Cortex-M4 of
//! which nothing is used but SysTick and two USARTs. It runs on QEMU's `netduinoplus2`.
//!
//! The first serial line is the host's. The second is the trace: one line `TIME COUNT` for every
//! piece of what the host sent, when the board was given it (ms of the board's time) and how many
//! bytes it was. With it a [`VirtualBoard`](hal_mock::board::VirtualBoard) can be given the same
//! bytes at the same times, and must answer with the same bytes (`tests/tests/qemu/main.rs`).
//! A panic and a hard fault tell their reason there, and stop the board.
//!
//! Time is real: SysTick says how far the virtual clock may go. The line takes no time, and is
//! looked at once a millisecond.
#![no_std]
#![no_main]

mod uart;

use core::cell::RefCell;
use core::fmt::Write;
use core::panic::PanicInfo;
use core::pin::pin;
use core::ptr;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::task::{RawWaker, RawWakerVTable, Waker};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::Mutex;
use embassy_time::Instant;
use firmware::app;
use firmware::controller::Controller;
use firmware::liveness::WATCHDOG_PERIOD;
use firmware::personality::Boot;
use firmware::personality::pms5005::{LinkCounters, Pms5005};
use firmware::recorder::{Recorder, Row};
use firmware::settings::Settings;
use hal_mock::plant::{Plant, Scene};
use hal_mock::tasks::{self, Channels, RECORDER_ROWS, Watchdog};
use static_cell::{ConstStaticCell, StaticCell};
use uart::{HOST, Line, TRACE};

/// The processor clock of the machine.
const CLOCK_HZ: u32 = 168_000_000;

/// Seed of the sensors' noise: the virtual board's default.
const SEED: u64 = 1;

static PLANT: StaticCell<RefCell<Plant>> = StaticCell::new();
static CHANNELS: StaticCell<Channels<LinkCounters>> = StaticCell::new();
static CONTROLLER: StaticCell<Controller> = StaticCell::new();
static SESSION: StaticCell<Pms5005> = StaticCell::new();
/// The recorder's.
static ROWS: ConstStaticCell<[Row; RECORDER_ROWS]> =
    ConstStaticCell::new([Row::ZERO; RECORDER_ROWS]);

/// How far the board's time may go. It lasts 49 days.
static MILLISECONDS: AtomicU32 = AtomicU32::new(0);
/// The tasks are to be polled.
static WOKEN: AtomicBool = AtomicBool::new(true);

#[entry]
fn main() -> ! {
    let plant = PLANT.init_with(|| RefCell::new(Plant::new(Scene::default(), SEED)));
    let channels = CHANNELS.init_with(Channels::new);
    let controller = CONTROLLER.init_with(|| Controller::new(Settings::DEFAULT.control));
    let session =
        SESSION.init_with(|| Pms5005::new(Settings::DEFAULT, Boot::default(), Instant::now()));
    let recorder = Mutex::new(RefCell::new(Recorder::new(ROWS.take())));
    TRACE.start();
    HOST.start();
    uart::listen();
    if let Some(core) = cortex_m::Peripherals::take() {
        start(core.SYST);
    }

    let line = Line::default();
    let (mut rx, mut tx) = line.board_end();
    let watchdog = Watchdog::new(WATCHDOG_PERIOD); // which nobody waits for to bite
    let ends = (&mut rx, &mut tx);
    let all = tasks::all(plant, controller, session, &recorder, ends, channels, &watchdog);
    let mut board = pin!(async {
        join(all, app::no_upkeep(channels)).await;
    });
    let waker = waker();
    let mut run_until = |ms: u32| {
        tasks::run_until(board.as_mut(), &waker, &WOKEN, Instant::from_millis(ms.into()));
    };
    let mut now = 0;
    loop {
        run_until(now);
        let count = line.hand_over();
        if count > 0 {
            tell(format_args!("{now} {count}"));
            run_until(now);
        }
        while MILLISECONDS.load(Ordering::Relaxed) == now {
            cortex_m::asm::wfi(); // a tick that slips in between is followed by the next
        }
        now = MILLISECONDS.load(Ordering::Relaxed);
    }
}

/// Writes a line of the trace.
fn tell(line: core::fmt::Arguments<'_>) {
    let _ = writeln!({ TRACE }, "{line}"); // it takes everything
}

/// Starts the ticks, 1 ms each.
fn start(mut systick: SYST) {
    systick.set_clock_source(SystClkSource::Core);
    systick.set_reload(CLOCK_HZ / 1000 - 1);
    systick.clear_current();
    systick.enable_counter();
    systick.enable_interrupt();
}

#[exception]
fn SysTick() {
    MILLISECONDS.fetch_add(1, Ordering::Relaxed);
}

/// Sets [`WOKEN`].
fn waker() -> Waker {
    const RAW: RawWaker = RawWaker::new(ptr::null(), &TABLE);
    const TABLE: RawWakerVTable = RawWakerVTable::new(|_| RAW, wake, wake, |_| {});
    fn wake(_: *const ()) {
        WOKEN.store(true, Ordering::Relaxed);
    }
    // SAFETY: none of the functions looks at the pointer, and there is nothing to drop.
    unsafe { Waker::from_raw(RAW) }
}

/// All of the STM32's interrupts: the vector table has no names for them.
#[exception]
unsafe fn DefaultHandler(number: i16) {
    assert_eq!(number, uart::INTERRUPT, "an interrupt that nobody has enabled");
    uart::receive();
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    panic!("hard fault at {:#010x}", frame.pc());
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    tell(format_args!("{info}"));
    loop {
        cortex_m::asm::wfi();
    }
}
