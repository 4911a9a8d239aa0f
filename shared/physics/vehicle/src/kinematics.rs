//! Suspension kinematics as smooth maps over wheel travel and rack displacement.
//!
//! Body axes ISO 8855 (x forward, y left, z up). The map of one knuckle gives, for wheel-centre travel z (up
//! from design, relative to the body) and rack displacement (left positive):
//! - the displacement (x, y) of the wheel centre from design, in body axes;
//! - the attitude of the knuckle frame K (axes parallel to the body at design) as angles of the sequence
//!   R_BK = Rz(ψ) Rx(ε) Ry(θ): steer ψ left positive, inclination ε about +x, knuckle pitch θ about the spin
//!   axis, all zero at design (static toe and camber are in the spin axis, which is fixed in K);
//! - the kingpin axis (caster, inclination, a point on it).
//!
//! Between grid points: tensor product of uniform cubic B-splines that interpolate the samples, end slopes by
//! one-sided differences of third order [de Boor, A Practical Guide to Splines, ch. XIII and XVII], so that
//! value, slope and curvature are continuous: the slopes are the partial velocities of Kane's equations.
//! Beyond the grid the surface continues along its tangent.

use config::car::{CarAxle, IdealKinematics};
use nalgebra::{Matrix3, Vector3};

/// Channels of a map: ψ, ε, θ, x, y.
const POSE: usize = 5;
/// Channels of the kingpin: direction components x, y (z is 1), point x, y, z.
const KINGPIN: usize = 5;

/// Pose of one knuckle at one wheel travel and rack displacement, as a kinematic solver gives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnuckleSample {
    /// Attitude of the knuckle frame K relative to the body, unit Euler parameters, scalar first; identity
    /// at design.
    pub attitude: [f64; 4],
    /// Forward displacement of the wheel centre from design. [m]
    pub x_m: f64,
    /// Displacement of the wheel centre to the left from design. [m]
    pub y_m: f64,
    /// Direction of the kingpin axis in body axes, pointing up (any length, z component positive).
    pub kingpin_direction: [f64; 3],
    /// A point on the kingpin axis (lower ball), relative to the wheel centre's design position, body axes.
    /// [m]
    pub kingpin_point_m: [f64; 3],
}

/// The grid on which the samples lie: uniform in travel and rack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// Lowest wheel travel. [m]
    pub travel_min_m: f64,
    /// Highest wheel travel. [m]
    pub travel_max_m: f64,
    /// Number of travels, at least 4.
    pub travels: usize,
    /// Rightmost rack displacement. [m]
    pub rack_min_m: f64,
    /// Leftmost rack displacement. [m]
    pub rack_max_m: f64,
    /// Number of rack displacements: 1 (an unsteered axle) or at least 4.
    pub racks: usize,
}

impl Grid {
    fn valid(&self) -> bool {
        self.travels >= 4
            && self.travel_max_m > self.travel_min_m
            && (self.racks == 1 || (self.racks >= 4 && self.rack_max_m > self.rack_min_m))
    }

    /// Wheel travel of row `i`. [m]
    #[must_use]
    pub fn travel_m(&self, i: usize) -> f64 {
        self.travel_min_m + (self.travel_max_m - self.travel_min_m) * i as f64 / (self.travels - 1) as f64
    }

    /// Rack displacement of column `j`. [m]
    #[must_use]
    pub fn rack_m(&self, j: usize) -> f64 {
        if self.racks == 1 {
            0.0
        } else {
            self.rack_min_m + (self.rack_max_m - self.rack_min_m) * j as f64 / (self.racks - 1) as f64
        }
    }
}

/// Knuckle angles and wheel-centre displacement with their derivatives.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct KnucklePose {
    /// ψ, ε, θ [rad], x, y [m].
    pub value: [f64; POSE],
    /// Derivatives to wheel travel.
    pub per_travel: [f64; POSE],
    /// Second derivatives to wheel travel.
    pub per_travel2: [f64; POSE],
    /// Derivatives to rack displacement.
    pub per_rack: [f64; POSE],
}

/// The kingpin axis in body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KingpinAxis {
    /// Unit vector, pointing up.
    pub direction: Vector3<f64>,
    /// A point on the axis relative to the wheel centre's design position. [m]
    pub point_m: Vector3<f64>,
}

