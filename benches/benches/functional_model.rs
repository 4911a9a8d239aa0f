//! One sub-step (0.1 ms) of the rack-EPS steering unit: composed from its model file, against the same equations and
//! the same rule (implicit midpoint, Newton's method to the same accuracy) written by hand, in the same run, in
//! alternating blocks. By hand twice: as a general program would (all ten states, full Jacobian, dense LU), and reduced
//! on paper to the two speeds. Before anything is timed, all three must agree on the drive.
//!
//! `cargo bench -p kingpin_benches --bench functional_model`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark prints, and may fail loudly")]

use functional_model::{CompileOptions, Compiled, Model, Parameters};
use kingpin_benches::{
    Contender, Durations, alternate, pin_to_core, print_against_baselines, print_machine, sized, time_batches,
};
use std::f64::consts::TAU;
use std::hint::black_box;

const MODEL: &str = include_str!("../../schemas/models/rack_eps.toml");
const STEP_S: f64 = 1e-4;

const J: f64 = 0.038;
const D: f64 = 0.01;
const BAR: f64 = 2.0 * 180.0 / std::f64::consts::PI;
const BAR_D: f64 = 0.1;
const I: f64 = 0.05 / TAU;
const LEAD: f64 = 0.007 / TAU;
const MASS: f64 = 3.0 + 3.1e-4 / (LEAD * LEAD);
const COLUMN: Contact =
    Contact { coulomb: 0.15, excess: 0.02, stiffness: 30.0, damping: 0.02, stribeck: 0.05 };
const RACK: Contact = Contact { coulomb: 150.0, excess: 20.0, stiffness: 3e6, damping: 2e3, stribeck: 0.005 };
const LAG: f64 = 5e-4;
const PHASE_LEAD: f64 = 5e-3;
const PHASE_LAG: f64 = 5e-4;
const X: [f64; 6] = [0.0, 0.8, 2.0, 4.0, 6.0, 8.0];
const Y: [f64; 4] = [0.0, 10.0, 30.0, 60.0];
const MAP: [[f64; 4]; 6] = [
    [0.0, 0.0, 0.0, 0.0],
    [100.0, 60.0, 20.0, 10.0],
    [1500.0, 900.0, 400.0, 200.0],
    [5500.0, 3200.0, 1500.0, 800.0],
    [9000.0, 6000.0, 3000.0, 1600.0],
    [9500.0, 7000.0, 4000.0, 2200.0],
];

/// LuGre friction.
struct Contact {
    coulomb: f64,
    excess: f64,
    stiffness: f64,
    damping: f64,
    stribeck: f64,
}

impl Contact {
    /// s|v|/g and its derivative along v.
    fn wear(&self, v: f64) -> (f64, f64) {
        let r = v / self.stribeck;
        let e = self.excess * (-r * r).exp();
        let g = self.coulomb + e;
        let rate = self.stiffness * v.abs() / g;
        let slope = self.stiffness * v.signum() / g + rate / g * e * 2.0 * r / self.stribeck;
        (rate, slope)
    }
}

#[derive(Clone, Copy, Default)]
struct Input {
    hand: f64,
    rack: f64,
    speed: f64,
}

/// Assist force at the rack and its derivatives along torque led, speed of the rack, its position.
fn assist(led: f64, v: f64, x: f64, speed: f64) -> (f64, f64, f64, f64) {
    let (s, at) = (led.signum(), led.abs());
    let mut i = 0;
    while i < 4 && X[i + 1] <= at {
        i += 1;
    }
    let mut j = 0;
    while j < 2 && Y[j + 1] <= speed {
        j += 1;
    }
    let t = ((at - X[i]) / (X[i + 1] - X[i])).min(1.0);
    let q = ((speed - Y[j]) / (Y[j + 1] - Y[j])).clamp(0.0, 1.0);
    let low = MAP[i][j] + (MAP[i][j + 1] - MAP[i][j]) * q;
    let high = MAP[i + 1][j] + (MAP[i + 1][j + 1] - MAP[i + 1][j]) * q;
    let slope = if at < X[5] { (high - low) / (X[i + 1] - X[i]) } else { 0.0 };
    let fade = (speed / 5.0).min(1.0);
    let (back, back_slope) =
        if (4000.0 * x).abs() < 150.0 { (4000.0 * x, 4000.0) } else { (150.0 * x.signum(), 0.0) };
    (s * (low + (high - low) * t) - 600.0 * v - back * fade, slope, -600.0, -back_slope * fade)
}

