//! Closed forms: static loads, load transfer, understeer and roll gradient, coast-down, energy.

use crate::support::*;
use config::car::{Car, Coupling, DesignLoad, Powertrain, SteeringSystem};
use tyre::{Contact, Tyre, UseMode};
use vehicle::{GRAVITY_M_S2 as G, GearMode, VehicleInput};

/// The saloon reduced to what closed forms know: no camber, toe and steer by travel, no compliance, no air, torque
/// straight at the wheels, rigid steering.
pub fn plain_car() -> Car {
    let mut c = with_constants(car("sedan"));
    for axle in [&mut c.front, &mut c.rear] {
        let k = axle.kinematics.as_mut().unwrap();
        k.toe_in_rad = 0.0;
        k.camber_rad = 0.0;
        k.toe_in_per_travel_rad_m = 0.0;
        k.camber_per_travel_rad_m = 0.0;
        k.caster_per_travel_rad_m = 0.0;
        k.forward_per_travel = 0.0;
        k.ackermann = 0.0;
        (k.caster_rad, k.kingpin_inclination_rad, k.kingpin_offset_m, k.caster_offset_m) =
            (0.0, 0.0, 0.0, 0.0);
        let e = &mut axle.compliance;
        (e.steer_per_fx_rad_n, e.steer_per_fy_rad_n, e.steer_per_mz_rad_n_m) = (0.0, 0.0, 0.0);
        (e.inclination_per_fx_rad_n, e.inclination_per_fy_rad_n) = (0.0, 0.0);
        (e.x_per_fx_m_n, e.y_per_fy_m_n) = (0.0, 0.0);
        // Linear dampers, spring straight already.
        let d = &mut axle.damper;
        d.speed_m_s = vec![-2.0, 2.0];
        d.force_n = vec![-10000.0, 10000.0];
    }
    c.front.kinematics.as_mut().unwrap().steer_per_rack_rad_m = 7.0;
    c.rear.kinematics.as_mut().unwrap().steer_per_rack_rad_m = 0.0;
    c.aerodynamics.drag = 0.0;
    c.aerodynamics.side_per_rad = 0.0;
    (c.aerodynamics.front_lift, c.aerodynamics.rear_lift, c.aerodynamics.yaw_per_rad) = (0.0, 0.0, 0.0);
    c.body.xz_product_kg_m2 = 0.0;
    c.powertrain = Powertrain::WheelTorque {
        max_torque_n_m: 4000.0,
        max_power_w: 1e5,
        drag_torque_n_m: 0.0,
        front_share: 0.5,
    };
    c.steering = SteeringSystem::Kinematic { rack_per_steering_wheel_m_rad: 1.0 / 7.0, rack_travel_m: 0.07 };
    c
}

/// Design heights for tyres of a vertical stiffness, so that the car stands as high as its section says.
pub fn stand_on(c: &mut Car, vertical_n_m: f64) {
    let loads = axle_loads(c);
    c.front.wheel_centre_height_m = 0.313 - loads[0] / vertical_n_m;
    c.rear.wheel_centre_height_m = 0.313 - loads[1] / vertical_n_m;
}

/// The tyre without what makes a straight-running wheel push sideways or resist, so that left equals right.
pub fn plain_tyre(vertical_n_m: f64) -> String {
    with_keys(
        &tyre_text("car_205_60r15.tir"),
        &[
            ("PHY1", 0.0),
            ("PHY2", 0.0),
            ("PVY1", 0.0),
            ("PVY2", 0.0),
            ("QSY1", 0.0),
            ("QSX3", 0.0),
            ("QDZ6", 0.0),
            ("QDZ7", 0.0),
            ("QHZ1", 0.0),
            ("QHZ2", 0.0),
            ("RVY1", 0.0),
            ("RVY2", 0.0),
            // No camber thrust and no slip of zero longitudinal force: the transient tyre's secant rate is the slip
            // demand over the steady force, and what shifts the one against the other shortens the relaxation.
            ("PHX1", 0.0),
            ("PHX2", 0.0),
            ("PKY6", 0.0),
            ("PKY7", 0.0),
            ("PVY3", 0.0),
            ("PVY4", 0.0),
            ("VERTICAL_STIFFNESS", vertical_n_m),
        ],
    )
}

/// Linear tyre at a load: cornering stiffness, camber stiffness [N/rad], trails of both [N·m/rad], relaxation [m].
pub struct LinearTyre {
    pub c: f64,
    pub gamma: f64,
    pub mz: f64,
    pub mz_gamma: f64,
    pub sigma: f64,
}