/// Maps of one knuckle.
#[derive(Debug, Clone, PartialEq)]
pub struct KnuckleMap {
    grid: Grid,
    travel_per_m: f64,
    rack_per_m: f64,
    rows: usize,
    columns: usize,
    pose: Vec<[f64; POSE]>,
    kingpin: Vec<[f64; KINGPIN]>,
    /// Spin axis in K, unit, to the left for both wheels.
    pub spin_axis_k: Vector3<f64>,
}

/// Weights of the four cubic B-splines over one cell: value, slope, curvature (in cell units).
fn weights(u: f64) -> [[f64; 4]; 3] {
    let (u2, u3, w) = (u * u, u * u * u, 1.0 - u);
    [
        [
            w * w * w / 6.0,
            (3.0 * u3 - 6.0 * u2 + 4.0) / 6.0,
            (-3.0 * u3 + 3.0 * u2 + 3.0 * u + 1.0) / 6.0,
            u3 / 6.0,
        ],
        [-0.5 * w * w, 1.5 * u2 - 2.0 * u, -1.5 * u2 + u + 0.5, 0.5 * u2],
        [w, 3.0 * u - 2.0, 1.0 - 3.0 * u, u],
    ]
}

/// B-spline coefficients c[-1..=n] interpolating f[0..n] with end slopes from four-point differences.
fn spline_coefficients(f: &[f64]) -> Vec<f64> {
    let n = f.len();
    // Slopes in cell units.
    let start = (-11.0 * f[0] + 18.0 * f[1] - 9.0 * f[2] + 2.0 * f[3]) / 6.0;
    let end = (11.0 * f[n - 1] - 18.0 * f[n - 2] + 9.0 * f[n - 3] - 2.0 * f[n - 4]) / 6.0;
    // (c[i-1] + 4 c[i] + c[i+1]) / 6 = f[i]; the ghosts are c[-1] = c[1] - 2 start, c[n] = c[n-2] + 2 end.
    let mut upper = vec![0.0; n];
    let mut c = vec![0.0; n];
    for i in 0..n {
        let (low, up) = match i {
            0 => (0.0, 2.0),
            _ if i == n - 1 => (2.0, 0.0),
            _ => (1.0, 1.0),
        };
        let right = 6.0 * f[i]
            + match i {
                0 => 2.0 * start,
                _ if i == n - 1 => -2.0 * end,
                _ => 0.0,
            };
        let (before_upper, before_c) = if i == 0 { (0.0, 0.0) } else { (upper[i - 1], c[i - 1]) };
        let pivot = 4.0 - low * before_upper;
        upper[i] = up / pivot;
        c[i] = (right - low * before_c) / pivot;
    }
    for i in (0..n - 1).rev() {
        c[i] -= upper[i] * c[i + 1];
    }
    let mut all = Vec::with_capacity(n + 2);
    all.push(c[1] - 2.0 * start);
    all.extend_from_slice(&c);
    all.push(c[n - 2] + 2.0 * end);
    all
}

/// Coefficients of one channel over the grid, row-major in travel.
fn surface_coefficients(samples: &[f64], travels: usize, racks: usize) -> Vec<f64> {
    let rows = travels + 2;
    let mut along_travel = vec![0.0; rows * racks];
    for j in 0..racks {
        let column: Vec<f64> = (0..travels).map(|i| samples[i * racks + j]).collect();
        for (i, c) in spline_coefficients(&column).into_iter().enumerate() {
            along_travel[i * racks + j] = c;
        }
    }
    if racks == 1 {
        return along_travel;
    }
    along_travel.chunks(racks).flat_map(spline_coefficients).collect()
}

/// Angles ψ, ε, θ of Rz(ψ) Rx(ε) Ry(θ).
fn angles(r: &Matrix3<f64>) -> [f64; 3] {
    [(-r[(0, 1)]).atan2(r[(1, 1)]), r[(2, 1)].clamp(-1.0, 1.0).asin(), (-r[(2, 0)]).atan2(r[(2, 2)])]
}

