//! Parts with equations: their variables, rows and columns (patent 24-26), equations, ratios and gyrators, energy
//! terms; with the transport term merged into the rows of vector states (the "spatial-motion equation", S31-S33).

use crate::calculus::{depends, substitute};
use crate::document::{Raw, RawPort};
use crate::error::Rule;
use crate::expand::{Shape, Value, binary};
use crate::flat::{Block, Equation, Flat, Gives, Kind, Port, SampledFrame};
use crate::frames;
use crate::instances::{Tree, declare};
use crate::node::Text;
use crate::pool::{Id, Node};
use crate::ratios::ratios;
use crate::syntax::{self, Ast, Op};
use crate::units::Unit;

/// `vD [m/s]`
fn name_and_unit(text: &str) -> Option<(&str, &str)> {
    let (name, rest) = text.split_once('[')?;
    let name = name.trim();
    let unit = rest.trim_end().strip_suffix(']')?;
    let fine = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    fine.then_some((name, unit))
}

/// A unit of a variable: SI, so that every number inside is SI.
fn si_unit(tree: &mut Tree, text: &Text, unit: &str, at: &str) -> Unit {
    match Unit::parse(unit) {
        Ok((u, scale)) => {
            if scale != 1.0 {
                tree.fail(
                    &text.place,
                    Rule::Unit,
                    at,
                    format!("variables are in SI: use {u} instead of {unit}"),
                );
            }
            u
        }
        Err(why) => {
            tree.fail(&text.place, Rule::Unit, at, why);
            Unit::ONE
        }
    }
}

/// Declares the variables of every block, input and mechanism.
pub(crate) fn declare_all(tree: &mut Tree, flat: &mut Flat) {
    for index in 0..tree.instances.len() {
        let raw = tree.instances[index].raw.clone();
        let path = tree.instances[index].path.clone();
        if raw.is_block() {
            declare_block(tree, flat, index, &raw, &path);
        } else {
            for (text, what) in [(&raw.columns.as_ref().map(|c| c.1.clone()), "columns")] {
                if let Some(place) = text {
                    tree.fail(
                        place,
                        Rule::Format,
                        &path,
                        format!("a model with parts has no {what} of its own"),
                    );
                }
            }
            for m in &raw.mechanisms {
                for (name, unit) in &m.gives {
                    let at = format!("{path}{}{}", if path.is_empty() { "" } else { "." }, m.name);
                    let u = si_unit(tree, unit, &unit.text, &at);
                    let kind = if m.always { Kind::Algebraic } else { Kind::Sampled };
                    let full = format!("{}.{name}", m.name);
                    let ids = declare(flat, &path, &full, 1, kind, u, None);
                    tree.instances[index].names.push((full, ids, u, false));
                }
            }
        }
        for (name, unit) in &raw.inputs {
            let at = format!("{path} input {name}");
            let u = si_unit(tree, unit, &unit.text, &at);
            if index == 0 {
                let ids = declare(flat, "", name, 1, Kind::Input, u, None);
                flat.inputs.extend(&ids);
                tree.instances[0].names.push((name.clone(), ids, u, false));
                continue;
            }
            // Fed by the host: the unit must agree.
            let feed = tree.instances[index]
                .part
                .as_ref()
                .and_then(|p| p.feed.iter().find(|(n, _)| n == name))
                .cloned();
            if feed.is_none() {
                let place = tree.instances[index].place.clone();
                tree.fail(
                    &place,
                    Rule::Unconnected,
                    &path,
                    format!("input '{name}' is not fed: add feed = {{ {name} = \"...\" }}"),
                );
            }
        }
    }
}

