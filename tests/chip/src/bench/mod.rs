//! The bench: the part on its board, with the world around it, and an image running.
//!
//! ```text
//!   test ── orders ──> the core's thread: rigless, Stm32f407 <──> World (plant, multiplexers, ...)
//!                                            │ USART2            │ USART6      │ I2C1
//!                                           Line                Servos        Display
//! ```
//! Time is the bench's own: it stands while the test looks, and moves while the test lets it run. The
//! same run comes out of the same orders, on every machine.

pub mod display;
pub mod line;
pub mod multiplexers;
pub mod pms5005;
pub mod probe;
pub mod servos;
mod stand;
pub mod world;

use std::num::{NonZeroU32, NonZeroU64};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use hal_mock::plant::Scene;
use hal_mock::servo_bus::ServoBus;
use object::{Object, ObjectSymbol, SymbolKind};
use rigless::device::{ErasedDevice, ResetCause};
use rigless::emulator::{self, AccessKind, Driver, Host, Settled, Start, Stop};
use rigless::image::Image;
use rigless::machine::{Board, Target, armv7m};
use rigless::mcu::{Mcu, Operate};
use rigless::session::Session;
use rigless::snapshot::Store;
use rigless::soc::{Bus, Width};
use rigless::time::VirtualNanos;

use crate::part::timers::Shared;
use crate::part::{REVISION_Z, Stm32f407};
use display::Display;
use line::Line;
use multiplexers::Multiplexers;
use servos::Servos;
pub use stand::Stand;
use world::World;

/// Instructions that the core executes in a second: one a clock, which no silicon with wait states
/// does. It is the bench's choice; nothing that depends on it is reported as the chip's.
const INSTRUCTIONS_PER_SECOND: u64 = 168_000_000;
/// The independent watchdog's key register, and the key that feeds.
const IWDG_KR: u64 = 0x4000_3000;
const FEED: u64 = 0xAAAA;
/// The servo bus's data register.
const USART6_DR: u64 = 0x4001_1404;
/// Where the settings' sectors begin.
const SETTINGS: u64 = 0x0800_4000;

/// What a bench is made of.
pub struct Make {
    /// The world.
    pub scene: Scene,
    /// The servo bus, for the CM-5.
    pub servos: ServoBus,
    /// The part's `DBGMCU_IDCODE`.
    pub identity: u64,
    /// What is in the settings' sectors, from 0x0800_4000.
    pub settings: Vec<u8>,
    /// What the maker put into system memory at 0x1FFF_0000: vectors first.
    pub loader: Vec<u8>,
    /// How many bits a display cut off in a byte still waits for, holding its data line low.
    pub stuck_bits: u32,
}

impl Default for Make {
    fn default() -> Self {
        let servos = ServoBus::new(Default::default(), []);
        let scene = Scene::default();
        let (settings, loader) = (Vec::new(), Vec::new());
        Self { scene, servos, identity: REVISION_Z, settings, loader, stuck_bits: 0 }
    }
}

/// The part and the world, as rigless runs them.
#[derive(Debug)]
pub struct Rig {
    /// The part.
    pub chip: Stm32f407,
    /// The world.
    pub world: World,
}

impl Store for Rig {}

impl Mcu for Rig {
    fn bus(&self) -> &Bus {
        self.chip.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.chip.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        self.chip.reset(at, cause);
        self.world.put_again(&mut self.chip, at);
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.chip.poll(now);
        self.world.step(&mut self.chip, now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        self.chip.split(slot)
    }
}

impl Board for Rig {
    fn name(&self) -> &'static str {
        "bench"
    }

    fn target_names(&self) -> Vec<&'static str> {
        vec!["stm32f407"]
    }

    fn mcu(&mut self, target: usize) -> Option<&mut dyn Mcu> {
        (target == 0).then_some(self)
    }

    fn targets(&mut self) -> Vec<Target<'_>> {
        let positive = |n| NonZeroU64::new(n).expect("it is above 0");
        let lines = NonZeroU32::new(self.chip.cpu().interrupt_lines.into()).expect("it has some");
        let core = armv7m::Core {
            variant: armv7m::Variant::M4,
            clock_hz: positive(168_000_000),
            interrupt_lines: lines,
            priority_bits: 4,
            refclk_divider: NonZeroU32::new(8).expect("it is above 0"),
            instructions_per_second: positive(INSTRUCTIONS_PER_SECOND),
            boot: "flash",
        };
        let windows = rigless::cpu::armv7m::windows(self.chip.bus());
        let spec = core.spec_with_parts(&windows, armv7m::Fpu::FpV4Sp, armv7m::MpuRegions::Eight);
        vec![Target::new("stm32f407", self, spec)]
    }
}