impl KnuckleMap {
    /// From samples on a grid, travel-major: `samples[i * racks + j]` at `travel_m(i)`, `rack_m(j)`.
    ///
    /// `spin_axis_k` is the wheel's spin axis at design, to the left for both wheels (static toe and camber).
    ///
    /// # Errors
    /// A sentence naming what is wrong with grid or samples.
    pub fn from_samples(
        grid: Grid,
        samples: &[KnuckleSample],
        spin_axis_k: [f64; 3],
    ) -> Result<Self, String> {
        if !grid.valid() {
            return Err(format!(
                "kinematics grid {grid:?}: needs 4 or more travels, and 1 or 4 or more racks"
            ));
        }
        if samples.len() != grid.travels * grid.racks {
            return Err(format!(
                "kinematics map: {} samples for a grid of {} by {}",
                samples.len(),
                grid.travels,
                grid.racks
            ));
        }
        let axis = Vector3::from(spin_axis_k);
        if !axis.norm().is_finite() || axis.norm() < 0.5 || axis.y <= 0.0 {
            return Err(format!("spin axis {spin_axis_k:?}: must be a unit vector pointing left"));
        }
        let mut pose = vec![[0.0; POSE]; samples.len()];
        let mut kingpin = vec![[0.0; KINGPIN]; samples.len()];
        for (k, s) in samples.iter().enumerate() {
            let r = spatial::EulerParameters::from_array(s.attitude).normalised().matrix();
            let [psi, epsilon, theta] = angles(&r);
            pose[k] = [psi, epsilon, theta, s.x_m, s.y_m];
            let d = s.kingpin_direction;
            kingpin[k] =
                [d[0] / d[2], d[1] / d[2], s.kingpin_point_m[0], s.kingpin_point_m[1], s.kingpin_point_m[2]];
            if pose[k].iter().chain(&kingpin[k]).any(|v| !v.is_finite()) || d[2] <= 0.0 {
                return Err(format!("kinematics sample {k}: {s:?} is not a pose"));
            }
        }
        let (rows, columns) = (grid.travels + 2, if grid.racks == 1 { 1 } else { grid.racks + 2 });
        let mut map = Self {
            grid,
            travel_per_m: (grid.travels - 1) as f64 / (grid.travel_max_m - grid.travel_min_m),
            rack_per_m: if grid.racks == 1 {
                0.0
            } else {
                (grid.racks - 1) as f64 / (grid.rack_max_m - grid.rack_min_m)
            },
            rows,
            columns,
            pose: vec![[0.0; POSE]; rows * columns],
            kingpin: vec![[0.0; KINGPIN]; rows * columns],
            spin_axis_k: axis.normalize(),
        };
        for channel in 0..POSE {
            let values: Vec<f64> = pose.iter().map(|p| p[channel]).collect();
            for (k, c) in surface_coefficients(&values, grid.travels, grid.racks).into_iter().enumerate() {
                map.pose[k][channel] = c;
            }
        }
        for channel in 0..KINGPIN {
            let values: Vec<f64> = kingpin.iter().map(|p| p[channel]).collect();
            for (k, c) in surface_coefficients(&values, grid.travels, grid.racks).into_iter().enumerate() {
                map.kingpin[k][channel] = c;
            }
        }
        Ok(map)
    }

    /// The grid of the samples.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Cell and place in it along travel; what lies beyond the grid.
    fn travel_cell(&self, travel_m: f64) -> (usize, f64, f64) {
        let inside = travel_m.clamp(self.grid.travel_min_m, self.grid.travel_max_m);
        let u = (inside - self.grid.travel_min_m) * self.travel_per_m;
        let cell = (u as usize).min(self.rows - 4);
        (cell, u - cell as f64, travel_m - inside)
    }

    fn rack_cell(&self, rack_m: f64) -> (usize, f64, f64) {
        let inside = rack_m.clamp(self.grid.rack_min_m, self.grid.rack_max_m);
        let u = (inside - self.grid.rack_min_m) * self.rack_per_m;
        let cell = (u as usize).min(self.columns - 4);
        (cell, u - cell as f64, rack_m - inside)
    }

