//! One suspension tick (pose, velocities and forces of both sides) for each shipped axle, on the structured
//! and on the general path, along a drive; against the bare linear algebra that a tick cannot do without,
//! in the same run, in alternating blocks. Also Newton steps a tick, and instructions a tick where valgrind
//! is at hand (counted as the difference of two runs of this program).
//!
//! `cargo bench -p kingpin_benches --bench solver`

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a benchmark prints, and may fail loudly")]

use std::hint::black_box;
use std::process::{Command, Stdio};

use config::axle::Axle;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::{Mat, Par};
use kingpin_benches::{
    Contender, Durations, alternate, is_full_run, pin_to_core, print_against_baselines, print_machine, sized,
    time_batches,
};
use multibody::linear::DenseLu;
use multibody::{SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;

const AXLES: &[(&str, &str)] = &[
    ("double wishbone (24 + 36)", include_str!("../../schemas/suspensions/sedan_double_wishbone.toml")),
    ("strut with bar (36 + 36)", include_str!("../../schemas/suspensions/compact_strut.toml")),
    ("five-link (24 + 36)", include_str!("../../schemas/suspensions/sedan_five_link.toml")),
    (
        "double wishbone, bushings",
        include_str!("../../schemas/suspensions/sedan_double_wishbone_bushings.toml"),
    ),
];

/// Environment variable by which this program, run under valgrind by itself, is told what to run: axle,
/// path, ticks.
const COUNT_KEY: &str = "KINGPIN_SOLVER_BENCH_COUNT";

/// A brisk drive: rack at 1 Hz over ±50 mm, wheels ±20 mm at 1.7 and 1.3 Hz, forces that follow.
fn input(tick: usize) -> SuspensionInput {
    let t = tick as f64 * 1e-3;
    let (rack, rate) = (std::f64::consts::TAU, [1.7 * std::f64::consts::TAU, 1.3 * std::f64::consts::TAU]);
    SuspensionInput {
        rack_m: 0.05 * (rack * t).sin(),
        rack_speed_m_s: 0.05 * rack * (rack * t).cos(),
        wheel_height_m: rate.map(|w| 0.02 * (w * t).sin()),
        wheel_speed_m_s: rate.map(|w| 0.02 * w * (w * t).cos()),
        wheel_force_n: rate
            .map(|w| Vector3::new(100.0, 2000.0 * (w * t).sin(), 4000.0 + 800.0 * (w * t).sin())),
        wheel_moment_n_m: rate.map(|w| Vector3::new(600.0 * (w * t).sin(), 10.0, -60.0 * (w * t).sin())),
    }
}

struct Drive {
    suspension: Suspension,
    output: SuspensionOutput,
    inputs: Vec<SuspensionInput>,
    tick: usize,
    iterations: u64,
    most: u32,
    ticks: u64,
}

impl Drive {
    fn new(axle: &Axle, path: SolverPath) -> Self {
        Self {
            suspension: Suspension::with_path(axle, path).unwrap(),
            output: SuspensionOutput::default(),
            inputs: (0..20_000).map(input).collect(),
            tick: 0,
            iterations: 0,
            most: 0,
            ticks: 0,
        }
    }

    #[inline]
    fn step(&mut self) {
        self.suspension.step(&self.inputs[self.tick], &mut self.output);
        self.tick = (self.tick + 1) % self.inputs.len();
    }

    fn block(&mut self, out: &mut Durations, ticks: usize) {
        for _ in 0..ticks {
            time_batches(out, 1, 1, |_| self.step());
            assert_eq!(self.output.status, Status::Converged);
            self.iterations += u64::from(self.output.iterations);
            // The first tick of the drive comes from wherever the last one ended.
            self.most = self.most.max(if self.tick == 1 { 0 } else { self.output.iterations });
            self.ticks += 1;
        }
    }
}

/// A well-conditioned matrix of order n as like a Jacobian as random numbers get: a few entries a row.
fn matrix(n: usize) -> Vec<f64> {
    let mut seed = 1_u64;
    let mut random = || {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..n * n)
        .map(|k| {
            if k % (n + 1) == 0 {
                1.0 + random()
            } else if random() < 0.3 {
                random() - 0.5
            } else {
                0.0
            }
        })
        .collect()
}

/// `factors` dense factorisations of order 6 with one solve each: the least for that many single-body blocks.
fn bare_blocks(factors: usize) -> impl FnMut() {
    let a = matrix(6);
    let mut lu = DenseLu::new(6);
    move || {
        for _ in 0..factors {
            let mut x = [1.0; 6];
            lu.matrix_mut().copy_from_slice(black_box(&a));
            lu.factor().unwrap();
            lu.solve(&mut x);
            black_box(&x);
        }
    }
}

/// faer's dense LU: `steps` factorisations with a solve at `order`, and one with a transposed solve at
/// `order_forces`: the least for the whole Jacobians without their structure.
fn bare_dense(order: usize, steps: usize, order_forces: usize) -> impl FnMut() {
    let build = |n: usize| {
        let values = matrix(n);
        let a = Mat::from_fn(n, n, |i, j| values[i * n + j]);
        let request = factor::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Default::default())
            .or(solve::solve_in_place_scratch::<usize, f64>(n, 1, Par::Seq))
            .or(solve::solve_transpose_in_place_scratch::<usize, f64>(n, 1, Par::Seq));
        (
            a.clone(),
            a,
            MemBuffer::new(request),
            vec![0_usize; n],
            vec![0_usize; n],
            Mat::from_fn(n, 1, |_, _| 1.0),
        )
    };
    let mut parts = [build(order), build(order_forces)];
    move || {
        for (part, count) in [(0, steps), (1, 1)] {
            let (a, lu, memory, forward, backward, x) = &mut parts[part];
            for _ in 0..count {
                lu.copy_from(&*a);
                x.fill(1.0);
                let stack = MemStack::new(memory);
                let (_, p) =
                    factor::lu_in_place(lu.as_mut(), forward, backward, Par::Seq, stack, Default::default());
                let stack = MemStack::new(memory);
                if part == 0 {
                    solve::solve_in_place(lu.as_ref(), lu.as_ref(), p, x.as_mut(), Par::Seq, stack);
                } else {
                    solve::solve_transpose_in_place(lu.as_ref(), lu.as_ref(), p, x.as_mut(), Par::Seq, stack);
                }
                black_box(&*x);
            }
        }
    }
}

