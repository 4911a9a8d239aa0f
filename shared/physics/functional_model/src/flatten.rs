//! The order of flattening, and the small sections: mechanisms, observations, start values, run settings.

use std::rc::Rc;

use crate::Resolver;
use crate::calculus::{Leaves, depends, evaluate};
use crate::couplings::{self, Fault};
use crate::document::Raw;
use crate::error::{ModelError, Place, Rule};
use crate::expand::{Scope, Shape, Trouble, Value, expand};
use crate::flat::{Box, Equation, Flat, Gives, Mechanism, Observation, component};
use crate::instances::{PartScope, Tree};
use crate::node::Text;
use crate::pool::Pool;
use crate::tables::Table;
use crate::units::Unit;
use crate::{blocks, syntax};

/// Flattens a model; all mistakes found on the way.
pub(crate) fn flatten(
    raw: &Rc<Raw>,
    resolver: &Resolver,
    overrides: &[(String, String)],
    fault: Fault,
) -> Result<Flat, Vec<ModelError>> {
    let mut flat = Flat::default();
    let mut tree = Tree::new(resolver, overrides);
    tree.grow(&mut flat.pool, raw.clone());
    blocks::declare_all(&mut tree, &mut flat);
    flat.parameters = tree.parameters.clone();
    flat.tables = tree.tables.iter().map(|t| t.1.clone()).collect();
    blocks::check_feeds(&mut tree, &mut flat);
    let errors_before = tree.errors.len();
    mechanisms(&mut tree, &mut flat);
    blocks::equations(&mut tree, &mut flat);
    couplings::join_all(&mut tree, &mut flat, fault);
    directions(&mut tree, &mut flat);
    observations(&mut tree, &mut flat);
    starts(&mut tree, &mut flat);
    run(&mut tree, &mut flat);
    boxes(&tree, &mut flat);
    let _ = errors_before;
    if tree.errors.is_empty() {
        if flat.equations.is_empty() {
            let place = raw.place.clone();
            return Err(vec![place.error(Rule::Format, "", "the model has no part with equations")]);
        }
        return Ok(flat);
    }
    tree.errors.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
    Err(tree.errors)
}

/// Names of a mechanism: what it reads, then what its model knows.
struct MechanismScope<'a, 'r> {
    outer: PartScope<'a, 'r>,
    reads: Vec<(String, Value)>,
}

impl Scope for MechanismScope<'_, '_> {
    fn name(&self, pool: &mut Pool, name: &str) -> Option<Result<Value, Trouble>> {
        if let Some((_, v)) = self.reads.iter().find(|(n, _)| n == name) {
            return Some(Ok(v.clone()));
        }
        self.outer.name(pool, name)
    }
    fn rate(&self, _: &mut Pool, _: &str) -> Option<Value> {
        None
    }
    fn table(&self, name: &str) -> Option<(u32, &Table)> {
        self.outer.table(name)
    }
    fn names(&self) -> Vec<String> {
        let mut names = self.outer.names();
        names.extend(self.reads.iter().map(|r| r.0.clone()));
        names
    }
}

