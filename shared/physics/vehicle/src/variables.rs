//! The model's named variables: what can be exported, what can be imported (spec 1.6, Tables 2.6 and 2.7).
//!
//! An import changes a variable inside the step: ADD to it, MULTIPLY it, REPLACE it. Names are resolved once, to
//! indices; setting and applying touch no heap. Imports are inputs, not state: whoever restores a checkpoint sets them
//! again. Wheels are named fl, fr, rl, rr.

use crate::io::{VehicleOutput, WHEELS};

/// What an import does to the variable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImportMode {
    /// The import is added to the model's value.
    Add,
    /// The model's value is multiplied by the import.
    Multiply,
    /// The import takes the place of the model's value.
    Replace,
}

/// A variable of the model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Variable {
    /// Name, with its unit.
    pub name: String,
    /// Unit, SI.
    pub unit: &'static str,
    /// What it is.
    pub description: &'static str,
}

/// Variables of the whole car that can be imported, in the order of their indices.
const CAR_IMPORTS: [(&str, &str, &str); 14] = [
    ("steering_wheel_angle_rad", "rad", "steering-wheel angle, left positive"),
    ("rack_displacement_m", "m", "rack displacement, left positive; ADD and MULTIPLY need one to act on"),
    ("throttle", "1", "throttle, 0 to 1, before the speed controller's replaces it"),
    ("brake_pressure_pa", "Pa", "master pressure of the driver"),
    (
        "external_force_x_n",
        "N",
        "air and external force on the body along x, at the sprung centre of gravity",
    ),
    (
        "external_force_y_n",
        "N",
        "air and external force on the body along y, at the sprung centre of gravity",
    ),
    (
        "external_force_z_n",
        "N",
        "air and external force on the body along z, at the sprung centre of gravity",
    ),
    ("external_moment_x_n_m", "N*m", "air and external moment on the body about x"),
    ("external_moment_y_n_m", "N*m", "air and external moment on the body about y"),
    ("external_moment_z_n_m", "N*m", "air and external moment on the body about z"),
    (
        "target_speed_m_s",
        "m/s",
        "speed for the controller to hold; REPLACE puts it to work, the others need one",
    ),
    ("hand_brake", "1", "pull of the hand brake, 0 to 1"),
    ("wind_x_m_s", "m/s", "velocity of the air over ground, earth x"),
    ("wind_y_m_s", "m/s", "velocity of the air over ground, earth y"),
];

/// Variables of one wheel that can be imported.
const WHEEL_IMPORTS: [(&str, &str, &str); 13] = [
    ("steer_rad", "rad", "rotation of the knuckle about the body's z, left positive"),
    ("inclination_rad", "rad", "rotation of the knuckle about x, top to the right positive"),
    ("friction", "1", "friction of the road relative to the tyre's test surface"),
    ("tyre_fz_n", "N", "vertical tyre force"),
    ("tyre_fx_n", "N", "longitudinal tyre force"),
    ("tyre_fy_n", "N", "lateral tyre force, left positive"),
    ("tyre_mx_n_m", "N*m", "overturning moment"),
    ("tyre_my_n_m", "N*m", "rolling resistance moment"),
    ("tyre_mz_n_m", "N*m", "aligning moment"),
    ("suspension_force_n", "N", "spring, stops, damper and anti-roll bar at the wheel, compression positive"),
    ("brake_capacity_n_m", "N*m", "largest friction torque of the brake"),
    ("road_height_m", "m", "height of the road under the wheel, earth z"),
    ("brake_line_pressure_pa", "Pa", "pressure asked of the wheel's brake, before its lag"),
];

/// The places of a wheel's imports.
pub(crate) mod wheel {
    pub const STEER: usize = 0;
    pub const INCLINATION: usize = 1;
    pub const FRICTION: usize = 2;
    pub const FZ: usize = 3;
    pub const FX: usize = 4;
    pub const FY: usize = 5;
    pub const MX: usize = 6;
    pub const MY: usize = 7;
    pub const MZ: usize = 8;
    pub const SUSPENSION: usize = 9;
    pub const BRAKE: usize = 10;
    pub const ROAD_HEIGHT: usize = 11;
    pub const BRAKE_LINE: usize = 12;
}

/// The places of the car's imports.
pub(crate) mod whole {
    pub const STEERING_WHEEL: usize = 0;
    pub const RACK: usize = 1;
    pub const THROTTLE: usize = 2;
    pub const BRAKE: usize = 3;
    pub const FORCE: usize = 4;
    pub const MOMENT: usize = 7;
    pub const TARGET_SPEED: usize = 10;
    pub const HAND_BRAKE: usize = 11;
    pub const WIND: usize = 12;
}

const WHEEL_NAMES: [&str; WHEELS] = ["fl", "fr", "rl", "rr"];
const IMPORTS: usize = CAR_IMPORTS.len() + WHEELS * WHEEL_IMPORTS.len();

