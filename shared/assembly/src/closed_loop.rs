//! The whole bench in this thread, tick by tick, without log or shared memory: for studies of the loop.
//!
//! The models, their order and what passes between them are those of a lockstep run; nothing here does
//! physics. A study watches the regions of each tick; [`trace`] keeps the signals that studies of tracking need.

use crate::{AssemblyError, ServiceKind, build, build_can};
use config::ResolvedBench;
use regions::{
    Bench, Parameters, Payload, RegionId, RigMeasurement, RigStatus, SuspensionState, VehicleState,
};
use runtime::lockstep::Chain;
use runtime::{Bound, region_specs};
use table::{Read, RegionReader, Table, TableInfo};

/// Arm and start at these times after tick 0, as a run of the bench does. [s]
const ARM_S: f64 = 0.05;
const START_S: f64 = 0.1;
/// [`RigStatus::state`] while running.
pub const RUNNING: u64 = 4;

/// One tick as the regions have it.
#[derive(Debug, Clone, Copy)]
pub struct Tick<'a> {
    /// Tick.
    pub n: u64,
    /// What the sensors said.
    pub measurement: &'a RigMeasurement,
    /// The car.
    pub vehicle: &'a VehicleState,
    /// The suspension.
    pub suspension: &'a SuspensionState,
    /// What the rig did.
    pub status: &'a RigStatus,
}

fn refused(fault: impl std::fmt::Display) -> AssemblyError {
    AssemblyError::new("closed loop", [fault])
}

/// Runs a bench for its scenario's duration; `watch` sees each tick and ends the run with `false`.
///
/// # Errors
/// A configuration that cannot be built.
pub fn run(resolved: &ResolvedBench, mut watch: impl FnMut(&Tick) -> bool) -> Result<(), AssemblyError> {
    let timing = &resolved.scenario.timing;
    let period_s = timing.period_s();
    let info = TableInfo { run_id: 1, period_ns: timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(period_s), info).map_err(refused)?;
    let bind = |kind| Bound::new(build(kind, resolved)?, &table, true).map_err(refused);
    let mut models =
        vec![bind(ServiceKind::Rig)?, bind(ServiceKind::Vehicle)?, bind(ServiceKind::Multibody)?];
    let mut order = vec![(0, 0), (1, 0), (2, 0), (0, 1)];
    if let Some(model) = build_can(resolved, None, false)? {
        models.push(Bound::new(model, &table, true).map_err(refused)?);
        order.push((3, 0));
    }
    let mut chain = Chain::new(models, order);
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(refused)?;
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).map_err(refused)?;
    let schedule =
        params::Schedule::new(resolved).map_err(|faults| AssemblyError::new("scenario", faults))?;
    let reader = |region: RegionId| table.reader(region as usize).clone();
    let readers =
        [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus]
            .map(reader);
    let (mut measurement, mut vehicle) = (RigMeasurement::absent(), VehicleState::absent());
    let (mut suspension, mut status) = (SuspensionState::absent(), RigStatus::absent());
    let ticks = |seconds: f64| (seconds / period_s).round() as u64;
    let (arm, start) = (ticks(ARM_S), ticks(START_S));
    for n in 0..ticks(resolved.scenario.duration_s) {
        let mut asked = Bench::absent();
        asked.tick = n;
        asked.alive = [1; 4];
        asked.end_tick = u64::MAX;
        (asked.request, asked.request_count) = if n >= start {
            (2, 2)
        } else if n >= arm {
            (1, 1)
        } else {
            (0, 0)
        };
        // Sole writer, in order: cannot be refused.
        let _ = bench.write(n, asked.words());
        let (version, values) = schedule.at(n);
        let _ = parameters.write(n, Parameters { tick: n, version, value: *values }.words());
        chain.tick(n).map_err(refused)?;
        let whole = take(&readers[0], n, &mut measurement)
            && take(&readers[1], n, &mut vehicle)
            && take(&readers[2], n, &mut suspension)
            && take(&readers[3], n, &mut status);
        debug_assert!(whole, "a tick just made must be there");
        let tick = Tick {
            n,
            measurement: &measurement,
            vehicle: &vehicle,
            suspension: &suspension,
            status: &status,
        };
        if !watch(&tick) {
            break;
        }
    }
    Ok(())
}

