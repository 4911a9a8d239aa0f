//! Against the CommonRoad multi-body model on the same parameters (spec 3.3), below 0.6 g.
//!
//! Theirs and ours differ by named simplifications. Switched to theirs here:
//! - camber in the tyre: they use the formula, whose axes are ISO-W, with the camber of an SAE frame, so a wheel
//!   that leans outward pushes inward; and the shifts take the sign of camber, which makes a step at zero (two
//!   tyres, exchanged when the inclination changes sign);
//! - the load's lateral shift under lateral force (K_lt), and their springs' sideways part, which acts at the wheel
//!   centres so that the leaning weight transfers load with the arm h_s − R and not h_s: both proportional to lateral
//!   acceleration and past the springs, here as heights of roll centre and centre of gravity;
//! - no gyroscopic moments (small spin inertia here);
//! - axles that stay upright: their unsprung masses do not lean with the body. Ours do (independent suspension),
//!   so here their mass is in the body and the roll centre so high that their load transfer passes the springs.
//!
//! - slip angles from the lateral velocity at the height of the sprung centre of gravity, not at the contact: here an
//!   import adds h p/V to the steer of all wheels.
//!
//! Not switched: their lateral spring and damper between body and axle.

use crate::support::*;
use config::car::Car;
use tyre::Tyre;
use vehicle::{ImportMode, Imports, Vehicle, VehicleInput};

struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|c| c.parse().unwrap_or(f64::NAN)).collect()).collect();
        Self { names, rows }
    }

    fn column(&self, name: &str) -> Vec<f64> {
        let at = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|r| r[at]).collect()
    }
}

fn at(values: &[f64], dt: f64, t: f64) -> f64 {
    let u = (t / dt).clamp(0.0, (values.len() - 1) as f64);
    let k = (u as usize).min(values.len() - 2);
    values[k] + (values[k + 1] - values[k]) * (u - k as f64)
}

/// Their tyre for wheels that lean to the side of `sign` (ISO-W).
fn their_tyre(name: &str, sign: f64) -> Tyre {
    let text = tyre_text(&format!("commonroad_{name}.tir")).replace("TYRESIDE = 'LEFT'\n", "");
    let text = with_keys(
        &text,
        &[
            ("PHY1", -0.0026747 * sign),
            ("PVY1", -0.037318 * sign),
            ("PHY3", -0.031415),
            ("PVY3", 0.32931),
            ("RVY3", 0.27568),
        ],
    );
    Tyre::from_tir(&text, name).unwrap()
}

/// Axles that stay upright: unsprung masses in the body, their load transfer past the springs.
fn upright_axles(c: &mut Car, k_lt: f64) {
    const LEFT: f64 = 5.0;
    let mut moved = 0.0;
    let mut height = 0.0;
    let mut behind = 0.0;
    let b = &mut c.body;
    let l = b.wheelbase_m;
    for (axle, x) in [(&mut c.front, 0.0), (&mut c.rear, l)] {
        let m = 2.0 * (axle.unsprung_mass_kg - LEFT);
        moved += m;
        height += m * axle.wheel_centre_height_m;
        behind += m * x;
        axle.unsprung_mass_kg = LEFT;
        axle.wheel_mass_kg = LEFT;
        // Their yaw inertia goes to the body.
        b.yaw_inertia_kg_m2 += m * ((x - b.front_axle_to_sprung_cg_m).powi(2) + 0.25 * axle.track_m.powi(2));
        axle.wheel_spin_inertia_kg_m2 = 0.3;
    }
    let total = b.sprung_mass_kg + moved;
    let sprung_height = b.sprung_cg_height_m;
    // Load transfer past the springs beyond that: per lateral acceleration, over the mass.
    let rate = |axle: &config::car::CarAxle| {
        0.5 * axle.track_m.powi(2) * axle.spring.force_n[2] / axle.spring.compression_m[2]
            + axle.anti_roll_bar_n_m_rad
    };
    let arm = b.sprung_mass_kg * sprung_height;
    let roll = arm / (rate(&c.front) + rate(&c.rear) - 9.81 * arm);
    let beyond = k_lt * total * 9.81 * 0.25 * 1.15 - 9.81 * b.sprung_mass_kg * 0.344 * roll / total;
    b.sprung_cg_height_m = (b.sprung_mass_kg * sprung_height + height) / total + beyond;
    b.front_axle_to_sprung_cg_m = (b.sprung_mass_kg * b.front_axle_to_sprung_cg_m + behind) / total;
    // Pitch: the unsprung masses do not pitch with the body; roll inertia likewise stays.
    for axle in [&mut c.front, &mut c.rear] {
        axle.kinematics.as_mut().unwrap().roll_centre_height_m = height / total + beyond;
    }
    b.sprung_mass_kg = total;
}

