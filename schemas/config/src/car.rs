//! The car: masses, suspension characteristics, tyres, driveline, brakes, aerodynamics.
//!
//! Axes ISO 8855: x forward, y left, z up. "Design" is the pose the hardpoint files are drawn in: each wheel's
//! travel is zero there. Quantities of a wheel are written for the left one and mirrored for the right one
//! (toe-in and top-outward camber positive on both sides). Springs, dampers, stops: force positive in
//! compression. Keys ending in `_file` name other data files; the loader resolves them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

mod check;
mod peer;

pub use peer::PeerModel;

/// A complete car.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Car {
    /// Name shown in logs and reports.
    pub name: String,
    /// Where the figures come from, and which of them are estimates.
    pub source: String,
    /// Sprung mass and where it sits.
    pub body: Body,
    /// Front axle.
    pub front: CarAxle,
    /// Rear axle.
    pub rear: CarAxle,
    /// Steering, used when no measured rack displacement replaces it.
    pub steering: SteeringSystem,
    /// What drives the wheels.
    pub powertrain: Powertrain,
    /// The functional model that takes the place of the powertrain's mechanics. With it, the powertrain's numbers are
    /// what transmission control and speed controller know of it; without it, they are also what is simulated.
    pub driveline: Option<DrivelineModel>,
    /// Brakes.
    pub brakes: Brakes,
    /// Aerodynamic forces.
    pub aerodynamics: Aerodynamics,
    /// The speed controller that holds a target speed.
    pub speed_control: SpeedControl,
    /// Where the accelerometer sits.
    pub accelerometer: Accelerometer,
    /// Integration.
    pub numerics: Numerics,
    /// Simplifications of another model to which this car is matched; a car of one's own has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub peer_model: Option<PeerModel>,
}

/// A driveline composed from functional models. What such a model must have is said in docs/MODELS.md.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrivelineModel {
    /// Model file: a path beside this file, or the bare name of a shipped one (`kingpin list models`).
    pub file: String,
    /// Parameters of the model that are replaced: full name and expression with unit, `"crank.J" = "0.2 kg*m^2"`.
    pub set: Option<BTreeMap<String, String>>,
    /// Axle it drives.
    pub driven: DrivenAxle,
}

/// Axle that a driveline model drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DrivenAxle {
    /// Front wheels.
    Front,
    /// Rear wheels.
    Rear,
}

/// The sprung mass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Sprung mass with load. [kg], [200, 10000]
    #[schemars(range(min = 200.0, max = 10000.0))]
    pub sprung_mass_kg: f64,
    /// Wheelbase at design. [m], [1, 6]
    #[schemars(range(min = 1.0, max = 6.0))]
    pub wheelbase_m: f64,
    /// Distance from the front axle back to the sprung centre of gravity. [m], (0, 6]
    #[schemars(range(max = 6.0), extend("exclusiveMinimum" = 0.0))]
    pub front_axle_to_sprung_cg_m: f64,
    /// Lateral position of the sprung centre of gravity, left positive. [m], [-0.3, 0.3]
    #[schemars(range(min = -0.3, max = 0.3))]
    pub sprung_cg_left_m: f64,
    /// Height of the sprung centre of gravity above the road at design. [m], [0.1, 3]
    #[schemars(range(min = 0.1, max = 3.0))]
    pub sprung_cg_height_m: f64,
    /// Roll inertia of the sprung mass about its centre of gravity. [kg m²], (0, 20000]
    #[schemars(range(max = 20000.0), extend("exclusiveMinimum" = 0.0))]
    pub roll_inertia_kg_m2: f64,
    /// Pitch inertia of the sprung mass about its centre of gravity. [kg m²], (0, 50000]
    #[schemars(range(max = 50000.0), extend("exclusiveMinimum" = 0.0))]
    pub pitch_inertia_kg_m2: f64,
    /// Yaw inertia of the sprung mass about its centre of gravity. [kg m²], (0, 50000]
    #[schemars(range(max = 50000.0), extend("exclusiveMinimum" = 0.0))]
    pub yaw_inertia_kg_m2: f64,
    /// Product of inertia ∫xz dm of the sprung mass. [kg m²], [-1000, 1000]
    #[schemars(range(min = -1000.0, max = 1000.0))]
    pub xz_product_kg_m2: f64,
}

