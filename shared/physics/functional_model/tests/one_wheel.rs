//! The one-wheel vehicle of the functional-model patent: every row of its closed form, at random parameters.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use functional_model::{CompileOptions, Method, Model, OperatingPoint, Parameters};
use support::{Random, no_files, reference, relative, shipped, show};

type M2 = [[f64; 2]; 2];

fn mul(a: M2, b: M2) -> M2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j]))
}
fn apply(a: M2, v: [f64; 2]) -> [f64; 2] {
    std::array::from_fn(|i| a[i][0] * v[0] + a[i][1] * v[1])
}
fn t(a: M2) -> M2 {
    [[a[0][0], a[1][0]], [a[0][1], a[1][1]]]
}
fn add(a: M2, b: M2, k: f64) -> M2 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + k * b[i][j]))
}
fn inverse(a: M2) -> M2 {
    let d = a[0][0] * a[1][1] - a[0][1] * a[1][0];
    [[a[1][1] / d, -a[0][1] / d], [-a[1][0] / d, a[0][0] / d]]
}
const I: M2 = [[1.0, 0.0], [0.0, 1.0]];

fn note(what: usize, worst: f64, now: f64) -> f64 {
    if now > 1e-12 && now > worst {
        println!("quantity {what}: {now:.1e}");
    }
    worst.max(now)
}

/// A random set: parameters as text, and the closed form of 5.4 at beta.
fn check_file(model: &Model, seed: u64, sets: usize) -> f64 {
    let mut worst = 0.0f64;
    for k in 0..sets {
        let mut r = Random(seed + k as u64);
        let (mc, dc, t0, d0) = (r.log(20.0, 1e3), r.log(1.0, 1e2), r.between(-50.0, 50.0), r.log(0.5, 10.0));
        let (n, rt) = (r.between(0.5, 3.0) * if r.below(2) == 0 { -1.0 } else { 1.0 }, r.log(0.1, 0.5));
        let (alpha, beta) = (r.between(-3.2, 3.2), r.between(-3.2, 3.2));
        let isotropic = r.below(2) == 0;
        let dx = r.log(100.0, 1.5e3);
        let dy = if isotropic { dx } else { r.log(100.0, 1.5e3) };
        let mut p = Parameters::new()
            .with("MC", &format!("{mc:e} kg"))
            .with("DC", &format!("{dc:e} N*s/m"))
            .with("car.T0", &format!("{t0:e} N*m"))
            .with("car.D0", &format!("{d0:e} N*m*s/rad"))
            .with("car.N", &format!("{n:e}"))
            .with("car.RT", &format!("{rt:e} m"))
            .with("car.alpha", &format!("{alpha:e} rad"));
        p.set(
            "DT",
            &if isotropic { format!("{dx:e} N*s/m") } else { format!("[{dx:e} N*s/m, {dy:e} N*s/m]") },
        );
        let system = show(model.compose(&p));
        let m =
            show(system.matrices_at(&OperatingPoint { sampled: vec![beta], ..OperatingPoint::default() }));

        // Spec 5.4, with D_T in the ground frame (the running part's).
        let nn = [alpha.sin(), -alpha.cos()];
        let c = [alpha.cos(), alpha.sin()];
        let outer = |a: [f64; 2], b: [f64; 2], k: f64| -> M2 {
            std::array::from_fn(|i| std::array::from_fn(|j| k * a[i] * b[j]))
        };
        let p_v = outer(nn, nn, rt * rt * n * n / d0);
        let o_v = nn.map(|x| x * rt * n * t0 / d0);
        let p_w = outer(c, nn, rt * n * n / d0);
        let o_w = c.map(|x| x * n * t0 / d0);
        let phi: M2 = [[beta.cos(), beta.sin()], [-beta.sin(), beta.cos()]];
        let dt: M2 = [[dx, 0.0], [0.0, dy]];
        // F_D = G (Phi^T O_V - x)
        let g = mul(inverse(add(I, mul(dt, mul(t(phi), mul(p_v, phi))), 1.0)), dt);
        let drive = apply(g, apply(t(phi), o_v));
        let a = add([[-dc, 0.0], [0.0, -dc]], g, -1.0);
        worst = note(1, worst, relative(&m.e.concat(), &[mc, 0.0, 0.0, mc]));
        worst = note(2, worst, relative(&m.a.concat(), &a.concat()));
        worst = note(3, worst, relative(&m.b.concat(), &[-1.0, 0.0, 0.0, -1.0]));
        worst = note(4, worst, relative(&m.state_constant, &drive));
        // Observations in the vehicle's frame: F_R = Phi F_D; w_T = O_w - P_w F_R; T_T = R_T-matrix F_R.
        let gv = mul(phi, g);
        let fr0 = apply(phi, drive);
        let find = |name: &str| {
            m.outputs.iter().position(|o| o == name).unwrap_or_else(|| panic!("{name} in {:?}", m.outputs))
        };
        let rows = |name: &str| [find(&format!("{name}.x")), find(&format!("{name}.y"))];
        let (w, torque) = (rows("axle_speed"), rows("axle_torque"));
        let r_t: M2 = [[0.0, -rt], [rt, 0.0]];
        let w_x = mul(p_w, gv);
        let w_1 = apply(p_w, fr0);
        worst = note(5, worst, relative(&[m.c[w[0]].clone(), m.c[w[1]].clone()].concat(), &w_x.concat()));
        // A difference of two nearly equal numbers when the wheel grips: relative to its terms.
        let size = o_w[0].hypot(o_w[1]);
        for q in 0..2 {
            worst = note(6, worst, (m.output_constant[w[q]] - (o_w[q] - w_1[q])).abs() / size);
        }
        let t_x = mul(r_t, gv);
        worst = note(
            7,
            worst,
            relative(
                &[m.c[torque[0]].clone(), m.c[torque[1]].clone()].concat(),
                &t_x.map(|r| r.map(|x| -x)).concat(),
            ),
        );
        worst = note(8, worst, relative(&torque.map(|i| m.output_constant[i]), &apply(r_t, fr0)));
        // V_F = x, beta as observed.
        let v = rows("outside.vF");
        assert_eq!([&m.c[v[0]][..], &m.c[v[1]][..]], [[1.0, 0.0], [0.0, 1.0]]);
        assert!((m.output_constant[find("heading")] - beta).abs() < 1e-14);
        // Isotropic: the same through Psi in the vehicle's frame.
        if isotropic {
            let psi = mul(inverse(add(I, mul(dt, p_v), 1.0)), dt);
            let a2 = add([[-dc, 0.0], [0.0, -dc]], mul(t(phi), mul(psi, phi)), -1.0);
            worst = note(9, worst, relative(&m.a.concat(), &a2.concat()));
            let wx = mul(p_w, mul(psi, phi));
            worst = note(10, worst, relative(&[m.c[w[0]].clone(), m.c[w[1]].clone()].concat(), &wx.concat()));
        }
    }
    worst
}

