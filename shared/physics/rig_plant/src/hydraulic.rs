//! A symmetric cylinder and its servo-valve in load-pressure form [Merritt 1967, eqs. 6-1 to 6-15].
//!
//! ```text
//! ẍ_v = ω²(u − x_v) − 2ζω ẋ_v,   Q = Q_r x_v √((p_s − sgn(x_v) p_L)/Δp_r)
//! ṗ_L = β(1/V₁ + 1/V₂)(Q − A q̇ − C p_L),   F = A p_L − friction − end stop
//! ```
//!
//! In: valve command [-1, 1], stroke and its speed. Out: force of the rod [N], + in the direction of + stroke.
//! The pressure is integrated implicitly in its own damping (valve and leakage), so a closed valve or a
//! stalled piston is stable at any step. Valid without cavitation; supply pressure is constant.

use crate::friction::LuGre;
use crate::state::{StateReader, StateWriter};
use config::rig::HydraulicAxis;

/// One cylinder with its valve.
#[derive(Debug, Clone)]
pub struct Cylinder {
    axis: HydraulicAxis,
    valve_omega: f64,
    flow_gain: f64,
    friction: LuGre,
    /// Opening of the valve. [-]
    pub opening: f64,
    opening_rate: f64,
    /// Load pressure. [Pa]
    pub pressure_pa: f64,
}

impl Cylinder {
    /// Values of its flat state.
    pub const STATE: usize = 4;

    /// A cylinder with closed valve, carrying `load_n`.
    pub fn new(axis: &HydraulicAxis, load_n: f64) -> Self {
        Self {
            axis: axis.clone(),
            valve_omega: core::f64::consts::TAU * axis.valve_frequency_hz,
            flow_gain: axis.rated_flow_m3_s / axis.rated_drop_pa.sqrt(),
            friction: LuGre::new(&axis.friction),
            opening: 0.0,
            opening_rate: 0.0,
            pressure_pa: load_n / axis.piston_area_m2,
        }
    }

    /// Largest stiffness the mass can meet (oil at the end of stroke, friction in stick, stop). [N/m]
    pub fn stiffness_max_n_m(&self) -> f64 {
        let oil = self.compliance(self.axis.stroke_m) * self.axis.piston_area_m2 * self.axis.piston_area_m2;
        oil + self.friction.stiffness() + self.axis.stop_stiffness_n_m
    }

    fn compliance(&self, stroke_m: f64) -> f64 {
        let reach = self.axis.stroke_m + self.axis.dead_length_m;
        let shortest = 0.5 * self.axis.dead_length_m;
        let chamber = |side: f64| self.axis.piston_area_m2 * (reach + side * stroke_m).max(shortest);
        self.axis.bulk_modulus_pa * (1.0 / chamber(1.0) + 1.0 / chamber(-1.0))
    }

    /// Advances valve and pressure by `step_s`; returns the rod's force. [N]
    pub fn step(&mut self, command: f64, stroke_m: f64, speed_m_s: f64, step_s: f64) -> f64 {
        let (a, w) = (&self.axis, self.valve_omega);
        let acceleration = w * w * (command - self.opening);
        self.opening_rate =
            (self.opening_rate + step_s * acceleration) / (1.0 + step_s * 2.0 * a.valve_damping_ratio * w);
        self.opening += step_s * self.opening_rate;
        if self.opening.abs() > 1.0 {
            self.opening = self.opening.signum();
            self.opening_rate = 0.0;
        }
        // √ of the signed drop, smooth through zero within a thousandth of the supply pressure.
        let drop = a.supply_pressure_pa - self.opening.signum() * self.pressure_pa;
        let smooth = 1e-3 * a.supply_pressure_pa;
        let root = (drop * drop + smooth * smooth).sqrt().sqrt();
        let flow = self.flow_gain * self.opening * drop / root;
        let flow_per_pressure = self.flow_gain * self.opening.abs() / root;
        let stiffness = self.compliance(stroke_m);
        let net = flow - a.piston_area_m2 * speed_m_s - a.leakage_m3_s_pa * self.pressure_pa;
        let damping = a.leakage_m3_s_pa + 0.5 * flow_per_pressure;
        self.pressure_pa += step_s * stiffness * net / (1.0 + step_s * stiffness * damping);
        let excess = stroke_m.abs() - a.stroke_m;
        let stop = if excess > 0.0 {
            let outward = speed_m_s * stroke_m.signum();
            -stroke_m.signum() * (a.stop_stiffness_n_m * excess + a.stop_damping_n_s_m * outward).max(0.0)
        } else {
            0.0
        };
        a.piston_area_m2 * self.pressure_pa + self.friction.step(speed_m_s, step_s) + stop
    }

    /// Writes the state.
    pub fn save(&self, out: &mut StateWriter) {
        out.put_all(&[self.opening, self.opening_rate, self.pressure_pa, self.friction.deflection]);
    }

    /// Reads the state.
    pub fn load(&mut self, from: &mut StateReader) {
        [self.opening, self.opening_rate, self.pressure_pa, self.friction.deflection] = from.take_array();
    }
}
