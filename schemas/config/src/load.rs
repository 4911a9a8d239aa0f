//! Loading a section: TOML text, `extends`, `--set`, schema, [`Check`] — all violations at once, each with
//! file, line, column, key, value and rule.
//!
//! A reference to a file is a path (it holds a `/` or a `.`), taken relative to the file that says it, or a
//! bare name, which is that of a shipped file ([`Library`]). A file name without directory that is not beside
//! the file that says it is looked for among the shipped ones too. `extends` follows the same rules.

use crate::check::{Broken, Check};
use crate::library::{Kind, Library};
use crate::problem::{Mistake, Problems, Violation};
use crate::tree::{self, Entry, Node, Origin, Place, Source, Table, Value};
use crate::validate;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::{Component, Path, PathBuf};

/// Longest chain of `extends`.
pub const EXTENDS_MAX: usize = 8;
/// Largest tyre or hardpoint file. [bytes]
pub const REFERENCE_BYTES_MAX: u64 = 64 << 20;
/// Largest configuration file. [bytes]
pub const FILE_BYTES_MAX: u64 = 8 << 20;

/// A section that can be loaded: what it is called and where shipped ones lie.
pub trait Section: Serialize + DeserializeOwned + JsonSchema + Check {
    /// Kind of the shipped files that hold this section.
    const KIND: Kind;

    /// Reads a foreign format by its file extension; `None`: the section has none by that name.
    fn from_foreign(_extension: &str, _text: &str, _name: &str) -> Option<Result<Self, Vec<Broken>>> {
        None
    }
}

impl Section for crate::scenario::Scenario {
    const KIND: Kind = Kind::Scenario;
}

impl Section for crate::campaign::Campaign {
    const KIND: Kind = Kind::Campaign;
}

impl Section for crate::study::Study {
    const KIND: Kind = Kind::Study;
}

impl Section for crate::car::Car {
    const KIND: Kind = Kind::Car;
}

impl Section for crate::rig::Rig {
    const KIND: Kind = Kind::Rig;
}

impl Section for crate::unit::SteeringUnit {
    const KIND: Kind = Kind::Unit;
}

/// Lies in a file of its own for runs without a scenario; one that it extends is looked for among the scenarios.
impl Section for crate::equations::Equations {
    const KIND: Kind = Kind::Scenario;
}

impl Section for crate::can::Can {
    const KIND: Kind = Kind::Can;
}

impl Section for crate::axle::Axle {
    const KIND: Kind = Kind::Suspension;

    fn from_foreign(extension: &str, text: &str, name: &str) -> Option<Result<Self, Vec<Broken>>> {
        (extension == "json").then(|| Self::from_hardpoint_json(text, name))
    }
}

/// A loaded section with the place of each of its values.
#[derive(Debug, Clone)]
pub struct Loaded<T> {
    /// The section.
    pub value: T,
    /// Every value and its place.
    pub tree: Node,
    /// The texts that it was made of; the first is the file asked for.
    pub sources: Vec<Source>,
}

impl<T> Loaded<T> {
    /// The place where a value was written, as `file:line:column`.
    pub fn written_at(&self, key: &str) -> String {
        let at = self.tree.origin_near(key);
        let name = self.sources.get(at.source).map(|source| source.place.name()).unwrap_or_default();
        if at.line == 0 { name } else { format!("{name}:{}:{}", at.line, at.column) }
    }

    /// A violation about a key, placed where its value was written.
    pub fn violation(&self, mistake: Mistake, key: &str, rule: impl Into<String>) -> Violation {
        violation_in(&self.tree, &self.sources, mistake, key, rule.into())
    }
}

/// Loads a section from a path, or a shipped one by its bare name.
///
/// # Errors
/// All violations at once.
pub fn load<T: Section>(reference: &str) -> Result<Loaded<T>, Problems> {
    load_with(reference, &[])
}

/// As [`load`], with `path=value` overrides laid over the file. A value is TOML (`3.5`, `"text"`, `[1, 2]`,
/// `true`); what is not TOML is taken as a text, so that file names need no quotes.
///
/// # Errors
/// All violations at once.
pub fn load_with<T: Section>(reference: &str, overrides: &[String]) -> Result<Loaded<T>, Problems> {
    load_at(&place_of_argument(reference, T::KIND)?, overrides)
}