#[test]
fn every_row_of_the_reference_file() {
    let Some(text) = reference("spec/5-one-wheel.toml") else { return };
    let model = show(Model::from_toml(&text, "5-one-wheel.toml", &no_files));
    let worst = check_file(&model, 1, 1000);
    println!("reference file: worst relative difference {worst:.1e}");
    assert!(worst < 1e-12, "{worst:e}");
}

#[test]
fn every_row_of_the_shipped_model() {
    let worst = check_file(&shipped("one_wheel.toml"), 5000, 1000);
    println!("shipped model, 1000 sets: worst relative difference {worst:.1e}");
    assert!(worst < 1e-12, "{worst:e}");
}

/// Power at every joint and the energy of the whole model, while driving in a turning side wind.
fn drive(system: &functional_model::System) -> (f64, f64) {
    let mut c = show(system.compile(CompileOptions { account: true, ..CompileOptions::default() }));
    assert_eq!(c.method(), Method::Exact);
    let (mut worst, mut open) = (0.0f64, 0.0f64);
    for k in 0..5000 {
        let t = k as f64 * 1e-3;
        c.step(&[30.0 * (0.7 * t).sin(), -40.0 * (1.1 * t).cos()], 1e-3);
        let a = c.account().unwrap();
        worst = worst.max(a.worst_residual());
        open = open.max(a.imbalance_j().abs() / a.moved_j.max(1.0));
        // With the planted mistake the system feeds itself: long enough once it has, before it overflows.
        if a.moved_j > 1e9 {
            break;
        }
    }
    assert!(c.account().unwrap().moved_j > 100.0, "nothing moved");
    (worst, open)
}

