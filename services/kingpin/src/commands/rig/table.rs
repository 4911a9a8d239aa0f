//! `rig table`: tie-rod force and ball height, command against reading, beside the published figures.
//!
//! Measured as specified: error = command\[n\] − cell reading available at n, both through the same zero-phase 50 Hz
//! filter, while steering is active and the bench runs, in per cent of half the peak-to-peak of that side's command;
//! the true force beside it. The whole bench closes the loop: car, suspension, rig with its delays and noise.

use super::{Ended, cell, jobs, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use assembly::closed_loop::{LoopTrace, trace};
use clap::Args as ClapArgs;
use config::ResolvedBench;
use metrics::tracking::tracking;
use rig_control::study::{MANOEUVRES, SteerMode, Study};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Arguments of `rig table`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Columns: largest and rms error of the tie-rod force, left and right, in % of half the peak-to-peak of the command;
in brackets what was published for the hardware bench. lag: of force (left, right) and height (left) behind the
command by cross-correlation [ms]. true: rms of the true force's error [%]. energy: fed into the steering by the
error, per second of steering [W]. Verdict: nominal figures at most half the published ones, varied ones at most
the published ones, force lag at most 5 ms, height lag at most 10 ms.
Exit code 1 when a figure misses its bound.
Example, everything on three seeds that nobody tuned with:
  kingpin rig table --corners --seeds 101,102,103")]
pub struct TableArgs {
    /// Nominal machine only: no variations, no parts switched off
    #[arg(long)]
    nominal: bool,
    /// All eight corners of the combined variations instead of two
    #[arg(long)]
    corners: bool,
    /// Seeds of the sensors' errors and noise: each bounded row is run with every one of them and shows the worst of
    /// each figure. Without: the scenarios' own
    #[arg(long, value_delimiter = ',', value_name = "SEED,…")]
    seeds: Vec<u64>,
    /// Replace a value, as in `run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Write the table as a page
    #[arg(long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

/// Scenario of each published manoeuvre, in the order of [`MANOEUVRES`].
const SCENARIOS: [&str; 4] = ["on_centre_120", "slalom_120", "lane_change_120", "sine_with_dwell_80"];
/// Suspensions, and what selects them.
const SUSPENSIONS: [(&str, &[&str]); 2] =
    [("double wishbone", &[]), ("strut", &["car.front.axle_file=\"compact_strut\""])];

/// The machine's valve gain, stiffness and delay over nominal.
type Variation = [f64; 3];

/// One row to be made.
struct Row {
    suspension: usize,
    manoeuvre: usize,
    case: String,
    variation: Variation,
    set: Vec<String>,
    /// Share of the published figures that bounds it; none where it only shows.
    bound: Option<f64>,
}

/// One row made.
struct Made {
    figures: [f64; 4],
    true_rms: [f64; 2],
    amplitude_n: [f64; 2],
    force_lag_s: [f64; 2],
    height_lag_s: f64,
    estimated_lag_s: f64,
    energy_w: f64,
    tripped: bool,
}

fn bench(row: &Row, sets: &[String]) -> Result<ResolvedBench, Ended> {
    let mut all: Vec<String> = SUSPENSIONS[row.suspension].1.iter().map(|s| (*s).to_owned()).collect();
    all.extend(sets.iter().cloned());
    all.extend(row.set.iter().cloned());
    let mut resolved = ResolvedBench::load(SCENARIOS[row.manoeuvre], &all)?;
    let [gain, stiffness, delay] = row.variation;
    let plant = &mut resolved.rig.plant;
    for axis in [&mut plant.horizontal, &mut plant.vertical] {
        axis.rated_flow_m3_s *= gain;
    }
    plant.leaf_spring_stiffness_n_m *= stiffness;
    plant.tie_rod_stiffness_n_m *= stiffness;
    // Delays are whole sub-steps: rounded to the nearest.
    let whole = |s: f64| (s * delay / plant.sub_step_s).round() * plant.sub_step_s;
    (plant.command_delay_s, plant.measurement_delay_s) =
        (whole(plant.command_delay_s), whole(plant.measurement_delay_s));
    Ok(resolved)
}

fn judge(t: &LoopTrace) -> Result<Made, Ended> {
    let mut made = Made {
        figures: [f64::NAN; 4],
        true_rms: [f64::NAN; 2],
        amplitude_n: [f64::NAN; 2],
        force_lag_s: [f64::NAN; 2],
        height_lag_s: f64::NAN,
        estimated_lag_s: f64::NAN,
        energy_w: f64::NAN,
        tripped: t.trip.is_some(),
    };
    for side in 0..2 {
        let of = |signal: &[f64]| {
            tracking(&t.force_command_n[side], signal, &t.active, t.period_s)
                .map_err(|why| Ended::Failed(format!("no figure: {why}")))
        };
        let reading = of(&t.force_reading_n[side])?;
        made.figures[2 * side] = reading.error_max_percent;
        made.figures[2 * side + 1] = reading.error_rms_percent;
        made.amplitude_n[side] = reading.amplitude;
        made.force_lag_s[side] = reading.lag_s;
        made.true_rms[side] = of(&t.force_true_n[side])?.error_rms_percent;
    }
    let height = tracking(&t.height_command_m[0], &t.height_reading_m[0], &t.active, t.period_s);
    made.height_lag_s = height.map_or(f64::NAN, |h| h.lag_s);
    let first = t.active.iter().position(|a| *a).unwrap_or(0);
    let last = t.active.iter().rposition(|a| *a).unwrap_or(first);
    made.energy_w = (t.energy_j[last] - t.energy_j[first]) / ((last - first).max(1) as f64 * t.period_s);
    made.estimated_lag_s = t.loop_delay_s[last];
    Ok(made)
}

impl Made {
    /// The worse of both, figure by figure.
    fn or_worse(mut self, other: &Made) -> Made {
        let larger = |a: &mut f64, b: f64| {
            // A figure that is missing is worse than any.
            if !b.is_finite() || b.abs() > a.abs() {
                *a = b;
            }
        };
        for k in 0..4 {
            larger(&mut self.figures[k], other.figures[k]);
        }
        for side in 0..2 {
            larger(&mut self.true_rms[side], other.true_rms[side]);
            larger(&mut self.force_lag_s[side], other.force_lag_s[side]);
        }
        larger(&mut self.height_lag_s, other.height_lag_s);
        larger(&mut self.estimated_lag_s, other.estimated_lag_s);
        larger(&mut self.energy_w, other.energy_w);
        self.tripped |= other.tripped;
        self
    }
}

impl Row {
    /// Whether the figures keep their bounds; true where there is none.
    fn kept(&self, made: &Made) -> bool {
        let Some(share) = self.bound else { return true };
        let published = MANOEUVRES[self.manoeuvre].published;
        let within = made.figures.iter().zip(published).all(|(ours, theirs)| *ours <= share * theirs);
        let lags = made.force_lag_s.iter().all(|lag| lag.abs() <= 0.005) && made.height_lag_s.abs() <= 0.010;
        within && lags && !made.tripped
    }
}

/// The variations: each alone, then combined.
fn variations(corners: bool) -> Vec<(String, Variation)> {
    let mut list = Vec::new();
    for (k, name) in ["gain", "stiffness", "delay"].into_iter().enumerate() {
        for (sign, factor) in [("+20 %", 1.2), ("−20 %", 0.8)] {
            let mut v = [1.0; 3];
            v[k] = factor;
            list.push((format!("{name} {sign}"), v));
        }
    }
    for bits in 0..8_u32 {
        let v: Variation = std::array::from_fn(|k| if bits >> k & 1 == 1 { 0.8 } else { 1.2 });
        if corners || bits == 0 || bits == 7 {
            let sign = |f: f64| if f > 1.0 { '+' } else { '−' };
            list.push((format!("gain {} stiffness {} delay {}", sign(v[0]), sign(v[1]), sign(v[2])), v));
        }
    }
    list
}

/// Parts switched off one by one, and what shows them best.
fn parts() -> Vec<(&'static str, Vec<&'static str>)> {
    vec![
        ("without force conversion", vec!["rig.control.switches.force_conversion=false"]),
        ("without rack feed-forward", vec!["rig.control.switches.rack_feed_forward=false"]),
        ("without delay compensation", vec!["rig.control.switches.delay_compensation=false"]),
        ("without force-rate feed-forward", vec!["rig.control.switches.force_rate_feed_forward=false"]),
        ("without pressure compensation", vec!["rig.control.switches.pressure_compensation=false"]),
        ("without gain adaptation", vec!["rig.control.switches.gain_adaptation=false"]),
        (
            "cylinder's cell above 3 Hz, with inertia feed-forward",
            vec![
                "rig.control.force.cell_crossover_rad_s=20",
                "rig.control.force.bandwidth_rad_s=60",
                "rig.control.switches.inertia_feed_forward=true",
            ],
        ),
        (
            "the same without inertia feed-forward",
            vec!["rig.control.force.cell_crossover_rad_s=20", "rig.control.force.bandwidth_rad_s=60"],
        ),
    ]
}

/// `kingpin rig table`.
pub fn table(args: &TableArgs) -> Result<Exit, Ended> {
    let mut rows = Vec::new();
    let nominal = [1.0; 3];
    for suspension in 0..SUSPENSIONS.len() {
        let mut add = |case: &str, variation, set: &[&str], bound| {
            for manoeuvre in 0..SCENARIOS.len() {
                rows.push(Row {
                    suspension,
                    manoeuvre,
                    case: case.to_owned(),
                    variation,
                    set: set.iter().map(|s| (*s).to_owned()).collect(),
                    bound,
                });
            }
        };
        add("nominal", nominal, &[], Some(0.5));
        if args.nominal {
            continue;
        }
        for (case, variation) in variations(args.corners) {
            add(&case, variation, &[], Some(1.0));
        }
        for (case, set) in parts() {
            add(case, nominal, &set, None);
        }
    }
    let cases: Vec<(usize, Option<u64>)> = rows
        .iter()
        .enumerate()
        .flat_map(|(i, row)| {
            let seeded = row.bound.is_some() && !args.seeds.is_empty();
            let seeds = if seeded { args.seeds.iter().copied().map(Some).collect() } else { vec![None] };
            seeds.into_iter().map(move |seed| (i, seed))
        })
        .collect();
    let runs = jobs::all("runs", &cases, args.json, |&(i, seed)| {
        let mut sets = args.set.clone();
        sets.extend(seed.map(|seed| format!("seed={seed}")));
        judge(&trace(&bench(&rows[i], &sets)?)?)
    })?;
    let mut made: Vec<Made> = Vec::with_capacity(rows.len());
    for (&(i, _), run) in cases.iter().zip(runs) {
        match made.pop() {
            Some(last) if made.len() == i => made.push(last.or_worse(&run)),
            Some(last) => made.extend([last, run]),
            None => made.push(run),
        }
    }
    let modes = modes(&bench(&rows[0], &args.set)?)?;
    let missed = rows.iter().zip(&made).filter(|(row, made)| !row.kept(made)).count();
    let parts = worth(&rows, &made);
    if args.json {
        output::json(&to_json(&rows, &made, &modes, &parts, missed, &args.seeds));
    } else {
        for table in tables(&rows, &made, &modes, &parts) {
            output::line(&table.title);
            output::line(output::columns(&table.rows));
        }
        output::line(format!("{missed} of {} bounded rows miss a bound", bounded(&rows)));
    }
    if let Some(path) = &args.output {
        let about = "Command against load-cell reading, zero-phase 50 Hz, in % of half the peak-to-peak of the command. \
                     Published figures: the hardware bench whose concept this follows.";
        let page = page::html("Tie-rod force tracking", about, &tables(&rows, &made, &modes, &parts), &[]);
        output::note(format!("  {}", write(path, &page)?.display()));
    }
    Ok(if missed == 0 { Exit::Done } else { Exit::Failed })
}

fn bounded(rows: &[Row]) -> usize {
    rows.iter().filter(|row| row.bound.is_some()).count()
}

/// What a part is worth: the figure that suffers most without it, and by which factor.
struct Worth {
    part: String,
    figure: String,
    with: f64,
    without: f64,
}

const FIGURES: [&str; 4] = ["left max", "left rms", "right max", "right rms"];

fn worth(rows: &[Row], made: &[Made]) -> Vec<Worth> {
    let mut list: Vec<Worth> = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        if row.bound.is_some() || row.case.starts_with("cylinder") {
            continue;
        }
        // The last part is measured against the case it is switched off in.
        let base_case = if row.case.starts_with("the same") { "cylinder" } else { "nominal" };
        let base = rows.iter().position(|b| {
            b.case.starts_with(base_case) && b.suspension == row.suspension && b.manoeuvre == row.manoeuvre
        });
        let Some(base) = base else { continue };
        for k in 0..4 {
            let (with, without) = (made[base].figures[k], made[i].figures[k]);
            let better = list.iter().position(|w| w.part == row.case);
            if better.is_none_or(|b| without / with > list[b].without / list[b].with) {
                let figure = format!(
                    "{}, {}, {}",
                    MANOEUVRES[row.manoeuvre].name, SUSPENSIONS[row.suspension].0, FIGURES[k]
                );
                let entry = Worth { part: row.case.clone(), figure, with, without };
                match better {
                    Some(b) => list[b] = entry,
                    None => list.push(entry),
                }
            }
        }
    }
    list
}

/// Figures of one mode of the steer axis.
struct Mode {
    name: &'static str,
    figures: [f64; 4],
    published: [f64; 4],
    steer: String,
}

/// Angle, torque and measuring-wheel mode, on the load of the study crate (bicycle model), lane change.
fn modes(resolved: &ResolvedBench) -> Result<Vec<Mode>, Ended> {
    let mut rows = Vec::new();
    for (name, mode) in [
        ("angle", SteerMode::Angle),
        ("torque", SteerMode::Torque),
        ("measuring wheel, hands on it", SteerMode::MeasuringWheel),
    ] {
        let mut unit = resolved.unit.clone();
        // The study's load has its rack ahead of the axle.
        unit.rack_travel_m_per_rev = unit.rack_travel_m_per_rev.abs();
        let study = Study { mode, ..Study::new(&resolved.rig, &unit) };
        let manoeuvre = &MANOEUVRES[1];
        let result = study.run(manoeuvre).map_err(|broken| {
            Ended::Input(broken.iter().map(|b| format!("{}: {}\n", b.key, b.rule)).collect())
        })?;
        let steer = match mode {
            SteerMode::Angle => format!("largest angle error {:.4} rad", result.steer_error_rad),
            SteerMode::Torque => format!("largest torque error {:.3} N·m", result.steer_torque_error_n_m),
            SteerMode::MeasuringWheel => {
                format!(
                    "angle {:.3} rad, torque {:.2} N·m",
                    result.steer_angle_max_rad, result.steer_torque_max_n_m
                )
            }
        };
        rows.push(Mode { name, figures: result.figures(), published: manoeuvre.published, steer });
    }
    Ok(rows)
}

fn tables(rows: &[Row], made: &[Made], modes: &[Mode], parts: &[Worth]) -> Vec<page::Table> {
    let mut list = Vec::new();
    for (s, (suspension, _)) in SUSPENSIONS.iter().enumerate() {
        let mut lines = vec![
            [
                "case",
                "manoeuvre",
                "left max",
                "left rms",
                "right max",
                "right rms",
                "largest share",
                "true rms",
                "amplitude [N]",
                "lag F [ms]",
                "lag z [ms]",
                "estimated [ms]",
                "energy [W]",
                "",
            ]
            .map(str::to_owned)
            .to_vec(),
        ];
        for (row, made) in rows.iter().zip(made).filter(|(row, _)| row.suspension == s) {
            let published = MANOEUVRES[row.manoeuvre].published;
            let figure = |k: usize| format!("{:.2} ({:.2})", made.figures[k], published[k]);
            let share = made.figures.iter().zip(published).fold(0.0, |m: f64, (a, b)| m.max(a / b));
            let verdict = match row.bound {
                Some(_) if made.tripped => "TRIPPED",
                Some(_) if row.kept(made) => "kept",
                Some(_) => "MISSED",
                None if made.tripped => "tripped",
                None => "",
            };
            lines.push(vec![
                row.case.clone(),
                MANOEUVRES[row.manoeuvre].name.to_owned(),
                figure(0),
                figure(1),
                figure(2),
                figure(3),
                cell(share, 2),
                format!("{:.2} {:.2}", made.true_rms[0], made.true_rms[1]),
                format!("{:.0} {:.0}", made.amplitude_n[0], made.amplitude_n[1]),
                format!("{} {}", cell(1e3 * made.force_lag_s[0], 2), cell(1e3 * made.force_lag_s[1], 2)),
                cell(1e3 * made.height_lag_s, 2),
                cell(1e3 * made.estimated_lag_s, 2),
                cell(made.energy_w, 4),
                verdict.to_owned(),
            ]);
        }
        list.push(page::Table {
            title: format!("Front suspension: {suspension}; ours (published) [%]"),
            rows: lines,
        });
    }
    if !parts.is_empty() {
        let mut lines = vec![
            ["part", "figure that suffers most", "with it [%]", "without it [%]", "factor"]
                .map(str::to_owned)
                .to_vec(),
        ];
        for w in parts {
            let numbers = [cell(w.with, 2), cell(w.without, 2), cell(w.without / w.with, 2)];
            lines.push([vec![w.part.clone(), w.figure.clone()], numbers.to_vec()].concat());
        }
        list.push(page::Table { title: "What each part is worth".to_owned(), rows: lines });
    }
    let mut lines = vec![
        ["steer axis", "left max", "left rms", "right max", "right rms", "steering"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for mode in modes {
        let figure = |k: usize| format!("{:.2} ({:.2})", mode.figures[k], mode.published[k]);
        lines.push(vec![
            mode.name.to_owned(),
            figure(0),
            figure(1),
            figure(2),
            figure(3),
            mode.steer.clone(),
        ]);
    }
    let title = format!(
        "Modes of the steer axis: {}, bicycle model as load; ours (published) [%]",
        MANOEUVRES[1].name
    );
    list.push(page::Table { title, rows: lines });
    list
}

fn to_json(
    rows: &[Row],
    made: &[Made],
    modes: &[Mode],
    parts: &[Worth],
    missed: usize,
    seeds: &[u64],
) -> Value {
    let row = |(row, made): (&Row, &Made)| {
        json!({
            "suspension": SUSPENSIONS[row.suspension].0,
            "scenario": SCENARIOS[row.manoeuvre],
            "case": row.case,
            "plant_gain_ratio": row.variation[0],
            "plant_stiffness_ratio": row.variation[1],
            "plant_delay_ratio": row.variation[2],
            "error_percent": {"left_max": made.figures[0], "left_rms": made.figures[1],
                "right_max": made.figures[2], "right_rms": made.figures[3]},
            "published_percent": MANOEUVRES[row.manoeuvre].published,
            "true_rms_percent": made.true_rms,
            "amplitude_n": made.amplitude_n,
            "force_lag_s": made.force_lag_s,
            "height_lag_s": made.height_lag_s,
            "estimated_lag_s": made.estimated_lag_s,
            "energy_w": made.energy_w,
            "tripped": made.tripped,
            "bound_ratio": row.bound,
            "kept": row.bound.map(|_| row.kept(made)),
        })
    };
    json!({
        "rows": rows.iter().zip(made).map(row).collect::<Vec<_>>(),
        "parts": parts.iter().map(|w| json!({"part": w.part, "figure": w.figure,
            "with_percent": w.with, "without_percent": w.without})).collect::<Vec<_>>(),
        "modes": modes.iter().map(|m| json!({"mode": m.name, "error_percent": m.figures, "steering": m.steer})).collect::<Vec<_>>(),
        "bounded": bounded(rows),
        "missed": missed,
        "seeds": seeds,
    })
}
