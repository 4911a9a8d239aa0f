//! Sections of the report that are tables: where the force error comes from, measured torque loops, the source's figures.

use crate::figure::{Figure, escaped};
use crate::force_budget::ForceBudget;
use crate::html::fixed;
use crate::overlay::RecordLoop;
use crate::source_figures::{LATERAL, SourceFigure, numbers_for};
use crate::summary::RunSummary;

/// The force-error budget of both sides.
pub(crate) fn force_budget(page: &mut String, summary: &RunSummary) {
    *page +=
        "<section id=\"budget\"><h2>Tie-rod force error, where it comes from</h2><div class=\"columns\">";
    for (side, budget) in ["left", "right"].into_iter().zip(&summary.force_budget) {
        *page += "<div>";
        side_budget(page, side, budget);
        *page += "</div>";
    }
    *page += "</div><p class=\"note\">Error = what the suspension asks for at an instant − what the steering unit feels at \
              that instant, unfiltered, while steering is active. The parts are signals that add up to it at every tick. \
              Share: mean product of part and whole over the whole's root mean square; the shares add up to that root mean \
              square, the parts' own root mean squares do not. A negative share makes up for others. Not in it: what the delay of \
              the measured rack does to what is asked.</p></section>\n";
}

fn side_budget(page: &mut String, side: &str, budget: &ForceBudget) {
    *page += &format!(
        "<h3>{side}</h3><table class=\"numbers\"><thead><tr><th>Part</th><th>rms N</th><th>largest N</th><th>share N</th>\
         <th>share %</th></tr></thead><tbody>"
    );
    if let Some(reason) = &budget.withheld {
        *page += &format!(
            "<tr><td colspan=\"5\" class=\"dim\">withheld: {}</td></tr></tbody></table>",
            escaped(reason)
        );
        return;
    }
    let whole = budget.rms_n.unwrap_or(f64::NAN);
    for part in &budget.parts {
        let mut name = part.name.clone();
        if let (true, Some(delay_s)) = (name.starts_with("delay"), budget.delay_s) {
            name = format!("{name}, {:.2} ms", 1e3 * delay_s);
        }
        *page += &format!(
            "<tr><td>{}</td><td>{:.2}</td><td>{}</td><td>{:.2}</td><td>{:.1}</td></tr>",
            escaped(&name),
            part.rms_n,
            fixed(part.peak_n, 1.0, 1),
            part.share_n,
            100.0 * part.share_n / whole
        );
    }
    *page += &format!(
        "<tr class=\"this\"><td>{}</td><td>{:.2}</td><td>{}</td><td>{}</td><td>100.0</td></tr></tbody></table>",
        if budget.against_cell {
            "whole, against the force cell (the true force is not known)"
        } else {
            "whole"
        },
        whole,
        fixed(budget.peak_n, 1.0, 1),
        fixed(budget.sum_of_shares_n, 1.0, 2),
    );
}

/// Measured steering-torque loops beside the bench's.
pub(crate) fn record_loops(page: &mut String, loops: &[RecordLoop]) {
    const PER_DEG: f64 = std::f64::consts::PI / 180.0;
    if loops.is_empty() {
        return;
    }
    *page += "<h3>Steering-torque loops against the record</h3><table class=\"numbers\"><thead><tr><th>Torque over</th>\
              <th>gradient measured</th><th>bench</th><th>error %</th><th>width measured</th><th>bench</th><th>error %</th>\
              </tr></thead><tbody>";
    for found in loops {
        let (name, scale, unit) = if found.over == LATERAL {
            ("lateral acceleration", 1.0, "N·m/(m/s²)")
        } else {
            ("steering-wheel angle", PER_DEG, "N·m/°")
        };
        *page += &format!(
            "<tr><td>{name}</td><td>{} {unit}</td><td>{} {unit}</td><td>{}</td><td>{} N·m</td><td>{} N·m</td><td>{}</td></tr>",
            fixed(found.measured.gradient, scale, 4),
            fixed(found.bench.gradient, scale, 4),
            fixed(found.gradient_error_percent, 1.0, 1),
            fixed(found.measured.width_n_m, 1.0, 3),
            fixed(found.bench.width_n_m, 1.0, 3),
            fixed(found.width_error_percent, 1.0, 1),
        );
    }
    *page += "</tbody></table>\n";
}

/// Writes under each figure which of the source's it stands for.
pub(crate) fn name_source(figures: &mut [Figure], source: &[SourceFigure]) {
    for figure in figures {
        let numbers = numbers_for(source, &figure.title);
        if numbers.is_empty() {
            continue;
        }
        let named = format!("Source: figure{} {numbers}.", if numbers.contains(',') { "s" } else { "" });
        figure.note = Some(match figure.note.take() {
            Some(note) => format!("{named} {note}"),
            None => named,
        });
    }
}

/// The table from the source's figures to ours.
pub(crate) fn source_table(page: &mut String, said: &str, source: &[SourceFigure], figures: &[Figure]) {
    *page += &format!(
        "<section id=\"source\"><h2>Figures of the source, and ours</h2><p class=\"note\">The source: the thesis on the \
         hydraulic bench whose concept this one follows, chapters 5.1 and 5.3. {}</p><table><thead><tr><th>Source</th>\
         <th>What it shows</th><th>Here</th></tr></thead><tbody>",
        escaped(said)
    );
    for figure in source {
        let links: Vec<String> = figure
            .ours
            .iter()
            .filter_map(|title| {
                let place = figures.iter().position(|f| f.title == **title)?;
                Some(format!("<a href=\"#figure-{place}\">{}</a>", escaped(title)))
            })
            .collect();
        let here = match (links.is_empty(), figure.lacks.is_empty()) {
            (false, true) => links.join("; "),
            (false, false) => {
                format!("{}; <span class=\"dim\">without {}</span>", links.join("; "), escaped(&figure.lacks))
            }
            (true, _) => "<span class=\"dim\">not in this log</span>".to_owned(),
        };
        *page +=
            &format!("<tr><td>{}</td><td>{}</td><td>{here}</td></tr>", figure.number, escaped(&figure.shows));
    }
    *page += "</tbody></table></section>\n";
}
