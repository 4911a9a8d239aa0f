//! What the quasi-static model leaves out: the inertia of the steered parts, after the source's Table 4.1
//! (strut, parts as point masses at their distances from the kingpin axis, road wheel 12 deg at 1 Hz), then
//! with the wheel's own inertia and with the gyroscopic moment of its spin.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::Axle;
use multibody::body::{Body, Twist};
use multibody::kinematics::{Kinematics, Limits};
use multibody::mechanism::Mechanism;
use multibody::{SolverPath, Suspension, SuspensionInput, SuspensionOutput};
use spatial::{Matrix3, Vector3, triad_along};

/// Upper and lower part of the damper, knuckle with hub and brake, tyre with wheel: mass [kg], distance of the centre of
/// mass from the kingpin axis [m].
const PARTS: [(f64, f64); 4] = [(2.38, 0.020), (2.38, 0.059), (2.72, 0.019), (26.2, 0.065)];

#[test]
fn the_inertia_left_out_is_that_of_the_table() {
    let path = format!("{}/../../../schemas/suspensions/compact_strut.toml", env!("CARGO_MANIFEST_DIR"));
    let axle: Axle =
        toml::from_str::<Axle>(&std::fs::read_to_string(path).unwrap()).unwrap().without_stabiliser();
    let mut suspension = Suspension::with_path(&axle, SolverPath::General).unwrap();
    let mut output = SuspensionOutput::default();
    suspension.step(&SuspensionInput::DESIGN, &mut output);
    let side = output.side[0];
    let d = (side.upper_joint_m - side.lower_joint_m).normalize();
    let knuckle = 2;

    // Accelerations at the turning point of the swing: the rack's acceleration that turns the left wheel about its
    // kingpin axis with A ω² of 12 deg at 1 Hz.
    let (mechanism, poses) = suspension.pose_stage();
    let poses = poses.to_vec();
    let mut drives = suspension.drives(&SuspensionInput::DESIGN);
    let rest = vec![Twist::ZERO; poses.len()];
    let kinematics = |bodies: Vec<Body>| {
        let mechanism = Mechanism::new(bodies, mechanism.constraints().to_vec());
        let mut k = Kinematics::new(
            "strut",
            mechanism,
            &poses,
            &suspension.drives(&SuspensionInput::DESIGN),
            Limits::STANDARD,
        )
        .unwrap();
        k.prepare(&poses, &suspension.drives(&SuspensionInput::DESIGN)).unwrap();
        k
    };
    let massless = mechanism.bodies().to_vec();
    let mut k = kinematics(massless.clone());
    let mut a = rest.clone();
    drives[0].acceleration = 1.0;
    k.acceleration(&rest, &drives, &mut a);
    let wanted = 12.0_f64.to_radians() * std::f64::consts::TAU.powi(2);
    drives[0].acceleration = wanted / a[knuckle].omega.dot(&d);
    k.acceleration(&rest, &drives, &mut a);
    assert!((a[knuckle].omega.dot(&d) - wanted).abs() < 1e-9);

    // Stage 2 carries the load, as in a tick: reactions of the force mechanism.
    let stage = suspension.force_stage();
    let tie = |load: &[f64]| {
        let mut k = Kinematics::new("strut", stage.mechanism.clone(), stage.poses, &drives, Limits::STANDARD)
            .unwrap();
        k.prepare(stage.poses, &drives).unwrap();
        let mut lambda = vec![0.0; stage.mechanism.rows()];
        k.reactions(load, &mut lambda);
        let c = stage.mechanism.constraints().iter().position(|c| c.name == "left tie rod").unwrap();
        stage.mechanism.action(c, k.rows(), &lambda, false).force_n.norm()
    };
    let n = stage.load.len();

    // The parts: point masses beside the axis, their d'Alembert forces as loads on the knuckle.
    let triad = triad_along(&d).unwrap();
    let mut load = vec![0.0; n];
    let mut inertia = 0.0;
    for (mass, distance) in PARTS {
        // On the axis where it is nearest to the wheel centre, then outboard by the table's distance.
        let foot = side.lower_joint_m + d * d.dot(&(side.wheel_centre_m - side.lower_joint_m));
        let outboard = (side.wheel_centre_m - foot).normalize();
        assert!(outboard.dot(&triad.column(2)).abs() < 1e-12);
        let s = foot + outboard * distance - side.wheel_centre_m;
        let acceleration = a[knuckle].v + a[knuckle].omega.cross(&s);
        let force = -mass * acceleration;
        let moment = s.cross(&force);
        for c in 0..3 {
            load[6 * knuckle + c] += force[c];
            load[6 * knuckle + 3 + c] += moment[c];
        }
        inertia += mass * distance * distance;
    }
    let rod = tie(&load);
    println!(
        "point masses: I about the kingpin {inertia:.4} kg m², moment {:.2} N m, tie rod {rod:.2} N",
        inertia * wanted
    );
    // The table's own sum, 0.122, is of rounded parts.
    assert!((inertia - 0.122).abs() < 0.0015);
    assert!((0.9..1.1).contains(&(inertia * wanted)));
    // The table's 6 to 8 N belong to arms of 0.125 to 0.167 m; this strut's is 0.118 m.
    assert!((6.0..8.6).contains(&rod), "{rod}");
    assert!((0.11..0.13).contains(&(inertia * wanted / rod)));

    // The wheel as a body: its mass at the wheel centre and its own diametral inertia, by inverse dynamics.
    let mut bodies = massless;
    bodies[knuckle].mass_kg = 26.2;
    bodies[knuckle].inertia_kg_m2 = Matrix3::from_diagonal(&Vector3::new(0.7, 1.2, 0.7));
    let mut heavy = kinematics(bodies.clone());
    let mut lambda = vec![0.0; mechanism.rows()];
    heavy.inverse_dynamics(&vec![0.0; mechanism.coordinates()], &rest, &a, &mut lambda);
    let c = mechanism.constraints().iter().position(|c| c.name == "left tie rod").unwrap();
    let with_drivers = mechanism.action(c, heavy.rows(), &lambda, false).force_n.norm();
    let mut load = vec![0.0; n];
    let (force, moment) = (-26.2 * a[knuckle].v, -(bodies[knuckle].inertia_kg_m2 * a[knuckle].omega));
    for c in 0..3 {
        load[6 * knuckle + c] = force[c];
        load[6 * knuckle + 3 + c] = moment[c];
    }
    let own = tie(&load);
    println!(
        "wheel with its own inertia (0.7 kg m²): tie rod {own:.1} N (inverse dynamics at held wheel heights {with_drivers:.1} N)"
    );
    assert!((40.0..65.0).contains(&own), "{own}");
    assert!((own - with_drivers).abs() < 0.2 * own);

    // Gyroscopic moment of the spinning wheel, −ω × H, in a 1 Hz lane change at 120 km/h: spin inertia 1.2 kg m² at
    // 111 rad/s, the wheel's camber to the road swinging by 0.7 deg at 1 Hz.
    let camber_rate = 0.7_f64.to_radians() * std::f64::consts::TAU;
    let spin = Vector3::new(0.0, 1.2 * (120.0 / 3.6 / 0.3), 0.0);
    let gyroscopic = -Vector3::new(camber_rate, 0.0, 0.0).cross(&spin);
    let mut load = vec![0.0; n];
    for c in 0..3 {
        load[6 * knuckle + 3 + c] = gyroscopic[c];
    }
    let about_kingpin = gyroscopic.dot(&d).abs();
    let rod = tie(&load);
    println!("gyroscopic moment: {about_kingpin:.1} N m about the kingpin, tie rod {rod:.0} N");
    assert!((8.0..12.0).contains(&about_kingpin), "{about_kingpin}");
    assert!(rod > own);
}
