//! The command line of `suspension`.

use clap::{Args as ClapArgs, Subcommand, ValueEnum};
use std::path::PathBuf;

/// What `--help` of the suspension commands says of their files.
const SUSPENSION_FILES: &str = "\
AXLE is a TOML axle file, the bare name of a shipped one (see `kingpin list suspensions`), or a hardpoint \
.json file (points by name, left and right), which is read as it is.

Frames and signs: body axes x forward, y left, z up, origin midway between the wheel centres at design, SI \
units. rack: + to the left. zL, zR: wheel-centre height minus design, + up. Fxk_L .. Mzk_R: force and moment \
of the wheel on the knuckle at the wheel centre, in the knuckle's axes. toe + in, camber + top outward, \
caster + top rearward, kpi + top inboard, steer + to the left. Axial forces + in tension; ball-joint forces \
act on the knuckle; rack_force is what the drive applies to the rack, + to the left.

Examples:
  kingpin suspension describe compact_strut
  kingpin suspension solve --axle compact_strut --input in.csv --output out.csv --method all
  kingpin suspension curves --axle sedan_double_wishbone --output curves
  kingpin suspension compare --axle hardpoints.json --reference measured.csv --output compare.html";

/// Arguments of `suspension`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_FILES)]
pub struct SuspensionArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: SuspensionCommand,
}

/// Commands of `suspension`.
#[derive(Debug, Subcommand)]
pub enum SuspensionCommand {
    /// Solve every row of a CSV: positions, alignment, forces
    Solve(SuspensionSolveArgs),
    /// Alignment curves over wheel travel and rack, and the kinematics map of a vehicle model
    Curves(SuspensionCurvesArgs),
    /// Bodies and constraints of an axle's models
    Describe(SuspensionDescribeArgs),
    /// The tie-rod force methods against a reference CSV
    Compare(SuspensionCompareArgs),
    /// Compliance of an axle with bushings, as a car file has it
    Compliance(SuspensionComplianceArgs),
}

/// Arguments of `suspension solve`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_SOLVE_HELP)]
pub struct SuspensionSolveArgs {
    /// Axle: TOML file, shipped name or hardpoint .json
    #[arg(long, value_name = "AXLE")]
    pub axle: String,
    /// Rows to solve: columns rack, zL, zR; optional step and Fxk_L .. Mzk_R; other columns are not read
    #[arg(long, value_name = "FILE.csv")]
    pub input: PathBuf,
    /// Where to write the results
    #[arg(long, value_name = "FILE.csv")]
    pub output: PathBuf,
    /// Tie-rod force method
    #[arg(long, value_enum, default_value_t = SuspensionMethod::Multibody)]
    pub method: SuspensionMethod,
    /// Hold the springs at their design length instead of the wheels at their heights (axles with bushings
    /// only); rack, zL and zR may then be left out
    #[arg(long)]
    pub lock_springs: bool,
}

/// What `suspension solve --help` adds.
const SUSPENSION_SOLVE_HELP: &str = "\
Columns written: step, rack, zL, zR; positions lbj_, ubj_, to_ (tie-rod outer ball), wc_, cp_ with _x _y _z \
and _L _R; q0..q3; steer, toe, camber, caster, kpi; spring_length or strut_length; arb_angle; loads Fxk.., \
Fxb..; tie, spring, Fubj or Ftop, Flbj, droplink, rack_force, arb_torque. An axle with a stabiliser has each \
force twice: _arb with it, _noarb without. An axle with bushings has dtoe, dcamber and defl_<point> too. \
For a virtual kingpin axis (five-link), lbj and ubj are points of it. The older methods write tie_map, \
tie_map_thesis, tie_simple and rack_force_<method>.

Last column: status, 0 where solved, else 1 not finite, 2 out of reach, 3 singular, 4 beyond a dead point; \
such a row holds the last solved one's results and makes the exit code 1.

AXLE is a TOML axle file, the bare name of a shipped one, or a hardpoint .json file, which is read as it is. \
Frames and signs: see `kingpin suspension --help`.";

/// Tie-rod force methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SuspensionMethod {
    /// Constraint forces of the multibody model
    Multibody,
    /// Alignment from one-dimensional maps, moment about the kingpin
    Map,
    /// Constant arm and conversion coefficients
    Simple,
    /// The map method as printed in its source, multiplying by the cosine where equilibrium divides
    #[value(name = "map_thesis")]
    MapThesis,
    /// All four
    All,
}

/// Arguments of `suspension curves`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_FILES)]
pub struct SuspensionCurvesArgs {
    /// Axle: TOML file, shipped name or hardpoint .json
    #[arg(long, value_name = "AXLE")]
    pub axle: String,
    /// Directory for travel.csv, rack.csv, kinematics_map.csv and curves.html; made if absent
    #[arg(long, value_name = "DIR")]
    pub output: PathBuf,
    /// Wheel travel to either side of design [m]
    #[arg(long, default_value_t = 0.08, value_name = "M")]
    pub travel: f64,
    /// Rack displacement to either side [default: the axle's stroke] [m]
    #[arg(long, value_name = "M")]
    pub rack: Option<f64>,
    /// Points of a curve
    #[arg(long, default_value_t = 161, value_name = "N", value_parser = clap::value_parser!(u32).range(3..=10_001))]
    pub points: u32,
}

/// Arguments of `suspension describe`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_FILES)]
pub struct SuspensionDescribeArgs {
    /// Axle: TOML file, shipped name or hardpoint .json
    #[arg(value_name = "AXLE")]
    pub axle: String,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `suspension compliance`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_FILES)]
pub struct SuspensionComplianceArgs {
    /// Axle with bushings: TOML file or shipped name
    #[arg(value_name = "AXLE")]
    pub axle: String,
    /// Vertical load of each wheel [N]
    #[arg(long, default_value_t = 4000.0, value_name = "N")]
    pub load_n: f64,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `suspension compare`.
#[derive(Debug, ClapArgs)]
#[command(after_help = SUSPENSION_FILES)]
pub struct SuspensionCompareArgs {
    /// Axle: TOML file, shipped name or hardpoint .json
    #[arg(long, value_name = "AXLE")]
    pub axle: String,
    /// Reference: inputs as for `solve`, and the columns to compare with, named as `solve` writes them
    #[arg(long, value_name = "FILE.csv")]
    pub reference: PathBuf,
    /// Hold the springs at their design length, as in `solve`
    #[arg(long)]
    pub lock_springs: bool,
    /// Write the figures there
    #[arg(long, value_name = "FILE.html")]
    pub output: Option<PathBuf>,
    /// Print the errors as JSON
    #[arg(long)]
    pub json: bool,
}
