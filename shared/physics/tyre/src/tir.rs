//! Reader of `.tir` tyre property files: `[SECTION]` lines, `KEY = VALUE` lines, `$` and `!` comments.
//!
//! Numbers are converted to SI from the units that `[UNITS]` names (coefficients of the Magic Formula are
//! dimensionless or per radian in every such file and stay as they are). All violations are collected, each with
//! its line. Unknown keys and missing `Must` keys are violations; keys of the known formats that this model does
//! not use, and the sections [`SKIPPED`], are passed over. Fortran exponents (`1.0D-3`) are read.

use crate::keys::{Dimension, KEYS, Need, Parameters, UNUSED};
use std::fmt;

/// Sections that hold tables or another model's data; their lines are not read.
const SKIPPED: &[&str] =
    &["SHAPE", "CONTACT_COEFFICIENTS", "DEFLECTION_LOAD_CURVE", "BOTTOMING_CURVE", "SUPPLEMENT", "COMMENTS"];

/// One thing wrong with a property file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TirError {
    /// Name of the file, as given.
    pub file: String,
    /// Line, from 1; `None` for what is missing from the whole file.
    pub line: Option<usize>,
    /// Section the line stands in, without brackets; empty before the first.
    pub section: String,
    /// The key; empty when the line has none.
    pub key: String,
    /// The value as written; empty when missing.
    pub value: String,
    /// The rule that is broken: "must be ...", "unknown key ...".
    pub rule: String,
}

impl fmt::Display for TirError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        write!(f, ": ")?;
        if !self.section.is_empty() {
            write!(f, "[{}] ", self.section)?;
        }
        write!(f, "{}", self.key)?;
        if !self.value.is_empty() {
            write!(f, " = {}", self.value)?;
        }
        write!(f, ": {}", self.rule)
    }
}

impl std::error::Error for TirError {}

/// The version of the Magic Formula that a file's coefficients belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Version {
    /// MF-Tyre 5.2 and its twin PAC2002: `FITTYP` 5, 6, 51, 52, or `PROPERTY_FILE_FORMAT = 'PAC2002'`.
    Mf52,
    /// MF-Tyre 6.1: `FITTYP` 60, 61.
    Mf61,
    /// MF-Tyre 6.2: `FITTYP` 62.
    Mf62,
    /// No formula: a table tyre.
    Table,
}

/// The side of the car a tyre was measured for or stands on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// A key the file does not give, and the value taken for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Substituted {
    /// The key.
    pub key: &'static str,
    /// The value taken, SI.
    pub value: f64,
}

/// What the reader found.
pub(crate) struct TirFile {
    pub parameters: Parameters,
    pub version: Version,
    pub side: Option<Side>,
    pub has_turn_slip: bool,
    pub substituted: Vec<Substituted>,
}

/// SI value of one file unit.
#[derive(Clone, Copy)]
struct Units {
    length: f64,
    force: f64,
    angle: f64,
    mass: f64,
    time: f64,
    pressure: Option<f64>,
}

impl Units {
    fn factor(&self, dimension: Dimension) -> f64 {
        match dimension {
            Dimension::None => 1.0,
            Dimension::Length => self.length,
            Dimension::PerLength => 1.0 / self.length,
            Dimension::PerLengthSquared => 1.0 / (self.length * self.length),
            Dimension::Force => self.force,
            Dimension::Torque => self.force * self.length,
            Dimension::Mass => self.mass,
            Dimension::Angle => self.angle,
            Dimension::Speed => self.length / self.time,
            Dimension::Pressure => self.pressure.unwrap_or(self.force / (self.length * self.length)),
            Dimension::Stiffness => self.force / self.length,
            Dimension::Damping => self.force * self.time / self.length,
        }
    }
}

