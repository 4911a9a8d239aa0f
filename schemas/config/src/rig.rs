//! The rig: linkage, actuators, sensors, transport, control, limits.
//!
//! Sides are mirror images; lateral numbers are "outboard" (left on the left side, right on the right).
//! `geometry` and `control` describe what the controller knows of the machine; `plant` is the virtual
//! machine itself, so that control can be tried on a machine that differs from what it was told.

use crate::unit::{LinearFriction, SteeringUnit};
use crate::{Broken, Check, Checker};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A five-axis steering rig: steer actuator, and a horizontal and a vertical cylinder on each side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// What this rig is, for logs and reports.
    pub name: String,
    /// Linkage between cylinders and tie rods.
    pub geometry: Geometry,
    /// The virtual machine.
    pub plant: Plant,
    /// Sensors of the virtual machine; their ranges hold for a real one too.
    pub sensors: Sensors,
    /// What the controller knows, and its tuning.
    pub control: Control,
    /// Limits of the safety monitor.
    pub limits: Limits,
}

/// Linkage of one side at rest (rack centred, strokes zero). Outboard and forward from the rack's centre.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Geometry {
    /// Inner tie-rod ball, outboard of the rack's centre. [m], (0, 2]
    #[schemars(range(max = 2.0), extend("exclusiveMinimum" = 0.0))]
    pub inner_ball_outboard_m: f64,
    /// Outer tie-rod ball: forward, outboard, up from the inner ball. [m]
    pub tie_rod_m: [f64; 3],
    /// Upper arm: column axis to outer ball; points forward at rest. [m], [0.05, 2]
    #[schemars(range(min = 0.05, max = 2.0))]
    pub upper_arm_m: f64,
    /// Lower arm: column axis to link; points outboard at rest. [m], [0.05, 2]
    #[schemars(range(min = 0.05, max = 2.0))]
    pub lower_arm_m: f64,
    /// Link between horizontal cylinder and lower arm. [m], [0.05, 5]
    #[schemars(range(min = 0.05, max = 5.0))]
    pub link_m: f64,
}

/// The virtual machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plant {
    /// Integration step. [s], [1e-6, 1e-4]
    #[schemars(range(min = 1e-6, max = 1e-4))]
    pub sub_step_s: f64,
    /// Transport delay from controller to valves. [s], [0, 0.02], whole sub-steps
    #[schemars(range(min = 0.0, max = 0.02))]
    pub command_delay_s: f64,
    /// Transport delay from sensors to controller. [s], [0, 0.02], whole sub-steps
    #[schemars(range(min = 0.0, max = 0.02))]
    pub measurement_delay_s: f64,
    /// Whether the machine goes from one command to the next in a straight line over a period, instead of in a step.
    /// Smoother, and half a period later.
    pub interpolate_commands: bool,
    /// Horizontal axis; `mass_kg` acts at the tip of the upper arm.
    pub horizontal: HydraulicAxis,
    /// Vertical axis; `mass_kg` is what it lifts.
    pub vertical: HydraulicAxis,
    /// Lateral stiffness of the leaf spring between upper arm and outer ball. [N/m], (0, 1e8]
    #[schemars(range(max = 1e8), extend("exclusiveMinimum" = 0.0))]
    pub leaf_spring_stiffness_n_m: f64,
    /// Axial stiffness of a tie rod with its joints and load cell. [N/m], (0, 1e9]
    #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
    pub tie_rod_stiffness_n_m: f64,
    /// Damping over stiffness of leaf spring and tie rod together. [s], [0, 0.1]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub tie_rod_damping_time_s: f64,
    /// Steer actuator.
    pub steer: SteerAxis,
}

