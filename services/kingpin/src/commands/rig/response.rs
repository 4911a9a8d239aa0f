//! `rig response`: how far and how fast the cylinders move, over frequency, open loop.
//!
//! The valve of a bare cylinder with its moving mass (no tie rod) is driven by a sine of full opening; where the stroke
//! would end at the stops, by so much less that it just does not. Strokes and speeds are the fundamental's.
//! Shape as in the published figures of such rigs (stroke and top speed of the actuators over frequency): stroke-limited
//! at first, then speed-limited (stroke ∝ 1/f), then the valve falls off.

use super::{Ended, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use clap::Args as ClapArgs;
use config::ResolvedBench;
use config::rig::HydraulicAxis;
use rig_plant::hydraulic::Cylinder;
use serde_json::json;
use std::f64::consts::TAU;
use std::path::PathBuf;

/// Arguments of `rig response`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Columns: frequency [Hz], stroke to each side [mm], top speed [m/s], valve opening used, for each axis.
Example:  kingpin rig response --set rig.plant.horizontal.supply_pressure_pa=1.4e7 --output response.html")]
pub struct ResponseArgs {
    /// Replace a value, as in `run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Write the figures as a page
    #[arg(long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// As JSON
    #[arg(long)]
    json: bool,
}

struct Point {
    frequency_hz: f64,
    stroke_m: f64,
    speed_m_s: f64,
    opening: f64,
}

/// Fundamental of the stroke under a valve sine of `opening`, after it has settled. [m]
fn stroke(axis: &HydraulicAxis, weight_n: f64, frequency_hz: f64, opening: f64) -> f64 {
    const STEPS: usize = 4000;
    // At least eight valve time constants, and two periods.
    let periods = (2.0_f64).max((0.1 * frequency_hz).ceil() + 1.0) as usize;
    let h = 1.0 / (frequency_hz * STEPS as f64);
    let inner = (h / 2e-5).ceil().max(1.0) as usize;
    let h_inner = h / inner as f64;
    let mut cylinder = Cylinder::new(axis, weight_n);
    let (mut x, mut v) = (0.0, 0.0);
    let mut sum = [0.0; 2];
    let mut drift = 0.0;
    for n in 0..(periods + 1) * STEPS {
        let phase = TAU * (n % STEPS) as f64 / STEPS as f64;
        for _ in 0..inner {
            // cos, so that the stroke starts at one end of its sine; a slow pull holds it centred against leakage.
            let command = (opening * phase.cos() - 0.05 * drift).clamp(-1.0, 1.0);
            let force = cylinder.step(command, x, v, h_inner) - weight_n;
            v += h_inner * force / axis.mass_kg;
            x += h_inner * v;
        }
        drift += 1.0 / STEPS as f64 * (x - drift);
        if n >= periods * STEPS {
            sum[0] += x * phase.cos();
            sum[1] += x * phase.sin();
        }
    }
    2.0 / STEPS as f64 * sum[0].hypot(sum[1])
}

fn sweep(axis: &HydraulicAxis, weight_n: f64, frequencies: &[f64]) -> Vec<Point> {
    frequencies
        .iter()
        .map(|&frequency_hz| {
            let reach = 0.98 * axis.stroke_m;
            let mut opening = 1.0;
            let mut at = f64::INFINITY;
            // No more than the stroke allows: speed times time, then corrected by what came out.
            let ideal = reach * TAU * frequency_hz
                / (axis.rated_flow_m3_s / axis.piston_area_m2
                    * (axis.supply_pressure_pa / axis.rated_drop_pa).sqrt());
            if ideal < 1.0 {
                opening = ideal;
            }
            for _ in 0..6 {
                at = stroke(axis, weight_n, frequency_hz, opening);
                if at <= reach {
                    break;
                }
                opening *= 0.98 * reach / at;
            }
            Point {
                frequency_hz,
                stroke_m: at.min(reach),
                speed_m_s: TAU * frequency_hz * at.min(reach),
                opening,
            }
        })
        .collect()
}

/// `kingpin rig response`.
pub fn response(args: &ResponseArgs) -> Result<Exit, Ended> {
    let resolved = ResolvedBench::load("slalom_120", &args.set)?;
    let p = &resolved.rig.plant;
    let frequencies: Vec<f64> = (0..33).map(|i| 0.1 * 10_f64.powf(f64::from(i) / 11.0)).collect();
    let axes = [
        ("horizontal", sweep(&p.horizontal, 0.0, &frequencies)),
        ("vertical", sweep(&p.vertical, p.vertical.mass_kg * 9.806_65, &frequencies)),
    ];
    let mut strokes =
        page::Figure::new("Stroke to each side", "frequency in Hz", "stroke in mm").log_axes(true, true);
    let mut speeds = page::Figure::new("Top speed", "frequency in Hz", "speed in m/s").log_axes(true, true);
    for (k, (name, points)) in axes.iter().enumerate() {
        let f: Vec<f64> = points.iter().map(|p| p.frequency_hz).collect();
        let mm: Vec<f64> = points.iter().map(|p| 1e3 * p.stroke_m).collect();
        let v: Vec<f64> = points.iter().map(|p| p.speed_m_s).collect();
        strokes.curve(name, &f, &mm, k + 1, if k == 0 { "solid" } else { "dash" });
        speeds.curve(name, &f, &v, k + 1, if k == 0 { "solid" } else { "dash" });
    }
    let mut rows = vec![
        ["f [Hz]", "horizontal [mm]", "[m/s]", "opening", "vertical [mm]", "[m/s]", "opening"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for (h, v) in axes[0].1.iter().zip(&axes[1].1) {
        let three = |p: &Point| {
            [format!("{:.3}", 1e3 * p.stroke_m), format!("{:.4}", p.speed_m_s), format!("{:.3}", p.opening)]
        };
        rows.push([vec![format!("{:.3}", h.frequency_hz)], three(h).to_vec(), three(v).to_vec()].concat());
    }
    if args.json {
        let point = |p: &Point| json!({"frequency_hz": p.frequency_hz, "stroke_m": p.stroke_m, "speed_m_s": p.speed_m_s, "valve_ratio": p.opening});
        let of = |k: usize| axes[k].1.iter().map(point).collect::<Vec<_>>();
        output::json(&json!({"horizontal": of(0), "vertical": of(1)}));
    } else {
        output::line(output::columns(&rows));
    }
    if let Some(path) = &args.output {
        let table = page::Table { title: "Open-loop response".to_owned(), rows };
        let about =
            "Bare cylinders with their moving mass, full valve opening, no more than the stroke allows";
        write(path, &page::html("Response of the rig's cylinders", about, &[table], &[strokes, speeds]))?;
        output::note(format!("  {}", path.display()));
    }
    Ok(Exit::Done)
}
