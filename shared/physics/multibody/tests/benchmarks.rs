//! Forward dynamics against closed forms: pendulum, double pendulum, slider-crank, Bennett's four-bar,
//! heavy top. Energy and constraint drift over 100 s are stated for each, and drawn: with `KINGPIN_DRIFT=FOLDER` set,
//! each writes its curves to FOLDER as an SVG of its own.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod drift_plot;

use std::f64::consts::{PI, TAU};

use multibody::body::{Body, Pose, Twist};
use multibody::constraint::{Constraint, Frame, Kind};
use multibody::dynamics::{Dynamics, Stabilisation};
use multibody::kinematics::{Kinematics, Limits};
use multibody::mechanism::Mechanism;
use multibody::{AssemblyError, Reason};
use spatial::{EulerParameters, Matrix3, Vector3, triad_along};

const G: f64 = 9.81;

fn body(name: &str, mass: f64, inertia: [f64; 3]) -> Body {
    Body {
        name: name.to_owned(),
        mass_kg: mass,
        inertia_kg_m2: Matrix3::from_diagonal(&Vector3::from(inertia)),
    }
}

/// A joint frame on a body at a global point with h along a global axis.
fn frame(pose: &Pose, point: Vector3<f64>, axis: Vector3<f64>) -> Frame {
    Frame { origin: pose.local(&point), axes: pose.p.matrix().tr_mul(&triad_along(&axis).unwrap()) }
}

fn revolute(
    name: &str,
    poses: &[Pose],
    i: usize,
    j: usize,
    point: Vector3<f64>,
    axis: Vector3<f64>,
) -> Constraint {
    let kind = Kind::Revolute { on_i: frame(&poses[i], point, axis), on_j: frame(&poses[j], point, axis) };
    Constraint { name: name.to_owned(), i, j, kind }
}

struct Drift {
    energy: f64,
    constraint: f64,
    /// Time, energy change, |Φ|. [s, -, m]
    curve: Vec<[f64; 3]>,
}

/// Runs for `seconds`; the largest energy change relative to `scale` [J] and the largest |Φ| on the way.
fn run(
    dynamics: &mut Dynamics,
    h: f64,
    seconds: f64,
    scale: f64,
    mut each: impl FnMut(f64, &Dynamics),
) -> Drift {
    let start = dynamics.energy_j();
    let mut drift = Drift { energy: 0.0, constraint: 0.0, curve: Vec::new() };
    let steps = (seconds / h).round() as u64;
    for k in 1..=steps {
        dynamics.step(h).unwrap();
        each(k as f64 * h, dynamics);
        if k % 50 == 0 {
            let (energy, constraint) = ((dynamics.energy_j() - start) / scale, dynamics.violation());
            drift.energy = drift.energy.max(energy.abs());
            drift.constraint = drift.constraint.max(constraint);
            drift.curve.push([k as f64 * h, energy, constraint]);
        }
    }
    drift
}

fn ground() -> Body {
    Body::massless("ground")
}

/// Point-like bob on a massless rod of length 1 about the x axis; starts at `angle` from hanging, at rest.
fn pendulum(angle: f64, stabilisation: Stabilisation) -> Dynamics {
    let bob = Pose {
        r: Vector3::new(0.0, angle.sin(), -angle.cos()),
        p: EulerParameters::from_axis_angle(&Vector3::x(), angle),
    };
    let poses = vec![Pose::IDENTITY, bob];
    let joint = revolute("pivot", &poses, 0, 1, Vector3::zeros(), Vector3::x());
    let mechanism = Mechanism::new(vec![ground(), body("bob", 2.0, [1e-9; 3])], vec![joint]);
    Dynamics::new(mechanism, poses, vec![Twist::ZERO; 2], &[0], Vector3::new(0.0, 0.0, -G), stabilisation)
}