/// A resolved import.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImportId(usize);

/// The imports in force.
#[derive(Debug, Clone, PartialEq)]
pub struct Imports {
    active: bool,
    slots: [Option<(ImportMode, f64)>; IMPORTS],
}

impl Default for Imports {
    fn default() -> Self {
        Self { active: false, slots: [None; IMPORTS] }
    }
}

impl Imports {
    /// Every variable that can be imported.
    #[must_use]
    pub fn variables() -> Vec<Variable> {
        let car = CAR_IMPORTS.iter().map(|(name, unit, description)| Variable {
            name: (*name).to_owned(),
            unit,
            description,
        });
        let wheels = WHEEL_NAMES.iter().flat_map(|w| {
            WHEEL_IMPORTS.iter().map(move |(name, unit, description)| Variable {
                name: format!("{name}_{w}"),
                unit,
                description,
            })
        });
        car.chain(wheels).collect()
    }

    /// The import of a name, if there is such a variable.
    #[must_use]
    pub fn find(name: &str) -> Option<ImportId> {
        Self::variables().iter().position(|v| v.name == name).map(ImportId)
    }

    /// Sets an import. A value that is not finite clears it.
    pub fn set(&mut self, id: ImportId, mode: ImportMode, value: f64) {
        self.slots[id.0] = value.is_finite().then_some((mode, value));
        self.active = self.slots.iter().any(Option::is_some);
    }

    /// Ends an import.
    pub fn clear(&mut self, id: ImportId) {
        self.slots[id.0] = None;
        self.active = self.slots.iter().any(Option::is_some);
    }

    /// Whether any import is in force.
    pub(crate) fn active(&self) -> bool {
        self.active
    }

    fn act(slot: Option<(ImportMode, f64)>, value: f64) -> f64 {
        match slot {
            None => value,
            Some((ImportMode::Add, v)) => value + v,
            Some((ImportMode::Multiply, v)) => value * v,
            Some((ImportMode::Replace, v)) => v,
        }
    }

    #[inline]
    pub(crate) fn car(&self, place: usize, value: f64) -> f64 {
        if self.active { Self::act(self.slots[place], value) } else { value }
    }

    /// What a REPLACE puts in place of an absent value.
    pub(crate) fn replacement(&self, place: usize) -> Option<f64> {
        match self.slots[place] {
            Some((ImportMode::Replace, v)) => Some(v),
            _ => None,
        }
    }

    #[inline]
    pub(crate) fn wheel(&self, wheel: usize, place: usize, value: f64) -> f64 {
        if self.active {
            Self::act(self.slots[CAR_IMPORTS.len() + wheel * WHEEL_IMPORTS.len() + place], value)
        } else {
            value
        }
    }
}

type Getter = fn(&VehicleOutput, usize) -> f64;

