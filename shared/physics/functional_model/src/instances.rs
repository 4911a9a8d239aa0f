//! The tree of parts: models used by name are found, parameters get their numbers, and names find their meaning
//! (parameters, inputs fed by the host, mechanism results, variables of parts, seen from the frame of the reader).

use std::cell::Cell;
use std::rc::Rc;

use crate::Resolver;
use crate::calculus::{Leaves, evaluate};
use crate::document::{Raw, RawPart};
use crate::error::{ModelError, Place, Rule};
use crate::expand::{Scope, Shape, Trouble, Value, expand};
use crate::flat::{Flat, Kind, Parameter, component};
use crate::node::Text;
use crate::pool::{Id, Pool};
use crate::syntax;
use crate::tables::Table;
use crate::units::Unit;

/// Deepest nesting of models.
const DEPTH_MAX: usize = 24;

/// Where `use = "..."` looks.
pub(crate) struct Environment {
    raw: Rc<Raw>,
    parent: Option<Rc<Environment>>,
}

/// One part (or the whole model, index 0).
pub(crate) struct Instance {
    pub name: String,
    pub path: String,
    pub parent: Option<usize>,
    pub raw: Rc<Raw>,
    pub part: Option<RawPart>,
    pub dim: usize,
    /// Written in place: sees its host's parameters.
    pub inline: bool,
    pub parameters: Vec<(String, Value)>,
    /// Own variables of a block, inputs of the whole model, results of mechanisms: name, scalars, unit, turned by
    /// frames.
    pub names: Vec<(String, Vec<u32>, Unit, bool)>,
    /// Index into `Flat::blocks`.
    pub block: Option<usize>,
    pub place: Place,
}

/// Everything known while flattening, except the pool (borrowed apart, since names create expressions).
pub(crate) struct Tree<'r> {
    pub instances: Vec<Instance>,
    pub tables: Vec<(usize, Table)>,
    pub parameters: Vec<Parameter>,
    pub errors: Vec<ModelError>,
    resolver: &'r Resolver<'r>,
    overrides: Vec<(String, Text, Cell<bool>)>,
    depth: Cell<usize>,
}

