//! The figures of a run. Angles in degrees, speeds in km/h, lengths in mm on screen; SI in the log.

use metrics::statistics::LogHistogram;
use metrics::tracking::error_signal;
use serde_json::{Value, json};

use crate::decimate::stride;
use crate::figure::{
    BLACK, BLUE, Figure, GREEN, GREY, ORANGE, POINTS_MAX, PURPLE, RECORD, Style, asked, axis, escaped, full,
    numbers, pretty_unit,
};
use crate::overlay::{Overlay, record_points};
use crate::run::Run;
use crate::source_figures::{LATERAL, STEERING, title};
use crate::table::{FLAGGED, STATES, state_name};

const DEG: f64 = 180.0 / std::f64::consts::PI;
const KMH: f64 = 3.6;
const MM: f64 = 1e3;

/// Name on the curve, full name of the signal, look.
type Line<'a> = (&'a str, &'a str, Style);

/// Draws figures of one run with the measured records that belong to it.
pub(crate) struct Drawer<'a> {
    pub run: &'a Run<'a>,
    pub overlays: &'a [Overlay],
    /// Overlays that found their figure.
    pub drawn: Vec<bool>,
}

impl<'a> Drawer<'a> {
    pub fn new(run: &'a Run<'a>, overlays: &'a [Overlay]) -> Self {
        Drawer { run, overlays, drawn: vec![false; overlays.len()] }
    }

    /// All figures, those without any curve left out.
    pub fn all(&mut self) -> Vec<Figure> {
        let mut figures = vec![
            self.time(
                title::ANGLE,
                "angle in °",
                DEG,
                &[
                    ("command", "vehicle_state.steering_wheel_angle_command_rad", asked(GREY)),
                    ("measured", "rig_measurement.steering_wheel_angle_rad", full(BLUE)),
                ],
            ),
            self.time(
                "Speed",
                "speed in km/h",
                KMH,
                &[
                    ("target", "vehicle_state.target_speed_m_s", asked(GREY)),
                    ("car, along x", "vehicle_state.velocity_m_s.x", full(BLUE)),
                ],
            ),
            self.time(
                title::ACCELERATION,
                "acceleration in m/s²",
                1.0,
                &[("bench", "vehicle_state.acceleration_m_s2.y", full(BLUE))],
            ),
            self.time(
                "Yaw rate",
                "yaw rate in °/s",
                DEG,
                &[("bench", "vehicle_state.angular_velocity_rad_s.z", full(BLUE))],
            ),
            self.force("left", BLUE),
            self.force("right", ORANGE),
            self.force_error(),
            self.time(
                "Rack displacement",
                "displacement in mm",
                MM,
                &[
                    ("true (virtual plant)", "rig_status.true_rack_displacement_m", full(GREEN)),
                    ("measured", "rig_measurement.rack_displacement_m", asked(BLUE)),
                ],
            ),
            self.time(
                "Ball heights",
                "height minus design in mm",
                MM,
                &[
                    ("left command", "rig_status.ball_height_applied_m.left", asked(GREY)),
                    ("left", "rig_measurement.vertical_stroke_m.left", full(BLUE)),
                    ("right command", "rig_status.ball_height_applied_m.right", asked(BLACK)),
                    ("right", "rig_measurement.vertical_stroke_m.right", full(ORANGE)),
                ],
            ),
            self.time(
                "Roll and side-slip angle",
                "angle in °",
                DEG,
                &[
                    ("roll", "vehicle_state.roll_rad", full(BLUE)),
                    ("side slip", "vehicle_state.side_slip_rad", full(PURPLE)),
                ],
            ),
            self.torque_over_angle(),
            self.torque_over_acceleration(),
            self.path(),
        ];
        figures.extend(self.left_over_overlays());
        figures.push(self.timeline());
        figures.extend(self.timing());
        figures.retain(|figure| !figure.is_empty());
        figures
    }

