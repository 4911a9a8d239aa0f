//! Every shipped file loads, and says what it should.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::axle::Axle;
use config::car::Car;
use config::rig::Rig;
use config::scenario::Scenario;
use config::unit::SteeringUnit;
use config::{Kind, Library, Section, load};

fn all_load<T: Section>() -> usize {
    let files = Library::list(T::KIND);
    for file in &files {
        if let Err(problems) = load::<T>(file.name) {
            panic!("{} does not load:\n{problems}", file.file_name);
        }
    }
    files.len()
}

#[test]
fn every_shipped_file_loads() {
    assert!(all_load::<Scenario>() >= 12);
    assert!(all_load::<Axle>() >= 2);
    assert!(all_load::<Rig>() >= 1);
    assert!(all_load::<SteeringUnit>() >= 1);
    all_load::<Car>();
}

#[test]
fn shared_parts_and_notes_are_not_listed() {
    let names: Vec<_> = Library::list(Kind::Scenario).into_iter().map(|file| file.name).collect();
    assert!(names.contains(&"growing_slalom_80"));
    assert!(!names.iter().any(|name| name.starts_with('_') || *name == "README"));
}

#[test]
fn a_scenario_is_called_as_its_file() {
    for file in Library::list(Kind::Scenario) {
        let scenario = load::<Scenario>(file.name).unwrap().value;
        assert_eq!(scenario.name, file.name);
    }
}

#[test]
fn a_section_written_out_loads_as_the_same() {
    let loaded = load::<Scenario>("growing_slalom_80").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("out.toml");
    std::fs::write(&path, toml::to_string(&loaded.value).unwrap()).unwrap();
    assert_eq!(load::<Scenario>(path.to_str().unwrap()).unwrap().value, loaded.value);
}

#[test]
fn editors_get_a_schema_that_allows_extends_and_still_tells_variants_apart() {
    let all = config::all_schemas();
    assert!(all.len() >= 6);
    for (kind, schema) in &all {
        assert_eq!(schema["properties"]["extends"]["type"], "string", "{kind:?}");
        assert_eq!(schema["additionalProperties"], false, "{kind:?}");
        assert!(schema.get("required").is_none(), "{kind:?}: an extended file may state the rest");
    }
    let sine = &all[0].1["$defs"]["Steer"]["oneOf"][2];
    assert_eq!(sine["required"], serde_json::json!(["type"]));
    assert_eq!(sine["properties"]["type"]["const"], "sine");
    assert!(sine["properties"]["frequency_hz"]["description"].as_str().unwrap().contains("[Hz]"));
}

#[test]
fn every_shipped_campaign_loads_and_its_scenario_too() {
    for file in Library::list(Kind::Campaign) {
        let campaign = config::load::<config::campaign::Campaign>(file.name);
        let campaign = campaign.unwrap_or_else(|problems| panic!("{problems}")).value;
        assert_eq!(campaign.name, file.name);
        config::ResolvedBench::load(&campaign.scenario, &campaign.set)
            .unwrap_or_else(|problems| panic!("{}: {problems}", file.name));
    }
}
