//! `rig identify`: tests of every axis, report, and the parameters for the controller.

use super::{Ended, cell, write};
use crate::commands::suspension::page;
use crate::exit::Exit;
use crate::output;
use assembly::identification::{Identified, TestPlan, identify as tests};
use clap::Args as ClapArgs;
use config::ResolvedBench;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::json;
use std::path::PathBuf;

/// Arguments of `rig identify`.
#[derive(Debug, ClapArgs)]
#[command(after_help = "\
Tests, all as commands within the rig's limits: multisines on tie-rod force and ball height (left and right on lines
of their own), chirp and binary sequence on the left force, a multisine of the steering angle, slow ramps without
assist for friction, and steps. Found are speed, delay and valve of each cylinder, stiffness between arm and rack,
moving mass, inertia and torque lag of the steer actuator, friction of rack and column.

Written: report.html, rig.toml (extends the rig by what was found), identified.json.
Example:
  kingpin rig identify --set rig.plant.leaf_spring_stiffness_n_m=3.6e5 --output found
  kingpin run lane_change_120 --lockstep --set 'rig_file=\"found/rig.toml\"'")]
pub struct IdentifyArgs {
    /// Scenario whose rig, steering unit and timing are taken
    #[arg(long, default_value = "slalom_120", value_name = "SCENARIO")]
    scenario: String,
    /// Replace a value, as in `run`; may be repeated
    #[arg(long, value_name = "PATH=VALUE")]
    set: Vec<String>,
    /// Directory for the results; made if absent
    #[arg(long, value_name = "DIR")]
    output: PathBuf,
    /// Peak of the tested tie-rod force [N]
    #[arg(long, default_value_t = 400.0, value_name = "N")]
    force: f64,
    /// Peak of the tested height [mm]
    #[arg(long, default_value_t = 6.0, value_name = "MM")]
    height: f64,
    /// Print what was found as JSON
    #[arg(long)]
    json: bool,
}

