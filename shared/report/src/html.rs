//! The report: one HTML file that needs nothing else.
//!
//! The figures are plotly's, with its script embedded once (the copy that the `plotly` crate carries, without
//! MathJax). A content security policy forbids the page every connection. All text that comes from a log, a
//! scenario or a user is escaped. The page prints: one figure to a row, no figure cut.

use std::sync::LazyLock;

use record::LogReader;

use crate::figure::{escaped, pretty_unit};
use crate::figures::Drawer;
use crate::overlay::Overlay;
use crate::published::{PUBLISHED_TRACKING, published_for};
use crate::run::Run;
use crate::sections;
use crate::shell;
use crate::source_figures::source_figures;
use crate::summary::{Percentiles, RunSummary, TrackingFigures, summarise};
use crate::table::STATES;
use crate::verdict::{Limits, Outcome};

/// What a report is to contain.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportOptions {
    /// Heading; the scenario's name if there is none.
    pub title: Option<String>,
    /// What the run shows, a sentence or two.
    pub description: Option<String>,
    /// Measured signals to lay over the run's.
    pub overlays: Vec<Overlay>,
    /// Limits to judge by.
    pub limits: Limits,
}

/// plotly's script, without its `<script>` tags.
pub fn plotly_js() -> &'static str {
    static SCRIPT: LazyLock<String> = LazyLock::new(|| {
        // The crate gives plotly in a first script element and MathJax in a second.
        let sources = plotly::Plot::offline_js_sources();
        let start = sources.find('>').map_or(0, |i| i + 1);
        let end = sources.find("</script>").unwrap_or(sources.len());
        sources[start..end].to_owned()
    });
    &SCRIPT
}

/// The report on a run as an HTML file.
pub fn report_html(log: &LogReader, options: &ReportOptions) -> String {
    let summary = summarise(log, &options.overlays, &options.limits);
    let run = Run::new(log);
    let mut figures = Drawer::new(&run, &options.overlays).all();
    let (said, source) = source_figures(&run, &options.overlays);
    sections::name_source(&mut figures, &source);
    let title = options.title.clone().unwrap_or_else(|| summary.scenario.replace('_', " "));

    let mut page = shell::open(&format!("{title} – Kingpin report"));
    header(&mut page, &title, options, &summary, log);
    page += "<main>\n<section id=\"summary\">\n";
    cards(&mut page, &summary);
    page += "<div class=\"columns\"><div>";
    verdicts(&mut page, &summary);
    page += "</div><div>";
    tracking(&mut page, &summary);
    page += "</div></div>\n";
    overlays(&mut page, &summary);
    sections::record_loops(&mut page, &summary.record_loops);
    page += "</section>\n";
    shell::section(&mut page, &figures);
    sections::force_budget(&mut page, &summary);
    sections::source_table(&mut page, &said, &source, &figures);
    timing(&mut page, &summary);
    log_section(&mut page, &summary);
    configuration(&mut page, log);
    page += "</main>\n";
    shell::close(&mut page, &figures);
    page
}

fn header(page: &mut String, title: &str, options: &ReportOptions, summary: &RunSummary, log: &LogReader) {
    let counted = |outcome| summary.verdicts.iter().filter(|v| v.outcome == outcome).count();
    let (badge, word) = if summary.passed { ("pass", "PASS") } else { ("fail", "FAIL") };
    let mode = if summary.lockstep { "lockstep" } else { "real time" };
    let mut facts = vec![
        mode.to_owned(),
        format!("{:.3} s at {:.0} Hz", summary.duration_s, 1.0 / summary.period_s.max(1e-9)),
        format!("bench {}", summary.bench),
        format!("run {}", summary.run_id),
        format!("seed {}", summary.seed),
    ];
    if log.header.wall_start_ns > 0 {
        facts.insert(0, utc(log.header.wall_start_ns));
    }
    let facts: Vec<String> = facts.iter().map(|f| format!("<span>{}</span>", escaped(f))).collect();
    let description =
        options.description.as_deref().map_or_else(String::new, |d| format!("<p>{}</p>", escaped(d)));
    *page += &format!(
        "<header><div class=\"bar\"><div><div class=\"brand\">Kingpin · run report</div><h1>{}</h1>{description}\
         <div class=\"facts\">{}</div></div><div class=\"badge {badge}\">{word}<small>{} passed · {} failed · {} withheld\
         </small></div></div></header>\n",
        escaped(title),
        facts.join(""),
        counted(Outcome::Pass),
        counted(Outcome::Fail),
        counted(Outcome::Withheld),
    );
}

