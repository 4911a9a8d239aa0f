//! TOML text as a tree that knows its lines and keeps the order of the file (the order of states, ports and
//! parts is the order of the matrices).

use std::rc::Rc;

use toml::de::{DeTable, DeValue};

use crate::error::{ModelError, Place, Rule};

/// A value and where it stands.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub place: Place,
    pub value: Item,
}

/// TOML values as far as models use them.
#[derive(Debug, Clone)]
pub(crate) enum Item {
    Text(String),
    Number(f64),
    Truth(bool),
    List(Vec<Node>),
    Table(Vec<(String, Node)>),
}

impl Item {
    pub fn kind(&self) -> &'static str {
        match self {
            Item::Text(_) => "text",
            Item::Number(_) => "a number",
            Item::Truth(_) => "true or false",
            Item::List(_) => "a list",
            Item::Table(_) => "a table",
        }
    }
}

/// Reads a document; all syntax errors at once.
pub(crate) fn read(text: &str, file: &Rc<str>) -> Result<Node, Vec<ModelError>> {
    let starts: Vec<usize> = std::iter::once(0)
        .chain(text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i + 1))
        .collect();
    let line = |at: usize| starts.partition_point(|s| *s <= at);
    let (table, errors) = DeTable::parse_recoverable(text);
    if !errors.is_empty() {
        return Err(errors
            .iter()
            .map(|e| {
                let at = e.span().map_or(0, |s| line(s.start));
                Place { file: file.clone(), line: at }.error(
                    Rule::Format,
                    "",
                    format!("not TOML: {}", e.message()),
                )
            })
            .collect());
    }
    Ok(Node { place: Place { file: file.clone(), line: 1 }, value: table_item(table.get_ref(), file, &line) })
}

fn table_item(table: &DeTable<'_>, file: &Rc<str>, line: &dyn Fn(usize) -> usize) -> Item {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, value)| key.span().start.min(value.span().start));
    Item::Table(
        entries
            .into_iter()
            .map(|(key, value)| {
                let place = Place { file: file.clone(), line: line(key.span().start) };
                (key.get_ref().to_string(), node(value.get_ref(), place, file, line))
            })
            .collect(),
    )
}

fn node(value: &DeValue<'_>, place: Place, file: &Rc<str>, line: &dyn Fn(usize) -> usize) -> Node {
    let item = match value {
        DeValue::String(s) => Item::Text(s.to_string()),
        DeValue::Integer(i) => {
            Item::Number(i64::from_str_radix(i.as_str(), i.radix()).map_or(f64::NAN, |v| v as f64))
        }
        DeValue::Float(f) => Item::Number(f.as_str().parse().unwrap_or(f64::NAN)),
        DeValue::Boolean(b) => Item::Truth(*b),
        DeValue::Datetime(d) => Item::Text(d.to_string()),
        DeValue::Array(list) => Item::List(
            list.iter()
                .map(|v| {
                    let place = Place { file: file.clone(), line: line(v.span().start) };
                    node(v.get_ref(), place, file, line)
                })
                .collect(),
        ),
        DeValue::Table(t) => table_item(t, file, line),
    };
    Node { place, value: item }
}

/// Text with its place.
#[derive(Debug, Clone, Default)]
pub(crate) struct Text {
    pub text: String,
    pub place: Place,
}

impl Node {
    /// The expression written here: text, a number, or (nested) lists of them as a vector or matrix.
    pub fn expression(&self) -> Option<String> {
        match &self.value {
            Item::Text(t) => Some(t.clone()),
            Item::Number(n) => Some(format!("{n:?}").replace("e-", "e-")),
            Item::List(items) => {
                let parts: Option<Vec<String>> = items.iter().map(Node::expression).collect();
                parts.map(|p| format!("[{}]", p.join(", ")))
            }
            _ => None,
        }
    }

    /// Text exactly.
    pub fn text(&self) -> Option<Text> {
        match &self.value {
            Item::Text(t) => Some(Text { text: t.clone(), place: self.place.clone() }),
            _ => None,
        }
    }
}
