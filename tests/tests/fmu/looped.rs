//! The controller in the loop: an anti-lock controller on the pressures of the car's brakes, as an FMU and in Rust; in
//! lockstep and in real time; killed, hung, wrong.

use assembly::{FmuFault, FmuNode, ServiceKind, build, build_fmus, fmu_part};
use config::ResolvedBench;
use fmu::{Cost, FmuError, Stepper};
use kingpin_tests::fmu::{Abs, Misdeed, Recipe, build as build_fmu};
use kingpin_tests::support::{self, kingpin, show};
use record::LogReader;
use regions::{Payload, RegionId, VehicleState, fmu_flags, model_flags};
use runtime::lockstep::Chain;
use runtime::{Bound, Model, region_specs};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;
use supervisor::RunPlan;
use table::{Read, Table, TableInfo};

/// Full braking on a slippery road from 80 km/h: without the controller the wheels lock.
fn scenario(folder: &Path, recipe: &Recipe, edits: &[(&str, &str)]) -> PathBuf {
    build_fmu(recipe, &folder.join("abs.fmu"));
    let mut text = "extends = \"_bench\"
name = \"fmu_braking\"
description = \"Braking on a slippery road with an anti-lock controller as an FMU.\"
duration_s = 4.0
warm_up_s = 1.0
speed = { type = \"constant\", speed_km_h = 80.0 }
steer = { type = \"hold\", angle_deg = 0.0 }
pedals = [{ start_s = 0.2, rise_s = 0.1, throttle = 0.0, brake_pressure_kpa = 9000.0 }]

[road.friction]
type = \"uniform\"
scale = 0.4

[[fmu]]
name = \"abs\"
file = \"abs.fmu\"
every_ticks = 1
budget_s = 1.0
hang_s = 20.0
on_loss = \"hold\"
parameters = { radius = 0.3, fault = 0, fault_time = 1.9995 }

[fmu.inputs]
speed = \"vehicle_state.velocity_m_s.x\"
yaw_rate = \"vehicle.yaw_rate_rad_s\"
"
    .to_owned();
    for wheel in ["fl", "fr", "rl", "rr"] {
        let _ = writeln!(text, "spin_{wheel} = \"vehicle_state.wheel_speed_rad_s.{wheel}\"");
    }
    text += "\n[fmu.outputs]\n";
    for wheel in ["fl", "fr", "rl", "rr"] {
        let _ = writeln!(
            text,
            "ratio_{wheel} = {{ to = \"brake_line_pressure_pa_{wheel}\", mode = \"multiply\", min = 0.0, max = 1.0 }}"
        );
    }
    for (from, to) in edits {
        assert!(text.contains(from), "{from}");
        text = text.replace(from, to);
    }
    let file = folder.join("braking.toml");
    std::fs::write(&file, text).unwrap();
    file
}

fn misdeed(misdeed: Misdeed) -> String {
    format!("fault = {}", misdeed as i32)
}

/// The controller in Rust, in the FMU's place: units as the bench has them.
struct InRust(Abs);

impl Stepper for InRust {
    fn step(&mut self, _: f64, h: f64, inputs: &[f64], outputs: &mut [f64]) -> Result<Cost, FmuError> {
        // In the order of the names: speed, four spins, yaw rate.
        let speed = inputs[0] * (1.0 / 0.277_777_777_777_777_78);
        let yaw = inputs[5] * (1.0 / 0.017_453_292_519_943_295);
        outputs.copy_from_slice(&self.0.step(h, speed, yaw, &inputs[1..5]));
        Ok(Cost::default())
    }
}

/// States of the car, tick by tick, with the FMUs given.
fn drive(resolved: &ResolvedBench, fmus: Vec<Box<dyn Model>>) -> Vec<VehicleState> {
    let period_s = resolved.scenario.timing.period_s();
    let info = TableInfo { run_id: 1, period_ns: resolved.scenario.timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(period_s), info).unwrap();
    let bind = |model| Bound::<dyn Model>::new(model, &table, true).unwrap();
    let mut models: Vec<_> = ServiceKind::ALL.map(|kind| bind(build(kind, resolved).unwrap())).into();
    let mut order = vec![(0, 0), (1, 0), (2, 0), (0, 1)];
    for fmu in fmus {
        order.push((models.len(), 0));
        models.push(bind(fmu));
    }
    let mut chain = Chain::new(models, order);
    let mut bench = table.claim_writer(RegionId::Bench as usize).unwrap();
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).unwrap();
    let plan = RunPlan::new(resolved.scenario.ticks(), period_s, resolved.rig.limits.stop_fade_s);
    let schedule = params::Schedule::new(resolved).unwrap();
    let reader = table.reader(RegionId::VehicleState as usize).clone();
    let mut states = Vec::new();
    for n in 0..resolved.scenario.ticks() {
        bench.write(n, plan.at(n).words()).unwrap();
        parameters.write(n, supervisor::parameters_at(&schedule, n).words()).unwrap();
        chain.tick(n).unwrap();
        let mut state = VehicleState::absent();
        assert_eq!(reader.read(n, state.words_mut()), Read::Ready);
        states.push(state);
    }
    states
}

fn load(file: &Path, overrides: &[&str]) -> ResolvedBench {
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    ResolvedBench::load(file.to_str().unwrap(), &overrides).unwrap_or_else(|problems| panic!("{problems}"))
}

/// Largest wheel slip while braking faster than 20 km/h.
fn slip_max(states: &[VehicleState]) -> f64 {
    let fast = states.iter().filter(|s| s.velocity_m_s[0] > 6.0);
    fast.flat_map(|s| s.slip_ratio).fold(0.0, |max, slip| f64::max(max, -slip))
}

#[test]
fn an_fmu_in_the_loop_does_exactly_what_the_same_controller_in_rust_does() {
    let mut locked = None;
    for fmi in [2, 3] {
        let folder = tempfile::tempdir().unwrap();
        let resolved = load(&scenario(folder.path(), &Recipe::sound(fmi), &[]), &[]);
        let (fmus, faults, _folders) = build_fmus(&resolved, &kingpin()).unwrap();
        let by_fmu = drive(&resolved, fmus);
        assert_eq!(faults[0].told(), None);
        let (_, part) = fmu_part(&resolved, 0, Path::new(""), false).unwrap();
        let node = FmuNode::new(part, Box::new(InRust(Abs::default())), FmuFault::default());
        let by_rust = drive(&resolved, vec![Box::new(node)]);
        let mut largest = 0.0_f64;
        for (a, b) in by_fmu.iter().zip(&by_rust) {
            assert_eq!(a.used_fmu, b.used_fmu);
            let all = a.wheel_speed_rad_s.iter().zip(&b.wheel_speed_rad_s);
            let all = all.chain(a.velocity_m_s.iter().zip(&b.velocity_m_s));
            let all = all.chain(a.brake_torque_n_m.iter().zip(&b.brake_torque_n_m));
            for (x, y) in all.chain(a.position_m.iter().zip(&b.position_m)) {
                largest = largest.max((x - y).abs() / x.abs().max(1.0));
            }
        }
        println!("FMI {fmi}: largest relative difference over {} ticks: {largest:e}", by_fmu.len());
        assert!(largest <= 1e-12, "FMI {fmi}: {largest:e}");
        // It is in the loop: without it the wheels lock.
        let without = *locked.get_or_insert_with(|| {
            let bare = ResolvedBench { fmus: Vec::new(), ..resolved.clone() };
            let scenario = config::scenario::Scenario { fmu: None, ..bare.scenario.clone() };
            slip_max(&drive(&ResolvedBench { scenario, ..bare }, Vec::new()))
        });
        let with = slip_max(&by_fmu);
        println!("largest slip while braking: {with:.3} with the controller, {without:.3} without");
        // Before the pressure has fallen a wheel comes to three quarters; locked it never is.
        assert!(with < 0.8 && without > 0.95, "{with} {without}");
    }
}

fn run(file: &Path, out: &Path, more: &[&str]) -> Output {
    Command::new(kingpin())
        .args(["run", file.to_str().unwrap(), "--no-report", "--json", "--out"])
        .arg(out)
        .args(more)
        .output()
        .unwrap()
}

fn words(output: &Output) -> String {
    // With --json what is wrong with the input is on standard output.
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

#[test]
fn lockstep_in_one_process_and_as_the_set_give_the_same_log() {
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), &Recipe::sound(3), &[("duration_s = 4.0", "duration_s = 2.0")]);
    let (one, set) = (folder.path().join("one"), folder.path().join("set"));
    let told = run(&file, &one, &["--lockstep"]);
    assert_eq!(told.status.code(), Some(0), "{}", words(&told));
    let name = format!("fmu-set-{}", std::process::id());
    let told = run(&file, &set, &["--lockstep=set", "--name", &name]);
    assert_eq!(told.status.code(), Some(0), "{}", words(&told));
    let compared = Command::new(kingpin()).arg("compare").arg(&one).arg(&set).output().unwrap();
    assert_eq!(
        compared.status.code(),
        Some(0),
        "{}{}",
        words(&compared),
        String::from_utf8_lossy(&compared.stdout)
    );
    let log = LogReader::open(&one).unwrap();
    let ratio = log.column("fmu_0", "output.0").unwrap();
    assert!(ratio.iter().any(|&ratio| ratio < 0.9), "it never acted");
    assert!(log.column("fmu_0", "output.4").unwrap().iter().all(|value| value.is_nan()));
}