/// As [`load_with`], from a place.
///
/// # Errors
/// All violations at once.
pub fn load_at<T: Section>(place: &Place, overrides: &[String]) -> Result<Loaded<T>, Problems> {
    let mut draft = Draft::read(place, T::KIND, overrides)?;
    draft.finish()
}

/// A file argument of a command: a path, or the bare name of a shipped file.
///
/// # Errors
/// A bare name that the library does not have.
pub fn place_of_argument(reference: &str, kind: Kind) -> Result<Place, Problems> {
    resolve(reference, &Place::Override, kind).map_err(|lost| {
        let violation = Violation::of_file(Mistake::NotFound, reference, lost.rule);
        Problems::one(Violation { suggestion: lost.suggestion, ..violation })
    })
}

/// The text of a file that is not TOML of ours: a path, or the bare name of a shipped file.
///
/// # Errors
/// A name that the library does not have, a file that cannot be read.
pub fn reference_text(reference: &str, kind: Kind) -> Result<crate::TextFile, Problems> {
    let place = place_of_argument(reference, kind)?;
    let text = read_text(&place, REFERENCE_BYTES_MAX).map_err(|violation| Problems::one(*violation))?;
    Ok(crate::TextFile { name: place.name(), text })
}

/// A tree that is read and merged but not yet checked.
pub(crate) struct Draft {
    pub(crate) tree: Node,
    pub(crate) sources: Vec<Source>,
    problems: Problems,
}

impl Draft {
    /// Reads and merges; `Err` if there is no tree to check at all.
    pub(crate) fn read(place: &Place, kind: Kind, overrides: &[String]) -> Result<Self, Problems> {
        let mut sources = Vec::new();
        let mut tree = read_tree(place, kind, &mut sources, &mut Vec::new())?;
        let mut problems = Problems::default();
        apply_overrides(&mut tree, overrides, &mut sources, &mut problems);
        Ok(Self { tree, sources, problems })
    }

    /// Checks everything and makes the section.
    pub(crate) fn finish<T: Section>(&mut self) -> Result<Loaded<T>, Problems> {
        let mut problems = std::mem::take(&mut self.problems);
        validate::validate(&raw_schema::<T>(), &self.tree, &self.sources, &mut problems);
        if problems.is_empty() {
            match serde_json::from_value::<T>(self.tree.to_json()) {
                Ok(value) => {
                    for broken in value.broken() {
                        problems.push(self.violation(Mistake::Rule, &broken.key, broken.rule));
                    }
                    if problems.is_empty() {
                        let (tree, sources) = (self.tree.clone(), self.sources.clone());
                        return Ok(Loaded { value, tree, sources });
                    }
                }
                // The schema said yes and the type says no: still the user's input, and it must be told.
                Err(error) => problems.push(self.violation(Mistake::WrongType, "", error.to_string())),
            }
        }
        problems.sort();
        Err(problems)
    }

    pub(crate) fn violation(&self, mistake: Mistake, key: &str, rule: String) -> Violation {
        violation_in(&self.tree, &self.sources, mistake, key, rule)
    }

    /// The place and text of a file named at a key; `None` if the key holds no text.
    pub(crate) fn reference(&self, key: &str, kind: Kind) -> Option<Result<Place, Violation>> {
        reference_in(&self.tree, &self.sources, key, kind)
    }
}

fn violation_in(tree: &Node, sources: &[Source], mistake: Mistake, key: &str, rule: String) -> Violation {
    let at = tree.origin_near(key);
    let value = match tree.at(key).map(|node| &node.value) {
        None | Some(Value::Table(_)) => String::new(),
        Some(value) => value.shown(),
    };
    Violation {
        mistake,
        file: sources.get(at.source).map(|source| source.place.name()).unwrap_or_default(),
        line: at.line,
        column: at.column,
        key: key.to_owned(),
        value,
        rule,
        suggestion: None,
    }
}

