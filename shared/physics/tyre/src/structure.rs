//! The tyre as a spring and a wheel: vertical force, loaded and effective rolling radius, contact patch, carcass
//! stiffnesses, relaxation lengths.
//!
//! "Paper" is Besselink, Schmeitz, Pacejka, Vehicle System Dynamics 48 sup. 1 (2010); (A3.n) Pacejka 3rd ed.
//! 2012, appendix 3; (M52), (M62) the MF-Tyre 5.2 and 6.2 equation manuals. MF 5.2 uses the vertical equations of
//! 6.1, whose extra terms its files do not have. Below the file's rim guard (`BOTTOM_OFFST`) a second spring
//! (`BOTTOM_STIFF`) acts in [`Structure::vertical_force`].

use crate::keys::Parameters;
use crate::math::{atan, exp};
use crate::tir::Version;

/// Bound of the two short iterations here; both converge in fewer than half of it.
const ITERATIONS: usize = 60;

/// Quotients that depend on the file only.
#[derive(Debug, Clone)]
pub(crate) struct Structure {
    p: Parameters,
    version: Version,
    /// Linear coefficient of load against relative deflection (paper, 4).
    q_fz1: f64,
    /// MF 5.2 contact length coefficients.
    q_a: [f64; 2],
}

impl Structure {
    pub fn new(p: &Parameters, version: Version) -> Self {
        let slope = p.vertical_stiffness * p.unloaded_radius / p.fnomin;
        let mut q_a = [p.q_a1, p.q_a2];
        if q_a == [0.0, 0.0] {
            // TNO's estimate where the file gives none, as mfeval 4.0 found it out.
            let y = slope.log10();
            q_a[0] = -0.0388 * y.powi(3) + 0.2509 * y.powi(2) - 0.6283 * y + 0.6279;
            q_a[1] = 1.693 * q_a[0] * q_a[0];
        }
        Self { p: p.clone(), version, q_fz1: (slope * slope - 4.0 * p.q_fz2).max(0.0).sqrt(), q_a }
    }

    /// Normalised load change (4.E2a).
    #[inline]
    pub fn dfz(&self, fz: f64) -> f64 {
        let fz0 = self.p.lfzo * self.p.fnomin;
        (fz - fz0) / fz0
    }

    /// Radius of the unloaded turning tyre (paper, 1). [m]
    #[inline]
    pub fn free_radius(&self, omega: f64) -> f64 {
        let p = &self.p;
        let growth = omega * p.unloaded_radius / p.longvl;
        p.unloaded_radius * (p.q_re0 + p.q_v1 * growth * growth)
    }

    /// Effective rolling radius (paper, 7). [m]
    #[inline]
    pub fn effective_radius(&self, fz: f64, omega: f64, dpi: f64) -> f64 {
        let p = &self.p;
        let load = fz / p.fnomin;
        let cz = p.vertical_stiffness * (1.0 + p.pfz1 * dpi);
        let re = self.free_radius(omega) - p.fnomin / cz * (p.dreff * atan(p.breff * load) + p.freff * load);
        re.max(p.rim_radius)
    }

    /// Effective rolling radius and wheel speed of a wheel that rolls at `vcx` with slip `kappa` (2.5).
    pub fn rolling(&self, fz: f64, kappa: f64, vcx: f64, dpi: f64) -> (f64, f64) {
        let mut re = 0.965 * self.p.unloaded_radius;
        let mut omega = 0.0;
        for _ in 0..ITERATIONS {
            omega = (1.0 + kappa) * vcx / re;
            let next = self.effective_radius(fz, omega, dpi);
            let step = (next - re).abs();
            re = next;
            if step <= 1e-12 {
                break;
            }
        }
        (re, omega)
    }

    /// Factor of speed, tangential forces and pressure on the vertical spring (A3.3). Never below a tenth, so that
    /// the spring stays a spring.
    #[inline]
    fn correction(&self, omega: f64, fx: f64, fy: f64, dpi: f64) -> f64 {
        let p = &self.p;
        let x = p.q_fcx * fx / p.fnomin;
        let y = p.q_fcy * fy / p.fnomin;
        (1.0 + p.q_v2 * (p.unloaded_radius / p.longvl) * omega.abs() - x * x - y * y).max(0.1)
            * (1.0 + p.pfz1 * dpi)
    }

