//! The reference files that the executable carries: cars, suspensions, tyres, units, rigs, scenarios, models, campaigns, studies.

use crate::validate::closest;
use include_dir::{Dir, include_dir};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

static CARS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../cars");
static SUSPENSIONS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../suspensions");
static TYRES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../tyres");
static UNITS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../units");
static SCENARIOS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../scenarios");
static RIGS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../rigs");
static CAN: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../can");
static CAMPAIGNS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../campaigns");
static STUDIES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../studies");
static MODELS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../models");

/// Kinds of shipped files; each has its directory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Scenarios.
    Scenario,
    /// Cars.
    Car,
    /// Axles: suspensions by their hardpoints.
    Suspension,
    /// Tyre property files.
    Tyre,
    /// Steering units.
    Unit,
    /// Rigs.
    Rig,
    /// Functional models.
    Model,
    /// CAN mappings and DBC files.
    Can,
    /// Fault campaigns.
    Campaign,
    /// Parameter studies.
    Study,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::Scenario,
        Self::Car,
        Self::Suspension,
        Self::Tyre,
        Self::Unit,
        Self::Rig,
        Self::Model,
        Self::Can,
        Self::Campaign,
        Self::Study,
    ];

    /// Directory of the kind in the library.
    pub fn directory(self) -> &'static str {
        match self {
            Self::Scenario => "scenarios",
            Self::Car => "cars",
            Self::Suspension => "suspensions",
            Self::Tyre => "tyres",
            Self::Unit => "units",
            Self::Rig => "rigs",
            Self::Model => "models",
            Self::Can => "can",
            Self::Campaign => "campaigns",
            Self::Study => "studies",
        }
    }

    fn embedded(self) -> &'static Dir<'static> {
        match self {
            Self::Scenario => &SCENARIOS,
            Self::Car => &CARS,
            Self::Suspension => &SUSPENSIONS,
            Self::Tyre => &TYRES,
            Self::Unit => &UNITS,
            Self::Rig => &RIGS,
            Self::Model => &MODELS,
            Self::Can => &CAN,
            Self::Campaign => &CAMPAIGNS,
            Self::Study => &STUDIES,
        }
    }
}

/// A shipped file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shipped {
    /// Its bare name, by which files and commands refer to it.
    pub name: &'static str,
    /// Its file name.
    pub file_name: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// The shipped files.
#[derive(Debug, Clone, Copy, Default)]
pub struct Library;

impl Library {
    /// The shipped files of a kind by name; those that start with `_` (shared parts) and notes are left out.
    pub fn list(kind: Kind) -> Vec<Shipped> {
        Self::all(kind).filter(|shipped| !shipped.name.starts_with('_')).collect()
    }

    /// The shipped file of a kind by its bare name, or by its file name.
    pub fn get(kind: Kind, name: &str) -> Option<Shipped> {
        Self::all(kind).find(|shipped| shipped.file_name == name || shipped.name == name)
    }

    /// The shipped file at a path such as `cars/sedan.toml`.
    pub fn at(path: &str) -> Option<Shipped> {
        let (directory, file_name) = path.split_once('/')?;
        let kind = Kind::ALL.into_iter().find(|kind| kind.directory() == directory)?;
        Self::all(kind).find(|shipped| shipped.file_name == file_name)
    }

    /// The name that was probably meant.
    pub fn closest(kind: Kind, name: &str) -> Option<String> {
        closest(name, Self::all(kind).map(|shipped| shipped.name).filter(|name| !name.starts_with('_')))
    }

    fn all(kind: Kind) -> impl Iterator<Item = Shipped> {
        let mut files: Vec<_> = kind.embedded().files().filter_map(shipped).collect();
        files.sort_by_key(|file| file.file_name);
        files.into_iter()
    }
}

fn shipped(file: &'static include_dir::File<'static>) -> Option<Shipped> {
    let file_name = file.path().file_name()?.to_str()?;
    let name = file.path().file_stem()?.to_str()?;
    let extension = file.path().extension()?.to_str()?;
    if !["toml", "json", "tir", "dbc"].contains(&extension) {
        return None;
    }
    Some(Shipped { name, file_name, text: file.contents_utf8()? })
}
