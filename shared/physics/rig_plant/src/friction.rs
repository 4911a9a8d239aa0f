//! Friction with pre-sliding: LuGre [Canudas de Wit et al. 1995, IEEE TAC 40(3), eq. 3–5].
//!
//! ```text
//! ż = v − σ₀|v|/g(v) z,   g(v) = F_c + (F_s − F_c) e^{−(v/v_s)²},   F = σ₀ z + σ₁ ż
//! ```
//!
//! In: relative speed. Out: force against it. Viscous friction is kept by the owner. z is integrated
//! implicitly, so it stays within g/σ₀ at any speed and step. Not modelled: temperature, wear.

use config::unit::Friction;

/// One friction contact.
#[derive(Debug, Clone, PartialEq)]
pub struct LuGre {
    sliding: f64,
    excess: f64,
    stribeck: f64,
    stiffness: f64,
    damping: f64,
    /// Bristle deflection. [m] or [rad]
    pub deflection: f64,
}

impl LuGre {
    /// A contact at rest, without deflection.
    pub fn new(friction: impl Into<Friction>) -> Self {
        let friction = friction.into();
        let stiffness = friction.sliding / friction.presliding;
        Self {
            sliding: friction.sliding,
            excess: friction.sliding * (friction.breakaway_ratio - 1.0),
            stribeck: friction.stribeck_speed,
            stiffness,
            damping: stiffness * friction.bristle_time_s,
            deflection: 0.0,
        }
    }

    /// Another sliding friction, with the same elastic displacement and ratios.
    pub fn set_sliding(&mut self, friction: impl Into<Friction>, sliding: f64) {
        let deflection = self.deflection;
        *self = Self::new(Friction { sliding, ..friction.into() });
        self.deflection = deflection;
    }

    /// Stiffness in stick, for stability checks.
    pub fn stiffness(&self) -> f64 {
        self.stiffness
    }

    /// Advances the bristle by `step_s` at constant `speed`; returns the force on the mover, against its motion.
    pub fn step(&mut self, speed: f64, step_s: f64) -> f64 {
        if self.sliding <= 0.0 {
            return 0.0;
        }
        let s = speed / self.stribeck;
        let g = if s.abs() > 6.0 { self.sliding } else { self.sliding + self.excess * (-s * s).exp() };
        let before = self.deflection;
        self.deflection = (before + step_s * speed) / (1.0 + step_s * self.stiffness * speed.abs() / g);
        let rate = (self.deflection - before) / step_s;
        -(self.stiffness * self.deflection + self.damping * rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contact() -> LuGre {
        LuGre::new(Friction {
            sliding: 150.0,
            breakaway_ratio: 1.2,
            stribeck_speed: 0.002,
            presliding: 5e-5,
            bristle_time_s: 0.001,
        })
    }

    #[test]
    fn slides_at_the_sliding_force_either_way() {
        let mut c = contact();
        for speed in [0.05, -0.3] {
            let force = (0..5000).map(|_| c.step(speed, 1e-4)).last().unwrap();
            assert!((force + 150.0 * speed.signum()).abs() < 0.1, "{force}");
        }
    }

    #[test]
    fn sticks_elastically_below_presliding_and_dissipates_in_a_cycle() {
        let mut c = contact();
        let (mut work, mut peak) = (0.0, 0.0_f64);
        for i in 0..20000 {
            let phase = f64::from(i) * 1e-4 * core::f64::consts::TAU;
            let speed = 1e-5 * core::f64::consts::TAU * phase.cos();
            let force = c.step(speed, 1e-4);
            peak = peak.max(force.abs());
            if i >= 10000 {
                work -= force * speed * 1e-4;
            }
        }
        // 10 µm at 3 N/µm are 30 N, less creep, plus bristle damping.
        assert!(peak > 20.0 && peak < 33.0, "{peak}");
        assert!(work > 0.0, "{work}");
    }
}
