//! An STM32F407VG: rigless' STM32F427 with this part's memory, wiring and identity, and our models of
//! what that one leaves out. The F427's peripherals are those of the F407's reference manual, RM0090.
//!
//! | model | what it is |
//! |---|---|
//! | [`exti`] | external interrupts and the choice of their ports |
//! | [`timers`] | TRGO, ITR0 and the update's DMA request of TIM1 and TIM8; TIM12 |
//! | [`converter`] | ADC1's trigger, and voltages that move |
//! | [`flash`] | a flash that ANDs and takes its time |
//! | [`clocks`] | clock enables and reset lines |
//! | `pulses` | what a timer makes of its pins |
//!
//! Each opens with two tables: what it covers, and what it leaves out and why. Everything else is
//! rigless' own, with tables of the same kind.
//!
//! | of the whole part left out | reason |
//! |---|---|
//! | PWR's VOS of the F407 | one bit where the F427 has two: written and read back here all the same |
//! | interrupt lines from 82 on | the F407 has none, and no image names one |
//! | wait states, caches, bus contention | time is a fixed number of instructions a second, chosen by the bench |
//! | what a halted core stops besides the watchdog and TIM5 (`halt`) | no image freezes anything else |
//! | half duplex of the UARTs | the bench puts the echo on the wire, if `HDSEL` stands (`bench::servos`) |

pub mod clocks;
pub mod converter;
pub mod exti;
pub mod flash;
mod pulses;
pub mod timers;

use rigless::device::{ErasedDevice, Level, ResetCause};
use rigless::mcu::{Bare, Mcu, Operate};
use rigless::soc::st::tim::Channel;
use rigless::soc::stm32f427::generated::{dbg, gpioa, pwr, rcc};
use rigless::soc::stm32f427::peripherals::dma::{Dma, Wire};
use rigless::soc::stm32f427::peripherals::gpio::{Gpio, Pin};
use rigless::soc::stm32f427::peripherals::tim::Tim;
use rigless::soc::stm32f427::peripherals::{adc, rcc as rcc_model, usart};
use rigless::soc::stm32f427::{self, Stm32f427};
use rigless::soc::{Bus, Error, Gate, Layout, Region, WriteModify};
use rigless::time::VirtualNanos;

use converter::{Converter, Front};
use exti::{Exti, Syscfg};
use flash::Flash;
pub use pulses::{Output, Pulses, Timer};
use timers::{Pwm, Shared, TwoChannels, UPDATE, tim12};

/// What every bus runs at after a reset: the internal oscillator.
pub const RESET_HZ: u64 = 16_000_000;

/// RM0090 section 2.3, tables 1 and 5: 1 MiB of flash, 64 KiB of core coupled memory, 112 and 16 KiB
/// of SRAM in one piece.
///
/// What lies between system memory and SRAM bears any access here, though the manual gives nothing but the
/// option bytes there: what silicon makes of it is not known, so nothing may rest on a fault of the bus.
static MEMORY: [Region; 6] = [
    Region::flash("flash", 0x0800_0000, 1 << 20).erased_to(0xFF).programmed_by("FLASH"),
    Region::ram("ccm", 0x1000_0000, 64 << 10),
    Region::system("system", 0x1FFF_0000, 32 << 10),
    Region::ram("below_sram", 0x1FFF_8000, 32 << 10),
    Region::ram("sram", 0x2000_0000, 128 << 10),
    Region::ram("backup_sram", 0x4002_4000, 4 << 10),
];

/// DMA2 as our images use it (RM0090 table 43).
static DMA2: [Wire; 4] = [
    Wire { instance: "ADC1", request: adc::DMA_REQUEST, channel: 0, streams: &[0, 4] },
    Wire { instance: "TIM8", request: UPDATE, channel: 7, streams: &[1] },
    Wire { instance: "USART6", request: usart::RECEIVE_REQUEST, channel: 5, streams: &[1, 2] },
    Wire { instance: "USART6", request: usart::TRANSMIT_REQUEST, channel: 5, streams: &[6, 7] },
];

