//! A whole bench resolved from one scenario: every file it names, read, checked and put together, with a
//! canonical text and its hash for the log.

use crate::axle::Axle;
use crate::can::Can;
use crate::car::Car;
use crate::check::Broken;
use crate::fmu::ResolvedFmu;
use crate::library::Kind;
use crate::load::{self, Draft, Loaded, REFERENCE_BYTES_MAX, Section};
use crate::model::ModelFiles;
use crate::problem::{Mistake, Problems, Violation};
use crate::record::{self, ForeignRecord, MeasuredSignal, RecordedHistory, TimeSeries, Wanted};
use crate::rig::Rig;
use crate::scenario::{Scenario, Speed};
use crate::steer::Steer;
use crate::surface::SurfaceFiles;
use crate::tree::{Node, Place, Source, Value};
use crate::unit::SteeringUnit;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Sections that `--set` reaches by the first part of its path; everything else is the scenario's.
const SECTIONS: [&str; 5] = ["car", "front_axle", "rear_axle", "rig", "unit"];

/// A text file as it is, with its name.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextFile {
    /// Name in messages.
    pub name: String,
    /// Its whole text.
    pub text: String,
}

/// Everything that a run needs, and all of it. Goes into each log as JSON and comes back from there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResolvedBench {
    /// The scenario.
    pub scenario: Scenario,
    /// The car.
    pub car: Car,
    /// The front suspension, which the multibody solver poses.
    pub front_axle: Axle,
    /// The rear suspension, if the car names one by its hardpoints.
    pub rear_axle: Option<Axle>,
    /// Tyre property files: front, rear.
    pub tyres: Vec<TextFile>,
    /// The rig.
    pub rig: Rig,
    /// The steering unit.
    pub unit: SteeringUnit,
    /// The steering unit's functional model, if its file names one.
    pub unit_model: Option<ModelFiles>,
    /// The car's driveline model, if its file names one.
    pub driveline_model: Option<ModelFiles>,
    /// The CAN bus, if the scenario asks for one.
    pub can: Option<ResolvedCan>,
    /// The FMUs, in the scenario's order.
    #[serde(default)]
    pub fmus: Vec<ResolvedFmu>,
    /// Recorded histories, if the scenario names any.
    pub record: Option<RecordedHistory>,
    /// The road's surface, if the scenario names one.
    pub surface: Option<SurfaceFiles>,
    /// Every configuration text that was read, for the log (overrides included).
    pub sources: Vec<TextFile>,
    /// Where keys of the scenario that are checked later were written, as `file:line:column`.
    #[serde(default)]
    pub places: BTreeMap<String, String>,
}

/// A CAN mapping and the DBC file that it speaks of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResolvedCan {
    /// The mapping.
    pub mapping: Can,
    /// The DBC file.
    pub dbc: TextFile,
}

/// Loads a CAN mapping (a path, or a shipped one by its bare name) and the DBC file that it names.
///
/// # Errors
/// All violations of the mapping at once; what does not fit the DBC is crate `can`'s to find.
pub fn load_can(reference: &str) -> Result<(Loaded<Can>, TextFile), Problems> {
    can_at(&load::place_of_argument(reference, Kind::Can)?, &[])
}

fn can_at(place: &Place, overrides: &[String]) -> Result<(Loaded<Can>, TextFile), Problems> {
    let mut draft = Draft::read(place, Kind::Can, overrides)?;
    let dbc = draft.reference("dbc_file", Kind::Can);
    let loaded = draft.finish::<Can>()?;
    let text = match dbc {
        Some(Ok(place)) => load::read_text(&place, REFERENCE_BYTES_MAX)
            .map(|text| TextFile { name: place.name(), text })
            .map_err(|violation| Problems::one(*violation))?,
        Some(Err(violation)) => return Err(Problems::one(violation)),
        None => {
            return Err(Problems::one(loaded.violation(Mistake::MissingKey, "dbc_file", "must be given")));
        }
    };
    Ok((loaded, text))
}