pub fn linear_tyre(text: &str, load: f64, speed: f64) -> LinearTyre {
    let t = Tyre::from_tir(text, "test").unwrap();
    let at = |alpha: f64, gamma: f64| {
        let c = Contact {
            vertical_load_n: load,
            slip_ratio: 0.0,
            slip_angle_rad: alpha,
            camber_rad: gamma,
            turn_slip_per_m: 0.0,
            speed_m_s: speed,
            pressure_pa: 220000.0,
            friction_scale: [1.0; 2],
        };
        let f = t.steady_state(&c, UseMode::AlphaStar);
        (f, t.shape(&c, &f))
    };
    let d = 1e-3;
    let slope = |f: &dyn Fn(f64) -> f64| (f(d) - f(-d)) / (2.0 * d);
    LinearTyre {
        c: -slope(&|a| at(a, 0.0).0.fy_n),
        gamma: slope(&|g| at(0.0, g).0.fy_n),
        mz: -slope(&|a| at(a, 0.0).0.mz_n_m),
        mz_gamma: slope(&|g| at(0.0, g).0.mz_n_m),
        sigma: at(0.0, 0.0).1.relaxation_length_m[1],
    }
}

pub fn axle_loads(c: &Car) -> [f64; 2] {
    let (a, l) = (c.body.front_axle_to_sprung_cg_m, c.body.wheelbase_m);
    [
        0.5 * c.body.sprung_mass_kg * G * (l - a) / l + c.front.unsprung_mass_kg * G,
        0.5 * c.body.sprung_mass_kg * G * a / l + c.rear.unsprung_mass_kg * G,
    ]
}

pub fn mass(c: &Car) -> f64 {
    c.body.sprung_mass_kg + 2.0 * (c.front.unsprung_mass_kg + c.rear.unsprung_mass_kg)
}

#[test]
fn stands_with_the_loads_of_the_lever_law() {
    for name in ["sedan", "ford_escort", "bmw_320i", "vw_vanagon"] {
        let c = with_constants(car(name));
        let mut v = build(&c);
        v.reset(
            0.0,
            &VehicleInput { brake_pressure_pa: 1e6, gear_mode: GearMode::Neutral, ..VehicleInput::default() },
        );
        let o = v.output();
        let expect = axle_loads(&c);
        for i in 0..4 {
            let error = o.wheels[i].fz_n / expect[i / 2] - 1.0;
            assert!(
                error.abs() < 2e-3,
                "{name} wheel {i}: {} N, lever law {} N",
                o.wheels[i].fz_n,
                expect[i / 2]
            );
            assert!(
                o.wheels[i].travel_m.abs() < 5e-4,
                "{name}: not in its design pose, {}",
                o.wheels[i].travel_m
            );
        }
    }
}

/// Runs to a steady circle; gives the car.
fn circle(c: &Car, text: &str, speed: f64, steer: f64) -> vehicle::Vehicle {
    let mut v = build_on(c, text);
    let mut input = hold(speed);
    v.reset(speed, &input);
    for k in 0..12000 {
        input.time_s = 1e-3 * f64::from(k);
        input.steering_wheel_angle_rad = steer * (f64::from(k) / 2000.0).min(1.0);
        v.step(&input);
    }
    v
}

#[test]
fn load_transfer_balances_the_overturning_moment() {
    let c = with_constants(car("sedan"));
    let text = plain_tyre(200000.0);
    let v = circle(&c, &text, 20.0, -0.9);
    let o = v.output();
    assert!(o.lateral_acceleration_m_s2.abs() > 3.0, "{}", o.lateral_acceleration_m_s2);
    // About a point on the road below the output's centre of gravity, horizontal axes.
    let (sy, cy) = o.yaw_rad.sin_cos();
    let left = |p: [f64; 3]| -sy * (p[0] - o.position_m[0]) + cy * (p[1] - o.position_m[1]);
    let unsprung = [40.0, 40.0, 38.0, 38.0];
    let ay = o.lateral_acceleration_cg_m_s2;
    // The sprung centre of gravity lies above the whole car's and leans with the roll.
    let design = (c.body.sprung_mass_kg * 0.56 + 2.0 * (40.0 * 0.2953 + 38.0 * 0.2964)) / mass(&c);
    let above = 0.56 - design;
    let sprung = c.body.sprung_mass_kg;
    let mut inertial = sprung * ay * (o.position_m[2] + above * o.roll_rad.cos());
    let mut moment = sprung * G * above * o.roll_rad.sin();
    let mut precession = 0.0;
    for (w, m) in o.wheels.iter().zip(unsprung) {
        let y = left(w.centre_position_m);
        inertial += m * ay * w.centre_position_m[2];
        // A wheel whose top leans right touches left of its centre's foot.
        moment += w.fz_n * (y + w.loaded_radius_m * w.inclination_rad.sin()) + w.mx_n_m - m * G * y;
        // Spin momentum points left and turns with the car.
        precession += o.yaw_rate_rad_s * 1.05 * w.spin_rad_s;
    }
    let sum = moment + inertial + precession;
    println!(
        "overturning {inertial:.0} N·m, wheel loads {moment:.0} N·m, gyroscopic {precession:.0} N·m, left over {sum:.1} N·m"
    );
    assert!(sum.abs() < 0.005 * inertial.abs(), "moments do not close by {sum} N·m of {inertial}");
}

