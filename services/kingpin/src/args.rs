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
    /// Run a standard's procedure and judge it: weave, steady circle, step, lane change, sine with dwell ...
    Procedure(ProcedureArgs),
    /// Make the report of a run again
    Report(ReportArgs),
    /// List what is shipped: scenarios, cars, suspensions, tyres, rigs, steering units, models, CAN mappings
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
    /// Solve a suspension on its own: poses, joint and tie-rod forces, curves, methods compared
    Suspension(crate::commands::suspension::SuspensionArgs),
    /// Functional models: check, compose, simulate, compare with a measurement, draw
    Model(crate::commands::ModelArgs),
    /// Evaluate a tyre on its own: tables of contacts, curves
    Tyre(crate::commands::tyre::TyreArgs),
    /// Drive a car on its own, away from any bench; its named variables
    Vehicle(crate::commands::vehicle::VehicleArgs),
    /// What the rig can do: tracking table, identification, response, tick rates, friction loops
    Rig(crate::commands::rig::RigArgs),
    /// CAN: check DBC and mapping files, watch a bus, send on it, play the ECU
    Can(crate::commands::can_args::CanArgs),
    /// FMUs, users' own models: what one is, whether it loads, what a step costs
    Fmu(crate::commands::fmu::FmuArgs),
    /// Run a parameter study on all cores: a table of figures over parameters, resumable
    Sweep(crate::commands::sweep::SweepArgs),
    /// Run a fault campaign: kill, stop, stall, spoil, and check what the bench makes of it
    Fault(crate::commands::fault::FaultArgs),
    /// Measure timing: the rig's wake-ups beside bare timers in the same run
    Bench(crate::commands::bench::BenchArgs),
    /// Say what this host lacks for hard real time, and what to do about it
    Doctor(DoctorArgs),
    /// Take over a running bench whose supervisor died
    Attach(AttachArgs),
    /// Save the last four seconds out of the table of a crashed (or running) bench
    Blackbox(BlackboxArgs),
    /// Live parameters of a running bench: list, get, set, undo, snapshot, diff
    Param(crate::commands::param::ParamArgs),
    /// Arm, start, stop, acknowledge a run that was started with --operate; emergency stop
    Operate(crate::commands::param::OperateArgs),
    /// The operator's page in a browser: live, or on a log
    Console(crate::commands::console::ConsoleArgs),
    /// A live bench for Foxglove, Lichtblick or PlotJuggler (Foxglove WebSocket protocol)
    Bridge(crate::commands::bridge::BridgeArgs),
    /// The essentials of a running bench in a terminal
    Monitor(crate::commands::monitor::MonitorArgs),
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
    /// Leave arming, starting, stopping and acknowledging to an operator (`kingpin operate`, console)
    #[arg(long)]
    pub operate: bool,
    /// With the operator's page beside it, while it runs
    #[arg(long)]
    pub console: bool,
    /// Port of the page; 0 is a free one
    #[arg(long, default_value_t = 8470, value_name = "PORT")]
    pub console_port: u16,
    /// Print the summary as JSON on standard output
    #[arg(long)]
    pub json: bool,
    /// Do not write report.html
    #[arg(long)]
    pub no_report: bool,
    /// Wait before a dead service is started again, for fault runs [s]
    #[arg(long, default_value_t = 0.0, value_name = "S")]
    pub restart_delay: f64,
    /// Acknowledge, arm and start again by itself after the rig was restarted or tripped: for unattended runs of
    /// the virtual rig
    #[arg(long)]
    pub rearm: bool,
    /// Let the services obey the orders of a fault campaign
    #[arg(long, hide = true)]
    pub faults: bool,
}

/// Arguments of `doctor`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Marks: good = as it should be, limits = costs jitter, LACKS = stands against hard real time, ? = the host does not say.
Nothing is changed; what to do is printed for you to do.

Example:
  kingpin doctor --seconds 10")]
