//! Systems with a closed form (spec 5.7): turning frames, rigid joins, gyrators, linear networks.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use functional_model::{CompileOptions, Compiled, Matrices, Method, OperatingPoint, Parameters, System};
use support::{model, relative, show};

fn system(text: &str) -> System {
    show(model(text).compose(&Parameters::new()))
}

fn run(text: &str, method: Method) -> Compiled {
    show(system(text).compile(CompileOptions { method: Some(method), account: true }))
}

/// E^-1 of the small systems here.
fn solved(m: &Matrices, rhs: Vec<f64>) -> Vec<f64> {
    let n = m.states.len();
    let e = nalgebra::DMatrix::from_fn(n, n, |i, j| m.e[i][j]);
    e.lu().solve(&nalgebra::DVector::from_vec(rhs)).unwrap().as_slice().to_vec()
}

const FREE_MASS: &str = r#"
dim = 2
free = ["mass.body"]
[start]
"mass.v" = "[3, 1] m/s"
[observe]
v = "mass.v"
p = "mass.p"
[parts.mass]
turn = "TURN"
states = { v = "m/s", p = "m" }
ports.body = { across = "vb [m/s]", through = "f [N]", gives = "across" }
columns = ["v", "p", "f"]
rows."(2 kg)*v'" = ["0", "0", "-1"]
rows."p'" = ["1", "0", "0"]
rows.vb = ["1", "0", "0"]
energy = "0.5*2 kg*dot(v, v)"
"#;

#[test]
fn a_free_mass_in_a_turning_frame_goes_straight() {
    // The start is in the frame that turns (angle 0 at the start).
    let mut still = run(&FREE_MASS.replace("TURN", "0 deg"), Method::Explicit);
    let mut turning = run(&FREE_MASS.replace("TURN", "5 rad/s^2*t^2 + 2 rad/s*t"), Method::Explicit);
    for _ in 0..2000 {
        still.step(&[], 1e-3);
        turning.step(&[], 1e-3);
    }
    let off = relative(turning.outputs(), still.outputs());
    println!("free mass, frame turned by {} rad: {off:.1e}", 5.0 * 4.0 + 4.0);
    assert!((still.output("p.x").unwrap() - 6.0).abs() < 1e-10);
    assert!(off < 1e-7);
    // Without the transport term it curves: the test can fail.
    let cut = FREE_MASS
        .replace("v = \"m/s\"", "v = { unit = \"m/s\", transport = false }")
        .replace("TURN", "2 rad/s*t");
    let mut curved = run(&cut, Method::Explicit);
    for _ in 0..2000 {
        curved.step(&[], 1e-3);
    }
    assert!(relative(curved.outputs(), still.outputs()) > 0.1);
    assert!(curved.account().unwrap().imbalance_j().abs() < 1e-9, "every energy check stays perfect");
}

#[test]
fn bead_on_a_rotating_rod() {
    let text = r#"
dim = 2
[parameters]
W = "2 rad/s"
m = "0.5 kg"
[start]
"rod.guide.r" = "0.1 m"
[observe]
r = "rod.guide.r"
T = "rod.guide.T"
[parts.motor]
dim = 0
ports.shaft = { across = "w [rad/s]", through = "T [N*m]", gives = "across", kind = "scalar" }
equations.w = "W"
[parts.rod]
turn = "W*t"
ports.hub = "guide.hub"
parts.guide.states = { r = { unit = "m", kind = "scalar" } }
parts.guide.ports.hub = { across = "w [rad/s]", through = "T [N*m]", gives = "through", kind = "scalar" }
parts.guide.ports.bead = { across = "v [m/s]", through = "f [N]", gives = "through" }
parts.guide.equations = { "r'" = "v.x", "f.x" = "0", "0" = "v.y - w*r", "T" = "-f.y*r" }
parts.bead.states = { v = "m/s" }
parts.bead.ports.body = { across = "vb [m/s]", through = "f [N]", gives = "across" }
parts.bead.equations = { "m*v'" = "-f", "vb" = "v" }
parts.bead.energy = "0.5*m*dot(v, v)"
couplings = [{ join = ["bead.body", "guide.bead"] }]
[[couplings]]
join = ["motor.shaft", "rod.hub"]
"#;
    let mut c = run(text, Method::Explicit);
    println!("bead: states {:?}", c.state_names());
    let (w, m, r0, dt): (f64, f64, f64, f64) = (2.0, 0.5, 0.1, 1e-3);
    let mut worst = 0.0f64;
    for k in 1..=1500 {
        c.step(&[], dt);
        let t = k as f64 * dt;
        let (r, torque) = (r0 * (w * t).cosh(), m * r0 * r0 * w * w * (2.0 * w * t).sinh());
        worst = worst
            .max((c.output("r").unwrap() / r - 1.0).abs())
            .max((c.output("T").unwrap() / torque - 1.0).abs());
    }
    println!("bead on a rod: r and torque off by {worst:.1e}");
    assert!(worst < 1e-9, "{worst:e}");
    assert!(c.account().unwrap().worst_residual() < 1e-12);
}