struct Errors {
    lateral: f64,
    yaw: f64,
    roll: f64,
    load: f64,
    seconds: f64,
}

fn compare(name: &str, file: &str, k_lt: f64, their_sign: bool) -> Option<Errors> {
    let table = Table::read(&reference(&format!("vehicle/crmb_{name}_{file}.csv"))?);
    let mut section = car(name);
    for axle in [&mut section.front, &mut section.rear] {
        axle.wheel_diametral_inertia_kg_m2 = 1e-3;
    }
    if their_sign {
        upright_axles(&mut section, k_lt);
    }
    section.speed_control.proportional_1_s = 5.0;
    section.speed_control.integral_1_s2 = 2.0;
    let plus = their_tyre(name, 1.0);
    let minus = their_tyre(name, -1.0);
    let four = |t: &Tyre| [t.clone(), t.clone(), t.clone(), t.clone()];
    let mut car = if their_sign {
        Vehicle::new(&section, maps(&section), four(&plus), 1e-3).unwrap()
    } else {
        build(&section)
    };
    let (steer, speed) = (table.column("delta_road_rad"), table.column("v_x_mps"));
    let ratio = 16.0;
    let time = table.column("t_s");
    let dt = time[1] - time[0];
    let each = (dt * 1000.0).round() as usize;
    let mut input = VehicleInput {
        steering_wheel_angle_rad: ratio * steer[0],
        target_speed_m_s: Some(speed[0]),
        ..VehicleInput::default()
    };
    car.reset(speed[0], &input);
    let lateral = table.column("ay_cg_mps2");
    let (yaw, roll) = (table.column("yawrate_rps"), table.column("roll_rad"));
    let load: Vec<Vec<f64>> =
        ["fl", "fr", "rl", "rr"].iter().map(|w| table.column(&format!("Fz_N_{w}"))).collect();
    // The circle starts in a turn: give it time to get there.
    let from = if file.starts_with("circle") { 15.0 } else { 0.0 };
    let mut sums = [0.0; 4];
    let mut count = 0.0;
    let mut signs = [1.0; 4];
    let steers = ["fl", "fr", "rl", "rr"].map(|w| Imports::find(&format!("steer_rad_{w}")).unwrap());
    let rows = table.rows.len();
    let mut seconds = 0.0;
    for n in 1..rows {
        for k in 0..each {
            let t = dt * (n - 1) as f64 + 1e-3 * k as f64;
            input.time_s = t;
            input.steering_wheel_angle_rad = ratio * at(&steer, dt, t + 1e-3);
            input.target_speed_m_s = Some(at(&speed, dt, t));
            if their_sign {
                for (i, w) in car.output().wheels.map(|w| w.inclination_rad).into_iter().enumerate() {
                    if w * signs[i] < 0.0 {
                        signs[i] = -signs[i];
                        car.set_tyre(i, if signs[i] > 0.0 { &plus } else { &minus });
                    }
                }
            }
            if their_sign {
                // They leave out the sideways motion of the contacts by roll.
                let o = car.output();
                let extra = section.body.sprung_cg_height_m * o.angular_velocity_rad_s[0] / o.velocity_m_s[0];
                for id in &steers {
                    car.imports_mut().set(*id, ImportMode::Add, extra);
                }
            }
            car.step(&input);
        }
        let now = dt * n as f64;
        if now < from {
            continue;
        }
        if lateral[n].abs() > 0.6 * 9.81 {
            break;
        }
        seconds = now;
        let o = car.output();
        sums[0] += (o.lateral_acceleration_cg_m_s2 - lateral[n]).powi(2);
        sums[1] += (o.yaw_rate_rad_s - yaw[n]).powi(2);
        sums[2] += (o.roll_rad - roll[n]).powi(2);
        for i in 0..4 {
            sums[3] += 0.25 * ((o.wheels[i].fz_n - load[i][n]) / load[i][0]).powi(2);
        }
        count += 1.0;
    }
    let (first, last) = ((from / dt).round() as usize, (seconds / dt).round() as usize);
    let peak = |v: &[f64]| v[first..=last].iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let rms = sums.map(|s| (s / count).sqrt());
    if std::env::var("KINGPIN_PEERS").is_ok() {
        let o = car.output();
        println!(
            "  at {seconds:.2} s: v_y {:.4} {:.4}  ay {:.3} {:.3}  yaw rate {:.4} {:.4}  roll {:.4} {:.4}  Fz {:.0?} {:.0?}",
            o.horizontal_velocity_m_s[1],
            table.column("v_y_mps")[last],
            o.lateral_acceleration_cg_m_s2,
            lateral[last],
            o.yaw_rate_rad_s,
            yaw[last],
            o.roll_rad,
            roll[last],
            o.wheels.map(|w| w.fz_n),
            [0, 1, 2, 3].map(|i| load[i][last])
        );
    }
    let errors = Errors {
        lateral: rms[0] / peak(&lateral),
        yaw: rms[1] / peak(&yaw),
        roll: rms[2] / peak(&roll),
        load: rms[3],
        seconds,
    };
    println!(
        "{name:12} {file:28} to {:5.2} s  ay {:5.2} %  yaw rate {:5.2} %  roll {:5.2} %  loads {:5.2} %{}",
        errors.seconds,
        100.0 * errors.lateral,
        100.0 * errors.yaw,
        100.0 * errors.roll,
        100.0 * errors.load,
        if their_sign { "" } else { "  (our tyre signs)" }
    );
    Some(errors)
}

