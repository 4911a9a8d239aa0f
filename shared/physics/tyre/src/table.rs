//! Table tyre: pure-slip curves as measured, Fy(α, Fz), Fx(κ, Fz), and where there are, Mz(α, Fz) and camber thrust
//! Fy(γ, Fz), from a TOML file.
//!
//! Between slips: monotone cubic (Fritsch and Butland 1984), so no overshoot and a continuous slope; beyond the
//! last slip: its value. Between loads: linear; below the first load and above the last: in proportion to load.
//! Combined slip by the normalised slip `k = |(κ/κp, α/αp)|` with the slips of the curves' peaks
//! (Pacejka, Tyre and Vehicle Dynamics, 3rd ed. 2012, §4.1): each force is its pure curve at k, shared by
//! direction. Friction by similarity: `F = λ F0(s/λ)` (same, §4.2). Camber thrust fades as 1/(1 + k²).
//! Axes ISO-W as everywhere here. Not modelled: pressure, turn slip, camber other than thrust, Mx.

use crate::formula::{Forced, Lateral, Outcome, Slip};
use crate::keys::{KEYS, Need, Parameters};
use crate::math::{atan, sign};
use crate::tir::TirError;
use crate::turn_slip::Zeta;
use serde::Deserialize;

/// A table file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    tyre: Basics,
    lateral: SlipTable,
    longitudinal: SlipTable,
    aligning: Option<SlipTable>,
    camber: Option<SlipTable>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Basics {
    /// Free text: where the numbers come from.
    source: String,
    unloaded_radius_m: f64,
    width_m: f64,
    rim_radius_m: f64,
    nominal_load_n: f64,
    inflation_pressure_pa: f64,
    vertical_stiffness_n_m: f64,
    vertical_damping_n_s_m: f64,
    longitudinal_stiffness_n_m: f64,
    lateral_stiffness_n_m: f64,
    yaw_stiffness_n_m_rad: f64,
    /// Rolling resistance moment over load and unloaded radius.
    rolling_resistance: f64,
    /// Coefficients B, D, F of the effective rolling radius (paper cited in `structure`, 7).
    rolling_radius: [f64; 3],
    /// Largest load the tables stand for. [N]
    load_max_n: f64,
}

/// `value[i][j]` at `load_n[i]`, `slip[j]`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SlipTable {
    /// Slip angle [rad], slip ratio [-] or camber [rad].
    slip: Vec<f64>,
    load_n: Vec<f64>,
    /// Force [N] or moment [N m].
    value: Vec<Vec<f64>>,
}

impl SlipTable {
    fn check(&self, key: &str, broken: &mut Vec<(String, String, &'static str)>) {
        let increasing = |v: &[f64]| v.windows(2).all(|w| w[0] < w[1]) && v.iter().all(|x| x.is_finite());
        let mut require = |holds: bool, part: &str, value: String, rule| {
            if !holds {
                broken.push((format!("{key}.{part}"), value, rule));
            }
        };
        require(
            self.slip.len() >= 3 && increasing(&self.slip),
            "slip",
            format!("{:?}", self.slip),
            "must be three or more increasing numbers",
        );
        require(
            self.slip.first().is_some_and(|s| *s < 0.0) && self.slip.last().is_some_and(|s| *s > 0.0),
            "slip",
            format!("{:?}", self.slip),
            "must reach to both sides of zero",
        );
        require(
            !self.load_n.is_empty() && increasing(&self.load_n) && self.load_n[0] > 0.0,
            "load_n",
            format!("{:?}", self.load_n),
            "must be one or more increasing numbers > 0",
        );
        require(
            self.value.len() == self.load_n.len(),
            "value",
            format!("{} rows", self.value.len()),
            "must have one row per load",
        );
        for (i, row) in self.value.iter().enumerate() {
            require(
                row.len() == self.slip.len() && row.iter().all(|v| v.is_finite()),
                &format!("value[{i}]"),
                format!("{row:?}"),
                "must be one finite number per slip",
            );
        }
    }
}

/// Cubic pieces over slip, linear over load.
#[derive(Debug, Clone)]
struct Surface {
    slip: Vec<f64>,
    load: Vec<f64>,
    /// Value and slope at (load, slip), load-major.
    node: Vec<[f64; 2]>,
    /// Value and slope at zero slip for each load.
    zero: Vec<[f64; 2]>,
    /// Largest magnitude over slip for each load, over that load.
    peak: Vec<f64>,
    /// Slip of that peak at the middle load.
    peak_slip: f64,
}

impl Surface {
    fn new(table: &SlipTable) -> Self {
        let n = table.slip.len();
        let mut node = Vec::with_capacity(n * table.load_n.len());
        for row in &table.value {
            node.extend(row.iter().zip(slopes(&table.slip, row)).map(|(v, d)| [*v, d]));
        }
        let mut surface = Self {
            slip: table.slip.clone(),
            load: table.load_n.clone(),
            node,
            zero: Vec::new(),
            peak: Vec::new(),
            peak_slip: 1.0,
        };
        for (i, row) in table.value.iter().enumerate() {
            surface.zero.push(surface.on_row(i, 0.0));
            let highest = row
                .iter()
                .enumerate()
                .fold((0, 0.0_f64), |m, (j, v)| if v.abs() > m.1 { (j, v.abs()) } else { m });
            surface.peak.push(highest.1 / surface.load[i]);
            if i == table.load_n.len() / 2 {
                surface.peak_slip = surface.slip[highest.0].abs().max(1e-3);
            }
        }
        surface
    }

