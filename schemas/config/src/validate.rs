//! Checks a tree against a section's JSON schema and reports every violation at once.
//!
//! Covers what schemars generates for the sections (a test walks all of their schemas for keywords that are
//! not covered here): types, ranges, lengths, required and unknown keys, words, tagged and untagged choices.

use crate::problem::{Mistake, Problems, Violation};
use crate::tree::{Node, Origin, Source, Table, Value};
use crate::unit_name;
use serde_json::{Map, Value as Json};

/// Deepest chain of schemas; no section comes near it.
const DEPTH_MAX: usize = 200;

/// Notes every violation of `schema` in `tree`.
pub(crate) fn validate(schema: &Json, tree: &Node, sources: &[Source], problems: &mut Problems) {
    let mut walker = Walker { root: schema, sources, path: Vec::new(), problems, depth: 0 };
    walker.value(schema, tree);
}

struct Walker<'a> {
    root: &'a Json,
    sources: &'a [Source],
    path: Vec<String>,
    problems: &'a mut Problems,
    depth: usize,
}

impl<'a> Walker<'a> {
    fn value(&mut self, schema: &'a Json, node: &Node) {
        let Some(schema) = schema.as_object() else { return };
        if self.depth >= DEPTH_MAX {
            return;
        }
        self.depth += 1;
        if let Some(target) = schema.get("$ref").and_then(|reference| self.resolve(reference)) {
            self.value(target, node);
        }
        for part in list(schema, "allOf") {
            self.value(part, node);
        }
        for keyword in ["oneOf", "anyOf"] {
            let branches = list(schema, keyword);
            if !branches.is_empty() {
                self.choice(branches, node);
            }
        }
        let words: Vec<_> = match (schema.get("const"), schema.get("enum")) {
            (Some(word), _) => vec![word],
            (None, Some(words)) => words.as_array().into_iter().flatten().collect(),
            (None, None) => Vec::new(),
        };
        if words.is_empty() {
            if self.of_type(schema, node) {
                self.content(schema, node);
            }
        } else {
            self.word(&words, node);
        }
        self.depth -= 1;
    }

