//! A run of the car from a table of inputs to a table of results.
//!
//! Input columns: `t_s` (increasing), one of `delta_road_rad` (mean road-wheel angle), `steering_wheel_rad`,
//! `rack_disp_m`, and either `target_speed_mps` or `throttle` and `brake_pa` (then `initial_speed_mps` of the first row,
//! if there, is the starting speed; else the car starts at rest). Values run in straight lines between rows. The
//! car starts settled at the first row. One output row for each input row, the user's outputs last.
//! Axes and signs ISO 8855 and ISO-W; `susp_defl_m` is positive in rebound.

use crate::io::VehicleInput;
use crate::vehicle::Vehicle;
use config::{NumberTable, Problems};
use std::fmt::Write as _;

/// Nearer to a row than this share of the interval is on it.
const ON_A_ROW: f64 = 1e-9;

/// Longest run. [s]
const DURATION_MAX_S: f64 = 36000.0;

/// Columns of the output that are the car's.
const CAR_COLUMNS: [&str; 21] = [
    "t_s",
    "delta_road_rad",
    "steering_wheel_rad",
    "rack_disp_m",
    "rack_force_N",
    "v_x_mps",
    "v_y_mps",
    "x_m",
    "y_m",
    "z_cg_m",
    "yaw_rad",
    "yawrate_rps",
    "roll_rad",
    "rollrate_rps",
    "pitch_rad",
    "ay_cg_mps2",
    "ax_cg_mps2",
    "beta_rad",
    "throttle",
    "gear",
    "engine_rps",
];
/// Columns of each wheel, before its name.
const WHEEL_COLUMNS: [&str; 13] = [
    "alpha_rad",
    "kappa",
    "camber_rad",
    "Fx_N",
    "Fy_N",
    "Fz_N",
    "Mx_Nm",
    "My_Nm",
    "Mz_Nm",
    "omega_rps",
    "steer_rad",
    "wc_z_m",
    "susp_defl_m",
];

const STEERS: [(&str, SteerBy); 3] = [
    ("delta_road_rad", SteerBy::RoadWheel),
    ("steering_wheel_rad", SteerBy::SteeringWheel),
    ("rack_disp_m", SteerBy::Rack),
];

#[derive(Debug, Clone, Copy, PartialEq)]
enum SteerBy {
    RoadWheel,
    SteeringWheel,
    Rack,
}

#[derive(Debug, Clone)]
enum Longitudinal {
    Speed(Vec<f64>),
    Pedals { throttle: Vec<f64>, brake_pa: Vec<f64>, initial_m_s: f64 },
}

/// A table of inputs being driven through.
#[derive(Debug, Clone)]
pub struct Simulation {
    time: Vec<f64>,
    by: SteerBy,
    steer: Vec<f64>,
    longitudinal: Longitudinal,
    ignored: Vec<String>,
    /// Next row to give.
    row: usize,
    /// Steps done.
    n: u64,
    /// Rows whose steering was not reached.
    unreached: usize,
}