#[test]
fn what_is_wrong_with_an_fmu_is_told_before_anything_starts() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let sound = Recipe::sound(2);
    let told = |recipe: &Recipe, edits: &[(&str, &str)], mode: &[&str]| {
        let file = scenario(folder.path(), recipe, edits);
        let output = run(&file, &out, mode);
        assert!(output.status.code().is_some_and(|code| code == 2 || code == 3), "{output:?}");
        words(&output)
    };
    for mode in [&["--lockstep"][..], &["--name", "fmu-never"]] {
        let text = told(&sound, &[("spin_fl =", "spin_vl =")], mode);
        assert!(text.contains("spin_vl: no such variable; did you mean spin_"), "{text}");
        assert!(text.contains("braking.toml:"), "{text}");
        let text =
            told(&sound, &[("vehicle_state.wheel_speed_rad_s.rr", "vehicle_state.brake_pressure_pa")], mode);
        assert!(text.contains("spin_rr: unit rad/s and Pa are not of one quantity"), "{text}");
        let text = told(&Recipe { platform: Some("win64"), ..sound.clone() }, &[], mode);
        assert!(text.contains("needs binaries/linux64, has win64"), "{text}");
    }
    let text = told(&Recipe { compiler: &["-DWITHOUT_STEP"], ..sound.clone() }, &[], &["--lockstep"]);
    assert!(text.contains("lacks functions that FMI demands: fmi2DoStep"), "{text}");
    let text = told(&sound, &[("brake_line_pressure_pa_fl", "brake_line_pressure")], &["--lockstep"]);
    assert!(text.contains("no variable that can be imported"), "{text}");
    let text = told(&sound, &[("vehicle.yaw_rate_rad_s", "vehicle.yaw_rate")], &["--lockstep"]);
    assert!(text.contains("no export of the car"), "{text}");
    let text = told(&sound, &[("fault = 0", "fault = 0, nothing = 3")], &["--lockstep"]);
    assert!(text.contains("nothing: no such variable"), "{text}");
}