    fn resolve(&self, reference: &Json) -> Option<&'a Json> {
        self.root.pointer(reference.as_str()?.strip_prefix('#')?)
    }

    /// Follows `$ref` to the schema that says something itself.
    fn plain(&self, mut schema: &'a Json) -> &'a Json {
        for _ in 0..8 {
            match schema.get("$ref").and_then(|reference| self.resolve(reference)) {
                Some(target) => schema = target,
                None => break,
            }
        }
        schema
    }

    fn of_type(&mut self, schema: &Map<String, Json>, node: &Node) -> bool {
        let types: Vec<&str> = match schema.get("type") {
            Some(Json::String(one)) => vec![one],
            Some(Json::Array(several)) => several.iter().filter_map(Json::as_str).collect(),
            _ => return true,
        };
        if types.iter().any(|wanted| fits(wanted, &node.value)) {
            return true;
        }
        let wanted: Vec<_> = types.iter().filter(|wanted| **wanted != "null").map(|t| in_words(t)).collect();
        let mut rule = format!("must be {}, not {}", wanted.join(" or "), node.value.type_name());
        if let (Some(unit), Value::Text(_)) = (self.unit(schema), &node.value)
            && types.iter().any(|t| *t == "number" || *t == "integer")
        {
            rule = format!("{rule}; the key tells the unit ({unit})");
        }
        self.note(Mistake::WrongType, node, rule, None);
        false
    }

    fn content(&mut self, schema: &'a Map<String, Json>, node: &Node) {
        match &node.value {
            Value::Integer(value) => self.range(schema, *value as f64, node),
            Value::Float(value) if value.is_finite() => self.range(schema, *value, node),
            Value::Float(_) => {
                let rule = self.range_rule(schema).unwrap_or_default();
                let rule =
                    format!("must be a finite number{}{rule}", if rule.is_empty() { "" } else { ": " });
                self.note(Mistake::NotFinite, node, rule, None);
            }
            Value::Text(text) => {
                let length = text.chars().count();
                self.length(schema, ["minLength", "maxLength"], length, "characters", node);
            }
            Value::Array(values) => {
                self.length(schema, ["minItems", "maxItems"], values.len(), "entries", node);
                let first = list(schema, "prefixItems");
                for (i, inner) in values.iter().enumerate() {
                    if let Some(item) = first.get(i).or_else(|| schema.get("items")) {
                        self.inside(format!("[{i}]"), |walker| walker.value(item, inner));
                    }
                    if schema.get("uniqueItems") == Some(&Json::Bool(true))
                        && values.iter().take(i).any(|before| before.value == inner.value)
                    {
                        self.inside(format!("[{i}]"), |walker| {
                            walker.note(Mistake::Rule, inner, "must not be listed twice".to_owned(), None);
                        });
                    }
                }
            }
            Value::Table(table) => self.table(schema, table, node),
            Value::Boolean(_) | Value::Datetime(_) => {}
        }
    }

    fn range(&mut self, schema: &Map<String, Json>, value: f64, node: &Node) {
        let bound = |keyword| schema.get(keyword).and_then(Json::as_f64);
        let inside = bound("minimum").is_none_or(|bound| value >= bound)
            && bound("maximum").is_none_or(|bound| value <= bound)
            && bound("exclusiveMinimum").is_none_or(|bound| value > bound)
            && bound("exclusiveMaximum").is_none_or(|bound| value < bound);
        if !inside && let Some(rule) = self.range_rule(schema) {
            self.note(Mistake::OutOfRange, node, format!("must be {rule}"), None);
        }
        if let Some(step) = bound("multipleOf")
            && (value / step).fract() != 0.0
        {
            self.note(Mistake::OutOfRange, node, format!("must be a multiple of {step}"), None);
        }
    }

    /// `in (0, 50] kg`.
    fn range_rule(&self, schema: &Map<String, Json>) -> Option<String> {
        let bound = |keyword: &str| schema.get(keyword).and_then(Json::as_f64);
        let low = match (bound("minimum"), bound("exclusiveMinimum")) {
            (Some(closed), open) if open.is_none_or(|open| closed > open) => Some(("[", closed)),
            (_, open) => open.map(|open| ("(", open)),
        };
        let high = match (bound("maximum"), bound("exclusiveMaximum")) {
            (Some(closed), open) if open.is_none_or(|open| closed < open) => Some(("]", closed)),
            (_, open) => open.map(|open| (")", open)),
        };
        let unit = self.unit(schema).map(|unit| format!(" {unit}")).unwrap_or_default();
        match (low, high) {
            (Some((open, low)), Some((close, high))) => {
                Some(format!("in {open}{}, {}{close}{unit}", number(low), number(high)))
            }
            (Some(("[", low)), None) => Some(format!("at least {}{unit}", number(low))),
            (Some((_, low)), None) => Some(format!("greater than {}{unit}", number(low))),
            (None, Some(("]", high))) => Some(format!("at most {}{unit}", number(high))),
            (None, Some((_, high))) => Some(format!("less than {}{unit}", number(high))),
            (None, None) => None,
        }
    }

    /// The unit that the description states as `[kg]`, or else the one at the end of the closest key.
    fn unit(&self, schema: &Map<String, Json>) -> Option<String> {
        let stated = schema.get("description").and_then(Json::as_str).and_then(|description| {
            let (unit, _) = description.split_once(". [")?.1.split_once(']')?;
            let plausible = !unit.contains(',') && unit.len() <= 16;
            plausible.then(|| if unit == "-" { String::new() } else { unit.to_owned() })
        });
        let named = || {
            let key = self.path.iter().rev().find(|part| !part.starts_with('['))?;
            unit_name::unit_of_key(key).map(str::to_owned)
        };
        stated.or_else(named).filter(|unit| !unit.is_empty())
    }

    fn length(
        &mut self,
        schema: &Map<String, Json>,
        keywords: [&str; 2],
        length: usize,
        of: &str,
        node: &Node,
    ) {
        let bound = |keyword| schema.get(keyword).and_then(Json::as_u64);
        let [low, high] = keywords.map(bound);
        let length = length as u64;
        if low.is_some_and(|low| length < low) || high.is_some_and(|high| length > high) {
            let wanted = match (low, high) {
                (Some(low), Some(high)) if low == high => format!("{low}"),
                (Some(low), Some(high)) => format!("{low} to {high}"),
                (Some(low), None) => format!("at least {low}"),
                (None, high) => format!("at most {}", high.unwrap_or(0)),
            };
            self.note(Mistake::WrongLength, node, format!("must have {wanted} {of}, has {length}"), None);
        }
    }

    fn word(&mut self, words: &[&Json], node: &Node) {
        if words.iter().any(|word| same(word, &node.value)) {
            return;
        }
        let names: Vec<_> = words.iter().filter_map(|word| word.as_str()).collect();
        let meant = match &node.value {
            Value::Text(text) => closest(text, names.iter().copied()),
            _ => None,
        };
        let shown: Vec<_> = words.iter().map(|word| word.to_string()).collect();
        self.note(Mistake::NotAChoice, node, format!("must be one of {}", shown.join(", ")), meant);
    }

    fn choice(&mut self, branches: &'a [Json], node: &Node) {
        let branches: Vec<&'a Json> = branches
            .iter()
            .map(|branch| self.plain(branch))
            .filter(|branch| branch.get("type").and_then(Json::as_str) != Some("null"))
            .collect();
        if let [only] = branches.as_slice() {
            return self.value(only, node);
        }
        let words: Option<Vec<&Json>> = branches.iter().map(|branch| branch.get("const")).collect();
        if let Some(words) = words {
            return self.word(&words, node);
        }
        if let Some(tag) = tag_of(&branches) {
            return self.tagged(tag, &branches, node);
        }
        self.untagged(&branches, node);
    }

    fn tagged(&mut self, tag: &str, branches: &[&'a Json], node: &Node) {
        let Value::Table(table) = &node.value else {
            let rule = format!("must be a table, not {}", node.value.type_name());
            return self.note(Mistake::WrongType, node, rule, None);
        };
        let words: Vec<&Json> = branches.iter().filter_map(|branch| tag_word(branch, tag)).collect();
        let Some(entry) = table.get(tag) else {
            let shown: Vec<_> = words.iter().map(|word| word.to_string()).collect();
            let rule = format!("missing; one of {}", shown.join(", "));
            return self.inside(tag.to_owned(), |walker| {
                walker.note_at(Mistake::MissingKey, node.origin, "", rule, None);
            });
        };
        match branches.iter().find(|b| tag_word(b, tag).is_some_and(|word| same(word, &entry.node.value))) {
            Some(branch) => self.value(branch, node),
            None => self.inside(tag.to_owned(), |walker| walker.word(&words, &entry.node)),
        }
    }

    /// Reports against the branch that comes closest.
    fn untagged(&mut self, branches: &[&'a Json], node: &Node) {
        let mut best: Option<Problems> = None;
        for branch in branches {
            let mut found = Problems::default();
            let mut walker = Walker {
                root: self.root,
                sources: self.sources,
                path: self.path.clone(),
                problems: &mut found,
                depth: self.depth,
            };
            walker.value(branch, node);
            if found.is_empty() {
                return;
            }
            // A branch of another type altogether says less than one whose content is wrong.
            let here = self.path();
            let rank = |p: &Problems| {
                let elsewhere = p.violations.iter().any(|v| v.mistake == Mistake::WrongType && v.key == here);
                (elsewhere, p.violations.len())
            };
            if best.as_ref().is_none_or(|best| rank(&found) < rank(best)) {
                best = Some(found);
            }
        }
        self.problems.extend(best.unwrap_or_default());
    }

    fn table(&mut self, schema: &'a Map<String, Json>, table: &Table, node: &Node) {
        let empty = Map::new();
        let properties = schema.get("properties").and_then(Json::as_object);
        let known = properties.unwrap_or(&empty);
        let mut meant_keys = Vec::new();
        for (key, entry) in table {
            if let Some(inner) = properties.and_then(|properties| properties.get(key)) {
                self.inside(key.clone(), |walker| walker.value(inner, &entry.node));
                continue;
            }
            match schema.get("additionalProperties") {
                Some(Json::Bool(false)) => {
                    // A key that the same file gives already was not meant; an inherited one may have been.
                    let source = entry.key_origin.source;
                    let free = known.keys().filter(|name| {
                        table.get(*name).is_none_or(|given| given.key_origin.source != source)
                    });
                    let (rule, meant) = unknown_key(key, free.map(String::as_str));
                    meant_keys.extend(meant.clone());
                    self.inside(key.clone(), |walker| {
                        let shown = entry.node.value.shown();
                        walker.note_at(Mistake::UnknownKey, entry.key_origin, &shown, rule, meant);
                    });
                }
                Some(inner @ Json::Object(_)) => {
                    self.inside(key.clone(), |walker| walker.value(inner, &entry.node));
                }
                _ => {}
            }
        }
        for key in list(schema, "required").iter().filter_map(Json::as_str) {
            // A misspelt key is one mistake, not two.
            if table.contains_key(key) || meant_keys.iter().any(|meant| meant == key) {
                continue;
            }
            let what =
                properties.and_then(|properties| properties.get(key)).map(|inner| self.describe(inner));
            let rule = format!("missing{}", what.map(|what| format!(": {what}")).unwrap_or_default());
            self.inside(key.to_owned(), |walker| {
                walker.note_at(Mistake::MissingKey, node.origin, "", rule, None);
            });
        }
    }

    /// First paragraph of the description.
    fn describe(&self, schema: &'a Json) -> String {
        let own = schema.get("description").or_else(|| self.plain(schema).get("description"));
        let text = own.and_then(Json::as_str).unwrap_or("a value is needed");
        text.split("\n\n").next().unwrap_or("").replace('\n', " ").trim_end_matches('.').to_owned()
    }

    fn inside(&mut self, part: String, walk: impl FnOnce(&mut Self)) {
        self.path.push(part);
        walk(self);
        self.path.pop();
    }

    fn path(&self) -> String {
        self.path.iter().fold(String::new(), |path, part| {
            if path.is_empty() || part.starts_with('[') { path + part } else { path + "." + part }
        })
    }

    fn note(&mut self, mistake: Mistake, node: &Node, rule: String, suggestion: Option<String>) {
        let shown = node.value.shown();
        self.note_at(mistake, node.origin, &shown, rule, suggestion);
    }

    fn note_at(
        &mut self,
        mistake: Mistake,
        at: Origin,
        value: &str,
        rule: String,
        suggestion: Option<String>,
    ) {
        let file = self.sources.get(at.source).map(|source| source.place.name()).unwrap_or_default();
        self.problems.push(Violation {
            mistake,
            file,
            line: at.line,
            column: at.column,
            key: self.path(),
            value: value.to_owned(),
            rule,
            suggestion,
        });
    }
}

fn list<'a>(schema: &'a Map<String, Json>, keyword: &str) -> &'a [Json] {
    schema.get(keyword).and_then(Json::as_array).map_or(&[], Vec::as_slice)
}

