//! `tyre`: a tyre on its own: tables of contacts evaluated, curves drawn.

mod plot;

use super::log::write_whole;
use super::suspension::read_text;
use crate::exit::Exit;
use crate::output;
use clap::{Args as ClapArgs, Subcommand};
use config::Kind;
use std::path::{Path, PathBuf};
use tyre::{Tyre, UseMode};

/// Largest table of contacts. [bytes]
const TABLE_BYTES_MAX: u64 = 1 << 30;

/// What the help of the tyre commands says of their files and signs.
const ABOUT: &str = "\
TYRE is a .tir property file (MF 5.2 / PAC2002, MF 6.1, MF 6.2: FITTYP 6, 52, 61, 62), a table tyre (.toml), or the \
bare name of a shipped one (see `kingpin list tyres`).

Axes ISO-W (TYDEX), at the contact centre: x forward, y left, z up. alpha < 0 gives Fy > 0; kappa > 0 drives; \
gamma > 0 leans the top to the right; Fz > 0 presses. SI units.

Examples:
  kingpin tyre evaluate --tir car_205_60r15 --input in.csv --output out.csv
  kingpin tyre evaluate --tir my.tir --input in.csv --output out.csv --use-mode 211
  kingpin tyre plot --tir my.tir --output my.html
  kingpin tyre plot --tir my.tir --output my.html --loads-n 2000,4000,6000 --pressure-pa 240000";

/// Arguments of `tyre`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT)]
pub struct TyreArgs {
    /// What to do.
    #[command(subcommand)]
    command: TyreCommand,
}

/// Commands of `tyre`.
#[derive(Debug, Subcommand)]
enum TyreCommand {
    /// Forces, moments, radii and stiffnesses at every row of a CSV
    Evaluate(EvaluateArgs),
    /// Fx, Fy, Mz, combined slip, stiffnesses and radii as figures
    Plot(PlotArgs),
}

/// What `tyre evaluate --help` adds.
const EVALUATE_HELP: &str = "\
Columns read, in any order: Fz_N (>= 0), kappa, alpha_rad (-pi/2, pi/2), gamma_rad, phit_1pm (turn slip), Vx_mps, and, \
if it is there, p_Pa (0 or absent: the file's inflation pressure). Others are named on standard error and not read.

Columns written: those seven, then Fx_N, Fy_N, Mx_Nm, My_Nm, Mz_Nm; Re_m effective rolling radius; rho_m deflection; \
contact_len_m; trail_m pneumatic trail; mux, muy peak friction; Rl_m loaded radius; Mzr_Nm residual torque; Cx_Npm, \
Cy_Npm carcass stiffnesses, Cz_Npm load over deflection; Kya_Nprad cornering stiffness; sigmax_m, sigmay_m relaxation \
lengths; Kxk_N slip stiffness.

Use modes, as three digits: 2 inputs are not limited to the file's ranges; then 1 alpha and gamma as they are, or \
2 alpha* = tan(alpha) sgn(Vx), gamma* = sin(gamma), for large angles and reverse; then 1 without or 2 with turn slip. \
Without combined slip is not a mode: give rows with kappa = 0 or alpha_rad = 0.

Axes ISO-W: alpha < 0 gives Fy > 0, kappa > 0 drives. A tyre is taken as its file describes it, never mirrored.";

/// Arguments of `tyre evaluate`.
#[derive(Debug, ClapArgs)]
#[command(after_help = EVALUATE_HELP)]
struct EvaluateArgs {
    /// Tyre: .tir file, table tyre (.toml) or shipped name
    #[arg(long, value_name = "TYRE")]
    tir: String,
    /// Contacts to evaluate
    #[arg(long, value_name = "FILE.csv")]
    input: PathBuf,
    /// Where to write the results
    #[arg(long, value_name = "FILE.csv")]
    output: PathBuf,
    /// 211: angles as they are; 221: alpha* and gamma*; 212, 222: the same with turn slip
    #[arg(long, default_value = "211", value_name = "MODE", value_parser = ["211", "221", "212", "222"])]
    use_mode: String,
}

/// Arguments of `tyre plot`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT)]
struct PlotArgs {
    /// Tyre: .tir file, table tyre (.toml) or shipped name
    #[arg(long, value_name = "TYRE")]
    tir: String,
    /// Where to write the page
    #[arg(long, value_name = "FILE.html")]
    output: PathBuf,
    /// Loads [default: 0.25, 0.5, 1, 1.5 and 2 times the nominal one, within the file's range] [N]
    #[arg(long, value_delimiter = ',', value_name = "N,N")]
    loads_n: Vec<f64>,
    /// Inflation pressure [default: the file's] [Pa]
    #[arg(long, value_name = "PA")]
    pressure_pa: Option<f64>,
    /// Rolling speed [m/s]
    #[arg(long, default_value_t = 16.7, value_name = "M/S")]
    speed_mps: f64,
    /// 211, 221: as `tyre evaluate` says
    #[arg(long, default_value = "221", value_name = "MODE", value_parser = ["211", "221"])]
    use_mode: String,
}

/// `kingpin tyre`.
pub fn tyre(args: &TyreArgs) -> Exit {
    let ended = match &args.command {
        TyreCommand::Evaluate(args) => evaluate(args),
        TyreCommand::Plot(args) => plot::plot(args),
    };
    ended.unwrap_or_else(|wrong| {
        output::note(wrong);
        Exit::BadInput
    })
}

/// A tyre from a file or a shipped name.
fn load_tyre(reference: &str) -> Result<Tyre, String> {
    let file =
        config::load::reference_text(reference, Kind::Tyre).map_err(|problems| problems.to_string())?;
    Tyre::from_text(&file.text, &file.name)
        .map_err(|faults| faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
}

fn mode_of(number: &str) -> Result<UseMode, String> {
    let mode = number.parse().ok().and_then(UseMode::from_number);
    mode.ok_or_else(|| format!("--use-mode = {number}: must be 211, 221, 212 or 222"))
}

fn write_text(path: &Path, text: &str) -> Exit {
    let written = write_whole(path, |to| to.write_all(text.as_bytes()).map_err(|e| e.to_string()));
    match written {
        Ok(()) => Exit::Done,
        Err(error) => {
            output::note(error);
            Exit::Unavailable
        }
    }
}

/// `kingpin tyre evaluate`.
fn evaluate(args: &EvaluateArgs) -> Result<Exit, String> {
    let mode = mode_of(&args.use_mode)?;
    // Both files are looked at before either ends the command, so that all that is wrong is told at once.
    let tyre = load_tyre(&args.tir);
    let text = read_text(&args.input, TABLE_BYTES_MAX);
    let name = args.input.display().to_string();
    let (tyre, text) = match (tyre, text) {
        (Ok(tyre), Ok(text)) => (tyre, text),
        (tyre, text) => {
            return Err([tyre.err(), text.err()].into_iter().flatten().collect::<Vec<_>>().join("\n"));
        }
    };
    if matches!(mode, UseMode::SmallAngleTurnSlip | UseMode::AlphaStarTurnSlip) && !tyre.info().has_turn_slip
    {
        output::note(format!("{}: has no turn slip coefficients: as if they were zero", args.tir));
    }
    let done = tyre::evaluate_csv(&tyre, &text, &name, mode).map_err(|problems| problems.to_string())?;
    if !done.ignored.is_empty() {
        output::note(format!("{name}: not read: {}", done.ignored.join(", ")));
    }
    Ok(write_text(&args.output, &done.text))
}
