//! The command line of `fault`.

use clap::Args as ClapArgs;
use std::path::PathBuf;

/// Arguments of `fault`.
#[derive(Debug, ClapArgs)]
#[command(after_help = FAULT_HELP)]
pub struct FaultArgs {
    /// A shipped campaign (see `kingpin list campaigns`) or a TOML file
    pub campaign: String,
    /// Replace a value of the campaign: `seed=7`, `faults_per_run=10`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    pub set: Vec<String>,
    /// Directory for results and logs [default: runs/<campaign>-<date>-<time>]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Name of the bench
    #[arg(long, default_value = "fault", value_name = "NAME")]
    pub name: String,
    /// Keep the logs of runs in which all was as expected, too
    #[arg(long)]
    pub keep: bool,
    /// Print the result as JSON on standard output
    #[arg(long)]
    pub json: bool,
}

/// What `fault --help` adds.
const FAULT_HELP: &str = "\
Each fault is made in undisturbed running, when and where the seed says, and judged by the log of the run and by an
observer of its own who reads the table:

  kill, torn_write   the rig holds no later than one output phase behind its staleness limit, counted in output
                     phases that it executed itself; the force fades as the rig file says, steer torque off, heights
                     frozen; the service is there again and the loop runs; vehicle and multibody states equal, bit
                     for bit, those of a model that never died and had the same inputs; no torn slot is ever read.
                     Rig: comes up off or idle at zero force and starts only when asked. Supervisor: attach takes
                     over, nothing else happens. Logger: no tick is missing in the log.
  stop, stall, late  as kill, if longer than the limit; else nothing but counts; every missed tick is stepped
  corrupt            no nonsense is used: refused, held, and stale when it lasts
  scribble           another program writes into the table's memory: who has a region open goes on, a spoilt tick is
                     missing, a spoilt head is not believed and put right by the next write, a header by the supervisor
  sensor             trips with a sensor's code, or is within tolerance (said); runs again when acknowledged
  disk_full          the loop runs on; what is lost is counted, what is logged is readable
  clock_step         nothing: time is monotonic; all files of the log keep one clock origin
  can                a message of the mapping is dropped, delayed, its counter stuck or its checksum wrong: whoever
                     receives it counts that (the ECU says so in its diagnosis), the message comes back, the loop
                     never notices; the CAN service itself may be killed and stopped, too

A fault during which the host itself stalled the rig for more ticks than the limit says nothing about the bench: it is
counted as `host stalled`, not as passed, and made again. Exit code 1 if any fault had another reaction than expected.

Results in the directory: faults.json, faults.html (force, state, staleness around the faults), logs of failed runs.

Examples:
  kingpin fault kills_30
  kingpin fault kills_1000 --json
  kingpin fault lockstep_mix --set seed=7 --keep
  kingpin fault can_paced";