impl Simulation {
    /// Reads and checks the CSV text `input`; `file` is its name in messages.
    ///
    /// # Errors
    /// Every violation: missing or contradicting columns, cells that are not finite numbers, times that do not
    /// increase.
    pub fn read(input: &str, file: &str) -> Result<Self, Problems> {
        let optional = [
            "delta_road_rad",
            "steering_wheel_rad",
            "rack_disp_m",
            "target_speed_mps",
            "throttle",
            "brake_pa",
            "initial_speed_mps",
        ];
        let table = NumberTable::read(input, file, &["t_s"], &optional)?;
        let mut problems = Problems::default();
        let column = |name: &str| table.column(name).map(<[f64]>::to_vec);
        let mut steers = STEERS.iter().filter_map(|(name, by)| column(name).map(|values| (*by, values)));
        let (steer, second) = (steers.next(), steers.next());
        if steer.is_none() || second.is_some() {
            let rule = "exactly one of delta_road_rad, steering_wheel_rad, rack_disp_m must be a column";
            problems.push(table.violation_of_header(rule));
        }
        let longitudinal = match (column("target_speed_mps"), column("throttle"), column("brake_pa")) {
            (Some(speed), None, None) => Some(Longitudinal::Speed(speed)),
            (None, Some(throttle), Some(brake_pa)) => {
                let initial_m_s = table.column("initial_speed_mps").map_or(0.0, |values| values[0]);
                Some(Longitudinal::Pedals { throttle, brake_pa, initial_m_s })
            }
            _ => {
                let rule = "either target_speed_mps, or both throttle and brake_pa, must be columns";
                problems.push(table.violation_of_header(rule));
                None
            }
        };
        let time = column("t_s").unwrap_or_default();
        for row in 1..time.len() {
            if time[row] <= time[row - 1] {
                problems.push(table.violation(row, "t_s", "must increase from row to row"));
            }
        }
        if time.len() < 2 {
            problems.push(table.violation_of_header("must have at least two rows"));
        } else if time[time.len() - 1] - time[0] > DURATION_MAX_S {
            problems.push(table.violation(time.len() - 1, "t_s", "must not span more than ten hours"));
        }
        for (name, low, high, rule) in [
            ("throttle", 0.0, 1.0, "must be in [0, 1]"),
            ("brake_pa", 0.0, 1e8, "must be in [0, 1e8] Pa"),
            ("target_speed_mps", -10.0, 120.0, "must be in [-10, 120] m/s"),
            ("initial_speed_mps", -10.0, 120.0, "must be in [-10, 120] m/s"),
        ] {
            for (row, value) in table.column(name).into_iter().flatten().enumerate() {
                if !(low..=high).contains(value) {
                    problems.push(table.violation(row, name, rule));
                }
            }
        }
        match (steer, longitudinal) {
            (Some((by, steer)), Some(longitudinal)) if problems.is_empty() => Ok(Self {
                time,
                by,
                steer,
                longitudinal,
                ignored: table.ignored().to_vec(),
                row: 0,
                n: 0,
                unreached: 0,
            }),
            _ => Err(problems),
        }
    }

    /// Columns of the table that were not read.
    #[must_use]
    pub fn ignored(&self) -> &[String] {
        &self.ignored
    }

    /// Rows so far at which the rack was not where the table wants it: beyond its stop, or faster than it follows.
    #[must_use]
    pub fn unreached(&self) -> usize {
        self.unreached
    }

    /// Rows in all.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.time.len()
    }

    /// Names of the values of a row.
    #[must_use]
    pub fn columns(vehicle: &Vehicle) -> Vec<String> {
        let wheels = ["fl", "fr", "rl", "rr"];
        let of_wheels = wheels.iter().flat_map(|w| WHEEL_COLUMNS.iter().map(move |c| format!("{c}_{w}")));
        let own = vehicle.equations().map_or(&[][..], |equations| equations.outputs());
        let car = CAR_COLUMNS.iter().map(|c| (*c).to_owned());
        car.chain(of_wheels).chain(own.iter().map(|o| o.name.clone())).collect()
    }

    /// Drives `vehicle` to the next row and puts its values into `values`; false at the end. The first call settles the
    /// car at the first row.
    pub fn next_row(&mut self, vehicle: &mut Vehicle, values: &mut Vec<f64>) -> bool {
        let step = vehicle.step_s();
        let first = self.time[0];
        if self.row >= self.time.len() {
            return false;
        }
        if self.row == 0 {
            let input = self.input(vehicle, 0, first - step, step);
            let speed = match &self.longitudinal {
                Longitudinal::Speed(speed) => speed[0],
                Longitudinal::Pedals { initial_m_s, .. } => *initial_m_s,
            };
            vehicle.reset(speed, &VehicleInput { time_s: first, ..input });
        } else {
            // Times of steps are counted, not summed, so that they do not drift.
            while first + (self.n as f64 + 0.5) * step < self.time[self.row] {
                let input = self.input(vehicle, self.row - 1, first + self.n as f64 * step, step);
                vehicle.step(&input);
                self.n += 1;
            }
        }
        let (asked, rack) = (self.steer[self.row], vehicle.output().rack_displacement_m);
        self.unreached += usize::from(match self.by {
            SteerBy::Rack => (asked - rack).abs() > 1e-6,
            SteerBy::RoadWheel => {
                let sides = &vehicle.kinematics()[0].sides;
                (asked - 0.5 * (sides[0].steer_rad(0.0, rack) + sides[1].steer_rad(0.0, rack))).abs() > 1e-5
            }
            SteerBy::SteeringWheel => false,
        });
        put_row(vehicle, self.time[self.row], values);
        self.row += 1;
        true
    }

    /// A row of results of `vehicle` at `time_s`, in the order of [`Self::columns`].
    pub fn values(vehicle: &Vehicle, time_s: f64, values: &mut Vec<f64>) {
        put_row(vehicle, time_s, values);
    }

    fn value(&self, column: &[f64], row: usize, t: f64) -> f64 {
        let next = (row + 1).min(self.time.len() - 1);
        let span = self.time[next] - self.time[row];
        let w = if span > 0.0 { ((t - self.time[row]) / span).clamp(0.0, 1.0) } else { 0.0 };
        // A step that ends on a row has that row's value, whatever the last digit of its time.
        match w {
            w if w > 1.0 - ON_A_ROW => column[next],
            w if w < ON_A_ROW => column[row],
            w => column[row] + w * (column[next] - column[row]),
        }
    }

    /// Inputs of a step that begins at `t` and ends one `step` later, in the row's interval.
    fn input(&self, vehicle: &Vehicle, row: usize, t: f64, step: f64) -> VehicleInput {
        let steer = self.value(&self.steer, row, t + step);
        let mut input = VehicleInput { time_s: t, ..VehicleInput::default() };
        match self.by {
            SteerBy::RoadWheel => {
                input.rack_displacement_m = Some(vehicle.kinematics()[0].rack_for_mean_steer_m(steer));
            }
            SteerBy::SteeringWheel => input.steering_wheel_angle_rad = steer,
            SteerBy::Rack => input.rack_displacement_m = Some(steer),
        }
        match &self.longitudinal {
            Longitudinal::Speed(speed) => input.target_speed_m_s = Some(self.value(speed, row, t)),
            Longitudinal::Pedals { throttle, brake_pa, .. } => {
                input.throttle = self.value(throttle, row, t);
                input.brake_pressure_pa = self.value(brake_pa, row, t);
            }
        }
        if matches!(&self.longitudinal, Longitudinal::Speed(speed) if speed[row] < 0.0) {
            input.gear_mode = crate::io::GearMode::Reverse;
        }
        input
    }
}