/// The F407's identity, revision Z (RM0090 section 38.6.1); revision A is 0x1000_6411.
pub const REVISION_Z: u64 = 0x1007_6413;

/// The bus: rigless' description over this part's memory. A bus of its own tells what it corrects;
/// what it does not tell is stated again.
fn bus(identity: u64) -> Result<Bus, Error> {
    let mut bare = Bare::new(stm32f427::builder())?;
    let from = stm32f427::builder().build()?;
    let instances: Vec<_> = from.peripherals().copied().collect();
    let mut bus = Bus::builder(from.cpu(), &MEMORY, instances.iter().copied());
    for instance in &instances {
        for register in instance.registers {
            let address = instance.base + u64::from(register.offset);
            let reset = bare.peek(VirtualNanos(0), address, register.width);
            if let (true, Ok(value)) = (register.access.is_readable(), reset)
                && value != register.reset
            {
                bus = bus.reset(instance.name, register.name, value);
            }
        }
        if let Some(clock) = from.clock_of(instance.name) {
            bus = bus.clocked_by(instance.name, clock);
        }
    }
    for timer in ["TIM1", "TIM2", "TIM3", "TIM4", "TIM5", "TIM8", "TIM12"] {
        bus = bus.write_modify(timer, "SR", WriteModify::ZeroToClear);
    }
    for i2c in ["I2C1", "I2C2", "I2C3"] {
        bus = bus.write_modify(i2c, "SR1", WriteModify::ZeroToClear);
    }
    for (enable, reset) in
        [(&rcc_model::GPIOJEN, &rcc_model::GPIOJRST), (&rcc_model::GPIOKEN, &rcc_model::GPIOKRST)]
    {
        bus = bus.declare("RCC", "AHB1ENR", enable).declare("RCC", "AHB1RSTR", reset);
    }
    for (instance, name, enable, reset) in clocks::GATES {
        let (enables, resets) = clocks::registers(name);
        bus = bus.gate(instance, Gate::by("RCC", enables, enable));
        bus = bus.reset_by(instance, Gate::by("RCC", resets, reset));
    }
    for sink in ["RCC", "C_ADC", "ADC1", "TIM1", "TIM8", "DMA1", "DMA2", "EXTI"] {
        bus = bus.reads_requests(sink);
    }
    bus.write_modify("FLASH", "SR", WriteModify::OneToClear)
        .write_modify("EXTI", "PR", WriteModify::OneToClear)
        .reset("DBG", "DBGMCU_IDCODE", identity)
        .clocked_by("TIM12", from.clock_of("TIM3").expect("TIM3 has a clock"))
        .build()
}

/// The part.
#[derive(Debug)]
pub struct Stm32f407 {
    /// rigless' part around its models.
    pub part: Stm32f427,
    /// External interrupts.
    pub exti: Exti,
    /// ADC1.
    pub adc1: Converter,
    /// TIM1.
    pub tim1: Pwm,
    /// TIM8.
    pub tim8: Pwm,
    /// The flash interface.
    pub flash: Flash,
    tim12: Tim<TwoChannels>,
    syscfg: Syscfg,
    waveforms: [Shared; 2],
    slots: [usize; 7],
    identity: u64,
    supply_mv: u32,
}

/// The instances that our models answer for, in the order of `Stm32f407::slots`.
const OURS: [&str; 7] = ["EXTI", "ADC1", "TIM1", "TIM8", "TIM12", "SYSCFG", "FLASH"];