impl ResolvedBench {
    /// Loads a scenario (a path, or a shipped one by its bare name) and everything that it names. Overrides
    /// are `path=value`; a path that starts with `car.`, `front_axle.`, `rear_axle.`, `rig.` or `unit.`
    /// reaches into that section, any other into the scenario.
    ///
    /// # Errors
    /// All violations of all files at once.
    pub fn load(scenario: &str, overrides: &[String]) -> Result<Self, Problems> {
        Self::load_with(scenario, overrides, &|_, _, _| None)
    }

    /// As [`Self::load`]; recorded histories that are not CSV are read by `foreign`.
    ///
    /// # Errors
    /// All violations of all files at once.
    pub fn load_with(
        scenario: &str,
        overrides: &[String],
        foreign: &ForeignRecord<'_>,
    ) -> Result<Self, Problems> {
        let place = load::place_of_argument(scenario, Kind::Scenario)?;
        let mut assembly = Assembly::new(overrides, "scenario");
        let mut draft = Draft::read(&place, Kind::Scenario, &assembly.of("scenario"))?;
        let scenario = draft.finish::<Scenario>();
        let rig = assembly.section::<Rig>(&draft, "rig_file", "rig");
        let unit = assembly.section::<SteeringUnit>(&draft, "unit_file", "unit");
        let unit_model =
            unit.as_ref().and_then(|unit| assembly.model(&unit.tree, &unit.sources, "model.file"));
        let car = assembly.car_of_bench(&draft);
        let scenario = assembly.keep(scenario);
        let record = scenario.as_ref().and_then(|loaded| assembly.record(loaded, foreign));
        let surface = scenario.as_ref().and_then(|loaded| assembly.surface(loaded));
        let wants_can = scenario.as_ref().is_some_and(|loaded| loaded.value.can.is_some());
        let can = if wants_can { assembly.can(&draft).map(Some) } else { Some(None) };
        let fmus = scenario.as_ref().map_or_else(Vec::new, |loaded| assembly.fmus(loaded));
        let Assembly { mut problems, sources, .. } = assembly;
        problems.sort();
        match (scenario, car, rig, unit, record, can) {
            (Some(scenario), Some((car, front_axle)), Some(rig), Some(unit), Some(record), Some(can))
                if problems.is_empty() =>
            {
                Ok(Self {
                    places: places(&scenario),
                    scenario: scenario.value,
                    car: car.car,
                    front_axle,
                    rear_axle: car.rear_axle,
                    tyres: car.tyres,
                    rig: rig.value,
                    unit: unit.value,
                    unit_model,
                    driveline_model: car.driveline_model,
                    can,
                    fmus,
                    record,
                    surface,
                    sources,
                })
            }
            _ => Err(problems),
        }
    }

    /// The canonical text: JSON of everything but the sources, with sorted keys. Where recorded files lie is
    /// left out, because only their content counts.
    pub fn canonical_json(&self) -> String {
        let mut canonical = self.clone();
        canonical.sources.clear();
        canonical.places.clear();
        if let Some(record) = &mut canonical.scenario.record {
            record.directory = None;
        }
        for fmu in &mut canonical.fmus {
            fmu.path.clear();
        }
        for fmu in canonical.scenario.fmu.iter_mut().flatten() {
            fmu.file.clear();
        }
        // Through `Value`, whose maps are sorted; numbers are finite since they passed the schema.
        serde_json::to_value(&canonical).map(|value| value.to_string()).unwrap_or_default()
    }

    /// SHA-256 of the canonical text, in hexadecimal: equal for runs with equal configuration.
    pub fn hash(&self) -> String {
        let digest = Sha256::digest(self.canonical_json().as_bytes());
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// A fault of the scenario found later, with the place of its key.
    pub fn violation(&self, key: &str, rule: &str) -> String {
        match self.places.get(key) {
            Some(place) => format!("{place}: {key}: {rule}"),
            None => format!("{}: {key}: {rule}", self.scenario.name),
        }
    }

    /// Everything, sources included, as JSON for the log.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::to_value(self).unwrap_or_default()
    }

