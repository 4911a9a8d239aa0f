//! Expressions as a flat list of instructions over a register file: what runs in the step. No allocation, no
//! recursion; equal subexpressions are computed once, constants stand in their registers from the start. The list is
//! cut into phases, so that values are to be had without the derivatives that follow them.

use std::collections::BTreeMap;

use crate::calculus::multiply_power;
use crate::pool::{Fun, Id, Node, Pool};
use crate::tables::Table;

#[derive(Debug, Clone, Copy)]
enum Step {
    /// r[to] = k * r[a]
    Scale {
        to: u32,
        a: u32,
        k: f64,
    },
    /// r[to] = j * r[a] + k * r[b]
    Combine {
        to: u32,
        a: u32,
        b: u32,
        j: f64,
        k: f64,
    },
    /// r[to] = r[a] + k * r[b]
    AddScaled {
        to: u32,
        a: u32,
        b: u32,
        k: f64,
    },
    /// r[to] = k * r[a] + c
    Affine {
        to: u32,
        a: u32,
        k: f64,
        c: f64,
    },
    /// r[to] = r[a] + k
    AddConstant {
        to: u32,
        a: u32,
        k: f64,
    },
    Multiply {
        to: u32,
        a: u32,
        b: u32,
    },
    Divide {
        to: u32,
        a: u32,
        b: u32,
    },
    /// r[to] = r[a]^k
    Power {
        to: u32,
        a: u32,
        k: f64,
    },
    Abs {
        to: u32,
        a: u32,
    },
    Exp {
        to: u32,
        a: u32,
    },
    Sign {
        to: u32,
        a: u32,
    },
    Min {
        to: u32,
        a: u32,
        b: u32,
    },
    Max {
        to: u32,
        a: u32,
        b: u32,
    },
    LessEqual {
        to: u32,
        a: u32,
        b: u32,
    },
    If {
        to: u32,
        a: u32,
        b: u32,
        c: u32,
    },
    One {
        to: u32,
        fun: Fun,
        a: u32,
    },
    Two {
        to: u32,
        fun: Fun,
        a: u32,
        b: u32,
    },
    Table {
        to: u32,
        table: u32,
        along: u8,
        a: u32,
        b: u32,
    },
    /// r[to], r[to + 1] = derivatives of a table of two arguments
    Gradient {
        to: u32,
        table: u32,
        a: u32,
        b: u32,
    },
}

/// A compiled list of expressions of some leaves.
#[derive(Debug, Clone, Default)]
pub(crate) struct Program {
    steps: Vec<Step>,
    registers: usize,
    outputs: Vec<u32>,
    constants: Vec<(u32, f64)>,
    /// Where each phase ends in `steps`.
    ends: Vec<usize>,
    /// Gradients already asked for: table, arguments, first register.
    gradients: Vec<(u32, u32, u32, u32)>,
}

impl Program {
    /// Compiles `roots`; `leaf` gives the input position of a variable, rate or time. What each group of `groups` needs
    /// comes before what the next needs; what is in no group comes last.
    pub fn compile(
        pool: &Pool,
        roots: &[Id],
        groups: &[Vec<Id>],
        inputs: usize,
        leaf: &dyn Fn(&Node) -> Option<usize>,
    ) -> Program {
        let mut p = Program { registers: inputs, ..Program::default() };
        let mut at: BTreeMap<Id, u32> = BTreeMap::new();
        for group in groups.iter().map(Vec::as_slice).chain([roots]) {
            for id in pool.below(group) {
                if !at.contains_key(&id) {
                    let register = p.emit(pool, id, &at, leaf);
                    at.insert(id, register);
                }
            }
            p.ends.push(p.steps.len());
        }
        p.outputs = roots.iter().map(|r| at[r]).collect();
        p.fuse();
        p
    }

    /// A scaled value that is used once, by the next step's sum, becomes part of it.
    fn fuse(&mut self) {
        let mut uses = vec![0u32; self.registers];
        for o in &self.outputs {
            uses[*o as usize] += 1;
        }
        for step in &self.steps {
            step.reads(&mut |r| uses[r as usize] += 1);
        }
        let mut kept: Vec<Step> = Vec::with_capacity(self.steps.len());
        let mut ends = Vec::with_capacity(self.ends.len());
        let mut phase = 0;
        for (k, step) in self.steps.iter().enumerate() {
            while phase < self.ends.len() && self.ends[phase] == k {
                ends.push(kept.len());
                phase += 1;
            }
            let floor = ends.last().copied().unwrap_or(0);
            let fused = match (kept.last().copied(), *step) {
                (Some(Step::Scale { to: s, a, k: j }), Step::AddScaled { to, a: sa, b, k })
                    if kept.len() > floor && sa == s && b != s && uses[s as usize] == 1 =>
                {
                    Some(Step::Combine { to, a, b, j, k })
                }
                (Some(Step::Scale { to: s, a, k }), Step::AddConstant { to, a: sa, k: c })
                    if kept.len() > floor && sa == s && uses[s as usize] == 1 =>
                {
                    Some(Step::Affine { to, a, k, c })
                }
                _ => None,
            };
            match fused {
                Some(f) => {
                    kept.pop();
                    kept.push(f);
                }
                None => kept.push(*step),
            }
        }
        while phase < self.ends.len() {
            ends.push(kept.len());
            phase += 1;
        }
        self.steps = kept;
        self.ends = ends;
    }

