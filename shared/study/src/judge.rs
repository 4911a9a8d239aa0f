//! Which procedure a scenario is driven for, as its steering says, and what a run of it gives.

use config::ResolvedBench;
use config::scenario::{DriverPath, Steer};
use metrics::handling::{Assessment, CarFacts, Layout, SteadyMethod};
use record::LogReader;
use report::{Procedure, angle_per_rack, signals};

/// Judges a run by the procedure of its scenario.
///
/// # Errors
/// A scenario that belongs to no procedure, a log that does not reach it.
pub fn assess(log: &LogReader, resolved: &ResolvedBench) -> Result<Assessment, String> {
    let scenario = &resolved.scenario;
    let (procedure, from_s, to_s) = procedure_of(resolved)
        .ok_or_else(|| format!("scenario {} is not driven as a procedure asks", scenario.name))?;
    let car = &resolved.car;
    let facts = CarFacts {
        steering_ratio: steering_ratio(log, resolved).unwrap_or(f64::NAN),
        wheelbase_m: car.body.wheelbase_m,
        mass_kg: car.body.sprung_mass_kg + car.front.unsprung_mass_kg + car.rear.unsprung_mass_kg,
        width_m: vehicle_width_m(&scenario.steer),
        front_m: car.body.front_axle_to_sprung_cg_m,
        rear_m: car.body.wheelbase_m - car.body.front_axle_to_sprung_cg_m,
    };
    if matches!(procedure, Procedure::SteadyTurn(_) | Procedure::Random) && facts.steering_ratio.is_nan() {
        return Err("the steering ratio cannot be told: the hand wheel hardly moved".to_owned());
    }
    let signals = signals(log, from_s, to_s)?;
    if signals.is_empty() {
        return Err("the run ends before the manoeuvre begins".to_owned());
    }
    Ok(report::assess(&procedure, &signals, &facts))
}

/// The procedure that a scenario is driven for and the part of the log that counts. [s]
pub fn procedure_of(resolved: &ResolvedBench) -> Option<(Procedure, f64, f64)> {
    let scenario = &resolved.scenario;
    let from_s = scenario.warm_up_s;
    let whole = |procedure| Some((procedure, from_s, f64::INFINITY));
    if let Some(at_s) = scenario.hands_off_s {
        return whole(Procedure::Release(at_s));
    }
    match &scenario.steer {
        Steer::Weave(weave) => whole(Procedure::Weave(weave.frequency_hz)),
        Steer::Ramp(_) => whole(Procedure::SteadyTurn(SteadyMethod::ConstantSpeed)),
        Steer::Step(_) => whole(Procedure::Step),
        Steer::SineWithDwell(_) => whole(Procedure::SineWithDwell(None)),
        Steer::Random(random) => Some((Procedure::Random, from_s + random.start_s, from_s + random.end_s)),
        Steer::Path(following) => match following.path {
            DriverPath::Circle { radius_m, .. } => {
                whole(Procedure::SteadyTurn(SteadyMethod::ConstantRadius(radius_m.abs())))
            }
            DriverPath::DoubleLaneChangeIso3888Part1 { straight_m, vehicle_width_m } => {
                whole(Procedure::LaneChange(Layout::double_lane_change(vehicle_width_m), straight_m))
            }
            DriverPath::ObstacleAvoidanceIso3888Part2 { straight_m, vehicle_width_m } => {
                whole(Procedure::LaneChange(Layout::obstacle_avoidance(vehicle_width_m), straight_m))
            }
            _ => None,
        },
        _ => None,
    }
}

fn vehicle_width_m(steer: &Steer) -> f64 {
    match steer {
        Steer::Path(following) => match following.path {
            DriverPath::DoubleLaneChangeIso3888Part1 { vehicle_width_m, .. }
            | DriverPath::ObstacleAvoidanceIso3888Part2 { vehicle_width_m, .. } => vehicle_width_m,
            _ => f64::NAN,
        },
        _ => f64::NAN,
    }
}

/// Overall kinematic steering ratio near straight running: hand-wheel angle per rack travel as the log has it, over the
/// mean front steer angle per rack travel of the axle at its design height.
pub fn steering_ratio(log: &LogReader, resolved: &ResolvedBench) -> Option<f64> {
    const REACH_M: f64 = 2e-3;
    let curve = multibody::methods::curve(
        &resolved.front_axle,
        multibody::methods::Over::Rack,
        &[-REACH_M, 0.0, REACH_M],
    )
    .ok()?;
    // Toe-in turns the left wheel to the right and the right wheel to the left.
    let steer =
        |point: &multibody::methods::CurvePoint| 0.5 * (point.side[1].toe_rad - point.side[0].toe_rad);
    let (first, last) = (curve.points.first()?, curve.points.last()?);
    let steer_per_rack = (steer(last) - steer(first)) / (last.at_m - first.at_m);
    let ratio = angle_per_rack(log)? / steer_per_rack;
    (ratio.is_finite() && ratio > 1.0).then_some(ratio)
}
