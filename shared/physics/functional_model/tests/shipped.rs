//! Every shipped model and library block: reads, composes, closes its power and energy, behaves like the machine.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use functional_model::{CompileOptions, Compiled, Model, Parameters, library};
use support::{Random, no_files, shipped, show};

const UNITS: [&str; 5] = ["rack_eps", "column_eps", "hydraulic", "recirculating_ball", "steer_by_wire"];

fn unit(name: &str, account: bool) -> Compiled {
    let system = show(shipped(&format!("{name}.toml")).compose(&Parameters::new()));
    show(system.compile(CompileOptions { account, ..CompileOptions::default() }))
}

#[test]
fn every_library_block_stands_alone_and_keeps_its_energy() {
    for (name, text) in library::BLOCKS {
        let model = show(Model::from_toml(text, name, &no_files));
        assert!(model.about().is_some(), "{name} says what it is");
        let mut p = Parameters::new();
        if name.contains("end_stop") {
            p.set("gap", "1 mm");
        }
        let system = show(model.compose(&p));
        let mut c = show(system.compile(CompileOptions { account: true, ..CompileOptions::default() }));
        let n = c.input_names().len();
        let mut r = Random(7);
        let mut worst = 0.0f64;
        for k in 0..2000 {
            let t = f64::from(k) * 1e-4;
            // Pressures and volume flows have their own sizes.
            let inputs: Vec<f64> = (0..n)
                .map(|i| {
                    let size = match system.input_units()[i].as_str() {
                        "Pa" => 2e6,
                        "m^3/s" => 1e-5,
                        "m/s" => 0.3,
                        _ => 1.0,
                    };
                    size * ((3.0 + i as f64) * t * 6.0 + i as f64).sin() + 1e-3 * size * r.between(-1.0, 1.0)
                })
                .collect();
            let s = c.step(&inputs, 1e-4);
            assert!(!s.not_converged && !s.state_held, "{name}: {s:?}");
            worst = worst.max(c.account().unwrap().worst_residual());
        }
        let a = c.account().unwrap();
        let off = a.imbalance_j().abs() / a.moved_j.max(1e-9);
        println!("{name}: residual {worst:.1e}, imbalance {off:.1e} of {:.3e} J", a.moved_j);
        assert!(worst < 1e-12, "{name}");
        // An end stop's spring has a corner: quadratic on each side only.
        let allowed = if name.contains("end_stop") { 1e-4 } else { 1e-9 };
        assert!(off < allowed, "{name}: {off:e}");
    }
}

/// Driver's torque and tie-rod forces of a lively drive.
fn drive(c: &mut Compiled, t: f64, dt: f64) -> functional_model::StepStatus {
    let at = |c: &Compiled, n: &str| c.input_index(n).unwrap();
    let mut u = vec![0.0; c.input_names().len()];
    u[at(c, "vehicle_speed")] = 20.0;
    u[at(c, "hand.T")] = 3.0 * (2.0 * std::f64::consts::PI * 0.5 * t).sin();
    let x = c.output("rack_position").unwrap();
    u[at(c, "left.fl")] = -6.0e4 * x + 40.0 * (60.0 * t).sin();
    u[at(c, "right.fr")] = 6.0e4 * x + 40.0 * (55.0 * t).sin();
    c.step(&u, dt)
}

#[test]
fn steering_units_keep_power_and_energy() {
    for name in UNITS {
        let mut c = unit(name, true);
        let (mut worst, mut open, mut reach) = (0.0f64, 0.0f64, 0.0f64);
        let mut iterations = 0;
        for k in 0..20_000 {
            let s = drive(&mut c, f64::from(k) * 1e-4, 1e-4);
            assert!(
                !s.not_converged && !s.state_held,
                "{name} at step {k}: {s:?} {:?} {:?}",
                c.state_names(),
                c.states()
            );
            iterations += s.iterations;
            let a = c.account().unwrap();
            worst = worst.max(a.worst_residual());
            open = open.max(a.imbalance_j().abs() / a.moved_j.max(1.0));
            reach = reach.max(c.output("rack_position").unwrap().abs());
        }
        println!(
            "{name}: states {}, rack reaches {:.1} mm, residual {worst:.1e}, imbalance {open:.1e}, {:.2} iterations",
            c.states().len(),
            reach * 1e3,
            f64::from(iterations) / 2e4
        );
        // Where the rack runs into its stop, a step across the corner is not quadratic.
        let allowed = if reach > 0.075 { 1e-6 } else { 1e-12 };
        assert!(worst < 1e-12 && open < allowed, "{name}");
        assert!((1e-3..0.08).contains(&reach), "{name}: rack reaches {reach} m");
    }
}

