//! `suspension`: an axle on its own, away from any bench.

mod arguments;
mod columns;
mod compare;
mod compliance;
mod curves;
mod input;
pub mod page;
mod solve;

pub use arguments::SuspensionArgs;

use crate::exit::Exit;
use crate::output;
use arguments::{SuspensionCommand, SuspensionDescribeArgs};
use config::axle::Axle;
use config::{Mistake, Problems, Violation};
use multibody::{Suspension, SuspensionDescription};
use serde_json::json;
use std::path::Path;

/// Largest hardpoint file. [bytes]
const HARDPOINTS_BYTES_MAX: u64 = 8 << 20;

/// `kingpin suspension`.
pub fn suspension(args: &SuspensionArgs) -> Exit {
    let ended = match &args.command {
        SuspensionCommand::Solve(args) => solve::solve(args),
        SuspensionCommand::Curves(args) => curves::curves(args),
        SuspensionCommand::Describe(args) => describe(args),
        SuspensionCommand::Compare(args) => compare::compare(args),
        SuspensionCommand::Compliance(args) => compliance::compliance(args),
    };
    ended.unwrap_or_else(|wrong| {
        output::note(wrong);
        Exit::BadInput
    })
}

/// What ends a command early: all that is wrong, ready to print.
type Wrong = String;

/// Reads a text file of bounded size.
pub fn read_text(path: &Path, bytes_max: u64) -> Result<String, Wrong> {
    let name = path.display().to_string();
    let fail = |mistake, rule: String| Violation::of_file(mistake, name.clone(), rule).to_string();
    let about = std::fs::metadata(path).map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => fail(Mistake::NotFound, "no such file".to_owned()),
        _ => fail(Mistake::Unreadable, format!("cannot be read: {error}")),
    })?;
    if !about.is_file() {
        return Err(fail(Mistake::Unreadable, "is not a regular file".to_owned()));
    }
    if about.len() > bytes_max {
        let rule = format!("is too large: {} bytes, at most {bytes_max}", about.len());
        return Err(fail(Mistake::Unreadable, rule));
    }
    let bytes =
        std::fs::read(path).map_err(|error| fail(Mistake::Unreadable, format!("cannot be read: {error}")))?;
    String::from_utf8(bytes).map_err(|_| fail(Mistake::Unreadable, "is not UTF-8 text".to_owned()))
}

/// An axle from a TOML file, a shipped name or a hardpoint .json file.
fn load_axle(reference: &str) -> Result<Axle, Wrong> {
    let path = Path::new(reference);
    if !path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        return config::load::<Axle>(reference).map(|loaded| loaded.value).map_err(|p| p.to_string());
    }
    let text = read_text(path, HARDPOINTS_BYTES_MAX)?;
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    Axle::from_hardpoint_json(text.trim_start_matches('\u{feff}'), &stem).map_err(|broken| {
        let mut problems = Problems::default();
        for broken in broken {
            let violation = Violation::of_file(Mistake::Reference, reference, broken.rule);
            problems.push(Violation { key: broken.key, ..violation });
        }
        problems.to_string()
    })
}

/// Assembles an axle's solver.
fn assemble(reference: &str, axle: &Axle) -> Result<Suspension, Wrong> {
    Suspension::new(axle).map_err(|error| format!("{reference}: {error}"))
}

/// The models of an axle: as it is and, where it has a stabiliser, without it.
fn models(reference: &str, axle: &Axle) -> Result<Vec<(&'static str, SuspensionDescription)>, Wrong> {
    let mut models = vec![("", assemble(reference, axle)?.describe())];
    if axle.stabiliser.is_some() {
        models[0].0 = "with stabiliser";
        let without = assemble(reference, &axle.without_stabiliser())?;
        models.push(("without stabiliser", without.describe()));
    }
    Ok(models)
}

/// `kingpin suspension describe`.
fn describe(args: &SuspensionDescribeArgs) -> Result<Exit, Wrong> {
    let axle = load_axle(&args.axle)?;
    let mut lines = Vec::new();
    let mut listed = Vec::new();
    let mut totals = vec![vec!["model".to_owned(), "coordinates".to_owned(), "equations".to_owned()]];
    for (variant, model) in models(&args.axle, &axle)? {
        // With bushings, one equilibrium is both stages.
        let stages = if model.bushings.is_empty() {
            vec![("kinematic", &model.kinematic), ("reaction", &model.reaction)]
        } else {
            vec![("with bushings", &model.kinematic)]
        };
        for (stage, what) in stages {
            let name = [axle.name.as_str(), variant, stage].into_iter().filter(|s| !s.is_empty());
            let name = name.collect::<Vec<_>>().join(", ");
            totals.push(vec![name.clone(), what.coordinates.to_string(), what.rows.to_string()]);
            lines.push(format!("{name}\n  bodies: {}", what.bodies.join(", ")));
            let mut rows = vec![["  rows", "kind", "constraint", "between"].map(str::to_owned).to_vec()];
            for c in &what.constraints {
                let first = c.body_i.as_deref().unwrap_or("ground");
                let between = format!("{first} – {}", c.body_j);
                rows.push(vec![format!("  {}", c.rows), c.kind.to_owned(), c.name.clone(), between]);
            }
            lines.push(output::columns(&rows).trim_end().to_owned());
            let sums =
                what.by_kind().into_iter().map(|(kind, count, rows)| format!("{kind} {count} ({rows})"));
            lines.push(format!("  in all: {}", sums.collect::<Vec<_>>().join(", ")));
            lines.push(format!("  {} equations for {} coordinates\n", what.rows, what.coordinates));
            let constraints = what.constraints.iter().map(|c| {
                json!({
                    "name": c.name, "kind": c.kind, "rows": c.rows,
                    "body_i": c.body_i, "body_j": c.body_j,
                })
            });
            let kinds = what.by_kind().into_iter();
            let kinds = kinds.map(|(kind, count, rows)| json!({"kind": kind, "count": count, "rows": rows}));
            listed.push(json!({
                "model": name, "variant": variant, "stage": stage,
                "bodies": what.bodies, "constraints": constraints.collect::<Vec<_>>(),
                "by_kind": kinds.collect::<Vec<_>>(),
                "coordinates": what.coordinates, "rows": what.rows,
            }));
        }
        if !model.bushings.is_empty() {
            let rest = model.kinematic.coordinates.saturating_sub(model.kinematic.rows);
            lines.push(format!(
                "bushings: {}\n  their stiffness holds what the equations leave free ({rest} coordinates, the rack's given stroke among them)\n",
                model.bushings.join(", ")
            ));
        }
    }
    if args.json {
        let bushings: Vec<_> = axle.bushings.iter().flat_map(|b| b.keys()).collect();
        output::json(&json!({ "axle": axle.name, "models": listed, "bushings": bushings }));
    } else {
        lines.push(output::columns(&totals).trim_end().to_owned());
        output::line(lines.join("\n"));
    }
    Ok(Exit::Done)
}
