//! Broken files of every sort: each is told with file, line, key and rule, several at once, and nothing
//! panics.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::car::Car;
use config::scenario::Scenario;
use config::{Mistake, Problems, ResolvedBench, Section, load, load_with};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A whole scenario, a line each, so that a test can break one.
const WHOLE: &str = r#"extends = "_bench"
name = "mine"
description = "A test."
duration_s = 12.0
speed = { type = "constant", speed_km_h = 80.0 }
[steer]
type = "sine"
start_s = 1.0
amplitude_deg = 30.0
frequency_hz = 0.5
fade_in_cycles = 0.5
cycles = 2
fade_out_cycles = 0.5
"#;

struct Case {
    dir: TempDir,
}

impl Case {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) -> String {
        let path = self.dir.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }

    fn problems(&self, text: &str) -> Problems {
        let path = self.write("s.toml", text);
        load::<Scenario>(&path).expect_err(text)
    }
}

/// One line of [`WHOLE`] replaced: exactly one violation, of this sort, at this line and key, whose rule and
/// suggestion hold these words.
fn check(from: &str, to: &str, mistake: Mistake, line: u32, key: &str, words: &str) {
    assert!(WHOLE.contains(from), "{from} is not in the file");
    let case = Case::new();
    let problems = case.problems(&WHOLE.replace(from, to));
    assert_eq!(problems.violations.len(), 1, "{to}:\n{problems}");
    let violation = &problems.violations[0];
    assert_eq!(
        (violation.mistake, violation.line, violation.key.as_str()),
        (mistake, line, key),
        "{problems}"
    );
    assert!(violation.file.ends_with("s.toml"), "{problems}");
    let shown = violation.to_string();
    assert!(shown.contains(words), "`{shown}` does not say `{words}`");
}

#[test]
fn the_whole_file_is_fine() {
    let case = Case::new();
    let path = case.write("s.toml", WHOLE);
    load::<Scenario>(&path).unwrap_or_else(|problems| panic!("{problems}"));
}

#[test]
fn one_broken_value_each() {
    use Mistake::*;
    let text = "duration_s = 12.0";
    check(text, "duration_s = \"long\"", WrongType, 4, "duration_s", "must be a number, not a text");
    check(text, "duration_s = \"12 s\"", WrongType, 4, "duration_s", "the key tells the unit (s)");
    check(text, "duration_s = true", WrongType, 4, "duration_s", "= true: must be a number");
    check(text, "duration_s = [12.0]", WrongType, 4, "duration_s", "= [12]: must be a number, not a list");
    check(text, "duration_s = 2026-11-22", WrongType, 4, "duration_s", "not a date or time");
    check(text, "duration_s = 0.0", OutOfRange, 4, "duration_s", "= 0: must be in (0, 86400] s");
    check(text, "duration_s = -3", OutOfRange, 4, "duration_s", "= -3: must be in (0, 86400] s");
    check(text, "duration_s = 1e99", OutOfRange, 4, "duration_s", "must be in (0, 86400] s");
    check(text, "duration_s = nan", NotFinite, 4, "duration_s", "= NaN: must be a finite number");
    check(text, "duration_s = inf", NotFinite, 4, "duration_s", "= inf: must be a finite number");
    check(text, "duration_s = 1e999", NotFinite, 4, "duration_s", "must be a finite number");
    check(text, "", MissingKey, 1, "duration_s", "missing: Length of the whole run");
    check(text, "duration = 12.0", UnknownKey, 4, "duration", "(did you mean `duration_s`?)");
    check(text, "duration_ms = 12.0", UnknownKey, 4, "duration_ms", "wanted in s, not in ms");
    check(text, "durations_s = 12.0", UnknownKey, 4, "durations_s", "(did you mean `duration_s`?)");
    check(text, "duration_s = 12.0\nduration_s = 13.0", Syntax, 5, "", "duplicate key");
    check(text, "duration_s = ", Syntax, 4, "", "not TOML");
    check(
        text,
        "duration_s = 12.0\nseed = 1.5",
        WrongType,
        5,
        "seed",
        "must be a whole number, not a decimal",
    );
    check(
        text,
        "duration_s = 12.0\nseed = -1",
        OutOfRange,
        5,
        "seed",
        "must be in [0, 9.007199254740992e15]",
    );
    check(text, "duration_s = 12.0\ngear = \"drve\"", NotAChoice, 5, "gear", "(did you mean `drive`?)");
    check(
        text,
        "duration_s = 12.0\ngear = 1",
        NotAChoice,
        5,
        "gear",
        "must be one of \"drive\", \"neutral\"",
    );
    check(text, "duration_s = 2.0", Rule, 4, "duration_s", "= 2: must be longer than warm_up_s (3 s)");
    check("name = \"mine\"", "name = \"\"", WrongLength, 2, "name", "must have 1 to 60 characters, has 0");
    check("name = \"mine\"", "name = \"a b\"", Rule, 2, "name", "must consist of letters");
}

