//! FMUs in the loop: what a scenario says of one joined with what the FMU says of itself; the node that steps it; and
//! what the vehicle makes of its outputs.
//!
//! The node steps behind everybody else in the tick, so that it has the rest of the tick to itself: at tick n it takes
//! the car at t_n+1, steps from t_n to t_n+1, and the vehicle takes what it put out in tick n+1. An FMU's own time has
//! no gaps: ticks that its process missed beyond catching up are missing from it.

use crate::AssemblyError;
use crate::guard::{Guard, Verdict};
use crate::kinematics::CACHE_PREFIX;
use config::ResolvedBench;
use config::equations::ImportMode as Mode;
use config::fmu::{FmuLoss, FmuRun, FmuValue, exports_read};
use fmu::{FmuError, Hosted, Joints, Runner, Setup, Stepper, Value, Wanted};
use regions::layout::Kind;
use regions::{Fmu, NO_TICK, Payload, RegionId, VehicleState, fmu_flags, model_flags};
use runtime::{Input, InputSpec, Inputs, Model, NodeSpec, Step, When};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use vehicle::{ExportId, Exports, ImportId, ImportMode, Imports};

/// Regions whose fields an FMU can read, in the order of the node's inputs.
const SOURCES: [RegionId; 4] =
    [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus];
const READS: &[InputSpec] = &[
    InputSpec { region: SOURCES[0], when: When::Latest },
    // The last same-tick input is what a paced node waits for.
    InputSpec { region: SOURCES[1], when: When::SameTick },
    InputSpec { region: SOURCES[2], when: When::Latest },
    // Of the tick before: nobody rings for the rig's last word on a tick, and it comes after the models.
    InputSpec { region: SOURCES[3], when: When::Previous },
];
const fn node(writes: RegionId, name: &'static str) -> [NodeSpec; 1] {
    [NodeSpec { name, reads: READS, writes, checkpoint: None, rings: true }]
}
const NODES: [[NodeSpec; 1]; 4] = [
    node(regions::FMUS[0], "fmu_0"),
    node(regions::FMUS[1], "fmu_1"),
    node(regions::FMUS[2], "fmu_2"),
    node(regions::FMUS[3], "fmu_3"),
];

/// Why an FMU is no longer stepped; filled by its node, looked at by whoever drives it.
#[derive(Debug, Clone, Default)]
pub struct FmuFault(Arc<Mutex<Option<String>>>);

impl FmuFault {
    /// In words, if there is one.
    #[must_use]
    pub fn told(&self) -> Option<String> {
        self.0.lock().ok().and_then(|told| told.clone())
    }

    fn tell(&self, text: String) {
        if let Ok(mut told) = self.0.lock() {
            told.get_or_insert(text);
        }
    }
}

/// Where an input of an FMU comes from: one of the node's inputs, a word of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Place {
    input: usize,
    word: usize,
    whole: bool,
}

/// An FMU of a scenario, checked and joined with it.
#[derive(Debug, Clone)]
pub struct FmuPart {
    /// Its name.
    pub name: String,
    /// What its process needs.
    pub setup: Setup,
    index: usize,
    places: Vec<Place>,
    limits: Vec<(f64, f64)>,
    every: u64,
    period_s: f64,
    budget_s: f64,
}

