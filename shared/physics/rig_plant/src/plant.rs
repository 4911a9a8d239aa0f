//! The virtual rig as a whole.
//!
//! Each sub-step: valve commands leave the transport delay; cylinders, tie rods and friction give forces from
//! the positions and speeds before the step; speeds advance with them, positions with the new speeds
//! (semi-implicit Euler: no numerical damping of the oil and rod resonances, stable for ω h < 2; the
//! constructor refuses machines with ω h > 1). Viscous, valve and friction parts are implicit.
//!
//! Tie rod and leaf spring are a massless series: elongation e of the straight line from inner ball to arm tip,
//! 1/k = 1/k_rod + cos²γ/k_leaf with γ between rod and the tip's tangent, F = k (e + τ ė).
//! Not modelled: mass of the ball, bending of arms, play in joints, column bearing friction, supply pressure drop.

use crate::hydraulic::Cylinder;
use crate::interface::{Actuation, Channel, Measurement, RigEnvironment};
use crate::linkage::Linkage;
use crate::random::Random;
use crate::sensors::{Encoder, ErrorRule, SensorModel};
use crate::state::{StateReader, StateWriter};
use crate::unit::{ColumnEps, SteeringUnitModel, UnitAccount, UnitInput, UnitOutput, UnitTuning};
use config::rig::{Rig, Sensor, SteerDevice};
use config::unit::SteeringUnit;
use config::{Broken, Check, Checker};

const GRAVITY: f64 = 9.806_65;
const COMMANDS: usize = 5;

/// The machine as it really is; for judging control, never for control.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Truth {
    /// Time since the start. [s]
    pub time_s: f64,
    /// The steering unit.
    pub unit: UnitOutput,
    /// Torque put into the column. [N·m]
    pub steering_wheel_torque_n_m: f64,
    /// Tie-rod forces, tension positive. [N]
    pub tie_rod_force_n: [f64; 2],
    /// Forces of the horizontal rods. [N]
    pub actuator_force_n: [f64; 2],
    /// Strokes of the horizontal cylinders. [m]
    pub horizontal_stroke_m: [f64; 2],
    /// Their speeds. [m/s]
    pub horizontal_speed_m_s: [f64; 2],
    /// Strokes of the vertical cylinders: the outer balls' heights over rest. [m]
    pub vertical_stroke_m: [f64; 2],
    /// Their speeds. [m/s]
    pub vertical_speed_m_s: [f64; 2],
    /// Openings of the valves: horizontal, vertical. [-]
    pub valve_opening: [[f64; 2]; 2],
    /// Load pressures: horizontal, vertical. [Pa]
    pub load_pressure_pa: [[f64; 2]; 2],
    /// Force of both tie rods on the rack, left positive. [N]
    pub rack_force_n: f64,
}

#[derive(Debug, Clone)]
struct Side {
    outboard_sign: f64,
    angle: f64,
    angle_rate: f64,
    lift: f64,
    lift_rate: f64,
    horizontal: Cylinder,
    vertical: Cylinder,
}

#[derive(Debug, Clone)]
struct SensorSet {
    models: [SensorModel; Channel::COUNT],
    encoder: Encoder,
    noise: Random,
    /// Last reading, kept when a value is not finite.
    last: [f64; Channel::COUNT],
}

/// Five axes, linkage, steering unit, sensors.
pub struct VirtualRig {
    rig: Rig,
    linkage: Linkage,
    unit: Box<dyn SteeringUnitModel>,
    sides: [Side; 2],
    steer_torque: f64,
    truth: Truth,
    environment: RigEnvironment,
    actuation: Actuation,
    /// Where interpolated commands stand, and how much they move a sub-step; sub-steps left to go.
    ramp: [[f64; COMMANDS]; 2],
    ramp_left: f64,
    ramp_steps: f64,
    step_s: f64,
    count: u64,
    commands: DelayLine<COMMANDS>,
    readings: DelayLine<{ Channel::COUNT }>,
    sensors: SensorSet,
    fault: u64,
}