fn cards(page: &mut String, summary: &RunSummary) {
    const DEG: f64 = 180.0 / std::f64::consts::PI;
    let peaks = &summary.peaks;
    let force_error = |i: usize| summary.force_tracking[i].error_rms_percent;
    let both = |a: Option<f64>, b: Option<f64>, digits: usize| match (a, b) {
        (None, None) => "–".to_owned(),
        (a, b) => format!("{} / {}", fixed(a, 1.0, digits), fixed(b, 1.0, digits)),
    };
    let cards = [
        ("Peak lateral acceleration", fixed(peaks.lateral_acceleration_m_s2, 1.0, 2), "m/s²"),
        ("Peak yaw rate", fixed(peaks.yaw_rate_rad_s, DEG, 1), "°/s"),
        ("Largest speed", fixed(summary.speed_m_s.map(|s| s.max), 3.6, 1), "km/h"),
        ("Peak steering-wheel angle", fixed(peaks.steering_wheel_angle_rad, DEG, 1), "°"),
        ("Peak steering torque", fixed(peaks.steering_wheel_torque_n_m, 1.0, 2), "N·m"),
        ("Peak tie-rod force l / r", both(peaks.tie_rod_force_n[0], peaks.tie_rod_force_n[1], 0), "N"),
        ("Tie-rod force error rms l / r", both(force_error(0), force_error(1), 2), "% of amplitude"),
        ("End state", summary.end_state.clone().unwrap_or_else(|| "–".to_owned()), ""),
    ];
    *page += "<div class=\"cards\">";
    for (name, value, unit) in cards {
        *page += &format!(
            "<div class=\"card\"><div class=\"name\">{name}</div><div class=\"value\">{} <small>{unit}</small></div></div>",
            escaped(&value)
        );
    }
    *page += "</div>\n";
}

fn verdicts(page: &mut String, summary: &RunSummary) {
    *page += "<h2>Against stated limits</h2><table><thead><tr><th></th><th>What</th><th>Found</th><th>Limit</th></tr></thead><tbody>";
    for verdict in &summary.verdicts {
        let (class, word) = match verdict.outcome {
            Outcome::Pass => ("pass", "pass"),
            Outcome::Fail => ("fail", "fail"),
            Outcome::Withheld => ("withheld", "withheld"),
        };
        *page += &format!(
            "<tr><td><span class=\"mark {class}\">{word}</span></td><td>{}</td><td>{}</td><td class=\"dim\">{}</td></tr>",
            escaped(&verdict.name),
            escaped(&verdict.found),
            escaped(&verdict.limit)
        );
    }
    *page += "</tbody></table>\n";
}

fn tracking(page: &mut String, summary: &RunSummary) {
    *page += "<h2>Tracking</h2><table class=\"numbers\"><thead><tr><th>Signal</th><th>amplitude</th><th>peak error</th>\
              <th>peak %</th><th>rms error</th><th>rms %</th><th>lag ms</th></tr></thead><tbody>";
    let groups: [(&str, &[TrackingFigures; 2], f64, &str, usize); 3] = [
        ("Tie-rod force, load cell", &summary.force_tracking, 1.0, "N", 1),
        ("Tie-rod force, true", &summary.true_force_tracking, 1.0, "N", 1),
        ("Ball height", &summary.height_tracking, 1e3, "mm", 3),
    ];
    for (name, sides, scale, unit, digits) in groups {
        for (side, f) in ["left", "right"].into_iter().zip(sides) {
            *page += &format!("<tr><td>{name}, {side}</td>");
            if let Some(reason) = &f.withheld {
                *page += &format!("<td colspan=\"6\" class=\"dim\">{}</td></tr>", escaped(reason));
                continue;
            }
            *page += &format!(
                "<td>{} {unit}</td><td>{} {unit}</td><td>{}</td><td>{} {unit}</td><td>{}</td><td>{}</td></tr>",
                fixed(f.amplitude, scale, digits),
                fixed(f.error_max, scale, digits),
                fixed(f.error_max_percent, 1.0, 2),
                fixed(f.error_rms, scale, digits),
                fixed(f.error_rms_percent, 1.0, 2),
                fixed(f.lag_s, 1e3, 2),
            );
        }
    }
    *page += "</tbody></table><p class=\"note\">Error = command − measurement of the same tick while steering is active, \
              in % of half the command's peak-to-peak; both through a zero-phase 50 Hz filter.</p>\n";
    loops(page, summary);
    let this = published_for(&summary.scenario);
    *page += "<h3>Published: hydraulic bench on hardware</h3><table class=\"numbers\"><thead><tr><th>Tie-rod force error in %</th>\
              <th>left peak</th><th>left rms</th><th>right peak</th><th>right rms</th></tr></thead><tbody>";
    for p in &PUBLISHED_TRACKING {
        let class = if this == Some(p) { " class=\"this\"" } else { "" };
        *page += &format!(
            "<tr{class}><td>{}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td><td>{:.2}</td></tr>",
            p.manoeuvre, p.left.0, p.left.1, p.right.0, p.right.1
        );
    }
    *page += "</tbody></table>\n";
}