/// Exports of the whole car: name, unit, description, how to get it.
const CAR_EXPORTS: &[(&str, &str, &str, Getter)] = &[
    ("time_s", "s", "time at the end of the step", |o, _| o.time_s),
    ("position_x_m", "m", "centre of gravity, earth x", |o, _| o.position_m[0]),
    ("position_y_m", "m", "centre of gravity, earth y", |o, _| o.position_m[1]),
    ("position_z_m", "m", "centre of gravity, earth z", |o, _| o.position_m[2]),
    ("roll_rad", "rad", "roll, right side down positive", |o, _| o.roll_rad),
    ("pitch_rad", "rad", "pitch, nose down positive", |o, _| o.pitch_rad),
    ("yaw_rad", "rad", "yaw, counted on past a half turn", |o, _| o.yaw_rad),
    ("velocity_x_m_s", "m/s", "velocity of the centre of gravity, body x", |o, _| o.velocity_m_s[0]),
    ("velocity_y_m_s", "m/s", "velocity of the centre of gravity, body y", |o, _| o.velocity_m_s[1]),
    ("velocity_z_m_s", "m/s", "velocity of the centre of gravity, body z", |o, _| o.velocity_m_s[2]),
    ("speed_forward_m_s", "m/s", "horizontal speed along the heading", |o, _| o.horizontal_velocity_m_s[0]),
    ("speed_left_m_s", "m/s", "horizontal speed to the left of the heading", |o, _| {
        o.horizontal_velocity_m_s[1]
    }),
    ("roll_rate_rad_s", "rad/s", "angular velocity about body x", |o, _| o.angular_velocity_rad_s[0]),
    ("pitch_rate_rad_s", "rad/s", "angular velocity about body y", |o, _| o.angular_velocity_rad_s[1]),
    ("body_yaw_rate_rad_s", "rad/s", "angular velocity about body z", |o, _| o.angular_velocity_rad_s[2]),
    ("yaw_rate_rad_s", "rad/s", "rate of the yaw angle", |o, _| o.yaw_rate_rad_s),
    ("longitudinal_acceleration_m_s2", "m/s^2", "horizontal, forward", |o, _| {
        o.longitudinal_acceleration_m_s2
    }),
    ("lateral_acceleration_m_s2", "m/s^2", "horizontal, to the left, at the accelerometer", |o, _| {
        o.lateral_acceleration_m_s2
    }),
    ("lateral_acceleration_cg_m_s2", "m/s^2", "horizontal, to the left, at the centre of gravity", |o, _| {
        o.lateral_acceleration_cg_m_s2
    }),
    ("vertical_acceleration_m_s2", "m/s^2", "of the centre of gravity, earth z", |o, _| {
        o.vertical_acceleration_m_s2
    }),
    ("accelerometer_x_m_s2", "m/s^2", "reading of the body-fixed accelerometer, x", |o, _| {
        o.accelerometer_m_s2[0]
    }),
    ("accelerometer_y_m_s2", "m/s^2", "reading of the body-fixed accelerometer, y", |o, _| {
        o.accelerometer_m_s2[1]
    }),
    ("accelerometer_z_m_s2", "m/s^2", "reading of the body-fixed accelerometer, z", |o, _| {
        o.accelerometer_m_s2[2]
    }),
    ("side_slip_angle_rad", "rad", "side-slip angle at the centre of gravity", |o, _| o.side_slip_angle_rad),
    ("throttle_in_effect", "1", "throttle in effect", |o, _| o.throttle),
    ("master_pressure_pa", "Pa", "master pressure in effect", |o, _| o.master_pressure_pa),
    ("gear", "1", "gear, 0 neutral, -1 reverse", |o, _| f64::from(o.gear)),
    ("engine_speed_rad_s", "rad/s", "engine speed", |o, _| o.engine_speed_rad_s),
    ("engine_torque_n_m", "N*m", "engine torque", |o, _| o.engine_torque_n_m),
    ("steering_wheel_angle_shown_rad", "rad", "steering-wheel angle", |o, _| o.steering_wheel_angle_rad),
    ("steering_torque_n_m", "N*m", "torsion-bar torque of the car's own steering", |o, _| {
        o.steering_torque_n_m
    }),
    ("rack_displacement_shown_m", "m", "rack displacement", |o, _| o.rack_displacement_m),
    ("rack_force_n", "N", "force of the front wheels on the rack, left positive", |o, _| o.rack_force_n),
    ("kingpin_moment_left_n_m", "N*m", "moment about the left kingpin, turning left positive", |o, _| {
        o.kingpin_moment_n_m[0]
    }),
    ("kingpin_moment_right_n_m", "N*m", "moment about the right kingpin, turning left positive", |o, _| {
        o.kingpin_moment_n_m[1]
    }),
];

