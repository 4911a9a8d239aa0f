//! A figure as plotly's data and layout, with the look that all figures share.

use serde_json::{Value, json};

use crate::decimate::min_max;

/// Colours that stay apart for the colour-blind [Okabe, Ito 2008] and in print.
pub(crate) const BLUE: &str = "#0072b2";
pub(crate) const ORANGE: &str = "#d55e00";
pub(crate) const GREEN: &str = "#009e73";
pub(crate) const PURPLE: &str = "#a855a0";
pub(crate) const GREY: &str = "#8b95a5";
pub(crate) const BLACK: &str = "#1b2430";

/// Most points of a curve over time.
pub(crate) const POINTS_MAX: usize = 2400;

/// A figure of the report.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Figure {
    /// Heading above it.
    pub title: String,
    /// A line below it.
    pub note: Option<String>,
    /// Whether it takes the whole width.
    pub wide: bool,
    /// Whether its x axis is the time of the run: then it zooms together with the others.
    pub timed: bool,
    /// Curves.
    pub data: Vec<Value>,
    /// Plotly's layout.
    pub layout: Value,
}

/// How a curve is drawn.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Style {
    pub colour: &'static str,
    pub dash: &'static str,
    pub width: f64,
}

/// A full line.
pub(crate) const fn full(colour: &'static str) -> Style {
    Style { colour, dash: "solid", width: 1.6 }
}

/// A dashed line: what was asked for.
pub(crate) const fn asked(colour: &'static str) -> Style {
    Style { colour, dash: "dash", width: 1.4 }
}

/// A thick pale line to lie under another: what was measured elsewhere.
pub(crate) const RECORD: Style = Style { colour: "#e0a100", dash: "solid", width: 2.6 };

impl Figure {
    /// An empty figure over the time of the run.
    pub fn over_time(title: &str, y_title: &str) -> Figure {
        Figure { timed: true, ..Figure::new(title, "time in s", y_title) }
    }

    /// An empty figure.
    pub fn new(title: &str, x_title: &str, y_title: &str) -> Figure {
        Figure {
            title: title.to_owned(),
            note: None,
            wide: false,
            timed: false,
            data: Vec::new(),
            layout: json!({
                "xaxis": axis(x_title),
                "yaxis": axis(y_title),
                "hovermode": "x unified",
            }),
        }
    }

    /// Adds a curve over ascending x, decimated without losing peaks.
    pub fn curve(&mut self, name: &str, x: &[f64], y: &[f64], scale: f64, style: Style) {
        let (x, y) = min_max(x, y, POINTS_MAX);
        let y: Vec<f64> = y.into_iter().map(|v| v * scale).collect();
        self.push(name, &x, &y, style, &json!({}));
    }

    /// Adds a curve as it is, with further properties of plotly's trace.
    pub fn push(&mut self, name: &str, x: &[f64], y: &[f64], style: Style, more: &Value) {
        let mut trace = json!({
            "type": "scatter", "mode": "lines", "name": escaped(name),
            "x": numbers(x, 8), "y": numbers(y, 6),
            "line": { "color": style.colour, "dash": style.dash, "width": style.width },
        });
        merge(&mut trace, more);
        self.data.push(trace);
    }

    /// Whether nothing is drawn in it.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }

    /// Changes the layout.
    pub fn layout(mut self, more: &Value) -> Figure {
        merge(&mut self.layout, more);
        self
    }

    /// Plotly's figure with the look that all share.
    pub fn to_json(&self) -> Value {
        let mut layout = json!({
            "margin": { "l": 62, "r": 14, "t": 28, "b": 42 },
            "font": { "family": "system-ui, 'Segoe UI', Roboto, Helvetica, Arial, sans-serif", "size": 12, "color": "#3a4553" },
            "paper_bgcolor": "#ffffff", "plot_bgcolor": "#ffffff",
            "legend": { "orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)" },
            "showlegend": true,
            "hoverlabel": { "font": { "size": 12 } },
            "uirevision": "keep",
        });
        merge(&mut layout, &self.layout);
        json!({ "data": self.data, "layout": layout, "timed": self.timed })
    }
}

/// An axis with its title.
pub(crate) fn axis(title: &str) -> Value {
    json!({
        "title": { "text": escaped(title), "standoff": 8 },
        "gridcolor": "#e7ebf0", "zerolinecolor": "#c3cbd6", "linecolor": "#c3cbd6",
        "showline": true, "ticks": "outside", "tickcolor": "#c3cbd6", "automargin": true,
    })
}

/// Lays `more` over `base`, object by object.
pub(crate) fn merge(base: &mut Value, more: &Value) {
    match (base, more) {
        (Value::Object(base), Value::Object(more)) => {
            for (key, value) in more {
                merge(base.entry(key.clone()).or_insert(Value::Null), value);
            }
        }
        (base, more) => *base = more.clone(),
    }
}

/// Numbers with so many significant digits; null where absent.
pub(crate) fn numbers(values: &[f64], digits: usize) -> Value {
    values.iter().map(|&v| number(v, digits)).collect()
}

fn number(value: f64, digits: usize) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    let rounded = format!("{value:.*e}", digits.saturating_sub(1)).parse().unwrap_or(value);
    // Whole numbers without ".0": a tenth of the file.
    if rounded == f64::trunc(rounded) && f64::abs(rounded) < 1e15 {
        json!(rounded as i64)
    } else {
        json!(rounded)
    }
}

/// A unit symbol as it is printed.
pub(crate) fn pretty_unit(unit: &str) -> String {
    unit.replace("^2", "²").replace("^3", "³").replace('*', "·")
}

/// Text that stays text in HTML and in plotly's labels, which know some HTML.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_gaps_are_null() {
        let text = numbers(&[1.0, 0.123_456_789, f64::NAN, -2.5e-7, 0.0], 6).to_string();
        assert_eq!(text, "[1,0.123457,null,-2.5e-7,0]");
    }

    #[test]
    fn text_stays_text() {
        assert_eq!(escaped("<b onclick='x'>&\""), "&lt;b onclick=&#39;x&#39;&gt;&amp;&quot;");
    }
}