/// One axle: wheels, tyres, kinematics, springs, compliance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CarAxle {
    /// Distance between the wheel centres at design. [m], [0.5, 3]
    #[schemars(range(min = 0.5, max = 3.0))]
    pub track_m: f64,
    /// Height of the wheel centres above the road at design (static loaded radius). [m], [0.15, 0.8]
    #[schemars(range(min = 0.15, max = 0.8))]
    pub wheel_centre_height_m: f64,
    /// Unsprung mass of one wheel station, wheel included. [kg], [5, 500]
    #[schemars(range(min = 5.0, max = 500.0))]
    pub unsprung_mass_kg: f64,
    /// Mass of one wheel with tyre. [kg], [2, 300]
    #[schemars(range(min = 2.0, max = 300.0))]
    pub wheel_mass_kg: f64,
    /// Spin inertia of one wheel with tyre, disc and shaft. [kg m²], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub wheel_spin_inertia_kg_m2: f64,
    /// Inertia of one wheel with tyre about a diameter. [kg m²], (0, 100]
    #[schemars(range(max = 100.0), extend("exclusiveMinimum" = 0.0))]
    pub wheel_diametral_inertia_kg_m2: f64,
    /// Tyre property file, for a left-hand tyre or either side; the right wheel carries its mirror image.
    pub tyre_file: String,
    /// Inflation pressure. [Pa], [50000, 1000000]
    #[schemars(range(min = 50000.0, max = 1000000.0))]
    pub tyre_pressure_pa: f64,
    /// Suspension hardpoint file from which the multibody solver makes this axle's kinematics maps.
    /// Exactly one of `axle_file` and `kinematics` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axle_file: Option<String>,
    /// Kinematics as constants, for a car whose hardpoints are unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kinematics: Option<IdealKinematics>,
    /// Main spring.
    pub spring: Spring,
    /// Damper.
    pub damper: Damper,
    /// Stop in bump.
    pub bump_stop: Stop,
    /// Stop in rebound.
    pub rebound_stop: Stop,
    /// Roll stiffness of the anti-roll bar at the axle, zero without a bar. [N·m/rad], [0, 500000]
    #[schemars(range(min = 0.0, max = 500000.0))]
    pub anti_roll_bar_n_m_rad: f64,
    /// Elastic deflections under tyre forces.
    pub compliance: Compliance,
}

/// Kinematics of one axle as constants (left side; the right one is its mirror image).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IdealKinematics {
    /// Toe-in at design. [rad], [-0.1, 0.1]
    #[schemars(range(min = -0.1, max = 0.1))]
    pub toe_in_rad: f64,
    /// Camber at design, top outward positive. [rad], [-0.2, 0.2]
    #[schemars(range(min = -0.2, max = 0.2))]
    pub camber_rad: f64,
    /// Toe-in gained per metre of bump travel. [rad/m], [-2, 2]
    #[schemars(range(min = -2.0, max = 2.0))]
    pub toe_in_per_travel_rad_m: f64,
    /// Camber (top outward) gained per metre of bump travel. [rad/m], [-3, 3]
    #[schemars(range(min = -3.0, max = 3.0))]
    pub camber_per_travel_rad_m: f64,
    /// Caster gained per metre of bump travel (top rearward). [rad/m], [-3, 3]
    #[schemars(range(min = -3.0, max = 3.0))]
    pub caster_per_travel_rad_m: f64,
    /// Height of the roll centre above the road at design. [m], [-0.5, 1]
    #[schemars(range(min = -0.5, max = 1.0))]
    pub roll_centre_height_m: f64,
    /// Outward motion of the wheel centre per square of bump travel (a rigid axle on track t rolling about a point on the
    /// road: -1/t). Absent: its path is straight. [1/m], [-10, 10]
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = -10.0, max = 10.0))]
    pub outward_per_travel2_1_m: Option<f64>,
    /// Forward motion of the wheel centre per metre of bump travel. [m/m], [-1, 1]
    #[schemars(range(min = -1.0, max = 1.0))]
    pub forward_per_travel: f64,
    /// Steer angle to the left per metre of rack displacement to the left; negative where the tie rod lies
    /// behind the wheel centre, zero on an unsteered axle. [rad/m], [-20, 20]
    #[schemars(range(min = -20.0, max = 20.0))]
    pub steer_per_rack_rad_m: f64,
    /// Share of the Ackermann steer difference, 0 parallel, 1 full. [-], [-1, 2]
    #[schemars(range(min = -1.0, max = 2.0))]
    pub ackermann: f64,
    /// Caster angle of the kingpin axis, top rearward. [rad], [-0.3, 0.5]
    #[schemars(range(min = -0.3, max = 0.5))]
    pub caster_rad: f64,
    /// Inclination of the kingpin axis, top inward. [rad], [-0.2, 0.5]
    #[schemars(range(min = -0.2, max = 0.5))]
    pub kingpin_inclination_rad: f64,
    /// Kingpin offset at the wheel centre: from the kingpin axis out to the wheel centre. [m], [-0.3, 0.3]
    #[schemars(range(min = -0.3, max = 0.3))]
    pub kingpin_offset_m: f64,
    /// Caster offset at the wheel centre: from the wheel centre forward to the kingpin axis. [m], [-0.2, 0.2]
    #[schemars(range(min = -0.2, max = 0.2))]
    pub caster_offset_m: f64,
}

