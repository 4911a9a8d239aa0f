//! `vehicle`: the car on its own, away from any bench: runs from a table, its named variables.

use super::log::write_whole;
use super::suspension::read_text;
use crate::exit::Exit;
use crate::output;
use clap::{Args as ClapArgs, Subcommand};
use config::ResolvedCar;
use config::equations::Equations;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::path::PathBuf;
use vehicle::{Exports, Imports, Simulation, Vehicle};

/// Largest table of inputs. [bytes]
const TABLE_BYTES_MAX: u64 = 1 << 30;

/// What the help of the vehicle commands says of the car and of signs.
const ABOUT: &str = "\
CAR is a TOML car file or the bare name of a shipped one (see `kingpin list cars`).

Axes and signs ISO 8855, SI units: x forward, y left, z up; left turn: positive steer, yaw rate, ay; roll + right side \
down, pitch + nose down; alpha < 0 gives Fy > 0 (ISO-W); kappa > 0 drives; Fz > 0 presses. Wheels fl, fr, rl, rr.

Examples:
  kingpin vehicle simulate --car bmw_320i --input in.csv --output out.csv
  kingpin vehicle simulate --car sedan --input in.csv --output out.csv --set body.sprung_mass_kg=1500
  kingpin vehicle variables --json";

/// Arguments of `vehicle`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT)]
pub struct VehicleArgs {
    /// What to do.
    #[command(subcommand)]
    command: VehicleCommand,
}

/// Commands of `vehicle`.
#[derive(Debug, Subcommand)]
enum VehicleCommand {
    /// Drive a car by the rows of a CSV
    Simulate(SimulateArgs),
    /// The car's named variables: what can be read, what can be imported
    Variables(VariablesArgs),
}

/// What `vehicle simulate --help` adds.
const SIMULATE_HELP: &str = "\
Columns read, in any order:
  t_s                   time, increasing; values run in straight lines between rows [s]
  one of
    delta_road_rad      mean angle of the front road wheels: the rack that gives it at design is set [rad]
    steering_wheel_rad  hand-wheel angle, through the car's own steering [rad]
    rack_disp_m         rack displacement, left positive [m]
  and either
    target_speed_mps    held by the speed controller; negative: in reverse [m/s]
  or
    throttle, brake_pa  0 to 1, master-cylinder pressure [Pa]; then
    initial_speed_mps   of the first row is the starting speed, if it is there [m/s]
Others are named on standard error and not read. Road: flat, dry (change it with imports, see --equations).

The car starts settled, straight ahead, at the first row. One row is written for each row read: t_s, delta_road_rad, \
steering_wheel_rad, rack_disp_m, rack_force_N (of the wheels on the rack), v_x_mps, v_y_mps (horizontal, of the centre of \
gravity), x_m, y_m, z_cg_m, yaw_rad, yawrate_rps, roll_rad, rollrate_rps, pitch_rad, ay_cg_mps2, ax_cg_mps2 \
(horizontal), beta_rad, throttle, gear, engine_rps; of each wheel alpha_rad, kappa, camber_rad (to the road, ISO-W), \
Fx_N, Fy_N, Fz_N, Mx_Nm, My_Nm, Mz_Nm, omega_rps, steer_rad, wc_z_m, susp_defl_m (rebound positive), each with _fl, \
_fr, _rl, _rr; then the outputs of --equations.

