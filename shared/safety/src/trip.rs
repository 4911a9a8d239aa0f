//! Why a bench trips.

/// Cause of a trip. The number goes into logs and never changes its meaning.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum TripCode {
    /// Emergency stop pressed (or its circuit open).
    EmergencyStop = 1,
    /// Interlock chain open.
    InterlockOpen = 2,
    /// Inputs stale on real hardware, or before running.
    StaleInputs = 3,
    /// Holding longer than allowed.
    HoldingTooLong = 4,
    /// The rig's own process missed ticks.
    RigStall = 5,
    /// Measured tie-rod force. Channel: side.
    TieRodForce = 10,
    /// Measured force of a horizontal cylinder. Channel: side.
    ActuatorForce = 11,
    /// Stroke of a horizontal cylinder. Channel: side.
    HorizontalStroke = 12,
    /// Stroke of a vertical cylinder. Channel: side.
    VerticalStroke = 13,
    /// Speed of a horizontal cylinder. Channel: side.
    HorizontalSpeed = 14,
    /// Speed of a vertical cylinder. Channel: side.
    VerticalSpeed = 15,
    /// Rack displacement.
    RackDisplacement = 16,
    /// Steering angle.
    SteerAngle = 17,
    /// Steering rate.
    SteerRate = 18,
    /// Steering torque.
    SteerTorque = 19,
    /// Step of the commanded force. Channel: side.
    CommandForceStep = 20,
    /// Step of the commanded height. Channel: side.
    CommandHeightStep = 21,
    /// A reading is out of its sensor's range. Channel: measurement channel.
    SensorRange = 30,
    /// A reading is frozen. Channel: measurement channel.
    SensorFrozen = 31,
    /// The force cells of a side disagree. Channel: side.
    ForceCellsDisagree = 32,
    /// Potentiometer and steering angle disagree.
    RackSensorsDisagree = 33,
    /// Energy fed into the steering in one steering cycle.
    EnergyPerCycle = 40,
    /// Energy fed into the steering in one second.
    EnergyPerSecond = 41,
    /// The ECU on the bus, which drives the unit's assist, is absent.
    EcuAbsent = 50,
    /// The ECU on the bus pushes against the driver.
    EcuAgainstDriver = 51,
}

impl TripCode {
    /// All codes.
    pub const ALL: [Self; 25] = [
        Self::EmergencyStop,
        Self::InterlockOpen,
        Self::StaleInputs,
        Self::HoldingTooLong,
        Self::RigStall,
        Self::TieRodForce,
        Self::ActuatorForce,
        Self::HorizontalStroke,
        Self::VerticalStroke,
        Self::HorizontalSpeed,
        Self::VerticalSpeed,
        Self::RackDisplacement,
        Self::SteerAngle,
        Self::SteerRate,
        Self::SteerTorque,
        Self::CommandForceStep,
        Self::CommandHeightStep,
        Self::SensorRange,
        Self::SensorFrozen,
        Self::ForceCellsDisagree,
        Self::RackSensorsDisagree,
        Self::EnergyPerCycle,
        Self::EnergyPerSecond,
        Self::EcuAbsent,
        Self::EcuAgainstDriver,
    ];

    /// The code of a number.
    pub fn from_number(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|code| *code as u8 == number)
    }

    /// Name and unit of limit and value, for messages.
    pub fn describe(self) -> (&'static str, &'static str) {
        match self {
            Self::EmergencyStop => ("emergency stop", ""),
            Self::InterlockOpen => ("interlock open", ""),
            Self::StaleInputs => ("inputs stale", "ticks"),
            Self::HoldingTooLong => ("holding too long", "s"),
            Self::RigStall => ("rig process stalled", "ticks"),
            Self::TieRodForce => ("tie-rod force", "N"),
            Self::ActuatorForce => ("actuator force", "N"),
            Self::HorizontalStroke => ("horizontal stroke", "m"),
            Self::VerticalStroke => ("vertical stroke", "m"),
            Self::HorizontalSpeed => ("horizontal speed", "m/s"),
            Self::VerticalSpeed => ("vertical speed", "m/s"),
            Self::RackDisplacement => ("rack displacement", "m"),
            Self::SteerAngle => ("steering angle", "rad"),
            Self::SteerRate => ("steering rate", "rad/s"),
            Self::SteerTorque => ("steering torque", "N·m"),
            Self::CommandForceStep => ("step of commanded force", "N"),
            Self::CommandHeightStep => ("step of commanded height", "m"),
            Self::SensorRange => ("sensor out of range", ""),
            Self::SensorFrozen => ("sensor frozen", "s"),
            Self::ForceCellsDisagree => ("force cells disagree", "N"),
            Self::RackSensorsDisagree => ("rack sensors disagree", "m"),
            Self::EnergyPerCycle => ("energy into the steering per cycle", "J"),
            Self::EnergyPerSecond => ("energy into the steering per second", "J"),
            Self::EcuAbsent => ("ECU on the bus absent", "s"),
            Self::EcuAgainstDriver => ("ECU pushes against the driver", "N·m"),
        }
    }
}

/// One trip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trip {
    /// Cause.
    pub code: TripCode,
    /// Side (0 left, 1 right) or measurement channel, where the code has one; else 0.
    pub channel: u8,
    /// Limit that was broken, in the code's unit.
    pub limit: f64,
    /// Value that broke it.
    pub value: f64,
    /// Tick of the step that saw it.
    pub tick: u64,
}
