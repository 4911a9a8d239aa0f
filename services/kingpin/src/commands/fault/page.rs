//! The results as a table on the terminal and as a page with what happened around the faults.

use super::judge::Judgement;
use super::round::Made;
use config::campaign::Campaign;
use record::LogReader;
use report::{Curve, Plot, Rows, page_html};
use serde_json::Value;

/// Windows drawn of each kind and target.
const DRAWN_MAX: usize = 4;
/// From the fault. [ticks]
const BEFORE: u64 = 30;
const AFTER: u64 = 600;

/// What the rig did around a fault.
pub struct Window {
    group: String,
    name: String,
    /// From the fault. [ms]
    time_ms: Vec<f64>,
    force_n: Vec<f64>,
    state: Vec<f64>,
    stale: Vec<f64>,
}

/// Keeps the window of a fault for the page, if there are not enough of its kind yet; failed ones always.
pub fn keep_window(windows: &mut Vec<Window>, log: &LogReader, made: &Made, judgement: &Judgement) {
    let group = format!("{}, {}", judgement.kind, judgement.target);
    let failed = !judgement.faults.is_empty();
    let there = windows.iter().filter(|w| w.group == group).count();
    if made.skipped.is_some() || there >= if failed { 3 * DRAWN_MAX } else { DRAWN_MAX } {
        return;
    }
    let Ok(region) = log.region("rig_status") else { return };
    let column = |name: &str| region.column_index(name);
    let (Ok(force), Ok(state), Ok(stale)) =
        (column("tie_rod_force_applied_n.left"), column("state"), column("stale_count"))
    else {
        return;
    };
    let rows = region.ticks.partition_point(|&t| t + BEFORE < made.tick)
        ..region.ticks.partition_point(|&t| t < made.tick + AFTER);
    let period_ms = log.header.period_ns as f64 * 1e-6;
    let mut window = Window {
        group,
        name: format!("no. {}{}", judgement.number, if failed { " (not as expected)" } else { "" }),
        time_ms: Vec::new(),
        force_n: Vec::new(),
        state: Vec::new(),
        stale: Vec::new(),
    };
    let mut last = None;
    for row in rows {
        let (tick, words) = (region.ticks[row], region.row(row));
        // A rig that was away leaves a gap, not a line.
        if last.is_some_and(|last| tick > last + 1) {
            window.time_ms.push((tick as f64 - made.tick as f64 - 0.5) * period_ms);
            window.force_n.push(f64::NAN);
            window.state.push(f64::NAN);
            window.stale.push(f64::NAN);
        }
        last = Some(tick);
        window.time_ms.push((tick as f64 - made.tick as f64) * period_ms);
        window.force_n.push(f64::from_bits(words[force]));
        window.state.push(words[state] as f64);
        window.stale.push(words[stale] as f64);
    }
    windows.push(window);
}

fn cell(value: &Value) -> String {
    match value {
        Value::Null => "–".to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => format!("{:.3}", number.as_f64().unwrap_or(f64::NAN)),
        other => other.to_string(),
    }
}

fn spread(value: &Value) -> String {
    match (value["p50"].as_f64(), value["max"].as_f64()) {
        (Some(p50), Some(max)) => format!("{p50:.1} / {max:.1}"),
        _ => "–".to_owned(),
    }
}

const HEAD: [&str; 13] = [
    "fault",
    "target",
    "made",
    "passed",
    "failed",
    "host stalled",
    "skipped",
    "held at stale ≤",
    "loop closed ms p50/max",
    "process back ms p50/max",
    "bare start+attach ms p50/max",
    "running again ms p50/max",
    "missed ticks p50/max",
];

fn rows(summary: &Value) -> Vec<Vec<String>> {
    let groups = summary["groups"].as_array().cloned().unwrap_or_default();
    groups
        .iter()
        .map(|g| {
            let mut row: Vec<String> =
                ["kind", "target", "made", "passed", "failed", "host_stalled", "skipped"]
                    .iter()
                    .chain(&["held_at_stale_count_max"])
                    .map(|key| cell(&g[*key]))
                    .collect();
            let spreads = ["loop_closed_ms", "back_ms", "bare_ms", "running_ms", "missed_ticks"];
            row.extend(spreads.iter().map(|key| spread(&g[*key])));
            row
        })
        .collect()
}

