//! Steady-state Magic Formula: pure and combined slip, aligning torque, overturning and rolling resistance moment.
//!
//! Axes ISO-W (TYDEX): x forward, y left, z up; α > 0 gives Fy < 0, κ > 0 drives. In `κ = -Vsx/Vcx`,
//! `tan α = Vsy/|Vcx|`.
//! Equation numbers: (4.E..) Pacejka, Tyre and Vehicle Dynamics, 3rd ed. 2012, §4.3.2; (A..) Besselink, Schmeitz,
//! Pacejka, "An improved Magic Formula/Swift tyre model that can handle inflation pressure changes", Vehicle
//! System Dynamics 48 sup. 1 (2010); (D49) the draft of that paper; (M) MF-Tyre 5.2 equation manual.
//! Where TNO's MF-Tyre departs from the book, the program is followed, as M. Furlan's mfeval 4.0 found it out:
//! A54-A56 in combined Mz, A58 and A60 with the signed camber angle in trail, Fz0 (not Fz0') in s, A48 for My,
//! D49 for Mx, trail times LFZO, Aμ = 1 in (4.E8).
//! Valid for any load ≥ 0 and any slip; nothing is limited to the file's ranges here.

use crate::keys::Parameters;
use crate::math::{atan, cos, cos_of_atan, exp, sign, sin};
use crate::tir::Version;
use crate::turn_slip::{Spin, Zeta};

/// ε of (4.E6a), (4.E16), (4.E26), (4.E38): keeps quotients finite.
const EPSILON: f64 = 1e-6;

/// Inputs of one evaluation, after the use mode has been applied.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slip {
    pub fz: f64,
    pub kappa: f64,
    /// α* of (4.E3): `tan α sgn Vcx` or α.
    pub alpha_star: f64,
    pub gamma: f64,
    /// γ* of (4.E4): `sin γ` or γ.
    pub gamma_star: f64,
    /// cos α' of (4.E6).
    pub cos_alpha_prime: f64,
    pub vcx: f64,
    /// Normalised pressure change (4.E2b).
    pub dpi: f64,
    pub pressure_ratio: f64,
    pub mu_scale: [f64; 2],
    /// Lateral force turns its sign in reverse (with α* only).
    pub turn_fy: bool,
    /// Reduction of the shifts towards standstill, 1 at speed.
    pub shift: f64,
    /// Keeps the curvature factors at or below 1, where the curves stay on their side of zero.
    pub limit_curvature: bool,
}

impl Slip {
    #[inline]
    fn curvature(&self, e: f64) -> f64 {
        if self.limit_curvature && e > 1.0 { 1.0 } else { e }
    }
}

/// Everything one evaluation gives.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Outcome {
    pub fx: f64,
    pub fy: f64,
    pub mx: f64,
    pub my: f64,
    pub mz: f64,
    pub trail: f64,
    pub mzr: f64,
    pub mux: f64,
    pub muy: f64,
    pub kxk: f64,
    pub kya: f64,
}

/// Forces, and what the moments need of their making.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forced {
    pub fx: f64,
    pub fy: f64,
    fy_prime: f64,
    pub mux: f64,
    pub muy: f64,
    pub kxk: f64,
    gyk: f64,
    pub lateral: Lateral,
    zeta: Zeta,
}

/// Quotients and products that depend on the file only.
#[derive(Debug, Clone)]
pub(crate) struct Formula {
    p: Parameters,
    version: Version,
    fz0_prime: f64,
    per_fz0_prime: f64,
    per_fz0: f64,
    per_v0: f64,
    cx: f64,
    cy: f64,
}

/// `D sin[C arctan{Bx - E(Bx - arctan Bx)}]`
#[inline]
fn sine_curve(d: f64, c: f64, bx: f64, e: f64) -> f64 {
    d * sin(c * atan(bx - e * (bx - atan(bx))))
}

/// `cos[C arctan{Bx - E(Bx - arctan Bx)}]`
#[inline]
fn cosine_curve(c: f64, bx: f64, e: f64) -> f64 {
    cos(c * atan(bx - e * (bx - atan(bx))))
}

