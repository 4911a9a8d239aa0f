//! The structured path: the same analyses, part by part in the order in which the constraints determine
//! the bodies.
//!
//! The order is found from the constraints alone: bodies fixed to the ground and bodies that a driver
//! slides along a guide have their pose in closed form; a body on a hinge with one more scalar equation has
//! one unknown, its angle (`hinge`); then the smallest sets of bodies that have as many constraints to already
//! placed bodies (and among themselves) as coordinates, each a small dense block (`block`).
//! Positions and velocities go through the parts forwards, reactions (the transposed system) backwards.
//! The Jacobian is block-triangular in this order, so nothing is approximated.

use spatial::{EulerParameters, Vector3};

use crate::body::{Placed, Pose, Twist};
use crate::constraint::{Drive, Kind, Row};
use crate::failure::{Failure, Solved};
use crate::kinematics::Limits;
use crate::linear::DenseLu;
use crate::mechanism::Mechanism;

mod block;
mod hinge;

use block::Block;
use hinge::Hinge;

/// Largest set of bodies that is looked for; what is larger goes to the general path.
const BLOCK_BODIES_MAX: usize = 3;

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
    Hinge(Box<Hinge>),
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
    /// Constraints whose rows come from another stage.
    lent: Vec<bool>,
}

/// Rows that two stages have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shared {
    from: usize,
    to: usize,
    count: usize,
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
            lent: vec![false; mechanism.constraints().len()],
            mechanism,
            parts,
            limits,
        };
        structured.mechanism.evaluate_placed(&structured.placed, drives, &mut structured.rows);
        for part in &mut structured.parts {
            let block = match part {
                Part::Fixed { .. } => continue,
                Part::Hinge(hinge) => {
                    hinge.set_design(&structured.mechanism, &structured.placed, drives)?;
                    continue;
                }
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
                Part::Hinge(hinge) => {
                    let solved = hinge.position(mechanism, poses, placed, rows, drives, limits)?;
                    total.iterations = total.iterations.max(solved.iterations);
                    total.residual = total.residual.max(solved.residual);
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
                Part::Hinge(hinge) => hinge.velocity(mechanism, rows, placed, twists)?,
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
        let Self { mechanism, parts, rows, load, placed, .. } = self;
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
                Part::Hinge(hinge) => hinge.reactions(mechanism, placed, rows, load, lambda)?,
                Part::Block(block) => block.reactions(mechanism, rows, load, lambda)?,
            }
        }
        Ok(())
    }

    fn evaluate(&mut self, poses: &[Pose], drives: &[Drive]) {
        for (placed, pose) in self.placed.iter_mut().zip(poses) {
            *placed = Placed::new(pose);
        }
        let Self { mechanism, parts, placed, rows, lent, .. } = self;
        let evaluate = |c: usize, first: usize, count: usize, rows: &mut [Row]| {
            if !lent[c] {
                mechanism.constraints()[c].evaluate(placed, drives, &mut rows[first..first + count]);
            }
        };
        // The rows of fixed and sliding bodies are those of design: their Jacobians are constant.
        for part in parts {
            match part {
                Part::Fixed { .. } | Part::Slide(_) => {}
                Part::Hinge(hinge) => {
                    hinge.turn_rows(placed, rows);
                    evaluate(hinge.tie, hinge.tie_row, 1, rows);
                }
                Part::Block(block) => {
                    for &(c, first, count, _, _) in &block.constraints {
                        evaluate(c, first, count, rows);
                    }
                }
            }
        }
    }

    /// Takes over rows that another stage has evaluated at the same poses: pairs of its first row and ours,
    /// and their number. They are not evaluated again in [`Self::reactions`].
    pub(crate) fn borrow_rows(&mut self, from: &[Row], pairs: &[Shared]) {
        for pair in pairs {
            let to = &mut self.rows[pair.to..pair.to + pair.count];
            to.copy_from_slice(&from[pair.from..pair.from + pair.count]);
        }
    }

    /// The rows that `self` evaluates for a pose and that `other` needs too: the same constraint between
    /// bodies that are the same (`same[k]` is the body of `self` that body k of `other` is). `other` no
    /// longer evaluates them by itself.
    pub(crate) fn share_rows(&self, other: &mut Self, same: &[Option<usize>]) -> Vec<Shared> {
        let ours = self.mechanism.constraints();
        let evaluated: Vec<usize> = self
            .parts
            .iter()
            .flat_map(|part| match part {
                Part::Block(block) => block.constraints.iter().map(|m| m.0).collect(),
                Part::Hinge(hinge) => vec![hinge.tie],
                Part::Fixed { .. } | Part::Slide(_) => Vec::new(),
            })
            .collect();
        let mut shared = Vec::new();
        for (c, theirs) in other.mechanism.constraints().iter().enumerate() {
            let alike = |k: &&usize| {
                let own = &ours[**k];
                own.kind == theirs.kind && same[theirs.i] == Some(own.i) && same[theirs.j] == Some(own.j)
            };
            if let Some(&own) = evaluated.iter().find(alike) {
                other.lent[c] = true;
                shared.push(Shared {
                    from: self.mechanism.first_row(own),
                    to: other.mechanism.first_row(c),
                    count: theirs.kind.rows(),
                });
            }
        }
        shared
    }
}

impl Slide {
    #[inline]
    fn pose(&self, base: &Pose, drives: &[Drive]) -> Pose {
        let local = self.origin + self.direction * drives[self.driver].value;
        Pose { r: base.point(&local), p: base.p.then(self.attitude) }
    }
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
        if !search.hinge() {
            search.block()?;
        }
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

    /// A body hinged on a fixed body with one more equation to placed bodies, if there is one.
    fn hinge(&mut self) -> bool {
        let all = self.mechanism.constraints();
        for (revolute, r) in all.iter().enumerate() {
            let Kind::Revolute { on_i, on_j } = &r.kind else { continue };
            let fixed = self.parts.iter().any(|p| matches!(p, Part::Fixed { body, .. } if *body == r.i));
            if self.placed[r.j] || !fixed {
                continue;
            }
            let on = self.constraints_on(&[r.j]);
            let [a, b] = on[..] else { continue };
            let tie = if a == revolute { b } else { a };
            if !matches!(all[tie].kind, Kind::Distance { .. }) || (a != revolute && b != revolute) {
                continue;
            }
            let (base, design) = (&self.design[r.i], &self.design[r.j]);
            let (revolute_row, tie_row) = (self.mechanism.first_row(revolute), self.mechanism.first_row(tie));
            let hinge = Hinge::new(
                r.j,
                (revolute, revolute_row),
                (tie, tie_row),
                all[tie].j == r.j,
                base,
                design,
                [on_i, on_j],
            );
            self.placed[r.j] = true;
            (self.used[revolute], self.used[tie]) = (true, true);
            self.parts.push(Part::Hinge(Box::new(hinge)));
            return true;
        }
        false
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
            given: vec![0.0; n],
            design_positive: true,
            factored: false,
            away: 0.0,
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
