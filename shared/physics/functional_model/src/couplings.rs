//! Joining ports. One convention (spec 5.3): across is shared; through is positive as power v*f flowing from the port
//! that gives across to the port that gives through. With sign s = +1 for a port that gives across and -1 for one
//! that gives through, the power leaving a part is s v f, and a joint of any number of ports reads: across equal,
//! sum of s f = 0 (or the dual: through equal, sum of s v = 0).
//! Different frames: for a port whose components differ from the joint's by Phi, power is kept by
//!   gives across: V = Phi v, f = Phi^T F      gives through: v = Phi^T V, F = Phi f.

use crate::document::{RawCoupling, RawPort};
use crate::error::{Place, Rule};
use crate::flat::{Coupling, Equation, Flat, Gives, Kind, component};
use crate::frames::{self, Matrix, apply};
use crate::instances::Tree;
use crate::node::Text;
use crate::pool::Id;
use crate::units::Unit;

/// Sign change or transposition on purpose, for the test that such a mistake is caught.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    None,
    /// Phi where Phi^T belongs.
    Transposed,
}

/// A port found by name: block, port index, and the instance of the block.
struct Found {
    block: usize,
    port: usize,
    instance: usize,
    inward: bool,
}

/// Follows a name such as `car.rim` through aliases to the block that owns the port.
fn find(tree: &mut Tree, flat: &Flat, host: usize, name: &Text) -> Option<Found> {
    let (mut at, mut rest, mut inward) = (host, name.text.clone(), false);
    let mut first = true;
    loop {
        let (head, tail) = match rest.split_once('.') {
            Some((h, t)) => (h.to_string(), Some(t.to_string())),
            None => (rest.clone(), None),
        };
        let here = tree.instances[at].path.clone();
        match tail {
            Some(tail) => {
                let Some(child) = tree.child(at, &head) else {
                    let parts: Vec<String> = tree
                        .instances
                        .iter()
                        .filter(|i| i.parent == Some(at))
                        .map(|i| i.name.clone())
                        .collect();
                    tree.fail(
                        &name.place,
                        Rule::UnknownName,
                        &name.text,
                        format!("there is no part '{head}'; parts: {}", parts.join(", ")),
                    );
                    return None;
                };
                if tail.contains('.') && first {
                    let inside = tree.instances[child].path.clone();
                    tree.fail(
                        &name.place,
                        Rule::TwoHosts,
                        &name.text,
                        format!("'{tail}' is inside '{inside}', which is its host; give {inside} a port for it: ports.NAME = \"{tail}\""),
                    );
                    return None;
                }
                at = child;
                rest = tail;
            }
            None => {
                let raw = tree.instances[at].raw.clone();
                if let Some(block) = tree.instances[at].block {
                    let ports = &flat.blocks[block].ports;
                    if let Some(port) = ports.iter().position(|p| p.name == head) {
                        return Some(Found { block, port, instance: at, inward });
                    }
                    let known: Vec<String> = ports.iter().map(|p| p.name.clone()).collect();
                    tree.fail(
                        &name.place,
                        Rule::UnknownName,
                        &name.text,
                        format!("part '{here}' has no port '{head}'; ports: {}", known.join(", ")),
                    );
                    return None;
                }
                match raw.ports.iter().find(|(n, _)| *n == head) {
                    Some((_, RawPort::Alias { of, inward: i })) => {
                        inward ^= *i;
                        rest = of.text.clone();
                    }
                    Some((_, RawPort::Own { place, .. })) => {
                        tree.fail(
                            place,
                            Rule::Format,
                            &name.text,
                            "a model with parts has ports of its parts: NAME = \"part.port\"",
                        );
                        return None;
                    }
                    None => {
                        let known: Vec<String> = raw.ports.iter().map(|p| p.0.clone()).collect();
                        tree.fail(
                            &name.place,
                            Rule::UnknownName,
                            &name.text,
                            format!("model '{here}' has no port '{head}'; ports: {}", known.join(", ")),
                        );
                        return None;
                    }
                }
            }
        }
        first = false;
    }
}

