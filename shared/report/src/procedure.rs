//! Procedures of the standards on logs: the signals a procedure needs, and a page with its conditions,
//! figures, rulings and plots.
//!
//! Signals: hand-wheel angle and torque as the rig measured them; motion from the car's state. The lateral
//! acceleration is horizontal, as the standards ask: a_y = d(v_y)/dt + ψ̇·v_x of the centre of gravity, formed
//! from the car's velocity, not the accelerometer on the rolling body.

use metrics::handling::{
    Assessment, CarFacts, FrequencyResponse, Layout, Signals, SteadyMethod, frequency_response, lane_change,
    random_steer, release, sine_with_dwell, slow_ramp, steady_turn, step_steer, weave,
};
use record::LogReader;
use serde_json::{Value, json};

use crate::figure::{BLUE, Figure, GREY, ORANGE, POINTS_MAX, PURPLE, escaped, full};
use crate::run::Run;
use crate::shell;

const DEG: f64 = 180.0 / std::f64::consts::PI;

/// What is assessed, with what the procedure must be told.
#[derive(Debug, Clone, PartialEq)]
pub enum Procedure {
    /// ISO 13674-1; the hand wheel's frequency in Hz.
    Weave(f64),
    /// Slow friction ramp.
    SlowRamp,
    /// ISO 4138.
    SteadyTurn(SteadyMethod),
    /// ISO 7401, clause 10.
    Step,
    /// ISO 7401, clause 12.
    Random,
    /// ISO 3888; the track and where it begins, in m.
    LaneChange(Layout, f64),
    /// FMVSS 126 and ISO 19365; the hand-wheel angle for 0.3 g in rad, if known.
    SineWithDwell(Option<f64>),
    /// Release of the hand wheel, at this time of the log in s.
    Release(f64),
}

/// The signals of a log from `from_s` to `to_s` of its time, over the ticks that have all of them.
///
/// # Errors
/// If the log lacks a signal, named.
pub fn signals(log: &LogReader, from_s: f64, to_s: f64) -> Result<Signals, String> {
    let run = Run::new(log);
    let t = run.period_s();
    let column = |region: &str, name: &str| {
        let all = run.numbers(region, name).ok_or_else(|| format!("the log has no {region}.{name}"))?;
        metrics::resample::bridge_gaps(&all).ok_or_else(|| format!("{region}.{name} holds no number"))
    };
    let state = |name: &str| column("vehicle_state", name);
    let (forward, left, yaw_rate) =
        (state("velocity_m_s.x")?, state("velocity_m_s.y")?, state("angular_velocity_rad_s.z")?);
    let n = run.len();
    let acceleration = (0..n)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(n - 1));
            (left[b] - left[a]) / ((b - a).max(1) as f64 * t) + yaw_rate[i] * forward[i]
        })
        .collect();
    let signals = Signals {
        sample_time_s: t,
        hand_wheel_angle_rad: column("rig_measurement", "steering_wheel_angle_rad")?,
        hand_wheel_torque_n_m: column("rig_measurement", "steering_wheel_torque_n_m")?,
        lateral_acceleration_m_s2: acceleration,
        yaw_rate_rad_s: yaw_rate,
        yaw_rad: state("yaw_rad")?,
        roll_rad: state("roll_rad")?,
        side_slip_rad: state("side_slip_rad")?,
        speed_m_s: forward,
        x_m: state("position_m.x")?,
        y_m: state("position_m.y")?,
    };
    let start = run.time_s().first().copied().unwrap_or(0.0);
    let index = |s: f64| (((s - start) / t).round().max(0.0) as usize).min(n);
    Ok(signals.part(index(from_s)..index(to_s)))
}

/// Hand-wheel angle over rack travel near straight running [rad/m], by least squares over the samples with less than
/// 90° at the hand wheel; so with the little that a torsion bar twists. None if it did not move enough to tell.
pub fn angle_per_rack(log: &LogReader) -> Option<f64> {
    let run = Run::new(log);
    let wheel = run.numbers("rig_measurement", "steering_wheel_angle_rad")?;
    let rack = run.numbers("rig_measurement", "rack_displacement_m")?;
    let (x, y): (Vec<f64>, Vec<f64>) =
        (0..run.len()).filter(|&i| wheel[i].abs() < 90_f64.to_radians()).map(|i| (rack[i], wheel[i])).unzip();
    metrics::fit::line(&x, &y).filter(|line| line.r_squared > 0.9).map(|line| line.slope)
}

