//! A step touches no heap.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

#[path = "car/support/mod.rs"]
mod support;

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use support::*;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn a_step_does_not_allocate() {
    let mut v = build(&with_constants(car("sedan")));
    let equations = r#"
        variables = [{ name = "a", unit = "N", start = 0, expression = "a * 0.9 + max(fy_n_fl, 3 N) + 10 N * sin(6 * time_s / 1 s)" }]
        imports = [{ variable = "external_force_y_n", mode = "add", expression = "a" }]
        outputs = [{ name = "b", unit = "kN", expression = "norm([a, fx_n_fl, fy_n_fl])" }]"#;
    v.set_equations(&toml::from_str(equations).unwrap()).unwrap();
    let mut input = hold(20.0);
    v.reset(20.0, &input);
    let mut state = vec![0.0; v.state_len()];
    assert_no_alloc(|| {
        for n in 0..500 {
            input.time_s = 1e-3 * f64::from(n);
            input.steering_wheel_angle_rad = 1e-3 * f64::from(n);
            if n == 200 {
                input.throttle = f64::NAN;
            }
            if n == 210 {
                input.throttle = 1.0;
                input.target_speed_m_s = None;
                input.brake_pressure_pa = 1e6;
            }
            v.step(&input);
            v.save_state(&mut state);
        }
        v.load_state(&state);
    });
    assert_eq!(violation_count(), 0);
}
