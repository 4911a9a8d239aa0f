//! What crosses the suspension's edge each tick, with units and signs.
//!
//! Frames: B car body (x forward, y left, z up; origin midway between the wheel centres at design), K the
//! knuckle (origin at the wheel centre, axes those of B at design, then fixed to the knuckle). Rack + to
//! the left. Axial forces + in tension. Side 0 left, 1 right.

use spatial::Vector3;

use crate::failure::Reason;

/// What the suspension is given each tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuspensionInput {
    /// Rack displacement, + to the left. [m]
    pub rack_m: f64,
    /// Rack speed. [m/s]
    pub rack_speed_m_s: f64,
    /// Wheel-centre height minus its design height, relative to the body, + up (bump). [m]
    pub wheel_height_m: [f64; 2],
    /// Its rate. [m/s]
    pub wheel_speed_m_s: [f64; 2],
    /// Force of the wheel on the knuckle at the wheel centre, in K. [N]
    pub wheel_force_n: [Vector3<f64>; 2],
    /// Moment of the wheel on the knuckle about the wheel centre, in K. [N m]
    pub wheel_moment_n_m: [Vector3<f64>; 2],
}

/// Largest number of an input, in its SI unit: beyond it there is no axle, and products of such numbers overflow.
const INPUT_MAX: f64 = 1e12;

impl SuspensionInput {
    /// Rack centred, wheels at design height, at rest, no load.
    pub const DESIGN: Self = Self {
        rack_m: 0.0,
        rack_speed_m_s: 0.0,
        wheel_height_m: [0.0; 2],
        wheel_speed_m_s: [0.0; 2],
        wheel_force_n: [Vector3::new(0.0, 0.0, 0.0); 2],
        wheel_moment_n_m: [Vector3::new(0.0, 0.0, 0.0); 2],
    };

    /// Numbers in [`Self::to_array`].
    pub const LEN: usize = 18;

    /// As plain numbers, for checkpoints.
    #[must_use]
    pub fn to_array(self) -> [f64; Self::LEN] {
        let mut x = [0.0; Self::LEN];
        x[0] = self.rack_m;
        x[1] = self.rack_speed_m_s;
        x[2..4].copy_from_slice(&self.wheel_height_m);
        x[4..6].copy_from_slice(&self.wheel_speed_m_s);
        for side in 0..2 {
            x[6 + 3 * side..9 + 3 * side].copy_from_slice(self.wheel_force_n[side].as_slice());
            x[12 + 3 * side..15 + 3 * side].copy_from_slice(self.wheel_moment_n_m[side].as_slice());
        }
        x
    }

    /// From [`Self::to_array`].
    ///
    /// # Panics
    /// If there are fewer than [`Self::LEN`] numbers.
    #[must_use]
    pub fn from_array(x: &[f64]) -> Self {
        let vector = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
        Self {
            rack_m: x[0],
            rack_speed_m_s: x[1],
            wheel_height_m: [x[2], x[3]],
            wheel_speed_m_s: [x[4], x[5]],
            wheel_force_n: [vector(6), vector(9)],
            wheel_moment_n_m: [vector(12), vector(15)],
        }
    }

    /// Whether every number is finite, and so small that no sum of products of them overflows.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.to_array().iter().all(|x| x.abs() <= INPUT_MAX)
    }
}

/// Whether this tick's pose was solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Status {
    /// Solved.
    #[default]
    Converged,
    /// Not solved: everything is the last good tick's, at rest.
    Held {
        /// Why.
        reason: Reason,
        /// The constraint that is worst off, by its index in the kinematic mechanism.
        constraint: Option<usize>,
    },
}

impl Status {
    /// 0 converged, else the reason's number.
    #[must_use]
    pub fn code(self) -> u32 {
        match self {
            Self::Converged => 0,
            Self::Held { reason, .. } => reason as u32,
        }
    }

    /// The constraint's index, or −1.
    #[must_use]
    pub fn constraint_index(self) -> i32 {
        match self {
            Self::Held { constraint: Some(index), .. } => i32::try_from(index).unwrap_or(i32::MAX),
            _ => -1,
        }
    }
}