pub struct DoctorArgs {
    /// Length of the measurement of timer wake-ups [s]
    #[arg(long, default_value_t = 2.0, value_name = "S")]
    pub seconds: f64,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `attach`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
A bench runs on when its supervisor dies: the rig, the models and the logger are processes of their own. For ten
seconds nothing changes; then the rig stops softly by itself and the others end. `attach` within that time takes the
bench's lock, adopts the services, restarts those that have died meanwhile, and sees the run to its planned end with
summary and report, as `run` would have.

Example:
  kingpin attach bench                              the default name of `kingpin run`")]
pub struct AttachArgs {
    /// Name of the bench
    pub name: String,
    /// Print the summary as JSON on standard output
    #[arg(long)]
    pub json: bool,
    /// Do not write report.html
    #[arg(long)]
    pub no_report: bool,
    /// As in `run`
    #[arg(long)]
    pub rearm: bool,
}

/// Arguments of `blackbox`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Every region of the table keeps at least four seconds. After a crash of everything they are still in shared memory,
until the next run of the same name, or `kingpin clean`, removes them; both save them first. The log that is written
is like any other: `kingpin report`, `export` and `compare` read it.

Example:
  kingpin blackbox --name bench -o crash.mcap && kingpin report crash.mcap")]
pub struct BlackboxArgs {
    /// Name of the bench [default: the only one there is]
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Where to write it [default: blackbox.mcap beside the run's log]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print what was saved as JSON
    #[arg(long)]
    pub json: bool,
}

/// Where lockstep runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Lockstep {
    /// All in this process: fastest
    Process,
    /// As the set of processes that also runs in real time
    Set,
}

/// Arguments of `procedure`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
A procedure runs its scenario in lockstep (or with --real-time by the clock), prints the conditions that the \
standard asks for with what was achieved, the figures, and pass or fail where the rule has a limit. A figure \
whose conditions were not met is withheld with the reason. weave and step are run again with another amplitude \
until the lateral acceleration is the standard's. sine-with-dwell first finds the angle A at 0.3 g.

Written: procedure.html (plots and tables), procedure.json, and each run's log, summary and report.

Examples:
  kingpin procedure weave
  kingpin procedure weave --set unit_file=\"rack_eps\" --out weave_rack_eps
  kingpin procedure sine-with-dwell --factor 5 --factor 6.5 --both-sides
  kingpin procedure step --log runs/step_100-20260101-120000      judge a run that is there
Exit code 1: a rule broken or a condition not met.")]
pub struct ProcedureArgs {
    /// Which
    #[arg(value_enum)]
    pub procedure: ProcedureName,
    /// Judge this run (directory or log file) instead of making one
    #[arg(long, value_name = "RUN", conflicts_with_all = ["out", "real_time", "set", "scenario"])]
    pub log: Option<PathBuf>,
    /// Another scenario that steers as the procedure asks
    #[arg(long, value_name = "SCENARIO")]
    pub scenario: Option<String>,
    /// Directory for the results [default: runs/procedure-<name>]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace a value, as in `run`
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// By the clock, as the set of processes, instead of in lockstep
    #[arg(long)]
    pub real_time: bool,
    /// Take the scenario's amplitude as it is, do not adapt it
    #[arg(long)]
    pub as_is: bool,
    /// sine-with-dwell: amplitudes in multiples of A [default: 1.5 to 6.5 in steps of 0.5]
    #[arg(long, value_name = "N")]
    pub factor: Vec<f64>,
    /// sine-with-dwell: both directions
    #[arg(long)]
    pub both_sides: bool,
    /// sine-with-dwell with --log: hand-wheel angle A that gives 0.3 g [deg]
    #[arg(long, value_name = "DEG")]
    pub angle_at_0_3_g_deg: Option<f64>,
    /// Lane changes: from the front axle to the front bumper [m]
    #[arg(long, default_value_t = 0.9, value_name = "M")]
    pub front_overhang_m: f64,
    /// Lane changes: from the rear axle to the rear bumper [m]
    #[arg(long, default_value_t = 1.0, value_name = "M")]
    pub rear_overhang_m: f64,
    /// Name of the bench
    #[arg(long, default_value = "procedure", value_name = "NAME")]
    pub name: String,
    /// No report.html of the single runs
    #[arg(long)]
    pub no_report: bool,
    /// Print the result as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

/// Procedures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProcedureName {
    /// On-centre weave, ISO 13674-1: 100 km/h, 0.2 Hz, 2 m/s²
    Weave,
    /// Slow friction ramp, 0.02 Hz, 50 km/h
    SlowRamp,
    /// Steady circle at constant radius, ISO 4138
    SteadyCircle,
    /// Steady turning at constant speed, ISO 4138
    SteadySpeed,
    /// Step input, ISO 7401 clause 10: 100 km/h, 4 m/s²
    Step,
    /// Random input, ISO 7401 clause 12: frequency response
    Random,
    /// Double lane change, ISO 3888-1
    LaneChange,
    /// Obstacle avoidance, ISO 3888-2
    ObstacleAvoidance,
    /// Sine with dwell, FMVSS 126 / ISO 19365
    SineWithDwell,
    /// Release of the hand wheel in a turn, ISO 17288-1
    Returnability,
}

/// Arguments of `report`.
#[derive(Debug, ClapArgs)]
pub struct ReportArgs {
    /// Directory of a run, or a log file; several are compared: figures side by side, curves laid over each other
    #[arg(required = true, num_args = 1.., value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Where to write it [default: report.html beside the log; of several runs compare-….html beside the first]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print the summary, or the comparison, as JSON on standard output
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
    /// Functional models
    Models,
    /// CAN mappings and DBC files
    Can,
    /// Fault campaigns
    Campaigns,
    /// Parameter studies
    Studies,
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
    /// A functional model
    Model,
    /// A CAN mapping
    Can,
    /// A fault campaign
    Campaign,
    /// A parameter study
    Study,
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
    /// Regions, fields, signals, or patterns with `*` and `?`, comma-separated; may be repeated [default: all]
    #[arg(long, value_name = "REGION[.FIELD]", value_delimiter = ',')]
    pub select: Vec<String>,
    /// One row for every N ticks
    #[arg(long, default_value_t = 1, value_name = "N")]
    pub every: u64,
    /// What that row holds
    #[arg(long, value_enum, default_value_t = ThinMethod::Pick)]
    pub method: ThinMethod,
    /// Where to write it [default: beside the log]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

/// Export formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ExportFormat {
    /// Comma-separated values, one time column
    Csv,
    /// ASAM MDF 4.10 with units, descriptions and the configuration attached: CANape, INCA, asammdf
    Mf4,
    /// Apache Parquet, one table; units and comments in `df.attrs` of pandas, configuration in the file's metadata
    Parquet,
    /// A smaller log: MCAP for ROS 2 tools and for kingpin itself
    Mcap,
}

/// How ticks are thinned out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ThinMethod {
    /// The first tick of each N as it is (what is faster than half the new rate aliases)
    Pick,
    /// The mean of the N ticks; counters, codes and flags those of the first
    Mean,
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
    /// Do not save the last seconds of what is removed
    #[arg(long)]
    pub discard: bool,
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
    /// The CAN bus.
    Can,
    /// The first FMU.
    #[value(name = "fmu_0")]
    Fmu0,
    /// The second FMU.
    #[value(name = "fmu_1")]
    Fmu1,
    /// The third FMU.
    #[value(name = "fmu_2")]
    Fmu2,
    /// The fourth FMU.
    #[value(name = "fmu_3")]
    Fmu3,
    /// An FMU for another process, asked over standard input.
    #[value(name = "fmu_host")]
    FmuHost,
    /// The log.
    Logger,
    /// Attaches and ends: what a restart costs at least.
    Probe,
    /// Stress for measurements.
    Load,
}
