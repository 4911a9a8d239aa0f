//! Transient tyre: carcass deflection between rim and road, from standstill to full speed, forward and reverse.
//!
//! Model. The tangential force is that of the carcass springs, `F_i = C_i e_i`; the contact patch slides against
//! the road with `V'_i = Vs_i + de_i/dt`. With the steady force F_ss(Vs/|Vx|) of the Magic Formula,
//! the patch's sliding speed is taken by the secant, which gives the first-order equation
//! `de_i/dt = λ_i (F_ss,i/C_i - e_i)`, `λ_i = max(|Vx|, |K Vs|/F_ref)/σ_i`:
//! - at small slip λ = |Vx|/σ, the usual relaxation length (Pacejka 3rd ed. 2012, §7.2);
//! - at large slip λ = C|Vs|/F, Dahl's friction law, which holds on at Vx = 0 (same, §7.3, §8.6).
//!
//! Towards standstill with gross sliding the drive becomes -Vs and the release acts only while the patch is loaded
//! further, with the fourth power of the used friction (elasto-plastic: small movements do not creep). Stored
//! energy is `Σ ½ C_i e_i²`; a change of load or pressure never raises it. A damper, proportional to the
//! stiffness, acts below the file's VXLOW and never beyond the friction limit. Discretisation is exact for inputs
//! that stay constant over the step; the force returned is that at its end.
//! A step that would make more energy than rolling resistance
//! takes (the formula's shifts and weighting functions can) is drawn back to the one that does not.
//! The formula's load, camber and curvature are kept in the range where its forces oppose the slip; above the
//! load limit forces grow in proportion to load.
//! Parking torque: a yaw spring with the same release, limited by friction, faded out above VXLOW.
//! Not modelled: contact patch mass, belt dynamics, temperature.

use crate::formula::Slip;
use crate::math::{atan, exp, sin};
use crate::model::{Forces, Tyre, UseMode};
use crate::turn_slip::Spin;

/// Largest slip the formula is asked for at standstill, where slip loses its meaning.
const SLIP_MAX: f64 = 1.5;
/// Ratio of damping of the standing tyre to the critical one of the mass that its load belongs to.
const DAMPING_RATIO: f64 = 0.15;
/// Shape factor of the curve without shifts that bounds the secant from below.
const SHAPE: f64 = 1.6;
/// Gravity, for that mass. [m/s²]
const GRAVITY: f64 = 9.81;

/// State of one rolling tyre.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TransientState {
    /// Longitudinal carcass deflection; > 0 pulls the wheel forward. [m]
    pub u_m: f64,
    /// Lateral carcass deflection; > 0 pulls the wheel to its left. [m]
    pub v_m: f64,
    /// Carcass stiffnesses the deflections belong to; 0 before the first step. [N/m]
    pub stiffness_n_m: [f64; 2],
    /// κ as the aligning torque sees it.
    pub slip_ratio: f64,
    /// tan α as the aligning torque sees it.
    pub slip_tangent: f64,
    /// Yaw deflection of the standing patch. [rad]
    pub yaw_rad: f64,
}

impl TransientState {
    /// Number of values of a saved state.
    pub const LEN: usize = 7;

    /// Writes the state into the first [`Self::LEN`] values of `to`.
    pub fn save_state(&self, to: &mut [f64]) {
        let [cx, cy] = self.stiffness_n_m;
        to[..Self::LEN].copy_from_slice(&[
            self.u_m,
            self.v_m,
            cx,
            cy,
            self.slip_ratio,
            self.slip_tangent,
            self.yaw_rad,
        ]);
    }

    /// Restores what [`Self::save_state`] wrote.
    pub fn load_state(&mut self, from: &[f64]) {
        *self = Self {
            u_m: from[0],
            v_m: from[1],
            stiffness_n_m: [from[2], from[3]],
            slip_ratio: from[4],
            slip_tangent: from[5],
            yaw_rad: from[6],
        };
    }

    /// Elastic energy stored in the carcass along x and y. [J]
    #[must_use]
    pub fn energy_j(&self) -> f64 {
        0.5 * (self.stiffness_n_m[0] * self.u_m * self.u_m + self.stiffness_n_m[1] * self.v_m * self.v_m)
    }
}