fn loops(page: &mut String, summary: &RunSummary) {
    const PER_DEG: f64 = std::f64::consts::PI / 180.0;
    let (angle, acceleration) = (&summary.torque_over_angle, &summary.torque_over_acceleration);
    *page += &format!(
        "<h3>Steering-torque loops</h3><table class=\"numbers\"><thead><tr><th>Loop</th><th>gradient at 0</th>\
         <th>width at 0</th></tr></thead><tbody>\
         <tr><td>over steering-wheel angle</td><td>{} N·m/°</td><td>{} N·m</td></tr>\
         <tr><td>over lateral acceleration</td><td>{} N·m/(m/s²)</td><td>{} N·m</td></tr></tbody></table>\n",
        fixed(angle.gradient, PER_DEG, 4),
        fixed(angle.width_n_m, 1.0, 3),
        fixed(acceleration.gradient, 1.0, 3),
        fixed(acceleration.width_n_m, 1.0, 3),
    );
}

fn overlays(page: &mut String, summary: &RunSummary) {
    if summary.overlays.is_empty() {
        return;
    }
    *page += "<h2>Against measured records</h2><table class=\"numbers\"><thead><tr><th>Signal</th><th>peak measured</th>\
              <th>peak bench</th><th>rms error</th><th>aligned</th><th>% of rms</th><th>lag ms</th><th>corr.</th></tr></thead><tbody>";
    for o in &summary.overlays {
        *page += &format!(
            "<tr><td>{}<br><small class=\"dim\">{}</small></td>",
            escaped(&o.title),
            escaped(&o.target)
        );
        if let Some(reason) = &o.withheld {
            *page += &format!("<td colspan=\"7\" class=\"dim\">withheld: {}</td></tr>", escaped(reason));
            continue;
        }
        let unit = escaped(&pretty_unit(&o.unit));
        *page += &format!(
            "<td>{} {unit}</td><td>{} {unit}</td><td>{} {unit}</td><td>{} {unit}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            significant(o.measured_peak),
            significant(o.simulated_peak),
            significant(o.rms_error),
            significant(o.rms_error_aligned),
            fixed(o.normalised_rms_error_percent, 1.0, 1),
            fixed(o.lag_s, 1e3, 0),
            fixed(o.correlation, 1.0, 4),
        );
    }
    *page += "</tbody></table><p class=\"note\">Lag: how much later the bench is. Aligned: with that lag taken out; \
              in % of the measured root mean square.</p>\n";
}

fn timing(page: &mut String, summary: &RunSummary) {
    *page += "<section id=\"timing\"><h2>Timing</h2>";
    if summary.lockstep {
        *page += "<p class=\"note\">Run in lockstep: it says nothing about real time.</p></section>\n";
        return;
    }
    *page += "<table class=\"numbers\"><thead><tr><th>Service</th><th>lateness p50</th><th>p99.9</th><th>max</th><th>compute p50</th>\
              <th>p99.9</th><th>max</th><th>late wake-ups</th><th>overruns</th><th>missed</th><th>caught up</th></tr></thead><tbody>";
    let cells = |p: &Option<Percentiles>| match p {
        Some(p) => {
            [p.p50, p.p99_9, p.max].map(|v| format!("<td>{} µs</td>", fixed(Some(v), 1e6, 1))).concat()
        }
        None => "<td>–</td>".repeat(3),
    };
    for s in &summary.timing {
        *page += &format!(
            "<tr><td>{}</td>{}{}<td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escaped(&s.service),
            cells(&s.wake_lateness_s),
            cells(&s.compute_s),
            s.late_wake_count,
            s.overrun_count,
            s.missed_count,
            s.caught_up_count
        );
    }
    *page += "</tbody></table>";
    let margin = summary.margin_s.map_or_else(String::new, |m| {
        format!(
            "Command before the output phase: smallest {:.0} µs, mean {:.0} µs. ",
            m.min * 1e6,
            m.mean * 1e6
        )
    });
    *page += &format!(
        "<p class=\"note\">{margin}Late commands: {}. Late wake-ups are the system's doing, overruns the service's own.</p></section>\n",
        summary.late_command_count.map_or_else(|| "unknown".to_owned(), |n| n.to_string())
    );
}

