//! `param` and `operate`: tuning and operating a running bench from the command line.

use crate::exit::Exit;
use crate::output;
use clap::{Args, Subcommand, ValueEnum};
use config::ResolvedBench;
use operator_link::{Answer, Client, Entry, Operation, Request};
use params::{LIST, Setting, Values, by_path};
use regions::{Payload, RegionId, RigStatus, SuspensionState, VehicleState};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use table::{Bench, RegionReader};

/// How long the supervisor may take to answer.
const PATIENCE: Duration = Duration::from_secs(2);
/// How long the services may take to say that they have taken a change over.
const ECHO: Duration = Duration::from_secs(3);

/// Arguments of `param`.
#[derive(Debug, Args)]
#[command(after_help = "\
A change is checked by the supervisor (path, type, range, state of the bench), put into the table with a new \
version and taken over by its service at its next tick; the answer names that tick. In lockstep a run depends on \
nothing but its configuration: there, changes are part of the scenario ([[parameters]], see `kingpin schema \
scenario`).

Examples:
  kingpin param list                                       path, value, unit, range, default
  kingpin param list growing_slalom_80                     the same for a run that is not there yet
  kingpin param set control.force.bandwidth_rad_s=90 control.switches.rack_feed_forward=off
  kingpin param snapshot good.toml && kingpin param diff good.toml
  kingpin param set --from good.toml
  kingpin param undo")]
pub struct ParamArgs {
    /// What to do.
    #[command(subcommand)]
    pub command: ParamCommand,
    /// Name of the bench
    #[arg(long, default_value = "bench", value_name = "NAME", global = true)]
    pub name: String,
    /// As JSON
    #[arg(long, global = true)]
    pub json: bool,
}

/// Commands of `param`.
#[derive(Debug, Subcommand)]
pub enum ParamCommand {
    /// All live parameters: path, value, unit, range, default
    List {
        /// Of this scenario instead of the running bench
        scenario: Option<String>,
    },
    /// Values of some parameters
    Get {
        /// Paths
        #[arg(required = true)]
        path: Vec<String>,
    },
    /// Change parameters: all of them or, if one is refused, none
    Set {
        /// `path=value`; a switch is on or off
        #[arg(required_unless_present = "from", value_name = "PATH=VALUE")]
        setting: Vec<String>,
        /// All values of a snapshot
        #[arg(long, value_name = "FILE", conflicts_with = "setting")]
        from: Option<PathBuf>,
    },
    /// Write all values into a TOML file
    Snapshot {
        /// File; `-` is standard output
        #[arg(default_value = "-")]
        file: PathBuf,
    },
    /// What differs from the configuration, or from a snapshot
    Diff {
        /// Snapshot [default: the configuration's own values]
        file: Option<PathBuf>,
    },
    /// Take the last change back
    Undo,
}

/// Arguments of `operate`.
#[derive(Debug, Args)]
#[command(after_help = "\
For runs started with `kingpin run SCENARIO --operate`. The emergency stop works in every run.

Examples:
  kingpin operate arm && kingpin operate start
  kingpin operate emergency-stop")]
pub struct OperateArgs {
    /// What the bench shall do
    #[arg(value_enum)]
    pub operation: Operate,
    /// Name of the bench
    #[arg(long, default_value = "bench", value_name = "NAME")]
    pub name: String,
}

/// What the bench shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Operate {
    /// Get ready
    Arm,
    /// Fade in and start the manoeuvre
    Start,
    /// Fade out; the run goes on (a run that runs by itself ends)
    Stop,
    /// Acknowledge a trip
    Acknowledge,
    /// Press the emergency stop
    EmergencyStop,
    /// Release the emergency stop
    Release,
    /// End the run
    End,
}

fn fail(json: bool, exit: Exit, error: impl std::fmt::Display) -> Exit {
    if json {
        output::json(&json!({ "error": error.to_string() }));
    } else {
        output::note(error);
    }
    exit
}

