//! A self-contained page of figures and tables for results that are not a run's: campaigns, timing.

use serde_json::json;

use crate::figure::{BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE};
use crate::figure::{Figure, escaped, full};
use crate::shell;

/// A curve of a [`Plot`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Curve {
    /// Name in the legend.
    pub name: String,
    /// Ascending abscissae.
    pub x: Vec<f64>,
    /// Ordinates; NaN is a gap.
    pub y: Vec<f64>,
    /// Drawn as steps.
    pub steps: bool,
}

/// A figure.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plot {
    /// Heading.
    pub title: String,
    /// A line below it.
    pub note: String,
    /// Title of the abscissa, with unit.
    pub x_title: String,
    /// Title of the ordinate, with unit.
    pub y_title: String,
    /// Logarithmic axes.
    pub log: [bool; 2],
    /// Curves.
    pub curves: Vec<Curve>,
    /// Whether it takes the whole width.
    pub wide: bool,
}

/// A table: head and rows.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rows {
    /// Heading above it.
    pub title: String,
    /// Heads of the columns.
    pub head: Vec<String>,
    /// Cells.
    pub rows: Vec<Vec<String>>,
}

/// The page. `passed`: what the badge says, `None` for none.
pub fn page_html(
    title: &str,
    lines: &[String],
    passed: Option<bool>,
    tables: &[Rows],
    plots: &[Plot],
) -> String {
    page_of(title, lines, passed, tables, &plots.iter().map(figure).collect::<Vec<_>>())
}

/// As [`page_html`], with figures of any kind.
pub(crate) fn page_of(
    title: &str,
    lines: &[String],
    passed: Option<bool>,
    tables: &[Rows],
    figures: &[Figure],
) -> String {
    let mut page = shell::open(&format!("{title} – Kingpin"));
    let badge = match passed {
        Some(true) => "<div class=\"badge pass\">PASS</div>",
        Some(false) => "<div class=\"badge fail\">FAIL</div>",
        None => "",
    };
    let facts: Vec<_> = lines.iter().map(|line| format!("<p>{}</p>", escaped(line))).collect();
    page += &format!(
        "<header><div class=\"bar\"><div><div class=\"brand\">Kingpin</div><h1>{}</h1>{}</div>{badge}</div></header>\n<main>\n",
        escaped(title),
        facts.join("")
    );
    for table in tables {
        let cells = |cells: &[String], tag: &str| -> String {
            cells.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect()
        };
        let rows: String = table.rows.iter().map(|row| format!("<tr>{}</tr>", cells(row, "td"))).collect();
        page += &format!(
            "<section style=\"overflow-x:auto\"><h2>{}</h2><table class=\"numbers\"><thead><tr>{}</tr></thead><tbody>{rows}</tbody></table></section>\n",
            escaped(&table.title),
            cells(&table.head, "th")
        );
    }
    shell::section(&mut page, figures);
    page += "</main>\n";
    shell::close(&mut page, figures);
    page
}

fn figure(plot: &Plot) -> Figure {
    const COLOURS: [&str; 6] = [BLUE, ORANGE, GREEN, PURPLE, BLACK, GREY];
    let mut figure = Figure::new(&plot.title, &plot.x_title, &plot.y_title);
    figure.wide = plot.wide;
    figure.note = Some(plot.note.clone()).filter(|note| !note.is_empty());
    for (i, curve) in plot.curves.iter().enumerate() {
        let shape = if curve.steps { json!({ "line": { "shape": "hv" } }) } else { json!({}) };
        figure.push(&curve.name, &curve.x, &curve.y, full(COLOURS[i % COLOURS.len()]), &shape);
    }
    let kind = |log: bool| if log { "log" } else { "linear" };
    figure.layout(&json!({ "xaxis": { "type": kind(plot.log[0]) }, "yaxis": { "type": kind(plot.log[1]) } }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_whole_and_text_stays_text() {
        let plot = Plot {
            title: "<force>".to_owned(),
            curves: vec![Curve {
                name: "a".to_owned(),
                x: vec![0.0, 1.0],
                y: vec![1.0, f64::NAN],
                steps: true,
            }],
            ..Plot::default()
        };
        let rows = Rows { title: "t".into(), head: vec!["h".into()], rows: vec![vec!["<c>".into()]] };
        let page = page_html("x & y", &["line".to_owned()], Some(false), &[rows], &[plot]);
        assert!(page.contains("x &amp; y") && page.contains("&lt;c&gt;") && page.contains("FAIL"));
        assert!(page.contains("&lt;force&gt;") && page.ends_with("</html>\n"));
    }
}
