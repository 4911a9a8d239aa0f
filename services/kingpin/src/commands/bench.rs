//! `bench jitter`: the rig's wake-ups beside bare timer threads in the same run, and how the chain keeps its
//! phases. Blocks of both alternate, on the same core, at the same priority, with the same call to sleep, so
//! that both see the same host. A third kind of block is `cyclictest`'s: no spinning at all.

mod arguments;
pub mod load;
pub mod timer;

pub use arguments::BenchArgs;

use crate::exit::Exit;
use crate::output;
use arguments::{BenchCommand, BenchJitterArgs};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use record::LogReader;
use report::{Curve, Plot, Rows, page_html};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;
use timer::{Timer, Times, measure};

/// Start of the process set that is not counted: fading in. [s]
const SETTLE_S: f64 = 1.5;
/// Draws of the bootstrap.
const DRAWS: usize = 1000;

/// `kingpin bench`.
pub fn bench(args: &BenchArgs) -> Exit {
    let BenchCommand::Jitter(args) = &args.command;
    jitter(args)
}

/// What a block of the process set showed.
#[derive(Default)]
struct Block {
    wake: Times,
    output: Times,
    vehicle_done: Times,
    chain: Times,
    hand_over: Times,
    margin: Times,
    ticks: u64,
    late_commands: u64,
    missed_by_rig: u64,
}