fn ask(bench: &Bench, request: &Request) -> Result<Answer, (Exit, String)> {
    let client = Client::new(bench).map_err(|e| (Exit::Unavailable, e.to_string()))?;
    client.ask(request, PATIENCE).map_err(|e| (Exit::Unavailable, e.to_string()))
}

/// `kingpin operate`.
pub fn operate(args: &OperateArgs) -> Exit {
    let operation = match args.operation {
        Operate::Arm => Operation::Arm,
        Operate::Start => Operation::Start,
        Operate::Stop => Operation::Stop,
        Operate::Acknowledge => Operation::Acknowledge,
        Operate::EmergencyStop => Operation::EmergencyStop,
        Operate::Release => Operation::ReleaseEmergencyStop,
        Operate::End => Operation::End,
    };
    let bench = match Bench::new(&args.name) {
        Ok(bench) => bench,
        Err(error) => return fail(false, Exit::BadInput, error),
    };
    match ask(&bench, &Request::Operate(operation)) {
        Ok(Answer::Done { tick }) => {
            output::line(format!("tick {tick}"));
            Exit::Done
        }
        Ok(answer) => refused(false, &answer),
        Err((exit, error)) => fail(false, exit, error),
    }
}

fn refused(json: bool, answer: &Answer) -> Exit {
    match answer {
        Answer::Refused(reasons) => {
            if json {
                output::json(
                    &json!({"refused": reasons.iter().map(|r| json!({"path": r.path, "reason": r.reason})).collect::<Vec<_>>()}),
                );
            } else {
                reasons.iter().for_each(output::note);
            }
            Exit::BadInput
        }
        _ => fail(json, Exit::Failed, "the supervisor gave an answer to another question"),
    }
}

/// `kingpin param`.
pub fn param(args: &ParamArgs) -> Exit {
    match run(args) {
        Ok(exit) => exit,
        Err((exit, error)) => fail(args.json, exit, error),
    }
}

type Failed = (Exit, String);

fn run(args: &ParamArgs) -> Result<Exit, Failed> {
    let bench = Bench::new(&args.name).map_err(|e| (Exit::BadInput, e.to_string()))?;
    let source = || "command line".to_owned();
    match &args.command {
        ParamCommand::List { scenario: Some(scenario) } => {
            let resolved = ResolvedBench::load(scenario, &[]).map_err(|p| (Exit::BadInput, p.to_string()))?;
            let defaults = params::defaults(&resolved);
            let fixed = params::Fixed::on(&resolved);
            let entry = |(parameter, default): (&params::Parameter, &f64)| {
                let (min, max) = parameter.range(*default);
                let reason = fixed.reason(parameter.id as usize).unwrap_or_default().to_owned();
                Entry {
                    path: parameter.path.to_owned(),
                    value: *default,
                    default: *default,
                    min,
                    max,
                    fixed: reason,
                }
            };
            show(args.json, 0, &LIST.iter().zip(&defaults).map(entry).collect::<Vec<_>>());
            Ok(Exit::Done)
        }
        ParamCommand::List { scenario: None } => {
            let (version, entries) = entries(&bench)?;
            show(args.json, version, &entries);
            Ok(Exit::Done)
        }
        ParamCommand::Get { path } => {
            let (version, entries) = entries(&bench)?;
            let unknown: Vec<_> = path.iter().filter(|p| by_path(p).is_none()).collect();
            if let Some(path) = unknown.first() {
                let hint =
                    params::closest(path).map(|near| format!("; did you mean {near}?")).unwrap_or_default();
                return Err((Exit::BadInput, format!("{path}: no such parameter{hint}")));
            }
            let wanted: Vec<_> = entries.into_iter().filter(|e| path.contains(&e.path)).collect();
            show(args.json, version, &wanted);
            Ok(Exit::Done)
        }
        ParamCommand::Set { setting, from } => {
            let settings = match from {
                Some(file) => snapshot(file)?,
                None => typed(setting)?,
            };
            change(args, &bench, &Request::Set { settings, source: source() })
        }
        ParamCommand::Undo => change(args, &bench, &Request::Undo { source: source() }),
        ParamCommand::Snapshot { file } => {
            let (version, entries) = entries(&bench)?;
            let text =
                params::write_snapshot(&values(&entries), &format!("bench {}, version {version}", args.name));
            if file == Path::new("-") {
                output::line(text.trim_end());
            } else {
                std::fs::write(file, text)
                    .map_err(|e| (Exit::Unavailable, format!("{}: {e}", file.display())))?;
            }
            Ok(Exit::Done)
        }
        ParamCommand::Diff { file } => {
            let (_, entries) = entries(&bench)?;
            let mut base: Values = [0.0; 62];
            base.iter_mut().zip(&entries).for_each(|(value, entry)| *value = entry.default);
            if let Some(file) = file {
                let mut book = params::Book::new(base);
                let settings = snapshot(file)?;
                book.set(&settings, None).map_err(|refused| {
                    let lines: Vec<_> = refused.iter().map(|r| format!("{}: {r}", file.display())).collect();
                    (Exit::BadInput, lines.join("\n"))
                })?;
                base = *book.values();
            }
            let found: Vec<_> = params::difference(&base, &values(&entries))
                .into_iter()
                .filter(|(path, ..)| file.is_none() || !path.starts_with("human."))
                .collect();
            if args.json {
                let rows = found.iter().map(|(path, from, to)| json!({"path": path, "from": from, "to": to}));
                output::json(&json!({ "differences": rows.collect::<Vec<_>>() }));
            } else {
                let rows: Vec<_> = found
                    .iter()
                    .map(|(path, from, to)| {
                        vec![
                            (*path).to_owned(),
                            human(path, *from),
                            "->".to_owned(),
                            human(path, *to),
                            unit(path),
                        ]
                    })
                    .collect();
                output::line(output::columns(&rows).trim_end());
            }
            Ok(Exit::Done)
        }
    }
}

