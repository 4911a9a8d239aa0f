//! The command line. The help is written for somebody who has a car to judge and has never seen this tool.

use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// An open, real-time steering hardware-in-the-loop bench for plain Linux.
///
/// A steering unit, real or virtual, sits on a rig; Kingpin simulates the rest of the car around it every
/// millisecond, drives the rig with the tie-rod forces that follow, records everything and reports.
///
/// Try:  kingpin run growing_slalom_80
#[derive(Debug, Parser)]
#[command(name = "kingpin", version, after_help = crate::exit::TABLE, arg_required_else_help = true)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a scenario: closed loop, log, summary and report
    Run(RunArgs),
    /// Make the report of a run again
    Report(ReportArgs),
    /// List what is shipped: scenarios, cars, suspensions, tyres, rigs, steering units
    List(ListArgs),
    /// Check a scenario and all files it names, without running it
    Check(CheckArgs),
    /// Print the JSON schema of a configuration file, for editors
    Schema(SchemaArgs),
    /// Look into the shared table of a running or crashed bench
    Table(TableArgs),
    /// Mend a log that was cut off
    Recover(RecoverArgs),
    /// Export a log
    Export(ExportArgs),
    /// Compare two lockstep logs bit by bit
    Compare(CompareArgs),
    /// Remove what crashed benches left in shared memory
    Clean(CleanArgs),
    /// Print a completion script for a shell
    Completions {
        /// Shell.
        shell: clap_complete::Shell,
    },
    /// Run one service of a bench (started by `run`)
    #[command(hide = true)]
    Service(ServiceArgs),
}

/// Arguments of `run`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Examples:
  kingpin run growing_slalom_80                     real time on the virtual rig
  kingpin run growing_slalom_80 --lockstep          as fast as it goes, same result every time
  kingpin run lane_change_120 --set speed.speed_km_h=100 --duration 12
  kingpin run double_lane_change_measured --set record.directory=\"my_record\"")]
pub struct RunArgs {
    /// A shipped scenario (see `kingpin list scenarios`) or a TOML file
    pub scenario: String,
    /// Tick by tick instead of by the clock: in this process, or as the set of processes
    #[arg(long, value_enum, num_args = 0..=1, default_missing_value = "process", require_equals = true)]
    pub lockstep: Option<Lockstep>,
    /// Length of the run instead of the scenario's, warm-up included [s]
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Directory for log, summary and report [default: runs/<scenario>-<date>-<time>]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace a value: `car.body.mass_kg=1500`, `speed.speed_km_h=60`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Name of the bench; benches of different names run side by side
    #[arg(long, default_value = "bench", value_name = "NAME")]
    pub name: String,
    /// Print the summary as JSON on standard output
    #[arg(long)]
    pub json: bool,
    /// Do not write report.html
    #[arg(long)]
    pub no_report: bool,
    /// Wait before a dead service is started again, for fault runs [s]
    #[arg(long, default_value_t = 0.0, value_name = "S")]
    pub restart_delay: f64,
}

/// Where lockstep runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lockstep {
    /// All in this process: fastest
    Process,
    /// As the set of processes that also runs in real time
    Set,
}

/// Arguments of `report`.
#[derive(Debug, ClapArgs)]
pub struct ReportArgs {
    /// Directory of a run, or a log file
    pub run: PathBuf,
    /// Where to write it [default: report.html beside the log]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print the summary as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `list`.
#[derive(Debug, ClapArgs)]
pub struct ListArgs {
    /// Only this kind
    #[arg(value_enum)]
    pub kind: Option<ListKind>,
    /// Print one of them, as a file to start from
    #[arg(long, value_name = "NAME", requires = "kind")]
    pub show: Option<String>,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Kinds of shipped files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ListKind {
    /// Manoeuvres to run
    Scenarios,
    /// Cars
    Cars,
    /// Hardpoint files
    Suspensions,
    /// Tyre property files
    Tyres,
    /// Rigs
    Rigs,
    /// Steering units
    Units,
}

/// Arguments of `check`.
#[derive(Debug, ClapArgs)]
pub struct CheckArgs {
    /// A shipped scenario or a TOML file
    pub scenario: String,
    /// Replace a value, as in `run`
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Print all that is wrong as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `schema`.
#[derive(Debug, ClapArgs)]
pub struct SchemaArgs {
    /// Section
    #[arg(value_enum)]
    pub section: SchemaSection,
}

/// Sections with a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SchemaSection {
    /// A scenario
    Scenario,
    /// A car
    Car,
    /// An axle's hardpoints
    Axle,
    /// A rig
    Rig,
    /// A steering unit
    Unit,
}

/// Arguments of `table`.
#[derive(Debug, ClapArgs)]
pub struct TableArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: TableCommand,
}

/// Commands of `table`.
#[derive(Debug, Subcommand)]
pub enum TableCommand {
    /// Show the regions of a bench, or the newest content of one
    Show(TableShowArgs),
}

/// Arguments of `table show`.
#[derive(Debug, ClapArgs)]
pub struct TableShowArgs {
    /// Region; without it the list of all
    pub region: Option<String>,
    /// Name of the bench [default: the only one there is]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// This tick instead of the newest
    #[arg(long, value_name = "N", requires = "region")]
    pub tick: Option<u64>,
    /// Again and again, until Ctrl-C
    #[arg(long)]
    pub watch: bool,
    /// As JSON; with --watch one object a line
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `recover`.
#[derive(Debug, ClapArgs)]
pub struct RecoverArgs {
    /// The broken log
    pub log: PathBuf,
    /// Where to write the mended one [default: <log>.recovered.mcap]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print what was saved as JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `export`.
#[derive(Debug, ClapArgs)]
pub struct ExportArgs {
    /// Directory of a run, or a log file
    pub run: PathBuf,
    /// Format
    #[arg(long, value_enum, default_value_t = ExportFormat::Csv)]
    pub format: ExportFormat,
    /// Regions or signals to export, by region or `region.field`; may be repeated [default: all]
    #[arg(long, value_name = "REGION[.FIELD]")]
    pub select: Vec<String>,
    /// Every n-th tick only
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub every: u64,
    /// Where to write it [default: beside the log]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// Export formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Comma-separated values, one time column
    Csv,
}

/// Arguments of `compare`.
#[derive(Debug, ClapArgs)]
pub struct CompareArgs {
    /// Directory of a run, or a log file
    pub a: PathBuf,
    /// Another
    pub b: PathBuf,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `clean`.
#[derive(Debug, ClapArgs)]
pub struct CleanArgs {
    /// Only this bench [default: every bench that nobody runs]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
}

/// Arguments of `service`.
#[derive(Debug, ClapArgs)]
pub struct ServiceArgs {
    /// Which.
    #[arg(value_enum)]
    pub service: ServiceName,
    /// Name of the bench.
    #[arg(long)]
    pub bench: String,
}

/// Services.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ServiceName {
    /// The rig.
    Rig,
    /// The car.
    Vehicle,
    /// The front suspension.
    Multibody,
    /// The log.
    Logger,
}
