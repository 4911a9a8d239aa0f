//! `report`, `recover`, `export`, `compare`: what is done with a log afterwards.

use crate::args::{CompareArgs, ExportArgs, ExportFormat, RecoverArgs, ReportArgs, ThinMethod};
use crate::exit::Exit;
use crate::output;
use record::{CsvOptions, Decimation, LogError, LogReader, Mf4Options};
use serde_json::json;
use std::collections::BTreeSet;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

fn failed(error: impl std::fmt::Display) -> Exit {
    output::note(error);
    Exit::BadInput
}

/// Directory in which a run's or a log's other files go.
fn beside(run: &Path) -> PathBuf {
    if run.is_dir() {
        run.to_owned()
    } else {
        run.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new(".")).to_owned()
    }
}

/// Writes a file whole or not at all.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> Result<(), String>,
) -> Result<(), String> {
    write_file(path, |file| write(file))
}

/// As [`write_whole`], for formats that seek.
fn write_file(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<std::fs::File>) -> Result<(), String>,
) -> Result<(), String> {
    let mut draft = path.as_os_str().to_owned();
    draft.push(".tmp");
    let draft = PathBuf::from(draft);
    let written = std::fs::File::create(&draft)
        .map_err(|e| e.to_string())
        .and_then(|file| {
            let mut buffered = BufWriter::with_capacity(1 << 20, file);
            write(&mut buffered)?;
            buffered.flush().map_err(|e| e.to_string())
        })
        .and_then(|()| std::fs::rename(&draft, path).map_err(|e| e.to_string()));
    if let Err(error) = written {
        let _ = std::fs::remove_file(&draft);
        return Err(format!("{}: {error}", path.display()));
    }
    Ok(())
}

/// `kingpin report`.
pub fn report(args: &ReportArgs) -> Exit {
    let [run] = &args.runs[..] else { return compare_runs(args) };
    let log = match LogReader::open(run) {
        Ok(log) => log,
        Err(error) => return failed(error),
    };
    let path = args.output.clone().unwrap_or_else(|| beside(run).join("report.html"));
    match super::summary::write_report(&log, &path) {
        Ok(summary) => {
            if args.json {
                output::json(&serde_json::to_value(&summary).unwrap_or_default());
            } else {
                output::line(path.display());
            }
            Exit::Done
        }
        Err(error) => failed(error),
    }
}

/// `kingpin report` of two or more runs.
fn compare_runs(args: &ReportArgs) -> Exit {
    const RUNS_MAX: usize = 6;
    if args.runs.len() > RUNS_MAX {
        return failed(format!("{} runs: at most {RUNS_MAX} are compared on a page", args.runs.len()));
    }
    let mut logs = Vec::new();
    for run in &args.runs {
        match LogReader::open(run) {
            Ok(log) => logs.push((short_name(run), log)),
            Err(error) => return failed(error),
        }
    }
    let compared: Vec<report::Compared<'_>> = logs
        .iter()
        .map(|(name, log)| report::Compared {
            name: name.clone(),
            log,
            options: super::summary::options(log),
        })
        .collect();
    let names: Vec<&str> = logs.iter().map(|(name, _)| name.as_str()).collect();
    let path = args.output.clone().unwrap_or_else(|| {
        let folder = args.runs[0].parent().filter(|p| !p.as_os_str().is_empty());
        let file: String = format!("compare-{}", names.join("-")).chars().take(180).collect();
        folder.unwrap_or(Path::new(".")).join(format!("{file}.html"))
    });
    let page = report::comparison_html(&compared);
    if let Err(error) = write_whole(&path, |out| out.write_all(page.as_bytes()).map_err(|e| e.to_string())) {
        return failed(error);
    }
    if args.json {
        output::json(&report::comparison_json(&compared));
    } else {
        output::line(path.display());
    }
    Exit::Done
}

/// What a run is called: its directory's name, or its log's.
fn short_name(run: &Path) -> String {
    let name = if run.is_dir() { run.file_name() } else { run.file_stem() };
    name.map_or_else(|| run.display().to_string(), |name| name.to_string_lossy().into_owned())
}