/// sin(c arctan x); for c = 2, the usual value, without the two functions.
#[inline]
fn sin_of_multiple_atan(c: f64, x: f64) -> f64 {
    if c == 2.0 { 2.0 * x / (1.0 + x * x) } else { sin(c * atan(x)) }
}

/// Sign with sgn 0 = 1, for quotients that must stay finite.
#[inline]
fn side(x: f64) -> f64 {
    if x < 0.0 { -1.0 } else { 1.0 }
}

/// Pure lateral slip, with what Mz needs of it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lateral {
    fy0: f64,
    pub kya: f64,
    shy: f64,
    svy: f64,
    by: f64,
}

impl Formula {
    pub fn new(p: &Parameters, version: Version) -> Self {
        let fz0_prime = p.lfzo * p.fnomin;
        Self {
            version,
            fz0_prime,
            per_fz0_prime: 1.0 / fz0_prime,
            per_fz0: 1.0 / p.fnomin,
            per_v0: 1.0 / p.longvl,
            cx: p.pcx1 * p.lcx,
            cy: p.pcy1 * p.lcy,
            p: p.clone(),
        }
    }

    /// Normalised load change (4.E2a).
    #[inline]
    pub fn dfz(&self, fz: f64) -> f64 {
        (fz - self.fz0_prime) * self.per_fz0_prime
    }

    /// Longitudinal slip stiffness (4.E15). [N]
    #[inline]
    pub fn kxk(&self, fz: f64, dpi: f64) -> f64 {
        let p = &self.p;
        let dfz = self.dfz(fz);
        let load = if p.pkx3 == 0.0 { 1.0 } else { exp(p.pkx3 * dfz) };
        fz * (p.pkx1 + p.pkx2 * dfz) * load * (1.0 + p.ppx1 * dpi + p.ppx2 * dpi * dpi) * p.lkx
    }

    /// Cornering stiffness (4.E25), signed as in the file. [N/rad]
    #[inline]
    pub fn kya(&self, fz: f64, dpi: f64, gamma_star: f64, zeta3: f64) -> f64 {
        let p = &self.p;
        let load =
            fz * self.per_fz0_prime / ((p.pky2 + p.pky5 * gamma_star * gamma_star) * (1.0 + p.ppy2 * dpi));
        p.pky1
            * self.fz0_prime
            * (1.0 + p.ppy1 * dpi)
            * (1.0 - p.pky3 * gamma_star.abs())
            * sin_of_multiple_atan(p.pky4, load)
            * zeta3
            * p.lky
    }

    /// Camber stiffness (4.E30), or of MF 5.2 (M). [N/rad]
    #[inline]
    pub fn kyg0(&self, fz: f64, dpi: f64) -> f64 {
        let p = &self.p;
        let dfz = self.dfz(fz);
        if self.version == Version::Mf52 {
            let load = fz / (p.pky2 * self.fz0_prime);
            let kya0 = p.pky1 * self.fz0_prime * sin_of_multiple_atan(p.pky4, load) * p.lkyc;
            (p.phy3 * kya0 + fz * (p.pvy3 + p.pvy4 * dfz)) * p.lkyc
        } else {
            fz * (p.pky6 + p.pky7 * dfz) * (1.0 + p.ppy5 * dpi) * p.lkyc
        }
    }

    /// Friction coefficients μx, μy (4.E13), (4.E23) at this load and camber.
    #[inline]
    pub fn mu(&self, s: &Slip) -> [f64; 2] {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let dpi = s.dpi;
        let (gx, gy) = (s.gamma * p.lgax, s.gamma_star * p.lgay);
        [
            (p.pdx1 + p.pdx2 * dfz)
                * (1.0 + p.ppx3 * dpi + p.ppx4 * dpi * dpi)
                * (1.0 - p.pdx3 * gx * gx)
                * (p.lmux * s.mu_scale[0]),
            (p.pdy1 + p.pdy2 * dfz)
                * (1.0 + p.ppy3 * dpi + p.ppy4 * dpi * dpi)
                * (1.0 - p.pdy3 * gy * gy)
                * (p.lmuy * s.mu_scale[1]),
        ]
    }