#[test]
fn chaplygin_sleigh() {
    let text = r#"
dim = 2
[parameters]
m = "3 kg"
J = "0.4 kg*m^2"
l = "0.5 m"
[start]
"sleigh.body.w" = "0.7 rad/s"
"sleigh.body.v" = "[1.2, 0.35] m/s"
"sleigh.body.theta" = "0.3 rad"
[observe]
w = "sleigh.body.w"
v = { of = "sleigh.body.v", in = "sleigh" }
[parts.sleigh]
turn = "sleigh.body.theta"
couplings = [{ join = ["body.blade", "ice.edge"] }]
[parts.sleigh.parts.body]
states = { v = "m/s", w = { unit = "rad/s", kind = "scalar" }, theta = { unit = "rad", kind = "scalar" } }
ports.blade = { across = "vb [m/s]", through = "f [N]", gives = "across" }
equations = { "m*v'" = "-f", "J*w'" = "l*f.y", "theta'" = "w", vb = "[v.x, v.y - l*w]" }
energy = "0.5*m*dot(v, v) + 0.5*J*w^2"
[parts.sleigh.parts.ice]
ports.edge = { across = "v [m/s]", through = "f [N]", gives = "through" }
equations = { "f.x" = "0", "0" = "v.y" }
"#;
    let mut c = run(text, Method::Explicit);
    println!("sleigh: states {:?}", c.state_names());
    let (m, j, l): (f64, f64, f64) = (3.0, 0.4, 0.5);
    let kappa = (j + m * l * l) / m;
    let (v0, w0): (f64, f64) = (1.2, 0.7);
    // v = c tanh r(t + t0), w = (c / sqrt kappa) sech r(t + t0): v^2 + kappa w^2 = c^2.
    let speed = (v0 * v0 + kappa * w0 * w0).sqrt();
    let r = speed * l / kappa;
    let t0 = (v0 / speed).atanh() / r;
    let mut worst = 0.0f64;
    for k in 1..=2000 {
        c.step(&[], 1e-3);
        let s = r * (k as f64 * 1e-3 + t0);
        worst = worst.max((c.output("v.x").unwrap() - speed * s.tanh()).abs());
        worst = worst.max((c.output("w").unwrap() - speed / kappa.sqrt() / s.cosh()).abs());
    }
    println!("Chaplygin sleigh: {worst:.1e} m/s, rad/s");
    assert!(worst < 1e-9, "{worst:e}");
    let a = c.account().unwrap();
    assert!(a.imbalance_j().abs() < 1e-9 && a.worst_residual() < 1e-10);
}