fn log_section(page: &mut String, summary: &RunSummary) {
    let log = &summary.log;
    *page += "<section id=\"log\"><h2>Log and flags</h2><div class=\"columns\"><div><table><tbody>";
    let mut row = |name: &str, value: String| {
        *page += &format!("<tr><td>{name}</td><td>{}</td></tr>", escaped(&value));
    };
    row("Files", log.files.join(", "));
    row("Ended by its writer", if log.finished { "yes" } else { "no" }.to_owned());
    row("Ticks missing", log.missing_ticks.values().sum::<u64>().to_string());
    for (region, (first, last)) in &log.first_gap {
        row("First gap", format!("{region}: ticks {first} to {last}"));
    }
    row(
        "Ticks in two files, same / different",
        format!("{} / {}", log.duplicate_ticks, log.conflicting_ticks),
    );
    row("Bytes unreadable", log.bytes_dropped.to_string());
    let count = |n: Option<u64>| n.map_or_else(|| "–".to_owned(), |n| n.to_string());
    row("Lost by a lagging logger", count(log.lost_count));
    row("Writes the disk refused", count(log.write_error_count));
    *page += "</tbody></table></div><div><table><tbody>";
    // In the order a bench goes through them; codes of other versions last.
    let place = |state: &str| STATES.iter().position(|&known| known == state);
    let mut states: Vec<_> = summary.state_ticks.iter().collect();
    states.sort_by_key(|(state, _)| place(state).unwrap_or(STATES.len()));
    for (state, ticks) in states {
        *page += &format!("<tr><td>state {}</td><td>{ticks} ticks</td></tr>", escaped(state));
    }
    for (flag, ticks) in &summary.flag_ticks {
        *page += &format!("<tr><td>flag {}</td><td>{ticks} ticks</td></tr>", escaped(flag));
    }
    *page += "</tbody></table></div></div></section>\n";
}

fn configuration(page: &mut String, log: &LogReader) {
    let header = &log.header;
    *page += "<section id=\"configuration\"><h2>Versions and configuration</h2><table><tbody>";
    for (part, version) in &header.versions {
        *page += &format!("<tr><td>{}</td><td>{}</td></tr>", escaped(part), escaped(version));
    }
    let intact = if header.configuration_intact() { "" } else { " (does not match the text below)" };
    *page += &format!(
        "<tr><td>configuration hash</td><td><code>{}</code>{intact}</td></tr></tbody></table>",
        escaped(&header.configuration_hash)
    );
    let mut block = |name: &str, text: &str| {
        *page +=
            &format!("<details><summary>{}</summary><pre>{}</pre></details>", escaped(name), escaped(text));
    };
    block("Resolved configuration", &header.configuration);
    for source in &header.sources {
        block(&source.name, &source.text);
    }
    *page += "</section>\n";
}

/// A number with so many decimals, or a dash.
pub(crate) fn fixed(value: Option<f64>, scale: f64, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |v| format!("{:.digits$}", v * scale))
}

/// A number with three significant digits, or a dash.
fn significant(value: Option<f64>) -> String {
    value.map_or_else(
        || "–".to_owned(),
        |v| {
            let before = if v == 0.0 { 1 } else { v.abs().log10().floor() as i32 + 1 };
            format!("{v:.*}", (3 - before).clamp(0, 9) as usize)
        },
    )
}

/// Unix time as date and time, UTC. Days to civil date: Howard Hinnant's algorithm, valid for all years here.
fn utc(unix_ns: u64) -> String {
    let seconds = unix_ns / 1_000_000_000;
    let (days, second) = ((seconds / 86_400) as i64, seconds % 86_400);
    let z = days + 719_468;
    let (era, day_of_era) = (z / 146_097, z % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = if shifted_month < 10 { shifted_month + 3 } else { shifted_month - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    format!("{year}-{month:02}-{day:02} {:02}:{:02}:{:02} UTC", second / 3600, second / 60 % 60, second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates() {
        assert_eq!(utc(0), "1970-01-01 00:00:00 UTC");
        assert_eq!(utc(951_782_399_000_000_000), "2000-02-28 23:59:59 UTC");
        assert_eq!(utc(951_782_400_000_000_000), "2000-02-29 00:00:00 UTC");
        assert_eq!(utc(1_760_000_000_123_456_789), "2025-10-09 08:53:20 UTC");
    }

    #[test]
    fn the_script_is_plotly_alone() {
        let script = plotly_js();
        assert!(script.len() > 3_000_000 && script.len() < 5_500_000, "{}", script.len());
        assert!(
            script.contains("plotly.js v3") && !script.contains("MathJax=") && !script.contains("</script")
        );
    }

    #[test]
    fn figures_of_three_digits() {
        assert_eq!(
            [Some(1234.5), Some(0.012_345), Some(0.0), None].map(significant),
            ["1234", "0.0123", "0.00", "–"]
        );
    }
}