    /// Pure longitudinal force (4.E9)-(4.E18). Returns (Fx0, Kxk).
    #[inline]
    fn fx0(&self, s: &Slip, mux: f64, zeta1: f64) -> (f64, f64) {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let dx = mux * s.fz * zeta1; // (4.E12)
        let kxk = self.kxk(s.fz, s.dpi);
        let bx = kxk / (self.cx * dx + EPSILON * side(dx)); // (4.E16)
        let shx = (p.phx1 + p.phx2 * dfz) * p.lhx * s.shift; // (4.E17)
        let svx = s.fz * (p.pvx1 + p.pvx2 * dfz) * p.lvx * (p.lmux * s.mu_scale[0]) * zeta1 * s.shift; // (4.E18)
        let kappax = s.kappa + shx; // (4.E10)
        let ex = (p.pex1 + p.pex2 * dfz + p.pex3 * dfz * dfz) * (1.0 - p.pex4 * sign(kappax)) * p.lex; // (4.E14)
        let ex = s.curvature(ex);
        let fx0 = sine_curve(dx, self.cx, bx * kappax, ex) + svx; // (4.E9)
        (if s.vcx < 0.0 { -fx0 } else { fx0 }, kxk)
    }

    /// Pure lateral force (4.E19)-(4.E30).
    #[inline]
    fn fy0(&self, s: &Slip, muy: f64, gamma_star: f64, zeta: &Zeta) -> Lateral {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let lmuy = p.lmuy * s.mu_scale[1];
        let kya = self.kya(s.fz, s.dpi, gamma_star, zeta.z3);
        let svyg = s.fz * (p.pvy3 + p.pvy4 * dfz) * gamma_star * p.lkyc * lmuy * zeta.z2; // (4.E28)
        let shy = (p.phy1 + p.phy2 * dfz) * p.lhy // (4.E27)
            + if self.version == Version::Mf52 {
                p.phy3 * gamma_star * p.lkyc // (M)
            } else if gamma_star == 0.0 && zeta.z4 == 1.0 {
                0.0
            } else {
                (self.kyg0(s.fz, s.dpi) * gamma_star - svyg) / (kya + EPSILON * side(kya)) * zeta.z0 + zeta.z4
                    - 1.0
            };
        let shy = shy * s.shift;
        let svy = (s.fz * (p.pvy1 + p.pvy2 * dfz) * p.lvy * lmuy * zeta.z2 + svyg) * s.shift; // (4.E29)
        let alphay = s.alpha_star + shy; // (4.E20)
        let dy = muy * s.fz * zeta.z2; // (4.E22)
        let ey = (p.pey1 + p.pey2 * dfz)
            * (1.0 + p.pey5 * gamma_star * gamma_star - (p.pey3 + p.pey4 * gamma_star) * side(alphay))
            * p.ley; // (4.E24)
        let ey = s.curvature(ey);
        let by = kya / (self.cy * dy + EPSILON * side(dy)); // (4.E26)
        let fy0 = sine_curve(dy, self.cy, by * alphay, ey) + svy; // (4.E19)
        Lateral { fy0: if s.turn_fy { -fy0 } else { fy0 }, kya, shy, svy, by }
    }

    /// Weighting function of side slip on Fx (4.E51)-(4.E57).
    #[inline]
    fn gxa(&self, s: &Slip) -> f64 {
        if s.alpha_star == 0.0 {
            return 1.0;
        }
        let p = &self.p;
        let exa = s.curvature(p.rex1 + p.rex2 * self.dfz(s.fz)); // (4.E56)
        let bxa = (p.rbx1 + p.rbx3 * s.gamma_star * s.gamma_star) * cos_of_atan(p.rbx2 * s.kappa) * p.lxal; // (4.E54)
        let shxa = p.rhx1; // (4.E57)
        let at = cosine_curve(p.rcx1, bxa * (s.alpha_star + shxa), exa);
        if shxa == 0.0 { at } else { at / cosine_curve(p.rcx1, bxa * shxa, exa) } // (4.E51), (4.E52)
    }

