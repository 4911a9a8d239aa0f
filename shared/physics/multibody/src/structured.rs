//! The structured path: the same analyses, part by part in the order in which the constraints determine
//! the bodies.
//!
//! The order is found from the constraints alone: bodies fixed to the ground and bodies that a driver
//! slides along a guide have their pose in closed form; then the smallest sets of bodies that have as many
//! constraints to already placed bodies (and among themselves) as coordinates, each a small dense block.
//! Positions and velocities go through the parts forwards, reactions (the transposed system) backwards.
//! The Jacobian is block-triangular in this order, so nothing is approximated.

use spatial::{EulerParameters, Vector3};

use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, Kind, ROWS_MAX, Row};
use crate::failure::{Failure, Reason, Solved};
use crate::kinematics::Limits;
use crate::linear::DenseLu;
use crate::mechanism::Mechanism;

/// Largest set of bodies that is looked for; what is larger goes to the general path.
const BLOCK_BODIES_MAX: usize = 3;

/// A block's constraint, its first row, its rows, and the block-local first column of bodies i and j.
type Member = (usize, usize, usize, Option<usize>, Option<usize>);

/// Bodies placed together, and the constraints that place them.
#[derive(Debug, Clone)]
struct Block {
    bodies: Vec<usize>,
    constraints: Vec<Member>,
    lu: DenseLu,
    rhs: Vec<f64>,
    design_positive: bool,
    factored: bool,
}

/// A body that a driver slides along a guide on a fixed body: closed form.
#[derive(Debug, Clone)]
struct Slide {
    body: usize,
    base: usize,
    /// Attitude relative to the base, and position at stroke 0 and direction, in the base's frame.
    attitude: EulerParameters,
    origin: Vector3<f64>,
    direction: Vector3<f64>,
    driver: usize,
    /// Guide and driver as a block; its Jacobian is constant in the base's frame.
    block: Block,
}

#[derive(Debug, Clone)]
enum Part {
    Fixed { body: usize, constraint: usize, pose: Pose },
    Slide(Box<Slide>),
    Block(Block),
}

/// A mechanism solved part by part.
#[derive(Debug, Clone)]
pub struct Structured {
    mechanism: Mechanism,
    parts: Vec<Part>,
    placed: Vec<Placed>,
    rows: Vec<Row>,
    load: Vec<f64>,
    limits: Limits,
}

impl Structured {
    /// Finds the order; `None` where the constraints give none (the general path then serves).
    #[must_use]
    pub fn new(mechanism: Mechanism, design: &[Pose], drives: &[Drive], limits: Limits) -> Option<Self> {
        let parts = order(&mechanism, design)?;
        let mut structured = Self {
            placed: design.iter().map(Placed::new).collect(),
            rows: vec![Row::ZERO; mechanism.rows()],
            load: vec![0.0; mechanism.coordinates()],
            mechanism,
            parts,
            limits,
        };
        structured.mechanism.evaluate_placed(&structured.placed, drives, &mut structured.rows);
        for part in &mut structured.parts {
            let block = match part {
                Part::Fixed { .. } => continue,
                Part::Slide(slide) => &mut slide.block,
                Part::Block(block) => block,
            };
            block.fill(&structured.rows);
            block.lu.factor().ok()?;
            block.design_positive = block.lu.determinant_positive();
        }
        Some(structured)
    }

    /// The mechanism.
    #[must_use]
    pub fn mechanism(&self) -> &Mechanism {
        &self.mechanism
    }

    /// Rows of the last evaluation.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Number of bodies in each block, in order; fixed and sliding bodies are not among them.
    #[must_use]
    pub fn block_sizes(&self) -> Vec<usize> {
        let size = |part: &Part| if let Part::Block(block) = part { Some(block.bodies.len()) } else { None };
        self.parts.iter().filter_map(size).collect()
    }

