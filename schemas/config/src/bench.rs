//! A whole bench resolved from one scenario: every file it names, read, checked and put together, with a
//! canonical text and its hash for the log.

use crate::axle::Axle;
use crate::car::Car;
use crate::check::Broken;
use crate::library::Kind;
use crate::load::{self, Draft, Loaded, Section};
use crate::model::ModelFiles;
use crate::problem::{Mistake, Problems, Violation};
use crate::record::{self, MeasuredSignal, RecordedHistory, TimeSeries, Wanted};
use crate::rig::Rig;
use crate::scenario::{Scenario, Speed};
use crate::steer::Steer;
use crate::tree::{Node, Place, Source, Value};
use crate::unit::SteeringUnit;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::{Path, PathBuf};

/// Largest tyre or hardpoint file. [bytes]
const REFERENCE_BYTES_MAX: u64 = 64 << 20;

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
    /// Recorded histories, if the scenario names any.
    pub record: Option<RecordedHistory>,
    /// Every configuration text that was read, for the log (overrides included).
    pub sources: Vec<TextFile>,
}

impl ResolvedBench {
    /// Loads a scenario (a path, or a shipped one by its bare name) and everything that it names. Overrides
    /// are `path=value`; a path that starts with `car.`, `front_axle.`, `rear_axle.`, `rig.` or `unit.`
    /// reaches into that section, any other into the scenario.
    ///
    /// # Errors
    /// All violations of all files at once.
    pub fn load(scenario: &str, overrides: &[String]) -> Result<Self, Problems> {
        let place = load::place_of_argument(scenario, Kind::Scenario)?;
        let mut assembly = Assembly { overrides, problems: Problems::default(), sources: Vec::new() };
        let mut draft = Draft::read(&place, Kind::Scenario, &assembly.of("scenario"))?;
        let scenario = draft.finish::<Scenario>();
        let rig = assembly.section::<Rig>(&draft, "rig_file", "rig");
        let unit = assembly.section::<SteeringUnit>(&draft, "unit_file", "unit");
        let unit_model =
            unit.as_ref().and_then(|unit| assembly.model(&unit.tree, &unit.sources, "model.file"));
        let car = assembly.car(&draft);
        let scenario = assembly.keep(scenario);
        let record = scenario.as_ref().and_then(|loaded| assembly.record(loaded));
        let Assembly { mut problems, sources, .. } = assembly;
        problems.sort();
        match (scenario, car, rig, unit, record) {
            (Some(scenario), Some(car), Some(rig), Some(unit), Some(record)) if problems.is_empty() => {
                Ok(Self {
                    scenario: scenario.value,
                    car: car.car,
                    front_axle: car.front_axle,
                    rear_axle: car.rear_axle,
                    tyres: car.tyres,
                    rig: rig.value,
                    unit: unit.value,
                    unit_model,
                    driveline_model: car.driveline_model,
                    record,
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
        if let Some(record) = &mut canonical.scenario.record {
            record.directory = None;
        }
        // Through `Value`, whose maps are sorted; numbers are finite since they passed the schema.
        serde_json::to_value(&canonical).map(|value| value.to_string()).unwrap_or_default()
    }

    /// SHA-256 of the canonical text, in hexadecimal: equal for runs with equal configuration.
    pub fn hash(&self) -> String {
        let digest = Sha256::digest(self.canonical_json().as_bytes());
        digest.iter().map(|byte| format!("{byte:02x}")).collect()
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

struct ResolvedCar {
    car: Car,
    front_axle: Axle,
    rear_axle: Option<Axle>,
    tyres: Vec<TextFile>,
    driveline_model: Option<ModelFiles>,
}

/// Gathers the parts and everything that is wrong with them.
struct Assembly<'a> {
    overrides: &'a [String],
    problems: Problems,
    sources: Vec<TextFile>,
}

impl Assembly<'_> {
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
                None => (section == "scenario").then(|| text.clone()),
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

    fn car(&mut self, scenario: &Draft) -> Option<ResolvedCar> {
        let place = self.place(scenario, "car_file", Kind::Car)?;
        let mut draft = match Draft::read(&place, Kind::Car, &self.of("car")) {
            Ok(draft) => draft,
            Err(problems) => {
                self.problems.extend(problems);
                return None;
            }
        };
        let car = draft.finish::<Car>();
        let car = self.keep(car);
        if car.as_ref().is_some_and(|car| car.value.front.axle_file.is_none()) {
            let rule =
                "must be given to run on the bench: its hardpoints are what the multibody solver poses";
            self.problems.push(draft.violation(Mistake::MissingKey, "front.axle_file", rule.to_owned()));
        }
        let front_axle = self.axle(&draft, "front");
        let rear_axle = self.axle(&draft, "rear");
        let tyres: Vec<_> = ["front", "rear"]
            .into_iter()
            .filter_map(|end| self.tyre(&draft, &format!("{end}.tyre_file")))
            .collect();
        let car = car?;
        let driveline_model = self.model(&car.tree, &car.sources, "driveline.file");
        Some(ResolvedCar { car: car.value, front_axle: front_axle?, rear_axle, tyres, driveline_model })
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

    /// `None`: something is wrong; `Some(None)`: the scenario names no record.
    fn record(&mut self, loaded: &Loaded<Scenario>) -> Option<Option<RecordedHistory>> {
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
            let series = self.series(loaded, "steer.file", &wanted);
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
            let series = self.series(loaded, "speed.file", &wanted);
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
            if let Some(series) = self.series(loaded, &format!("compare[{i}].file"), &wanted) {
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

    fn series(&mut self, loaded: &Loaded<Scenario>, key: &str, wanted: &Wanted<'_>) -> Option<TimeSeries> {
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
        if !csv {
            let rule = "must be a .csv file; other records are exported to CSV first";
            self.problems.push(loaded.violation(Mistake::Record, key, rule));
            return None;
        }
        match record::read(&path, wanted) {
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

fn in_file(mistake: Mistake, file: &str, key: &str, rule: String) -> Violation {
    Violation { key: key.to_owned(), ..Violation::of_file(mistake, file, rule) }
}