/// Instructions that one tick takes, by valgrind; `None` where it is not at hand.
fn instructions(axle: usize, path: &str) -> Option<f64> {
    let count = |ticks: u32| -> Option<f64> {
        let output = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
            .arg(std::env::current_exe().ok()?)
            .env(COUNT_KEY, format!("{axle} {path} {ticks}"))
            .stdout(Stdio::null())
            .output()
            .ok()?;
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        let line = text.lines().find(|line| line.contains("Collected"))?;
        line.rsplit(' ').next()?.trim().parse().ok()
    };
    Some((count(3000)? - count(1000)?) / 2000.0)
}

fn main() {
    let axles: Vec<Axle> = AXLES.iter().map(|(_, text)| toml::from_str(text).unwrap()).collect();
    if let Ok(what) = std::env::var(COUNT_KEY) {
        let words: Vec<&str> = what.split(' ').collect();
        let path = if words[1] == "general" { SolverPath::General } else { SolverPath::Structured };
        let mut drive = Drive::new(&axles[words[0].parse::<usize>().unwrap()], path);
        for _ in 0..words[2].parse::<usize>().unwrap() {
            drive.step();
        }
        return;
    }
    let pinned = pin_to_core(1);
    print_machine();
    println!("pinned to one core: {pinned}");
    let (blocks, ticks) = sized((20, 5000), (2, 50));
    for (index, (name, _)) in AXLES.iter().enumerate() {
        let mut structured = Drive::new(&axles[index], SolverPath::Structured);
        let mut general = Drive::new(&axles[index], SolverPath::General);
        // As many factorisations as a tick needs. Structured: one a side for the pose, which the chord steps use
        // again, and one a side for the forces. General: two Newton steps and one for the forces.
        let order = structured.suspension.describe().kinematic.coordinates;
        let order_forces = structured.suspension.describe().reaction.coordinates;
        let parts = 4;
        let mut bare_structured = bare_blocks(parts);
        let mut bare_general = bare_dense(order, 2, order_forces);
        let structured_name = format!("bare: {parts} × dense 6");
        let general_name = format!("bare: 2 × dense {order} + {order_forces} (faer)");
        let mut contenders: Vec<Contender<'_>> = vec![
            (&structured_name, Box::new(|out| time_batches(out, ticks, 1, |_| bare_structured()))),
            ("structured path", Box::new(|out| structured.block(out, ticks))),
            (&general_name, Box::new(|out| time_batches(out, ticks, 1, |_| bare_general()))),
            ("general path", Box::new(|out| general.block(out, ticks))),
        ];
        let results = alternate(blocks, &mut contenders);
        drop(contenders);
        let rows: Vec<(&Durations, usize)> = results.iter().zip([0, 0, 2, 2]).collect();
        print_against_baselines(name, &rows);
        for (path, drive) in [("structured", &structured), ("general", &general)] {
            let mean = drive.iterations as f64 / drive.ticks as f64;
            let counted = if is_full_run() { instructions(index, path) } else { None };
            let counted = counted.map_or_else(|| "not counted".to_owned(), |n| format!("{n:.0}"));
            println!(
                "  {path}: Newton steps a tick {mean:.2} (most {}), instructions a tick {counted}",
                drive.most
            );
        }
    }
}
