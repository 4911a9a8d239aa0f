//! The tyre as its users see it: parameters from a property file, forces at a contact, shape under load.
//!
//! Frames and signs: ISO-W, see the crate. Evaluation is pure; nothing allocates after reading.

use crate::formula::{Formula, Outcome, Slip};
use crate::keys::Parameters;
use crate::law::Law;
use crate::math::{sign, sin, tan};
use crate::structure::Structure;
use crate::table;
use crate::tir::{self, Side, Substituted, TirError, Version};
use crate::turn_slip::Spin;

/// A micro-radian short of sideways, where tan α ends.
const SLIP_ANGLE_MAX: f64 = std::f64::consts::FRAC_PI_2 - 1e-6;

/// How slip enters the formula; the numbers are those of the usual tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UseMode {
    /// 211: α and γ as they are, as MF-Tyre does.
    SmallAngle,
    /// 221: `α* = tan α sgn Vx`, `γ* = sin γ`, as the book does; for large angles and reverse.
    AlphaStar,
    /// 212: as 211, with turn slip.
    SmallAngleTurnSlip,
    /// 222: as 221, with turn slip.
    AlphaStarTurnSlip,
}

impl UseMode {
    /// The mode of a number, `None` for one that is not 211, 221, 212 or 222.
    #[must_use]
    pub fn from_number(number: u32) -> Option<Self> {
        Some(match number {
            211 => Self::SmallAngle,
            221 => Self::AlphaStar,
            212 => Self::SmallAngleTurnSlip,
            222 => Self::AlphaStarTurnSlip,
            _ => return None,
        })
    }

    pub(crate) fn alpha_star(self) -> bool {
        matches!(self, Self::AlphaStar | Self::AlphaStarTurnSlip)
    }

    pub(crate) fn turn_slip(self) -> bool {
        matches!(self, Self::SmallAngleTurnSlip | Self::AlphaStarTurnSlip)
    }
}

/// A rolling contact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Vertical load. [N], ≥ 0 (below: as 0)
    pub vertical_load_n: f64,
    /// `κ = -Vsx/Vcx`; -1 is a locked wheel, > 0 drives.
    pub slip_ratio: f64,
    /// `tan α = Vcy/|Vcx|`. [rad], (-π/2, π/2)
    pub slip_angle_rad: f64,
    /// Camber (inclination). [rad]
    pub camber_rad: f64,
    /// Turn slip, used in the modes with turn slip only. [1/m]
    pub turn_slip_per_m: f64,
    /// Longitudinal speed of the contact centre, < 0 in reverse. [m/s]
    pub speed_m_s: f64,
    /// Inflation pressure. [Pa]
    pub pressure_pa: f64,
    /// Scale of the road's friction along x and y on top of the file's; 1 on the road of the test. (0, 10]
    pub friction_scale: [f64; 2],
}

/// Forces and moments of the road on the wheel at the contact centre, ISO-W.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Forces {
    /// Longitudinal force. [N]
    pub fx_n: f64,
    /// Lateral force. [N]
    pub fy_n: f64,
    /// Overturning moment. [N m]
    pub mx_n_m: f64,
    /// Rolling resistance moment; < 0 rolling forward. [N m]
    pub my_n_m: f64,
    /// Aligning torque. [N m]
    pub mz_n_m: f64,
    /// Pneumatic trail. [m]
    pub trail_m: f64,
    /// Residual torque, part of Mz. [N m]
    pub residual_torque_n_m: f64,
    /// Peak friction coefficient along x (signed as the file's).
    pub mu_x: f64,
    /// Peak friction coefficient along y (signed as the file's).
    pub mu_y: f64,
    /// dFx/dκ at zero slip and this load. [N]
    pub longitudinal_slip_stiffness_n: f64,
    /// dFy/dα at zero slip and this load and camber; < 0 for files in ISO signs. [N/rad]
    pub cornering_stiffness_n_rad: f64,
}