/// `kingpin recover`.
pub fn recover(args: &RecoverArgs) -> Exit {
    let output = args.output.clone().unwrap_or_else(|| args.log.with_extension("recovered.mcap"));
    match record::recover(&args.log, &output) {
        Ok(report) => {
            if args.json {
                output::json(&serde_json::to_value(&report).unwrap_or_default());
            } else {
                output::line(format!(
                    "{}: {} messages and {} events saved, {} bytes could not be read",
                    output.display(),
                    report.messages,
                    report.events,
                    report.bytes_dropped
                ));
                for (region, tick) in &report.last_tick {
                    output::line(format!("  {region}: up to tick {tick}"));
                }
            }
            Exit::Done
        }
        Err(error) => failed(error),
    }
}

/// `kingpin export`.
pub fn export(args: &ExportArgs) -> Exit {
    if args.every == 0 {
        return failed("--every = 0: must be 1 or more");
    }
    let log = match open_for(&args.run, &args.select) {
        Ok(log) => log,
        Err(error) => return failed(error),
    };
    let log = log.thinned(
        args.every,
        match args.method {
            ThinMethod::Pick => Decimation::Pick,
            ThinMethod::Mean => Decimation::Mean,
        },
    );
    let name = match args.format {
        ExportFormat::Csv => "log.csv",
        ExportFormat::Mf4 => "log.mf4",
        ExportFormat::Parquet => "log.parquet",
        // Not of the names that a run's own logs have.
        ExportFormat::Mcap => "export.mcap",
    };
    let path = args.output.clone().unwrap_or_else(|| beside(&args.run).join(name));
    if args.format == ExportFormat::Mcap && path.canonicalize().is_ok_and(|p| same_file(&p, &args.run)) {
        return failed(format!("{}: is the log itself; name another file with --output", path.display()));
    }
    let selection = args.select.clone();
    let mut rows = 0;
    let written = write_file(&path, |out| {
        rows = match args.format {
            ExportFormat::Csv => {
                record::export_csv(&log, &CsvOptions { selection, ..CsvOptions::default() }, out)
            }
            ExportFormat::Mf4 => record::export_mf4(&log, &Mf4Options { selection, decimation: 1 }, out),
            ExportFormat::Parquet => record::export_parquet(&log, &selection, out),
            ExportFormat::Mcap => record::export_mcap(&log, &selection, out),
        }
        .map_err(|e: LogError| e.to_string())?;
        Ok(())
    });
    match written {
        Ok(()) => {
            output::line(format!("{}: {rows} rows", path.display()));
            Exit::Done
        }
        Err(error) => failed(error),
    }
}

/// Opens a log with the regions that are meant, if that can be told from the names alone and all are there; else whole,
/// so that errors know what else there is.
fn open_for(run: &Path, selection: &[String]) -> Result<LogReader, LogError> {
    let region = |entry: &String| {
        let region = entry.split('.').next().filter(|region| !region.contains(['*', '?']));
        region.map(str::to_owned)
    };
    let wanted: Option<BTreeSet<String>> = selection.iter().map(region).collect();
    if let Some(wanted) = wanted.filter(|wanted| !wanted.is_empty()) {
        let log = LogReader::open_regions(run, |name| wanted.contains(name))?;
        if log.regions().len() == wanted.len() {
            return Ok(log);
        }
    }
    LogReader::open(run)
}

/// Whether a file is one of a log's.
fn same_file(path: &Path, run: &Path) -> bool {
    record::log_files(run)
        .is_ok_and(|files| files.iter().any(|file| file.canonicalize().is_ok_and(|file| file == path)))
}

/// `kingpin compare`.
pub fn compare(args: &CompareArgs) -> Exit {
    let (a, b) = match (LogReader::open(&args.a), LogReader::open(&args.b)) {
        (Ok(a), Ok(b)) => (a, b),
        (Err(error), _) | (_, Err(error)) => return failed(error),
    };
    let differences = record::compare(&a, &b);
    if args.json {
        output::json(&json!({ "identical": differences.is_empty(), "differences": differences }));
    } else if differences.is_empty() {
        output::line("bit-identical in every region that two lockstep runs must agree on");
    } else {
        for difference in &differences {
            output::line(difference);
        }
    }
    if differences.is_empty() { Exit::Done } else { Exit::Failed }
}