fn mechanisms(tree: &mut Tree, flat: &mut Flat) {
    for index in 0..tree.instances.len() {
        let raw = tree.instances[index].raw.clone();
        let path = tree.instances[index].path.clone();
        for m in &raw.mechanisms {
            let at = if path.is_empty() { m.name.clone() } else { format!("{path}.{}", m.name) };
            let mut reads = Vec::new();
            for (name, text) in &m.reads {
                match tree.expand_in(&mut flat.pool, index, text) {
                    Ok(v) => reads.push((name.clone(), v)),
                    Err(trouble) => tree.trouble(text, &at, trouble),
                }
            }
            // Its own last results by their short names.
            for (name, _) in &m.gives {
                let full = format!("{}.{name}", m.name);
                if let Some((_, ids, unit, _)) = tree.instances[index].names.iter().find(|n| n.0 == full) {
                    let v = Value::scalar(flat.pool.variable(ids[0] as usize), *unit);
                    reads.push((name.clone(), v));
                }
            }
            let in_scope = |tree: &Tree, flat: &mut Flat, text: &Text| {
                let ast = syntax::parse(&text.text).map_err(Trouble::Form)?;
                let scope =
                    MechanismScope { outer: PartScope { tree, index, frame: None }, reads: reads.clone() };
                expand(&ast, &mut flat.pool, &scope)
            };
            let mut mechanism = Mechanism { gives: Vec::new(), hold: None };
            for (name, unit_text) in &m.gives {
                let full = format!("{}.{name}", m.name);
                let Some((_, ids, unit, _)) =
                    tree.instances[index].names.iter().find(|n| n.0 == full).cloned()
                else {
                    continue;
                };
                let Some((_, rule)) = m.rule.iter().find(|(n, _)| n == name) else {
                    tree.fail(&unit_text.place, Rule::EquationCount, &at, format!("no rule gives '{name}'"));
                    continue;
                };
                let v = match in_scope(tree, flat, rule) {
                    Ok(v) => v,
                    Err(trouble) => {
                        tree.trouble(rule, &at, trouble);
                        continue;
                    }
                };
                if v.shape != Shape::Scalar {
                    tree.fail(
                        &rule.place,
                        Rule::Dimension,
                        &at,
                        format!("rule {name} is {}, a mechanism gives scalars", v.shape),
                    );
                }
                if v.unit.is_some_and(|u| u != unit) {
                    tree.fail(
                        &rule.place,
                        Rule::Unit,
                        &at,
                        format!("rule {name} is {}, it gives {unit}", v.unit_text()),
                    );
                }
                match m.start.iter().find(|(n, _)| n == name) {
                    Some((_, text)) => {
                        let start = in_scope(tree, flat, text);
                        set_start(tree, flat, &ids, unit, text, &at, start);
                    }
                    None if !m.always => {
                        tree.fail(
                            &m.place,
                            Rule::Start,
                            &at,
                            format!("start = {{ {name} = ... }} is missing"),
                        );
                    }
                    None => {}
                }
                if m.always {
                    let own = flat.pool.variable(ids[0] as usize);
                    let residual = flat.pool.sub(own, v.parts[0]);
                    flat.equations.push(Equation {
                        residual,
                        block: None,
                        label: format!("mechanism {at}"),
                        gives: Gives::Variable(ids[0]),
                        place: rule.place.clone(),
                    });
                } else {
                    mechanism.gives.push((ids[0], v.parts[0]));
                }
            }
            for (name, text) in m.rule.iter().chain(&m.start) {
                if !m.gives.iter().any(|(n, _)| n == name) {
                    tree.fail(&text.place, Rule::UnknownName, &at, format!("'{name}' is not in gives"));
                }
            }
            if let Some(text) = &m.hold {
                if m.always {
                    tree.fail(
                        &text.place,
                        Rule::Format,
                        &at,
                        "hold belongs to a mechanism that runs each sample",
                    );
                }
                match in_scope(tree, flat, text) {
                    Ok(v) => mechanism.hold = Some(v.parts[0]),
                    Err(trouble) => tree.trouble(text, &at, trouble),
                }
            }
            if !m.always {
                flat.mechanisms.push(mechanism);
            }
        }
    }
}

fn numbers(flat: &Flat, v: &Value) -> Option<Vec<f64>> {
    for p in &v.parts {
        let d = depends(&flat.pool, *p);
        if !d.variables.is_empty() || !d.rates.is_empty() || d.time {
            return None;
        }
    }
    let p = flat.parameter_values();
    let leaves = Leaves { parameters: &p, variables: &[], rates: &[], time: 0.0, tables: &flat.tables };
    Some(evaluate(&flat.pool, &v.parts, &leaves))
}

