//! One 1 ms step of the full car (saloon, sine steer at 80 km/h) with 1, 2 and 4 sub-steps, against the tyre
//! evaluations alone that a step with 1 sub-step cannot do without, in the same run, in alternating blocks.
//! Also simulated seconds per second of the vehicle alone.
//!
//! `cargo bench -p kingpin_benches --bench step`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark prints, and may fail loudly")]

use config::car::{Car, IdealKinematics};
use kingpin_benches::{
    Contender, Durations, alternate, pin_to_core, print_against_baselines, print_machine, sized, time_batches,
};
use std::hint::black_box;
use tyre::{Motion, TransientState, Tyre, UseMode};
use vehicle::{AxleKinematics, Vehicle, VehicleInput};

const CAR: &str = include_str!("../../schemas/cars/sedan.toml");
/// Its rear constants stand in for the saloon's hardpoints.
const OTHER: &str = include_str!("../../schemas/cars/bmw_m8.toml");
const TYRE: &str = include_str!("../../schemas/tyres/car_205_60r15.tir");

fn tyre() -> Tyre {
    Tyre::from_tir(TYRE, "car_205_60r15.tir").unwrap()
}

fn car(sub_steps: u32) -> Vehicle {
    let mut car: Car = toml::from_str(CAR).unwrap();
    car.numerics.sub_steps = sub_steps;
    // Maps of the same size as from hardpoints; their contents do not matter here.
    let rear = toml::from_str::<Car>(OTHER).unwrap().rear.kinematics.unwrap();
    let front = IdealKinematics { steer_per_rack_rad_m: -7.3, ..rear.clone() };
    let maps = [
        AxleKinematics::ideal(&front, &car.front, car.body.wheelbase_m, 0.07).unwrap(),
        AxleKinematics::ideal(&rear, &car.rear, car.body.wheelbase_m, 0.0).unwrap(),
    ];
    let mut vehicle = Vehicle::new(&car, maps, [tyre(), tyre(), tyre(), tyre()], 1e-3).unwrap();
    vehicle.reset(22.22, &VehicleInput { target_speed_m_s: Some(22.22), ..VehicleInput::default() });
    vehicle
}

struct Drive {
    vehicle: Vehicle,
    tick: usize,
}

impl Drive {
    fn step(&mut self) {
        let t = self.tick as f64 * 1e-3;
        self.vehicle.step(&VehicleInput {
            rack_displacement_m: Some(0.006 * (std::f64::consts::TAU * 0.3 * t).sin()),
            target_speed_m_s: Some(22.22),
            time_s: t,
            ..VehicleInput::default()
        });
        black_box(self.vehicle.output());
        self.tick += 1;
    }
}

fn main() {
    pin_to_core(1);
    print_machine();
    let blocks = sized(40, 2);
    let batches = sized(2000, 20);
    let [mut one, mut two, mut four] = [1, 2, 4].map(|n| Drive { vehicle: car(n), tick: 0 });
    let tyre = tyre();
    let mut states = [TransientState::default(); 4];
    let mut tick = 0usize;
    let tyres_only = move |out: &mut Durations| {
        time_batches(out, batches, 1, |_| {
            let alpha = 0.03 * (std::f64::consts::TAU * 0.3e-3 * tick as f64).sin();
            for (i, state) in states.iter_mut().enumerate() {
                let motion = Motion {
                    vertical_load_n: 3500.0 + 200.0 * i as f64,
                    speed_m_s: 22.22,
                    slip_speed_x_m_s: -0.05,
                    slip_speed_y_m_s: 22.22 * alpha,
                    spin_rate_rad_s: 0.0,
                    camber_rad: 0.01,
                    pressure_pa: 220_000.0,
                    friction_scale: [1.0; 2],
                };
                black_box(tyre.transient_step(state, &motion, UseMode::AlphaStar, 1e-3));
            }
            tick += 1;
        });
    };
    let mut contenders: [Contender<'_>; 4] = [
        ("four tyre evaluations", Box::new(tyres_only)),
        ("step, 1 sub-step (default)", Box::new(move |out| time_batches(out, batches, 1, |_| one.step()))),
        ("step, 2 sub-steps", Box::new(move |out| time_batches(out, batches, 1, |_| two.step()))),
        ("step, 4 sub-steps", Box::new(move |out| time_batches(out, batches, 1, |_| four.step()))),
    ];
    let rows = alternate(blocks, &mut contenders);
    let table: Vec<(&Durations, usize)> = rows.iter().map(|r| (r, 0)).collect();
    print_against_baselines("One 1 ms step of the car (budget: p50 <= 5 us)", &table);
    println!(
        "\n  simulated seconds per second, vehicle alone, from the median: {:.0}",
        1e6 / rows[1].quantile_ns(0.5)
    );
}