EQUATIONS is a TOML file with the keys of a scenario's [equations]:
  variables = [{ name = \"gust\", unit = \"N\", expression = \"if(time_s > 2 s, 800 N, 0)\" }]
  imports = [{ variable = \"external_force_y_n\", mode = \"add\", expression = \"gust\" }]
  outputs = [{ name = \"front_fy\", unit = \"kN\", expression = \"fy_n_fl + fy_n_fr\" }]

Axes and signs: see `kingpin vehicle --help`.";

/// Arguments of `vehicle simulate`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SIMULATE_HELP)]
struct SimulateArgs {
    /// Car: TOML file or shipped name
    #[arg(long, value_name = "CAR")]
    car: String,
    /// Inputs over time
    #[arg(long, value_name = "FILE.csv")]
    input: PathBuf,
    /// Where to write the results
    #[arg(long, value_name = "FILE.csv")]
    output: PathBuf,
    /// Replace a value of the car: `body.sprung_mass_kg=1500`, `front_axle.rack_stroke_m=0.08`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Variables, imports and outputs of your own: a TOML file
    #[arg(long, value_name = "FILE.toml")]
    equations: Option<String>,
    /// Length of a step [ms]
    #[arg(long, default_value_t = 1.0, value_name = "MS")]
    step_ms: f64,
}

/// Arguments of `vehicle variables`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Exports can be read by expressions and are what a run puts out; imports can be changed while it runs, by ADD, MULTIPLY or \
REPLACE (see `kingpin vehicle simulate --help`, EQUATIONS).")]
struct VariablesArgs {
    /// Show this car's value of each export too, at rest
    #[arg(long, value_name = "CAR")]
    car: Option<String>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// `kingpin vehicle`.
pub fn vehicle(args: &VehicleArgs) -> Exit {
    let ended = match &args.command {
        VehicleCommand::Simulate(args) => simulate(args),
        VehicleCommand::Variables(args) => variables(args),
    };
    ended.unwrap_or_else(|wrong| {
        output::note(wrong);
        Exit::BadInput
    })
}

fn load_car(reference: &str, overrides: &[String], step_s: f64) -> Result<Vehicle, String> {
    let resolved = ResolvedCar::load(reference, overrides).map_err(|problems| problems.to_string())?;
    if resolved.driveline_model.is_some() {
        output::note(format!(
            "{reference}: its driveline model runs on the bench only; here its own powertrain drives"
        ));
    }
    assembly::build_car(&resolved, step_s).map_err(|error| format!("{reference}: {error}"))
}

/// `kingpin vehicle simulate`.
fn simulate(args: &SimulateArgs) -> Result<Exit, String> {
    // Everything is looked at before anything ends the command, so that all that is wrong is told at once.
    let mut wrong = Vec::new();
    if !(args.step_ms > 0.0 && args.step_ms <= 10.0) {
        wrong.push(format!("--step-ms = {}: must be in (0, 10] ms", args.step_ms));
    }
    let name = args.input.display().to_string();
    let table = read_text(&args.input, TABLE_BYTES_MAX)
        .and_then(|text| Simulation::read(&text, &name).map_err(|problems| problems.to_string()));
    let equations = args.equations.as_ref().map(|file| config::load::<Equations>(file)).transpose();
    let car = load_car(&args.car, &args.set, (args.step_ms * 1e-3).clamp(1e-6, 1e-2));
    wrong.extend(table.as_ref().err().cloned());
    wrong.extend(equations.as_ref().err().map(ToString::to_string));
    wrong.extend(car.as_ref().err().cloned());
    let (Ok(mut table), Ok(equations), Ok(mut car)) = (table, equations, car) else {
        return Err(wrong.join("\n"));
    };
    if let Some(equations) = &equations
        && let Err(broken) = car.set_equations(&equations.value)
    {
        let told =
            |b: &config::Broken| equations.violation(config::Mistake::Rule, &b.key, &b.rule).to_string();
        wrong.extend(broken.iter().map(told));
    }
    if !wrong.is_empty() {
        return Err(wrong.join("\n"));
    }
    if !table.ignored().is_empty() {
        output::note(format!("{name}: not read: {}", table.ignored().join(", ")));
    }
    let bar = ProgressBar::with_draw_target(Some(table.rows() as u64), ProgressDrawTarget::stderr_with_hz(4));
    let style = ProgressStyle::with_template("simulating {bar:30} {percent} %, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let written = write_whole(&args.output, |to| {
        let told = |e: std::io::Error| e.to_string();
        writeln!(to, "{}", Simulation::columns(&car).join(",")).map_err(told)?;
        let mut values = Vec::new();
        while table.next_row(&mut car, &mut values) {
            for (k, value) in values.iter().enumerate() {
                let separator = if k == 0 { "" } else { "," };
                write!(to, "{separator}{value}").map_err(told)?;
            }
            writeln!(to).map_err(told)?;
            bar.inc(1);
        }
        Ok(())
    });
    bar.finish_and_clear();
    if let Err(error) = written {
        output::note(error);
        return Ok(Exit::Unavailable);
    }
    if table.unreached() > 0 {
        output::note(format!(
            "{name}: {} of {} rows ask for more steering than the rack gives (its stop, or 2 m/s): the results have what it \
             reached",
            table.unreached(),
            table.rows()
        ));
    }
    let held = car.output().held_steps;
    let faults = car.equations().map_or(0, |equations| equations.faults());
    if held > 0 {
        output::note(format!("the car's state was not sound in {held} steps: the last sound one was held"));
    }
    if faults > 0 {
        output::note(format!("{faults} results of equations were not finite: their last values were kept"));
    }
    Ok(if held + faults > 0 { Exit::Failed } else { Exit::Done })
}

/// `kingpin vehicle variables`.
fn variables(args: &VariablesArgs) -> Result<Exit, String> {
    let car = args.car.as_ref().map(|car| load_car(car, &[], 1e-3)).transpose()?;
    let value = |name: &str| {
        let id = Exports::find(name)?;
        car.as_ref().map(|car| Exports::get(id, car.output()))
    };
    let all = Exports::variables()
        .into_iter()
        .map(|v| ("export", v))
        .chain(Imports::variables().into_iter().map(|v| ("import", v)));
    if args.json {
        let list = all.map(|(direction, v)| {
            let mut entry = json!({
                "name": v.name, "unit": v.unit, "description": v.description, "direction": direction,
            });
            if let Some(value) = value(&v.name) {
                entry["value"] = json!(value);
            }
            entry
        });
        output::json(
            &json!({ "variables": list.collect::<Vec<_>>(), "import_modes": ["add", "multiply", "replace"] }),
        );
        return Ok(Exit::Done);
    }
    let head = ["name", "unit", "direction", "description"].map(str::to_owned).to_vec();
    let mut rows = vec![head];
    if car.is_some() {
        rows[0].insert(3, "value".to_owned());
    }
    for (direction, v) in all {
        let mut row = vec![v.name.clone(), v.unit.to_owned(), direction.to_owned()];
        if car.is_some() {
            row.push(value(&v.name).map_or_else(String::new, |value| format!("{value:.6}")));
        }
        row.push(v.description.to_owned());
        rows.push(row);
    }
    output::line(output::columns(&rows).trim_end());
    Ok(Exit::Done)
}