#[test]
fn simple_pendulum_has_the_period_of_the_elliptic_integral() {
    let angle = 2.0_f64;
    // T = 4 √(l/g) K(sin(θ0/2)), K by the arithmetic-geometric mean: K = π/(2 agm(1, cos(θ0/2))).
    let (mut a, mut b) = (1.0, (0.5 * angle).cos());
    for _ in 0..10 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    let period = 4.0 * (1.0 / G).sqrt() * PI / (2.0 * a);
    let mut dynamics = pendulum(angle, Stabilisation::Projection);
    let (mut previous, mut crossings, mut last) = (f64::NAN, 0_u32, 0.0);
    let drift = run(&mut dynamics, 2e-3, 100.0, 2.0 * G, |t, d| {
        let y = d.poses()[1].r.y;
        // Upward passages through the bottom, interpolated with the velocity: y = v δ.
        if previous < 0.0 && y >= 0.0 {
            crossings += 1;
            last = t - y / d.twists()[1].v.y;
        }
        previous = y;
    });
    // The first upward passage is at ¾ T.
    let measured = last / (f64::from(crossings) - 0.25);
    drift_plot::draw("simple pendulum", &drift.curve);
    println!(
        "pendulum: period {measured:.9} s, closed form {period:.9} s; over 100 s energy drift {:.1e} of m g l, constraints {:.1e}",
        drift.energy, drift.constraint
    );
    assert!((measured - period).abs() < 1e-6 * period);
    assert!(drift.energy < 1e-6 && drift.constraint < 1e-11);
}

#[test]
fn stabilisation_matters_and_each_kind_keeps_its_word() {
    let mut violations = Vec::new();
    for stabilisation in
        [Stabilisation::None, Stabilisation::Baumgarte { alpha: 20.0, beta: 20.0 }, Stabilisation::Projection]
    {
        let mut dynamics = pendulum(2.0, stabilisation);
        let drift = run(&mut dynamics, 5e-3, 20.0, 2.0 * G, |_, _| {});
        println!(
            "pendulum, {stabilisation:?}, h = 5 ms, 20 s: constraints {:.1e}, energy {:.1e}",
            drift.constraint, drift.energy
        );
        violations.push(drift.constraint);
    }
    assert!(violations[0] > 10.0 * violations[1] && violations[1] > 10.0 * violations[2], "{violations:?}");
}