    /// Moves `poses` to where the constraints are met.
    ///
    /// # Errors
    /// As the general path's; iterations are those of the slowest block.
    pub fn position(&mut self, poses: &mut [Pose], drives: &[Drive]) -> Result<Solved, Failure> {
        let Self { mechanism, parts, placed, rows, limits, .. } = self;
        let mut total = Solved::default();
        for part in parts {
            match part {
                Part::Fixed { body, pose, .. } => {
                    poses[*body] = *pose;
                    placed[*body] = Placed::new(pose);
                }
                Part::Slide(slide) => {
                    let pose = slide.pose(&poses[slide.base], drives);
                    poses[slide.body] = pose;
                    placed[slide.body] = Placed::new(&pose);
                }
                Part::Block(block) => {
                    let solved = block.position(mechanism, poses, placed, rows, drives, limits)?;
                    total.iterations = total.iterations.max(solved.iterations);
                    total.residual = total.residual.max(solved.residual);
                }
            }
        }
        Ok(total)
    }

    /// Velocities. Right after `position` (and with its rows at hand) the last Newton step's factors serve,
    /// corrected twice; with `fresh` everything is evaluated and factored at `poses`.
    ///
    /// # Errors
    /// Singular, with the constraint.
    pub fn velocity(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        fresh: bool,
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        if fresh {
            self.evaluate(poses, drives);
        }
        let Self { mechanism, parts, rows, placed, .. } = self;
        for part in parts {
            match part {
                Part::Fixed { body, .. } => twists[*body] = Twist::ZERO,
                Part::Slide(slide) => {
                    let base = &placed[slide.base];
                    let reach = base.a.tr_mul(&(placed[slide.body].r - base.r));
                    let w = twists[slide.base].omega;
                    let local = w.cross(&reach) + slide.direction * drives[slide.driver].speed;
                    let omega = slide.attitude.matrix().tr_mul(&w);
                    twists[slide.body] = Twist { v: twists[slide.base].v + base.a * local, omega };
                }
                Part::Block(block) => block.velocity(mechanism, rows, drives, fresh, twists)?,
            }
        }
        Ok(())
    }

    /// Quasi-static reactions at `poses`: Φ_qᵀ λ = `load`, from the last part back to the first.
    ///
    /// # Errors
    /// Singular, with the constraint.
    pub fn reactions(
        &mut self,
        poses: &[Pose],
        drives: &[Drive],
        load: &[f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        self.evaluate(poses, drives);
        self.load.copy_from_slice(load);
        let Self { mechanism, parts, rows, load, .. } = self;
        for part in parts.iter_mut().rev() {
            match part {
                Part::Fixed { body, constraint, .. } => {
                    // At the fixed pose the ground's Jacobian is the identity.
                    let first = mechanism.first_row(*constraint);
                    lambda[first..first + 6].copy_from_slice(&load[6 * *body..6 * *body + 6]);
                }
                Part::Slide(slide) => {
                    // The guide is on a fixed body and does not turn: its factors are those of design.
                    slide.block.pass_on(mechanism, rows, load, lambda);
                }
                Part::Block(block) => block.reactions(mechanism, rows, load, lambda)?,
            }
        }
        Ok(())
    }

    fn evaluate(&mut self, poses: &[Pose], drives: &[Drive]) {
        for (placed, pose) in self.placed.iter_mut().zip(poses) {
            *placed = Placed::new(pose);
        }
        // The rows of fixed and sliding bodies are those of design: their Jacobians are constant.
        for part in &self.parts {
            let Part::Block(block) = part else { continue };
            for &(c, first, count, _, _) in &block.constraints {
                let rows = &mut self.rows[first..first + count];
                self.mechanism.constraints()[c].evaluate(&self.placed, drives, rows);
            }
        }
    }
}

impl Slide {
    #[inline]
    fn pose(&self, base: &Pose, drives: &[Drive]) -> Pose {
        let local = self.origin + self.direction * drives[self.driver].value;
        Pose { r: base.point(&local), p: base.p.then(self.attitude) }
    }
}

impl Block {
    /// Jacobian of the block's rows in its own bodies' coordinates.
    #[inline]
    fn fill(&mut self, rows: &[Row]) {
        let n = 6 * self.bodies.len();
        let matrix = self.lu.matrix_mut();
        matrix.fill(0.0);
        let mut at = 0;
        for &(_, first, count, on_i, on_j) in &self.constraints {
            for row in &rows[first..first + count] {
                let to = &mut matrix[at * n..(at + 1) * n];
                if let Some(column) = on_i {
                    to[column..column + 6].copy_from_slice(&row.jac[..6]);
                }
                if let Some(column) = on_j {
                    to[column..column + 6].copy_from_slice(&row.jac[6..]);
                }
                at += 1;
            }
        }
    }

