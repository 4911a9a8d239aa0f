//! What can be wrong with an FMU or with what is asked of it.

use std::path::PathBuf;

/// A fault of an FMU, or of a binding to it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FmuError {
    /// The file system refused.
    Io {
        /// File or folder.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The file is not a sound zip archive.
    Zip {
        /// File.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// `modelDescription.xml` is missing, not XML, or lacks what FMI demands.
    Xml {
        /// What is wrong, with its line where it has one.
        why: String,
    },
    /// Another version of FMI.
    Version {
        /// As the file says it.
        found: String,
    },
    /// A model-exchange or scheduled-execution FMU.
    NotCoSimulation,
    /// It needs a tool that is not here.
    NeedsTool {
        /// The tool that made it.
        tool: String,
    },
    /// There is no binary for this machine in it.
    WrongPlatform {
        /// Folder that is needed.
        needed: String,
        /// Folders that are there.
        present: Vec<String>,
    },
    /// The binary cannot be loaded.
    Load {
        /// Name of the binary.
        library: String,
        /// What the loader says.
        why: String,
    },
    /// The binary lacks functions of FMI.
    MissingSymbols {
        /// Name of the binary.
        library: String,
        /// Functions.
        names: Vec<String>,
    },
    /// It embeds a Python interpreter: collection pauses and a global lock have no place in a real-time loop.
    Python {
        /// How that was seen.
        sign: String,
    },
    /// It has no variable of this name.
    UnknownVariable {
        /// As asked.
        name: String,
        /// The closest one that it has.
        near: Option<String>,
    },
    /// The variable is there, but not for this use.
    Causality {
        /// Variable.
        name: String,
        /// What it is.
        is: String,
        /// What was wanted.
        wanted: &'static str,
    },
    /// A type that cannot be bound (text, binary, clock, array).
    Kind {
        /// Variable.
        name: String,
        /// Its type.
        is: String,
        /// What was wanted.
        wanted: String,
    },
    /// The units are of different quantities.
    UnitMismatch {
        /// Variable.
        name: String,
        /// Its unit.
        unit: String,
        /// The unit at the other end.
        other: String,
    },
    /// A unit whose meaning neither the FMU nor this program states.
    UnitUnknown {
        /// Variable.
        name: String,
        /// Its unit.
        unit: String,
    },
    /// The FMU does not say the variable's unit and the scenario does not either.
    UnitMissing {
        /// Variable.
        name: String,
        /// The unit at the other end.
        other: String,
    },
    /// A start value or parameter that does not fit.
    Value {
        /// Variable.
        name: String,
        /// Rule.
        rule: String,
    },
    /// The length of a step suits the FMU not.
    Step {
        /// Rule.
        rule: String,
    },
    /// A function of the FMU reported a failure.
    Call {
        /// Function.
        function: &'static str,
        /// Status in words.
        status: &'static str,
        /// What the FMU said, last lines.
        said: String,
    },
    /// As the process that runs the FMU told it.
    Told {
        /// In words.
        text: String,
    },
    /// The process that ran the FMU is gone.
    Died {
        /// How it ended.
        how: String,
    },
    /// The FMU did not answer.
    Hung {
        /// After this time. [ms]
        waited_ms: u64,
    },
}

impl std::fmt::Display for FmuError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Io { path, why } => write!(f, "{}: {why}", path.display()),
            Self::Zip { path, why } => write!(f, "{}: not a sound zip archive: {why}", path.display()),
            Self::Xml { why } => write!(f, "modelDescription.xml: {why}"),
            Self::Version { found } => write!(f, "fmiVersion = \"{found}\": must be 2.0 or 3.0"),
            Self::NotCoSimulation => write!(f, "not a co-simulation FMU: <CoSimulation> is missing"),
            Self::NeedsTool { tool } => write!(f, "needs the tool that made it ({tool}) to run"),
            Self::WrongPlatform { needed, present } => {
                let has = if present.is_empty() { "none".to_owned() } else { present.join(", ") };
                write!(f, "no binary for this machine: needs binaries/{needed}, has {has}")
            }
            Self::Load { library, why } => write!(f, "{library}: cannot be loaded: {why}"),
            Self::MissingSymbols { library, names } => {
                write!(f, "{library}: lacks functions that FMI demands: {}", names.join(", "))
            }
            Self::Python { sign } => {
                write!(f, "runs Python ({sign}): allowed in lockstep only, never in real time")
            }
            Self::UnknownVariable { name, near } => {
                write!(f, "{name}: no such variable")?;
                near.as_ref().map_or(Ok(()), |near| write!(f, "; did you mean {near}?"))
            }
            Self::Causality { name, is, wanted } => write!(f, "{name}: is {is}, must be {wanted}"),
            Self::Kind { name, is, wanted } => write!(f, "{name}: is {is}, must be {wanted}"),
            Self::UnitMismatch { name, unit, other } => {
                write!(f, "{name}: unit {unit} and {other} are not of one quantity")
            }
            Self::UnitUnknown { name, unit } => write!(
                f,
                "{name}: what unit {unit} means is not known: the FMU gives no BaseUnit for it; say it with \
                 units.{name}"
            ),
            Self::UnitMissing { name, other } => {
                write!(f, "{name}: the FMU states no unit; say it with units.{name} (other end: {other})")
            }
            Self::Value { name, rule } => write!(f, "{name}: {rule}"),
            Self::Step { rule } => write!(f, "step: {rule}"),
            Self::Call { function, status, said } => {
                write!(f, "{function} returned {status}")?;
                if said.is_empty() { Ok(()) } else { write!(f, "; it said: {said}") }
            }
            Self::Told { text } => f.write_str(text),
            Self::Died { how } => write!(f, "its process died: {how}"),
            Self::Hung { waited_ms } => write!(f, "it did not come back from a call within {waited_ms} ms"),
        }
    }
}

impl std::error::Error for FmuError {}
