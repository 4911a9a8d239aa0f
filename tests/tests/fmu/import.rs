//! The importer by itself, in this process: files, names, units, steps.

use fmu::{Fmu, FmuError, Joints, Runner, Setup, Stepper, Value, Wanted};
use kingpin_tests::fmu::{Abs, Recipe, build};
use kingpin_tests::support::peer;
use std::path::Path;
use std::process::Command;

const WHEELS: [&str; 4] = ["fl", "fr", "rl", "rr"];

fn open(folder: &Path, recipe: &Recipe) -> Result<Fmu, FmuError> {
    Fmu::open(&build(recipe, &folder.join("abs.fmu")))
}

fn inputs() -> Vec<(String, &'static str)> {
    let mut all = vec![("speed".to_owned(), "m/s"), ("yaw_rate".to_owned(), "rad/s")];
    all.extend(WHEELS.map(|w| (format!("spin_{w}"), "rad/s")));
    all
}

fn outputs() -> Vec<(String, &'static str)> {
    let mut all: Vec<_> = WHEELS.map(|w| (format!("ratio_{w}"), "1")).into();
    all.push(("active".to_owned(), "1"));
    all
}

fn wanted<'a>(list: &'a [(String, &'a str)]) -> Vec<Wanted<'a>> {
    list.iter().map(|(name, unit)| Wanted { name, unit }).collect()
}

fn setup(fmu: &Fmu, folder: &Path) -> Setup {
    let (inputs, outputs) = (inputs(), outputs());
    let joints = Joints { inputs: &wanted(&inputs), outputs: &wanted(&outputs), ..Joints::default() };
    fmu.extract(folder).unwrap();
    Setup::new(fmu, "abs", folder, &joints).unwrap()
}

/// Wheels that lock and spin up again, a car that slows down.
fn drive(n: u32) -> [f64; 6] {
    let t = f64::from(n) * 1e-3;
    let v = (25.0 - 6.0 * t).max(0.0);
    let spin = |k: f64| v / 0.3 * (1.0 - 0.2 * (7.0 * t + k).sin().abs());
    [v, 0.02 * (3.0 * t).sin(), spin(0.0), spin(0.4), spin(0.9), spin(1.3)]
}

#[test]
fn both_versions_step_as_the_same_controller_in_rust() {
    for fmi in [2, 3] {
        let folder = tempfile::tempdir().unwrap();
        let fmu = open(folder.path(), &Recipe::sound(fmi)).unwrap();
        let mut runner = Runner::new(&setup(&fmu, folder.path())).unwrap();
        assert_eq!(runner.version(), format!("{fmi}.0"));
        let mut rust = Abs::default();
        let mut released = 0;
        for n in 0..4000 {
            let input = drive(n);
            let mut output = [0.0; 5];
            runner.step(f64::from(n) * 1e-3, 1e-3, &input, &mut output).unwrap();
            let expected = rust.step(
                1e-3,
                input[0] * (1.0 / 0.27777777777777778),
                input[1] * (1.0 / 0.017453292519943295),
                &input[2..],
            );
            for i in 0..4 {
                let difference = (output[i] - expected[i]).abs();
                assert!(difference <= 1e-12, "FMI {fmi}, tick {n}, wheel {i}: {difference}");
            }
            released += u32::from(output[4] != 0.0);
        }
        assert!(released > 200, "the controller never acted: {released}");
    }
}

#[test]
fn fmpy_finds_nothing_to_say_of_them() {
    let Some(python) = peer("fmpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    for fmi in [2, 3] {
        let file = build(&Recipe::sound(fmi), &folder.path().join(format!("abs{fmi}.fmu")));
        let script = "import sys\nfrom fmpy.validation import validate_fmu\nfrom fmpy import simulate_fmu\n\
                      print(validate_fmu(sys.argv[1]))\n\
                      r = simulate_fmu(sys.argv[1], stop_time=0.1, output_interval=1e-3, start_values={'speed': 90.0})\n\
                      print(len(r), r['ratio_fl'][-1] < 0.1)";
        let told = Command::new(&python).args(["-c", script]).arg(&file).output().unwrap();
        let text = String::from_utf8_lossy(&told.stdout);
        let errors = String::from_utf8_lossy(&told.stderr);
        assert_eq!(text.trim(), "[]\n101 True", "FMI {fmi}: {text}{errors}");
    }
}

#[test]
fn what_is_wrong_with_a_file_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let told = |recipe: &Recipe| {
        let fmu = open(folder.path(), recipe)?;
        let unpacked = folder.path().join("x");
        fmu.extract(&unpacked)?;
        let setup = Setup::new(&fmu, "abs", &unpacked, &Joints::default()).map_err(|mut f| f.remove(0))?;
        Runner::new(&setup).map(drop)
    };
    for fmi in [2, 3] {
        let sound = Recipe::sound(fmi);
        assert_eq!(told(&sound), Ok(()));
        let wrong = told(&Recipe { platform: Some("win64"), ..sound.clone() }).unwrap_err();
        let FmuError::WrongPlatform { present, .. } = &wrong else { panic!("{wrong}") };
        assert_eq!(present, &["win64"]);
        let wrong = told(&Recipe { compiler: &["-DWITHOUT_STEP"], ..sound.clone() }).unwrap_err();
        let FmuError::MissingSymbols { names, .. } = &wrong else { panic!("{wrong}") };
        assert_eq!(names, &[format!("fmi{fmi}DoStep")]);
        let edits = vec![("modelName=\"abs\"", "modelName=\"abs\" nonsense")];
        let wrong = told(&Recipe { edits, ..sound.clone() }).unwrap_err();
        assert!(matches!(wrong, FmuError::Xml { .. }), "{wrong}");
        let edits = vec![("{6d1b8a52", "{00000000")];
        let wrong = told(&Recipe { edits, ..sound.clone() }).unwrap_err();
        assert!(matches!(wrong, FmuError::Call { status: "no instance", .. }), "{wrong}");
        let edits = vec![("<CoSimulation", "<ModelExchange")];
        let wrong = told(&Recipe { edits, ..sound.clone() }).unwrap_err();
        assert_eq!(wrong, FmuError::NotCoSimulation);
        let edits = if fmi == 2 {
            vec![("fmiVersion=\"2.0\"", "fmiVersion=\"1.0\"")]
        } else {
            vec![("fmiVersion=\"3.0\"", "fmiVersion=\"4.0\"")]
        };
        let wrong = told(&Recipe { edits, ..sound.clone() }).unwrap_err();
        assert!(matches!(wrong, FmuError::Version { .. }), "{wrong}");
    }
    // A binary of another kind under the right name.
    let file = folder.path().join("text.fmu");
    build(&Recipe::sound(2), &file);
    let unpacked = folder.path().join("y");
    let fmu = Fmu::open(&file).unwrap();
    fmu.extract(&unpacked).unwrap();
    std::fs::write(unpacked.join("binaries/linux64/abs.so"), "not a library").unwrap();
    let setup = Setup::new(&fmu, "abs", &unpacked, &Joints::default()).unwrap();
    let wrong = Runner::new(&setup).unwrap_err();
    assert!(matches!(wrong, FmuError::Load { .. }), "{wrong}");
    // No archive, half an archive.
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    assert!(matches!(Fmu::open(&file), Err(FmuError::Zip { .. })));
    assert!(matches!(Fmu::open(&folder.path().join("none.fmu")), Err(FmuError::Io { .. })));
}

#[test]
fn what_is_wrong_with_a_binding_is_said_all_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let fmu = open(folder.path(), &Recipe::sound(3)).unwrap();
    let joints = Joints {
        inputs: &[
            Wanted { name: "spede", unit: "m/s" },
            Wanted { name: "spin_fl", unit: "Pa" },
            Wanted { name: "ratio_fl", unit: "1" },
            Wanted { name: "speed", unit: "m/s" },
        ],
        outputs: &[Wanted { name: "ratio_fr", unit: "Pa" }],
        parameters: &[
            ("speed", Value::Number(1.0)),
            ("fault", Value::Number(0.5)),
            ("floor", Value::Text("low".into())),
            ("enabled", Value::Number(1.0)),
            ("label", Value::Text("x".into())),
        ],
        ..Joints::default()
    };
    let faults = Setup::new(&fmu, "abs", folder.path(), &joints).unwrap_err();
    let told: Vec<_> = faults.iter().map(ToString::to_string).collect();
    let expected = [
        "spede: no such variable; did you mean speed?",
        "spin_fl: unit rad/s and Pa are not of one quantity",
        "ratio_fl: is output, must be input",
        "ratio_fr: the FMU states no unit; say it with units.ratio_fr (other end: Pa)",
        "speed: is input (continuous), must be a parameter",
        "fault: 0.5 is no Int32",
        "floor: is Float64, must be a text, as the value given",
    ];
    assert_eq!(told, expected, "{told:#?}");
}
