//! A TOML file as a tree in which each value knows the file, line and column that it was written at,
//! and the merging of such trees (`extends`, `--set`).

use crate::problem::{Mistake, Problems, Violation};
use std::collections::BTreeMap;
use std::path::PathBuf;
use toml::de::{DeTable, DeValue};

/// Deepest nesting of tables and lists.
const DEPTH_MAX: usize = 64;

/// Where a text comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// A file on disk.
    Disk(PathBuf),
    /// A shipped file, by its path in the library: `scenarios/weave_120.toml`.
    Library(String),
    /// `--set`.
    Override,
}

impl Place {
    /// As it is named in messages.
    pub fn name(&self) -> String {
        match self {
            Self::Disk(path) => path.display().to_string(),
            Self::Library(path) => format!("library:{path}"),
            Self::Override => "--set".to_owned(),
        }
    }
}

/// A text that was read while loading.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Source {
    /// Where it comes from.
    pub place: Place,
    /// Its whole text.
    pub text: String,
}

/// The place of a value: which source, and where in it (counted from 1; 0: nowhere in particular).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// Index into the loading's sources.
    pub source: usize,
    /// Line.
    pub line: u32,
    /// Column in characters.
    pub column: u32,
}

/// A value and its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Where the value was written.
    pub origin: Origin,
}

/// A table's entry.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Where the key was written.
    pub key_origin: Origin,
    /// The value.
    pub node: Node,
}

/// The entries of a table.
pub type Table = BTreeMap<String, Entry>;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Boolean(bool),
    /// A whole number.
    Integer(i128),
    /// A decimal number, perhaps not finite.
    Float(f64),
    /// A text.
    Text(String),
    /// A date or time (no section has one).
    Datetime(String),
    /// A list.
    Array(Vec<Node>),
    /// A table.
    Table(Table),
}

impl Value {
    /// What the value is, in words.
    pub(crate) fn type_name(&self) -> &'static str {
        match self {
            Self::Boolean(_) => "true or false",
            Self::Integer(_) => "a whole number",
            Self::Float(_) => "a decimal number",
            Self::Text(_) => "a text",
            Self::Datetime(_) => "a date or time",
            Self::Array(_) => "a list",
            Self::Table(_) => "a table",
        }
    }

    /// The value as written, shortened.
    pub(crate) fn shown(&self) -> String {
        match self {
            Self::Boolean(value) => value.to_string(),
            Self::Integer(value) => value.to_string(),
            Self::Float(value) => value.to_string(),
            Self::Text(value) => {
                let short: String = value.chars().take(80).collect();
                let tail = if short.len() < value.len() { "…" } else { "" };
                format!("\"{}{tail}\"", short.escape_debug())
            }
            Self::Datetime(value) => value.clone(),
            Self::Array(values) if values.len() <= 6 => {
                let shown: Vec<_> = values.iter().map(|node| node.value.shown()).collect();
                format!("[{}]", shown.join(", "))
            }
            Self::Array(values) => format!("[{} values]", values.len()),
            Self::Table(_) => "{…}".to_owned(),
        }
    }
}

impl Node {
    /// The value at a dotted key path with list entries as `[i]`.
    pub fn at(&self, path: &str) -> Option<&Self> {
        split_path(path).into_iter().try_fold(self, |node, step| match (&node.value, step) {
            (Value::Table(table), Step::Key(key)) => table.get(key).map(|entry| &entry.node),
            (Value::Array(values), Step::Index(i)) => values.get(i),
            _ => None,
        })
    }

    /// The place of the value at a path or, if it is absent, of the closest table or list around it.
    pub fn origin_near(&self, path: &str) -> Origin {
        let mut node = self;
        for step in split_path(path) {
            node = match (&node.value, step) {
                (Value::Table(table), Step::Key(key)) => match table.get(key) {
                    Some(entry) => &entry.node,
                    None => break,
                },
                (Value::Array(values), Step::Index(i)) => match values.get(i) {
                    Some(inner) => inner,
                    None => break,
                },
                _ => break,
            };
        }
        node.origin
    }

    /// As JSON; a number that is not finite becomes null.
    pub fn to_json(&self) -> serde_json::Value {
        use serde_json::{Number, Value as Json};
        match &self.value {
            Value::Boolean(value) => Json::Bool(*value),
            Value::Integer(value) => i64::try_from(*value)
                .map(Number::from)
                .or_else(|_| u64::try_from(*value).map(Number::from))
                .map_or_else(|_| float(*value as f64), Json::Number),
            Value::Float(value) => float(*value),
            Value::Text(value) | Value::Datetime(value) => Json::String(value.clone()),
            Value::Array(values) => Json::Array(values.iter().map(Self::to_json).collect()),
            Value::Table(table) => {
                Json::Object(table.iter().map(|(k, entry)| (k.clone(), entry.node.to_json())).collect())
            }
        }
    }
}

