//! Speed controller: PI from speed error to acceleration demand, met by throttle, below that by the brakes.
//!
//! a = k_p e + ∫ k_i e dt, limited; the integral stands still while the demand is limited (anti-windup).
//! The demand becomes a sum of wheel torques by the car's mass and rolling radius; resistances are the
//! integral's business.

use config::car::SpeedControl as SpeedControlConfig;

/// The controller's constants.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedControl {
    proportional: f64,
    integral: f64,
    most: f64,
    least: f64,
    /// Wheel torque per acceleration. [kg·m]
    torque_per_acceleration: f64,
}

impl SpeedControl {
    /// For a car of `mass_kg` (rotating parts included) on wheels of `radius_m`.
    #[must_use]
    pub fn new(c: &SpeedControlConfig, mass_kg: f64, radius_m: f64) -> Self {
        Self {
            proportional: c.proportional_1_s,
            integral: c.integral_1_s2,
            most: c.max_acceleration_m_s2,
            least: -c.max_deceleration_m_s2,
            torque_per_acceleration: mass_kg * radius_m,
        }
    }

    /// One step: sum of wheel torques to ask for. [N·m]
    pub fn demand_n_m(&self, integral: &mut f64, error_m_s: f64, step_s: f64) -> f64 {
        let wanted = self.proportional * error_m_s + *integral;
        let held = wanted.clamp(self.least, self.most);
        // Integrate unless that would push further into the limit.
        if wanted == held || (wanted - held) * error_m_s < 0.0 {
            *integral += self.integral * error_m_s * step_s;
        }
        held * self.torque_per_acceleration
    }
}
