//! Brakes: master pressure → four wheel pressures with first-order lag → torques.
//!
//! The rear pressure follows a proportioning valve (knee and slope). Lag by exact discretisation of
//! p' = (p_demand − p)/τ. Torque is Coulomb friction: the solver of the wheel spins applies at most what
//! brings a wheel to rest within a sub-step, so that standing needs no regularisation.

use config::car::Brakes as BrakesConfig;

/// The brakes' constants.
#[derive(Debug, Clone, PartialEq)]
pub struct Brakes {
    torque_per_pressure: [f64; 4],
    decay: f64,
    max_pressure_pa: f64,
    knee_pa: f64,
    slope: f64,
    hand_brake_n_m: f64,
}

impl Brakes {
    /// For sub-steps of `step_s`.
    #[must_use]
    pub fn new(c: &BrakesConfig, step_s: f64) -> Self {
        let (front, rear) = (c.front_torque_per_pressure_n_m_pa, c.rear_torque_per_pressure_n_m_pa);
        Self {
            torque_per_pressure: [front, front, rear, rear],
            decay: (-step_s / c.lag_s).exp(),
            max_pressure_pa: c.max_pressure_pa,
            knee_pa: c.rear_knee_pressure_pa,
            slope: c.rear_slope_above_knee,
            hand_brake_n_m: c.hand_brake_torque_n_m,
        }
    }

    /// Master pressure limited to what the system can make. [Pa]
    #[must_use]
    pub fn limited_pa(&self, master_pa: f64) -> f64 {
        master_pa.clamp(0.0, self.max_pressure_pa)
    }

    /// Sum of brake torques per master pressure, below the knee. [N·m/Pa]
    #[must_use]
    pub fn total_gain(&self) -> f64 {
        self.torque_per_pressure.iter().sum()
    }

    /// One sub-step of the wheel pressures; `line` may change what is asked of a wheel's brake (ABS).
    pub fn advance(&self, pressure_pa: &mut [f64; 4], master_pa: f64, line: impl Fn(usize, f64) -> f64) {
        let above = (master_pa - self.knee_pa).max(0.0);
        let rear = master_pa - above * (1.0 - self.slope);
        for (i, (p, demand)) in pressure_pa.iter_mut().zip([master_pa, master_pa, rear, rear]).enumerate() {
            let demand = line(i, demand);
            *p = demand + (*p - demand) * self.decay;
        }
    }

    /// Largest friction torque of each wheel's brake. [N·m]
    #[must_use]
    pub fn capacity_n_m(&self, pressure_pa: &[f64; 4], hand_brake: f64) -> [f64; 4] {
        let mut torque = [0.0; 4];
        for i in 0..4 {
            torque[i] = self.torque_per_pressure[i] * pressure_pa[i];
        }
        torque[2] += self.hand_brake_n_m * hand_brake;
        torque[3] += self.hand_brake_n_m * hand_brake;
        torque
    }
}