    fn constraint_of_local_row(&self, local: usize) -> Option<usize> {
        let mut at = 0;
        for &(constraint, _, count, _, _) in &self.constraints {
            at += count;
            if local < at {
                return Some(constraint);
            }
        }
        None
    }

    fn position(
        &mut self,
        mechanism: &Mechanism,
        poses: &mut [Pose],
        placed: &mut [Placed],
        rows: &mut [Row],
        drives: &[Drive],
        limits: &Limits,
    ) -> Result<Solved, Failure> {
        let failure =
            |reason, constraint, iterations, residual| Failure { reason, constraint, iterations, residual };
        let mut step = f64::INFINITY;
        let mut iterations = 0;
        self.factored = false;
        loop {
            for &body in &self.bodies {
                placed[body] = Placed::new(&poses[body]);
            }
            let (mut residual, mut worst, mut at) = (0.0, None, 0);
            for &(c, first, count, _, _) in &self.constraints {
                mechanism.constraints()[c].evaluate(placed, drives, &mut rows[first..first + count]);
                for row in &rows[first..first + count] {
                    self.rhs[at] = -row.phi;
                    at += 1;
                    // Negated so that NaN is the worst of all.
                    if !(row.phi.abs() <= residual) {
                        (residual, worst) = (row.phi.abs(), Some(c));
                    }
                }
            }
            if !residual.is_finite() {
                return Err(failure(Reason::OutOfReach, worst, iterations, f64::MAX));
            }
            if residual <= limits.phi && (step <= limits.step || residual <= Limits::PHI_NOTHING) {
                if self.factored && self.lu.determinant_positive() != self.design_positive {
                    return Err(failure(Reason::WrongBranch, worst, iterations, residual));
                }
                return Ok(Solved { iterations, residual });
            }
            if iterations == limits.iterations {
                return Err(failure(Reason::OutOfReach, worst, iterations, residual));
            }
            self.fill(rows);
            if let Err(singular) = self.lu.factor() {
                let constraint = self.constraint_of_local_row(singular.0);
                return Err(failure(Reason::Singular, constraint, iterations, residual));
            }
            self.factored = true;
            self.lu.solve(&mut self.rhs);
            iterations += 1;
            step = self.rhs.iter().fold(0.0, |m, x| if x.abs() <= m { m } else { x.abs() });
            if !(step <= limits.step_max) {
                return Err(failure(Reason::OutOfReach, worst, iterations, residual));
            }
            for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact(6)) {
                let (dr, dpi) = (Vector3::new(x[0], x[1], x[2]), Vector3::new(x[3], x[4], x[5]));
                poses[body] = poses[body].moved(&dr, &dpi);
            }
        }
    }