    /// The inverse of [`Self::to_json`]: a log's configuration, for its replay.
    ///
    /// # Errors
    /// What does not fit.
    pub fn from_json(text: &str) -> Result<Self, Problems> {
        serde_json::from_str(text).map_err(|error| {
            Problems::one(Violation {
                line: u32::try_from(error.line()).unwrap_or(0),
                column: u32::try_from(error.column()).unwrap_or(0),
                ..Violation::of_file(Mistake::Syntax, "resolved configuration", error.to_string())
            })
        })
    }
}

/// A car with the files that it names, for runs without a bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResolvedCar {
    /// The car.
    pub car: Car,
    /// The front suspension, if the car names one by its hardpoints.
    pub front_axle: Option<Axle>,
    /// The rear suspension, if the car names one by its hardpoints.
    pub rear_axle: Option<Axle>,
    /// Tyre property files: front, rear.
    pub tyres: Vec<TextFile>,
    /// The car's driveline model, if its file names one.
    pub driveline_model: Option<ModelFiles>,
}

impl ResolvedCar {
    /// Loads a car (a path, or a shipped one by its bare name) and the files that it names. Overrides are
    /// `path=value`; a path that starts with `front_axle.` or `rear_axle.` reaches into that section, any other, with or
    /// without `car.` ahead, into the car.
    ///
    /// # Errors
    /// All violations of all files at once.
    pub fn load(car: &str, overrides: &[String]) -> Result<Self, Problems> {
        let place = load::place_of_argument(car, Kind::Car)?;
        let mut assembly = Assembly::new(overrides, "car");
        for text in overrides {
            if SECTIONS[3..].iter().any(|section| text.trim_start().starts_with(&format!("{section}."))) {
                let rule = "there is no such section in a run of the car alone".to_owned();
                assembly.problems.push(in_file(Mistake::Override, "--set", text, rule));
            }
        }
        let resolved = assembly.car_at(&place).map(|(car, _)| car);
        let mut problems = assembly.problems;
        problems.sort();
        match resolved {
            Some(car) if problems.is_empty() => Ok(car),
            _ => Err(problems),
        }
    }
}

/// Where keys whose values only the parts can judge were written.
fn places(scenario: &Loaded<Scenario>) -> BTreeMap<String, String> {
    let mut keys = Vec::new();
    if let Some(equations) = &scenario.value.equations {
        let mut entries = |list: &str, count: usize, fields: &[&str]| {
            let all = (0..count).flat_map(|i| fields.iter().map(move |field| format!("[{i}].{field}")));
            keys.extend(all.map(|entry| format!("equations.{list}{entry}")));
        };
        let count = |n: Option<usize>| n.unwrap_or(0);
        let fields = ["name", "unit", "expression", "start"];
        entries("variables", count(equations.variables.as_ref().map(Vec::len)), &fields);
        entries("imports", count(equations.imports.as_ref().map(Vec::len)), &["variable", "expression"]);
        entries("outputs", count(equations.outputs.as_ref().map(Vec::len)), &fields[..3]);
    }
    for (i, fmu) in scenario.value.fmu.iter().flatten().enumerate() {
        keys.extend(["name", "file", "every_ticks"].map(|key| format!("fmu[{i}].{key}")));
        let maps = [("parameters", &fmu.parameters), ("start", &fmu.start)];
        let named =
            maps.iter().flat_map(|(map, values)| values.iter().flatten().map(move |(name, _)| (*map, name)));
        let named = named.chain(fmu.inputs.keys().map(|name| ("inputs", name)));
        let named = named.chain(fmu.outputs.keys().map(|name| ("outputs", name)));
        let named = named.chain(fmu.units.iter().flatten().map(|(name, _)| ("units", name)));
        keys.extend(named.map(|(map, name)| format!("fmu[{i}].{map}.{name}")));
    }
    keys.into_iter().map(|key| (key.clone(), scenario.written_at(&key))).collect()
}

