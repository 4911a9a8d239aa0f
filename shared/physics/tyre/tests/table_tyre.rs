//! Table tyre: the shipped file, made from the shipped property file, gives the same forces; bad files are refused.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use std::fmt::Write as _;
use support::{shipped, workspace};
use tyre::{Contact, Motion, TransientState, Tyre, UseMode};

const FILE: &str = "schemas/tyres/car_205_60r15_table.toml";
const LOADS: [f64; 5] = [1000.0, 2500.0, 4000.0, 6000.0, 9000.0];
const SLIPS: [f64; 27] = [
    -1.0, -0.7, -0.5, -0.35, -0.25, -0.2, -0.16, -0.13, -0.1, -0.08, -0.06, -0.04, -0.02, 0.0, 0.02, 0.04,
    0.06, 0.08, 0.1, 0.13, 0.16, 0.2, 0.25, 0.35, 0.5, 0.7, 1.0,
];
const CAMBERS: [f64; 7] = [-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15];

fn at(load: f64, slip: [f64; 2], camber: f64) -> Contact {
    Contact {
        vertical_load_n: load,
        slip_ratio: slip[0],
        slip_angle_rad: slip[1],
        camber_rad: camber,
        turn_slip_per_m: 0.0,
        speed_m_s: 16.67,
        pressure_pa: 220e3,
        friction_scale: [1.0; 2],
    }
}

fn table() -> Tyre {
    Tyre::from_text(&std::fs::read_to_string(workspace().join(FILE)).unwrap(), FILE)
        .unwrap_or_else(|e| panic!("{e:?}"))
}

fn write_table(name: &str, slips: &[f64], out: &mut String, value: impl Fn(f64, f64) -> f64) {
    writeln!(out, "\n[{name}]\nslip = {slips:?}\nload_n = {LOADS:?}\nvalue = [").unwrap();
    for load in LOADS {
        let row: Vec<f64> = slips.iter().map(|s| (value(load, *s) * 100.0).round() / 100.0).collect();
        writeln!(out, "    {row:?},").unwrap();
    }
    out.push_str("]\n");
}

/// The shipped table, sampled from the shipped property file; `UPDATE_TABLES=1` writes it.
#[test]
fn shipped_table_is_the_sampled_formula() {
    let tyre = shipped();
    let info = tyre.info();
    let mode = UseMode::SmallAngle;
    let [cx, cy] = tyre.carcass_stiffness_n_m(info.nominal_load_n, info.inflation_pressure_pa);
    let mut out = format!(
        "# Table tyre 205/60 R15: car_205_60r15.tir sampled (tests/table_tyre.rs of the tyre crate makes this file).\n\
         # slip: slip angle [rad], slip ratio [-], slip angle, camber [rad]; value: force [N], aligning torque [N m].\n\
         [tyre]\nsource = \"sampled from car_205_60r15.tir; its sources hold\"\nunloaded_radius_m = {:?}\nwidth_m = {:?}\n\
         rim_radius_m = {:?}\nnominal_load_n = {:?}\ninflation_pressure_pa = {:?}\nvertical_stiffness_n_m = {:?}\n\
         vertical_damping_n_s_m = {:?}\nlongitudinal_stiffness_n_m = {cx:?}\nlateral_stiffness_n_m = {cy:?}\n\
         yaw_stiffness_n_m_rad = 5000.0\nrolling_resistance = 0.01\nrolling_radius = [8.4, 0.27, 0.07]\nload_max_n = 9000.0\n",
        info.unloaded_radius_m,
        info.width_m,
        info.rim_radius_m,
        info.nominal_load_n,
        info.inflation_pressure_pa,
        info.vertical_stiffness_n_m,
        info.vertical_damping_n_s_m,
    );
    let force = |load: f64, slip: [f64; 2], camber: f64| tyre.steady_state(&at(load, slip, camber), mode);
    write_table("lateral", &SLIPS, &mut out, |fz, a| force(fz, [0.0, a], 0.0).fy_n);
    write_table("longitudinal", &SLIPS, &mut out, |fz, k| force(fz, [k, 0.0], 0.0).fx_n);
    write_table("aligning", &SLIPS, &mut out, |fz, a| force(fz, [0.0, a], 0.0).mz_n_m);
    write_table("camber", &CAMBERS, &mut out, |fz, g| {
        force(fz, [0.0; 2], g).fy_n - force(fz, [0.0; 2], 0.0).fy_n
    });
    let path = workspace().join(FILE);
    if std::env::var("UPDATE_TABLES").is_ok() {
        std::fs::write(&path, &out).unwrap();
    }
    assert!(std::fs::read_to_string(path).unwrap() == out, "{FILE} is stale: run with UPDATE_TABLES=1");
}

