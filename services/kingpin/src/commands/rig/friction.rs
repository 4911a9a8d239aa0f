//! `rig friction`: steering torque over angle at the hand wheel, for several frictions of the rack.

use super::{Ended, cell, jobs, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use assembly::closed_loop::trace;
use clap::Args as ClapArgs;
use config::ResolvedBench;
use metrics::filter::LowPass;
use metrics::fit::crossing;
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `rig friction`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Width: steering torque at zero angle, rising less falling angle [N·m], over the whole cycles of the manoeuvre, torque
below 5 Hz. Friction of the rack widens the loop of the slow ramp without exception: at 0.02 Hz nothing else depends on
the direction of motion, and what the rack's friction takes comes out at the wheel, less what the assist carries. In
the weave the car's own answer lags the angle by tens of milliseconds and more; that lag's loop is as wide as
friction's and of either sense, assist damping and active return come on top, and friction also changes how far the
rack follows the wheel, so the width there may rise or fall with friction.
Exit code 1 when the slow ramp's width does not grow with friction.")]
pub struct FrictionArgs {
    /// Frictions of the rack [N]
    #[arg(long, value_delimiter = ',', default_values_t = [50.0, 100.0, 150.0, 250.0, 400.0], value_name = "N,…")]
    friction: Vec<f64>,
    /// Replace a value, as in `run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Write loops and widths as a page
    #[arg(long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Manoeuvre, its name, and what is set beside the friction.
const MANOEUVRES: [(&str, &str, &[&str]); 2] = [
    ("slow_ramp_50", "slow ramp, 0.02 Hz, 50 km/h", &[]),
    ("weave_100", "weave, 0.2 Hz, 100 km/h", &["duration_s=30"]),
];

struct Loop {
    width_n_m: f64,
    angle_deg: Vec<f64>,
    torque_n_m: Vec<f64>,
}

/// `kingpin rig friction`.
pub fn friction(args: &FrictionArgs) -> Result<Exit, Ended> {
    let mut frictions = args.friction.clone();
    frictions.sort_by(f64::total_cmp);
    let cases: Vec<(usize, f64)> =
        (0..MANOEUVRES.len()).flat_map(|m| frictions.iter().map(move |f| (m, *f))).collect();
    let loops = jobs::all("runs", &cases, args.json, |&(manoeuvre, newton)| {
        let (scenario, _, more) = MANOEUVRES[manoeuvre];
        let mut sets: Vec<String> = more.iter().map(|s| (*s).to_owned()).collect();
        sets.extend(args.set.iter().cloned());
        sets.push(format!("unit.rack_friction.sliding_n={newton:?}"));
        let t = trace(&ResolvedBench::load(scenario, &sets)?)?;
        if let Some((code, tick)) = t.trip {
            return Err(Ended::Failed(format!(
                "{scenario} at {newton} N tripped: code {code} at tick {tick}"
            )));
        }
        let torque = match LowPass::butterworth(5.0, t.period_s) {
            Some(filter) => filter.zero_phase(&t.torque_n_m),
            None => t.torque_n_m.clone(),
        };
        let first = t.active.iter().position(|a| *a).unwrap_or(0);
        let last = t.active.iter().rposition(|a| *a).unwrap_or(first);
        // The first quarter of the cycles settles.
        let from = first + (last - first) / 4;
        let angle = &t.angle_reading_rad[from..=last];
        let width_n_m = crossing(angle, &torque[from..=last], 0.0).map_or(f64::NAN, |c| c.width);
        let step = (angle.len() / 2000).max(1);
        Ok(Loop {
            width_n_m,
            angle_deg: angle.iter().step_by(step).map(|a| a.to_degrees()).collect(),
            torque_n_m: torque[from..=last].iter().copied().step_by(step).collect(),
        })
    })?;
    let widths = |m: usize| -> Vec<f64> {
        loops[m * frictions.len()..(m + 1) * frictions.len()].iter().map(|l| l.width_n_m).collect()
    };
    let (ramp, weave) = (widths(0), widths(1));
    let rises = |w: &[f64]| w.windows(2).all(|pair| pair[1] > pair[0]);
    let mut rows = vec![
        ["rack friction [N]", "slow ramp: width [N·m]", "weave: width [N·m]"].map(str::to_owned).to_vec(),
    ];
    for (k, newton) in frictions.iter().enumerate() {
        rows.push(vec![cell(*newton, 0), cell(ramp[k], 4), cell(weave[k], 4)]);
    }
    let verdict = format!(
        "slow ramp: width {} with friction; weave: {}",
        if rises(&ramp) { "grows" } else { "DOES NOT GROW" },
        if rises(&weave) { "grows too" } else { "does not, nor need it: see --help" },
    );
    if args.json {
        output::json(
            &json!({"rack_friction_n": frictions, "slow_ramp_width_n_m": ramp, "weave_width_n_m": weave,
            "slow_ramp_monotone": rises(&ramp), "weave_monotone": rises(&weave)}),
        );
    } else {
        output::line(output::columns(&rows));
        output::line(&verdict);
    }
    if let Some(path) = &args.output {
        let mut figures = Vec::new();
        for (m, (_, name, _)) in MANOEUVRES.iter().enumerate() {
            let mut figure = page::Figure::new(name, "hand-wheel angle in deg", "steering torque in N·m");
            for (k, newton) in frictions.iter().enumerate() {
                let l = &loops[m * frictions.len() + k];
                figure.curve(&format!("{newton} N"), &l.angle_deg, &l.torque_n_m, k, "solid");
            }
            figures.push(figure);
        }
        let mut width =
            page::Figure::new("Width of the loop at zero angle", "rack friction in N", "width in N·m");
        width.curve("slow ramp", &frictions, &ramp, 1, "solid");
        width.curve("weave", &frictions, &weave, 2, "dash");
        figures.push(width);
        let table = page::Table { title: "Width of the loop".to_owned(), rows };
        write(
            path,
            &page::html("Steering torque over angle, and rack friction", &verdict, &[table], &figures),
        )?;
        output::note(format!("  {}", path.display()));
    }
    Ok(if rises(&ramp) { Exit::Done } else { Exit::Failed })
}