    fn velocity(
        &mut self,
        mechanism: &Mechanism,
        rows: &[Row],
        drives: &[Drive],
        fresh: bool,
        twists: &mut [Twist],
    ) -> Result<(), Failure> {
        let exact = fresh || !self.factored;
        if exact {
            self.fill(rows);
            self.lu.factor().map_err(|singular| Failure {
                reason: Reason::Singular,
                constraint: self.constraint_of_local_row(singular.0),
                iterations: 0,
                residual: 0.0,
            })?;
            // These are not the factors of a Newton step.
            self.factored = false;
        }
        // ν less what the placed bodies' velocities contribute; then twice more for what is left of it, as
        // the factors may be those of the step before (each pass takes its error to the next power).
        for &body in &self.bodies {
            twists[body] = Twist::ZERO;
        }
        for _ in 0..if exact { 1 } else { 3 } {
            let mut at = 0;
            let mut nu = [0.0; ROWS_MAX];
            for &(c, first, count, _, _) in &self.constraints {
                let constraint = &mechanism.constraints()[c];
                constraint.velocity_right_side(drives, &mut nu);
                let (i, j) = (&twists[constraint.i], &twists[constraint.j]);
                let absolute = constraint.kind.is_absolute();
                for (row, nu) in rows[first..first + count].iter().zip(&nu) {
                    let own = along(&row.jac[6..], j);
                    self.rhs[at] = nu - own - if absolute { 0.0 } else { along(&row.jac[..6], i) };
                    at += 1;
                }
            }
            self.lu.solve(&mut self.rhs);
            for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact(6)) {
                let add = Twist::from_slice(x);
                twists[body] = Twist { v: twists[body].v + add.v, omega: twists[body].omega + add.omega };
            }
        }
        Ok(())
    }

    fn reactions(
        &mut self,
        mechanism: &Mechanism,
        rows: &[Row],
        load: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), Failure> {
        self.fill(rows);
        self.lu.factor().map_err(|singular| Failure {
            reason: Reason::Singular,
            constraint: self.constraint_of_local_row(singular.0),
            iterations: 0,
            residual: 0.0,
        })?;
        self.factored = false;
        self.pass_on(mechanism, rows, load, lambda);
        Ok(())
    }

    /// λ of this block with the factors at hand, and what its constraints leave to bodies of earlier parts.
    fn pass_on(&mut self, mechanism: &Mechanism, rows: &[Row], load: &mut [f64], lambda: &mut [f64]) {
        for (&body, x) in self.bodies.iter().zip(self.rhs.chunks_exact_mut(6)) {
            x.copy_from_slice(&load[6 * body..6 * body + 6]);
        }
        self.lu.solve_transposed(&mut self.rhs);
        let mut at = 0;
        for &(c, first, count, on_i, on_j) in &self.constraints {
            lambda[first..first + count].copy_from_slice(&self.rhs[at..at + count]);
            at += count;
            let constraint = &mechanism.constraints()[c];
            for (body, own, offset) in [(constraint.i, on_i, 0), (constraint.j, on_j, 6)] {
                if own.is_some() || (offset == 0 && constraint.kind.is_absolute()) {
                    continue;
                }
                for r in first..first + count {
                    for k in 0..6 {
                        load[6 * body + k] -= rows[r].jac[offset + k] * lambda[r];
                    }
                }
            }
        }
    }
}

/// Row times a body's velocity.
#[inline]
fn along(jac: &[f64], twist: &Twist) -> f64 {
    let (v, w) = (&twist.v, &twist.omega);
    jac[0] * v.x + jac[1] * v.y + jac[2] * v.z + jac[3] * w.x + jac[4] * w.y + jac[5] * w.z
}

/// The parts in order, or `None` where some bodies or constraints fit in none.
fn order(mechanism: &Mechanism, design: &[Pose]) -> Option<Vec<Part>> {
    let mut search = Search {
        mechanism,
        design,
        placed: vec![false; design.len()],
        used: vec![false; mechanism.constraints().len()],
        parts: Vec::new(),
    };
    search.fixed();
    search.slides();
    while search.placed.contains(&false) {
        search.block()?;
    }
    (!search.used.contains(&false)).then_some(search.parts)
}

struct Search<'a> {
    mechanism: &'a Mechanism,
    design: &'a [Pose],
    placed: Vec<bool>,
    used: Vec<bool>,
    parts: Vec<Part>,
}

