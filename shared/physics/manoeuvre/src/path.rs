//! A driver who follows a path: looks ahead along it and steers onto the arc that leads there
//! [pure pursuit: Wallace et al. 1985; Coulter 1992, CMU-RI-TR-92-01], takes out a lasting lateral error
//! slowly, and has an arm with a lag and limits of angle and rate.
//!
//! Frame: the road's (ISO 8855, x forward at the start, y left). The arc through the aim point at (x, y) in
//! the car's frame has the curvature 2y / (x² + y²); the driver turns the wheel to what the car would need
//! for it, `expected_rad_m` · (1 + (v / v_ch)²) · curvature, v_ch the characteristic speed of the linear
//! single-track model as the driver knows it; what he does not know of the car the slow trim finds.
//! Not modelled: speed choice, prediction by a vehicle model, neuromuscular dynamics.

use crate::curve::Curve;
use crate::shape::Motion;
use config::scenario::{DriverPath, PathFollowing};

/// Distance of the nodes of a path. [m]
const NODE_M: f64 = 0.25;
/// Longest path kept in nodes; longer ones get wider nodes. [m]
const LENGTH_MAX_M: f64 = 20_000.0;
/// Shortest look ahead. [m]
const AHEAD_MIN_M: f64 = 2.0;
/// Largest shift of the aim point that the trim may reach. [m]
const TRIM_MAX_M: f64 = 3.0;
/// Below this speed the trim waits. [m/s]
const TRIM_SPEED_MIN_M_S: f64 = 1.0;

/// A point of a path.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PathPoint {
    /// Forward. [m]
    pub x_m: f64,
    /// Left. [m]
    pub y_m: f64,
    /// Direction, from +x towards +y. [rad]
    pub heading_rad: f64,
    /// Curvature, left positive. [1/m]
    pub curvature_per_m: f64,
}

impl PathPoint {
    /// Further along the arc of this point's curvature.
    fn further(&self, along_m: f64) -> Self {
        let turn = self.curvature_per_m * along_m;
        let half = 0.5 * turn;
        let chord = if half.abs() < 1e-6 { along_m } else { along_m * half.sin() / half };
        let (sine, cosine) = (self.heading_rad + half).sin_cos();
        Self {
            x_m: self.x_m + chord * cosine,
            y_m: self.y_m + chord * sine,
            heading_rad: self.heading_rad + turn,
            curvature_per_m: self.curvature_per_m,
        }
    }
}

/// A path by its length: nodes at equal distances, each an arc to the next; the last arc goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct Path {
    node_m: f64,
    nodes: Vec<PathPoint>,
}

impl Path {
    /// Lays out a path.
    pub fn new(path: &DriverPath) -> Self {
        match path {
            DriverPath::Circle { radius_m, straight_m, transition_m } => {
                let last = straight_m + transition_m;
                let node_m = NODE_M.max(last / LENGTH_MAX_M * NODE_M);
                let curvature = |s: f64| ((s - straight_m) / transition_m).clamp(0.0, 1.0) / radius_m;
                let count = (last / node_m).ceil() as usize + 2;
                let mut point = PathPoint::default();
                let nodes = (0..count)
                    .map(|i| {
                        // The mean curvature of the piece ahead: exact heading on a clothoid.
                        let s = i as f64 * node_m;
                        point.curvature_per_m = curvature(s + 0.5 * node_m);
                        let node = point;
                        point = point.further(node_m);
                        node
                    })
                    .collect();
                Self { node_m, nodes }
            }
            DriverPath::DoubleLaneChangeIso3888Part1 { straight_m, vehicle_width_m } => {
                // ISO 3888-1: sections of 15, 30, 25, 25, 15 and 15 m; widths 1.1 b, 1.2 b and 1.3 b, each + 0.25 m;
                // the middle lane's right edge lies 3.5 m left of the outer ones'. Along the lanes' middles; the
                // driver uses the ends of the lanes, 5 to 7 m of each.
                let [b, from] = [*vehicle_width_m, *straight_m];
                let [aside, back] = [3.5 + 0.05 * b, 0.1 * b];
                Self::through(
                    vec![0.0, from + 9.0, from + 50.0, from + 64.0, from + 102.0, from + 125.0],
                    vec![0.0, 0.0, aside, aside, back, back],
                )
            }
            DriverPath::ObstacleAvoidanceIso3888Part2 { straight_m, vehicle_width_m } => {
                // ISO 3888-2: sections of 12, 13.5, 11, 12.5 and 12 m; widths 1.1 b + 0.25 m, b + 1 m and
                // 1.3 b + 0.25 m (at least 3 m); the middle lane begins 1 m left of the first one's edge.
                let [b, from] = [*vehicle_width_m, *straight_m];
                let [first, middle, last] = [1.1 * b + 0.25, b + 1.0, (1.3 * b + 0.25).max(3.0)];
                let aside = 0.5 * first + 1.0 + 0.5 * middle;
                let back = 0.5 * (last - first);
                Self::through(
                    vec![0.0, from + 10.5, from + 26.5, from + 35.5, from + 50.5, from + 61.0],
                    vec![0.0, 0.0, aside, aside, back, back],
                )
            }
            DriverPath::Points { x_m, y_m } => Self::through(x_m.clone(), y_m.clone()),
        }
    }