/// Radii, patch and stiffnesses at a contact.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shape {
    /// Effective rolling radius. [m]
    pub effective_rolling_radius_m: f64,
    /// Wheel speed at the given slip. [rad/s]
    pub wheel_speed_rad_s: f64,
    /// Vertical deflection. [m]
    pub deflection_m: f64,
    /// Loaded radius. [m]
    pub loaded_radius_m: f64,
    /// Load over deflection. [N/m]
    pub vertical_stiffness_n_m: f64,
    /// Length of the contact patch. [m]
    pub contact_length_m: f64,
    /// Width of the contact patch. [m]
    pub contact_width_m: f64,
    /// Overall longitudinal carcass stiffness. [N/m]
    pub longitudinal_stiffness_n_m: f64,
    /// Overall lateral carcass stiffness. [N/m]
    pub lateral_stiffness_n_m: f64,
    /// Relaxation lengths along x and y. [m]
    pub relaxation_length_m: [f64; 2],
}

/// What a file says of itself and what was taken where it is silent.
#[derive(Debug, Clone, PartialEq)]
pub struct TyreInfo {
    /// Name of the file, as given to the reader.
    pub file_name: String,
    /// Formula version.
    pub version: Version,
    /// Side it was measured for, if told.
    pub side: Option<Side>,
    /// Whether the file has turn slip coefficients.
    pub has_turn_slip: bool,
    /// Whether this tyre is the mirror image of the file's.
    pub is_mirrored: bool,
    /// Unloaded radius. [m]
    pub unloaded_radius_m: f64,
    /// Section width. [m]
    pub width_m: f64,
    /// Rim radius. [m]
    pub rim_radius_m: f64,
    /// Nominal load. [N]
    pub nominal_load_n: f64,
    /// Inflation pressure that the file asks for. [Pa]
    pub inflation_pressure_pa: f64,
    /// Nominal pressure of the coefficients. [Pa]
    pub nominal_pressure_pa: f64,
    /// Loads the coefficients are valid for. [N]
    pub load_range_n: [f64; 2],
    /// Camber angles the coefficients are valid for. [rad]
    pub camber_range_rad: [f64; 2],
    /// Vertical stiffness at nominal load and pressure. [N/m]
    pub vertical_stiffness_n_m: f64,
    /// Vertical damping. [N s/m]
    pub vertical_damping_n_s_m: f64,
    /// Keys the file leaves out and the values taken.
    pub substituted: Vec<Substituted>,
}

/// Immutable parameters of one tyre.
#[derive(Debug, Clone)]
pub struct Tyre {
    pub(crate) p: Parameters,
    pub(crate) law: Law,
    pub(crate) structure: Structure,
    pub(crate) info: TyreInfo,
    /// -1 for a mirror image, else 1.
    pub(crate) hand: f64,
    /// Load up to which the friction coefficients stay sound. [N]
    pub(crate) load_limit: f64,
}

impl Tyre {
    /// Reads a property file. `file_name` is for messages only.
    ///
    /// # Errors
    /// All violations of the file: unknown and missing keys, values out of range, lines that are no key.
    pub fn from_tir(text: &str, file_name: &str) -> Result<Self, Vec<TirError>> {
        let file = tir::read(text, file_name)?;
        let mut p = file.parameters;
        if file.version != Version::Mf52 {
            // Scale factors of camber are keys of MF 5.2 / PAC2002 alone.
            (p.lgax, p.lgay, p.lgaz) = (1.0, 1.0, 1.0);
        }
        let load_limit = load_limit(&p);
        let law = Law::Magic(Box::new(Formula::new(&p, file.version)));
        let info = TyreInfo {
            version: file.version,
            side: file.side,
            has_turn_slip: file.has_turn_slip,
            substituted: file.substituted,
            ..info(&p, file_name)
        };
        Ok(Self { law, structure: Structure::new(&p, file.version), info, hand: 1.0, load_limit, p })
    }