#[test]
fn double_pendulum_follows_lagranges_equations() {
    // Equal point masses and rods; Lagrange's equations in the two angles, integrated apart.
    let (t1, t2) = (1.2_f64, -0.4_f64);
    let at = |t1: f64, t2: f64| {
        let first = Vector3::new(0.0, t1.sin(), -t1.cos());
        [first, first + Vector3::new(0.0, t2.sin(), -t2.cos())]
    };
    let [r1, r2] = at(t1, t2);
    let turned = |t: f64| EulerParameters::from_axis_angle(&Vector3::x(), t);
    let poses = vec![Pose::IDENTITY, Pose { r: r1, p: turned(t1) }, Pose { r: r2, p: turned(t2) }];
    let joints = vec![
        revolute("pivot", &poses, 0, 1, Vector3::zeros(), Vector3::x()),
        revolute("elbow", &poses, 1, 2, r1, Vector3::x()),
    ];
    let mechanism =
        Mechanism::new(vec![ground(), body("one", 1.0, [1e-9; 3]), body("two", 1.0, [1e-9; 3])], joints);
    let gravity = Vector3::new(0.0, 0.0, -G);
    let mut dynamics =
        Dynamics::new(mechanism, poses, vec![Twist::ZERO; 3], &[0], gravity, Stabilisation::Projection);
    let rate = |x: [f64; 4]| {
        let [a, b, u, v] = x;
        let (s, c) = ((a - b).sin(), (a - b).cos());
        let (p, q) = (-v * v * s - 2.0 * G * a.sin(), u * u * s - G * b.sin());
        let det = 2.0 - c * c;
        [u, v, (p - c * q) / det, (2.0 * q - c * p) / det]
    };
    let mut x = [t1, t2, 0.0, 0.0];
    let h = 1e-3;
    let mut worst = 0.0_f64;
    let drift = run(&mut dynamics, h, 100.0, 3.0 * G, |t, d| {
        // Four steps of an independent integration of the angles to one of the bodies'; chaos parts them later.
        if t > 5.0 {
            return;
        }
        for _ in 0..4 {
            let e = 0.25 * h;
            let go = |k: [f64; 4], w: f64| std::array::from_fn::<f64, 4, _>(|i| x[i] + w * k[i]);
            let k1 = rate(x);
            let k2 = rate(go(k1, 0.5 * e));
            let k3 = rate(go(k2, 0.5 * e));
            let k4 = rate(go(k3, e));
            x = std::array::from_fn(|i| x[i] + e / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        let [r1, r2] = at(x[0], x[1]);
        worst = worst.max((d.poses()[1].r - r1).norm()).max((d.poses()[2].r - r2).norm());
    });
    drift_plot::draw("double pendulum", &drift.curve);
    println!(
        "double pendulum: off Lagrange's by {worst:.1e} m over 5 s; over 100 s energy drift {:.1e} of 3 m g l, constraints {:.1e}",
        drift.energy, drift.constraint
    );
    assert!(worst < 1e-6 && drift.energy < 1e-5 && drift.constraint < 1e-11, "{worst:e}");
}

#[test]
fn slider_crank_keeps_its_closed_form_and_its_energy() {
    let (crank, rod) = (0.2, 0.5);
    let angle = 0.6_f64;
    let geometry = |t: f64| {
        let pin = Vector3::new(crank * t.cos(), crank * t.sin(), 0.0);
        let slider = pin.x + (rod * rod - pin.y * pin.y).sqrt();
        (pin, Vector3::new(slider, 0.0, 0.0))
    };
    let (pin, slider) = geometry(angle);
    let along = slider - pin;
    let turned = |t: f64| EulerParameters::from_axis_angle(&Vector3::z(), t);
    let poses = vec![
        Pose::IDENTITY,
        Pose { r: 0.5 * pin, p: turned(angle) },
        Pose { r: 0.5 * (pin + slider), p: turned(along.y.atan2(along.x)) },
        Pose::at(slider),
    ];
    let guide = Kind::Translational {
        on_i: frame(&poses[0], Vector3::zeros(), Vector3::x()),
        on_j: frame(&poses[3], slider, Vector3::x()),
    };
    // The rod's end stays on the slider's pin, whose axis is z: two rows; a ball joint would have one too many.
    let end = Kind::Strut { on_i: frame(&poses[3], slider, Vector3::z()), s_j: poses[2].local(&slider) };
    let constraints = vec![
        revolute("shaft", &poses, 0, 1, Vector3::zeros(), Vector3::z()),
        revolute("crank pin", &poses, 1, 2, pin, Vector3::z()),
        Constraint { name: "guide".to_owned(), i: 0, j: 3, kind: guide },
        Constraint { name: "gudgeon pin".to_owned(), i: 3, j: 2, kind: end },
    ];
    let bodies = vec![
        ground(),
        body("crank", 2.0, [0.01, 0.02, 0.02]),
        body("rod", 1.0, [0.001, 0.02, 0.02]),
        body("slider", 1.5, [0.01; 3]),
    ];
    let mechanism = Mechanism::new(bodies, constraints);
    // Consistent speeds for a crank speed of 10 rad/s, from the closed form by central differences.
    let (w, e) = (10.0, 1e-6);
    let ((pin_a, slider_a), (pin_b, slider_b)) = (geometry(angle - e * w), geometry(angle + e * w));
    let rod_angle = |p: Vector3<f64>, s: Vector3<f64>| (s - p).y.atan2((s - p).x);
    let rod_speed = (rod_angle(pin_b, slider_b) - rod_angle(pin_a, slider_a)) / (2.0 * e);
    let speed = |a: Vector3<f64>, b: Vector3<f64>| (b - a) / (2.0 * e);
    let twist = |v, w: f64| Twist { v, omega: Vector3::new(0.0, 0.0, w) };
    let twists = vec![
        Twist::ZERO,
        twist(0.5 * speed(pin_a, pin_b), w),
        twist(0.5 * speed(pin_a + slider_a, pin_b + slider_b), rod_speed),
        twist(speed(slider_a, slider_b), 0.0),
    ];
    let mut dynamics =
        Dynamics::new(mechanism, poses, twists, &[0], Vector3::zeros(), Stabilisation::Projection);
    let scale = dynamics.energy_j();
    let mut worst = 0.0_f64;
    let drift = run(&mut dynamics, 1e-3, 100.0, scale, |_, d| {
        let p = d.poses()[1].p;
        let (_, slider) = geometry(2.0 * p.e.z.atan2(p.e0));
        worst = worst.max((d.poses()[3].r - slider).norm());
    });
    drift_plot::draw("slider-crank", &drift.curve);
    println!(
        "slider-crank: off the closed form by {worst:.1e} m; over 100 s energy drift {:.1e}, constraints {:.1e}",
        drift.energy, drift.constraint
    );
    assert!(worst < 1e-9 && drift.energy < 1e-6 && drift.constraint < 1e-11);
}

/// Bennett's linkage: opposite links of length a, b and twist α, β with sin α / a = sin β / b.
struct Bennett {
    /// Joint points and axes A, B, C, D at one position.
    points: [Vector3<f64>; 4],
    axes: [Vector3<f64>; 4],
}

impl Bennett {
    fn new(theta: f64) -> Self {
        let (a, alpha, beta) = (1.0, 0.7_f64, 1.1_f64);
        let b = a * beta.sin() / alpha.sin();
        // Denavit–Hartenberg: screw by θ about z, then by the link's length and twist about x. Closure relation:
        // tan(θ1/2) tan(θ2/2) = sin((β + α)/2) / sin((β − α)/2).
        let constant = (0.5 * (beta + alpha)).sin() / (0.5 * (beta - alpha)).sin();
        let other = 2.0 * (constant / (0.5 * theta).tan()).atan();
        let mut at = Pose::IDENTITY;
        let (mut points, mut axes) = ([Vector3::zeros(); 4], [Vector3::z(); 4]);
        // Joints A, B, C, D carry θ1, θ2, −θ1, −θ2 and lead into links a, b, a, b.
        for (k, (turn, length, twist)) in
            [(theta, a, alpha), (other, b, beta), (TAU - theta, a, alpha), (TAU - other, b, beta)]
                .into_iter()
                .enumerate()
        {
            (points[k], axes[k]) = (at.r, at.p.matrix() * Vector3::z());
            let p = at.p.then(EulerParameters::from_axis_angle(&Vector3::z(), turn));
            let r = at.r + p.matrix() * Vector3::new(length, 0.0, 0.0);
            at = Pose { r, p: p.then(EulerParameters::from_axis_angle(&Vector3::x(), twist)) };
        }
        // The chain closes: that is Bennett's theorem.
        assert!(at.r.norm() < 1e-12 && (at.p.matrix() - Matrix3::identity()).norm() < 1e-12, "{at:?}");
        Self { points, axes }
    }
}

fn bennett_bodies(linkage: &Bennett) -> (Vec<Body>, Vec<Pose>) {
    let p = linkage.points;
    let middle = |i: usize, j: usize| Pose::at(0.5 * (p[i] + p[j]));
    // The link D–A stands on the ground.
    let bodies = vec![
        ground(),
        body("AB", 2.0, [0.1, 0.12, 0.15]),
        body("BC", 3.0, [0.2, 0.3, 0.25]),
        body("CD", 2.0, [0.1, 0.12, 0.15]),
    ];
    (bodies, vec![Pose::IDENTITY, middle(0, 1), middle(1, 2), middle(2, 3)])
}

#[test]
fn bennetts_four_bar_moves_although_it_should_not() {
    let linkage = Bennett::new(1.0);
    let (bodies, poses) = bennett_bodies(&linkage);
    let [pa, pb, pc, pd] = linkage.points;
    let [ha, hb, hc, hd] = linkage.axes;
    let open = vec![
        revolute("A", &poses, 0, 1, pa, ha),
        revolute("B", &poses, 1, 2, pb, hb),
        revolute("C", &poses, 2, 3, pc, hc),
    ];
    // Four revolutes: 20 equations for 18 coordinates, of rank 17. Refused, with the redundant joint named.
    let mut all = open.clone();
    all.push(revolute("D", &poses, 3, 0, pd, hd));
    let grounded =
        Constraint { name: "ground".to_owned(), i: 0, j: 0, kind: Kind::Ground { pose: Pose::IDENTITY } };
    let with_ground: Vec<Constraint> = all.iter().cloned().chain([grounded]).collect();
    let refused = Kinematics::new(
        "Bennett",
        Mechanism::new(bodies.clone(), with_ground),
        &poses,
        &[],
        Limits::STANDARD,
    );
    assert!(matches!(refused, Err(AssemblyError::NotDetermined { rows: 26, coordinates: 24, .. })));
    let full = Mechanism::new(bodies.clone(), all);
    let mut dynamics = Dynamics::new(
        full.clone(),
        poses.clone(),
        vec![Twist::ZERO; 4],
        &[0],
        Vector3::zeros(),
        Stabilisation::None,
    );
    let failure = dynamics.step(1e-3).unwrap_err();
    assert_eq!(failure.reason, Reason::Singular);
    assert!(failure.constraint.is_some());

    // Joint D by two rows only: D's point on link CD stays on D's axis. The rest follows from Bennett's theorem.
    let mut closed = open;
    let kind = Kind::Strut { on_i: frame(&poses[0], pd, hd), s_j: poses[3].local(&pd) };
    closed.push(Constraint { name: "D on its axis".to_owned(), i: 0, j: 3, kind });
    let mechanism = Mechanism::new(bodies, closed);
    // Gravity so directed that the linkage swings about θ = 1.3: normal to the path of the centre of mass there, and
    // along its curvature. (At some positions the two rows of D are not enough.)
    let moment = |theta: f64| {
        let p = Bennett::new(theta).points;
        (p[0] + p[1]) + 1.5 * (p[1] + p[2]) + (p[2] + p[3])
    };
    let (e, middle) = (1e-3, 1.3);
    let first = (moment(middle + e) - moment(middle - e)) / (2.0 * e);
    let second = (moment(middle + e) - 2.0 * moment(middle) + moment(middle - e)) / (e * e);
    let down = -(second - first * (first.dot(&second) / first.norm_squared())).normalize();
    let gravity = G * down;
    let mut dynamics = Dynamics::new(
        mechanism,
        poses.clone(),
        vec![Twist::ZERO; 4],
        &[0],
        gravity,
        Stabilisation::Projection,
    );
    let mut rows = vec![multibody::constraint::Row::ZERO; full.rows()];
    let (mut worst, mut swing) = (0.0_f64, 0.0_f64);
    let angle = |d: &Dynamics| d.poses()[1].p.rotation_vector().dot(&ha);
    let drift = run(&mut dynamics, 2e-3, 100.0, 50.0, |_, d| {
        full.evaluate(d.poses(), &[], &mut rows);
        worst = rows.iter().fold(worst, |m, row| m.max(row.phi.abs()));
        swing = swing.max(angle(d).abs());
    });
    // Where the linkage ended, the closed form gives the same joint positions.
    let end = Bennett::new(1.0 + angle(&dynamics));
    let b_now = dynamics.poses()[1].point(&poses[1].local(&pb));
    let c_now = dynamics.poses()[2].point(&poses[2].local(&pc));
    let distances =
        |b: Vector3<f64>, c: Vector3<f64>, a: Vector3<f64>, d: Vector3<f64>| [(b - d).norm(), (c - a).norm()];
    let (now, closed_form) = (
        distances(b_now, c_now, pa, pd),
        distances(end.points[1], end.points[2], end.points[0], end.points[3]),
    );
    drift_plot::draw("Bennett's four-bar", &drift.curve);
    println!(
        "Bennett: swings over {swing:.2} rad; the joint left out stays met to {worst:.1e}; diagonals {now:.9?} for {closed_form:.9?}; over 100 s energy drift {:.1e} of 50 J, constraints {:.1e}",
        drift.energy, drift.constraint
    );
    assert!(swing > 0.3 && worst < 1e-9, "{swing} {worst:e}");
    assert!((0..2).all(|k| (now[k] - closed_form[k]).abs() < 1e-8));
    assert!(drift.energy < 1e-6 && drift.constraint < 1e-11);
}

#[test]
fn heavy_top_precesses_steadily() {
    // Symmetrical top on a ball joint at l below its centre. About the point: I = I₁ + m l², I₃. With spin
    // ω₃ = ψ̇ + Ω cos θ the tilt θ stays when m g l = I₃ ω₃ Ω − I Ω² cos θ [Goldstein, ch. 5.7].
    let (mass, l, i1, i3, theta, spin) = (2.0, 0.3, 0.02, 0.03, 0.5_f64, 90.0);
    let i = i1 + mass * l * l;
    let (a, b, c) = (i * theta.cos(), -i3 * spin, mass * G * l);
    let precession = (-b - (b * b - 4.0 * a * c).sqrt()) / (2.0 * a);
    let p = EulerParameters::from_axis_angle(&Vector3::x(), -theta);
    let axis = p.matrix() * Vector3::z();
    let poses = vec![Pose::IDENTITY, Pose { r: l * axis, p }];
    let global = Vector3::z() * precession + axis * (spin - precession * theta.cos());
    let twist = Twist { v: global.cross(&poses[1].r), omega: p.matrix().tr_mul(&global) };
    let kind = Kind::Spherical { s_i: Vector3::zeros(), s_j: Vector3::new(0.0, 0.0, -l) };
    let joint = Constraint { name: "point".to_owned(), i: 0, j: 1, kind };
    let mechanism = Mechanism::new(vec![ground(), body("top", mass, [i1, i1, i3])], vec![joint]);
    let gravity = Vector3::new(0.0, 0.0, -G);
    let mut dynamics =
        Dynamics::new(mechanism, poses, vec![Twist::ZERO, twist], &[0], gravity, Stabilisation::Projection);
    let (mut tilt, mut angle, mut previous) = (0.0_f64, 0.0, axis.y.atan2(axis.x));
    let momentum = |d: &Dynamics| {
        let (pose, twist) = (&d.poses()[1], &d.twists()[1]);
        let own = pose.p.matrix() * Vector3::new(i1 * twist.omega.x, i1 * twist.omega.y, i3 * twist.omega.z);
        (pose.r.cross(&(mass * twist.v)) + own).z
    };
    let start = momentum(&dynamics);
    let scale = dynamics.energy_j();
    let seconds = 100.0;
    let drift = run(&mut dynamics, 5e-4, seconds, scale, |_, d| {
        let now = d.poses()[1].p.matrix() * Vector3::z();
        tilt = tilt.max((now.z.acos() - theta).abs());
        let heading = now.y.atan2(now.x);
        angle += (heading - previous + PI).rem_euclid(TAU) - PI;
        previous = heading;
    });
    let off = angle / (precession * seconds) - 1.0;
    let momentum_off = momentum(&dynamics) / start - 1.0;
    drift_plot::draw("heavy top", &drift.curve);
    println!(
        "heavy top: precession {precession:.4} rad/s off by {off:.1e}, tilt by {tilt:.1e} rad, vertical momentum by {momentum_off:.1e}; over 100 s energy drift {:.1e}, constraints {:.1e}",
        drift.energy, drift.constraint
    );
    assert!(off.abs() < 1e-5 && tilt < 1e-4 && momentum_off.abs() < 1e-5);
    assert!(drift.energy < 1e-5 && drift.constraint < 1e-11);
}