#[test]
fn turning_left_moves_the_rack_left_and_assist_helps() {
    for name in UNITS {
        let mut c = unit(name, false);
        let mut u = vec![0.0; c.input_names().len()];
        u[c.input_index("vehicle_speed").unwrap()] = 5.0;
        u[c.input_index("hand.T").unwrap()] = 3.0;
        for _ in 0..20_000 {
            let x = c.output("rack_position").unwrap();
            u[c.input_index("left.fl").unwrap()] = -6e4 * x;
            u[c.input_index("right.fr").unwrap()] = 6e4 * x;
            c.step(&u, 1e-4);
        }
        let (x, torque) = (c.output("rack_position").unwrap(), c.output("torsion_torque").unwrap());
        println!("{name}: 3 N m to the left for 2 s: rack {:.1} mm, torsion bar {torque:.2} N m", x * 1e3);
        // Held still: the bar carries the driver's torque, less friction and what still moves.
        assert!(x > 1e-3 && (torque - 3.0).abs() < 0.6, "{name}");
        assert!(c.output("left.vl").unwrap() == -c.output("right.vr").unwrap());
    }
}

#[test]
fn a_saved_state_continues_to_the_bit() {
    for name in UNITS {
        let mut c = unit(name, true);
        for k in 0..500 {
            drive(&mut c, f64::from(k) * 1e-4, 1e-4);
        }
        let mut saved = vec![0.0; c.state_len()];
        c.save_state(&mut saved);
        let mut other = unit(name, true);
        other.load_state(&saved);
        for k in 500..1000 {
            drive(&mut c, f64::from(k) * 1e-4, 1e-4);
            drive(&mut other, f64::from(k) * 1e-4, 1e-4);
        }
        let bits =
            |c: &Compiled| c.states().iter().chain(c.outputs()).map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&c), bits(&other), "{name}");
        assert!(c.state_len() <= functional_model::STATE_LEN_MAX);
    }
}

#[test]
fn bad_inputs_are_held_and_flagged() {
    let mut c = unit("rack_eps", false);
    let mut u = vec![0.0; c.input_names().len()];
    u[c.input_index("hand.T").unwrap()] = 2.0;
    c.step(&u, 1e-4);
    u[c.input_index("hand.T").unwrap()] = f64::NAN;
    let mut good = unit("rack_eps", false);
    u[c.input_index("hand.T").unwrap()] = 2.0;
    good.step(&u, 1e-4);
    good.step(&u, 1e-4);
    u[c.input_index("hand.T").unwrap()] = f64::NAN;
    let s = c.step(&u, 1e-4);
    assert!(s.input_held && c.states() == good.states());
}

#[test]
fn driveline_drives_both_wheels_alike_and_keeps_its_energy() {
    let system = show(shipped("driveline.toml").compose(&Parameters::new()));
    let mut c = show(system.compile(CompileOptions { account: true, ..CompileOptions::default() }));
    let index = |n: &str| system.input_names().iter().position(|x| x == n).unwrap();
    let mut worst = 0.0f64;
    for k in 0..20_000 {
        let mut u = vec![0.0; system.input_names().len()];
        u[index("pedal")] = 0.4;
        u[index("lock_up")] = if k > 12_000 { 1.0 } else { 0.0 };
        // A car of 1500 kg through two wheels of 0.3 m would add this much inertia; here a drag.
        u[index("left.Tw")] = -8.0 * c.output("left_speed").unwrap();
        u[index("right.Tw")] = -8.0 * c.output("right_speed").unwrap();
        let s = c.step(&u, 5e-4);
        assert!(!s.not_converged, "step {k}: {s:?}");
        worst = worst.max(c.account().unwrap().worst_residual());
    }
    let a = c.account().unwrap();
    let (l, r, e) = (
        c.output("left_speed").unwrap(),
        c.output("right_speed").unwrap(),
        c.output("engine_speed").unwrap(),
    );
    println!(
        "driveline: engine {e:.1} rad/s, wheels {l:.2} {r:.2}, residual {worst:.1e}, imbalance {:.1e} of {:.2e} J",
        a.imbalance_j(),
        a.moved_j
    );
    assert!(l > 1.0 && (l - r).abs() < 1e-9);
    // Locked up: engine speed is the wheel's times the gears, but for the clutch's slip.
    assert!((e - l * 2.5 * 3.7).abs() < 2.0);
    assert!(worst < 1e-12 && a.imbalance_j().abs() / a.moved_j < 1e-9);
}

