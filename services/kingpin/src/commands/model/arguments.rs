//! Arguments of the `model` commands.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

const ABOUT_FILES: &str = "\
FILE is a model file (TOML, see docs/MODELS.md), or the bare name of a shipped one (see `kingpin list models`; \
`kingpin list models --show NAME` prints it). Values carry their units: --set \"car.N=3\" --set \"DT=[900 N*s/m, 1500 N*s/m]\". \
Results are in SI units.

Examples:
  kingpin model check my_unit.toml
  kingpin model describe rack_eps
  kingpin model compose one_wheel --set \"car.alpha=90 deg\" --at heading.beta=0.5
  kingpin model compose one_wheel --symbolic
  kingpin model simulate one_wheel --duration 5 --output drive.csv
  kingpin model simulate rack_eps --input drive.csv --output out.csv --account
  kingpin model compare rack_eps --measured drive.csv --output compare.html
  kingpin model draw column_eps --output column_eps.svg
  kingpin schema model > model.schema.json";

/// Arguments of `model`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT_FILES)]
pub struct ModelArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: ModelCommand,
}

/// Commands of `model`.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Read and compose models: every mistake with file, line, part and port
    Check(CheckArgs),
    /// Parameters, ports, states, observations; who gives what to whom
    Describe(DescribeArgs),
    /// The system's named matrices, as numbers or as text in the parameters' names
    Compose(ComposeArgs),
    /// Run it: inputs from a CSV file or constant, results to a CSV file
    Simulate(SimulateArgs),
    /// Run it and draw the results as a page
    Plot(PlotArgs),
    /// Run it on a measured drive; align, compare, overlay
    Compare(CompareArgs),
    /// Draw parts, joints and frames as nested boxes (SVG)
    Draw(DrawArgs),
}