/// A cylinder with its servo-valve; symmetric cylinder, load-pressure form [Merritt 1967, ch. 6].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HydraulicAxis {
    /// Piston area. [m²], (0, 0.1]
    #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
    pub piston_area_m2: f64,
    /// Stroke to each side. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub stroke_m: f64,
    /// Oil beyond the stroke in each chamber, as length of cylinder. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub dead_length_m: f64,
    /// Supply pressure. [Pa], (0, 5e7]
    #[schemars(range(max = 5e7), extend("exclusiveMinimum" = 0.0))]
    pub supply_pressure_pa: f64,
    /// Flow at full opening and rated drop. [m³/s], (0, 0.1]
    #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
    pub rated_flow_m3_s: f64,
    /// Pressure drop over the whole valve at rated flow. [Pa], (0, 5e7]
    #[schemars(range(max = 5e7), extend("exclusiveMinimum" = 0.0))]
    pub rated_drop_pa: f64,
    /// Natural frequency of the valve. [Hz], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub valve_frequency_hz: f64,
    /// Damping ratio of the valve. [-], (0, 5]
    #[schemars(range(max = 5.0), extend("exclusiveMinimum" = 0.0))]
    pub valve_damping_ratio: f64,
    /// Bulk modulus of the oil. [Pa], [1e8, 3e9]
    #[schemars(range(min = 1e8, max = 3e9))]
    pub bulk_modulus_pa: f64,
    /// Leakage between the chambers. [m³/(s·Pa)], [0, 1e-9]
    #[schemars(range(min = 0.0, max = 1e-9))]
    pub leakage_m3_s_pa: f64,
    /// Friction of the cylinder.
    pub friction: LinearFriction,
    /// Moving mass. [kg], (0, 2000]
    #[schemars(range(max = 2000.0), extend("exclusiveMinimum" = 0.0))]
    pub mass_kg: f64,
    /// Stiffness of the end stops, at the piston. [N/m], (0, 1e8]
    #[schemars(range(max = 1e8), extend("exclusiveMinimum" = 0.0))]
    pub stop_stiffness_n_m: f64,
    /// Damping of the end stops. [N·s/m], [0, 1e6]
    #[schemars(range(min = 0.0, max = 1e6))]
    pub stop_damping_n_s_m: f64,
}

/// What turns the column.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SteerDevice {
    /// A rotary actuator in place of the hand wheel: angle or torque mode.
    Actuator,
    /// A measuring hand wheel turned by a human; the actuator is taken off.
    MeasuringWheel,
}

/// Steer axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SteerAxis {
    /// What turns the column.
    pub device: SteerDevice,
    /// Inertia of the actuator and its fixture, on the motor's side of the torque cell. [kg·m²], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub inertia_kg_m2: f64,
    /// Largest torque. [N·m], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub torque_limit_n_m: f64,
    /// Largest speed: the actuator gives no torque beyond it. [rad/s], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub speed_limit_rad_s: f64,
    /// Bandwidth of the torque. [Hz], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub torque_bandwidth_hz: f64,
}

/// Makes a section for the sensors of one unit; the errors relative to full scale have none.
macro_rules! sensor_section {
    ($(#[$doc:meta])* $name:ident, $unit:literal, $range:ident, $noise:ident) => {
        $(#[$doc])*
        /// Non-linearity, hysteresis, gain and offset are drawn once a run; noise once a sample.
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            #[doc = concat!("Largest magnitude it converts, to 16 bits; the full scale of the errors. [", $unit, "], (0, 1e6]")]
            #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
            pub $range: f64,
            /// Largest non-linearity over full scale. [-], [0, 0.1]
            #[schemars(range(min = 0.0, max = 0.1))]
            pub nonlinearity_ratio: f64,
            /// Largest hysteresis over full scale. [-], [0, 0.1]
            #[schemars(range(min = 0.0, max = 0.1))]
            pub hysteresis_ratio: f64,
            /// Largest offset from run to run over full scale. [-], [0, 0.1]
            #[schemars(range(min = 0.0, max = 0.1))]
            pub repeatability_ratio: f64,
            /// Largest error that a tare removes, over full scale. [-], [0, 0.2]
            #[schemars(range(min = 0.0, max = 0.2))]
            pub zero_balance_ratio: f64,
            /// Largest error over reading. [-], [0, 0.1]
            #[schemars(range(min = 0.0, max = 0.1))]
            pub gain_error_ratio: f64,
            #[doc = concat!("Standard deviation of the noise of a sample. [", $unit, "], [0, 1e5]")]
            #[schemars(range(min = 0.0, max = 1e5))]
            pub $noise: f64,
        }

        impl From<&$name> for Sensor {
            fn from(s: &$name) -> Self {
                Self {
                    range: s.$range,
                    nonlinearity: s.nonlinearity_ratio,
                    hysteresis: s.hysteresis_ratio,
                    repeatability: s.repeatability_ratio,
                    zero_balance: s.zero_balance_ratio,
                    gain: s.gain_error_ratio,
                    noise: s.$noise,
                }
            }
        }
    };
}

sensor_section!(
    /// Errors of a force cell.
    ForceSensor, "N", range_n, noise_n
);
sensor_section!(
    /// Errors of a displacement sensor.
    LengthSensor, "m", range_m, noise_m
);
sensor_section!(
    /// Errors of a torque cell.
    TorqueSensor, "N·m", range_n_m, noise_n_m
);

/// A sensor of any unit, as the sensor model takes it. Ratios are over full scale, `gain` over the reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensor {
    /// Full scale.
    pub range: f64,
    /// Largest non-linearity. [-]
    pub nonlinearity: f64,
    /// Largest hysteresis. [-]
    pub hysteresis: f64,
    /// Largest offset from run to run. [-]
    pub repeatability: f64,
    /// Largest error that a tare removes. [-]
    pub zero_balance: f64,
    /// Largest error over the reading. [-]
    pub gain: f64,
    /// Standard deviation of a sample's noise.
    pub noise: f64,
}