#[test]
fn one_broken_table_each() {
    use Mistake::*;
    let kind = "type = \"sine\"";
    check(kind, "type = \"sin\"", NotAChoice, 7, "steer.type", "(did you mean `sine`?)");
    check(kind, "", MissingKey, 6, "steer.type", "missing; one of \"hold\", \"free\", \"sine\"");
    check(kind, "type = 3", NotAChoice, 7, "steer.type", "= 3: must be one of");
    check("cycles = 2\n", "cycles = 2.25\n", OutOfRange, 12, "steer.cycles", "must be a multiple of 0.5");
    check(
        "frequency_hz = 0.5",
        "frequency_khz = 0.5",
        UnknownKey,
        10,
        "steer.frequency_khz",
        "wanted in Hz, not in kHz",
    );
    check(
        "frequency_hz = 0.5",
        "frequency_hz = 0.5\ndwell_s = 1.0",
        UnknownKey,
        11,
        "steer.dwell_s",
        "unknown key",
    );
    check(
        "speed_km_h = 80.0",
        "speed_m_s = 22.0",
        UnknownKey,
        5,
        "speed.speed_m_s",
        "wanted in km/h, not in m/s",
    );
    check(
        "speed_km_h = 80.0",
        "speed_kmh = 80.0",
        UnknownKey,
        5,
        "speed.speed_kmh",
        "did you mean `speed_km_h`?",
    );
    check(
        "speed_km_h = 80.0",
        "speed_km_h = 800.0",
        OutOfRange,
        5,
        "speed.speed_km_h",
        "must be in [-30, 300] km/h",
    );
    let speed = "speed = { type = \"constant\", speed_km_h = 80.0 }";
    check(speed, "speed = 80.0", WrongType, 5, "speed", "must be a table, not a decimal number");
    check(
        speed,
        "speed = { type = \"profile\", time_s = [0, 5, 5], speed_km_h = [1, 2, 3] }",
        Rule,
        5,
        "speed.time_s[2]",
        "= 5: must be greater than 5 before it",
    );
    check(
        speed,
        "speed = { type = \"profile\", time_s = [0], speed_km_h = [1, 2] }",
        WrongLength,
        5,
        "speed.time_s",
        "must have 2 to 10000 entries, has 1",
    );
    check(
        speed,
        "speed = { type = \"profile\", time_s = [0, 5], speed_km_h = [1, 999] }",
        OutOfRange,
        5,
        "speed.speed_km_h[1]",
        "= 999: must be in [-30, 300] km/h",
    );
}

#[test]
fn the_timing_must_be_one_that_works() {
    let case = Case::new();
    let problems = case.problems(&format!("{WHOLE}[timing]\nperiod_ms = 0.7\noutput_phase = 0.3\n"));
    let shown: Vec<String> = problems.violations.iter().map(ToString::to_string).collect();
    assert!(
        shown[0].ends_with("s.toml:15:13: timing.period_ms = 0.7: must be 1, 0.5 or 0.25 ms"),
        "{problems}"
    );
    assert!(shown[1].contains("output_phase = 0.3: must be later than multibody_latest_start"), "{problems}");
}

