//! Tie-rod force from the moment about the kingpin axis, without a multibody solver.
//!
//! Equilibrium of knuckle and wheel about the kingpin axis d_kp: the wheel's force and moment give
//! M_kp = ((r_w − r_kp) × F_w + ΣM)·d_kp, the rod's tension T pulls the outer ball along −d_tie, so
//! T = M_kp / (l_k t̂·d_tie) with l_k t̂ = d_kp × arm, d_tie from inner to outer ball.
//! - *Alignment map*: everything from one-dimensional maps, added ([`super::map`]).
//! - *Simplified geometry*: T = M_kp / d_arm with the arm l_k t̂·d_tie and the six conversion coefficients of
//!   M_kp frozen at design.
//! - *Alignment map as printed* in the source (eqs. 4.7–4.10): multiplies by the cosine t̂·d_tie where
//!   equilibrium divides. Wrong; kept to show by how much.
//!
//! Valid where what carries the car passes through the kingpin axis (spring on an arm, strut to its top
//! mount). A stabiliser on the knuckle does not: neither method knows of it, nor of kingpin friction.

use config::axle::Axle;
use spatial::Vector3;

use super::map::{AlignmentMaps, MapError, MappedSide};
use crate::suspension::SuspensionInput;

/// Shorter arms carry no force worth the name: a rod through the kingpin axis. [m]
const ARM_MIN_M: f64 = 1e-6;

/// The older methods' forces of one side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SideForces {
    /// Alignment map. [N], + tension
    pub map_n: f64,
    /// Alignment map as printed. [N], + tension
    pub map_thesis_n: f64,
    /// Simplified geometry. [N], + tension
    pub simple_n: f64,
    /// Moment about the kingpin axis by the maps, along the axis upwards. [N m]
    pub map_kingpin_moment_n_m: f64,
    /// The same by the constant coefficients. [N m]
    pub simple_kingpin_moment_n_m: f64,
}

/// The older methods' forces.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OlderForces {
    /// Left and right.
    pub side: [SideForces; 2],
    /// Force along +y that the rack drive must apply, by the alignment map. [N]
    pub map_rack_n: f64,
    /// The same by the printed form. [N]
    pub map_thesis_rack_n: f64,
    /// The same by simplified geometry. [N]
    pub simple_rack_n: f64,
}

/// Constants of the simplified geometry, one side.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Simple {
    /// Kingpin moment per wheel force in K. [m]
    per_force: Vector3<f64>,
    /// Kingpin moment per wheel moment in K. [-]
    per_moment: Vector3<f64>,
    /// [m]
    arm_m: f64,
    /// y component of the rod's direction, inner to outer ball.
    rod_y: f64,
}

/// Both older methods of an axle.
#[derive(Debug, Clone, PartialEq)]
pub struct OlderMethods {
    maps: AlignmentMaps,
    simple: [Simple; 2],
}

/// Direction of the rod and its lever: d_tie, d_kp × arm.
fn lever(side: &MappedSide) -> (Vector3<f64>, Vector3<f64>) {
    let rod = (side.tie_rod_ball_m - side.tie_rod_inner_m).normalize();
    (rod, side.kingpin_direction.cross(&(side.tie_rod_ball_m - side.kingpin_point_m)))
}

fn away_from_zero(arm_m: f64) -> f64 {
    if arm_m.abs() < ARM_MIN_M { ARM_MIN_M.copysign(arm_m) } else { arm_m }
}

impl OlderMethods {
    /// Sweeps the axle's maps and freezes the simplified geometry at design.
    ///
    /// # Errors
    /// As [`AlignmentMaps::new`].
    pub fn new(axle: &Axle) -> Result<Self, MapError> {
        let maps = AlignmentMaps::new(axle)?;
        let simple = [0, 1].map(|k| {
            let side = maps.at(k, 0.0, 0.0);
            let (rod, lever) = lever(&side);
            // (r × F)·d = (d × r)·F
            let d = side.kingpin_direction;
            Simple {
                per_force: side.attitude.tr_mul(&d.cross(&(side.wheel_centre_m - side.kingpin_point_m))),
                per_moment: side.attitude.tr_mul(&d),
                arm_m: away_from_zero(lever.dot(&rod)),
                rod_y: rod.y,
            }
        });
        Ok(Self { maps, simple })
    }

    /// The maps.
    #[must_use]
    pub fn maps(&self) -> &AlignmentMaps {
        &self.maps
    }

    /// Constant arm of the simplified geometry, left and right; negative behind the kingpin axis on the
    /// left. [m]
    #[must_use]
    pub fn simple_arm_m(&self) -> [f64; 2] {
        [self.simple[0].arm_m, self.simple[1].arm_m]
    }

    /// Forces at an input. Without allocation; a function of the input alone. Inputs are to be finite.
    #[must_use]
    pub fn evaluate(&self, input: &SuspensionInput) -> OlderForces {
        let mut forces = OlderForces::default();
        for k in 0..2 {
            let (force, moment) = (input.wheel_force_n[k], input.wheel_moment_n_m[k]);
            let side = self.maps.at(k, input.wheel_height_m[k], input.rack_m);
            let (rod, lever) = lever(&side);
            let about_point = (side.wheel_centre_m - side.kingpin_point_m).cross(&(side.attitude * force))
                + side.attitude * moment;
            let m_kp = about_point.dot(&side.kingpin_direction);
            let l_k = away_from_zero(lever.norm());
            let cosine = lever.dot(&rod) / l_k;
            let simple = &self.simple[k];
            let m_simple = simple.per_force.dot(&force) + simple.per_moment.dot(&moment);
            let out = &mut forces.side[k];
            out.map_kingpin_moment_n_m = m_kp;
            out.simple_kingpin_moment_n_m = m_simple;
            out.map_n = m_kp / away_from_zero(l_k * cosine);
            out.map_thesis_n = m_kp / l_k * cosine;
            out.simple_n = m_simple / simple.arm_m;
            forces.map_rack_n -= out.map_n * rod.y;
            forces.map_thesis_rack_n -= out.map_thesis_n * rod.y;
            forces.simple_rack_n -= out.simple_n * simple.rod_y;
        }
        forces
    }
}
