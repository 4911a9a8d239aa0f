//! `model simulate` and `model plot`: a model run on its own.

use super::arguments::{DriveArgs, PlotArgs, SimulateArgs};
use super::series::{Series, means};
use super::{Wrong, lines, load, number, place, write};
use crate::commands::suspension::page::{Figure, Table, html};
use crate::exit::Exit;
use crate::output;
use functional_model::{CompileOptions, Compiled, System};
use std::fmt::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Most steps of a run.
const STEPS_MAX: f64 = 1e9;
/// Step where the file says none. [s]
const STEP_S: f64 = 1e-4;

/// What a run gave.
pub struct Run {
    /// Times. [s]
    pub time_s: Vec<f64>,
    /// Header and values of each column.
    pub columns: Vec<(String, Vec<f64>)>,
    /// Steps that did not converge or held a state.
    pub faults: u64,
    /// Stopped by the user.
    pub stopped: bool,
    /// Worst power residual relative to the power flowing; imbalance relative to the energy moved.
    pub account: Option<(f64, f64)>,
}

/// How to record.
pub struct Keep {
    /// Every n-th step.
    pub every: u32,
    /// States too.
    pub states: bool,
    /// Powers and energies too.
    pub account: bool,
}

/// Where each input comes from.
enum Source {
    Constant(f64),
    Column(usize),
}

fn sources(drive: &DriveArgs, system: &System, series: Option<&Series>) -> Result<Vec<Source>, Wrong> {
    let names = system.input_names();
    let mut sources: Vec<Source> = names.iter().map(|_| Source::Constant(0.0)).collect();
    if let Some(series) = series {
        for (k, column) in series.columns.iter().enumerate() {
            if let Some(i) = names.iter().position(|n| means(&column.header, n)) {
                sources[i] = Source::Column(k);
            }
        }
    }
    for text in &drive.constant {
        let (name, value) = number("--constant", text)?;
        sources[place("--constant", name, &names, "input")?] = Source::Constant(value);
    }
    Ok(sources)
}

fn header(name: &str, unit: &str) -> String {
    format!("{name} [{unit}]")
}

