//! What the safety monitor is given and what it gives, once a tick.

use crate::ecu::EcuWord;
use crate::state::BenchState;
use crate::trip::Trip;
use rig_control::{Fade, RigCommand};
use rig_plant::Measurement;

/// What the operator asks for at this tick. Requests that the state does not allow are ignored and reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum OperatorRequest {
    /// Nothing.
    #[default]
    None = 0,
    /// off → idle.
    SwitchOn = 1,
    /// idle → armed.
    Arm = 2,
    /// armed → starting.
    Start = 3,
    /// starting, running, holding, resuming → stopping; armed → idle.
    Stop = 4,
    /// tripped → idle, once the cause is gone.
    Acknowledge = 5,
    /// idle → off.
    SwitchOff = 6,
}

/// Everything a step judges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyInput {
    /// Tick of this step.
    pub tick: u64,
    /// What the operator asks for.
    pub request: OperatorRequest,
    /// Emergency stop pressed, or its circuit open.
    pub emergency_stop: bool,
    /// Interlock chain open.
    pub interlock_open: bool,
    /// The rig's own executed output phases without a fresh command; 0: this tick's command is fresh.
    pub inputs_stale_ticks: u32,
    /// Ticks the rig's own process just missed.
    pub missed_ticks: u32,
    /// Sensors.
    pub measurement: Measurement,
    /// Command of the simulation; the last one while stale.
    pub command: RigCommand,
    /// Energy that tracking errors fed into the steering in the last full cycle. [J]
    pub energy_cycle_j: f64,
    /// The same within the last second. [J]
    pub energy_second_j: f64,
    /// What the ECU on the bus asks for; `None` where none drives the unit's motor.
    pub ecu: Option<EcuWord>,
}

/// What a step decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafetyOutput {
    /// State from this tick on.
    pub state: BenchState,
    /// The latched trip, while tripped: the first cause.
    pub trip: Option<Trip>,
    /// Whether this step tripped.
    pub tripped_now: bool,
    /// Share of the command let through (also in `command.fade`).
    pub fade: Fade,
    /// The command for the controller: within all limits.
    pub command: RigCommand,
    /// Assist torque for the unit's motor, within limits and faded; `None` where no ECU on the bus drives it. [N·m]
    pub assist_request_n_m: Option<f64>,
    /// Bits of [`crate::clamp::flags`]: what was clamped in this tick.
    pub clamped: u64,
    /// A request that the state does not allow.
    pub request_refused: bool,
    /// Bits by [`rig_plant::Channel`]: readings not believed in this tick.
    pub sensor_faults: u64,
}