fn typed(settings: &[String]) -> Result<Vec<(String, Setting)>, Failed> {
    settings
        .iter()
        .map(|text| match text.split_once('=') {
            Some((path, value)) => Ok((path.trim().to_owned(), Setting::typed(value))),
            None => Err((Exit::BadInput, format!("{text}: must be PATH=VALUE"))),
        })
        .collect()
}

fn snapshot(file: &Path) -> Result<Vec<(String, Setting)>, Failed> {
    let text =
        std::fs::read_to_string(file).map_err(|e| (Exit::BadInput, format!("{}: {e}", file.display())))?;
    params::read_snapshot(&text).map_err(|e| (Exit::BadInput, format!("{}: {e}", file.display())))
}

fn entries(bench: &Bench) -> Result<(u64, Vec<Entry>), Failed> {
    match ask(bench, &Request::List)? {
        Answer::Parameters { version, entries, .. } => Ok((version, entries)),
        _ => Err((Exit::Failed, "the supervisor gave an answer to another question".to_owned())),
    }
}

fn values(entries: &[Entry]) -> Values {
    let mut values = [0.0; 62];
    values.iter_mut().zip(entries).for_each(|(value, entry)| *value = entry.value);
    values
}

fn human(path: &str, value: f64) -> String {
    by_path(path).map_or_else(|| value.to_string(), |parameter| parameter.text(value))
}

fn unit(path: &str) -> String {
    by_path(path).map(|p| p.unit).filter(|unit| *unit != "1").unwrap_or_default().to_owned()
}

