//! The anti-lock controller of `tests/fmu/abs.c` as an FMU of FMI 2.0 or 3.0, sound or spoilt, and the same in Rust.

use crate::support::workspace;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What the FMU's instantiation wants to hear.
const TOKEN: &str = "{6d1b8a52-7a53-4e0e-9c5e-5d0a4c7f2b11}";

/// What the controller does in its fault, by the number of its parameter `fault`.
#[allow(missing_docs)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Misdeed {
    None,
    NotANumber,
    Crash,
    SleepTwoSeconds,
    Loop,
    Error,
    Exit,
    FourMilliseconds,
}

/// How an FMU is to be made.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// 2 or 3.
    pub fmi: u32,
    /// Folder of the binary; `None`: this machine's.
    pub platform: Option<&'static str>,
    /// Further words for the compiler.
    pub compiler: &'static [&'static str],
    /// Replaced in the XML.
    pub edits: Vec<(&'static str, &'static str)>,
}

impl Recipe {
    /// A sound one.
    #[must_use]
    pub fn sound(fmi: u32) -> Self {
        Recipe { fmi, platform: None, compiler: &[], edits: Vec::new() }
    }
}

struct Variable {
    name: String,
    reference: u32,
    causality: &'static str,
    kind: &'static str,
    unit: Option<&'static str>,
    start: Option<&'static str>,
}

fn variables() -> Vec<Variable> {
    let mut all = Vec::new();
    let mut add = |name: &str, causality, kind, unit, start| {
        let reference = all.len() as u32;
        all.push(Variable { name: name.to_owned(), reference, causality, kind, unit, start });
    };
    let wheels = ["fl", "fr", "rl", "rr"];
    add("speed", "input", "Real", Some("km/h"), Some("0"));
    add("yaw_rate", "input", "Real", Some("deg/s"), Some("0"));
    for wheel in wheels {
        add(&format!("spin_{wheel}"), "input", "Real", Some("rad/s"), Some("0"));
    }
    for wheel in wheels {
        add(&format!("ratio_{wheel}"), "output", "Real", None, None);
    }
    add("active", "output", "Integer", None, None);
    let parameter = "parameter";
    add("slip_low", parameter, "Real", None, Some("0.08"));
    add("slip_high", parameter, "Real", None, Some("0.15"));
    add("release_per_s", parameter, "Real", Some("1/s"), Some("12"));
    add("build_per_s", parameter, "Real", Some("1/s"), Some("4"));
    add("floor", parameter, "Real", None, Some("0.05"));
    add("radius", parameter, "Real", Some("m"), Some("0.3"));
    add("off_below", parameter, "Real", Some("km/h"), Some("8"));
    add("yaw_gain", parameter, "Real", None, Some("0.5"));
    add("fault_time", parameter, "Real", Some("s"), Some("0"));
    add("fault", parameter, "Integer", None, Some("0"));
    add("label", parameter, "String", None, Some("abs"));
    add("enabled", parameter, "Boolean", None, Some("true"));
    all
}

const UNITS: &str = r#"
    <Unit name="km/h"><BaseUnit m="1" s="-1" factor="0.27777777777777778"/></Unit>
    <Unit name="deg/s"><BaseUnit s="-1" rad="1" factor="0.017453292519943295"/></Unit>
    <Unit name="rad/s"><BaseUnit s="-1" rad="1"/></Unit>
    <Unit name="1/s"><BaseUnit s="-1"/></Unit>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="s"><BaseUnit s="1"/></Unit>"#;

