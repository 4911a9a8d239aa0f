//! The vehicle node: rack in, car out, and what the manoeuvre asks of the hand wheel.

use crate::driveline::ComposedDriveline;
use crate::fmu_node::FmuAction;
use crate::guard::{Guard, Verdict};
use crate::live::{Live, manoeuvre_time_s};
use crate::{AssemblyError, car};
use config::ResolvedBench;
use config::scenario::{Gear, Steer};
use manoeuvre::path::{Observed, PathDriver};
use manoeuvre::{HandWheel, Manoeuvre};
use params::{Id, value};
use regions::{
    Bench, Fmu, NO_TICK, Parameters, Payload, RegionId, RigMeasurement, VehicleCheckpoint, VehicleState,
    model_flags,
};
use road::{Place, Road};
use runtime::{InputSpec, Inputs, Model, NodeSpec, Step, When};
use std::path::Path;
use vehicle::{
    AxleKinematics, ExportId, Exports, GearMode, RoadContact, Vehicle, VehicleInput, VehicleOutput, WHEELS,
};

const READS: &[InputSpec] = &[
    InputSpec { region: RegionId::RigMeasurement, when: When::SameTick },
    InputSpec { region: RegionId::Bench, when: When::Latest },
    InputSpec { region: RegionId::Parameters, when: When::Latest },
    InputSpec { region: regions::FMUS[0], when: When::Previous },
    InputSpec { region: regions::FMUS[1], when: When::Previous },
    InputSpec { region: regions::FMUS[2], when: When::Previous },
    InputSpec { region: regions::FMUS[3], when: When::Previous },
];
/// Behind those, what the FMUs put out the tick before, as many as there are.
const FIRST_FMU: usize = 3;
const fn nodes(fmus: usize) -> [NodeSpec; 1] {
    let (reads, _) = READS.split_at(FIRST_FMU + fmus);
    [NodeSpec {
        name: "vehicle",
        reads,
        writes: RegionId::VehicleState,
        checkpoint: Some(RegionId::VehicleCheckpoint),
        rings: true,
    }]
}
const NODES: [[NodeSpec; 1]; 5] = [nodes(0), nodes(1), nodes(2), nodes(3), nodes(4)];

/// Words of the checkpoint behind the car's own: rack, driver.
const OWN: usize = 1 + DRIVER;
const DRIVER: usize = 4;

/// The car with its manoeuvre.
pub struct VehicleNode {
    vehicle: Vehicle,
    driveline: Option<ComposedDriveline>,
    manoeuvre: Manoeuvre,
    driver: Option<PathDriver>,
    fmus: Vec<FmuAction>,
    exports: Vec<ExportId>,
    road: Road,
    off_surface: bool,
    period_s: f64,
    rack_max_m: f64,
    gear: GearMode,
    guard: Guard,
    rack_m: f64,
    used_tick: u64,
    restored: bool,
    live: Live,
    tuning: Tuning,
    last: VehicleState,
}

/// The vehicle's share of the live parameters.
#[derive(Debug, Clone, Copy)]
struct Tuning {
    friction_scale: [f64; WHEELS],
    speed_offset_m_s: f64,
}