impl VirtualRig {
    /// The rig at rest, unloaded and centred.
    ///
    /// # Errors
    /// Every broken rule of the rig and of the unit, of `period_s` (whole sub-steps), and of a machine too stiff
    /// for its sub-step.
    pub fn new(rig: &Rig, unit: &SteeringUnit, seed: u64, period_s: f64) -> Result<Self, Vec<Broken>> {
        let mut checker = Checker::default();
        unit.check(&mut checker);
        let upstream = match rig.plant.steer.device {
            SteerDevice::Actuator => rig.plant.steer.inertia_kg_m2,
            SteerDevice::MeasuringWheel => unit.hand_wheel_inertia_kg_m2,
        };
        let broken = checker.into_found();
        if !broken.is_empty() {
            return Err(broken);
        }
        Self::with_unit(rig, Box::new(ColumnEps::new(unit, upstream)), seed, period_s)
    }

    /// The same around any steering unit; `unit` must carry the inertia of hand wheel or actuator.
    ///
    /// # Errors
    /// As [`VirtualRig::new`].
    pub fn with_unit(
        rig: &Rig,
        unit: Box<dyn SteeringUnitModel>,
        seed: u64,
        period_s: f64,
    ) -> Result<Self, Vec<Broken>> {
        let mut checker = Checker::default();
        rig.check(&mut checker);
        let p = &rig.plant;
        let step = p.sub_step_s;
        checker.within("plant", |c| {
            let steps = period_s / step;
            c.require(
                (steps - steps.round()).abs() < 1e-6 && steps >= 0.5,
                "sub_step_s",
                format!("must divide the period of {period_s} s"),
            );
            let rod = 1.0 / (1.0 / p.tie_rod_stiffness_n_m + 1.0 / p.leaf_spring_stiffness_n_m);
            let mut stable = |key: &str, omega: f64| {
                c.require(
                    omega * step <= 1.0,
                    "sub_step_s",
                    format!("must be at most {:.2e} s for the stiffness of {key}", 1.0 / omega),
                );
            };
            for (key, axis) in [("horizontal", &p.horizontal), ("vertical", &p.vertical)] {
                let stiffness = Cylinder::new(axis, 0.0).stiffness_max_n_m() + rod;
                stable(key, (stiffness / axis.mass_kg).sqrt());
                stable(&format!("{key} (valve)"), core::f64::consts::TAU * axis.valve_frequency_hz);
            }
            stable("the steering unit", unit.frequency_max_rad_s(2.0 * rod));
        });
        let broken = checker.into_found();
        if !broken.is_empty() {
            return Err(broken);
        }

        let side = |outboard_sign| Side {
            outboard_sign,
            angle: 0.0,
            angle_rate: 0.0,
            lift: 0.0,
            lift_rate: 0.0,
            horizontal: Cylinder::new(&p.horizontal, 0.0),
            vertical: Cylinder::new(&p.vertical, p.vertical.mass_kg * GRAVITY),
        };
        let steps = |delay: f64| (delay / step).round() as usize;
        let mut result = Self {
            linkage: Linkage::new(&rig.geometry),
            unit,
            sides: [side(1.0), side(-1.0)],
            steer_torque: 0.0,
            truth: Truth::default(),
            environment: RigEnvironment::default(),
            actuation: Actuation::default(),
            ramp: [[0.0; COMMANDS]; 2],
            ramp_left: 0.0,
            ramp_steps: (period_s / step).round(),
            step_s: step,
            count: 0,
            commands: DelayLine::new(steps(p.command_delay_s)),
            readings: DelayLine::new(steps(p.measurement_delay_s)),
            sensors: SensorSet::new(rig, seed),
            fault: 0,
            rig: rig.clone(),
        };
        result.refresh_truth();
        if rig.sensors.tare_at_start {
            result.tare();
        }
        Ok(result)
    }

    /// Commands to the actuators, held until the next. A value that is not finite leaves the last one.
    pub fn set_actuation(&mut self, actuation: &Actuation) {
        let held = &mut self.actuation;
        let keep = |old: &mut f64, new: f64, limit: f64| {
            if new.is_finite() {
                *old = new.clamp(-limit, limit);
            }
        };
        for side in 0..2 {
            keep(&mut held.horizontal_valve[side], actuation.horizontal_valve[side], 1.0);
            keep(&mut held.vertical_valve[side], actuation.vertical_valve[side], 1.0);
        }
        let limit = self.rig.plant.steer.torque_limit_n_m;
        keep(&mut held.steer_torque_n_m, actuation.steer_torque_n_m, limit);
        if self.rig.plant.interpolate_commands {
            let [at, step] = &mut self.ramp;
            let goal = flat(&self.actuation);
            for k in 0..COMMANDS {
                step[k] = (goal[k] - at[k]) / self.ramp_steps;
            }
            self.ramp_left = self.ramp_steps;
        }
    }

