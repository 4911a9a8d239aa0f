//! Structured and general path give the same numbers; fuzzed inputs give neither panic nor NaN.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::{Axle, KingpinFriction};
use multibody::{SideOutput, SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput};
use proptest::prelude::*;
use spatial::Vector3;

fn shipped(name: &str) -> Axle {
    let path = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

const NAMES: [&str; 4] =
    ["sedan_double_wishbone", "compact_strut", "sedan_five_link", "sedan_double_wishbone_bushings"];

/// Positions, angles, velocities.
fn side_motion(s: &SideOutput) -> Vec<f64> {
    let mut x = vec![
        s.steer_rad,
        s.toe_rad,
        s.camber_rad,
        s.caster_rad,
        s.kingpin_inclination_rad,
        s.spring_length_m,
    ];
    x.extend(s.knuckle_quaternion);
    let vectors = [
        s.tie_rod_ball_m,
        s.tie_rod_ball_velocity_m_s,
        s.wheel_centre_m,
        s.knuckle_angular_velocity_rad_s,
        s.contact_patch_m,
        s.upper_joint_m,
        s.lower_joint_m,
    ];
    x.extend(vectors.iter().chain(&s.bushing_deflection_m).flat_map(|v| v.iter()));
    x
}

/// Forces and moments.
fn side_loads(s: &SideOutput) -> Vec<f64> {
    let mut x = vec![
        s.tie_rod_force_n,
        s.kingpin_moment_n_m,
        s.kingpin_friction_n_m,
        s.spring_force_n,
        s.drop_link_force_n,
    ];
    let vectors = [s.wheel_force_n, s.wheel_moment_n_m, s.upper_joint_force_n, s.lower_joint_force_n];
    x.extend(vectors.iter().flat_map(|v| v.iter()));
    x
}

fn motion(o: &SuspensionOutput) -> Vec<f64> {
    let mut x = vec![o.stabiliser_angle_rad[0], o.stabiliser_angle_rad[1], o.residual];
    x.extend(o.side.iter().flat_map(side_motion));
    x
}

fn loads(o: &SuspensionOutput) -> Vec<f64> {
    let mut x = vec![o.rack_force_n, o.stabiliser_torque_n_m];
    x.extend(o.side.iter().flat_map(side_loads));
    x
}

fn input(x: &[f64], reach: f64) -> SuspensionInput {
    let vector = |at: usize, scale: f64| Vector3::new(x[at], x[at + 1], x[at + 2]) * scale;
    SuspensionInput {
        rack_m: reach * x[0],
        rack_speed_m_s: x[1],
        wheel_height_m: [reach * x[2], reach * x[3]],
        wheel_speed_m_s: [x[4], x[5]],
        wheel_force_n: [vector(6, 5000.0), vector(9, 5000.0)],
        wheel_moment_n_m: [vector(12, 800.0), vector(15, 800.0)],
    }
}

/// The largest difference: of motion relative to 1 m, 1 rad, 1 m/s or the number itself, of forces and moments
/// to the largest of that tick (at least 1 N): each is a sum of terms of that size.
fn difference(a: &SuspensionOutput, b: &SuspensionOutput) -> f64 {
    let largest = loads(a).iter().fold(1.0_f64, |m, x| m.max(x.abs()));
    let moved =
        motion(a).iter().zip(&motion(b)).map(|(x, y)| (x - y).abs() / x.abs().max(1.0)).fold(0.0, f64::max);
    loads(a).iter().zip(&loads(b)).map(|(x, y)| (x - y).abs() / largest).fold(moved, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn structured_and_general_path_agree(moves in prop::collection::vec(prop::collection::vec(-1.0..1.0f64, 18), 1..8)) {
        for name in NAMES {
            let mut axle = shipped(name);
            axle.kingpin_friction = Some(KingpinFriction { moment_n_m: 8.0, presliding_rad: 0.002 });
            let mut general = Suspension::with_path(&axle, SolverPath::General).unwrap();
            let mut structured = Suspension::with_path(&axle, SolverPath::Structured).unwrap();
            let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
            for x in &moves {
                let input = input(x, 0.045);
                general.step(&input, &mut a);
                structured.step(&input, &mut b);
                prop_assert_eq!(a.status, Status::Converged, "{}", name);
                prop_assert_eq!(b.status, Status::Converged, "{}", name);
                let off = difference(&a, &b);
                prop_assert!(off < 1e-10, "{} {off:e}", name);
            }
        }
    }

    #[test]
    fn fuzzed_inputs_give_finite_outputs(
        seed in prop::collection::vec(prop_oneof![
            8 => -1.0..1.0f64,
            1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(1e300), Just(-1e300), Just(1e-310), Just(0.0)],
        ], 18 * 12),
        reach in prop_oneof![Just(0.05), Just(0.3), Just(3.0), Just(1e6)],
    ) {
        for name in NAMES {
            for path in [SolverPath::General, SolverPath::Structured] {
                let mut suspension = Suspension::with_path(&shipped(name), path).unwrap();
                let mut output = SuspensionOutput::default();
                for (tick, x) in seed.chunks_exact(18).enumerate() {
                    suspension.step(&input(x, reach), &mut output);
                    let finite = motion(&output).iter().chain(&loads(&output)).all(|x| x.is_finite());
                    prop_assert!(finite, "{} {:?} tick {tick}: {:?}", name, path, output);
                    prop_assert_eq!(output.status == Status::Converged, output.held_ticks == 0);
                }
                // Whatever came before: back at design it works again.
                for _ in 0..2 {
                    suspension.step(&SuspensionInput::DESIGN, &mut output);
                }
                prop_assert_eq!(output.status, Status::Converged, "{} {:?}", name, path);
                prop_assert!(output.side[0].wheel_centre_m.x.abs() < 1e-9, "{} {:?} {:?}", name, path, output);
            }
        }
    }
}

#[test]
fn the_paths_agree_along_a_drive_and_say_by_how_much() {
    for name in NAMES {
        let axle = shipped(name);
        let mut general = Suspension::with_path(&axle, SolverPath::General).unwrap();
        let mut structured = Suspension::with_path(&axle, SolverPath::Structured).unwrap();
        let (mut a, mut b) = (SuspensionOutput::default(), SuspensionOutput::default());
        let (mut worst, mut most) = (0.0_f64, 0);
        for tick in 0..4000_u32 {
            let t = f64::from(tick) * 1e-3;
            let mut x = [0.3; 18];
            x[0] = (2.0 * t).sin();
            (x[2], x[3]) = (0.6 * (11.0 * t).sin(), -0.7 * (9.0 * t).cos());
            x[8] = 0.8;
            general.step(&input(&x, 0.05), &mut a);
            structured.step(&input(&x, 0.05), &mut b);
            assert_eq!((a.status, b.status), (Status::Converged, Status::Converged), "{name} {tick}");
            worst = worst.max(difference(&a, &b));
            if tick > 0 {
                most = most.max(a.iterations).max(b.iterations);
            }
        }
        println!("{name}: paths differ by at most {worst:.1e}; at most {most} Newton steps a tick");
        assert!(worst < 1e-10, "{name} {worst:e}");
    }
}