    /// Elastic vertical force at a deflection of the free-turning radius. [N]
    #[inline]
    pub fn vertical_force(&self, deflection: f64, omega: f64, fx: f64, fy: f64, dpi: f64) -> f64 {
        if deflection <= 0.0 {
            return 0.0;
        }
        let p = &self.p;
        let d = deflection / p.unloaded_radius;
        let tread = (d * (self.q_fz1 + p.q_fz2 * d)) * self.correction(omega, fx, fy, dpi) * p.fnomin;
        let bottom = deflection - (p.unloaded_radius - p.rim_radius - p.bottom_offst);
        tread + if bottom > 0.0 { p.bottom_stiff * bottom } else { 0.0 }
    }

    /// Derivative of [`Self::vertical_force`]. [N/m]
    #[inline]
    pub fn vertical_stiffness(&self, deflection: f64, omega: f64, dpi: f64) -> f64 {
        let p = &self.p;
        let d = deflection.max(0.0) / p.unloaded_radius;
        let tread = (self.q_fz1 + 2.0 * p.q_fz2 * d) * self.correction(omega, 0.0, 0.0, dpi) * p.fnomin
            / p.unloaded_radius;
        let bottom = deflection - (p.unloaded_radius - p.rim_radius - p.bottom_offst);
        tread + if bottom > 0.0 { p.bottom_stiff } else { 0.0 }
    }

    /// Deflection and loaded radius under a load. [m]
    pub fn deflection(&self, fz: f64, omega: f64, fx: f64, fy: f64, gamma: f64, dpi: f64) -> (f64, f64) {
        if self.version == Version::Mf62 {
            return self.deflection62(fz, omega, fx, fy, gamma, dpi);
        }
        let p = &self.p;
        let c = fz / (self.correction(omega, fx, fy, dpi) * p.fnomin);
        let root = (self.q_fz1 * self.q_fz1 + 4.0 * p.q_fz2 * c).max(0.0).sqrt();
        // The stable form of (-B + sqrt(B² - 4AC)) / 2A.
        let rho = (2.0 * c / (self.q_fz1 + root) * p.unloaded_radius).max(0.0);
        (rho, (self.free_radius(omega) - rho).max(0.0))
    }

    /// Vertical force at a loaded radius (M62), and the deflection it belongs to.
    fn vertical_force62(&self, rl: f64, omega: f64, fx: f64, fy: f64, gamma: f64, dpi: f64) -> (f64, f64) {
        let p = &self.p;
        let free = self.free_radius(omega);
        let r0 = p.unloaded_radius;
        let ratio = rl / free;
        let sfyg = (p.q_fys1 + p.q_fys2 * ratio + p.q_fys3 * ratio * ratio) * gamma;
        let flat = (free - rl).max(0.0);
        let tread_width = (1.075 - 0.5 * p.aspect_ratio) * p.width;
        let at_load = (p.q_cam1 * rl + p.q_cam2 * rl * rl) * gamma;
        let at_free = (p.q_cam1 * free + p.q_cam2 * free * free) * gamma;
        let by_camber = if at_free == 0.0 {
            0.0
        } else {
            at_load * at_load * (tread_width / 8.0) * gamma.tan().abs() / (at_free * at_free)
                - p.q_cam3 * flat * gamma.abs()
        };
        let rho = (flat + by_camber).max(0.0);
        let d = rho / r0;
        let x = p.q_fcx * fx / p.fnomin;
        let y = d.powf(p.q_fcy2) * (p.q_fcy * (fy - sfyg) / p.fnomin);
        let factor =
            (1.0 + p.q_v2 * (r0 / p.longvl) * omega.abs() - x * x - if rho > 0.0 { y * y } else { 0.0 })
                * (1.0 + p.pfz1 * dpi);
        (factor * d * (self.q_fz1 + p.q_fz2 * d) * p.fnomin, rho)
    }

    /// Bisection of (M62) for the loaded radius, from the free radius down to the first radius that carries `fz`.
    fn deflection62(&self, fz: f64, omega: f64, fx: f64, fy: f64, gamma: f64, dpi: f64) -> (f64, f64) {
        let free = self.free_radius(omega);
        // The first step downwards that carries the load; else the one that carries most.
        let steps = 32;
        let (mut low, mut high) = (0.2 * free, free);
        let mut most = (f64::NEG_INFINITY, free);
        for i in 1..=steps {
            let rl = free * (1.0 - 0.8 * f64::from(i) / f64::from(steps));
            let (force, _) = self.vertical_force62(rl, omega, fx, fy, gamma, dpi);
            if force >= fz {
                low = rl;
                break;
            }
            high = rl;
            if force > most.0 {
                most = (force, rl);
            }
            if i == steps {
                let rl = most.1;
                return (self.vertical_force62(rl, omega, fx, fy, gamma, dpi).1, rl);
            }
        }
        for _ in 0..ITERATIONS {
            let middle = 0.5 * (low + high);
            if self.vertical_force62(middle, omega, fx, fy, gamma, dpi).0 >= fz {
                low = middle;
            } else {
                high = middle;
            }
        }
        let rl = 0.5 * (low + high);
        (self.vertical_force62(rl, omega, fx, fy, gamma, dpi).1, rl)
    }