fn jitter(args: &BenchJitterArgs) -> Exit {
    let blocks = (args.duration / args.block).ceil().max(1.0) as usize;
    let interrupt = super::run::interruptible();
    let directory = args.out.clone().unwrap_or_else(|| {
        let stamp = super::run::timestamp(runtime::clock::wall_now() / 1_000_000_000);
        Path::new("runs").join(format!("jitter-{stamp}"))
    });
    let refuse = |exit: Exit, text: String| {
        if args.json {
            output::json(&json!({ "error": text }))
        } else {
            output::note(&text)
        }
        exit
    };
    if !(args.duration > 0.0 && args.block > 0.0 && args.block <= 600.0) {
        return refuse(Exit::BadInput, "--duration and --block: must be above 0 s".to_owned());
    }
    let executable = match std::env::current_exe() {
        Ok(path) => path,
        Err(error) => return refuse(Exit::Unavailable, error.to_string()),
    };
    if let Err(error) = std::fs::create_dir_all(&directory) {
        return refuse(Exit::Unavailable, format!("{}: {error}", directory.display()));
    }
    let mut stress = match args.load.then(|| start_load(&executable)).transpose() {
        Ok(stress) => stress,
        Err(error) => return refuse(Exit::Unavailable, format!("--load: {error}")),
    };
    let bar = ProgressBar::new(blocks as u64);
    if args.json {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let style = ProgressStyle::with_template("jitter {bar:30} block {pos}/{len} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let period_ns = (args.period * 1e6).round() as u64;
    let count = (args.block * 1e9 / period_ns as f64) as usize;
    let core = args.cores.first().copied();
    let bare = Timer { core, priority: Some(args.priority), period_ns, spin_ns: assembly::service::SPIN_NS };
    let (mut set, mut same, mut cyclic) = (Vec::new(), Vec::new(), Vec::new());
    let mut error = None;
    for block in 0..blocks {
        if interrupt.load(Ordering::Relaxed) {
            break;
        }
        bar.set_message("process set");
        match run_block(args, &executable, &directory, block) {
            Ok(measured) => set.push(measured),
            Err(why) => {
                error = Some(why);
                break;
            }
        }
        bar.set_message("bare timer");
        same.push(measure(bare, count));
        bar.set_message("cyclictest");
        // A tenth of the time is enough for what nothing is compared with.
        cyclic.push(measure(Timer { spin_ns: 0, ..bare }, (count / 10).max(100)));
        bar.inc(1);
    }
    bar.finish_and_clear();
    if let Some(stress) = &mut stress {
        let _ = stress.kill();
        let _ = stress.wait();
    }
    if let Some(error) = error {
        return refuse(Exit::Failed, error);
    }
    if set.is_empty() {
        return Exit::Interrupted;
    }
    finish(args, &directory, &set, &same, &cyclic, interrupt.load(Ordering::Relaxed))
}

fn start_load(executable: &Path) -> std::io::Result<Child> {
    Command::new(executable)
        .args(["service", "load", "--bench", "load"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
}

/// Runs the process set for a block and reads its timings from the log.
fn run_block(
    args: &BenchJitterArgs,
    executable: &Path,
    directory: &Path,
    block: usize,
) -> Result<Block, String> {
    let out = directory.join(format!("set{block:04}"));
    let duration = args.block + SETTLE_S;
    let mut command = Command::new(executable);
    command.args(["run", &args.scenario, "--json", "--no-report", "--rearm", "--name", &args.name]);
    command.arg("--duration").arg(format!("{duration:?}")).arg("--out").arg(&out);
    let mut set = |text: String| {
        command.args(["--set", &text]);
    };
    set("warm_up_s=0.5".to_owned());
    set(format!("timing.period_ms={:?}", args.period));
    if args.period < 0.5 {
        set("timing.output_phase=0.8".to_owned());
    }
    set(format!("realtime.priority={}", args.priority));
    if let Some(rig) = args.cores.first() {
        let others = args.cores.get(1).unwrap_or(rig);
        set(format!("realtime.cores.rig={rig}"));
        set(format!("realtime.cores.vehicle={others}"));
        set(format!("realtime.cores.multibody={others}"));
    }
    let done = command.stdin(Stdio::null()).output().map_err(|e| e.to_string())?;
    let said = || String::from_utf8_lossy(&done.stderr).into_owned() + &String::from_utf8_lossy(&done.stdout);
    if matches!(done.status.code(), Some(2 | 3) | None) {
        return Err(format!("the process set did not run: {}", said()));
    }
    let wanted = ["rig_timing", "vehicle_timing", "multibody_timing", "rig_status"];
    let log = LogReader::open_regions(&out, |name| wanted.contains(&name)).map_err(|e| e.to_string())?;
    let measured = read_block(&log, args.period * 1e-3, duration)?;
    let _ = std::fs::remove_dir_all(&out);
    Ok(measured)
}

fn read_block(log: &LogReader, period_s: f64, duration_s: f64) -> Result<Block, String> {
    let mut block = Block::default();
    let first = (SETTLE_S / period_s) as u64;
    let end = (duration_s / period_s) as u64;
    let region = |name: &str| log.region(name).map_err(|e| e.to_string());
    let (rig, vehicle, multibody) =
        (region("rig_timing")?, region("vehicle_timing")?, region("multibody_timing")?);
    let column = |name: &str| rig.column_index(name).map_err(|e| e.to_string());
    let [wake, start, compute, done, margin, output] =
        ["wake_lateness_s", "start_s", "compute_s", "done_s", "margin_s", "output_lateness_s"].map(column);
    let (wake, start, compute, done, margin, output) = (wake?, start?, compute?, done?, margin?, output?);
    let caught_up = column("caught_up_count")?;
    let value = |words: &[u64], column: usize| f64::from_bits(words[column]) * 1e9;
    let mut next = first;
    for (row, &tick) in rig.ticks.iter().enumerate().filter(|(_, t)| (first..end).contains(*t)) {
        let words = rig.row(row);
        block.ticks += 1;
        block.wake.record_with_overslept_ns(value(words, wake), tick - next, period_s * 1e9);
        next = tick + 1;
        block.output.record_ns(value(words, output));
        let (Some(v), Some(m)) = (vehicle.at_tick(tick), multibody.at_tick(tick)) else { continue };
        block.vehicle_done.record_ns(value(v, done));
        // A tick that was caught up has no margin: it is counted, not measured.
        let before = multibody.at_tick(tick.saturating_sub(1)).map(|w| w[caught_up]);
        if before.is_some_and(|before| before == m[caught_up]) {
            let chain = value(m, done) - value(words, start);
            block.chain.record_ns(chain);
            let computed = value(words, compute) + value(v, compute) + value(m, compute);
            block.hand_over.record_ns(chain - computed);
            block.margin.record_ns(value(m, margin));
        }
    }
    block.missed_by_rig = (end - first).saturating_sub(block.ticks);
    let late = log.column_u64("rig_status", "late_command_count").map_err(|e| e.to_string())?;
    let ticks = &region("rig_status")?.ticks;
    let at =
        |tick: u64| late.get(ticks.partition_point(|&t| t < tick).min(late.len().saturating_sub(1))).copied();
    block.late_commands = at(end).unwrap_or(0).saturating_sub(at(first).unwrap_or(0));
    Ok(block)
}

fn sum<'a>(times: impl Iterator<Item = &'a Times>) -> Times {
    times.fold(Times::default(), |mut sum, times| {
        sum.add(times);
        sum
    })
}

/// 95 % interval of the ratio of two quantiles: blocks drawn with replacement [Efron 1979], since wake-ups within a
/// block are not independent.
fn interval(set: &[&Times], bare: &[&Times], quantile: f64) -> Option<[f64; 2]> {
    if set.len() < 5 {
        return None;
    }
    let mut state = 1_u64;
    let mut below = |end: usize| {
        // SplitMix64: the same interval each time for the same data.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % end as u64) as usize
    };
    let mut ratios: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let drawn: Vec<usize> = (0..set.len()).map(|_| below(set.len())).collect();
            // Pairs of neighbouring blocks saw the same host: drawn together.
            let of = |times: &[&Times]| sum(drawn.iter().map(|&i| times[i])).quantile_ns(quantile);
            of(set) / of(bare).max(1.0)
        })
        .collect();
    ratios.sort_by(f64::total_cmp);
    Some([ratios[DRAWS / 40], ratios[DRAWS - DRAWS / 40 - 1]])
}

fn row(name: &str, times: &Times) -> Value {
    json!({
        "name": name, "samples": times.len(),
        "p50_us": times.quantile_ns(0.5) * 1e-3, "p99_us": times.quantile_ns(0.99) * 1e-3,
        "p99_9_us": times.quantile_ns(0.999) * 1e-3, "max_us": times.quantile_ns(1.0) * 1e-3,
    })
}

fn finish(
    args: &BenchJitterArgs,
    directory: &Path,
    set: &[Block],
    same: &[Times],
    cyclic: &[Times],
    interrupted: bool,
) -> Exit {
    let wake = sum(set.iter().map(|b| &b.wake));
    let bare = sum(same.iter());
    let (wakes, bares): (Vec<_>, Vec<_>) = set.iter().zip(same).map(|(b, s)| (&b.wake, s)).unzip();
    let ratios: Vec<Value> = [0.5, 0.99, 0.999]
        .iter()
        .map(|&q| {
            json!({
                "quantile": q, "ratio": wake.quantile_ns(q) / bare.quantile_ns(q).max(1.0),
                "interval_95": interval(&wakes, &bares, q),
            })
        })
        .collect();
    let margins = sum(set.iter().map(|b| &b.margin));
    let rows = [
        ("rig wake-up, process set", &wake),
        ("bare timer, same core, priority and sleep", &bare),
        ("bare timer without spinning (cyclictest)", &sum(cyclic.iter())),
        ("rig output phase, lateness", &sum(set.iter().map(|b| &b.output))),
        ("vehicle done, after the tick", &sum(set.iter().map(|b| &b.vehicle_done))),
        ("chain: rig sample to suspension state", &sum(set.iter().map(|b| &b.chain))),
        ("chain without the steps' computing", &sum(set.iter().map(|b| &b.hand_over))),
    ];
    let ticks: u64 = set.iter().map(|b| b.ticks).sum();
    let late: u64 = set.iter().map(|b| b.late_commands).sum();
    let missed: u64 = set.iter().map(|b| b.missed_by_rig).sum();
    let load = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let kernel = rustix::system::uname();
    let summary = json!({
        "period_ms": args.period, "cores": args.cores, "priority": args.priority, "load": args.load,
        "blocks": set.len(), "block_s": args.block, "interrupted": interrupted,
        "spin_us": assembly::service::SPIN_NS as f64 * 1e-3,
        "host": {"kernel": kernel.release().to_string_lossy(), "version": kernel.version().to_string_lossy(),
            "cores": std::thread::available_parallelism().map_or(1, |n| n.get()), "load_average": load.trim()},
        "rows": rows.iter().map(|(name, times)| row(name, times)).collect::<Vec<_>>(),
        "margin_before_output_phase_us": {"p0_1": margins.quantile_ns(0.001) * 1e-3,
            "p1": margins.quantile_ns(0.01) * 1e-3, "p50": margins.quantile_ns(0.5) * 1e-3},
        "rig_wake_up_to_bare_timer": ratios,
        "ticks": ticks, "late_commands": late, "ticks_missed_by_rig": missed,
    });
    let head = ["", "samples", "p50 us", "p99 us", "p99.9 us", "max us"].map(str::to_owned).to_vec();
    let mut table = vec![head.clone()];
    table.extend(rows.iter().map(|(name, times)| {
        let us = |q: f64| format!("{:.1}", times.quantile_ns(q) * 1e-3);
        vec![(*name).to_owned(), times.len().to_string(), us(0.5), us(0.99), us(0.999), us(1.0)]
    }));
    let mut lines = vec![format!(
        "{} blocks of {:.0} s each, {} ms, priority {}, cores {:?}{}: {ticks} ticks, {late} late commands, {missed} ticks missed by the rig",
        set.len(),
        args.block,
        args.period,
        args.priority,
        args.cores,
        if args.load { ", under load" } else { "" }
    )];
    for ratio in &ratios {
        let quantile = 100.0 * ratio["quantile"].as_f64().unwrap_or(0.0);
        let interval = match (ratio["interval_95"][0].as_f64(), ratio["interval_95"][1].as_f64()) {
            (Some(a), Some(b)) => format!("95 % interval {a:.2} to {b:.2}"),
            _ => "too few blocks for an interval".to_owned(),
        };
        lines.push(format!(
            "rig wake-up to bare timer, p{quantile}: {:.2} ({interval})",
            ratio["ratio"].as_f64().unwrap_or(f64::NAN)
        ));
    }
    let curve = |name: &str, times: &Times| {
        let (x, y) = times.tail();
        Curve { name: name.to_owned(), x, y, steps: false }
    };
    let plots = [("Wake-ups", 0..3), ("Phases and chain", 3..7)].map(|(title, range)| Plot {
        title: title.to_owned(),
        note: "share of all that came later than the time on the abscissa".to_owned(),
        x_title: "time in us".to_owned(),
        y_title: "share".to_owned(),
        log: [true, true],
        curves: rows[range].iter().map(|(name, times)| curve(name, times)).collect(),
        wide: true,
    });
    let page_rows = Rows { title: "Times".to_owned(), head, rows: table.iter().skip(1).cloned().collect() };
    let html = page_html("Jitter", &lines, None, &[page_rows], &plots);
    let text = serde_json::to_string_pretty(&summary).unwrap_or_default();
    let files: [(PathBuf, &str); 2] =
        [(directory.join("jitter.json"), &text), (directory.join("jitter.html"), &html)];
    for (path, content) in &files {
        let written =
            super::log::write_whole(path, |out| out.write_all(content.as_bytes()).map_err(|e| e.to_string()));
        if let Err(error) = written {
            output::note(error);
            return Exit::Unavailable;
        }
    }
    if args.json {
        output::json(&summary);
    } else {
        output::line(output::columns(&table).trim_end());
        lines.iter().for_each(output::line);
        files.iter().for_each(|(path, _)| output::line(format!("  {}", path.display())));
    }
    if interrupted { Exit::Interrupted } else { Exit::Done }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_holds_the_ratio_and_widens_with_unequal_blocks() {
        let block = |scale: f64| {
            let mut times = Times::default();
            (1..=1000).for_each(|i| times.record_ns(f64::from(i) * scale));
            times
        };
        let even: Vec<_> = (0..20).map(|_| block(100.0)).collect();
        let twice: Vec<_> = (0..20).map(|_| block(200.0)).collect();
        let (a, b): (Vec<&Times>, Vec<&Times>) = twice.iter().zip(&even).unzip();
        let [low, high] = interval(&a, &b, 0.999).unwrap_or([0.0; 2]);
        assert!((low - 2.0).abs() < 0.01 && (high - 2.0).abs() < 0.01, "{low} {high}");
        let uneven: Vec<_> = (0..20).map(|i| block(if i % 4 == 0 { 400.0 } else { 100.0 })).collect();
        let (a, b): (Vec<&Times>, Vec<&Times>) = uneven.iter().zip(&even).unzip();
        let [low, high] = interval(&a, &b, 0.5).unwrap_or([0.0; 2]);
        assert!(high - low > 0.05, "{low} {high}");
        assert!(interval(&a[..4], &b[..4], 0.5).is_none());
    }

    #[test]
    fn a_bare_timer_is_never_early_and_counts_what_it_should() {
        let timer = Timer { core: None, priority: None, period_ns: 500_000, spin_ns: 20_000 };
        let times = measure(timer, 50);
        assert_eq!(times.len(), 50);
        let (x, y) = times.tail();
        assert!(x.is_sorted() && y.is_sorted_by(|a, b| a >= b));
    }
}
