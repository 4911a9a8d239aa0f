//! A run of the car from a table of inputs to a table of results, both CSV text.
//!
//! Input columns: `t_s` (increasing), one of `delta_road_rad` (mean road-wheel angle), `steering_wheel_rad`,
//! `rack_disp_m`, and either `target_speed_mps` or `throttle` and `brake_pa` (then `initial_speed_mps` of the first row,
//! if there, is the starting speed; else the car starts at rest). Values run in straight lines between rows. The
//! car starts settled at the first row. One output row for each input row.
//! Axes and signs ISO 8855 and ISO-W; `susp_defl_m` is positive in rebound.

use crate::io::VehicleInput;
use crate::vehicle::Vehicle;
use std::fmt;
use std::fmt::Write as _;

/// One thing wrong with an input table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SimulateError {
    /// Line of the text, from 1; the header is line 1.
    pub line: usize,
    /// Column, empty when the whole line is meant.
    pub column: String,
    /// The value as written.
    pub value: String,
    /// The rule that is broken.
    pub rule: String,
}

impl fmt::Display for SimulateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.column)?;
        if !self.value.is_empty() {
            write!(f, " = {}", self.value)?;
        }
        write!(f, ": {}", self.rule)
    }
}

impl std::error::Error for SimulateError {}

/// Violations beyond this number are not collected.
const ERRORS_MAX: usize = 100;
/// Longest run. [s]
const DURATION_MAX_S: f64 = 36000.0;

/// Columns of the output that are the car's.
const CAR_COLUMNS: &str = "t_s,delta_road_rad,steering_wheel_rad,rack_disp_m,rack_force_N,v_x_mps,v_y_mps,x_m,y_m,\
z_cg_m,yaw_rad,yawrate_rps,roll_rad,rollrate_rps,pitch_rad,ay_cg_mps2,ax_cg_mps2,beta_rad,throttle,gear,engine_rps";
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

#[derive(Debug, Clone, Copy, PartialEq)]
enum SteerBy {
    RoadWheel,
    SteeringWheel,
    Rack,
}

struct Columns {
    time: Vec<f64>,
    steer: Vec<f64>,
    by: SteerBy,
    speed: Option<Vec<f64>>,
    throttle: Vec<f64>,
    brake: Vec<f64>,
    initial: f64,
}

