//! Lockstep and paced drivers over toy models: same results however the nodes are scheduled, catching up
//! steps every tick, and the tick path does not allocate.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use assert_no_alloc::{AllocDisabler, assert_no_alloc, violation_count};
use regions::{Payload, RegionId, RigMeasurement, RigStatus, SuspensionState, VehicleState};
use runtime::clock::{self, Grid, SECOND};
use runtime::lockstep::{Chain, Patience};
use runtime::{Bound, InputSpec, Inputs, Model, NodeSpec, Step, When, lockstep, paced, region_specs};
use table::{Read, Table, TableInfo};

#[global_allocator]
static ALLOCATOR: AllocDisabler = AllocDisabler;

const PERIOD: u64 = 1_000_000;

/// A rig whose rack follows the force of the tick before; the loop is a little recurrence.
struct Rig {
    rack: f64,
    skipped: u64,
}
const READS_OUTPUT: &[InputSpec] = &[InputSpec { region: RegionId::SuspensionState, when: When::SameTick }];
const RIG: &[NodeSpec] = &[
    NodeSpec { name: "sample", reads: &[], writes: RegionId::RigMeasurement, checkpoint: None, rings: true },
    NodeSpec {
        name: "apply",
        reads: READS_OUTPUT,
        writes: RegionId::RigStatus,
        checkpoint: None,
        rings: false,
    },
];
impl Model for Rig {
    fn nodes(&self) -> &'static [NodeSpec] {
        RIG
    }
    fn step(&mut self, node: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        if node == 0 {
            self.skipped += step.skipped;
            let mut m = RigMeasurement::absent();
            m.tick = step.n;
            m.rack_displacement_m = self.rack;
            output.copy_from_slice(m.words());
        } else {
            let (s, input) = inputs.get::<SuspensionState>(0);
            self.rack = 0.9 * self.rack + 0.1 * (s.tie_rod_force_n[0] + (step.n as f64 * 0.01).sin());
            let mut r = RigStatus::absent();
            r.tick = step.n;
            r.used_suspension_state = input.tick();
            r.true_rack_displacement_m = self.rack;
            output.copy_from_slice(r.words());
        }
    }
}

/// A vehicle that integrates the rack: what it holds depends on every tick having been stepped once.
struct Vehicle {
    sum: f64,
    steps: u64,
}
const READS_RIG: &[InputSpec] = &[InputSpec { region: RegionId::RigMeasurement, when: When::SameTick }];
const VEHICLE: &[NodeSpec] = &[NodeSpec {
    name: "vehicle",
    reads: READS_RIG,
    writes: RegionId::VehicleState,
    checkpoint: Some(RegionId::VehicleCheckpoint),
    rings: true,
}];
impl Model for Vehicle {
    fn nodes(&self) -> &'static [NodeSpec] {
        VEHICLE
    }
    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (m, input) = inputs.get::<RigMeasurement>(0);
        self.sum += 1e-3 * m.rack_displacement_m + 1e-6;
        self.steps += 1;
        let mut v = VehicleState::absent();
        v.tick = step.n;
        v.used_rig_measurement = input.tick();
        v.yaw_rad = self.sum;
        v.held_count = u64::from(!input.fresh());
        output.copy_from_slice(v.words());
    }
    fn save(&self, n: u64, words: &mut [u64]) {
        (words[0], words[1], words[2]) = (n, self.sum.to_bits(), self.steps);
    }
    fn restore(&mut self, words: &[u64]) -> bool {
        (self.sum, self.steps) = (f64::from_bits(words[1]), words[2]);
        true
    }
}

