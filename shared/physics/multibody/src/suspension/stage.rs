//! One stage's solver: the general path or the structured one, behind the same four questions.

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::failure::{AssemblyError, Failure, Solved};
use crate::kinematics::{Kinematics, Limits};
use crate::mechanism::Mechanism;

use super::SolverPath;

/// A stage's mechanism with its solver.
#[derive(Debug, Clone)]
pub(super) enum Stage {
    General(Kinematics),
}

impl Stage {
    pub fn new(
        name: &str,
        mechanism: Mechanism,
        design: &[Pose],
        drives: &[Drive],
        _path: SolverPath,
    ) -> Result<Self, AssemblyError> {
        let general = Kinematics::new(name, mechanism, design, drives, Limits::STANDARD)?;
        Ok(Self::General(general))
    }

    pub fn mechanism(&self) -> &Mechanism {
        match self {
            Self::General(general) => general.mechanism(),
        }
    }

    pub fn rows(&self) -> &[Row] {
        match self {
            Self::General(general) => general.rows(),
        }
    }

    pub fn position(&mut self, poses: &mut [Pose], drives: &[Drive]) -> Result<Solved, Failure> {
        match self {
            Self::General(general) => general.position(poses, drives),
        }
    }

    pub fn velocity(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        match self {
            Self::General(general) => {
                general.prepare(poses, drives)?;
                general.velocity(drives, twists);
            }
        }
        Ok(())
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
            }
        }
        Ok(())
    }
}
