//! The vehicle node: rack in, car out, and what the manoeuvre asks of the hand wheel.

use crate::guard::{Guard, Verdict};
use crate::{AssemblyError, axle_kinematics};
use config::ResolvedBench;
use config::scenario::Gear;
use manoeuvre::Manoeuvre;
use regions::{Payload, RegionId, RigMeasurement, VehicleCheckpoint, VehicleState, model_flags};
use runtime::{InputSpec, Inputs, Model, NodeSpec, Step, When};
use tyre::Tyre;
use vehicle::kinematics::AxleKinematics;
use vehicle::{GearMode, Vehicle, VehicleInput, VehicleOutput};

const READS: &[InputSpec] = &[InputSpec { region: RegionId::RigMeasurement, when: When::SameTick }];
const NODES: &[NodeSpec] = &[NodeSpec {
    name: "vehicle",
    reads: READS,
    writes: RegionId::VehicleState,
    checkpoint: Some(RegionId::VehicleCheckpoint),
    rings: true,
}];

/// The car with its manoeuvre.
pub struct VehicleNode {
    vehicle: Vehicle,
    manoeuvre: Manoeuvre,
    period_s: f64,
    rack_max_m: f64,
    gear: GearMode,
    guard: Guard,
    rack_m: f64,
    used_tick: u64,
    restored: bool,
    last: VehicleState,
}

impl VehicleNode {
    /// Builds the car from its files.
    ///
    /// # Errors
    /// Everything that is wrong with them.
    pub fn new(resolved: &ResolvedBench) -> Result<Self, AssemblyError> {
        let scenario = &resolved.scenario;
        let period_s = scenario.timing.period_s();
        let manoeuvre = Manoeuvre::new(scenario, resolved.record.as_ref())
            .map_err(|fault| AssemblyError::new("scenario", [fault]))?;
        let mut vehicle = build_vehicle(resolved, period_s)?;
        let first = manoeuvre.at(0.0);
        vehicle.reset(first.initial_speed_m_s);
        let mut last = VehicleState::absent();
        last.used_rig_measurement = regions::NO_TICK;
        Ok(VehicleNode {
            vehicle,
            manoeuvre,
            period_s,
            rack_max_m: resolved.front_axle.rack_full_m,
            gear: match scenario.gear {
                Gear::Drive => GearMode::Drive,
                Gear::Neutral => GearMode::Neutral,
                Gear::Reverse => GearMode::Reverse,
            },
            guard: Guard::new(scenario.limits.stale_after_ticks),
            rack_m: 0.0,
            used_tick: regions::NO_TICK,
            restored: false,
            last,
        })
    }
}

/// The car of a resolved bench, at rest at its static equilibrium.
pub(crate) fn build_vehicle(resolved: &ResolvedBench, period_s: f64) -> Result<Vehicle, AssemblyError> {
    let car = &resolved.car;
    let parse = |index: usize| {
        let file = &resolved.tyres[index.min(resolved.tyres.len() - 1)];
        Tyre::from_tir(&file.text, &file.name).map_err(|faults| AssemblyError::new("tyre", faults))
    };
    if resolved.tyres.is_empty() {
        return Err(AssemblyError::new("car", ["no tyre file is named"]));
    }
    let (front_tyre, rear_tyre) = (parse(0)?, parse(1)?);
    let front = axle_kinematics(&resolved.front_axle, resolved.front_axle.rack_full_m)
        .map_err(|faults| AssemblyError::new("front axle", faults))?;
    let rear = match (&resolved.rear_axle, &car.rear.kinematics) {
        (Some(axle), _) => axle_kinematics(axle, 0.0).map_err(|f| AssemblyError::new("rear axle", f))?,
        (None, Some(ideal)) => AxleKinematics::ideal(ideal, &car.rear, car.body.wheelbase_m, 0.0)
            .map_err(|fault| AssemblyError::new("rear axle", [fault]))?,
        (None, None) => {
            return Err(AssemblyError::new("car", ["rear: needs axle_file or kinematics"]));
        }
    };
    let tyres = [front_tyre.clone(), front_tyre, rear_tyre.clone(), rear_tyre];
    Vehicle::new(car, [front, rear], tyres, period_s)
        .map_err(|broken| AssemblyError::new("car", broken.into_iter().map(|b| format!("{}: {}", b.key, b.rule))))
}