    /// Reads a table tyre (TOML). `file_name` is for messages only.
    ///
    /// # Errors
    /// All violations of the file.
    pub fn from_table(text: &str, file_name: &str) -> Result<Self, Vec<TirError>> {
        let (law, p) = table::read(text, file_name)?;
        Ok(Self {
            law: Law::Table(Box::new(law)),
            structure: Structure::new(&p, Version::Mf61),
            info: TyreInfo { version: Version::Table, ..info(&p, file_name) },
            hand: 1.0,
            load_limit: p.fzmax,
            p,
        })
    }

    /// Reads a tyre by the ending of its file's name: `.toml` a table tyre, else a property file.
    ///
    /// # Errors
    /// All violations of the file.
    pub fn from_text(text: &str, file_name: &str) -> Result<Self, Vec<TirError>> {
        if file_name.to_ascii_lowercase().ends_with(".toml") {
            Self::from_table(text, file_name)
        } else {
            Self::from_tir(text, file_name)
        }
    }

    /// This tyre as it stands on `side`: the mirror image where the file is for the other side.
    #[must_use]
    pub fn on_side(&self, side: Side) -> Self {
        let mut tyre = self.clone();
        tyre.info.is_mirrored = self.info.side.is_some_and(|of_file| of_file != side);
        tyre.hand = if tyre.info.is_mirrored { -1.0 } else { 1.0 };
        tyre
    }

    /// This tyre with the constant shifts of its lateral force (PHY1, PVY1) reversed: for models that take the sign of
    /// camber into the shifts. Table tyres stay as they are.
    #[must_use]
    pub fn with_reversed_shifts(&self) -> Self {
        let mut tyre = self.clone();
        if let Law::Magic(_) = tyre.law {
            (tyre.p.phy1, tyre.p.pvy1) = (-self.p.phy1, -self.p.pvy1);
            tyre.law = Law::Magic(Box::new(Formula::new(&tyre.p, self.info.version)));
        }
        tyre
    }

    /// What the file says of itself.
    #[must_use]
    pub fn info(&self) -> &TyreInfo {
        &self.info
    }

    /// Forces and moments of steady rolling. Inputs are taken as they are, not limited to the file's ranges. A
    /// load ≤ 0 gives none. Finite inputs give finite forces.
    #[must_use]
    pub fn steady_state(&self, c: &Contact, mode: UseMode) -> Forces {
        // Beyond these bounds nothing is said of a tyre; they keep the powers finite.
        let fz = c.vertical_load_n.min(1e3 * self.p.fnomin);
        if fz <= 0.0 || c.vertical_load_n.is_nan() {
            return Forces::default();
        }
        let gamma = self.hand * c.camber_rad.clamp(-1.5, 1.5);
        let alpha = self.hand * c.slip_angle_rad.clamp(-SLIP_ANGLE_MAX, SLIP_ANGLE_MAX);
        let kappa = c.slip_ratio.clamp(-1e3, 1e3);
        let vcx = c.speed_m_s.clamp(-1e3, 1e3);
        let pressure_ratio = (c.pressure_pa / self.p.nompres).clamp(1e-3, 1e3);
        let tan_alpha = tan(alpha);
        let (alpha_star, gamma_star) =
            if mode.alpha_star() { (tan_alpha * sign(vcx), sin(gamma)) } else { (alpha, gamma) };
        let vc = vcx.abs() * (1.0 + tan_alpha * tan_alpha).sqrt();
        let slip = Slip {
            fz,
            kappa,
            alpha_star,
            tan_alpha,
            gamma,
            gamma_star,
            cos_alpha_prime: vcx / (vc + 1e-6), // (4.E6), (4.E6a)
            vcx,
            dpi: pressure_ratio - 1.0,
            pressure_ratio,
            mu_scale: c.friction_scale.map(|s| s.clamp(1e-3, 10.0)),
            turn_fy: mode.alpha_star() && vcx < 0.0,
            shift: 1.0,
            limit_curvature: false,
        };
        let spin = mode.turn_slip().then(|| {
            let phi_t = self.hand * c.turn_slip_per_m.clamp(-1e3, 1e3);
            let (_, omega) = self.structure.rolling(fz, kappa, vcx, slip.dpi);
            Spin::new(&self.p, phi_t, gamma, omega, vc, vcx, self.structure.dfz(fz))
        });
        let forced = self.law.forces(&slip, spin.as_ref());
        let outcome = self.law.moments(
            &slip,
            spin.as_ref(),
            &forced,
            forced.fx,
            forced.fy,
            self.law.my(&slip, forced.fx),
        );
        self.outward(&outcome)
    }

