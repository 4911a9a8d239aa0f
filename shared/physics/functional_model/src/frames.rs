//! How parts sit in their hosts. A guest vector seen in the host is V_host = R V_guest (turning, 2-D: about z; 3-D:
//! a sequence of turns about the guest's own axes); a part without a frame, or with one direction only, lies along a
//! direction: V_host = a v_guest. Couplings use the same matrix for through quantities, transposed (spec 5.3), so
//! power is the same on both sides whatever the author writes.
//! A frame that turns continuously has an angular velocity, Omega = R^T dR/dt in the guest's axes; vector states
//! kept in it obey E dx/dt + Omega x (E x) (the transport term).

use crate::calculus::{depends, time_derivative};
use crate::expand::{Shape, Trouble};
use crate::flat::{Kind, Variable};
use crate::instances::Tree;
use crate::pool::{Fun, Id, Pool};

/// rows x cols, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Matrix {
    pub rows: usize,
    pub cols: usize,
    pub parts: Vec<Id>,
}

impl Matrix {
    pub fn identity(pool: &mut Pool, n: usize) -> Matrix {
        let parts = (0..n * n).map(|k| pool.number(f64::from(u8::from(k / n == k % n)))).collect();
        Matrix { rows: n, cols: n, parts }
    }

    pub fn times(&self, pool: &mut Pool, other: &Matrix) -> Matrix {
        let mut parts = Vec::with_capacity(self.rows * other.cols);
        for i in 0..self.rows {
            for k in 0..other.cols {
                let terms: Vec<(Id, f64)> = (0..self.cols)
                    .map(|j| (pool.mul(self.parts[i * self.cols + j], other.parts[j * other.cols + k]), 1.0))
                    .collect();
                parts.push(pool.sum(&terms, 0.0));
            }
        }
        Matrix { rows: self.rows, cols: other.cols, parts }
    }

    pub fn transposed(&self) -> Matrix {
        let parts = (0..self.rows * self.cols)
            .map(|k| self.parts[(k % self.rows) * self.cols + k / self.rows])
            .collect();
        Matrix { rows: self.cols, cols: self.rows, parts }
    }
}

/// matrix * vector
pub(crate) fn apply(pool: &mut Pool, m: &Matrix, v: &[Id]) -> Vec<Id> {
    (0..m.rows)
        .map(|i| {
            let terms: Vec<(Id, f64)> =
                (0..m.cols).map(|j| (pool.mul(m.parts[i * m.cols + j], v[j]), 1.0)).collect();
            pool.sum(&terms, 0.0)
        })
        .collect()
}

fn scalar_angle(tree: &Tree, pool: &mut Pool, host: usize, text: &crate::node::Text) -> Result<Id, Trouble> {
    let v = tree.expand_in(pool, host, text)?;
    if v.shape != Shape::Scalar {
        return Err(Trouble::Shape(format!("an angle is a scalar, not {}", v.shape)));
    }
    if v.unit.is_some_and(|u| u != crate::units::Unit::ONE) {
        return Err(Trouble::Unit(format!("an angle is in rad or deg, not {}", v.unit_text())));
    }
    Ok(v.parts[0])
}

/// Turn about one axis, guest to host.
fn turn_about(pool: &mut Pool, axis: char, angle: Id, dim: usize) -> Matrix {
    let (c, s) = (pool.call(Fun::Cos, &[angle]), pool.call(Fun::Sin, &[angle]));
    let (zero, one, minus) = (pool.number(0.0), pool.number(1.0), pool.scale(s, -1.0));
    let parts = match (dim, axis) {
        (2, _) => vec![c, minus, s, c],
        (_, 'x') => vec![one, zero, zero, zero, c, minus, zero, s, c],
        (_, 'y') => vec![c, zero, s, zero, one, zero, minus, zero, c],
        _ => vec![c, minus, zero, s, c, zero, zero, zero, one],
    };
    Matrix { rows: dim, cols: dim, parts }
}

