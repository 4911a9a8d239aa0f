//! Our car and suspension as FMUs: checked and run by fmpy, against the command line's own results.

use kingpin_tests::support::{kingpin, peer};
use std::fmt::Write as _;
use std::path::Path;
use std::process::Command;

const MASTER: &str = r#"
import sys, csv, shutil
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
fmu, inputs, out, instances = sys.argv[1], sys.argv[2], sys.argv[3], int(sys.argv[4])
problems = validate_fmu(fmu)
assert problems == [], problems
d = read_model_description(fmu)
folder = extract(fmu)
rows = list(csv.DictReader(open(inputs)))
by = {v.name: v for v in d.modelVariables}
reals = [v for v in d.modelVariables if v.causality == 'output']
def make(name):
    s = FMU2Slave(guid=d.guid, unzipDirectory=folder, modelIdentifier=d.coSimulation.modelIdentifier, instanceName=name)
    s.instantiate()
    return s
def drive(s):
    s.setInteger([by['steer_by'].valueReference], [1])
    def put(steer, rest):
        s.setReal([by['steering_wheel_rad_in'].valueReference, by['target_speed_mps_in'].valueReference],
                  [float(rows[steer]['steering_wheel_rad']), float(rows[rest]['target_speed_mps'])])
    s.setupExperiment(startTime=0.0)
    s.enterInitializationMode()
    put(0, 0)
    s.exitInitializationMode()
    told = [s.getReal([v.valueReference for v in reals])]
    for n in range(1, len(rows)):
        put(n, n - 1)
        s.doStep(currentCommunicationPoint=(n - 1) * 1e-3, communicationStepSize=1e-3)
        told.append(s.getReal([v.valueReference for v in reals]))
    return told
slaves = [make('a%d' % i) for i in range(instances)]
told = [drive(s) for s in slaves]
slaves[0].reset()
again = drive(slaves[0])
assert all(t == told[0] for t in told) and again == told[0], 'instances or reset differ'
with open(out, 'w') as f:
    f.write('t_s,' + ','.join(v.name for v in reals) + '\n')
    for n, values in enumerate(told[0]):
        f.write(','.join([rows[n]['t_s']] + [repr(float(v)) for v in values]) + '\n')
for s in slaves:
    s.terminate(); s.freeInstance()
shutil.rmtree(folder)
"#;

fn export(arguments: &[&str], out: &Path) {
    let done = Command::new(kingpin())
        .args(["fmu", "export"])
        .args(arguments)
        .arg("--out")
        .arg(out)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

fn table(file: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(file).unwrap();
    let mut lines = text.lines();
    let head = lines.next().unwrap().split(',').map(str::to_owned).collect();
    (head, lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect())
}

#[test]
fn fmpy_drives_our_car_to_the_bits_of_vehicle_simulate() {
    let Some(python) = peer("fmpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut rows = "t_s,steering_wheel_rad,target_speed_mps\n".to_owned();
    for n in 0..3000 {
        let t = f64::from(n) * 1e-3;
        let steer = if t > 0.5 { 0.6 * (std::f64::consts::PI * (t - 0.5)).sin() } else { 0.0 };
        let _ = writeln!(rows, "{t},{steer},{}", 22.0 + t);
    }
    std::fs::write(at("in.csv"), rows).unwrap();
    export(&["--car", "sedan"], &at("sedan.fmu"));
    let done = Command::new(&python)
        .args(["-c", MASTER])
        .args([at("sedan.fmu"), at("in.csv"), at("fmpy.csv")])
        .arg("2")
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let done = Command::new(kingpin())
        .args(["vehicle", "simulate", "--car", "sedan", "--input"])
        .arg(at("in.csv"))
        .arg("--output")
        .arg(at("own.csv"))
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let (own_head, own) = table(&at("own.csv"));
    let (fmu_head, fmu) = table(&at("fmpy.csv"));
    assert_eq!(own_head, fmu_head);
    assert_eq!(own.len(), fmu.len());
    let mut different = 0;
    for (n, (a, b)) in own.iter().zip(&fmu).enumerate() {
        for (k, (x, y)) in a.iter().zip(b).enumerate() {
            if x.to_bits() != y.to_bits() && different < 5 {
                println!("row {n}, {}: {x} against {y}", own_head[k]);
            }
            different += u64::from(x.to_bits() != y.to_bits());
        }
    }
    assert_eq!(different, 0, "of {} values", own.len() * own_head.len());
    let yaw = own_head.iter().position(|name| name == "yaw_rad").unwrap();
    assert!(own.iter().any(|row| row[yaw].abs() > 0.05), "the car turned");
}

#[test]
fn our_suspension_as_an_fmu_is_sound_and_solves_what_the_command_solves() {
    let Some(python) = peer("fmpy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("front.fmu");
    export(&["--suspension", "sedan_double_wishbone"], &file);
    let script = "import sys\nfrom fmpy.validation import validate_fmu\nfrom fmpy import simulate_fmu\n\
        assert validate_fmu(sys.argv[1]) == []\n\
        r = simulate_fmu(sys.argv[1], stop_time=0.01, output_interval=1e-3, start_values={'rack_m': 0.02, \
        'wheel_height_m_left': 0.03, 'wheel_force_z_n_left': 4000.0})\n\
        print(repr(float(r['steer_rad_left'][-1])), repr(float(r['steer_rad_right'][-1])), \
        repr(float(r['solver_status'][-1])), repr(float(r['tie_rod_force_n_left'][-1])))";
    let done = Command::new(&python).args(["-c", script]).arg(&file).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let told: Vec<f64> =
        String::from_utf8_lossy(&done.stdout).split_whitespace().map(|v| v.parse().unwrap()).collect();
    println!("{told:?}");
    assert!(told[2] == 0.0 && told[0].abs() > 0.05 && told[0].signum() == told[1].signum(), "{told:?}");
    assert!(told[3].abs() > 1.0, "a wheel force loads the tie rod");
}