fn source(resolved: &ResolvedBench, from: &str) -> Result<(Place, String), String> {
    let fmus = resolved.scenario.fmu.as_deref().unwrap_or_default();
    if let Some(name) = from.strip_prefix("vehicle.") {
        let unit = Exports::variables().into_iter().find(|v| v.name == name).map(|v| v.unit);
        let at = exports_read(fmus).iter().position(|n| n == name);
        let column = at.and_then(|at| {
            let columns = VehicleState::LAYOUT.columns();
            columns.into_iter().find(|column| column.name == format!("export.{at}"))
        });
        return match (unit, column) {
            (Some(unit), Some(column)) => {
                Ok((Place { input: 1, word: column.word, whole: false }, unit.to_owned()))
            }
            _ => Err(format!("{name} is no export of the car: see `kingpin vehicle variables`")),
        };
    }
    let Some((region, field)) = from.split_once('.') else {
        return Err(format!("{from}: must be region.field, or vehicle.EXPORT"));
    };
    let Some(input) = SOURCES.iter().position(|id| id.region().name == region) else {
        let names: Vec<_> = SOURCES.iter().map(|id| id.region().name).collect();
        return Err(format!("{region}: must be one of {}, vehicle", names.join(", ")));
    };
    let columns = SOURCES[input].region().layout.columns();
    match columns.iter().find(|column| column.name == field) {
        Some(column) => {
            let unit = if matches!(column.unit, "user") { "SI" } else { column.unit };
            let place = Place { input, word: column.word, whole: column.kind == Kind::U64 };
            Ok((place, unit.to_owned()))
        }
        None => {
            let root = field.split('.').next().unwrap_or(field);
            let near: Vec<_> = columns
                .iter()
                .filter(|column| column.name.starts_with(root))
                .map(|column| column.name.as_str())
                .collect();
            let hint =
                if near.is_empty() { String::new() } else { format!("; there are {}", near.join(", ")) };
            Err(format!("{field} is no field of {region}{hint}"))
        }
    }
}

/// What an output acts on, and the unit it must have.
fn target(run: &FmuRun, name: &str) -> Result<(ImportId, &'static str), String> {
    let output = &run.outputs[name];
    let variable = Imports::variables().into_iter().find(|v| v.name == output.to);
    match (variable, Imports::find(&output.to)) {
        (Some(variable), Some(id)) => {
            Ok((id, if output.mode == Mode::Multiply { "1" } else { variable.unit }))
        }
        _ if Exports::find(&output.to).is_some() => Err(format!("{} can be read but not changed", output.to)),
        _ => {
            Err(format!("{} is no variable that can be imported: see `kingpin vehicle variables`", output.to))
        }
    }
}

/// The key of the scenario that a fault of an FMU belongs to.
fn key_of(run: &FmuRun, error: &FmuError) -> String {
    let name = match error {
        FmuError::UnknownVariable { name, .. }
        | FmuError::Causality { name, .. }
        | FmuError::Kind { name, .. }
        | FmuError::UnitMismatch { name, .. }
        | FmuError::UnitUnknown { name, .. }
        | FmuError::UnitMissing { name, .. }
        | FmuError::Value { name, .. } => name,
        FmuError::Step { .. } => return "every_ticks".to_owned(),
        _ => return "file".to_owned(),
    };
    let has = |map: &Option<std::collections::BTreeMap<String, FmuValue>>| {
        map.as_ref().is_some_and(|map| map.contains_key(name))
    };
    let parameter = matches!(error, FmuError::Causality { wanted, .. } if wanted.contains("parameter"));
    if has(&run.parameters) && (parameter || !run.inputs.contains_key(name)) {
        format!("parameters.{name}")
    } else if run.inputs.contains_key(name) {
        format!("inputs.{name}")
    } else if run.outputs.contains_key(name) {
        format!("outputs.{name}")
    } else if has(&run.start) {
        format!("start.{name}")
    } else {
        format!("units.{name}")
    }
}

fn values(map: Option<&std::collections::BTreeMap<String, FmuValue>>) -> Vec<(&str, Value)> {
    let value = |value: &FmuValue| match value {
        FmuValue::Truth(truth) => Value::Number(f64::from(u8::from(*truth))),
        FmuValue::Number(number) => Value::Number(*number),
        FmuValue::Text(text) => Value::Text(text.clone()),
    };
    map.into_iter().flatten().map(|(name, given)| (name.as_str(), value(given))).collect()
}