fn set_start(
    tree: &mut Tree,
    flat: &mut Flat,
    ids: &[u32],
    unit: Unit,
    text: &Text,
    at: &str,
    value: Result<Value, Trouble>,
) {
    match value {
        Ok(v) => {
            if v.unit.is_some_and(|u| u != unit) {
                tree.fail(
                    &text.place,
                    Rule::Unit,
                    at,
                    format!("start \"{}\" is {}, the variable is {unit}", text.text, v.unit_text()),
                );
                return;
            }
            let Some(n) = numbers(flat, &v) else {
                tree.fail(
                    &text.place,
                    Rule::Start,
                    at,
                    format!("start \"{}\" must be made of parameters", text.text),
                );
                return;
            };
            if n.len() != ids.len() && n.len() != 1 {
                tree.fail(
                    &text.place,
                    Rule::Dimension,
                    at,
                    format!("start has {} components, the variable {}", n.len(), ids.len()),
                );
                return;
            }
            for (k, id) in ids.iter().enumerate() {
                let variable = &mut flat.variables[*id as usize];
                variable.start = Some(n[if n.len() == 1 { 0 } else { k }]);
                variable.start_place = text.place.clone();
            }
        }
        Err(trouble) => tree.trouble(text, at, trouble),
    }
}

fn starts(tree: &mut Tree, flat: &mut Flat) {
    // Inner models first, so that what the whole model says wins.
    for index in (0..tree.instances.len()).rev() {
        let raw = tree.instances[index].raw.clone();
        let path = tree.instances[index].path.clone();
        for (name, text) in &raw.start {
            let (mut at, mut rest) = (index, name.as_str());
            let found = loop {
                if let Some(n) = tree.instances[at].names.iter().find(|n| n.0 == rest) {
                    break Some(n.clone());
                }
                let Some((head, tail)) = rest.split_once('.') else { break None };
                let Some(child) = tree.child(at, head) else { break None };
                (at, rest) = (child, tail);
            };
            let Some((_, ids, unit, _)) = found else {
                tree.fail(
                    &text.place,
                    Rule::UnknownName,
                    &path,
                    format!("start: there is no variable '{name}'"),
                );
                continue;
            };
            let value = tree.expand_in(&mut flat.pool, index, text);
            set_start(tree, flat, &ids, unit, text, name, value);
        }
    }
}

/// Directions must have unit length, or a torque would change on the way.
fn directions(tree: &mut Tree, flat: &mut Flat) {
    for index in 1..tree.instances.len() {
        let Some(part) = tree.instances[index].part.clone() else { continue };
        let (parent, path) = (tree.instances[index].parent.unwrap_or(0), tree.instances[index].path.clone());
        for (_, text) in &part.turn {
            if let Ok(v) = tree.expand_in(&mut flat.pool, parent, text) {
                if v.unit.is_some_and(|u| u != Unit::ONE) {
                    tree.fail(
                        &text.place,
                        Rule::Unit,
                        &path,
                        format!("turn: an angle is in rad or deg, not {}", v.unit_text()),
                    );
                } else if v.shape != Shape::Scalar {
                    tree.fail(
                        &text.place,
                        Rule::Dimension,
                        &path,
                        format!("turn: an angle is a scalar, not {}", v.shape),
                    );
                }
            }
        }
        if let Some(text) = &part.along
            && let Ok(v) = tree.expand_in(&mut flat.pool, parent, text)
            && let Some(n) = numbers(flat, &v)
        {
            let length = n.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (length - 1.0).abs() > 1e-9 {
                tree.fail(
                    &text.place,
                    Rule::Value,
                    &path,
                    format!("along has length {length}, a direction has length 1"),
                );
            }
        }
        if let Some(text) = &part.matrix
            && let Ok(v) = tree.expand_in(&mut flat.pool, parent, text)
            && let (Some(n), Shape::Matrix(r, c)) = (numbers(flat, &v), v.shape)
        {
            let off = (0..c * c).any(|k| {
                let dot: f64 = (0..r).map(|i| n[i * c + k / c] * n[i * c + k % c]).sum();
                (dot - f64::from(u8::from(k / c == k % c))).abs() > 1e-9
            });
            if off {
                tree.fail(
                    &text.place,
                    Rule::Value,
                    &path,
                    "matrix is not a rotation (its columns are not orthonormal)",
                );
            }
        }
    }
}

