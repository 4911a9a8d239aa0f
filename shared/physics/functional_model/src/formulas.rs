//! Plain formulas of named quantities, in the language of model files ([`crate`]), compiled once: for whoever wants
//! expressions with checked units without composing a model (user variables and outputs of the car).
//!
//! A formula may use the inputs and the formulas before it; a name that is both means the formula before it. So an
//! input named as a formula that stands later, or as itself, can carry the value of the last run.

use crate::expand::{Scope, Shape, Trouble, Value, distance, expand};
use crate::pool::{Id, Node, Pool};
use crate::program::Program;
use crate::syntax;
use crate::tables::Table;
use crate::units::Unit;

/// One formula: its name (empty: nobody can use it), the unit of its value, its text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Formula<'a> {
    /// Name for the formulas behind it.
    pub name: &'a str,
    /// Unit of the value, such as `N*m`; the value comes in it, and the formula must have its dimension.
    pub unit: &'a str,
    /// The expression.
    pub text: &'a str,
}

/// What is wrong with a formula.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormulaError {
    /// Which formula.
    pub index: usize,
    /// Whether its unit, not its text, is meant.
    pub in_unit: bool,
    /// The sentence to show.
    pub rule: String,
}

/// Compiled formulas with their registers.
#[derive(Debug, Clone)]
pub struct Formulas {
    program: Program,
    registers: Vec<f64>,
    inputs: usize,
    /// SI per unit of each result.
    scale: Vec<f64>,
    used: Vec<bool>,
}

impl Formulas {
    /// Compiles `formulas` of `inputs`, given by name and unit; a run takes their values in SI.
    ///
    /// # Errors
    /// Every mistake of every formula.
    pub fn compile(inputs: &[(&str, &str)], formulas: &[Formula<'_>]) -> Result<Self, Vec<FormulaError>> {
        let mut pool = Pool::default();
        let mut names: Vec<(&str, Value)> = Vec::with_capacity(inputs.len() + formulas.len());
        for (i, (name, unit)) in inputs.iter().enumerate() {
            // The caller's own names: a unit that cannot be read is our mistake, and checked by a test there.
            let unit = Unit::parse(unit).map_or(Unit::ONE, |(unit, _)| unit);
            names.push((name, Value::scalar(pool.variable(i), unit)));
        }
        let mut errors = Vec::new();
        let mut roots = Vec::new();
        let mut scale = Vec::new();
        for (index, formula) in formulas.iter().enumerate() {
            let mut wrong = |in_unit: bool, rule: String| errors.push(FormulaError { index, in_unit, rule });
            let unit = Unit::parse(formula.unit);
            let value = syntax::parse(formula.text).and_then(|ast| {
                expand(&ast, &mut pool, &Names(&names)).map_err(|trouble| match trouble {
                    Trouble::Unknown(m) | Trouble::Unit(m) | Trouble::Shape(m) | Trouble::Form(m) => m,
                })
            });
            let (unit, factor) = unit.unwrap_or_else(|rule| {
                wrong(true, rule);
                (Unit::ONE, 1.0)
            });
            // Something of the right kind goes on in place of a broken formula, so that its name is known.
            let mut id = pool.number(1.0);
            match value {
                Err(rule) => wrong(false, rule),
                Ok(Value { shape, .. }) if shape != Shape::Scalar => {
                    wrong(false, format!("must give a number, gives {shape}"));
                }
                Ok(value) if value.unit.is_some_and(|found| found != unit) => {
                    let rule = format!("must give {}, gives {}", formula.unit, value.unit_text());
                    wrong(false, rule);
                }
                Ok(value) => id = value.parts[0],
            }
            if !formula.name.is_empty() {
                names.push((formula.name, Value::scalar(id, unit)));
            }
            roots.push(id);
            scale.push(factor);
        }
        if !errors.is_empty() {
            return Err(errors);
        }
        let place = |node: &Node| match node {
            Node::Variable(i) => Some(*i as usize),
            _ => None,
        };
        let program = Program::compile(&pool, &roots, &[], inputs.len(), &place);
        let used = used(&pool, &roots, inputs.len());
        let registers = program.new_registers(inputs.len());
        Ok(Self { program, registers, inputs: inputs.len(), scale, used })
    }

    /// Whether any formula depends on an input.
    #[must_use]
    pub fn uses(&self, input: usize) -> bool {
        self.used[input]
    }

    /// Evaluates all formulas: `inputs` in SI, `results` each in its formula's unit. Touches no heap.
    pub fn run(&mut self, inputs: &[f64], results: &mut [f64]) {
        self.registers[..self.inputs].copy_from_slice(inputs);
        self.program.run(&mut self.registers, &[]);
        for (k, result) in results.iter_mut().enumerate().take(self.scale.len()) {
            *result = self.program.output(&self.registers, k) / self.scale[k];
        }
    }
}

/// SI per unit of a unit's text; `None` when it is not a unit.
#[must_use]
pub fn si_per_unit(unit: &str) -> Option<f64> {
    Unit::parse(unit).ok().map(|(_, scale)| scale)
}

/// The name that was probably meant.
pub fn closest<'a>(written: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let near = names.map(|name| (distance(name, written), name));
    near.filter(|(d, name)| *d <= 1 + name.len() / 4).min().map(|(_, name)| name)
}