/// Opens FMU `index` of a scenario and joins it; nothing is unpacked yet, `folder` is where it is to be.
///
/// # Errors
/// Everything that does not fit, with the place of its key.
pub fn fmu_part(
    resolved: &ResolvedBench,
    index: usize,
    folder: &Path,
    paced: bool,
) -> Result<(fmu::Fmu, FmuPart), AssemblyError> {
    let (Some(run), Some(file)) =
        (resolved.scenario.fmu.iter().flatten().nth(index), resolved.fmus.get(index))
    else {
        return Err(AssemblyError::new("fmu", [format!("there is no FMU {index} in this scenario")]));
    };
    let told = |key: &str, rule: &str| resolved.violation(&format!("fmu[{index}].{key}"), rule);
    let fmu = fmu::Fmu::open(Path::new(&file.path))
        .map_err(|error| AssemblyError::new("fmu", [told("file", &error.to_string())]))?;
    let mut faults = Vec::new();
    if fmu.sha256 != file.sha256 {
        faults.push(told("file", "the file was changed since the run was made"));
    }
    let python = fmu.python();
    if let (Some(sign), true) = (&python, paced) {
        faults.push(told("file", &FmuError::Python { sign: sign.clone() }.to_string()));
    }
    let mut places = Vec::new();
    let mut inputs = Vec::new();
    for (name, from) in &run.inputs {
        match source(resolved, from) {
            Ok((place, unit)) => {
                places.push(place);
                inputs.push((name, unit));
            }
            Err(rule) => faults.push(told(&format!("inputs.{name}"), &rule)),
        }
    }
    let mut outputs = Vec::new();
    for name in run.outputs.keys() {
        match target(run, name) {
            Ok((_, unit)) => outputs.push((name, unit)),
            Err(rule) => faults.push(told(&format!("outputs.{name}"), &rule)),
        }
    }
    let inputs: Vec<_> = inputs.iter().map(|(name, unit)| Wanted { name, unit }).collect();
    let outputs: Vec<_> = outputs.iter().map(|(name, unit)| Wanted { name, unit }).collect();
    let (parameters, start) = (values(run.parameters.as_ref()), values(run.start.as_ref()));
    let joints = Joints {
        inputs: &inputs,
        outputs: &outputs,
        parameters: &parameters,
        start: &start,
        units: run.units.as_ref(),
    };
    let period_s = resolved.scenario.timing.period_s();
    let every = u64::from(run.every_ticks);
    if let Err(error) = fmu::check_step(&fmu.description, every as f64 * period_s) {
        faults.push(told(&key_of(run, &error), &error.to_string()));
    }
    let setup = Setup::new(&fmu, &run.name, folder, &joints);
    if let Err(wrong) = &setup {
        faults.extend(wrong.iter().map(|error| told(&key_of(run, error), &error.to_string())));
    }
    let Ok(mut setup) = setup else { return Err(AssemblyError::new("fmu", faults)) };
    if !faults.is_empty() {
        return Err(AssemblyError::new("fmu", faults));
    }
    if python.is_some() {
        setup.interpreter = fmu::interpreter();
    }
    let limit = |bound: Option<f64>, absent: f64| bound.unwrap_or(absent);
    let limits = run
        .outputs
        .values()
        .map(|output| (limit(output.min, f64::NEG_INFINITY), limit(output.max, f64::INFINITY)))
        .collect();
    let budget_s = if paced { run.budget_s } else { f64::INFINITY };
    let name = run.name.clone();
    Ok((fmu, FmuPart { name, setup, index, places, limits, every, period_s, budget_s }))
}

/// Checks all FMUs of a scenario without loading them.
///
/// # Errors
/// Everything that does not fit.
pub fn check_fmus(resolved: &ResolvedBench, paced: bool) -> Result<(), AssemblyError> {
    let count = resolved.scenario.fmu.as_ref().map_or(0, Vec::len);
    let mut faults = Vec::new();
    for index in 0..count {
        if let Err(error) = fmu_part(resolved, index, Path::new(""), paced) {
            faults.extend(error.faults);
        }
    }
    for error in [actions(resolved).err(), exports(resolved).err()].into_iter().flatten() {
        faults.extend(error.faults.into_iter().filter(|fault| !faults.contains(fault)).collect::<Vec<_>>());
    }
    if faults.is_empty() { Ok(()) } else { Err(AssemblyError::new("fmu", faults)) }
}