/// Drives `vehicle` by the whole of a table; `file` is its name in messages.
///
/// # Errors
/// As [`Simulation::read`].
pub fn simulate_csv(vehicle: &mut Vehicle, input: &str, file: &str) -> Result<String, Problems> {
    let mut simulation = Simulation::read(input, file)?;
    let mut out = Simulation::columns(vehicle).join(",");
    out.push('\n');
    let mut values = Vec::new();
    while simulation.next_row(vehicle, &mut values) {
        let mut separator = "";
        for value in &values {
            // Writing to a string cannot fail.
            let _ = write!(out, "{separator}{value}");
            separator = ",";
        }
        out.push('\n');
    }
    Ok(out)
}

fn put_row(vehicle: &Vehicle, time: f64, values: &mut Vec<f64>) {
    let o = vehicle.output();
    let mean_steer = 0.5 * (o.wheels[0].kinematic_steer_rad + o.wheels[1].kinematic_steer_rad);
    values.clear();
    values.extend([
        time,
        mean_steer,
        o.steering_wheel_angle_rad,
        o.rack_displacement_m,
        o.rack_force_n,
        o.horizontal_velocity_m_s[0],
        o.horizontal_velocity_m_s[1],
        o.position_m[0],
        o.position_m[1],
        o.position_m[2],
        o.yaw_rad,
        o.yaw_rate_rad_s,
        o.roll_rad,
        o.angular_velocity_rad_s[0],
        o.pitch_rad,
        o.lateral_acceleration_cg_m_s2,
        o.longitudinal_acceleration_m_s2,
        o.side_slip_angle_rad,
        o.throttle,
        f64::from(o.gear),
        o.engine_speed_rad_s,
    ]);
    for w in &o.wheels {
        values.extend([
            w.slip_angle_rad,
            w.slip_ratio,
            w.inclination_rad,
            w.fx_n,
            w.fy_n,
            w.fz_n,
            w.mx_n_m,
            w.my_n_m,
            w.mz_n_m,
            w.spin_rad_s,
            w.steer_rad,
            w.centre_position_m[2],
            -w.travel_m,
        ]);
    }
    values.extend_from_slice(vehicle.equations().map_or(&[], |equations| equations.values()));
}