    /// Half length and half width of the contact patch (paper, 9, 10; M52). [m]
    pub fn contact_patch(&self, fz: f64, dpi: f64) -> (f64, f64) {
        let p = &self.p;
        let r0 = p.unloaded_radius;
        let cz = p.vertical_stiffness * (1.0 + p.pfz1 * dpi);
        // No longer patch once the rim bottoms.
        let fz = if r0 - fz / cz < p.rim_radius + p.bottom_offst {
            ((r0 - p.rim_radius - p.bottom_offst) * cz).max(0.0)
        } else {
            fz
        };
        if self.version == Version::Mf52 {
            let load = fz / p.fnomin;
            (r0 * (self.q_a[1] * load + self.q_a[0] * load.sqrt()), 0.5 * p.width)
        } else {
            let d = fz / (cz * r0);
            (r0 * (p.q_ra2 * d + p.q_ra1 * d.sqrt()), p.width * (p.q_rb2 * d + p.q_rb1 * d.cbrt()))
        }
    }

    /// Overall longitudinal and lateral stiffness of the carcass (paper, 17, 18). [N/m]
    #[inline]
    pub fn carcass(&self, dfz: f64, dpi: f64) -> [f64; 2] {
        let p = &self.p;
        [
            p.longitudinal_stiffness * (1.0 + p.pcfx1 * dfz + p.pcfx2 * dfz * dfz) * (1.0 + p.pcfx3 * dpi),
            p.lateral_stiffness * (1.0 + p.pcfy1 * dfz + p.pcfy2 * dfz * dfz) * (1.0 + p.pcfy3 * dpi),
        ]
    }

    /// Relaxation lengths (paper, 19; M52) from the slip stiffnesses at this load. [m]
    #[inline]
    pub fn relaxation(&self, fz: f64, gamma: f64, dpi: f64, kxk: f64, kya: f64) -> [f64; 2] {
        let p = &self.p;
        let dfz = self.dfz(fz);
        if self.version == Version::Mf52 {
            let load = fz / p.fnomin;
            let x = (p.ptx1 + p.ptx2 * dfz) * exp(-p.ptx3 * dfz) * p.lsgkp * p.unloaded_radius * load;
            let f = fz / (p.pty2 * p.lfzo * p.fnomin);
            let lateral = if p.pty2 == 0.0 { 0.0 } else { 2.0 * f / (1.0 + f * f) };
            let y = p.pty1 * lateral * (1.0 - p.pky3 * gamma.abs()) * p.unloaded_radius * p.lfzo * p.lsgal;
            [x, y]
        } else {
            let [cx, cy] = self.carcass(dfz, dpi);
            [(kxk / cx).abs(), (kya / cy).abs()]
        }
    }

    /// Whether relaxation along x (0) or y (1) is a length of its own in the file, not slip over carcass stiffness.
    #[inline]
    pub fn has_load_relaxation(&self, axis: usize) -> bool {
        self.version == Version::Mf52 && [self.p.ptx1, self.p.pty1][axis] != 0.0
    }

    /// Yaw stiffness of the standing tyre. [N m/rad]
    pub fn yaw_stiffness(&self, dpi: f64) -> f64 {
        self.p.yaw_stiffness * (1.0 + self.p.pcmz1 * dpi)
    }

    /// Largest turning moment of the standing tyre per unit of friction: (4.95) where the file has turn slip, else
    /// that of evenly pressed, fully sliding tread of the contact width, `w/sqrt 8` per newton. [N m]
    pub fn parking_moment(&self, fz: f64, has_turn_slip: bool) -> f64 {
        let p = &self.p;
        if has_turn_slip {
            p.qcrp1 * p.unloaded_radius * fz * (fz / (p.lfzo * p.fnomin)).sqrt() * p.lmp
        } else {
            fz * p.width / 8.0_f64.sqrt()
        }
    }
}