    /// Back from the file's side to the wheel's.
    #[inline]
    pub(crate) fn outward(&self, o: &Outcome) -> Forces {
        Forces {
            fx_n: o.fx,
            fy_n: self.hand * o.fy,
            mx_n_m: self.hand * o.mx,
            my_n_m: o.my,
            mz_n_m: self.hand * o.mz,
            trail_m: o.trail,
            residual_torque_n_m: self.hand * o.mzr,
            mu_x: o.mux,
            mu_y: o.muy,
            longitudinal_slip_stiffness_n: o.kxk,
            cornering_stiffness_n_rad: o.kya,
        }
    }

    #[inline]
    pub(crate) fn dpi(&self, pressure_pa: f64) -> f64 {
        (pressure_pa / self.p.nompres).clamp(1e-3, 1e3) - 1.0
    }

    /// Radii, patch, stiffnesses and relaxation lengths at a contact with the forces `f` on it.
    #[must_use]
    pub fn shape(&self, c: &Contact, f: &Forces) -> Shape {
        let fz = c.vertical_load_n.clamp(0.0, 1e3 * self.p.fnomin);
        let dpi = self.dpi(c.pressure_pa);
        let gamma = self.hand * c.camber_rad.clamp(-1.5, 1.5);
        let (re, omega) =
            self.structure.rolling(fz, c.slip_ratio.clamp(-1e3, 1e3), c.speed_m_s.clamp(-1e3, 1e3), dpi);
        let (rho, rl) = self.structure.deflection(fz, omega, f.fx_n, self.hand * f.fy_n, gamma, dpi);
        let (a, b) = self.structure.contact_patch(fz, dpi);
        let [cx, cy] = self.structure.carcass(self.structure.dfz(fz), dpi);
        Shape {
            effective_rolling_radius_m: re,
            wheel_speed_rad_s: omega,
            deflection_m: rho,
            loaded_radius_m: rl,
            vertical_stiffness_n_m: if rho > 0.0 {
                fz / rho
            } else {
                self.structure.vertical_stiffness(0.0, omega, dpi)
            },
            contact_length_m: 2.0 * a,
            contact_width_m: 2.0 * b,
            longitudinal_stiffness_n_m: cx,
            lateral_stiffness_n_m: cy,
            relaxation_length_m: self.structure.relaxation(
                fz,
                gamma,
                dpi,
                f.longitudinal_slip_stiffness_n,
                f.cornering_stiffness_n_rad,
            ),
        }
    }

    /// Vertical force of the tyre, spring and damper, never pulling. [N]
    ///
    /// `deflection_m`: free-turning radius minus loaded radius, > 0 in contact; `rate_m_s`: its derivative;
    /// `fx_n`, `fy_n`: tangential forces (of the last step will do), which soften the spring.
    #[must_use]
    pub fn vertical_force_n(
        &self,
        deflection_m: f64,
        rate_m_s: f64,
        omega_rad_s: f64,
        fx_n: f64,
        fy_n: f64,
        pressure_pa: f64,
    ) -> f64 {
        if deflection_m <= 0.0 || deflection_m.is_nan() {
            return 0.0;
        }
        let spring =
            self.structure.vertical_force(deflection_m, omega_rad_s, fx_n, fy_n, self.dpi(pressure_pa));
        (spring + self.p.vertical_damping * rate_m_s).max(0.0)
    }

