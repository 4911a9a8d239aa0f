//! The car: parts put together, one step, its outputs.
//!
//! Body axes at the sprung centre of gravity, ISO 8855. One step = `sub_steps` sub-steps of semi-implicit Euler:
//! forces from positions and velocities of the sub-step's start, new velocities from them, positions from the new
//! velocities; dampers and all Coulomb friction implicit, tyre relaxation and hydraulic lags by exact
//! discretisation, attitude by the exponential map. The velocity is kept in earth axes and the attitude in unit
//! Euler parameters, so that neither drifts. Outputs: positions and velocities at the end of the step, forces and
//! accelerations of its last sub-step.
//!
//! A car on its side: tyres let go between 66 and 78 degrees of lean, a crude hull carries the body (`hull`).
//!
//! Freedoms: body 6, wheel travels 4, spins 4, tyre relaxation 8, engine 1, brake pressures 4 = 27; besides the
//! rack (for a steering of its own), elastic deflections and the controllers' states.

use crate::aerodynamics::Aerodynamics;
use crate::brakes::Brakes;
use crate::chassis::{self, Handed, Masses, StationLoad};
use crate::driveline::{DriveDemand, Driveline, OutsideDrive, SpinTorques};
use crate::equations::Equations;
use crate::hull::Hull;
use crate::io::{GearMode, VehicleInput, VehicleOutput, WHEELS};
use crate::kinematics::AxleKinematics;
use crate::peer::Peer;
use crate::speed_control::SpeedControl;
use crate::state::State;
use crate::station::{Contact, Motion, Station};
use crate::steering::Steering;
use crate::suspension::Suspension;
use crate::variables::{Imports, wheel, whole};
use config::car::Car;
use config::{Broken, Check};
use nalgebra::{Matrix3, Vector3};
use tyre::{Forces, Side, Tyre, UseMode};

/// Standard gravity. [m/s²]
pub const GRAVITY_M_S2: f64 = 9.80665;
/// Largest rack rate taken over from a measured rack. [m/s]
const RACK_RATE_MAX_M_S: f64 = 2.0;
/// A measured rack is believed up to this multiple of the car's own travel.
const RACK_EXCESS: f64 = 1.2;
/// A target below this means standing. [m/s]
const STANDING_M_S: f64 = 0.02;
/// Speed below which a car told to stand is held by its brakes. [m/s]
const STOPPING_M_S: f64 = 0.3;
/// Master pressure that holds it. [Pa]
const HOLD_PRESSURE_PA: f64 = 3e6;
/// Cosine of the lean at which a tread has left the road, and from which it lies on it wholly.
const UPRIGHT_NONE: f64 = 0.2;
const UPRIGHT_FULL: f64 = 0.4;
/// Largest inclination told to a tyre, of a car on its side: a car's tyre has no camber thrust to extrapolate there. [rad]
const CAMBER_MAX_RAD: f64 = 0.35;
/// A tyre is not pressed in further than to this share of its free radius.
const RADIUS_SHARE_MIN: f64 = 0.4;
/// Least friction of a road. [-]
const FRICTION_MIN: f64 = 1e-3;

/// The 27-freedom car.
#[derive(Debug, Clone)]
pub struct Vehicle {
    pub(crate) step_s: f64,
    pub(crate) sub_steps: u32,
    pub(crate) sub_step_s: f64,
    pub(crate) masses: Masses,
    pub(crate) design: [Vector3<f64>; WHEELS],
    pub(crate) kinematics: [AxleKinematics; 2],
    pub(crate) suspension: [Suspension; 2],
    pub(crate) driveline: Driveline,
    outside: Option<OutsideDrive>,
    brakes: Brakes,
    aerodynamics: Aerodynamics,
    hull: Hull,
    speed_control: SpeedControl,
    pub(crate) steering: Steering,
    tyres: [Tyre; WHEELS],
    pressure_pa: [f64; WHEELS],
    mode: UseMode,
    peer: Option<Box<Peer>>,
    /// Centre of gravity of the whole car at design, and the accelerometer, from the sprung one.
    pub(crate) centre: Vector3<f64>,
    pub(crate) accelerometer: Vector3<f64>,
    pub(crate) design_height_m: f64,
    pub(crate) state: State,
    imports: Imports,
    pub(crate) equations: Option<Box<Equations>>,
    pub(crate) output: VehicleOutput,
}