/// Gathers the parts and everything that is wrong with them.
struct Assembly<'a> {
    overrides: &'a [String],
    /// Section that overrides reach without its name.
    main: &'static str,
    problems: Problems,
    sources: Vec<TextFile>,
}

impl<'a> Assembly<'a> {
    fn new(overrides: &'a [String], main: &'static str) -> Self {
        Self { overrides, main, problems: Problems::default(), sources: Vec::new() }
    }

    /// The overrides of a section, their first part taken off.
    fn of(&self, section: &str) -> Vec<String> {
        let first = |text: &str| {
            let path = text.split('=').next().unwrap_or("").trim();
            let head = path.split(['.', '[']).next().unwrap_or("");
            SECTIONS.contains(&head).then(|| head.to_owned())
        };
        self.overrides
            .iter()
            .filter_map(|text| match first(text) {
                Some(head) => (head == section)
                    .then(|| text.trim_start().strip_prefix(head.as_str()))
                    .flatten()
                    .map(|rest| rest.strip_prefix('.').unwrap_or(rest).to_owned()),
                None => (section == self.main).then(|| text.clone()),
            })
            .collect()
    }

    fn keep<T>(&mut self, loaded: Result<Loaded<T>, Problems>) -> Option<Loaded<T>> {
        match loaded {
            Ok(loaded) => {
                for source in &loaded.sources {
                    self.source(source.place.name(), source.text.clone());
                }
                Some(loaded)
            }
            Err(problems) => {
                self.problems.extend(problems);
                None
            }
        }
    }

    fn source(&mut self, name: String, text: String) {
        let file = TextFile { name, text };
        if !self.sources.contains(&file) {
            self.sources.push(file);
        }
    }

    fn place(&mut self, draft: &Draft, key: &str, kind: Kind) -> Option<Place> {
        match draft.reference(key, kind)? {
            Ok(place) => Some(place),
            Err(violation) => {
                self.problems.push(violation);
                None
            }
        }
    }

    fn section<T: Section>(&mut self, draft: &Draft, key: &str, name: &str) -> Option<Loaded<T>> {
        let place = self.place(draft, key, T::KIND)?;
        let overrides = self.of(name);
        self.keep(load::load_at::<T>(&place, &overrides))
    }

    fn car_of_bench(&mut self, scenario: &Draft) -> Option<(ResolvedCar, Axle)> {
        let place = self.place(scenario, "car_file", Kind::Car)?;
        let (mut car, draft) = self.car_at(&place)?;
        if car.car.front.axle_file.is_none() {
            let rule =
                "must be given to run on the bench: its hardpoints are what the multibody solver poses";
            self.problems.push(draft.violation(Mistake::MissingKey, "front.axle_file", rule.to_owned()));
        }
        let front_axle = car.front_axle.take()?;
        Some((car, front_axle))
    }

    fn car_at(&mut self, place: &Place) -> Option<(ResolvedCar, Draft)> {
        let mut draft = match Draft::read(place, Kind::Car, &self.of("car")) {
            Ok(draft) => draft,
            Err(problems) => {
                self.problems.extend(problems);
                return None;
            }
        };
        let car = draft.finish::<Car>();
        let car = self.keep(car);
        let front_axle = self.axle(&draft, "front");
        let rear_axle = self.axle(&draft, "rear");
        let tyres: Vec<_> = ["front", "rear"]
            .into_iter()
            .filter_map(|end| self.tyre(&draft, &format!("{end}.tyre_file")))
            .collect();
        let car = car?;
        let driveline_model = self.model(&car.tree, &car.sources, "driveline.file");
        Some((ResolvedCar { car: car.value, front_axle, rear_axle, tyres, driveline_model }, draft))
    }