/// Motion of the wheel over the road for one step, at the contact centre, ISO-W.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Vertical load. [N]
    pub vertical_load_n: f64,
    /// Longitudinal speed Vcx of the contact centre. [m/s]
    pub speed_m_s: f64,
    /// Longitudinal slip speed `Vsx = Vcx - ω Re`. [m/s]
    pub slip_speed_x_m_s: f64,
    /// Lateral slip speed `Vsy`, > 0 to the left. [m/s]
    pub slip_speed_y_m_s: f64,
    /// Turning rate of the wheel plane about the vertical, > 0 to the left. [rad/s]
    pub spin_rate_rad_s: f64,
    /// Camber. [rad]
    pub camber_rad: f64,
    /// Inflation pressure. [Pa]
    pub pressure_pa: f64,
    /// Scale of the road's friction along x and y. (0, 10]
    pub friction_scale: [f64; 2],
}

impl Motion {
    fn is_finite(&self) -> bool {
        [
            self.vertical_load_n,
            self.speed_m_s,
            self.slip_speed_x_m_s,
            self.slip_speed_y_m_s,
            self.spin_rate_rad_s,
            self.camber_rad,
            self.pressure_pa,
            self.friction_scale[0],
            self.friction_scale[1],
        ]
        .iter()
        .all(|v| v.is_finite())
    }
}

