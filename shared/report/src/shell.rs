//! What every page has: head with style and security policy, the section of figures, the figures' data and scripts.

use serde_json::Value;

use crate::figure::{Figure, escaped};
use crate::html::plotly_js;

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The beginning of a page, up to and with `<body>`. `title` is what the browser's tab says.
pub(crate) fn open(title: &str) -> String {
    let mut page = String::with_capacity(6 << 20);
    page += "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n";
    page += "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
             script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:\">\n";
    page += "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n";
    page += &format!("<title>{}</title>\n<style>{STYLE}</style></head><body>\n", escaped(title));
    page
}

/// The section of the figures, to be drawn by the script at the page's end.
pub(crate) fn section(page: &mut String, figures: &[Figure]) {
    *page += "<section id=\"figures\"><h2>Figures</h2><div class=\"figures\">\n";
    for (i, figure) in figures.iter().enumerate() {
        let wide = if figure.wide { " wide" } else { "" };
        let note = figure
            .note
            .as_deref()
            .map_or_else(String::new, |n| format!("<p class=\"note\">{}</p>", escaped(n)));
        *page += &format!(
            "<figure class=\"figure{wide}\"><h3>{}</h3><div class=\"plot\" id=\"figure-{i}\"></div>{note}</figure>\n",
            escaped(&figure.title)
        );
    }
    *page += "</div></section>\n";
}

/// The end of a page: the figures' data and the scripts that draw them.
pub(crate) fn close(page: &mut String, figures: &[Figure]) {
    let data: Vec<Value> = figures.iter().map(Figure::to_json).collect();
    // A less-than sign inside would end the element.
    let data = Value::Array(data).to_string().replace('<', "\\u003c");
    *page += &format!("<script type=\"application/json\" id=\"data\">{data}</script>\n");
    *page += &format!("<script>{}</script>\n<script>{SCRIPT}</script>\n</body></html>\n", plotly_js());
}
