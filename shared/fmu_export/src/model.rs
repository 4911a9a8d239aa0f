//! The models behind the C interface: variables by handle, start, step. No heap in a step.
//!
//! The car takes what `kingpin vehicle simulate` takes from a row: steering at the step's *end*, pedals and speed at its
//! beginning; a master that sets them so gets the same bits. Axes and signs ISO 8855.

use config::ResolvedCar;
use config::axle::Axle;
use multibody::{Suspension, SuspensionInput, SuspensionOutput};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use vehicle::{GearMode, Simulation, Vehicle, VehicleInput};

/// What an FMU is of: the content of `resources/model.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resource {
    /// A car, and the length of its step. [s]
    Car {
        /// All of its files.
        car: Box<ResolvedCar>,
        /// Length of a step. [s]
        step_s: f64,
    },
    /// A suspension, and the length of its step. [s]
    Suspension {
        /// Its hardpoints and elements.
        axle: Box<Axle>,
        /// Length of a step. [s]
        step_s: f64,
    },
}

impl Resource {
    /// Length of a step. [s]
    #[must_use]
    pub fn step_s(&self) -> f64 {
        match self {
            Resource::Car { step_s, .. } | Resource::Suspension { step_s, .. } => *step_s,
        }
    }
}

/// What a variable is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Fixed before the start.
    Parameter,
    /// Set before a step.
    Input,
    /// Read behind a step.
    Output,
}

/// Type of a variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// fmi2Real.
    Real,
    /// fmi2Integer.
    Integer,
    /// fmi2Boolean.
    Boolean,
}

/// A variable; its handle is its place in the list.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// For what.
    pub role: Role,
    /// Type.
    pub kind: Type,
    /// Unit, SI; `1` for numbers.
    pub unit: &'static str,
    /// Start value of parameters and inputs.
    pub start: f64,
    /// What it is.
    pub description: String,
}

/// Handles of the car's parameters and inputs.
mod car {
    pub const STEER_BY: usize = 0;
    pub const SPEED_CONTROL: usize = 1;
    pub const INITIAL_SPEED: usize = 2;
    pub const ROAD_WHEEL: usize = 3;
    pub const STEERING_WHEEL: usize = 4;
    pub const RACK: usize = 5;
    pub const TARGET_SPEED: usize = 6;
    pub const THROTTLE: usize = 7;
    pub const BRAKE: usize = 8;
    pub const OUTPUTS: usize = 9;
}

/// First output of the suspension; before it rack, its speed, then of each side height, speed, force and moment.
const SUSPENSION_OUTPUTS: usize = 2 + 2 * 8;

fn unit_of(column: &str) -> &'static str {
    let stem =
        ["_fl", "_fr", "_rl", "_rr"].iter().find_map(|wheel| column.strip_suffix(wheel)).unwrap_or(column);
    let ends: [(&str, &str); 10] = [
        ("_mps2", "m/s2"),
        ("_mps", "m/s"),
        ("_rps", "rad/s"),
        ("_rad", "rad"),
        ("_Nm", "N.m"),
        ("_N", "N"),
        ("_m", "m"),
        ("_pa", "Pa"),
        ("_s", "s"),
        ("yawrate", "rad/s"),
    ];
    if stem == "susp_defl_m" {
        return "m";
    }
    ends.iter().find(|(end, _)| stem.ends_with(end)).map_or("1", |(_, unit)| unit)
}

