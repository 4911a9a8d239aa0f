//! The body's own contact with the road, for a car that rolls over: eight corners of a box with springs, dampers and
//! Coulomb friction.
//!
//! The box follows from the car's own geometry, for want of body dimensions in the section: 0.8 m beyond the axles,
//! as wide as the wider track, from 0.12 m above the road to twice the height of the sprung centre of gravity. Spring:
//! the weight on one corner presses it in by 50 mm; damping 0.3 of critical; friction 0.6, regular below 0.2 m/s. Crude:
//! it keeps a rolled car above the road and brings it to rest, no more.

use config::car::Car;
use nalgebra::Vector3;

const OVERHANG_M: f64 = 0.8;
const CLEARANCE_M: f64 = 0.12;
const PRESSED_M: f64 = 0.05;
const FRICTION: f64 = 0.6;
const CREEP_M_S: f64 = 0.2;
/// A corner is not pressed in further than this, so that a bad start stays bounded. [m]
const DEPTH_MAX_M: f64 = 0.5;

/// The corners of the box.
#[derive(Debug, Clone, PartialEq)]
pub struct Hull {
    corners: [Vector3<f64>; 8],
    /// Largest distance of a corner from the sprung centre of gravity. [m]
    reach_m: f64,
    /// How far the lowest corner lies below the sprung centre of gravity in the design attitude. [m]
    below_m: f64,
    stiffness: f64,
    damping: f64,
}

impl Hull {
    /// Of a car of `mass_kg`.
    #[must_use]
    pub fn new(car: &Car, mass_kg: f64) -> Self {
        let b = &car.body;
        let half = 0.5 * car.front.track_m.max(car.rear.track_m);
        let x = [
            b.front_axle_to_sprung_cg_m + OVERHANG_M,
            b.front_axle_to_sprung_cg_m - b.wheelbase_m - OVERHANG_M,
        ];
        let z = [CLEARANCE_M - b.sprung_cg_height_m, b.sprung_cg_height_m];
        let corners =
            std::array::from_fn(|i| Vector3::new(x[i / 4], if i % 4 < 2 { half } else { -half }, z[i % 2]));
        let stiffness = mass_kg * crate::vehicle::GRAVITY_M_S2 / PRESSED_M;
        Self {
            reach_m: corners.iter().map(Vector3::norm).fold(0.0, f64::max),
            corners,
            below_m: -z[0],
            stiffness,
            damping: 0.6 * (stiffness * 0.25 * mass_kg).sqrt(),
        }
    }

    /// Force and moment about the sprung centre of gravity, body axes. `height_m` is that of the sprung centre of
    /// gravity above the road plane with normal `n`; `v`, `w`: velocities of the body.
    #[must_use]
    pub fn wrench(
        &self,
        n: &Vector3<f64>,
        height_m: f64,
        v: &Vector3<f64>,
        w: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        // Upright and above the floor, or too high: nothing to do.
        let tilt = (1.0 - n.z * n.z).max(0.0).sqrt();
        if height_m > self.reach_m || (n.z > 0.0 && height_m > self.below_m * n.z + self.reach_m * tilt) {
            return (force, moment);
        }
        for corner in &self.corners {
            let depth = -(height_m + corner.dot(n));
            if depth <= 0.0 {
                continue;
            }
            let speed = v + w.cross(corner);
            let up = speed.dot(n);
            let press =
                (self.stiffness * depth.min(DEPTH_MAX_M) - self.damping * up.clamp(-20.0, 20.0)).max(0.0);
            let sliding = speed - n * up;
            let drag = sliding * (-FRICTION * press / sliding.norm().max(CREEP_M_S));
            let f = n * press + drag;
            force += f;
            moment += corner.cross(&f);
        }
        (force, moment)
    }
}