#[test]
fn all_violations_of_all_levels_are_told_at_once() {
    let case = Case::new();
    let text = "extends = \"_bench\"\nname = 3\nnonsense = 1\nduration_s = -1\n\
        speed = { type = \"constant\", speed_km_h = nan }\n\
        steer = { type = \"step\", start_s = -1.0, angle_dg = 5.0, rise_s = 0.1 }\n";
    let problems = case.problems(text);
    let keys: Vec<&str> = problems.violations.iter().map(|violation| violation.key.as_str()).collect();
    assert_eq!(
        keys,
        [
            "description",
            "name",
            "nonsense",
            "duration_s",
            "speed.speed_km_h",
            "steer.start_s",
            "steer.angle_dg"
        ],
        "{problems}"
    );
    let json = problems.to_json();
    assert_eq!(json["violations"][1]["line"], 2);
    assert_eq!(json["violations"][6]["suggestion"], "angle_deg");
    assert_eq!(json["violations"][3]["mistake"], "out_of_range");
}

#[test]
fn a_value_of_the_extended_file_is_told_where_it_stands() {
    let case = Case::new();
    case.write("base/base.toml", WHOLE.replace("30.0", "3000.0"));
    let problems = case.problems("extends = \"base/base.toml\"\nname = \"child\"\nduration_s = -1.0\n");
    let places: Vec<_> = problems
        .violations
        .iter()
        .map(|violation| (Path::new(&violation.file).file_name().unwrap().to_str().unwrap(), violation.line))
        .collect();
    assert_eq!(places, [("base.toml", 9), ("s.toml", 3)], "{problems}");
}

#[test]
fn extends_that_go_wrong() {
    let case = Case::new();
    case.write("a.toml", "extends = \"b.toml\"\n");
    case.write("b.toml", "# b\nextends = \"c.toml\"\n");
    case.write("c.toml", "extends = \"./a.toml\"\n");
    let told = |text: &str| case.problems(text).violations[0].clone();
    let cycle = told("extends = \"a.toml\"\n");
    assert_eq!((cycle.mistake, cycle.line), (Mistake::Extends, 1));
    assert!(cycle.file.ends_with("c.toml"));
    let shown = cycle.rule.replace(case.dir.path().to_str().unwrap(), "");
    assert_eq!(shown, "must not lead back to itself: /a.toml → /b.toml → /c.toml → /a.toml");
    let itself = told("extends = \"s.toml\"\n");
    assert!(itself.rule.starts_with("must not lead back to itself"));

    for i in 0..12 {
        case.write(&format!("d{i}.toml"), format!("extends = \"d{}.toml\"\n", i + 1));
    }
    case.write("d12.toml", WHOLE);
    assert!(told("extends = \"d0.toml\"\n").rule.contains("deeper than 8"));
    load::<Scenario>(case.dir.path().join("d5.toml").to_str().unwrap()).unwrap();

    let lost = told("\nextends = \"gone/x.toml\"\n");
    assert_eq!((lost.mistake, lost.line, lost.key.as_str()), (Mistake::NotFound, 2, "extends"));
    assert!(lost.rule.contains("no such file") && lost.rule.contains("gone/x.toml"));
    let name = told("extends = \"growing_slalom_8\"\n");
    assert_eq!(name.suggestion.as_deref(), Some("growing_slalom_80"));
    assert_eq!(told("extends = 3\n").mistake, Mistake::WrongType);
    assert_eq!(told("extends = \"\"\n").mistake, Mistake::NotFound);
    case.write("bad.toml", "a = = 1\n");
    let inner = told("extends = \"bad.toml\"\n");
    assert!(inner.file.ends_with("bad.toml") && inner.mistake == Mistake::Syntax);
}