/// Arguments of `model check`.
#[derive(Debug, ClapArgs)]
pub struct CheckArgs {
    /// Model files or shipped names
    #[arg(required = true, value_name = "FILE")]
    pub models: Vec<String>,
    /// Replace a parameter; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `model describe`.
#[derive(Debug, ClapArgs)]
pub struct DescribeArgs {
    /// Model file or shipped name
    #[arg(value_name = "FILE")]
    pub model: String,
    /// Replace a parameter; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `model compose`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
E dx/dt = A x + B u + a1,  y = C x + D u + c1, exact for what is linear between samples, else the tangent at the \
operating point. States, inputs and sampled quantities are named as `kingpin model describe` names them; those not \
given with --at stand at their start values (inputs at zero).

The symbolic text is one `name = expression` a line: definitions k1, n1 ..., then entries such as \
A[road.x.x, road.x.y]; column 1 is the constant.

Examples:
  kingpin model compose one_wheel --set \"car.alpha=90 deg\" --at heading.beta=0.5 --json
  kingpin model compose rack_eps --at bar.twist=0.02")]
pub struct ComposeArgs {
    /// Model file or shipped name
    #[arg(value_name = "FILE")]
    pub model: String,
    /// Replace a parameter; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Operating point: a state, input or sampled quantity in SI units; may be repeated
    #[arg(long, value_name = "NAME=NUMBER")]
    pub at: Vec<String>,
    /// Text in the names of the parameters instead of numbers
    #[arg(long)]
    pub symbolic: bool,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// What drives a simulation.
#[derive(Debug, ClapArgs)]
pub struct DriveArgs {
    /// Model file or shipped name
    #[arg(value_name = "FILE")]
    pub model: String,
    /// Replace a parameter; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Inputs over time: CSV with the column `time_s` (or `time [ms]` ...) and one for each driven input, with a unit \
    /// in brackets where it is not SI; other columns are not read
    #[arg(long, value_name = "FILE.csv")]
    pub input: Option<PathBuf>,
    /// An input that stays at a value, SI; may be repeated. Inputs not named at all are zero
    #[arg(long, value_name = "NAME=NUMBER")]
    pub constant: Vec<String>,
    /// Start value of a state, SI, instead of the file's; may be repeated
    #[arg(long, value_name = "NAME=NUMBER")]
    pub start: Vec<String>,
    /// Length [default: as long as the input] [s]
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Step [default: the file's sample, else 0.0001] [s]
    #[arg(long, value_name = "S")]
    pub dt: Option<f64>,
    /// Keep each input row's values until the next instead of a line between them
    #[arg(long)]
    pub hold: bool,
}

/// Arguments of `model simulate`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Columns written: time_s, the outputs (what open ports give, then observations) and with --states the states, each \
with its SI unit in brackets; with --account residual_w and flow_w (largest over the joints), stored_j, entered_j, \
supplied_j, lost_j, unstated_j and imbalance_j, which is zero but for rounding when the energy account closes.

Exit code 1: a step did not converge or held its state; 130: stopped by Ctrl-C, what was computed is written.

Examples:
  kingpin model simulate one_wheel --constant outside.fF.x=-50 --duration 20 --output out.csv
  kingpin model simulate rack_eps --input drive.csv --start rack.x=0.01 --output out.csv --account")]
pub struct SimulateArgs {
    #[command(flatten)]
    pub drive: DriveArgs,
    /// Where to write the results
    #[arg(long, value_name = "FILE.csv")]
    pub output: PathBuf,
    /// Write every n-th step only
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Write the states too
    #[arg(long)]
    pub states: bool,
    /// Write powers and the energy account, and print what they come to
    #[arg(long)]
    pub account: bool,
}

/// Arguments of `model plot`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Examples:
  kingpin model plot hydraulic --constant hand.T=3 --duration 2 --output hydraulic.html
  kingpin model plot one_wheel --constant outside.fF.x=-50 --duration 20 --path outside.vF.x:outside.vF.y --output path.html")]
pub struct PlotArgs {
    #[command(flatten)]
    pub drive: DriveArgs,
    /// Where to write the page
    #[arg(long, value_name = "FILE.html")]
    pub output: PathBuf,
    /// Draw two outputs over each other, and the path they make when they are speeds
    #[arg(long, value_name = "X:Y")]
    pub path: Vec<String>,
}

/// Arguments of `model compare`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
The measured CSV has the column `time_s`; columns named as inputs of the model drive it (with --input, that file \
does), columns named as its outputs are compared. --signal maps other names: --signal rack_position=\"Rack [mm]\".

The measurement's lag is found where the correlation of the first compared signal is largest, within --lag-max, and \
taken out. Printed for each signal: rms of measured - model, the same over the measured rms about its mean, largest \
error, gain and bias of the line measured = gain * model + bias, correlation; and what the measurement is like: \
samples, largest gap, range, strongest frequency.

Examples:
  kingpin model compare rack_eps --measured drive.csv
  kingpin model compare rack_eps --measured drive.csv --signal \"torsion_torque=Mtb [N*m]\" --lag-max 0.2 --output c.html")]
pub struct CompareArgs {
    #[command(flatten)]
    pub drive: DriveArgs,
    /// The measured drive
    #[arg(long, value_name = "FILE.csv")]
    pub measured: PathBuf,
    /// Compare this output with that column; may be repeated
    #[arg(long, value_name = "OUTPUT=COLUMN")]
    pub signal: Vec<String>,
    /// Most lag looked for; 0: the times agree already [s]
    #[arg(long, default_value_t = 0.1, value_name = "S")]
    pub lag_max: f64,
    /// Write the overlay there
    #[arg(long, value_name = "FILE.html")]
    pub output: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `model draw`.
#[derive(Debug, ClapArgs)]
pub struct DrawArgs {
    /// Model file or shipped name
    #[arg(value_name = "FILE")]
    pub model: String,
    /// Replace a parameter; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Where to write it [default: standard output]
    #[arg(long, value_name = "FILE.svg")]
    pub output: Option<PathBuf>,
}