    /// What surrounds the rig. Values that are not finite leave the last ones.
    pub fn set_environment(&mut self, environment: &RigEnvironment) {
        self.environment.engine_on = environment.engine_on;
        if environment.vehicle_speed_m_s.is_finite() {
            self.environment.vehicle_speed_m_s = environment.vehicle_speed_m_s;
        }
        if environment.hand_torque_n_m.is_finite() {
            self.environment.hand_torque_n_m = environment.hand_torque_n_m;
        }
        if environment.assist_request_n_m.is_none_or(f64::is_finite) {
            self.environment.assist_request_n_m = environment.assist_request_n_m;
        }
    }

    /// Whether the steering unit's motor takes a torque from an ECU outside
    /// ([`RigEnvironment::assist_request_n_m`]).
    pub fn takes_assist_request(&self) -> bool {
        self.unit.takes_assist_request()
    }

    /// Tunes the steering unit from the next sub-step on.
    pub fn tune_unit(&mut self, tuning: &UnitTuning) {
        self.unit.tune(tuning);
    }

    /// Advances by `duration_s`, rounded to whole sub-steps, at most 100 000.
    pub fn advance(&mut self, duration_s: f64) {
        let steps = (duration_s / self.step_s).round();
        debug_assert!((duration_s / self.step_s - steps).abs() < 1e-6, "duration must be whole sub-steps");
        for _ in 0..(steps.clamp(0.0, 100_000.0) as u32) {
            self.sub_step();
        }
        self.refresh_truth();
    }

    /// Reads the sensors as they were one measurement delay ago.
    pub fn sample(&mut self, out: &mut Measurement) {
        let delayed = *self.readings.oldest();
        *out = self.sensors.convert(&delayed);
    }

    /// The tare procedure: unloaded and centred, the mean of 256 conversions becomes zero for force cells,
    /// torque cells, rack potentiometer and strokes.
    pub fn tare(&mut self) {
        let now = *self.readings.newest();
        self.sensors.tare(&now);
    }

    /// The machine as it really is.
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// The steering unit's account of power and energy, if it keeps one.
    pub fn unit_account(&self) -> Option<&UnitAccount> {
        self.unit.account()
    }

    /// Geometry of the linkage.
    pub fn linkage(&self) -> &Linkage {
        &self.linkage
    }

    /// Number of times a state left the finite numbers and was put back to rest. 0 in any healthy run.
    pub fn fault_count(&self) -> u64 {
        self.fault
    }