#[test]
fn files_that_are_no_files() {
    let case = Case::new();
    let told = |path: &str| load::<Scenario>(path).unwrap_err().violations[0].clone();
    assert_eq!(told("gone.toml").to_string(), "gone.toml: no such file");
    let directory = told(case.dir.path().join(".").to_str().unwrap());
    assert_eq!(directory.rule, "is a directory, not a file");
    assert_eq!(told("no_such_scenario").mistake, Mistake::NotFound);
    assert_eq!(told("growing_slalom80").suggestion.as_deref(), Some("growing_slalom_80"));
    assert_eq!(told("").mistake, Mistake::NotFound);
    assert_eq!(told("/dev/null").rule, "is not a regular file");
    let latin = case.write("latin.toml", b"name = \"a\"\n# caf\xe9\n");
    assert_eq!((told(&latin).rule.as_str(), told(&latin).line), ("is not UTF-8 text", 2));
    let large = case.write("large.toml", vec![b'#'; 9 << 20]);
    assert!(told(&large).rule.contains("is too large"));
    assert_eq!(told("a\0b.toml").mistake, Mistake::Unreadable);
    assert_eq!(told(&case.write("e.toml", "")).mistake, Mistake::MissingKey);
    let deep = case.write("deep.toml", format!("a = {}{}\n", "[".repeat(100_000), "]".repeat(100_000)));
    assert_eq!(told(&deep).mistake, Mistake::Syntax);
}

#[test]
fn overrides_win_and_are_told_as_such() {
    let case = Case::new();
    let path = case.write("s.toml", WHOLE);
    let set = |overrides: &[&str]| {
        let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
        load_with::<Scenario>(&path, &overrides)
    };
    let fine =
        set(&["duration_s=20", "steer.amplitude_deg = 15.5", "name=other", "timing.period_ms=0.5"]).unwrap();
    assert_eq!((fine.value.duration_s, fine.value.name.as_str()), (20.0, "other"));
    assert_eq!(fine.written_at("duration_s"), "--set");
    assert!(fine.written_at("steer.frequency_hz").ends_with("s.toml:10:16"));
    // A new type replaces the table, so that nothing of the old type is left over.
    set(&["steer.type=step", "steer.start_s=1", "steer.angle_deg=20", "steer.rise_s=0.2"]).unwrap();
    set(&["steer={type=\"hold\", angle_deg=1}"]).unwrap();

    let told = |overrides: &[&str]| set(overrides).unwrap_err().to_string();
    assert_eq!(told(&["duration_s=-1"]), "--set: duration_s = -1: must be in (0, 86400] s");
    assert_eq!(
        told(&["steer.amplitud_deg=1"]),
        "--set: steer.amplitud_deg = 1: unknown key (did you mean `amplitude_deg`?)"
    );
    assert_eq!(told(&["duration_s"]), "--set: duration_s: must be of the form path=value");
    assert!(told(&["=3"]).contains("must be a dotted key path"));
    assert!(told(&["name.x=3"]).contains("name = {…}: must be a text"));
    assert!(told(&["name[0]=3"]).contains("cannot be inside a text"));
    assert!(told(&["seed=1x"]).contains("= \"1x\": must be a whole number"));
}

/// Loads a bench and expects it to fail.
fn bench(case: &Case, text: &str, overrides: &[&str]) -> Problems {
    let path = case.write("s.toml", text);
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    ResolvedBench::load(&path, &overrides).expect_err(text)
}

#[test]
fn references_that_lead_nowhere() {
    let case = Case::new();
    let text = format!("car_file = \"sedn\"\nrig_file = \"gone/rig.toml\"\nunit_file = \".\"\n{WHOLE}");
    let problems = bench(&case, &text, &[]);
    let shown: Vec<String> = problems.violations.iter().map(ToString::to_string).collect();
    assert!(
        shown
            .iter()
            .any(|s| s.contains("s.toml:1:12: car_file = \"sedn\"") && s.contains("did you mean `sedan`?")),
        "{problems}"
    );
    assert!(
        shown.iter().any(|s| s.contains("s.toml:2:12: rig_file") && s.contains("no such file")),
        "{problems}"
    );
    assert!(shown.iter().any(|s| s.contains("is a directory")), "{problems}");
}

#[test]
fn a_broken_car_is_told_in_its_own_file_together_with_the_scenario() {
    let case = Case::new();
    case.write(
        "car.toml",
        "extends = \"sedan\"\n[body]\nsprung_mass_g = 1370000.0\nwheelbase_m = 27.0\n[front]\ntyre_file = \"gone.tir\"\n\
         axle_file = \"gone.toml\"\n",
    );
    let text = format!("car_file = \"car.toml\"\n{}", WHOLE.replace("12.0", "-12.0"));
    let problems = bench(&case, &text, &["rig.name=5", "unit.rack_mas_kg=4", "front_axle.x=1"]);
    let found = |file: &str, line: u32, key: &str| {
        let hit =
            problems.violations.iter().any(|v| v.file.ends_with(file) && v.line == line && v.key == key);
        assert!(hit, "no {file}:{line} {key} in\n{problems}");
    };
    found("s.toml", 5, "duration_s");
    found("car.toml", 3, "body.sprung_mass_g");
    found("car.toml", 4, "body.wheelbase_m");
    found("car.toml", 6, "front.tyre_file");
    found("car.toml", 7, "front.axle_file");
    found("--set", 0, "name");
    found("--set", 0, "rack_mas_kg");
}