impl Tyre {
    /// Advances the transient tyre by `dt_s` and returns forces and moments at the end of the step.
    ///
    /// Regular at any speed including zero. A load ≤ 0 gives no force and forgets the deflection. Finite inputs
    /// give finite forces; with any other the state stays and the forces are zero.
    pub fn transient_step(&self, state: &mut TransientState, m: &Motion, mode: UseMode, dt_s: f64) -> Forces {
        let load = m.vertical_load_n.min(1e3 * self.p.fnomin);
        if !m.is_finite() || !dt_s.is_finite() {
            return Forces::default();
        }
        if load <= 0.0 {
            *state = TransientState::default();
            return Forces::default();
        }
        let fz = load.min(self.load_limit);
        let scale = load / fz;
        let p = &self.p;
        let vcx = m.speed_m_s.clamp(-1e3, 1e3);
        let vs = [m.slip_speed_x_m_s.clamp(-1e4, 1e4), self.hand * m.slip_speed_y_m_s.clamp(-1e4, 1e4)];
        let gamma = (self.hand * m.camber_rad).clamp(p.cammin.max(-0.5), p.cammax.min(0.5));
        let pressure_ratio = (m.pressure_pa / p.nompres).clamp(p.presmin / p.nompres, p.presmax / p.nompres);
        let dpi = pressure_ratio - 1.0;
        let mu_scale = m.friction_scale.map(|s| s.clamp(1e-3, 10.0));

        // Slip: Vs over |Vx|, but never more than SLIP_MAX, so that it has a direction at standstill.
        let speed = vcx.abs();
        let slip_speed = (vs[0] * vs[0] + vs[1] * vs[1]).sqrt();
        let per_v = 1.0 / speed.max(slip_speed / SLIP_MAX).max(1e-12);
        let heading = if vcx < 0.0 { -1.0 } else { 1.0 };
        let (slip_ratio, slip_tangent) = (-vs[0] * heading * per_v, vs[1] * per_v);
        let rolling = (speed / p.vxlow).min(1.0);
        // 0 at standstill, 1 above VXLOW, smooth: ½ (1 - cos πx).
        let shift = if rolling < 1.0 { sin(std::f64::consts::FRAC_PI_2 * rolling).powi(2) } else { 1.0 };
        let slip_at = |slip_ratio: f64, slip_tangent: f64| Slip {
            fz,
            kappa: slip_ratio,
            alpha_star: if mode.alpha_star() { slip_tangent * heading } else { atan(slip_tangent) },
            tan_alpha: slip_tangent,
            gamma,
            gamma_star: if mode.alpha_star() { sin(gamma) } else { gamma },
            cos_alpha_prime: heading / (1.0 + slip_tangent * slip_tangent).sqrt(),
            vcx,
            dpi,
            pressure_ratio,
            mu_scale,
            turn_fy: mode.alpha_star() && vcx < 0.0,
            shift,
            limit_curvature: true,
        };
        let spin = (mode.turn_slip() && self.info.has_turn_slip).then(|| {
            let v = (speed * speed + vs[1] * vs[1]).sqrt();
            let phi_t = -self.hand * m.spin_rate_rad_s.clamp(-1e3, 1e3) / v.max(p.vxlow);
            let re = self.structure.effective_radius(fz, 0.0, dpi);
            let omega = (vcx - vs[0]) / re;
            Spin::new(p, phi_t, gamma, omega, v, vcx, self.structure.dfz(fz))
        });
        let slip = slip_at(slip_ratio, slip_tangent);
        let forced = self.law.forces(&slip, spin.as_ref());

        // Carcass: stiffness and relaxation length belong together, σ = K/C.
        let k = [forced.kxk.abs(), forced.lateral.kya.abs()];
        let (c, sigma) = self.springs(fz, gamma, dpi, k);
        let c = [c[0] * scale, c[1] * scale];
        let mut e = [state.u_m, self.hand * state.v_m];
        for i in 0..2 {
            // A stiffer carcass keeps its force, a softer one its deflection: neither gains energy.
            let before = state.stiffness_n_m[i];
            if c[i] > before {
                e[i] *= before / c[i];
            }
        }

        let patch = Patch {
            c,
            sigma,
            vs,
            speed,
            slip_speed,
            per_v,
            rolling,
            f_ss: [forced.fx * scale, forced.fy * scale],
            f_max: [(forced.mux * load).abs().max(1e-9), (forced.muy * load).abs().max(1e-9)],
            demand: (sq(k[0] * vs[0]) + sq(k[1] * vs[1])).sqrt() * scale,
        };
        // Rolling resistance takes from the wheel; on a wheel that turns against its way (My sees κ alone) it acts
        // not at all rather than drive it.
        let wheel_speed = (vcx - vs[0]) / p.unloaded_radius;
        let my = self.law.my(&slip, forced.fx) * scale;
        let my = if my * wheel_speed < 0.0 { my } else { 0.0 };
        let (e, lag) = patch.advance(e, dt_s, -my * wheel_speed * dt_s);
        let mut f = [c[0] * e[0], c[1] * e[1]];

        // Damper of the standing tyre, inside what friction leaves.
        if rolling < 1.0 {
            let fade = sq(1.0 - rolling) * 2.0 * DAMPING_RATIO;
            let d = [0, 1].map(|i| -fade * (c[i] * load / GRAVITY).sqrt() * vs[i]);
            let share = damper_share(f, d, patch.f_max, patch.limit());
            f = [f[0] + share * d[0], f[1] + share * d[1]];
        }

        let moment_slip = if speed > 0.0 || slip_speed > 0.0 {
            [
                slip_ratio + (state.slip_ratio - slip_ratio) * lag[0],
                slip_tangent + (self.hand * state.slip_tangent - slip_tangent) * lag[1],
            ]
        } else {
            [state.slip_ratio, self.hand * state.slip_tangent]
        };
        let at = slip_at(moment_slip[0], moment_slip[1]);
        let mut outcome = self.law.moments(&at, spin.as_ref(), &forced, f[0] / scale, f[1] / scale, my);
        outcome.fx = f[0];
        outcome.fy = f[1];
        outcome.mx *= scale;
        outcome.my = my;
        outcome.mz *= scale;
        outcome.mzr *= scale;

        // Parking torque.
        let spin_rate = self.hand * m.spin_rate_rad_s.clamp(-1e3, 1e3);
        let mut yaw = self.hand * state.yaw_rad;
        if rolling < 1.0 || yaw != 0.0 {
            let cz = self.structure.yaw_stiffness(dpi).max(1e-6);
            let most = self.structure.parking_moment(load, self.info.has_turn_slip)
                * (0.5 * (forced.mux.abs() + forced.muy.abs()));
            let used = (cz * yaw / most.max(1e-9)).abs();
            let loading = -spin_rate * yaw > 0.0;
            let slide = if loading || used > 1.0 {
                sq(used.min(1.0)) * cz * spin_rate.abs() / most.max(1e-9)
            } else {
                0.0
            };
            let half_patch = (0.1 * p.unloaded_radius).max(0.01);
            let (decay, ramp) = decay((speed / half_patch + slide) * dt_s);
            yaw = (yaw * decay - spin_rate * dt_s * ramp).clamp(-most / cz, most / cz);
            outcome.mz += cz * yaw * (1.0 - shift);
        }

        *state = TransientState {
            u_m: e[0],
            v_m: self.hand * e[1],
            stiffness_n_m: c,
            slip_ratio: moment_slip[0],
            slip_tangent: self.hand * moment_slip[1],
            yaw_rad: self.hand * yaw,
        };
        self.outward(&outcome)
    }

