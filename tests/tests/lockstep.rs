//! Lockstep: a run depends on nothing but its configuration. One process and the process set, twice each,
//! bit-identical; the tick path of the whole bench does not allocate; a checkpoint continues bit-exactly.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assembly::{ServiceKind, build};
use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use config::ResolvedBench;
use kingpin_tests::support::kingpin;
use record::LogReader;
use regions::{Payload, RegionId, SuspensionState, VehicleState, model_flags};
use runtime::lockstep::Chain;
use runtime::{Bound, Model, region_specs};
use std::path::Path;
use std::process::Command;
use supervisor::RunPlan;
use table::{Read, RegionWriter, Table, TableInfo};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

fn resolved(scenario: &str, overrides: &[&str]) -> ResolvedBench {
    let overrides: Vec<String> = overrides.iter().map(|&o| o.to_owned()).collect();
    ResolvedBench::load(scenario, &overrides).unwrap_or_else(|problems| panic!("{problems}"))
}

struct Bench {
    table: Table,
    chain: Chain,
    bench: RegionWriter,
    parameters: RegionWriter,
    plan: RunPlan,
    schedule: params::Schedule,
}

fn bench(resolved: &ResolvedBench) -> Bench {
    let period_s = resolved.scenario.timing.period_s();
    let info = TableInfo { run_id: 1, period_ns: resolved.scenario.timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(period_s), info).unwrap();
    let bind = |kind| Bound::<dyn Model>::new(build(kind, resolved).unwrap(), &table, true).unwrap();
    let models = ServiceKind::ALL.map(bind).into_iter().collect();
    let chain = Chain::new(models, vec![(0, 0), (1, 0), (2, 0), (0, 1)]);
    let bench = table.claim_writer(RegionId::Bench as usize).unwrap();
    let plan = RunPlan::new(resolved.scenario.ticks(), period_s, resolved.rig.limits.stop_fade_s);
    let parameters = table.claim_writer(RegionId::Parameters as usize).unwrap();
    let schedule = params::Schedule::new(resolved).unwrap();
    Bench { table, chain, bench, parameters, plan, schedule }
}

impl Bench {
    fn tick(&mut self, n: u64) {
        self.bench.write(n, self.plan.at(n).words()).unwrap();
        self.parameters.write(n, supervisor::parameters_at(&self.schedule, n).words()).unwrap();
        self.chain.tick(n).unwrap();
    }
}

#[test]
fn the_tick_of_the_whole_bench_does_not_allocate() {
    // A change of parameters on the way: taking it over must not allocate either.
    let change = r#"parameters=[{type="set", at_s=-1.0, path="control.force.bandwidth_rad_s", value=110},
        {type="set", at_s=-1.0, path="unit.rack_friction_n", value=120}]"#;
    let mut bench = bench(&resolved("growing_slalom_80", &["duration_s=6.0", change]));
    for n in 0..1500 {
        bench.tick(n);
    }
    let before = violation_count();
    assert_no_alloc(|| {
        for n in 1500..4500 {
            bench.tick(n);
        }
    });
    assert_eq!(violation_count(), before);
    assert_no_alloc(|| drop(std::hint::black_box(vec![1u8])));
    assert!(violation_count() > before, "the check must be able to fail");
}

/// Kills and restarts vehicle and multibody in the middle: from their checkpoints the run goes on as if nothing
/// had been.
#[test]
fn a_restart_from_the_checkpoints_continues_bit_exactly() {
    let resolved = resolved("slalom_120", &["duration_s=6.0"]);
    let (mut whole, mut broken) = (bench(&resolved), bench(&resolved));
    for n in 0..4200 {
        whole.tick(n);
        broken.tick(n);
    }
    // The rig stays; its table and bench region too.
    let Bench { table, chain, bench: bench_writer, parameters, plan, schedule } = broken;
    let mut models = chain.into_models();
    drop(models.split_off(1));
    for kind in [ServiceKind::Vehicle, ServiceKind::Multibody] {
        let mut bound = Bound::<dyn Model>::new(build(kind, &resolved).unwrap(), &table, true).unwrap();
        assert_eq!(bound.restore(&table), Some(4199));
        models.push(bound);
    }
    let chain = Chain::new(models, vec![(0, 0), (1, 0), (2, 0), (0, 1)]);
    let mut broken = Bench { table, chain, bench: bench_writer, parameters, plan, schedule };
    for n in 4200..5500 {
        whole.tick(n);
        broken.tick(n);
        for region in
            [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus]
        {
            let words = |bench: &Bench| {
                let reader = bench.table.reader(region as usize);
                let mut words = vec![0; reader.words()];
                assert_eq!(reader.read(n, &mut words), Read::Ready);
                if n == 4200 && matches!(region, RegionId::VehicleState | RegionId::SuspensionState) {
                    words[2] = 0; // flags: the restored ones say so, once
                }
                words
            };
            assert!(words(&whole) == words(&broken), "{} at tick {n}", region.region().name);
        }
    }
}

