//! `rig`: what the rig can do and how it was found out. Tracking table, identification, response, tick rates, friction.

mod friction;
mod identify;
mod jobs;
mod rate;
mod response;
mod table;
mod trips;

use crate::exit::Exit;
use crate::output;
use clap::{Args as ClapArgs, Subcommand};
use config::Problems;
use std::path::{Path, PathBuf};

/// Arguments of `rig`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Examples:
  kingpin rig table --output table.html            tracking beside the published figures
  kingpin rig identify --output found              test every axis, write report and parameters
  kingpin run slalom_120 --set 'rig_file=\"found/rig.toml\"'    and use them
  kingpin rig response --output response.html      stroke and speed over frequency
  kingpin rig rate                                 steering torque at 1, 2 and 4 kHz against 10 kHz
  kingpin rig trips                                every trip, provoked
  kingpin rig friction --output friction.html      torque over angle, weave and slow ramp

All of it runs on the virtual rig, in lockstep, with the same result every time. --set changes a value as in
`kingpin run`: rig.plant.* is the machine, rig.control.* what the controller believes of it.")]
pub struct RigArgs {
    /// What to do.
    #[command(subcommand)]
    command: RigCommand,
}

/// Commands of `rig`.
#[derive(Debug, Subcommand)]
enum RigCommand {
    /// Tracking of tie-rod force and ball height beside the published figures
    Table(table::TableArgs),
    /// Test every axis of the rig: frequency responses, delay, stiffness, inertia, friction
    Identify(identify::IdentifyArgs),
    /// Open-loop response of the cylinders: stroke and speed over frequency
    Response(response::ResponseArgs),
    /// Steering torque at tick rates of 1, 2 and 4 kHz against 10 kHz
    Rate(rate::RateArgs),
    /// Every trip provoked on the running rig, with its reaction in ticks
    Trips(trips::TripsArgs),
    /// Steering torque over angle for several rack frictions: weave and slow ramp
    Friction(friction::FrictionArgs),
}

/// Why a command ended early.
enum Ended {
    /// Wrong input, ready to print.
    Input(String),
    /// A study that could not be done.
    Failed(String),
}

impl From<Problems> for Ended {
    fn from(problems: Problems) -> Self {
        Ended::Input(problems.to_string())
    }
}

impl From<assembly::AssemblyError> for Ended {
    fn from(error: assembly::AssemblyError) -> Self {
        Ended::Input(error.to_string())
    }
}

/// `kingpin rig`.
pub fn rig(args: &RigArgs) -> Exit {
    let ended = match &args.command {
        RigCommand::Table(args) => table::table(args),
        RigCommand::Identify(args) => identify::identify(args),
        RigCommand::Response(args) => response::response(args),
        RigCommand::Rate(args) => rate::rate(args),
        RigCommand::Trips(args) => trips::trips(args),
        RigCommand::Friction(args) => friction::friction(args),
    };
    ended.unwrap_or_else(|why| match why {
        Ended::Input(text) => {
            output::note(text);
            Exit::BadInput
        }
        Ended::Failed(text) => {
            output::note(text);
            Exit::Failed
        }
    })
}

/// Writes a file and says where it lies.
fn write(path: &Path, text: &str) -> Result<PathBuf, Ended> {
    std::fs::write(path, text).map_err(|error| Ended::Failed(format!("{}: {error}", path.display())))?;
    Ok(path.to_owned())
}

/// A number of a table, or a dash.
fn cell(value: f64, digits: usize) -> String {
    if value.is_finite() { format!("{value:.digits$}") } else { "–".to_owned() }
}