/// Reads and checks the whole table.
fn read(text: &str) -> Result<Columns, Vec<SimulateError>> {
    let mut errors = Vec::new();
    let broken = |line: usize, column: &str, value: &str, rule: &str| SimulateError {
        line,
        column: column.to_owned(),
        value: value.to_owned(),
        rule: rule.to_owned(),
    };
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let header = match reader.headers() {
        Ok(header) => header.clone(),
        Err(e) => return Err(vec![broken(1, "", "", &e.to_string())]),
    };
    let at = |name: &str| header.iter().position(|h| h == name);
    let steers = [
        ("delta_road_rad", SteerBy::RoadWheel),
        ("steering_wheel_rad", SteerBy::SteeringWheel),
        ("rack_disp_m", SteerBy::Rack),
    ];
    let given: Vec<_> = steers.iter().filter(|(name, _)| at(name).is_some()).collect();
    if at("t_s").is_none() {
        errors.push(broken(1, "t_s", "", "missing column"));
    }
    if given.len() != 1 {
        let rule = "exactly one of delta_road_rad, steering_wheel_rad, rack_disp_m must be a column";
        errors.push(broken(1, "", "", rule));
    }
    if at("target_speed_mps").is_some() == at("throttle").is_some() {
        errors.push(broken(1, "", "", "either target_speed_mps, or throttle and brake_pa, must be columns"));
    } else if at("throttle").is_some() && at("brake_pa").is_none() {
        errors.push(broken(1, "brake_pa", "", "missing column, it goes with throttle"));
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let names = ["t_s", given[0].0, "target_speed_mps", "throttle", "brake_pa", "initial_speed_mps"];
    let mut values: [Vec<f64>; 6] = Default::default();
    for record in reader.records() {
        if errors.len() >= ERRORS_MAX {
            break;
        }
        let record = match record {
            Ok(record) => record,
            Err(e) => {
                let line = e.position().map_or(0, |p| usize::try_from(p.line()).unwrap_or(0));
                errors.push(broken(line, "", "", "must have as many cells as the first line"));
                continue;
            }
        };
        let line = record.position().map_or(0, |p| usize::try_from(p.line()).unwrap_or(0));
        for (name, column) in names.iter().zip(&mut values) {
            let Some(index) = at(name) else { continue };
            let cell = record.get(index).unwrap_or("");
            match cell.parse::<f64>() {
                Ok(v) if v.is_finite() => column.push(v),
                _ => errors.push(broken(line, name, cell, "must be a finite number")),
            }
        }
        let time = &values[0];
        if time.len() > 1 && time[time.len() - 1] <= time[time.len() - 2] {
            errors.push(broken(
                line,
                "t_s",
                &time[time.len() - 1].to_string(),
                "must increase from row to row",
            ));
        }
    }
    let [time, steer, speed, throttle, brake, initial] = values;
    if errors.is_empty() {
        match (time.first(), time.last()) {
            (Some(first), Some(last)) if time.len() >= 2 => {
                if last - first > DURATION_MAX_S {
                    errors.push(broken(1, "t_s", &last.to_string(), "must not span more than ten hours"));
                }
            }
            _ => errors.push(broken(1, "", "", "must have at least two rows")),
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let by = given[0].1;
    let speed = at("target_speed_mps").is_some().then_some(speed);
    let initial = speed.as_ref().map_or(initial.first().copied().unwrap_or(0.0), |s| s[0]);
    Ok(Columns { time, steer, by, speed, throttle, brake, initial })
}

impl Columns {
    fn value(&self, column: &[f64], row: usize, t: f64) -> f64 {
        let next = (row + 1).min(self.time.len() - 1);
        let span = self.time[next] - self.time[row];
        let w = if span > 0.0 { ((t - self.time[row]) / span).clamp(0.0, 1.0) } else { 0.0 };
        column[row] + w * (column[next] - column[row])
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
        match &self.speed {
            Some(speed) => input.target_speed_m_s = Some(self.value(speed, row, t)),
            None => {
                input.throttle = self.value(&self.throttle, row, t);
                input.brake_pressure_pa = self.value(&self.brake, row, t);
            }
        }
        input
    }
}

/// Drives `vehicle` by the table `input`.
///
/// # Errors
/// Missing or contradicting columns, cells that are not finite numbers, times that do not increase; the first hundred.
pub fn simulate_csv(vehicle: &mut Vehicle, input: &str) -> Result<String, Vec<SimulateError>> {
    let columns = read(input)?;
    let step = vehicle.step_s();
    let mut out = String::from(CAR_COLUMNS);
    for wheel in ["fl", "fr", "rl", "rr"] {
        for column in WHEEL_COLUMNS {
            // Writing to a string cannot fail.
            let _ = write!(out, ",{column}_{wheel}");
        }
    }
    out.push('\n');
    let first = columns.time[0];
    let start = columns.input(vehicle, 0, first - step, step);
    vehicle.reset(columns.initial, &VehicleInput { time_s: first, ..start });
    write_row(vehicle, first, &mut out);
    let mut n = 0u64;
    for row in 0..columns.time.len() - 1 {
        // Times of steps are counted, not summed, so that they do not drift.
        while first + (n as f64 + 0.5) * step < columns.time[row + 1] {
            let now = columns.input(vehicle, row, first + n as f64 * step, step);
            vehicle.step(&now);
            n += 1;
        }
        write_row(vehicle, columns.time[row + 1], &mut out);
    }
    Ok(out)
}

fn write_row(vehicle: &Vehicle, time: f64, out: &mut String) {
    let o = vehicle.output();
    let mean_steer = 0.5 * (o.wheels[0].kinematic_steer_rad + o.wheels[1].kinematic_steer_rad);
    let car = [
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
    ];
    let wheels = o.wheels.iter().flat_map(|w| {
        [
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
        ]
    });
    let mut separator = "";
    for value in car.into_iter().chain(wheels) {
        let _ = write!(out, "{separator}{value}");
        separator = ",";
    }
    out.push('\n');
}
