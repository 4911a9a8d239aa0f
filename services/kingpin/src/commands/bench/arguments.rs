//! The command line of `bench`.

use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;

/// Arguments of `bench`.
#[derive(Debug, ClapArgs)]
pub struct BenchArgs {
    /// What to measure.
    #[command(subcommand)]
    pub command: BenchCommand,
}

/// Commands of `bench`.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Wake-ups, phases and chain latency of the process set beside bare timer threads
    Jitter(BenchJitterArgs),
}

/// Arguments of `bench jitter`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Blocks of the process set and of a bare timer thread alternate, on the same core, at the same priority, with the same
call to sleep (20 us of spinning before the time aimed at), so that both see the same host; a third, shorter kind of
block does not spin, as cyclictest does not. Times are of wake-ups after the time aimed at, of the tick only; the chain
is from the rig's sample to the published suspension state; the margin is what is left before the output phase.
Every period counts, in both: one that was overslept counts with the time until the thread ran again.
Ratios of p50, p99 and p99.9 come with a 95 % interval from drawing whole blocks with replacement.

Results in the directory: jitter.json, jitter.html.

Examples:
  kingpin bench jitter --duration 60
  kingpin bench jitter --cores 0,1 --duration 1000 --load       10^6 ticks under stress
  kingpin bench jitter --period 0.25 --duration 30              at 4 kHz")]
pub struct BenchJitterArgs {
    /// Cores: of the rig and the bare timer, then of vehicle and multibody [default: wherever the kernel puts them]
    #[arg(long, value_delimiter = ',', value_name = "CORE[,CORE]")]
    pub cores: Vec<usize>,
    /// Length of each of the two series [s]
    #[arg(long, default_value_t = 60.0, value_name = "S")]
    pub duration: f64,
    /// Length of a block [s]
    #[arg(long, default_value_t = 10.0, value_name = "S")]
    pub block: f64,
    /// Stress all cores meanwhile: computing, cache misses, memory traffic, disk writes
    #[arg(long)]
    pub load: bool,
    /// Period: 1, 0.5 or 0.25 [ms]
    #[arg(long, default_value_t = 1.0, value_name = "MS")]
    pub period: f64,
    /// SCHED_FIFO priority of rig and bare timer
    #[arg(long, default_value_t = 60, value_name = "N", value_parser = clap::value_parser!(i32).range(1..=98))]
    pub priority: i32,
    /// Scenario of the process set
    #[arg(long, default_value = "slalom_120", value_name = "NAME")]
    pub scenario: String,
    /// Name of the bench
    #[arg(long, default_value = "jitter", value_name = "NAME")]
    pub name: String,
    /// Directory for the results [default: runs/jitter-<date>-<time>]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print the result as JSON on standard output
    #[arg(long)]
    pub json: bool,
}
