//! No step allocates: every shipped axle, both paths, held ticks included.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use config::axle::{Axle, KingpinFriction};
use multibody::{SolverPath, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

#[test]
fn steps_do_not_allocate() {
    for name in
        ["sedan_double_wishbone", "sedan_double_wishbone_bushings", "compact_strut", "sedan_five_link"]
    {
        for path in [SolverPath::General, SolverPath::Structured] {
            let file = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
            let mut axle: Axle = toml::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
            axle.kingpin_friction = Some(KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.002 });
            let mut suspension = Suspension::with_path(&axle, path).unwrap();
            let mut output = SuspensionOutput::default();
            let mut state = vec![0.0; suspension.state_len()];
            let before = violation_count();
            assert_no_alloc(|| {
                for tick in 0..500_u32 {
                    let t = f64::from(tick) * 1e-3;
                    let mut input = SuspensionInput {
                        rack_m: 0.04 * (5.0 * t).sin(),
                        wheel_height_m: [0.02 * (9.0 * t).sin(), 0.03 * (7.0 * t).sin()],
                        ..SuspensionInput::DESIGN
                    };
                    input.wheel_force_n = [Vector3::new(10.0, 800.0, 4000.0); 2];
                    if tick % 50 == 7 {
                        input.rack_m = if tick % 100 == 7 { 5.0 } else { f64::NAN };
                    }
                    suspension.step(&input, &mut output);
                    suspension.save_state(&mut state);
                }
                suspension.load_state(&state);
                suspension.reset();
            });
            assert_eq!(violation_count(), before, "{name} {path:?}");
        }
    }
    // The counter counts.
    let before = violation_count();
    assert_no_alloc(|| drop(std::hint::black_box(vec![1.0_f64; 8])));
    assert!(violation_count() > before);
}