/// `kingpin rig identify`.
pub fn identify(args: &IdentifyArgs) -> Result<Exit, Ended> {
    if !(args.force > 0.0 && args.force <= 3000.0 && args.height > 0.0 && args.height <= 40.0) {
        return Err(Ended::Input("--force must be in (0, 3000] N and --height in (0, 40] mm".to_owned()));
    }
    let resolved = ResolvedBench::load(&args.scenario, &args.set)?;
    std::fs::create_dir_all(&args.output)
        .map_err(|error| Ended::Failed(format!("{}: {error}", args.output.display())))?;
    let plan = TestPlan { force_n: args.force, height_m: 1e-3 * args.height, ..TestPlan::default() };
    let bar = ProgressBar::new(100);
    if args.json {
        bar.set_draw_target(ProgressDrawTarget::hidden());
    }
    let style = ProgressStyle::with_template("{bar:30} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let scenario = &resolved.scenario;
    let (period_s, phase) = (scenario.timing.period_s(), scenario.timing.output_phase);
    let found = tests(&resolved.rig, &resolved.unit, scenario.seed, period_s, phase, &plan, |what, part| {
        bar.set_position((100.0 * part) as u64);
        bar.set_message(what.to_owned());
    })
    .map_err(|error| Ended::Failed(error.to_string()))?;
    bar.finish_and_clear();

    let rows = parameters(&found, &resolved);
    let toml = found.to_toml(&resolved.rig, &scenario.rig_file);
    let steps: Vec<_> = found
        .steps
        .iter()
        .map(|s| json!({"axis": s.name, "rise_s": s.rise_s, "overshoot_percent": s.overshoot_percent, "dead_time_s": s.dead_time_s}))
        .collect();
    let result = json!({
        "parameters": rows.iter().skip(1).map(|r| json!({"name": r[0], "unit": r[1], "found": r[2], "believed": r[3], "note": r[4]})).collect::<Vec<_>>(),
        "steps": steps,
    });
    let figures = figures(&found);
    let tables = [
        page::Table { title: "What was found".to_owned(), rows: rows.clone() },
        page::Table { title: "Steps".to_owned(), rows: step_rows(&found) },
    ];
    let about =
        format!("{}: tests of every axis through safety and controller, as commands", resolved.rig.name);
    let written = [
        write(
            &args.output.join("report.html"),
            &page::html("Identification of the rig", &about, &tables, &figures),
        )?,
        write(&args.output.join("rig.toml"), &toml)?,
        write(
            &args.output.join("identified.json"),
            &serde_json::to_string_pretty(&result).unwrap_or_default(),
        )?,
    ];
    if args.json {
        output::json(&result);
    } else {
        output::line(output::columns(&rows));
        output::line(output::columns(&step_rows(&found)));
        for path in written {
            output::line(format!("  {}", path.display()));
        }
    }
    Ok(Exit::Done)
}

/// Found beside believed: name, unit, found, believed, how sure.
fn parameters(found: &Identified, resolved: &ResolvedBench) -> Vec<Vec<String>> {
    let c = &resolved.rig.control;
    let unit = &resolved.unit;
    let mut rows = vec![["parameter", "unit", "found", "believed", ""].map(str::to_owned).to_vec()];
    let mut add =
        |name: String, unit: &str, value: Option<f64>, believed: f64, digits: usize, note: String| {
            rows.push(vec![
                name,
                unit.to_owned(),
                value.map_or_else(|| "–".to_owned(), |v| cell(v, digits)),
                cell(believed, digits),
                note,
            ]);
        };
    for (side, name) in ["left", "right"].into_iter().enumerate() {
        for (axis, fit, model) in [
            ("horizontal", &found.horizontal[side], &c.horizontal),
            ("vertical", &found.vertical[side], &c.vertical),
        ] {
            let note = fit.map_or_else(String::new, |f| format!("misfit {:.2} %", 100.0 * f.misfit));
            let of = |pick: fn(&rig_control::identification::AxisFit) -> f64| fit.as_ref().map(pick);
            add(
                format!("{name} {axis}: no-load speed"),
                "m/s",
                of(|f| f.speed_m_s),
                model.no_load_speed_m_s,
                4,
                note,
            );
            add(
                format!("{name} {axis}: valve"),
                "Hz",
                of(|f| f.valve_frequency_hz),
                model.valve_frequency_hz,
                1,
                String::new(),
            );
            add(
                format!("{name} {axis}: valve damping"),
                "-",
                of(|f| f.valve_damping_ratio),
                model.valve_damping_ratio,
                3,
                String::new(),
            );
            add(
                format!("{name} {axis}: delay, command to reading"),
                "ms",
                of(|f| 1e3 * f.delay_s),
                f64::NAN,
                3,
                String::new(),
            );
        }
        let stiffness = found.stiffness_n_m[side];
        let note = |d: Option<f64>| d.map_or_else(String::new, |d| format!("± {d:.3}"));
        add(
            format!("{name}: stiffness arm to rack"),
            "N/mm",
            stiffness.map(|f| 1e-3 * f.value),
            1e-3 * c.tie_rod_stiffness_n_m,
            1,
            note(stiffness.map(|f| 1e-3 * f.deviation)),
        );
        let mass = found.mass_kg[side];
        add(
            format!("{name}: moving mass at the arm"),
            "kg",
            mass.map(|f| f.value),
            c.horizontal.mass_kg,
            2,
            note(mass.map(|f| f.deviation)),
        );
    }
    let none = String::new;
    add(
        "command delay (transport)".to_owned(),
        "ms",
        found.command_delay_s.map(|v| 1e3 * v),
        1e3 * c.command_delay_s,
        3,
        none(),
    );
    add(
        "steer actuator: inertia".to_owned(),
        "kg·m²",
        found.hub.map(|h| h.inertia_kg_m2),
        resolved.rig.plant.steer.inertia_kg_m2,
        4,
        none(),
    );
    add(
        "steer actuator: torque lag".to_owned(),
        "ms",
        found.torque_lag_s.map(|v| 1e3 * v),
        1e3 * c.steer.torque_lag_s,
        3,
        none(),
    );
    add(
        "unit: rack friction".to_owned(),
        "N",
        found.rack_friction_n,
        unit.rack_friction.sliding_n,
        1,
        "beside the unit's file".to_owned(),
    );
    add(
        "unit: rack damping".to_owned(),
        "N·s/m",
        found.rack_damping_n_s_m,
        unit.rack_damping_n_s_m,
        0,
        none(),
    );
    add(
        "unit: column friction".to_owned(),
        "N·m",
        found.column_friction_n_m,
        unit.column_friction.sliding_n_m,
        3,
        none(),
    );
    add(
        "unit: rack travel".to_owned(),
        "mm/rev",
        found.rack_per_radian_m.map(|v| 1e3 * std::f64::consts::TAU * v),
        1e3 * unit.rack_travel_m_per_rev,
        3,
        none(),
    );
    rows
}

fn step_rows(found: &Identified) -> Vec<Vec<String>> {
    let mut rows =
        vec![["step of", "rise 10–90 % [ms]", "overshoot [%]", "5 % after [ms]"].map(str::to_owned).to_vec()];
    for s in &found.steps {
        rows.push(vec![
            s.name.to_owned(),
            cell(1e3 * s.rise_s, 1),
            cell(s.overshoot_percent, 1),
            cell(1e3 * s.dead_time_s, 1),
        ]);
    }
    rows
}

fn figures(found: &Identified) -> Vec<page::Figure> {
    let mut list = Vec::new();
    for named in &found.responses {
        let r = &named.response;
        let mut gain = page::Figure::new(
            &format!("{}, gain", named.name),
            "frequency in Hz",
            &format!("gain in {}", named.unit),
        )
        .log_axes(true, true);
        gain.curve("gain", &r.frequency_hz, &r.magnitude(), 1, "solid");
        let mut phase = page::Figure::new(
            &format!("{}, phase and coherence", named.name),
            "frequency in Hz",
            "phase in deg; coherence in %",
        )
        .log_axes(true, false);
        phase.curve("phase", &r.frequency_hz, &r.phase_deg(), 1, "solid");
        let coherence: Vec<f64> = r.coherence.iter().map(|c| 100.0 * c).collect();
        phase.curve("coherence in %", &r.frequency_hz, &coherence, 2, "dot");
        list.extend([gain, phase]);
    }
    for s in &found.steps {
        let mut figure = page::Figure::new(
            &format!("Step: {}", s.name),
            "time in s",
            &format!("{} in {}", s.name, s.unit),
        );
        figure.curve("command", &s.time_s, &s.command, 0, "dash");
        figure.curve("reading", &s.time_s, &s.reading, 1, "solid");
        list.push(figure);
    }
    list
}
