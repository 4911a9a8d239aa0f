//! Every reference table, each against the property file it was made from.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use support::{Table, reference};
use tyre::{OUTPUT_COLUMNS, Tyre, UseMode, evaluate_csv};

/// Largest error of a column, relative to the table's peak, and the row it is in.
fn error(ours: &[f64], theirs: &[f64]) -> (f64, f64, usize) {
    let peak = theirs.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let (row, worst) = ours
        .iter()
        .zip(theirs)
        .map(|(a, b)| (a - b).abs())
        .enumerate()
        .fold((0, 0.0), |m, (i, e)| if e > m.1 || e.is_nan() { (i, e) } else { m });
    (if worst == 0.0 { 0.0 } else { worst / peak }, peak, row)
}

fn check(tyre: &str, mode: u32, set: &str) {
    let (Some(tir), Some(csv)) =
        (reference(&format!("tyre/{tyre}.tir")), reference(&format!("tyre/{tyre}_mode{mode}_{set}.csv")))
    else {
        return;
    };
    let model = Tyre::from_tir(&tir, tyre).unwrap_or_else(|e| panic!("{}", e[0]));
    let ours = evaluate_csv(&model, &csv, "reference", UseMode::from_number(mode).unwrap()).unwrap();
    let ours = Table::parse(&ours.text);
    let theirs = Table::parse(&csv);
    assert_eq!(ours.names, theirs.names);
    println!("{tyre} mode {mode} {set}: {} points; error relative to the table's peak:", ours.rows.len());
    for name in OUTPUT_COLUMNS {
        let (e, peak, row) = error(&ours.column(name), &theirs.column(name));
        let limit = match name {
            // MF 5.2, 6.2: the reference finds the loaded radius by a search that stops at 1e-6 m.
            "rho_m" | "Rl_m" | "Cz_Npm" => 1e-5,
            // The ten digits of the tables.
            _ => 2e-9,
        };
        println!("  {name:14} {e:9.1e} of {peak:.6} (line {})", row + 2);
        assert!(e <= limit, "{tyre} {mode} {set} {name}: {e:e} of {peak} in line {}", row + 2);
    }
}

macro_rules! tables {
    ($($name:ident: $tyre:literal;)*) => {$(
        mod $name {
            #[test]
            fn lateral_211() { super::check($tyre, 211, "pure_lateral"); }
            #[test]
            fn lateral_221() { super::check($tyre, 221, "pure_lateral"); }
            #[test]
            fn longitudinal_211() { super::check($tyre, 211, "pure_longitudinal"); }
            #[test]
            fn longitudinal_221() { super::check($tyre, 221, "pure_longitudinal"); }
            #[test]
            fn combined_211() { super::check($tyre, 211, "combined"); }
            #[test]
            fn combined_221() { super::check($tyre, 221, "combined"); }
        }
    )*};
}

tables! {
    pactest_235_60r16: "chrono_pactest_235_60R16_PAC2002";
    sedan_245_40r18: "chrono_sedan_245_40R18_PAC2002";
    example_mf52: "mfeval_MF52";
    example_mf61: "mfeval_MF61";
    example_mf62: "mfeval_MF62";
    book_205_60r15: "pacejka2006_205_60R15_MF61";
}