#[test]
fn the_loop_is_closed_and_the_car_answers_the_hand_wheel() {
    let resolved = resolved("step_100", &["duration_s=9.0"]);
    let mut bench = bench(&resolved);
    for n in 0..8900 {
        bench.tick(n);
    }
    let mut state = VehicleState::absent();
    bench.table.reader(RegionId::VehicleState as usize).latest(8900, state.words_mut()).unwrap();
    let yaw_rate = state.angular_velocity_rad_s[2];
    assert!(yaw_rate > 0.02, "a step to the left turns the car to the left: {yaw_rate}");
    let steady = state.velocity_m_s[0] * yaw_rate;
    let lateral = state.acceleration_m_s2[1];
    assert!((lateral - steady).abs() < 0.1 * steady.abs() + 0.1, "a_y {lateral} against v·r {steady}");
    assert!(state.roll_rad > 0.0, "the body leans out of the turn");
    let fz: f64 = (0..4).map(|w| state.tyre_force_n[3 * w + 2]).sum();
    assert!(state.tyre_force_n[5] > state.tyre_force_n[2], "the outer front wheel carries more");
    let mass = resolved.car.body.sprung_mass_kg
        + 2.0 * (resolved.car.front.unsprung_mass_kg + resolved.car.rear.unsprung_mass_kg);
    assert!((fz - mass * 9.81).abs() < 0.05 * mass * 9.81, "wheel loads {fz} N carry {mass} kg");
}

fn run(arguments: &[&str], out: &Path) {
    let done = Command::new(kingpin())
        .args(["run", "growing_slalom_80", "--duration", "5", "--no-report"])
        .args(arguments)
        .arg("--out")
        .arg(out)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
}

#[test]
fn one_process_and_the_process_set_twice_each_leave_four_equal_logs() {
    let folder = tempfile::tempdir().unwrap();
    let runs = [
        ("a", "--lockstep=process", "lock-a"),
        ("b", "--lockstep=process", "lock-b"),
        ("c", "--lockstep=set", "lock-c"),
        ("d", "--lockstep=set", "lock-d"),
    ];
    for (out, lockstep, name) in runs {
        run(&[lockstep, "--name", name], &folder.path().join(out));
    }
    let logs: Vec<_> =
        runs.iter().map(|(out, ..)| LogReader::open(&folder.path().join(out)).unwrap()).collect();
    for (log, (out, ..)) in logs.iter().zip(&runs) {
        assert!(log.intact(), "{out}");
        let differences = record::compare(&logs[0], log);
        assert!(differences.is_empty(), "{out}: {}", differences[0]);
    }
    // Another seed is another run: the comparison can fail.
    run(&["--lockstep", "--set", "seed=2"], &folder.path().join("e"));
    let other = LogReader::open(&folder.path().join("e")).unwrap();
    assert!(!record::compare(&logs[0], &other).is_empty());
}

/// Killed between publishing a tick and saving its checkpoint: the successor steps that tick again, is refused, and says
/// with the next one that it was restored.
#[test]
fn a_restart_is_told_also_when_the_dead_writer_had_published_the_next_tick() {
    let resolved = resolved("slalom_120", &[]);
    let info = TableInfo { run_id: 1, period_ns: 1_000_000, t0_ns: 1 };
    let table = Table::create_local(&region_specs(1e-3), info).unwrap();
    let model = || build(ServiceKind::Multibody, &resolved).unwrap();
    let bind = || Bound::<dyn Model>::new(model(), &table, false).unwrap();
    let region = RegionId::SuspensionState as usize;
    let flags = |tick: u64| {
        let mut state = SuspensionState::absent();
        assert_eq!(table.reader(region).read(tick, state.words_mut()), Read::Ready);
        state.flags
    };
    let mut first = bind();
    (0..=10).for_each(|n| first.tick(0, n, false).unwrap());
    drop(first);
    let mut dead = table.claim_writer(region).unwrap();
    dead.write(11, SuspensionState::absent().words()).unwrap();
    drop(dead);
    let mut second = bind();
    assert_eq!(second.restore(&table), Some(10));
    (11..=13).for_each(|n| second.tick(0, n, true).unwrap());
    assert_eq!(second.refused(), 1);
    let restored = [11, 12, 13].map(|tick| flags(tick) & model_flags::RESTORED != 0);
    assert_eq!(restored, [false, true, false]);
}
