//! Aerodynamic force and moment on the body, coefficients after SAE J1594.
//!
//! In: air velocity relative to the body, body axes. Out: force [N] and moment [N·m] about the sprung centre
//! of gravity. Drag acts against the flow's forward part, side force and yaw moment in proportion to the
//! flow's angle (held at ±0.5 rad), lift at the axles. Valid for flow from ahead; from behind the drag turns
//! round and the lift stays.

use config::car::{Aerodynamics as AerodynamicsConfig, Body};
use nalgebra::Vector3;

/// Constants.
#[derive(Debug, Clone, PartialEq)]
pub struct Aerodynamics {
    half_density_area: f64,
    drag: f64,
    lift: [f64; 2],
    side: f64,
    yaw_arm: f64,
    /// Where drag and side force act, and the axles, relative to the sprung centre of gravity.
    height: f64,
    axle_x: [f64; 2],
}

impl Aerodynamics {
    /// For a body.
    #[must_use]
    pub fn new(a: &AerodynamicsConfig, b: &Body) -> Self {
        Self {
            half_density_area: 0.5 * a.air_density_kg_m3 * a.frontal_area_m2,
            drag: a.drag,
            lift: [a.front_lift, a.rear_lift],
            side: a.side_per_rad,
            yaw_arm: a.yaw_per_rad * b.wheelbase_m,
            height: a.height_m - b.sprung_cg_height_m,
            axle_x: [b.front_axle_to_sprung_cg_m, b.front_axle_to_sprung_cg_m - b.wheelbase_m],
        }
    }

    /// Force and moment for the body's velocity through the air, body axes. [m/s] → [N], [N·m]
    #[must_use]
    pub fn wrench(&self, through_air: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (vx, vy) = (through_air.x, through_air.y);
        let pressure = self.half_density_area * (vx * vx + vy * vy);
        if pressure == 0.0 {
            return (Vector3::zeros(), Vector3::zeros());
        }
        // Angle of the car's motion through the air, left positive.
        let angle = vy.atan2(vx.abs()).clamp(-0.5, 0.5);
        let drag = -self.half_density_area * self.drag * vx * vx.abs();
        let side = -pressure * self.side * angle;
        let lift = [pressure * self.lift[0], pressure * self.lift[1]];
        let yaw = pressure * self.yaw_arm * angle;
        let middle = 0.5 * (self.axle_x[0] + self.axle_x[1]);
        let force = Vector3::new(drag, side, lift[0] + lift[1]);
        let moment = Vector3::new(
            -self.height * side,
            self.height * drag - self.axle_x[0] * lift[0] - self.axle_x[1] * lift[1],
            middle * side - yaw,
        );
        (force, moment)
    }
}