    /// Along a smooth curve through points y(x).
    fn through(x_m: Vec<f64>, y_m: Vec<f64>) -> Self {
        let (first, last) = (x_m[0], x_m[x_m.len() - 1]);
        let curve = Curve::new(x_m, y_m);
        let node_m = NODE_M.max((last - first) / LENGTH_MAX_M * NODE_M);
        let mut x = first;
        let mut nodes: Vec<PathPoint> = Vec::new();
        while x < last {
            let here = curve.at(x);
            let heading_rad = here.rate.atan();
            nodes.push(PathPoint { x_m: x, y_m: here.value, heading_rad, curvature_per_m: 0.0 });
            // Midpoint rule along the arc length.
            let half = curve.at(x + 0.5 * node_m * heading_rad.cos());
            x += node_m * half.rate.atan().cos();
        }
        for i in 1..nodes.len() {
            let turn = nodes[i].heading_rad - nodes[i - 1].heading_rad;
            nodes[i - 1].curvature_per_m = turn / node_m;
        }
        Self { node_m, nodes }
    }

    /// The point at a length from the begin; straight on before it.
    pub fn at(&self, station_m: f64) -> PathPoint {
        let last = self.nodes.len() - 1;
        if station_m <= 0.0 {
            let straight = PathPoint { curvature_per_m: 0.0, ..self.nodes[0] };
            return straight.further(station_m);
        }
        let i = ((station_m / self.node_m) as usize).min(last);
        self.nodes[i].further(station_m - i as f64 * self.node_m)
    }

    /// The station closest to a point, searched from a station nearby. Bounded.
    fn closest(&self, near_m: f64, x_m: f64, y_m: f64) -> f64 {
        let mut station = near_m;
        for _ in 0..4 {
            let point = self.at(station);
            let (sine, cosine) = point.heading_rad.sin_cos();
            let ahead = (x_m - point.x_m) * cosine + (y_m - point.y_m) * sine;
            station += ahead.clamp(-2.0, 2.0);
        }
        station
    }
}

/// What the driver sees of the car.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Observed {
    /// Position of the car's reference point (front axle or centre of gravity), forward. [m]
    pub x_m: f64,
    /// The same, left. [m]
    pub y_m: f64,
    /// Yaw angle. [rad]
    pub yaw_rad: f64,
    /// Speed forward. [m/s]
    pub speed_m_s: f64,
}

/// The driver's output of one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct DriverSteering {
    /// Hand-wheel angle and rate. [rad], [rad/s]
    pub wheel: Motion,
    /// Distance from the car to the path, positive with the path on the left. [m]
    pub lateral_error_m: f64,
    /// The observation was not finite: the wheel was held.
    pub held: bool,
}