/// End stop: force and derivatives along position and speed.
fn stop(x: f64, v: f64) -> (f64, f64, f64) {
    let over = (x - 0.075).max(0.0) + (x + 0.075).min(0.0);
    if over == 0.0 {
        return (0.0, 0.0, 0.0);
    }
    let deep = (1000.0 * over.abs()).min(1.0);
    let deepening = if deep < 1.0 { 1000.0 * over.signum() } else { 0.0 };
    (5e6 * over + 5e5 * deep * v, 5e6 + 5e5 * deepening * v, 5e5 * deep)
}

fn demand(force: f64) -> (f64, f64) {
    let wanted = force * LEAD;
    if wanted.abs() < 12.0 { (wanted, LEAD) } else { (12.0 * wanted.signum(), 0.0) }
}

/// w, v, angle, x, twist, column bristle, rack bristle, filter, motor torque.
type Nine = [f64; 9];
const W: usize = 0;
const V: usize = 1;
const ANGLE: usize = 2;
const POSITION: usize = 3;
const TWIST: usize = 4;
const ZC: usize = 5;
const ZR: usize = 6;
const FILTER: usize = 7;
const MOTOR: usize = 8;

/// What a rig reads after a step.
#[derive(Clone, Copy, Default)]
#[allow(dead_code)] // Read by hand when the two disagree.
struct Read {
    angle: f64,
    w: f64,
    torque: f64,
    x: f64,
    v: f64,
    assist: f64,
    motor: f64,
}

/// Outputs with the force of the ball screw, which needs the rack's acceleration.
fn read(s: &Nine, u: &Input) -> Read {
    let torque = BAR * s[TWIST] + BAR_D * (s[W] - s[V] / I);
    let zr = s[V] - RACK.wear(s[V]).0 * s[ZR];
    let friction = RACK.stiffness * s[ZR] + RACK.damping * zr;
    let force = torque / I + s[MOTOR] / LEAD - friction - stop(s[POSITION], s[V]).0 + u.rack;
    let acceleration = force / MASS;
    let assist = s[MOTOR] / LEAD - (MASS - 3.0) * acceleration;
    Read { angle: s[ANGLE], w: s[W], torque, x: s[POSITION], v: s[V], assist, motor: s[MOTOR] }
}

/// Reduced on paper: everything at the middle of the step follows from the two speeds there.
struct Reduced {
    s: Nine,
    guess: [f64; 2],
}