fn description(fmi: u32) -> String {
    let mut list = String::new();
    let mut structure = String::new();
    for v in variables() {
        let unit = v.unit.map_or_else(String::new, |unit| format!(" unit=\"{unit}\""));
        let variability = match (v.causality, v.kind) {
            ("parameter", _) => "fixed",
            (_, "Real") => "continuous",
            _ => "discrete",
        };
        let start = v.start.map_or_else(String::new, |start| format!(" start=\"{start}\""));
        let shared = format!(
            "name=\"{}\" valueReference=\"{}\" causality=\"{}\" variability=\"{variability}\"",
            v.name, v.reference, v.causality
        );
        if fmi == 2 {
            let _ =
                write!(list, "\n    <ScalarVariable {shared}><{}{unit}{start}/></ScalarVariable>", v.kind);
        } else {
            let kind = match v.kind {
                "Real" => "Float64",
                "Integer" => "Int32",
                kind => kind,
            };
            if kind == "String" {
                let _ = write!(list, "\n    <String {shared}><Start value=\"abs\"/></String>");
            } else {
                let _ = write!(list, "\n    <{kind} {shared}{unit}{start}/>");
            }
        }
        if v.causality == "output" {
            if fmi == 2 {
                let _ = write!(structure, "<Unknown index=\"{}\"/>", v.reference + 1);
            } else {
                let _ = write!(structure, "<Output valueReference=\"{}\"/>", v.reference);
            }
        }
    }
    if fmi == 3 {
        list += "\n    <Float64 name=\"time\" valueReference=\"23\" causality=\"independent\" unit=\"s\"/>";
    }
    let (token, structure) = if fmi == 2 {
        ("guid", format!("<Outputs>{structure}</Outputs><InitialUnknowns>{structure}</InitialUnknowns>"))
    } else {
        ("instantiationToken", format!("{structure}{}", structure.replace("<Output ", "<InitialUnknown ")))
    };
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<fmiModelDescription fmiVersion=\"{fmi}.0\" modelName=\"abs\" \
         {token}=\"{TOKEN}\" description=\"Wheel-slip controller with a yaw share\">\n  <CoSimulation \
         modelIdentifier=\"abs\" canHandleVariableCommunicationStepSize=\"true\"/>\n  <UnitDefinitions>{UNITS}\n  \
         </UnitDefinitions>\n  <ModelVariables>{list}\n  </ModelVariables>\n  <ModelStructure>{structure}\
         </ModelStructure>\n</fmiModelDescription>\n"
    )
}

/// Compiles and packs the controller into `file`.
///
/// # Panics
/// When there is no C compiler, or it refuses.
#[allow(clippy::unwrap_used, clippy::panic)]
pub fn build(recipe: &Recipe, file: &Path) -> PathBuf {
    let folder = tempfile::tempdir().unwrap();
    let binary = folder.path().join("abs.so");
    let done = Command::new("cc")
        .args(["-shared", "-fPIC", "-O2", "-std=gnu11", "-Wall", "-Werror", "-ffp-contract=off"])
        .arg(format!("-DFMI={}", recipe.fmi))
        .arg(format!("-DTOKEN=\"{TOKEN}\""))
        .args(recipe.compiler)
        .arg(workspace().join("tests/fmu/abs.c"))
        .arg("-o")
        .arg(&binary)
        .arg("-lm")
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let platform = recipe.platform.unwrap_or(if recipe.fmi == 2 { "linux64" } else { "x86_64-linux" });
    let mut text = description(recipe.fmi);
    for (from, to) in &recipe.edits {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let entries = [
        ("modelDescription.xml".to_owned(), text.into_bytes()),
        (format!("binaries/{platform}/abs.so"), std::fs::read(&binary).unwrap()),
        ("resources/readme.txt".to_owned(), b"nothing is read from here\n".to_vec()),
    ];
    let mut zip = zip::ZipWriter::new(std::fs::File::create(file).unwrap());
    for (name, bytes) in entries {
        zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        zip.write_all(&bytes).unwrap();
    }
    zip.finish().unwrap();
    file.to_owned()
}

/// The same controller in Rust: the same operations in the same order.
#[derive(Debug, Clone)]
pub struct Abs {
    ratio: [f64; 4],
}

impl Default for Abs {
    fn default() -> Self {
        Abs { ratio: [1.0; 4] }
    }
}

impl Abs {
    /// One step of `h` seconds. Speed in km/h, yaw rate in deg/s, spins in rad/s; pressure ratios.
    pub fn step(&mut self, h: f64, speed: f64, yaw_rate: f64, spin: &[f64]) -> [f64; 4] {
        let v = speed / 3.6;
        let mut out = [0.0; 4];
        for i in 0..4 {
            let mut slip = 1.0 - 0.3 * spin[i] / v.max(0.5);
            if speed < 8.0 {
                slip = 0.0;
            }
            if slip > 0.15 {
                self.ratio[i] -= 12.0 * h;
            } else if slip < 0.08 {
                self.ratio[i] += 4.0 * h;
            }
            self.ratio[i] = self.ratio[i].clamp(0.05, 1.0);
            let mut share: f64 = 0.0;
            if i < 2 {
                share = (0.5 * yaw_rate * if i == 0 { 1.0 } else { -1.0 }).max(0.0);
            }
            out[i] = (self.ratio[i] - share).max(0.05);
        }
        out
    }
}