/// What one sub-step found, for the outputs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    pub(crate) stations: [Station; WHEELS],
    pub(crate) contacts: [Contact; WHEELS],
    pub(crate) tyre: [Forces; WHEELS],
    pub(crate) load_n: [f64; WHEELS],
    pub(crate) handed: [Handed; WHEELS],
    pub(crate) spins: SpinTorques,
    pub(crate) body: Vector3<f64>,
    pub(crate) angular: Vector3<f64>,
    pub(crate) damper_n: [f64; WHEELS],
    pub(crate) steering_n_m: f64,
    pub(crate) power_w: [f64; WHEELS],
}

impl Vehicle {
    /// Puts a car together. `kinematics` and `tyres` are those of the car's files (front, rear; front left, front
    /// right, rear left, rear right — each mirrored here to the side it stands on); `step_s` in (0, 0.01] is the
    /// time one [`Self::step`] advances.
    ///
    /// # Errors
    /// Every broken rule of the car section, and parts that do not fit it.
    pub fn new(
        car: &Car,
        kinematics: [AxleKinematics; 2],
        tyres: [Tyre; WHEELS],
        step_s: f64,
    ) -> Result<Self, Vec<Broken>> {
        let mut vehicle = Self::unsettled(car, kinematics, tyres, step_s)?;
        vehicle.reset(0.0, &VehicleInput::default());
        Ok(vehicle)
    }

