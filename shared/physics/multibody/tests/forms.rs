//! Claims about the solver itself: both coordinate forms agree, Newton is quadratic, every body is in
//! balance, reactions obey virtual work, velocities and accelerations are those of the motion.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::Axle;
use multibody::body::{Body, Pose, Twist};
use multibody::constraint::Drive;
use multibody::kinematics::{Kinematics, Limits};
use multibody::mechanism::Mechanism;
use multibody::{SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput, dynamics, euler_form};
use spatial::{Matrix3, Vector3};

fn shipped(name: &str) -> Axle {
    let path = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

const NAMES: [&str; 3] = ["sedan_double_wishbone", "compact_strut", "sedan_five_link"];

fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    ((*seed >> 11) as f64) / ((1_u64 << 52) as f64) - 1.0
}

fn random_input(seed: &mut u64) -> SuspensionInput {
    let mut vector = |scale: f64| Vector3::from_fn(|_, _| scale * random(seed));
    let (wheel_force_n, wheel_moment_n_m) =
        ([vector(5000.0), vector(5000.0)], [vector(700.0), vector(700.0)]);
    SuspensionInput {
        rack_m: 0.045 * random(seed),
        rack_speed_m_s: random(seed),
        wheel_height_m: [0.05 * random(seed), 0.05 * random(seed)],
        wheel_speed_m_s: [random(seed), random(seed)],
        wheel_force_n,
        wheel_moment_n_m,
    }
}

/// The same mechanism with masses, so that dynamics are defined.
fn heavy(mechanism: &Mechanism) -> Mechanism {
    let bodies = mechanism.bodies().iter().enumerate().map(|(k, body)| {
        let x = 1.0 + 0.3 * k as f64;
        let inertia_kg_m2 = Matrix3::new(x, 0.1, -0.2, 0.1, 1.4 * x, 0.05, -0.2, 0.05, 0.8 * x);
        Body { name: body.name.clone(), mass_kg: 5.0 * x, inertia_kg_m2 }
    });
    Mechanism::new(bodies.collect(), mechanism.constraints().to_vec())
}

#[test]
fn seven_coordinates_give_what_six_give() {
    let mut seed = 3;
    let mut worst = [0.0_f64; 4];
    for name in NAMES {
        let axle = shipped(name);
        let mut suspension = Suspension::with_path(&axle, SolverPath::General).unwrap();
        let design = suspension.pose_stage().1.to_vec();
        let mut output = SuspensionOutput::default();
        for _ in 0..20 {
            let input = random_input(&mut seed);
            suspension.step(&input, &mut output);
            assert_eq!(output.status, Status::Converged);
            let (mechanism, poses) = suspension.pose_stage();
            // Positions, in a few pieces from design.
            let mut seven = design.clone();
            for piece in 1..=10 {
                let share = f64::from(piece) / 10.0;
                let part = SuspensionInput {
                    rack_m: share * input.rack_m,
                    wheel_height_m: input.wheel_height_m.map(|z| share * z),
                    ..input
                };
                euler_form::position(mechanism, &mut seven, &suspension.drives(&part)).unwrap();
            }
            for (six, seven) in poses.iter().zip(&seven) {
                assert!((seven.p.norm_squared() - 1.0).abs() < 1e-12);
                let off = (six.r - seven.r).amax().max((six.p.matrix() - seven.p.matrix()).amax());
                worst[0] = worst[0].max(off);
            }
            // Reactions.
            let stage = suspension.force_stage();
            let drives = suspension.drives(&input);
            let lambda = euler_form::reactions(stage.mechanism, stage.poses, &drives, stage.load).unwrap();
            let scale = stage.lambda.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
            for (six, seven) in stage.lambda.iter().zip(&lambda) {
                worst[1] = worst[1].max((six - seven).abs() / scale);
            }
            // Dynamics, of the force stage with masses, its rack driver among the constraints.
            let mechanism = heavy(stage.mechanism);
            let twists: Vec<Twist> = (0..mechanism.bodies().len())
                .map(|_| Twist {
                    v: Vector3::from_fn(|_, _| random(&mut seed)),
                    omega: Vector3::from_fn(|_, _| 3.0 * random(&mut seed)),
                })
                .collect();
            let (a6, l6) =
                dynamics::accelerations(&mechanism, stage.poses, &twists, &drives, stage.load).unwrap();
            let (a7, l7) =
                euler_form::accelerations(&mechanism, stage.poses, &twists, &drives, stage.load).unwrap();
            let scale = a6.iter().fold(1.0_f64, |m, a| m.max(a.v.amax()).max(a.omega.amax()));
            for (a, b) in a6.iter().zip(&a7) {
                worst[2] = worst[2].max((a.v - b.v).amax().max((a.omega - b.omega).amax()) / scale);
            }
            let scale = l6.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
            worst[3] = l6.iter().zip(&l7).fold(worst[3], |m, (a, b)| m.max((a - b).abs() / scale));
        }
    }
    println!(
        "6 and 7 coordinates differ by at most: poses {:.1e}, reactions {:.1e}, accelerations {:.1e}, dynamic λ {:.1e} (relative)",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst.iter().all(|x| *x < 1e-10), "{worst:?}");
}