fn float(value: f64) -> serde_json::Value {
    serde_json::Number::from_f64(value).map_or(serde_json::Value::Null, serde_json::Value::Number)
}

/// One step of a key path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step<'a> {
    /// Into a table.
    Key(&'a str),
    /// Into a list.
    Index(usize),
}

/// Splits `a.b[2].c`. What does not parse as an index stays part of the key.
pub(crate) fn split_path(path: &str) -> Vec<Step<'_>> {
    let mut steps = Vec::new();
    for part in path.split('.').filter(|part| !part.is_empty()) {
        let (key, mut rest) = part.split_at(part.find('[').unwrap_or(part.len()));
        if !key.is_empty() {
            steps.push(Step::Key(key));
        }
        while let Some((index, tail)) = rest.strip_prefix('[').and_then(|inner| inner.split_once(']')) {
            let Ok(index) = index.parse() else { break };
            steps.push(Step::Index(index));
            rest = tail;
        }
    }
    steps
}

/// Byte offsets to line and column.
struct Lines<'a> {
    text: &'a str,
    starts: Vec<usize>,
    source: usize,
}

impl<'a> Lines<'a> {
    fn new(text: &'a str, source: usize) -> Self {
        let starts = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect();
        Self { text, starts, source }
    }

    fn origin(&self, offset: usize) -> Origin {
        let line = self.starts.partition_point(|start| *start <= offset).max(1);
        let start = self.starts.get(line - 1).copied().unwrap_or(0);
        let before = self.text.get(start..offset.min(self.text.len())).unwrap_or("");
        Origin { source: self.source, line: line as u32, column: before.chars().count() as u32 + 1 }
    }
}

/// Parses TOML; all syntax errors at once.
pub(crate) fn parse(text: &str, name: &str, source: usize) -> Result<Node, Problems> {
    let lines = Lines::new(text, source);
    let mut problems = Problems::default();
    let (root, errors) = DeTable::parse_recoverable(text);
    for error in &errors {
        let at = lines.origin(error.span().map_or(0, |span| span.start));
        let rule = format!("not TOML: {}", error.message().lines().collect::<Vec<_>>().join("; "));
        problems.push(syntax(name, at, rule));
    }
    if !problems.is_empty() {
        return Err(problems);
    }
    let origin = Origin { source, line: 1, column: 1 };
    match table(root.get_ref(), &lines, 0) {
        Ok(table) => Ok(Node { value: Value::Table(table), origin }),
        Err(at) => Err(Problems::one(syntax(name, at, format!("nested deeper than {DEPTH_MAX} levels")))),
    }
}

fn syntax(file: &str, at: Origin, rule: String) -> Violation {
    Violation {
        mistake: Mistake::Syntax,
        file: file.to_owned(),
        line: at.line,
        column: at.column,
        key: String::new(),
        value: String::new(),
        rule,
        suggestion: None,
    }
}

/// `Err` is the place of what is nested too deep.
fn table(table: &DeTable<'_>, lines: &Lines<'_>, depth: usize) -> Result<Table, Origin> {
    table
        .iter()
        .map(|(key, value)| {
            let key_origin = lines.origin(key.span().start);
            let node = node(value, lines, depth + 1)?;
            Ok((key.get_ref().to_string(), Entry { key_origin, node }))
        })
        .collect()
}

