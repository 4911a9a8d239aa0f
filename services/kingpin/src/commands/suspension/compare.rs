//! `suspension compare`: the tie-rod force methods, and everything else that is solved, against a reference.

use super::arguments::{SuspensionCompareArgs, SuspensionMethod};
use super::columns::{Column, columns, variants};
use super::input::{Rows, SIDES, read};
use super::page::{Figure, Table, html};
use super::solve::{Solved, Solver};
use super::{Wrong, load_axle};
use crate::commands::log::write_whole;
use crate::exit::Exit;
use crate::output;
use config::axle::Axle;
use config::{Mistake, Violation};
use serde_json::json;

/// How far a quantity is from the reference.
#[derive(Debug, Clone, Copy)]
struct Error {
    max: f64,
    rms: f64,
    /// Largest |reference|.
    peak: f64,
}

fn error(ours: &[f64], reference: &[f64]) -> Error {
    let off = || ours.iter().zip(reference).map(|(a, b)| (a - b).abs());
    let square: f64 = off().map(|e| e * e).sum();
    Error {
        max: off().fold(0.0, f64::max),
        rms: (square / ours.len().max(1) as f64).sqrt(),
        peak: reference.iter().fold(0.0, |m, x| m.max(x.abs())),
    }
}

/// One method's tie-rod forces.
struct Method {
    name: &'static str,
    force: [Vec<f64>; 2],
}

/// What is compared: a reference, its rows solved.
struct Comparison<'a> {
    rows: &'a Rows,
    solved: Vec<Solved>,
    columns: Vec<Column>,
}

impl Comparison<'_> {
    /// A column as we have it.
    fn ours(&self, name: &str) -> Option<Vec<f64>> {
        let column = self.columns.iter().find(|c| c.name == name)?;
        Some(self.solved.iter().map(|row| (column.read)(row)).collect())
    }

    /// The reference's tie-rod force of a side: of the axle as it is.
    fn tie(&self, suffix: &str, k: usize) -> Option<&[f64]> {
        let named = self.rows.column(&format!("tie{suffix}_{}", SIDES[k]));
        named.or_else(|| self.rows.column(&format!("tie_{}", SIDES[k])))
    }

    fn methods(&self, axle: &Axle) -> Vec<Method> {
        let mut named: Vec<(&'static str, String)> = Vec::new();
        let suffixes = variants(axle);
        named.push(("multibody", format!("tie{}", suffixes[0])));
        if let Some(without) = suffixes.get(1) {
            named.push(("multibody without stabiliser", format!("tie{without}")));
        }
        named.push(("map", "tie_map".to_owned()));
        named.push(("simple", "tie_simple".to_owned()));
        named.push(("map_thesis", "tie_map_thesis".to_owned()));
        let force =
            |stem: &str| [0, 1].map(|k| self.ours(&format!("{stem}_{}", SIDES[k])).unwrap_or_default());
        named.into_iter().map(|(name, stem)| Method { name, force: force(&stem) }).collect()
    }

    /// What the curves run over: the input that moves most, else the rows.
    fn abscissa(&self) -> (&'static str, Vec<f64>) {
        let read = |f: fn(&Solved) -> f64| self.solved.iter().map(f).collect::<Vec<f64>>();
        let span =
            |v: &[f64]| v.iter().fold(f64::MIN, |m, x| m.max(*x)) - v.iter().fold(f64::MAX, |m, x| m.min(*x));
        let rack = read(|row| row.input.rack_m * 1e3);
        let left = read(|row| row.input.wheel_height_m[0] * 1e3);
        let monotonic = |v: &[f64]| v.is_sorted() || v.iter().rev().is_sorted();
        if span(&rack) > 0.0 && monotonic(&rack) {
            ("rack in mm", rack)
        } else if span(&left) > 0.0 && monotonic(&left) {
            ("left wheel travel in mm", left)
        } else {
            ("step", read(|row| row.step))
        }
    }
}