    fn sub_step(&mut self) {
        let h = self.step_s;
        let p = &self.rig.plant;
        let goal = flat(&self.actuation);
        if p.interpolate_commands {
            let [at, step] = &mut self.ramp;
            if self.ramp_left > 0.5 {
                self.ramp_left -= 1.0;
                for k in 0..COMMANDS {
                    at[k] += step[k];
                }
            } else {
                *at = goal;
            }
            self.commands.push(*at);
        } else {
            self.commands.push(goal);
        }
        let command = *self.commands.oldest();

        let unit = *self.unit.output();
        let mut rack_force = 0.0;
        for (i, side) in self.sides.iter_mut().enumerate() {
            let arm = self.linkage.arm(side.angle);
            let rack_outboard = side.outboard_sign * unit.rack_displacement_m;
            let rod = self.linkage.rod(&arm, side.lift, rack_outboard);
            let tip_speed = self.linkage.upper_arm_m() * side.angle_rate;
            let rate = rod.per_tip * tip_speed + rod.direction[2] * side.lift_rate
                - rod.direction[1] * side.outboard_sign * unit.rack_velocity_m_s;
            let compliance =
                1.0 / p.tie_rod_stiffness_n_m + rod.per_tip * rod.per_tip / p.leaf_spring_stiffness_n_m;
            let force = (rod.elongation_m + p.tie_rod_damping_time_s * rate) / compliance;
            rack_force += side.outboard_sign * rod.direction[1] * force;

            let slope = arm.stroke_per_angle_m_rad;
            let pull = side.horizontal.step(command[i], arm.stroke_m, slope * side.angle_rate, h);
            let torque = pull * slope - force * rod.per_tip * self.linkage.upper_arm_m();
            let arm_length = self.linkage.upper_arm_m();
            side.angle_rate += h * torque / (p.horizontal.mass_kg * arm_length * arm_length);

            let lift = side.vertical.step(command[2 + i], side.lift, side.lift_rate, h);
            let weight = p.vertical.mass_kg * GRAVITY;
            side.lift_rate += h * (lift - weight - force * rod.direction[2]) / p.vertical.mass_kg;

            side.angle += h * side.angle_rate;
            side.lift += h * side.lift_rate;
            self.truth.tie_rod_force_n[i] = force;
            self.truth.actuator_force_n[i] = pull;
        }
        self.truth.rack_force_n = rack_force;

        let (shaft_torque, upstream) = match p.steer.device {
            SteerDevice::Actuator => {
                let omega = core::f64::consts::TAU * p.steer.torque_bandwidth_hz;
                let wanted = command[4];
                self.steer_torque = (self.steer_torque + h * omega * wanted) / (1.0 + h * omega);
                // Torque fades out over the last 2 % of speed.
                let speed = unit.hand_wheel_rate_rad_s * self.steer_torque.signum();
                let room = (p.steer.speed_limit_rad_s - speed) / (0.02 * p.steer.speed_limit_rad_s);
                (self.steer_torque * room.clamp(0.0, 1.0), p.steer.inertia_kg_m2)
            }
            SteerDevice::MeasuringWheel => (0.0, 0.0),
        };
        let input = UnitInput {
            hand_wheel_torque_n_m: shaft_torque + self.environment.hand_torque_n_m,
            rack_force_n: rack_force,
            vehicle_speed_m_s: self.environment.vehicle_speed_m_s,
            engine_on: self.environment.engine_on,
            assist_request_n_m: self.environment.assist_request_n_m,
        };
        self.unit.step(&input, h);
        let unit = self.unit.output();
        self.truth.steering_wheel_torque_n_m =
            input.hand_wheel_torque_n_m - upstream * unit.hand_wheel_acceleration_rad_s2;
        self.count += 1;

        let reading = self.true_channels();
        if reading.iter().all(|v| v.is_finite()) {
            self.readings.push(reading);
        } else {
            self.return_to_rest();
        }
    }

    fn true_channels(&self) -> [f64; Channel::COUNT] {
        let (u, t) = (self.unit.output(), &self.truth);
        let stroke = |side: &Side| self.linkage.arm(side.angle).stroke_m;
        [
            u.hand_wheel_angle_rad,
            t.steering_wheel_torque_n_m,
            u.torsion_bar_torque_n_m,
            u.assist_force_n * self.unit.rack_per_radian_m(),
            u.rack_displacement_m,
            t.tie_rod_force_n[0],
            t.tie_rod_force_n[1],
            t.actuator_force_n[0],
            t.actuator_force_n[1],
            stroke(&self.sides[0]),
            stroke(&self.sides[1]),
            self.sides[0].lift,
            self.sides[1].lift,
        ]
    }

    fn refresh_truth(&mut self) {
        let t = &mut self.truth;
        t.time_s = self.count as f64 * self.step_s;
        t.unit = *self.unit.output();
        for (i, side) in self.sides.iter().enumerate() {
            let arm = self.linkage.arm(side.angle);
            t.horizontal_stroke_m[i] = arm.stroke_m;
            t.horizontal_speed_m_s[i] = arm.stroke_per_angle_m_rad * side.angle_rate;
            t.vertical_stroke_m[i] = side.lift;
            t.vertical_speed_m_s[i] = side.lift_rate;
            t.valve_opening[0][i] = side.horizontal.opening;
            t.valve_opening[1][i] = side.vertical.opening;
            t.load_pressure_pa[0][i] = side.horizontal.pressure_pa;
            t.load_pressure_pa[1][i] = side.vertical.pressure_pa;
        }
    }

    /// A state that is not finite cannot come from finite commands; if it does, the machine stands still and counts.
    fn return_to_rest(&mut self) {
        self.fault += 1;
        let (command_len, unit_len) = (self.commands.state_len(), self.unit.state_len());
        debug_assert!(command_len > 0 && unit_len > 0);
        let p = &self.rig.plant;
        for side in &mut self.sides {
            side.angle = 0.0;
            side.angle_rate = 0.0;
            side.lift = 0.0;
            side.lift_rate = 0.0;
            let zeros = [0.0; Cylinder::STATE];
            side.horizontal.load(&mut StateReader::new(&zeros));
            side.vertical.load(&mut StateReader::new(&zeros));
            side.vertical.pressure_pa = p.vertical.mass_kg * GRAVITY / p.vertical.piston_area_m2;
        }
        self.steer_torque = 0.0;
        let zeros = [0.0; 256];
        self.unit.load(&mut StateReader::new(&zeros));
        self.truth.tie_rod_force_n = [0.0; 2];
        self.truth.actuator_force_n = [0.0; 2];
        self.truth.steering_wheel_torque_n_m = 0.0;
        let last = *self.readings.newest();
        self.readings.push(last);
    }