/// SI value of a unit by its name in `[UNITS]`, or the names that are known.
fn unit(key: &str, name: &str) -> Result<f64, &'static str> {
    let name = name.to_ascii_lowercase();
    Ok(match (key, name.as_str()) {
        ("LENGTH", "meter" | "metre" | "meters" | "metres" | "m") => 1.0,
        ("LENGTH", "mm" | "millimeter" | "millimetre") => 1e-3,
        ("LENGTH", "cm" | "centimeter" | "centimetre") => 1e-2,
        ("LENGTH", "km" | "kilometer" | "kilometre") => 1e3,
        ("LENGTH", "inch" | "in") => 0.0254,
        ("LENGTH", "foot" | "feet" | "ft") => 0.3048,
        ("LENGTH", "mile") => 1609.344,
        ("LENGTH", _) => return Err("must be a length unit: meter, mm, cm, km, inch, foot or mile"),
        ("FORCE", "newton" | "newtons" | "n") => 1.0,
        ("FORCE", "knewton" | "kilonewton" | "kn") => 1e3,
        ("FORCE", "kg_force" | "kilogram_force" | "kgf" | "kpound_force_metric") => 9.80665,
        ("FORCE", "pound_force" | "lbf") => 4.4482216152605,
        ("FORCE", "kpound_force") => 4448.2216152605,
        ("FORCE", _) => {
            return Err("must be a force unit: newton, knewton, kg_force, pound_force or kpound_force");
        }
        ("ANGLE", "radians" | "radian" | "rad") => 1.0,
        ("ANGLE", "degrees" | "degree" | "deg") => std::f64::consts::PI / 180.0,
        ("ANGLE", _) => return Err("must be an angle unit: radians or degrees"),
        ("MASS", "kg" | "kilogram") => 1.0,
        ("MASS", "gram" | "g") => 1e-3,
        ("MASS", "tonne" | "ton_metric" | "megagram") => 1e3,
        ("MASS", "pound_mass" | "lbm" | "pound") => 0.45359237,
        ("MASS", "slug") => 14.593902937206,
        ("MASS", _) => return Err("must be a mass unit: kg, gram, tonne, pound_mass or slug"),
        ("TIME", "second" | "seconds" | "sec" | "s") => 1.0,
        ("TIME", "millisecond" | "milliseconds" | "ms") => 1e-3,
        ("TIME", "minute" | "min") => 60.0,
        ("TIME", "hour" | "h") => 3600.0,
        ("TIME", _) => return Err("must be a time unit: second, millisecond, minute or hour"),
        ("PRESSURE", "pascal" | "pa") => 1.0,
        ("PRESSURE", "kpascal" | "kilopascal" | "kpa") => 1e3,
        ("PRESSURE", "mpascal" | "megapascal" | "mpa") => 1e6,
        ("PRESSURE", "bar") => 1e5,
        ("PRESSURE", "psi") => 6894.757293168,
        ("PRESSURE", _) => return Err("must be a pressure unit: pascal, kpascal, mpascal, bar or psi"),
        _ => return Err("unknown unit"),
    })
}

/// One `KEY = VALUE` line.
struct Entry<'a> {
    line: usize,
    section: &'a str,
    key: String,
    value: &'a str,
}

impl Entry<'_> {
    fn broken(&self, file: &str, rule: impl Into<String>) -> TirError {
        TirError {
            file: file.to_owned(),
            line: Some(self.line),
            section: self.section.to_owned(),
            key: self.key.clone(),
            value: self.value.to_owned(),
            rule: rule.into(),
        }
    }

    fn text(&self) -> &str {
        self.value.trim_matches(['\'', '"']).trim()
    }

    fn number(&self) -> Option<f64> {
        let text = self.text();
        let value: f64 = text.parse().or_else(|_| text.replace(['D', 'd'], "e").parse()).ok()?;
        value.is_finite().then_some(value)
    }
}

/// Splits the text into entries, noting lines that are neither section, comment nor `KEY = VALUE`.
fn entries<'a>(text: &'a str, file: &str, errors: &mut Vec<TirError>) -> Vec<Entry<'a>> {
    let mut found = Vec::new();
    let mut section = "";
    for (index, raw) in text.lines().enumerate() {
        let raw = if index == 0 { raw.trim_start_matches('\u{feff}') } else { raw };
        let code = raw.split(['$', '!']).next().unwrap_or("").trim();
        if code.is_empty() {
            continue;
        }
        if let Some(rest) = code.strip_prefix('[') {
            section = rest.split(']').next().unwrap_or("").trim();
            continue;
        }
        if SKIPPED.contains(&section.to_ascii_uppercase().as_str()) {
            continue;
        }
        match code.split_once('=') {
            Some((key, value)) => found.push(Entry {
                line: index + 1,
                section,
                key: key.trim().to_ascii_uppercase(),
                value: value.trim(),
            }),
            None => errors.push(TirError {
                file: file.to_owned(),
                line: Some(index + 1),
                section: section.to_owned(),
                key: code.chars().take(60).collect(),
                value: String::new(),
                rule: "must be a [SECTION], a comment ($ or !) or KEY = VALUE".to_owned(),
            }),
        }
    }
    found
}

fn in_units_section(entry: &Entry<'_>) -> bool {
    entry.section.eq_ignore_ascii_case("UNITS")
}

