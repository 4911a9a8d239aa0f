//! One wheel station in a given state: where its wheel is, how it moves, where it touches the road.
//!
//! Everything in body axes. With wheel travel z and rack displacement q (rate q̇ prescribed), the wheel centre
//! is at r(z, q) from the sprung centre of gravity and the knuckle turns by R_BK(z, q); Kane's partial
//! velocities to ż are t = ∂r/∂z and a (angular), those to q̇ are p and b:
//!   v = v_B + ω × r + t ż + p q̇,   Ω = ω + a ż + b q̇.
//! Contact after ISO 8855 / Pacejka, Tyre and Vehicle Dynamics, ch. 2: x_w = s × n normalised, y_w = n × x_w,
//! contact point on the line from the wheel centre along the wheel plane's steepest descent to the road plane.

use crate::kinematics::{KnuckleMap, knuckle_matrix};
use crate::suspension::Deflection;
use nalgebra::{Matrix3, Vector3};

/// Position and motion of a wheel station.
#[derive(Debug, Clone, Copy)]
pub struct Station {
    /// Wheel centre from the sprung centre of gravity. [m]
    pub r: Vector3<f64>,
    /// R_BK.
    pub knuckle: Matrix3<f64>,
    /// Spin axis, to the left.
    pub s: Vector3<f64>,
    /// ∂r/∂z.
    pub t: Vector3<f64>,
    /// Angular velocity of the knuckle per ż. [rad/m]
    pub a: Vector3<f64>,
    /// ∂r/∂q.
    pub p: Vector3<f64>,
    /// Angular velocity of the knuckle per q̇. [rad/m]
    pub b: Vector3<f64>,
    /// Velocity of the wheel centre. [m/s]
    pub v: Vector3<f64>,
    /// Angular velocity of the knuckle. [rad/s]
    pub w: Vector3<f64>,
    /// Acceleration of the wheel centre that is there without accelerations of the coordinates. [m/s²]
    pub bias: Vector3<f64>,
}

/// Motion of the body in body axes, and of the rack.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Velocity of the sprung centre of gravity. [m/s]
    pub v: Vector3<f64>,
    /// Angular velocity. [rad/s]
    pub w: Vector3<f64>,
    /// Rack displacement. [m]
    pub rack: f64,
    /// Rack rate. [m/s]
    pub rack_rate: f64,
}

impl Station {
    /// At travel `z` with rate `z_rate`; `design` is the wheel centre at design from the sprung centre of
    /// gravity.
    #[must_use]
    pub fn new(
        map: &KnuckleMap,
        design: &Vector3<f64>,
        z: f64,
        z_rate: f64,
        deflection: &Deflection,
        m: &Motion,
    ) -> Self {
        let pose = map.pose(z, m.rack);
        let mut value = pose.value;
        value[0] += deflection[0];
        value[1] += deflection[1];
        value[3] += deflection[2];
        value[4] += deflection[3];
        let knuckle = knuckle_matrix(&value);
        let (sp, cp) = value[0].sin_cos();
        let along = Vector3::new(cp, sp, 0.0);
        let across = knuckle.column(1).into_owned();
        let rates = |d: &[f64; 5]| along * d[1] + across * d[2] + Vector3::new(0.0, 0.0, d[0]);
        let r = design + Vector3::new(value[3], value[4], z);
        let t = Vector3::new(pose.per_travel[3], pose.per_travel[4], 1.0);
        let p = Vector3::new(pose.per_rack[3], pose.per_rack[4], 0.0);
        let a = rates(&pose.per_travel);
        let b = rates(&pose.per_rack);
        let relative = t * z_rate + p * m.rack_rate;
        let curve = Vector3::new(pose.per_travel2[3], pose.per_travel2[4], 0.0) * (z_rate * z_rate);
        let turn = m.w.cross(&r);
        Self {
            r,
            knuckle,
            s: knuckle * map.spin_axis_k,
            t,
            a,
            p,
            b,
            v: m.v + turn + relative,
            w: m.w + a * z_rate + b * m.rack_rate,
            bias: m.w.cross(&(turn + relative * 2.0)) + curve,
        }
    }
}

/// Where and how a wheel meets the road plane.
#[derive(Debug, Clone, Copy)]
pub struct Contact {
    /// Forward along the road in the wheel plane.
    pub x: Vector3<f64>,
    /// To the left along the road.
    pub y: Vector3<f64>,
    /// Road normal, up.
    pub n: Vector3<f64>,
    /// From wheel centre to contact point. [m]
    pub c: Vector3<f64>,
    /// Distance wheel centre to contact point. [m]
    pub radius_m: f64,
    /// Rate at which that distance shrinks. [m/s]
    pub closing_m_s: f64,
    /// Inclination of the wheel to the road, top to the right positive. [rad]
    pub inclination_rad: f64,
    /// Speed of the contact point, carried by the wheel but not spinning, along x and y. [m/s]
    pub vx_m_s: f64,
    /// See `vx_m_s`.
    pub vy_m_s: f64,
    /// Rate at which the wheel's heading turns about the normal. [rad/s]
    pub turn_rad_s: f64,
}

impl Contact {
    /// With the plane through a point `height_m` below the wheel centre (along the normal `n`).
    #[must_use]
    pub fn new(station: &Station, n: &Vector3<f64>, height_m: f64, road_rate_m_s: f64) -> Self {
        let s = &station.s;
        let sine = s.dot(n).clamp(-0.999, 0.999);
        let cosine = (1.0 - sine * sine).sqrt();
        let x = s.cross(n) / cosine;
        let y = n.cross(&x);
        // Up in the wheel plane.
        let up = x.cross(s);
        let radius_m = height_m / cosine;
        let c = -up * radius_m;
        let turning = station.w - s * s.dot(&station.w);
        let at_contact = station.v + turning.cross(&c);
        Self {
            x,
            y,
            n: *n,
            c,
            radius_m,
            closing_m_s: (road_rate_m_s - station.v.dot(n)) / cosine,
            inclination_rad: sine.asin(),
            vx_m_s: at_contact.dot(&x),
            vy_m_s: at_contact.dot(&y),
            turn_rad_s: turning.dot(n),
        }
    }

    /// Keeps the contact point at least `least_m` below the wheel centre: of a car on its side a wheel centre may come
    /// under the road, and a lever of the wrong sign would drive the wheel.
    pub fn keep_radius(&mut self, station: &Station, least_m: f64) {
        if self.radius_m >= least_m {
            return;
        }
        self.radius_m = least_m;
        self.c = -self.x.cross(&station.s) * least_m;
        let turning = station.w - station.s * station.s.dot(&station.w);
        let at_contact = station.v + turning.cross(&self.c);
        self.vx_m_s = at_contact.dot(&self.x);
        self.vy_m_s = at_contact.dot(&self.y);
    }
}