/// Sensors. Forces [N], lengths [m], torques [N·m].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sensors {
    /// Whether cells and potentiometers are tared, unloaded and centred, before the run.
    pub tare_at_start: bool,
    /// Load cell in each tie rod. [N]
    pub tie_rod_force: ForceSensor,
    /// Load cell on each horizontal cylinder. [N]
    pub actuator_force: ForceSensor,
    /// Stroke of each horizontal cylinder. [m]
    pub horizontal_stroke: LengthSensor,
    /// Stroke of each vertical cylinder. [m]
    pub vertical_stroke: LengthSensor,
    /// String potentiometer at the rack. [m]
    pub rack_displacement: LengthSensor,
    /// Torque cell of the steer axis: error is the larger of `gain_error_ratio` of reading and
    /// `nonlinearity_ratio` of full scale. [N·m]
    pub steering_torque: TorqueSensor,
    /// Torque sensor of the unit's ECU. [N·m]
    pub torsion_bar_torque: TorqueSensor,
    /// Resolution of the steering-angle encoder. [rad], (0, 0.1]; 0.005° = 8.727e-5 rad
    #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
    pub encoder_resolution_rad: f64,
    /// Largest error of the encoder, once a turn. [rad], [0, 0.1]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub encoder_error_rad: f64,
}

/// What the controller believes of the machine, and its tuning.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Control {
    /// Compensations that are on at the start.
    pub switches: Switches,
    /// Axial stiffness between arm and rack (leaf spring and tie rod in series). [N/m], (0, 1e9]
    #[schemars(range(max = 1e9), extend("exclusiveMinimum" = 0.0))]
    pub tie_rod_stiffness_n_m: f64,
    /// Transport delay from controller to valve; the output phase comes on top by itself. [s], [0, 0.05]
    #[schemars(range(min = 0.0, max = 0.05))]
    pub command_delay_s: f64,
    /// Delay from sensor to controller. [s], [0, 0.05]
    #[schemars(range(min = 0.0, max = 0.05))]
    pub measurement_delay_s: f64,
    /// Below this frequency the rack displacement for the models comes from the potentiometer, above it from the
    /// pinion's angle (encoder and torsion bar). [rad/s], (0, 100000]; the largest: potentiometer alone
    #[schemars(range(max = 100000.0), extend("exclusiveMinimum" = 0.0))]
    pub rack_crossover_rad_s: f64,
    /// Horizontal axis.
    pub horizontal: AxisModel,
    /// Vertical axis.
    pub vertical: AxisModel,
    /// Force loop.
    pub force: ForceLoop,
    /// Height loop.
    pub height: HeightLoop,
    /// Steer loop.
    pub steer: SteerLoop,
}

