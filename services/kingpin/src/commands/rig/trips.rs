//! `rig trips`: every trip of the safety monitor provoked on the running virtual rig, with its reaction in ticks.

use super::{Ended, cell, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use assembly::trips::demonstrate;
use clap::Args as ClapArgs;
use config::ResolvedBench;
use safety::TripCode;
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `rig trips`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Columns: code and name of the trip; what was done; limit and the value that broke it; time that the rule itself takes
(two sensors must disagree for a while, a reading must stand still for a while) [ticks]; reaction: ticks beyond that to
the tick whose own output is the first command of the safe state (1: that of the cause itself); fade of the force in
that output (below 1: it ramps; the vertical axes are frozen and the steer torque is off in the same output); true
tie-rod force before and 0.2 s after the trip [N].
Exit code 1 when a trip is missing, is another one, or comes later than one tick.")]
pub struct TripsArgs {
    /// Scenario whose rig and steering unit are taken
    #[arg(long, default_value = "slalom_120", value_name = "SCENARIO")]
    scenario: String,
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

/// `kingpin rig trips`.
pub fn trips(args: &TripsArgs) -> Result<Exit, Ended> {
    let resolved = ResolvedBench::load(&args.scenario, &args.set)?;
    let list = demonstrate(&resolved.rig, &resolved.unit, resolved.scenario.seed)?;
    let missing: Vec<TripCode> =
        TripCode::ALL.into_iter().filter(|code| !list.iter().any(|d| d.wanted == *code)).collect();
    let kept = list.iter().filter(|d| d.kept()).count();
    let mut rows = vec![
        [
            "code",
            "trip",
            "provoked by",
            "limit",
            "value",
            "unit",
            "rule [ticks]",
            "reaction [ticks]",
            "fade",
            "force before, after [N]",
            "",
        ]
        .map(str::to_owned)
        .to_vec(),
    ];
    for d in &list {
        let (name, unit) = d.wanted.describe();
        let (limit, value) = d.trip.map_or((f64::NAN, f64::NAN), |trip| (trip.limit, trip.value));
        rows.push(vec![
            (d.wanted as u8).to_string(),
            name.to_owned(),
            d.cause.to_owned(),
            cell(limit, 4),
            cell(value, 4),
            unit.to_owned(),
            d.rule_ticks.to_string(),
            if d.trip.is_some() { d.reaction_ticks().to_string() } else { "–".to_owned() },
            cell(d.fade.force, 3),
            format!("{} {}", cell(d.force_n[0], 0), cell(d.force_n[1], 0)),
            match d.trip {
                _ if d.kept() => "kept".to_owned(),
                Some(trip) if trip.code != d.wanted => format!("TRIPPED BY {}", trip.code.describe().0),
                Some(_) => "LATE".to_owned(),
                None => "NO TRIP".to_owned(),
            },
        ]);
    }
    let verdict =
        format!("{kept} of {} trips within one tick; codes not provoked: {}", list.len(), missing.len());
    if args.json {
        let of = |d: &assembly::trips::Demonstrated| {
            json!({"code": d.wanted as u8, "name": d.wanted.describe().0, "cause": d.cause,
                "limit": d.trip.map(|t| t.limit), "value": d.trip.map(|t| t.value),
                "tripped_by": d.trip.map(|t| t.code as u8), "rule_ticks": d.rule_ticks,
                "reaction_ticks": d.trip.map(|_| d.reaction_ticks()), "force_fade_ratio": d.fade.force,
                "force_before_after_n": d.force_n, "kept": d.kept()})
        };
        output::json(&json!({"trips": list.iter().map(of).collect::<Vec<_>>(), "kept": kept,
            "not_provoked": missing.iter().map(|code| *code as u8).collect::<Vec<_>>()}));
    } else {
        output::line(output::columns(&rows));
        output::line(&verdict);
    }
    if let Some(path) = &args.output {
        let table = page::Table { title: "Trips".to_owned(), rows };
        let page = page::html("Trips of the safety monitor", &verdict, &[table], &[]);
        output::note(format!("  {}", write(path, &page)?.display()));
    }
    Ok(if kept == list.len() && missing.is_empty() { Exit::Done } else { Exit::Failed })
}
