//! `blackbox` and `clean`: what a crash left in shared memory, saved and removed. Never another run's.

use crate::args::{BlackboxArgs, CleanArgs};
use crate::exit::Exit;
use crate::output;
use logger::blackbox::{BlackboxError, save};
use serde_json::json;
use std::collections::BTreeSet;
use table::Bench;

/// `kingpin blackbox`.
pub fn blackbox(args: &BlackboxArgs) -> Exit {
    let bench = match super::table::the_bench(args.name.as_deref()) {
        Ok(Some(bench)) => bench,
        Ok(None) => return Exit::BadInput,
        Err(error) => {
            output::note(error);
            return Exit::BadInput;
        }
    };
    match save(&bench, args.output.as_deref()) {
        Ok(saved) => {
            if args.json {
                output::json(&serde_json::to_value(&saved).unwrap_or_default());
            } else {
                output::line(&saved);
            }
            Exit::Done
        }
        Err(error) => {
            if args.json {
                output::json(&json!({ "error": error.to_string() }));
            } else {
                output::note(&error);
            }
            if matches!(error, BlackboxError::Nothing(_)) { Exit::BadInput } else { Exit::Unavailable }
        }
    }
}

/// Benches that have a directory of locks, with or without memory.
fn directories() -> impl Iterator<Item = String> {
    let entries = std::fs::read_dir(table::base_from_environment()).into_iter().flatten().flatten();
    let names = entries.filter(|entry| entry.path().is_dir()).map(|entry| entry.file_name());
    names.filter_map(|name| name.into_string().ok()).filter(|name| Bench::new(name).is_ok())
}

/// `kingpin clean`.
pub fn clean(args: &CleanArgs) -> Exit {
    let names = match &args.name {
        Some(name) => vec![name.clone()],
        None => match table::list_benches() {
            Ok(benches) => {
                let mut names: BTreeSet<_> = benches.iter().map(|b| b.as_str().to_owned()).collect();
                names.extend(directories());
                names.into_iter().collect()
            }
            Err(error) => {
                output::note(error);
                return Exit::Unavailable;
            }
        },
    };
    let mut exit = Exit::Done;
    for name in names {
        let removed = Bench::new(&name).and_then(|bench| {
            let lock = bench.lock()?;
            if let Some((region, pid)) = table::writers_alive(&bench)? {
                let what = format!("region {region} of bench {name}");
                return Err(table::TableError::Claimed { what, holder_pid: Some(pid) });
            }
            if !args.discard && !table::list_bench(&bench)?.is_empty() {
                output::note(format!("{name}: {}", supervisor::save_before_cleaning(&lock)));
            }
            supervisor::remove_left_overs(&lock)
        });
        match removed {
            Ok(count) => output::line(format!("{name}: removed {count} segments")),
            Err(error) => {
                // In use: never another run's.
                output::note(format!("{name}: left alone: {error}"));
                if args.name.is_some() {
                    exit = Exit::Unavailable;
                }
            }
        }
    }
    exit
}
