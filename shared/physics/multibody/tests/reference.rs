//! Every reference file of an independent multibody code, one test per file: positions, alignment, forces.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use config::axle::Axle;
use multibody::{SideOutput, SolverPath, Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;
use support::{Table, reference};

const SIDES: [&str; 2] = ["L", "R"];

/// Solves every row of a table on a path and hands each to `check`.
fn run(
    axle: &Axle,
    path: SolverPath,
    table: &Table,
    loads: bool,
    mut check: impl FnMut(usize, &SuspensionOutput),
) {
    let mut suspension = Suspension::with_path(axle, path).unwrap();
    let mut output = SuspensionOutput::default();
    for row in 0..table.len() {
        let at = |name: &str| table.get(row, name);
        let mut input = SuspensionInput {
            rack_m: at("rack"),
            wheel_height_m: [at("zL"), at("zR")],
            ..SuspensionInput::DESIGN
        };
        if loads {
            for (k, s) in SIDES.iter().enumerate() {
                let vector = |n: &str| Vector3::from(["x", "y", "z"].map(|a| at(&format!("{n}{a}k_{s}"))));
                input.wheel_force_n[k] = vector("F");
                input.wheel_moment_n_m[k] = vector("M");
            }
        }
        suspension.step(&input, &mut output);
        assert_eq!(output.status, Status::Converged, "row {row}");
        check(row, &output);
    }
}

fn axle_of(file: &str) -> Option<Axle> {
    let hardpoints = if file.contains("dw_sedan") { "dw_sedan" } else { "strut_compact" };
    let text = reference(&format!("hardpoints_{hardpoints}.json"))?;
    Some(Axle::from_hardpoint_json(&text, hardpoints).unwrap())
}

/// Value of a kinematic column without its side suffix.
fn kinematic_value(name: &str, side: &SideOutput, angle: f64) -> f64 {
    let axis =
        |v: Vector3<f64>| v[["x", "y", "z"].iter().position(|a| name.ends_with(&format!("_{a}"))).unwrap()];
    match name.split('_').next().unwrap() {
        "lbj" => axis(side.lower_joint_m),
        "ubj" => axis(side.upper_joint_m),
        "to" => axis(side.tie_rod_ball_m),
        "wc" => axis(side.wheel_centre_m),
        "cp" => axis(side.contact_patch_m),
        "q0" => side.knuckle_quaternion[0],
        "q1" => side.knuckle_quaternion[1],
        "q2" => side.knuckle_quaternion[2],
        "q3" => side.knuckle_quaternion[3],
        "steer" => side.steer_rad,
        "toe" => side.toe_rad,
        "camber" => side.camber_rad,
        "caster" => side.caster_rad,
        "kpi" => side.kingpin_inclination_rad,
        "spring" | "strut" => side.spring_length_m,
        "arb" => angle,
        other => panic!("unknown column {other}"),
    }
}

fn kinematic(file: &str) {
    let (Some(text), Some(axle)) = (reference(file), axle_of(file)) else { return };
    let table = Table::parse(&text);
    let tolerance = if file.contains("strut_compact_compound") { 1e-8 } else { 1e-9 };
    for path in [SolverPath::General, SolverPath::Structured] {
        let (mut worst_m, mut worst_rad, mut columns) = (0.0_f64, 0.0_f64, 0);
        run(&axle, path, &table, false, |row, output| {
            columns = 0;
            for name in table.names().iter().filter(|n| n.ends_with("_L") || n.ends_with("_R")) {
                let side = usize::from(name.ends_with("_R"));
                let (short, expect) = (&name[..name.len() - 2], table.get(row, name));
                let got = kinematic_value(short, &output.side[side], output.stabiliser_angle_rad[side]);
                let off = (got - expect).abs();
                let length =
                    ["lbj", "ubj", "to_", "wc", "cp", "spring", "strut"].iter().any(|p| short.starts_with(p));
                let worst = if length { &mut worst_m } else { &mut worst_rad };
                *worst = worst.max(off);
                assert!(off <= tolerance, "{file} row {row} {name}: {got} for {expect}");
                columns += 1;
            }
        });
        println!(
            "{file} {path:?}: {columns} columns × {} rows: positions {worst_m:.1e} m, angles and quaternions {worst_rad:.1e}",
            table.len()
        );
        assert!(columns > 40);
    }
}

/// Value of a force column without side and stabiliser suffix.
fn force_value(name: &str, side: &SideOutput) -> f64 {
    let axis =
        |v: Vector3<f64>| v[["x", "y", "z"].iter().position(|a| name.ends_with(&format!("_{a}"))).unwrap()];
    match name.split('_').next().unwrap() {
        "tie" => side.tie_rod_force_n,
        "spring" => side.spring_force_n,
        "droplink" => side.drop_link_force_n,
        "Fubj" | "Ftop" => axis(side.upper_joint_force_n),
        "Flbj" => axis(side.lower_joint_force_n),
        "Fxb" => side.wheel_force_n.x,
        "Fyb" => side.wheel_force_n.y,
        "Fzb" => side.wheel_force_n.z,
        "Mxb" => side.wheel_moment_n_m.x,
        "Myb" => side.wheel_moment_n_m.y,
        "Mzb" => side.wheel_moment_n_m.z,
        other => panic!("unknown column {other}"),
    }
}

fn force(file: &str) {
    let (Some(text), Some(axle)) = (reference(file), axle_of(file)) else { return };
    let table = Table::parse(&text);
    let variants: &[(&str, Axle)] = if axle.stabiliser.is_some() {
        &[("_arb", axle.clone()), ("_noarb", axle.without_stabiliser())]
    } else {
        &[("", axle.clone())]
    };
    for path in [SolverPath::General, SolverPath::Structured] {
        for (suffix, axle) in variants {
            let (mut worst, mut worst_name, mut columns) = (0.0_f64, String::new(), 0);
            run(axle, path, &table, true, |row, output| {
                columns = 0;
                for name in table.names() {
                    let expect = table.get(row, name);
                    let whole = name.strip_prefix("rack_force").or(name.strip_prefix("arb_torque"));
                    let got = if let Some(rest) = whole {
                        if name.starts_with("rack") && rest != *suffix
                            || name.starts_with("arb") && *suffix != "_arb"
                        {
                            continue;
                        }
                        if name.starts_with("rack") {
                            output.rack_force_n
                        } else {
                            output.stabiliser_torque_n_m
                        }
                    } else if let Some(short) = name.strip_suffix("_L").or(name.strip_suffix("_R")) {
                        let body = ["Fxb", "Fyb", "Fzb", "Mxb", "Myb", "Mzb"].contains(&short);
                        if ["Fxk", "Fyk", "Fzk", "Mxk", "Myk", "Mzk"].contains(&short) {
                            continue;
                        }
                        let short = match (body, short.strip_suffix(suffix)) {
                            (true, _) => short,
                            (false, Some(short)) => short,
                            (false, None) if short == "droplink" && *suffix == "_arb" => short,
                            _ => continue,
                        };
                        if !body && suffix.is_empty() && short.ends_with("arb") {
                            continue;
                        }
                        force_value(short, &output.side[usize::from(name.ends_with("_R"))])
                    } else {
                        continue;
                    };
                    // The run's peak of that quantity, components and sides together; 1 N where it is 0.
                    let stem = name.split('_').next().unwrap();
                    let peak =
                        if stem.len() == 3 { table.peak(&stem[..1]) } else { table.peak(stem) }.max(1.0);
                    let off = (got - expect).abs() / peak;
                    if off > worst {
                        (worst, worst_name) = (off, name.clone());
                    }
                    assert!(off <= 1e-6, "{file} row {row} {name}: {got} for {expect}, peak {peak}");
                    columns += 1;
                }
            });
            println!(
                "{file}{suffix} {path:?}: {columns} columns × {} rows: {worst:.1e} of the peak ({worst_name})",
                table.len()
            );
            assert!(columns >= 28, "{columns}");
        }
    }
}

macro_rules! files {
    ($($name:ident: $check:ident $file:literal;)+) => { $(#[test] fn $name() { $check($file); })+ };
}

files! {
    dw_steer_kin: kinematic "ref_dw_sedan_steer_kin.csv";
    dw_bounce_kin: kinematic "ref_dw_sedan_bounce_kin.csv";
    dw_rebound_kin: kinematic "ref_dw_sedan_rebound_kin.csv";
    dw_compound_kin: kinematic "ref_dw_sedan_compound_kin.csv";
    strut_steer_kin: kinematic "ref_strut_compact_steer_kin.csv";
    strut_bounce_kin: kinematic "ref_strut_compact_bounce_kin.csv";
    strut_rebound_kin: kinematic "ref_strut_compact_rebound_kin.csv";
    strut_compound_kin: kinematic "ref_strut_compact_compound_kin.csv";
    dw_steer_force: force "ref_dw_sedan_steer_force.csv";
    dw_bounce_force: force "ref_dw_sedan_bounce_force.csv";
    dw_rebound_force: force "ref_dw_sedan_rebound_force.csv";
    dw_compound_force: force "ref_dw_sedan_compound_force.csv";
    strut_steer_force: force "ref_strut_compact_steer_force.csv";
    strut_bounce_force: force "ref_strut_compact_bounce_force.csv";
    strut_rebound_force: force "ref_strut_compact_rebound_force.csv";
    strut_compound_force: force "ref_strut_compact_compound_force.csv";
}