#[test]
fn in_lockstep_a_bad_fmu_is_a_flagged_fault_and_the_bench_survives() {
    let folder = tempfile::tempdir().unwrap();
    let flags_of = |wrong: Misdeed, edits: &[(&str, &str)]| {
        let fault = misdeed(wrong);
        let mut all = vec![("fault = 0", fault.as_str()), ("duration_s = 4.0", "duration_s = 3.0")];
        all.extend(edits);
        let file = scenario(folder.path(), &Recipe::sound(3), &all);
        let out = folder.path().join(format!("{wrong:?}{}", edits.len()));
        let output = run(&file, &out, &["--lockstep"]);
        let log =
            LogReader::open(&out).unwrap_or_else(|error| panic!("{wrong:?}: {error}: {}", words(&output)));
        assert!(log.intact());
        let column = |region, name| log.column_u64(region, name).unwrap();
        let states = column("rig_status", "state");
        (output, column("fmu_0", "flags"), column("vehicle_state", "flags"), states)
    };
    // Five ticks of NaN: held, flagged, counted; the run is as planned.
    let (output, fmu, car, states) = flags_of(Misdeed::NotANumber, &[]);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert_eq!(fmu.iter().filter(|&&flags| flags & fmu_flags::REFUSED_OUTPUT != 0).count(), 5);
    assert!(car.iter().filter(|&&flags| flags & model_flags::REFUSED_INPUT != 0).count() >= 5);
    assert!(!states.contains(&8));
    // A crash takes only its process: the rig holds, then trips; the log is whole.
    let (output, fmu, car, states) = flags_of(Misdeed::Crash, &[]);
    assert_eq!(output.status.code(), Some(1), "{}", words(&output));
    assert!(
        words(&output).contains("FMU abs at tick 1999: its process died: signal 11"),
        "{}",
        words(&output)
    );
    assert!(fmu[2100] & fmu_flags::FAILED != 0 && car[2100] & model_flags::FMU_LOST != 0);
    assert!(states.contains(&5), "the rig held");
    // The same, but the car is to go on without it: it does, flagged.
    let (output, fmu, car, states) =
        flags_of(Misdeed::Error, &[("on_loss = \"hold\"", "on_loss = \"release\"")]);
    assert_eq!(output.status.code(), Some(1), "{}", words(&output));
    assert!(
        words(&output).contains("fmi3DoStep returned error; it said: told to fail"),
        "{}",
        words(&output)
    );
    assert!(fmu[2100] & fmu_flags::FAILED != 0 && car[2100] & model_flags::FMU_LOST != 0);
    assert!(car[2100] & model_flags::STALE == 0 && !states.contains(&5), "the rig went on");
    // Two seconds in a step: lockstep waits.
    let (output, fmu, ..) = flags_of(Misdeed::SleepTwoSeconds, &[("hang_s = 20.0", "hang_s = 15.0")]);
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(fmu.iter().all(|flags| flags & !fmu_flags::HELD_INPUT == 0));
    // For ever: an end is put to it.
    let (output, ..) = flags_of(Misdeed::Loop, &[("hang_s = 20.0", "hang_s = 1.0")]);
    assert_eq!(output.status.code(), Some(1), "{}", words(&output));
    assert!(words(&output).contains("did not come back"), "{}", words(&output));
}

