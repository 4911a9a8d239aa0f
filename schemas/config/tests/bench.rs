//! A bench resolves from one name, hashes by content, and comes back from its log text.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::{Kind, Library, ResolvedBench};
use std::path::PathBuf;

fn bench(name: &str, overrides: &[&str]) -> ResolvedBench {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    ResolvedBench::load(name, &overrides).unwrap_or_else(|problems| panic!("{name}:\n{problems}"))
}

#[test]
fn every_shipped_scenario_resolves_except_those_that_need_a_record() {
    for file in Library::list(Kind::Scenario) {
        if !["double_lane_change_measured", "reproduce_run"].contains(&file.name) {
            let bench = bench(file.name, &[]);
            assert_eq!(bench.tyres.len(), 2);
            assert!(
                bench
                    .sources
                    .iter()
                    .any(|source| source.name == format!("library:scenarios/{}", file.file_name))
            );
        }
    }
}

#[test]
fn the_hash_tells_content_and_nothing_else() {
    let plain = bench("growing_slalom_80", &[]);
    assert_eq!(plain.hash(), bench("growing_slalom_80", &[]).hash());
    assert_eq!(plain.hash().len(), 64);
    let others = ["steer.last_amplitude_deg=49", "car.body.sprung_mass_kg=1371", "rig.name=other", "seed=2"];
    for other in others {
        assert_ne!(plain.hash(), bench("growing_slalom_80", &[other]).hash(), "{other}");
    }
    assert_eq!(bench("growing_slalom_80", &["car.body.sprung_mass_kg=1371"]).car.body.sprung_mass_kg, 1371.0);
    let kept = bench("growing_slalom_80", &["steer.last_amplitude_deg=75"]);
    assert_eq!(plain.hash(), kept.hash());
}

#[test]
fn a_bench_comes_back_from_its_log_text() {
    let bench = bench("steady_circle_r80", &[]);
    let text = bench.to_json().to_string();
    let back = ResolvedBench::from_json(&text).unwrap();
    assert_eq!(back, bench);
    assert_eq!(back.hash(), bench.hash());
    assert!(ResolvedBench::from_json("{").is_err());
    assert!(ResolvedBench::from_json("{\"scenario\": 1}").is_err());
}

/// The reference data lie beside the repository, read in place.
fn reference(path: &str) -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
    let path = root.join("../shared/reference").join(path);
    if path.exists() {
        return Some(path);
    }
    eprintln!("missing: reference/{}", path.display());
    assert!(std::env::var("CI").as_deref() != Ok("true"), "reference data missing");
    None
}

#[test]
fn the_measured_double_lane_change_drives_by_one_setting() {
    let Some(directory) = reference("measured/bmw_m8_roadview") else { return };
    let set = format!("record.directory={}", directory.display());
    let bench = bench("double_lane_change_measured", &[&set]);
    let record = bench.record.as_ref().unwrap();
    let steer = record.steering_wheel_angle_rad.as_ref().unwrap();
    let peak = steer.value.iter().map(|angle| angle.abs()).fold(0.0, f64::max);
    assert!((0.6..0.8).contains(&peak), "{peak} rad at the hand wheel");
    let speed = record.speed_m_s.as_ref().unwrap();
    let within: Vec<f64> = speed
        .time_s
        .iter()
        .zip(&speed.value)
        .filter(|(t, _)| (0.0..=7.9).contains(*t))
        .map(|(_, v)| *v)
        .collect();
    assert!(within.iter().all(|v| (17.5..20.5).contains(v)), "{within:?}");
    assert_eq!(record.measured.len(), 3);
    let lateral = &record.measured[0].series.value;
    assert!((lateral.iter().map(|a| a.abs()).fold(0.0, f64::max) - 6.231312).abs() < 1e-9);
    // Where the record lies does not change what it is.
    let other = bench.clone();
    assert_eq!(other.hash(), bench.hash());
}