/// A link: a body in a frame turned by its own angle, with arms to its two ends.
const ARM: &str = r#"
dim = 2
fixed = ["first.base"]
[ports]
tau1 = { of = "first.shaft", positive = "in" }
tau2 = { of = "second.shaft", positive = "in" }
[parameters]
l1 = "0.8 m"
l2 = "0.6 m"
[start]
"first.body.w" = "0.9 rad/s"
"second.body.w" = "-1.3 rad/s"
"first.body.theta" = "0.4 rad"
"second.body.theta" = "1.1 rad"
[parts.first]
use = "model.link"
turn = "first.body.theta"
set = { m = "3 kg", J = "0.2 kg*m^2", c = "0.35 m", l = "l1" }
[parts.second]
use = "model.link"
turn = "second.body.theta"
set = { m = "2 kg", J = "0.1 kg*m^2", c = "0.25 m", l = "l2" }
free = []
[[couplings]]
join = ["first.tip", "second.base"]
[model.link]
ports = { base = "to_base.end", tip = "to_tip.end", shaft = "body.shaft" }
parameters = { m = "1 kg", J = "1 kg*m^2", c = "0.5 m", l = "1 m" }
couplings = [{ join = ["body.centre", "to_base.centre", "to_tip.centre"] }, { join = ["body.turning", "to_base.turning", "to_tip.turning"] }]
[model.link.parts.body]
states = { v = "m/s", w = { unit = "rad/s", kind = "scalar" }, theta = { unit = "rad", kind = "scalar" } }
ports.centre = { across = "vc [m/s]", through = "f [N]", gives = "across" }
ports.turning = { across = "wc [rad/s]", through = "T [N*m]", gives = "across", kind = "scalar" }
ports.shaft = { across = "ws [rad/s]", through = "Ts [N*m]", gives = "across", kind = "scalar" }
equations = { "m*v'" = "-f", "J*w'" = "-T - Ts", "theta'" = "w", vc = "v", wc = "w", ws = "w" }
energy = "0.5*m*dot(v, v) + 0.5*J*w^2"
[model.link.parts.to_base]
ports.centre = { across = "vc [m/s]", through = "fc [N]", gives = "through" }
ports.turning = { across = "w [rad/s]", through = "T [N*m]", gives = "through", kind = "scalar" }
ports.end = { across = "ve [m/s]", through = "fe [N]", gives = "across" }
ratio.ve = [{ of = "vc", is = "1" }, { of = "w", is = ["0 m", "-c"] }]
[model.link.parts.to_tip]
ports.centre = { across = "vc [m/s]", through = "fc [N]", gives = "through" }
ports.turning = { across = "w [rad/s]", through = "T [N*m]", gives = "through", kind = "scalar" }
ports.end = { across = "ve [m/s]", through = "fe [N]", gives = "across" }
ratio.ve = [{ of = "vc", is = "1" }, { of = "w", is = ["0 m", "l - c"] }]
"#;

#[test]
fn two_link_arm_entry_by_entry() {
    let text = ARM.replace("free = []\n", "").replace("fixed = [", "free = [\"second.tip\"]\nfixed = [");
    let s = system(&text);
    println!("arm: states {:?}, dependent {:?}", s.state_names(), s.dependent_states());
    let names = s.state_names();
    let at = |n: &str| names.iter().position(|x| x == n).unwrap();
    let (t1, w1, t2, w2) =
        (at("first.body.theta"), at("first.body.w"), at("second.body.theta"), at("second.body.w"));
    assert_eq!(names.len(), 4);
    let (m1, j1, c1, l1, m2, j2, c2) = (3.0, 0.2, 0.35, 0.8, 2.0, 0.1, 0.25);
    let mut worst = 0.0f64;
    let mut r = support::Random(3);
    for _ in 0..50 {
        let mut x = vec![0.0; 4];
        let (a, b, u, v) =
            (r.between(-3.0, 3.0), r.between(-3.0, 3.0), r.between(-4.0, 4.0), r.between(-4.0, 4.0));
        (x[t1], x[t2], x[w1], x[w2]) = (a, b, u, v);
        let tau = [r.between(-9.0, 9.0), r.between(-9.0, 9.0)];
        let m = show(s.matrices_at(&OperatingPoint {
            states: x.clone(),
            inputs: tau.to_vec(),
            ..OperatingPoint::default()
        }));
        // Absolute angles: M = [[J1 + m1 c1^2 + m2 l1^2, m2 l1 c2 cos], [.., J2 + m2 c2^2]], C = m2 l1 c2 sin.
        let (cos, sin) = ((b - a).cos(), (b - a).sin());
        let mm =
            [[j1 + m1 * c1 * c1 + m2 * l1 * l1, m2 * l1 * c2 * cos], [m2 * l1 * c2 * cos, j2 + m2 * c2 * c2]];
        let k = m2 * l1 * c2 * sin;
        let force = [tau[0] + k * v * v, tau[1] - k * u * u];
        let rhs: Vec<f64> = (0..4)
            .map(|i| {
                (0..4).map(|j| m.a[i][j] * x[j]).sum::<f64>()
                    + (0..2).map(|j| m.b[i][j] * tau[j]).sum::<f64>()
                    + m.state_constant[i]
            })
            .collect();
        let e = [[m.e[w1][w1], m.e[w1][w2]], [m.e[w2][w1], m.e[w2][w2]]];
        worst = worst.max(relative(&e.concat(), &mm.concat()));
        worst = worst.max(relative(&[rhs[w1], rhs[w2]], &force));
        // The tangent of C with respect to the speeds.
        let c = [m.a[w1][w2], m.a[w2][w1], m.a[w1][w1], m.a[w2][w2]];
        worst = worst.max(relative(&c, &[2.0 * k * v, -2.0 * k * u, 0.0, 0.0]));
    }
    println!("two-link arm: M, C and forces off by {worst:.1e}");
    assert!(worst < 1e-10, "{worst:e}");
    // And it keeps its energy when let go.
    let mut c = show(s.compile(CompileOptions { method: Some(Method::Explicit), account: true }));
    for _ in 0..2000 {
        c.step(&[0.0, 0.0], 5e-4);
    }
    let a = c.account().unwrap();
    let drift = (a.stored_j / a.start_j - 1.0).abs();
    println!(
        "arm let go for 1 s: energy {:.6} J, drift {drift:.1e}, residual {:.1e}",
        a.stored_j,
        a.worst_residual()
    );
    assert!(drift < 1e-9 && a.worst_residual() < 1e-11);
}