/// After all names exist: do the feeds fit?
pub(crate) fn check_feeds(tree: &mut Tree, flat: &mut Flat) {
    for index in 1..tree.instances.len() {
        let Some(part) = tree.instances[index].part.clone() else { continue };
        let raw = tree.instances[index].raw.clone();
        let (path, parent) = (tree.instances[index].path.clone(), tree.instances[index].parent.unwrap_or(0));
        for (name, text) in &part.feed {
            let Some((_, unit)) = raw.inputs.iter().find(|(n, _)| n == name) else {
                tree.fail(
                    &text.place,
                    Rule::UnknownName,
                    &path,
                    format!("feed: the part has no input '{name}'"),
                );
                continue;
            };
            let want = Unit::parse(&unit.text).map_or(Unit::ONE, |u| u.0);
            match tree.expand_in(&mut flat.pool, parent, text) {
                Ok(v) if v.unit.is_some_and(|u| u != want) => {
                    let message =
                        format!("feed: \"{}\" is {}, input {name} is {want}", text.text, v.unit_text());
                    tree.fail(&text.place, Rule::Unit, &path, message);
                }
                Ok(v) if v.shape != Shape::Scalar => {
                    tree.fail(
                        &text.place,
                        Rule::Dimension,
                        &path,
                        format!("feed: input {name} is a scalar, \"{}\" is {}", text.text, v.shape),
                    );
                }
                Ok(_) => {}
                Err(trouble) => tree.trouble(text, &path, trouble),
            }
        }
    }
}

fn declare_block(tree: &mut Tree, flat: &mut Flat, index: usize, raw: &Raw, path: &str) {
    let block = flat.blocks.len();
    tree.instances[index].block = Some(block);
    let size = tree.instances[index].dim.max(1);
    for s in &raw.states {
        let at = format!("{path} state {}", s.name);
        let unit = si_unit(tree, &s.unit, &s.unit.text, &at);
        let n = if s.scalar { 1 } else { size };
        let ids = declare(flat, path, &s.name, n, Kind::State, unit, Some(block));
        name_once(tree, index, &s.name, ids, unit, !s.scalar, &s.unit);
    }
    for (name, text) in &raw.signals {
        let unit = si_unit(tree, text, &text.text, &format!("{path} signal {name}"));
        let ids = declare(flat, path, name, 1, Kind::Algebraic, unit, Some(block));
        name_once(tree, index, name, ids, unit, false, text);
    }
    let mut ports = Vec::new();
    for (name, port) in &raw.ports {
        let at = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        let RawPort::Own { across, through, gives, scalar, place } = port else {
            let RawPort::Alias { of, .. } = port else { continue };
            tree.fail(
                &of.place,
                Rule::Format,
                &at,
                "a block's port is { across, through, gives }".to_string(),
            );
            continue;
        };
        let n = if *scalar { 1 } else { size };
        let mut pair = Vec::new();
        for text in [across, through] {
            let Some((var, unit)) = name_and_unit(&text.text) else {
                tree.fail(
                    &text.place,
                    Rule::Format,
                    &at,
                    format!("'{}' should read 'name [unit]'", text.text),
                );
                continue;
            };
            let unit = si_unit(tree, text, unit, &at);
            let ids = declare(flat, path, var, n, Kind::Algebraic, unit, Some(block));
            name_once(tree, index, var, ids.clone(), unit, !*scalar, text);
            pair.push((var.to_string(), ids, unit));
        }
        if pair.len() < 2 {
            continue;
        }
        let (through, across) = (pair.remove(1), pair.remove(0));
        if across.2.times(through.2) != Unit::WATT {
            let message = format!("across {} x through {} is not a power", across.2, through.2);
            tree.fail(place, Rule::Unit, &at, message);
        }
        if !["across", "through"].contains(&gives.text.as_str()) {
            tree.fail(
                &gives.place,
                Rule::Format,
                &at,
                format!("gives = \"across\" or \"through\", not \"{}\"", gives.text),
            );
        }
        ports.push(Port {
            name: name.clone(),
            across: (across.0, across.1),
            through: (through.0, through.1),
            gives_across: gives.text == "across",
            scalar: *scalar,
            unit: (across.2, through.2),
            coupling: None,
            place: place.clone(),
        });
    }
    let place = tree.instances[index].place.clone();
    flat.blocks.push(Block { path: path.to_string(), ports, energy: None, loss: None, supply: None, place });
}

fn name_once(
    tree: &mut Tree,
    index: usize,
    name: &str,
    ids: Vec<u32>,
    unit: Unit,
    turned: bool,
    text: &Text,
) {
    if tree.instances[index].names.iter().any(|n| n.0 == name) {
        let path = tree.instances[index].path.clone();
        tree.fail(&text.place, Rule::Format, path, format!("'{name}' is declared twice in this part"));
        return;
    }
    tree.instances[index].names.push((name.into(), ids, unit, turned));
}