/// The path-following driver.
#[derive(Debug, Clone, PartialEq)]
pub struct PathDriver {
    path: Path,
    preview_s: f64,
    lag_s: f64,
    expected_rad_m: f64,
    characteristic_m_s: f64,
    trim_per_s: f64,
    angle_max: f64,
    rate_max: f64,
    station_m: f64,
    trim_m: f64,
    angle: f64,
    error_m: f64,
}

impl PathDriver {
    /// A driver at the begin of the path, wheel straight.
    pub fn new(following: &PathFollowing) -> Self {
        Self {
            path: Path::new(&following.path),
            preview_s: following.preview_s,
            lag_s: following.lag_s,
            expected_rad_m: following.expected_rad_m,
            characteristic_m_s: following.characteristic_speed_km_h / 3.6,
            trim_per_s: following.trim_per_s,
            angle_max: following.angle_max_deg.to_radians(),
            rate_max: following.rate_max_deg_s.to_radians(),
            station_m: 0.0,
            trim_m: 0.0,
            angle: 0.0,
            error_m: 0.0,
        }
    }

    /// The path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// One step of `dt_s` (> 0).
    pub fn step(&mut self, seen: &Observed, dt_s: f64) -> DriverSteering {
        let finite = [seen.x_m, seen.y_m, seen.yaw_rad, seen.speed_m_s].iter().all(|x| x.is_finite());
        if !finite {
            let wheel = Motion::rest(self.angle);
            return DriverSteering { wheel, lateral_error_m: self.error_m, held: true };
        }
        self.station_m = self.path.closest(self.station_m, seen.x_m, seen.y_m);
        let here = self.path.at(self.station_m);
        let (sine, cosine) = here.heading_rad.sin_cos();
        self.error_m = (here.y_m - seen.y_m) * cosine - (here.x_m - seen.x_m) * sine;

        let ahead_m = (self.preview_s * seen.speed_m_s).max(AHEAD_MIN_M);
        let aim = self.path.at(self.station_m + ahead_m);
        let (sine, cosine) = seen.yaw_rad.sin_cos();
        let (dx, dy) = (aim.x_m - seen.x_m, aim.y_m - seen.y_m);
        let (aim_x, aim_y) = (dx * cosine + dy * sine, dy * cosine - dx * sine + self.trim_m);
        let reach_m2 = (aim_x * aim_x + aim_y * aim_y).max(0.25 * ahead_m * ahead_m);
        let understeer = 1.0 + (seen.speed_m_s / self.characteristic_m_s).powi(2);
        let wanted = self.expected_rad_m * understeer * 2.0 * aim_y / reach_m2;
        if wanted.abs() < self.angle_max && seen.speed_m_s > TRIM_SPEED_MIN_M_S {
            let trim = self.trim_m + self.trim_per_s * self.error_m * dt_s;
            self.trim_m = trim.clamp(-TRIM_MAX_M, TRIM_MAX_M);
        }

        let wanted = wanted.clamp(-self.angle_max, self.angle_max);
        let most = self.rate_max * dt_s;
        let change = ((wanted - self.angle) * -(-dt_s / self.lag_s).exp_m1()).clamp(-most, most);
        self.angle += change;
        let wheel = Motion { value: self.angle, rate: change / dt_s };
        DriverSteering { wheel, lateral_error_m: self.error_m, held: false }
    }

    /// Length of the state. [f64s]
    pub fn state_len(&self) -> usize {
        4
    }

    /// Writes the state into the first [`Self::state_len`] places.
    pub fn save_state(&self, state: &mut [f64]) {
        state[..4].copy_from_slice(&[self.station_m, self.trim_m, self.angle, self.error_m]);
    }

    /// Takes a saved state over.
    pub fn load_state(&mut self, state: &[f64]) {
        [self.station_m, self.trim_m, self.angle, self.error_m] = [state[0], state[1], state[2], state[3]];
    }
}
