//! The two ways in which a suspension is solved, behind the questions that a tick asks: two rigid stages,
//! or one elastic equilibrium.

use spatial::{Vector3, Wrench};

use crate::body::{Pose, Twist};
use crate::constraint::{Drive, Row};
use crate::equilibrium::Equilibrium;
use crate::failure::{Failure, Solved};
use crate::mechanism::Mechanism;

use super::model::{BODY, Follow, RACK};
use super::stage::Stage;
use crate::structured::Shared;

/// Solvers with their workspace.
#[derive(Debug, Clone)]
pub(super) enum Solver {
    /// Pose first, then forces at that pose.
    Rigid { kinematic: Stage, reaction: Box<Stage>, follow: Vec<Follow>, shared: Vec<Shared> },
    /// Both at once.
    Elastic { equilibrium: Box<Equilibrium>, wrenches: Vec<Wrench>, rack_design: Vector3<f64> },
}

impl Solver {
    /// The mechanism in whose constraints failures are named.
    pub fn pose_mechanism(&self) -> &Mechanism {
        match self {
            Self::Rigid { kinematic, .. } => kinematic.mechanism(),
            Self::Elastic { equilibrium, .. } => equilibrium.mechanism(),
        }
    }

    /// The mechanism of the forces.
    pub fn force_mechanism(&self) -> &Mechanism {
        match self {
            Self::Rigid { reaction, .. } => reaction.mechanism(),
            Self::Elastic { equilibrium, .. } => equilibrium.mechanism(),
        }
    }

    /// Rows of the force mechanism as evaluated last.
    pub fn force_rows(&self) -> &[Row] {
        match self {
            Self::Rigid { reaction, .. } => reaction.rows(),
            Self::Elastic { equilibrium, .. } => equilibrium.rows(),
        }
    }

    /// Pose at the drivers. `load` is used where pose and forces are one.
    pub fn position(
        &mut self,
        poses: &mut [Pose],
        drives: &[Drive],
        load: &mut [f64],
    ) -> Result<Solved, Failure> {
        match self {
            Self::Rigid { kinematic, .. } => kinematic.position(poses, drives),
            Self::Elastic { equilibrium, wrenches, rack_design } => {
                poses[BODY] = Pose::IDENTITY;
                poses[RACK] = Pose::at(*rack_design + Vector3::new(0.0, drives[0].value, 0.0));
                equilibrium.position(poses, drives, wrenches, load)
            }
        }
    }

    /// Velocities at `poses`; `fresh` unless `position` has just ended there.
    pub fn velocity(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        load: &[f64],
        fresh: bool,
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        match self {
            Self::Rigid { kinematic, .. } => kinematic.velocity(poses, drives, fresh, twists),
            Self::Elastic { equilibrium, .. } => {
                twists[BODY] = Twist::ZERO;
                twists[RACK] = Twist { v: Vector3::new(0.0, drives[0].speed, 0.0), omega: Vector3::zeros() };
                equilibrium.velocity(poses, drives, load, twists)
            }
        }
    }

    /// Poses of the force mechanism's bodies.
    pub fn follow(&self, poses: &[Pose], out: &mut [Pose]) {
        match self {
            Self::Rigid { follow, .. } => {
                for (pose, follow) in out.iter_mut().zip(follow) {
                    *pose = follow.pose(poses);
                }
            }
            Self::Elastic { .. } => out.copy_from_slice(poses),
        }
    }

    /// Multipliers of the force mechanism at its poses.
    pub fn reactions(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        load: &[f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        match self {
            Self::Rigid { kinematic, reaction, shared, .. } => {
                reaction.borrow_rows(kinematic.rows(), shared);
                reaction.reactions(poses, drives, load, lambda)
            }
            Self::Elastic { equilibrium, .. } => {
                lambda.copy_from_slice(equilibrium.lambda());
                Ok(())
            }
        }
    }
}