/// Runs a model as the arguments say, on `series` where there is one.
pub fn run(drive: &DriveArgs, system: &System, series: Option<&Series>, keep: &Keep) -> Result<Run, Wrong> {
    let mut compiled = system
        .compile(CompileOptions { account: keep.account, ..CompileOptions::default() })
        .map_err(|errors| lines(&errors))?;
    let sources = sources(drive, system, series)?;
    let dt = drive.dt.or(system.sample_s()).unwrap_or(STEP_S);
    if dt <= 0.0 || !dt.is_finite() {
        return Err(format!("--dt {dt}: must be above 0"));
    }
    let begin = series.map_or(0.0, |s| s.time_s[0]);
    let length = match (drive.duration, series) {
        (Some(duration), _) => duration,
        (None, Some(series)) => series.time_s[series.time_s.len() - 1] - begin,
        (None, None) => return Err("how long? give --duration, or --input with a drive".to_owned()),
    };
    let steps = (length / dt).round();
    if !(1.0..=STEPS_MAX).contains(&steps) {
        return Err(format!("--duration {length}: must be 1 to {STEPS_MAX:e} steps of {dt} s"));
    }
    if !drive.start.is_empty() {
        let names = system.state_names();
        let mut states = compiled.states().to_vec();
        for text in &drive.start {
            let (name, value) = number("--start", text)?;
            states[place("--start", name, &names, "state")?] = value;
        }
        compiled.set_states(&states);
    }
    let mut headers: Vec<String> =
        system.output_names().iter().zip(system.output_units()).map(|(n, u)| header(n, &u)).collect();
    if keep.states {
        let states = system.state_names();
        headers.extend(states.iter().zip(system.state_units()).map(|(n, u)| header(n, &u)));
    }
    if keep.account {
        let names = [
            "residual_w",
            "flow_w",
            "stored_j",
            "entered_j",
            "supplied_j",
            "lost_j",
            "unstated_j",
            "imbalance_j",
        ];
        headers.extend(names.map(str::to_owned));
    }
    let mut result = Run {
        time_s: Vec::new(),
        columns: headers.into_iter().map(|h| (h, Vec::new())).collect(),
        faults: 0,
        stopped: false,
        account: None,
    };
    let stop = Arc::new(AtomicBool::new(false));
    // Where the handler is refused, Ctrl-C ends the command at once, as it did before.
    let handler = signal_hook::flag::register(signal_hook::consts::SIGINT, Arc::clone(&stop)).ok();
    let bar = progress(steps);
    let mut inputs = vec![0.0; sources.len()];
    let (mut worst, mut open) = (0.0f64, 0.0f64);
    record(&compiled, begin, keep, &mut result);
    for k in 0..steps as u64 {
        let t = begin + k as f64 * dt;
        for (u, source) in inputs.iter_mut().zip(&sources) {
            *u = match (source, series) {
                (Source::Column(c), Some(s)) => {
                    s.at(*c, if drive.hold { t } else { t + 0.5 * dt }, drive.hold)
                }
                (Source::Constant(v), _) => *v,
                _ => 0.0,
            };
        }
        let status = compiled.step(&inputs, dt);
        result.faults += u64::from(status.not_converged || status.state_held);
        if let Some(a) = compiled.account() {
            worst = worst.max(a.worst_residual());
            if a.moved_j > 0.0 {
                open = open.max(a.imbalance_j().abs() / a.moved_j);
            }
        }
        if (k + 1).is_multiple_of(u64::from(keep.every)) {
            record(&compiled, begin + (k + 1) as f64 * dt, keep, &mut result);
        }
        if k.is_multiple_of(10_000) {
            bar.set_position(k);
            if stop.load(Ordering::Relaxed) {
                result.stopped = true;
                break;
            }
        }
    }
    bar.finish_and_clear();
    if let Some(handler) = handler {
        signal_hook::low_level::unregister(handler);
    }
    result.account = keep.account.then_some((worst, open));
    Ok(result)
}

