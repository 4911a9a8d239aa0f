//! The car by itself: its files put together, for the bench and for runs without one.

use crate::compliance::with_bushings;
use crate::{AssemblyError, axle_kinematics_in};
use config::axle::Axle;
use config::car::{Car, SteeringSystem};
use config::{ResolvedCar, TextFile};
use std::path::Path;
use tyre::Tyre;
use vehicle::{AxleKinematics, Vehicle};

/// Builds a car that steps by `step_s`, at rest at its static equilibrium.
///
/// # Errors
/// [`AssemblyError`] naming the part and everything that is wrong with it.
pub fn build_car(resolved: &ResolvedCar, step_s: f64) -> Result<Vehicle, AssemblyError> {
    let axles = [resolved.front_axle.as_ref(), resolved.rear_axle.as_ref()];
    let maps = maps(&resolved.car, axles[0], axles[1], None)?;
    assemble(&resolved.car, axles, maps, &resolved.tyres, step_s, true)
}

/// Kinematics maps, front and rear: swept from hardpoints where the car names them (or found in the directory `kept`), else
/// from its constants.
pub(crate) fn maps(
    car: &Car,
    front: Option<&Axle>,
    rear: Option<&Axle>,
    kept: Option<&Path>,
) -> Result<[AxleKinematics; 2], AssemblyError> {
    let b = &car.body;
    let map = |part, hardpoints: Option<&Axle>, axle: &config::car::CarAxle, rack_max_m: f64| match (
        hardpoints,
        &axle.kinematics,
    ) {
        (Some(h), _) => {
            let rack_m = if rack_max_m > 0.0 { h.rack_stroke_m } else { 0.0 };
            axle_kinematics_in(h, rack_m, kept).map_err(|faults| AssemblyError::new(part, faults))
        }
        (None, Some(constants)) => AxleKinematics::ideal(constants, axle, b.wheelbase_m, rack_max_m)
            .map_err(|fault| AssemblyError::new(part, [fault])),
        (None, None) => Err(AssemblyError::new(part, ["needs axle_file or kinematics"])),
    };
    let rack_max_m = match &car.steering {
        SteeringSystem::Kinematic { rack_travel_m, .. } => *rack_travel_m,
        SteeringSystem::Assisted(steering) => steering.rack_travel_m,
    };
    Ok([map("front axle", front, &car.front, rack_max_m)?, map("rear axle", rear, &car.rear, 0.0)?])
}

/// Car, axles (front, rear; their bushings' compliance comes to the car's own), maps and tyres (front, rear; or one for
/// both) together; not `settled`: its state is loaded before it is stepped.
pub(crate) fn assemble(
    car: &Car,
    axles: [Option<&Axle>; 2],
    maps: [AxleKinematics; 2],
    tyres: &[TextFile],
    step_s: f64,
    settled: bool,
) -> Result<Vehicle, AssemblyError> {
    let parse = |index: usize| match tyres.get(index).or(tyres.first()) {
        Some(file) => {
            Tyre::from_text(&file.text, &file.name).map_err(|faults| AssemblyError::new("tyre", faults))
        }
        None => Err(AssemblyError::new("car", ["no tyre file is named"])),
    };
    let (front, rear) = (parse(0)?, parse(1)?);
    let car = with_bushings(car, axles).map_err(|(part, faults)| AssemblyError::new(part, faults))?;
    let make = if settled { Vehicle::new } else { Vehicle::unsettled };
    make(&car, maps, [front.clone(), front, rear.clone(), rear], step_s).map_err(|broken| {
        AssemblyError::new("car", broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule)))
    })
}