fn take<P: Payload>(reader: &RegionReader, n: u64, out: &mut P) -> bool {
    reader.read(n, bytemuck::cast_slice_mut(std::slice::from_mut(out))) == Read::Ready
}

/// Signals of a run, one value a tick. Left is index 0, right is 1.
#[derive(Debug, Clone, Default)]
pub struct LoopTrace {
    /// Period. [s]
    pub period_s: f64,
    /// Time since tick 0. [s]
    pub time_s: Vec<f64>,
    /// The manoeuvre steers and the bench runs.
    pub active: Vec<bool>,
    /// Tie-rod force asked for. [N]
    pub force_command_n: [Vec<f64>; 2],
    /// Load cell's reading available at the tick. [N]
    pub force_reading_n: [Vec<f64>; 2],
    /// True force at the end of the tick (virtual rig). [N]
    pub force_true_n: [Vec<f64>; 2],
    /// Ball height asked for. [m]
    pub height_command_m: [Vec<f64>; 2],
    /// Vertical stroke's reading. [m]
    pub height_reading_m: [Vec<f64>; 2],
    /// Hand-wheel angle asked for; NaN where the wheel is free. [rad]
    pub angle_command_rad: Vec<f64>,
    /// Encoder's reading. [rad]
    pub angle_reading_rad: Vec<f64>,
    /// Torque cell's reading. [N·m]
    pub torque_n_m: Vec<f64>,
    /// Torque sent to the steer actuator. [N·m]
    pub torque_command_n_m: Vec<f64>,
    /// Rack potentiometer's reading. [m]
    pub rack_m: Vec<f64>,
    /// True rack displacement (virtual rig). [m]
    pub rack_true_m: Vec<f64>,
    /// Valve commands of the horizontal cylinders. [-]
    pub valve: [Vec<f64>; 2],
    /// Energy fed into the steering since the start. [J]
    pub energy_j: Vec<f64>,
    /// Estimated lag of the force loop; NaN until known. [s]
    pub loop_delay_s: Vec<f64>,
    /// Lateral acceleration of the car. [m/s²]
    pub lateral_m_s2: Vec<f64>,
    /// Trip code and tick of the first trip, if there was one.
    pub trip: Option<(u64, u64)>,
}

/// Runs a bench and keeps its signals; ends at the first trip.
///
/// # Errors
/// As [`run`].
pub fn trace(resolved: &ResolvedBench) -> Result<LoopTrace, AssemblyError> {
    let mut t = LoopTrace { period_s: resolved.scenario.timing.period_s(), ..LoopTrace::default() };
    run(resolved, |tick| {
        let (m, v, s) = (tick.measurement, tick.vehicle, tick.status);
        t.time_s.push(m.time_s);
        t.active.push(v.manoeuvre_active == 1 && s.state == RUNNING);
        for side in 0..2 {
            t.force_command_n[side].push(s.tie_rod_force_command_n[side]);
            t.force_reading_n[side].push(m.tie_rod_force_n[side]);
            t.force_true_n[side].push(s.true_tie_rod_force_n[side]);
            t.height_command_m[side].push(s.ball_height_applied_m[side]);
            t.height_reading_m[side].push(m.vertical_stroke_m[side]);
            t.valve[side].push(s.horizontal_valve_ratio[side]);
        }
        t.angle_command_rad.push(s.steering_wheel_angle_applied_rad);
        t.angle_reading_rad.push(m.steering_wheel_angle_rad);
        t.torque_n_m.push(m.steering_wheel_torque_n_m);
        t.torque_command_n_m.push(s.steer_torque_command_n_m);
        t.rack_m.push(m.rack_displacement_m);
        t.rack_true_m.push(s.true_rack_displacement_m);
        t.energy_j.push(s.port_energy_j);
        t.loop_delay_s.push(s.loop_delay_s);
        t.lateral_m_s2.push(v.acceleration_m_s2[1]);
        if s.trip_code != 0 && t.trip.is_none() {
            t.trip = Some((s.trip_code, s.trip_tick));
        }
        t.trip.is_none()
    })?;
    Ok(t)
}
