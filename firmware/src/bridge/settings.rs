//! What an owner of a CM-5 may choose. These are constants of its image, without numbers: a bridge has no
//! flash to keep them in, and its PC no packet to ask for them.

/// What happens when the PC of a CM-5 falls silent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OnSilence {
    /// Goals and torque stay as they are; what turns endlessly is stopped. A robot that goes limp
    /// falls.
    Freeze,
    /// All torque goes: for what must not hold against a hand.
    TorqueOff,
}

/// The CM-5 bridge's settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BridgeSettings {
    /// Baud of the board's line to the PC; default 1,000,000. A stock CM-5's port has 57,600. The
    /// virtual board has an option instead.
    pub pc_baud: u32,
    /// Silence of the PC, in ms, after which `on_silence` is done; 0 never. Default 1000.
    pub pc_timeout_ms: u16,
    /// How often a hello is said between the reports while the PC is silent, and while it has not
    /// answered that the table of servos has changed, in seconds; 0 never. Default 10. Before the
    /// PC's first answer it is once a second.
    pub hello_period_s: u16,
    /// What the servos do then; default [`OnSilence::Freeze`].
    pub on_silence: OnSilence,
    /// How often an ID that did not answer is asked again before there is no servo; default 2. With
    /// one byte of a hundred damaged, a PING of twice 6 bytes fails once in nine times.
    pub search_retries: u8,
    /// Whether the PC may set a servo's lock, which leaves only registers 24 to 35 writable until
    /// power-off; default no.
    pub pass_lock: bool,
}

impl BridgeSettings {
    /// The defaults named at each field.
    pub const DEFAULT: Self = Self {
        pc_baud: 1_000_000,
        pc_timeout_ms: 1000,
        hello_period_s: 10,
        on_silence: OnSilence::Freeze,
        search_retries: 2,
        pass_lock: false,
    };
}