    /// Weighting function of κ on Fy (4.E59)-(4.E65).
    #[inline]
    fn gyk(&self, s: &Slip) -> f64 {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let shyk = p.rhy1 + p.rhy2 * dfz; // (4.E65)
        if s.kappa == 0.0 {
            return 1.0;
        }
        let eyk = s.curvature(p.rey1 + p.rey2 * dfz); // (4.E64)
        let byk = (p.rby1 + p.rby4 * s.gamma_star * s.gamma_star)
            * cos_of_atan(p.rby2 * (s.alpha_star - p.rby3))
            * p.lyka; // (4.E62)
        let at = cosine_curve(p.rcy1, byk * (s.kappa + shyk), eyk);
        if shyk == 0.0 { at } else { at / cosine_curve(p.rcy1, byk * shyk, eyk) } // (4.E59), (4.E60)
    }

    /// κ-induced side force (4.E66), (4.E67) per unit of μy.
    #[inline]
    fn svyk_per_mu(&self, s: &Slip, zeta2: f64) -> f64 {
        let p = &self.p;
        let d = p.rvy1 + p.rvy2 * self.dfz(s.fz) + p.rvy3 * s.gamma_star;
        if d == 0.0 || s.kappa == 0.0 {
            return 0.0;
        }
        s.fz * d
            * cos_of_atan(p.rvy4 * s.alpha_star)
            * zeta2
            * sin(p.rvy5 * atan(p.rvy6 * s.kappa))
            * p.lvyka
            * s.shift
    }

    /// Forces of pure and combined slip. `s.fz` must be positive.
    pub fn forces(&self, s: &Slip, spin: Option<&Spin>) -> Forced {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let [mux, muy] = self.mu(s);
        let mut zeta = Zeta::NONE;
        if let Some(spin) = spin {
            zeta.forces(p, spin, dfz, s);
        }
        let (fx0, kxk) = self.fx0(s, mux, zeta.z1);
        let gs = s.gamma_star * p.lgay;
        if let Some(spin) = spin {
            let kya = self.kya(s.fz, s.dpi, gs, zeta.z3);
            let kya0 = self.kya(s.fz, s.dpi, 0.0, zeta.z3);
            let svyg = s.fz * (p.pvy3 + p.pvy4 * dfz) * gs * p.lkyc * (p.lmuy * s.mu_scale[1]) * zeta.z2;
            zeta.camber(p, spin, dfz, self.kyg0(s.fz, s.dpi), kya, kya0, svyg, s.vcx);
        }
        let lateral = self.fy0(s, muy, gs, &zeta);
        let gyk = self.gyk(s);
        let svyk_per_mu = self.svyk_per_mu(s, zeta.z2);
        // Fy' of (4.E74): at zero camber and spin, but for Gyk, which TNO leaves.
        let fy = gyk * lateral.fy0 + muy * svyk_per_mu; // (4.E58)
        let fy_prime = if self.version == Version::Mf52 || (gs == 0.0 && spin.is_none()) {
            // MF 5.2: Fy - SVyk (M).
            gyk * lateral.fy0
        } else {
            let flat = Slip { gamma_star: 0.0, ..*s };
            gyk * self.fy0(&flat, self.mu(&flat)[1], 0.0, &Zeta::NONE).fy0
        };
        Forced { fx: self.gxa(s) * fx0, fy, fy_prime, mux, muy, kxk, gyk, lateral, zeta } // (4.E50)
    }

    /// Moments that go with the forces `fx`, `fy` (those of `forced`, or lagging ones) and rolling resistance `my`. `s` is the slip that trail
    /// and residual torque follow.
    pub fn moments(
        &self,
        s: &Slip,
        spin: Option<&Spin>,
        forced: &Forced,
        fx: f64,
        fy: f64,
        my: f64,
    ) -> Outcome {
        let (mz, trail, mzr) = self.mz(s, spin, forced, fx, fy);
        Outcome {
            fx,
            fy,
            mx: self.mx(s, fy),
            my,
            mz,
            trail,
            mzr,
            mux: forced.mux,
            muy: forced.muy,
            kxk: forced.kxk,
            kya: forced.lateral.kya,
        }
    }