    fn fresh(&mut self) -> u32 {
        self.registers += 1;
        (self.registers - 1) as u32
    }

    fn power(&mut self, a: u32, e: f64) -> u32 {
        if e == 1.0 {
            return a;
        }
        let to = self.fresh();
        self.steps.push(if e == 2.0 { Step::Multiply { to, a, b: a } } else { Step::Power { to, a, k: e } });
        to
    }

    fn emit(
        &mut self,
        pool: &Pool,
        id: Id,
        at: &BTreeMap<Id, u32>,
        leaf: &dyn Fn(&Node) -> Option<usize>,
    ) -> u32 {
        match pool.node(id) {
            Node::Number(n) => {
                let to = self.fresh();
                self.constants.push((to, *n));
                to
            }
            node @ (Node::Parameter(_) | Node::Variable(_) | Node::Rate(_) | Node::Time) => {
                let position = leaf(node);
                // Parameters are numbers by now and all other leaves are inputs: anything else is our mistake.
                assert!(position.is_some(), "leaf {node:?} has no place");
                position.unwrap_or(0) as u32
            }
            Node::Sum(terms, c) => {
                let (first, k) = terms[0];
                let mut last = at[&first];
                if k != 1.0 {
                    let to = self.fresh();
                    self.steps.push(Step::Scale { to, a: last, k });
                    last = to;
                }
                for (t, k) in &terms[1..] {
                    let to = self.fresh();
                    self.steps.push(Step::AddScaled { to, a: last, b: at[t], k: *k });
                    last = to;
                }
                if *c != 0.0 {
                    let to = self.fresh();
                    self.steps.push(Step::AddConstant { to, a: last, k: *c });
                    last = to;
                }
                last
            }
            Node::Product(factors) => {
                let mut last: Option<u32> = None;
                for (t, e) in factors {
                    let a = at[t];
                    last = Some(match (last, *e) {
                        (Some(l), -1.0) => {
                            let to = self.fresh();
                            self.steps.push(Step::Divide { to, a: l, b: a });
                            to
                        }
                        (Some(l), e) => {
                            let b = self.power(a, e);
                            let to = self.fresh();
                            self.steps.push(Step::Multiply { to, a: l, b });
                            to
                        }
                        (None, e) => self.power(a, e),
                    });
                }
                last.unwrap_or(0)
            }
            Node::Call(Fun::Norm, args) => {
                // sqrt of the sum of squares, spelt out: any number of arguments.
                let mut sum: Option<u32> = None;
                for a in args {
                    let (square, a) = (self.fresh(), at[a]);
                    self.steps.push(Step::Multiply { to: square, a, b: a });
                    sum = Some(match sum {
                        None => square,
                        Some(s) => {
                            let to = self.fresh();
                            self.steps.push(Step::AddScaled { to, a: s, b: square, k: 1.0 });
                            to
                        }
                    });
                }
                let to = self.fresh();
                self.steps.push(Step::Power { to, a: sum.unwrap_or(0), k: 0.5 });
                to
            }
            Node::Call(fun, args) => {
                let to = self.fresh();
                let place = |k: usize| args.get(k).map_or(0, |id| at[id]);
                let (a, b, c) = (place(0), place(1), place(2));
                self.steps.push(match fun {
                    Fun::Abs => Step::Abs { to, a },
                    Fun::Exp => Step::Exp { to, a },
                    Fun::Sign => Step::Sign { to, a },
                    Fun::Min => Step::Min { to, a, b },
                    Fun::Max => Step::Max { to, a, b },
                    Fun::LessEqual => Step::LessEqual { to, a, b },
                    Fun::If => Step::If { to, a, b, c },
                    _ if args.len() == 1 => Step::One { to, fun: *fun, a },
                    _ => Step::Two { to, fun: *fun, a, b },
                });
                to
            }
            Node::Table { table, along, args } => {
                let a = at[&args[0]];
                let b = args.get(1).map_or(a, |b| at[b]);
                if args.len() == 2 && *along > 0 {
                    let found = self.gradients.iter().find(|g| (g.0, g.1, g.2) == (*table, a, b));
                    let to = match found {
                        Some(g) => g.3,
                        None => {
                            let to = self.fresh();
                            self.fresh();
                            self.steps.push(Step::Gradient { to, table: *table, a, b });
                            self.gradients.push((*table, a, b, to));
                            to
                        }
                    };
                    return to + u32::from(*along) - 1;
                }
                let to = self.fresh();
                self.steps.push(Step::Table { to, table: *table, along: *along, a, b });
                to
            }
        }
    }

