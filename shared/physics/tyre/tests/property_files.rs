//! Property files: every violation named with its place; units; the shipped files; the evaluation table.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use support::{reference, shipped, workspace};
use tyre::{Contact, Side, Tyre, UseMode, Version, evaluate_csv};

fn text() -> String {
    std::fs::read_to_string(workspace().join("schemas/tyres/car_205_60r15.tir")).unwrap()
}

fn errors(text: &str) -> Vec<String> {
    match Tyre::from_tir(text, "x.tir") {
        Ok(_) => Vec::new(),
        Err(errors) => errors.iter().map(ToString::to_string).collect(),
    }
}

fn line_of(text: &str, part: &str) -> usize {
    text.lines().position(|l| l.contains(part)).unwrap() + 1
}

#[test]
fn every_shipped_tyre_reads() {
    let mut count = 0;
    for entry in std::fs::read_dir(workspace().join("schemas/tyres")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.ends_with(".tir") || name.ends_with(".toml") {
            let tyre = Tyre::from_text(&std::fs::read_to_string(&path).unwrap(), &name).unwrap_or_else(|e| {
                panic!("{}", e.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"))
            });
            assert_eq!(tyre.info().file_name, name);
            count += 1;
        }
    }
    assert!(count >= 2);
}

#[test]
fn reference_files_read_and_tell_what_they_lack() {
    for (name, version, lacks) in [
        ("chrono_pactest_235_60R16_PAC2002", Version::Mf52, "QSY5"),
        ("chrono_sedan_245_40R18_PAC2002", Version::Mf52, "RBX1"),
        ("chrono_vwbus_185_80R14_PAC2002", Version::Mf52, "Q_FZ2"),
        ("mfeval_MF52", Version::Mf52, "LKYC"),
        ("mfeval_MF61", Version::Mf61, "PTX1"),
        ("mfeval_MF62", Version::Mf62, "PTX1"),
        ("pacejka2006_205_60R15_MF61", Version::Mf61, "BREFF"),
    ] {
        let Some(text) = reference(&format!("tyre/{name}.tir")) else { continue };
        let tyre = Tyre::from_tir(&text, name).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!(tyre.info().version, version);
        assert!(
            tyre.info().substituted.iter().any(|s| s.key == lacks),
            "{name}: {:?}",
            tyre.info().substituted
        );
    }
}

#[test]
fn names_every_violation_with_its_line() {
    let good = text();
    assert!(errors(&good).is_empty());
    let bad = good
        .replace("PDY1 = -0.990", "PDY_1 = -0.990")
        .replace("PCX1 = 1.685", "PCX1 = strong")
        .replace("LENGTH = 'meter'", "LENGTH = 'cubit'")
        .replace("FITTYP   = 61", "FITTYP   = 7")
        .replace("QCZ1 = 1.180\n", "")
        .replace("RHX1 = 0.007", "RHX1 = 0.007\nRHX1 = 0.008")
        .replace("[LATERAL_COEFFICIENTS]", "[LATERAL_COEFFICIENTS]\nthis is no key");
    let found = errors(&bad);
    for expected in [
        format!(
            "x.tir:{}: [LATERAL_COEFFICIENTS] PDY_1 = -0.990: unknown key; did you mean PDY1?",
            line_of(&bad, "PDY_1")
        ),
        "x.tir: PDY1: missing key".to_owned(),
        "x.tir: QCZ1: missing key".to_owned(),
        format!(
            "x.tir:{}: [LONGITUDINAL_COEFFICIENTS] PCX1 = strong: must be a finite number",
            line_of(&bad, "PCX1")
        ),
        format!(
            "x.tir:{}: [UNITS] LENGTH = 'cubit': must be a length unit: meter, mm, cm, km, inch, foot or mile",
            line_of(&bad, "cubit")
        ),
        format!(
            "x.tir:{}: [MODEL] FITTYP = 7: must be 5, 6, 51 or 52 (MF-Tyre 5.2), 61 (MF-Tyre 6.1) or 62 (MF-Tyre 6.2)",
            line_of(&bad, "FITTYP")
        ),
        format!(
            "x.tir:{}: [LONGITUDINAL_COEFFICIENTS] RHX1 = 0.008: given before with another value, in line {}",
            line_of(&bad, "RHX1 = 0.008"),
            line_of(&bad, "RHX1 = 0.007")
        ),
        format!(
            "x.tir:{}: [LATERAL_COEFFICIENTS] this is no key: must be a [SECTION], a comment ($ or !) or KEY = VALUE",
            line_of(&bad, "this is no key")
        ),
    ] {
        assert!(found.contains(&expected), "{expected}\nnot in\n{}", found.join("\n"));
    }
    assert_eq!(found.len(), 8, "{}", found.join("\n"));
}

#[test]
fn refuses_values_out_of_range() {
    for (from, to, part) in [
        ("UNLOADED_RADIUS = 0.313", "UNLOADED_RADIUS = -0.313", "UNLOADED_RADIUS = -0.313: must be > 0"),
        (
            "RIM_RADIUS      = 0.1905",
            "RIM_RADIUS = 0.4",
            "RIM_RADIUS = 0.4: must be > 0 and below UNLOADED_RADIUS",
        ),
        ("FNOMIN             = 4000", "FNOMIN = 0", "FNOMIN = 0: must be > 0"),
        ("LMUY = 1", "LMUY = 0", "LMUY = 0: must be > 0"),
        ("FZMAX = 9000", "FZMAX = 100", "FZMAX = 100: must be above FZMIN"),
        ("Q_FZ2 = 15.0", "Q_FZ2 = 1e4", "Q_FZ2 = 1e4: must be at most"),
        ("PKX1 = 21.51", "PKX1 = nan", "PKX1 = nan: must be a finite number"),
        ("PKX1 = 21.51", "PKX1 = 1e999", "PKX1 = 1e999: must be a finite number"),
    ] {
        let bad = text().replace(from, to);
        assert_ne!(bad, text(), "{from}");
        let found = errors(&bad);
        assert!(found.iter().any(|e| e.contains(part)), "{part}: {found:?}");
    }
}

#[test]
fn garbage_is_refused_without_panic() {
    for text in ["", "[", "=", "\u{feff}", "[UNITS\nLENGTH", "a=b\n=c\n[]\n'='", "\0\0\0"] {
        assert!(!errors(text).is_empty(), "{text:?}");
    }
}

/// The same tyre written in millimetres, kilonewtons, degrees and milliseconds.
#[test]
fn units_are_honoured() {
    let mut other = String::new();
    let mut section = String::new();
    for line in text().lines() {
        let code = line.split('$').next().unwrap().trim();
        if code.starts_with('[') {
            section = code.to_owned();
        }
        let Some((key, value)) = code.split_once('=').map(|(k, v)| (k.trim(), v.trim())) else {
            other.push_str(code);
            other.push('\n');
            continue;
        };
        let factor = match key {
            "UNLOADED_RADIUS" | "WIDTH" | "RIM_RADIUS" | "RIM_WIDTH" | "BOTTOM_OFFST" => 1e3,
            "FNOMIN" | "FZMIN" | "FZMAX" => 1e-3,
            // kN/mm is MN/m; kN/mm² is GPa; kN ms/mm is kN s/m; mm/ms is m/s; kN mm is N m.
            "VERTICAL_STIFFNESS" | "BOTTOM_STIFF" | "LONGITUDINAL_STIFFNESS" | "LATERAL_STIFFNESS" => 1e-6,
            "INFLPRES" | "NOMPRES" | "PRESMIN" | "PRESMAX" => 1e-9,
            "VERTICAL_DAMPING" => 1e-3,
            "ALPMIN" | "ALPMAX" | "CAMMIN" | "CAMMAX" => 180.0 / std::f64::consts::PI,
            _ => 1.0,
        };
        let value = match key {
            "LENGTH" => "'mm'".to_owned(),
            "FORCE" => "'knewton'".to_owned(),
            "ANGLE" => "'degrees'".to_owned(),
            "TIME" => "'millisecond'".to_owned(),
            _ => value.parse::<f64>().map_or(value.to_owned(), |v| format!("{}", v * factor)),
        };
        let _ = &section;
        other.push_str(&format!("{key} = {value}\n"));
    }
    let (a, b) = (shipped(), Tyre::from_tir(&other, "other.tir").unwrap_or_else(|e| panic!("{e:?}")));
    let contact = contact(-0.05, 0.08, 0.02);
    let (fa, fb) =
        (a.steady_state(&contact, UseMode::AlphaStar), b.steady_state(&contact, UseMode::AlphaStar));
    assert!((fa.fx_n - fb.fx_n).abs() < 1e-6 && (fa.mz_n_m - fb.mz_n_m).abs() < 1e-6, "{fa:?} {fb:?}");
    let (sa, sb) = (a.shape(&contact, &fa), b.shape(&contact, &fb));
    assert!((sa.loaded_radius_m - sb.loaded_radius_m).abs() < 1e-9);
    assert!((sa.lateral_stiffness_n_m - sb.lateral_stiffness_n_m).abs() < 1e-3);
    assert!((a.info().vertical_damping_n_s_m - b.info().vertical_damping_n_s_m).abs() < 1e-9);
    assert!((a.info().camber_range_rad[1] - b.info().camber_range_rad[1]).abs() < 1e-12);
}

fn contact(kappa: f64, alpha: f64, gamma: f64) -> Contact {
    Contact {
        vertical_load_n: 3700.0,
        slip_ratio: kappa,
        slip_angle_rad: alpha,
        camber_rad: gamma,
        turn_slip_per_m: 0.0,
        speed_m_s: 21.0,
        pressure_pa: 231e3,
        friction_scale: [1.0; 2],
    }
}

#[test]
fn other_side_is_the_mirror_image() {
    let left = shipped();
    assert_eq!(left.info().side, Some(Side::Left));
    let right = left.on_side(Side::Right);
    assert!(right.info().is_mirrored && !left.on_side(Side::Left).info().is_mirrored);
    let a = left.steady_state(&contact(-0.05, 0.08, 0.02), UseMode::AlphaStar);
    let b = right.steady_state(&contact(-0.05, -0.08, -0.02), UseMode::AlphaStar);
    assert_eq!(
        (a.fx_n, a.fy_n, a.mx_n_m, a.my_n_m, a.mz_n_m),
        (b.fx_n, -b.fy_n, -b.mx_n_m, b.my_n_m, -b.mz_n_m)
    );
    // Ply steer and conicity make the difference.
    let c = right.steady_state(&contact(0.0, 0.0, 0.0), UseMode::AlphaStar);
    assert!(c.fy_n.abs() > 10.0, "{c:?}");
}

#[test]
fn scaling_factors_scale() {
    let base = shipped();
    let scaled = |key: &str, value: f64| {
        let old = format!("{key} = 1\n");
        assert!(text().contains(&old), "{key}");
        Tyre::from_tir(&text().replacen(&old, &format!("{key} = {value}\n"), 1), key).unwrap()
    };
    let force = |t: &Tyre, k: f64, a: f64, g: f64| t.steady_state(&contact(k, a, g), UseMode::SmallAngle);
    let b = force(&base, 0.0, 0.0, 0.0);
    let half = |key| force(&scaled(key, 0.5), 0.0, 0.0, 0.0);
    let ratio = |a: f64, b: f64| a / b;
    assert!((ratio(half("LMUY").mu_y, b.mu_y) - 0.5).abs() < 1e-12);
    assert!((ratio(half("LMUX").mu_x, b.mu_x) - 0.5).abs() < 1e-12);
    assert!(
        (ratio(half("LKX").longitudinal_slip_stiffness_n, b.longitudinal_slip_stiffness_n) - 0.5).abs()
            < 1e-12
    );
    assert!((ratio(half("LKY").cornering_stiffness_n_rad, b.cornering_stiffness_n_rad) - 0.5).abs() < 1e-12);
    assert!((ratio(half("LMY").my_n_m, b.my_n_m) - 0.5).abs() < 1e-12);
    assert!((ratio(half("LTR").trail_m, b.trail_m) - 0.5).abs() < 1e-12);
    // Friction scale of the road is LMU on top of the file's.
    let mut icy = contact(0.05, 0.1, 0.0);
    icy.friction_scale = [1.0, 0.5];
    let (a, b) = (base.steady_state(&icy, UseMode::SmallAngle), force(&scaled("LMUY", 0.5), 0.05, 0.1, 0.0));
    assert!((a.fy_n - b.fy_n).abs() < 1e-9 && (a.mz_n_m - b.mz_n_m).abs() < 1e-9);
    // Every other factor changes something in combined slip with camber, and nothing is ignored.
    let all = |t: &Tyre| {
        let f = force(t, -0.04, 0.06, 0.05);
        let s = t.shape(&contact(-0.04, 0.06, 0.05), &f);
        [f.fx_n, f.fy_n, f.mx_n_m, f.my_n_m, f.mz_n_m, s.relaxation_length_m[0], s.relaxation_length_m[1]]
    };
    // QSX1 is 0 in the file: LVMX has nothing to scale; PVX is 0: neither has LVX.
    for key in "LFZO LCX LEX LHX LCY LEY LHY LVY LRES LXAL LYKA LVYKA LS LKYC LKZC LMX".split(' ') {
        assert_ne!(all(&scaled(key, 1.3)), all(&base), "{key} does nothing");
    }
}

#[test]
fn evaluation_names_bad_cells() {
    let tyre = shipped();
    let run = |text: &str| evaluate_csv(&tyre, text, "t.csv", UseMode::SmallAngle);
    let header = "Fz_N,kappa,alpha_rad,gamma_rad,phit_1pm,Vx_mps,p_Pa";
    let out = run(&format!("{header}\n4000,0,-0.1,0,0,20,220000\n")).unwrap();
    let mut lines = out.text.lines();
    assert!(lines.next().unwrap().starts_with(&format!("{header},Fx_N,Fy_N,Mx_Nm,My_Nm,Mz_Nm,Re_m,rho_m")));
    let row: Vec<f64> = lines.next().unwrap().split(',').map(|c| c.parse().unwrap()).collect();
    assert!(row[8] > 3000.0, "alpha < 0 gives Fy > 0: {row:?}");
    // Any order of columns, no pressure, extra columns, spaces, Windows line ends.
    let other =
        run("Vx_mps, x,Fz_N,kappa,alpha_rad,gamma_rad,phit_1pm\r\n20,9, 4000,0,-0.1,0,0\r\n").unwrap();
    assert_eq!((other.text, other.ignored), (out.text, vec!["x".to_owned()]));
    let e = run("Fz_N,kappa\n1,2\n").unwrap_err();
    assert_eq!(e.violations.len(), 4);
    assert_eq!(e.violations[0].to_string(), "t.csv:1: alpha_rad: column is missing");
    let told = |text: String| -> Vec<String> {
        run(&text).unwrap_err().violations.iter().map(ToString::to_string).collect()
    };
    assert_eq!(
        told(format!("{header}\n-1,0,2,0,0,20,220000\n1,0,0,0,0,20,-1\n")),
        [
            "t.csv:2: Fz_N = -1: must be >= 0",
            "t.csv:2: alpha_rad = 2: must be in (-pi/2, pi/2)",
            "t.csv:3: p_Pa = -1: must be >= 0 (0: the inflation pressure of the file)",
        ]
    );
    assert_eq!(
        told(format!("{header}\n1,x,0,0,0,inf,1\n1,2\n")),
        [
            "t.csv:2: kappa = x: must be a number",
            "t.csv:2: Vx_mps = inf: must be a finite number",
            "t.csv:3: has 2 cells, the first line has 7",
        ]
    );
}
