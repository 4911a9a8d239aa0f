//! Who may depend on whom. The architecture's first invariants, read from the manifests and the sources.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Layer of each crate: it may depend on crates of lower layers only, and on those of its own row's list.
const LAYERS: &[(&str, &[&str])] = &[
    ("config", &[]),
    ("regions", &[]),
    ("table", &[]),
    ("params", &["config", "regions"]),
    ("operator_link", &["params", "table"]),
    ("spatial", &[]),
    ("metrics", &[]),
    ("road", &["config"]),
    ("tyre", &["config"]),
    ("functional_model", &["spatial"]),
    ("manoeuvre", &["config"]),
    ("multibody", &["spatial", "config"]),
    ("vehicle", &["spatial", "config", "tyre", "functional_model"]),
    ("rig_plant", &["config", "functional_model"]),
    ("rig_control", &["config", "rig_plant", "metrics"]),
    ("safety", &["config", "rig_plant", "rig_control"]),
    ("runtime", &["table", "regions"]),
    ("can", &["config"]),
    ("fmu", &[]),
    (
        "assembly",
        &[
            "can",
            "fmu",
            "config",
            "regions",
            "params",
            "table",
            "runtime",
            "spatial",
            "multibody",
            "tyre",
            "vehicle",
            "functional_model",
            "rig_plant",
            "rig_control",
            "manoeuvre",
            "road",
            "safety",
        ],
    ),
    ("fmu_export", &["assembly", "config", "multibody", "vehicle"]),
    ("record", &["regions"]),
    ("report", &["record", "metrics", "regions"]),
    (
        "study",
        &[
            "assembly",
            "config",
            "metrics",
            "multibody",
            "params",
            "record",
            "regions",
            "report",
            "runtime",
            "table",
        ],
    ),
    ("vehicle_service", &["assembly", "table"]),
    ("multibody_service", &["assembly", "table"]),
    ("rig_service", &["assembly", "table"]),
    ("can_service", &["assembly", "can", "runtime", "table"]),
    ("fmu_service", &["assembly", "fmu", "regions", "runtime", "table"]),
    ("logger", &["assembly", "params", "record", "regions", "runtime", "table"]),
    (
        "console_service",
        &["assembly", "config", "operator_link", "params", "record", "regions", "report", "safety", "table"],
    ),
    (
        "bridge_service",
        &["assembly", "console_service", "logger", "operator_link", "params", "record", "regions", "table"],
    ),
    (
        "supervisor",
        &["assembly", "config", "logger", "operator_link", "params", "record", "regions", "runtime", "table"],
    ),
];

/// May depend on everything.
const TOP: &[&str] = &["kingpin", "kingpin_python", "kingpin_tests", "kingpin_benches"];

fn manifests() -> Vec<(PathBuf, toml::Table)> {
    let root = workspace();
    let text = std::fs::read_to_string(root.join("Cargo.toml")).unwrap();
    let workspace: toml::Table = text.parse().unwrap();
    workspace["workspace"]["members"]
        .as_array()
        .unwrap()
        .iter()
        .map(|member| {
            let folder = root.join(member.as_str().unwrap());
            let text = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
            (folder, text.parse().unwrap())
        })
        .collect()
}

#[test]
fn crates_depend_downwards_only() {
    let manifests = manifests();
    let ours: BTreeSet<String> =
        manifests.iter().map(|(_, m)| m["package"]["name"].as_str().unwrap().to_owned()).collect();
    let allowed: BTreeMap<_, _> = LAYERS.iter().copied().collect();
    let mut faults = Vec::new();
    for (_, manifest) in &manifests {
        let name = manifest["package"]["name"].as_str().unwrap();
        if TOP.contains(&name) {
            continue;
        }
        let Some(may) = allowed.get(name) else {
            faults.push(format!("{name} has no place in the layers: give it one"));
            continue;
        };
        let dependencies = manifest.get("dependencies").and_then(|d| d.as_table());
        for dependency in dependencies.into_iter().flat_map(|d| d.keys()) {
            if ours.contains(dependency) && !may.contains(&dependency.as_str()) {
                faults.push(format!("{name} depends on {dependency}"));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn each_layer_only_lists_layers_before_it() {
    let mut seen = BTreeSet::new();
    for (name, may) in LAYERS {
        for below in *may {
            assert!(seen.contains(below), "{name} lists {below}, which does not stand before it");
        }
        seen.insert(*name);
    }
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// The part of a source file that ships: what stands before its in-file tests, without comments.
fn shipped(text: &str) -> String {
    let code = text.split("#[cfg(test)]").next().unwrap();
    code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

#[test]
fn physics_reads_no_clock_no_file_and_no_environment() {
    let banned = [
        "Instant::now",
        "SystemTime",
        "std::fs",
        "std::env",
        "std::process",
        "std::net",
        "std::thread",
        "HashMap",
        "thread_rng",
        "println!",
    ];
    let mut faults = Vec::new();
    for (folder, _) in manifests() {
        if !folder.starts_with(workspace().join("shared/physics")) && !folder.ends_with("shared/safety") {
            continue;
        }
        let mut files = Vec::new();
        sources(&folder.join("src"), &mut files);
        for file in files {
            let code = shipped(&std::fs::read_to_string(&file).unwrap());
            for word in banned {
                if code.contains(word) {
                    faults.push(format!("{}: {word}", file.display()));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn unsafe_stands_in_named_files_only() {
    let named = [
        "shared/table/src/segment.rs",
        "shared/runtime/src/realtime.rs",
        "shared/fmu/src/binary.rs",
        "services/kingpin/src/heap.rs",
        "shared/fmu_export/src/abi.rs",
    ];
    let mut faults = Vec::new();
    for (folder, _) in manifests() {
        let mut files = Vec::new();
        if folder.join("src").is_dir() {
            sources(&folder.join("src"), &mut files);
        }
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            let name = file.strip_prefix(workspace()).unwrap().to_string_lossy().into_owned();
            let code = shipped(&text);
            if (code.contains("unsafe {") || code.contains("unsafe fn") || code.contains("unsafe impl"))
                && !named.contains(&name.as_str())
            {
                faults.push(name.clone());
            }
            for (at, line) in text.lines().enumerate() {
                if line.contains("unsafe {") && named.contains(&name.as_str()) {
                    let before = text.lines().skip(at.saturating_sub(6)).take(7).collect::<String>();
                    assert!(before.contains("SAFETY:"), "{name}:{}: unsafe without its SAFETY line", at + 1);
                }
            }
        }
    }
    assert!(faults.is_empty(), "unsafe outside the named files: {}", faults.join(", "));
}

#[test]
fn every_source_file_says_what_it_is() {
    let mut faults = Vec::new();
    for (folder, _) in manifests() {
        let mut files = Vec::new();
        for part in ["src", "tests", "benches"] {
            if folder.join(part).is_dir() {
                sources(&folder.join(part), &mut files);
            }
        }
        for file in files {
            let text = std::fs::read_to_string(&file).unwrap();
            if !text.starts_with("//!") {
                faults.push(file.display().to_string());
            }
        }
    }
    assert!(faults.is_empty(), "no //! at the top of {}", faults.join(", "));
}

#[test]
fn only_tests_speak_of_the_reference_data() {
    let mut faults = Vec::new();
    for (folder, _) in manifests() {
        if folder.ends_with("tests") || !folder.join("src").is_dir() {
            continue;
        }
        let mut files = Vec::new();
        sources(&folder.join("src"), &mut files);
        for file in files {
            if shipped(&std::fs::read_to_string(&file).unwrap()).contains("../shared") {
                faults.push(file.display().to_string());
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join(", "));
}
