//! Cars for the tests: the shipped files, with constants in place of hardpoint files (the multibody solver that
//! makes those maps is not a dependency of this crate).
#![allow(dead_code)]

use config::car::{Car, IdealKinematics};
use std::path::{Path, PathBuf};
use tyre::Tyre;
use vehicle::{AxleKinematics, Vehicle, VehicleInput};

/// Root of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// A reference file, or `None` with a note when it is not there (an error in CI).
pub fn reference(path: &str) -> Option<String> {
    let full = root().join("../shared/reference").join(path);
    match std::fs::read_to_string(&full) {
        Ok(text) => Some(text),
        Err(e) => {
            assert!(
                std::env::var("CI").as_deref() != Ok("true"),
                "missing reference {}: {e}",
                full.display()
            );
            eprintln!("skipped: reference file {path} is missing");
            None
        }
    }
}

/// A shipped car.
pub fn car(name: &str) -> Car {
    let path = root().join("schemas/cars").join(format!("{name}.toml"));
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Constants near those of the double-wishbone front axle.
pub fn front_constants() -> IdealKinematics {
    IdealKinematics {
        toe_in_rad: 0.0,
        camber_rad: 0.0,
        toe_in_per_travel_rad_m: 0.0,
        camber_per_travel_rad_m: -0.35,
        caster_per_travel_rad_m: 0.05,
        roll_centre_height_m: 0.06,
        outward_per_travel2_1_m: None,
        forward_per_travel: 0.0,
        steer_per_rack_rad_m: -7.3,
        ackermann: 0.3,
        caster_rad: 0.0938,
        kingpin_inclination_rad: 0.1747,
        kingpin_offset_m: 0.06,
        caster_offset_m: -0.02,
    }
}

/// Constants near those of the saloon's rear axle.
pub fn rear_constants() -> IdealKinematics {
    IdealKinematics {
        toe_in_rad: 0.0017,
        camber_rad: -0.0175,
        toe_in_per_travel_rad_m: 0.05,
        camber_per_travel_rad_m: -0.45,
        caster_per_travel_rad_m: -0.10,
        roll_centre_height_m: 0.10,
        forward_per_travel: -0.05,
        steer_per_rack_rad_m: 0.0,
        ackermann: 0.0,
        caster_rad: 0.05,
        kingpin_inclination_rad: 0.05,
        kingpin_offset_m: 0.05,
        caster_offset_m: 0.0,
        ..front_constants()
    }
}

/// Without hardpoint files.
pub fn with_constants(mut car: Car) -> Car {
    if car.rear.axle_file.take().is_some() {
        car.rear.kinematics = Some(rear_constants());
    }
    if car.front.axle_file.take().is_some() {
        car.front.kinematics = Some(front_constants());
    }
    car
}

/// Text of a tyre file by the name in a car file.
pub fn tyre_text(name: &str) -> String {
    let path = root().join("schemas/tyres").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The same with other values for keys that it has.
pub fn with_keys(text: &str, keys: &[(&str, f64)]) -> String {
    let mut found = vec![false; keys.len()];
    let lines: Vec<String> = text
        .lines()
        .map(|line| {
            let key = line.split('=').next().unwrap_or("").trim();
            match keys.iter().position(|(k, _)| *k == key) {
                Some(i) => {
                    found[i] = true;
                    format!("{key} = {}", keys[i].1)
                }
                None => line.to_owned(),
            }
        })
        .collect();
    assert!(found.iter().all(|f| *f), "keys not in the tyre file: {keys:?} {found:?}");
    lines.join("\n")
}

/// A car with the tyre of a text on all wheels.
pub fn build_on(car: &Car, tyre_text: &str) -> Vehicle {
    let t = Tyre::from_tir(tyre_text, "test").unwrap_or_else(|e| panic!("{e:?}"));
    Vehicle::new(car, maps(car), [t.clone(), t.clone(), t.clone(), t], 1e-3)
        .unwrap_or_else(|e| panic!("{e:?}"))
}

/// A tyre by the name in a car file.
pub fn tyre(name: &str) -> Tyre {
    let path = root().join("schemas/tyres").join(name);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    Tyre::from_tir(&text, name).unwrap_or_else(|e| panic!("{name}: {e:?}"))
}

pub fn maps(car: &Car) -> [AxleKinematics; 2] {
    let axle = |a: &config::car::CarAxle| {
        let k = a.kinematics.as_ref().expect("constants");
        AxleKinematics::ideal(k, a, car.body.wheelbase_m, 0.1).expect("maps")
    };
    [axle(&car.front), axle(&car.rear)]
}

/// A car from its section, 1 ms steps.
pub fn build(car: &Car) -> Vehicle {
    build_with_step(car, 1e-3)
}

pub fn build_with_step(car: &Car, step_s: f64) -> Vehicle {
    let (f, r) = (tyre(&car.front.tyre_file), tyre(&car.rear.tyre_file));
    Vehicle::new(car, maps(car), [f.clone(), f, r.clone(), r], step_s).unwrap_or_else(|e| panic!("{e:?}"))
}

/// Input that holds a speed.
pub fn hold(speed: f64) -> VehicleInput {
    VehicleInput { target_speed_m_s: Some(speed), ..VehicleInput::default() }
}

/// What the tyres did to the car: the work of each, and how much went to and fro. [J]
pub struct TyreAccount {
    step_s: f64,
    work: [f64; 4],
    traffic: [f64; 4],
    worst: f64,
}

/// What may stand in a carcass when an account is opened. [J]
const CARCASS_J: f64 = 30.0;
/// Rounding of the sum over steps, of what went to and fro.
const ACCOUNT_SHARE: f64 = 0.005;

impl TyreAccount {
    pub fn new(step_s: f64) -> Self {
        Self { step_s, work: [0.0; 4], traffic: [0.0; 4], worst: f64::MIN }
    }

    /// Books a step. `Err` with the wheel and its work once a tyre has given more than it was given.
    pub fn book(&mut self, o: &vehicle::VehicleOutput) -> Result<(), String> {
        self.book_on_turning_road(o, 0.0)
    }

    /// The same while the road itself turns about the wheels' x axis: what it does by the overturning moment is the road's
    /// work, not the tyre's.
    pub fn book_on_turning_road(
        &mut self,
        o: &vehicle::VehicleOutput,
        road_roll_rate_rad_s: f64,
    ) -> Result<(), String> {
        for (i, w) in o.wheels.iter().enumerate() {
            let power = w.tyre_power_w - w.mx_n_m * road_roll_rate_rad_s;
            self.work[i] += power * self.step_s;
            self.traffic[i] += power.abs() * self.step_s;
            self.worst = self.worst.max(self.work[i]);
            let most = CARCASS_J + ACCOUNT_SHARE * self.traffic[i];
            if self.work[i] > most || self.work[i].is_nan() {
                return Err(format!(
                    "tyre {i} has made energy: gave {:.1} J, {:.0} J to and fro",
                    self.work[i], self.traffic[i]
                ));
            }
        }
        Ok(())
    }

    /// Books a step; a tyre that makes energy fails the test.
    #[track_caller]
    pub fn add(&mut self, o: &vehicle::VehicleOutput) {
        if let Err(told) = self.book(o) {
            panic!("at {:.3} s: {told}", o.time_s);
        }
    }

    /// Prints the sums. A car that was moved has taken energy through every tyre.
    pub fn close(&self, what: &str) {
        println!(
            "{what}: the tyres took {:.0?} J, never gave more than {:.2} J, {:.0?} J to and fro",
            self.work.map(|w| -w),
            self.worst,
            self.traffic
        );
    }

    pub fn taken_j(&self) -> f64 {
        -self.work.iter().sum::<f64>()
    }
}
