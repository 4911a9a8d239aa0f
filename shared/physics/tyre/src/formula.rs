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
use crate::math::{atan, atan_all, cos_of_atan, exp, sign, sin, sin_all};
use crate::tir::Version;
use crate::turn_slip::{Spin, Zeta};
use std::f64::consts::{FRAC_2_PI, FRAC_PI_2};

/// ε of (4.E6a), (4.E16), (4.E26), (4.E38): keeps quotients finite.
const EPSILON: f64 = 1e-6;

/// Inputs of one evaluation, after the use mode has been applied.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slip {
    pub fz: f64,
    pub kappa: f64,
    /// α* of (4.E3): `tan α sgn Vcx` or α.
    pub alpha_star: f64,
    /// tan α
    pub tan_alpha: f64,
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
    pub fy_prime: f64,
    pub mux: f64,
    pub muy: f64,
    pub kxk: f64,
    pub gyk: f64,
    pub lateral: Lateral,
    pub zeta: Zeta,
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
    per_fzmin: f64,
    cx: f64,
    cy: f64,
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
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Lateral {
    pub kya: f64,
    shy: f64,
    svy: f64,
    by: f64,
    dy: f64,
    /// By αy
    argument: f64,
    ey: f64,
    turned: bool,
}

impl Lateral {
    /// For laws that have no more to tell than the cornering stiffness.
    pub fn of_stiffness(kya: f64) -> Self {
        Self { kya, ..Self::default() }
    }