fn fits(wanted: &str, value: &Value) -> bool {
    matches!(
        (wanted, value),
        ("boolean", Value::Boolean(_))
            | ("integer", Value::Integer(_))
            | ("number", Value::Integer(_) | Value::Float(_))
            | ("string", Value::Text(_))
            | ("array", Value::Array(_))
            | ("object", Value::Table(_))
    )
}

fn in_words(wanted: &str) -> &'static str {
    match wanted {
        "boolean" => "true or false",
        "integer" => "a whole number",
        "number" => "a number",
        "string" => "a text",
        "array" => "a list",
        "object" => "a table",
        _ => "something else",
    }
}

fn same(word: &Json, value: &Value) -> bool {
    match (word, value) {
        (Json::String(word), Value::Text(text)) => word == text,
        (Json::Bool(word), Value::Boolean(value)) => word == value,
        (Json::Number(word), Value::Integer(value)) => word.as_f64() == Some(*value as f64),
        (Json::Number(word), Value::Float(value)) => word.as_f64() == Some(*value),
        _ => false,
    }
}

/// The key whose value tells the branches apart.
fn tag_of<'a>(branches: &[&'a Json]) -> Option<&'a str> {
    let first = branches.first()?.get("properties")?.as_object()?;
    first.keys().map(String::as_str).find(|key| branches.iter().all(|b| tag_word(b, key).is_some()))
}

