//! Kinematics maps of the shipped cars from their own hardpoint files, front and rear, against the solver that made
//! them; and that the cars on these maps drive.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use assembly::axle_kinematics;
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