#[test]
fn trolley_pendulum() {
    let text = r#"
dim = 2
free = ["trolley.push"]
[parameters]
M = "5 kg"
m = "2 kg"
l = "0.7 m"
g = "9.81 m/s^2"
[start]
"rod.angle.theta" = "0.001 rad"
"rod.angle.w" = "0 rad/s"
"trolley.v" = "0 m/s"
[observe]
theta = "rod.angle.theta"
[parts.trolley]
dim = 0
along = ["1", "0"]
states = { v = "m/s" }
ports.pin = { across = "vp [m/s]", through = "f [N]", gives = "across" }
ports.push = { across = "vq [m/s]", through = "q [N]", gives = "across" }
equations = { "M*v'" = "-f - q", vp = "v", vq = "v" }
energy = "0.5*M*v^2"
[parts.bob]
states = { v = "m/s", y = { unit = "m", kind = "scalar" } }
ports.body = { across = "vb [m/s]", through = "f [N]", gives = "across" }
equations = { "m*v'" = "-f + [0 N, -m*g]", vb = "v", "y'" = "v.y" }
energy = "0.5*m*dot(v, v) + m*g*y"
[parts.rod]
turn = "rod.angle.theta"
ports = { pin = "arm.pin", bob = "arm.bob" }
couplings = [{ join = ["angle.shaft", "arm.turning"] }]
[parts.rod.parts.angle]
states = { theta = { unit = "rad", kind = "scalar" }, w = { unit = "rad/s", kind = "scalar" } }
ports.shaft = { across = "ws [rad/s]", through = "T [N*m]", gives = "across", kind = "scalar" }
equations = { "theta'" = "w", "1e-12 kg*m^2*w'" = "-T", ws = "w" }
[parts.rod.parts.arm]
ports.pin = { across = "vp [m/s]", through = "fp [N]", gives = "through" }
ports.turning = { across = "w [rad/s]", through = "T [N*m]", gives = "through", kind = "scalar" }
ports.bob = { across = "vb [m/s]", through = "fb [N]", gives = "across" }
ratio.vb = [{ of = "vp", is = "1" }, { of = "w", is = ["l", "0 m"] }]
[[couplings]]
join = ["trolley.pin", "rod.pin"]
[[couplings]]
join = ["rod.bob", "bob.body"]
"#;
    let s = system(text);
    println!("trolley: states {:?}, dependent {:?}", s.state_names(), s.dependent_states());
    let mut c = show(s.compile(CompileOptions { method: Some(Method::Explicit), account: true }));
    let (mm, m, l, g) = (5.0f64, 2.0, 0.7, 9.81);
    let omega = ((mm + m) * g / (mm * l)).sqrt();
    let mut worst = 0.0f64;
    for k in 1..=2000 {
        c.step(&[], 1e-3);
        worst = worst.max((c.output("theta").unwrap() - 1e-3 * (omega * k as f64 * 1e-3).cos()).abs() / 1e-3);
    }
    let a = c.account().unwrap();
    println!(
        "trolley-pendulum: omega {omega:.4}: {worst:.1e} of the swing; energy imbalance {:.1e} J",
        a.imbalance_j()
    );
    assert!(worst < 1e-5, "amplitude effect only");
    assert!(a.imbalance_j().abs() < 1e-12 && (a.stored_j - a.start_j).abs() < 1e-12);
}