    /// As [`Self::new`], but not in equilibrium, which takes thousands of steps to find: for a state that is there
    /// already, by [`Self::load_state`], before the first step.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn unsettled(
        car: &Car,
        kinematics: [AxleKinematics; 2],
        tyres: [Tyre; WHEELS],
        step_s: f64,
    ) -> Result<Self, Vec<Broken>> {
        let mut broken = car.broken();
        let mut fault = |key: &str, rule: String| broken.push(Broken { key: key.to_owned(), rule });
        if !(step_s > 0.0 && step_s <= 0.01) {
            fault("step_s", format!("must be in (0, 0.01] s, is {step_s}"));
        }
        let steering = Steering::new(&car.steering).map_err(|rule| fault("steering", rule)).ok();
        if car.numerics.sub_steps == 0 {
            fault("numerics.sub_steps", "must be at least 1".to_owned());
        }
        let Some(steering) = steering.filter(|_| broken.is_empty()) else { return Err(broken) };

        let b = &car.body;
        let (front, rear) = (&car.front, &car.rear);
        let place = |ahead: f64, left: f64, height: f64| {
            Vector3::new(ahead, left - b.sprung_cg_left_m, height - b.sprung_cg_height_m)
        };
        let (ahead, behind) = (b.front_axle_to_sprung_cg_m, b.front_axle_to_sprung_cg_m - b.wheelbase_m);
        let design = [
            place(ahead, 0.5 * front.track_m, front.wheel_centre_height_m),
            place(ahead, -0.5 * front.track_m, front.wheel_centre_height_m),
            place(behind, 0.5 * rear.track_m, rear.wheel_centre_height_m),
            place(behind, -0.5 * rear.track_m, rear.wheel_centre_height_m),
        ];
        let four = |f: f64, r: f64| [f, f, r, r];
        let mut masses = Masses {
            sprung_kg: b.sprung_mass_kg,
            inertia_kg_m2: Matrix3::new(
                b.roll_inertia_kg_m2,
                0.0,
                -b.xz_product_kg_m2,
                0.0,
                b.pitch_inertia_kg_m2,
                0.0,
                -b.xz_product_kg_m2,
                0.0,
                b.yaw_inertia_kg_m2,
            ),
            unsprung_kg: four(front.unsprung_mass_kg, rear.unsprung_mass_kg),
            wheel_kg: four(front.wheel_mass_kg, rear.wheel_mass_kg),
            spin_kg_m2: four(front.wheel_spin_inertia_kg_m2, rear.wheel_spin_inertia_kg_m2),
            diametral_kg_m2: four(front.wheel_diametral_inertia_kg_m2, rear.wheel_diametral_inertia_kg_m2),
            yaw_lateral_kg_m: 0.0,
        };
        let mass = masses.sprung_kg + masses.unsprung_kg.iter().sum::<f64>();
        let centre = (0..WHEELS).map(|i| design[i] * masses.unsprung_kg[i]).sum::<Vector3<f64>>() / mass;
        let sub_step_s = step_s / f64::from(car.numerics.sub_steps);
        let height = four(front.wheel_centre_height_m, rear.wheel_centre_height_m);
        let balance = balanced_forces(&masses, &design, height, &kinematics);
        let rotating: f64 = (0..WHEELS).map(|i| masses.spin_kg_m2[i] / height[i].powi(2)).sum();
        let radius = 0.5 * (front.wheel_centre_height_m + rear.wheel_centre_height_m);
        let sides = [Side::Left, Side::Right, Side::Left, Side::Right];
        let tyres = [0, 1, 2, 3].map(|i| tyres[i].on_side(sides[i]));
        let peer = car.peer_model.as_ref().map(|p| Box::new(Peer::new(p, car, &tyres)));
        let mut centre = centre;
        if let Some(p) = &car.peer_model {
            if p.no_gyroscopic_moments {
                masses.spin_kg_m2 = [0.0; WHEELS];
            }
            if p.yaw_about_sprung_centre {
                masses.yaw_lateral_kg_m = -centre.x * mass;
                centre.x = 0.0;
            }
        }
        Ok(Self {
            step_s,
            sub_steps: car.numerics.sub_steps,
            sub_step_s,
            centre,
            accelerometer: place(
                ahead - car.accelerometer.behind_front_axle_m,
                car.accelerometer.left_m,
                car.accelerometer.height_m,
            ),
            design_height_m: b.sprung_cg_height_m,
            suspension: [
                Suspension::new(front, [balance[0], balance[1]], sub_step_s),
                Suspension::new(rear, [balance[2], balance[3]], sub_step_s),
            ],
            driveline: Driveline::new(car),
            outside: None,
            brakes: Brakes::new(&car.brakes, sub_step_s),
            aerodynamics: Aerodynamics::new(&car.aerodynamics, b),
            hull: Hull::new(car, mass),
            speed_control: SpeedControl::new(&car.speed_control, mass + rotating, radius),
            steering,
            tyres,
            peer,
            pressure_pa: four(front.tyre_pressure_pa, rear.tyre_pressure_pa),
            mode: UseMode::AlphaStar,
            masses,
            design,
            kinematics,
            state: State::zero(),
            imports: Imports::default(),
            equations: None,
            output: VehicleOutput::default(),
        })
    }

    /// The time one step advances. [s]
    #[must_use]
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Mass of the whole car. [kg]
    #[must_use]
    pub fn mass_kg(&self) -> f64 {
        self.masses.sprung_kg + self.masses.unsprung_kg.iter().sum::<f64>()
    }

    /// The kinematics maps, front and rear.
    #[must_use]
    pub fn kinematics(&self) -> &[AxleKinematics; 2] {
        &self.kinematics
    }

    /// Puts another tyre on a wheel, mirrored to its side; its transient state stays.
    pub fn set_tyre(&mut self, wheel: usize, tyre: &Tyre) {
        let side = if wheel.is_multiple_of(2) { Side::Left } else { Side::Right };
        self.tyres[wheel] = tyre.on_side(side);
        if let Some(peer) = &mut self.peer {
            peer.set_tyre(wheel, &self.tyres[wheel]);
        }
    }

    /// Outputs of the last step.
    #[must_use]
    pub fn output(&self) -> &VehicleOutput {
        &self.output
    }

    /// Puts a driveline that is simulated outside in the place of the powertrain's mechanics. An input, not state.
    pub fn set_outside_drive(&mut self, drive: Option<OutsideDrive>) {
        self.outside = drive;
    }

    /// What transmission control asked of the driveline in the last step.
    #[must_use]
    pub fn drive_demand(&self) -> DriveDemand {
        let s = &self.state.driveline;
        DriveDemand {
            pedal: self.output.throttle,
            ratio: self.driveline.effective_ratio(s),
            lock_up: s.lock_up,
        }
    }

    /// The imports in force, to set or clear.
    pub fn imports_mut(&mut self) -> &mut Imports {
        &mut self.imports
    }

    /// Takes the user's variables, imports and outputs on, from the next [`Self::reset`] on.
    ///
    /// # Errors
    /// Names and expressions that are wrong, by their key within the section.
    pub fn set_equations(&mut self, section: &config::equations::Equations) -> Result<(), Vec<Broken>> {
        let mut equations = Box::new(Equations::new(section, self.step_s)?);
        equations.reset(&self.output);
        self.equations = Some(equations);
        Ok(())
    }

    /// The equations, their imports no longer in force.
    pub(crate) fn take_equations(&mut self) -> Option<Box<Equations>> {
        let equations = self.equations.take()?;
        equations.release(&mut self.imports);
        Some(equations)
    }

    /// The user's equations, if there are any.
    #[must_use]
    pub fn equations(&self) -> Option<&Equations> {
        self.equations.as_deref()
    }

    /// Numbers in a saved state.
    #[must_use]
    pub fn state_len(&self) -> usize {
        State::len() + self.equations.as_ref().map_or(0, |equations| equations.state_len())
    }

    /// Writes the state; `to` holds at least [`Self::state_len`] numbers.
    pub fn save_state(&self, to: &mut [f64]) {
        let mut state = self.state;
        let mut slots = to.iter_mut();
        state.visit(&mut |v| {
            if let Some(slot) = slots.next() {
                *slot = *v;
            }
        });
        if let Some(equations) = &self.equations {
            equations.save_state(slots.into_slice());
        }
    }

    /// Restores what [`Self::save_state`] wrote. The outputs are those of a step on the last input from there, with
    /// the clock put back, until the next step brings its own.
    pub fn load_state(&mut self, from: &[f64]) {
        assert!(from.len() >= self.state_len(), "a saved vehicle state has {} numbers", self.state_len());
        if let Some(equations) = &mut self.equations {
            equations.load_state(&from[State::len()..]);
        }
        let mut values = from.iter();
        self.state.visit(&mut |v| {
            if let Some(value) = values.next() {
                *v = *value;
            }
        });
        let state = self.state;
        // The step that brings the outputs back is not one of the equations'.
        let equations = self.equations.take();
        self.step(&state.input);
        self.equations = equations;
        self.state = state;
        self.output.time_s = state.time;
    }

    /// Advances one step. A number in `input` that is not finite, or a state that would become unsound, holds the
    /// last good one and is counted.
    pub fn step(&mut self, input: &VehicleInput) {
        let before = self.state;
        if let Some(equations) = &mut self.equations {
            equations.before(input.time_s, &mut self.imports);
        }
        if input.finite() {
            self.state.input = *input;
        } else {
            self.state.held += 1;
        }
        let mut input = self.state.input;
        if self.imports.active() {
            let i = &self.imports;
            input.steering_wheel_angle_rad = i.car(whole::STEERING_WHEEL, input.steering_wheel_angle_rad);
            input.rack_displacement_m = match input.rack_displacement_m {
                Some(rack) => Some(i.car(whole::RACK, rack)),
                None => i.replacement(whole::RACK),
            };
            input.throttle = i.car(whole::THROTTLE, input.throttle);
            input.brake_pressure_pa = i.car(whole::BRAKE, input.brake_pressure_pa);
            input.target_speed_m_s = match input.target_speed_m_s {
                Some(speed) => Some(i.car(whole::TARGET_SPEED, speed)),
                None => i.replacement(whole::TARGET_SPEED),
            };
            input.hand_brake = i.car(whole::HAND_BRAKE, input.hand_brake);
            for k in 0..2 {
                input.wind_m_s[k] = i.car(whole::WIND + k, input.wind_m_s[k]);
            }
            for (k, road) in input.road.iter_mut().enumerate() {
                road.height_m = i.wheel(k, wheel::ROAD_HEIGHT, road.height_m);
            }
        }
        let control = self.control(&input);
        let mut found = None;
        for k in 0..self.sub_steps {
            found = Some(self.sub_step(&input, &control, k));
        }
        self.state.steering_wheel = input.steering_wheel_angle_rad;
        self.state.road_height = input.road.map(|r| r.height_m);
        self.state.time = input.time_s + self.step_s;
        if self.state.sound() {
            if let Some(found) = found {
                self.put_out(&input, &control, &found);
            }
        } else {
            let held = self.state.held + 1;
            self.state = before;
            self.state.held = held;
            self.state.time = self.output.time_s + self.step_s;
            self.output.time_s = self.state.time;
            self.output.held_steps = held;
        }
        if let Some(equations) = &mut self.equations {
            equations.after(&self.output);
        }
    }

    /// Once a step: what steering, throttle, brakes and gearbox do.
    fn control(&mut self, input: &VehicleInput) -> Control {
        let over = self.over(self.state.position, &self.state.attitude.matrix());
        let s = &mut self.state;
        let travel = self.steering.travel_m();
        let prescribed = input
            .rack_displacement_m
            .map(|r| r.clamp(-RACK_EXCESS * travel, RACK_EXCESS * travel))
            .or_else(|| {
                (!self.steering.dynamic())
                    .then(|| self.steering.unloaded_rack_m(input.steering_wheel_angle_rad))
            });
        let prescribed_rate = prescribed
            .map(|target| ((target - s.rack) / self.step_s).clamp(-RACK_RATE_MAX_M_S, RACK_RATE_MAX_M_S));
        let mut throttle = input.throttle.clamp(0.0, 1.0);
        let mut master_pa = input.brake_pressure_pa;
        if let Some(target) = input.target_speed_m_s {
            let forward = horizontal_forward(&s.attitude.matrix());
            let speed = s.velocity.x * forward.0 + s.velocity.y * forward.1;
            let sense = if input.gear_mode == GearMode::Reverse { -1.0 } else { 1.0 };
            let error = (target - speed) * sense;
            let stopping = target.abs() < STANDING_M_S && speed.abs() < STOPPING_M_S;
            if stopping {
                // A converter creeps at idle: a car told to stand is held by its brakes.
                s.speed_integral = 0.0;
                master_pa += self.brakes.limited_pa(HOLD_PRESSURE_PA);
            }
            let torque = self.speed_control.demand_n_m(&mut s.speed_integral, error, self.step_s);
            let missing;
            (throttle, missing) = self.driveline.throttle_for(&s.driveline, &s.spin, torque);
            // Brakes help only when the controller really asks for deceleration.
            if missing < 0.0 && torque < 0.0 && self.brakes.total_gain() > 0.0 {
                master_pa += -missing / self.brakes.total_gain();
            }
        }
        self.driveline.select(&mut s.driveline, &s.spin, throttle, input.gear_mode, self.step_s);
        let wheel_rate = (input.steering_wheel_angle_rad - s.steering_wheel) / self.step_s;
        Control {
            throttle,
            master_pa: self.brakes.limited_pa(master_pa),
            hand_brake: input.hand_brake.clamp(0.0, 1.0),
            prescribed_rate,
            wheel_from: s.steering_wheel,
            wheel_rate,
            over,
        }
    }

    /// Where in the earth plane each wheel centre stands (at the start of the step).
    fn over(&self, position: Vector3<f64>, attitude: &Matrix3<f64>) -> [[f64; 2]; WHEELS] {
        let mut over = [[0.0; 2]; WHEELS];
        for i in 0..WHEELS {
            let r = self.design[i] + Vector3::new(0.0, 0.0, self.state.travel[i]);
            let p = position + attitude * r;
            over[i] = [p.x, p.y];
        }
        over
    }

    fn sub_step(&mut self, input: &VehicleInput, control: &Control, index: u32) -> Found {
        let h = self.sub_step_s;
        let s = &mut self.state;
        let mut steering_n_m = 0.0;
        if let Some(rate) = control.prescribed_rate {
            s.rack_rate = rate;
            s.rack += rate * h;
        } else {
            let angle = control.wheel_from + control.wheel_rate * h * f64::from(index + 1);
            steering_n_m = self.steering.advance(
                &mut s.rack,
                &mut s.rack_rate,
                (angle, control.wheel_rate),
                s.rack_force,
                s.velocity.norm(),
                h,
            );
        }
        let to_earth = s.attitude.matrix();
        let to_body = to_earth.transpose();
        let gravity = to_body * Vector3::new(0.0, 0.0, -GRAVITY_M_S2);
        let motion = Motion { v: to_body * s.velocity, w: s.angular, rack: s.rack, rack_rate: s.rack_rate };
        let mut force = Vector3::zeros();
        let mut moment = Vector3::zeros();

        // Wheels on the road.
        let stations: [Station; WHEELS] = std::array::from_fn(|i| {
            let map = &self.kinematics[i / 2].sides[i % 2];
            let mut deflection = s.deflection[i];
            if self.imports.active() {
                let value = map.pose(s.travel[i], motion.rack).value;
                for (k, place) in [(0, wheel::STEER), (1, wheel::INCLINATION)] {
                    let angle = value[k] + deflection[k];
                    deflection[k] += self.imports.wheel(i, place, angle) - angle;
                }
            }
            Station::new(map, &self.design[i], s.travel[i], s.travel_rate[i], &deflection, &motion)
        });
        let mut contacts: [Contact; WHEELS] = std::array::from_fn(|i| {
            let road = &input.road[i];
            let norm = (1.0 + road.slope_x * road.slope_x + road.slope_y * road.slope_y).sqrt();
            let centre = s.position + to_earth * stations[i].r;
            let above = centre.z
                - road.height_m
                - road.slope_x * (centre.x - control.over[i][0])
                - road.slope_y * (centre.y - control.over[i][1]);
            let normal = to_body * Vector3::new(-road.slope_x / norm, -road.slope_y / norm, 1.0 / norm);
            let mut contact = Contact::new(&stations[i], &normal, above / norm, 0.0);
            contact.keep_radius(&stations[i], RADIUS_SHARE_MIN * self.tyres[i].free_radius_m(s.spin[i]));
            contact
        });
        if let Some(peer) = &self.peer {
            peer.adjust(&mut contacts, &stations, &s.travel, &s.angular, &to_earth);
        }
        let mut tyre_forces = [Forces::default(); WHEELS];
        let mut load_n = [0.0; WHEELS];
        let mut forces = [Vector3::zeros(); WHEELS];
        let mut moments = [Vector3::zeros(); WHEELS];
        let mut about_spin = [0.0; WHEELS];
        let mut power_w = [0.0; WHEELS];
        for i in 0..WHEELS {
            let (contact, tyre, spin, pressure) =
                (&contacts[i], &self.tyres[i], s.spin[i], self.pressure_pa[i]);
            let free = tyre.free_radius_m(spin);
            let deflection = free - contact.radius_m.max(RADIUS_SHARE_MIN * free);
            let [fx, fy] = s.tyre_force[i];
            let fz = tyre.vertical_force_n(deflection, contact.closing_m_s, spin, fx, fy, pressure);
            // A car on its side: the tread leaves the road.
            let upright = contact.n.z.min(contact.inclination_rad.cos());
            let fz = fz * ((upright - UPRIGHT_NONE) / (UPRIGHT_FULL - UPRIGHT_NONE)).clamp(0.0, 1.0);
            let fz = self.imports.wheel(i, wheel::FZ, fz).max(0.0);
            let friction = self.imports.wheel(i, wheel::FRICTION, input.road[i].friction);
            let rolling = tyre.effective_rolling_radius_m(fz, spin, pressure);
            let motion = tyre::Motion {
                vertical_load_n: fz,
                speed_m_s: contact.vx_m_s,
                slip_speed_x_m_s: contact.vx_m_s - spin * rolling,
                slip_speed_y_m_s: contact.vy_m_s,
                spin_rate_rad_s: contact.turn_rad_s,
                camber_rad: contact.inclination_rad.clamp(-CAMBER_MAX_RAD, CAMBER_MAX_RAD),
                pressure_pa: pressure,
                friction_scale: [friction.clamp(FRICTION_MIN, 2.0); 2],
            };
            let mut f = match &self.peer {
                Some(peer) => peer.tyre_step(i, tyre, &mut s.tyre[i], &motion, self.mode, h),
                None => tyre.transient_step(&mut s.tyre[i], &motion, self.mode, h),
            };
            if self.imports.active() {
                f.fx_n = self.imports.wheel(i, wheel::FX, f.fx_n);
                f.fy_n = self.imports.wheel(i, wheel::FY, f.fy_n);
                f.mx_n_m = self.imports.wheel(i, wheel::MX, f.mx_n_m);
                f.my_n_m = self.imports.wheel(i, wheel::MY, f.my_n_m);
                f.mz_n_m = self.imports.wheel(i, wheel::MZ, f.mz_n_m);
            }
            s.tyre_force[i] = [f.fx_n, f.fy_n];
            let on_wheel = contact.x * f.fx_n + contact.y * f.fy_n + contact.n * fz;
            let couple = contact.x * f.mx_n_m + contact.y * f.my_n_m + contact.n * f.mz_n_m;
            let at_centre = contact.c.cross(&on_wheel) + couple;
            about_spin[i] = stations[i].s.dot(&at_centre);
            forces[i] = on_wheel;
            moments[i] = at_centre - stations[i].s * about_spin[i];
            let turning = stations[i].w - stations[i].s * stations[i].s.dot(&stations[i].w);
            tyre_forces[i] = f;
            load_n[i] = fz;
            // At the wheel all but the vertical spring's part: force along the normal by the contact's speed along it.
            let station = &stations[i];
            let lift = fz * (station.v + turning.cross(&contact.c)).dot(&contact.n);
            power_w[i] = on_wheel.dot(&station.v) + moments[i].dot(&station.w) + about_spin[i] * spin - lift;
        }

        if let Some(peer) = &self.peer {
            moment += peer.couple(&mut moments, &contacts, &tyre_forces, &to_earth);
        }

        // Spins: tyres, engine, differentials, brakes.
        self.brakes.advance(&mut s.brake_pressure, control.master_pa);
        let mut capacity = self.brakes.capacity_n_m(&s.brake_pressure, control.hand_brake);
        for (i, torque) in capacity.iter_mut().enumerate() {
            *torque = self.imports.wheel(i, wheel::BRAKE, *torque).max(0.0);
        }
        let spins = self.driveline.advance(
            &mut s.driveline,
            &mut s.spin,
            &about_spin,
            &capacity,
            control.throttle,
            input.gear_mode,
            self.outside.as_ref(),
            h,
        );

        // Suspension.
        let mut damper_n = [0.0; WHEELS];
        let lift = self.peer.as_ref().map_or([0.0; WHEELS], |p| p.lift_n(&tyre_forces, &to_earth));
        let loads: [StationLoad; WHEELS] = std::array::from_fn(|i| {
            let (axle, side) = (i / 2, i % 2);
            let suspension = &self.suspension[axle];
            let bar = suspension.bar_n(s.travel[2 * axle], s.travel[2 * axle + 1]);
            let (damper, damping) = suspension.damper_n(s.travel_rate[i]);
            damper_n[i] = damper;
            // The brake's reaction is on the knuckle, the drive shaft's on the body.
            moment -= stations[i].s * spins.drive_n_m[i];
            let f = &tyre_forces[i];
            suspension.deflect(side, &mut s.deflection[i], f.fx_n, f.fy_n, f.mz_n_m);
            StationLoad {
                force: forces[i],
                moment: moments[i] - stations[i].s * spins.brake_n_m[i],
                spin: s.spin[i],
                suspension: self.imports.wheel(
                    i,
                    wheel::SUSPENSION,
                    suspension.spring_n(side, s.travel[i])
                        + damper
                        + lift[i]
                        + if side == 0 { bar } else { -bar },
                ),
                damping,
            }
        });

        // Air.
        let wind = to_body * Vector3::new(input.wind_m_s[0], input.wind_m_s[1], 0.0);
        let (air_force, air_moment) = self.aerodynamics.wrench(&(motion.v - wind));
        for k in 0..3 {
            force[k] += self.imports.car(whole::FORCE + k, air_force[k]);
            moment[k] += self.imports.car(whole::MOMENT + k, air_moment[k]);
        }

        // The body's own contact, with the mean plane under the wheels.
        let mean = |f: &dyn Fn(usize) -> f64| 0.25 * (0..WHEELS).map(f).sum::<f64>();
        let (slope_x, slope_y) = (mean(&|i| input.road[i].slope_x), mean(&|i| input.road[i].slope_y));
        let norm = (1.0 + slope_x * slope_x + slope_y * slope_y).sqrt();
        let above = s.position.z
            - mean(&|i| input.road[i].height_m)
            - slope_x * (s.position.x - mean(&|i| control.over[i][0]))
            - slope_y * (s.position.y - mean(&|i| control.over[i][1]));
        let normal = to_body * Vector3::new(-slope_x / norm, -slope_y / norm, 1.0 / norm);
        let (hull_force, hull_moment) = self.hull.wrench(&normal, above / norm, &motion.v, &motion.w);
        force += hull_force;
        moment += hull_moment;

        // Motion.
        let acc =
            chassis::accelerations(&self.masses, &stations, &loads, &s.angular, &gravity, &force, &moment, h);
        let handed =
            [0, 1, 2, 3].map(|i| chassis::handed(&self.masses, i, &stations[i], &loads[i], &acc, &gravity));
        s.rack_force = handed[0].on_rack + handed[1].on_rack;
        s.velocity += to_earth * (acc.body * h);
        s.angular += acc.angular * h;
        for i in 0..WHEELS {
            s.travel_rate[i] += acc.travel[i] * h;
            s.travel[i] += s.travel_rate[i] * h;
        }
        s.position += s.velocity * h;
        s.attitude =
            s.attitude.then(spatial::EulerParameters::from_rotation_vector(&(s.angular * h))).normalised();
        Found {
            stations,
            contacts,
            tyre: tyre_forces,
            load_n,
            handed,
            spins,
            body: acc.body,
            angular: acc.angular,
            damper_n,
            steering_n_m,
            power_w,
        }
    }

    pub(crate) fn start_spins(&self, speed_m_s: f64) -> [f64; WHEELS] {
        let mut spin = [0.0; WHEELS];
        for i in 0..WHEELS {
            let radius = self.design[i].z + self.design_height_m;
            spin[i] = speed_m_s
                / self.tyres[i].effective_rolling_radius_m(4000.0, speed_m_s / radius, self.pressure_pa[i]);
        }
        spin
    }

    pub(crate) fn start_driveline(&mut self, mode: GearMode) {
        self.state.driveline = self.driveline.start(&self.state.spin, mode);
    }
}