/// Lines of what was seen besides the table.
fn lines(summary: &Value) -> Vec<String> {
    let mut lines = vec![format!(
        "{} faults in {} runs, seed {}: {} passed, {} failed, {} said nothing because the host stalled, {} skipped, {} never judged",
        summary["faults"],
        summary["runs"],
        summary["seed"],
        summary["passed_count"],
        summary["failed_count"],
        summary["host_stalled_count"],
        summary["skipped_count"],
        summary["never_judged_count"],
    )];
    for name in ["vehicle", "multibody"] {
        let replay = &summary["stepped_again"][name];
        if replay.is_object() {
            lines.push(format!(
                "{name} stepped again from its logged inputs without ever dying: {} ticks, {} differ in any bit{}{}",
                replay["ticks"],
                replay["different"],
                if replay["first"].is_null() { String::new() } else { format!(", first {}", replay["first"]) },
                if replay["stopped"].is_null() { String::new() } else { format!(", stopped: {}", replay["stopped"]) },
            ));
        }
    }
    match summary["bit_identical_twice"].as_bool() {
        Some(true) => lines.push("run twice: the logs are the same bit for bit".to_owned()),
        Some(false) => lines.push("run twice: the logs DIFFER".to_owned()),
        None => {}
    }
    lines
}

/// What was not as expected.
fn failures(summary: &Value) -> Vec<String> {
    let mut all: Vec<String> = summary["run_faults"].as_array().into_iter().flatten().map(cell).collect();
    for j in summary["judgements"].as_array().into_iter().flatten() {
        if j["outcome"] == "failed" {
            let faults: Vec<_> = j["faults"].as_array().into_iter().flatten().map(cell).collect();
            let notes: Vec<_> = j["notes"].as_array().into_iter().flatten().map(cell).collect();
            all.push(format!(
                "no. {} {} {} at tick {}: {} [{}]",
                j["number"],
                cell(&j["kind"]),
                cell(&j["target"]),
                j["tick"],
                faults.join("; "),
                notes.join("; ")
            ));
        }
    }
    all
}

/// For the terminal.
pub fn text(summary: &Value) -> String {
    let mut table = vec![HEAD.iter().map(|&h| h.to_owned()).collect::<Vec<_>>()];
    table.extend(rows(summary));
    let mut text = crate::output::columns(&table);
    for line in lines(summary) {
        text += &line;
        text.push('\n');
    }
    for failure in failures(summary).iter().take(40) {
        text += &format!("NOT AS EXPECTED: {failure}\n");
    }
    text.trim_end().to_owned()
}

/// The page.
pub fn html(campaign: &Campaign, summary: &Value, windows: &[Window]) -> String {
    let mut tables = vec![Rows {
        title: "By fault and target".to_owned(),
        head: HEAD.iter().map(|&h| h.to_owned()).collect(),
        rows: rows(summary),
    }];
    let failures = failures(summary);
    if !failures.is_empty() {
        tables.push(Rows {
            title: "Not as expected".to_owned(),
            head: vec!["what".to_owned()],
            rows: failures.into_iter().map(|failure| vec![failure]).collect(),
        });
    }
    let mut groups: Vec<&str> = windows.iter().map(|w| w.group.as_str()).collect();
    groups.sort_unstable();
    groups.dedup();
    let mut plots = Vec::new();
    for group in groups {
        let of: Vec<_> = windows.iter().filter(|w| w.group == group).collect();
        type Pick = fn(&Window) -> &Vec<f64>;
        let signals: [(&str, &str, Pick, &str, bool); 3] = [
            ("tie-rod force applied, left", "N", |w| &w.force_n, "", false),
            (
                "state",
                "state",
                |w| &w.state,
                "0 off, 1 idle, 2 armed, 3 starting, 4 running, 5 holding, 6 resuming, 7 stopping, 8 tripped",
                true,
            ),
            ("output phases without a fresh command", "ticks", |w| &w.stale, "", true),
        ];
        for (what, y, signal, note, steps) in signals {
            plots.push(Plot {
                title: format!("{group}: {what}"),
                note: note.to_owned(),
                x_title: "time from the fault in ms".to_owned(),
                y_title: y.to_owned(),
                curves: of
                    .iter()
                    .map(|w| Curve {
                        name: w.name.clone(),
                        x: w.time_ms.clone(),
                        y: signal(w).clone(),
                        steps,
                    })
                    .collect(),
                ..Plot::default()
            });
        }
    }
    let mut head = vec![campaign.description.clone()];
    head.extend(lines(summary));
    page_html(&campaign.name, &head, summary["passed"].as_bool(), &tables, &plots)
}
