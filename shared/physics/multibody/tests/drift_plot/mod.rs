//! Energy and constraint drift over time as an SVG that needs nothing but itself.

use std::fmt::Write;

/// Width and height of one panel. [px]
const PANEL: (f64, f64) = (640.0, 190.0);
/// Left, and top and bottom margin. [px]
const MARGIN: (f64, f64) = (90.0, 34.0);
/// Most points that are drawn: of each stretch of time the extremes.
const STRETCHES: usize = 300;

/// Writes `FOLDER/drift-NAME.svg` where the environment names a folder; else nothing. Each row: time [s], energy
/// change relative to the benchmark's scale, largest |Φ| [m or -].
pub fn draw(name: &str, rows: &[[f64; 3]]) {
    let Some(folder) = std::env::var_os("KINGPIN_DRIFT") else { return };
    let file = name.replace('\'', "").replace(' ', "-").to_lowercase();
    let path = std::path::Path::new(&folder).join(format!("drift-{file}.svg"));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(&path, svg(name, rows)).unwrap();
    println!("{}", path.display());
}

fn svg(name: &str, rows: &[[f64; 3]]) -> String {
    let (width, height) = (PANEL.0 + MARGIN.0 + 20.0, 2.0 * (PANEL.1 + 2.0 * MARGIN.1));
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         font-family=\"system-ui,sans-serif\" font-size=\"12\"><rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for (panel, title) in [(1, "energy change, relative"), (2, "largest |Φ|")] {
        let top = MARGIN.1 + f64::from(panel - 1) * (PANEL.1 + 2.0 * MARGIN.1);
        let values = || rows.iter().map(|row| row[panel as usize]);
        let (low, high) = values().fold((0.0_f64, 0.0_f64), |(l, h), x| (l.min(x), h.max(x)));
        let span = (high - low).max(1e-300);
        let end = rows.last().map_or(1.0, |row| row[0]);
        let place = |t: f64, x: f64| (MARGIN.0 + PANEL.0 * t / end, top + PANEL.1 * (1.0 - (x - low) / span));
        let _ = writeln!(
            out,
            "<text x=\"{}\" y=\"{}\" font-weight=\"600\">{}: {title} over {end:.0} s</text>\n\
             <rect x=\"{}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#c3cbd6\"/>",
            MARGIN.0,
            top - 8.0,
            name.replace('\'', "’"),
            MARGIN.0,
            PANEL.0,
            PANEL.1
        );
        for x in [low, 0.5 * (low + high), high] {
            let (_, y) = place(0.0, x);
            let _ = writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{x:.1e}</text>",
                MARGIN.0 - 6.0,
                y + 4.0
            );
        }
        for k in 0..=5 {
            let t = end * f64::from(k) / 5.0;
            let _ = writeln!(
                out,
                "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{t:.0}</text>",
                place(t, low).0,
                top + PANEL.1 + 16.0
            );
        }
        let mut line = String::new();
        for chunk in rows.chunks(rows.len().div_ceil(STRETCHES).max(1)) {
            let of = |row: &[f64; 3]| row[panel as usize];
            let least = chunk.iter().min_by(|a, b| of(a).total_cmp(&of(b)));
            let most = chunk.iter().max_by(|a, b| of(a).total_cmp(&of(b)));
            let mut both: Vec<&[f64; 3]> = least.into_iter().chain(most).collect();
            both.sort_by(|a, b| a[0].total_cmp(&b[0]));
            for row in both {
                let (x, y) = place(row[0], of(row));
                let _ = write!(line, "{x:.1},{y:.1} ");
            }
        }
        let _ = writeln!(out, "<polyline points=\"{line}\" fill=\"none\" stroke=\"#0072b2\"/>");
    }
    out + "</svg>\n"
}
