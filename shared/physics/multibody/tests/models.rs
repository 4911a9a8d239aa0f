//! The suspension models as assembled: counts of the source's tables, errors, holding, state.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::axle::{Axle, Geometry, KingpinFriction};
use multibody::mechanism::Description;
use multibody::{AssemblyError, Reason, SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;

fn shipped(name: &str) -> Axle {
    let path = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[track_caller]
fn expect(description: &Description, bodies: usize, kinds: &[(&str, usize, usize)]) {
    assert_eq!(description.bodies.len(), bodies);
    let mut found = description.by_kind();
    let mut kinds = kinds.to_vec();
    found.sort_unstable();
    kinds.sort_unstable();
    assert_eq!(found, kinds);
    assert_eq!(description.rows, 6 * bodies);
    assert_eq!(description.coordinates, 6 * bodies);
}

const BASE: [(&str, usize, usize); 3] =
    [("ground", 1, 6), ("translational", 1, 5), ("translational driver", 1, 1)];

fn with(more: &[(&'static str, usize, usize)]) -> Vec<(&'static str, usize, usize)> {
    [&BASE, more].concat()
}

#[test]
fn counts_are_those_of_the_tables() {
    let strut_with_bar = shipped("compact_strut");
    let strut = Suspension::new(&strut_with_bar.without_stabiliser()).unwrap().describe();
    expect(&strut.kinematic, 4, &with(&[("strut", 2, 4), ("distance", 6, 6), ("axis driver", 2, 2)]));
    expect(&strut.reaction, 4, &with(&[("strut", 2, 4), ("distance", 8, 8)]));
    let wishbone = Suspension::new(&shipped("sedan_double_wishbone")).unwrap().describe();
    expect(&wishbone.kinematic, 4, &with(&[("distance", 10, 10), ("axis driver", 2, 2)]));
    let arms = [("revolute", 2, 10), ("spherical", 2, 6), ("distance", 8, 8)];
    expect(&wishbone.reaction, 6, &with(&arms));
    let bar = Suspension::new(&strut_with_bar).unwrap().describe();
    let drivers = [("strut", 2, 4), ("distance", 8, 8), ("revolute", 2, 10), ("axis driver", 2, 2)];
    expect(&bar.kinematic, 6, &with(&drivers));
    expect(&bar.reaction, 6, &with(&[("strut", 2, 4), ("distance", 10, 10), ("revolute", 2, 10)]));
    let totals = [strut, wishbone, bar].map(|d| [d.kinematic.rows, d.reaction.rows]);
    assert_eq!(totals, [[24, 24], [24, 36], [36, 36]]);
    let five = Suspension::new(&shipped("sedan_five_link")).unwrap().describe();
    expect(&five.kinematic, 4, &with(&[("distance", 10, 10), ("axis driver", 2, 2)]));
    expect(&five.reaction, 6, &with(&[("distance", 10, 10), ("universal", 2, 8), ("spherical", 2, 6)]));
}

fn loaded(rack: f64, z: [f64; 2]) -> SuspensionInput {
    SuspensionInput {
        rack_m: rack,
        rack_speed_m_s: 0.1,
        wheel_height_m: z,
        wheel_speed_m_s: [0.2, -0.1],
        wheel_force_n: [Vector3::new(100.0, 1500.0, 3000.0), Vector3::new(-50.0, 1800.0, 5000.0)],
        wheel_moment_n_m: [Vector3::new(450.0, 10.0, -40.0), Vector3::new(500.0, -10.0, -60.0)],
    }
}

#[test]
fn an_unreachable_input_is_held_named_and_recovered_from() {
    for name in ["sedan_double_wishbone", "compact_strut", "sedan_five_link"] {
        for path in [SolverPath::General, SolverPath::Structured] {
            let mut suspension = Suspension::with_path(&shipped(name), path).unwrap();
            let (mut good, mut held, mut again) =
                <(SuspensionOutput, SuspensionOutput, SuspensionOutput)>::default();
            suspension.step(&loaded(0.02, [0.01, -0.01]), &mut good);
            assert_eq!(good.status, Status::Converged, "{name}");
            for (count, bad) in [loaded(0.9, [0.0; 2]), loaded(0.0, [0.6, 0.0]), loaded(f64::NAN, [0.0; 2])]
                .iter()
                .enumerate()
            {
                suspension.step(bad, &mut held);
                let Status::Held { reason, constraint } = held.status else { panic!("{name}: {held:?}") };
                assert_eq!(reason == Reason::NotFinite, count == 2, "{name} {count} {reason:?}");
                if count < 2 {
                    assert!(suspension.constraint_name(constraint.unwrap()).is_some());
                }
                assert_eq!(held.held_ticks, count as u64 + 1);
                assert_eq!(held.side[0].tie_rod_force_n, good.side[0].tie_rod_force_n);
                assert_eq!(held.side[1].wheel_centre_m, good.side[1].wheel_centre_m);
                assert_eq!(held.side[1].tie_rod_ball_velocity_m_s, Vector3::zeros());
            }
            suspension.step(&loaded(0.02, [0.01, -0.01]), &mut again);
            assert_eq!((again.status, again.held_ticks), (Status::Converged, 0));
            assert!((again.side[0].tie_rod_force_n - good.side[0].tie_rod_force_n).abs() < 1e-9);
        }
    }
}

#[test]
fn degenerate_axles_are_typed_errors() {
    // The outer balls on the kingpin axes: with the height drivers swapped for the springs, nothing holds
    // the knuckles against turning about them.
    let mut axle = shipped("sedan_double_wishbone");
    let Geometry::DoubleWishbone(g) = &mut axle.geometry else { panic!() };
    g.left.tierod_outer_m = [-0.02, 0.7325, 0.0124];
    g.left.tierod_inner_m = [-0.02, 0.40, 0.0124];
    let found = Suspension::new(&axle).unwrap_err();
    let AssemblyError::Redundant { mechanism, constraints } = &found else { panic!("{found:?}") };
    assert!(mechanism.contains("reaction") && !constraints.is_empty(), "{found}");
    // A broken rule of the axle itself comes back as such.
    axle.loaded_radius_m = -1.0;
    assert!(matches!(Suspension::new(&axle), Err(AssemblyError::Axle(_))));
}

#[test]
fn a_restored_state_goes_on_bit_for_bit() {
    for name in ["sedan_double_wishbone", "compact_strut", "sedan_five_link"] {
        let mut axle = shipped(name);
        axle.kingpin_friction = Some(KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.002 });
        let mut one = Suspension::new(&axle).unwrap();
        let mut two = Suspension::new(&axle).unwrap();
        let mut state = vec![0.0; one.state_len()];
        let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
        let input = |k: u32| {
            let t = f64::from(k) * 1e-3;
            let rack = if k == 120 { f64::INFINITY } else { 0.03 * (9.0 * t).sin() };
            loaded(rack, [0.02 * (20.0 * t).sin(), -0.02 * (17.0 * t).sin()])
        };
        for k in 0..120 {
            one.step(&input(k), &mut a);
        }
        one.save_state(&mut state);
        two.load_state(&state);
        for k in 120..300 {
            one.step(&input(k), &mut a);
            two.step(&input(k), &mut b);
            assert_eq!(a, b, "{name} tick {k}");
        }
        one.reset();
        one.step(&input(0), &mut a);
        let mut fresh = Suspension::new(&axle).unwrap();
        fresh.step(&input(0), &mut b);
        assert_eq!(a, b, "{name}: reset");
    }
}

#[test]
fn kingpin_friction_shifts_the_tie_rod_force_by_its_moment_over_the_arm() {
    let smooth = shipped("sedan_double_wishbone");
    let mut rough = smooth.clone();
    rough.kingpin_friction = Some(KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.001 });
    let run = |axle: &Axle, racks: &[f64]| {
        let mut suspension = Suspension::new(axle).unwrap();
        let mut output = SuspensionOutput::default();
        for rack in racks {
            suspension.step(&loaded(*rack, [0.0; 2]), &mut output);
        }
        (output.side[0].tie_rod_force_n, output.side[0].kingpin_friction_n_m)
    };
    let up: Vec<f64> = (0..100_u32).map(|k| 2e-4 * f64::from(k)).collect();
    let down: Vec<f64> =
        up.iter().copied().chain((0..50_u32).map(|k| 0.0198 - 2e-4 * f64::from(k))).collect();
    let free = run(&smooth, &[up[50]]).0;
    let (rising, rising_moment) = run(&rough, &up[..=50]);
    let (falling, falling_moment) = run(&rough, &down[..=148]);
    // The tie rod is behind the axle: rack to the left steers to the right, friction acts to the left.
    assert!((rising_moment - 8.0).abs() < 0.1 && (falling_moment + 8.0).abs() < 0.1);
    let hysteresis = (rising - falling).abs();
    // 16 N m over an arm of about 0.15 m.
    assert!((90.0..130.0).contains(&hysteresis), "{hysteresis}");
    assert!((0.5 * (rising + falling) - free).abs() < 3.0);
}
