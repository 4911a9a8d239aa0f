//! The page of a parameter study: what moves what, and by how much.

use metrics::correlation::correlation;
use metrics::statistics::{mean, range};
use serde_json::json;

use crate::figure::{BLUE, Figure, full};
use crate::page::{Rows, page_of};
use crate::procedure::short;

/// Most errors that are told one by one.
const TOLD_MAX: usize = 100;

/// A column of a study's table; NaN where absent.
#[derive(Debug, Clone, Copy)]
pub struct StudyColumn<'a> {
    /// Its name.
    pub name: &'a str,
    /// Its values, one a run.
    pub values: &'a [f64],
}

/// The page: each figure's span, its correlation with each parameter (Pearson's, over the runs that have both), each
/// figure over the parameter it follows most, and the runs that went wrong.
pub fn study_html(
    title: &str,
    lines: &[String],
    parameters: &[StudyColumn<'_>],
    figures: &[StudyColumn<'_>],
    errors: &[(u64, &str)],
) -> String {
    let number = |value: f64| if value.is_finite() { short(value) } else { "–".to_owned() };
    let both = |a: &StudyColumn<'_>, b: &StudyColumn<'_>| -> (Vec<f64>, Vec<f64>) {
        a.values.iter().zip(b.values).filter(|(a, b)| a.is_finite() && b.is_finite()).unzip()
    };
    let mut spans = Rows {
        title: "Figures over all runs".to_owned(),
        head: ["figure", "runs", "smallest", "mean", "largest"].map(str::to_owned).to_vec(),
        rows: Vec::new(),
    };
    let mut follows = Rows {
        title: "Correlation with the parameters".to_owned(),
        head: std::iter::once("figure").chain(parameters.iter().map(|p| p.name)).map(str::to_owned).collect(),
        rows: Vec::new(),
    };
    let mut plots: Vec<Figure> = Vec::new();
    for figure in figures {
        let count = figure.values.iter().filter(|value| value.is_finite()).count();
        let (low, high) = range(figure.values).unwrap_or((f64::NAN, f64::NAN));
        spans.rows.push(vec![
            figure.name.to_owned(),
            count.to_string(),
            number(low),
            number(mean(figure.values)),
            number(high),
        ]);
        let found: Vec<f64> = parameters
            .iter()
            .map(|parameter| {
                let (x, y) = both(parameter, figure);
                correlation(&x, &y).unwrap_or(f64::NAN)
            })
            .collect();
        let cells = found.iter().map(|r| if r.is_finite() { format!("{r:+.2}") } else { "–".to_owned() });
        follows.rows.push(std::iter::once(figure.name.to_owned()).chain(cells).collect());
        let most = found
            .iter()
            .enumerate()
            .filter(|(_, r)| r.is_finite())
            .max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        let Some(parameter) = most.and_then(|(p, _)| parameters.get(p)) else { continue };
        let (x, y) = both(parameter, figure);
        let mut plot =
            Figure::new(figure.name, parameter.name, figure.name).layout(&json!({ "hovermode": "closest" }));
        plot.push("runs", &x, &y, full(BLUE), &json!({ "mode": "markers", "marker": { "size": 5 } }));
        plots.push(plot);
    }
    let mut tables = vec![spans, follows];
    if !errors.is_empty() {
        let mut rows: Vec<Vec<String>> = errors
            .iter()
            .take(TOLD_MAX)
            .map(|(run, error)| vec![run.to_string(), (*error).to_owned()])
            .collect();
        if errors.len() > TOLD_MAX {
            rows.push(vec![String::new(), format!("and {} more", errors.len() - TOLD_MAX)]);
        }
        let head = ["run", "error"].map(str::to_owned).to_vec();
        tables.push(Rows { title: "Runs with an error".to_owned(), head, rows });
    }
    page_of(title, lines, None, &tables, &plots)
}