/// Guest-to-host matrix of a part of two or three dimensions; `None` = not turned.
pub(crate) fn rotation(tree: &Tree, pool: &mut Pool, at: usize) -> Result<Option<Matrix>, Trouble> {
    let me = &tree.instances[at];
    let (Some(part), Some(host)) = (&me.part, me.parent) else { return Ok(None) };
    let (guest_dim, host_dim) = (me.dim, tree.instances[host].dim);
    if guest_dim < 2 {
        return Ok(None);
    }
    if part.along.is_some() {
        return Err(Trouble::Shape(format!(
            "'along' places parts of dim 0 or 1; this part has dim = {guest_dim}: use turn"
        )));
    }
    let mut whole: Option<Matrix> = None;
    if let Some(text) = &part.matrix {
        let v = tree.expand_in(pool, host, text)?;
        if v.shape != Shape::Matrix(host_dim, host_dim) {
            return Err(Trouble::Shape(format!("matrix must be {host_dim} x {host_dim}, it is {}", v.shape)));
        }
        whole = Some(Matrix { rows: host_dim, cols: host_dim, parts: v.parts });
    }
    for (axis, text) in &part.turn {
        if host_dim == 2 && *axis != 'z' {
            return Err(Trouble::Shape("in a plane a part turns about z only".into()));
        }
        let angle = scalar_angle(tree, pool, host, text)?;
        let r = turn_about(pool, *axis, angle, host_dim);
        whole = Some(match whole {
            Some(w) => w.times(pool, &r),
            None => r,
        });
    }
    if guest_dim < host_dim {
        // A plane in space: its x and y axes.
        let full = match whole {
            Some(w) => w,
            None => Matrix::identity(pool, host_dim),
        };
        let parts = (0..host_dim)
            .flat_map(|i| (0..guest_dim).map(move |j| (i, j)))
            .map(|(i, j)| full.parts[i * host_dim + j])
            .collect();
        return Ok(Some(Matrix { rows: host_dim, cols: guest_dim, parts }));
    }
    Ok(whole)
}

/// Matrix that takes a port's components to the frame of `to` (an ancestor). `None` = the same components.
/// `rotational`: the port turns (rad/s), so in a part of one dimension it points along Y (patent 0029).
pub(crate) fn lift(
    tree: &Tree,
    pool: &mut Pool,
    from: usize,
    to: usize,
    size: usize,
    rotational: bool,
) -> Result<Option<Matrix>, Trouble> {
    let mut whole: Option<Matrix> = None;
    let mut rows = size;
    let mut pending: Option<Id> = None;
    let mut at = from;
    while at != to {
        let me = &tree.instances[at];
        let Some(host) = me.parent else { break };
        let host_dim = tree.instances[host].dim;
        if me.dim >= 2 {
            if let Some(r) = rotation(tree, pool, at)?
                && r.cols == rows
            {
                rows = r.rows;
                whole = Some(match whole {
                    Some(w) => r.times(pool, &w),
                    None => r,
                });
            }
        } else if let Some(part) = &me.part {
            if host_dim <= 1 {
                if part.along.is_some() {
                    return Err(Trouble::Shape("'along' needs a host of two or three dimensions".into()));
                }
                for (_, text) in &part.turn {
                    let angle = scalar_angle(tree, pool, host, text)?;
                    pending = Some(match pending {
                        Some(p) => pool.add(p, angle),
                        None => angle,
                    });
                }
            } else if rows == 1 {
                let column = direction(tree, pool, host, part, host_dim, pending.take(), rotational, me.dim)?;
                if let Some(parts) = column {
                    rows = host_dim;
                    whole = Some(Matrix { rows: host_dim, cols: 1, parts });
                }
            }
        }
        at = host;
    }
    Ok(whole)
}

#[allow(clippy::too_many_arguments)]
fn direction(
    tree: &Tree,
    pool: &mut Pool,
    host: usize,
    part: &crate::document::RawPart,
    host_dim: usize,
    pending: Option<Id>,
    rotational: bool,
    dim: usize,
) -> Result<Option<Vec<Id>>, Trouble> {
    if let Some(text) = &part.along {
        let v = tree.expand_in(pool, host, text)?;
        if v.shape != Shape::Vector(host_dim) {
            return Err(Trouble::Shape(format!("along is {}, the host has {host_dim} dimensions", v.shape)));
        }
        if v.unit.is_some_and(|u| u != crate::units::Unit::ONE) {
            return Err(Trouble::Unit(format!("along is a direction without unit, not {}", v.unit_text())));
        }
        return Ok(Some(v.parts));
    }
    if part.turn.is_empty() && pending.is_none() {
        return Ok(None);
    }
    let mut whole = Matrix::identity(pool, host_dim);
    for (axis, text) in &part.turn {
        let angle = scalar_angle(tree, pool, host, text)?;
        let r = turn_about(pool, *axis, angle, host_dim);
        whole = whole.times(pool, &r);
    }
    if let Some(angle) = pending {
        let r = turn_about(pool, 'z', angle, host_dim);
        whole = whole.times(pool, &r);
    }
    let column = usize::from(rotational && dim == 1);
    Ok(Some((0..host_dim).map(|i| whole.parts[i * host_dim + column]).collect()))
}