/// Compensations that can be switched one by one, also while running.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Switches {
    /// Actuator force, stroke and tie-rod directions by the linkage's geometry; off: fixed ratios at rest.
    pub force_conversion: bool,
    /// Stroke that the steering angle will make the rack travel.
    pub rack_feed_forward: bool,
    /// Force that accelerates arm and column.
    pub inertia_feed_forward: bool,
    /// Prediction over actuator lag and transport delays.
    pub delay_compensation: bool,
    /// Rate of the commanded force, fed forward.
    pub force_rate_feed_forward: bool,
    /// Valve opening corrected by load pressure.
    pub pressure_compensation: bool,
    /// Valve gain learnt from the measured stroke.
    pub gain_adaptation: bool,
}

/// What the controller believes of a hydraulic axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisModel {
    /// Speed without load at full opening. [m/s], (0, 10]
    #[schemars(range(max = 10.0), extend("exclusiveMinimum" = 0.0))]
    pub no_load_speed_m_s: f64,
    /// Force at which it stalls. [N], (0, 1e6]
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub stall_force_n: f64,
    /// Natural frequency of the valve. [Hz], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub valve_frequency_hz: f64,
    /// Damping ratio of the valve. [-], (0, 5]
    #[schemars(range(max = 5.0), extend("exclusiveMinimum" = 0.0))]
    pub valve_damping_ratio: f64,
    /// Natural frequency that the lead compensation gives the valve instead. [Hz], (0, 1000], at least the valve's own
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub lead_frequency_hz: f64,
    /// Moving mass (horizontal: at the tip of the upper arm). [kg], [0, 2000]
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub mass_kg: f64,
    /// Largest rate of the valve command; 1 is full opening. [1/s], (0, 100000]
    #[schemars(range(max = 100000.0), extend("exclusiveMinimum" = 0.0))]
    pub valve_rate_limit_1_s: f64,
}

/// Tuning of the force loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceLoop {
    /// Closed-loop bandwidth. [rad/s], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub bandwidth_rad_s: f64,
    /// Rate of the integral part (delay compensation off). [rad/s], [0, 200]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub integral_rad_s: f64,
    /// Rate at which unexplained motion is observed. [rad/s], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub observer_rad_s: f64,
    /// Time constant of the derivative part (delay compensation off). [s], [0, 0.05]
    #[schemars(range(min = 0.0, max = 0.05))]
    pub derivative_s: f64,
    /// Bandwidth of the tracker that gives the commanded force's rate. [rad/s], (0, 2000]
    #[schemars(range(max = 2000.0), extend("exclusiveMinimum" = 0.0))]
    pub command_tracker_rad_s: f64,
    /// Bandwidth of the rack-motion observer. [rad/s], (0, 500]
    #[schemars(range(max = 500.0), extend("exclusiveMinimum" = 0.0))]
    pub rack_observer_rad_s: f64,
    /// Above this frequency the force comes from the actuator's cell, below it from the tie rod's. [rad/s], (0, 100000]
    #[schemars(range(max = 100000.0), extend("exclusiveMinimum" = 0.0))]
    pub cell_crossover_rad_s: f64,
}

/// Tuning of the height loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeightLoop {
    /// Closed-loop bandwidth. [rad/s], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub bandwidth_rad_s: f64,
    /// Rate of the integral part. [rad/s], [0, 200]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub integral_rad_s: f64,
}

/// Tuning of the steer loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SteerLoop {
    /// Closed-loop bandwidth in angle mode. [rad/s], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub bandwidth_rad_s: f64,
    /// Damping ratio in angle mode. [-], [0.3, 3]
    #[schemars(range(min = 0.3, max = 3.0))]
    pub damping_ratio: f64,
    /// Rate of the integral part. [rad/s], [0, 200]
    #[schemars(range(min = 0.0, max = 200.0))]
    pub integral_rad_s: f64,
    /// Bandwidth with which the measured load torque is fed forward. [rad/s], [0, 2000]
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub load_torque_rad_s: f64,
    /// Gain on torque error in torque mode. [-], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub torque_gain: f64,
    /// Damping of the hub in torque mode. [N·m·s/rad], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub torque_damping_n_m_s_rad: f64,
    /// Lag of the actuator's torque. [s], [0, 0.1]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub torque_lag_s: f64,
}

