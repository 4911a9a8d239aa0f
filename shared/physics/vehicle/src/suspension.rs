//! Vertical suspension forces of one axle, and its elastic deflections.
//!
//! Spring, damper and stops act along wheel travel z (bump positive) through a constant lever ratio i:
//! force at the wheel F = i·f(i·z) by virtual work. The anti-roll bar acts on the difference of travels:
//! ±K (z_l − z_r)/t². All act between body and wheel station, so only on z in the equations of motion.

use crate::curve::Curve;
use config::car::{CarAxle, DesignLoad, Stop};

/// Elastic deflections of one wheel: steer, inclination [rad], x, y [m], ISO axes.
pub type Deflection = [f64; 4];

/// Characteristics of one axle's suspension.
#[derive(Debug, Clone, PartialEq)]
pub struct Suspension {
    spring: Curve,
    spring_ratio: f64,
    /// Force at the wheel at design. [N], left and right
    design_force_n: [f64; 2],
    damper: Curve,
    damper_ratio: f64,
    bump: Stop,
    rebound: Stop,
    bar_rate_n_m: f64,
    compliance: [[f64; 3]; 4],
    compliance_gain: f64,
}

/// Force of a stop pressed in by `depth_m`.
fn stop_force(stop: &Stop, depth_m: f64) -> f64 {
    if depth_m > 0.0 { depth_m * (stop.stiffness_n_m + stop.progression_n_m2 * depth_m) } else { 0.0 }
}

impl Suspension {
    /// For sub-steps of `step_s`; `balance_n` is the force at each wheel that holds the car in its design
    /// pose.
    #[must_use]
    pub fn new(a: &CarAxle, balance_n: [f64; 2], step_s: f64) -> Self {
        let c = &a.compliance;
        Self {
            spring: Curve::new(&a.spring.compression_m, &a.spring.force_n, 1.0, 1.0),
            spring_ratio: a.spring.lever_ratio,
            design_force_n: match a.spring.design_load {
                DesignLoad::Balanced => balance_n,
                DesignLoad::Force { force_n } => [force_n * a.spring.lever_ratio; 2],
            },
            damper: Curve::new(&a.damper.speed_m_s, &a.damper.force_n, 1.0, 1.0),
            damper_ratio: a.damper.lever_ratio,
            bump: a.bump_stop.clone(),
            rebound: a.rebound_stop.clone(),
            bar_rate_n_m: a.anti_roll_bar_n_m_rad / (a.track_m * a.track_m),
            compliance: [
                [c.steer_per_fx_rad_n, c.steer_per_fy_rad_n, c.steer_per_mz_rad_n_m],
                [c.inclination_per_fx_rad_n, c.inclination_per_fy_rad_n, c.inclination_per_mz_rad_n_m],
                [c.x_per_fx_m_n, 0.0, 0.0],
                [0.0, c.y_per_fy_m_n, 0.0],
            ],
            compliance_gain: 1.0 - (-step_s / c.lag_s).exp(),
        }
    }

    /// Force of spring and stops at the wheel on `side`, compression positive. [N]
    #[must_use]
    pub fn spring_n(&self, side: usize, travel_m: f64) -> f64 {
        self.design_force_n[side]
            + self.spring_ratio * self.spring.value(self.spring_ratio * travel_m)
            + stop_force(&self.bump, travel_m - self.bump.gap_m)
            - stop_force(&self.rebound, -travel_m - self.rebound.gap_m)
    }

    /// Force of the damper at the wheel, bump positive, and its slope. [N], [N·s/m]
    #[must_use]
    pub fn damper_n(&self, rate_m_s: f64) -> (f64, f64) {
        let (force, slope) = self.damper.value_and_slope(self.damper_ratio * rate_m_s);
        (self.damper_ratio * force, self.damper_ratio * self.damper_ratio * slope)
    }

    /// Force of the anti-roll bar on the left wheel, compression positive; the right one has the opposite.
    /// [N]
    #[must_use]
    pub fn bar_n(&self, travel_left_m: f64, travel_right_m: f64) -> f64 {
        self.bar_rate_n_m * (travel_left_m - travel_right_m)
    }

    /// One sub-step of the elastic deflections of the wheel on `side` under its contact forces.
    pub fn deflect(&self, side: usize, deflection: &mut Deflection, fx_n: f64, fy_n: f64, mz_n_m: f64) {
        // Mirror: on the right, y and rotations about x and z change sign, x keeps it.
        let m = if side == 0 { 1.0 } else { -1.0 };
        let load = [fx_n, m * fy_n, m * mz_n_m];
        for (row, d) in deflection.iter_mut().enumerate() {
            let c = &self.compliance[row];
            let target = c[0] * load[0] + c[1] * load[1] + c[2] * load[2];
            let target = if row == 2 { target } else { m * target };
            *d += (target - *d) * self.compliance_gain;
        }
    }
}
