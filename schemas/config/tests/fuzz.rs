//! Whatever the text is, loading ends with a section or with violations, never with a panic.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use config::car::Car;
use config::rig::Rig;
use config::scenario::Scenario;
use config::{Kind, Library, Section, load, load_with};
use proptest::prelude::*;
use std::io::Write;

/// Loads a text from a file; violations must be there and must be printable if it fails.
fn try_load<T: Section>(text: &[u8]) {
    let mut file = tempfile::Builder::new().suffix(".toml").tempfile().unwrap();
    file.write_all(text).unwrap();
    if let Err(problems) = load::<T>(file.path().to_str().unwrap()) {
        assert!(!problems.violations.is_empty());
        assert!(!problems.to_string().is_empty() && problems.to_json().is_object());
        assert!(problems.violations.iter().all(|violation| !violation.rule.is_empty()));
    }
}

fn shipped(kind: Kind) -> Vec<&'static str> {
    Library::list(kind).into_iter().map(|file| file.text).collect()
}

/// Pieces that mean something in TOML or to the schemas.
const PIECES: &[&str] = &[
    "nan",
    "-inf",
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "=",
    "\"",
    "'",
    ".",
    ",",
    "\n",
    "#",
    "1e400",
    "-1",
    "0x_",
    "99999999999999999999999",
    "true",
    "type",
    "\"sine\"",
    "[steer]",
    "extends = \"_bench\"",
    "\u{0}",
    "ä",
    "\"\"\"",
    "2026-01-01",
    "a.b.c",
    "[a]\n",
    "_file = 3",
    "extends = \"../../x.toml\"",
];

#[derive(Debug, Clone)]
enum Edit {
    Insert(usize, usize),
    Delete(usize, usize),
    Byte(usize, u8),
    Repeat(usize, usize),
}

fn edits() -> impl Strategy<Value = Vec<Edit>> {
    let at = 0..20_000_usize;
    let edit = prop_oneof![
        (at.clone(), 0..PIECES.len()).prop_map(|(at, piece)| Edit::Insert(at, piece)),
        (at.clone(), 1..200_usize).prop_map(|(at, count)| Edit::Delete(at, count)),
        (at.clone(), any::<u8>()).prop_map(|(at, byte)| Edit::Byte(at, byte)),
        (at, 1..200_usize).prop_map(|(at, count)| Edit::Repeat(at, count)),
    ];
    proptest::collection::vec(edit, 1..8)
}

fn edited(text: &str, edits: &[Edit]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for edit in edits {
        let within = |at: usize| at % (bytes.len() + 1);
        match edit {
            Edit::Insert(at, piece) => {
                let at = within(*at);
                bytes.splice(at..at, PIECES[*piece].bytes());
            }
            Edit::Delete(at, count) => {
                let at = within(*at);
                let end = (at + count).min(bytes.len());
                bytes.drain(at..end);
            }
            Edit::Byte(at, byte) => {
                let at = within(*at);
                if let Some(old) = bytes.get_mut(at) {
                    *old = *byte;
                }
            }
            Edit::Repeat(at, count) => {
                let at = within(*at);
                let end = (at + count).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                bytes.splice(at..at, piece);
            }
        }
    }
    bytes
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn edited_scenarios_do_not_panic(which in 0..100_usize, edits in edits()) {
        let texts = shipped(Kind::Scenario);
        try_load::<Scenario>(&edited(texts[which % texts.len()], &edits));
    }

    #[test]
    fn edited_cars_do_not_panic(edits in edits()) {
        for text in shipped(Kind::Car).into_iter().take(1) {
            try_load::<Car>(&edited(text, &edits));
        }
    }

    #[test]
    fn edited_rigs_do_not_panic(edits in edits()) {
        for text in shipped(Kind::Rig).into_iter().take(1) {
            try_load::<Rig>(&edited(text, &edits));
        }
    }

    #[test]
    fn any_bytes_do_not_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        try_load::<Scenario>(&bytes);
    }

    #[test]
    fn any_override_does_not_panic(text in "\\PC{0,40}", piece in 0..PIECES.len()) {
        for text in [text.clone(), format!("steer.{text}"), format!("{text}={}", PIECES[piece])] {
            let _ = load_with::<Scenario>("growing_slalom_80", &[text]);
        }
    }
}

#[test]
fn long_dotted_keys_and_deep_tables_do_not_overflow() {
    for depth in [60, 70, 100, 1000, 20_000] {
        try_load::<Scenario>(format!("{}a = 1\n", "a.".repeat(depth)).as_bytes());
        try_load::<Scenario>(format!("[{}a]\n", "a.".repeat(depth)).as_bytes());
        try_load::<Scenario>(format!("a = {}1{}\n", "{a=".repeat(depth), "}".repeat(depth)).as_bytes());
    }
}