/// Exports of one wheel.
const WHEEL_EXPORTS: &[(&str, &str, &str, Getter)] = &[
    ("fx_n", "N", "longitudinal tyre force", |o, i| o.wheels[i].fx_n),
    ("fy_n", "N", "lateral tyre force, left positive", |o, i| o.wheels[i].fy_n),
    ("fz_n", "N", "vertical tyre force", |o, i| o.wheels[i].fz_n),
    ("mx_n_m", "N*m", "overturning moment", |o, i| o.wheels[i].mx_n_m),
    ("my_n_m", "N*m", "rolling resistance moment", |o, i| o.wheels[i].my_n_m),
    ("mz_n_m", "N*m", "aligning moment", |o, i| o.wheels[i].mz_n_m),
    ("slip_ratio", "1", "longitudinal slip, driving positive", |o, i| o.wheels[i].slip_ratio),
    ("slip_angle_rad", "rad", "slip angle, ISO-W", |o, i| o.wheels[i].slip_angle_rad),
    ("centre_force_x_n", "N", "force on the knuckle at the wheel centre, knuckle x", |o, i| {
        o.wheels[i].centre_force_n[0]
    }),
    ("centre_force_y_n", "N", "force on the knuckle at the wheel centre, knuckle y", |o, i| {
        o.wheels[i].centre_force_n[1]
    }),
    ("centre_force_z_n", "N", "force on the knuckle at the wheel centre, knuckle z", |o, i| {
        o.wheels[i].centre_force_n[2]
    }),
    ("centre_moment_x_n_m", "N*m", "moment on the knuckle at the wheel centre, knuckle x", |o, i| {
        o.wheels[i].centre_moment_n_m[0]
    }),
    ("centre_moment_y_n_m", "N*m", "moment on the knuckle at the wheel centre, knuckle y", |o, i| {
        o.wheels[i].centre_moment_n_m[1]
    }),
    ("centre_moment_z_n_m", "N*m", "moment on the knuckle at the wheel centre, knuckle z", |o, i| {
        o.wheels[i].centre_moment_n_m[2]
    }),
    ("centre_height_m", "m", "height of the wheel centre, earth z", |o, i| o.wheels[i].centre_position_m[2]),
    ("travel_m", "m", "wheel-centre height relative to the body less design", |o, i| o.wheels[i].travel_m),
    ("vertical_velocity_m_s", "m/s", "of the wheel centre, earth z", |o, i| {
        o.wheels[i].vertical_velocity_m_s
    }),
    ("vertical_acceleration_m_s2", "m/s^2", "of the wheel centre, earth z", |o, i| {
        o.wheels[i].vertical_acceleration_m_s2
    }),
    ("brake_torque_n_m", "N*m", "brake torque on the wheel", |o, i| o.wheels[i].brake_torque_n_m),
    ("drive_torque_n_m", "N*m", "drive-shaft torque on the wheel", |o, i| o.wheels[i].drive_torque_n_m),
    ("brake_pressure_pa", "Pa", "wheel brake pressure", |o, i| o.wheels[i].brake_pressure_pa),
    ("road_inclination_rad", "rad", "inclination to the road, ISO-W", |o, i| o.wheels[i].inclination_rad),
    ("camber_rad", "rad", "camber relative to the body, top outward positive", |o, i| o.wheels[i].camber_rad),
    ("heading_rad", "rad", "heading relative to the body, left positive", |o, i| o.wheels[i].steer_rad),
    ("spin_rad_s", "rad/s", "spin speed", |o, i| o.wheels[i].spin_rad_s),
    ("spring_force_n", "N", "spring and stops at the wheel", |o, i| o.wheels[i].spring_force_n),
    ("damper_force_n", "N", "damper at the wheel, bump positive", |o, i| o.wheels[i].damper_force_n),
    ("loaded_radius_m", "m", "loaded radius", |o, i| o.wheels[i].loaded_radius_m),
    ("tyre_power_w", "W", "power of the tyre's forces on the car, negative: taken", |o, i| {
        o.wheels[i].tyre_power_w
    }),
];

/// A resolved export.
#[derive(Debug, Clone, Copy)]
pub struct ExportId(Getter, usize);

/// The variables that can be exported.
#[derive(Debug, Clone, Copy)]
pub struct Exports;

impl Exports {
    /// Every variable that can be exported.
    #[must_use]
    pub fn variables() -> Vec<Variable> {
        Self::all().into_iter().map(|(variable, _)| variable).collect()
    }

    fn all() -> Vec<(Variable, ExportId)> {
        let mut out = Vec::new();
        for (name, unit, description, get) in CAR_EXPORTS {
            out.push((Variable { name: (*name).to_owned(), unit, description }, ExportId(*get, 0)));
        }
        for (i, w) in WHEEL_NAMES.iter().enumerate() {
            for (name, unit, description, get) in WHEEL_EXPORTS {
                out.push((Variable { name: format!("{name}_{w}"), unit, description }, ExportId(*get, i)));
            }
        }
        out
    }

    /// The export of a name, if there is such a variable.
    #[must_use]
    pub fn find(name: &str) -> Option<ExportId> {
        Self::all().into_iter().find(|(v, _)| v.name == name).map(|(_, id)| id)
    }

    /// The value of an export.
    #[must_use]
    pub fn get(id: ExportId, output: &VehicleOutput) -> f64 {
        (id.0)(output, id.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_resolve() {
        let mut names: Vec<String> =
            Imports::variables().into_iter().chain(Exports::variables()).map(|v| v.name).collect();
        assert!(names.iter().all(|n| Imports::find(n).is_some() != Exports::find(n).is_some()));
        let count = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), count, "two variables of one name");
        let output = VehicleOutput { roll_rad: 0.25, ..VehicleOutput::default() };
        assert_eq!(Exports::find("roll_rad").map(|id| Exports::get(id, &output)), Some(0.25));
        assert!(Imports::find("roll_rad").is_none());
    }

    #[test]
    fn modes_add_multiply_and_replace() {
        let mut imports = Imports::default();
        let id = Imports::find("tyre_fy_n_rl").unwrap();
        assert_eq!(imports.wheel(2, wheel::FY, 10.0), 10.0);
        imports.set(id, ImportMode::Add, 5.0);
        assert_eq!(imports.wheel(2, wheel::FY, 10.0), 15.0);
        imports.set(id, ImportMode::Multiply, 0.5);
        assert_eq!(imports.wheel(2, wheel::FY, 10.0), 5.0);
        imports.set(id, ImportMode::Replace, -1.0);
        assert_eq!((imports.wheel(2, wheel::FY, 10.0), imports.wheel(3, wheel::FY, 10.0)), (-1.0, 10.0));
        imports.clear(id);
        assert!(!imports.active());
    }
}