impl VehicleNode {
    /// Builds the car from its files and settles it at its first speed.
    ///
    /// # Errors
    /// Everything that is wrong with them.
    pub fn new(resolved: &ResolvedBench, kept: Option<&Path>) -> Result<Self, AssemblyError> {
        let scenario = &resolved.scenario;
        let period_s = scenario.timing.period_s();
        let manoeuvre = Manoeuvre::new(scenario, resolved.record.as_ref())
            .map_err(|fault| AssemblyError::new("scenario", [fault]))?;
        // Settling takes thousands of steps: a restarted service finds the state there.
        let settled = kept.map(|kept| kept.join(settled_name(resolved)));
        let found = settled.as_ref().and_then(|file| read_state(file));
        let mut vehicle = build_vehicle(resolved, period_s, kept, found.is_none())?;
        let fits = |state: &Vec<f64>| state.len() == vehicle.state_len();
        let (there, found) = (found.is_some(), found.filter(fits));
        match &found {
            Some(state) => vehicle.load_state(state),
            // Another car's file by the same name: as if there were none.
            None if there => vehicle.reset(0.0, &VehicleInput::default()),
            None => {}
        }
        let driver = match &scenario.steer {
            Steer::Path(following) => Some(PathDriver::new(following)),
            _ => None,
        };
        let driveline = ComposedDriveline::new(resolved)?;
        let further = OWN + driveline.as_ref().map_or(0, ComposedDriveline::state_len);
        if vehicle.state_len() + further > VehicleCheckpoint::absent().state.len() {
            return Err(AssemblyError::new("car", ["its state does not fit the checkpoint region"]));
        }
        let mut last = VehicleState::absent();
        last.used_rig_measurement = NO_TICK;
        let mut node = VehicleNode {
            vehicle,
            driveline,
            manoeuvre,
            driver,
            fmus: crate::fmu_node::actions(resolved)?,
            exports: crate::fmu_node::exports(resolved)?,
            road: Road::new(&scenario.road, resolved.surface.as_ref())
                .map_err(|fault| AssemblyError::new("road", [fault]))?,
            off_surface: false,
            period_s,
            rack_max_m: resolved.front_axle.rack_stroke_m,
            gear: match scenario.gear {
                Gear::Drive => GearMode::Drive,
                Gear::Neutral => GearMode::Neutral,
                Gear::Reverse => GearMode::Reverse,
            },
            guard: Guard::new(resolved.rig.limits.stale_ticks),
            rack_m: 0.0,
            used_tick: NO_TICK,
            restored: false,
            live: Live::default(),
            tuning: Tuning { friction_scale: [1.0; WHEELS], speed_offset_m_s: 0.0 },
            last,
        };
        if found.is_none() {
            let input = node.input(0.0);
            node.vehicle.reset(node.manoeuvre.initial_speed_m_s(), &input);
            if let Some(file) = settled {
                let mut state = vec![0.0; node.vehicle.state_len()];
                node.vehicle.save_state(&mut state);
                write_state(&file, &state);
            }
        }
        if let Some(driveline) = &mut node.driveline {
            let (spin, demand) = (spins(&node.vehicle), node.vehicle.drive_demand());
            let drive = driveline.settle(&spin, &demand, period_s);
            node.vehicle.set_outside_drive(Some(drive));
        }
        fill(&mut node.last, node.vehicle.output());
        node.last.used_fmu = [NO_TICK; 4];
        Ok(node)
    }

    fn checkpoint_len(&self) -> usize {
        self.vehicle.state_len() + OWN + self.driveline.as_ref().map_or(0, ComposedDriveline::state_len)
    }

    /// The car's input for a step at `time_s`.
    fn input(&mut self, time_s: f64) -> VehicleInput {
        let command = self.manoeuvre.at(time_s);
        let car = self.vehicle.output();
        let places: [Place; WHEELS] = std::array::from_fn(|i| {
            let wheel = &car.wheels[i];
            let [x_m, y_m, _] = wheel.centre_position_m;
            Place { x_m, y_m, heading_rad: car.yaw_rad + wheel.steer_rad }
        });
        let mut contacts = self.road.contacts(&places);
        self.off_surface = contacts.iter().any(|contact| contact.outside);
        for (contact, scale) in contacts.iter_mut().zip(self.tuning.friction_scale) {
            contact.friction *= scale;
        }
        VehicleInput {
            rack_displacement_m: Some(self.rack_m),
            steering_wheel_angle_rad: command.steering_wheel_angle_rad,
            throttle: command.pedals.map_or(0.0, |p| p.throttle),
            brake_pressure_pa: command.pedals.map_or(0.0, |p| p.brake_pressure_pa),
            hand_brake: 0.0,
            gear_mode: self.gear,
            target_speed_m_s: command
                .pedals
                .is_none()
                .then_some(command.target_speed_m_s + self.tuning.speed_offset_m_s),
            road: contacts.map(|c| RoadContact {
                height_m: c.height_m,
                slope_x: c.slope_x,
                slope_y: c.slope_y,
                friction: c.friction,
            }),
            wind_m_s: self.manoeuvre.wind_m_s(time_s),
            time_s,
        }
    }
}