impl Stm32f407 {
    /// A part with an 8 MHz crystal and this supply, with voltages on these inputs of ADC1.
    pub fn new(
        identity: u64,
        supply_mv: u32,
        waveforms: [Shared; 2],
        front: Box<dyn Front>,
        inputs: &'static [u8],
    ) -> Result<Self, Error> {
        let mut part = Stm32f427::new()?;
        part.rcc.attach_crystals(8_000_000, 0);
        let slot = |name| part.bus().slot_of(name).expect("the part has it");
        let slots = OURS.map(slot);
        let [first, second] = &waveforms;
        let mut chip = Self {
            exti: Exti::default(),
            adc1: Converter::new(front, inputs, supply_mv),
            tim1: Pwm::new(None, first.clone()),
            tim8: Pwm::new(Some("TIM1"), second.clone()),
            flash: Flash::default(),
            tim12: tim12(),
            syscfg: Syscfg,
            part,
            waveforms,
            slots,
            identity,
            supply_mv,
        };
        chip.fit()?;
        chip.check()?;
        Ok(chip)
    }

    /// Puts this part's bus and wiring in the place of the F427's.
    fn fit(&mut self) -> Result<(), Error> {
        *self.part.bus_mut() = bus(self.identity)?;
        self.part.dma[1] = Dma::new(&DMA2, &[], true);
        self.part.set_supply(self.supply_mv);
        Ok(())
    }

    /// What the world drives on a pin; `None` lets go of it.
    pub fn drive(&mut self, at: VirtualNanos, port: usize, pin: u8, level: Option<Level>) {
        let pin = Pin::new(pin).expect("a port has 16 pins");
        self.part.drive_port(at, port, |gpio, registers, context| {
            gpio.drive(pin, level, registers, context);
        });
    }

    /// The level on a pin that is no timer's.
    pub fn level(&mut self, port: usize, pin: u8) -> Level {
        let (gpio, registers) = self.part.port(port);
        gpio.level(Pin::new(pin).expect("a port has 16 pins"), registers)
    }

    /// The alternate function that a pin carries.
    pub fn function(&mut self, port: usize, pin: u8) -> Option<u8> {
        let (_, registers) = self.part.port(port);
        Gpio::function(Pin::new(pin).expect("a port has 16 pins"), registers)
    }

    /// What an encoder drives on channels 1 and 2 of TIM2 (0) or TIM4 (2).
    pub fn encoder(&mut self, at: VirtualNanos, timer: usize, a: Level, b: Level) {
        self.part.drive_timer(at, timer, |timer, registers, context| {
            for (channel, level) in [(1, a), (2, b)] {
                let channel = Channel::new(channel).expect("1 and 2 are channels");
                timer.drive_input(channel, level, registers, context);
            }
        });
    }

    /// The PWM of TIM1 and TIM8 as it was when they were last touched.
    pub fn waveforms(&self) -> [timers::Waveform; 2] {
        self.waveforms.each_ref().map(|shared| shared.lock().unwrap().clone())
    }

    /// One update's DMA request of TIM8 more than its counter makes.
    pub fn request_once_more(&mut self, now: VirtualNanos) {
        let slot = self.slots[3];
        let mut context = self.part.bus_mut().drive(now, slot).1;
        context.request(UPDATE, Level::High);
        context.request(UPDATE, Level::Low);
    }

    /// Asks for a stop at `at`.
    pub fn wake_at(&mut self, now: VirtualNanos, at: VirtualNanos) {
        let slot = self.slots[0];
        self.part.bus_mut().drive(now, slot).1.schedule(at);
    }

    /// A probe halts the core, or lets it go: of what `DBGMCU_APB1_FZ` names the watchdog and TIM5 stand
    /// still meanwhile, everything else goes on (RM0090 section 38.16.4). The clocks are those of a board
    /// that has started.
    pub fn halt(&mut self, now: VirtualNanos, is_halted: bool) {
        use dbg::dbgmcu_apb1_fz::{DBG_IWDEG_STOP, DBG_TIM5_STOP};
        let frozen = self.register("DBG", dbg::Register::DbgmcuApb1Fz);
        let lsi_hz = self.part.rcc.lsi_hz();
        let all =
            [("IWDG", DBG_IWDEG_STOP, lsi_hz), ("TIM5", DBG_TIM5_STOP, pulses::APB1_HZ as u64)];
        for (instance, freezes, hz) in all {
            if freezes.is_set(frozen) {
                let slot = self.part.bus().slot_of(instance).expect("the part has it");
                let (bus, model) = self.part.split(slot);
                let (registers, mut context) = bus.drive(now, slot);
                let model = model.expect("rigless models it");
                model.on_clock(if is_halted { 0 } else { hz }, registers, &mut context);
            }
        }
    }

