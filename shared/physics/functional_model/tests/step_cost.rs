//! The step allocates nothing, and what it costs next to the same equations written by hand.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use functional_model::{CompileOptions, Parameters};
use support::{shipped, show};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn no_step_allocates() {
    for name in [
        "one_wheel",
        "rack_eps",
        "column_eps",
        "hydraulic",
        "recirculating_ball",
        "steer_by_wire",
        "driveline",
    ] {
        let system = show(shipped(&format!("{name}.toml")).compose(&Parameters::new()));
        for account in [false, true] {
            let mut c = show(system.compile(CompileOptions { account, ..CompileOptions::default() }));
            let mut u = vec![0.0; c.input_names().len()];
            let mut saved = vec![0.0; c.state_len()];
            assert_no_alloc(|| {
                for k in 0..500 {
                    for (i, v) in u.iter_mut().enumerate() {
                        *v = 0.5 * (0.01 * f64::from(k) + i as f64).sin();
                    }
                    // A change of step length is part of the promise.
                    c.step(&u, if k % 100 < 50 { 1e-4 } else { 2e-4 });
                }
                c.save_state(&mut saved);
                c.load_state(&saved);
            });
            assert_eq!(violation_count(), 0, "{name}");
        }
    }
}

#[test]
fn cost_of_the_rack_unit() {
    let system = show(shipped("rack_eps.toml").compose(&Parameters::new()));
    let mut c = show(system.compile(CompileOptions::default()));
    let mut u = vec![0.0; c.input_names().len()];
    let at = |n: &str| system.input_names().iter().position(|x| x == n).unwrap();
    let (hand, left, right) = (at("hand.T"), at("left.fl"), at("right.fr"));
    let rack = c.output_index("rack_position").unwrap();
    let mut times = Vec::new();
    for k in 0..20_000 {
        u[hand] = 3.0 * (3e-4 * f64::from(k)).sin();
        u[left] = -6e4 * c.outputs()[rack];
        u[right] = 6e4 * c.outputs()[rack];
        let t = std::time::Instant::now();
        c.step(&u, 1e-4);
        times.push(t.elapsed().as_nanos() as u64);
    }
    times.sort_unstable();
    println!(
        "rack_eps step: p50 {} ns, p99.9 {} ns, max {} ns ({} states)",
        times[10_000],
        times[19_980],
        times[19_999],
        c.states().len()
    );
    assert!(c.outputs()[rack].is_finite());
}

#[test]
fn the_diagram_shows_every_part_frame_and_joint() {
    for (name, frames, parts) in [("one_wheel", 2, 3), ("rack_eps", 1, 11)] {
        let svg = show(shipped(&format!("{name}.toml")).compose(&Parameters::new())).diagram();
        assert_eq!(svg.matches("class=\"frame\"").count(), frames, "{name}");
        assert_eq!(svg.matches("class=\"part\"").count(), parts, "{name}");
        assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
        if name == "one_wheel" {
            assert!(svg.contains("turn z heading.beta") && svg.contains("along [cos(alpha), sin(alpha)]"));
            assert_eq!(svg.matches("class=\"joint\"").count(), 2);
            assert_eq!(svg.matches("class=\"open\"").count(), 1);
        }
    }
}