/// Real-time runs one after the other: together they would stall each other.
static ALONE: Mutex<()> = Mutex::new(());

fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Long limits of the rig: a slow machine must not trip it.
const PATIENT: [&str; 8] = [
    "--set",
    "rig.limits.stall_ticks=5000",
    "--set",
    "rig.limits.holding_max_s=30",
    "--set",
    "realtime.lock_memory=false",
    "--set",
    "speed.speed_km_h=60",
];

fn paced(file: &Path, out: &Path, name: &str) -> std::process::Child {
    Command::new(kingpin())
        .args(["run", file.to_str().unwrap(), "--no-report", "--json", "--name", name, "--out"])
        .arg(out)
        .args(PATIENT)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn until<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    support::until(what, Duration::from_secs(60), look)
}

#[test]
fn in_real_time_a_killed_fmu_holds_the_bench_and_comes_back() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), &Recipe::sound(2), &[("duration_s = 4.0", "duration_s = 9.0")]);
    let (out, name) = (folder.path().join("out"), format!("fmu-kill-{}", std::process::id()));
    let child = paced(&file, &out, &name);
    until("running", || (show(&name, "rig_status")?["content"]["state"].as_u64()? == 4).then_some(()));
    let writer = |region: &str| show(&name, region)?["header"]["writer_pid"].as_u64();
    let killed = until("the FMU", || writer("fmu_0"));
    kill_process(Pid::from_raw(i32::try_from(killed).unwrap()).unwrap(), Signal::KILL).unwrap();
    until("the restart", || writer("fmu_0").filter(|&pid| pid != killed));
    until("running again", || (show(&name, "rig_status")?["content"]["state"].as_u64()? == 4).then_some(()));
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(words(&output).contains("fmu_0"), "the death is told: {}", words(&output));
    let log = LogReader::open(&out).unwrap();
    let flags = log.column_u64("vehicle_state", "flags").unwrap();
    assert!(flags.iter().any(|f| f & model_flags::FMU_LOST != 0), "the loss is flagged");
    let states = log.column_u64("rig_status", "state").unwrap();
    assert!(states.contains(&5), "the rig held");
    assert!(!states.contains(&8), "and did not trip");
    let steps = log.column_u64("fmu_0", "step_count").unwrap();
    assert!(steps.windows(2).any(|w| w[1] < w[0]), "a new instance counts from the beginning");
    let seconds = log.column("fmu_0", "compute_s").unwrap();
    let finite: Vec<_> = seconds.iter().filter(|s| s.is_finite()).collect();
    assert!(finite.len() > 1000, "a step's cost is logged");
}

