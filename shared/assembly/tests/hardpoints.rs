//! Kinematics maps of the shipped cars from their own hardpoint files, front and rear, against the solver that made
//! them; and that the cars on these maps drive.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use assembly::{axle_compliance, axle_kinematics, build_car};
use config::axle::Axle;
use config::car::Car;
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use nalgebra::Vector3;
use spatial::EulerParameters;
use std::path::{Path, PathBuf};
use tyre::Tyre;
use vehicle::{AxleKinematics, Vehicle, VehicleInput, knuckle_matrix};

fn schemas(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../schemas").join(path)
}

fn read(path: &str) -> String {
    std::fs::read_to_string(schemas(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn car(name: &str) -> Car {
    toml::from_str(&read(&format!("cars/{name}.toml"))).unwrap()
}

fn axle(file: &str) -> Axle {
    toml::from_str(&read(&format!("suspensions/{file}"))).unwrap()
}

/// Cars whose both axles are drawn.
const DRAWN: [&str; 2] = ["sedan", "compact"];

fn maps(car: &Car) -> [AxleKinematics; 2] {
    let (front, rear) = (car.front.axle_file.as_ref().unwrap(), car.rear.axle_file.as_ref().unwrap());
    let front = axle(front);
    [axle_kinematics(&front, front.rack_stroke_m).unwrap(), axle_kinematics(&axle(rear), 0.0).unwrap()]
}

/// Steer and camber (top outward) of a spin axis on a side.
fn angles(s: &Vector3<f64>, side: usize) -> [f64; 2] {
    let outward = if side == 0 { -1.0 } else { 1.0 };
    [(-s.x).atan2(s.y).to_degrees(), (outward * s.z.asin()).to_degrees()]
}

#[test]
fn maps_are_the_solver_s_own_pose_front_and_rear() {
    for name in DRAWN {
        let c = car(name);
        let maps = maps(&c);
        for (end, file) in [&c.front.axle_file, &c.rear.axle_file].into_iter().enumerate() {
            let axle = axle(file.as_ref().unwrap());
            let mut solver = Suspension::new(&axle).unwrap();
            let mut output = SuspensionOutput::default();
            let (mut worst_deg, mut worst_m) = (0.0f64, 0.0f64);
            let design = {
                solver.step(&SuspensionInput::DESIGN, &mut output);
                output.side.map(|s| s.wheel_centre_m)
            };
            for i in -7..=7 {
                let travel = 0.0103 * f64::from(i);
                for j in if end == 0 { -4..=4 } else { 0..=0 } {
                    let rack = 0.0137 * f64::from(j);
                    solver.reset();
                    // To the pose in steps.
                    for k in 1..=10 {
                        let part = f64::from(k) / 10.0;
                        let input = SuspensionInput {
                            rack_m: part * rack,
                            wheel_height_m: [part * travel; 2],
                            ..SuspensionInput::DESIGN
                        };
                        solver.step(&input, &mut output);
                    }
                    assert_eq!(output.status, Status::Converged, "{name} at {travel} {rack}");
                    for side in 0..2 {
                        let map = &maps[end].sides[side];
                        let value = map.pose(travel, rack).value;
                        let ours = angles(&(knuckle_matrix(&value) * map.spin_axis_k), side);
                        let knuckle =
                            EulerParameters::from_array(output.side[side].knuckle_quaternion).matrix();
                        let theirs = angles(&(knuckle * Vector3::from(axle.spin_axis(side))), side);
                        let moved = output.side[side].wheel_centre_m - design[side];
                        for k in 0..2 {
                            worst_deg = worst_deg.max((ours[k] - theirs[k]).abs());
                        }
                        worst_m = worst_m.max((value[3] - moved.x).abs()).max((value[4] - moved.y).abs());
                    }
                }
            }
            println!(
                "{name} {}: map off the solver by {worst_deg:.5} deg, {:.4} mm",
                axle.name,
                1e3 * worst_m
            );
            assert!(worst_deg < 0.02 && worst_m < 1e-4, "{name} {}: {worst_deg} deg {worst_m} m", axle.name);
        }
    }
}

#[test]
fn rear_axles_are_as_they_were_designed() {
    for name in DRAWN {
        let c = car(name);
        let map = &maps(&c)[1].sides[0];
        let half = 0.001;
        let at = |z: f64| {
            let value = map.pose(z, 0.0).value;
            let r = knuckle_matrix(&value);
            let s = r * map.spin_axis_k;
            // Contact path: below the wheel centre in the wheel plane.
            let patch = value[4] - c.rear.wheel_centre_height_m * -s.z;
            let [steer, camber] = angles(&s, 0);
            [-steer.to_radians(), camber.to_radians(), patch, value[3]]
        };
        let (up, down) = (at(half), at(-half));
        let slope = [0, 1, 2, 3].map(|k| (up[k] - down[k]) / (2.0 * half));
        let roll_centre = 0.5 * c.rear.track_m * slope[2];
        println!(
            "{name}: rear toe-in {:.4} rad/m, camber {:.4} rad/m, roll centre {roll_centre:.4} m, forward {:.4}",
            slope[0], slope[1], slope[3]
        );
        assert!((slope[0] - 0.05).abs() < 0.015, "toe {}", slope[0]);
        assert!((slope[1] + 0.45).abs() < 0.02, "camber {}", slope[1]);
        assert!((roll_centre - 0.10).abs() < 0.02, "roll centre {roll_centre}");
        assert!((slope[3] + 0.05).abs() < 0.02, "forward {}", slope[3]);
    }
}

#[test]
fn cars_on_their_own_hardpoints_drive() {
    for name in DRAWN {
        let c = car(name);
        let t = Tyre::from_tir(&read(&format!("tyres/{}", c.front.tyre_file)), "t").unwrap();
        let mut v = Vehicle::new(&c, maps(&c), [t.clone(), t.clone(), t.clone(), t], 1e-3).unwrap();
        let mut input = VehicleInput { target_speed_m_s: Some(22.22), ..VehicleInput::default() };
        v.reset(22.22, &input);
        let start = *v.output();
        assert!(start.wheels.iter().all(|w| w.travel_m.abs() < 0.005), "{name} does not stand at design");
        for n in 0..6000 {
            input.time_s = 1e-3 * f64::from(n);
            input.steering_wheel_angle_rad = 0.5 * (input.time_s / 0.3).min(1.0);
            v.step(&input);
            // Toe and camber of the car belong to the pose of the solver.
            for w in &v.output().wheels {
                assert!((w.kinematic_camber_rad - w.camber_rad).abs() < 0.01);
            }
        }
        let o = v.output();
        let gradient = (o.roll_rad / o.lateral_acceleration_m_s2 * 9.81).to_degrees();
        println!(
            "{name}: {:.2} m/s2, yaw rate {:.3} rad/s, roll {gradient:.2} deg/g, side slip {:.2} deg",
            o.lateral_acceleration_m_s2,
            o.yaw_rate_rad_s,
            o.side_slip_angle_rad.to_degrees()
        );
        assert!((2.0..6.0).contains(&o.lateral_acceleration_m_s2), "{name}");
        assert!((2.5..6.5).contains(&gradient), "{name}: {gradient} deg/g");
        assert!(o.held_steps == 0);
    }
}

/// Compliance from bushings: signs and sizes at the bench of the solver, small against large loads, and in the car.
#[test]
fn bushings_become_the_car_s_compliance() {
    let bushed = axle("sedan_double_wishbone_bushings.toml");
    let c = axle_compliance(&bushed, 4000.0, 0.005).unwrap();
    println!("{c:?}");
    // The wheel gives way in the direction of the force; across, its centre lies near the line about which it leans.
    assert!((1e-8..1e-5).contains(&c.x_per_fx_m_n) && (1e-9..1e-5).contains(&c.y_per_fy_m_n), "{c:?}");
    // The contact patch moves with a force to the left, the lower arm carrying more of it than the upper one: the wheel
    // turns about +x.
    assert!((1e-9..1e-5).contains(&c.inclination_per_fy_rad_n), "{c:?}");
    assert!(c.steer_per_mz_rad_n_m > 0.0 && c.steer_per_mz_rad_n_m < 1e-4, "{c:?}");
    // Stiffer rubber gives less, in proportion.
    let mut stiff = bushed.clone();
    for bushing in stiff.bushings.as_mut().unwrap().values_mut() {
        bushing.radial_n_per_m *= 10.0;
        bushing.axial_n_per_m *= 10.0;
    }
    let s = axle_compliance(&stiff, 4000.0, 0.005).unwrap();
    assert!((s.y_per_fy_m_n * 10.0 / c.y_per_fy_m_n - 1.0).abs() < 0.1, "{s:?}");
    assert!((s.inclination_per_fy_rad_n * 10.0 / c.inclination_per_fy_rad_n - 1.0).abs() < 0.1, "{s:?}");
    let rigid = axle_compliance(&axle("sedan_double_wishbone.toml"), 4000.0, 0.005);
    assert!(rigid.unwrap_err()[0].contains("needs bushings"));

    // In the car: the shipped saloon's figures, and those of the bushings on top where its axle has them.
    let drive = |overrides: &[String]| {
        let resolved = config::ResolvedCar::load("sedan", overrides).unwrap();
        let own = resolved.car.front.compliance.clone();
        let mut v = build_car(&resolved, 1e-3).unwrap();
        let input = VehicleInput {
            target_speed_m_s: Some(25.0),
            rack_displacement_m: Some(-0.003),
            ..VehicleInput::default()
        };
        v.reset(25.0, &input);
        for _ in 0..4000 {
            v.step(&input);
        }
        (*v.output(), own)
    };
    let (plain, own) = drive(&[]);
    let (soft, same) = drive(&["front.axle_file=sedan_double_wishbone_bushings".to_owned()]);
    assert_eq!(own, same);
    let elastic =
        |o: &vehicle::VehicleOutput, i: usize| o.wheels[i].steer_rad - o.wheels[i].kinematic_steer_rad;
    let mut expected = [0.0; 2];
    for (n, (o, with)) in [(&plain, 0.0), (&soft, 1.0)].into_iter().enumerate() {
        let w = &o.wheels[0];
        let b = config::ResolvedCar::load("sedan", &[]).unwrap().car;
        let front = 1.0 - b.body.front_axle_to_sprung_cg_m / b.body.wheelbase_m;
        let load = 9.80665 * (0.5 * b.body.sprung_mass_kg * front + b.front.unsprung_mass_kg);
        let c = axle_compliance(&bushed, load, 0.005).unwrap();
        expected[n] = (own.steer_per_fx_rad_n + with * c.steer_per_fx_rad_n) * w.fx_n
            + (own.steer_per_fy_rad_n + with * c.steer_per_fy_rad_n) * w.fy_n
            + (own.steer_per_mz_rad_n_m + with * c.steer_per_mz_rad_n_m) * w.mz_n_m;
        let found = elastic(o, 0);
        println!("elastic steer of the left wheel {found:.3e} rad, by its coefficients {:.3e}", expected[n]);
        assert!((found - expected[n]).abs() < 2e-6, "{found} against {}", expected[n]);
    }
    // The shipped saloon's own figures understeer: the lateral force turns its front wheels out of the turn.
    assert!(elastic(&plain, 0) < -2e-4 && plain.wheels[0].fy_n > 500.0);
    assert!((soft.yaw_rate_rad_s / plain.yaw_rate_rad_s - 1.0).abs() > 1e-4, "the bushings change nothing");
}