/// How the spring's force at design is fixed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum DesignLoad {
    /// Preloaded so that the car stands in its design pose (zero travel at all wheels) on a level road.
    Balanced,
    /// A given force at design.
    Force {
        /// Spring force at design, at the spring. [N], [0, 200000]
        #[schemars(range(min = 0.0, max = 200000.0))]
        force_n: f64,
    },
}

/// Spring force over its own compression from design, straight lines between points, end slopes continued.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spring {
    /// Spring compression per wheel travel. [-], (0, 3]
    #[schemars(range(max = 3.0), extend("exclusiveMinimum" = 0.0))]
    pub lever_ratio: f64,
    /// The force in the design pose.
    pub design_load: DesignLoad,
    /// Compression from design, increasing. [m]
    pub compression_m: Vec<f64>,
    /// Force above the one at design (zero at zero compression). [N]
    pub force_n: Vec<f64>,
}

/// Damper force over its own speed, straight lines between points, end slopes continued.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Damper {
    /// Damper compression per wheel travel. [-], (0, 3]
    #[schemars(range(max = 3.0), extend("exclusiveMinimum" = 0.0))]
    pub lever_ratio: f64,
    /// Compression speed, increasing, bump positive. [m/s]
    pub speed_m_s: Vec<f64>,
    /// Force, positive in bump. [N]
    pub force_n: Vec<f64>,
}

/// A stop: no force up to `gap_m` of wheel travel, then stiffness·x + progression·x².
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    /// Wheel travel from design at which the stop touches. [m], [0, 1]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gap_m: f64,
    /// Stiffness at the wheel on touching. [N/m], [0, 2000000]
    #[schemars(range(min = 0.0, max = 2000000.0))]
    pub stiffness_n_m: f64,
    /// Progression at the wheel. [N/m²], [0, 1e9]
    #[schemars(range(min = 0.0, max = 1000000000.0))]
    pub progression_n_m2: f64,
}

/// Elastic deflections of one wheel under the forces and moment at its contact patch, linear, with a lag.
/// Written for the left wheel in ISO axes (steer and inclination as rotations about +z and +x); mirrored for
/// the right one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Compliance {
    /// Time constant with which deflection follows force. [s], [0.001, 0.1]
    #[schemars(range(min = 0.001, max = 0.1))]
    pub lag_s: f64,
    /// Steer to the left per forward force. [rad/N], [-1e-4, 1e-4]
    #[schemars(range(min = -0.0001, max = 0.0001))]
    pub steer_per_fx_rad_n: f64,
    /// Steer to the left per lateral force to the left. [rad/N], [-1e-4, 1e-4]
    #[schemars(range(min = -0.0001, max = 0.0001))]
    pub steer_per_fy_rad_n: f64,
    /// Steer to the left per aligning moment. [rad/(N·m)], [-1e-3, 1e-3]
    #[schemars(range(min = -0.001, max = 0.001))]
    pub steer_per_mz_rad_n_m: f64,
    /// Inclination (rotation about +x) per forward force. [rad/N], [-1e-4, 1e-4]
    #[schemars(range(min = -0.0001, max = 0.0001))]
    pub inclination_per_fx_rad_n: f64,
    /// Inclination (rotation about +x) per lateral force to the left. [rad/N], [-1e-4, 1e-4]
    #[schemars(range(min = -0.0001, max = 0.0001))]
    pub inclination_per_fy_rad_n: f64,
    /// Inclination (rotation about +x) per aligning moment. [rad/(N·m)], [-1e-3, 1e-3]
    #[schemars(range(min = -0.001, max = 0.001))]
    pub inclination_per_mz_rad_n_m: f64,
    /// Forward shift of the wheel centre per forward force. [m/N], [0, 1e-4]
    #[schemars(range(min = 0.0, max = 0.0001))]
    pub x_per_fx_m_n: f64,
    /// Shift of the wheel centre to the left per lateral force to the left. [m/N], [0, 1e-4]
    #[schemars(range(min = 0.0, max = 0.0001))]
    pub y_per_fy_m_n: f64,
}