/// Limits of the safety monitor. A command beyond a `command_*` limit is clamped and reported; a
/// measurement beyond a limit trips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Commanded tie-rod force, magnitude. [N], (0, 1e5]
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub command_force_n: f64,
    /// Commanded rate of tie-rod force; faster is slowed. [N/s], (0, 1e7]
    #[schemars(range(max = 1e7), extend("exclusiveMinimum" = 0.0))]
    pub command_force_rate_n_s: f64,
    /// Step of the commanded tie-rod force in one tick that trips. [N], (0, 1e5]
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub command_force_step_n: f64,
    /// Commanded ball height, magnitude. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub command_height_m: f64,
    /// Commanded speed of ball height; faster is slowed. [m/s], (0, 10]
    #[schemars(range(max = 10.0), extend("exclusiveMinimum" = 0.0))]
    pub command_height_speed_m_s: f64,
    /// Step of the commanded ball height in one tick that trips. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub command_height_step_m: f64,
    /// Commanded steering angle, magnitude. [rad], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub command_steer_angle_rad: f64,
    /// Commanded steering rate; faster is slowed. [rad/s], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub command_steer_rate_rad_s: f64,
    /// Commanded steering torque and actuator torque, magnitude. [N·m], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub command_steer_torque_n_m: f64,
    /// Valve opening, magnitude. [-], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub command_valve: f64,
    /// Measured tie-rod force. [N], (0, 1e5]
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub tie_rod_force_n: f64,
    /// Measured force of a horizontal cylinder. [N], (0, 1e6]
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub actuator_force_n: f64,
    /// Stroke of a horizontal cylinder. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub horizontal_stroke_m: f64,
    /// Stroke of a vertical cylinder. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub vertical_stroke_m: f64,
    /// Speed of a horizontal cylinder, over `speed_window_s`. [m/s], (0, 10]
    #[schemars(range(max = 10.0), extend("exclusiveMinimum" = 0.0))]
    pub horizontal_speed_m_s: f64,
    /// Speed of a vertical cylinder, over `speed_window_s`. [m/s], (0, 10]
    #[schemars(range(max = 10.0), extend("exclusiveMinimum" = 0.0))]
    pub vertical_speed_m_s: f64,
    /// Window over which speeds and rates are measured. [s], (0, 0.1]
    #[schemars(range(max = 0.1), extend("exclusiveMinimum" = 0.0))]
    pub speed_window_s: f64,
    /// Rack displacement. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub rack_displacement_m: f64,
    /// Steering angle. [rad], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub steer_angle_rad: f64,
    /// Steering rate, over `speed_window_s`. [rad/s], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub steer_rate_rad_s: f64,
    /// Steering torque. [N·m], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub steer_torque_n_m: f64,
    /// Age of inputs from which on they count as stale, for the rig and for the models. [ticks], [1, 1000]
    #[schemars(range(min = 1, max = 1000))]
    pub stale_ticks: u32,
    /// The rig's own missed ticks that trip. [ticks], [1, 10000]
    #[schemars(range(min = 1, max = 10000))]
    pub stall_ticks: u32,
    /// Longest holding before it trips. [s], (0, 60]
    #[schemars(range(max = 60.0), extend("exclusiveMinimum" = 0.0))]
    pub holding_max_s: f64,
    /// Fresh ticks that end holding. [ticks], [1, 10000]
    #[schemars(range(min = 1, max = 10000))]
    pub resume_fresh_ticks: u32,
    /// Fade from measured to commanded when resuming. [s], [0.01, 60]
    #[schemars(range(min = 0.01, max = 60.0))]
    pub resume_fade_s: f64,
    /// Soft start. [s], [0.01, 60]
    #[schemars(range(min = 0.01, max = 60.0))]
    pub start_fade_s: f64,
    /// Soft stop by the operator. [s], [0.01, 60]
    #[schemars(range(min = 0.01, max = 60.0))]
    pub stop_fade_s: f64,
    /// Ramp of the axial force to zero in the safe state. [s], [0.001, 10]
    #[schemars(range(min = 0.001, max = 10.0))]
    pub safe_ramp_s: f64,
    /// Difference between the two force cells of a side (after conversion). [N], (0, 1e5]
    #[schemars(range(max = 1e5), extend("exclusiveMinimum" = 0.0))]
    pub force_disagreement_n: f64,
    /// Difference between rack potentiometer and steering angle times ratio. [m], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub rack_disagreement_m: f64,
    /// How long two sensors must disagree. [s], [0, 10]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub disagreement_s: f64,
    /// How long a reading may keep exactly one value while its noise should move it. [s], (0, 60]
    #[schemars(range(max = 60.0), extend("exclusiveMinimum" = 0.0))]
    pub frozen_s: f64,
    /// Energy that tracking errors may feed into the steering in one steering cycle. [J], (0, 1e6]
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub energy_per_cycle_j: f64,
    /// The same within one second. [J], (0, 1e6]
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub energy_per_second_j: f64,
    /// Assist torque at the pinion that an ECU on the bus may ask of the unit's motor, magnitude; more is cut.
    /// [N·m], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub ecu_assist_torque_n_m: f64,
    /// Its rate; faster is slowed. [N·m/s], (0, 1e6]
    #[schemars(range(max = 1e6), extend("exclusiveMinimum" = 0.0))]
    pub ecu_assist_rate_n_m_s: f64,
    /// Age of what the ECU said from which on it counts as absent. [s], (0, 1]
    #[schemars(range(max = 1.0), extend("exclusiveMinimum" = 0.0))]
    pub ecu_stale_s: f64,
    /// How long the ECU may be absent. [s], (0, 60]
    #[schemars(range(max = 60.0), extend("exclusiveMinimum" = 0.0))]
    pub ecu_absent_max_s: f64,
    /// Assist torque against the driver that trips when it lasts longer than `disagreement_s`. [N·m], (0, 1000]
    #[schemars(range(max = 1000.0), extend("exclusiveMinimum" = 0.0))]
    pub ecu_against_n_m: f64,
}

