//! `rig rate`: what the tick rate does to the steering torque, against a bench at 10 kHz.

use super::{Ended, cell, jobs, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use assembly::closed_loop::{LoopTrace, trace};
use clap::Args as ClapArgs;
use config::ResolvedBench;
use metrics::resample::linear_at;
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `rig rate`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
The same manoeuvre at each tick rate, in lockstep, with a noiseless torque cell and potentiometer so that only the rate
differs, commands held and commands interpolated over a tick. Columns: tick [ms], commands, peak steering torque [N·m],
its error against 10 kHz [%], largest difference of the torque over time [N·m], loop delay estimated [ms].
Transport delays are the rig file's: they do not shrink with the tick.")]
pub struct RateArgs {
    /// Scenario
    #[arg(long, default_value = "sine_with_dwell_80", value_name = "SCENARIO")]
    scenario: String,
    /// Replace a value, as in `run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Write table and figure as a page
    #[arg(long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

struct Case {
    period_ms: f64,
    interpolated: bool,
}

/// `kingpin rig rate`.
pub fn rate(args: &RateArgs) -> Result<Exit, Ended> {
    let mut cases = vec![Case { period_ms: 0.1, interpolated: false }];
    for period_ms in [1.0, 0.5, 0.25] {
        cases.extend([false, true].map(|interpolated| Case { period_ms, interpolated }));
    }
    let runs: Vec<LoopTrace> = jobs::all("runs", &cases, args.json, |case| {
        let mut resolved = ResolvedBench::load(&args.scenario, &args.set)?;
        let (timing, rig) = (&mut resolved.scenario.timing, &mut resolved.rig);
        // 10 kHz is no rate a scenario may ask for: it is the study's yardstick.
        timing.period_ms = case.period_ms;
        rig.plant.interpolate_commands = case.interpolated;
        rig.plant.sub_step_s = 5e-5;
        let s = &mut rig.sensors;
        for noise in [
            &mut s.tie_rod_force.noise_n,
            &mut s.actuator_force.noise_n,
            &mut s.rack_displacement.noise_m,
            &mut s.steering_torque.noise_n_m,
            &mut s.torsion_bar_torque.noise_n_m,
            &mut s.horizontal_stroke.noise_m,
            &mut s.vertical_stroke.noise_m,
        ] {
            *noise = 0.0;
        }
        // Without noise a reading at rest is frozen, and rightly so.
        rig.limits.frozen_s = 60.0;
        Ok(trace(&resolved)?)
    })?;
    let peak = |t: &LoopTrace| {
        let active = (0..t.active.len()).filter(|&i| t.active[i]);
        active.fold(0.0, |m: f64, i| m.max(t.torque_n_m[i].abs()))
    };
    let reference = &runs[0];
    let rated = peak(reference);
    let mut rows = vec![
        [
            "tick [ms]",
            "commands",
            "peak torque [N·m]",
            "error [%]",
            "largest difference [N·m]",
            "loop delay [ms]",
            "",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    let mut list = Vec::new();
    let mut figure = page::Figure::new("Steering torque", "time in s", "torque in N·m");
    for (k, (case, run)) in cases.iter().zip(&runs).enumerate() {
        let difference = (0..run.time_s.len()).filter(|&i| run.active[i]).fold(0.0, |m: f64, i| {
            m.max(
                (run.torque_n_m[i] - linear_at(&reference.time_s, &reference.torque_n_m, run.time_s[i]))
                    .abs(),
            )
        });
        let error = 100.0 * (peak(run) / rated - 1.0);
        let delay = run.loop_delay_s.iter().rev().find(|v| v.is_finite()).map_or(f64::NAN, |v| 1e3 * v);
        let kind = if case.interpolated { "interpolated" } else { "held" };
        let trip =
            run.trip.map_or_else(String::new, |(code, tick)| format!("tripped: code {code} at tick {tick}"));
        rows.push(vec![
            format!("{}", case.period_ms),
            kind.to_owned(),
            cell(peak(run), 4),
            cell(error, 3),
            cell(difference, 4),
            cell(delay, 3),
            trip,
        ]);
        list.push(json!({"period_ms": case.period_ms, "commands": kind, "peak_torque_n_m": peak(run),
            "error_percent": error, "largest_difference_n_m": difference, "loop_delay_ms": delay, "trip": run.trip}));
        if !case.interpolated {
            let every = (1.0 / case.period_ms).round().max(1.0) as usize;
            let thin = |v: &[f64]| v.iter().copied().step_by(every).collect::<Vec<f64>>();
            figure.curve(
                &format!("{} ms", case.period_ms),
                &thin(&run.time_s),
                &thin(&run.torque_n_m),
                k,
                "solid",
            );
        }
    }
    if args.json {
        output::json(&json!({"scenario": args.scenario, "cases": list}));
    } else {
        output::line(output::columns(&rows));
    }
    if let Some(path) = &args.output {
        let title = format!("Tick rate and steering torque: {}", args.scenario);
        let table = page::Table { title: "Against 10 kHz".to_owned(), rows };
        write(
            path,
            &page::html(
                &title,
                "Sensors without noise; transport delays as in the rig's file",
                &[table],
                &[figure],
            ),
        )?;
        output::note(format!("  {}", path.display()));
    }
    let tripped = runs.iter().any(|run| run.trip.is_some());
    Ok(if tripped { Exit::Failed } else { Exit::Done })
}
