//! Expressions as a flat list of instructions over a register file: what runs in the step. No allocation, no
//! recursion; equal subexpressions are computed once.

use std::collections::BTreeMap;

use crate::calculus::multiply_power;
use crate::pool::{Fun, Id, Node, Pool};
use crate::tables::Table;

#[derive(Debug, Clone, Copy)]
enum Step {
    /// r[to] = k
    Constant {
        to: u32,
        k: f64,
    },
    /// r[to] = k * r[a]
    Scale {
        to: u32,
        a: u32,
        k: f64,
    },
    /// r[to] = r[a] + k * r[b]
    AddScaled {
        to: u32,
        a: u32,
        b: u32,
        k: f64,
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
    Three {
        to: u32,
        fun: Fun,
        a: u32,
        b: u32,
        c: u32,
    },
    Table {
        to: u32,
        table: u32,
        along: u8,
        a: u32,
        b: u32,
    },
}

/// A compiled list of expressions of some leaves.
#[derive(Debug, Clone, Default)]
pub(crate) struct Program {
    inputs: usize,
    steps: Vec<Step>,
    registers: usize,
    outputs: Vec<u32>,
}

impl Program {
    /// Compiles `roots`; `leaf` gives the input position of a variable, rate or time.
    pub fn compile(
        pool: &Pool,
        roots: &[Id],
        inputs: usize,
        leaf: &dyn Fn(&Node) -> Option<usize>,
    ) -> Program {
        let mut p = Program { inputs, registers: inputs, ..Program::default() };
        let mut at: BTreeMap<Id, u32> = BTreeMap::new();
        for id in pool.below(roots) {
            let register = p.emit(pool, id, &at, leaf);
            at.insert(id, register);
        }
        p.outputs = roots.iter().map(|r| at[r]).collect();
        p
    }

    fn fresh(&mut self) -> u32 {
        self.registers += 1;
        (self.registers - 1) as u32
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
                self.steps.push(Step::Constant { to, k: *n });
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
                    let to = self.fresh();
                    match (last, *e) {
                        (Some(l), 1.0) => self.steps.push(Step::Multiply { to, a: l, b: a }),
                        (Some(l), -1.0) => self.steps.push(Step::Divide { to, a: l, b: a }),
                        (Some(l), e) => {
                            let power = to;
                            self.steps.push(Step::Power { to: power, a, k: e });
                            let product = self.fresh();
                            self.steps.push(Step::Multiply { to: product, a: l, b: power });
                            last = Some(product);
                            continue;
                        }
                        (None, e) => self.steps.push(Step::Power { to, a, k: e }),
                    }
                    last = Some(to);
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
                let step = match args[..] {
                    [a] => Step::One { to, fun: *fun, a: at[&a] },
                    [a, b] => Step::Two { to, fun: *fun, a: at[&a], b: at[&b] },
                    _ => Step::Three { to, fun: *fun, a: at[&args[0]], b: at[&args[1]], c: at[&args[2]] },
                };
                self.steps.push(step);
                to
            }
            Node::Table { table, along, args } => {
                let to = self.fresh();
                let a = at[&args[0]];
                let b = args.get(1).map_or(a, |b| at[b]);
                self.steps.push(Step::Table { to, table: *table, along: *along, a, b });
                to
            }
        }
    }

    /// Size of the register file; inputs come first.
    pub fn registers(&self) -> usize {
        self.registers
    }

    pub fn outputs(&self) -> usize {
        self.outputs.len()
    }

    /// Runs over registers whose first entries are the inputs.
    pub fn run(&self, r: &mut [f64], tables: &[Table]) {
        debug_assert!(r.len() >= self.registers && self.inputs <= self.registers);
        for step in &self.steps {
            match *step {
                Step::Constant { to, k } => r[to as usize] = k,
                Step::Scale { to, a, k } => r[to as usize] = k * r[a as usize],
                Step::AddScaled { to, a, b, k } => r[to as usize] = r[a as usize] + k * r[b as usize],
                Step::AddConstant { to, a, k } => r[to as usize] = r[a as usize] + k,
                Step::Multiply { to, a, b } => r[to as usize] = r[a as usize] * r[b as usize],
                Step::Divide { to, a, b } => r[to as usize] = r[a as usize] / r[b as usize],
                Step::Power { to, a, k } => r[to as usize] = multiply_power(1.0, r[a as usize], k),
                Step::One { to, fun, a } => r[to as usize] = fun.apply(&[r[a as usize]]),
                Step::Two { to, fun, a, b } => r[to as usize] = fun.apply(&[r[a as usize], r[b as usize]]),
                Step::Three { to, fun, a, b, c } => {
                    r[to as usize] = fun.apply(&[r[a as usize], r[b as usize], r[c as usize]]);
                }
                Step::Table { to, table, along, a, b } => {
                    r[to as usize] = tables[table as usize].look_up(&[r[a as usize], r[b as usize]], along);
                }
            }
        }
    }

    /// Output `k` after a run.
    #[inline]
    pub fn output(&self, r: &[f64], k: usize) -> f64 {
        r[self.outputs[k] as usize]
    }
}