#[test]
fn commonroad_cars_below_six_tenths_of_g() {
    let cars = [
        ("ford_escort", 1.0278264878518764e-05),
        ("bmw_320i", 1.6430724599974725e-05),
        ("vw_vanagon", 1.2231329122034703e-05),
    ];
    // Bounds by kind of manoeuvre: [lateral acceleration, yaw rate, roll, loads], rms of the peak. The goal of 3 % is met
    // in quasi-steady turning and for the loads. Beyond it: steps of the Escort (nearly neutral, so that a small
    // difference of the axles' forces grows), and where their car hunts about straight ahead by up to 0.3 m/s2 because
    // its tyres step at zero camber, which no two models do in step.
    let bounds = [
        ("circle_R80", [0.025, 0.030, 0.015, 0.025]),
        ("slalom_0p3Hz_grow_80", [0.030, 0.030, 0.025, 0.025]),
        ("step_steer_80_lin", [0.060, 0.055, 0.060, 0.030]),
        ("step_steer_80_1p2deg", [0.060, 0.055, 0.050, 0.030]),
        ("swd_0p7Hz_80_1deg", [0.065, 0.030, 0.090, 0.040]),
        ("swd_0p7Hz_80_2deg", [0.040, 0.030, 0.060, 0.040]),
    ];
    let mut broken = Vec::new();
    for (name, k_lt) in cars {
        for (file, bound) in bounds {
            let Some(e) = compare(name, file, k_lt, true) else { continue };
            let found = [e.lateral, e.yaw, e.roll, e.load];
            if !found.iter().zip(bound).all(|(f, b)| *f <= b) {
                broken.push(format!("{name} {file}: {found:.4?} above {bound:?}"));
            }
        }
        compare(name, "step_steer_80_1p2deg", k_lt, false);
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
