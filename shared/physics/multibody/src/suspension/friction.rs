//! Friction about the kingpin axis: Dahl's model [Dahl 1968] — Coulomb friction with a smooth, elastic
//! reversal — integrated exactly over each tick's rotation. Rate-independent, hence without a clock:
//! dM/dθ = (M_c sgn(dθ) − M)/θ_p, so M → M_c sgn(dθ) + (M − M_c sgn(dθ)) e^(−|dθ|/θ_p).
//! It is the LuGre model without its Stribeck and viscous terms. Each closed loop dissipates.

/// One side's friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct KingpinFriction {
    coulomb_n_m: f64,
    presliding_rad: f64,
    moment_n_m: f64,
}

impl KingpinFriction {
    pub fn new(config: &config::axle::KingpinFriction) -> Self {
        Self { coulomb_n_m: config.moment_n_m, presliding_rad: config.presliding_rad, moment_n_m: 0.0 }
    }

    pub fn reset(&mut self) {
        self.moment_n_m = 0.0;
    }

    /// Opposes rotation by `angle_rad` about the kingpin.
    pub fn turn(&mut self, angle_rad: f64) {
        if angle_rad != 0.0 {
            let limit = self.coulomb_n_m.copysign(angle_rad);
            self.moment_n_m =
                limit + (self.moment_n_m - limit) * (-angle_rad.abs() / self.presliding_rad).exp();
        }
    }

    /// Moment against positive rotation. [N m]
    pub fn moment_n_m(self) -> f64 {
        self.moment_n_m
    }

    pub fn set_moment_n_m(&mut self, moment_n_m: f64) {
        self.moment_n_m = moment_n_m;
    }
}

#[cfg(test)]
mod tests {
    use super::KingpinFriction;

    #[test]
    fn slides_at_the_coulomb_moment_reverses_smoothly_and_dissipates() {
        let config = config::axle::KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.002 };
        let mut friction = KingpinFriction::new(&config);
        let (mut work, mut previous) = (0.0, 0.0_f64);
        for k in 0..4000_u32 {
            let angle = |k: u32| 0.05 * (f64::from(k) * std::f64::consts::TAU / 2000.0).sin();
            let turn = angle(k + 1) - angle(k);
            friction.turn(turn);
            work += friction.moment_n_m() * turn;
            // One tick's change is bounded by the stiffness M_c/θ_p, doubled at full reversal.
            assert!((friction.moment_n_m() - previous).abs() <= 2.0 * 8.0 / 0.002 * turn.abs() + 1e-12);
            previous = friction.moment_n_m();
            assert!(previous.abs() <= 8.0);
        }
        // Two cycles of ±0.05 rad: 8 N m × 0.4 rad, less M_c θ_p at the start and 2 M_c θ_p a reversal.
        let expected = 8.0 * 0.4 - 8.0 * 0.002 * (1.0 + 4.0 * 2.0);
        assert!((work - expected).abs() < 0.005, "{work}, {expected}");
        let before = friction.moment_n_m();
        friction.turn(0.0);
        assert_eq!(friction.moment_n_m(), before);
    }
}