#[test]
fn a_supervisor_that_takes_over_looks_after_the_fmu_too() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let file = scenario(folder.path(), &Recipe::sound(2), &[("duration_s = 4.0", "duration_s = 15.0")]);
    let (out, name) = (folder.path().join("out"), format!("fmu-attach-{}", std::process::id()));
    let mut first = paced(&file, &out, &name);
    let running = || (show(&name, "rig_status")?["content"]["state"].as_u64()? == 4).then_some(());
    let writer = |region: &str| show(&name, region)?["header"]["writer_pid"].as_u64();
    until("running", running);
    first.kill().unwrap();
    first.wait().unwrap();
    let next = Command::new(kingpin())
        .args(["attach", &name, "--json", "--no-report", "--rearm"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    until("the new supervisor", || writer("bench").filter(|&pid| pid == u64::from(next.id())));
    let killed = until("the FMU", || writer("fmu_0"));
    kill_process(Pid::from_raw(i32::try_from(killed).unwrap()).unwrap(), Signal::KILL).unwrap();
    until("the restart", || writer("fmu_0").filter(|&pid| pid != killed));
    until("running again", running);
    let output = next.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    assert!(words(&output).contains("service fmu_0 died"), "the death is told: {}", words(&output));
    let states = LogReader::open(&out).unwrap().column_u64("rig_status", "state").unwrap();
    assert!(states.contains(&5) && !states.contains(&8), "the rig held and did not trip");
}

#[test]
fn in_real_time_a_step_of_two_seconds_is_ended_and_the_bench_comes_back() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let fault = misdeed(Misdeed::SleepTwoSeconds);
    let edits = [
        ("duration_s = 4.0", "duration_s = 8.0"),
        ("hang_s = 20.0", "hang_s = 0.4"),
        ("fault = 0", fault.as_str()),
        ("fault_time = 1.9995", "fault_time = 2.5"),
    ];
    let file = scenario(folder.path(), &Recipe::sound(3), &edits);
    let (out, name) = (folder.path().join("out"), format!("fmu-hang-{}", std::process::id()));
    let output = paced(&file, &out, &name).wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", words(&output));
    let said = std::fs::read_to_string(out.join("services.txt")).unwrap_or_default();
    assert!(said.contains("a step did not come back"), "{said}");
    let log = LogReader::open(&out).unwrap();
    let flags = log.column_u64("vehicle_state", "flags").unwrap();
    assert!(flags.iter().any(|f| f & model_flags::FMU_LOST != 0), "the loss is flagged");
    let states = log.column_u64("rig_status", "state").unwrap();
    let held = states.iter().position(|&state| state == 5).expect("the rig held");
    assert!(states[held..].contains(&4), "and ran again");
}