/// Writes the equations of every block.
pub(crate) fn equations(tree: &mut Tree, flat: &mut Flat) {
    for index in 0..tree.instances.len() {
        let Some(block) = tree.instances[index].block else { continue };
        let raw = tree.instances[index].raw.clone();
        let from = flat.equations.len();
        rows(tree, flat, index, block, &raw);
        for (label, text) in &raw.equations {
            let Some(left) = label_value(tree, flat, index, label) else { continue };
            let right = tree.expand_in(&mut flat.pool, index, text);
            let path = flat.blocks[block].path.clone();
            match right {
                Ok(right) => equation(tree, flat, index, block, label, left, right, text),
                Err(trouble) => tree.trouble(text, &path, trouble),
            }
        }
        ratios(tree, flat, index, block, &raw);
        energy_terms(tree, flat, index, block, &raw);
        count(tree, flat, block, &raw, from);
        sampled_frames(tree, flat, index, &raw);
    }
}

fn label_value(tree: &mut Tree, flat: &mut Flat, index: usize, label: &Text) -> Option<Value> {
    match tree.expand_in(&mut flat.pool, index, label) {
        Ok(v) => Some(v),
        Err(trouble) => {
            let path = tree.instances[index].path.clone();
            tree.trouble(label, &path, trouble);
            None
        }
    }
}

fn rows(tree: &mut Tree, flat: &mut Flat, index: usize, block: usize, raw: &Raw) {
    let path = flat.blocks[block].path.clone();
    if raw.rows.is_empty() {
        return;
    }
    let Some((columns, place)) = &raw.columns else {
        tree.fail(&raw.place, Rule::Format, &path, "rows need columns = [...]");
        return;
    };
    let mut values = Vec::new();
    for c in columns {
        match tree.expand_in(&mut flat.pool, index, c) {
            Ok(v) => values.push(v),
            Err(trouble) => {
                tree.trouble(c, &path, trouble);
                return;
            }
        }
    }
    let _ = place;
    for (label, entries) in &raw.rows {
        if entries.len() != values.len() {
            let message = format!(
                "row '{}' has {} entries, there are {} columns",
                label.text,
                entries.len(),
                values.len()
            );
            tree.fail(&label.place, Rule::EquationCount, &path, message);
            continue;
        }
        let Some(left) = label_value(tree, flat, index, label) else { continue };
        let mut sum: Option<Value> = None;
        let mut good = true;
        for ((entry, column), name) in entries.iter().zip(&values).zip(columns) {
            let product = tree
                .expand_in(&mut flat.pool, index, entry)
                .and_then(|c| binary(Op::Multiply, &c, column, &mut flat.pool));
            let product = match product {
                Ok(p) => p,
                Err(trouble) => {
                    tree.trouble(entry, &format!("{path} row {} column {}", label.text, name.text), trouble);
                    good = false;
                    continue;
                }
            };
            if let (Some(a), Some(b)) = (product.unit, left.unit)
                && a != b
            {
                let message = format!("\"{}\" gives {a}, the row is in {b}", entry.text);
                tree.fail(
                    &entry.place,
                    Rule::Unit,
                    format!("{path} row {} column {}", label.text, name.text),
                    message,
                );
                good = false;
                continue;
            }
            sum = Some(match sum {
                None => product,
                Some(s) => match binary(Op::Add, &s, &product, &mut flat.pool) {
                    Ok(v) => v,
                    Err(trouble) => {
                        tree.trouble(entry, &format!("{path} row {}", label.text), trouble);
                        good = false;
                        s
                    }
                },
            });
        }
        if let (true, Some(sum)) = (good, sum) {
            let text = Text { text: label.text.clone(), place: label.place.clone() };
            equation(tree, flat, index, block, label, left, sum, &text);
        }
    }
}

