//! Axles as nobody would draw them: random hardpoints, mangled files, inputs of all sizes. A typed error that names
//! what is wrong, or numbers; no panic, no NaN.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::{Axle, Geometry};
use multibody::{AssemblyError, SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;

struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn shipped(name: &str) -> Axle {
    let path = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

const NAMES: [&str; 4] =
    ["sedan_double_wishbone", "compact_strut", "sedan_five_link", "sedan_double_wishbone_bushings"];

/// Moves every point by up to `by`; now and then makes two points one, or a coordinate absurd.
fn mangle(axle: &mut Axle, by: f64, random: &mut Random) {
    let mut points: Vec<&mut [f64; 3]> = Vec::new();
    match &mut axle.geometry {
        Geometry::DoubleWishbone(g) => {
            let p = &mut g.left;
            points.extend([
                &mut p.uca_front_m,
                &mut p.uca_rear_m,
                &mut p.uca_ball_m,
                &mut p.lca_front_m,
                &mut p.lca_rear_m,
                &mut p.lca_ball_m,
                &mut p.tierod_inner_m,
                &mut p.tierod_outer_m,
                &mut p.spring_upper_m,
                &mut p.spring_lower_m,
                &mut p.wheel_centre_m,
            ]);
        }
        Geometry::Strut(g) => {
            let p = &mut g.left;
            points.extend([
                &mut p.lca_front_m,
                &mut p.lca_rear_m,
                &mut p.lca_ball_m,
                &mut p.strut_top_m,
                &mut p.strut_lower_m,
                &mut p.tierod_inner_m,
                &mut p.tierod_outer_m,
                &mut p.wheel_centre_m,
            ]);
        }
        Geometry::FiveLink(g) => {
            let p = &mut g.left;
            points.extend([
                &mut p.upper_front_inner_m,
                &mut p.upper_front_outer_m,
                &mut p.upper_rear_inner_m,
                &mut p.upper_rear_outer_m,
                &mut p.lower_front_inner_m,
                &mut p.lower_front_outer_m,
                &mut p.lower_rear_inner_m,
                &mut p.lower_rear_outer_m,
                &mut p.tierod_inner_m,
                &mut p.tierod_outer_m,
                &mut p.spring_upper_m,
                &mut p.spring_lower_m,
                &mut p.wheel_centre_m,
            ]);
        }
    }
    if let Some(bar) = &mut axle.stabiliser {
        let p = &mut bar.left;
        points.extend([&mut p.arb_bush_m, &mut p.arb_arm_end_m, &mut p.droplink_upper_m]);
    }
    for p in &mut points {
        for x in p.iter_mut() {
            *x += by * random.next();
        }
    }
    let count = points.len();
    let mut pick = || ((0.5 + 0.5 * random.next()) * count as f64) as usize % count;
    let (a, b) = (pick(), pick());
    match ((random.next() + 1.0) * 10.0) as u32 {
        0 => *points[a] = *points[b],
        1 => points[a][1] = -points[a][1],
        2 => points[a][2] = [f64::NAN, f64::INFINITY, 1e300, 1e-320][b % 4],
        3 => *points[a] = [0.0; 3],
        _ => {}
    }
}

#[test]
fn random_axles_are_refused_by_name_or_solved() {
    let mut random = Random(20);
    let (mut refused, mut named, mut solved, mut held) = (0, 0, 0, 0);
    for round in 0..240_u32 {
        let name = NAMES[round as usize % 4];
        let mut axle = shipped(name);
        let by = [0.003, 0.03, 0.15, 0.6][(round / 4) as usize % 4];
        mangle(&mut axle, by, &mut random);
        let path = if round % 8 < 4 { SolverPath::Structured } else { SolverPath::General };
        let mut suspension = match Suspension::with_path(&axle, path) {
            Ok(suspension) => suspension,
            Err(error) => {
                refused += 1;
                match &error {
                    AssemblyError::Axle(broken) => {
                        assert!(!broken.is_empty() && broken.iter().all(|b| !b.rule.is_empty()));
                    }
                    AssemblyError::Redundant { constraints, .. } => {
                        assert!(!constraints.is_empty(), "{error}")
                    }
                    other => assert!(!other.to_string().is_empty()),
                }
                continue;
            }
        };
        let mut output = SuspensionOutput::default();
        for tick in 0..16_u32 {
            let reach = [0.005, 0.05, 0.3, 5.0][tick as usize % 4];
            let mut vector = |size: f64| Vector3::from([0; 3].map(|_| size * random.next()));
            let (f, m) = ([vector(8000.0), vector(8000.0)], [vector(900.0), vector(900.0)]);
            let input = SuspensionInput {
                rack_m: reach * random.next(),
                rack_speed_m_s: random.next(),
                wheel_height_m: [reach * random.next(), reach * random.next()],
                wheel_speed_m_s: [random.next(), random.next()],
                wheel_force_n: f,
                wheel_moment_n_m: m,
            };
            suspension.step(&input, &mut output);
            let mut state = vec![0.0; suspension.state_len()];
            suspension.save_state(&mut state);
            assert!(state.iter().all(|x| x.is_finite()), "{name} round {round} tick {tick}");
            // Every number that is written down is one.
            let text = format!("{output:?}");
            assert!(
                !text.contains("NaN") && !text.contains("inf"),
                "{name} round {round} tick {tick}: {text}"
            );
            if let Status::Held { constraint, .. } = output.status {
                held += 1;
                named += usize::from(constraint.and_then(|c| suspension.constraint_name(c)).is_some());
            } else {
                solved += 1;
            }
        }
    }
    println!(
        "240 axles: {refused} refused; ticks: {solved} solved, {held} held, {named} of them by a constraint's name"
    );
    assert!(refused > 15 && solved > 1000 && held > 500);
    // What is held is held for a constraint, but where the balance of an elastic equilibrium fails as a whole.
    assert!(named * 10 > held * 9, "{named} of {held}");
}

#[test]
fn mangled_hardpoint_files_are_refused_or_read() {
    let whole = r#"{"name":"x","type":"macpherson_strut","rack_full_m":0.07,"loaded_radius":0.3,
        "static_toe_in_rad":[0,0],"static_camber_rad":[0,0],"arb_stiffness_Nm_per_rad":1500.0,"left":{},"right":{}}"#;
    let mut random = Random(3);
    let mut bytes = whole.as_bytes().to_vec();
    for _ in 0..3000 {
        let at = ((0.5 + 0.5 * random.next()) * bytes.len() as f64) as usize % bytes.len();
        let old = bytes[at];
        bytes[at] = b"{}[]\",:0-9eENanxtrue"[((0.5 + 0.5 * random.next()) * 20.0) as usize % 20];
        let found = Axle::from_hardpoint_json(&String::from_utf8_lossy(&bytes), "x");
        assert!(found.is_err_and(|broken| !broken.is_empty()));
        if random.next() > -0.9 {
            bytes[at] = old;
        }
    }
}