    /// Value and slope on one load's curve.
    fn on_row(&self, row: usize, slip: f64) -> [f64; 2] {
        let n = self.slip.len();
        let nodes = &self.node[row * n..(row + 1) * n];
        if slip <= self.slip[0] {
            return [nodes[0][0], 0.0];
        }
        if slip >= self.slip[n - 1] {
            return [nodes[n - 1][0], 0.0];
        }
        let j = self.slip.partition_point(|s| *s <= slip) - 1;
        let h = self.slip[j + 1] - self.slip[j];
        let t = (slip - self.slip[j]) / h;
        let ([a, da], [b, db]) = (nodes[j], nodes[j + 1]);
        let (da, db) = (da * h, db * h);
        let (c2, c3) = (3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db);
        [a + t * (da + t * (c2 + t * c3)), (da + t * (2.0 * c2 + t * 3.0 * c3)) / h]
    }

    /// Rows and weights of a load.
    fn rows(&self, fz: f64) -> ([usize; 2], [f64; 2]) {
        let last = self.load.len() - 1;
        if fz <= self.load[0] {
            ([0, 0], [fz / self.load[0], 0.0])
        } else if fz >= self.load[last] {
            ([last, last], [fz / self.load[last], 0.0])
        } else {
            let i = self.load.partition_point(|l| *l <= fz) - 1;
            let t = (fz - self.load[i]) / (self.load[i + 1] - self.load[i]);
            ([i, i + 1], [1.0 - t, t])
        }
    }

    fn at(&self, fz: f64, slip: f64) -> f64 {
        let ([i, j], [a, b]) = self.rows(fz);
        a * self.on_row(i, slip)[0] + if b == 0.0 { 0.0 } else { b * self.on_row(j, slip)[0] }
    }

    /// Value and slope at zero slip.
    fn at_zero(&self, fz: f64) -> [f64; 2] {
        let ([i, j], [a, b]) = self.rows(fz);
        [0, 1].map(|k| a * self.zero[i][k] + b * self.zero[j][k])
    }

    /// Peak friction coefficient at a load.
    fn friction(&self, fz: f64) -> f64 {
        let ([i, j], [a, b]) = self.rows(fz);
        let sum = a + b;
        (a * self.peak[i] + b * self.peak[j]) / sum.max(1e-12)
    }
}

/// Slopes of the monotone cubic: harmonic mean of neighbouring secants, zero at turns; secants at the ends.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let n = x.len();
    let secant = |i: usize| (y[i + 1] - y[i]) / (x[i + 1] - x[i]);
    (0..n)
        .map(|i| {
            if i == 0 {
                secant(0)
            } else if i == n - 1 {
                secant(n - 2)
            } else {
                let (a, b) = (secant(i - 1), secant(i));
                if a * b <= 0.0 {
                    0.0
                } else {
                    let (ha, hb) = (x[i] - x[i - 1], x[i + 1] - x[i]);
                    let w = (ha + 2.0 * hb) / (3.0 * (ha + hb));
                    a * b / (w * b + (1.0 - w) * a)
                }
            }
        })
        .collect()
}

/// Forces from tables.
#[derive(Debug, Clone)]
pub(crate) struct TableLaw {
    lateral: Surface,
    longitudinal: Surface,
    aligning: Option<Surface>,
    camber: Option<Surface>,
    rolling_moment_per_n: f64,
    vxlow: f64,
}

/// Normalised slip: length and direction.
struct Normal {
    k: f64,
    x: f64,
    y: f64,
}