impl Reduced {
    fn step(&mut self, u: &Input) -> Read {
        let (s, h) = (&mut self.s, 0.5 * STEP_S);
        let (a, b) = (h / PHASE_LAG, h / LAG);
        let [mut w, mut v] = self.guess;
        let mut middle = *s;
        for _ in 0..25 {
            let (rc, rc1) = COLUMN.wear(w);
            let (rr, rr1) = RACK.wear(v);
            let (nc, nr) = (1.0 / (1.0 + h * rc), 1.0 / (1.0 + h * rr));
            let (zc, zr) = ((s[ZC] + h * w) * nc, (s[ZR] + h * v) * nr);
            let (zc1, zr1) = (h * nc * (1.0 - rc1 * zc), h * nr * (1.0 - rr1 * zr));
            let twist = s[TWIST] + h * (w - v / I);
            let torque = BAR * twist + BAR_D * (w - v / I);
            let stiff = BAR * h + BAR_D;
            let filter = (s[FILTER] + a * torque) / (1.0 + a);
            let led = filter + PHASE_LEAD / PHASE_LAG * (torque - filter);
            let led1 = a / (1.0 + a) + PHASE_LEAD / PHASE_LAG * (1.0 - a / (1.0 + a));
            let x = s[POSITION] + h * v;
            let (force, fl, fv, fx) = assist(led, v, x, u.speed);
            let (wanted, part) = demand(force);
            let motor = (s[MOTOR] + b * wanted) / (1.0 + b);
            let m1 = part * b / (1.0 + b);
            let (fs, fsx, fsv) = stop(x, v);
            let tc = COLUMN.stiffness * zc + COLUMN.damping * (w - rc * zc);
            let tc1 = COLUMN.stiffness * zc1 + COLUMN.damping * (1.0 - rc1 * zc - rc * zc1);
            let fr = RACK.stiffness * zr + RACK.damping * (v - rr * zr);
            let fr1 = RACK.stiffness * zr1 + RACK.damping * (1.0 - rr1 * zr - rr * zr1);
            let f0 = w - s[W] - h / J * (u.hand - D * w - tc - torque);
            let f1 = v - s[V] - h / MASS * (torque / I + motor / LEAD - fr - fs + u.rack);
            let j00 = 1.0 + h / J * (D + tc1 + stiff);
            let j01 = -h / J * stiff / I;
            let j10 = -h / MASS * (stiff / I + m1 * fl * led1 * stiff / LEAD);
            let j11 = 1.0
                + h / MASS
                    * (stiff / (I * I) - m1 / LEAD * (-fl * led1 * stiff / I + fv + fx * h)
                        + fr1
                        + fsv
                        + fsx * h);
            let det = j00 * j11 - j01 * j10;
            let (dw, dv) = ((f0 * j11 - j01 * f1) / det, (j00 * f1 - j10 * f0) / det);
            w -= dw;
            v -= dv;
            middle = [w, v, s[ANGLE] + h * w, x, twist, zc, zr, filter, motor];
            if dw.abs() < 1e-8 * (w.abs() + 1e-4) && dv.abs() < 1e-8 * (v.abs() + 1e-4) {
                break;
            }
        }
        // The last correction moved the speeds: what follows from them once more.
        middle[TWIST] = s[TWIST] + h * (w - v / I);
        middle[POSITION] = s[POSITION] + h * v;
        middle[ANGLE] = s[ANGLE] + h * w;
        for k in 0..9 {
            s[k] = 2.0 * middle[k] - s[k];
        }
        self.guess = [s[W], s[V]];
        read(s, u)
    }
}

/// As a general program would: Newton's method on all states, full Jacobian by hand, dense LU with pivoting.
struct General {
    s: Nine,
}

impl General {
    fn rates(s: &Nine, u: &Input, f: &mut Nine, g: &mut [[f64; 9]; 9]) {
        let ((rc, rc1), (rr, rr1)) = (COLUMN.wear(s[W]), RACK.wear(s[V]));
        let torque = BAR * s[TWIST] + BAR_D * (s[W] - s[V] / I);
        let led = s[FILTER] + PHASE_LEAD / PHASE_LAG * (torque - s[FILTER]);
        let lead = PHASE_LEAD / PHASE_LAG;
        let (force, fl, fv, fx) = assist(led, s[V], s[POSITION], u.speed);
        let (wanted, part) = demand(force);
        let (fs, fsx, fsv) = stop(s[POSITION], s[V]);
        let (zc, zr) = (s[W] - rc * s[ZC], s[V] - rr * s[ZR]);
        let tc = COLUMN.stiffness * s[ZC] + COLUMN.damping * zc;
        let fr = RACK.stiffness * s[ZR] + RACK.damping * zr;
        *f = [
            (u.hand - D * s[W] - tc - torque) / J,
            (torque / I + s[MOTOR] / LEAD - fr - fs + u.rack) / MASS,
            s[W],
            s[V],
            s[W] - s[V] / I,
            zc,
            zr,
            (torque - s[FILTER]) / PHASE_LAG,
            (wanted - s[MOTOR]) / LAG,
        ];
        *g = [[0.0; 9]; 9];
        g[W][W] = -(D + COLUMN.damping * (1.0 - rc1 * s[ZC]) + BAR_D) / J;
        g[W][V] = BAR_D / I / J;
        g[W][TWIST] = -BAR / J;
        g[W][ZC] = -(COLUMN.stiffness - COLUMN.damping * rc) / J;
        g[V][W] = BAR_D / I / MASS;
        g[V][V] = (-BAR_D / (I * I) - RACK.damping * (1.0 - rr1 * s[ZR]) - fsv) / MASS;
        g[V][POSITION] = -fsx / MASS;
        g[V][TWIST] = BAR / I / MASS;
        g[V][ZR] = -(RACK.stiffness - RACK.damping * rr) / MASS;
        g[V][MOTOR] = 1.0 / LEAD / MASS;
        g[ANGLE][W] = 1.0;
        g[POSITION][V] = 1.0;
        g[TWIST][W] = 1.0;
        g[TWIST][V] = -1.0 / I;
        g[ZC][W] = 1.0 - rc1 * s[ZC];
        g[ZC][ZC] = -rc;
        g[ZR][V] = 1.0 - rr1 * s[ZR];
        g[ZR][ZR] = -rr;
        g[FILTER][W] = BAR_D / PHASE_LAG;
        g[FILTER][V] = -BAR_D / I / PHASE_LAG;
        g[FILTER][TWIST] = BAR / PHASE_LAG;
        g[FILTER][FILTER] = -1.0 / PHASE_LAG;
        let m = part / LAG;
        g[MOTOR][W] = m * fl * lead * BAR_D;
        g[MOTOR][V] = m * (-fl * lead * BAR_D / I + fv);
        g[MOTOR][POSITION] = m * fx;
        g[MOTOR][TWIST] = m * fl * lead * BAR;
        g[MOTOR][FILTER] = m * fl * (1.0 - lead);
        g[MOTOR][MOTOR] = -1.0 / LAG;
    }