/// The variables of a model, in the order of their handles. The car's outputs are the columns of `vehicle simulate`.
#[must_use]
pub fn variables(resource: &Resource, columns: &[String]) -> Vec<Variable> {
    let of = |name: &str, role, kind, unit, start, description: &str| Variable {
        name: name.to_owned(),
        role,
        kind,
        unit,
        start,
        description: description.to_owned(),
    };
    use Role::{Input, Output, Parameter};
    use Type::{Boolean, Integer, Real};
    match resource {
        Resource::Car { .. } => {
            let mut all = vec![
                of("steer_by", Parameter, Integer, "1", 1.0, "0 road-wheel angle, 1 hand wheel, 2 rack"),
                of(
                    "speed_control",
                    Parameter,
                    Boolean,
                    "1",
                    1.0,
                    "the car holds target_speed_mps_in; else pedals",
                ),
                of("initial_speed_mps", Parameter, Real, "m/s", 0.0, "first speed where pedals drive"),
                of(
                    "delta_road_rad_in",
                    Input,
                    Real,
                    "rad",
                    0.0,
                    "mean angle of the front wheels at the step's end",
                ),
                of(
                    "steering_wheel_rad_in",
                    Input,
                    Real,
                    "rad",
                    0.0,
                    "hand-wheel angle at the step's end, + left",
                ),
                of("rack_disp_m_in", Input, Real, "m", 0.0, "rack displacement at the step's end, + left"),
                of("target_speed_mps_in", Input, Real, "m/s", 0.0, "speed to hold; negative: in reverse"),
                of("throttle_in", Input, Real, "1", 0.0, "0 to 1"),
                of("brake_pa_in", Input, Real, "Pa", 0.0, "master-cylinder pressure"),
            ];
            debug_assert_eq!(all.len(), car::OUTPUTS);
            // The first column is the time, which FMI has by itself.
            all.extend(columns.iter().skip(1).map(|column| {
                of(column, Output, Real, unit_of(column), 0.0, "as column of vehicle simulate")
            }));
            all
        }
        Resource::Suspension { .. } => {
            let mut all = vec![
                of("rack_m", Input, Real, "m", 0.0, "rack displacement, + left"),
                of("rack_speed_m_s", Input, Real, "m/s", 0.0, "its rate"),
            ];
            let sides = ["left", "right"];
            for side in sides {
                let mut add = |name: &str, unit, text| {
                    all.push(of(&format!("{name}_{side}"), Input, Real, unit, 0.0, text));
                };
                add("wheel_height_m", "m", "wheel-centre height relative to the body less design");
                add("wheel_speed_m_s", "m/s", "its rate");
                for axis in ["x", "y", "z"] {
                    add(
                        &format!("wheel_force_{axis}_n"),
                        "N",
                        "force of the wheel on the knuckle, knuckle frame",
                    );
                }
                for axis in ["x", "y", "z"] {
                    add(&format!("wheel_moment_{axis}_n_m"), "N.m", "moment of the wheel on the knuckle");
                }
            }
            debug_assert_eq!(all.len(), SUSPENSION_OUTPUTS);
            all.push(of("rack_force_n", Output, Real, "N", 0.0, "force the rack drive must apply, + left"));
            all.push(of("solver_status", Output, Real, "1", 0.0, "0 converged"));
            for side in sides {
                for (name, unit, text) in [
                    ("tie_rod_force_n", "N", "axial force of the tie rod, tension positive"),
                    ("steer_rad", "rad", "steer angle, + left"),
                    ("toe_rad", "rad", "toe, toe-in positive"),
                    ("camber_rad", "rad", "camber, top outward positive"),
                    ("caster_rad", "rad", "caster, top rearward positive"),
                    ("kingpin_inclination_rad", "rad", "kingpin inclination, top inward positive"),
                    ("kingpin_moment_n_m", "N.m", "moment of the wheel forces about the kingpin"),
                    ("wheel_centre_x_m", "m", "wheel centre, body frame"),
                    ("wheel_centre_y_m", "m", "wheel centre, body frame"),
                    ("wheel_centre_z_m", "m", "wheel centre, body frame"),
                ] {
                    all.push(of(&format!("{name}_{side}"), Output, Real, unit, 0.0, text));
                }
            }
            all
        }
    }
}

enum Physics {
    Car(Box<Vehicle>),
    Suspension(Box<(Suspension, SuspensionOutput)>),
}

/// An instance: values by handle and the physics.
pub struct Model {
    resource: Resource,
    variables: Vec<Variable>,
    values: Vec<f64>,
    row: Vec<f64>,
    physics: Physics,
    start_s: f64,
    steps: u64,
}

fn physics(resource: &Resource) -> Result<Physics, String> {
    match resource {
        Resource::Car { car, step_s } => assembly::build_car(car, *step_s)
            .map(|car| Physics::Car(Box::new(car)))
            .map_err(|e| e.to_string()),
        Resource::Suspension { axle, step_s } => {
            let mut suspension = Suspension::new(axle).map_err(|e| e.to_string())?;
            suspension.set_period(Some(*step_s));
            Ok(Physics::Suspension(Box::new((suspension, SuspensionOutput::default()))))
        }
    }
}

impl Model {
    /// Builds the physics of a resource.
    ///
    /// # Errors
    /// What is wrong with its files.
    pub fn new(resource: Resource) -> Result<Self, String> {
        let physics = physics(&resource)?;
        let columns = match &physics {
            Physics::Car(car) => Simulation::columns(car),
            Physics::Suspension(_) => Vec::new(),
        };
        let variables = variables(&resource, &columns);
        let mut model = Model {
            values: variables.iter().map(|variable| variable.start).collect(),
            row: Vec::with_capacity(columns.len()),
            variables,
            physics,
            resource,
            start_s: 0.0,
            steps: 0,
        };
        model.start(0.0);
        Ok(model)
    }

    /// The variables, in the order of their handles.
    #[must_use]
    pub fn variables(&self) -> &[Variable] {
        &self.variables
    }

    /// Everything as behind [`Self::new`].
    ///
    /// # Errors
    /// As there.
    pub fn reset(&mut self) -> Result<(), String> {
        self.physics = physics(&self.resource)?;
        for (value, variable) in self.values.iter_mut().zip(&self.variables) {
            *value = variable.start;
        }
        self.start(0.0);
        Ok(())
    }

