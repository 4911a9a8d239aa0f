//! What can be wrong with a model, in the words of its author: file and line, the part or coupling, and the
//! rule that was broken. All mistakes of one pass are collected before any is reported.

use std::fmt;

/// The kind of a mistake, so that a caller (or a test) can tell them apart without reading the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// The text is not valid TOML, or a key or value has a form the format does not know.
    Format,
    /// An expression cannot be read.
    Expression,
    /// A name that nothing declares.
    UnknownName,
    /// Quantities of different dimension are added, compared or assigned; or across x through is not power.
    Unit,
    /// Vectors, matrices or frames of different size meet.
    Dimension,
    /// A part has too few or too many equations for what it says it gives.
    EquationCount,
    /// A port is joined to nothing.
    Unconnected,
    /// A port is joined twice, or a part is placed by two hosts.
    TwoHosts,
    /// A model contains itself.
    CyclicNesting,
    /// A file named by the model could not be read.
    Resolve,
    /// A loop of equations that has no (unique) solution.
    SingularLoop,
    /// Rigidly joined storages that cannot be reduced.
    Irreducible,
    /// Start values that contradict a rigid join.
    Start,
    /// A parameter's value is outside what the model can use.
    Value,
    /// The chosen method does not fit the model.
    Method,
}

/// One mistake in a model file or its parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelError {
    /// Name of the file or text as given to [`crate::Model::from_toml`].
    pub file: String,
    /// Line in that file, from 1; 0 when the mistake has no single line.
    pub line: usize,
    /// The parts and ports concerned, for instance `car.tyre.rim`.
    pub place: String,
    /// Which rule was broken.
    pub rule: Rule,
    /// The sentence to show.
    pub message: String,
}

impl fmt::Display for ModelError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
        }
        if !self.place.is_empty() {
            write!(f, ": {}", self.place)?;
        }
        write!(f, ": {}", self.message)
    }
}

impl std::error::Error for ModelError {}

/// Where something was written.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Place {
    pub file: std::rc::Rc<str>,
    pub line: usize,
}

impl Place {
    pub fn error(&self, rule: Rule, place: impl Into<String>, message: impl Into<String>) -> ModelError {
        ModelError {
            file: self.file.to_string(),
            line: self.line,
            place: place.into(),
            rule,
            message: message.into(),
        }
    }
}