    fn step(&mut self, u: &Input) -> Read {
        let h = 0.5 * STEP_S;
        let mut middle = self.s;
        let (mut f, mut g) = ([0.0; 9], [[0.0; 9]; 9]);
        for _ in 0..25 {
            Self::rates(&middle, u, &mut f, &mut g);
            let mut r: Nine = std::array::from_fn(|i| middle[i] - self.s[i] - h * f[i]);
            for i in 0..9 {
                for j in 0..9 {
                    g[i][j] = f64::from(u8::from(i == j)) - h * g[i][j];
                }
            }
            solve(&mut g, &mut r);
            let mut done = true;
            for i in 0..9 {
                middle[i] -= r[i];
                done &= r[i].abs() < 1e-8 * (middle[i].abs() + 1e-4);
            }
            if done {
                break;
            }
        }
        for i in 0..9 {
            self.s[i] = 2.0 * middle[i] - self.s[i];
        }
        read(&self.s, u)
    }
}

fn solve(a: &mut [[f64; 9]; 9], b: &mut Nine) {
    for k in 0..9 {
        let mut best = k;
        for i in k + 1..9 {
            if a[i][k].abs() > a[best][k].abs() {
                best = i;
            }
        }
        a.swap(k, best);
        b.swap(k, best);
        for i in k + 1..9 {
            let f = a[i][k] / a[k][k];
            if f != 0.0 {
                for j in k..9 {
                    a[i][j] -= f * a[k][j];
                }
                b[i] -= f * b[k];
            }
        }
    }
    for i in (0..9).rev() {
        let mut s = b[i];
        for j in i + 1..9 {
            s -= a[i][j] * b[j];
        }
        b[i] = s / a[i][i];
    }
}

/// The composed unit.
struct Composed {
    c: Compiled,
    u: Vec<f64>,
    at: [usize; 4],
    outputs: [usize; 7],
}

impl Composed {
    fn new(account: bool) -> Self {
        let model = Model::from_toml(MODEL, "rack_eps.toml", &|name| Err(format!("no {name}"))).unwrap();
        let system = model.compose(&Parameters::new()).unwrap();
        let c = system.compile(CompileOptions { account, ..CompileOptions::default() }).unwrap();
        let at = ["hand.T", "left.fl", "right.fr", "vehicle_speed"].map(|n| c.input_index(n).unwrap());
        let outputs = [
            "hand_angle",
            "hand_speed",
            "torsion_torque",
            "rack_position",
            "rack_velocity",
            "assist_force",
            "motor_torque",
        ]
        .map(|n| c.output_index(n).unwrap());
        Self { u: vec![0.0; c.input_names().len()], c, at, outputs }
    }