    /// Length of the flat state.
    pub fn state_len(&self) -> usize {
        let sides = 2 * (4 + 2 * Cylinder::STATE);
        let held = COMMANDS + 2 * COMMANDS + 1 + 5 + 1 + 2 + 2 + 5;
        sides
            + held
            + self.unit.state_len()
            + self.commands.state_len()
            + self.readings.state_len()
            + SensorSet::STATE
    }

    /// Writes the complete state into the front of `out` (at least [`Self::state_len`] long).
    pub fn save_state(&self, out: &mut [f64]) {
        let mut w = StateWriter::new(out);
        for side in &self.sides {
            w.put_all(&[side.angle, side.angle_rate, side.lift, side.lift_rate]);
            side.horizontal.save(&mut w);
            side.vertical.save(&mut w);
        }
        let (a, e, t) = (&self.actuation, &self.environment, &self.truth);
        w.put_all(&a.horizontal_valve);
        w.put_all(&a.vertical_valve);
        w.put(a.steer_torque_n_m);
        w.put_all(&self.ramp[0]);
        w.put_all(&self.ramp[1]);
        w.put(self.ramp_left);
        w.put_all(&[e.vehicle_speed_m_s, f64::from(u8::from(e.engine_on)), e.hand_torque_n_m]);
        let request = e.assist_request_n_m;
        w.put_all(&[f64::from(u8::from(request.is_some())), request.unwrap_or(0.0)]);
        w.put(self.steer_torque);
        w.put_u64(self.count);
        w.put_u64(self.fault);
        w.put_all(&t.tie_rod_force_n);
        w.put_all(&t.actuator_force_n);
        w.put(t.steering_wheel_torque_n_m);
        self.unit.save(&mut w);
        self.commands.save(&mut w);
        self.readings.save(&mut w);
        self.sensors.save(&mut w);
        debug_assert_eq!(w.written(), self.state_len());
    }

    /// Takes over a state written by a rig of the same configuration; the continuation is bit-exact.
    pub fn load_state(&mut self, from: &[f64]) {
        let mut r = StateReader::new(from);
        for side in &mut self.sides {
            [side.angle, side.angle_rate, side.lift, side.lift_rate] = r.take_array();
            side.horizontal.load(&mut r);
            side.vertical.load(&mut r);
        }
        r.take_all(&mut self.actuation.horizontal_valve);
        r.take_all(&mut self.actuation.vertical_valve);
        self.actuation.steer_torque_n_m = r.take();
        self.ramp = [r.take_array(), r.take_array()];
        self.ramp_left = r.take();
        self.environment = RigEnvironment {
            vehicle_speed_m_s: r.take(),
            engine_on: r.take() != 0.0,
            hand_torque_n_m: r.take(),
            assist_request_n_m: {
                let [asked, torque] = r.take_array();
                (asked != 0.0).then_some(torque)
            },
        };
        self.steer_torque = r.take();
        self.count = r.take_u64();
        self.fault = r.take_u64();
        r.take_all(&mut self.truth.tie_rod_force_n);
        r.take_all(&mut self.truth.actuator_force_n);
        self.truth.steering_wheel_torque_n_m = r.take();
        self.unit.load(&mut r);
        self.commands.load(&mut r);
        self.readings.load(&mut r);
        self.sensors.load(&mut r);
        self.refresh_truth();
    }
}

/// The commands in the order of the delay line.
fn flat(a: &Actuation) -> [f64; COMMANDS] {
    let ([hl, hr], [vl, vr]) = (a.horizontal_valve, a.vertical_valve);
    [hl, hr, vl, vr, a.steer_torque_n_m]
}

impl SensorSet {
    const STATE: usize = Channel::COUNT * (SensorModel::STATE + 1) + 2;