fn whole(value: f64, step: f64) -> bool {
    let steps = value / step;
    (steps - steps.round()).abs() < 1e-6
}

/// Checks a rig with its steering unit and the period they are stepped with. [s], [1e-4, 1e-2]
///
/// # Errors
/// Every broken rule.
pub fn check_rig(rig: &Rig, unit: &SteeringUnit, period_s: f64) -> Result<(), Vec<Broken>> {
    let mut checker = Checker::default();
    rig.check(&mut checker);
    unit.check(&mut checker);
    let range = (1e-4..=1e-2).contains(&period_s);
    checker.require(range, "period_s", "must be between 0.0001 s and 0.01 s");
    let broken = checker.into_found();
    if broken.is_empty() { Ok(()) } else { Err(broken) }
}

impl Check for Rig {
    fn check(&self, c: &mut Checker) {
        c.within("geometry", |c| self.geometry.check(c));
        c.within("plant", |c| {
            let step = self.plant.sub_step_s;
            for (key, value) in [
                ("command_delay_s", self.plant.command_delay_s),
                ("measurement_delay_s", self.plant.measurement_delay_s),
            ] {
                c.require(
                    whole(value, step),
                    key,
                    format!("must be a whole number of sub_step_s = {step} s"),
                );
            }
            for (key, axis, stroke_limit) in [
                ("horizontal", &self.plant.horizontal, self.limits.horizontal_stroke_m),
                ("vertical", &self.plant.vertical, self.limits.vertical_stroke_m),
            ] {
                c.within(key, |c| {
                    c.require(
                        stroke_limit <= axis.stroke_m,
                        "stroke_m",
                        format!("must reach limits.{key}_stroke_m = {stroke_limit} m"),
                    );
                });
            }
            let lower = self.geometry.lower_arm_m;
            c.require(
                self.plant.horizontal.stroke_m <= 0.8 * lower,
                "horizontal.stroke_m",
                format!(
                    "must stay within 0.8 of geometry.lower_arm_m = {lower} m (the linkage locks beyond)"
                ),
            );
        });
        c.within("control", |c| {
            for (key, axis) in
                [("horizontal", &self.control.horizontal), ("vertical", &self.control.vertical)]
            {
                c.require(
                    axis.lead_frequency_hz >= axis.valve_frequency_hz,
                    &format!("{key}.lead_frequency_hz"),
                    format!("must be at least valve_frequency_hz = {} Hz", axis.valve_frequency_hz),
                );
            }
        });
        c.within("limits", |c| {
            let (l, s) = (&self.limits, &self.sensors);
            let mut below = |lower: f64, key: &str, upper: f64, than: &str| {
                c.require(lower <= upper, key, format!("must not exceed {than} = {upper}"));
            };
            below(l.command_force_n, "command_force_n", l.tie_rod_force_n, "tie_rod_force_n");
            below(
                l.tie_rod_force_n,
                "tie_rod_force_n",
                s.tie_rod_force.range_n,
                "sensors.tie_rod_force.range_n",
            );
            let actuator = s.actuator_force.range_n;
            below(l.actuator_force_n, "actuator_force_n", actuator, "sensors.actuator_force.range_n_n");
            below(l.command_height_m, "command_height_m", l.vertical_stroke_m, "vertical_stroke_m");
            below(l.command_steer_angle_rad, "command_steer_angle_rad", l.steer_angle_rad, "steer_angle_rad");
            below(
                l.command_steer_rate_rad_s,
                "command_steer_rate_rad_s",
                l.steer_rate_rad_s,
                "steer_rate_rad_s",
            );
            let torque = self.plant.steer.torque_limit_n_m;
            let torque_key = "plant.steer.torque_limit_n_m";
            below(l.command_steer_torque_n_m, "command_steer_torque_n_m", torque, torque_key);
            let step = l.command_force_step_n;
            below(step, "command_force_step_n", 2.0 * l.command_force_n, "twice command_force_n");
        });
    }
}

