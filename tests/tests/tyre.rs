//! The tyre commands, run as a user runs them: every reference table, any order of columns, bad input, the page.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use kingpin_tests::csv::Table;
use kingpin_tests::support::{kingpin, reference};
use std::path::Path;
use std::process::{Command, Output};
use tempfile::TempDir;

const INPUTS: [&str; 7] = ["Fz_N", "kappa", "alpha_rad", "gamma_rad", "phit_1pm", "Vx_mps", "p_Pa"];

fn run(args: &[&str]) -> Output {
    Command::new(kingpin()).arg("tyre").args(args).output().unwrap()
}

fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn evaluate(tir: &str, input: &Path, output: &Path, mode: &str) -> Output {
    let (input, output) = (input.to_str().unwrap(), output.to_str().unwrap());
    run(&["evaluate", "--tir", tir, "--input", input, "--output", output, "--use-mode", mode])
}

/// Every set of a tyre in a mode, against the columns of the reference. The reference's ten digits bound all columns but
/// deflection, loaded radius and load over deflection: there the reference (MF 5.2 and 6.2) stops a search at 1e-6 m.
fn check(tyre: &str, mode: &str) {
    let folder = TempDir::new().unwrap();
    let Some(tir) = reference(&format!("tyre/{tyre}.tir")) else { return };
    for set in ["pure_lateral", "pure_longitudinal", "combined"] {
        let Some(input) = reference(&format!("tyre/{tyre}_mode{mode}_{set}.csv")) else { return };
        let output = folder.path().join("out.csv");
        let ended = evaluate(tir.to_str().unwrap(), &input, &output, mode);
        assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
        let theirs = Table::read(&input);
        let ours = Table::read(&output);
        assert_eq!(ours.names, theirs.names, "columns as the reference's");
        assert_eq!(ours.rows.len(), theirs.rows.len());
        let mut line = String::new();
        for name in &theirs.names {
            let (a, b) = (ours.column(name), theirs.column(name));
            let peak = b.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            let worst = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let error = if worst == 0.0 { 0.0 } else { worst / peak };
            let limit = match name.as_str() {
                "rho_m" | "Rl_m" | "Cz_Npm" => 1e-5,
                _ => 2e-9,
            };
            assert!(error <= limit, "{tyre} {mode} {set} {name}: {error:e} of the peak {peak}");
            if ["Fx_N", "Fy_N", "Mx_Nm", "My_Nm", "Mz_Nm"].contains(&name.as_str()) {
                line += &format!(" {name} {error:.1e}");
            }
        }
        println!("{tyre} {mode} {set}, {} points:{line}", ours.rows.len());
    }
}