    /// Aligning torque (4.E31)-(4.E47), (4.E71)-(4.E76) with the changes named above: (Mz, trail, Mzr).
    #[inline]
    fn mz(&self, s: &Slip, spin: Option<&Spin>, forced: &Forced, fx: f64, fy: f64) -> (f64, f64, f64) {
        let p = &self.p;
        let lateral = &forced.lateral;
        let mut zeta = forced.zeta;
        let dfz = self.dfz(s.fz);
        let lmuy = p.lmuy * s.mu_scale[1];
        let (gamma, gs) = (s.gamma * p.lgaz, s.gamma_star * p.lgaz);
        let r0 = p.unloaded_radius;
        if let Some(spin) = spin {
            zeta.moments(p, spin, dfz, s.fz, s.fz * self.per_fz0_prime, forced.muy, s.gamma, forced.gyk);
        }
        let kya_prime = lateral.kya + EPSILON * side(lateral.kya); // (4.E39)
        let sht = p.qhz1 + p.qhz2 * dfz + (p.qhz3 + p.qhz4 * dfz) * gs; // (4.E35)
        let shf = lateral.shy + lateral.svy / kya_prime; // (4.E38)
        let alphar = s.alpha_star + shf; // (4.E37)
        let alphat = s.alpha_star + sht; // (4.E34)
        let dt = (p.qdz1 + p.qdz2 * dfz)
            * (1.0 - p.ppz1 * s.dpi)
            * (1.0 + p.qdz3 * gamma + p.qdz4 * gamma * gamma)
            * s.fz
            * (r0 * self.per_fz0_prime)
            * p.ltr
            * zeta.z5; // (A60)
        let bt = (p.qbz1 + p.qbz2 * dfz + p.qbz3 * dfz * dfz)
            * (1.0 + p.qbz4 * gamma + p.qbz5 * gamma.abs())
            * p.lky
            / lmuy; // (A58)
        let ct = p.qcz1; // (4.E41)
        let et = (p.qez1 + p.qez2 * dfz + p.qez3 * dfz * dfz)
            * (1.0 + (p.qez4 + p.qez5 * gs) * std::f64::consts::FRAC_2_PI * atan(bt * ct * alphat)); // (4.E44)
        let et = s.curvature(et);
        let camber = if gs == 0.0 {
            0.0
        } else {
            ((p.qdz8 + p.qdz9 * dfz) * (1.0 + p.ppz2 * s.dpi) + (p.qdz10 + p.qdz11 * dfz) * gs.abs())
                * gs
                * p.lkzc
                * zeta.z0
        };
        let dr = s.fz
            * r0
            * ((p.qdz6 + p.qdz7 * dfz) * p.lres * zeta.z2 + camber)
            * lmuy
            * sign(s.vcx)
            * cos(s.alpha_star)
            + (zeta.z8 - 1.0); // (4.E47)
        let br = (p.qbz9 * p.lky / lmuy + p.qbz10 * lateral.by * self.cy) * zeta.z6; // (4.E45)

        // Equivalent slips (A54), (A55).
        let kappa = forced.kxk / kya_prime * s.kappa;
        let (alphar_eq, alphat_eq) = if kappa == 0.0 {
            (fold(alphar), fold(alphat))
        } else {
            (equivalent(alphar, kappa), equivalent(alphat, kappa))
        };
        let mzr = if zeta.z7 == 1.0 {
            dr * cos_of_atan(br * alphar_eq)
        } else {
            dr * cos(zeta.z7 * atan(br * alphar_eq))
        }; // (4.E75)
        let trail = dt * cosine_curve(ct, bt * alphat_eq, et) * s.cos_alpha_prime * p.lfzo; // (4.E73)
        let arm = r0 * (p.ssz1 + p.ssz2 * (fy * self.per_fz0) + (p.ssz3 + p.ssz4 * dfz) * gamma) * p.ls; // (A56)

        let trail = trail * s.shift;
        let mzr = mzr * s.shift;
        let fy_prime = forced.fy_prime + (fy - forced.fy);
        (-trail * fy_prime + mzr + arm * fx, trail, mzr) // (4.E71), (4.E72)
    }