fn observations(tree: &mut Tree, flat: &mut Flat) {
    for index in 0..tree.instances.len() {
        let raw = tree.instances[index].raw.clone();
        let path = tree.instances[index].path.clone();
        for o in &raw.observe {
            let at = if path.is_empty() { o.name.clone() } else { format!("{path}.{}", o.name) };
            let mut frame = index;
            if let Some(text) = &o.frame {
                let mut found = Some(index);
                for piece in text.text.split('.') {
                    found = found.and_then(|f| tree.child(f, piece));
                }
                match found {
                    Some(f) => frame = f,
                    None => {
                        tree.fail(
                            &text.place,
                            Rule::UnknownName,
                            &at,
                            format!("there is no part '{}' to see it from", text.text),
                        );
                        continue;
                    }
                }
            }
            match tree.expand_seen_from(&mut flat.pool, index, frame, &o.of) {
                Ok(v) => {
                    let n = v.parts.len();
                    for (k, part) in v.parts.iter().enumerate() {
                        flat.observations.push(Observation {
                            name: component(&at, k, n),
                            part: *part,
                            unit: v.unit.unwrap_or(Unit::ONE),
                        });
                    }
                }
                Err(trouble) => tree.trouble(&o.of, &at, trouble),
            }
        }
    }
}

fn run(tree: &mut Tree, flat: &mut Flat) {
    let raw = tree.instances[0].raw.clone();
    if let Some(text) = &raw.sample {
        match tree.expand_in(&mut flat.pool, 0, text) {
            Ok(v) if v.unit != Some(Unit::SECOND) || v.shape != Shape::Scalar => {
                tree.fail(&text.place, Rule::Unit, "run.sample", "sample is a time, such as \"1 ms\"");
            }
            Ok(v) => match numbers(flat, &v) {
                Some(n) if n[0] > 0.0 => flat.sample = Some(n[0]),
                _ => tree.fail(&text.place, Rule::Value, "run.sample", "sample must be positive"),
            },
            Err(trouble) => tree.trouble(text, "run.sample", trouble),
        }
    }
    if let Some(text) = &raw.method {
        if !["exact", "implicit", "explicit"].contains(&text.text.as_str()) {
            tree.fail(
                &text.place,
                Rule::Method,
                "run.method",
                format!("'{}' is not exact, implicit or explicit", text.text),
            );
        }
        flat.method = Some((text.text.clone(), text.place.clone()));
    }
    if flat.sample.is_none() && !flat.mechanisms.is_empty() {
        tree.fail(
            &Place { line: 1, ..raw.place.clone() },
            Rule::Method,
            "run",
            "a model with mechanisms needs [run] sample = \"...\"",
        );
    }
}

fn boxes(tree: &Tree, flat: &mut Flat) {
    for i in &tree.instances {
        let placed = i.part.as_ref().map_or(String::new(), |p| {
            if let Some(a) = &p.along {
                format!("along {}", a.text)
            } else if let Some(m) = &p.matrix {
                format!("matrix {}", m.text)
            } else {
                let turns: Vec<String> =
                    p.turn.iter().map(|(axis, t)| format!("turn {axis} {}", t.text)).collect();
                turns.join(", ")
            }
        });
        flat.boxes.push(Box {
            name: i.name.clone(),
            path: i.path.clone(),
            dim: i.dim,
            parent: i.parent,
            block: i.block,
            placed,
        });
    }
}