    /// (4.E19) from the sine of its curve.
    #[inline(always)]
    fn force(&self, sine: f64) -> f64 {
        let fy0 = self.dy * sine + self.svy;
        if self.turned { -fy0 } else { fy0 }
    }
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
            // No fading where the file has no least load.
            per_fzmin: if p.fzmin > 0.0 { 1.0 / p.fzmin } else { f64::INFINITY },
            cx: p.pcx1 * p.lcx,
            cy: p.pcy1 * p.lcy,
            p: p.clone(),
        }
    }

    /// Normalised load change (4.E2a).
    #[inline]
    fn dfz(&self, fz: f64) -> f64 {
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

    /// Pure lateral slip (4.E20)-(4.E29) at a camber.
    #[inline(always)]
    fn lateral(&self, s: &Slip, mu: f64, gamma_star: f64, zeta: &Zeta) -> Lateral {
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
        let dy = mu * s.fz * zeta.z2; // (4.E22)
        let ey = (p.pey1 + p.pey2 * dfz)
            * (1.0 + p.pey5 * gamma_star * gamma_star - (p.pey3 + p.pey4 * gamma_star) * side(alphay))
            * p.ley; // (4.E24)
        let by = kya / (self.cy * dy + EPSILON * side(dy)); // (4.E26)
        Lateral { kya, shy, svy, by, dy, argument: by * alphay, ey: s.curvature(ey), turned: s.turn_fy }
    }

    /// Forces of pure and combined slip. `s.fz` must be positive.
    #[inline(always)]
    pub fn forces(&self, s: &Slip, spin: Option<&Spin>) -> Forced {
        let p = &self.p;
        let dfz = self.dfz(s.fz);
        let [mux, muy] = self.mu(s);
        let gs = s.gamma_star * p.lgay;
        let kxk = self.kxk(s.fz, s.dpi);
        let mut zeta = Zeta::NONE;
        if let Some(spin) = spin {
            zeta.forces(p, spin, dfz, s);
            let kya = self.kya(s.fz, s.dpi, gs, zeta.z3);
            let kya0 = self.kya(s.fz, s.dpi, 0.0, zeta.z3);
            let svyg = s.fz * (p.pvy3 + p.pvy4 * dfz) * gs * p.lkyc * (p.lmuy * s.mu_scale[1]) * zeta.z2;
            zeta.camber(p, spin, dfz, self.kyg0(s.fz, s.dpi), kya, kya0, svyg, s.vcx);
        }

        // Pure longitudinal slip.
        let dx = mux * s.fz * zeta.z1; // (4.E12)
        let bx = kxk / (self.cx * dx + EPSILON * side(dx)); // (4.E16)
        let shx = (p.phx1 + p.phx2 * dfz) * p.lhx * s.shift; // (4.E17)
        let svx = s.fz * (p.pvx1 + p.pvx2 * dfz) * p.lvx * (p.lmux * s.mu_scale[0]) * zeta.z1 * s.shift; // (4.E18)
        let kappax = s.kappa + shx; // (4.E10)
        let ex = (p.pex1 + p.pex2 * dfz + p.pex3 * dfz * dfz) * (1.0 - p.pex4 * sign(kappax)) * p.lex; // (4.E14)
        let ex = s.curvature(ex);

        // Pure lateral slip, also at zero camber and spin for Fy' of (4.E74); MF 5.2 does without (M).
        let lateral = self.lateral(s, muy, gs, &zeta);
        let flat = if self.version == Version::Mf52 || (gs == 0.0 && spin.is_none()) {
            lateral
        } else {
            self.lateral(s, self.mu(&Slip { gamma_star: 0.0, ..*s })[1], 0.0, &Zeta::NONE)
        };

        // Weighting functions and κ-induced side force.
        let exa = s.curvature(p.rex1 + p.rex2 * dfz); // (4.E56)
        let bxa = (p.rbx1 + p.rbx3 * s.gamma_star * s.gamma_star) * cos_of_atan(p.rbx2 * s.kappa) * p.lxal; // (4.E54)
        let shxa = p.rhx1; // (4.E57)
        let shyk = p.rhy1 + p.rhy2 * dfz; // (4.E65)
        let eyk = s.curvature(p.rey1 + p.rey2 * dfz); // (4.E64)
        let byk = (p.rby1 + p.rby4 * s.gamma_star * s.gamma_star)
            * cos_of_atan(p.rby2 * (s.alpha_star - p.rby3))
            * p.lyka; // (4.E62)
        let svyk_per_mu = s.fz
            * (p.rvy1 + p.rvy2 * dfz + p.rvy3 * s.gamma_star)
            * cos_of_atan(p.rvy4 * s.alpha_star)
            * zeta.z2
            * p.lvyka
            * s.shift; // (4.E67)

        // All curves at once: y = Bx - E(Bx - arctan Bx), then sin or cos of C arctan y.
        let b = [
            bx * kappax,
            lateral.argument,
            flat.argument,
            bxa * (s.alpha_star + shxa),
            bxa * shxa,
            byk * (s.kappa + shyk),
            byk * shyk,
            p.rvy6 * s.kappa,
        ];
        let e = [ex, lateral.ey, flat.ey, exa, exa, eyk, eyk, 0.0];
        let inner = atan_all(b);
        let mut y = [0.0; 8];
        for i in 0..8 {
            y[i] = b[i] - e[i] * (b[i] - inner[i]);
        }
        let y = atan_all(y);
        let [fx0, fy0, flat_fy0, gxa, gxa0, gyk, gyk0, svyk] = sin_all([
            self.cx * y[0],
            self.cy * y[1],
            self.cy * y[2],
            FRAC_PI_2 + p.rcx1 * y[3],
            FRAC_PI_2 + p.rcx1 * y[4],
            FRAC_PI_2 + p.rcy1 * y[5],
            FRAC_PI_2 + p.rcy1 * y[6],
            p.rvy5 * y[7],
        ]);
        let fx0 = (dx * fx0 + svx) * if s.vcx < 0.0 { -1.0 } else { 1.0 }; // (4.E9)
        let gyk = gyk / gyk0; // (4.E59), (4.E60)
        let svyk = svyk_per_mu * svyk; // (4.E66)
        Forced {
            fx: gxa / gxa0 * fx0,                      // (4.E50)-(4.E52)
            fy: gyk * lateral.force(fy0) + muy * svyk, // (4.E58)
            fy_prime: gyk * flat.force(flat_fy0), // (4.E74) but for Gyk, which TNO leaves with its camber
            mux,
            muy,
            kxk,
            gyk,
            lateral,
            zeta,
        }
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
        let camber = if gs == 0.0 {
            0.0
        } else {
            ((p.qdz8 + p.qdz9 * dfz) * (1.0 + p.ppz2 * s.dpi) + (p.qdz10 + p.qdz11 * dfz) * gs.abs())
                * gs
                * p.lkzc
                * zeta.z0
        };
        let br = (p.qbz9 * p.lky / lmuy + p.qbz10 * lateral.by * self.cy) * zeta.z6; // (4.E45)

        // Equivalent slips (A54), (A55): tan² = sin²/(1 - sin²).
        let kappa = forced.kxk / kya_prime * s.kappa;
        let [sin_r, sin_t, cos_alpha] = sin_all([alphar, alphat, FRAC_PI_2 + s.alpha_star]);
        let equivalent = |sine: f64| (sine * sine / (1.0 - sine * sine).max(1e-32) + kappa * kappa).sqrt();
        let load = self.mx_load(s) * self.per_fz0;
        let [curved, alphar_eq, alphat_eq, load_squared, side_force, load] = atan_all([
            bt * ct * alphat,
            equivalent(sin_r),
            equivalent(sin_t),
            (p.qsx6 * load) * (p.qsx6 * load),
            p.qsx9 * (fy * self.per_fz0),
            p.qsx11 * load,
        ]);
        let (alphar_eq, alphat_eq) = (alphar_eq * sign(alphar), alphat_eq * sign(alphat));
        let et = (p.qez1 + p.qez2 * dfz + p.qez3 * dfz * dfz)
            * (1.0 + (p.qez4 + p.qez5 * gs) * FRAC_2_PI * curved); // (4.E44)
        let et = s.curvature(et);
        let btt = bt * alphat_eq;
        let btt = btt - et * (btt - atan(btt));
        let [residual, slope] = atan_all([br * alphar_eq, btt]);
        let [residual, slope, by_load, by_side] = sin_all([
            FRAC_PI_2 + zeta.z7 * residual,
            FRAC_PI_2 + ct * slope,
            FRAC_PI_2 + p.qsx5 * load_squared,
            p.qsx7 * s.gamma + p.qsx8 * side_force,
        ]);

        let dr = s.fz
            * r0
            * ((p.qdz6 + p.qdz7 * dfz) * p.lres * zeta.z2 + camber)
            * lmuy
            * sign(s.vcx)
            * cos_alpha
            + (zeta.z8 - 1.0); // (4.E47)
        let mzr = dr * residual * s.shift; // (4.E75)
        let trail = dt * slope * s.cos_alpha_prime * p.lfzo * s.shift; // (4.E73)
        let arm = r0 * (p.ssz1 + p.ssz2 * (fy * self.per_fz0) + (p.ssz3 + p.ssz4 * dfz) * gamma) * p.ls; // (A56)
        let fy_prime = forced.fy_prime + (fy - forced.fy);
        Outcome {
            fx,
            fy,
            mx: self.mx(s, fy, p.qsx4 * by_load * by_side + p.qsx10 * load * s.gamma),
            my,
            mz: -trail * fy_prime + mzr + arm * fx, // (4.E71), (4.E72)
            trail,
            mzr,
            mux: forced.mux,
            muy: forced.muy,
            kxk: forced.kxk,
            kya: lateral.kya,
        }
    }

    /// Load of Mx: below FZMIN it fades with its third power.
    #[inline(always)]
    fn mx_load(&self, s: &Slip) -> f64 {
        let ratio = (s.fz * self.per_fzmin).min(1.0);
        s.fz * ratio * ratio
    }

    /// Overturning moment (D49); `curves` are its terms with QSX4 and QSX10.
    #[inline(always)]
    fn mx(&self, s: &Slip, fy: f64, curves: f64) -> f64 {
        let p = &self.p;
        let gamma = s.gamma;
        p.unloaded_radius
            * p.lmx
            * (self.mx_load(s)
                * (p.qsx1 * p.lvmx
                    - p.qsx2 * gamma * (1.0 + p.ppmx1 * s.dpi)
                    - p.qsx12 * gamma * gamma.abs()
                    + p.qsx3 * (fy * self.per_fz0)
                    + curves)
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
            my *= sin(FRAC_PI_2 * (s.kappa + 1.0) / (high + 1.0));
        } else if s.kappa < low {
            my = -my;
        }
        my
    }
}