fn node(value: &toml::Spanned<DeValue<'_>>, lines: &Lines<'_>, depth: usize) -> Result<Node, Origin> {
    let origin = lines.origin(value.span().start);
    if depth > DEPTH_MAX {
        return Err(origin);
    }
    let value = match value.get_ref() {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(integer) => match i128::from_str_radix(integer.as_str(), integer.radix()) {
            Ok(integer) => Value::Integer(integer),
            Err(_) => Value::Float(integer.as_str().parse().unwrap_or(f64::INFINITY)),
        },
        DeValue::Float(float) => Value::Float(float.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(boolean) => Value::Boolean(*boolean),
        DeValue::Datetime(datetime) => Value::Datetime(datetime.to_string()),
        DeValue::Array(values) => {
            Value::Array(values.iter().map(|inner| node(inner, lines, depth + 1)).collect::<Result<_, _>>()?)
        }
        DeValue::Table(inner) => Value::Table(table(inner, lines, depth)?),
    };
    Ok(Node { value, origin })
}

/// Lays `child` over `parent`: tables merge key by key, everything else of the child replaces. A table whose
/// `type` differs from the parent's replaces it whole, since the keys of another type do not fit.
pub(crate) fn merge(parent: &mut Node, child: Node) {
    match (&mut parent.value, child.value) {
        (Value::Table(below), Value::Table(above)) if same_type(below, &above) => {
            parent.origin = child.origin;
            for (key, entry) in above {
                match below.get_mut(&key) {
                    Some(old) => {
                        old.key_origin = entry.key_origin;
                        merge(&mut old.node, entry.node);
                    }
                    None => {
                        below.insert(key, entry);
                    }
                }
            }
        }
        (_, value) => *parent = Node { value, origin: child.origin },
    }
}

fn same_type(below: &Table, above: &Table) -> bool {
    match (below.get("type"), above.get("type")) {
        (Some(below), Some(above)) => below.node.value == above.node.value,
        _ => true,
    }
}

/// Puts `node` where `path` tells, making tables on the way. `Err` tells what is in the way.
pub(crate) fn put(root: &mut Node, path: &str, node: Node) -> Result<(), String> {
    let steps = split_path(path);
    if steps.is_empty() || steps.len() > DEPTH_MAX {
        return Err("must be a dotted key path".to_owned());
    }
    let origin = node.origin;
    let mut at = root;
    for step in steps {
        at = match (&mut at.value, step) {
            (Value::Table(table), Step::Key(key)) => {
                let empty = Node { value: Value::Table(Table::new()), origin };
                &mut table.entry(key.to_owned()).or_insert(Entry { key_origin: origin, node: empty }).node
            }
            (Value::Array(values), Step::Index(i)) => {
                let length = values.len();
                values.get_mut(i).ok_or_else(|| format!("the list has {length} entries, counted from 0"))?
            }
            (value, Step::Key(key)) => {
                return Err(format!("`{key}` cannot be inside {}", value.type_name()));
            }
            (value, Step::Index(i)) => {
                return Err(format!("`[{i}]` cannot be inside {}", value.type_name()));
            }
        };
    }
    *at = node;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tree(text: &str) -> Node {
        parse(text, "t", 0).unwrap()
    }

    #[test]
    fn values_know_line_and_column() {
        let root = tree("a = 1\n[b]\n  c = [1, 2.5]\nd.e = \"ä\" # x\n");
        let at = |path: &str| {
            let origin = root.at(path).unwrap().origin;
            (origin.line, origin.column)
        };
        assert_eq!(at("a"), (1, 5));
        assert_eq!(at("b.c[1]"), (3, 11));
        assert_eq!(at("b.d.e"), (4, 7));
        assert_eq!(root.origin_near("b.missing.x").line, 2);
    }

    #[test]
    fn all_syntax_errors_are_reported_with_their_lines() {
        let problems = parse("a = \nb = 1\nc = [1, \n", "t", 0).unwrap_err();
        let lines: Vec<_> = problems.violations.iter().map(|v| v.line).collect();
        assert!(lines.contains(&1) && lines.len() >= 2, "{problems}");
    }

    #[test]
    fn child_wins_arrays_replace_and_another_type_replaces_the_table() {
        let mut parent = tree("x = 1\nlist = [1, 2]\n[s]\ntype = \"sine\"\nf = 2\n[t]\na = 1\nb = 2\n");
        merge(&mut parent, tree("list = [3]\n[s]\ntype = \"step\"\n[t]\nb = 5\n"));
        assert_eq!(parent.at("x").unwrap().value, Value::Integer(1));
        assert_eq!(parent.at("list").unwrap().value.shown(), "[3]");
        assert!(parent.at("s.f").is_none());
        assert_eq!(parent.at("t.a").unwrap().value, Value::Integer(1));
        assert_eq!(parent.at("t.b").unwrap().value, Value::Integer(5));
    }

    #[test]
    fn put_makes_tables_and_names_what_is_in_the_way() {
        let mut root = tree("a = [1, 2]\n");
        let one = || Node { value: Value::Integer(9), origin: Origin { source: 0, line: 0, column: 0 } };
        put(&mut root, "a[1]", one()).unwrap();
        put(&mut root, "b.c", one()).unwrap();
        assert_eq!(root.at("a[1]").unwrap().value, Value::Integer(9));
        assert_eq!(root.at("b.c").unwrap().value, Value::Integer(9));
        assert!(put(&mut root, "a[7]", one()).unwrap_err().contains("2 entries"));
        assert!(put(&mut root, "a.x", one()).unwrap_err().contains("inside a list"));
        assert!(put(&mut root, "", one()).is_err());
    }
}