fn tag_word<'a>(branch: &'a Json, tag: &str) -> Option<&'a Json> {
    branch.get("properties")?.get(tag)?.get("const")
}

/// What to say of a key that the table does not have, and which free one was probably meant.
fn unknown_key<'a>(key: &str, free: impl Iterator<Item = &'a str>) -> (String, Option<String>) {
    let free: Vec<&str> = free.collect();
    let stem = unit_name::split(key).map_or(key, |(stem, _)| stem);
    let given = unit_name::unit_of_key(key);
    let other_unit = free.iter().find_map(|name| {
        let (other_stem, unit) = unit_name::split(name)?;
        (other_stem == stem && given != Some(unit)).then_some((*name, unit))
    });
    if let Some((name, unit)) = other_unit {
        let rule = match given {
            Some(given) => format!("unknown key: the value is wanted in {unit}, not in {given}"),
            None => format!("unknown key: the name ends with the unit, {unit}"),
        };
        return (rule, Some(name.to_owned()));
    }
    ("unknown key".to_owned(), closest(key, free.into_iter()))
}

/// The name closest to `written`, if it is close at all.
pub(crate) fn closest<'a>(written: &str, names: impl Iterator<Item = &'a str>) -> Option<String> {
    if written.chars().count() > 80 {
        return None;
    }
    let lower = written.to_lowercase();
    names
        .map(|name| (strsim::damerau_levenshtein(&lower, &name.to_lowercase()), name))
        .filter(|(distance, name)| *distance <= (name.chars().count() / 3).max(1))
        .min()
        .map(|(_, name)| name.to_owned())
}

