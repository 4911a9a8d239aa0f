//! One stage's solver: the general path or the structured one, behind the same questions.

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::failure::{AssemblyError, Failure, Solved};
use crate::kinematics::{Kinematics, Limits};
use crate::mechanism::Mechanism;
use crate::structured::{Shared, Structured};

use super::SolverPath;

/// A stage's mechanism with its solver.
#[derive(Debug, Clone)]
pub(super) enum Stage {
    General(Box<Kinematics>),
    Structured(Box<Structured>),
}

impl Stage {
    /// The general solver checks the mechanism in any case; where no structure is found, it also serves.
    pub fn new(
        name: &str,
        mechanism: Mechanism,
        design: &[Pose],
        drives: &[Drive],
        path: SolverPath,
    ) -> Result<Self, AssemblyError> {
        let general = Kinematics::new(name, mechanism.clone(), design, drives, Limits::STANDARD)?;
        let structured = match path {
            SolverPath::Structured => Structured::new(mechanism, design, drives, Limits::STANDARD),
            SolverPath::General => None,
        };
        Ok(structured.map_or_else(|| Self::General(Box::new(general)), |s| Self::Structured(Box::new(s))))
    }

    pub fn mechanism(&self) -> &Mechanism {
        match self {
            Self::General(general) => general.mechanism(),
            Self::Structured(structured) => structured.mechanism(),
        }
    }

    pub fn rows(&self) -> &[Row] {
        match self {
            Self::General(general) => general.rows(),
            Self::Structured(structured) => structured.rows(),
        }
    }

    /// Rows that this stage evaluates for a pose and that `other` needs too; `other` is from now on given
    /// them by [`Self::borrow_rows`]. `same`: this stage's body for each body of the other.
    pub fn share_rows(&self, other: &mut Self, same: &[Option<usize>]) -> Vec<Shared> {
        match (self, other) {
            (Self::Structured(one), Self::Structured(other)) => one.share_rows(other, same),
            _ => Vec::new(),
        }
    }

    /// Takes over the rows in common.
    pub fn borrow_rows(&mut self, from: &[Row], shared: &[Shared]) {
        if let Self::Structured(structured) = self {
            structured.borrow_rows(from, shared);
        }
    }

    pub fn position(&mut self, poses: &mut [Pose], drives: &[Drive]) -> Result<Solved, Failure> {
        match self {
            Self::General(general) => general.position(poses, drives),
            Self::Structured(structured) => structured.position(poses, drives),
        }
    }

    /// Velocities at `poses`; `fresh` unless `position` has just ended there.
    pub fn velocity(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        fresh: bool,
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        match self {
            Self::General(general) => {
                if fresh {
                    general.prepare(poses, drives)?;
                }
                general.velocity(drives, twists)
            }
            Self::Structured(structured) => structured.velocity(poses, drives, fresh, twists),
        }
    }

    pub fn reactions(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        load: &[f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        match self {
            Self::General(general) => {
                general.prepare(poses, drives)?;
                general.reactions(load, lambda);
                Ok(())
            }
            Self::Structured(structured) => structured.reactions(poses, drives, load, lambda),
        }
    }
}
