//! Diagram of a model as SVG: frames as nested boxes (a frame of two or three dimensions has a solid border, its
//! angle written on it), parts as filled boxes with their ports, joints as lines. Layout is a plain grid, the same
//! for the same model.

use std::fmt::Write;

use crate::flat::Flat;
use crate::model::System;

const WIDE: f64 = 170.0;
const LINE: f64 = 16.0;
const GAP: f64 = 46.0;
const PAD: f64 = 16.0;
const HEAD: f64 = 26.0;

#[derive(Clone, Copy, Default)]
struct Rectangle {
    x: f64,
    y: f64,
    w: f64,
    h: f64,
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Size of a box and the offsets of its children.
fn measure(flat: &Flat, at: usize, place: &mut [Rectangle]) {
    let children: Vec<usize> = (0..flat.boxes.len()).filter(|b| flat.boxes[*b].parent == Some(at)).collect();
    if children.is_empty() {
        let ports = flat.boxes[at].block.map_or(0, |b| flat.blocks[b].ports.len());
        place[at].w = WIDE;
        place[at].h = HEAD + LINE * ports.max(1) as f64 + 8.0;
        return;
    }
    for c in &children {
        measure(flat, *c, place);
    }
    let columns = (children.len() as f64).sqrt().ceil() as usize;
    let (mut y, mut widest) = (HEAD + PAD, 0.0f64);
    for row in children.chunks(columns) {
        let (mut x, mut tall) = (PAD, 0.0f64);
        for c in row {
            place[*c].x = x;
            place[*c].y = y;
            x += place[*c].w + GAP;
            tall = tall.max(place[*c].h);
        }
        widest = widest.max(x - GAP + PAD);
        y += tall + GAP;
    }
    place[at].w = widest.max(WIDE + 2.0 * PAD);
    place[at].h = y - GAP + PAD;
}

impl System {
    /// The diagram as one SVG document.
    pub fn diagram(&self) -> String {
        let flat = self.flat.borrow();
        let mut place = vec![Rectangle::default(); flat.boxes.len()];
        measure(&flat, 0, &mut place);
        // Children come after their parents: offsets become absolute in one pass.
        place[0].x = 8.0;
        place[0].y = 8.0;
        for b in 1..flat.boxes.len() {
            if let Some(p) = flat.boxes[b].parent {
                place[b].x += place[p].x;
                place[b].y += place[p].y;
            }
        }
        let (w, h) = (place[0].w + 16.0, place[0].h + 60.0);
        let mut s = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w:.0} {h:.0}\" width=\"{w:.0}\" height=\"{h:.0}\" font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
        );
        for (b, r) in flat.boxes.iter().zip(&place) {
            let part = b.block.is_some();
            let fill = if part { "#eef4fb" } else { "none" };
            let dash = if b.dim >= 2 { "" } else { " stroke-dasharray=\"5 3\"" };
            let name = if b.name.is_empty() { "model" } else { &b.name };
            let how = if b.placed.is_empty() { String::new() } else { format!(" | {}", b.placed) };
            let _ = writeln!(
                s,
                "<g class=\"{}\" id=\"{}\"><rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" rx=\"6\" fill=\"{fill}\" stroke=\"#345\"{dash}/><text x=\"{:.1}\" y=\"{:.1}\" font-weight=\"bold\">{}</text><text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\" fill=\"#567\">{}-D{}</text></g>",
                if part { "part" } else { "frame" },
                escape(&b.path),
                r.x,
                r.y,
                r.w,
                r.h,
                r.x + 8.0,
                r.y + 15.0,
                escape(name),
                r.x + 14.0 + 7.5 * name.len() as f64,
                r.y + 15.0,
                b.dim,
                escape(&how)
            );
        }
        let anchor = |block: usize, port: usize| -> (f64, f64) {
            let b = flat.boxes.iter().position(|b| b.block == Some(block)).unwrap_or(0);
            (place[b].x, place[b].y + HEAD + LINE * port as f64 + 4.0)
        };
        for (b, block) in flat.blocks.iter().enumerate() {
            for (p, port) in block.ports.iter().enumerate() {
                let (x, y) = anchor(b, p);
                let given = if port.gives_across { &port.across.0 } else { &port.through.0 };
                let _ = writeln!(
                    s,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"{}\"/><text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\">{} (gives {})</text>",
                    if port.gives_across { "#c33" } else { "#36c" },
                    x + 8.0,
                    y + 3.5,
                    escape(&port.name),
                    escape(given)
                );
            }
        }
        for c in &flat.couplings {
            let points: Vec<(f64, f64)> = c.members.iter().map(|m| anchor(m.0, m.1)).collect();
            let title = escape(&c.name);
            if c.outside.is_some() {
                let (x, y) = points[0];
                let _ = writeln!(
                    s,
                    "<path class=\"open\" d=\"M {x:.1} {y:.1} h -14\" stroke=\"#2a7\" stroke-width=\"2\" fill=\"none\"><title>{title}</title></path>"
                );
                continue;
            }
            for pair in points.windows(2) {
                let ((ax, ay), (bx, by)) = (pair[0], pair[1]);
                let reach = 18.0 + 0.12 * (ay - by).abs().min(120.0);
                let _ = writeln!(
                    s,
                    "<path class=\"joint\" d=\"M {ax:.1} {ay:.1} C {:.1} {ay:.1} {:.1} {by:.1} {bx:.1} {by:.1}\" stroke=\"#444\" fill=\"none\"><title>{title}</title></path>",
                    ax - reach,
                    bx - reach
                );
            }
        }
        let _ = writeln!(
            s,
            "<text x=\"12\" y=\"{:.1}\" font-size=\"10\" fill=\"#567\">red port: gives across (velocity, pressure, voltage); blue: gives through (force, flow, current); green: open; solid frame: 2-D or 3-D</text>\n</svg>",
            place[0].h + 32.0
        );
        s
    }
}