fn used(pool: &Pool, roots: &[Id], inputs: usize) -> Vec<bool> {
    let mut used = vec![false; inputs];
    for id in pool.below(roots) {
        if let Node::Variable(i) = pool.node(id) {
            used[*i as usize] = true;
        }
    }
    used
}

struct Names<'a>(&'a [(&'a str, Value)]);

impl Scope for Names<'_> {
    fn name(&self, _: &mut Pool, name: &str) -> Option<Result<Value, Trouble>> {
        self.0.iter().rev().find(|(known, _)| *known == name).map(|(_, value)| Ok(value.clone()))
    }
    fn rate(&self, _: &mut Pool, _: &str) -> Option<Value> {
        None
    }
    fn table(&self, _: &str) -> Option<(u32, &Table)> {
        None
    }
    fn names(&self) -> Vec<String> {
        self.0.iter().map(|(name, _)| (*name).to_owned()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formula<'a>(name: &'a str, unit: &'a str, text: &'a str) -> Formula<'a> {
        Formula { name, unit, text }
    }

    #[test]
    fn formulas_use_inputs_and_those_before_them() {
        let inputs = [("force", "N"), ("speed", "m/s"), ("sum", "J")];
        let mut f = Formulas::compile(
            &inputs,
            &[
                formula("power", "kW", "force * speed"),
                // `sum` is not yet a formula here: the input, its last value.
                formula("sum", "J", "sum + power * 1 ms"),
                formula("", "1", "if(sum > 10 J, 1, 0)"),
            ],
        )
        .unwrap();
        let mut out = [0.0; 3];
        let mut sum = 0.0;
        for n in 1..=4 {
            f.run(&[2000.0, 2.0, sum], &mut out);
            sum = out[1];
            assert!((out[0] - 4.0).abs() < 1e-12 && (out[1] - 4.0 * f64::from(n)).abs() < 1e-12);
            assert_eq!(out[2], f64::from(u8::from(n > 2)));
        }
        assert!(f.uses(0) && f.uses(2));
    }

    #[test]
    fn every_mistake_of_every_formula_is_told() {
        let told = Formulas::compile(
            &[("force", "N"), ("speed", "m/s")],
            &[
                formula("a", "N", "force + speed"),
                formula("b", "N", "forec"),
                formula("c", "furlong", "force *"),
                formula("d", "N", "2 * a"),
                formula("e", "m", "force"),
                formula("f", "N", "[force, force]"),
            ],
        )
        .unwrap_err();
        let told: Vec<_> = told.iter().map(|e| (e.index, e.in_unit, e.rule.as_str())).collect();
        assert_eq!(told[0], (0, false, "cannot add N and m/s"));
        assert_eq!(told[1], (1, false, "nothing is called 'forec' here; did you mean 'force'?"));
        assert!(told[2].1 && told[2].2.contains("furlong"), "{told:?}");
        assert!(!told[3].1 && told[3].0 == 2, "{told:?}");
        assert_eq!(told[4], (4, false, "must give m, gives N"));
        assert_eq!(told[5], (5, false, "must give a number, gives a vector of 2"));
        assert_eq!(told.len(), 6);
    }
}