impl Search<'_> {
    fn fixed(&mut self) {
        for (constraint, c) in self.mechanism.constraints().iter().enumerate() {
            if let Kind::Ground { pose } = c.kind
                && !self.placed[c.j]
            {
                self.placed[c.j] = true;
                self.used[constraint] = true;
                self.parts.push(Part::Fixed { body: c.j, constraint, pose });
            }
        }
    }

    /// Bodies with a guide and a driver along it, both on the same placed body.
    fn slides(&mut self) {
        let all = self.mechanism.constraints();
        for (guide, g) in all.iter().enumerate() {
            let Kind::Translational { on_i, .. } = &g.kind else { continue };
            for (drive, d) in all.iter().enumerate() {
                let Kind::TranslationalDriver { on_i: axis, driver, s_j } = &d.kind else { continue };
                let fixed = self.parts.iter().any(|p| matches!(p, Part::Fixed { body, .. } if *body == g.i));
                let same = (d.i, d.j) == (g.i, g.j) && fixed && !self.placed[g.j];
                if !same || (axis.h() - on_i.h()).norm() > 1e-12 {
                    continue;
                }
                let (base, body) = (&self.design[g.i], &self.design[g.j]);
                let direction = on_i.h();
                // Stroke at the design pose, to be taken back.
                let stroke = direction.dot(&(base.local(&body.point(s_j)) - axis.origin));
                self.placed[g.j] = true;
                (self.used[guide], self.used[drive]) = (true, true);
                let slide = Slide {
                    body: g.j,
                    base: g.i,
                    attitude: base.p.relative_to(body.p),
                    origin: base.local(&body.r) - direction * stroke,
                    direction,
                    driver: *driver,
                    block: self.block_of(vec![g.j], &[guide, drive]),
                };
                self.parts.push(Part::Slide(Box::new(slide)));
            }
        }
    }

    /// The next smallest set of bodies with as many rows as coordinates.
    fn block(&mut self) -> Option<()> {
        let left: Vec<usize> = (0..self.placed.len()).filter(|b| !self.placed[*b]).collect();
        for size in 1..=BLOCK_BODIES_MAX.min(left.len()) {
            for set in combinations(&left, size) {
                let constraints = self.constraints_on(&set);
                let rows: usize =
                    constraints.iter().map(|c| self.mechanism.constraints()[*c].kind.rows()).sum();
                if rows == 6 * size {
                    for &c in &constraints {
                        self.used[c] = true;
                    }
                    for &body in &set {
                        self.placed[body] = true;
                    }
                    let block = self.block_of(set, &constraints);
                    self.parts.push(Part::Block(block));
                    return Some(());
                }
            }
        }
        None
    }

    /// Unused constraints whose bodies are all in the set or placed, at least one of them in the set.
    fn constraints_on(&self, set: &[usize]) -> Vec<usize> {
        let all = self.mechanism.constraints();
        let known = |body: usize| self.placed[body] || set.contains(&body);
        (0..all.len())
            .filter(|&c| {
                let (i, j, absolute) = (all[c].i, all[c].j, all[c].kind.is_absolute());
                let touches = set.contains(&j) || (!absolute && set.contains(&i));
                !self.used[c] && touches && known(j) && (absolute || known(i))
            })
            .collect()
    }

    fn block_of(&self, bodies: Vec<usize>, constraints: &[usize]) -> Block {
        let column = |body: usize| bodies.iter().position(|b| *b == body).map(|at| 6 * at);
        let constraints = constraints
            .iter()
            .map(|&c| {
                let constraint = &self.mechanism.constraints()[c];
                let on_i = if constraint.kind.is_absolute() { None } else { column(constraint.i) };
                let rows = constraint.kind.rows();
                (c, self.mechanism.first_row(c), rows, on_i, column(constraint.j))
            })
            .collect();
        let n = 6 * bodies.len();
        Block {
            bodies,
            constraints,
            lu: DenseLu::new(n),
            rhs: vec![0.0; n],
            design_positive: true,
            factored: false,
        }
    }
}

/// All subsets of `size` elements, in order.
fn combinations(of: &[usize], size: usize) -> Vec<Vec<usize>> {
    if size == 0 {
        return vec![Vec::new()];
    }
    let mut all = Vec::new();
    for (k, &first) in of.iter().enumerate() {
        for rest in combinations(&of[k + 1..], size - 1) {
            all.push([vec![first], rest].concat());
        }
    }
    all
}