/// Name of the file for the settled state of a car: of everything that it depends on.
fn settled_name(resolved: &ResolvedBench) -> String {
    format!("{}settled-{}.f64", crate::kinematics::CACHE_PREFIX, resolved.hash())
}

fn read_state(file: &Path) -> Option<Vec<f64>> {
    let bytes = std::fs::read(file).ok()?;
    let (words, rest) = bytes.as_chunks::<8>();
    let state: Vec<f64> = words.iter().map(|word| f64::from_le_bytes(*word)).collect();
    (rest.is_empty() && state.iter().all(|value| value.is_finite())).then_some(state)
}

fn write_state(file: &Path, state: &[f64]) {
    let bytes: Vec<u8> = state.iter().flat_map(|value| value.to_le_bytes()).collect();
    // Whole or not at all; a file that cannot be written costs the next start its time.
    let draft = file.with_extension(std::process::id().to_string());
    let _ = std::fs::write(&draft, bytes).and_then(|()| std::fs::rename(&draft, file));
}

/// The car of a resolved bench, at rest at its static equilibrium.
pub(crate) fn build_vehicle(
    resolved: &ResolvedBench,
    period_s: f64,
    kept: Option<&Path>,
    settled: bool,
) -> Result<Vehicle, AssemblyError> {
    let front_axle = Some(&resolved.front_axle);
    let maps = car::maps(&resolved.car, front_axle, resolved.rear_axle.as_ref(), kept)?;
    sense(&maps[0], resolved)?;
    let axles = [front_axle, resolved.rear_axle.as_ref()];
    let mut vehicle = car::assemble(&resolved.car, axles, maps, &resolved.tyres, period_s, settled)?;
    if let Some(section) = &resolved.scenario.equations {
        vehicle.set_equations(section).map_err(|broken| {
            let told = |b: config::Broken| resolved.violation(&format!("equations.{}", b.key), &b.rule);
            AssemblyError::new("scenario", broken.into_iter().map(told))
        })?;
    }
    Ok(vehicle)
}

/// A left turn of the hand wheel must steer left: the unit's pinion has to suit the axle's tie rods.
fn sense(front: &AxleKinematics, resolved: &ResolvedBench) -> Result<(), AssemblyError> {
    let step_m = 0.1 * resolved.front_axle.rack_stroke_m;
    let steer = |rack_m: f64| front.sides[0].steer_rad(0.0, rack_m);
    let gain = (steer(step_m) - steer(-step_m)) / (2.0 * step_m);
    let ratio = resolved.unit.rack_travel_m_per_rev;
    if gain * ratio > 0.0 {
        return Ok(());
    }
    let where_ = if gain < 0.0 { "behind" } else { "ahead of" };
    Err(AssemblyError::new(
        "unit",
        [format!(
            "rack_travel_m_per_rev = {ratio}: must be {} for this car, whose tie rods lie {where_} the axle; \
             a left turn of the hand wheel would steer right",
            if gain < 0.0 { "negative" } else { "positive" },
        )],
    ))
}