    /// Settles the model at the inputs set, at a time. [s]
    pub fn start(&mut self, time_s: f64) {
        (self.start_s, self.steps) = (time_s, 0);
        let values = &self.values;
        match &mut self.physics {
            Physics::Car(car) => {
                let input = car_input(car, values, time_s);
                let control = values[car::SPEED_CONTROL] != 0.0;
                let speed = values[if control { car::TARGET_SPEED } else { car::INITIAL_SPEED }];
                car.reset(speed, &input);
            }
            Physics::Suspension(both) => {
                let (suspension, output) = &mut **both;
                suspension.reset();
                suspension.step(&suspension_input(values), output);
            }
        }
        self.put_out();
    }

    /// Steps by `length_s`, a multiple of the model's step. Whether the model's state stayed sound.
    ///
    /// # Errors
    /// A length that is none.
    pub fn step(&mut self, length_s: f64) -> Result<bool, &'static str> {
        let step_s = self.resource.step_s();
        let count = (length_s / step_s).round();
        if !(count >= 1.0 && (length_s - count * step_s).abs() <= 1e-6 * step_s * count && count < 1e6) {
            return Err("the step must be a multiple of the model's own");
        }
        let mut sound = true;
        for _ in 0..count as u64 {
            let values = &self.values;
            match &mut self.physics {
                Physics::Car(car) => {
                    // Counted, not summed, as `vehicle simulate` does.
                    let time_s = self.start_s + self.steps as f64 * step_s;
                    let held = car.output().held_steps;
                    let input = car_input(car, values, time_s);
                    car.step(&input);
                    sound &= car.output().held_steps == held;
                }
                Physics::Suspension(both) => {
                    let (suspension, output) = &mut **both;
                    suspension.step(&suspension_input(values), output);
                    sound &= output.status == multibody::Status::Converged;
                }
            }
            self.steps += 1;
        }
        self.put_out();
        Ok(sound)
    }

    /// The value of a handle of a type.
    #[must_use]
    pub fn get(&self, kind: Type, reference: u32) -> Option<f64> {
        let variable = self.variables.get(reference as usize)?;
        (variable.kind == kind).then(|| self.values[reference as usize])
    }

    /// Sets an input or, before the start, a parameter. Whether there is such a one and the value is finite.
    pub fn set(&mut self, kind: Type, reference: u32, value: f64, started: bool) -> bool {
        let fits = self.variables.get(reference as usize).is_some_and(|variable| {
            variable.kind == kind
                && match variable.role {
                    Role::Input => true,
                    Role::Parameter => !started,
                    Role::Output => false,
                }
        });
        if fits && value.is_finite() {
            self.values[reference as usize] = value;
            return true;
        }
        false
    }

    fn put_out(&mut self) {
        match &self.physics {
            Physics::Car(car) => {
                Simulation::values(car, 0.0, &mut self.row);
                self.values[car::OUTPUTS..].copy_from_slice(&self.row[1..]);
            }
            Physics::Suspension(both) => {
                let o = &both.1;
                let out = &mut self.values[SUSPENSION_OUTPUTS..];
                out[0] = o.rack_force_n;
                out[1] = f64::from(o.status.code());
                for (side, place) in o.side.iter().zip(out[2..].chunks_exact_mut(10)) {
                    place.copy_from_slice(&[
                        side.tie_rod_force_n,
                        side.steer_rad,
                        side.toe_rad,
                        side.camber_rad,
                        side.caster_rad,
                        side.kingpin_inclination_rad,
                        side.kingpin_moment_n_m,
                        side.wheel_centre_m.x,
                        side.wheel_centre_m.y,
                        side.wheel_centre_m.z,
                    ]);
                }
            }
        }
    }
}

fn car_input(vehicle: &Vehicle, values: &[f64], time_s: f64) -> VehicleInput {
    let mut input = VehicleInput { time_s, ..VehicleInput::default() };
    match values[car::STEER_BY] as i64 {
        0 => {
            let steer = values[car::ROAD_WHEEL];
            input.rack_displacement_m = Some(vehicle.kinematics()[0].rack_for_mean_steer_m(steer));
        }
        2 => input.rack_displacement_m = Some(values[car::RACK]),
        _ => input.steering_wheel_angle_rad = values[car::STEERING_WHEEL],
    }
    if values[car::SPEED_CONTROL] != 0.0 {
        let speed = values[car::TARGET_SPEED];
        input.target_speed_m_s = Some(speed);
        if speed < 0.0 {
            input.gear_mode = GearMode::Reverse;
        }
    } else {
        input.throttle = values[car::THROTTLE];
        input.brake_pressure_pa = values[car::BRAKE];
    }
    input
}

fn suspension_input(v: &[f64]) -> SuspensionInput {
    let side = |k: usize| &v[2 + 8 * k..10 + 8 * k];
    let vector = |v: &[f64]| Vector3::new(v[0], v[1], v[2]);
    SuspensionInput {
        rack_m: v[0],
        rack_speed_m_s: v[1],
        wheel_height_m: [side(0)[0], side(1)[0]],
        wheel_speed_m_s: [side(0)[1], side(1)[1]],
        wheel_force_n: [vector(&side(0)[2..5]), vector(&side(1)[2..5])],
        wheel_moment_n_m: [vector(&side(0)[5..8]), vector(&side(1)[5..8])],
    }
}