#[test]
fn hardpoints_in_json_are_taken_or_told() {
    let case = Case::new();
    case.write("car.toml", "extends = \"sedan\"\nfront.axle_file = \"axle.json\"\n");
    case.write("axle.json", "{\"type\": \"double_wishbone\"}");
    let problems = bench(&case, &format!("car_file = \"car.toml\"\n{WHOLE}"), &[]);
    assert!(problems.violations.iter().all(|v| v.file.ends_with("axle.json")), "{problems}");
    assert!(problems.violations.len() > 3, "{problems}");
    case.write("axle.json", "{");
    bench(&case, &format!("car_file = \"car.toml\"\n{WHOLE}"), &[]);
}

#[test]
fn recorded_files_that_are_missing_or_broken() {
    let case = Case::new();
    let shipped = |overrides: &[&str]| {
        let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
        ResolvedBench::load("double_lane_change_measured", &overrides).unwrap_err()
    };
    let problems = shipped(&[]);
    assert_eq!(problems.violations.len(), 5, "{problems}");
    assert!(problems.to_string().contains("--set record.directory=DIR"), "{problems}");
    assert!(problems.violations[0].file.starts_with("library:scenarios/double_lane_change_measured.toml"));

    let directory = case.dir.path().to_str().unwrap();
    let set = format!("record.directory={directory}");
    assert!(shipped(&[&set]).to_string().contains("no such file"));
    let rows: String = (0..2300).map(|i| format!("{},0.001,0.1,19\n", f64::from(i) * 0.01)).collect();
    case.write("double_lane_change_inputs_200Hz.csv", format!("time,steering,x,y\n{rows}"));
    let car_bus = format!("car_time,Acceleration_Y,Yaw_Velocity,Velocity_X\n{rows}");
    case.write("double_lane_change_car_bus.csv", &car_bus);
    let problems = shipped(&[&set]);
    assert_eq!(problems.violations.len(), 1, "{problems}");
    assert_eq!((problems.violations[0].key.as_str(), problems.violations[0].line), ("Roll", 1));
    case.write("double_lane_change_car_bus.csv", car_bus.replace("Velocity_X", "Velocity_X,Roll"));
    let problems = shipped(&[&set]);
    assert!(problems.to_string().contains("has 4 fields where the header has 5"), "{problems}");
    assert!(problems.violations.len() + problems.more > 100);
    case.write("double_lane_change_car_bus.csv", car_bus.replace("Yaw_Velocity", "Roll"));
    let problems = shipped(&[&set, "compare=[]", "duration_s=60", "steer.low_pass_hz=80"]);
    let shown = problems.to_string();
    assert!(shown.contains("but the run needs 0 s to 57.00 s"), "{shown}");
    assert!(shown.contains("steering: covers"), "{shown}");
    let problems = shipped(&[&set, "compare=[]", "steer.low_pass_hz=80"]);
    assert!(problems.to_string().contains("steer.low_pass_hz = 80: must be below 45.0 Hz"), "{problems}");
}

#[test]
fn a_car_file_alone() {
    let case = Case::new();
    let path = case.write("c.toml", "extends = \"sedan\"\nname = 1\n[rear]\ntrack_mm = 1500.0\n");
    let problems = load::<Car>(&path).unwrap_err();
    let shown = problems.to_string();
    assert!(shown.contains("c.toml:2:8: name = 1: must be a text, not a whole number"), "{shown}");
    assert!(shown.contains("c.toml:4:1: rear.track_mm = 1500: "), "{shown}");
    assert!(Car::KIND.directory() == "cars");
}