    /// Carcass stiffnesses and relaxation lengths with σ = K/C, both bounded away from zero.
    #[inline]
    fn springs(&self, fz: f64, gamma: f64, dpi: f64, k: [f64; 2]) -> ([f64; 2], [f64; 2]) {
        let p = &self.p;
        let floor = 0.02 * p.unloaded_radius;
        let sigma = self.structure.relaxation(fz, gamma, dpi, k[0], k[1]);
        let nominal = [p.longitudinal_stiffness, p.lateral_stiffness];
        let carcass = self.structure.carcass(self.structure.dfz(fz), dpi);
        let mut c = [0.0; 2];
        let mut s = [0.0; 2];
        for i in 0..2 {
            let stiffness = if self.structure.has_load_relaxation(i) && sigma[i] > 0.0 {
                k[i] / sigma[i].max(floor)
            } else {
                carcass[i]
            };
            c[i] = stiffness.clamp(0.2 * nominal[i], 20.0 * nominal[i]);
            s[i] = (k[i] / c[i]).max(1e-4);
        }
        (c, s)
    }
}

/// The patch for one step: carcass, slip and what the formula gives for it.
struct Patch {
    /// Carcass stiffnesses. [N/m]
    c: [f64; 2],
    /// Relaxation lengths. [m]
    sigma: [f64; 2],
    /// Slip velocity. [m/s]
    vs: [f64; 2],
    /// |Vcx| [m/s]
    speed: f64,
    /// |Vs| [m/s]
    slip_speed: f64,
    /// What slip velocity is divided by to give slip, inverted. [s/m]
    per_v: f64,
    /// 0 at standstill, 1 from VXLOW.
    rolling: f64,
    /// Steady forces of the formula. [N]
    f_ss: [f64; 2],
    /// Friction limits. [N]
    f_max: [f64; 2],
    /// |K Vs| [N m/s]
    demand: f64,
}

impl Patch {
    /// Share of friction that forces use: 1 on the ellipse of the friction limits.
    #[inline]
    fn use_of(&self, f: [f64; 2]) -> f64 {
        (sq(f[0] / self.f_max[0]) + sq(f[1] / self.f_max[1])).sqrt()
    }

    /// The ellipse, or further out where the formula itself is.
    #[inline]
    fn limit(&self) -> f64 {
        self.use_of(self.f_ss).max(1.0)
    }

    /// No more than the limit. Taking deflection away gives energy away.
    #[inline]
    fn limited(&self, e: [f64; 2], limit: f64) -> [f64; 2] {
        let used = self.use_of([self.c[0] * e[0], self.c[1] * e[1]]);
        if used > limit { e.map(|e| e * (limit / used)) } else { e }
    }