fn show(json: bool, version: u64, entries: &[Entry]) {
    if json {
        let rows: Vec<_> = entries
            .iter()
            .filter_map(|e| by_path(&e.path).map(|p| (e, p)))
            .map(|(e, p)| {
                json!({"path": e.path, "value": e.value, "unit": p.unit, "min": e.min, "max": e.max,
                    "default": e.default, "fixed": e.fixed, "states": p.states.text(), "service": p.tuner.name(), "doc": p.doc})
            })
            .collect();
        output::json(&json!({"version": version, "parameters": rows}));
        return;
    }
    let mut rows =
        vec![["path", "value", "unit", "range", "default", "service", "meaning"].map(str::to_owned).to_vec()];
    for entry in entries {
        let Some(parameter) = by_path(&entry.path) else { continue };
        let range = match parameter.kind {
            _ if !entry.fixed.is_empty() => "fixed".to_owned(),
            params::Kind::Number => format!("{} to {}", entry.min, entry.max),
            params::Kind::Switch => "off, on".to_owned(),
            params::Kind::Choice(names) => names.join(", "),
        };
        rows.push(vec![
            entry.path.clone(),
            parameter.text(entry.value),
            unit(&entry.path),
            range,
            parameter.text(entry.default),
            parameter.tuner.name().to_owned(),
            parameter.doc.to_owned(),
        ]);
    }
    let mut reasons: Vec<&str> = entries.iter().map(|e| e.fixed.as_str()).filter(|r| !r.is_empty()).collect();
    reasons.dedup();
    output::line(output::columns(&rows).trim_end());
    for reason in reasons {
        output::line(format!("fixed: {reason}"));
    }
}

fn change(args: &ParamArgs, bench: &Bench, request: &Request) -> Result<Exit, Failed> {
    let answer = ask(bench, request)?;
    let Answer::Changed { version, tick, changes } = &answer else {
        return Ok(refused(args.json, &answer));
    };
    let echo = echo(bench, *version);
    if args.json {
        let rows: Vec<_> =
            changes.iter().map(|c| json!({"path": c.path, "from": c.from, "to": c.to})).collect();
        let at: serde_json::Map<_, _> =
            echo.iter().map(|(who, tick)| ((*who).to_owned(), json!(tick))).collect();
        output::json(&json!({"version": version, "tick": tick, "changes": rows, "applied_by_tick": at}));
    } else {
        for c in changes {
            output::line(format!(
                "{}: {} -> {} {}",
                c.path,
                human(&c.path, c.from),
                human(&c.path, c.to),
                unit(&c.path)
            ));
        }
        let by: Vec<_> = echo
            .iter()
            .map(|(who, tick)| match tick {
                Some(tick) => format!("{who} by tick {tick}"),
                None => format!("{who} not yet"),
            })
            .collect();
        output::line(format!("version {version} from tick {tick}; taken over: {}", by.join(", ")));
    }
    Ok(Exit::Done)
}

/// Waits for the services to say that they run on a version; the tick at which each was seen to.
fn echo(bench: &Bench, version: u64) -> Vec<(&'static str, Option<u64>)> {
    let begin = Instant::now();
    let mut seen = [("rig", None), ("vehicle", None), ("multibody", None)];
    let readers = [RegionId::RigStatus, RegionId::VehicleState, RegionId::SuspensionState]
        .map(|id| RegionReader::open_any(bench, id.region().name).ok());
    while seen.iter().any(|(_, tick)| tick.is_none()) && begin.elapsed() < ECHO {
        for (at, (reader, (_, tick))) in readers.iter().zip(&mut seen).enumerate() {
            let Some(reader) = reader else { continue };
            if tick.is_none() {
                *tick = version_seen(at, reader).filter(|(on, _)| *on >= version).map(|(_, n)| n);
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    seen.to_vec()
}

fn version_seen(at: usize, reader: &RegionReader) -> Option<(u64, u64)> {
    let head = reader.head();
    match at {
        0 => {
            let mut words = RigStatus::absent();
            reader.latest(head, words.words_mut())?;
            Some((words.parameters_version, words.tick))
        }
        1 => {
            let mut words = VehicleState::absent();
            reader.latest(head, words.words_mut())?;
            Some((words.parameters_version, words.tick))
        }
        _ => {
            let mut words = SuspensionState::absent();
            reader.latest(head, words.words_mut())?;
            Some((words.parameters_version, words.tick))
        }
    }
}