/// `kingpin suspension compare`.
pub fn compare(args: &SuspensionCompareArgs) -> Result<Exit, Wrong> {
    let axle = load_axle(&args.axle)?;
    let mut solver = Solver::new(&args.axle, &axle, SuspensionMethod::All, args.lock_springs)?;
    let columns = columns(&axle, SuspensionMethod::All, solver.design());
    let plain: Vec<String> = SIDES.iter().map(|side| format!("tie_{side}")).collect();
    let known = |name: &str| plain.iter().any(|p| p == name) || columns.iter().any(|c| c.name == name);
    let mut rows = read(&args.reference, !args.lock_springs, known)?;
    if rows.further.is_empty() {
        let rule = "has no column to compare with (such as tie_L or toe_L, as `solve` writes them)";
        return Err(Violation::of_file(Mistake::MissingKey, rows.name, rule).to_string());
    }
    let (mut solved, failed) = solver.solve_all(&rows);
    // A row that was not solved holds another row's numbers: no error of a method.
    let good: Vec<bool> = solved.iter().map(|row| row.status == 0).collect();
    for (_, values) in &mut rows.further {
        let mut good = good.iter();
        values.retain(|_| good.next().is_some_and(|g| *g));
    }
    solved.retain(|row| row.status == 0);
    if solved.is_empty() {
        output::note(format!("{}: no row was solved", rows.name));
        return Ok(Exit::Failed);
    }
    let comparison = Comparison { rows: &rows, solved, columns };
    let methods = comparison.methods(&axle);
    let truth = [0, 1].map(|k| comparison.tie(variants(&axle)[0], k));

    let mut forces = vec![
        [
            "tie-rod force method",
            "max left [N]",
            "max right [N]",
            "rms left [N]",
            "rms right [N]",
            "max of peak",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    let mut forces_json = Vec::new();
    if let [Some(left), Some(right)] = truth {
        let peak = error(left, left).peak.max(error(right, right).peak);
        for method in &methods {
            let [l, r] = [error(&method.force[0], left), error(&method.force[1], right)];
            let share = l.max.max(r.max) / peak.max(1e-300);
            let newtons = [l.max, r.max, l.rms, r.rms].map(brief);
            let mut row = vec![method.name.to_owned()];
            row.extend(newtons);
            row.push(if share < 1e-4 { format!("{share:.1e}") } else { format!("{:.2} %", share * 100.0) });
            forces.push(row);
            forces_json.push(json!({
                "method": method.name, "max_n": [l.max, r.max], "rms_n": [l.rms, r.rms], "peak_n": peak,
            }));
        }
    }
    let mut others = vec![
        ["quantity (multibody)", "columns", "max error", "peak", "max of peak"].map(str::to_owned).to_vec(),
    ];
    let mut others_json = Vec::new();
    for (stem, count, worst) in quantities(&comparison) {
        let share = worst.max / worst.peak.max(1e-300);
        let share = if worst.peak > 0.0 { format!("{share:.1e}") } else { "–".to_owned() };
        others.push(vec![
            stem.clone(),
            count.to_string(),
            format!("{:.1e}", worst.max),
            brief(worst.peak),
            share,
        ]);
        others_json.push(json!({"quantity": stem, "columns": count, "max": worst.max, "rms": worst.rms, "peak": worst.peak}));
    }
    if let Some(path) = &args.output {
        let tables = [
            Table { title: "Tie-rod force against the reference".to_owned(), rows: forces.clone() },
            Table { title: "Everything else that both have".to_owned(), rows: others.clone() },
        ];
        let tables: Vec<Table> = tables.into_iter().filter(|t| t.rows.len() > 1).collect();
        let figures = figures(&comparison, &methods, truth);
        let about =
            format!("{} against {}, {} rows. SI units; tension +.", args.axle, rows.name, rows.rows.len());
        let page = html(&format!("{}: tie-rod force methods", axle.name), &about, &tables, &figures);
        write_whole(path, |to| to.write_all(page.as_bytes()).map_err(|e| e.to_string()))?;
    }
    if args.json {
        output::json(&json!({
            "axle": axle.name, "rows": rows.rows.len(), "failed_rows": failed,
            "methods": forces_json, "quantities": others_json,
        }));
    } else {
        for table in [&forces, &others] {
            if table.len() > 1 {
                output::line(output::columns(table));
            }
        }
    }
    Ok(if failed > 0 { Exit::Failed } else { Exit::Done })
}

/// Errors of the multibody solution by quantity: columns of one name, axes and sides together. The inputs are
/// no quantities.
fn quantities(comparison: &Comparison) -> Vec<(String, usize, Error)> {
    let mut found: Vec<(String, usize, Error)> = Vec::new();
    for (name, reference) in &comparison.rows.further {
        let Some(ours) = comparison.ours(name) else { continue };
        let stem = name.strip_suffix("_L").or(name.strip_suffix("_R")).unwrap_or(name);
        let stem = ["_x", "_y", "_z"].iter().fold(stem.to_owned(), |s, axis| {
            let inner = s.replace(&format!("{axis}_"), "_");
            inner.strip_suffix(axis).map_or(inner.clone(), str::to_owned)
        });
        let here = error(&ours, reference);
        match found.iter_mut().find(|(s, _, _)| *s == stem) {
            Some((_, count, worst)) => {
                *count += 1;
                worst.max = worst.max.max(here.max);
                worst.rms = worst.rms.max(here.rms);
                worst.peak = worst.peak.max(here.peak);
            }
            None => found.push((stem, 1, here)),
        }
    }
    found
}

fn figures(comparison: &Comparison, methods: &[Method], truth: [Option<&[f64]>; 2]) -> Vec<Figure> {
    let (label, x) = comparison.abscissa();
    let mut figures = Vec::new();
    let minus = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
    for (k, side) in ["left", "right"].iter().enumerate() {
        let Some(truth) = truth[k] else { continue };
        let mut force = Figure::new(&format!("Tie-rod force, {side}"), label, "N");
        let mut off = Figure::new(&format!("Tie-rod force, {side}: method − reference"), label, "N");
        force.curve("reference", &x, truth, 0, "solid");
        for (m, method) in methods.iter().enumerate() {
            let dash = ["dash", "dashdot", "dot", "longdash", "longdashdot"][m % 5];
            force.curve(method.name, &x, &method.force[k], 1 + m, dash);
            off.curve(method.name, &x, &minus(&method.force[k], truth), 1 + m, dash);
        }
        let mut exact = Figure::new(&format!("Tie-rod force, {side}: multibody − reference"), label, "N");
        exact.curve("multibody", &x, &minus(&methods[0].force[k], truth), 1, "solid");
        figures.extend([force, off, exact]);
    }
    // Positions: how far a point is from where the reference has it.
    for (point, title) in [("lbj", "Lower ball joint"), ("to", "Tie-rod outer ball"), ("wc", "Wheel centre")]
    {
        let mut figure = Figure::new(&format!("{title}: distance from the reference"), label, "mm");
        for (k, side) in ["left", "right"].iter().enumerate() {
            for (m, map) in ["", "_map"].iter().enumerate() {
                let mut square = vec![0.0; x.len()];
                for axis in ["x", "y", "z"] {
                    let truth = comparison.rows.column(&format!("{point}_{axis}_{}", SIDES[k]));
                    let ours = comparison.ours(&format!("{point}_{axis}{map}_{}", SIDES[k]));
                    let (Some(truth), Some(ours)) = (truth, ours) else { continue };
                    for ((s, a), b) in square.iter_mut().zip(&ours).zip(truth) {
                        *s += 1e6 * (a - b) * (a - b);
                    }
                }
                let there = comparison.rows.column(&format!("{point}_x_{}", SIDES[k])).is_some();
                if there {
                    let distance: Vec<f64> = square.iter().map(|s| s.sqrt()).collect();
                    let name = format!("{}, {side}", ["multibody", "map"][m]);
                    figure.curve(&name, &x, &distance, 1 + m, ["solid", "dash"][k]);
                }
            }
        }
        if !figure.is_empty() {
            figures.push(figure);
        }
    }
    for (angle, title) in
        [("toe", "Toe"), ("camber", "Camber"), ("caster", "Caster"), ("kpi", "Kingpin inclination")]
    {
        let mut figure = Figure::new(title, label, "°");
        let degrees = |v: &[f64]| v.iter().map(|a| a.to_degrees()).collect::<Vec<f64>>();
        for (k, side) in ["left", "right"].iter().enumerate() {
            let Some(truth) = comparison.rows.column(&format!("{angle}_{}", SIDES[k])) else { continue };
            let dash = ["solid", "dash"][k];
            figure.curve(&format!("reference, {side}"), &x, &degrees(truth), 0, dash);
            for (m, map) in ["", "_map"].iter().enumerate() {
                let ours = comparison.ours(&format!("{angle}{map}_{}", SIDES[k])).unwrap_or_default();
                let name = format!("{}, {side}", ["multibody", "map"][m]);
                figure.curve(&name, &x, &degrees(&ours), 1 + m, "dot");
            }
        }
        if !figure.is_empty() {
            figures.push(figure);
        }
    }
    figures
}

/// A number with four significant digits, small ones by their power of ten.
fn brief(x: f64) -> String {
    if x != 0.0 && x.abs() < 0.01 {
        return format!("{x:.1e}");
    }
    let before = if x == 0.0 { 1 } else { x.abs().log10().floor() as i32 + 1 };
    format!("{x:.*}", (4 - before).clamp(0, 6) as usize)
}