/// The steering between steering wheel and rack, for runs without a steering unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum SteeringSystem {
    /// Rigid and without friction: the rack follows the steering wheel.
    Kinematic {
        /// Rack displacement to the left per steering-wheel angle to the left. [m/rad], [-0.1, 0.1], not 0
        #[schemars(range(min = -0.1, max = 0.1))]
        rack_per_steering_wheel_m_rad: f64,
        /// Largest rack displacement to either side. [m], (0, 0.3]
        #[schemars(range(max = 0.3), extend("exclusiveMinimum" = 0.0))]
        rack_travel_m: f64,
    },
    /// Column with torsion bar, rack with mass, friction and assist.
    Assisted(AssistedSteering),
}

/// Column, torsion bar, pinion and assisted rack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AssistedSteering {
    /// Pinion angle, increasing, left positive. [rad]
    pub pinion_rad: Vec<f64>,
    /// Rack displacement to the left at those angles, monotonic. [m]
    pub rack_m: Vec<f64>,
    /// Largest rack displacement to either side. [m], (0, 0.3]
    #[schemars(range(max = 0.3), extend("exclusiveMinimum" = 0.0))]
    pub rack_travel_m: f64,
    /// Rack mass with everything that moves with it (assist motor, pinion, wheels about their kingpins).
    /// [kg], [1, 5000]
    #[schemars(range(min = 1.0, max = 5000.0))]
    pub rack_mass_kg: f64,
    /// Viscous damping of the rack. [N·s/m], [0, 100000]
    #[schemars(range(min = 0.0, max = 100000.0))]
    pub rack_damping_n_s_m: f64,
    /// Coulomb friction of the rack. [N], [0, 2000]
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub rack_friction_n: f64,
    /// Torsion bar stiffness. [N·m/rad], [1, 10000]
    #[schemars(range(min = 1.0, max = 10000.0))]
    pub torsion_bar_n_m_rad: f64,
    /// Torsion bar damping. [N·m·s/rad], [0, 100]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub torsion_bar_damping_n_m_s_rad: f64,
    /// Torsion-bar torque at the points of the assist curve, from zero, increasing. [N·m]
    pub assist_torque_n_m: Vec<f64>,
    /// Speeds at which the assist curves are given, increasing. [m/s]
    pub assist_speed_m_s: Vec<f64>,
    /// Assist force on the rack: one row for each speed, one entry for each torque. [N]
    pub assist_force_n: Vec<Vec<f64>>,
}

/// What drives the wheels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Powertrain {
    /// Torque straight at the wheels in proportion to throttle: for cars whose driveline is unknown.
    WheelTorque {
        /// Largest sum of drive torques. [N·m], (0, 100000]
        #[schemars(range(max = 100000.0), extend("exclusiveMinimum" = 0.0))]
        max_torque_n_m: f64,
        /// Largest power. [W], (0, 5000000]
        #[schemars(range(max = 5000000.0), extend("exclusiveMinimum" = 0.0))]
        max_power_w: f64,
        /// Sum of wheel torques at closed throttle, as a drag. [N·m], [0, 10000]
        #[schemars(range(min = 0.0, max = 10000.0))]
        drag_torque_n_m: f64,
        /// Share of the front axle. [-], [0, 1]
        #[schemars(range(min = 0.0, max = 1.0))]
        front_share: f64,
    },
    /// Combustion engine, coupling, gearbox, differentials.
    Combustion(Box<Combustion>),
}

/// Engine to differentials.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Combustion {
    /// Engine.
    pub engine: Engine,
    /// Between engine and gearbox.
    pub coupling: Coupling,
    /// Gearbox.
    pub gearbox: Gearbox,
    /// Share of the gearbox torque that goes to the front axle: 0 rear, 1 front, between all-wheel drive.
    /// [-], [0, 1]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub front_share: f64,
    /// Largest torque of the lock between front and rear axle (all-wheel drive only). [N·m], [0, 10000]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub centre_lock_torque_n_m: f64,
    /// Front axle differential (unused with rear drive).
    pub front_differential: Differential,
    /// Rear axle differential (unused with front drive).
    pub rear_differential: Differential,
}

