//! `table show`: looking into shared memory, live or left over, without touching anybody.

use crate::args::{TableArgs, TableCommand, TableShowArgs};
use crate::exit::Exit;
use crate::output;
use regions::{Kind, REGIONS, Region, region_by_name};
use serde_json::{Value, json};
use std::time::Duration;
use table::{Bench, Read, RegionReader, TableError};

/// Time between two looks of `--watch`.
const WATCH: Duration = Duration::from_millis(200);

/// `kingpin table`.
pub fn table(args: &TableArgs) -> Exit {
    let TableCommand::Show(args) = &args.command;
    match show(args) {
        Ok(exit) => exit,
        Err(error) => {
            output::note(error);
            Exit::Unavailable
        }
    }
}

fn show(args: &TableShowArgs) -> Result<Exit, TableError> {
    let Some(bench) = the_bench(args.name.as_deref())? else {
        return Ok(Exit::BadInput);
    };
    let region = match &args.region {
        Some(name) => match region_by_name(name) {
            Some((_, region)) => Some(region),
            None => {
                let names: Vec<_> = REGIONS.iter().map(|r| r.name).collect();
                output::note(format!("no region `{name}`; there are {}", names.join(", ")));
                return Ok(Exit::BadInput);
            }
        },
        None => None,
    };
    loop {
        match region {
            Some(region) => show_region(&bench, region, args)?,
            None => show_all(&bench, args)?,
        }
        if !args.watch {
            return Ok(Exit::Done);
        }
        std::thread::sleep(WATCH);
    }
}

/// The bench of that name, or the only one there is. Says on standard error why there is none.
pub fn the_bench(name: Option<&str>) -> Result<Option<Bench>, TableError> {
    if let Some(name) = name {
        return Bench::new(name).map(Some);
    }
    let benches = table::list_benches()?;
    match benches.as_slice() {
        [one] => Bench::new(one.as_str()).map(Some),
        [] => {
            output::note("no bench has a table: none is running and none has crashed");
            Ok(None)
        }
        many => {
            let names: Vec<_> = many.iter().map(|b| b.as_str()).collect();
            output::note(format!("several benches have a table; name one with --name: {}", names.join(", ")));
            Ok(None)
        }
    }
}

/// What the header of a region says, with the age of its newest tick.
fn describe(reader: &RegionReader) -> Value {
    let header = reader.header();
    let writer = header.writer();
    let alive = writer.is_some_and(table::is_alive);
    let head = reader.head();
    // Age in ticks by the clock; a left-over table goes on ageing.
    let now_tick = header
        .t0_ns()
        .filter(|&t0| t0 > 1)
        .map(|t0| table::monotonic_ns().saturating_sub(t0) / header.period_ns().max(1));
    json!({
        "region": reader.name(),
        "newest_tick": head.checked_sub(1),
        "age_ticks": now_tick.and_then(|now| (now + 1).checked_sub(head)),
        "epoch": header.epoch(),
        "writer_pid": writer.map(|w| w.pid),
        "writer_alive": alive,
        "words": reader.words(),
        "depth": reader.depth(),
        "period_ns": header.period_ns(),
        "run_id": header.run_id(),
        "layout": reader.layout().to_string(),
    })
}

fn text(value: &Value) -> String {
    match value {
        Value::Null => "-".to_owned(),
        Value::String(text) => text.clone(),
        Value::Bool(yes) => (if *yes { "yes" } else { "no" }).to_owned(),
        other => other.to_string(),
    }
}