impl Model for VehicleNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        NODES
    }

    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (measured, input) = inputs.get::<RigMeasurement>(0);
        let mut flags = 0;
        let rack = measured.rack_displacement_m;
        let plausible = rack.is_finite() && rack.abs() <= 1.5 * self.rack_max_m;
        let verdict = self.guard.judge(step, input, plausible, &mut flags);
        if verdict == Verdict::Good {
            (self.rack_m, self.used_tick) = (rack, input.tick());
        }
        if std::mem::take(&mut self.restored) {
            flags |= model_flags::RESTORED;
        }
        let next_s = (step.n + 1) as f64 * self.period_s;
        let held = self.vehicle.output().held_steps;
        if verdict != Verdict::Stale {
            let driver = self.manoeuvre.at(step.n as f64 * self.period_s);
            self.vehicle.step(&VehicleInput {
                rack_displacement_m: Some(self.rack_m),
                steering_wheel_angle_rad: driver.steering_wheel_angle_rad,
                throttle: driver.throttle,
                brake_pressure_pa: driver.brake_pressure_pa,
                hand_brake: 0.0,
                gear_mode: self.gear,
                target_speed_m_s: driver.target_speed_m_s,
                road: driver.road,
                wind_m_s: driver.wind_m_s,
                time_s: step.n as f64 * self.period_s,
            });
            fill(&mut self.last, self.vehicle.output());
            self.last.rack_displacement_m = [self.rack_m; 2];
        }
        if self.vehicle.output().held_steps > held {
            flags |= model_flags::MODEL_FAULT;
        }
        let next = self.manoeuvre.at(next_s);
        let state = &mut self.last;
        state.tick = step.n;
        state.time_s = next_s;
        state.flags = flags;
        state.used_rig_measurement = self.used_tick;
        state.held_count = self.guard.held_count();
        state.manoeuvre_active = u64::from(next.active);
        state.steering_wheel_angle_command_rad = next.steering_wheel_angle_rad;
        state.steering_wheel_rate_command_rad_s = next.steering_wheel_rate_rad_s;
        state.target_speed_m_s = next.target_speed_m_s.unwrap_or(f64::NAN);
        output.copy_from_slice(state.words());
    }

    fn save(&self, n: u64, words: &mut [u64]) {
        let checkpoint: &mut [VehicleCheckpoint] = bytemuck::cast_slice_mut(words);
        let checkpoint = &mut checkpoint[0];
        let len = self.vehicle.state_len();
        checkpoint.tick = n;
        checkpoint.len = len as u64;
        checkpoint.counters = [self.guard.held_count(), self.used_tick, 0, 0, 0, 0];
        self.vehicle.save_state(&mut checkpoint.state[..len]);
        checkpoint.state[len] = self.rack_m;
    }

    fn restore(&mut self, words: &[u64]) -> bool {
        let checkpoint: &[VehicleCheckpoint] = bytemuck::cast_slice(words);
        let checkpoint = &checkpoint[0];
        let len = self.vehicle.state_len();
        if checkpoint.len != len as u64 || !checkpoint.state[..=len].iter().all(|v| v.is_finite()) {
            return false;
        }
        self.vehicle.load_state(&checkpoint.state[..len]);
        self.rack_m = checkpoint.state[len];
        self.guard.restore(checkpoint.counters[0]);
        self.used_tick = checkpoint.counters[1];
        self.restored = true;
        fill(&mut self.last, self.vehicle.output());
        true
    }
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