/// A folder with an unpacked FMU, removed with this.
#[derive(Debug)]
pub struct Unpacked(PathBuf);

impl Drop for Unpacked {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Models of a scenario's FMUs, what went wrong with each, and the folders they live in.
pub type Fmus = (Vec<Box<dyn Model>>, Vec<FmuFault>, Vec<Unpacked>);

/// The FMUs of a scenario for a run in one thread, each in a child process `executable service fmu_host`, with why they
/// are no longer stepped. The folders live as long as the last part.
///
/// # Errors
/// Everything that does not fit, or what the FMU says.
pub fn build_fmus(resolved: &ResolvedBench, executable: &Path) -> Result<Fmus, AssemblyError> {
    check_fmus(resolved, false)?;
    let (mut models, mut faults, mut folders): (Vec<Box<dyn Model>>, _, _) =
        (Vec::new(), Vec::new(), Vec::new());
    let patience = Duration::from_secs_f64(resolved.scenario.limits.lockstep_wait_max_s);
    for (index, run) in resolved.scenario.fmu.iter().flatten().enumerate() {
        let refuse = |error: &FmuError| {
            AssemblyError::new("fmu", [resolved.violation(&format!("fmu[{index}].file"), &error.to_string())])
        };
        let unique = format!("kingpin-fmu-{}-{index}-{:p}", std::process::id(), &raw const folders);
        let folder = std::env::temp_dir().join(unique);
        let (fmu, part) = fmu_part(resolved, index, &folder, false)?;
        folders.push(Unpacked(folder.clone()));
        fmu.extract(&folder).map_err(|error| refuse(&error))?;
        let patience = patience.min(Duration::from_secs_f64(run.hang_s.max(0.5)));
        let hosted =
            Hosted::start(executable, &["service", "fmu_host", "--bench", "none"], &part.setup, patience)
                .map_err(|error| refuse(&error))?;
        let fault = FmuFault::default();
        models.push(Box::new(FmuNode::new(part, Box::new(hosted), fault.clone())));
        faults.push(fault);
    }
    Ok((models, faults, folders))
}

/// FMU `index` of a scenario in this process, unpacked into the bench's directory (kept from one start of the service to
/// the next).
///
/// # Errors
/// Everything that does not fit, or what the FMU says.
pub fn fmu_model(
    resolved: &ResolvedBench,
    index: usize,
    directory: &Path,
    paced: bool,
    first_tick: u64,
) -> Result<(FmuPart, Runner), AssemblyError> {
    let sha256 = resolved.fmus.get(index).map_or("", |file| &file.sha256);
    let folder = directory.join(format!("{CACHE_PREFIX}fmu-{index}-{sha256}"));
    let (fmu, mut part) = fmu_part(resolved, index, &folder, paced)?;
    let refuse = |error: &FmuError| {
        AssemblyError::new("fmu", [resolved.violation(&format!("fmu[{index}].file"), &error.to_string())])
    };
    if !folder.is_dir() {
        // Whole or not at all.
        let draft = folder.with_extension(std::process::id().to_string());
        fmu.extract(&draft).map_err(|error| refuse(&error))?;
        let _ = std::fs::rename(&draft, &folder);
    }
    part.setup.start_s = first_tick as f64 * part.period_s;
    let runner = Runner::new(&part.setup).map_err(|error| refuse(&error))?;
    Ok((part, runner))
}

/// An FMU that is stepped.
pub struct FmuNode {
    part: FmuPart,
    stepper: Box<dyn Stepper>,
    fault: FmuFault,
    inputs: Vec<f64>,
    outputs: Vec<f64>,
    state: Fmu,
}

impl FmuNode {
    /// From its part and whatever steps it.
    pub fn new(part: FmuPart, stepper: Box<dyn Stepper>, fault: FmuFault) -> Self {
        let mut state = Fmu::absent();
        state.used_rig_measurement = NO_TICK;
        FmuNode {
            inputs: vec![0.0; part.setup.inputs.len()],
            outputs: vec![0.0; part.setup.outputs.len()],
            part,
            stepper,
            fault,
            state,
        }
    }
}

impl Model for FmuNode {
    fn nodes(&self) -> &'static [NodeSpec] {
        &NODES[self.part.index]
    }

    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let part = &self.part;
        let state = &mut self.state;
        let failed = state.flags & fmu_flags::FAILED;
        state.tick = step.n;
        state.time_s = (step.n + 1) as f64 * part.period_s;
        state.flags = failed;
        state.compute_s = f64::NAN;
        if step.caught_up {
            state.flags |= fmu_flags::CAUGHT_UP;
        }
        let used = |input: usize| inputs.words(input).1.tick();
        state.used_rig_measurement = used(0);
        state.used_vehicle_state = used(1);
        state.used_suspension_state = used(2);
        if failed != 0 {
            output.copy_from_slice(state.words());
            return;
        }
        if !step.n.is_multiple_of(part.every) {
            state.flags |= fmu_flags::BETWEEN;
            output.copy_from_slice(state.words());
            return;
        }
        for (value, place) in self.inputs.iter_mut().zip(&part.places) {
            let (words, input) = inputs.words(place.input);
            let word = words[place.word];
            let found = match (input.tick() == NO_TICK, place.whole) {
                (true, _) => f64::NAN,
                (_, true) => word as f64,
                (_, false) => f64::from_bits(word),
            };
            if found.is_finite() {
                *value = found;
            } else {
                state.flags |= fmu_flags::HELD_INPUT;
            }
        }
        state.held_input_count += u64::from(state.flags & fmu_flags::HELD_INPUT != 0);
        for (slot, value) in state.input.iter_mut().zip(&self.inputs) {
            *slot = *value;
        }
        let length_s = part.every as f64 * part.period_s;
        // Counted, not summed: does not drift. An FMU's time has no gaps.
        let time_s = part.setup.start_s + state.step_count as f64 * length_s;
        match self.stepper.step(time_s, length_s, &self.inputs, &mut self.outputs) {
            Ok(cost) => {
                state.step_count += 1;
                if part.budget_s.is_finite() {
                    state.compute_s = cost.seconds;
                }
                if cost.seconds > part.budget_s {
                    state.flags |= fmu_flags::OVER_BUDGET;
                    state.over_budget_count += 1;
                } else if self.outputs.iter().all(|value| value.is_finite()) {
                    let all = self.outputs.iter().zip(&part.limits);
                    for (slot, (value, (low, high))) in state.output.iter_mut().zip(all) {
                        *slot = value.clamp(*low, *high);
                        if *slot != *value {
                            state.flags |= fmu_flags::CLAMPED;
                        }
                    }
                } else {
                    state.flags |= fmu_flags::REFUSED_OUTPUT;
                    state.refused_count += 1;
                }
            }
            Err(error) => {
                state.flags |= fmu_flags::FAILED;
                self.fault.tell(format!("FMU {} at tick {}: {error}", part.name, step.n));
            }
        }
        output.copy_from_slice(state.words());
    }
}

