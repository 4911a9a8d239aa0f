//! What can go wrong: in assembling a mechanism (typed errors), and in a tick (plain data, never a panic).

/// Why a position analysis did not give a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum Reason {
    /// An input is not finite.
    NotFinite = 1,
    /// No pose meets the constraints (a link cannot reach), or Newton did not get there.
    OutOfReach = 2,
    /// The Jacobian is singular: a dead point or redundant constraints.
    Singular = 3,
    /// Newton got to a pose on the far side of a dead point.
    WrongBranch = 4,
}

impl Reason {
    /// For people.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::NotFinite => "input is not finite",
            Self::OutOfReach => "no pose reaches the input",
            Self::Singular => "constraints are singular",
            Self::WrongBranch => "pose lies beyond a dead point",
        }
    }
}

/// A failed position analysis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Failure {
    /// Why.
    pub reason: Reason,
    /// The constraint that is worst off, by its index in the mechanism.
    pub constraint: Option<usize>,
    /// Newton steps taken.
    pub iterations: u32,
    /// Largest |Φ| left. [m or m² or -]
    pub residual: f64,
}

/// A successful position analysis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Solved {
    /// Newton steps taken.
    pub iterations: u32,
    /// Largest |Φ| left. [m or m² or -]
    pub residual: f64,
}

/// A mechanism or suspension that cannot be assembled.
#[derive(Debug, Clone, PartialEq)]
pub enum AssemblyError {
    /// The axle breaks its own rules.
    Axle(Vec<config::Broken>),
    /// Not as many equations as coordinates.
    NotDetermined {
        /// Which mechanism.
        mechanism: String,
        /// Six per body.
        coordinates: usize,
        /// Scalar equations.
        rows: usize,
    },
    /// These constraints say again what others say, or contradict them, at design.
    Redundant {
        /// Which mechanism.
        mechanism: String,
        /// Names of the constraints.
        constraints: Vec<String>,
    },
    /// A constraint is not met by the design poses.
    NotClosed {
        /// Which mechanism.
        mechanism: String,
        /// Name of the constraint.
        constraint: String,
        /// Its |Φ|.
        residual: f64,
    },
    /// A direction or length that a joint needs is degenerate.
    Degenerate {
        /// What.
        what: String,
    },
}

impl std::fmt::Display for AssemblyError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Axle(broken) => {
                let lines: Vec<String> = broken.iter().map(|b| format!("{}: {}", b.key, b.rule)).collect();
                write!(f, "{}", lines.join("; "))
            }
            Self::NotDetermined { mechanism, coordinates, rows } => {
                write!(f, "{mechanism}: {rows} equations for {coordinates} coordinates")
            }
            Self::Redundant { mechanism, constraints } => {
                write!(f, "{mechanism}: redundant or singular at design: {}", constraints.join(", "))
            }
            Self::NotClosed { mechanism, constraint, residual } => {
                write!(f, "{mechanism}: {constraint} is not met at design (off by {residual:.3e})")
            }
            Self::Degenerate { what } => write!(f, "{what} has no direction or length"),
        }
    }
}

impl std::error::Error for AssemblyError {}
