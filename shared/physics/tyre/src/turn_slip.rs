//! Turn slip: the reduction factors ζ0..ζ8 of Pacejka, Tyre and Vehicle Dynamics, 3rd ed. 2012, §4.3.3.
//!
//! φ is the spin slip (4.76), φt the turn slip (path curvature seen by the contact patch, 1/m), both in ISO-W
//! signs. Two places follow the MF-Tyre manual: φ with the plus sign of an upward z axis, and B_Drp with φt.
//! Validated against nothing but the limits of the book (φ = 0 gives factors of 1); no reference table has turn
//! slip.

use crate::formula::Slip;
use crate::keys::Parameters;
use crate::math::{atan, cos_of_atan, sign, sin, tan};

/// Spin of one evaluation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spin {
    /// φ [1/m] (4.76)
    pub phi: f64,
    /// φt [1/m] (4.75)
    pub phi_t: f64,
    /// Camber reduction factor ε_γ (4.90).
    pub epsilon_gamma: f64,
}

impl Spin {
    /// (4.75), (4.76), (4.90); `omega` is the wheel speed [rad/s], `v` the contact speed [m/s].
    pub fn new(p: &Parameters, phi_t: f64, gamma: f64, omega: f64, v: f64, vcx: f64, dfz: f64) -> Self {
        // ε_γ = 1 would make (4.89) and (4.99) infinite.
        let epsilon_gamma = (p.pecp1 * (1.0 + p.pecp2 * dfz)).min(0.95);
        let v = if vcx.abs() < p.vxlow { p.vxlow * if vcx < 0.0 { -1.0 } else { 1.0 } } else { v };
        let yaw_rate = -phi_t * v; // (4.75)
        let phi = (yaw_rate - (1.0 - epsilon_gamma) * omega * sin(gamma)) / v; // (4.76)
        Self { phi, phi_t, epsilon_gamma }
    }
}

/// ζ0..ζ8.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Zeta {
    pub z0: f64,
    pub z1: f64,
    pub z2: f64,
    pub z3: f64,
    pub z4: f64,
    pub z5: f64,
    pub z6: f64,
    pub z7: f64,
    pub z8: f64,
}

impl Zeta {
    /// No turn slip.
    pub const NONE: Self =
        Self { z0: 1.0, z1: 1.0, z2: 1.0, z3: 1.0, z4: 1.0, z5: 1.0, z6: 1.0, z7: 1.0, z8: 1.0 };

    /// ζ1, ζ2, ζ3: (4.105), (4.77), (4.79).
    pub fn forces(&mut self, p: &Parameters, spin: &Spin, dfz: f64, s: &Slip) {
        let spin_radius = p.unloaded_radius * spin.phi;
        let bxp = p.pdxp1 * (1.0 + p.pdxp2 * dfz) * cos_of_atan(p.pdxp3 * s.kappa); // (4.106)
        self.z1 = cos_of_atan(bxp * spin_radius);
        self.z3 = cos_of_atan(p.pkyp1 * spin_radius * spin_radius);
        let byp = p.pdyp1 * (1.0 + p.pdyp2 * dfz) * cos_of_atan(p.pdyp3 * tan_of(s.alpha_star)); // (4.78)
        let r = spin_radius.abs();
        self.z2 = cos_of_atan(byp * (r + p.pdyp4 * r.sqrt()));
    }

    /// ζ0, ζ4: (4.80)-(4.89).
    pub fn camber(
        &mut self,
        p: &Parameters,
        spin: &Spin,
        dfz: f64,
        kyg0: f64,
        kya: f64,
        kya0: f64,
        svyg: f64,
        vcx: f64,
    ) {
        let safe = |k: f64| k + if k < 0.0 { -1e-6 } else { 1e-6 };
        let dhyp = (p.phyp2 + p.phyp3 * dfz) * sign(vcx); // (4.86)
        let kyr0 = kyg0 / (1.0 - spin.epsilon_gamma); // (4.89)
        let scale = p.phyp1 * dhyp * safe(kya0);
        let b = if scale == 0.0 { 0.0 } else { kyr0 / scale }; // (4.88)
        let x = b * p.unloaded_radius * spin.phi;
        let shyp = dhyp * sin(p.phyp1 * atan(x - p.phyp4 * (x - atan(x)))) * sign(vcx); // (4.80)
        self.z0 = 0.0; // (4.83)
        self.z4 = 1.0 + shyp - svyg / safe(kya); // (4.84)
    }

    /// ζ5..ζ8: (4.91), (4.102), (4.94)-(4.103).
    pub fn moments(
        &mut self,
        p: &Parameters,
        spin: &Spin,
        dfz: f64,
        fz: f64,
        load: f64,
        muy: f64,
        gamma: f64,
        gyk: f64,
    ) {
        let r0 = p.unloaded_radius;
        self.z5 = cos_of_atan(p.qdtp1 * r0 * spin.phi); // (4.91)
        self.z6 = cos_of_atan(p.qbrp1 * r0 * spin.phi); // (4.102)
        let mzp_inf = (p.qcrp1 * muy.abs() * r0 * fz * load.sqrt() * p.lmp).max(1e-6); // (4.95)
        let cdrp = p.qdrp1; // (4.96)
        let ddrp = mzp_inf / sin(0.5 * std::f64::consts::PI * cdrp); // (4.94)
        let kzgr0 = fz * r0 * (p.qdz8 + p.qdz9 * dfz + (p.qdz10 + p.qdz11 * dfz) * gamma.abs()) * p.lkzc; // (4.99)
        let bdrp = kzgr0 / (cdrp * ddrp * (1.0 - spin.epsilon_gamma)); // (4.98)
        let drp = ddrp * sin(cdrp * atan(bdrp * r0 * spin.phi_t)); // (4.97)
        let mzp90 = mzp_inf * std::f64::consts::FRAC_2_PI * atan(p.qcrp2 * r0 * spin.phi_t.abs()) * gyk; // (4.103)
        let ratio = if drp == 0.0 { 0.0 } else { (mzp90 / drp.abs()).clamp(-1.0, 1.0) };
        self.z7 = std::f64::consts::FRAC_2_PI * ratio.acos(); // (4.104)
        self.z8 = 1.0 + drp; // (4.101)
    }
}

fn tan_of(alpha: f64) -> f64 {
    tan(alpha.clamp(-1.5, 1.5))
}