fn progress(steps: f64) -> indicatif::ProgressBar {
    // Some steps take microseconds: below this a run is over before anybody looks.
    if steps < 2e5 {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(steps as u64);
    if let Ok(style) = indicatif::ProgressStyle::with_template("{wide_bar} {percent}% {eta}") {
        bar.set_style(style);
    }
    bar
}

fn record(compiled: &Compiled, t: f64, keep: &Keep, run: &mut Run) {
    run.time_s.push(t);
    let mut at = 0;
    let mut put = |v: f64| {
        run.columns[at].1.push(v);
        at += 1;
    };
    compiled.outputs().iter().for_each(|v| put(*v));
    if keep.states {
        compiled.states().iter().for_each(|v| put(*v));
    }
    if let Some(a) = compiled.account() {
        put(a.residual_w.iter().fold(0.0, |m, v| m.max(v.abs())));
        put(a.flowing_w.iter().fold(0.0, |m, v| m.max(*v)));
        for v in [a.stored_j, a.entered_j, a.supplied_j, a.lost_j, a.unstated_j, a.imbalance_j()] {
            put(v);
        }
    }
}

/// The input file's columns that the model takes.
pub fn input(drive: &DriveArgs, system: &System) -> Result<Option<Series>, Wrong> {
    let Some(path) = &drive.input else { return Ok(None) };
    let (names, units) = (system.input_names(), system.input_units());
    let series = Series::read(path, |h| names.iter().position(|n| means(h, n)).map(|k| units[k].clone()))?;
    if series.columns.is_empty() {
        return Err(format!(
            "{}: no column is an input of the model; inputs are: {}",
            series.name,
            names.join(", ")
        ));
    }
    Ok(Some(series))
}

/// How a run ended.
pub fn ended(run: &Run) -> Exit {
    if run.stopped {
        output::note("stopped by Ctrl-C; what was computed is written");
        return Exit::Interrupted;
    }
    if run.faults > 0 {
        output::note(format!("{} steps did not converge or held their state", run.faults));
        return Exit::Failed;
    }
    Exit::Done
}

/// `kingpin model simulate`.
pub fn simulate(args: &SimulateArgs) -> Result<Exit, Wrong> {
    let (_, system) = load(&args.drive.model, &args.drive.set)?;
    let series = input(&args.drive, &system)?;
    let keep = Keep { every: args.every, states: args.states, account: args.account };
    let run = run(&args.drive, &system, series.as_ref(), &keep)?;
    let mut text = String::with_capacity(run.time_s.len() * (run.columns.len() + 1) * 14);
    text += "time_s";
    for (name, _) in &run.columns {
        let _ = write!(text, ",{name}");
    }
    text.push('\n');
    for (k, t) in run.time_s.iter().enumerate() {
        let _ = write!(text, "{}", (t * 1e9).round() / 1e9);
        for (_, values) in &run.columns {
            let _ = write!(text, ",{}", values[k]);
        }
        text.push('\n');
    }
    write(&args.output, &text)?;
    if let Some((residual, imbalance)) = run.account {
        output::line(format!(
            "power residual at most {residual:.1e} of the power flowing; energy account open by at most {imbalance:.1e} of the energy moved"
        ));
    }
    Ok(ended(&run))
}

/// A curve thinned to what a page needs.
pub fn thinned(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let every = x.len().div_ceil(4000).max(1);
    let take = |v: &[f64]| v.iter().step_by(every).copied().collect();
    (take(x), take(y))
}

/// `kingpin model plot`.
pub fn plot(args: &PlotArgs) -> Result<Exit, Wrong> {
    let (model, system) = load(&args.drive.model, &args.drive.set)?;
    let series = input(&args.drive, &system)?;
    let names = system.output_names();
    let mut paths = Vec::new();
    for text in &args.path {
        let (x, y) = text.split_once(':').ok_or_else(|| format!("--path {text}: must be X:Y"))?;
        paths.push((place("--path", x, &names, "output")?, place("--path", y, &names, "output")?));
    }
    let run = run(&args.drive, &system, series.as_ref(), &Keep { every: 1, states: false, account: false })?;
    let mut figures = Vec::new();
    for (k, (name, values)) in run.columns.iter().enumerate() {
        let mut figure = Figure::new(name, "time [s]", name);
        let (x, y) = thinned(&run.time_s, values);
        figure.curve(&names[k], &x, &y, 1, "solid");
        figures.push(figure);
    }
    for (x, y) in paths {
        let (a, b) = (&run.columns[x], &run.columns[y]);
        let mut figure = Figure::new(&format!("{} over {}", b.0, a.0), &a.0, &b.0);
        let (across, up) = thinned(&a.1, &b.1);
        figure.curve("", &across, &up, 1, "solid");
        figures.push(figure);
        let integral = |v: &[f64]| {
            let mut sum = 0.0;
            let mut path = vec![0.0];
            for k in 1..v.len() {
                sum += 0.5 * (v[k] + v[k - 1]) * (run.time_s[k] - run.time_s[k - 1]);
                path.push(sum);
            }
            path
        };
        let (across, up) = thinned(&integral(&a.1), &integral(&b.1));
        let mut figure = Figure::new(
            "path: both integrated over time",
            &format!("integral of {}", a.0),
            &format!("integral of {}", b.0),
        );
        figure.curve("", &across, &up, 2, "solid");
        figures.push(figure);
    }
    let parameters = system.parameters().into_iter();
    let mut rows = vec![["parameter", "value", "unit (SI)"].map(str::to_owned).to_vec()];
    rows.extend(parameters.map(|p| vec![p.name, format!("{:.6e}", p.value), p.unit]));
    let table = Table { title: "Parameters".to_owned(), rows };
    write(&args.output, &html(model.name(), model.about().unwrap_or(""), &[table], &figures))?;
    Ok(ended(&run))
}