/// What the vehicle does with the outputs of an FMU.
#[derive(Debug)]
pub struct FmuAction {
    targets: Vec<(ImportId, ImportMode)>,
    loss: FmuLoss,
    guard: Guard,
    values: Vec<f64>,
    used_tick: u64,
}

impl FmuAction {
    /// Takes the outputs of the tick before into the car's imports. Whether the car counts as lost with the FMU.
    pub fn take(
        &mut self,
        step: &Step,
        state: &Fmu,
        input: &Input,
        imports: &mut Imports,
        flags: &mut u64,
    ) -> bool {
        // Before tick 0 no FMU has said anything: the car is as without it.
        let Some(before) = step.n.checked_sub(1) else { return false };
        let bad = fmu_flags::REFUSED_OUTPUT | fmu_flags::OVER_BUDGET | fmu_flags::FAILED;
        let outputs = &state.output[..self.targets.len()];
        let plausible = state.flags & bad == 0 && outputs.iter().all(|value| value.is_finite());
        let mut own = 0;
        let verdict =
            self.guard.judge(&Step { n: before, ..*step }, input, plausible, self.used_tick, &mut own);
        let usable =
            verdict == Verdict::Good || (self.used_tick == NO_TICK && input.tick() != NO_TICK && plausible);
        if usable {
            self.values.copy_from_slice(outputs);
            self.used_tick = input.tick();
        }
        *flags |= own & !model_flags::STALE;
        let mut lost = false;
        let mut release = false;
        if verdict == Verdict::Stale {
            *flags |= model_flags::FMU_LOST;
            match self.loss {
                FmuLoss::Hold => {
                    *flags |= model_flags::STALE;
                    lost = true;
                }
                FmuLoss::Release => release = true,
            }
        }
        for ((id, mode), value) in self.targets.iter().zip(&self.values) {
            // NaN, before the first word, clears.
            imports.set(*id, *mode, if release { f64::NAN } else { *value });
        }
        lost
    }

