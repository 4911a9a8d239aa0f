//! `procedure`: a standard's procedure run on the bench and judged, or judged on a log that is there already.

use super::log::write_whole;
use crate::args::{ProcedureArgs, ProcedureName};
use crate::exit::Exit;
use crate::output;
use config::ResolvedBench;
use config::scenario::{DriverPath, Speed, Steer};
use indicatif::{ProgressBar, ProgressStyle};
use metrics::handling::{Assessment, CarFacts, Layout, Signals, SteadyMethod};
use metrics::statistics::amplitude;
use record::LogReader;
use regions::RigStatus;
use report::{Entry, Procedure, assess, assessment_json, assessment_text, procedure_html, signals};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use study::judge::steering_ratio;
use supervisor::{Mode, Observer, Run};

/// Most runs made to reach the lateral acceleration that a standard asks for.
const ADAPTATIONS_MAX: usize = 4;
/// How near that must be. [1]
const ADAPTED: f64 = 0.03;

/// How a procedure is driven.
struct Definition {
    scenario: &'static str,
    /// The key of the amplitude and the lateral acceleration wanted of it. [m/s²]
    adapt: Option<(&'static str, f64)>,
}

fn definition(name: ProcedureName) -> Definition {
    let plain = |scenario| Definition { scenario, adapt: None };
    match name {
        ProcedureName::Weave => {
            Definition { scenario: "weave_100", adapt: Some(("steer.amplitude_deg", 2.0)) }
        }
        ProcedureName::SlowRamp => plain("slow_ramp_50"),
        ProcedureName::SteadyCircle => plain("steady_circle_r80"),
        ProcedureName::SteadySpeed => plain("steady_speed_80"),
        ProcedureName::Step => Definition { scenario: "step_100", adapt: Some(("steer.angle_deg", 4.0)) },
        ProcedureName::Random => plain("random_100"),
        ProcedureName::LaneChange => plain("double_lane_change_80"),
        ProcedureName::ObstacleAvoidance => plain("obstacle_avoidance_50"),
        ProcedureName::SineWithDwell => plain("sine_with_dwell_80"),
        ProcedureName::Returnability => plain("returnability_60"),
    }
}

/// What went wrong, and the exit code it has.
struct Refusal(Exit, String);

impl Refusal {
    fn input(text: impl ToString) -> Self {
        Refusal(Exit::BadInput, text.to_string())
    }
    fn failed(text: impl ToString) -> Self {
        Refusal(Exit::Failed, text.to_string())
    }
}

/// A run judged.
struct Judged {
    title: String,
    directory: PathBuf,
    procedure: Procedure,
    signals: Signals,
    assessment: Assessment,
}

/// `kingpin procedure`.
pub fn procedure(args: &ProcedureArgs) -> Exit {
    match make(args) {
        Ok(exit) => exit,
        Err(Refusal(exit, text)) => {
            if args.json {
                output::json(&json!({ "error": text }));
            } else {
                output::note(text);
            }
            exit
        }
    }
}

fn make(args: &ProcedureArgs) -> Result<Exit, Refusal> {
    let judged = match &args.log {
        Some(log) => vec![judge(args, log, String::from("the log"), None)?],
        None => run_all(args)?,
    };
    let name = judged[0].assessment.procedure;
    let directory = args.log.clone().unwrap_or_else(|| out_directory(args));
    let directory = if directory.is_dir() {
        directory
    } else {
        directory.parent().map(Path::to_path_buf).unwrap_or_default()
    };
    let entries: Vec<Entry<'_>> = judged
        .iter()
        .map(|run| Entry {
            title: run.title.clone(),
            procedure: &run.procedure,
            signals: &run.signals,
            assessment: &run.assessment,
            link: run
                .directory
                .strip_prefix(&directory)
                .ok()
                .map(|path| path.join("report.html"))
                .filter(|path| directory.join(path).is_file())
                .map(|path| path.display().to_string()),
        })
        .collect();
    let page = procedure_html(name, &[], &entries);
    let page_path = directory.join("procedure.html");
    let write = |path: &Path, text: &str| {
        write_whole(path, |out| out.write_all(text.as_bytes()).map_err(|e| e.to_string()))
            .map_err(|e| Refusal(Exit::Unavailable, e))
    };
    write(&page_path, &page)?;
    let broken =
        judged.iter().flat_map(|run| &run.assessment.rulings).filter(|r| r.kept == Ok(false)).count();
    let valid = judged.iter().all(|run| run.assessment.valid());
    let result = json!({
        "procedure": name,
        "valid": valid,
        "passed": valid && broken == 0,
        "runs": judged.iter().map(|run| json!({
            "title": run.title,
            "directory": run.directory,
            "assessment": assessment_json(&run.assessment),
        })).collect::<Vec<_>>(),
        "page": page_path,
    });
    write(&directory.join("procedure.json"), &serde_json::to_string_pretty(&result).unwrap_or_default())?;
    if args.json {
        output::json(&result);
    } else {
        for run in &judged {
            output::line(format!("{}: {}", run.title, assessment_text(&run.assessment)));
        }
        output::line(format!("  {}", page_path.display()));
        output::line(format!("  {}", directory.join("procedure.json").display()));
    }
    Ok(if valid && broken == 0 { Exit::Done } else { Exit::Failed })
}

fn out_directory(args: &ProcedureArgs) -> PathBuf {
    let name = clap::ValueEnum::to_possible_value(&args.procedure)
        .map_or_else(String::new, |v| v.get_name().to_owned());
    args.out.clone().unwrap_or_else(|| Path::new("runs").join(format!("procedure-{name}")))
}

/// Makes the runs of the procedure.
fn run_all(args: &ProcedureArgs) -> Result<Vec<Judged>, Refusal> {
    let directory = out_directory(args);
    if directory.exists() && std::fs::read_dir(&directory).is_ok_and(|mut entries| entries.next().is_some()) {
        return Err(Refusal(
            Exit::Unavailable,
            format!("{}: not empty; name another directory with --out", directory.display()),
        ));
    }
    let definition = definition(args.procedure);
    if args.procedure == ProcedureName::SineWithDwell {
        return dwell_series(args, &directory);
    }
    let Some((key, target)) = definition.adapt.filter(|_| !args.as_is) else {
        let run = directory.join("run");
        perform(args, definition.scenario, &[], &run)?;
        return Ok(vec![judge(args, &run, "run".to_owned(), None)?]);
    };
    let mut overrides: Vec<String> = Vec::new();
    let mut judged = Vec::new();
    for attempt in 1..=ADAPTATIONS_MAX {
        let run = directory.join(format!("run-{attempt}"));
        let resolved = perform(args, definition.scenario, &overrides, &run)?;
        let title = format!("run {attempt}");
        let found = judge(args, &run, title, None)?;
        let achieved = achieved(&found);
        judged.push(found);
        if achieved.is_nan() || achieved <= 0.0 || (achieved / target - 1.0).abs() <= ADAPTED {
            break;
        }
        // Not linear near the limit of grip: half steps on a logarithmic scale would be slower and no safer.
        let amplitude_deg = amplitude_of(&resolved.scenario.steer).unwrap_or(0.0) * target / achieved;
        if !args.json {
            output::note(format!(
                "{achieved:.2} m/s² reached of {target:.2}: again with {key} = {amplitude_deg:.2}"
            ));
        }
        overrides = vec![format!("{key}={amplitude_deg:?}")];
    }
    // The last one is the one that counts; the others only led to it.
    Ok(judged.pop().into_iter().collect())
}

fn amplitude_of(steer: &Steer) -> Option<f64> {
    match steer {
        Steer::Weave(weave) => Some(weave.amplitude_deg),
        Steer::Step(step) => Some(step.angle_deg),
        _ => None,
    }
}

/// The lateral acceleration that a run is adapted by. [m/s²]
fn achieved(run: &Judged) -> f64 {
    let names = ["peak lateral acceleration", "steady lateral acceleration"];
    run.assessment
        .conditions
        .iter()
        .find(|condition| names.contains(&condition.name))
        .map_or_else(|| amplitude(&run.signals.lateral_acceleration_m_s2), |condition| condition.achieved)
}

/// FMVSS 126: the slowly increasing steer gives the angle A at 0.3 g, then the series in multiples of A.
fn dwell_series(args: &ProcedureArgs, directory: &Path) -> Result<Vec<Judged>, Refusal> {
    let slow = directory.join("slowly_increasing_steer");
    let resolved = perform(args, "ramp_80", &[], &slow)?;
    let log = open(&slow)?;
    let whole = signals(&log, resolved.scenario.warm_up_s, f64::INFINITY).map_err(Refusal::failed)?;
    // Linear regression from 0.1 g to 0.375 g over the rise [49 CFR 571.126, S7.6.1].
    let acceleration = &whole.lateral_acceleration_m_s2;
    let rise = acceleration.iter().position(|a| a.abs() > 0.375 * 9.806_65).unwrap_or(acceleration.len());
    let (x, y): (Vec<f64>, Vec<f64>) = (0..rise)
        .filter(|&i| acceleration[i].abs() > 0.1 * 9.806_65)
        .map(|i| (whole.hand_wheel_angle_rad[i].abs(), acceleration[i].abs()))
        .unzip();
    let line = metrics::fit::line(&x, &y).filter(|line| line.slope > 0.0 && rise < acceleration.len());
    let line = line.ok_or_else(|| {
        Refusal::failed("the slowly increasing steer did not reach 0.375 g: A is not known")
    })?;
    let a_rad = (0.3 * 9.806_65 - line.intercept) / line.slope;
    if !args.json {
        output::note(format!("A = {:.1}° at the hand wheel gives 0.3 g", a_rad.to_degrees()));
    }
    // Steps of half A up to 6.5 A or 270°, whichever is more, but not beyond 300° [S7.9.4].
    let last = f64::clamp(270.0, 6.5 * a_rad.to_degrees(), 300.0);
    let mut factors: Vec<f64> = if args.factor.is_empty() {
        (3..=13).map(|i| 0.5 * f64::from(i)).collect()
    } else {
        args.factor.clone()
    };
    factors.retain(|factor| factor * a_rad.to_degrees() <= last + 1e-9);
    let mut judged = Vec::new();
    for factor in factors {
        for (side, sign) in [("left first", 1.0), ("right first", -1.0)] {
            if sign < 0.0 && !args.both_sides {
                continue;
            }
            let degrees = sign * factor * a_rad.to_degrees();
            let run = directory.join(format!("run-{factor:.1}A-{}", &side[..side.find(' ').unwrap_or(0)]));
            perform(args, "sine_with_dwell_80", &[format!("steer.amplitude_deg={degrees:?}")], &run)?;
            judged.push(judge(args, &run, format!("{factor:.1} A, {side}"), Some(a_rad))?);
        }
    }
    Ok(judged)
}

fn open(directory: &Path) -> Result<LogReader, Refusal> {
    LogReader::open(directory).map_err(|e| Refusal::input(format!("{}: {e}", directory.display())))
}

/// Judges a log.
fn judge(args: &ProcedureArgs, path: &Path, title: String, a_rad: Option<f64>) -> Result<Judged, Refusal> {
    let log = open(path)?;
    let resolved = ResolvedBench::from_json(&log.header.configuration).map_err(Refusal::input)?;
    let scenario = &resolved.scenario;
    let other = || {
        Refusal::input(format!(
            "{}: scenario {} does not steer as {} needs it",
            path.display(),
            scenario.name,
            clap::ValueEnum::to_possible_value(&args.procedure)
                .map_or_else(String::new, |v| v.get_name().to_owned())
        ))
    };
    let mut from_s = scenario.warm_up_s;
    let mut to_s = f64::INFINITY;
    let procedure = match (args.procedure, &scenario.steer) {
        (ProcedureName::Weave, Steer::Weave(weave)) => Procedure::Weave(weave.frequency_hz),
        (ProcedureName::SlowRamp, Steer::Sine(sine)) => {
            // The full cycles only: while the amplitude grows the loop is open.
            from_s += sine.start_s + sine.fade_in_cycles / sine.frequency_hz;
            to_s = from_s + sine.cycles / sine.frequency_hz;
            Procedure::SlowRamp
        }
        (ProcedureName::SteadyCircle, Steer::Path(following)) => match following.path {
            DriverPath::Circle { radius_m, .. } => {
                Procedure::SteadyTurn(SteadyMethod::ConstantRadius(radius_m.abs()))
            }
            _ => return Err(other()),
        },
        (ProcedureName::SteadySpeed, Steer::Ramp(_)) => Procedure::SteadyTurn(SteadyMethod::ConstantSpeed),
        (ProcedureName::Step, Steer::Step(_)) => Procedure::Step,
        (ProcedureName::Random, Steer::Random(random)) => {
            to_s = from_s + random.end_s;
            from_s += random.start_s;
            Procedure::Random
        }
        (ProcedureName::LaneChange | ProcedureName::ObstacleAvoidance, Steer::Path(following)) => {
            match following.path {
                DriverPath::DoubleLaneChangeIso3888Part1 { straight_m, vehicle_width_m } => {
                    Procedure::LaneChange(Layout::double_lane_change(vehicle_width_m), straight_m)
                }
                DriverPath::ObstacleAvoidanceIso3888Part2 { straight_m, vehicle_width_m } => {
                    Procedure::LaneChange(Layout::obstacle_avoidance(vehicle_width_m), straight_m)
                }
                _ => return Err(other()),
            }
        }
        (ProcedureName::SineWithDwell, Steer::SineWithDwell(_)) => {
            Procedure::SineWithDwell(a_rad.or(args.angle_at_0_3_g_deg.map(f64::to_radians)))
        }
        (ProcedureName::Returnability, _) => Procedure::Release(scenario.hands_off_s.ok_or_else(other)?),
        _ => return Err(other()),
    };
    let width_m = match &scenario.steer {
        Steer::Path(following) => match following.path {
            DriverPath::DoubleLaneChangeIso3888Part1 { vehicle_width_m, .. }
            | DriverPath::ObstacleAvoidanceIso3888Part2 { vehicle_width_m, .. } => vehicle_width_m,
            _ => f64::NAN,
        },
        _ => f64::NAN,
    };
    let car = &resolved.car;
    let mass_kg = car.body.sprung_mass_kg + car.front.unsprung_mass_kg + car.rear.unsprung_mass_kg;
    let needs_ratio = matches!(procedure, Procedure::SteadyTurn(_) | Procedure::Random);
    let ratio = steering_ratio(&log, &resolved);
    if needs_ratio && ratio.is_none() {
        return Err(Refusal::failed(format!(
            "{}: the steering ratio cannot be told: the hand wheel hardly moved",
            path.display()
        )));
    }
    let facts = CarFacts {
        steering_ratio: ratio.unwrap_or(f64::NAN),
        wheelbase_m: car.body.wheelbase_m,
        mass_kg,
        width_m,
        front_m: car.body.front_axle_to_sprung_cg_m + args.front_overhang_m,
        rear_m: car.body.wheelbase_m - car.body.front_axle_to_sprung_cg_m + args.rear_overhang_m,
    };
    let moving = !matches!(scenario.speed, Speed::Constant { speed_km_h: 0.0 });
    if !moving {
        return Err(other());
    }
    let signals = signals(&log, from_s, to_s).map_err(Refusal::failed)?;
    if signals.is_empty() {
        return Err(Refusal::failed(format!("{}: the log ends before the manoeuvre begins", path.display())));
    }
    let assessment = assess(&procedure, &signals, &facts);
    let directory = if path.is_dir() {
        path.to_path_buf()
    } else {
        path.parent().map(Path::to_path_buf).unwrap_or_default()
    };
    Ok(Judged { title, directory, procedure, signals, assessment })
}

/// Runs a scenario into a directory.
fn perform(
    args: &ProcedureArgs,
    scenario: &str,
    more: &[String],
    directory: &Path,
) -> Result<ResolvedBench, Refusal> {
    let scenario = args.scenario.as_deref().unwrap_or(scenario);
    let mut overrides = args.set.clone();
    overrides.extend_from_slice(more);
    let resolved = super::history::load_bench(scenario, &overrides).map_err(Refusal::input)?;
    let bench = table::Bench::new(&args.name).map_err(Refusal::input)?;
    std::fs::create_dir_all(directory)
        .map_err(|e| Refusal(Exit::Unavailable, format!("{}: {e}", directory.display())))?;
    let run = Run {
        bench,
        resolved: resolved.clone(),
        directory: directory.to_path_buf(),
        mode: if args.real_time { Mode::Paced } else { Mode::LockstepProcess },
        restart_delay_ns: 0,
        rearm: false,
        faults: false,
        fault_plan: Vec::new(),
        versions: BTreeMap::from([("kingpin".to_owned(), env!("CARGO_PKG_VERSION").to_owned())]),
        operated: false,
    };
    let interrupt = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM] {
        let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&interrupt));
        let _ = signal_hook::flag::register(signal, Arc::clone(&interrupt));
    }
    let mut bar = Bar::new(&resolved.scenario.name, args.json);
    let outcome =
        supervisor::run(&run, &interrupt, &mut bar).map_err(|e| Refusal(Exit::Unavailable, e.to_string()))?;
    bar.0.finish_and_clear();
    if interrupt.load(Ordering::Relaxed) {
        return Err(Refusal(Exit::Interrupted, "interrupted; the rig was stopped softly".to_owned()));
    }
    let log = open(directory)?;
    super::summary::write_all(&log, directory, !args.no_report, &json!({})).map_err(Refusal::failed)?;
    if outcome.last_status.trip_code != 0 {
        return Err(Refusal::failed(format!(
            "{}: tripped: code {} at tick {}",
            resolved.scenario.name, outcome.last_status.trip_code, outcome.last_status.trip_tick
        )));
    }
    Ok(resolved)
}

/// A progress bar.
struct Bar(ProgressBar);

impl Bar {
    fn new(name: &str, quiet: bool) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
        let style = ProgressStyle::with_template("{prefix} {bar:30} {percent:>3} %  {eta}");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(name.to_owned());
        Bar(bar)
    }
}

impl Observer for Bar {
    fn progress(&mut self, done: u64, all: u64, _: &RigStatus) {
        self.0.set_length(all);
        self.0.set_position(done);
    }

    fn note(&mut self, line: &str) {
        self.0.println(line);
    }
}