/// One side's results. All vectors in B.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SideOutput {
    /// Tie-rod axial force, + tension. [N]
    pub tie_rod_force_n: f64,
    /// Tie rod's outer ball. [m]
    pub tie_rod_ball_m: Vector3<f64>,
    /// Its velocity. [m/s]
    pub tie_rod_ball_velocity_m_s: Vector3<f64>,
    /// Wheel centre. [m]
    pub wheel_centre_m: Vector3<f64>,
    /// Knuckle's attitude, scalar first, first ≥ 0; takes vectors of K to B.
    pub knuckle_quaternion: [f64; 4],
    /// Knuckle's angular velocity. [rad/s]
    pub knuckle_angular_velocity_rad_s: Vector3<f64>,
    /// Wheel heading, + to the left: atan2(−s_x, s_y), s the wheel axis. [rad]
    pub steer_rad: f64,
    /// Toe, + in: left −steer, right +steer. [rad]
    pub toe_rad: f64,
    /// Camber, + top outward: left asin(−s_z), right asin(s_z). [rad]
    pub camber_rad: f64,
    /// Caster in the side view, + top rearward: atan2(−d_x, d_z), d from lower to upper joint. [rad]
    pub caster_rad: f64,
    /// Kingpin inclination in the front view, + top inboard: atan2(∓d_y, d_z). [rad]
    pub kingpin_inclination_rad: f64,
    /// Contact patch, fixed to the knuckle. [m]
    pub contact_patch_m: Vector3<f64>,
    /// The wheel's force on the knuckle. [N]
    pub wheel_force_n: Vector3<f64>,
    /// The wheel's moment on the knuckle about the wheel centre. [N m]
    pub wheel_moment_n_m: Vector3<f64>,
    /// Moment of the wheel's force and moment about the kingpin axis, along d (upwards). [N m]
    pub kingpin_moment_n_m: f64,
    /// Friction moment about the kingpin axis that was applied to the knuckle, along d. [N m]
    pub kingpin_friction_n_m: f64,
    /// Upper end of the kingpin axis: upper ball joint or strut top mount; for a virtual axis the point of
    /// the axis at the height of the wheel centre. [m]
    pub upper_joint_m: Vector3<f64>,
    /// Lower end of the kingpin axis: lower ball joint; for a virtual axis the point of the axis at the
    /// height of the contact patch. [m]
    pub lower_joint_m: Vector3<f64>,
    /// Force on the knuckle at the upper joint (strut: total force of the body on the strut; five-link: sum
    /// of both upper links). [N]
    pub upper_joint_force_n: Vector3<f64>,
    /// Force on the knuckle at the lower joint (five-link: sum of both lower links). [N]
    pub lower_joint_force_n: Vector3<f64>,
    /// Axial force of the locked spring and damper, + tension (negative when it carries the car). [N]
    pub spring_force_n: f64,
    /// Length of the spring (strut: from strut lower point to top mount). [m]
    pub spring_length_m: f64,
    /// Drop-link axial force, + tension; 0 without a stabiliser. [N]
    pub drop_link_force_n: f64,
    /// Displacement of each bushing's centre on the arm from its body point, in the order of
    /// [`config::axle::Geometry::body_points`]; 0 where the joint is rigid. [m]
    pub bushing_deflection_m: [Vector3<f64>; 4],
}

/// What the suspension gives each tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SuspensionOutput {
    /// Left and right.
    pub side: [SideOutput; 2],
    /// Force along +y that the rack drive must apply to the rack. [N]
    pub rack_force_n: f64,
    /// Rotation of each stabiliser half from design about the bar's axis (right to left). [rad]
    pub stabiliser_angle_rad: [f64; 2],
    /// Stabiliser torque, stiffness × (left − right angle). [N m]
    pub stabiliser_torque_n_m: f64,
    /// Whether this tick was solved.
    pub status: Status,
    /// Ticks held in a row up to now; 0 when solved.
    pub held_ticks: u64,
    /// Newton steps of this tick, all sub-steps together (on the structured path: of the slowest block).
    pub iterations: u32,
    /// Largest |Φ| left. [m or m² or -]
    pub residual: f64,
}