/// One side of a joint: its components in the joint's frame.
struct Side {
    across: Vec<Id>,
    through: Vec<Id>,
    sign: f64,
    label: String,
}

/// Writes all joints: couplings of every model, free ports, and the open ports of the whole model.
pub(crate) fn join_all(tree: &mut Tree, flat: &mut Flat, fault: Fault) {
    for host in 0..tree.instances.len() {
        let raw = tree.instances[host].raw.clone();
        for c in &raw.couplings {
            join(tree, flat, host, c, fault);
        }
        for name in &raw.free {
            closed(tree, flat, host, name, false);
        }
        for name in &raw.fixed {
            closed(tree, flat, host, name, true);
        }
    }
    open_ports(tree, flat, fault);
    for b in 0..flat.blocks.len() {
        for p in flat.blocks[b].ports.clone() {
            if p.coupling.is_none() {
                let path = &flat.blocks[b].path;
                let at = if path.is_empty() { p.name.clone() } else { format!("{path}.{}", p.name) };
                tree.fail(&p.place, Rule::Unconnected, at, "the port is joined to nothing; couple it, open it under [ports], or list it in free = [...] (no through) or fixed = [...] (no across)");
            }
        }
    }
}

/// Marks a port as used; an error when it already is.
fn claim(tree: &mut Tree, flat: &mut Flat, found: &Found, coupling: usize, name: &Text) -> bool {
    let port = &mut flat.blocks[found.block].ports[found.port];
    if let Some(other) = port.coupling {
        let other = flat.couplings.get(other).map_or_else(|| "this joint".to_string(), |c| c.name.clone());
        tree.fail(
            &name.place,
            Rule::TwoHosts,
            &name.text,
            format!("the port is already joined in '{other}'"),
        );
        return false;
    }
    port.coupling = Some(coupling);
    true
}

#[allow(clippy::too_many_arguments)]
fn side(
    tree: &mut Tree,
    flat: &mut Flat,
    found: &Found,
    host: usize,
    coupling: &str,
    name: &Text,
    place: &Place,
    fault: Fault,
) -> Option<Side> {
    let port = flat.blocks[found.block].ports[found.port].clone();
    let size = port.across.1.len();
    let sign = port.sign();
    let v: Vec<Id> = port.across.1.iter().map(|i| flat.pool.variable(*i as usize)).collect();
    let f: Vec<Id> = port.through.1.iter().map(|i| flat.pool.variable(*i as usize)).collect();
    let rotational = port.unit.0 == Unit::PER_SECOND;
    let phi = if port.scalar {
        None
    } else {
        match frames::lift(tree, &mut flat.pool, found.instance, host, size, rotational) {
            Ok(phi) => phi,
            Err(trouble) => {
                tree.trouble(name, &name.text, trouble);
                return None;
            }
        }
    };
    let Some(phi) = phi else {
        return Some(Side { across: v, through: f, sign, label: name.text.clone() });
    };
    let wrong =
        if fault == Fault::Transposed && phi.rows == phi.cols { phi.clone() } else { phi.transposed() };
    let (rows, label) = (phi.rows, format!("frame of {} at {coupling}", name.text));
    let mut new = |what: &str, unit: Unit, gives_variable: bool| -> (Vec<u32>, Vec<Id>) {
        let ids: Vec<u32> = (0..rows)
            .map(|k| {
                flat.variable(
                    component(&format!("{coupling}:{}.{what}", name.text), k, rows),
                    Kind::Algebraic,
                    unit,
                    None,
                )
            })
            .collect();
        let _ = gives_variable;
        let parts = ids.iter().map(|i| flat.pool.variable(*i as usize)).collect();
        (ids, parts)
    };
    let (across_ids, across) = new("across", port.unit.0, true);
    let (through_ids, through) = new("through", port.unit.1, false);
    let equate = |flat: &mut Flat, left: &[(Id, u32)], m: &Matrix, right: &[Id]| {
        let values = apply(&mut flat.pool, m, right);
        for ((l, v), r) in left.iter().zip(&values) {
            let residual = flat.pool.sub(*l, *r);
            flat.equations.push(Equation {
                residual,
                block: None,
                label: label.clone(),
                gives: Gives::Variable(*v),
                place: place.clone(),
            });
        }
    };
    let pair = |ids: &[u32], parts: &[Id]| -> Vec<(Id, u32)> {
        parts.iter().copied().zip(ids.iter().copied()).collect()
    };
    if port.gives_across {
        equate(flat, &pair(&across_ids, &across), &phi, &v);
        equate(flat, &pair(&port.through.1, &f), &wrong, &through);
    } else {
        equate(flat, &pair(&port.across.1, &v), &wrong, &across);
        equate(flat, &pair(&through_ids, &through), &phi, &f);
    }
    Some(Side { across, through, sign, label: name.text.clone() })
}