#[test]
fn power_and_energy_close_and_a_planted_mistake_shows() {
    let model = shipped("one_wheel.toml");
    let p = Parameters::new().with("car.alpha", "70 deg").with("DT", "[900 N*s/m, 1500 N*s/m]");
    let (residual, imbalance) = drive(&show(model.compose(&p)));
    println!(
        "power residual {residual:.1e} of the flow, energy imbalance {imbalance:.1e} of the energy moved"
    );
    assert!(residual < 1e-12 && imbalance < 1e-12);
    let (residual, imbalance) = drive(&show(model.compose_with_planted_mistake(&p)));
    println!("planted transposition: residual {residual:.1e}, imbalance {imbalance:.1e}");
    assert!(residual > 1e-3 && imbalance > 1e-3);
}

/// Closed form of the wheel hodograph (spec 5.7): alpha = 90 deg, wind f along +x, 0 < beta < pi.
#[test]
fn wheel_hodograph() {
    let (dc, dt, t0, d0, n, rt) = (15.0, 900.0, 12.0, 0.9, 2.0, 0.3);
    let f = 20.0;
    let cap_p = rt * rt * n * n / d0;
    let psi = dt / (1.0 + dt * cap_p);
    let k = dc + psi;
    let p = psi * rt * n * t0 / d0;
    let q: f64 = p / f;
    // Closed form: 1/|v| = sin b tau^q [C - (k/2f)(tau^(1-q)/(1-q) - tau^(-1-q)/(1+q))].
    let inner = |b: f64| {
        let tau = (0.5 * b).tan();
        k / (2.0 * f) * (tau.powf(1.0 - q) / (1.0 - q) - tau.powf(-1.0 - q) / (1.0 + q))
    };
    let (b0, v0) = (2.0f64, 1.5);
    let c0 = 1.0 / (v0 * b0.sin() * (0.5 * b0).tan().powf(q)) + inner(b0);
    let speed = |b: f64| 1.0 / (b.sin() * (0.5 * b).tan().powf(q) * (c0 - inner(b)));
    let run = |dt: f64, always: bool| -> (f64, f64, f64) {
        let text = support::shipped_files("one_wheel.toml").unwrap();
        let text = text.replace("sample = \"1 ms\"", &format!("sample = \"{dt:e} s\""));
        let text = if always {
            text.replace("method = \"exact\"", "method = \"explicit\"")
                .replace("hold = \"norm(v) < 0.05 m/s\"\n", "")
                .replace("start = { beta = \"0 deg\" }", "runs = \"always\"")
        } else {
            text
        };
        let model = show(Model::from_toml(&text, "one_wheel.toml", &no_files));
        let mut c = show(show(model.compose(&Parameters::new())).compile(CompileOptions::default()));
        c.set_states(&[v0 * b0.cos(), v0 * b0.sin()]);
        let mut worst = 0.0f64;
        for _ in 0..(40.0 / dt).round() as usize {
            c.step(&[-f, 0.0], dt);
            let v = c.states();
            let (b, size) = (v[1].atan2(v[0]), v[0].hypot(v[1]));
            if b > 0.05 {
                worst = worst.max((size / speed(b) - 1.0).abs());
            }
        }
        (worst, c.states()[0], c.states()[1])
    };
    let (e1, ..) = run(4e-3, false);
    let (e2, ..) = run(2e-3, false);
    let (e3, x, y) = run(1e-3, false);
    println!(
        "hodograph, sampled heading: {e1:.2e} {e2:.2e} {e3:.2e} at 4, 2, 1 ms (first order); final v ({x:.4}, {y:.4})"
    );
    assert!((1.8..2.2).contains(&(e1 / e2)) && (1.8..2.2).contains(&(e2 / e3)), "not first order");
    let (c1, ..) = run(0.4, true);
    let (c2, x, y) = run(0.2, true);
    println!("hodograph, continuous heading: {c1:.2e} {c2:.2e} at 400, 200 ms; final v ({x:.4}, {y:.4})");
    assert!(c2 < 1e-5 && c1 / c2 > 10.0, "continuous heading is not fourth order");
    // It turns downwind, to the speed (p + f)/k.
    assert!(y.abs() < 0.1 * x && (x / ((p + f) / k) - 1.0).abs() < 0.02, "{x} {y} {}", (p + f) / k);
}