    fn axle(&mut self, car: &Draft, end: &str) -> Option<Axle> {
        let place = self.place(car, &format!("{end}.axle_file"), Kind::Suspension)?;
        let overrides = self.of(&format!("{end}_axle"));
        let extension = match &place {
            Place::Disk(path) => path.extension().map(|ext| ext.to_string_lossy().to_lowercase()),
            Place::Library(path) => Path::new(path).extension().map(|ext| ext.to_string_lossy().into_owned()),
            Place::Override => None,
        };
        let foreign = extension.as_deref().unwrap_or("");
        if foreign == "toml" || Axle::from_foreign(foreign, "", "").is_none() {
            return self.keep(load::load_at::<Axle>(&place, &overrides)).map(|loaded| loaded.value);
        }
        self.foreign_axle(&place, foreign, &overrides)
    }

    fn foreign_axle(&mut self, place: &Place, extension: &str, overrides: &[String]) -> Option<Axle> {
        let name = place.name();
        let text = match load::read_text(place, REFERENCE_BYTES_MAX) {
            Ok(text) => text,
            Err(violation) => {
                self.problems.push(*violation);
                return None;
            }
        };
        if let Some(first) = overrides.first() {
            let rule = format!("cannot be set: {name} is not TOML; make a TOML file of it");
            self.problems.push(in_file(Mistake::Override, "--set", first, rule));
        }
        let stem =
            Path::new(&name).file_stem().map_or_else(|| name.clone(), |s| s.to_string_lossy().into_owned());
        match Axle::from_foreign(extension, &text, &stem)? {
            Ok(axle) => {
                self.source(name, text);
                Some(axle)
            }
            Err(broken) => {
                for Broken { key, rule } in broken {
                    self.problems.push(in_file(Mistake::Reference, &name, &key, rule));
                }
                None
            }
        }
    }

    /// A functional model with all files it names.
    fn model(&mut self, tree: &Node, sources: &[Source], key: &str) -> Option<ModelFiles> {
        let place = match load::reference_in(tree, sources, key, Kind::Model)? {
            Ok(place) => place,
            Err(violation) => {
                self.problems.push(violation);
                return None;
            }
        };
        match ModelFiles::at(&place) {
            Ok(files) => {
                for file in std::iter::once(&files.main).chain(&files.parts) {
                    self.source(file.name.clone(), file.text.clone());
                }
                Some(files)
            }
            Err(problems) => {
                self.problems.extend(problems);
                None
            }
        }
    }

    fn can(&mut self, scenario: &Draft) -> Option<ResolvedCan> {
        let place = self.place(scenario, "can.mapping_file", Kind::Can)?;
        match can_at(&place, &[]) {
            Ok((loaded, dbc)) => {
                let mapping = self.keep(Ok(loaded))?.value;
                self.source(dbc.name.clone(), dbc.text.clone());
                Some(ResolvedCan { mapping, dbc })
            }
            Err(problems) => {
                self.problems.extend(problems);
                None
            }
        }
    }

    fn fmus(&mut self, loaded: &Loaded<Scenario>) -> Vec<ResolvedFmu> {
        let mut all = Vec::new();
        for i in 0..loaded.value.fmu.as_ref().map_or(0, Vec::len) {
            let key = format!("fmu[{i}].file");
            let found = named_path(loaded, &key).and_then(|path| {
                let path = std::path::absolute(&path).map_err(|e| e.to_string())?;
                let bytes = std::fs::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
                let sha256 = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
                Ok(ResolvedFmu { path: path.display().to_string(), sha256 })
            });
            match found {
                Ok(fmu) => all.push(fmu),
                Err(rule) => self.problems.push(loaded.violation(Mistake::NotFound, &key, rule)),
            }
        }
        all
    }