fn show_all(bench: &Bench, args: &TableShowArgs) -> Result<(), TableError> {
    let mut rows = vec![
        ["region", "newest tick", "age [ticks]", "epoch", "writer", "alive", "words", "depth"]
            .map(str::to_owned)
            .to_vec(),
    ];
    let mut values = Vec::new();
    for found in table::list_bench(bench)? {
        match RegionReader::open_any(bench, &found.region) {
            Ok(reader) => {
                let value = describe(&reader);
                let keys = [
                    "region",
                    "newest_tick",
                    "age_ticks",
                    "epoch",
                    "writer_pid",
                    "writer_alive",
                    "words",
                    "depth",
                ];
                rows.push(keys.iter().map(|key| text(&value[key])).collect());
                values.push(value);
            }
            Err(error) => {
                rows.push(vec![found.region.clone(), error.to_string()]);
                values.push(json!({"region": found.region, "error": error.to_string()}));
            }
        }
    }
    if values.is_empty() {
        output::note(format!("bench `{}` has no table", bench.name()));
    }
    if args.json {
        let all = json!({"bench": bench.name().as_str(), "supervisor_pid": bench.supervisor_pid()?, "regions": values});
        if args.watch { output::line(all) } else { output::json(&all) }
    } else {
        let supervisor = match bench.supervisor_pid()? {
            Some(pid) => format!("supervisor {pid}"),
            None => "no supervisor".to_owned(),
        };
        output::line(format!("bench {}, {supervisor}", bench.name()));
        output::line(output::columns(&rows));
    }
    Ok(())
}

fn show_region(bench: &Bench, region: &'static Region, args: &TableShowArgs) -> Result<(), TableError> {
    let reader = RegionReader::open_any(bench, region.name)?;
    let head = describe(&reader);
    let ours = region.layout;
    let theirs = reader.layout();
    let known = theirs.hash == ours.hash() && theirs.version == ours.version;
    let mut words = vec![0; reader.words()];
    let mut state = "ready";
    let tick = match args.tick {
        Some(n) => match reader.read(n, &mut words) {
            Read::Ready => Some(n),
            Read::NotYet => {
                state = "not yet published";
                None
            }
            Read::Missing => {
                state = "missing: skipped, or its writer died in it";
                None
            }
            Read::Overwritten => {
                state = "overwritten: older than the history";
                None
            }
        },
        None => reader.latest(reader.head(), &mut words).map(|latest| latest.tick),
    };
    let value = |kind: Kind, word: u64| match kind {
        Kind::F64 => {
            let number = f64::from_bits(word);
            if number.is_finite() { json!(number) } else { json!(number.to_string()) }
        }
        Kind::U64 if word == u64::MAX => json!("none"),
        Kind::U64 => json!(word),
    };
    if args.json {
        let content: serde_json::Map<_, _> = match (tick, known) {
            (Some(_), true) => {
                ours.columns().iter().map(|c| (c.name.clone(), value(c.kind, words[c.word]))).collect()
            }
            _ => serde_json::Map::new(),
        };
        let all = json!({"header": head, "tick": tick, "state": state, "content": content});
        if args.watch {
            output::line(all)
        } else {
            output::json(&all)
        }
        return Ok(());
    }
    let age = text(&head["age_ticks"]);
    output::line(format!(
        "{}: tick {}, age {age} ticks, epoch {}, writer {} ({})",
        region.name,
        tick.map_or("-".to_owned(), |n| n.to_string()),
        text(&head["epoch"]),
        text(&head["writer_pid"]),
        if head["writer_alive"] == json!(true) { "alive" } else { "not alive" },
    ));
    if !known {
        output::line(format!("  its layout is not this version's: there {theirs}; here {}", ours.hash()));
    } else if tick.is_none() {
        output::line(format!("  {state}"));
    } else {
        let rows: Vec<_> = ours
            .columns()
            .iter()
            .map(|c| {
                let shown = match c.kind {
                    Kind::F64 => format!("{:>16.6}", f64::from_bits(words[c.word])),
                    Kind::U64 if words[c.word] == u64::MAX => format!("{:>16}", "none"),
                    Kind::U64 => format!("{:>16}", words[c.word]),
                };
                vec![format!("  {}", c.name), shown, c.unit.to_owned(), c.doc.to_owned()]
            })
            .collect();
        output::line(output::columns(&rows));
    }
    Ok(())
}