/// Engine torque over speed at both ends of the throttle; between them in proportion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Engine {
    /// Engine speed, increasing. [rpm]
    pub speed_rpm: Vec<f64>,
    /// Torque at full throttle. [N·m]
    pub full_throttle_n_m: Vec<f64>,
    /// Torque at closed throttle (negative: drag). [N·m]
    pub closed_throttle_n_m: Vec<f64>,
    /// Crank inertia with flywheel and pump. [kg m²], (0, 10]
    #[schemars(range(max = 10.0), extend("exclusiveMinimum" = 0.0))]
    pub inertia_kg_m2: f64,
    /// Speed held by the idle governor. [rpm], [300, 2000]
    #[schemars(range(min = 300.0, max = 2000.0))]
    pub idle_rpm: f64,
    /// Speed at which fuel is cut. [rpm], [1000, 20000]
    #[schemars(range(min = 1000.0, max = 20000.0))]
    pub limit_rpm: f64,
}

/// Between engine and gearbox.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum Coupling {
    /// Hydrodynamic converter with lock-up clutch.
    TorqueConverter {
        /// Turbine speed over pump speed, from 0, increasing. [-]
        speed_ratio: Vec<f64>,
        /// Turbine torque over pump torque. [-]
        torque_ratio: Vec<f64>,
        /// Pump torque over the square of pump speed. [N·m·s²/rad²]
        capacity_n_m_s2: Vec<f64>,
        /// Lowest gear in which the lock-up clutch closes; beyond the top gear: never. [-], [1, 20]
        #[schemars(range(min = 1, max = 20))]
        lock_up_gear: u32,
        /// Turbine speed above which the lock-up clutch closes. [rpm], [0, 10000]
        #[schemars(range(min = 0.0, max = 10000.0))]
        lock_up_rpm: f64,
        /// Torque capacity of the lock-up clutch. [N·m], [0, 5000]
        #[schemars(range(min = 0.0, max = 5000.0))]
        lock_up_torque_n_m: f64,
    },
    /// Dry clutch; opened by the automatic launch and shift control.
    Clutch {
        /// Torque capacity when closed. [N·m], (0, 5000]
        #[schemars(range(max = 5000.0), extend("exclusiveMinimum" = 0.0))]
        torque_n_m: f64,
        /// Engine speed at which the launch control has the clutch closed. [rpm], [300, 6000]
        #[schemars(range(min = 300.0, max = 6000.0))]
        launch_rpm: f64,
    },
}

/// Gearbox with its shift map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gearbox {
    /// Forward ratios, first gear first: input speed over output speed. [-]
    pub forward_ratios: Vec<f64>,
    /// Reverse ratio, as a positive number. [-], (0, 30]
    #[schemars(range(max = 30.0), extend("exclusiveMinimum" = 0.0))]
    pub reverse_ratio: f64,
    /// Share of the torque that arrives. [-], [0.5, 1]
    #[schemars(range(min = 0.5, max = 1.0))]
    pub efficiency: f64,
    /// Time a shift takes. [s], [0.01, 2]
    #[schemars(range(min = 0.01, max = 2.0))]
    pub shift_time_s: f64,
    /// Shortest time between two shifts. [s], [0.01, 10]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub shift_interval_s: f64,
    /// Throttle at the columns of the shift map, from 0 to 1, increasing. [-]
    pub shift_throttle: Vec<f64>,
    /// Gearbox input speed for an upshift: one row for each gear but the top. [rpm]
    pub upshift_rpm: Vec<Vec<f64>>,
    /// Gearbox input speed for a downshift: one row for each gear but the first. [rpm]
    pub downshift_rpm: Vec<Vec<f64>>,
}

/// An axle differential.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Differential {
    /// Ratio of the axle drive. [-], [0.5, 20]
    #[schemars(range(min = 0.5, max = 20.0))]
    pub ratio: f64,
    /// Constant friction torque between the outputs. [N·m], [0, 5000]
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub preload_n_m: f64,
    /// Friction torque between the outputs over the sum of their torques: 0 open. [-], [0, 1]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub locking_ratio: f64,
}

