//! A page of figures that needs nothing but itself.

use serde_json::{Value, json};

/// Colours that stay apart for the colour-blind [Okabe, Ito 2008].
pub const COLOURS: [&str; 7] = ["#1b2430", "#0072b2", "#d55e00", "#009e73", "#a855a0", "#e0a100", "#56b4e9"];

/// A figure.
pub struct Figure {
    title: String,
    data: Vec<Value>,
    layout: Value,
}

impl Figure {
    /// An empty figure.
    pub fn new(title: &str, x: &str, y: &str) -> Self {
        let axis = |title: &str| {
            json!({"title": {"text": escaped(title), "standoff": 8}, "gridcolor": "#e7ebf0",
                   "zerolinecolor": "#c3cbd6", "showline": true, "linecolor": "#c3cbd6", "automargin": true})
        };
        Self {
            title: title.to_owned(),
            data: Vec::new(),
            layout: json!({
                "xaxis": axis(x), "yaxis": axis(y), "hovermode": "x unified", "height": 340,
                "margin": {"l": 62, "r": 14, "t": 10, "b": 42},
                "legend": {"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom"},
                "paper_bgcolor": "#fff", "plot_bgcolor": "#fff", "showlegend": true,
                "font": {"family": "system-ui, sans-serif", "size": 12, "color": "#3a4553"},
            }),
        }
    }

    /// Logarithmic axes.
    pub fn log_axes(mut self, x: bool, y: bool) -> Self {
        for (axis, log) in [("xaxis", x), ("yaxis", y)] {
            if log {
                self.layout[axis]["type"] = json!("log");
            }
        }
        self
    }

    /// Adds a curve; `dash` as plotly names it.
    pub fn curve(&mut self, name: &str, x: &[f64], y: &[f64], colour: usize, dash: &str) {
        let short = |v: &f64| -> f64 { format!("{v:.7e}").parse().unwrap_or(*v) };
        let numbers = |v: &[f64]| v.iter().map(short).collect::<Vec<f64>>();
        self.data.push(json!({
            "type": "scatter", "mode": "lines", "name": escaped(name), "x": numbers(x), "y": numbers(y),
            "line": {"color": COLOURS[colour % COLOURS.len()], "dash": dash,
                     "width": if dash == "solid" { 1.8 } else { 1.5 }},
        }));
    }

    /// Whether nothing is drawn in it.
    pub fn is_empty(&self) -> bool {
        self.data.is_empty()
    }
}

/// A table with a heading: first row is the header.
pub struct Table {
    /// Heading.
    pub title: String,
    /// Rows.
    pub rows: Vec<Vec<String>>,
}

const STYLE: &str = "body{margin:0;background:#f5f7f9;color:#1b2430;font:14px/1.45 system-ui,sans-serif}\
    header{background:#17212e;color:#fff;padding:18px 28px}h1{margin:0 0 4px;font-size:24px}\
    header p{margin:0;color:#ccd6e0}main{max-width:1440px;margin:0 auto;padding:16px 28px}\
    .figures{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:16px}\
    figure{margin:0;background:#fff;border:1px solid #dfe4ea;border-radius:8px;padding:10px;min-width:0}\
    h2{font-size:17px}h3{margin:0 2px 4px;font-size:14px}\
    table{border-collapse:collapse;background:#fff;border:1px solid #dfe4ea}\
    th,td{padding:5px 12px;border-bottom:1px solid #dfe4ea;text-align:right;font-variant-numeric:tabular-nums}\
    th:first-child,td:first-child{text-align:left}\
    @media(max-width:900px),print{.figures{display:block}figure{break-inside:avoid;margin-bottom:10px}}";

/// The page.
pub fn html(title: &str, about: &str, tables: &[Table], figures: &[Figure]) -> String {
    let mut page = String::with_capacity(6 << 20);
    page += "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n";
    page += "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
             script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:\">\n";
    page += &format!("<title>{}</title><style>{STYLE}</style></head><body>\n", escaped(title));
    page += &format!("<header><h1>{}</h1><p>{}</p></header><main>\n", escaped(title), escaped(about));
    for table in tables {
        page += &format!("<h2>{}</h2><table>\n", escaped(&table.title));
        for (r, row) in table.rows.iter().enumerate() {
            let tag = if r == 0 { "th" } else { "td" };
            let cells = row.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)));
            page += &format!("<tr>{}</tr>\n", cells.collect::<String>());
        }
        page += "</table>\n";
    }
    page += "<h2>Figures</h2><div class=\"figures\">\n";
    for (i, figure) in figures.iter().enumerate() {
        let title = escaped(&figure.title);
        page += &format!("<figure><h3>{title}</h3><div id=\"figure-{i}\"></div></figure>\n");
    }
    let data: Vec<Value> = figures.iter().map(|f| json!({"data": f.data, "layout": f.layout})).collect();
    // A less-than sign inside would end the element.
    let data = Value::Array(data).to_string().replace('<', "\\u003c");
    page += &format!("</div></main><script type=\"application/json\" id=\"data\">{data}</script>\n");
    page += &format!("<script>{}</script>\n", report::plotly_js());
    page += "<script>JSON.parse(document.getElementById('data').textContent).forEach((f,i)=>\
             Plotly.newPlot('figure-'+i,f.data,f.layout,{responsive:true,displaylogo:false}));</script>\n\
             </body></html>\n";
    page
}

/// Text that stays text in HTML and in plotly's labels.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
