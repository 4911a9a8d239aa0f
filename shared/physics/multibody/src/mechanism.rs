//! A mechanism: bodies and the constraints between them, as data. Nothing here knows what it depicts.

use spatial::{Matrix3, Vector3, Wrench};

use crate::body::{Body, Placed, Pose, Twist};
use crate::constraint::{Constraint, Drive, Row};

/// Bodies and constraints, with the row numbering.
#[derive(Debug, Clone)]
pub struct Mechanism {
    bodies: Vec<Body>,
    constraints: Vec<Constraint>,
    first_row: Vec<usize>,
    constraint_of_row: Vec<usize>,
    rows: usize,
}

/// What a mechanism consists of, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Description {
    /// Names of the bodies.
    pub bodies: Vec<String>,
    /// Every constraint: kind, name, first body (`None` for the ground), second body, rows.
    pub constraints: Vec<ConstraintDescription>,
    /// Six per body.
    pub coordinates: usize,
    /// Scalar equations.
    pub rows: usize,
}

/// One constraint, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ConstraintDescription {
    /// Kind, as in the literature.
    pub kind: &'static str,
    /// Its name.
    pub name: String,
    /// First body; absent where the global frame is meant.
    pub body_i: Option<String>,
    /// Second body.
    pub body_j: String,
    /// Scalar equations.
    pub rows: usize,
}

impl Description {
    /// Equations by kind, in the order of first appearance: kind, number of constraints, rows in all.
    #[must_use]
    pub fn by_kind(&self) -> Vec<(&'static str, usize, usize)> {
        let mut kinds: Vec<(&'static str, usize, usize)> = Vec::new();
        for constraint in &self.constraints {
            match kinds.iter_mut().find(|(kind, _, _)| *kind == constraint.kind) {
                Some((_, count, rows)) => {
                    *count += 1;
                    *rows += constraint.rows;
                }
                None => kinds.push((constraint.kind, 1, constraint.rows)),
            }
        }
        kinds
    }
}

impl Mechanism {
    /// From bodies and constraints; bodies are named in constraints by their index.
    #[must_use]
    pub fn new(bodies: Vec<Body>, constraints: Vec<Constraint>) -> Self {
        assert!(constraints.iter().all(|c| c.i < bodies.len() && c.j < bodies.len()));
        assert!(constraints.iter().all(|c| c.kind.is_absolute() || c.i != c.j));
        let mut rows = 0;
        let mut first_row = Vec::with_capacity(constraints.len());
        for constraint in &constraints {
            first_row.push(rows);
            rows += constraint.kind.rows();
        }
        let of_row = |row| first_row.partition_point(|first| *first <= row) - 1;
        let constraint_of_row = (0..rows).map(of_row).collect();
        Self { bodies, constraints, first_row, constraint_of_row, rows }
    }

    /// The bodies.
    #[must_use]
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The constraints.
    #[must_use]
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// Six per body.
    #[must_use]
    pub fn coordinates(&self) -> usize {
        6 * self.bodies.len()
    }

    /// Scalar equations in all.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// First row of a constraint.
    #[must_use]
    pub fn first_row(&self, constraint: usize) -> usize {
        self.first_row[constraint]
    }

    /// The constraint to which a row belongs.
    #[must_use]
    pub fn constraint_of_row(&self, row: usize) -> usize {
        self.constraint_of_row[row]
    }

    /// What the mechanism consists of.
    #[must_use]
    pub fn describe(&self) -> Description {
        let name = |body: usize| self.bodies[body].name.clone();
        Description {
            bodies: (0..self.bodies.len()).map(name).collect(),
            constraints: self
                .constraints
                .iter()
                .map(|c| ConstraintDescription {
                    kind: c.kind.name(),
                    name: c.name.clone(),
                    body_i: (!c.kind.is_absolute()).then(|| name(c.i)),
                    body_j: name(c.j),
                    rows: c.kind.rows(),
                })
                .collect(),
            coordinates: self.coordinates(),
            rows: self.rows,
        }
    }

    /// Φ and Jacobian of every row at the given poses. `rows` must hold [`Self::rows`] entries.
    pub fn evaluate(&self, poses: &[Pose], drives: &[Drive], rows: &mut [Row]) {
        let placed: Vec<Placed> = poses.iter().map(Placed::new).collect();
        self.evaluate_placed(&placed, drives, rows);
    }

    pub(crate) fn evaluate_placed(&self, placed: &[Placed], drives: &[Drive], rows: &mut [Row]) {
        for (constraint, first) in self.constraints.iter().zip(&self.first_row) {
            constraint.evaluate(placed, drives, &mut rows[*first..*first + constraint.kind.rows()]);
        }
    }