/// Angular velocity of a part's frame against the ground, in its own axes: one number (about z) in a plane, three
/// in space; `None` when it never turns between samples.
pub(crate) fn spin(
    tree: &Tree,
    pool: &mut Pool,
    at: usize,
    variables: &[Variable],
) -> Result<Option<Vec<Id>>, Trouble> {
    let me = &tree.instances[at];
    let dim = me.dim;
    let size = if dim == 3 { 3 } else { 1 };
    let Some(part) = &me.part else { return Ok(None) };
    let Some(host) = me.parent else { return Ok(None) };
    if let Some(text) = &part.spin {
        let v = tree.expand_in(pool, at, text)?;
        if v.parts.len() != size || v.unit != Some(crate::units::Unit::PER_SECOND) {
            return Err(Trouble::Shape(format!(
                "spin is {size} component(s) in rad/s, not {} in {}",
                v.shape,
                v.unit_text()
            )));
        }
        return Ok(Some(v.parts));
    }
    if dim < 2 {
        return Ok(None);
    }
    let held = |v: u32| variables[v as usize].kind == Kind::Sampled;
    let mut omega = spin(tree, pool, host, variables)?;
    if dim == 2 && omega.as_ref().is_some_and(|o| o.len() == 3) {
        omega = omega.map(|o| vec![o[2]]);
    }
    if part.matrix.is_some() {
        let Some(r) = rotation(tree, pool, at)? else { return Ok(omega) };
        let rate =
            Matrix { parts: r.parts.iter().map(|p| time_derivative(pool, *p, &held)).collect(), ..r.clone() };
        let own = r.transposed().times(pool, &rate);
        let mut total: Vec<Id> =
            if dim == 2 { vec![own.parts[2]] } else { vec![own.parts[7], own.parts[2], own.parts[3]] };
        if let Some(o) = omega {
            let turned = if dim == 3 { apply(pool, &r.transposed(), &o) } else { o };
            total = total.iter().zip(&turned).map(|(a, b)| pool.add(*a, *b)).collect();
        }
        return Ok(total.iter().any(|p| !pool.is_zero(*p)).then_some(total));
    }
    for (axis, text) in &part.turn {
        let angle = scalar_angle(tree, pool, host, text)?;
        let rate = time_derivative(pool, angle, &held);
        if dim == 2 {
            if !pool.is_zero(rate) {
                omega = Some(match omega {
                    Some(o) => vec![pool.add(o[0], rate)],
                    None => vec![rate],
                });
            }
            continue;
        }
        let back = turn_about(pool, *axis, angle, 3).transposed();
        let mut turned = match omega {
            Some(o) => apply(pool, &back, &o),
            None => (0..3).map(|_| pool.number(0.0)).collect(),
        };
        let k = match axis {
            'x' => 0,
            'y' => 1,
            _ => 2,
        };
        turned[k] = pool.add(turned[k], rate);
        omega = turned.iter().any(|p| !pool.is_zero(*p)).then_some(turned);
    }
    Ok(omega)
}

/// Omega x v, in a plane (one omega) or in space.
pub(crate) fn cross(pool: &mut Pool, omega: &[Id], v: &[Id]) -> Vec<Id> {
    if omega.len() == 1 {
        let (a, b) = (pool.mul(omega[0], v[1]), pool.mul(omega[0], v[0]));
        return vec![pool.scale(a, -1.0), b];
    }
    let mut minor = |i: usize, j: usize| {
        let (p, q) = (pool.mul(omega[i], v[j]), pool.mul(omega[j], v[i]));
        pool.sub(p, q)
    };
    vec![minor(1, 2), minor(2, 0), minor(0, 1)]
}

/// Guest-to-ground matrix when it depends on sampled variables.
pub(crate) fn sampled_rotation(
    tree: &Tree,
    pool: &mut Pool,
    at: usize,
    variables: &[Variable],
) -> Result<Option<Matrix>, Trouble> {
    let mut whole: Option<Matrix> = None;
    let mut here = at;
    while let Some(host) = tree.instances[here].parent {
        if let Some(r) = rotation(tree, pool, here)? {
            whole = Some(match whole {
                Some(w) => r.times(pool, &w),
                None => r,
            });
        }
        here = host;
    }
    let sampled = |m: &Matrix| {
        m.parts
            .iter()
            .any(|p| depends(pool, *p).variables.iter().any(|v| variables[*v as usize].kind == Kind::Sampled))
    };
    Ok(whole.filter(|m| m.rows == m.cols && sampled(m)))
}