/// What steering, throttle and brakes do during one step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Control {
    pub(crate) throttle: f64,
    pub(crate) master_pa: f64,
    pub(crate) hand_brake: f64,
    pub(crate) prescribed_rate: Option<f64>,
    pub(crate) wheel_from: f64,
    pub(crate) wheel_rate: f64,
    pub(crate) over: [[f64; 2]; WHEELS],
}

/// Cosine and sine of the heading of the body's x axis.
pub(crate) fn horizontal_forward(to_earth: &Matrix3<f64>) -> (f64, f64) {
    let (x, y) = (to_earth[(0, 0)], to_earth[(1, 0)]);
    let length = x.hypot(y);
    if length > 1e-9 { (x / length, y / length) } else { (1.0, 0.0) }
}

/// Suspension forces at the wheels that hold the car in its design pose on a level road.
///
/// Sprung weight over the axles by the lever law and over the sides likewise; then through the vertical equation of
/// each station, t·F − m_u g t_z = force along the travel, with the contact force straight up.
fn balanced_forces(
    m: &Masses,
    design: &[Vector3<f64>; WHEELS],
    height: [f64; WHEELS],
    kinematics: &[AxleKinematics; 2],
) -> [f64; WHEELS] {
    let weight = m.sprung_kg * GRAVITY_M_S2;
    let wheelbase = design[0].x - design[2].x;
    let axle = [weight * -design[2].x / wheelbase, weight * design[0].x / wheelbase];
    let still = Motion { v: Vector3::zeros(), w: Vector3::zeros(), rack: 0.0, rack_rate: 0.0 };
    std::array::from_fn(|i| {
        let (k, side) = (i / 2, i % 2);
        let track = design[2 * k].y - design[2 * k + 1].y;
        let share = if side == 0 { -design[2 * k + 1].y / track } else { design[2 * k].y / track };
        // The wheel station's own weight rests on the tyre; a cambered wheel touches beside its centre, and the
        // moment of that works through the camber change.
        let station = Station::new(&kinematics[k].sides[side], &design[i], 0.0, 0.0, &[0.0; 4], &still);
        let contact = Contact::new(&station, &Vector3::z(), height[i], 0.0);
        let load = Vector3::z() * (axle[k] * share + m.unsprung_kg[i] * GRAVITY_M_S2);
        let moment = contact.c.cross(&load);
        axle[k] * share + station.a.dot(&(moment - station.s * station.s.dot(&moment)))
    })
}
