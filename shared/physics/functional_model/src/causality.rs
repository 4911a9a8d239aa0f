//! Who gives what to whom, after composing: which part had to be turned round (its equation solved for the other
//! quantity), which loops were solved together, which storages became dependent. The assignment of equations to
//! unknowns starts from what the author declared and changes it only where it must (augmenting paths).

use std::fmt;

use crate::calculus::depends;
use crate::flat::{Gives, Kind};
use crate::model::System;
use crate::reduce::{augment, column_of, name_of, rate_column_of};

/// Causality of one port.
#[derive(Debug, Clone, PartialEq)]
pub struct PortCausality {
    /// `car.tyre.rim`
    pub port: String,
    /// Joint it belongs to.
    pub joint: String,
    /// Name and declared role: what the part says it gives.
    pub declared: String,
    /// What it gives in the composed system.
    pub actual: String,
    /// True when the part was turned round.
    pub turned: bool,
}

/// The causality report of a system.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CausalityReport {
    /// Every port.
    pub ports: Vec<PortCausality>,
    /// Loops of unknowns solved together (algebraic loops), largest first.
    pub loops: Vec<Vec<String>>,
    /// States that rigid joins made dependent.
    pub dependent_states: Vec<String>,
}

impl fmt::Display for CausalityReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for p in &self.ports {
            let note =
                if p.turned { format!("   (turned round; declared {})", p.declared) } else { String::new() };
            writeln!(f, "{} gives {}{note}", p.port, p.actual)?;
        }
        for l in &self.loops {
            writeln!(f, "solved together: {}", l.join(", "))?;
        }
        for s in &self.dependent_states {
            writeln!(f, "rigidly joined: {s} follows from the other states")?;
        }
        Ok(())
    }
}

impl System {
    /// Derives the causality of the composed system.
    pub fn causality_report(&self) -> CausalityReport {
        let flat = self.flat.borrow();
        let mut unknown: Vec<u32> = Vec::new();
        for (v, variable) in flat.variables.iter().enumerate() {
            match variable.kind {
                Kind::Algebraic => unknown.push(column_of(v as u32)),
                Kind::State => unknown.push(rate_column_of(v as u32)),
                _ => {}
            }
        }
        let place = |column: u32| unknown.binary_search(&column).ok();
        unknown_sorted(&unknown);
        let rate_of = |v: u32| match self.dae.dependent.iter().find(|d| d.0 == v) {
            Some(d) => column_of(d.1),
            None => rate_column_of(v),
        };
        let mut edges: Vec<Vec<usize>> = Vec::new();
        let mut declared: Vec<Option<usize>> = Vec::new();
        for e in &self.dae.equations {
            let d = depends(&flat.pool, e.residual);
            let mut u: Vec<usize> = d
                .variables
                .iter()
                .filter_map(|v| place(column_of(*v)))
                .chain(d.rates.iter().filter_map(|v| place(rate_column_of(*v))))
                .collect();
            let gives = if e.order > 0 {
                None
            } else {
                match flat.equations[e.origin].gives {
                    Gives::Variable(v) => place(column_of(v)),
                    Gives::Rate(v) => place(rate_of(v)),
                    Gives::Nothing => None,
                }
            };
            // What it was declared to give comes first.
            if let Some(g) = gives.filter(|g| u.contains(g)) {
                u.retain(|x| *x != g);
                u.insert(0, g);
            }
            declared.push(gives.filter(|g| u.contains(g)));
            edges.push(u);
        }
        let mut owner: Vec<Option<usize>> = vec![None; unknown.len()];
        for (e, g) in declared.iter().enumerate() {
            if let Some(g) = g
                && owner[*g].is_none()
            {
                owner[*g] = Some(e);
            }
        }
        for e in 0..edges.len() {
            if !owner.contains(&Some(e)) {
                let mut seen = vec![false; unknown.len()];
                augment(e, &edges, &mut owner, &mut seen);
            }
        }
        let mut report = CausalityReport::default();
        for b in flat.blocks.iter().enumerate() {
            for p in &b.1.ports {
                // A quantity is given by the part when one of the part's own equations determines it.
                let by_part = |ids: &[u32]| {
                    ids.iter()
                        .filter(|v| {
                            place(column_of(**v)).and_then(|k| owner[k]).is_some_and(|e| {
                                flat.equations[self.dae.equations[e].origin].block == Some(b.0)
                            })
                        })
                        .count()
                };
                let (across, through) = (by_part(&p.across.1), by_part(&p.through.1));
                let name = |(n, _): &(String, Vec<u32>), role: &str| format!("{role} {n}");
                let declared =
                    if p.gives_across { name(&p.across, "across") } else { name(&p.through, "through") };
                let actual = match (across, through) {
                    (0, 0) => "nothing".to_string(),
                    (_, 0) => name(&p.across, "across"),
                    (0, _) => name(&p.through, "through"),
                    _ => {
                        format!("{} and {} (in part)", name(&p.across, "across"), name(&p.through, "through"))
                    }
                };
                report.ports.push(PortCausality {
                    port: if b.1.path.is_empty() {
                        p.name.clone()
                    } else {
                        format!("{}.{}", b.1.path, p.name)
                    },
                    joint: p
                        .coupling
                        .and_then(|c| flat.couplings.get(c))
                        .map_or(String::new(), |c| c.name.clone()),
                    turned: actual != declared,
                    declared,
                    actual,
                });
            }
        }
        report.loops = loops(&edges, &owner)
            .into_iter()
            .map(|l| l.into_iter().map(|k| name_of(&flat, unknown[k])).collect())
            .collect();
        report.dependent_states =
            self.dae.dependent.iter().map(|d| flat.variables[d.0 as usize].name.clone()).collect();
        report
    }
}

fn unknown_sorted(unknown: &[u32]) {
    debug_assert!(unknown.windows(2).all(|w| w[0] < w[1]));
}

/// Strongly connected unknowns (Tarjan 1972, SIAM J. Comput. 1, 146), without recursion.
fn loops(edges: &[Vec<usize>], owner: &[Option<usize>]) -> Vec<Vec<usize>> {
    let n = owner.len();
    let next = |u: usize| owner[u].map_or(&[][..], |e| &edges[e][..]);
    let (mut index, mut low, mut on) = (vec![usize::MAX; n], vec![0; n], vec![false; n]);
    let (mut stack, mut found, mut count) = (Vec::new(), Vec::new(), 0);
    for root in 0..n {
        if index[root] != usize::MAX {
            continue;
        }
        let mut work = vec![(root, 0usize)];
        while let Some((u, at)) = work.pop() {
            if at == 0 {
                index[u] = count;
                low[u] = count;
                count += 1;
                stack.push(u);
                on[u] = true;
            }
            let mut descended = false;
            for k in at..next(u).len() {
                let v = next(u)[k];
                if index[v] == usize::MAX {
                    work.push((u, k + 1));
                    work.push((v, 0));
                    descended = true;
                    break;
                }
                if on[v] {
                    low[u] = low[u].min(index[v]);
                }
            }
            if descended {
                continue;
            }
            if low[u] == index[u] {
                let mut group = Vec::new();
                while let Some(v) = stack.pop() {
                    on[v] = false;
                    group.push(v);
                    if v == u {
                        break;
                    }
                }
                if group.len() > 1 {
                    group.sort_unstable();
                    found.push(group);
                }
            }
            if let Some((parent, _)) = work.last() {
                low[*parent] = low[*parent].min(low[u]);
            }
        }
    }
    found.sort_by_key(|g: &Vec<usize>| std::cmp::Reverse(g.len()));
    found
}