macro_rules! tables {
    ($($name:ident: $tyre:literal;)*) => {$(
        #[test]
        fn $name() {
            check($tyre, "211");
            check($tyre, "221");
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

#[test]
fn columns_come_in_any_order_and_others_are_reported() {
    let folder = TempDir::new().unwrap();
    let (plain, mixed) = (folder.path().join("a.csv"), folder.path().join("b.csv"));
    std::fs::write(&plain, format!("{}\n4000,0.01,-0.05,0.02,0,20,0\n", INPUTS.join(","))).unwrap();
    std::fs::write(
        &mixed,
        "\u{feff}Vx_mps;note\n".replace(';', ",phit_1pm, gamma_rad,alpha_rad,kappa,Fz_N,")
            + "20,0,0.02,-0.05,0.01,4000,a word\r\n",
    )
    .unwrap();
    let outputs = [&plain, &mixed].map(|input| {
        let output = input.with_extension("out");
        let ended = evaluate("car_205_60r15", input, &output, "221");
        assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
        (std::fs::read_to_string(output).unwrap(), told(&ended))
    });
    assert_eq!(outputs[0].0, outputs[1].0);
    assert_eq!(outputs[0].1, "");
    assert!(outputs[1].1.contains("b.csv: not read: note"), "{}", outputs[1].1);
    let row = Table::parse(&outputs[0].0);
    assert!(row.column("Fy_N")[0] > 1000.0, "alpha < 0 gives Fy > 0");
    assert!(row.column("p_Pa")[0] > 1e5, "0: the file's pressure, and told");
}

#[test]
fn turn_slip_modes_do_something_where_the_file_has_it() {
    let Some(tir) = reference("tyre/mfeval_MF62.tir") else { return };
    let folder = TempDir::new().unwrap();
    let input = folder.path().join("in.csv");
    std::fs::write(&input, format!("{}\n4000,0,-0.03,0,0.05,10,0\n", INPUTS.join(","))).unwrap();
    let forces = ["211", "221", "212", "222"].map(|mode| {
        let output = folder.path().join(mode);
        let ended = evaluate(tir.to_str().unwrap(), &input, &output, mode);
        assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
        Table::read(&output).column("Mz_Nm")[0]
    });
    assert!((forces[0] / forces[1] - 1.0).abs() < 0.05, "{forces:?}");
    assert!((forces[2] - forces[0]).abs() > 1.0 && (forces[3] - forces[1]).abs() > 1.0, "{forces:?}");
}

#[test]
fn bad_input_is_told_all_at_once() {
    let folder = TempDir::new().unwrap();
    let input = folder.path().join("in.csv");
    let output = folder.path().join("out.csv");
    std::fs::write(&input, "Fz_N,kappa,alpha_rad,gamma_rad\n1,2,3,4\n").unwrap();
    let ended = evaluate("no_such_tyre", &input, &output, "211");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("no shipped file of that name in tyres"), "{}", told(&ended));
    let ended = evaluate("car_205_60r15", &input, &output, "211");
    assert_eq!(ended.status.code(), Some(2));
    for missing in ["phit_1pm", "Vx_mps"] {
        assert!(
            told(&ended).contains(&format!("in.csv:1: {missing}: column is missing")),
            "{}",
            told(&ended)
        );
    }
    std::fs::write(&input, format!("{}\n-5,0,2,0,0,20,0\n4000,x,0,0,0,20,0\n", INPUTS.join(","))).unwrap();
    let ended = evaluate("car_205_60r15", &input, &output, "211");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("in.csv:3: kappa = x: must be a number"), "{}", told(&ended));
    let tir = folder.path().join("broken.tir");
    std::fs::write(&tir, "[MODEL]\nFITTYP = 61\nPCX9 = 1\n").unwrap();
    let ended = evaluate(tir.to_str().unwrap(), &folder.path().join("absent.csv"), &output, "211");
    assert_eq!(ended.status.code(), Some(2));
    assert!(told(&ended).contains("PCX9") && told(&ended).contains("absent.csv"), "{}", told(&ended));
    assert_eq!(evaluate("car_205_60r15", &input, &output, "219").status.code(), Some(2));
    assert!(!output.exists());
}

#[test]
fn the_page_of_curves_needs_nothing_else() {
    let folder = TempDir::new().unwrap();
    let output = folder.path().join("page.html");
    for tyre in ["car_205_60r15", "car_205_60r15_table"] {
        let ended = run(&["plot", "--tir", tyre, "--output", output.to_str().unwrap()]);
        assert_eq!(ended.status.code(), Some(0), "{}", told(&ended));
        let page = std::fs::read_to_string(&output).unwrap();
        assert!(page.matches("<figure>").count() >= 12);
        // Nothing is fetched: the browser is told so, and what comes before the plotting library names no source.
        let own = &page[..page.find("<script>").unwrap()];
        assert!(
            page.contains("default-src 'none'") && !own.contains("src=\"") && own.contains("Combined slip")
        );
        assert!(!own.contains("NaN") && !own.contains("null"), "a curve has a hole");
    }
    let ended = run(&[
        "plot",
        "--tir",
        "car_205_60r15",
        "--output",
        output.to_str().unwrap(),
        "--loads-n",
        "-1,3000",
    ]);
    assert_eq!(ended.status.code(), Some(2));
}