#[test]
fn agrees_with_the_formula_it_was_sampled_from() {
    let (formula, table) = (shipped(), table());
    let mode = UseMode::SmallAngle;
    let mut worst = [0.0_f64; 4];
    for load in [800.0, 1800.0, 3300.0, 4700.0, 7500.0] {
        for i in -60..=60 {
            let slip = f64::from(i) * 0.005;
            let pairs = [
                ([0.0, slip], 0.0, 0),
                ([slip, 0.0], 0.0, 1),
                ([0.7 * slip, slip], 0.0, 2),
                ([0.0, 0.2 * slip], 0.06, 3),
            ];
            for (s, camber, which) in pairs {
                let (a, b) = (
                    formula.steady_state(&at(load, s, camber), mode),
                    table.steady_state(&at(load, s, camber), mode),
                );
                worst[which] = worst[which]
                    .max((a.fx_n - b.fx_n).abs() / load)
                    .max(if which == 1 { 0.0 } else { (a.fy_n - b.fy_n).abs() / load })
                    .max(if which == 0 { (a.mz_n_m - b.mz_n_m).abs() / (0.05 * load) } else { 0.0 });
            }
        }
    }
    println!(
        "table against formula, of load: pure lateral {:.3}, pure longitudinal {:.3}, combined {:.3}, camber {:.3}",
        worst[0], worst[1], worst[2], worst[3]
    );
    assert!(worst[0] < 0.05 && worst[1] < 0.05, "{worst:?}");
    // Normalised slip is another model of combined slip, without κ-induced side force (13 % of load here); camber thrust has no shape factor here.
    assert!(worst[2] < 0.3 && worst[3] < 0.06, "{worst:?}");
}

/// Samples themselves are met exactly.
#[test]
fn meets_its_samples() {
    let (formula, table) = (shipped(), table());
    for load in LOADS {
        for slip in SLIPS {
            let f = |t: &Tyre, s| t.steady_state(&at(load, s, 0.0), UseMode::SmallAngle);
            assert!((f(&formula, [slip, 0.0]).fx_n - f(&table, [slip, 0.0]).fx_n).abs() < 0.01);
            assert!((f(&formula, [0.0, slip]).fy_n - f(&table, [0.0, slip]).fy_n).abs() < 0.01);
        }
    }
}

#[test]
fn runs_through_standstill() {
    let table = table();
    let mut state = TransientState::default();
    let mut work = 0.0;
    for i in 0..20_000 {
        let t = f64::from(i) * 1e-3;
        let speed = 5.0 * (0.5 * t).cos();
        let m = Motion {
            vertical_load_n: 4000.0 * (1.0 + 0.9 * (3.0 * t).sin()),
            speed_m_s: speed,
            slip_speed_x_m_s: (2.0 * t).sin(),
            slip_speed_y_m_s: 0.3 * (1.7 * t).cos(),
            spin_rate_rad_s: (0.9 * t).sin(),
            camber_rad: 0.05 * t.sin(),
            pressure_pa: 220e3,
            friction_scale: [0.8; 2],
        };
        let f = table.transient_step(&mut state, &m, UseMode::SmallAngle, 1e-3);
        assert!([f.fx_n, f.fy_n, f.mz_n_m, f.my_n_m].iter().all(|v| v.is_finite()));
        let omega = (speed - m.slip_speed_x_m_s) / table.info().unloaded_radius_m;
        work -= 1e-3 * (f.fx_n * m.slip_speed_x_m_s + f.fy_n * m.slip_speed_y_m_s + f.my_n_m * omega);
        assert!(state.energy_j() - work < 1e-6);
    }
}

#[test]
fn refuses_bad_tables_naming_every_rule() {
    let good = std::fs::read_to_string(workspace().join(FILE)).unwrap();
    let errors = |text: &str| {
        Tyre::from_text(text, "x.toml")
            .map(|_| ())
            .unwrap_err()
            .iter()
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    let e = errors(
        &good
            .replace("width_m = 0.205", "width_m = -1")
            .replace("rolling_resistance = 0.01", "rolling_resistance = nan"),
    );
    assert_eq!(e.len(), 2, "{e:?}");
    assert!(e[0].contains("tyre.width_m = -1") && e[1].contains("tyre.rolling_resistance = NaN"), "{e:?}");
    let e = errors(&good.replacen("[-1.0, -0.7,", "[-1.0, -2.0,", 1));
    assert!(e[0].contains("lateral.slip") && e[0].contains("increasing"), "{e:?}");
    let e = errors(&good.replace("width_m", "wide_m"));
    assert!(e[0].starts_with("x.toml:") && e[0].contains("wide_m"), "{e:?}");
    let e = errors(&good.replace("[lateral]", "[longitudinal2]"));
    assert!(e[0].contains("longitudinal2"), "{e:?}");
}