    /// Slope of the vertical spring at a deflection. [N/m]
    #[must_use]
    pub fn vertical_stiffness_n_m(&self, deflection_m: f64, omega_rad_s: f64, pressure_pa: f64) -> f64 {
        self.structure.vertical_stiffness(deflection_m, omega_rad_s, self.dpi(pressure_pa))
    }

    /// Radius of the unloaded tyre at a wheel speed. [m]
    #[must_use]
    pub fn free_radius_m(&self, omega_rad_s: f64) -> f64 {
        self.structure.free_radius(omega_rad_s)
    }

    /// Loaded radius under a load, without tangential forces. [m]
    #[must_use]
    pub fn loaded_radius_m(&self, fz_n: f64, omega_rad_s: f64, camber_rad: f64, pressure_pa: f64) -> f64 {
        let fz = fz_n.clamp(0.0, 1e3 * self.p.fnomin);
        self.structure.deflection(fz, omega_rad_s, 0.0, 0.0, self.hand * camber_rad, self.dpi(pressure_pa)).1
    }

    /// Effective rolling radius. [m]
    #[must_use]
    pub fn effective_rolling_radius_m(&self, fz_n: f64, omega_rad_s: f64, pressure_pa: f64) -> f64 {
        let fz = fz_n.clamp(0.0, 1e3 * self.p.fnomin);
        self.structure.effective_radius(fz, omega_rad_s, self.dpi(pressure_pa))
    }

    /// Length of the contact patch. [m]
    #[must_use]
    pub fn contact_length_m(&self, fz_n: f64, pressure_pa: f64) -> f64 {
        2.0 * self.structure.contact_patch(fz_n.clamp(0.0, 1e3 * self.p.fnomin), self.dpi(pressure_pa)).0
    }

    /// Overall carcass stiffnesses along x and y at a load. [N/m]
    #[must_use]
    pub fn carcass_stiffness_n_m(&self, fz_n: f64, pressure_pa: f64) -> [f64; 2] {
        self.structure.carcass(self.structure.dfz(fz_n), self.dpi(pressure_pa))
    }

    /// Relaxation lengths along x and y at a load and camber. [m]
    #[must_use]
    pub fn relaxation_length_m(&self, fz_n: f64, camber_rad: f64, pressure_pa: f64) -> [f64; 2] {
        let fz = fz_n.clamp(0.0, 1e3 * self.p.fnomin);
        let dpi = self.dpi(pressure_pa);
        let gamma = self.hand * camber_rad;
        let kxk = self.law.kxk(fz, dpi);
        let kya = self.law.kya(fz, dpi, gamma);
        self.structure.relaxation(fz, gamma, dpi, kxk, kya)
    }
}

/// What the parameters say of themselves.
fn info(p: &Parameters, file_name: &str) -> TyreInfo {
    TyreInfo {
        file_name: file_name.to_owned(),
        version: Version::Mf61,
        side: None,
        has_turn_slip: false,
        is_mirrored: false,
        unloaded_radius_m: p.unloaded_radius,
        width_m: p.width,
        rim_radius_m: p.rim_radius,
        nominal_load_n: p.fnomin,
        inflation_pressure_pa: p.inflpres,
        nominal_pressure_pa: p.nompres,
        load_range_n: [p.fzmin, p.fzmax],
        camber_range_rad: [p.cammin, p.cammax],
        vertical_stiffness_n_m: p.vertical_stiffness,
        vertical_damping_n_s_m: p.vertical_damping,
        substituted: Vec::new(),
    }
}

/// Load at which either friction coefficient has fallen to 40 % of its nominal value, or the file's FZMAX.
fn load_limit(p: &Parameters) -> f64 {
    let fz0 = p.lfzo * p.fnomin;
    let at = |d1: f64, d2: f64| {
        let slope = d2 / d1;
        if slope < 0.0 { fz0 * (1.0 - 0.6 / slope) } else { f64::INFINITY }
    };
    p.fzmax.max(1.5 * fz0).min(at(p.pdx1, p.pdx2)).min(at(p.pdy1, p.pdy2))
}
