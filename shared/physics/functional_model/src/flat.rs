//! The flattened model: every part's scalar variables and equations side by side, couplings written out. This is
//! what composition works on and what error messages are phrased from.

use crate::error::Place;
use crate::pool::{Id, Pool};
use crate::tables::Table;
use crate::units::Unit;

/// What a scalar variable is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    State,
    Algebraic,
    /// Given from outside.
    Input,
    /// Given by a mechanism once a sample and held in between.
    Sampled,
}

#[derive(Debug, Clone)]
pub(crate) struct Variable {
    pub name: String,
    pub kind: Kind,
    pub unit: Unit,
    /// Index into `Flat::blocks`.
    pub block: Option<usize>,
    pub start: Option<f64>,
    pub start_place: Place,
    /// Made a state only because its rate is needed; the first to become dependent again.
    pub promoted: bool,
}

/// What the author says an equation is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Gives {
    Variable(u32),
    Rate(u32),
    Nothing,
}

/// residual = 0
#[derive(Debug, Clone)]
pub(crate) struct Equation {
    pub residual: Id,
    pub block: Option<usize>,
    /// For instance `row vF of road` or `coupling motor.shaft - tyre.axle`.
    pub label: String,
    pub gives: Gives,
    pub place: Place,
}

#[derive(Debug, Clone)]
pub(crate) struct Port {
    pub name: String,
    pub across: (String, Vec<u32>),
    pub through: (String, Vec<u32>),
    pub gives_across: bool,
    /// Never turned or lifted by frames.
    pub scalar: bool,
    pub unit: (Unit, Unit),
    /// Joined to (index into couplings).
    pub coupling: Option<usize>,
    pub place: Place,
}

impl Port {
    /// +1 when power v*f leaves the block (it gives across), -1 when it enters.
    pub fn sign(&self) -> f64 {
        if self.gives_across { 1.0 } else { -1.0 }
    }
}

/// A part with equations.
#[derive(Debug, Clone)]
pub(crate) struct Block {
    pub path: String,
    pub ports: Vec<Port>,
    pub energy: Option<Id>,
    pub loss: Option<Id>,
    pub supply: Option<Id>,
    pub place: Place,
}

#[derive(Debug, Clone)]
pub(crate) struct Coupling {
    /// `motor.shaft - tyre.axle`, or `outside` for an open port.
    pub name: String,
    /// Block and port indices.
    pub members: Vec<(usize, usize)>,
    /// An open port's outside pair, in the outermost frame: across and through variables, and the sign with which
    /// power v*f leaves the model.
    pub outside: Option<(Vec<u32>, Vec<u32>, f64)>,
}

#[derive(Debug, Clone)]
pub(crate) struct Mechanism {
    /// Sampled variables and their rules.
    pub gives: Vec<(u32, Id)>,
    pub hold: Option<Id>,
}

#[derive(Debug, Clone)]
pub(crate) struct Observation {
    pub name: String,
    pub part: Id,
    pub unit: Unit,
}

/// A vector state kept in a frame whose direction changes at samples: its components are re-expressed then.
#[derive(Debug, Clone)]
pub(crate) struct SampledFrame {
    pub states: Vec<u32>,
    /// d x d, guest to ground.
    pub rotation: Vec<Id>,
}

/// One frame or part for the diagram.
#[derive(Debug, Clone)]
pub(crate) struct Box {
    pub name: String,
    pub path: String,
    pub dim: usize,
    pub parent: Option<usize>,
    pub block: Option<usize>,
    /// How it sits in its host, as the author wrote it.
    pub placed: String,
}

#[derive(Debug, Clone)]
pub(crate) struct Parameter {
    pub name: String,
    pub unit: Unit,
    pub value: f64,
}

#[derive(Default)]
pub(crate) struct Flat {
    pub pool: Pool,
    pub tables: Vec<Table>,
    pub parameters: Vec<Parameter>,
    pub variables: Vec<Variable>,
    pub equations: Vec<Equation>,
    pub blocks: Vec<Block>,
    pub couplings: Vec<Coupling>,
    pub mechanisms: Vec<Mechanism>,
    pub observations: Vec<Observation>,
    /// Scalar inputs and the outputs the open ports give back, in file order.
    pub inputs: Vec<u32>,
    pub outputs: Vec<u32>,
    pub sampled_frames: Vec<SampledFrame>,
    pub boxes: Vec<Box>,
    pub sample: Option<f64>,
    pub method: Option<(String, Place)>,
}

impl Flat {
    pub fn parameter_values(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.value).collect()
    }

    /// New variable; returns its index.
    pub fn variable(&mut self, name: String, kind: Kind, unit: Unit, block: Option<usize>) -> u32 {
        self.variables.push(Variable {
            name,
            kind,
            unit,
            block,
            start: None,
            start_place: Place::default(),
            promoted: false,
        });
        (self.variables.len() - 1) as u32
    }
}

/// `name`, or `name.x`, `name.y`, `name.z`.
pub(crate) fn component(name: &str, at: usize, of: usize) -> String {
    if of == 1 { name.to_string() } else { format!("{name}.{}", ["x", "y", "z"].get(at).unwrap_or(&"?")) }
}