/// left = right, component by component, with the transport term.
#[allow(clippy::too_many_arguments)]
fn equation(
    tree: &mut Tree,
    flat: &mut Flat,
    index: usize,
    block: usize,
    label: &Text,
    left: Value,
    right: Value,
    text: &Text,
) {
    let path = flat.blocks[block].path.clone();
    let at = format!("{path} row {}", label.text);
    if let (Some(a), Some(b)) = (left.unit, right.unit)
        && a != b
    {
        tree.fail(&text.place, Rule::Unit, &at, format!("the left side is {a}, the right side {b}"));
        return;
    }
    let (gives, left_parts) = given(tree, flat, index, &left, &label.text);
    let n = left.parts.len();
    let right_parts = match right.shape {
        _ if right.parts.len() == n => right.parts.clone(),
        Shape::Scalar if flat.pool.is_zero(right.parts[0]) => vec![right.parts[0]; n],
        shape => {
            tree.fail(
                &text.place,
                Rule::Dimension,
                &at,
                format!("the left side is {}, the right side {shape}", left.shape),
            );
            return;
        }
    };
    for k in 0..n {
        let residual = flat.pool.sub(left_parts[k], right_parts[k]);
        flat.equations.push(Equation {
            residual,
            block: Some(block),
            label: format!(
                "row {} of {}",
                crate::flat::component(&label.text, k, n),
                if path.is_empty() { "the model" } else { &path }
            ),
            gives: gives.get(k).copied().unwrap_or(Gives::Nothing),
            place: text.place.clone(),
        });
    }
}

/// What a left side gives, and its components with transport.
fn given(tree: &mut Tree, flat: &mut Flat, index: usize, left: &Value, label: &str) -> (Vec<Gives>, Vec<Id>) {
    let variables: Vec<Gives> = left
        .parts
        .iter()
        .filter_map(|p| match flat.pool.node(*p) {
            Node::Variable(v) => Some(Gives::Variable(*v)),
            _ => None,
        })
        .collect();
    if variables.len() == left.parts.len() {
        return (variables, left.parts.clone());
    }
    let raw = tree.instances[index].raw.clone();
    let mut named = None;
    for s in &raw.states {
        if label.contains(&format!("{}'", s.name)) && mentions(label, &s.name) {
            named = Some(s.clone());
        }
    }
    let Some(state) = named else { return (Vec::new(), left.parts.clone()) };
    let ids = tree.instances[index]
        .names
        .iter()
        .find(|n| n.0 == state.name)
        .map(|n| n.1.clone())
        .unwrap_or_default();
    let gives = ids.iter().map(|v| Gives::Rate(*v)).collect();
    if state.scalar || !state.transport || ids.len() < 2 || left.parts.len() != ids.len() {
        return (gives, left.parts.clone());
    }
    // E x: the left side with rates replaced by their states.
    let held = substitute(&mut flat.pool, &left.parts, &mut |pool, node| match node {
        Node::Rate(v) if ids.contains(v) => Some(pool.variable(*v as usize)),
        _ => None,
    });
    let variables = flat.variables.clone();
    match frames::spin(tree, &mut flat.pool, index, &variables) {
        Ok(None) => (gives, left.parts.clone()),
        Ok(Some(omega)) => {
            let transport = frames::cross(&mut flat.pool, &omega, &held);
            let parts = left.parts.iter().zip(&transport).map(|(a, b)| flat.pool.add(*a, *b)).collect();
            (gives, parts)
        }
        Err(trouble) => {
            let path = tree.instances[index].path.clone();
            let place = tree.instances[index].place.clone();
            tree.trouble(&Text { text: "turn".into(), place }, &path, trouble);
            (gives, left.parts.clone())
        }
    }
}

fn mentions(label: &str, state: &str) -> bool {
    fn walk(ast: &Ast, state: &str) -> bool {
        match ast {
            Ast::Rate(n) => n == state,
            Ast::Negate(a) | Ast::Quantity(a, ..) => walk(a, state),
            Ast::Binary(_, a, b) => walk(a, state) || walk(b, state),
            Ast::Call(_, a) | Ast::List(a) => a.iter().any(|x| walk(x, state)),
            _ => false,
        }
    }
    syntax::parse(label).is_ok_and(|a| walk(&a, state))
}