/// The file that the text at `key` names, relative to where it was written.
pub(crate) fn reference_in(
    tree: &Node,
    sources: &[Source],
    key: &str,
    kind: Kind,
) -> Option<Result<Place, Violation>> {
    let node = tree.at(key)?;
    let Value::Text(reference) = &node.value else { return None };
    let from = &sources.get(node.origin.source)?.place;
    Some(resolve(reference, from, kind).and_then(|place| exists(&place).map(|()| place)).map_err(|lost| {
        let violation = violation_in(tree, sources, Mistake::NotFound, key, lost.rule);
        Violation { suggestion: lost.suggestion, ..violation }
    }))
}

pub(crate) struct Lost {
    pub(crate) rule: String,
    pub(crate) suggestion: Option<String>,
}

/// Resolves a reference said at `from`.
pub(crate) fn resolve(reference: &str, from: &Place, kind: Kind) -> Result<Place, Lost> {
    if reference.is_empty() {
        return Err(Lost { rule: "must name a file".to_owned(), suggestion: None });
    }
    if !reference.contains(['/', '\\', '.']) {
        return match Library::get(kind, reference) {
            Some(shipped) => Ok(Place::Library(format!("{}/{}", kind.directory(), shipped.file_name))),
            None => Err(Lost {
                rule: format!(
                    "no shipped file of that name in {} (a path holds a `/` or a `.`)",
                    kind.directory()
                ),
                suggestion: Library::closest(kind, reference),
            }),
        };
    }
    let beside = beside(reference, from);
    if *from != Place::Override
        && !reference.contains(['/', '\\'])
        && exists(&beside).is_err()
        && let Some(shipped) = Library::get(kind, reference)
    {
        return Ok(Place::Library(format!("{}/{}", kind.directory(), shipped.file_name)));
    }
    Ok(beside)
}

/// A path said at `from`.
fn beside(reference: &str, from: &Place) -> Place {
    match from {
        Place::Disk(path) => Place::Disk(path.parent().unwrap_or(Path::new("")).join(reference)),
        Place::Override => Place::Disk(PathBuf::from(reference)),
        Place::Library(path) if Path::new(reference).is_relative() => {
            let mut parts: Vec<String> = path.split('/').map(str::to_owned).collect();
            parts.pop();
            for component in Path::new(reference).components() {
                match component {
                    Component::ParentDir => drop(parts.pop()),
                    Component::Normal(part) => parts.push(part.to_string_lossy().into_owned()),
                    _ => {}
                }
            }
            Place::Library(parts.join("/"))
        }
        Place::Library(_) => Place::Disk(PathBuf::from(reference)),
    }
}

/// Whether there is something to read at all (what is wrong with it is told when it is read).
fn exists(place: &Place) -> Result<(), Lost> {
    let (found, shown) = match place {
        Place::Disk(path) => (path.exists(), path.display().to_string()),
        Place::Library(path) => (Library::at(path).is_some(), format!("library:{path}")),
        Place::Override => (true, String::new()),
    };
    if found { Ok(()) } else { Err(Lost { rule: format!("no such file: {shown}"), suggestion: None }) }
}

/// Reads a whole text file.
pub(crate) fn read_text(place: &Place, bytes_max: u64) -> Result<String, Box<Violation>> {
    let fail = |mistake, rule: String| Box::new(Violation::of_file(mistake, place.name(), rule));
    match place {
        Place::Library(path) => Library::at(path)
            .map(|shipped| shipped.text.to_owned())
            .ok_or_else(|| fail(Mistake::NotFound, "no such file in the library".to_owned())),
        Place::Override => Ok(String::new()),
        Place::Disk(path) => {
            let about = std::fs::metadata(path).map_err(|error| {
                let lost = error.kind() == std::io::ErrorKind::NotFound;
                let mistake = if lost { Mistake::NotFound } else { Mistake::Unreadable };
                fail(
                    mistake,
                    if lost { "no such file".to_owned() } else { format!("cannot be read: {error}") },
                )
            })?;
            if about.is_dir() {
                return Err(fail(Mistake::Unreadable, "is a directory, not a file".to_owned()));
            }
            if !about.is_file() {
                return Err(fail(Mistake::Unreadable, "is not a regular file".to_owned()));
            }
            if about.len() > bytes_max {
                let rule = format!("is too large: {} bytes, at most {bytes_max}", about.len());
                return Err(fail(Mistake::Unreadable, rule));
            }
            let bytes = std::fs::read(path)
                .map_err(|error| fail(Mistake::Unreadable, format!("cannot be read: {error}")))?;
            String::from_utf8(bytes).map_err(|error| {
                let before = error.utf8_error().valid_up_to();
                let bytes = error.into_bytes();
                let line = bytes.iter().take(before).filter(|byte| **byte == b'\n').count() as u32 + 1;
                let rule = "is not UTF-8 text";
                Box::new(Violation { line, ..Violation::of_file(Mistake::Unreadable, place.name(), rule) })
            })
        }
    }
}