impl Model for VehicleNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        &NODES[self.fmus.len()]
    }

    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (measured, input) = inputs.get::<RigMeasurement>(0);
        let (bench, bench_input) = inputs.get::<Bench>(1);
        let (parameters, parameters_input) = inputs.get::<Parameters>(2);
        if let Some(values) = self.live.news(parameters, parameters_input) {
            let (front, rear) = (value(values, Id::FrontFriction), value(values, Id::RearFriction));
            self.tuning = Tuning {
                friction_scale: [front, front, rear, rear],
                speed_offset_m_s: value(values, Id::SpeedOffset),
            };
        }
        let mut flags = 0;
        let rack = measured.rack_displacement_m;
        let plausible = rack.is_finite() && rack.abs() <= 1.5 * self.rack_max_m;
        let verdict = self.guard.judge(step, input, plausible, self.used_tick, &mut flags);
        if verdict == Verdict::Good {
            (self.rack_m, self.used_tick) = (rack, input.tick());
        }
        let mut lost = false;
        for (k, fmu) in self.fmus.iter_mut().enumerate() {
            let (state, input) = inputs.get::<Fmu>(FIRST_FMU + k);
            lost |= fmu.take(step, state, input, self.vehicle.imports_mut(), &mut flags);
            self.last.used_fmu[k] = fmu.used_tick();
            self.last.fmu_held_count[k] = fmu.held_count();
        }
        let verdict = if lost { Verdict::Stale } else { verdict };
        if std::mem::take(&mut self.restored) {
            flags |= model_flags::RESTORED;
        }
        let manoeuvre_s = |n: u64| manoeuvre_time_s(bench, bench_input, n, self.period_s);
        let (now_s, next_s) = (manoeuvre_s(step.n), manoeuvre_s(step.n + 1));
        let next = self.manoeuvre.at(next_s);
        let (mut angle, mut rate) = (next.steering_wheel_angle_rad, next.steering_wheel_rate_rad_s);
        if verdict != Verdict::Stale {
            let held = self.vehicle.output().held_steps;
            let faults = self.vehicle.equations().map_or(0, |equations| equations.faults());
            let input = self.input(now_s);
            self.vehicle.step(&input);
            if let Some(driveline) = &mut self.driveline {
                let demand = self.vehicle.drive_demand();
                let drive = driveline.step(&spins(&self.vehicle), &demand, self.period_s);
                self.vehicle.set_outside_drive(Some(drive));
            }
            if self.off_surface {
                flags |= model_flags::OFF_SURFACE;
            }
            let car = self.vehicle.output();
            if car.held_steps > held {
                flags |= model_flags::MODEL_FAULT;
            }
            fill(&mut self.last, car);
            if let Some(equations) = self.vehicle.equations() {
                if equations.faults() > faults {
                    flags |= model_flags::EQUATION_FAULT;
                }
                for (slot, value) in self.last.user_output.iter_mut().zip(equations.values()) {
                    *slot = *value;
                }
            }
            for (slot, id) in self.last.export.iter_mut().zip(&self.exports) {
                *slot = Exports::get(*id, car);
            }
            self.last.rack_displacement_m = [self.rack_m; 2];
            if let (Some(driver), HandWheel::PathDriver) = (&mut self.driver, next.hand_wheel) {
                let seen = Observed {
                    x_m: car.position_m[0],
                    y_m: car.position_m[1],
                    yaw_rad: car.yaw_rad,
                    speed_m_s: car.horizontal_velocity_m_s[0],
                };
                let steering = driver.step(&seen, self.period_s);
                (angle, rate) = (steering.wheel.value, steering.wheel.rate);
            }
        }
        let state = &mut self.last;
        state.tick = step.n;
        state.time_s = (step.n + 1) as f64 * self.period_s;
        state.flags = flags;
        state.parameters_version = self.live.version();
        state.used_rig_measurement = self.used_tick;
        state.held_count = self.guard.held_count();
        state.manoeuvre_active = u64::from(next.active);
        state.hand_wheel_mode = u64::from(next.hand_wheel != HandWheel::Free);
        state.steering_wheel_angle_command_rad = angle;
        state.steering_wheel_rate_command_rad_s = rate;
        state.target_speed_m_s = next.target_speed_m_s + self.tuning.speed_offset_m_s;
        output.copy_from_slice(state.words());
    }

    fn save(&self, n: u64, words: &mut [u64]) {
        let checkpoint: &mut [VehicleCheckpoint] = bytemuck::cast_slice_mut(words);
        let checkpoint = &mut checkpoint[0];
        let len = self.vehicle.state_len();
        checkpoint.tick = n;
        checkpoint.len = self.checkpoint_len() as u64;
        checkpoint.counters = [self.guard.held_count(), self.used_tick, 0, 0, 0, 0];
        self.vehicle.save_state(&mut checkpoint.state[..len]);
        checkpoint.state[len] = self.rack_m;
        match &self.driver {
            Some(driver) => driver.save_state(&mut checkpoint.state[len + 1..len + OWN]),
            None => checkpoint.state[len + 1..len + OWN].fill(0.0),
        }
        if let Some(driveline) = &self.driveline {
            driveline.save_state(&mut checkpoint.state[len + OWN..len + OWN + driveline.state_len()]);
        }
    }

    fn unpublished(&mut self) {
        self.restored |= self.last.flags & model_flags::RESTORED != 0;
    }

    fn restore(&mut self, words: &[u64]) -> bool {
        let checkpoint: &[VehicleCheckpoint] = bytemuck::cast_slice(words);
        let checkpoint = &checkpoint[0];
        let len = self.vehicle.state_len();
        let all = self.checkpoint_len();
        if checkpoint.len != all as u64 || !checkpoint.state[..all].iter().all(|v| v.is_finite()) {
            return false;
        }
        self.vehicle.load_state(&checkpoint.state[..len]);
        self.rack_m = checkpoint.state[len];
        if let Some(driver) = &mut self.driver {
            driver.load_state(&checkpoint.state[len + 1..len + OWN]);
        }
        if let Some(driveline) = &mut self.driveline {
            let drive = driveline.load_state(&checkpoint.state[len + OWN..all]);
            self.vehicle.set_outside_drive(Some(drive));
        }
        self.guard.restore(checkpoint.counters[0]);
        self.used_tick = checkpoint.counters[1];
        self.restored = true;
        // What a stale first step holds.
        fill(&mut self.last, self.vehicle.output());
        self.last.rack_displacement_m = [self.rack_m; 2];
        true
    }
}