    fn tyre(&mut self, car: &Draft, key: &str) -> Option<TextFile> {
        let place = self.place(car, key, Kind::Tyre)?;
        match load::read_text(&place, REFERENCE_BYTES_MAX) {
            Ok(text) => {
                self.source(place.name(), text.clone());
                Some(TextFile { name: place.name(), text })
            }
            Err(violation) => {
                self.problems.push(*violation);
                None
            }
        }
    }

    fn surface(&mut self, loaded: &Loaded<Scenario>) -> Option<SurfaceFiles> {
        loaded.value.road.surface.as_ref()?;
        let key = "road.surface.file";
        let path = match named_path(loaded, key) {
            Ok(path) => path,
            Err(rule) => {
                self.problems.push(loaded.violation(Mistake::NotFound, key, rule));
                return None;
            }
        };
        if !path.exists() {
            let rule = format!("no such file: {}", path.display());
            self.problems.push(loaded.violation(Mistake::NotFound, key, rule));
            return None;
        }
        match SurfaceFiles::read(&path) {
            Ok(files) => Some(files),
            Err(problems) => {
                self.problems.extend(problems);
                None
            }
        }
    }

    /// `None`: something is wrong; `Some(None)`: the scenario names no record.
    fn record(
        &mut self,
        loaded: &Loaded<Scenario>,
        foreign: &ForeignRecord<'_>,
    ) -> Option<Option<RecordedHistory>> {
        let scenario = &loaded.value;
        let Some(window) = &scenario.record else { return Some(None) };
        let until_s = scenario.duration_s - scenario.warm_up_s;
        let mut history = RecordedHistory::default();
        let wrong_before = self.problems.violations.len();
        if let Steer::RecordedHistory(steer) = &scenario.steer {
            let wanted = Wanted {
                time_column: &steer.time_column,
                column: &steer.column,
                shift_s: steer.time_offset_s - window.start_s,
                scale: steer.scale_rad,
                offset: steer.offset_deg.to_radians(),
                until_s,
            };
            let series = self.series(loaded, "steer.file", &wanted, foreign);
            self.low_pass(loaded, "steer.low_pass_hz", steer.low_pass_hz, series.as_ref());
            history.steering_wheel_angle_rad = series.map(|mut series| {
                let clip = steer.clip_deg.to_radians();
                series.value.iter_mut().for_each(|angle| *angle = angle.clamp(-clip, clip));
                series
            });
        }
        if let Speed::RecordedHistory { time_column, time_offset_s, column, scale_m_s, low_pass_hz, .. } =
            &scenario.speed
        {
            let wanted = Wanted {
                time_column,
                column,
                shift_s: time_offset_s - window.start_s,
                scale: *scale_m_s,
                offset: 0.0,
                until_s,
            };
            let series = self.series(loaded, "speed.file", &wanted, foreign);
            self.low_pass(loaded, "speed.low_pass_hz", *low_pass_hz, series.as_ref());
            history.speed_m_s = series;
        }
        for (i, compare) in scenario.compare.iter().flatten().enumerate() {
            let wanted = Wanted {
                time_column: &compare.time_column,
                column: &compare.column,
                shift_s: compare.time_offset_s - window.start_s,
                scale: compare.scale,
                offset: 0.0,
                until_s,
            };
            if let Some(series) = self.series(loaded, &format!("compare[{i}].file"), &wanted, foreign) {
                let (signal, column) = (compare.signal, compare.column.clone());
                history.measured.push(MeasuredSignal { signal, column, series });
            }
        }
        (self.problems.violations.len() == wrong_before).then_some(Some(history))
    }

    /// A low-pass that the record is too coarse for.
    fn low_pass(
        &mut self,
        loaded: &Loaded<Scenario>,
        key: &str,
        cutoff_hz: Option<f64>,
        series: Option<&TimeSeries>,
    ) {
        let spacing_s = series.map_or(0.0, TimeSeries::median_spacing_s);
        let most_hz = 0.45 / spacing_s;
        if cutoff_hz.is_some_and(|cutoff_hz| cutoff_hz >= most_hz) {
            let rule = format!("must be below {most_hz:.1} Hz, 0.45 of the record's sampling frequency");
            self.problems.push(loaded.violation(Mistake::Record, key, rule));
        }
    }