#[test]
fn in_real_time_a_step_over_the_budget_is_not_used() {
    let _alone = alone();
    let folder = tempfile::tempdir().unwrap();
    let fault = misdeed(Misdeed::FourMilliseconds);
    let edits = [("budget_s = 1.0", "budget_s = 0.0035"), ("fault = 0", fault.as_str())];
    let file = scenario(folder.path(), &Recipe::sound(3), &edits);
    let (out, name) = (folder.path().join("out"), format!("fmu-late-{}", std::process::id()));
    let output = paced(&file, &out, &name).wait_with_output().unwrap();
    assert!(output.status.code().is_some_and(|code| code < 2), "{}", words(&output));
    let log = LogReader::open(&out).unwrap();
    let flags = log.column_u64("fmu_0", "flags").unwrap();
    let outputs = log.column("fmu_0", "output.0").unwrap();
    let late: Vec<_> = (1..flags.len()).filter(|&i| flags[i] & fmu_flags::OVER_BUDGET != 0).collect();
    assert!(!late.is_empty(), "steps of 4 ms against 3.5 ms");
    assert!(late.iter().all(|&i| outputs[i].to_bits() == outputs[i - 1].to_bits()), "its outputs are held");
    assert_eq!(*log.column_u64("fmu_0", "over_budget_count").unwrap().last().unwrap(), late.len() as u64);
}

#[test]
fn check_tells_variables_and_cost_and_refuses_bad_ones() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("abs.fmu");
    let check = |more: &[&str]| {
        Command::new(kingpin()).args(["fmu", "check", "--json"]).arg(&file).args(more).output().unwrap()
    };
    for fmi in [2, 3] {
        build_fmu(&Recipe::sound(fmi), &file);
        let output = check(&["--steps", "5000", "--budget-ms", "1000", "--set", "speed=90"]);
        assert_eq!(output.status.code(), Some(0), "{}", words(&output));
        let told: Value = serde_json::from_slice(&output.stdout).unwrap();
        println!("FMI {fmi}: {} us, heap calls a step {}", told["step_us"], told["allocations_per_step"]);
        assert_eq!(told["allocations_per_step"], 0.0);
        assert_eq!(told["variables"].as_array().unwrap().len(), if fmi == 2 { 23 } else { 24 });
        assert_eq!(told["variables"][0]["unit"], "km/h");
    }
    // The count can say something else than 0: the same with a malloc in each step.
    build_fmu(&Recipe { compiler: &["-DALLOCATE"], ..Recipe::sound(2) }, &file);
    let told: Value =
        serde_json::from_slice(&check(&["--steps", "1000", "--budget-ms", "1000"]).stdout).unwrap();
    assert_eq!(told["allocations_per_step"], 1.0, "{told}");
    for (recipe, wanted) in [
        (Recipe { platform: Some("darwin64"), ..Recipe::sound(2) }, "has darwin64"),
        (Recipe { compiler: &["-DWITHOUT_STEP"], ..Recipe::sound(2) }, "fmi2DoStep"),
    ] {
        build_fmu(&recipe, &file);
        let output = check(&[]);
        assert_eq!(output.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&output.stdout).contains(wanted), "{output:?}");
    }
    build_fmu(&Recipe::sound(3), &file);
    for (fault, wanted) in
        [(Misdeed::Crash, "signal 11"), (Misdeed::Exit, "exit status 7"), (Misdeed::Loop, "did not")]
    {
        let fault = misdeed(fault).replace(' ', "");
        let output = check(&["--set", &fault, "--patience-s", "2"]);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert!(String::from_utf8_lossy(&output.stdout).contains(wanted), "{output:?}");
    }
}
