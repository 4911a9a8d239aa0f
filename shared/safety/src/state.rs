//! States of the bench.
//!
//! ```text
//! off → idle → armed → starting → running → stopping → idle
//!                                 running → holding → resuming → running     (virtual rig only)
//! any but off, tripped → tripped → (acknowledged) → idle
//! ```

/// State of the bench.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum BenchState {
    /// Not switched on: nothing acts.
    #[default]
    Off = 0,
    /// On; forces zero, axes held, steer torque off.
    Idle = 1,
    /// Ready to start on the operator's word.
    Armed = 2,
    /// Soft fade-in of forces, heights, steering.
    Starting = 3,
    /// Commands pass within limits.
    Running = 4,
    /// Inputs stale: vertical axes frozen, force ramping down, steer torque off.
    Holding = 5,
    /// Inputs fresh again: fading from measured to commanded.
    Resuming = 6,
    /// Soft fade-out by the operator.
    Stopping = 7,
    /// Latched safe state.
    Tripped = 8,
}

impl BenchState {
    /// All states.
    pub const ALL: [Self; 9] = [
        Self::Off,
        Self::Idle,
        Self::Armed,
        Self::Starting,
        Self::Running,
        Self::Holding,
        Self::Resuming,
        Self::Stopping,
        Self::Tripped,
    ];

    /// The state of a number.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.get(usize::from(number)).copied()
    }

    /// Name for logs and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "off",
            Self::Idle => "idle",
            Self::Armed => "armed",
            Self::Starting => "starting",
            Self::Running => "running",
            Self::Holding => "holding",
            Self::Resuming => "resuming",
            Self::Stopping => "stopping",
            Self::Tripped => "tripped",
        }
    }

    /// Whether commands of the simulation reach the rig, at least in part.
    pub fn follows_commands(self) -> bool {
        matches!(self, Self::Starting | Self::Running | Self::Holding | Self::Resuming | Self::Stopping)
    }
}