#[test]
fn rigid_gear_and_rigid_springs_reduce() {
    let text = r#"
[parameters]
Jm = "0.02 kg*m^2"
Jl = "3 kg*m^2"
N = "7"
[ports]
drive = { of = "motor.shaft", positive = "in" }
[start]
"motor.w" = "2 rad/s"
[parts.motor]
states = { w = "rad/s" }
ports.shaft = { across = "ws [rad/s]", through = "Ts [N*m]", gives = "across" }
ports.gear = { across = "wg [rad/s]", through = "Tg [N*m]", gives = "across" }
equations = { "Jm*w'" = "-Ts - Tg", ws = "w", wg = "w" }
[parts.gear]
ports.input = { across = "wi [rad/s]", through = "Ti [N*m]", gives = "through" }
ports.output = { across = "wo [rad/s]", through = "To [N*m]", gives = "across" }
ratio.wo = { of = "wi", is = "1/N" }
[parts.load]
states = { w = "rad/s" }
ports.shaft = { across = "ws [rad/s]", through = "T [N*m]", gives = "across" }
equations = { "Jl*w'" = "-T", ws = "w" }
[observe]
load = "load.w"
[[couplings]]
join = ["motor.gear", "gear.input"]
[[couplings]]
join = ["gear.output", "load.shaft"]
"#;
    let s = system(text);
    assert_eq!(s.dependent_states(), ["load.w"]);
    let m = show(s.matrices());
    let want = 0.02 + 3.0 / 49.0;
    assert!((m.e[0][0] / want - 1.0).abs() < 1e-13 && (m.b[0][0] - 1.0).abs() < 1e-13, "{m:?}");
    let load = m.outputs.iter().position(|o| o == "load").unwrap();
    assert!((m.c[load][0] - 1.0 / 7.0).abs() < 1e-15);
}

#[test]
fn turned_springs() {
    let text = r#"
dim = 2
free = ["mass.outer"]
[parameters]
phi = "0.6 rad"
[parts.mass]
states = { v = "m/s" }
ports.inner = { across = "vi [m/s]", through = "fi [N]", gives = "across" }
ports.outer = { across = "vo [m/s]", through = "fo [N]", gives = "across" }
equations = { "(2 kg)*v'" = "-fi - fo", vi = "v", vo = "v" }
[parts.spring]
turn = "phi"
states = { d = "m" }
ports.end = { across = "v [m/s]", through = "f [N]", gives = "through" }
equations = { "d'" = "v", f = "[500 N/m, 90 N/m]*d" }
[[couplings]]
join = ["mass.inner", "spring.end"]
"#;
    let m = show(system(text).matrices());
    let at = |n: &str| m.states.iter().position(|x| x == n).unwrap();
    let (v, d) = ([at("mass.v.x"), at("mass.v.y")], [at("spring.d.x"), at("spring.d.y")]);
    // -A_vd A_dv = Phi K Phi^T in the ground.
    let k: Vec<f64> =
        (0..4).map(|q| -(0..2).map(|j| m.a[v[q / 2]][d[j]] * m.a[d[j]][v[q % 2]]).sum::<f64>()).collect();
    let (kx, ky, s, c) = (500.0, 90.0, 0.6f64.sin(), 0.6f64.cos());
    let want = [kx * c * c + ky * s * s, (kx - ky) * s * c, (kx - ky) * s * c, kx * s * s + ky * c * c];
    assert!(relative(&k, &want) < 1e-14, "{k:?} {want:?}");
    assert!((k[0] + k[3] - kx - ky).abs() < 1e-10 && (k[0] * k[3] - k[1] * k[2] - kx * ky).abs() < 1e-8);
}