/// Brakes: master pressure to four wheel pressures with lag, to torques.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Brakes {
    /// Torque of one front brake per pressure. [N·m/Pa], [0, 0.01]
    #[schemars(range(min = 0.0, max = 0.01))]
    pub front_torque_per_pressure_n_m_pa: f64,
    /// Torque of one rear brake per pressure. [N·m/Pa], [0, 0.01]
    #[schemars(range(min = 0.0, max = 0.01))]
    pub rear_torque_per_pressure_n_m_pa: f64,
    /// Time constant of the wheel pressures. [s], [0.001, 1]
    #[schemars(range(min = 0.001, max = 1.0))]
    pub lag_s: f64,
    /// Largest master pressure. [Pa], [0, 5e7]
    #[schemars(range(min = 0.0, max = 50000000.0))]
    pub max_pressure_pa: f64,
    /// Master pressure above which the rear pressure rises less. [Pa], [0, 5e7]
    #[schemars(range(min = 0.0, max = 50000000.0))]
    pub rear_knee_pressure_pa: f64,
    /// Rise of rear over master pressure above the knee. [-], [0, 1]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub rear_slope_above_knee: f64,
    /// Torque of the hand brake at full pull, at each rear wheel. [N·m], [0, 10000]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub hand_brake_torque_n_m: f64,
}

/// Aerodynamic forces; areas and coefficients after SAE J1594, moments over the wheelbase.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Aerodynamics {
    /// Air density. [kg/m³], [0, 2]
    #[schemars(range(min = 0.0, max = 2.0))]
    pub air_density_kg_m3: f64,
    /// Frontal area. [m²], [0, 20]
    #[schemars(range(min = 0.0, max = 20.0))]
    pub frontal_area_m2: f64,
    /// Drag coefficient. [-], [0, 2]
    #[schemars(range(min = 0.0, max = 2.0))]
    pub drag: f64,
    /// Lift coefficient of the front axle, up positive. [-], [-3, 2]
    #[schemars(range(min = -3.0, max = 2.0))]
    pub front_lift: f64,
    /// Lift coefficient of the rear axle, up positive. [-], [-3, 2]
    #[schemars(range(min = -3.0, max = 2.0))]
    pub rear_lift: f64,
    /// Side force coefficient per angle of the air flow. [1/rad], [0, 5]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub side_per_rad: f64,
    /// Yaw moment coefficient per angle of the air flow, about mid-wheelbase; positive turns the nose away
    /// from the wind. [1/rad], [-2, 2]
    #[schemars(range(min = -2.0, max = 2.0))]
    pub yaw_per_rad: f64,
    /// Height above the road at which drag and side force act. [m], [0, 3]
    #[schemars(range(min = 0.0, max = 3.0))]
    pub height_m: f64,
}

/// The speed controller: acceleration demand from the speed error, held by throttle or brake.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpeedControl {
    /// Acceleration demand per speed error. [1/s], (0, 20]
    #[schemars(range(max = 20.0), extend("exclusiveMinimum" = 0.0))]
    pub proportional_1_s: f64,
    /// Rise of the demand per speed error and time. [1/s²], [0, 20]
    #[schemars(range(min = 0.0, max = 20.0))]
    pub integral_1_s2: f64,
    /// Largest demand in drive. [m/s²], (0, 20]
    #[schemars(range(max = 20.0), extend("exclusiveMinimum" = 0.0))]
    pub max_acceleration_m_s2: f64,
    /// Largest demand in braking; 0: throttle only. [m/s²], [0, 20]
    #[schemars(range(min = 0.0, max = 20.0))]
    pub max_deceleration_m_s2: f64,
}

/// Where the accelerometer sits in the body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Accelerometer {
    /// Distance behind the front axle. [m], [-3, 8]
    #[schemars(range(min = -3.0, max = 8.0))]
    pub behind_front_axle_m: f64,
    /// Distance left of the centre plane. [m], [-2, 2]
    #[schemars(range(min = -2.0, max = 2.0))]
    pub left_m: f64,
    /// Height above the road at design. [m], [0, 3]
    #[schemars(range(min = 0.0, max = 3.0))]
    pub height_m: f64,
}

/// Integration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Numerics {
    /// Sub-steps in one step. [-], [1, 20]
    #[schemars(range(min = 1, max = 20))]
    pub sub_steps: u32,
}