impl TableLaw {
    /// dFx/dκ at zero slip. [N]
    pub fn kxk(&self, fz: f64) -> f64 {
        self.longitudinal.at_zero(fz)[1]
    }

    /// dFy/dα at zero slip. [N/rad]
    pub fn kya(&self, fz: f64) -> f64 {
        self.lateral.at_zero(fz)[1]
    }

    fn normal(&self, s: &Slip) -> Normal {
        let kx = s.kappa / (self.longitudinal.peak_slip * s.mu_scale[0]);
        let ky = atan(s.tan_alpha) / (self.lateral.peak_slip * s.mu_scale[1]);
        let k = (kx * kx + ky * ky).sqrt();
        if k > 0.0 { Normal { k, x: kx / k, y: ky / k } } else { Normal { k, x: 0.0, y: 0.0 } }
    }

    /// Pure curve at normalised slip k, shared by direction; the rest of its value at zero slip fades with slip. All
    /// of that value fades towards standstill.
    fn share(surface: &Surface, fz: f64, k: f64, direction: f64, mu: f64, shift: f64) -> f64 {
        let zero = surface.at_zero(fz)[0];
        let curve = surface.at(fz, k * surface.peak_slip * sign(direction)) - zero * (1.0 - shift);
        let share = direction.abs();
        mu * (curve * share + zero * shift * (1.0 - share) / (1.0 + k * k))
    }

    pub fn forces(&self, s: &Slip) -> Forced {
        let n = self.normal(s);
        let heading = if s.vcx < 0.0 { -1.0 } else { 1.0 };
        let fx = Self::share(&self.longitudinal, s.fz, n.k, n.x, s.mu_scale[0], s.shift) * heading;
        let side = Self::share(&self.lateral, s.fz, n.k, n.y, s.mu_scale[1], s.shift);
        let thrust =
            self.camber.as_ref().map_or(0.0, |c| c.at(s.fz, s.gamma)) * s.mu_scale[1] / (1.0 + n.k * n.k);
        let fy = side + thrust * s.shift;
        Forced {
            fx,
            fy,
            fy_prime: side,
            mux: self.longitudinal.friction(s.fz) * s.mu_scale[0],
            muy: self.lateral.friction(s.fz) * s.mu_scale[1],
            kxk: self.kxk(s.fz),
            gyk: 1.0,
            lateral: Lateral::of_stiffness(self.kya(s.fz)),
            zeta: Zeta::NONE,
        }
    }

    pub fn moments(&self, s: &Slip, forced: &Forced, fx: f64, fy: f64, my: f64) -> Outcome {
        let n = self.normal(s);
        let heading = if s.vcx < 0.0 { -1.0 } else { 1.0 };
        let mz = self.aligning.as_ref().map_or(0.0, |m| {
            Self::share(m, s.fz, n.k * self.lateral.peak_slip / m.peak_slip, n.y, s.mu_scale[1], s.shift)
        }) * heading
            * s.shift;
        Outcome {
            fx,
            fy,
            my,
            mz,
            trail: if forced.fy_prime.abs() > 1e-3 * s.fz { -mz / forced.fy_prime } else { 0.0 },
            mux: forced.mux,
            muy: forced.muy,
            kxk: forced.kxk,
            kya: forced.lateral.kya,
            ..Outcome::default()
        }
    }

    /// Rolling resistance, linear through standstill and a locked wheel.
    pub fn my(&self, s: &Slip) -> f64 {
        let wheel = (s.vcx * (1.0 + s.kappa) / self.vxlow).clamp(-1.0, 1.0);
        -self.rolling_moment_per_n * s.fz * wheel
    }
}

