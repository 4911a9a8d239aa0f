//! `list`, `check`, `schema`: configuration without running it.

use crate::args::{CheckArgs, ListArgs, ListKind, SchemaArgs, SchemaSection};
use crate::exit::Exit;
use crate::output;
use config::ResolvedBench;
use config::library::{Kind, Library};
use std::collections::BTreeSet;

fn kind_of(kind: ListKind) -> Kind {
    match kind {
        ListKind::Scenarios => Kind::Scenario,
        ListKind::Cars => Kind::Car,
        ListKind::Suspensions => Kind::Suspension,
        ListKind::Tyres => Kind::Tyre,
        ListKind::Rigs => Kind::Rig,
        ListKind::Units => Kind::Unit,
        ListKind::Models => Kind::Model,
        ListKind::Can => Kind::Can,
        ListKind::Campaigns => Kind::Campaign,
        ListKind::Studies => Kind::Study,
    }
}

/// `kingpin list`.
pub fn list(args: &ListArgs) -> Exit {
    if let (Some(kind), Some(name)) = (args.kind, &args.show) {
        return match Library::get(kind_of(kind), name) {
            Some(shipped) => {
                output::line(shipped.text.trim_end());
                Exit::Done
            }
            None => {
                let hint = Library::closest(kind_of(kind), name);
                let hint = hint.map(|name| format!(" (did you mean `{name}`?)")).unwrap_or_default();
                output::note(format!("nothing of that kind is shipped as `{name}`{hint}"));
                Exit::BadInput
            }
        };
    }
    let all = [
        ListKind::Scenarios,
        ListKind::Cars,
        ListKind::Suspensions,
        ListKind::Tyres,
        ListKind::Rigs,
        ListKind::Units,
        ListKind::Models,
        ListKind::Can,
        ListKind::Campaigns,
        ListKind::Studies,
    ];
    let kinds = args.kind.map_or(all.to_vec(), |kind| vec![kind]);
    let mut json = serde_json::Map::new();
    for kind in kinds {
        let directory = kind_of(kind).directory();
        // A leading underscore marks files that others extend.
        let shipped: Vec<_> =
            Library::list(kind_of(kind)).into_iter().filter(|s| !s.name.starts_with('_')).collect();
        if args.json {
            let items = shipped.iter().map(
                |s| serde_json::json!({"name": s.name, "description": describe(s.text), "path": s.file_name}),
            );
            json.insert(directory.to_owned(), items.collect());
            continue;
        }
        output::line(format!("{directory}:"));
        let rows: Vec<_> = shipped.iter().map(|s| vec![format!("  {}", s.name), describe(s.text)]).collect();
        output::line(output::columns(&rows));
    }
    if args.json {
        output::json(&serde_json::Value::Object(json));
    }
    Exit::Done
}

/// What a file says of itself: its `description`, else its first comment line.
fn describe(text: &str) -> String {
    let described = text.lines().find_map(|line| {
        let value = line
            .trim()
            .strip_prefix("description")
            .or_else(|| line.trim().strip_prefix("about"))?
            .trim_start()
            .strip_prefix('=')?;
        Some(value.trim().trim_matches(['"', '\'']).to_owned())
    });
    let comment = || {
        let mark = |c: char| c == '#' || c == '!' || c == '$' || c == ' ' || c == '-';
        let words = |line: &&str| line.starts_with(['#', '!', '$']) && line.contains(char::is_alphabetic);
        text.lines().find(words).map(|line| line.trim_matches(mark).to_owned())
    };
    described.filter(|d| !d.is_empty()).or_else(comment).unwrap_or_default()
}

/// Loads a bench and builds all that is in it once, so that whatever does not fit is said, all of it, before anything
/// runs or is written. What is wrong is said already.
pub(super) fn load(scenario: &str, overrides: &[String], json: bool) -> Result<ResolvedBench, Exit> {
    let resolved = super::history::load_bench(scenario, overrides).map_err(|problems| {
        if json {
            output::json(&problems.to_json());
        } else {
            output::note(&problems);
        }
        Exit::BadInput
    })?;
    let models = assembly::ServiceKind::ALL.map(|kind| assembly::build(kind, &resolved).map(drop));
    let can = assembly::CanParts::new(&resolved).map(drop);
    let mut wrong: Vec<String> =
        models.into_iter().chain([can]).filter_map(Result::err).map(|error| error.to_string()).collect();
    if let Err(refused) = params::Schedule::new(&resolved) {
        wrong.extend(refused.iter().map(|refusal| format!("{}: {refusal}", resolved.scenario.name)));
    }
    // A file that several services use is wrong for each of them.
    let mut told = BTreeSet::new();
    wrong.retain(|error| told.insert(error.clone()));
    if wrong.is_empty() {
        Ok(resolved)
    } else {
        Err(super::run::say(json, Exit::BadInput, &wrong.join("\n")))
    }
}

/// `kingpin check`.
pub fn check(args: &CheckArgs) -> Exit {
    let resolved = match load(&args.scenario, &args.set, args.json) {
        Ok(resolved) => resolved,
        Err(exit) => return exit,
    };
    if let Err(error) = assembly::check_fmus(&resolved, false) {
        return super::run::say(args.json, Exit::BadInput, &error.to_string());
    }
    // Sound, but perhaps for lockstep only.
    if let Err(error) = assembly::check_fmus(&resolved, true) {
        output::note(error);
    }
    if args.json {
        output::json(&serde_json::json!({ "valid": true, "hash": resolved.hash() }));
    } else {
        output::line(format!("{}: valid, configuration {}", args.scenario, &resolved.hash()[..12]));
    }
    Exit::Done
}

/// `kingpin schema`.
pub fn schema(args: &SchemaArgs) -> Exit {
    output::json(&match args.section {
        SchemaSection::Scenario => config::schema_json::<config::scenario::Scenario>(),
        SchemaSection::Car => config::schema_json::<config::car::Car>(),
        SchemaSection::Axle => config::schema_json::<config::axle::Axle>(),
        SchemaSection::Rig => config::schema_json::<config::rig::Rig>(),
        SchemaSection::Model => serde_json::from_str(functional_model::schema::JSON).unwrap_or_default(),
        SchemaSection::Can => config::schema_json::<config::can::Can>(),
        SchemaSection::Campaign => config::schema_json::<config::campaign::Campaign>(),
        SchemaSection::Study => config::schema_json::<config::study::Study>(),
        SchemaSection::Unit => config::schema_json::<config::unit::SteeringUnit>(),
    });
    Exit::Done
}