fn join(tree: &mut Tree, flat: &mut Flat, host: usize, c: &RawCoupling, fault: Fault) {
    let path = tree.instances[host].path.clone();
    let prefix = if path.is_empty() { String::new() } else { format!("{path}: ") };
    let joined = c.join.iter().map(|t| t.text.as_str()).collect::<Vec<_>>().join(" - ");
    let name = format!("{prefix}{joined}");
    let index = flat.couplings.len();
    let mut members = Vec::new();
    let mut sides: Vec<Side> = Vec::new();
    let mut units: Option<((Unit, Unit), String)> = None;
    for text in &c.join {
        let Some(found) = find(tree, flat, host, text) else { continue };
        if !claim(tree, flat, &found, index, text) {
            continue;
        }
        let unit = flat.blocks[found.block].ports[found.port].unit;
        match &units {
            Some((first, who)) if *first != unit => {
                let message = format!("joins {} / {} to {} / {} of {who}", unit.0, unit.1, first.0, first.1);
                tree.fail(&text.place, Rule::Unit, &text.text, message);
            }
            Some(_) => {}
            None => units = Some((unit, text.text.clone())),
        }
        members.push((found.block, found.port));
        if let Some(s) = side(tree, flat, &found, host, &name, text, &c.place, fault) {
            sides.push(s);
        }
    }
    flat.couplings.push(Coupling { name: name.clone(), members, outside: None });
    if sides.len() != c.join.len() {
        return;
    }
    let n = sides[0].across.len();
    if let Some(odd) = sides.iter().find(|s| s.across.len() != n) {
        let message = format!(
            "{} has {n} component(s) in this frame, {} has {}; say how the part lies in its host (along, turn)",
            sides[0].label,
            odd.label,
            odd.across.len()
        );
        tree.fail(&c.place, Rule::Dimension, &name, message);
        return;
    }
    joint(flat, &sides, c.series, &name, &c.place);
}

/// Equations of one joint.
fn joint(flat: &mut Flat, sides: &[Side], series: bool, name: &str, place: &Place) {
    let label = format!("coupling {name}");
    let push = |flat: &mut Flat, residual: Id| {
        flat.equations.push(Equation {
            residual,
            block: None,
            label: label.clone(),
            gives: Gives::Nothing,
            place: place.clone(),
        });
    };
    for k in 0..sides[0].across.len() {
        let pick = |s: &Side, shared: bool| if shared != series { s.across[k] } else { s.through[k] };
        for s in &sides[1..] {
            let residual = flat.pool.sub(pick(&sides[0], true), pick(s, true));
            push(flat, residual);
        }
        let terms: Vec<(Id, f64)> = sides.iter().map(|s| (pick(s, false), s.sign)).collect();
        let residual = flat.pool.sum(&terms, 0.0);
        push(flat, residual);
    }
}