/// Assesses signals by a procedure.
pub fn assess(procedure: &Procedure, signals: &Signals, car: &CarFacts) -> Assessment {
    match procedure {
        Procedure::Weave(frequency_hz) => weave(signals, *frequency_hz),
        Procedure::SlowRamp => slow_ramp(signals),
        Procedure::SteadyTurn(method) => steady_turn(signals, *method, car),
        Procedure::Step => step_steer(signals),
        Procedure::Random => random_steer(signals, car),
        Procedure::LaneChange(layout, start_m) => lane_change(signals, layout, *start_m, car),
        Procedure::SineWithDwell(amplitude) => sine_with_dwell(signals, *amplitude, car),
        Procedure::Release(at_s) => release(signals, *at_s),
    }
}

/// An assessment as JSON; withheld figures are null with their reason.
pub fn assessment_json(assessment: &Assessment) -> Value {
    json!({
        "procedure": assessment.procedure,
        "valid": assessment.valid(),
        "conditions": assessment.conditions.iter().map(|c| json!({
            "name": c.name, "unit": c.unit, "met": c.met(),
            "achieved": finite(c.achieved), "least": finite(c.least), "most": finite(c.most),
        })).collect::<Vec<_>>(),
        "figures": assessment.figures.iter().map(|f| json!({
            "name": f.name, "unit": f.unit,
            "value": f.value.as_ref().ok(), "withheld": f.value.as_ref().err(),
        })).collect::<Vec<_>>(),
        "rulings": assessment.rulings.iter().map(|r| json!({
            "rule": r.rule, "kept": r.kept.as_ref().ok(), "withheld": r.kept.as_ref().err(),
        })).collect::<Vec<_>>(),
    })
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// An assessment as text for a terminal.
pub fn assessment_text(assessment: &Assessment) -> String {
    let mut lines = vec![assessment.procedure.to_owned(), "  conditions achieved".to_owned()];
    for condition in &assessment.conditions {
        let mark = if condition.met() { "met    " } else { "NOT MET" };
        lines.push(format!("    {mark}  {condition}"));
    }
    lines.push("  figures".to_owned());
    for figure in &assessment.figures {
        lines.push(match &figure.value {
            Ok(value) => {
                let unit = if figure.unit == "1" { "" } else { figure.unit };
                format!("    {:<48} {:>10} {unit}", figure.name, short(*value)).trim_end().to_owned()
            }
            Err(reason) if reason.starts_with("condition") => {
                format!("    {:<48} withheld: a condition was not met", figure.name)
            }
            Err(reason) => format!("    {:<48} withheld: {reason}", figure.name),
        });
    }
    for ruling in &assessment.rulings {
        lines.push(match &ruling.kept {
            Ok(kept) => format!("  {}  {}", if *kept { "PASS" } else { "FAIL" }, ruling.rule),
            Err(reason) if reason.starts_with("condition") => {
                format!("  not judged  {}: a condition was not met", ruling.rule)
            }
            Err(reason) => format!("  not judged  {}: {reason}", ruling.rule),
        });
    }
    lines.join("\n")
}

/// Four significant digits.
pub(crate) fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

/// A run of a procedure on the page.
#[derive(Debug)]
pub struct Entry<'a> {
    /// What distinguishes it from the others, e.g. its amplitude.
    pub title: String,
    /// What was assessed.
    pub procedure: &'a Procedure,
    /// The signals assessed.
    pub signals: &'a Signals,
    /// The result.
    pub assessment: &'a Assessment,
    /// Link to the run's own report, relative to the page.
    pub link: Option<String>,
}

