//! The double wishbone with bushings against an independent multibody code: four load cases.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use std::collections::BTreeMap;

use config::axle::{Axle, Bushing};
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use spatial::Vector3;
use support::{Table, reference};

fn compliant(file: &str) {
    let (Some(text), Some(hardpoints)) = (reference(file), reference("hardpoints_dw_sedan.json")) else {
        return;
    };
    let table = Table::parse(&text);
    let mut axle = Axle::from_hardpoint_json(&hardpoints, "dw_sedan").unwrap();
    let bushing = Bushing {
        radial_n_per_m: 8e6,
        axial_n_per_m: 1e6,
        torsional_n_m_per_rad: 50.0,
        axis: None,
        damping: None,
    };
    let points = ["uca_front", "uca_rear", "lca_front", "lca_rear"];
    axle.bushings =
        Some(points.map(|name| (name.to_owned(), bushing.clone())).into_iter().collect::<BTreeMap<_, _>>());
    let mut suspension = Suspension::new(&axle).unwrap();
    let mut output = SuspensionOutput::default();
    suspension.step(&SuspensionInput::DESIGN, &mut output);
    let design = output;
    // The reference locks the springs at their design length.
    assert!(suspension.lock_springs(Some(design.side.map(|side| side.spring_length_m))));
    let mut worst: BTreeMap<&str, f64> = BTreeMap::new();
    let mut most = 0;
    for row in 0..table.len() {
        let at = |name: &str| table.get(row, name);
        let mut input = SuspensionInput::DESIGN;
        for (k, s) in ["L", "R"].iter().enumerate() {
            let vector = |n: &str| Vector3::from(["x", "y", "z"].map(|a| at(&format!("{n}{a}k_{s}"))));
            (input.wheel_force_n[k], input.wheel_moment_n_m[k]) = (vector("F"), vector("M"));
        }
        suspension.step(&input, &mut output);
        assert_eq!(output.status, Status::Converged, "{file} row {row}");
        most = most.max(output.iterations);
        for (k, s) in ["L", "R"].iter().enumerate() {
            let (side, free) = (&output.side[k], &design.side[k]);
            let vector = |n: &str| Vector3::from(["x", "y", "z"].map(|a| at(&format!("{n}_{a}_{s}"))));
            let one = |n: &str| at(&format!("{n}_{s}"));
            let mut check = |what: &'static str, off: f64, peak: f64, limit: f64| {
                let off = off / peak;
                let entry = worst.entry(what).or_default();
                *entry = entry.max(off);
                assert!(off <= limit, "{file} row {row} side {s} {what}: off by {off:e} of the peak");
            };
            check("tie", (side.tie_rod_force_n - one("tie")).abs(), table.peak("tie"), 1e-6);
            check("spring", (side.spring_force_n - one("spring")).abs(), table.peak("spring"), 1e-5);
            check("toe", (side.toe_rad - one("toe")).abs(), table.peak("dtoe"), 1e-5);
            check("dtoe", (side.toe_rad - free.toe_rad - one("dtoe")).abs(), table.peak("dtoe"), 1e-5);
            check("camber", (side.camber_rad - one("camber")).abs(), table.peak("dcamber"), 1e-5);
            check("Fubj", (side.upper_joint_force_n - vector("Fubj")).amax(), table.peak("Fubj"), 1e-5);
            check("Flbj", (side.lower_joint_force_n - vector("Flbj")).amax(), table.peak("Flbj"), 1e-5);
            check("wc [m]", (side.wheel_centre_m - vector("wc")).amax(), 1.0, 1e-9);
            let q = ["q0", "q1", "q2", "q3"].map(one);
            let off = (0..4).map(|c| (q[c] - side.knuckle_quaternion[c]).abs()).fold(0.0, f64::max);
            check("q", off, 1.0, 1e-8);
            for (place, name) in points.iter().enumerate() {
                let expect = vector(&format!("defl_{name}"));
                let off = (side.bushing_deflection_m[place] - expect).amax();
                check("deflection", off, table.peak("defl_"), 1e-5);
            }
        }
    }
    println!("{file}: {} rows, at most {most} Newton steps; off by at most, of the run's peak:", table.len());
    for (what, off) in worst {
        println!("  {what:<11} {off:.1e}");
    }
}