/// A port left free passes no through, a fixed one no across.
fn closed(tree: &mut Tree, flat: &mut Flat, host: usize, name: &Text, fixed: bool) {
    let Some(found) = find(tree, flat, host, name) else { return };
    let index = flat.couplings.len();
    if !claim(tree, flat, &found, index, name) {
        return;
    }
    let port = flat.blocks[found.block].ports[found.port].clone();
    let what = if fixed { "fixed" } else { "free" };
    let zero = if fixed { &port.across.1 } else { &port.through.1 };
    for v in zero {
        let residual = flat.pool.variable(*v as usize);
        flat.equations.push(Equation {
            residual,
            block: None,
            label: format!("{what} port {}", name.text),
            gives: Gives::Variable(*v),
            place: name.place.clone(),
        });
    }
    flat.couplings.push(Coupling {
        name: format!("{} - {what}", name.text),
        members: vec![(found.block, found.port)],
        outside: None,
    });
}

/// Ports of the whole model: what a part takes becomes an input, what it gives an output, in the outermost frame.
fn open_ports(tree: &mut Tree, flat: &mut Flat, fault: Fault) {
    let raw = tree.instances[0].raw.clone();
    let ports: Vec<(String, Text, bool)> = if raw.is_block() {
        raw.ports
            .iter()
            .filter_map(|(n, p)| match p {
                RawPort::Own { place, .. } => {
                    Some((n.clone(), Text { text: n.clone(), place: place.clone() }, false))
                }
                RawPort::Alias { .. } => None,
            })
            .collect()
    } else {
        raw.ports
            .iter()
            .filter_map(|(n, p)| match p {
                RawPort::Alias { of, inward } => Some((n.clone(), of.clone(), *inward)),
                RawPort::Own { place, .. } => {
                    tree.fail(
                        place,
                        Rule::Format,
                        n,
                        "a model with parts has ports of its parts: NAME = \"part.port\"",
                    );
                    None
                }
            })
            .collect()
    };
    for (name, of, inward) in ports {
        let Some(mut found) = find(tree, flat, 0, &of) else { continue };
        found.inward ^= inward;
        let index = flat.couplings.len();
        if !claim(tree, flat, &found, index, &of) {
            continue;
        }
        let Some(s) = side(tree, flat, &found, 0, &name, &of, &of.place, fault) else { continue };
        let port = flat.blocks[found.block].ports[found.port].clone();
        let n = s.across.len();
        let gives = port.gives_across;
        let flip = if found.inward { -1.0 } else { 1.0 };
        let make = |flat: &mut Flat, base: &str, unit: Unit, kind: Kind| -> Vec<u32> {
            (0..n)
                .map(|k| flat.variable(component(&format!("{name}.{base}"), k, n), kind, unit, None))
                .collect()
        };
        let across_kind = if gives { Kind::Algebraic } else { Kind::Input };
        let through_kind = if gives { Kind::Input } else { Kind::Algebraic };
        let across = make(flat, &port.across.0, port.unit.0, across_kind);
        let through = make(flat, &port.through.0, port.unit.1, through_kind);
        flat.inputs.extend(if gives { &through } else { &across });
        flat.outputs.extend(if gives { &across } else { &through });
        for k in 0..n {
            for (outer, inner, factor) in [(across[k], s.across[k], 1.0), (through[k], s.through[k], flip)] {
                let o = flat.pool.variable(outer as usize);
                let residual = flat.pool.sum(&[(o, factor), (inner, -1.0)], 0.0);
                let given = if flat.variables[outer as usize].kind == Kind::Input {
                    Gives::Nothing
                } else {
                    Gives::Variable(outer)
                };
                flat.equations.push(Equation {
                    residual,
                    block: None,
                    label: format!("open port {name}"),
                    gives: given,
                    place: of.place.clone(),
                });
            }
        }
        flat.couplings.push(Coupling {
            name: format!("{} - {name} (open)", of.text),
            members: vec![(found.block, found.port)],
            outside: Some((across, through, s.sign * flip)),
        });
    }
}