struct Multibody;
const READS_BOTH: &[InputSpec] = &[
    InputSpec { region: RegionId::RigMeasurement, when: When::SameTick },
    InputSpec { region: RegionId::VehicleState, when: When::SameTick },
];
const MULTIBODY: &[NodeSpec] = &[NodeSpec {
    name: "multibody",
    reads: READS_BOTH,
    writes: RegionId::SuspensionState,
    checkpoint: None,
    rings: true,
}];
impl Model for Multibody {
    fn nodes(&self) -> &'static [NodeSpec] {
        MULTIBODY
    }
    fn step(&mut self, _: usize, step: &Step, inputs: &Inputs, output: &mut [u64]) {
        let (m, _) = inputs.get::<RigMeasurement>(0);
        let (v, input) = inputs.get::<VehicleState>(1);
        let mut s = SuspensionState::absent();
        s.tick = step.n;
        s.used_vehicle_state = input.tick();
        s.tie_rod_force_n = [-m.rack_displacement_m - v.yaw_rad; 2];
        output.copy_from_slice(s.words());
    }
}

fn local() -> Table {
    Table::create_local(&region_specs(1e-3), TableInfo { run_id: 1, period_ns: PERIOD, t0_ns: 0 }).unwrap()
}

fn chain(table: &Table) -> Chain {
    let bind = |model: Box<dyn Model>| Bound::new(model, table, true).unwrap();
    let models = vec![
        bind(Box::new(Rig { rack: 0.0, skipped: 0 })),
        bind(Box::new(Vehicle { sum: 0.0, steps: 0 })),
        bind(Box::new(Multibody)),
    ];
    Chain::new(models, vec![(0, 0), (1, 0), (2, 0), (0, 1)])
}

fn history(table: &Table, ticks: u64) -> Vec<Vec<u64>> {
    let regions =
        [RegionId::RigMeasurement, RegionId::VehicleState, RegionId::SuspensionState, RegionId::RigStatus];
    regions
        .iter()
        .flat_map(|&region| {
            let reader = table.reader(region as usize).clone();
            (0..ticks).map(move |n| {
                let mut words = vec![0; reader.words()];
                assert_eq!(reader.read(n, &mut words), Read::Ready, "{} {n}", region.region().name);
                words
            })
        })
        .collect()
}

#[test]
fn one_thread_and_three_threads_agree_to_the_bit() {
    const TICKS: u64 = 2000;
    let table = local();
    let mut one = chain(&table);
    for n in 0..TICKS {
        one.tick(n).unwrap();
    }
    let expected = history(&table, TICKS);

    let table = local();
    let patience = Patience { spin_ns: 0, limit_ns: 10 * SECOND };
    std::thread::scope(|scope| {
        let models: [Box<dyn Model>; 3] = [
            Box::new(Multibody),
            Box::new(Vehicle { sum: 0.0, steps: 0 }),
            Box::new(Rig { rack: 0.0, skipped: 0 }),
        ];
        for model in models {
            let mut bound = Bound::new(model, &table, true).unwrap();
            scope.spawn(move || lockstep::follow(&mut bound, 0, patience, |n| n == TICKS).unwrap());
        }
    });
    assert!(history(&table, TICKS) == expected);
}

#[test]
fn a_lockstep_node_stepped_before_its_input_is_refused_and_names_it() {
    let table = local();
    let mut vehicle: Bound<dyn Model> =
        Bound::new(Box::new(Vehicle { sum: 0.0, steps: 0 }) as Box<dyn Model>, &table, true).unwrap();
    let text = vehicle.tick(0, 0, false).unwrap_err().to_string();
    assert!(text.contains("rig_measurement") && text.contains("vehicle"), "{text}");
    let patience = Patience { spin_ns: 0, limit_ns: SECOND / 20 };
    let text = lockstep::follow(&mut vehicle, 0, patience, |_| false).unwrap_err().to_string();
    assert!(text.contains("service rig is dead or stuck"), "{text}");
}