fn spins(vehicle: &Vehicle) -> [f64; WHEELS] {
    vehicle.output().wheels.map(|wheel| wheel.spin_rad_s)
}

fn fill(state: &mut VehicleState, o: &VehicleOutput) {
    state.throttle_ratio = o.throttle;
    state.brake_pressure_pa = o.master_pressure_pa;
    state.gear = f64::from(o.gear);
    state.engine_speed_rad_s = o.engine_speed_rad_s;
    state.position_m = o.position_m;
    (state.roll_rad, state.pitch_rad, state.yaw_rad) = (o.roll_rad, o.pitch_rad, o.yaw_rad);
    state.velocity_m_s = o.velocity_m_s;
    state.angular_velocity_rad_s = o.angular_velocity_rad_s;
    state.acceleration_m_s2 =
        [o.longitudinal_acceleration_m_s2, o.lateral_acceleration_m_s2, o.vertical_acceleration_m_s2];
    state.side_slip_rad = o.side_slip_angle_rad;
    state.kingpin_moment_n_m = o.kingpin_moment_n_m;
    for (i, w) in o.wheels.iter().enumerate() {
        // Toe-in: left wheels to the right, right wheels to the left.
        let inward = if i % 2 == 0 { -1.0 } else { 1.0 };
        state.tyre_force_n[3 * i..3 * i + 3].copy_from_slice(&[w.fx_n, w.fy_n, w.fz_n]);
        state.tyre_moment_n_m[3 * i..3 * i + 3].copy_from_slice(&[w.mx_n_m, w.my_n_m, w.mz_n_m]);
        state.slip_ratio[i] = w.slip_ratio;
        state.slip_angle_rad[i] = w.slip_angle_rad;
        state.steer_rad[i] = w.steer_rad;
        state.toe_rad[i] = inward * w.kinematic_steer_rad;
        state.camber_rad[i] = w.kinematic_camber_rad;
        state.wheel_speed_rad_s[i] = w.spin_rad_s;
        state.brake_torque_n_m[i] = w.brake_torque_n_m;
        state.wheel_centre_force_n[3 * i..3 * i + 3].copy_from_slice(&w.centre_force_n);
        state.wheel_centre_moment_n_m[3 * i..3 * i + 3].copy_from_slice(&w.centre_moment_n_m);
        state.wheel_centre_height_m[i] = w.centre_position_m[2];
        state.wheel_travel_m[i] = w.travel_m;
        state.wheel_travel_speed_m_s[i] = w.travel_rate_m_s;
        state.wheel_vertical_acceleration_m_s2[i] = w.vertical_acceleration_m_s2;
    }
}