impl Check for Geometry {
    fn check(&self, c: &mut Checker) {
        let [forward, outboard, up] = self.tie_rod_m;
        let length = (forward * forward + outboard * outboard + up * up).sqrt();
        c.require(
            outboard > 0.0 && length <= 2.0 && outboard >= 0.5 * length,
            "tie_rod_m",
            "must point outboard (outboard part at least half of its length) and be at most 2 m long",
        );
        c.require(
            self.link_m > 0.5 * self.lower_arm_m,
            "link_m",
            format!("must be longer than half of lower_arm_m = {} m", self.lower_arm_m),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shipped() -> Rig {
        toml::from_str(include_str!("../../rigs/virtual.toml")).unwrap()
    }

    #[test]
    fn shipped_rig_parses_and_holds_its_rules() {
        assert_eq!(shipped().broken(), []);
    }

    #[test]
    fn shipped_rig_is_the_machine_of_the_specification() {
        let axis = shipped().plant.horizontal;
        let speed =
            |drop: f64| axis.rated_flow_m3_s * (drop / axis.rated_drop_pa).sqrt() / axis.piston_area_m2;
        assert!((speed(21e6) - 0.55).abs() < 0.005, "no-load top speed");
        assert!((speed(7e6) - 0.32).abs() < 0.005, "speed at the rated drop");
        assert!((axis.piston_area_m2 * axis.supply_pressure_pa - 42e3).abs() < 1.0, "stall force");
    }

    #[test]
    fn rules_across_sections_are_reported_at_once() {
        let mut rig = shipped();
        rig.plant.command_delay_s = 0.00105;
        rig.limits.command_force_n = 12000.0;
        rig.limits.vertical_stroke_m = 0.2;
        rig.geometry.tie_rod_m = [0.3, 0.1, 0.0];
        let keys: Vec<String> = rig.broken().into_iter().map(|b| b.key).collect();
        let expected = [
            "geometry.tie_rod_m",
            "plant.command_delay_s",
            "plant.vertical.stroke_m",
            "limits.command_force_n",
        ];
        assert_eq!(keys, expected);
    }
}
