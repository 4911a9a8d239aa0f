//! `fmu`: what an FMU is, whether it loads, what a step of it costs.

use crate::exit::Exit;
use crate::output;
use clap::{Args as ClapArgs, Subcommand};
use fmu::{Causality, Fmu, FmuError, Hosted, Joints, Setup, Stepper, Value, Wanted};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::Duration;

const ABOUT: &str = "\
An FMU (functional mock-up unit, FMI 2.0 or 3.0 for co-simulation) is a user's own model. In the loop it runs in a \
process of its own; a scenario names it:

  [[fmu]]
  name = \"abs\"
  file = \"abs.fmu\"
  inputs = { speed = \"vehicle_state.velocity_m_s.x\", pressure = \"vehicle.brake_pressure_pa_fl\" }
  outputs = { ratio = { to = \"brake_line_pressure_pa_fl\", mode = \"multiply\", min = 0.0, max = 1.0 } }
  parameters = { slip_high = 0.15 }
  every_ticks = 1
  budget_s = 0.0003
  hang_s = 0.5
  on_loss = \"hold\"

Units are converted between the FMU's and the bench's. More: docs/FMU.md.";

/// Arguments of `fmu`.
#[derive(Debug, ClapArgs)]
#[command(after_help = ABOUT)]
pub struct FmuArgs {
    /// What to do.
    #[command(subcommand)]
    command: FmuCommand,
}

/// Commands of `fmu`.
#[derive(Debug, Subcommand)]
enum FmuCommand {
    /// Look into an FMU, load it, run it, measure a step
    Check(CheckArgs),
    /// Pack the car or the suspension as an FMU for other tools
    Export(super::fmu_export::ExportArgs),
}

const CHECK_HELP: &str = "\
The FMU is loaded in a process of its own and stepped with its start values. Told: its variables with units (SI \
conversions known), causality and start value; a step's time (p50, p99.9, max) around set, doStep and get, without the \
way to the process and back; heap calls in a step.

Heap calls are those of malloc, calloc, realloc, aligned_alloc and posix_memalign in the FMU's process during its \
steps, whoever made them (C, C++, Rust): the executable defines these functions and hands them on to the C library's.

Exit code 0: sound, and p99.9 within the budget; 1: sound, but too slow, or its outputs are not finite; 2: not sound.

Example:
  kingpin fmu check abs.fmu --steps 20000 --step-ms 1 --budget-ms 0.3 --set slip_high=0.2";

/// Arguments of `fmu check`.
#[derive(Debug, ClapArgs)]
#[command(after_help = CHECK_HELP)]
struct CheckArgs {
    /// The FMU
    #[arg(value_name = "FILE.fmu")]
    file: PathBuf,
    /// Steps measured, behind a tenth as many to warm up
    #[arg(long, default_value_t = 20_000, value_name = "N")]
    steps: u32,
    /// Length of a step [ms]
    #[arg(long, default_value_t = 1.0, value_name = "MS")]
    step_ms: f64,
    /// Time that a step may take [ms]
    #[arg(long, default_value_t = 0.3, value_name = "MS")]
    budget_ms: f64,
    /// Give a parameter or start value, in the FMU's unit; may be repeated
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Longest wait for an answer of the FMU [s]
    #[arg(long, default_value_t = 10.0, value_name = "S")]
    patience_s: f64,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// `kingpin fmu`.
pub fn fmu(args: &FmuArgs) -> Exit {
    let args = match &args.command {
        FmuCommand::Check(args) => args,
        FmuCommand::Export(args) => return super::fmu_export::export(args),
    };
    match check(args) {
        Ok(exit) => exit,
        Err(faults) => {
            if args.json {
                output::json(&json!({ "valid": false, "faults": faults }));
            } else {
                for fault in faults {
                    output::note(format!("{}: {fault}", args.file.display()));
                }
            }
            Exit::BadInput
        }
    }
}

/// What was measured, times in seconds.
struct Measured {
    seconds: Vec<f64>,
    allocations: u64,
    steps_with_allocations: u64,
    not_finite: Vec<String>,
}

/// A folder that goes with this.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn told(error: &FmuError) -> Vec<String> {
    vec![error.to_string()]
}

fn check(args: &CheckArgs) -> Result<Exit, Vec<String>> {
    let mut wrong = Vec::new();
    if args.steps == 0 || args.steps > 10_000_000 {
        wrong.push(format!("--steps = {}: must be in [1, 10000000]", args.steps));
    }
    for (name, value, high) in [
        ("--step-ms", args.step_ms, 1e6),
        ("--budget-ms", args.budget_ms, 1e6),
        ("--patience-s", args.patience_s, 3600.0),
    ] {
        if !(value > 0.0 && value <= high) {
            wrong.push(format!("{name} = {value}: must be in (0, {high}]"));
        }
    }
    let opened = Fmu::open(&args.file).map_err(|error| wrong.push(error.to_string())).ok();
    let Some(fmu) = opened.filter(|_| wrong.is_empty()) else { return Err(wrong) };
    let unique = format!("kingpin-fmu-check-{}", std::process::id());
    let folder = Folder(std::env::temp_dir().join(unique));
    let setup = join(&fmu, &folder.0, &args.set)?;
    let step_s = args.step_ms * 1e-3;
    fmu::check_step(&fmu.description, step_s).map_err(|error| told(&error))?;
    fmu.extract(&folder.0).map_err(|error| told(&error))?;
    let measured = measure(&fmu, &setup, args, step_s).map_err(|error| told(&error))?;
    let python = fmu.python();
    Ok(report(&fmu, &setup, args, python.as_deref(), measured))
}

/// All inputs at their start values, all numeric outputs.
fn join(fmu: &Fmu, folder: &Path, set: &[String]) -> Result<Setup, Vec<String>> {
    let d = &fmu.description;
    let of = |causality: Causality| {
        let fits = move |v: &&fmu::Variable| v.causality == causality && v.kind.numeric() && !v.array;
        d.variables.iter().filter(fits)
    };
    let wanted = |v: &'_ fmu::Variable| (v.name.clone(), v.unit.clone().unwrap_or_else(|| "1".to_owned()));
    let known = |name: &str| d.unit(name).is_some();
    let inputs: Vec<_> = of(Causality::Input).map(wanted).collect();
    let outputs: Vec<_> = of(Causality::Output).map(wanted).collect();
    let mut wrong = Vec::new();
    for (name, unit) in inputs.iter().chain(&outputs).filter(|(_, unit)| unit != "1" && !known(unit)) {
        output::note(format!("{name}: what unit {unit} means is not known: in a scenario say it with units"));
    }
    let plain = |list: &[(String, String)]| -> Vec<(String, &'static str)> {
        list.iter().map(|(name, _)| (name.clone(), "SI")).collect()
    };
    let (inputs, outputs) = (plain(&inputs), plain(&outputs));
    let (mut parameters, mut start) = (Vec::new(), Vec::new());
    for text in set {
        let Some((name, value)) = text.split_once('=') else {
            wrong.push(format!("--set {text}: must be NAME=VALUE"));
            continue;
        };
        let value = match value.trim() {
            "true" => Value::Number(1.0),
            "false" => Value::Number(0.0),
            other => other.parse().map_or_else(|_| Value::Text(other.to_owned()), Value::Number),
        };
        match d.variable(name.trim()) {
            Ok(v) if v.causality == Causality::Parameter => parameters.push((name.trim(), value)),
            Ok(_) => start.push((name.trim(), value)),
            Err(error) => wrong.push(error.to_string()),
        }
    }
    let unknown = |name: &str| d.variable(name).ok().and_then(|v| v.unit.clone()).filter(|unit| !known(unit));
    let units: std::collections::BTreeMap<String, String> = inputs
        .iter()
        .chain(&outputs)
        .filter(|(name, _)| unknown(name).is_some())
        .map(|(name, _)| (name.clone(), "1".to_owned()))
        .collect();
    let inputs: Vec<_> = inputs.iter().map(|(name, unit)| Wanted { name, unit }).collect();
    let outputs: Vec<_> = outputs.iter().map(|(name, unit)| Wanted { name, unit }).collect();
    let joints = Joints {
        inputs: &inputs,
        outputs: &outputs,
        parameters: &parameters,
        start: &start,
        units: Some(&units),
    };
    let joined = Setup::new(fmu, &d.model_name, folder, &joints);
    match joined {
        Ok(mut setup) if wrong.is_empty() => {
            if fmu.python().is_some() {
                setup.interpreter = fmu::interpreter();
            }
            Ok(setup)
        }
        Ok(_) => Err(wrong),
        Err(faults) => {
            wrong.extend(faults.iter().map(ToString::to_string));
            Err(wrong)
        }
    }
}

/// Values at which the inputs rest: given with --set, else the FMU's start values, else zero. In SI units.
fn resting(fmu: &Fmu, setup: &Setup) -> Vec<f64> {
    let value = |port: &fmu::Port| {
        let given = setup.start.iter().find(|(reference, ..)| *reference == port.reference);
        let stated = fmu.description.variables.iter().find(|v| v.reference == port.reference);
        let stated = stated.and_then(|v| v.start.as_deref()).and_then(|text| match text.trim() {
            "true" => Some(1.0),
            "false" => Some(0.0),
            number => number.parse::<f64>().ok(),
        });
        let own = match given {
            Some((_, _, Value::Number(number))) => *number,
            _ => stated.filter(|number| number.is_finite()).unwrap_or(0.0),
        };
        (own - port.conversion.zero) / port.conversion.gain
    };
    setup.inputs.iter().map(value).collect()
}

fn measure(fmu: &Fmu, setup: &Setup, args: &CheckArgs, step_s: f64) -> Result<Measured, FmuError> {
    let executable =
        std::env::current_exe().map_err(|e| FmuError::Io { path: "kingpin".into(), why: e.to_string() })?;
    let patience = Duration::from_secs_f64(args.patience_s);
    let mut hosted =
        Hosted::start(&executable, &["service", "fmu_host", "--bench", "none"], setup, patience)?;
    let inputs = resting(fmu, setup);
    let mut outputs = vec![0.0; setup.outputs.len()];
    let warm_up = args.steps / 10;
    let all = warm_up + args.steps;
    let bar = ProgressBar::with_draw_target(Some(u64::from(all)), ProgressDrawTarget::stderr_with_hz(4));
    let style = ProgressStyle::with_template("stepping {bar:30} {percent} %, {eta} left");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let mut measured = Measured {
        seconds: Vec::with_capacity(args.steps as usize),
        allocations: 0,
        steps_with_allocations: 0,
        not_finite: Vec::new(),
    };
    let mut bad = vec![false; outputs.len()];
    for n in 0..all {
        let cost = hosted.step(f64::from(n) * step_s, step_s, &inputs, &mut outputs)?;
        for (bad, value) in bad.iter_mut().zip(&outputs) {
            *bad |= !value.is_finite();
        }
        if n >= warm_up {
            measured.seconds.push(cost.seconds);
            measured.allocations += cost.allocations;
            measured.steps_with_allocations += u64::from(cost.allocations > 0);
        }
        if n.is_multiple_of(256) {
            bar.set_position(u64::from(n));
        }
    }
    bar.finish_and_clear();
    let bad = bad.iter().enumerate().filter(|(_, bad)| **bad);
    measured.not_finite = bad.map(|(i, _)| format!("output {i}")).collect();
    Ok(measured)
}

fn report(fmu: &Fmu, setup: &Setup, args: &CheckArgs, python: Option<&str>, mut measured: Measured) -> Exit {
    let d = &fmu.description;
    measured.seconds.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let rank = (share * measured.seconds.len() as f64).ceil() as usize;
        measured.seconds[rank.clamp(1, measured.seconds.len()) - 1] * 1e6
    };
    let (p50, p999, max) = (at(0.5), at(0.999), at(1.0));
    let budget_us = args.budget_ms * 1e3;
    let in_time = p999 <= budget_us;
    let per_step = measured.allocations as f64 / measured.seconds.len() as f64;
    let real_time = python.is_none() && in_time && measured.not_finite.is_empty();
    if args.json {
        let variables: Vec<_> = d
            .variables
            .iter()
            .map(|v| {
                json!({
                    "name": v.name, "type": format!("{:?}", v.kind), "causality": v.causality.name(),
                    "variability": v.variability, "unit": v.unit, "start": v.start, "min": v.min, "max": v.max,
                    "unit_known": v.unit.as_ref().map(|unit| d.unit(unit).is_some()),
                    "description": v.description,
                })
            })
            .collect();
        output::json(&json!({
            "valid": true, "fmi_version": d.version.to_string(), "model_name": d.model_name,
            "sha256": fmu.sha256, "platforms": fmu.platforms, "generation_tool": d.generation_tool,
            "python": python, "variables": variables,
            "steps": measured.seconds.len(), "step_ms": args.step_ms,
            "step_us": { "p50": p50, "p99_9": p999, "max": max }, "budget_us": budget_us,
            "allocations_per_step": per_step, "steps_with_allocations": measured.steps_with_allocations,
            "outputs_not_finite": measured.not_finite, "in_time": in_time, "real_time": real_time,
        }));
    } else {
        output::line(format!(
            "{}: FMI {}, {} ({}), for {}",
            args.file.display(),
            d.version,
            d.model_name,
            if d.generation_tool.is_empty() { "tool not named" } else { &d.generation_tool },
            fmu.platforms.join(", ")
        ));
        let head = ["variable", "type", "causality", "unit", "start", "description"];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        for v in &d.variables {
            let unit = v.unit.as_ref().map_or_else(String::new, |unit| {
                if d.unit(unit).is_some() { unit.clone() } else { format!("{unit} (not known)") }
            });
            rows.push(vec![
                v.name.clone(),
                format!("{:?}{}", v.kind, if v.array { "[]" } else { "" }),
                v.causality.name().to_owned(),
                unit,
                v.start.clone().unwrap_or_default(),
                v.description.clone(),
            ]);
        }
        output::line(output::columns(&rows).trim_end());
        output::line(format!(
            "\n{} steps of {} ms, {} inputs set and {} outputs read in each: p50 {p50:.3} us, p99.9 {p999:.3} us, \
             max {max:.3} us; {per_step} heap calls a step",
            measured.seconds.len(),
            args.step_ms,
            setup.inputs.len(),
            setup.outputs.len(),
        ));
        if let Some(sign) = python {
            output::line(format!("runs Python ({sign}): lockstep only"));
        }
        if !measured.not_finite.is_empty() {
            output::line(format!("not finite: {}", measured.not_finite.join(", ")));
        }
        let verdict = match (in_time, real_time) {
            (true, true) => "within the budget",
            (true, false) => "within the budget, but not for real time",
            (false, _) => "over the budget: held, flagged and counted in a real-time run",
        };
        output::line(format!("budget {budget_us} us: {verdict}"));
    }
    if in_time && measured.not_finite.is_empty() { Exit::Done } else { Exit::Failed }
}