#[test]
fn newton_converges_quadratically() {
    let limits = Limits { step: 1e-14, phi: 1e-15, step_max: 1.0, iterations: 12 };
    for name in NAMES {
        let suspension = Suspension::with_path(&shipped(name), SolverPath::General).unwrap();
        let (mechanism, design) = suspension.pose_stage();
        let start = suspension.drives(&SuspensionInput::DESIGN);
        let mut kinematics = Kinematics::new(name, mechanism.clone(), design, &start, limits).unwrap();
        let target =
            SuspensionInput { rack_m: 0.02, wheel_height_m: [0.03, -0.02], ..SuspensionInput::DESIGN };
        let mut poses = design.to_vec();
        // Rounding may keep the last steps above the (deliberately tiny) limits.
        let _ = kinematics.position(&mut poses, &suspension.drives(&target));
        let steps = kinematics.steps();
        let shown: Vec<String> = steps.iter().map(|s| format!("{s:.1e}")).collect();
        println!("{name}: lengths of Newton's steps {}", shown.join(", "));
        let usable: Vec<f64> = steps.iter().copied().take_while(|s| *s > 1e-13).collect();
        assert!(usable.len() >= 3 && usable.len() <= 6, "{name}: {steps:?}");
        for pair in usable.windows(2).filter(|pair| pair[0] < 0.2 && pair[1] > 1e-12) {
            let constant = pair[1] / (pair[0] * pair[0]);
            assert!(constant < 30.0, "{name}: {steps:?}");
        }
        let last = &usable[usable.len() - 3..];
        let order = (last[2] / last[1]).ln() / (last[1] / last[0]).ln();
        assert!(order > 1.7, "{name}: order {order:.2}, {steps:?}");
    }
}

#[test]
fn every_body_is_in_balance() {
    let mut seed = 11;
    for name in NAMES {
        for path in [SolverPath::General, SolverPath::Structured] {
            let mut suspension = Suspension::with_path(&shipped(name), path).unwrap();
            let mut output = SuspensionOutput::default();
            let mut worst = 0.0_f64;
            for _ in 0..100 {
                let input = random_input(&mut seed);
                suspension.step(&input, &mut output);
                assert_eq!(output.status, Status::Converged);
                let (left, load) = suspension.imbalance().unwrap();
                worst = left.iter().fold(worst, |m, x| m.max(x.abs() / load));
            }
            println!("{name} {path:?}: body balance closes to {worst:.1e} of the load");
            assert!(worst < 1e-9, "{name} {path:?}: {worst:e}");
        }
    }
}

#[test]
fn joint_frame_reactions_are_the_statics_of_the_joint() {
    // At each two-body joint: what it does to j is the opposite of what it does to i, about the same point;
    // and a joint does no work along what it leaves free.
    let mut suspension = Suspension::new(&shipped("compact_strut")).unwrap();
    let mut output = SuspensionOutput::default();
    let mut seed = 5;
    for _ in 0..30 {
        suspension.step(&random_input(&mut seed), &mut output);
        let stage = suspension.force_stage();
        for (c, constraint) in stage.mechanism.constraints().iter().enumerate() {
            if constraint.kind.is_absolute() || constraint.kind.name() == "strut" {
                continue;
            }
            let [on_i, on_j] = [true, false]
                .map(|i| stage.mechanism.joint_reaction(c, stage.rows, stage.lambda, stage.poses, i));
            let turn = |i: bool| {
                let body = if i { constraint.i } else { constraint.j };
                stage.poses[body].p.matrix() * constraint.axes_on(i)
            };
            let scale = on_i.force_n.norm().max(1.0);
            assert!(
                (turn(true) * on_i.force_n + turn(false) * on_j.force_n).norm() < 1e-9 * scale,
                "{}",
                constraint.name
            );
            match constraint.kind.name() {
                // Free to turn about h: no moment about it.
                "revolute" => assert!(on_j.moment_n_m.z.abs() < 1e-8 * scale.max(on_j.moment_n_m.norm())),
                // Links and balls: no moment at all about their ends.
                "distance" | "spherical" => {
                    assert!(on_i.moment_n_m.norm().max(on_j.moment_n_m.norm()) < 1e-9 * scale)
                }
                // The guide leaves the stroke free: no force along h.
                "translational" => assert!(on_j.force_n.z.abs() < 1e-9 * scale),
                _ => {}
            }
        }
    }
}