    /// A figure over time with the measured records that belong to its signals.
    fn time(&mut self, title: &str, y_title: &str, scale: f64, lines: &[Line<'_>]) -> Figure {
        let mut figure = Figure::over_time(title, y_title);
        for (_, signal, _) in lines {
            self.draw_overlays(&mut figure, signal, scale);
        }
        for (name, signal, style) in lines {
            if let Ok(signal) = self.run.log.signal(signal)
                && signal.value.iter().any(|v| v.is_finite())
            {
                let (time_s, value) = with_gaps(&signal.time_s, &signal.value, self.run.period_s());
                figure.curve(name, &time_s, &value, scale, *style);
            }
        }
        if figure.data.len() == 1 {
            figure = figure.layout(&json!({ "showlegend": false }));
        }
        figure
    }

    fn draw_overlays(&mut self, figure: &mut Figure, signal: &str, scale: f64) {
        for (i, overlay) in self.overlays.iter().enumerate().filter(|(_, o)| o.target == signal) {
            let known = self.run.log.signal(signal).is_ok_and(|s| s.unit == overlay.unit);
            if known {
                figure.curve(&overlay.title, &overlay.time_s, &overlay.value, scale, RECORD);
                self.drawn[i] = true;
            }
        }
    }

    /// Records of signals that no figure shows.
    fn left_over_overlays(&mut self) -> Vec<Figure> {
        let mut figures = Vec::new();
        let overlays = self.overlays;
        for (i, overlay) in overlays.iter().enumerate() {
            if self.drawn[i] {
                continue;
            }
            // A record of an unknown signal or in another unit has its reason in the table.
            if !self.run.log.signal(&overlay.target).is_ok_and(|s| s.unit == overlay.unit) {
                continue;
            }
            let y_title = format!("value in {}", pretty_unit(&overlay.unit));
            figures.push(self.time(
                &overlay.target,
                &y_title,
                1.0,
                &[("bench", &overlay.target, full(BLUE))],
            ));
        }
        figures
    }

    fn force(&mut self, side: &str, colour: &'static str) -> Figure {
        let names = [
            format!("suspension_state.tie_rod_force_n.{side}"),
            format!("rig_status.tie_rod_force_command_n.{side}"),
            format!("rig_measurement.tie_rod_force_n.{side}"),
            format!("rig_status.true_tie_rod_force_n.{side}"),
        ];
        // The rig's own record of the command carries the tick it acted on; without it the sender's.
        let command = if self.run.log.signal(&names[1]).is_ok() { &names[1] } else { &names[0] };
        self.time(
            if side == "left" { title::FORCE_LEFT } else { title::FORCE_RIGHT },
            "force in N (tension positive)",
            1.0,
            &[
                ("true (virtual plant)", &names[3], Style { colour: GREEN, dash: "dot", width: 1.2 }),
                ("measured", &names[2], full(colour)),
                ("command", command, asked(BLACK)),
            ],
        )
    }

    fn force_error(&self) -> Figure {
        let mut figure = Figure::over_time(title::FORCE_ERROR, "error in N");
        let time_s = self.run.time_s();
        for (side, colour) in [("left", BLUE), ("right", ORANGE)] {
            let command = self.run.numbers("rig_status", &format!("tie_rod_force_command_n.{side}"));
            let measured = self.run.numbers("rig_measurement", &format!("tie_rod_force_n.{side}"));
            if let (Some(command), Some(measured)) = (command, measured)
                && let Ok(error) = error_signal(&command, &measured, self.run.period_s())
                && error.iter().any(|v| v.is_finite())
            {
                figure.curve(side, &time_s, &error, 1.0, full(colour));
            }
        }
        figure.note = Some("Both through the same zero-phase 50 Hz filter.".to_owned());
        figure
    }

    /// Points of the time in which steering is active, thinned; the whole run if it never is.
    fn loop_points(&self, x: (&str, &str), y: (&str, &str)) -> Option<(Vec<f64>, Vec<f64>)> {
        let (x, y) = (self.run.numbers(x.0, x.1)?, self.run.numbers(y.0, y.1)?);
        let active = self.run.active().filter(|a| a.contains(&true));
        let points: Vec<(f64, f64)> = (0..x.len())
            .filter(|&i| active.as_ref().is_none_or(|a| a[i]) && x[i].is_finite() && y[i].is_finite())
            .map(|i| (x[i], y[i]))
            .collect();
        let step = stride(points.len(), 2 * POINTS_MAX);
        let points: (Vec<f64>, Vec<f64>) = points.into_iter().step_by(step).unzip();
        (points.0.len() > 1).then_some(points)
    }

    /// The measured loop, where torque and its abscissa are recorded.
    fn record_loop(&self, figure: &mut Figure, over: &str, scale: f64) {
        if let Some((x, y)) = record_points(self.run, self.overlays, over) {
            let step = stride(x.len(), 2 * POINTS_MAX);
            let thin = |v: &[f64], scale: f64| v.iter().step_by(step).map(|v| v * scale).collect::<Vec<_>>();
            figure.push("measured", &thin(&x, scale), &thin(&y, 1.0), RECORD, &json!({}));
        }
    }

    fn torque_over_angle(&self) -> Figure {
        let mut figure =
            Figure::new(title::TORQUE_ANGLE, "steering-wheel angle in °", "steering-wheel torque in N·m")
                .layout(&json!({ "hovermode": "closest" }));
        self.record_loop(&mut figure, STEERING, DEG);
        let angle = ("rig_measurement", "steering_wheel_angle_rad");
        if let Some((x, y)) = self.loop_points(angle, ("rig_measurement", "steering_wheel_torque_n_m")) {
            let x: Vec<f64> = x.into_iter().map(|v| v * DEG).collect();
            figure.push("bench", &x, &y, full(BLUE), &json!({}));
        }
        figure
    }

    fn torque_over_acceleration(&self) -> Figure {
        let mut figure = Figure::new(
            title::TORQUE_ACCELERATION,
            "lateral acceleration in m/s²",
            "steering-wheel torque in N·m",
        )
        .layout(&json!({ "hovermode": "closest" }));
        self.record_loop(&mut figure, LATERAL, 1.0);
        let acceleration = ("vehicle_state", "acceleration_m_s2.y");
        let torque = ("rig_measurement", "steering_wheel_torque_n_m");
        if let Some((x, y)) = self.loop_points(acceleration, torque) {
            figure.push("bench", &x, &y, full(BLUE), &json!({}));
        }
        figure
    }

    fn path(&self) -> Figure {
        let mut figure = Figure::new("Path of the car", "x in m", "y in m (left positive)")
            .layout(&json!({ "hovermode": "closest", "showlegend": false }));
        let x = self.run.numbers("vehicle_state", "position_m.x");
        let y = self.run.numbers("vehicle_state", "position_m.y");
        let (Some(x), Some(y)) = (x, y) else { return figure };
        let step = stride(x.len(), 2 * POINTS_MAX);
        let thin = |v: &[f64]| v.iter().copied().step_by(step).collect::<Vec<_>>();
        let span = |v: &[f64]| metrics::statistics::range(v).map_or(0.0, |(a, b)| b - a);
        let ratio = span(&x).max(1.0) / span(&y).max(1.0);
        if (0.2..6.0).contains(&ratio) {
            figure = figure.layout(&json!({ "yaxis": { "scaleanchor": "x", "scaleratio": 1 } }));
        } else {
            figure.note = Some("Axes are not to the same scale.".to_owned());
        }
        if x.iter().any(|v| v.is_finite()) {
            figure.push("path", &thin(&x), &thin(&y), full(BLUE), &json!({}));
        }
        figure
    }

    /// Bench state above, flags below, events as marks.
    fn timeline(&self) -> Figure {
        let mut figure = Figure::over_time("Bench state, flags and events", "");
        figure.wide = true;
        let time_s = self.run.time_s();
        let Some(states) = self.run.words("rig_status", "state") else { return figure };
        let changes = changes(&states);
        let (x, y): (Vec<f64>, Vec<f64>) = changes
            .iter()
            .map(|&(i, state)| (time_s[i], state.map_or(f64::NAN, |s| s as f64)))
            .chain(
                time_s.last().map(|&t| (t, states.last().copied().flatten().map_or(f64::NAN, |s| s as f64))),
            )
            .unzip();
        let names: Vec<String> =
            y.iter().map(|v| if v.is_finite() { state_name(*v as u64) } else { String::new() }).collect();
        figure.push(
            "state",
            &x,
            &y,
            Style { width: 2.4, ..full(BLUE) },
            &json!({
                "line": { "shape": "hv" }, "text": names, "hovertemplate": "%{text}<extra></extra>",
            }),
        );
        let segments = self.flag_segments(&time_s);
        self.draw_events(&mut figure);
        let bottom = if segments.is_empty() { 0.0 } else { (0.1 + 0.06 * segments.len() as f64).min(0.6) };
        for (name, x) in &segments {
            let y: Vec<Value> =
                x.iter().map(|t| if t.is_finite() { json!(name) } else { Value::Null }).collect();
            figure.data.push(json!({
                "type": "scatter", "mode": "lines", "name": name, "x": numbers(x, 8), "y": y,
                "yaxis": "y2", "line": { "color": ORANGE, "width": 9 }, "hovertemplate": "%{y}<extra></extra>",
            }));
        }
        if segments.is_empty() {
            figure.note = Some("No flag was set on any tick.".to_owned());
        }
        let ticks: Vec<usize> = (0..STATES.len()).collect();
        let mut lower = axis("");
        crate::figure::merge(
            &mut lower,
            &json!({ "type": "category", "domain": [0, (bottom - 0.06).max(0.0)], "showgrid": true }),
        );
        let mut layout = json!({
            "showlegend": false, "hovermode": "closest",
            "height": 320.0 + 22.0 * segments.len() as f64,
            "margin": { "l": 150 },
            "xaxis": { "anchor": if segments.is_empty() { "y" } else { "y2" } },
            "yaxis": { "tickvals": ticks, "ticktext": STATES, "range": [-0.5, 8.9], "domain": [bottom, 1] },
        });
        if !segments.is_empty() {
            layout["yaxis2"] = lower;
        }
        figure.layout(&layout)
    }

    fn draw_events(&self, figure: &mut Figure) {
        const EVENTS_MAX: usize = 300;
        let events: Vec<_> = self.run.log.events.iter().take(EVENTS_MAX).collect();
        if events.is_empty() {
            return;
        }
        let x: Vec<f64> = events.iter().map(|e| e.time_s).collect();
        let text: Vec<String> =
            events.iter().map(|e| escaped(&format!("{}: {}", e.kind, e.text()))).collect();
        figure.data.push(json!({
            "type": "scatter", "mode": "markers", "name": "events", "x": numbers(&x, 8),
            "y": vec![8.6; x.len()], "text": text, "hovertemplate": "%{x} s %{text}<extra></extra>",
            "marker": { "symbol": "triangle-down", "size": 9, "color": BLACK },
        }));
    }

    /// Per flag that was ever set: start, end, NaN for every stretch of ticks.
    fn flag_segments(&self, time_s: &[f64]) -> Vec<(String, Vec<f64>)> {
        const STRETCHES_MAX: usize = 1000;
        let mut found = Vec::new();
        for (region, prefix, bits) in FLAGGED {
            let Some(words) = self.run.words(region, "flags") else { continue };
            for (bit, name) in bits {
                let set: Vec<Option<u64>> =
                    words.iter().map(|w| Some(u64::from(w.is_some_and(|w| w & bit != 0)))).collect();
                let changes = changes(&set);
                let mut x = Vec::new();
                for (i, &(start, on)) in changes.iter().enumerate() {
                    if on == Some(1) && x.len() < 3 * STRETCHES_MAX {
                        let end = changes.get(i + 1).map_or(set.len() - 1, |&(end, _)| end);
                        // A single tick must still be seen: at least a thousandth of the run.
                        let least = (time_s[time_s.len() - 1] - time_s[0]) * 1e-3;
                        x.extend([time_s[start], time_s[end].max(time_s[start] + least), f64::NAN]);
                    }
                }
                if !x.is_empty() {
                    found.push((format!("{prefix}: {name}"), x));
                }
            }
        }
        found
    }

    fn timing(&self) -> Vec<Figure> {
        if self.run.log.header.lockstep {
            return Vec::new();
        }
        let services = [("rig", BLUE), ("vehicle", ORANGE), ("multibody", GREEN)];
        let mut lateness = histogram("Wake-up lateness", "wake-up after the time aimed at, in µs");
        let mut compute = histogram("Compute time", "time of a step, in µs");
        let mut over_time =
            Figure::over_time("End of each step within the tick", "after start of tick, in ms");
        for (service, colour) in services {
            let region = format!("{service}_timing");
            if let Some(values) = self.run.numbers(&region, "wake_lateness_s") {
                add_histogram(&mut lateness, service, &values, colour);
            }
            if let Some(values) = self.run.numbers(&region, "compute_s") {
                add_histogram(&mut compute, service, &values, colour);
            }
            // The rig's own step ends with the sample; its output phase is judged by the margin.
            if let Some(values) = self.run.numbers(&region, "done_s")
                && values.iter().any(|v| v.is_finite())
            {
                over_time.curve(
                    service,
                    &self.run.time_s(),
                    &values,
                    1e3,
                    Style { width: 1.0, ..full(colour) },
                );
            }
        }
        let mut margin = histogram(
            "Arrival of the command before the output phase",
            "margin in µs (late commands in the summary)",
        );
        if let Some(values) = self.run.numbers("rig_timing", "margin_s") {
            add_histogram(&mut margin, "margin", &values, BLUE);
        }
        vec![lateness, compute, margin, over_time]
    }
}

fn histogram(title: &str, x_title: &str) -> Figure {
    Figure::new(title, x_title, "ticks").layout(&json!({
        "xaxis": { "type": "log", "exponentformat": "none", "dtick": 1 },
        "yaxis": { "type": "log", "exponentformat": "power", "dtick": 1 },
        "hovermode": "closest",
    }))
}

fn add_histogram(figure: &mut Figure, name: &str, values: &[f64], colour: &'static str) {
    let h = LogHistogram::of(values, 1e-7, 1.0, 140);
    let first = h.counts.iter().position(|&n| n > 0);
    let (Some(first), Some(last)) = (first, h.counts.iter().rposition(|&n| n > 0)) else { return };
    // Steps: each count from its lower border on; a half below the first and after the last closes the shape.
    let mut x: Vec<f64> = h.borders[first..=last + 1].iter().map(|b| b * 1e6).collect();
    let mut y: Vec<f64> =
        h.counts[first..=last].iter().map(|&n| if n > 0 { n as f64 } else { 0.5 }).collect();
    x.insert(0, h.borders[first] * 1e6);
    y.insert(0, 0.5);
    y.push(0.5);
    figure.push(
        name,
        &x,
        &y,
        full(colour),
        &json!({
            "line": { "shape": "hv" }, "fill": "tozeroy", "fillcolor": format!("{colour}22"),
            "hovertemplate": "%{x:.3g} µs: %{y} ticks",
        }),
    );
    let top = figure
        .data
        .iter()
        .filter_map(|t| t["y"].as_array())
        .flatten()
        .filter_map(Value::as_f64)
        .fold(1.0, f64::max);
    figure.layout["yaxis"]["range"] = json!([-0.3, top.log10() + 0.25]);
    // Whole decades, so that the axis has labels even where all values are alike.
    let old = |i: usize| figure.layout["xaxis"]["range"][i].as_f64();
    let low = (h.borders[first] * 1e6).log10().floor();
    let high = (h.borders[last + 1] * 1e6).log10().ceil();
    let range = json!([old(0).map_or(low, |o| o.min(low)), old(1).map_or(high, |o| o.max(high))]);
    figure.layout["xaxis"]["range"] = range;
}

/// Where a sequence changes its value: index and new value, the first one included.
fn changes(words: &[Option<u64>]) -> Vec<(usize, Option<u64>)> {
    let mut out: Vec<(usize, Option<u64>)> = Vec::new();
    for (i, &word) in words.iter().enumerate() {
        if out.last().is_none_or(|&(_, last)| last != word) {
            out.push((i, word));
        }
    }
    out
}

/// A signal with an absent value put into every hole of its time base, so that no line crosses it.
fn with_gaps(time_s: &[f64], value: &[f64], period_s: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut t, mut v) = (Vec::with_capacity(time_s.len()), Vec::with_capacity(time_s.len()));
    for (i, (&time, &x)) in time_s.iter().zip(value).enumerate() {
        if i > 0 && time - time_s[i - 1] > 1.5 * period_s {
            t.push(time_s[i - 1] + period_s);
            v.push(f64::NAN);
        }
        t.push(time);
        v.push(x);
    }
    (t, v)
}