    fn step(&mut self, u: &Input) -> Read {
        for (k, v) in self.at.iter().zip([u.hand, 0.5 * u.rack, -0.5 * u.rack, u.speed]) {
            self.u[*k] = v;
        }
        self.c.step(&self.u, STEP_S);
        let o = self.c.outputs();
        let [angle, w, torque, x, v, assist, motor] = self.outputs.map(|k| o[k]);
        Read { angle, w, torque, x, v, assist, motor }
    }
}

/// A lively drive: the driver's torque and a spring at the rack.
struct Drive {
    k: u64,
    last: Read,
}

impl Drive {
    fn new() -> Self {
        Self { k: 0, last: Read::default() }
    }

    fn run(&mut self, step: &mut dyn FnMut(&Input) -> Read) {
        let t = self.k as f64 * STEP_S;
        let u = Input {
            hand: 3.0 * (TAU * 0.5 * t).sin(),
            rack: -1.2e5 * self.last.x + 80.0 * (60.0 * t).sin(),
            speed: 20.0,
        };
        self.last = step(&u);
        black_box(&self.last);
        self.k += 1;
    }
}

fn main() {
    pin_to_core(1);
    print_machine();
    let mut composed = Composed::new(false);
    let mut accounted = Composed::new(true);
    let mut general = General { s: [0.0; 9] };
    let mut reduced = Reduced { s: [0.0; 9], guess: [0.0; 2] };

    // They are the same equations: the same drive gives the same motion.
    let mut drives = [Drive::new(), Drive::new(), Drive::new()];
    let mut worst = 0.0f64;
    for _ in 0..20_000 {
        drives[0].run(&mut |u| composed.step(u));
        drives[1].run(&mut |u| general.step(u));
        drives[2].run(&mut |u| reduced.step(u));
        let [a, b, c] = [0, 1, 2].map(|k| drives[k].last);
        for (one, size) in [(&b, 1.0), (&c, 1.0)] {
            worst = worst.max((a.x - one.x).abs() / 0.02 * size);
            worst = worst.max((a.torque - one.torque).abs() / 3.0 * size);
            worst = worst.max((a.assist - one.assist).abs() / 1000.0 * size);
        }
    }
    println!(
        "\n  composed and by hand on the same drive of 2 s: largest difference {worst:.1e} of the range\n"
    );
    assert!(worst < 1e-6, "not the same equations: {worst:e}");

    let blocks = sized(40, 2);
    let batches = sized(200, 5);
    let batch = 50;
    let [mut d0, mut d1, mut d2, mut d3] = [Drive::new(), Drive::new(), Drive::new(), Drive::new()];
    let mut contenders: [Contender<'_>; 4] = [
        (
            "by hand, general Newton",
            Box::new(move |out: &mut Durations| {
                time_batches(out, batches, batch, |_| d0.run(&mut |u| general.step(u)));
            }),
        ),
        (
            "by hand, reduced on paper",
            Box::new(move |out: &mut Durations| {
                time_batches(out, batches, batch, |_| d1.run(&mut |u| reduced.step(u)));
            }),
        ),
        (
            "composed",
            Box::new(move |out: &mut Durations| {
                time_batches(out, batches, batch, |_| d2.run(&mut |u| composed.step(u)));
            }),
        ),
        (
            "composed, with account",
            Box::new(move |out: &mut Durations| {
                time_batches(out, batches, batch, |_| d3.run(&mut |u| accounted.step(u)));
            }),
        ),
    ];
    let rows = alternate(blocks, &mut contenders);
    let table: Vec<(&Durations, usize)> = rows.iter().map(|r| (r, 0)).collect();
    print_against_baselines("One sub-step of the rack-EPS unit", &table);
    let p50 = |k: usize| rows[k].quantile_ns(0.5);
    println!(
        "\n  composed over by hand: {:.2} (general Newton), {:.2} (reduced on paper); with account {:.2}, {:.2}",
        p50(2) / p50(0),
        p50(2) / p50(1),
        p50(3) / p50(0),
        p50(3) / p50(1)
    );
}