#[test]
fn the_rack_force_obeys_virtual_work() {
    let mut seed = 21;
    for name in NAMES {
        let mut suspension = Suspension::with_path(&shipped(name), SolverPath::General).unwrap();
        let mut output = SuspensionOutput::default();
        let mut worst = 0.0_f64;
        for _ in 0..10 {
            let input = random_input(&mut seed);
            suspension.step(&input, &mut output);
            let stage = suspension.force_stage();
            // The force stage with its springs locked as they are, moved by the rack alone.
            let h = 1e-5;
            let drive =
                |rack: f64| [Drive { value: rack, ..Drive::default() }, Drive::default(), Drive::default()];
            let locked = stage.mechanism.constraints().iter().map(|c| {
                let mut c = c.clone();
                if let multibody::constraint::Kind::Distance { s_i, s_j, length_m } = &mut c.kind {
                    *length_m = (stage.poses[c.j].point(s_j) - stage.poses[c.i].point(s_i)).norm();
                }
                c
            });
            let mechanism = Mechanism::new(stage.mechanism.bodies().to_vec(), locked.collect());
            let mut kinematics =
                Kinematics::new(name, mechanism, stage.poses, &drive(input.rack_m), Limits::STANDARD)
                    .unwrap();
            let mut moved = |rack: f64| {
                let mut poses = stage.poses.to_vec();
                kinematics.position(&mut poses, &drive(rack)).unwrap();
                poses
            };
            let (plus, minus): (Vec<Pose>, Vec<Pose>) = (moved(input.rack_m + h), moved(input.rack_m - h));
            let mut work = output.rack_force_n * 2.0 * h;
            let mut size = 0.0;
            for (b, load) in stage.load.chunks_exact(6).enumerate() {
                let force = Vector3::new(load[0], load[1], load[2]);
                let moment = Vector3::new(load[3], load[4], load[5]);
                let shift = plus[b].r - minus[b].r;
                let turn = minus[b].p.relative_to(plus[b].p).rotation_vector();
                work += force.dot(&shift) + moment.dot(&turn);
                size += (force.norm() * shift.norm()) + moment.norm() * turn.norm();
            }
            worst = worst.max(work.abs() / size);
        }
        println!("{name}: virtual work of the reactions off by {worst:.1e} (finite difference)");
        assert!(worst < 1e-6, "{name}: {worst:e}");
    }
}

#[test]
fn velocities_and_accelerations_are_those_of_the_motion() {
    for name in NAMES {
        let suspension = Suspension::with_path(&shipped(name), SolverPath::General).unwrap();
        let (mechanism, design) = suspension.pose_stage();
        let start = suspension.drives(&SuspensionInput::DESIGN);
        let mut kinematics =
            Kinematics::new(name, mechanism.clone(), design, &start, Limits::STANDARD).unwrap();
        let drives = |t: f64| {
            std::array::from_fn::<Drive, 3, _>(|k| {
                let (x0, v, a) = (start[k].value + 0.01 * k as f64, [0.3, -0.2, 0.4][k], [2.0, 3.0, -1.0][k]);
                Drive { value: x0 + v * t + 0.5 * a * t * t, speed: v + a * t, acceleration: a }
            })
        };
        let mut poses = design.to_vec();
        let mut at = |t: f64| {
            kinematics.position(&mut poses, &drives(t)).unwrap();
            poses.clone()
        };
        let h = 2e-4;
        let [minus, now, plus] = [-h, 0.0, h].map(&mut at);
        let mut twists = vec![Twist::ZERO; now.len()];
        let mut accelerations = twists.clone();
        kinematics.prepare(&now, &drives(0.0)).unwrap();
        kinematics.velocity(&drives(0.0), &mut twists).unwrap();
        kinematics.acceleration(&twists, &drives(0.0), &mut accelerations);
        for b in 0..now.len() {
            let v = (plus[b].r - minus[b].r) / (2.0 * h);
            let a = (plus[b].r - 2.0 * now[b].r + minus[b].r) / (h * h);
            let (ahead, behind) = (
                now[b].p.relative_to(plus[b].p).rotation_vector(),
                now[b].p.relative_to(minus[b].p).rotation_vector(),
            );
            assert!((v - twists[b].v).norm() < 1e-6, "{name}");
            assert!((a - accelerations[b].v).norm() < 1e-4, "{name}: {a} {}", accelerations[b].v);
            assert!(((ahead - behind) / (2.0 * h) - twists[b].omega).norm() < 1e-5, "{name}");
            assert!(((ahead + behind) / (h * h) - accelerations[b].omega).norm() < 2e-3, "{name}");
        }
    }
}