/// Reads a file and everything that it extends.
fn read_tree(
    place: &Place,
    kind: Kind,
    sources: &mut Vec<Source>,
    chain: &mut Vec<(Place, String)>,
) -> Result<Node, Problems> {
    let text = read_text(place, FILE_BYTES_MAX).map_err(|violation| Problems::one(*violation))?;
    let index = sources.len();
    let mut node = tree::parse(&text, &place.name(), index)?;
    sources.push(Source { place: place.clone(), text });
    let Value::Table(table) = &mut node.value else { return Ok(node) };
    let Some(extends) = table.remove("extends") else { return Ok(node) };
    chain.push((identity(place), place.name()));
    let at = extends.node.origin;
    let fail = |mistake, rule: String, suggestion| {
        Problems::one(Violation {
            mistake,
            file: place.name(),
            line: at.line,
            column: at.column,
            key: "extends".to_owned(),
            value: extends.node.value.shown(),
            rule,
            suggestion,
        })
    };
    let Value::Text(reference) = &extends.node.value else {
        let rule = format!("must be a text naming a file, not {}", extends.node.value.type_name());
        return Err(fail(Mistake::WrongType, rule, None));
    };
    let parent = resolve(reference, place, kind)
        .and_then(|parent| exists(&parent).map(|()| parent))
        .map_err(|lost| fail(Mistake::NotFound, lost.rule, lost.suggestion))?;
    let known = identity(&parent);
    if let Some(first) = chain.iter().position(|(before, _)| *before == known) {
        let mut names: Vec<&str> = chain.iter().skip(first).map(|(_, name)| name.as_str()).collect();
        let back = names.first().copied().unwrap_or_default();
        names.push(back);
        let rule = format!("must not lead back to itself: {}", names.join(" → "));
        return Err(fail(Mistake::Extends, rule, None));
    }
    if chain.len() > EXTENDS_MAX {
        let rule = format!("must not be deeper than {EXTENDS_MAX} files");
        return Err(fail(Mistake::Extends, rule, None));
    }
    let mut base = read_tree(&parent, kind, sources, chain)?;
    chain.pop();
    tree::merge(&mut base, node);
    Ok(base)
}

/// The same file under another name is the same.
fn identity(place: &Place) -> Place {
    match place {
        Place::Disk(path) => Place::Disk(path.canonicalize().unwrap_or_else(|_| path.clone())),
        other => other.clone(),
    }
}

/// Lays overrides over the tree. Those without a list index merge like a file that extends it, so that a new
/// `type` replaces the whole table; those with one are put in their place afterwards.
fn apply_overrides(
    tree: &mut Node,
    overrides: &[String],
    sources: &mut Vec<Source>,
    problems: &mut Problems,
) {
    if overrides.is_empty() {
        return;
    }
    let origin = Origin { source: sources.len(), line: 0, column: 0 };
    sources.push(Source { place: Place::Override, text: overrides.join("\n") });
    let mut overlay = Node { value: Value::Table(Table::new()), origin };
    let mut indexed = Vec::new();
    for text in overrides {
        let mut fail = |key: &str, rule: String| {
            problems.push(wrong_override(key, rule));
        };
        let Some((path, value)) = text.split_once('=') else {
            fail(text, "must be of the form path=value".to_owned());
            continue;
        };
        let path = path.trim();
        let node = override_value(value.trim(), origin);
        if path.contains('[') {
            indexed.push((path.to_owned(), node));
        } else if let Err(rule) = tree::put(&mut overlay, path, node) {
            fail(path, rule);
        }
    }
    let at = tree.origin;
    tree::merge(tree, overlay);
    // A missing key of the root is missing in the file, not in the overrides.
    tree.origin = at;
    for (path, node) in indexed {
        if let Err(rule) = tree::put(tree, &path, node) {
            problems.push(wrong_override(&path, rule));
        }
    }
}