/// Reads a table file: the tables, and the parameters that the rest of the tyre uses.
pub(crate) fn read(text: &str, file: &str) -> Result<(TableLaw, Parameters), Vec<TirError>> {
    let error = |line, key: String, value: String, rule: String| TirError {
        file: file.to_owned(),
        line,
        section: String::new(),
        key,
        value,
        rule,
    };
    let parsed: File = toml::from_str(text).map_err(|e| {
        let line = e.span().map(|s| text[..s.start.min(text.len())].lines().count().max(1));
        vec![error(line, "tyre table".to_owned(), String::new(), e.message().to_owned())]
    })?;
    let mut broken = Vec::new();
    let t = &parsed.tyre;
    for (key, value) in [
        ("unloaded_radius_m", t.unloaded_radius_m),
        ("width_m", t.width_m),
        ("rim_radius_m", t.rim_radius_m),
        ("nominal_load_n", t.nominal_load_n),
        ("inflation_pressure_pa", t.inflation_pressure_pa),
        ("vertical_stiffness_n_m", t.vertical_stiffness_n_m),
        ("longitudinal_stiffness_n_m", t.longitudinal_stiffness_n_m),
        ("lateral_stiffness_n_m", t.lateral_stiffness_n_m),
        ("yaw_stiffness_n_m_rad", t.yaw_stiffness_n_m_rad),
        ("load_max_n", t.load_max_n),
    ] {
        if value.is_nan() || value <= 0.0 || value.is_infinite() {
            broken.push((format!("tyre.{key}"), value.to_string(), "must be > 0"));
        }
    }
    for (key, value) in
        [("vertical_damping_n_s_m", t.vertical_damping_n_s_m), ("rolling_resistance", t.rolling_resistance)]
    {
        if value.is_nan() || value < 0.0 || value.is_infinite() {
            broken.push((format!("tyre.{key}"), value.to_string(), "must be >= 0"));
        }
    }
    if t.rim_radius_m >= t.unloaded_radius_m {
        broken.push((
            "tyre.rim_radius_m".to_owned(),
            t.rim_radius_m.to_string(),
            "must be below unloaded_radius_m",
        ));
    }
    if t.source.trim().is_empty() {
        broken.push(("tyre.source".to_owned(), t.source.clone(), "must tell where the numbers come from"));
    }
    if t.rolling_radius.iter().any(|v| !v.is_finite()) {
        broken.push(("tyre.rolling_radius".to_owned(), format!("{:?}", t.rolling_radius), "must be finite"));
    }
    let before = broken.len();
    parsed.lateral.check("lateral", &mut broken);
    parsed.longitudinal.check("longitudinal", &mut broken);
    if let Some(table) = &parsed.aligning {
        table.check("aligning", &mut broken);
    }
    if let Some(table) = &parsed.camber {
        table.check("camber", &mut broken);
    }
    if broken.len() == before {
        let zero_slope = |t: &SlipTable| Surface::new(t).zero.iter().map(|z| z[1]).collect::<Vec<_>>();
        let lateral = zero_slope(&parsed.lateral);
        if lateral.iter().any(|k| *k >= 0.0) {
            broken.push((
                "lateral.value".to_owned(),
                format!("slopes {lateral:?}"),
                "must fall with slip angle through zero (ISO-W)",
            ));
        }
        let longitudinal = zero_slope(&parsed.longitudinal);
        if longitudinal.iter().any(|k| *k <= 0.0) {
            broken.push((
                "longitudinal.value".to_owned(),
                format!("slopes {longitudinal:?}"),
                "must rise with slip ratio through zero",
            ));
        }
    }
    if !broken.is_empty() {
        return Err(broken
            .into_iter()
            .map(|(key, value, rule)| error(None, key, value, rule.to_owned()))
            .collect());
    }
    let mut p = Parameters::default();
    for key in KEYS {
        if let Need::Or(value) = key.need {
            (key.set)(&mut p, value);
        }
    }
    p.unloaded_radius = t.unloaded_radius_m;
    p.width = t.width_m;
    p.aspect_ratio = (t.unloaded_radius_m - t.rim_radius_m) / t.width_m;
    p.rim_radius = t.rim_radius_m;
    p.fnomin = t.nominal_load_n;
    p.inflpres = t.inflation_pressure_pa;
    p.nompres = t.inflation_pressure_pa;
    p.vertical_stiffness = t.vertical_stiffness_n_m;
    p.vertical_damping = t.vertical_damping_n_s_m;
    p.longitudinal_stiffness = t.longitudinal_stiffness_n_m;
    p.lateral_stiffness = t.lateral_stiffness_n_m;
    p.yaw_stiffness = t.yaw_stiffness_n_m_rad;
    [p.breff, p.dreff, p.freff] = t.rolling_radius;
    p.fzmax = t.load_max_n;
    // The camber range of the table, where there is one.
    if let Some(c) = &parsed.camber {
        (p.cammin, p.cammax) = (c.slip[0], c.slip[c.slip.len() - 1]);
    }
    let law = TableLaw {
        lateral: Surface::new(&parsed.lateral),
        longitudinal: Surface::new(&parsed.longitudinal),
        aligning: parsed.aligning.as_ref().map(Surface::new),
        camber: parsed.camber.as_ref().map(Surface::new),
        rolling_moment_per_n: t.rolling_resistance * t.unloaded_radius_m,
        vxlow: p.vxlow,
    };
    Ok((law, p))
}