    /// Pose and derivatives at wheel travel and rack displacement.
    #[must_use]
    pub fn pose(&self, travel_m: f64, rack_m: f64) -> KnucklePose {
        let (i, u, beyond_travel) = self.travel_cell(travel_m);
        let [wv, ws, wc] = weights(u);
        let scale = self.travel_per_m;
        let mut out = KnucklePose::default();
        if self.columns == 1 {
            for a in 0..4 {
                let c = &self.pose[i + a];
                for k in 0..POSE {
                    out.value[k] += wv[a] * c[k];
                    out.per_travel[k] += ws[a] * c[k];
                    out.per_travel2[k] += wc[a] * c[k];
                }
            }
        } else {
            let (j, v, beyond_rack) = self.rack_cell(rack_m);
            let [rv, rs, _] = weights(v);
            // Rows first: each row's value and rack slope, then across travel.
            for a in 0..4 {
                let start = (i + a) * self.columns + j;
                let c = &self.pose[start..start + 4];
                for k in 0..POSE {
                    let value = rv[0] * c[0][k] + rv[1] * c[1][k] + rv[2] * c[2][k] + rv[3] * c[3][k];
                    let slope = rs[0] * c[0][k] + rs[1] * c[1][k] + rs[2] * c[2][k] + rs[3] * c[3][k];
                    out.value[k] += wv[a] * value;
                    out.per_travel[k] += ws[a] * value;
                    out.per_travel2[k] += wc[a] * value;
                    out.per_rack[k] += wv[a] * slope;
                }
            }
            for k in 0..POSE {
                out.per_rack[k] *= self.rack_per_m;
                out.value[k] += out.per_rack[k] * beyond_rack;
            }
        }
        for k in 0..POSE {
            out.per_travel[k] *= scale;
            out.per_travel2[k] *= scale * scale;
            out.value[k] += out.per_travel[k] * beyond_travel;
        }
        if beyond_travel != 0.0 {
            out.per_travel2 = [0.0; POSE];
        }
        out
    }

    /// The kingpin axis at wheel travel and rack displacement (held beyond the grid).
    #[must_use]
    pub fn kingpin(&self, travel_m: f64, rack_m: f64) -> KingpinAxis {
        let (i, u, _) = self.travel_cell(travel_m);
        let wv = weights(u)[0];
        let mut out = [0.0; KINGPIN];
        let (j, rv) = if self.columns == 1 {
            (0, [1.0, 0.0, 0.0, 0.0])
        } else {
            let (j, v, _) = self.rack_cell(rack_m);
            (j, weights(v)[0])
        };
        for a in 0..4 {
            for b in 0..self.columns.min(4) {
                let c = &self.kingpin[(i + a) * self.columns + j + b];
                for k in 0..KINGPIN {
                    out[k] += wv[a] * rv[b] * c[k];
                }
            }
        }
        KingpinAxis {
            direction: Vector3::new(out[0], out[1], 1.0).normalize(),
            point_m: Vector3::new(out[2], out[3], out[4]),
        }
    }

    /// Heading of the wheel, left positive. [rad]
    #[must_use]
    pub fn steer_rad(&self, travel_m: f64, rack_m: f64) -> f64 {
        let s = knuckle_matrix(&self.pose(travel_m, rack_m).value) * self.spin_axis_k;
        (-s.x).atan2(s.y)
    }
}

/// R_BK of the angles ψ, ε, θ at the head of `value`.
#[must_use]
pub fn knuckle_matrix(value: &[f64; POSE]) -> Matrix3<f64> {
    let (sp, cp) = value[0].sin_cos();
    let (se, ce) = value[1].sin_cos();
    let (st, ct) = value[2].sin_cos();
    Matrix3::new(
        cp * ct - sp * se * st,
        -sp * ce,
        cp * st + sp * se * ct,
        sp * ct + cp * se * st,
        cp * ce,
        sp * st - cp * se * ct,
        -ce * st,
        se,
        ce * ct,
    )
}

/// Kinematics of one axle: left and right knuckle.
#[derive(Debug, Clone, PartialEq)]
pub struct AxleKinematics {
    /// Maps of the left and the right knuckle.
    pub sides: [KnuckleMap; 2],
}

impl AxleKinematics {
    /// From both sides' samples (see [`KnuckleMap::from_samples`]).
    ///
    /// # Errors
    /// A sentence naming the side and what is wrong.
    pub fn from_samples(
        grid: Grid,
        left: &[KnuckleSample],
        right: &[KnuckleSample],
        spin_axis_k: [[f64; 3]; 2],
    ) -> Result<Self, String> {
        Ok(Self {
            sides: [
                KnuckleMap::from_samples(grid, left, spin_axis_k[0]).map_err(|e| format!("left: {e}"))?,
                KnuckleMap::from_samples(grid, right, spin_axis_k[1]).map_err(|e| format!("right: {e}"))?,
            ],
        })
    }