/// Roll per lateral acceleration on stiff tyres. [rad s²/m]
///
/// The body rolls about its roll axis with the contacts fixed; the wheels lean with it, so their masses (and the
/// precession of their spin momentum) roll it as well: (Σ K − g Σ m h') φ = a (Σ m h' + 4 I_s/R).
pub fn roll_gradient(c: &Car) -> f64 {
    let b = &c.body;
    let l = b.wheelbase_m;
    let share = [(l - b.front_axle_to_sprung_cg_m) / l, b.front_axle_to_sprung_cg_m / l];
    let (mut stiffness, mut moment, mut precession) = (0.0, b.sprung_mass_kg * b.sprung_cg_height_m, 0.0);
    for (axle, s) in [&c.front, &c.rear].into_iter().zip(share) {
        let t = axle.track_m;
        let slope = axle.spring.force_n[2] / axle.spring.compression_m[2];
        stiffness += 0.5 * t * t * slope * axle.spring.lever_ratio.powi(2) + axle.anti_roll_bar_n_m_rad;
        moment += -s * b.sprung_mass_kg * axle.kinematics.as_ref().unwrap().roll_centre_height_m
            + 2.0 * axle.unsprung_mass_kg * axle.wheel_centre_height_m;
        precession += 2.0 * axle.wheel_spin_inertia_kg_m2 / axle.wheel_centre_height_m;
    }
    (moment + precession) / (stiffness - G * moment)
}

/// Steer needed per lateral acceleration beyond L/R. [rad s²/m]
fn understeer_gradient(c: &Car, text: &str, speed: f64, roll: f64) -> f64 {
    let b = &c.body;
    let loads = axle_loads(c);
    let m = mass(c);
    let (x, l) = (l_cg(c), b.wheelbase_m);
    let (a, r) = (x, l - x);
    let (f, k) = (linear_tyre(text, loads[0], speed), linear_tyre(text, loads[1], speed));
    // Unknown axle slips s_f, s_r per unit lateral acceleration: force and moment balance with aligning moments.
    // 2 C s + 2 C_γ φ each; moments 2 (mz s + mz_γ φ).
    let (cf, cr) = (2.0 * f.c, 2.0 * k.c);
    let (gf, gr) = (2.0 * f.gamma * roll, 2.0 * k.gamma * roll);
    let (nf, nr) = (2.0 * f.mz, 2.0 * k.mz);
    let n0 = 2.0 * (f.mz_gamma + k.mz_gamma) * roll;
    // [cf, cr; a cf + nf, −r cr + nr] [s_f, s_r] = [m − gf − gr; −(a gf − r gr) − n0]
    let (a11, a12, b1) = (cf, cr, m - gf - gr);
    let (a21, a22, b2) = (a * cf + nf, -r * cr + nr, -(a * gf - r * gr) - n0);
    let det = a11 * a22 - a12 * a21;
    let sf = (b1 * a22 - a12 * b2) / det;
    let sr = (a11 * b2 - a21 * b1) / det;
    sf - sr
}

/// Distance of the whole car's centre of gravity behind the front axle.
pub fn l_cg(c: &Car) -> f64 {
    let b = &c.body;
    (b.sprung_mass_kg * b.front_axle_to_sprung_cg_m + 2.0 * c.rear.unsprung_mass_kg * b.wheelbase_m) / mass(c)
}