#[test]
fn torque_free_body_in_space() {
    // Symmetric top: w3 constant, (w1, w2) turns with (J3 - J1)/J1 w3. The frame's spin is the body's own.
    let text = r#"
dim = 3
[parts.body]
spin = "w"
states = { w = "rad/s" }
ports.hub = { across = "wh [rad/s]", through = "T [N*m]", gives = "across" }
equations = { "[0.4 kg*m^2, 0.4 kg*m^2, 0.7 kg*m^2]*w'" = "-T", wh = "w" }
energy = "0.5*dot([0.4 kg*m^2, 0.4 kg*m^2, 0.7 kg*m^2]*w, w)"
[start]
"body.w" = "[0.5, 0, 3] rad/s"
"#;
    let text = format!("free = [\"body.hub\"]\n{text}");
    let mut c = run(&text, Method::Explicit);
    let rate = (0.7 - 0.4) / 0.4 * 3.0;
    let mut worst = 0.0f64;
    for k in 1..=2000 {
        c.step(&[], 1e-3);
        let a = rate * k as f64 * 1e-3;
        worst = worst.max(relative(c.states(), &[0.5 * a.cos(), 0.5 * a.sin(), 3.0]));
    }
    println!("torque-free top: {worst:.1e}, energy drift {:.1e} J", c.account().unwrap().imbalance_j());
    assert!(worst < 1e-10, "{worst:e}");
}

/// d/dt x = E^-1 A x + ..., compared with numbers written by hand.
fn check(text: &str, states: &[&str], want: &[&[f64]], want_b: &[&[f64]]) {
    let m = show(system(text).matrices());
    let n = states.len();
    assert_eq!(m.states.len(), n, "{:?}", m.states);
    let at: Vec<usize> = states
        .iter()
        .map(|s| m.states.iter().position(|x| x == s).unwrap_or_else(|| panic!("{s} in {:?}", m.states)))
        .collect();
    for (j, cj) in at.iter().enumerate() {
        let column = solved(&m, (0..n).map(|i| m.a[i][*cj]).collect());
        let wanted: Vec<f64> = (0..n).map(|i| want[i][j]).collect();
        let got: Vec<f64> = at.iter().map(|i| column[*i]).collect();
        assert!(relative(&got, &wanted) < 1e-13, "column {}: {got:?} {wanted:?}", states[j]);
    }
    for j in 0..m.inputs.len() {
        let column = solved(&m, (0..n).map(|i| m.b[i][j]).collect());
        let got: Vec<f64> = at.iter().map(|i| column[*i]).collect();
        let wanted: Vec<f64> = (0..n).map(|i| want_b[i][j]).collect();
        assert!(relative(&got, &wanted) < 1e-13, "input {}: {got:?} {wanted:?}", m.inputs[j]);
    }
}

#[test]
fn rlc_in_series() {
    // A series joint shares the current; the source takes the loop's current.
    check(
        r#"
ports.terminal = "r.source"
[parts.r]
ports.source = { across = "us [V]", through = "is [A]", gives = "through" }
ports.loop = { across = "ul [V]", through = "il [A]", gives = "across" }
equations = { is = "il", ul = "us - 3 Ohm*is" }
[parts.l]
states = { i = "A" }
ports.a = { across = "u [V]", through = "ia [A]", gives = "through" }
equations = { "0.2 H*i'" = "u", ia = "i" }
[parts.c]
states = { u = "V" }
ports.a = { across = "ua [V]", through = "i [A]", gives = "across" }
equations = { "0.01 F*u'" = "-i", ua = "u" }
[[couplings]]
join = ["r.loop", "l.a", "c.a"]
shared = "through"
"#,
        &["l.i", "c.u"],
        &[&[-3.0 / 0.2, 1.0 / 0.2], &[-1.0 / 0.01, 0.0]],
        &[&[1.0 / 0.2], &[0.0]],
    );
}

#[test]
fn dc_motor() {
    check(
        r#"
ports = { supply = "winding.supply", shaft = { of = "rotor.shaft", positive = "in" } }
[parts.winding]
states = { i = "A" }
ports.supply = { across = "u [V]", through = "is [A]", gives = "through" }
ports.field = { across = "e [V]", through = "ia [A]", gives = "through" }
equations = { "0.003 H*i'" = "u + e - 0.4 Ohm*i", is = "i", ia = "i" }
[parts.field]
ports.a = { across = "e [V]", through = "i [A]", gives = "across" }
ports.m = { across = "w [rad/s]", through = "T [N*m]", gives = "through" }
gyrator.e = { of = "w", is = "-0.05 V*s/rad" }
[parts.rotor]
states = { w = "rad/s" }
ports.m = { across = "wm [rad/s]", through = "T [N*m]", gives = "across" }
ports.shaft = { across = "ws [rad/s]", through = "Ts [N*m]", gives = "across" }
equations = { "0.001 kg*m^2*w'" = "-T - Ts - 0.0002 N*m*s/rad*w", wm = "w", ws = "w" }
[[couplings]]
join = ["winding.field", "field.a"]
[[couplings]]
join = ["field.m", "rotor.m"]
"#
        // e against w is across against across: a ratio whose dual is the torque constant.
        .replace("gyrator.e", "ratio.e")
        .as_str(),
        &["winding.i", "rotor.w"],
        &[&[-0.4 / 0.003, -0.05 / 0.003], &[0.05 / 0.001, -0.0002 / 0.001]],
        &[&[1.0 / 0.003, 0.0], &[0.0, 1.0 / 0.001]],
    );
}