    /// γ of every row. Allocates; for analyses off the tick.
    pub fn acceleration_right_side(
        &self,
        poses: &[Pose],
        twists: &[Twist],
        drives: &[Drive],
        out: &mut [f64],
    ) {
        let placed: Vec<Placed> = poses.iter().map(Placed::new).collect();
        for (constraint, first) in self.constraints.iter().zip(&self.first_row) {
            let rows = *first..*first + constraint.kind.rows();
            constraint.acceleration_right_side(&placed, twists, drives, &mut out[rows]);
        }
    }

    /// ν of every row.
    pub fn velocity_right_side(&self, drives: &[Drive], out: &mut [f64]) {
        for (constraint, first) in self.constraints.iter().zip(&self.first_row) {
            constraint.velocity_right_side(drives, &mut out[*first..*first + constraint.kind.rows()]);
        }
    }

    /// Row `r` of the Jacobian times the coordinates x, six per body.
    #[inline]
    pub(crate) fn row_product(&self, r: usize, row: &Row, x: &[f64]) -> f64 {
        let c = &self.constraints[self.constraint_of_row[r]];
        let (i, j) = (&x[6 * c.i..6 * c.i + 6], &x[6 * c.j..6 * c.j + 6]);
        let mut sum = 0.0;
        for k in 0..6 {
            // The first half of an absolute constraint's row is zero.
            sum += row.jac[k] * i[k] + row.jac[6 + k] * j[k];
        }
        sum
    }

    /// Columns of row entry `local` (0..12) of a constraint; `None` for the unused half of absolute ones.
    pub(crate) fn column(&self, constraint: usize, local: usize) -> Option<usize> {
        let c = &self.constraints[constraint];
        match (local < 6, c.kind.is_absolute()) {
            (true, true) => None,
            (true, false) => Some(6 * c.i + local),
            (false, _) => Some(6 * c.j + local - 6),
        }
    }

    /// The Jacobian as a dense row-major matrix, rows × coordinates.
    #[must_use]
    pub fn dense_jacobian(&self, rows: &[Row]) -> Vec<f64> {
        let n = self.coordinates();
        let mut dense = vec![0.0; self.rows * n];
        for (r, row) in rows.iter().enumerate() {
            let constraint = self.constraint_of_row(r);
            for local in 0..12 {
                if let Some(column) = self.column(constraint, local) {
                    dense[r * n + column] += row.jac[local];
                }
            }
        }
        dense
    }

    /// What constraint `constraint` does to body i (`on_i`) or j, −Φ_qᵀλ: force in the global frame,
    /// moment about the body's origin in the body frame.
    #[must_use]
    #[inline]
    pub fn action(&self, constraint: usize, rows: &[Row], lambda: &[f64], on_i: bool) -> Wrench {
        let mut total = [0.0; 6];
        let offset = if on_i { 0 } else { 6 };
        let first = self.first_row[constraint];
        for r in first..first + self.constraints[constraint].kind.rows() {
            for k in 0..6 {
                total[k] -= rows[r].jac[offset + k] * lambda[r];
            }
        }
        Wrench {
            force_n: Vector3::new(total[0], total[1], total[2]),
            moment_n_m: Vector3::new(total[3], total[4], total[5]),
        }
    }

    /// The same, as force and moment about the joint's point on that body, in the joint frame
    /// [eq. 3.114, 3.115 of the source: F'' = −CᵀAᵀΦ_rᵀλ, T'' = −Cᵀ(Φ_πᵀ + s̃'ᵀAᵀΦ_rᵀ)λ].
    #[must_use]
    pub fn joint_reaction(
        &self,
        constraint: usize,
        rows: &[Row],
        lambda: &[f64],
        poses: &[Pose],
        on_i: bool,
    ) -> Wrench {
        let c = &self.constraints[constraint];
        let action = self.action(constraint, rows, lambda, on_i);
        let a: Matrix3<f64> = poses[if on_i { c.i } else { c.j }].p.matrix();
        let axes = c.axes_on(on_i);
        let force = a.tr_mul(&action.force_n);
        let in_body = Wrench { force_n: force, moment_n_m: action.moment_n_m }.about(&c.point_on(on_i));
        in_body.expressed(&axes.transpose())
    }

    /// What is left of the balance of every body: Q − Φ_qᵀλ in [force, moment] per body; zero when the
    /// reactions carry the load.
    #[must_use]
    pub fn imbalance(&self, rows: &[Row], lambda: &[f64], load: &[f64]) -> Vec<f64> {
        let mut left = load.to_vec();
        for (r, row) in rows.iter().enumerate() {
            let constraint = self.constraint_of_row(r);
            for local in 0..12 {
                if let Some(column) = self.column(constraint, local) {
                    left[column] -= row.jac[local] * lambda[r];
                }
            }
        }
        left
    }
}