#[test]
fn understeer_and_roll_gradient_at_a_tenth_of_g() {
    let mut c = plain_car();
    let vertical = 4e6; // tyres that do not roll: the closed form has none of that
    stand_on(&mut c, vertical);
    let text = with_keys(&plain_tyre(vertical), &[("Q_FZ2", 0.0)]);
    let speed = 20.0;
    let roll = roll_gradient(&c);
    let expect = understeer_gradient(&c, &text, speed, roll);
    let l = c.body.wheelbase_m;
    let steer = 0.981 * (l / speed.powi(2) + expect);
    let v = circle(&c, &text, speed, steer);
    let o = v.output();
    let ay = o.yaw_rate_rad_s * o.horizontal_velocity_m_s[0];
    let curvature = o.yaw_rate_rad_s / o.horizontal_velocity_m_s[0].hypot(o.horizontal_velocity_m_s[1]);
    let mean_steer = 0.5 * (o.wheels[0].steer_rad + o.wheels[1].steer_rad);
    let found = (mean_steer - l * curvature) / ay;
    println!(
        "at {:.3} m/s2: understeer gradient {:.4} mrad/(m/s2), closed form {:.4}; roll gradient {:.3} deg/g, closed form {:.3}",
        ay,
        1e3 * found,
        1e3 * expect,
        (o.roll_rad / ay * G).to_degrees(),
        (roll * G).to_degrees()
    );
    assert!((ay - 0.981).abs() < 0.03, "{ay}");
    assert!((o.roll_rad / ay / roll - 1.0).abs() < 0.02, "roll gradient {} against {roll}", o.roll_rad / ay);
    // The gradient is a difference of two slips: 2 % of the whole steer angle is what it is measured by.
    assert!(
        ((found - expect) / expect).abs() < 0.02 || ((found - expect) * ay / steer).abs() < 0.004,
        "understeer gradient {found} against {expect}"
    );
    assert!((mean_steer / (l * curvature + expect * ay) - 1.0).abs() < 0.02);
}

