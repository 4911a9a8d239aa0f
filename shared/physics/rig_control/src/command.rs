//! What the controller is asked for, and what it tells about itself.

/// What the steer axis does.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum SteerCommand {
    /// Nothing: no torque. With a measuring wheel the human steers.
    #[default]
    Free,
    /// Follow an angle.
    Angle {
        /// Angle, left turn positive. [rad]
        angle_rad: f64,
        /// Its rate. [rad/s]
        rate_rad_s: f64,
    },
    /// Give a torque to the column.
    Torque {
        /// Torque, left turn positive. [N·m]
        torque_n_m: f64,
    },
}

/// Share of the command that is let through, 0 to 1, by the state of the bench.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fade {
    /// Multiplies the tie-rod forces.
    pub force: f64,
    /// Ball height between where the axis was when this last became 0 and the command.
    pub vertical: f64,
    /// Steering angle likewise; 0 takes the torque off.
    pub steer: f64,
}

impl Fade {
    /// Nothing gets through.
    pub const OFF: Self = Self { force: 0.0, vertical: 0.0, steer: 0.0 };
    /// Everything gets through.
    pub const FULL: Self = Self { force: 1.0, vertical: 1.0, steer: 1.0 };
}

/// Command of one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigCommand {
    /// Tie-rod forces, tension positive. [N]
    pub tie_rod_force_n: [f64; 2],
    /// Heights of the outer balls over rest. [m]
    pub ball_height_m: [f64; 2],
    /// Their rates. [m/s]
    pub ball_height_velocity_m_s: [f64; 2],
    /// Steer axis.
    pub steer: SteerCommand,
    /// What the bench's state lets through.
    pub fade: Fade,
}

impl Default for RigCommand {
    fn default() -> Self {
        Self {
            tie_rod_force_n: [0.0; 2],
            ball_height_m: [0.0; 2],
            ball_height_velocity_m_s: [0.0; 2],
            steer: SteerCommand::Free,
            fade: Fade::OFF,
        }
    }
}

/// What the controller tells about a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ControlDiagnostics {
    /// Command (after fade) less reading of the tie-rod cell. [N]
    pub force_error_n: [f64; 2],
    /// Force the loop works on: both cells joined. [N]
    pub force_feedback_n: [f64; 2],
    /// Command (after fade) less stroke. [m]
    pub height_error_m: [f64; 2],
    /// Rack velocity as observed. [m/s]
    pub rack_velocity_m_s: f64,
    /// Rack velocity fed forward. [m/s]
    pub rack_velocity_ahead_m_s: f64,
    /// Tie-rod velocity that nothing explains, by the force loop's disturbance observer. [m/s]
    pub disturbance_m_s: [f64; 2],
    /// Lag of the force from command to reading, estimated while running; 0 until known. [s]
    pub loop_delay_s: [f64; 2],
    /// Whether the estimate is supported by enough movement of the command: bits left, right.
    pub loop_delay_known: u64,
    /// Energy that tracking errors fed into the steering over the last full steering cycle. [J]
    pub energy_cycle_j: f64,
    /// The same over the last second. [J]
    pub energy_second_j: f64,
    /// The same since the start. [J]
    pub energy_total_j: f64,
    /// Bits of [`flags`](self::flags).
    pub flags: u64,
}

/// Bits of [`ControlDiagnostics::flags`].
pub mod flags {
    /// A horizontal valve command was cut at full opening (left, right at the next bit).
    pub const HORIZONTAL_SATURATED: u64 = 1;
    /// A vertical valve command was cut at full opening (left, right at the next bit).
    pub const VERTICAL_SATURATED: u64 = 1 << 2;
    /// A valve command was slowed to its rate limit.
    pub const RATE_LIMITED: u64 = 1 << 4;
    /// The steer torque was cut at its limit.
    pub const STEER_SATURATED: u64 = 1 << 5;
    /// A command was not finite: the last one was used.
    pub const COMMAND_HELD: u64 = 1 << 6;
    /// A reading was not finite: the last one was used.
    pub const MEASUREMENT_HELD: u64 = 1 << 7;
}