    /// A register as it stands.
    pub fn register<L: Layout>(&self, instance: &str, register: L) -> u64 {
        self.part.bus().registers(instance).expect("the part has it").get(register)
    }
}

/// What a system reset keeps (RM0090 sections 7.1.1, 7.1.3, 38.16.3).
struct Kept {
    rcc: [u64; 2],
    pwr: u64,
    dbg: [u64; 3],
}

const RCC: [rcc::Register; 2] = [rcc::Register::Csr, rcc::Register::Bdcr];
const DBG: [dbg::Register; 3] =
    [dbg::Register::DbgmcuCr, dbg::Register::DbgmcuApb1Fz, dbg::Register::DbgmcuApb2Fz];

impl Kept {
    fn of(bus: &Bus) -> Self {
        let of = |instance: &str| bus.registers(instance).expect("the part has it");
        Self {
            rcc: RCC.map(|register| of("RCC").get(register)),
            pwr: of("PWR").get(pwr::Register::Csr),
            dbg: DBG.map(|register| of("DBG").get(register)),
        }
    }

    fn put(&self, bus: &mut Bus) {
        let slot = |bus: &Bus, name| bus.slot_of(name).expect("the part has it");
        let (clocks, power, debug) = (slot(bus, "RCC"), slot(bus, "PWR"), slot(bus, "DBG"));
        for (register, value) in RCC.into_iter().zip(self.rcc) {
            bus.slot_mut(clocks).registers_mut().set(register, value);
        }
        bus.slot_mut(power).registers_mut().set(pwr::Register::Csr, self.pwr);
        for (register, value) in DBG.into_iter().zip(self.dbg) {
            bus.slot_mut(debug).registers_mut().set(register, value);
        }
    }
}

impl Mcu for Stm32f407 {
    fn bus(&self) -> &Bus {
        self.part.bus()
    }

    fn bus_mut(&mut self) -> &mut Bus {
        self.part.bus_mut()
    }

    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        // rigless' reset checks that the bus is its own: it gets one, with what it is to keep.
        let kept = Kept::of(self.part.bus());
        *self.part.bus_mut() = stm32f427::builder().build().expect("it was built before");
        kept.put(self.part.bus_mut());
        self.part.reset(at, cause);
        let kept = Kept::of(self.part.bus());
        self.adc1.restart(self.supply_mv);
        let [first, second] = &self.waveforms;
        self.tim1 = Pwm::new(None, first.clone());
        self.tim8 = Pwm::new(Some("TIM1"), second.clone());
        self.tim12 = tim12();
        ErasedDevice::reset(&mut self.exti);
        ErasedDevice::reset(&mut self.flash);
        self.fit().expect("it was built before");
        kept.put(self.part.bus_mut());
    }

    fn poll(&mut self, now: VirtualNanos) {
        self.part.poll(now);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let Some(ours) = self.slots.iter().position(|&s| s == slot) else {
            return self.part.split(slot);
        };
        let model: &mut dyn ErasedDevice = match ours {
            0 => &mut self.exti,
            1 => &mut self.adc1,
            2 => &mut self.tim1,
            3 => &mut self.tim8,
            4 => &mut self.tim12,
            5 => &mut self.syscfg,
            _ => &mut self.flash,
        };
        (self.part.bus_mut(), Some(model))
    }
}

/// The pull resistors that a pin has switched on: 0 none, 1 up, 2 down.
pub fn pull(chip: &Stm32f407, port: &'static str, pin: u8) -> u64 {
    chip.register(port, gpioa::Register::Pupdr) >> (2 * pin) & 3
}