#[test]
fn the_cars_driveline_shifts_locks_up_and_keeps_its_energy() {
    let system = show(shipped("driveline_automatic.toml").compose(&Parameters::new()));
    let mut c = show(system.compile(CompileOptions { account: true, ..CompileOptions::default() }));
    let index = |n: &str| system.input_names().iter().position(|x| x == n).unwrap();
    let (mut worst, mut open) = (0.0f64, 0.0f64);
    for k in 0..8000 {
        let t = f64::from(k) * 1e-3;
        let mut u = vec![0.0; system.input_names().len()];
        u[index("pedal")] = if t < 6.0 { 0.4 } else { 0.0 };
        u[index("ratio")] = if t < 2.0 { 2.37 } else { (2.37 - (t - 2.0) * 2.4).max(1.56) };
        u[index("lock_up")] = (t - 3.0).clamp(0.0, 1.0);
        u[index("left.wb")] = 40.0 + 2.0 * t;
        u[index("right.wb")] = 40.0 + 2.0 * t;
        let s = c.step(&u, 1e-3);
        assert!(!s.not_converged && !s.state_held, "step {k}: {s:?}");
        let a = c.account().unwrap();
        worst = worst.max(a.worst_residual());
        open = open.max(a.imbalance_j().abs() / a.moved_j.max(1.0));
        if k == 5900 {
            let (left, engine) = (c.output("left_torque").unwrap(), c.output("engine_torque").unwrap());
            // Half of the engine's torque through both ratios, less what speeds up crank and input shaft.
            let want = 0.5 * 1.56 * 3.7 * (engine - 0.18 * 2.0 * 1.56 * 3.7);
            assert!((left / want - 1.0).abs() < 0.02, "{left} {want}");
        }
    }
    println!("driveline_automatic: residual {worst:.1e}, imbalance {open:.1e}");
    assert!(c.output("left_torque").unwrap() < 0.0, "overrun brakes");
    assert!(worst < 1e-12 && open < 1e-10);
}

#[test]
fn cardan_joints() {
    let chain = |phase: &str| {
        let text = format!(
            "ports.out = \"b.output\"\n[parts.a]\nuse = \"library/universal_joint.toml\"\n[parts.b]\nuse = \"library/universal_joint.toml\"\nset = {{ phase = \"{phase}\" }}\n[parts.drive]\nports.shaft = {{ across = \"w [rad/s]\", through = \"T [N*m]\", gives = \"across\" }}\nequations.w = \"10 rad/s\"\n[[couplings]]\njoin = [\"drive.shaft\", \"a.input\"]\n[[couplings]]\njoin = [\"a.output\", \"b.input\"]\n"
        );
        let mut c =
            show(show(support::model(&text).compose(&Parameters::new())).compile(CompileOptions::default()));
        let (mut low, mut high) = (f64::INFINITY, 0.0f64);
        for _ in 0..4000 {
            c.step(&[0.0], 2.5e-4);
            let ratio = c.output("out.wo").unwrap() / 10.0;
            low = low.min(ratio);
            high = high.max(ratio);
        }
        (low, high)
    };
    let c2 = 20.0f64.to_radians().cos().powi(2);
    let (low, high) = chain("90 deg");
    println!("double cardan, phased: ratio {low:.9} .. {high:.9}");
    assert!((low - 1.0).abs() < 1e-6 && (high - 1.0).abs() < 1e-6);
    let (low, high) = chain("0 deg");
    println!("mis-phased: ratio {low:.6} .. {high:.6}, cos^2 = {c2:.6}, 1/cos^2 = {:.6}", 1.0 / c2);
    assert!((low - c2).abs() < 1e-4 && (high - 1.0 / c2).abs() < 1e-4);
}

#[test]
fn a_table_from_a_file_gives_its_known_answer() {
    // x in mm, value in kN: a spring of 2 kN at 10 mm, linear between the points.
    let files = |name: &str| match name {
        "spring.csv" => Ok("# measured\nx [mm], value [kN]\n-10, -2\n0, 0\n10, 2\n20, 8\n".to_string()),
        _ => Err("no such file".to_string()),
    };
    let text = r#"
format = "kingpin-model/1"
ports.end = "spring.end"
observe.force = "spring.f"
[parts.spring]
states = { x = "m" }
ports.end = { across = "v [m/s]", through = "f [N]", gives = "through" }
tables.curve = { file = "spring.csv" }
equations = { "x'" = "v", f = "curve(x)" }
"#;
    let model = show(Model::from_toml(text, "spring", &files));
    let mut c = show(show(model.compose(&Parameters::new())).compile(CompileOptions::default()));
    for (x, f) in [(0.005, 1000.0), (0.015, 5000.0), (-0.05, -2000.0)] {
        c.set_states(&[x]);
        assert!((c.output("force").unwrap() - f).abs() < 1e-9);
    }
    c.set_states(&[0.0]);
    for _ in 0..100 {
        c.step(&[0.15], 1e-3);
    }
    assert!((c.output("force").unwrap() - 5000.0).abs() < 1e-6);
}

#[test]
fn a_compiled_model_may_move_to_the_thread_that_steps_it() {
    fn send<T: Send>(_: &T) {}
    send(&unit("rack_eps", false));
}