fn read_units(entries: &[Entry<'_>], file: &str, errors: &mut Vec<TirError>) -> Units {
    let mut units = Units { length: 1.0, force: 1.0, angle: 1.0, mass: 1.0, time: 1.0, pressure: None };
    let mut given = Vec::new();
    for entry in entries.iter().filter(|e| in_units_section(e)) {
        match unit(&entry.key, entry.text()) {
            Ok(value) => {
                given.push(entry.key.as_str());
                match entry.key.as_str() {
                    "LENGTH" => units.length = value,
                    "FORCE" => units.force = value,
                    "ANGLE" => units.angle = value,
                    "MASS" => units.mass = value,
                    "TIME" => units.time = value,
                    _ => units.pressure = Some(value),
                }
            }
            Err(_) if entry.key == "TEMPERATURE" => {}
            Err(rule) => {
                given.push(entry.key.as_str());
                errors.push(entry.broken(file, rule));
            }
        }
    }
    for key in ["LENGTH", "FORCE", "ANGLE", "MASS", "TIME"] {
        if !given.contains(&key) {
            errors.push(missing(file, "UNITS", key));
        }
    }
    units
}

fn missing(file: &str, section: &str, key: &str) -> TirError {
    TirError {
        file: file.to_owned(),
        line: None,
        section: section.to_owned(),
        key: key.to_owned(),
        value: String::new(),
        rule: "missing key".to_owned(),
    }
}

fn read_version(entries: &[Entry<'_>], file: &str, errors: &mut Vec<TirError>) -> Version {
    if let Some(entry) = entries.iter().find(|e| e.key == "FITTYP") {
        return match entry.number() {
            Some(5.0 | 6.0 | 51.0 | 52.0) => Version::Mf52,
            Some(60.0 | 61.0) => Version::Mf61,
            Some(62.0) => Version::Mf62,
            _ => {
                errors.push(entry.broken(
                    file,
                    "must be 5, 6, 51 or 52 (MF-Tyre 5.2), 61 (MF-Tyre 6.1) or 62 (MF-Tyre 6.2)",
                ));
                Version::Mf61
            }
        };
    }
    match entries.iter().find(|e| e.key == "PROPERTY_FILE_FORMAT") {
        Some(entry)
            if ["PAC2002", "MF_05", "MF-TYRE"].contains(&entry.text().to_ascii_uppercase().as_str()) =>
        {
            Version::Mf52
        }
        Some(entry) => {
            errors.push(entry.broken(file, "must be 'PAC2002' where FITTYP is absent"));
            Version::Mf52
        }
        None => {
            errors.push(missing(file, "MODEL", "FITTYP"));
            Version::Mf61
        }
    }
}

fn read_side(entries: &[Entry<'_>], file: &str, errors: &mut Vec<TirError>) -> Option<Side> {
    let entry = entries.iter().find(|e| e.key == "TYRESIDE")?;
    match entry.text().to_ascii_uppercase().as_str() {
        "LEFT" => Some(Side::Left),
        "RIGHT" => Some(Side::Right),
        "UNKNOWN" | "SYMMETRIC" | "" => None,
        _ => {
            errors.push(entry.broken(file, "must be 'LEFT' or 'RIGHT'"));
            None
        }
    }
}

/// Nearest known key, for a misspelt one.
fn suggestion(key: &str) -> Option<&'static str> {
    KEYS.iter()
        .map(|k| k.name)
        .map(|name| (strsim::damerau_levenshtein(key, name), name))
        .filter(|(distance, name)| *distance <= 1 + name.len() / 6)
        .min()
        .map(|(_, name)| name)
}

/// Rules of single values and pairs that the equations need.
fn check(p: &Parameters) -> Vec<(&'static str, f64, &'static str)> {
    let mut broken = Vec::new();
    let mut require = |holds: bool, key, value, rule| {
        if !holds {
            broken.push((key, value, rule));
        }
    };
    require(p.unloaded_radius > 0.0, "UNLOADED_RADIUS", p.unloaded_radius, "must be > 0");
    require(p.width > 0.0, "WIDTH", p.width, "must be > 0");
    require(
        p.rim_radius > 0.0 && p.rim_radius < p.unloaded_radius,
        "RIM_RADIUS",
        p.rim_radius,
        "must be > 0 and below UNLOADED_RADIUS",
    );
    require(
        p.aspect_ratio > 0.0 && p.aspect_ratio < 2.0,
        "ASPECT_RATIO",
        p.aspect_ratio,
        "must be in (0, 2)",
    );
    require(p.fnomin > 0.0, "FNOMIN", p.fnomin, "must be > 0");
    require(p.vertical_stiffness > 0.0, "VERTICAL_STIFFNESS", p.vertical_stiffness, "must be > 0");
    require(p.vertical_damping >= 0.0, "VERTICAL_DAMPING", p.vertical_damping, "must be >= 0");
    require(p.longvl > 0.0, "LONGVL", p.longvl, "must be > 0");
    require(p.vxlow > 0.0, "VXLOW", p.vxlow, "must be > 0");
    require(p.nompres > 0.0, "NOMPRES", p.nompres, "must be > 0");
    require(p.inflpres > 0.0, "INFLPRES", p.inflpres, "must be > 0");
    require(p.lfzo > 0.0, "LFZO", p.lfzo, "must be > 0");
    require(p.lmux > 0.0, "LMUX", p.lmux, "must be > 0");
    require(p.lmuy > 0.0, "LMUY", p.lmuy, "must be > 0");
    require(p.pcx1 * p.lcx > 0.0, "PCX1", p.pcx1, "must be > 0 (times LCX)");
    require(p.pcy1 * p.lcy > 0.0, "PCY1", p.pcy1, "must be > 0 (times LCY)");
    require(p.pdx1 != 0.0, "PDX1", p.pdx1, "must not be 0");
    require(p.pdy1 != 0.0, "PDY1", p.pdy1, "must not be 0");
    require(p.pky2 != 0.0, "PKY2", p.pky2, "must not be 0");
    require(
        p.longitudinal_stiffness > 0.0,
        "LONGITUDINAL_STIFFNESS",
        p.longitudinal_stiffness,
        "must be > 0",
    );
    require(p.lateral_stiffness > 0.0, "LATERAL_STIFFNESS", p.lateral_stiffness, "must be > 0");
    require(p.fzmin < p.fzmax, "FZMAX", p.fzmax, "must be above FZMIN");
    require(p.cammin < p.cammax, "CAMMAX", p.cammax, "must be above CAMMIN");
    require(p.alpmin < p.alpmax, "ALPMAX", p.alpmax, "must be above ALPMIN");
    require(p.kpumin < p.kpumax, "KPUMAX", p.kpumax, "must be above KPUMIN");
    require(p.presmin < p.presmax, "PRESMAX", p.presmax, "must be above PRESMIN");
    let slope = p.vertical_stiffness * p.unloaded_radius / p.fnomin;
    require(
        slope * slope >= 4.0 * p.q_fz2,
        "Q_FZ2",
        p.q_fz2,
        "must be at most (VERTICAL_STIFFNESS UNLOADED_RADIUS / FNOMIN)^2 / 4",
    );
    broken
}

/// Reads a property file; all violations at once.
pub(crate) fn read(text: &str, file: &str) -> Result<TirFile, Vec<TirError>> {
    let mut errors = Vec::new();
    let entries = entries(text, file, &mut errors);
    let units = read_units(&entries, file, &mut errors);
    let version = read_version(&entries, file, &mut errors);
    let side = read_side(&entries, file, &mut errors);

    let mut parameters = Parameters::default();
    // Which entry gave each key of the table.
    let mut source: Vec<Option<&Entry<'_>>> = vec![None; KEYS.len()];
    for entry in entries.iter().filter(|e| !in_units_section(e)) {
        let Some(index) = KEYS.iter().position(|k| k.name == entry.key) else {
            if !UNUSED.contains(&entry.key.as_str()) {
                let rule = match suggestion(&entry.key) {
                    Some(name) => format!("unknown key; did you mean {name}?"),
                    None => "unknown key".to_owned(),
                };
                errors.push(entry.broken(file, rule));
            }
            continue;
        };
        let Some(value) = entry.number() else {
            errors.push(entry.broken(file, "must be a finite number"));
            source[index] = Some(entry);
            continue;
        };
        if let Some(first) = source[index] {
            if first.number() != Some(value) {
                errors.push(
                    entry.broken(file, format!("given before with another value, in line {}", first.line)),
                );
            }
            continue;
        }
        source[index] = Some(entry);
        (KEYS[index].set)(&mut parameters, value * units.factor(KEYS[index].dimension));
    }

    let mut substituted = Vec::new();
    for (key, given) in KEYS.iter().zip(&source) {
        match (key.need, given) {
            (_, Some(_)) => {}
            (Need::Must, None) => errors.push(missing(file, "", key.name)),
            (Need::Or(value), None) => {
                (key.set)(&mut parameters, value);
                substituted.push(Substituted { key: key.name, value });
            }
        }
    }
    if errors.is_empty() {
        for (key, value, rule) in check(&parameters) {
            let at = KEYS.iter().position(|k| k.name == key).and_then(|i| source[i]);
            errors.push(match at {
                Some(entry) => entry.broken(file, rule),
                None => {
                    TirError { value: value.to_string(), rule: rule.to_owned(), ..missing(file, "", key) }
                }
            });
        }
    }
    if !errors.is_empty() {
        errors.sort_by_key(|e| e.line.unwrap_or(usize::MAX));
        return Err(errors);
    }
    let has_turn_slip = KEYS.iter().zip(&source).any(|(k, s)| k.name == "PDXP1" && s.is_some());
    Ok(TirFile { parameters, version, side, has_turn_slip, substituted })
}