#[test]
fn the_tick_path_does_not_allocate() {
    let table = local();
    let mut chain = chain(&table);
    chain.tick(0).unwrap();
    let before = violation_count();
    assert_no_alloc(|| {
        for n in 1..500 {
            let _ = chain.tick(n);
        }
    });
    assert_eq!(violation_count(), before);
    assert_no_alloc(|| drop(std::hint::black_box(vec![1u8])));
    assert!(violation_count() > before, "the check must be able to fail");
}

/// A follower that starts late, or restarts from its checkpoint, ends with the state it would have had.
#[test]
fn catching_up_steps_every_tick_once() {
    const TICKS: u64 = 150;
    let run = |start_after: u64, restart_at: Option<u64>| {
        let table = local();
        let grid = Grid { t0: clock::now() + SECOND / 100, period: PERIOD };
        std::thread::scope(|scope| {
            let table = &table;
            let mut rig: Bound<dyn Model> =
                Bound::new(Box::new(Rig { rack: 0.5, skipped: 0 }) as Box<dyn Model>, table, false).unwrap();
            scope.spawn(move || {
                let plan = paced::LeadPlan { output_phase: 0.5, spin_ns: 0 };
                paced::lead(&mut rig, table, RegionId::RigTiming, grid, 0, plan, |n| n >= TICKS).unwrap();
            });
            let plan = paced::FollowPlan {
                latest_start: 0.25,
                done_by: 0.25,
                spin_lead_ns: 0,
                spin_tail_ns: 0,
                due: 0.0,
                used_at: 0.5,
                catch_up_max: 200,
            };
            let follow = |first: u64, end: u64| {
                let model: Box<dyn Model> = Box::new(Vehicle { sum: 0.0, steps: 0 });
                let mut bound = Bound::new(model, table, false).unwrap();
                let first = bound.restore(table).map_or(first, |n| n + 1);
                paced::follow(&mut bound, table, RegionId::VehicleTiming, grid, first, plan, |n| n >= end)
                    .unwrap();
            };
            clock::sleep_until(grid.at(start_after, 0.0), 0);
            if let Some(n) = restart_at {
                follow(0, n);
                clock::sleep_until(grid.at(n + 30, 0.0), 0);
            }
            follow(0, TICKS);
        });
        let mut words = vec![0; table.reader(RegionId::VehicleCheckpoint as usize).words()];
        let latest = table.reader(RegionId::VehicleCheckpoint as usize).latest(TICKS, &mut words).unwrap();
        let mut timing = regions::Timing::absent();
        table.reader(RegionId::VehicleTiming as usize).latest(TICKS, timing.words_mut()).unwrap();
        (latest.tick, words[2], timing)
    };
    let (tick, steps, _) = run(0, None);
    assert_eq!((tick, steps), (TICKS - 1, TICKS));
    let (tick, steps, timing) = run(60, None);
    assert_eq!((tick, steps), (TICKS - 1, TICKS));
    assert!(timing.caught_up_count >= 60);
    let (tick, steps, timing) = run(0, Some(50));
    assert_eq!((tick, steps), (TICKS - 1, TICKS), "the restarted one goes on from its checkpoint");
    assert!(timing.caught_up_count >= 29 && timing.epoch == 2, "{timing:?}");
}

#[test]
fn a_stalled_rig_never_publishes_the_past() {
    let table = local();
    let grid = Grid { t0: clock::now(), period: PERIOD };
    let model: Box<dyn Model> = Box::new(Rig { rack: 0.0, skipped: 0 });
    let mut rig = Bound::new(model, &table, false).unwrap();
    clock::sleep_until(grid.at(40, 0.0), 0);
    let plan = paced::LeadPlan { output_phase: 0.5, spin_ns: 0 };
    paced::lead(&mut rig, &table, RegionId::RigTiming, grid, 0, plan, |n| n >= 60).unwrap();
    let reader = table.reader(RegionId::RigMeasurement as usize);
    let mut words = vec![0; reader.words()];
    assert_eq!(reader.read(39, &mut words), Read::Missing);
    assert_eq!(reader.head(), 60);
}