    /// A register file for it: inputs come first, constants are in place. At least `least` long.
    pub fn new_registers(&self, least: usize) -> Vec<f64> {
        let mut r = vec![0.0; self.registers.max(least)];
        for (to, k) in &self.constants {
            r[*to as usize] = *k;
        }
        r
    }

    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// Runs all of it over registers of [`Program::new_registers`] whose first entries are the inputs.
    pub fn run(&self, r: &mut [f64], tables: &[Table]) {
        execute(&self.steps, r, tables);
    }

    /// Runs the phases from `from` up to, not including, `to`.
    #[inline]
    pub fn run_phases(&self, from: usize, to: usize, r: &mut [f64], tables: &[Table]) {
        let start = if from == 0 { 0 } else { self.ends[from - 1] };
        let end = if to == 0 { 0 } else { self.ends[to - 1] };
        execute(&self.steps[start..end], r, tables);
    }

    /// Number of phases: one for each group, and the rest.
    pub fn phases(&self) -> usize {
        self.ends.len()
    }

    /// Output `k` after a run.
    #[inline]
    pub fn output(&self, r: &[f64], k: usize) -> f64 {
        r[self.outputs[k] as usize]
    }
}

impl Step {
    fn reads(&self, see: &mut dyn FnMut(u32)) {
        use Step::*;
        match *self {
            Scale { a, .. } | Affine { a, .. } | AddConstant { a, .. } | Power { a, .. } => see(a),
            Abs { a, .. } | Exp { a, .. } | Sign { a, .. } | One { a, .. } => see(a),
            Combine { a, b, .. } | AddScaled { a, b, .. } | Multiply { a, b, .. } | Divide { a, b, .. } => {
                see(a);
                see(b);
            }
            Min { a, b, .. } | Max { a, b, .. } | LessEqual { a, b, .. } | Two { a, b, .. } => {
                see(a);
                see(b);
            }
            Table { a, b, .. } | Gradient { a, b, .. } => {
                see(a);
                see(b);
            }
            If { a, b, c, .. } => {
                see(a);
                see(b);
                see(c);
            }
        }
    }
}

fn execute(steps: &[Step], r: &mut [f64], tables: &[Table]) {
    for step in steps {
        let (to, value) = match *step {
            Step::Scale { to, a, k } => (to, k * r[a as usize]),
            Step::Combine { to, a, b, j, k } => (to, j * r[a as usize] + k * r[b as usize]),
            Step::AddScaled { to, a, b, k } => (to, r[a as usize] + k * r[b as usize]),
            Step::Affine { to, a, k, c } => (to, k * r[a as usize] + c),
            Step::AddConstant { to, a, k } => (to, r[a as usize] + k),
            Step::Multiply { to, a, b } => (to, r[a as usize] * r[b as usize]),
            Step::Divide { to, a, b } => (to, r[a as usize] / r[b as usize]),
            Step::Power { to, a, k } => (to, multiply_power(1.0, r[a as usize], k)),
            Step::Abs { to, a } => (to, r[a as usize].abs()),
            // Far below, the library's exp takes its slow way to the same zero.
            Step::Exp { to, a } => (to, if r[a as usize] < -746.0 { 0.0 } else { r[a as usize].exp() }),
            Step::Sign { to, a } => (to, Fun::Sign.apply(&[r[a as usize]])),
            Step::Min { to, a, b } => (to, r[a as usize].min(r[b as usize])),
            Step::Max { to, a, b } => (to, r[a as usize].max(r[b as usize])),
            Step::LessEqual { to, a, b } => (to, f64::from(u8::from(r[a as usize] <= r[b as usize]))),
            Step::If { to, a, b, c } => {
                (to, if r[a as usize] != 0.0 { r[b as usize] } else { r[c as usize] })
            }
            Step::One { to, fun, a } => (to, fun.apply(&[r[a as usize]])),
            Step::Two { to, fun, a, b } => (to, fun.apply(&[r[a as usize], r[b as usize]])),
            Step::Table { to, table, along, a, b } => {
                (to, tables[table as usize].look_up(&[r[a as usize], r[b as usize]], along))
            }
            Step::Gradient { to, table, a, b } => {
                let [x, y] = tables[table as usize].gradient(r[a as usize], r[b as usize]);
                r[to as usize] = x;
                (to + 1, y)
            }
        };
        r[to as usize] = value;
    }
}