#[test]
fn coasts_down_by_air_and_rolling_resistance() {
    let mut c = plain_car();
    c.aerodynamics.drag = 0.3;
    let text = with_keys(&plain_tyre(200000.0), &[("QSY1", 0.012)]);
    let mut v = build_on(&c, &text);
    let mut input = VehicleInput { gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    v.reset(40.0, &input);
    for k in 0..30000 {
        input.time_s = 1e-3 * f64::from(k);
        v.step(&input);
    }
    // m_eff dv/dt = −½ρ c A v² − rolling, rolling from the tyre's own My at the axle loads.
    let t = Tyre::from_tir(&text, "test").unwrap();
    let loads = axle_loads(&c);
    let rolling = |speed: f64| {
        let my = |load: f64| {
            let contact = Contact {
                vertical_load_n: load,
                slip_ratio: 0.0,
                slip_angle_rad: 0.0,
                camber_rad: 0.0,
                turn_slip_per_m: 0.0,
                speed_m_s: speed,
                pressure_pa: 220000.0,
                friction_scale: [1.0; 2],
            };
            let f = t.steady_state(&contact, UseMode::AlphaStar);
            -f.my_n_m / t.shape(&contact, &f).loaded_radius_m
        };
        2.0 * (my(loads[0]) + my(loads[1]))
    };
    let re = t.effective_rolling_radius_m(loads[0], 100.0, 220000.0);
    let m_eff = mass(&c) + 4.0 * 1.05 / (re * re);
    let mut speed = 40.0;
    for _ in 0..30000 {
        let drag = 0.5 * 1.2 * 2.15 * 0.3 * speed * speed;
        speed -= 1e-3 * (drag + rolling(speed)) / m_eff;
    }
    let found = v.output().horizontal_velocity_m_s[0];
    println!("after 30 s of coasting from 40 m/s: {found:.3} m/s, closed form {speed:.3} m/s");
    assert!((found - speed).abs() < 0.005 * (40.0 - speed), "{found} against {speed}");
}

#[test]
fn undamped_bounce_keeps_its_energy() {
    let mut c = plain_car();
    for axle in [&mut c.front, &mut c.rear] {
        axle.damper.force_n = vec![0.0, 0.0];
        axle.spring.design_load = DesignLoad::Balanced;
        // On the ground, so that the contacts do not scrub in heave and pitch.
        axle.kinematics.as_mut().unwrap().roll_centre_height_m = 0.0;
    }
    let stiffness = 200000.0;
    let text = with_keys(
        &plain_tyre(stiffness),
        &[("VERTICAL_DAMPING", 0.0), ("Q_FZ2", 0.0), ("Q_V2", 0.0), ("Q_V1", 0.0)],
    );
    let mut v = build_on(&c, &text);
    let mut input = VehicleInput { gear_mode: GearMode::Neutral, ..VehicleInput::default() };
    v.reset(0.0, &input);
    let rest = *v.output();
    // Lift the body by 20 mm at its state: position z is the third number of a saved state.
    let mut state = vec![0.0; v.state_len()];
    v.save_state(&mut state);
    state[2] += 0.02;
    v.load_state(&state);
    let b = &c.body;
    let spring = |axle: &config::car::CarAxle| {
        (axle.spring.force_n[2] / axle.spring.compression_m[2]) * axle.spring.lever_ratio.powi(2)
    };
    let k = [spring(&c.front), spring(&c.rear)];
    let loads = axle_loads(&c);
    let unsprung = [c.front.unsprung_mass_kg, c.rear.unsprung_mass_kg];
    let energy = |v: &vehicle::Vehicle, s: &[f64]| {
        let o = v.output();
        // Numbers of the state: position 0..3, velocity 3..6, angular 6..9, attitude 9..13, travel 13..17, rate
        // 17..21, spin 21..25.
        let mut e = 0.5 * b.sprung_mass_kg * (s[3] * s[3] + s[4] * s[4] + s[5] * s[5])
            + 0.5
                * (b.roll_inertia_kg_m2 * s[6].powi(2)
                    + b.pitch_inertia_kg_m2 * s[7].powi(2)
                    + b.yaw_inertia_kg_m2 * s[8].powi(2))
            + b.sprung_mass_kg * G * s[2];
        for i in 0..4 {
            let (axle, w) = (i / 2, &o.wheels[i]);
            // The body pitches about its centre, so the wheels roll to and fro below it.
            let along = s[3] + s[7] * (w.centre_position_m[2] - s[2]);
            e += 0.5 * unsprung[axle] * (w.vertical_velocity_m_s.powi(2) + along * along)
                + 0.5 * 1.05 * s[21 + i].powi(2)
                + unsprung[axle] * G * w.centre_position_m[2];
            // Springs about their design force; tyres from their free length.
            let balanced = loads[axle] - unsprung[axle] * G;
            e += 0.5 * k[axle] * s[13 + i].powi(2) + balanced * s[13 + i];
            let deflection = 0.313 - w.centre_position_m[2];
            e += 0.5 * stiffness * deflection.max(0.0).powi(2);
        }
        e
    };
    // The integrator is symplectic: energy swings about its mean with the step, but the mean does not drift.
    let mut means = [0.0; 2];
    let mut highest: f64 = 0.0;
    for n in 0..10000 {
        input.time_s = 1e-3 * f64::from(n);
        v.step(&input);
        v.save_state(&mut state);
        match n {
            0..2000 => means[0] += energy(&v, &state) / 2000.0,
            8000.. => {
                means[1] += energy(&v, &state) / 2000.0;
                highest = highest.max((v.output().position_m[2] - rest.position_m[2]).abs());
            }
            _ => {}
        }
    }
    // The energy of the motion: 20 mm of stretch in the springs at the wheels.
    let motion = 0.5 * 2.0 * (k[0] + k[1]) * 0.02 * 0.02;
    let drift = means[1] - means[0];
    println!(
        "energy of the bounce {motion:.2} J, drifts by {drift:.4} J in 8 s; still {:.1} mm high",
        1e3 * highest
    );
    // What it loses is the standing tyres' own damping: pitch rocks their contacts to and fro.
    assert!(drift < 0.001 * motion && drift > -0.03 * motion, "energy of {motion} J drifts by {drift} J");
    assert!(highest > 0.012, "the bounce died away: {highest}");
}

#[test]
fn sedan_with_its_coupling_needs_throttle_for_speed() {
    let c = with_constants(car("sedan"));
    let Powertrain::Combustion(p) = &c.powertrain else { panic!("the saloon has an engine") };
    assert!(matches!(p.coupling, Coupling::TorqueConverter { .. }));
    let mut v = build(&c);
    v.reset(27.78, &hold(27.78));
    let o = v.output();
    assert!(o.longitudinal_acceleration_m_s2.abs() < 1e-3, "{}", o.longitudinal_acceleration_m_s2);
    // Power at the wheels against air and rolling resistance at 100 km/h: 10 to 16 kW for this class.
    let power: f64 = o.wheels.iter().map(|w| w.drive_torque_n_m * w.spin_rad_s).sum();
    assert!((8e3..20e3).contains(&power), "{power} W at 100 km/h");
}