const MASS_SPRING: &str = r#"
[model.mass]
parameters = { m = "1 kg" }
states = { v = "m/s" }
ports.body = { across = "vb [m/s]", through = "f [N]", gives = "across" }
equations = { "m*v'" = "-f", vb = "v" }
[model.strut]
parameters = { k = "1 N/m", d = "0 N*s/m" }
states = { x = "m" }
ports.a = { across = "va [m/s]", through = "fa [N]", gives = "through" }
ports.b = { across = "vb [m/s]", through = "fb [N]", gives = "through" }
equations = { "x'" = "va - vb", fa = "k*x + d*(va - vb)", fb = "-k*x - d*(va - vb)" }
"#;

#[test]
fn quarter_car_and_two_masses() {
    let text = format!(
        r#"
ports.road = "tyre.b"
[parts.body]
use = "model.mass"
set = {{ m = "300 kg" }}
[parts.wheel]
use = "model.mass"
set = {{ m = "40 kg" }}
[parts.spring]
use = "model.strut"
set = {{ k = "18000 N/m", d = "1200 N*s/m" }}
[parts.tyre]
use = "model.strut"
set = {{ k = "2e5 N/m" }}
[[couplings]]
join = ["body.body", "spring.a"]
[[couplings]]
join = ["spring.b", "wheel.body", "tyre.a"]
{MASS_SPRING}"#
    );
    let (mb, mw, k, d, kt) = (300.0, 40.0, 18000.0, 1200.0, 2e5);
    check(
        &text,
        &["body.v", "wheel.v", "spring.x", "tyre.x"],
        &[
            &[-d / mb, d / mb, -k / mb, 0.0],
            &[d / mw, -d / mw, k / mw, -kt / mw],
            &[1.0, -1.0, 0.0, 0.0],
            &[0.0, 1.0, 0.0, 0.0],
        ],
        &[&[0.0], &[0.0], &[0.0], &[-1.0]],
    );
}

#[test]
fn hydraulic_cylinder_with_mass() {
    // Pressure and velocity are both across: f = A p, Q = A v (a gyrator).
    let text = r#"
ports.pump = { of = "volume.inlet", positive = "in" }
ports.load = { of = "mass.outer", positive = "in" }
[parts.volume]
states = { p = "Pa" }
ports.inlet = { across = "pi [Pa]", through = "qi [m^3/s]", gives = "across" }
ports.outlet = { across = "po [Pa]", through = "qo [m^3/s]", gives = "across" }
equations = { "1e-4 m^3/(1.2 GPa)*p'" = "-qi - qo - 1e-12 m^3/(Pa*s)*p", pi = "p", po = "p" }
[parts.piston]
ports.oil = { across = "p [Pa]", through = "q [m^3/s]", gives = "through" }
ports.rod = { across = "v [m/s]", through = "f [N]", gives = "through" }
gyrator.f = { of = "p", is = "-2e-3 m^2" }
[parts.mass]
states = { v = "m/s" }
ports.rod = { across = "vr [m/s]", through = "f [N]", gives = "across" }
ports.outer = { across = "vo [m/s]", through = "fo [N]", gives = "across" }
equations = { "25 kg*v'" = "-f - fo", vr = "v", vo = "v" }
[[couplings]]
join = ["volume.outlet", "piston.oil"]
[[couplings]]
join = ["mass.rod", "piston.rod"]
"#;
    let c = 1e-4 / 1.2e9;
    check(
        text,
        &["volume.p", "mass.v"],
        &[&[-1e-12 / c, -2e-3 / c], &[2e-3 / 25.0, 0.0]],
        &[&[1.0 / c, 0.0], &[0.0, 1.0 / 25.0]],
    );
}