macro_rules! files {
    ($($name:ident: $file:literal;)+) => { $(#[test] fn $name() { compliant($file); })+ };
}

files! {
    fy2000: "ref_dw_sedan_compliant_fy2000.csv";
    fy2000_fz4000: "ref_dw_sedan_compliant_fy2000_fz4000.csv";
    fxm2000: "ref_dw_sedan_compliant_fxm2000.csv";
    fxm2000_fz4000: "ref_dw_sedan_compliant_fxm2000_fz4000.csv";
}

#[test]
fn stiff_bushings_approach_the_rigid_axle() {
    for name in ["sedan_double_wishbone", "compact_strut", "sedan_five_link"] {
        let path = format!("{}/../../../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let rigid: Axle = toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        let input = |k: u32| SuspensionInput {
            rack_m: 4e-4 * f64::from(k),
            wheel_height_m: [3e-4 * f64::from(k), -2e-4 * f64::from(k)],
            rack_speed_m_s: 0.4,
            wheel_speed_m_s: [0.3, -0.2],
            wheel_force_n: [Vector3::new(-300.0, 1500.0, 4500.0), Vector3::new(-200.0, 900.0, 2500.0)],
            wheel_moment_n_m: [Vector3::new(400.0, 20.0, -50.0), Vector3::new(250.0, 10.0, -30.0)],
        };
        let mut off = Vec::new();
        for stiffness in [1e6, 1e8] {
            let mut soft = rigid.clone();
            let axis = (name == "sedan_five_link").then_some([0.3, 0.1, 1.0]);
            let bushing = Bushing {
                radial_n_per_m: stiffness,
                axial_n_per_m: stiffness,
                torsional_n_m_per_rad: 1e-2,
                axis,
                damping: None,
            };
            // The spring stands beside its link's line: no bushing holds the link against turning about it.
            let points = soft.geometry.body_points().iter().filter(|point| **point != "lower_front_inner");
            let all = points.map(|point| ((*point).to_owned(), bushing.clone()));
            soft.bushings = Some(all.collect());
            let mut a = Suspension::new(&rigid).unwrap();
            let mut b = Suspension::new(&soft).unwrap();
            let (mut x, mut y) = (SuspensionOutput::default(), SuspensionOutput::default());
            let mut worst = [0.0_f64; 4];
            for k in 0..60 {
                a.step(&input(k), &mut x);
                b.step(&input(k), &mut y);
                assert_eq!((x.status, y.status), (Status::Converged, Status::Converged), "{name} {k}");
                for side in 0..2 {
                    let (x, y) = (&x.side[side], &y.side[side]);
                    worst[0] = worst[0].max((x.tie_rod_force_n - y.tie_rod_force_n).abs());
                    worst[1] = worst[1].max((x.spring_force_n - y.spring_force_n).abs());
                    worst[2] = worst[2].max((x.toe_rad - y.toe_rad).abs());
                    worst[3] =
                        worst[3].max((x.tie_rod_ball_velocity_m_s - y.tie_rod_ball_velocity_m_s).amax());
                }
            }
            println!(
                "{name}, {stiffness:.0e} N/m: off from rigid by tie {:.2e} N, spring {:.2e} N, toe {:.2e} rad, ball velocity {:.2e} m/s",
                worst[0], worst[1], worst[2], worst[3]
            );
            off.push(worst);
        }
        // A hundred times stiffer: a hundred times nearer.
        for k in 0..4 {
            assert!(off[1][k] < 0.03 * off[0][k], "{name} {k}: {off:?}");
        }
    }
}