    fn new(rig: &Rig, seed: u64) -> Self {
        let s = &rig.sensors;
        let mut run = Random::new(seed, 1);
        let mut model = |sensor: Sensor, rule| SensorModel::new(sensor, rule, &mut run);
        use ErrorRule::{Larger, Sum};
        // The encoder's place is kept by a model that is never used, so that channels and models share indices.
        let models = [
            model((&s.steering_torque).into(), Larger),
            model((&s.steering_torque).into(), Larger),
            model((&s.torsion_bar_torque).into(), Sum),
            model((&s.torsion_bar_torque).into(), Sum),
            model((&s.rack_displacement).into(), Sum),
            model((&s.tie_rod_force).into(), Sum),
            model((&s.tie_rod_force).into(), Sum),
            model((&s.actuator_force).into(), Sum),
            model((&s.actuator_force).into(), Sum),
            model((&s.horizontal_stroke).into(), Sum),
            model((&s.horizontal_stroke).into(), Sum),
            model((&s.vertical_stroke).into(), Sum),
            model((&s.vertical_stroke).into(), Sum),
        ];
        let encoder = Encoder::new(s.encoder_resolution_rad, s.encoder_error_rad, &mut run);
        Self { models, encoder, noise: Random::new(seed, 2), last: [0.0; Channel::COUNT] }
    }

    fn convert(&mut self, truth: &[f64; Channel::COUNT]) -> Measurement {
        let mut validity = 0;
        let mut reading = [0.0; Channel::COUNT];
        reading[0] = self.encoder.convert(truth[0]);
        validity |= 1 << Channel::SteeringAngle as u8;
        // The ECU tells its assist over the bus: no sensor error.
        reading[3] = truth[3];
        validity |= 1 << Channel::AssistTorque as u8;
        let mut spare = [0.0; 2];
        for (used, i) in [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12].into_iter().enumerate() {
            if used % 2 == 0 {
                spare = self.noise.normal_pair();
            }
            let (value, valid) = self.models[i].convert(truth[i], spare[used % 2]);
            reading[i] = value;
            validity |= u64::from(valid) << i;
        }
        for i in 0..Channel::COUNT {
            if reading[i].is_finite() {
                self.last[i] = reading[i];
            } else {
                reading[i] = self.last[i];
                validity &= !(1 << i);
            }
        }
        Measurement::from_channels(&reading, validity)
    }

    fn tare(&mut self, truth: &[f64; Channel::COUNT]) {
        const CONVERSIONS: usize = 256;
        for i in [1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12] {
            let model = &mut self.models[i];
            model.tare = 0.0;
            let mut sum = 0.0;
            for _ in 0..CONVERSIONS / 2 {
                for normal in self.noise.normal_pair() {
                    sum += model.convert(truth[i], normal).0;
                }
            }
            model.tare = sum / CONVERSIONS as f64 - truth[i];
        }
    }

    fn save(&self, w: &mut StateWriter) {
        for model in &self.models {
            w.put_all(&[model.tare, model.loop_position, model.last]);
        }
        w.put_all(&self.last);
        w.put_u64(self.noise.state);
    }

    fn load(&mut self, r: &mut StateReader) {
        for model in &mut self.models {
            [model.tare, model.loop_position, model.last] = r.take_array();
        }
        r.take_all(&mut self.last);
        self.noise.state = r.take_u64();
    }
}

/// A delay of whole sub-steps.
#[derive(Debug, Clone)]
struct DelayLine<const N: usize> {
    ring: Vec<[f64; N]>,
    head: usize,
}

impl<const N: usize> DelayLine<N> {
    fn new(steps: usize) -> Self {
        Self { ring: vec![[0.0; N]; steps + 1], head: 0 }
    }

    fn push(&mut self, value: [f64; N]) {
        self.head = if self.head + 1 == self.ring.len() { 0 } else { self.head + 1 };
        self.ring[self.head] = value;
    }

    fn newest(&self) -> &[f64; N] {
        &self.ring[self.head]
    }

    fn oldest(&self) -> &[f64; N] {
        let next = if self.head + 1 == self.ring.len() { 0 } else { self.head + 1 };
        &self.ring[next]
    }

    fn state_len(&self) -> usize {
        1 + N * self.ring.len()
    }

    fn save(&self, w: &mut StateWriter) {
        w.put(self.head as f64);
        for value in &self.ring {
            w.put_all(value);
        }
    }

    fn load(&mut self, r: &mut StateReader) {
        self.head = (r.take() as usize).min(self.ring.len() - 1);
        for value in &mut self.ring {
            r.take_all(value);
        }
    }
}