    fn series(
        &mut self,
        loaded: &Loaded<Scenario>,
        key: &str,
        wanted: &Wanted<'_>,
        foreign: &ForeignRecord<'_>,
    ) -> Option<TimeSeries> {
        let path = match record_path(loaded, key) {
            Ok(path) => path,
            Err(rule) => {
                self.problems.push(loaded.violation(Mistake::NotFound, key, rule));
                return None;
            }
        };
        if !path.exists() {
            let rule = format!("no such file: {}", path.display());
            self.problems.push(loaded.violation(Mistake::NotFound, key, rule));
            return None;
        }
        let csv = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv"));
        let series = if csv {
            record::read(&path, wanted)
        } else {
            let name = path.display().to_string();
            match foreign(&path, wanted.time_column, wanted.column) {
                Some(Ok(samples)) => record::of_samples(&samples, &name, wanted),
                Some(Err(rule)) => Err(Problems::one(in_file(Mistake::Record, &name, wanted.column, rule))),
                None => {
                    let rule = "must be a .csv file, or a log of this bench (.mcap, or a run's directory); \
                                other records are exported to CSV first";
                    Err(Problems::one(loaded.violation(Mistake::Record, key, rule)))
                }
            }
        };
        match series {
            Ok(series) => Some(series),
            Err(problems) => {
                self.problems.extend(problems);
                None
            }
        }
    }
}

/// Where a recorded file lies: in `record.directory`, else beside the file that names it. A file given with
/// `--set` does not mean a directory that was not.
fn record_path(loaded: &Loaded<Scenario>, key: &str) -> Result<PathBuf, String> {
    let said = |key: &str| {
        let node = loaded.tree.at(key)?;
        let Value::Text(text) = &node.value else { return None };
        Some((text.as_str(), &loaded.sources.get(node.origin.source)?.place))
    };
    let Some((file, from)) = said(key) else { return Err("must name a file".to_owned()) };
    let beside = |place: &Place, path: &str| match place {
        Place::Disk(by) => Some(by.parent().unwrap_or(Path::new("")).join(path)),
        Place::Override => Some(PathBuf::from(path)),
        Place::Library(_) => Path::new(path).is_absolute().then(|| PathBuf::from(path)),
    };
    let directory = said("record.directory")
        .filter(|(_, by)| *from != Place::Override || **by == Place::Override)
        .filter(|_| Path::new(file).is_relative());
    match directory {
        Some((directory, by)) => beside(by, directory).map(|path| path.join(file)),
        None => beside(from, file),
    }
    .ok_or_else(|| {
        format!(
            "is not shipped: give the directory of the record with --set record.directory=DIR, or the file \
             itself with --set {key}=FILE"
        )
    })
}

/// The file named at a key, relative to the file that says it.
fn named_path(loaded: &Loaded<Scenario>, key: &str) -> Result<PathBuf, String> {
    let node = loaded.tree.at(key).ok_or("must name a file")?;
    let Value::Text(file) = &node.value else { return Err("must name a file".to_owned()) };
    match loaded.sources.get(node.origin.source).map(|source| &source.place) {
        Some(Place::Disk(by)) => Ok(by.parent().unwrap_or(Path::new("")).join(file)),
        Some(Place::Library(_)) if Path::new(file).is_relative() => {
            Err(format!("is not shipped: give it with --set {key}=FILE"))
        }
        _ => Ok(PathBuf::from(file)),
    }
}

fn in_file(mistake: Mistake, file: &str, key: &str, rule: String) -> Violation {
    Violation { key: key.to_owned(), ..Violation::of_file(mistake, file, rule) }
}