type Act = Box<dyn FnOnce(&mut Stand<'_>) + Send>;

enum Order {
    RunUntil(u64),
    Do(Act),
}

/// The run's side of the bench.
struct Runner {
    orders: Receiver<Order>,
    stopped: Sender<()>,
    feeds: Vec<u64>,
    is_held: bool,
    is_halted: bool,
    /// How many there were when the core was last looked at.
    resets: usize,
    is_waited_for: bool,
}

impl Runner {
    /// Holds the core or lets it go.
    fn hold(&mut self, session: &Session<Rig>, host: &mut dyn Host, now: VirtualNanos) {
        // A reset lets go of a core that a probe has halted.
        let resets = session.resets().len();
        self.is_halted &= resets == std::mem::replace(&mut self.resets, resets);
        // It stands still too while the flash that it runs from is at work.
        let is_held = self.is_halted || now.0 < session.board().chip.flash.busy_until;
        if is_held != self.is_held {
            self.is_held = is_held;
            host.hold(is_held);
        }
    }
}

impl Driver<Rig> for Runner {
    fn on_settled(&mut self, session: &mut Session<Rig>, host: &mut dyn Host, settled: Settled) {
        let now = match settled {
            Settled::Access { access, .. } => {
                let is_feed = access.kind == AccessKind::Write && access.value == FEED;
                if is_feed && access.address == IWDG_KR {
                    self.feeds.push(access.virtual_time.0);
                }
                if access.kind == AccessKind::Write && access.address == USART6_DR {
                    let Rig { chip, world } = session.board_mut();
                    world.servos.master_writes(access.value as u8); // 8 data bits
                    chip.wake_at(access.virtual_time, access.virtual_time);
                }
                access.virtual_time
            }
            Settled::Stop(stop) => stop.at,
            _ => return,
        };
        self.hold(session, host, now);
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Rig>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        if std::mem::take(&mut self.is_waited_for) {
            self.stopped.send(()).ok()?;
        }
        loop {
            match self.orders.recv().ok()? {
                Order::RunUntil(ns) if ns > stop.at.0 => {
                    self.is_waited_for = true;
                    return Some(VirtualNanos(ns));
                }
                Order::RunUntil(_) => self.stopped.send(()).ok()?,
                Order::Do(act) => {
                    let (feeds, is_halted) = (&mut self.feeds, &mut self.is_halted);
                    act(&mut Stand { session, host, feeds, is_halted, now: stop.at });
                    self.hold(session, host, stop.at);
                }
            }
        }
    }
}

/// A bench with an image that runs.
pub struct Bench {
    orders: Option<Sender<Order>>,
    stopped: Receiver<()>,
    thread: Option<JoinHandle<()>>,
    now_ns: u64,
    /// The host's end of its line.
    pub line: Line,
    /// The display.
    pub display: Display,
    /// The servo bus.
    pub servos: Servos,
    /// The image's file.
    elf: Vec<u8>,
}

/// Where `.ci/images` leaves an image.
pub fn image(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/images").join(format!("{name}.elf"))
}

impl Bench {
    /// Switches on a board with one of the images of `.ci/images`.
    ///
    /// # Panics
    /// If the image is not there.
    pub fn boot(name: &str) -> Self {
        Self::boot_with(name, Make::default())
    }

    /// Switches on a board like this.
    pub fn boot_with(name: &str, make: Make) -> Self {
        let path = image(name);
        let image = Image::read(&path, None)
            .unwrap_or_else(|error| panic!("{}: {error}; .ci/images builds it", path.display()));
        let elf = image.bytes().to_vec();
        let waveforms = [Shared::default(), Shared::default()];
        let channels = [world::COMMON[0], world::COMMON[1], world::COMMON[2]];
        let wiring = if name.ends_with("f446") { &world::F446 } else { &world::F407 };
        let front = Multiplexers::new(wiring.select, channels, waveforms.clone());
        let voltages = front.voltages.clone();
        let (line, display) = (Line::default(), Display::default());
        let servos = Servos::new(make.servos);
        let mut world = World::new(make.scene, wiring, voltages, servos.clone());
        world.stuck_bits = make.stuck_bits;
        let chip = Stm32f407::new(make.identity, 3300, waveforms, Box::new(front), world::COMMON);
        let mut chip = chip.expect("the part's description is right");
        chip.part.usart[1].attach(line.clone());
        chip.part.usart[3].attach(servos.clone());
        chip.part.i2c[0].attach(display.clone());
        let rig = Rig { chip, world };
        let (orders, from_test) = channel();
        let (stopped, from_run) = channel();
        let thread = std::thread::spawn(move || {
            let session = Session::new(Box::new(rig), 0, VirtualNanos(1)).expect("a target");
            let mut images = vec![image];
            for (bytes, at) in [(make.loader, 0x1FFF_0000), (make.settings, SETTINGS)] {
                if !bytes.is_empty() {
                    let image = Image::new(Path::new("more"), bytes, Some(at));
                    images.push(image.expect("it is placed as it is"));
                }
            }
            let runner = Runner {
                orders: from_test,
                stopped,
                feeds: Vec::new(),
                is_held: false,
                is_halted: false,
                resets: 0,
                is_waited_for: false,
            };
            if let Err(error) = emulator::run(session, &Start::new(&images), runner) {
                panic!("the run ended: {error}");
            }
        });
        Self {
            orders: Some(orders),
            stopped: from_run,
            thread: Some(thread),
            now_ns: 0,
            line,
            display,
            servos,
            elf,
        }
    }

    /// Where the image has the only symbol, or the shortest, with this in its mangled name. A
    /// function's is its first instruction.
    ///
    /// # Panics
    /// If there is none.
    pub fn symbol(&self, part: &str) -> u64 {
        let file = object::File::parse(&self.elf[..]).expect("an ELF file");
        let named = file.symbols().filter_map(|symbol| Some((symbol.name().ok()?, symbol)));
        let code_or_data = named.filter(|(name, symbol)| {
            name.contains(part) && matches!(symbol.kind(), SymbolKind::Text | SymbolKind::Data)
        });
        let shortest = code_or_data.min_by_key(|(name, _)| name.len());
        shortest.unwrap_or_else(|| panic!("no symbol with {part}")).1.address() & !1
    }

    /// Puts other instructions where a symbol is, as if the flash had always held them: what the
    /// image does from there on is the test's. Half words of Thumb code; answers what was there.
    pub fn patch(&self, part: &str, code: &[u16]) -> Vec<u16> {
        let (address, code) = (self.symbol(part), code.to_vec());
        self.with(move |stand| {
            let put = |(address, half): (u64, u16)| {
                let was = stand.host.read(address, Width::W16).expect("it is in the flash");
                let put = stand.host.program(address, Width::W16, half.into());
                put.expect("it is in the flash");
                was as u16 // 16 bits were read
            };
            (address..).step_by(2).zip(code).map(put).collect()
        })
    }

    /// The image's file.
    pub fn elf(&self) -> &[u8] {
        &self.elf
    }

    fn order(&self, order: Order) {
        let orders = self.orders.as_ref().expect("they live as long as the bench");
        orders.send(order).expect("the run goes on");
    }

    /// Now, in ns since power on.
    pub fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// Runs until then.
    pub fn run_until_ns(&mut self, ns: u64) {
        self.order(Order::RunUntil(ns));
        self.stopped.recv().expect("the run goes on");
        self.now_ns = self.now_ns.max(ns);
    }

    /// Runs for some milliseconds.
    pub fn run_for(&mut self, ms: u64) {
        self.run_until_ns(self.now_ns + ms * 1_000_000);
    }

    /// With time standing still.
    pub fn with<T: Send + 'static>(
        &self,
        act: impl FnOnce(&mut Stand<'_>) -> T + Send + 'static,
    ) -> T {
        let (answer, from_run) = channel();
        self.order(Order::Do(Box::new(move |stand| {
            let _ = answer.send(act(stand)); // whoever asked waits for it
        })));
        from_run.recv().expect("the run goes on")
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.orders = None; // the run ends
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // what it has to say it has said
        }
    }
}