/// Bounds such as 1e8 and 9007199254740992 as one would write them.
fn number(value: f64) -> String {
    if value != 0.0 && (value.abs() >= 1e7 || value.abs() < 1e-4) {
        format!("{value:e}")
    } else {
        format!("{value}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load::raw_schema;

    /// Keywords that the walker acts on.
    const CHECKED: &str = "$ref allOf anyOf oneOf const enum type minimum maximum exclusiveMinimum \
        exclusiveMaximum multipleOf minLength maxLength minItems maxItems items prefixItems uniqueItems \
        properties required additionalProperties";
    /// Keywords that say nothing about validity.
    const SILENT: &str = "$schema $defs title description format default examples deprecated";

    fn keywords_in(schema: &Json, what: &str) {
        let Some(schema) = schema.as_object() else { return };
        for (keyword, inner) in schema {
            let known = CHECKED.split(' ').chain(SILENT.split(' ')).any(|known| known == keyword);
            assert!(known, "{what}: `{keyword}: {inner}` is not checked by the walker");
            match (keyword.as_str(), inner) {
                ("properties" | "$defs", Json::Object(named)) => {
                    named.iter().for_each(|(name, inner)| keywords_in(inner, &format!("{what}.{name}")));
                }
                (_, Json::Array(several)) => several.iter().for_each(|inner| keywords_in(inner, what)),
                _ => keywords_in(inner, what),
            }
        }
    }

    #[test]
    fn no_section_uses_a_schema_keyword_that_the_walker_ignores() {
        keywords_in(&raw_schema::<crate::scenario::Scenario>(), "scenario");
        keywords_in(&raw_schema::<crate::car::Car>(), "car");
        keywords_in(&raw_schema::<crate::axle::Axle>(), "axle");
        keywords_in(&raw_schema::<crate::rig::Rig>(), "rig");
        keywords_in(&raw_schema::<crate::unit::SteeringUnit>(), "unit");
    }

    #[test]
    fn a_key_with_another_unit_is_told_so() {
        let known = ["mass_kg", "speed_m_s", "name"];
        let told = |key| unknown_key(key, known.into_iter());
        assert_eq!(
            told("mass_g"),
            ("unknown key: the value is wanted in kg, not in g".to_owned(), Some("mass_kg".to_owned()))
        );
        assert_eq!(told("speed_kmh").1.as_deref(), Some("speed_m_s"));
        assert!(told("mass").0.contains("ends with the unit, kg"));
        assert_eq!(told("nane"), ("unknown key".to_owned(), Some("name".to_owned())));
        assert_eq!(told("colour").1, None);
    }
}