    /// From the constants of a car file.
    ///
    /// # Errors
    /// A sentence naming what is wrong.
    pub fn ideal(
        k: &IdealKinematics,
        axle: &CarAxle,
        wheelbase_m: f64,
        rack_travel_m: f64,
    ) -> Result<Self, String> {
        let steered = k.steer_per_rack_rad_m != 0.0;
        let grid = Grid {
            travel_min_m: -0.15,
            travel_max_m: 0.15,
            travels: 13,
            rack_min_m: -rack_travel_m,
            rack_max_m: rack_travel_m,
            racks: if steered { 41 } else { 1 },
        };
        let half_track = 0.5 * axle.track_m;
        let mut both = Vec::with_capacity(2);
        for side in [1.0, -1.0] {
            // Outward is +y on the left (side = 1), -y on the right.
            let spin_axis =
                Vector3::new(side * k.toe_in_rad.sin(), 1.0, -side * k.camber_rad.sin()).normalize();
            // Caster: top rearward; inclination: top inward.
            let direction =
                Vector3::new(-k.caster_rad.tan(), -side * k.kingpin_inclination_rad.tan(), 1.0).normalize();
            let point = Vector3::new(k.caster_offset_m, -side * k.kingpin_offset_m, 0.0);
            let mut samples = Vec::with_capacity(grid.travels * grid.racks);
            for i in 0..grid.travels {
                let z = grid.travel_m(i);
                for j in 0..grid.racks {
                    let t = (k.steer_per_rack_rad_m * grid.rack_m(j)).tan();
                    let steer =
                        (wheelbase_m * t / (wheelbase_m - side * k.ackermann * half_track * t)).atan();
                    // About the kingpin by the angle that gives this heading (secant steps on a smooth function).
                    let turn = |angle: f64| spatial::EulerParameters::from_axis_angle(&direction, angle);
                    let heading = |angle: f64| {
                        let y = turn(angle).matrix() * Vector3::y();
                        (-y.x).atan2(y.y)
                    };
                    let mut angle = steer;
                    for _ in 0..8 {
                        angle += steer - heading(angle);
                    }
                    let steered = turn(angle).matrix();
                    let travel = knuckle_matrix(&[
                        -side * k.toe_in_per_travel_rad_m * z,
                        -side * k.camber_per_travel_rad_m * z,
                        -k.caster_per_travel_rad_m * z,
                        0.0,
                        0.0,
                    ]);
                    let attitude = travel * steered;
                    // The wheel centre turns about the kingpin; in travel the contact patch moves at right
                    // angles to its line to the instant centre, which fixes the roll centre's height.
                    let turned = point - steered * point;
                    let camber = k.camber_per_travel_rad_m;
                    let outward = k.roll_centre_height_m / half_track + axle.wheel_centre_height_m * camber;
                    samples.push(KnuckleSample {
                        attitude: spatial::EulerParameters::from_matrix(&attitude).to_array(),
                        x_m: turned.x + k.forward_per_travel * z,
                        y_m: turned.y + side * (outward + k.outward_per_travel2_1_m.unwrap_or(0.0) * z) * z,
                        kingpin_direction: (travel * direction).into(),
                        kingpin_point_m: (point + Vector3::new(0.0, 0.0, z)).into(),
                    });
                }
            }
            both.push((samples, spin_axis));
        }
        Self::from_samples(grid, &both[0].0, &both[1].0, [both[0].1.into(), both[1].1.into()])
    }

    /// Rack displacement at which the mean of both wheels' headings is `steer_rad`, at design travel.
    ///
    /// False position with halved ends (Illinois) over the grid, at most 40 evaluations; the ends where out of reach.
    #[must_use]
    pub fn rack_for_mean_steer_m(&self, steer_rad: f64) -> f64 {
        let excess = |rack: f64| {
            0.5 * (self.sides[0].steer_rad(0.0, rack) + self.sides[1].steer_rad(0.0, rack)) - steer_rad
        };
        let grid = self.sides[0].grid();
        let (mut a, mut b) = (grid.rack_min_m, grid.rack_max_m);
        let (mut at_a, mut at_b) = (excess(a), excess(b));
        if at_a * at_b >= 0.0 {
            return if at_a.abs() < at_b.abs() { a } else { b };
        }
        let mut side = 0;
        for _ in 0..40 {
            let next = (a * at_b - b * at_a) / (at_b - at_a);
            let at_next = excess(next);
            if at_next.abs() < 1e-13 || (b - a).abs() < 1e-15 {
                return next;
            }
            if at_next * at_b < 0.0 {
                (a, at_a) = (b, at_b);
                side = 1;
            } else if side == 2 {
                at_a *= 0.5;
            } else {
                side = 2;
            }
            (b, at_b) = (next, at_next);
        }
        b
    }
}