    /// Overturning moment (D49); below FZMIN the load fades with its third power.
    #[inline]
    fn mx(&self, s: &Slip, fy: f64) -> f64 {
        let p = &self.p;
        let fz = if s.fz < p.fzmin { s.fz * (s.fz / p.fzmin).powi(2) } else { s.fz };
        let load = fz * self.per_fz0;
        let side_load = fy * self.per_fz0;
        let gamma = s.gamma;
        let mixed = if p.qsx4 == 0.0 {
            0.0
        } else {
            p.qsx4
                * cos(p.qsx5 * atan((p.qsx6 * load).powi(2)))
                * sin(p.qsx7 * gamma + p.qsx8 * atan(p.qsx9 * side_load))
        };
        let by_load = if p.qsx10 == 0.0 { 0.0 } else { p.qsx10 * atan(p.qsx11 * load) * gamma };
        p.unloaded_radius
            * p.lmx
            * (fz
                * (p.qsx1 * p.lvmx
                    - p.qsx2 * gamma * (1.0 + p.ppmx1 * s.dpi)
                    - p.qsx12 * gamma * gamma.abs()
                    + p.qsx3 * side_load
                    + mixed
                    + by_load)
                + fy * (p.qsx13 + p.qsx14 * gamma.abs()))
    }

    /// Rolling resistance moment (A48), or of MF 5.2 (M), with the program's turn at a locked wheel and low load.
    #[inline]
    pub fn my(&self, s: &Slip, fx: f64) -> f64 {
        let p = &self.p;
        if s.vcx == 0.0 {
            return 0.0;
        }
        let fz = if s.fz < p.fzmin { s.fz * (s.fz / p.fzmin) } else { s.fz };
        let load = fz * self.per_fz0;
        let speed = (s.vcx * self.per_v0).abs();
        let rolling = p.qsy1 + p.qsy2 * (fx * self.per_fz0) + p.qsy3 * speed + p.qsy4 * speed.powi(4);
        let mut my = if self.version == Version::Mf52 {
            -p.unloaded_radius * fz * p.lmy * rolling
        } else {
            let by_load = if p.qsy7 == 1.0 { load } else { load.powf(p.qsy7) };
            let by_pressure =
                if p.qsy8 == 0.0 || s.pressure_ratio == 1.0 { 1.0 } else { s.pressure_ratio.powf(p.qsy8) };
            -p.unloaded_radius
                * p.fnomin
                * p.lmy
                * (rolling + (p.qsy5 + p.qsy6 * load) * s.gamma * s.gamma)
                * (by_load * by_pressure)
        };
        if s.vcx < 0.0 {
            my = -my;
        }
        // Turn of sign between a wheel rolling forward and one turning backward, through a locked wheel.
        let high = p.vxlow / s.vcx.abs() - 1.0;
        let low = -1.0 - p.vxlow - high;
        if s.kappa >= low && s.kappa <= high {
            my *= sin(std::f64::consts::FRAC_PI_2 * (s.kappa + 1.0) / (high + 1.0));
        } else if s.kappa < low {
            my = -my;
        }
        my
    }
}

/// (A54), (A55) without κ: arctan|tan α| sgn α.
#[inline]
fn fold(alpha: f64) -> f64 {
    if alpha.abs() < std::f64::consts::FRAC_PI_2 { alpha } else { equivalent(alpha, 0.0) }
}

/// (A54), (A55)
#[inline]
fn equivalent(alpha: f64, kappa: f64) -> f64 {
    let tan = crate::math::tan(alpha);
    atan((tan * tan + kappa * kappa).sqrt()) * sign(alpha)
}