    /// Tick of the outputs in force.
    pub fn used_tick(&self) -> u64 {
        self.used_tick
    }

    /// Ticks in which outputs were held.
    pub fn held_count(&self) -> u64 {
        self.guard.held_count()
    }
}

/// What the FMUs of a scenario act on.
pub(crate) fn actions(resolved: &ResolvedBench) -> Result<Vec<FmuAction>, AssemblyError> {
    let mut faults = Vec::new();
    let mut taken: Vec<(String, String)> = Vec::new();
    let imports = resolved.scenario.equations.iter().flat_map(|e| e.imports.iter().flatten());
    for (k, import) in imports.enumerate() {
        taken.push((import.variable.clone(), format!("equations.imports[{k}]")));
    }
    let mut all = Vec::new();
    for (index, run) in resolved.scenario.fmu.iter().flatten().enumerate() {
        let mut targets = Vec::new();
        for (name, output) in &run.outputs {
            let key = format!("fmu[{index}].outputs.{name}");
            if let Some((_, by)) = taken.iter().find(|(variable, _)| *variable == output.to) {
                let rule = format!("{} is already acted on by {by}", output.to);
                faults.push(resolved.violation(&key, &rule));
            }
            taken.push((output.to.clone(), key.clone()));
            let mode = match output.mode {
                Mode::Add => ImportMode::Add,
                Mode::Multiply => ImportMode::Multiply,
                Mode::Replace => ImportMode::Replace,
            };
            match target(run, name) {
                Ok((id, _)) => targets.push((id, mode)),
                Err(rule) => faults.push(resolved.violation(&key, &rule)),
            }
        }
        all.push(FmuAction {
            values: vec![f64::NAN; targets.len()],
            targets,
            loss: run.on_loss,
            guard: Guard::new(resolved.rig.limits.stale_ticks),
            used_tick: NO_TICK,
        });
    }
    if faults.is_empty() { Ok(all) } else { Err(AssemblyError::new("fmu", faults)) }
}

/// The exports of the car that FMUs read.
pub(crate) fn exports(resolved: &ResolvedBench) -> Result<Vec<ExportId>, AssemblyError> {
    let names = exports_read(resolved.scenario.fmu.as_deref().unwrap_or_default());
    let found = |name: &String| {
        let rule = format!("vehicle.{name}: is no export of the car: see `kingpin vehicle variables`");
        Exports::find(name).ok_or_else(|| AssemblyError::new("fmu", [rule]))
    };
    names.iter().map(found).collect()
}