fn wrong_override(key: &str, rule: String) -> Violation {
    Violation { key: key.to_owned(), ..Violation::of_file(Mistake::Override, Place::Override.name(), rule) }
}

fn override_value(text: &str, origin: Origin) -> Node {
    let parsed = tree::parse(&format!("value = {text}\n"), "", origin.source).ok();
    let single = parsed.and_then(|mut root| match &mut root.value {
        Value::Table(table) if table.len() == 1 => table.remove("value"),
        _ => None,
    });
    let mut node = single.map_or(Node { value: Value::Text(text.to_owned()), origin }, |entry| entry.node);
    place_all(&mut node, origin);
    node
}

fn place_all(node: &mut Node, origin: Origin) {
    node.origin = origin;
    match &mut node.value {
        Value::Array(values) => values.iter_mut().for_each(|inner| place_all(inner, origin)),
        Value::Table(table) => table.values_mut().for_each(|Entry { key_origin, node }| {
            *key_origin = origin;
            place_all(node, origin);
        }),
        _ => {}
    }
}

/// The section's JSON schema as the loader checks it.
pub(crate) fn raw_schema<T: JsonSchema>() -> serde_json::Value {
    schemars::generate::SchemaSettings::draft2020_12().into_generator().into_root_schema_for::<T>().to_value()
}

/// The section's JSON schema for editors: with `extends`, and without the demand for keys that an extended
/// file may state (the loader demands them).
pub fn schema_json<T: Section>() -> serde_json::Value {
    let mut schema = raw_schema::<T>();
    relax(&mut schema);
    if let Some(properties) = schema.get_mut("properties").and_then(serde_json::Value::as_object_mut) {
        let about = "A file of the same kind whose keys this one takes over and overrides: a path relative to \
                     this file, or the bare name of a shipped file.";
        properties
            .insert("extends".to_owned(), serde_json::json!({ "type": "string", "description": about }));
    }
    schema
}

/// The editors' schemas of all sections, each with the kind of file that it is for.
pub fn all_schemas() -> Vec<(Kind, serde_json::Value)> {
    vec![
        (Kind::Scenario, schema_json::<crate::scenario::Scenario>()),
        (Kind::Car, schema_json::<crate::car::Car>()),
        (Kind::Suspension, schema_json::<crate::axle::Axle>()),
        (Kind::Rig, schema_json::<crate::rig::Rig>()),
        (Kind::Unit, schema_json::<crate::unit::SteeringUnit>()),
        (Kind::Can, schema_json::<crate::can::Can>()),
        (Kind::Campaign, schema_json::<crate::campaign::Campaign>()),
        (Kind::Study, schema_json::<crate::study::Study>()),
    ]
}

/// Drops `required` except for the words that tell the branches of a choice apart.
fn relax(schema: &mut serde_json::Value) {
    match schema {
        serde_json::Value::Object(object) => {
            let tags: Vec<String> = object
                .get("properties")
                .and_then(serde_json::Value::as_object)
                .map(|properties| {
                    let tags = properties.iter().filter(|(_, inner)| inner.get("const").is_some());
                    tags.map(|(name, _)| name.clone()).collect()
                })
                .unwrap_or_default();
            if object.contains_key("properties") && object.contains_key("required") {
                if tags.is_empty() {
                    object.remove("required");
                } else {
                    object.insert("required".to_owned(), tags.into());
                }
            }
            object.values_mut().for_each(relax);
        }
        serde_json::Value::Array(values) => values.iter_mut().for_each(relax),
        _ => {}
    }
}