fn energy_terms(tree: &mut Tree, flat: &mut Flat, index: usize, block: usize, raw: &Raw) {
    let path = flat.blocks[block].path.clone();
    let terms = [
        (&raw.energy, Unit::JOULE, "energy"),
        (&raw.loss, Unit::WATT, "loss"),
        (&raw.supply, Unit::WATT, "supply"),
    ];
    for (text, unit, what) in terms {
        let Some(text) = text else { continue };
        match tree.expand_in(&mut flat.pool, index, text) {
            Ok(v) if v.shape != Shape::Scalar => {
                tree.fail(
                    &text.place,
                    Rule::Dimension,
                    &path,
                    format!("{what} is a scalar, not {}", v.shape),
                );
            }
            Ok(v) if v.unit.is_some_and(|u| u != unit) => {
                tree.fail(
                    &text.place,
                    Rule::Unit,
                    &path,
                    format!("{what} is {}, it must be {unit}", v.unit_text()),
                );
            }
            Ok(v) => {
                let b = &mut flat.blocks[block];
                let slot = match what {
                    "energy" => &mut b.energy,
                    "loss" => &mut b.loss,
                    _ => &mut b.supply,
                };
                *slot = Some(v.parts[0]);
            }
            Err(trouble) => tree.trouble(text, &path, trouble),
        }
    }
}

/// Every state needs its rate, every port what it gives; nothing twice, nothing extra.
fn count(tree: &mut Tree, flat: &mut Flat, block: usize, raw: &Raw, from: usize) {
    if !tree.errors.is_empty() {
        return;
    }
    let b = flat.blocks[block].clone();
    let own = &flat.equations[from..];
    let computed = |v: u32| own.iter().filter(|e| e.gives == Gives::Variable(v)).count();
    // Rows labelled by an expression (such as 0) are constraints: they stand for what no row gives outright.
    let constraints = own.iter().filter(|e| e.gives == Gives::Nothing).count();
    let mut problems = Vec::new();
    for p in &b.ports {
        let given = if p.gives_across { &p.across } else { &p.through };
        match given.1.iter().map(|v| computed(*v)).max() {
            Some(0) if constraints > 0 => {}
            Some(0) => problems.push((
                p.place.clone(),
                format!("{}.{}", b.path, p.name),
                format!("the port gives '{}', but no row computes it", given.0),
            )),
            Some(1) | None => {}
            Some(_) => problems.push((
                p.place.clone(),
                format!("{}.{}", b.path, p.name),
                format!("'{}' is computed twice", given.0),
            )),
        }
        let taken = if p.gives_across { &p.through } else { &p.across };
        if constraints == 0 && taken.1.iter().any(|v| computed(*v) > 0) {
            problems.push((
                p.place.clone(),
                format!("{}.{}", b.path, p.name),
                format!("the port takes '{}', but a row computes it", taken.0),
            ));
        }
    }
    let unknowns: usize = raw.signals.len()
        + b.ports.iter().map(|p| p.across.1.len()).sum::<usize>()
        + flat.variables.iter().filter(|v| v.kind == Kind::State && v.block == Some(block)).count();
    if problems.is_empty() && own.len() != unknowns {
        let message = format!(
            "{} scalar equations for {unknowns} rates of states and given port quantities",
            own.len()
        );
        problems.push((b.place.clone(), b.path.clone(), message));
    }
    for s in &raw.states {
        let rated = own.iter().any(|e| !depends(&flat.pool, e.residual).rates.is_empty());
        if !rated {
            problems.push((s.unit.place.clone(), b.path.clone(), format!("no row gives {}'", s.name)));
        }
    }
    for (place, at, message) in problems {
        tree.fail(&place, Rule::EquationCount, at, message);
    }
}

fn sampled_frames(tree: &mut Tree, flat: &mut Flat, index: usize, raw: &Raw) {
    let variables = flat.variables.clone();
    if !variables.iter().any(|v| v.kind == Kind::Sampled) {
        return;
    }
    for s in raw.states.iter().filter(|s| !s.scalar && s.transport) {
        let Some((_, ids, _, _)) = tree.instances[index].names.iter().find(|n| n.0 == s.name).cloned() else {
            continue;
        };
        if ids.len() < 2 {
            continue;
        }
        match frames::sampled_rotation(tree, &mut flat.pool, index, &variables) {
            Ok(Some(m)) if m.cols == ids.len() => {
                flat.sampled_frames.push(SampledFrame { states: ids, rotation: m.parts });
            }
            Ok(_) => {}
            Err(trouble) => {
                let path = tree.instances[index].path.clone();
                tree.trouble(&s.unit, &path, trouble);
            }
        }
    }
}