    /// Deflections after the step and the lag factor of each axis. `allowance`: energy that the step takes from the
    /// wheel elsewhere (rolling resistance), which the formula's shifts may give back. [J]
    #[inline]
    fn advance(&self, e: [f64; 2], dt: f64, allowance: f64) -> ([f64; 2], [f64; 2]) {
        let Self { c, sigma, vs, f_ss, .. } = self;
        // |F_ss|, but not below a curve without shifts: the formula's force runs through zero beside zero slip (camber
        // thrust, PHX, PHY), where the secant would shorten the relaxation length without end. Its slope at zero is K,
        // so that near straight running it is σ that counts whatever the shifts; far out it gives 0.59 of the peak.
        let linear = self.demand * self.per_v;
        let most = 0.5 * (self.f_max[0] + self.f_max[1]);
        let unshifted = most * sin(SHAPE * atan(linear / (SHAPE * most)));
        let f_ref = (sq(f_ss[0]) + sq(f_ss[1])).sqrt().max(unshifted).max(1e-9);
        // 1: rolling (secant of the formula); 0: gross sliding near standstill (friction against Vs).
        let gross = self.slip_speed / self.speed.max(1e-12);
        let roll = (2.0 * (1.0 - gross)).clamp(0.0, 1.0).max(self.rolling);
        let release = if roll < 1.0 {
            let loading = -(vs[0] * c[0] * e[0] + vs[1] * c[1] * e[1]) > 0.0;
            let used = (sq(c[0] * e[0]) + sq(c[1] * e[1])).sqrt() / f_ref;
            if loading || used > 1.0 { sq(sq(used.min(1.0))) } else { 0.0 }
        } else {
            0.0
        };
        let mut lag = [0.0; 2];
        let (mut next, mut safe) = (e, e);
        for i in 0..2 {
            let rate_roll = self.speed.max(self.demand / f_ref) / sigma[i];
            let rate = roll * rate_roll + (1.0 - roll) * release * c[i] * self.slip_speed / f_ref;
            let drive = roll * rate_roll * f_ss[i] / c[i] - (1.0 - roll) * vs[i];
            let (decay, ramp) = decay(rate * dt);
            next[i] = e[i] * decay + drive * dt * ramp;
            safe[i] = e[i] * decay - vs[i] * dt * ramp;
            lag[i] = decay;
        }
        let limit = self.limit();
        next = self.limited(next, limit);
        let balance = |to: [f64; 2]| {
            (0..2).map(|i| -c[i] * to[i] * vs[i] * dt - 0.5 * c[i] * (sq(to[i]) - sq(e[i]))).sum::<f64>()
        };
        let dissipated = balance(next) + allowance;
        if dissipated < 0.0 {
            // The step would make energy, by the formula's shifts at small slip or by its weighting functions. Between
            // it and the step driven by -Vs, which dissipates for any rate, the balance is concave: go as far as it
            // allows.
            safe = self.limited(safe, limit);
            let way = [next[0] - safe[0], next[1] - safe[1]];
            let a = 0.5 * (c[0] * sq(way[0]) + c[1] * sq(way[1]));
            let start = (balance(safe) + allowance).max(0.0);
            // balance(safe + s way) = start + b s - a s²
            let b = dissipated - start + a;
            let share = (b + (b * b + 4.0 * a * start).sqrt()) / (2.0 * a).max(1e-300);
            let share = share.clamp(0.0, 1.0);
            next = [safe[0] + share * way[0], safe[1] + share * way[1]];
        }
        (next, lag)
    }
}

fn sq(x: f64) -> f64 {
    x * x
}

/// `e^-a` and `(1 - e^-a)/a`, for a ≥ 0.
fn decay(a: f64) -> (f64, f64) {
    if a < 1e-3 {
        let ramp = 1.0 - a * (0.5 - a / 6.0);
        (1.0 - a * ramp, ramp)
    } else {
        let e = exp(-a);
        (e, (1.0 - e) / a)
    }
}

/// Largest share in [0, 1] of the damper force `d` that keeps `f + share d` inside the friction ellipse.
fn damper_share(f: [f64; 2], d: [f64; 2], f_max: [f64; 2], limit: f64) -> f64 {
    let (fx, fy) = (f[0] / f_max[0], f[1] / f_max[1]);
    let (dx, dy) = (d[0] / f_max[0], d[1] / f_max[1]);
    let a = dx * dx + dy * dy;
    if a == 0.0 {
        return 0.0;
    }
    let b = fx * dx + fy * dy;
    let c = (fx * fx + fy * fy - limit * limit).min(0.0);
    ((-b + (b * b - a * c).sqrt()) / a).clamp(0.0, 1.0)
}