/// A page on one procedure, of one run or a series. Self-contained, offline, printable.
pub fn procedure_html(title: &str, facts: &[String], entries: &[Entry<'_>]) -> String {
    let mut page = shell::open(&format!("{title} – Kingpin procedure"));
    let rulings = || entries.iter().flat_map(|e| &e.assessment.rulings);
    let failed = rulings().any(|r| r.kept == Ok(false));
    let valid = entries.iter().all(|e| e.assessment.valid());
    let (badge, word) = match (valid, failed) {
        (_, true) => ("fail", "FAIL"),
        (false, _) => ("fail", "CONDITIONS NOT MET"),
        _ => ("pass", if rulings().next().is_some() { "PASS" } else { "VALID" }),
    };
    let facts: Vec<String> = facts.iter().map(|f| format!("<span>{}</span>", escaped(f))).collect();
    page += &format!(
        "<header><div class=\"bar\"><div><div class=\"brand\">Kingpin · procedure</div><h1>{}</h1>\
         <div class=\"facts\">{}</div></div><div class=\"badge {badge}\">{word}</div></div></header>\n<main>\n",
        escaped(title),
        facts.join("")
    );
    let figures = plots(entries);
    shell::section(&mut page, &figures);
    for entry in entries {
        tables(&mut page, entry);
    }
    page += "</main>\n";
    shell::close(&mut page, &figures);
    page
}

fn tables(page: &mut String, entry: &Entry<'_>) {
    let link = entry
        .link
        .as_deref()
        .map_or_else(String::new, |l| format!(" <a href=\"{}\">report of the run</a>", escaped(l)));
    *page += &format!(
        "<section><h2>{}{link}</h2><div class=\"columns\"><div><h3>Figures</h3><table>",
        escaped(&entry.title)
    );
    for figure in &entry.assessment.figures {
        let cell = match &figure.value {
            Ok(value) => {
                format!("<td class=\"number\">{}</td><td>{}</td>", short(*value), escaped(figure.unit))
            }
            Err(reason) => format!("<td colspan=\"2\">withheld: {}</td>", escaped(reason)),
        };
        *page += &format!("<tr><td>{}</td>{cell}</tr>", escaped(figure.name));
    }
    *page += "</table></div><div><h3>Conditions achieved</h3><table>";
    for condition in &entry.assessment.conditions {
        let (class, word) = if condition.met() { ("pass", "met") } else { ("fail", "not met") };
        *page += &format!(
            "<tr class=\"{class}\"><td>{}</td><td>{word}</td></tr>",
            escaped(&condition.to_string())
        );
    }
    *page += "</table>";
    if !entry.assessment.rulings.is_empty() {
        *page += "<h3>Rules</h3><table>";
        for ruling in &entry.assessment.rulings {
            let (class, word) = match &ruling.kept {
                Ok(true) => ("pass", "pass".to_owned()),
                Ok(false) => ("fail", "FAIL".to_owned()),
                Err(reason) => ("withheld", format!("not judged: {reason}")),
            };
            *page += &format!(
                "<tr class=\"{class}\"><td>{}</td><td>{}</td></tr>",
                escaped(ruling.rule),
                escaped(&word)
            );
        }
        *page += "</table>";
    }
    *page += "</div></div></section>\n";
}

const COLOURS: [&str; 6] = [BLUE, ORANGE, "#009e73", PURPLE, "#e0a100", GREY];

fn plots(entries: &[Entry<'_>]) -> Vec<Figure> {
    let Some(first) = entries.first() else { return Vec::new() };
    let scaled = |values: &[f64], scale: f64| values.iter().map(|v| scale * v).collect::<Vec<f64>>();
    type Pick = fn(&Signals) -> &Vec<f64>;
    let over_time = |title: &str, unit: &str, scale: f64, pick: Pick| {
        let mut figure = Figure::over_time(title, unit);
        for (k, entry) in entries.iter().enumerate() {
            let s = entry.signals;
            let time: Vec<f64> = (0..s.len()).map(|i| i as f64 * s.sample_time_s).collect();
            figure.curve(&entry.title, &time, pick(s), scale, full(COLOURS[k % COLOURS.len()]));
        }
        figure
    };
    let cross = |title: &str, x: (&str, f64, Pick), y: (&str, f64, Pick)| {
        let mut figure = Figure::new(title, x.0, y.0).layout(&json!({"hovermode": "closest"}));
        for (k, entry) in entries.iter().enumerate() {
            let s = entry.signals;
            let every = (s.len() / POINTS_MAX).max(1);
            let thin = |pick: Pick, scale: f64| {
                scaled(&pick(s)[..s.len()], scale).into_iter().step_by(every).collect::<Vec<_>>()
            };
            figure.push(
                &entry.title,
                &thin(x.2, x.1),
                &thin(y.2, y.1),
                full(COLOURS[k % COLOURS.len()]),
                &json!({}),
            );
        }
        figure
    };
    let angle: (&str, f64, Pick) = ("hand-wheel angle in °", DEG, |s| &s.hand_wheel_angle_rad);
    let torque: (&str, f64, Pick) = ("hand-wheel torque in N·m", 1.0, |s| &s.hand_wheel_torque_n_m);
    let acceleration: (&str, f64, Pick) =
        ("lateral acceleration in m/s²", 1.0, |s| &s.lateral_acceleration_m_s2);
    let time_angle = over_time("Hand-wheel angle", angle.0, angle.1, angle.2);
    let time_acceleration = over_time("Lateral acceleration", acceleration.0, 1.0, acceleration.2);
    let time_yaw = over_time("Yaw rate", "yaw rate in °/s", DEG, |s| &s.yaw_rate_rad_s);
    let time_torque = over_time("Hand-wheel torque", torque.0, 1.0, torque.2);
    let torque_angle = cross("Torque over angle", angle, torque);
    match first.procedure {
        Procedure::Weave(_) | Procedure::SlowRamp => vec![
            torque_angle,
            cross("Torque over lateral acceleration", acceleration, torque),
            cross("Lateral acceleration over angle", angle, acceleration),
            time_angle,
            time_acceleration,
            time_torque,
        ],
        Procedure::SteadyTurn(_) => vec![
            cross("Angle over lateral acceleration", acceleration, angle),
            cross("Torque over lateral acceleration", acceleration, torque),
            cross(
                "Side slip over lateral acceleration",
                acceleration,
                ("side-slip angle in °", DEG, |s| &s.side_slip_rad),
            ),
            cross("Roll over lateral acceleration", acceleration, ("roll angle in °", DEG, |s| &s.roll_rad)),
            over_time("Speed", "speed in km/h", 3.6, |s| &s.speed_m_s),
        ],
        Procedure::Random => {
            let mut figures = bode(first);
            figures.extend([time_angle, time_yaw]);
            figures
        }
        Procedure::LaneChange(layout, start_m) => {
            let mut path = cross(
                "Path of the centre of gravity and cones",
                ("x in m", 1.0, |s| &s.x_m),
                ("y in m", 1.0, |s| &s.y_m),
            );
            for gate in &layout.gates {
                for edge in [gate.left_m, gate.right_m] {
                    let x = [start_m + gate.from_m, start_m + gate.to_m];
                    path.push(
                        "cones",
                        &x,
                        &[edge, edge],
                        full(ORANGE),
                        &json!({"mode": "lines+markers", "showlegend": false}),
                    );
                }
            }
            path.wide = true;
            vec![path, time_angle, time_acceleration, time_torque, time_yaw]
        }
        Procedure::Step | Procedure::Release(_) | Procedure::SineWithDwell(_) => {
            vec![time_angle, time_yaw, time_acceleration, time_torque, torque_angle]
        }
    }
}

fn bode(entry: &Entry<'_>) -> Vec<Figure> {
    let s = entry.signals;
    let every = ((0.02 / s.sample_time_s) as usize).max(1);
    let thin = |values: &[f64]| values.iter().copied().step_by(every).collect::<Vec<f64>>();
    let input = thin(&s.hand_wheel_angle_rad);
    let step = s.sample_time_s * every as f64;
    let mut gain =
        Figure::new("Gain over hand-wheel angle", "frequency in Hz", "gain, 1 at the lowest frequency");
    let mut phase = Figure::new("Phase", "frequency in Hz", "phase in °");
    let mut coherence = Figure::new("Coherence", "frequency in Hz", "coherence");
    for (name, values, colour) in [
        ("yaw rate", &s.yaw_rate_rad_s, BLUE),
        ("lateral acceleration", &s.lateral_acceleration_m_s2, ORANGE),
        ("hand-wheel torque", &s.hand_wheel_torque_n_m, PURPLE),
    ] {
        let found = frequency_response(&input, &thin(values), step, 10.0, 0.1..=3.0);
        let Some(first) = found.first() else { continue };
        let x: Vec<f64> = found.iter().map(|r| r.frequency_hz).collect();
        let of = |pick: &dyn Fn(&FrequencyResponse) -> f64| found.iter().map(pick).collect::<Vec<f64>>();
        gain.push(name, &x, &of(&|r| r.gain / first.gain), full(colour), &json!({}));
        phase.push(name, &x, &of(&|r| r.phase_rad * DEG), full(colour), &json!({}));
        coherence.push(name, &x, &of(&|r| r.coherence), full(colour), &json!({}));
    }
    vec![gain, phase, coherence]
}