impl<'r> Tree<'r> {
    pub fn new(resolver: &'r Resolver<'r>, overrides: &[(String, String)]) -> Tree<'r> {
        let place = Place { file: "parameters".into(), line: 0 };
        Tree {
            instances: Vec::new(),
            tables: Vec::new(),
            parameters: Vec::new(),
            errors: Vec::new(),
            resolver,
            overrides: overrides
                .iter()
                .map(|(k, v)| (k.clone(), Text { text: v.clone(), place: place.clone() }, Cell::new(false)))
                .collect(),
            depth: Cell::new(0),
        }
    }

    pub fn fail(&mut self, place: &Place, rule: Rule, at: impl Into<String>, message: impl Into<String>) {
        let error = place.error(rule, at, message);
        if !self.errors.contains(&error) {
            self.errors.push(error);
        }
    }

    pub fn trouble(&mut self, text: &Text, at: &str, trouble: Trouble) {
        let (rule, message) = match trouble {
            Trouble::Unknown(m) => (Rule::UnknownName, m),
            Trouble::Unit(m) => (Rule::Unit, m),
            Trouble::Shape(m) => (Rule::Dimension, m),
            Trouble::Form(m) => (Rule::Expression, m),
        };
        self.fail(&text.place.clone(), rule, at, format!("\"{}\": {message}", text.text));
    }

    /// Builds the tree below the whole model.
    pub fn grow(&mut self, pool: &mut Pool, raw: Rc<Raw>) {
        let environment = Rc::new(Environment { raw: raw.clone(), parent: None });
        let dim = raw.dim.as_ref().map_or(0, |d| d.0);
        let place = raw.place.clone();
        self.instance(pool, "", None, raw, None, dim, false, &environment, &mut Vec::new(), place);
        let unused: Vec<String> = self.overrides.iter().filter(|o| !o.2.get()).map(|o| o.0.clone()).collect();
        for name in unused {
            let mut known: Vec<&str> = self.parameters.iter().map(|p| p.name.as_str()).collect();
            known.sort_by_key(|k| crate::expand::distance(k, &name));
            let near = known.first().map(|k| format!("; did you mean '{k}'?")).unwrap_or_default();
            let place = Place { file: "parameters".into(), line: 0 };
            self.fail(&place, Rule::UnknownName, &name, format!("the model has no parameter '{name}'{near}"));
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn instance(
        &mut self,
        pool: &mut Pool,
        name: &str,
        parent: Option<usize>,
        raw: Rc<Raw>,
        part: Option<RawPart>,
        dim: usize,
        inline: bool,
        environment: &Rc<Environment>,
        used: &mut Vec<String>,
        place: Place,
    ) {
        let path = match parent {
            Some(p) if !self.instances[p].path.is_empty() => format!("{}.{name}", self.instances[p].path),
            _ => name.to_string(),
        };
        let index = self.instances.len();
        self.instances.push(Instance {
            name: name.into(),
            path,
            parent,
            raw: raw.clone(),
            part: part.clone(),
            dim,
            inline,
            parameters: Vec::new(),
            names: Vec::new(),
            block: None,
            place,
        });
        self.parameters_of(pool, index, part.as_ref());
        self.tables_of(pool, index);
        if used.len() > DEPTH_MAX {
            return;
        }
        for child in &raw.parts {
            let found = match &child.uses {
                None => Some((child.content.clone(), environment.clone(), true, String::new())),
                Some(uses) => self.find(uses, environment, index, child),
            };
            let Some((content, env, inline, identity)) = found else { continue };
            if !identity.is_empty() && used.contains(&identity) {
                let chain = format!("{} -> {identity}", used.join(" -> "));
                self.fail(
                    &child.place,
                    Rule::CyclicNesting,
                    &child.name,
                    format!("the model contains itself: {chain}"),
                );
                continue;
            }
            let asked = child.content.dim.as_ref();
            let child_dim = match (&content.dim, asked) {
                (Some((d, _)), Some((a, p))) if d != a => {
                    let d = *d;
                    self.fail(p, Rule::Dimension, &child.name, format!("the model used has dim = {d}"));
                    d
                }
                (Some((d, _)), _) => *d,
                (None, Some((a, _))) => *a,
                (None, None) => dim,
            };
            if child_dim > dim && dim > 0 || child_dim > 1 && dim == 0 {
                self.fail(
                    &child.place,
                    Rule::Dimension,
                    &child.name,
                    format!("a part of dim = {child_dim} cannot sit in a host of dim = {dim}"),
                );
            }
            if !identity.is_empty() {
                used.push(identity.clone());
            }
            self.instance(
                pool,
                &child.name,
                Some(index),
                content,
                Some(child.clone()),
                child_dim,
                inline,
                &env,
                used,
                child.place.clone(),
            );
            if !identity.is_empty() {
                used.pop();
            }
        }
    }

    /// The model a part uses: `model.NAME` from the same file, otherwise a file through the resolver.
    fn find(
        &mut self,
        uses: &Text,
        environment: &Rc<Environment>,
        host: usize,
        child: &RawPart,
    ) -> Option<(Rc<Raw>, Rc<Environment>, bool, String)> {
        if let Some(name) = uses.text.strip_prefix("model.") {
            let mut env = Some(environment.clone());
            while let Some(e) = env {
                if let Some((_, raw)) = e.raw.models.iter().find(|(n, _)| n == name) {
                    let inner = Rc::new(Environment { raw: raw.clone(), parent: Some(e.clone()) });
                    let identity = format!("{}:{}", raw.place.file, name);
                    return Some((raw.clone(), inner, false, identity));
                }
                env = e.parent.clone();
            }
            self.fail(&uses.place, Rule::UnknownName, &child.name, format!("no [model.{name}] in this file"));
            return None;
        }
        let text = match crate::library::resolve(&uses.text)
            .map(Ok)
            .unwrap_or_else(|| (self.resolver)(&uses.text))
        {
            Ok(text) => text,
            Err(why) => {
                self.fail(
                    &uses.place,
                    Rule::Resolve,
                    &child.name,
                    format!("cannot use '{}': {why}", uses.text),
                );
                return None;
            }
        };
        let file: Rc<str> = uses.text.as_str().into();
        let raw = crate::node::read(&text, &file).and_then(|n| crate::document::read(&n));
        match raw {
            Ok(raw) => {
                let raw = Rc::new(raw);
                let env = Rc::new(Environment { raw: raw.clone(), parent: None });
                Some((raw, env, false, uses.text.clone()))
            }
            Err(errors) => {
                let path = self.instances[host].path.clone();
                for mut e in errors {
                    e.place = format!(
                        "{path}{}{} ({})",
                        if path.is_empty() { "" } else { "." },
                        child.name,
                        e.place
                    );
                    if !self.errors.contains(&e) {
                        self.errors.push(e);
                    }
                }
                None
            }
        }
    }

    fn parameters_of(&mut self, pool: &mut Pool, index: usize, part: Option<&RawPart>) {
        let raw = self.instances[index].raw.clone();
        let path = self.instances[index].path.clone();
        if let Some(part) = part {
            for (name, text) in &part.set {
                if !raw.parameters.iter().any(|(n, _)| n == name) {
                    let known: Vec<&str> = raw.parameters.iter().map(|p| p.0.as_str()).collect();
                    let message =
                        format!("set: the part has no parameter '{name}'; it has: {}", known.join(", "));
                    self.fail(&text.place, Rule::UnknownName, &path, message);
                }
            }
        }
        let mut open: Vec<(String, Text, bool)> = raw
            .parameters
            .iter()
            .map(|(name, default)| {
                let set = part.and_then(|p| p.set.iter().find(|(n, _)| n == name));
                (name.clone(), set.map_or(default, |s| &s.1).clone(), set.is_some())
            })
            .collect();
        // Parameters may be written in terms of each other in any order.
        while !open.is_empty() {
            let before = open.len();
            let mut waiting = Vec::new();
            let mut last = Vec::new();
            for (name, text, from_host) in open {
                let full = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                let scope = if from_host { self.instances[index].parent.unwrap_or(0) } else { index };
                match self.expand_in(pool, scope, &text) {
                    Ok(value) => self.parameter(pool, index, &name, &full, &text, value, from_host, &raw),
                    Err(trouble) => {
                        last.push((full, text.clone(), trouble));
                        waiting.push((name, text, from_host));
                    }
                }
            }
            if waiting.len() == before {
                for (full, text, trouble) in last {
                    self.trouble(&text, &full, trouble);
                }
                break;
            }
            open = waiting;
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn parameter(
        &mut self,
        pool: &mut Pool,
        index: usize,
        name: &str,
        full: &str,
        text: &Text,
        mut value: Value,
        from_host: bool,
        raw: &Raw,
    ) {
        let mut unit = value.unit;
        if from_host
            && let Some((_, default)) = raw.parameters.iter().find(|(n, _)| n == name)
            && let Ok(d) = self.expand_in(pool, index, default)
        {
            if let (Some(a), Some(b)) = (d.unit, unit)
                && a != b
            {
                self.fail(
                    &text.place,
                    Rule::Unit,
                    full,
                    format!("\"{}\" is {b}, the parameter is {a}", text.text),
                );
            }
            unit = unit.or(d.unit);
        }
        let override_text = self.overrides.iter().find(|o| o.0 == full).map(|o| {
            o.2.set(true);
            o.1.clone()
        });
        if let Some(text) = override_text {
            match self.expand_in(pool, 0, &text) {
                Ok(v) => {
                    if let (Some(a), Some(b)) = (unit, v.unit)
                        && a != b
                    {
                        self.fail(
                            &text.place,
                            Rule::Unit,
                            full,
                            format!("\"{}\" is {b}, the parameter is {a}", text.text),
                        );
                    }
                    unit = unit.or(v.unit);
                    value = v;
                }
                Err(trouble) => self.trouble(&text, full, trouble),
            }
        }
        let numbers = evaluate(
            pool,
            &value.parts,
            &Leaves {
                parameters: &self.parameters.iter().map(|p| p.value).collect::<Vec<_>>(),
                variables: &[],
                rates: &[],
                time: 0.0,
                tables: &[],
            },
        );
        let n = value.parts.len();
        let mut parts = Vec::with_capacity(n);
        for (at, number) in numbers.iter().enumerate() {
            if !number.is_finite() {
                self.fail(
                    &text.place,
                    Rule::Value,
                    full,
                    format!("\"{}\" is not a finite number", text.text),
                );
            }
            parts.push(pool.parameter(self.parameters.len()));
            let label = match value.shape {
                Shape::Matrix(_, c) => format!("{full}.m{}{}", at / c + 1, at % c + 1),
                _ => component(full, at, n),
            };
            self.parameters.push(Parameter { name: label, unit: unit.unwrap_or(Unit::ONE), value: *number });
        }
        let v = Value { shape: value.shape, parts, unit: Some(unit.unwrap_or(Unit::ONE)) };
        self.instances[index].parameters.push((name.into(), v));
    }

    fn tables_of(&mut self, pool: &mut Pool, index: usize) {
        let raw = self.instances[index].raw.clone();
        for t in &raw.tables {
            let path = self.instances[index].path.clone();
            let at = format!("{path} table {}", t.name);
            let mut columns = Vec::new();
            if let Some(file) = &t.file {
                match crate::library::resolve(&file.text)
                    .map(Ok)
                    .unwrap_or_else(|| (self.resolver)(&file.text))
                {
                    Ok(text) => match crate::tables::table_file(&text) {
                        Ok(c) => columns = c,
                        Err(why) => {
                            self.fail(&file.place, Rule::Format, &at, format!("{}: {why}", file.text))
                        }
                    },
                    Err(why) => self.fail(
                        &file.place,
                        Rule::Resolve,
                        &at,
                        format!("cannot read '{}': {why}", file.text),
                    ),
                }
            } else {
                for text in [&t.x, &t.y, &t.value] {
                    match text {
                        None => columns.push(None),
                        Some(text) => match self.expand_in(pool, index, text) {
                            Ok(v) => {
                                let p = self.parameters.iter().map(|p| p.value).collect::<Vec<_>>();
                                let leaves = Leaves {
                                    parameters: &p,
                                    variables: &[],
                                    rates: &[],
                                    time: 0.0,
                                    tables: &[],
                                };
                                columns.push(Some((
                                    evaluate(pool, &v.parts, &leaves),
                                    v.unit.unwrap_or(Unit::ONE),
                                )));
                            }
                            Err(trouble) => self.trouble(text, &at, trouble),
                        },
                    }
                }
            }
            if columns.len() != 3 {
                continue;
            }
            let value = columns.pop().flatten();
            let y = columns.pop().flatten();
            let x = columns.pop().flatten();
            let (Some(x), Some(value)) = (x, value) else {
                self.fail(&t.place, Rule::Format, &at, "a table has x and value (and y), or a file");
                continue;
            };
            let mut units = vec![x.1];
            let y = y.map_or(Vec::new(), |(y, u)| {
                units.push(u);
                y
            });
            match Table::new(&t.name, x.0, y, value.0, t.cubic, units, value.1) {
                Ok(table) => self.tables.push((index, table)),
                Err(why) => self.fail(&t.place, Rule::Value, &at, why),
            }
        }
    }

    /// Reads and expands an expression in the scope of a part.
    pub fn expand_in(&self, pool: &mut Pool, index: usize, text: &Text) -> Result<Value, Trouble> {
        let ast = syntax::parse(&text.text).map_err(Trouble::Form)?;
        expand(&ast, pool, &PartScope { tree: self, index, frame: None })
    }

    /// The same, with vectors of parts expressed in the frame of `frame` (an instance at or below `index`).
    pub fn expand_seen_from(
        &self,
        pool: &mut Pool,
        index: usize,
        frame: usize,
        text: &Text,
    ) -> Result<Value, Trouble> {
        let ast = syntax::parse(&text.text).map_err(Trouble::Form)?;
        expand(&ast, pool, &PartScope { tree: self, index, frame: Some(frame) })
    }

    pub fn child(&self, index: usize, name: &str) -> Option<usize> {
        self.instances.iter().position(|i| i.parent == Some(index) && i.name == name)
    }

    /// Is `index` inside (or equal to) `outer`?
    pub fn within(&self, index: usize, outer: usize) -> bool {
        let mut at = Some(index);
        while let Some(i) = at {
            if i == outer {
                return true;
            }
            at = self.instances[i].parent;
        }
        false
    }

    /// A part's variable by dotted path, in the frame of `frame`.
    fn variable_of(
        &self,
        pool: &mut Pool,
        index: usize,
        name: &str,
        frame: usize,
    ) -> Option<Result<Value, Trouble>> {
        let mut at = index;
        let mut rest = name;
        loop {
            if let Some((_, ids, unit, turned)) = self.instances[at].names.iter().find(|n| n.0 == rest) {
                let parts: Vec<Id> = ids.iter().map(|v| pool.variable(*v as usize)).collect();
                if parts.len() > 1 && *turned && at != frame {
                    return Some(self.seen_from(pool, at, frame, parts).map(|p| Value::vector(p, *unit)));
                }
                return Some(Ok(Value::vector(parts, *unit)));
            }
            let (head, tail) = rest.split_once('.')?;
            at = self.child(at, head)?;
            rest = tail;
        }
    }

    /// Components of a vector of part `from` in the frame of `to`, an ancestor.
    fn seen_from(&self, pool: &mut Pool, from: usize, to: usize, parts: Vec<Id>) -> Result<Vec<Id>, Trouble> {
        if !self.within(from, to) {
            return Err(Trouble::Shape(format!(
                "'{}' is not inside '{}', so its vectors cannot be given in that frame",
                self.instances[from].path, self.instances[to].path
            )));
        }
        if self.depth.get() > 40 {
            return Err(Trouble::Form("a frame's angle depends on a vector in that same frame".into()));
        }
        self.depth.set(self.depth.get() + 1);
        let result = (|| {
            let (mut at, mut parts) = (from, parts);
            while at != to {
                let r = crate::frames::rotation(self, pool, at)?;
                if let Some(r) = r {
                    parts = crate::frames::apply(pool, &r, &parts);
                }
                match self.instances[at].parent {
                    Some(p) => at = p,
                    None => break,
                }
            }
            Ok(parts)
        })();
        self.depth.set(self.depth.get() - 1);
        result
    }
}

/// Names as seen from inside a part.
pub(crate) struct PartScope<'a, 'r> {
    pub tree: &'a Tree<'r>,
    pub index: usize,
    pub frame: Option<usize>,
}

impl Scope for PartScope<'_, '_> {
    fn name(&self, pool: &mut Pool, name: &str) -> Option<Result<Value, Trouble>> {
        let tree = self.tree;
        let me = &tree.instances[self.index];
        if let Some((_, text)) = me.raw.locals.iter().find(|(n, _)| n == name) {
            if tree.depth.get() > 40 {
                return Some(Err(Trouble::Form(format!("'{name}' is defined by itself"))));
            }
            tree.depth.set(tree.depth.get() + 1);
            let v = tree.expand_in(pool, self.index, text);
            tree.depth.set(tree.depth.get() - 1);
            return Some(v);
        }
        if let Some(v) = tree.variable_of(pool, self.index, name, self.frame.unwrap_or(self.index)) {
            return Some(v);
        }
        // An input of a used part is what its host feeds it.
        if let (Some(part), Some(parent)) = (&me.part, me.parent)
            && me.raw.inputs.iter().any(|(n, _)| n == name)
            && let Some((_, text)) = part.feed.iter().find(|(n, _)| n == name)
        {
            if tree.depth.get() > 40 {
                return Some(Err(Trouble::Form(format!("input '{name}' is fed by itself"))));
            }
            tree.depth.set(tree.depth.get() + 1);
            let v = tree.expand_in(pool, parent, text);
            tree.depth.set(tree.depth.get() - 1);
            return Some(v);
        }
        let mut at = self.index;
        loop {
            let here = &tree.instances[at];
            if let Some((_, v)) = here.parameters.iter().find(|(n, _)| n == name) {
                return Some(Ok(v.clone()));
            }
            // A part written in place sees its host's parameters and mechanisms, not its variables.
            match here.parent {
                Some(p) if here.inline => {
                    let host = &tree.instances[p];
                    if let Some((_, ids, unit, _)) =
                        host.names.iter().find(|n| n.0 == name && n.0.contains('.'))
                    {
                        let parts = ids.iter().map(|v| pool.variable(*v as usize)).collect();
                        return Some(Ok(Value::vector(parts, *unit)));
                    }
                    at = p;
                }
                _ => break,
            }
        }
        if name == "t" {
            let id = pool.time();
            return Some(Ok(Value::scalar(id, Unit::SECOND)));
        }
        None
    }

    fn rate(&self, pool: &mut Pool, name: &str) -> Option<Value> {
        let me = &self.tree.instances[self.index];
        if !me.raw.states.iter().any(|s| s.name == name) {
            return None;
        }
        let (_, ids, unit, _) = me.names.iter().find(|n| n.0 == name)?;
        let parts = ids.iter().map(|v| pool.rate(*v as usize)).collect();
        Some(Value::vector(parts, unit.over(Unit::SECOND)))
    }

    fn table(&self, name: &str) -> Option<(u32, &Table)> {
        let mut at = self.index;
        loop {
            if let Some(i) = self.tree.tables.iter().position(|(owner, t)| *owner == at && t.name == name) {
                return Some((i as u32, &self.tree.tables[i].1));
            }
            let here = &self.tree.instances[at];
            match here.parent {
                Some(p) if here.inline => at = p,
                _ => return None,
            }
        }
    }

    fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        let mut at = self.index;
        loop {
            let here = &self.tree.instances[at];
            names.extend(here.parameters.iter().map(|p| p.0.clone()));
            names.extend(here.names.iter().map(|p| p.0.clone()));
            names.extend(here.raw.locals.iter().map(|p| p.0.clone()));
            for i in self.tree.instances.iter().filter(|i| i.parent == Some(at)) {
                names.extend(i.names.iter().map(|n| format!("{}.{}", i.name, n.0)));
            }
            match here.parent {
                Some(p) if here.inline => at = p,
                _ => return names,
            }
        }
    }
}

/// A variable of a part: `n` scalars.
pub(crate) fn declare(
    flat: &mut Flat,
    path: &str,
    name: &str,
    n: usize,
    kind: Kind,
    unit: Unit,
    block: Option<usize>,
) -> Vec<u32> {
    let full = if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    (0..n).map(|i| flat.variable(component(&full, i, n), kind, unit, block)).collect()
}
