//! Signals by name: `region.field` or `region.field.label`, as in logs and exports.

use regions::{ALL, Kind, RegionId};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::sync::LazyLock;

/// Where a signal's word is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Signal {
    pub(crate) region: RegionId,
    pub(crate) word: usize,
    pub(crate) kind: Kind,
}

static BY_NAME: LazyLock<HashMap<String, Signal>> = LazyLock::new(|| {
    let mut all = HashMap::new();
    for region in ALL.into_iter().filter(|id| id.region().logged()) {
        for column in region.region().layout.columns() {
            let name = format!("{}.{}", region.region().name, column.name);
            all.insert(name, Signal { region, word: column.word, kind: column.kind });
        }
    }
    all
});

/// The signal of that name.
pub(crate) fn find(name: &str) -> Option<Signal> {
    BY_NAME.get(name).copied()
}

/// A word as JSON: `null` where there is no number.
pub(crate) fn number(kind: Kind, word: u64) -> Value {
    match kind {
        Kind::F64 => {
            let value = f64::from_bits(word);
            if value.is_finite() { json!(value) } else { Value::Null }
        }
        Kind::U64 if word == u64::MAX => Value::Null,
        Kind::U64 => json!(word),
    }
}

/// Every signal with unit and meaning, for the page's choice.
pub(crate) fn catalogue() -> Value {
    let mut rows = Vec::new();
    for region in ALL.into_iter().filter(|id| id.region().logged()) {
        for column in region.region().layout.columns() {
            let name = format!("{}.{}", region.region().name, column.name);
            rows.push(json!([name, column.unit, column.doc]));
        }
    }
    Value::Array(rows)
}
