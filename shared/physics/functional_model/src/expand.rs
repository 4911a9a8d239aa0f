//! From a syntax tree to scalar expressions, checking shapes and units on the way. Shapes: a scalar stands for
//! scalar * identity next to a matrix, and is repeated next to a vector; vector * vector is component by component
//! (a vector coefficient is a diagonal); matrix * vector is the usual product. A literal 0 fits every unit.

use crate::pool::{Fun, Id, Pool};
use crate::syntax::{Ast, Op};
use crate::tables::Table;
use crate::units::Unit;

/// Rows and columns of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    Scalar,
    Vector(usize),
    Matrix(usize, usize),
}

impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Shape::Scalar => f.write_str("a scalar"),
            Shape::Vector(n) => write!(f, "a vector of {n}"),
            Shape::Matrix(r, c) => write!(f, "a {r} x {c} matrix"),
        }
    }
}

/// An expanded value: components (row by row) and unit; no unit = zero, which fits everything.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Value {
    pub shape: Shape,
    pub parts: Vec<Id>,
    pub unit: Option<Unit>,
}

impl Value {
    pub fn scalar(id: Id, unit: Unit) -> Value {
        Value { shape: Shape::Scalar, parts: vec![id], unit: Some(unit) }
    }

    pub fn vector(parts: Vec<Id>, unit: Unit) -> Value {
        let shape = if parts.len() == 1 { Shape::Scalar } else { Shape::Vector(parts.len()) };
        Value { shape, parts, unit: Some(unit) }
    }

    pub fn unit_text(&self) -> String {
        self.unit.map_or_else(|| "any unit".into(), |u| u.to_string())
    }
}

/// What names mean where an expression stands.
pub(crate) trait Scope {
    /// Value of a (possibly dotted) name; `None` = not declared here.
    fn name(&self, pool: &mut Pool, name: &str) -> Option<Result<Value, Trouble>>;
    /// Value of `name'`.
    fn rate(&self, pool: &mut Pool, name: &str) -> Option<Value>;
    /// A table by its name.
    fn table(&self, name: &str) -> Option<(u32, &Table)>;
    /// Names to suggest after a misspelling.
    fn names(&self) -> Vec<String>;
}

/// Why an expression was refused; the kind chooses the rule of the reported error.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Trouble {
    Unknown(String),
    Unit(String),
    Shape(String),
    Form(String),
}

type Result1 = Result<Value, Trouble>;

/// Expands a tree.
pub(crate) fn expand(ast: &Ast, pool: &mut Pool, scope: &dyn Scope) -> Result1 {
    match ast {
        Ast::Number(n) => {
            let id = pool.number(*n);
            Ok(Value {
                shape: Shape::Scalar,
                parts: vec![id],
                unit: if *n == 0.0 { None } else { Some(Unit::ONE) },
            })
        }
        Ast::Quantity(inner, unit, scale) => {
            let mut v = expand(inner, pool, scope)?;
            if v.unit.is_some_and(|u| u != Unit::ONE) {
                return Err(Trouble::Unit("a quantity is a plain number followed by a unit".into()));
            }
            v.unit = Some(*unit);
            v.parts = v.parts.iter().map(|p| pool.scale(*p, *scale)).collect();
            Ok(v)
        }
        Ast::Name(name) => look_up(name, pool, scope),
        Ast::Rate(name) => scope
            .rate(pool, name)
            .ok_or_else(|| Trouble::Unknown(format!("'{name}'' is not the rate of a state of this part"))),
        Ast::Negate(inner) => {
            let mut v = expand(inner, pool, scope)?;
            v.parts = v.parts.iter().map(|p| pool.scale(*p, -1.0)).collect();
            Ok(v)
        }
        Ast::Binary(op, a, b) => {
            let (a, b) = (expand(a, pool, scope)?, expand(b, pool, scope)?);
            binary(*op, &a, &b, pool)
        }
        Ast::List(items) => {
            let items: Vec<Value> = items.iter().map(|i| expand(i, pool, scope)).collect::<Result<_, _>>()?;
            list(&items)
        }
        Ast::Call(name, args) => {
            let args: Vec<Value> = args.iter().map(|a| expand(a, pool, scope)).collect::<Result<_, _>>()?;
            call(name, &args, pool, scope)
        }
    }
}

fn look_up(name: &str, pool: &mut Pool, scope: &dyn Scope) -> Result1 {
    if let Some(v) = scope.name(pool, name) {
        return v;
    }
    if name == "pi" {
        let id = pool.number(std::f64::consts::PI);
        return Ok(Value::scalar(id, Unit::ONE));
    }
    if let Some((base, axis)) = name.rsplit_once('.')
        && let Some(at) = ["x", "y", "z"].iter().position(|a| *a == axis)
        && let Some(v) = scope.name(pool, base)
    {
        let v = v?;
        return match v.shape {
            Shape::Vector(n) if at < n => {
                Ok(Value { shape: Shape::Scalar, parts: vec![v.parts[at]], unit: v.unit })
            }
            shape => Err(Trouble::Shape(format!("'{base}' is {shape}: it has no component {axis}"))),
        };
    }
    let mut names = scope.names();
    names.sort();
    let near = names
        .iter()
        .map(|n| (distance(n, name), n))
        .filter(|(d, n)| *d <= 1 + n.len() / 4)
        .min()
        .map(|(_, n)| format!("; did you mean '{n}'?"))
        .unwrap_or_default();
    Err(Trouble::Unknown(format!("nothing is called '{name}' here{near}")))
}

/// Edit distance, for suggestions only.
pub(crate) fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut last = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let new = (last + usize::from(x != y)).min(row[j] + 1).min(row[j + 1] + 1);
            last = row[j + 1];
            row[j + 1] = new;
        }
    }
    row[b.len()]
}

fn list(items: &[Value]) -> Result1 {
    let mut unit = None;
    for item in items {
        unit = same_unit(unit, item.unit)
            .map_err(|(a, b)| Trouble::Unit(format!("a list mixes {a} and {b}")))?;
    }
    let parts: Vec<Id> = items.iter().flat_map(|v| v.parts.iter().copied()).collect();
    let shape = match items[0].shape {
        Shape::Scalar if items.len() == 1 => Shape::Vector(1),
        Shape::Scalar => Shape::Vector(items.len()),
        Shape::Vector(n) => Shape::Matrix(items.len(), n),
        Shape::Matrix(..) => return Err(Trouble::Shape("lists nest at most twice".into())),
    };
    if items.iter().any(|v| v.shape != items[0].shape) {
        return Err(Trouble::Shape("the rows of a matrix must have the same length".into()));
    }
    Ok(Value { shape, parts, unit })
}

fn same_unit(a: Option<Unit>, b: Option<Unit>) -> Result<Option<Unit>, (Unit, Unit)> {
    match (a, b) {
        (Some(a), Some(b)) if a != b => Err((a, b)),
        (Some(a), _) => Ok(Some(a)),
        (None, b) => Ok(b),
    }
}

/// Applies a binary operation with the shape rules above.
pub(crate) fn binary(op: Op, a: &Value, b: &Value, pool: &mut Pool) -> Result1 {
    let unit = match op {
        Op::Multiply => match (a.unit, b.unit) {
            (Some(x), Some(y)) => Some(x.times(y)),
            _ => None,
        },
        Op::Divide => match (a.unit, b.unit) {
            (Some(x), Some(y)) => Some(x.over(y)),
            (None, _) => None,
            (_, None) => return Err(Trouble::Form("division by zero".into())),
        },
        Op::Power => {
            let exponent = pool.as_number(b.parts[0]);
            if b.shape != Shape::Scalar || b.unit.is_some_and(|u| u != Unit::ONE) {
                return Err(Trouble::Unit("an exponent is a plain number".into()));
            }
            match (a.unit, exponent) {
                (Some(u), Some(e)) => Some(
                    u.power(e)
                        .ok_or_else(|| Trouble::Unit(format!("{u} has no power {e} with whole units")))?,
                ),
                (Some(u), None) if u != Unit::ONE => {
                    return Err(Trouble::Unit(format!(
                        "a variable exponent needs a plain number below, not {u}"
                    )));
                }
                (u, _) => u,
            }
        }
        _ => {
            let word = match op {
                Op::Add => "add",
                Op::Subtract => "subtract",
                _ => "compare",
            };
            let both = same_unit(a.unit, b.unit)
                .map_err(|(x, y)| Trouble::Unit(format!("cannot {word} {x} and {y}")))?;
            if matches!(op, Op::Add | Op::Subtract) { both } else { Some(Unit::ONE) }
        }
    };
    let mut each = |x: Id, y: Id| match op {
        Op::Add => pool.add(x, y),
        Op::Subtract => pool.sub(x, y),
        Op::Multiply => pool.mul(x, y),
        Op::Divide => pool.div(x, y),
        Op::Power => match pool.as_number(y) {
            Some(e) => pool.product(&[(x, e)]),
            None => pool.call(Fun::Power, &[x, y]),
        },
        Op::Less => pool.call(Fun::Less, &[x, y]),
        Op::LessEqual => pool.call(Fun::LessEqual, &[x, y]),
        Op::Greater => pool.call(Fun::Less, &[y, x]),
        Op::GreaterEqual => pool.call(Fun::LessEqual, &[y, x]),
        Op::And => pool.call(Fun::And, &[x, y]),
        Op::Or => pool.call(Fun::Or, &[x, y]),
    };
    let mismatch = || Err(Trouble::Shape(format!("{} and {} do not go together here", a.shape, b.shape)));
    let (shape, parts) = match (a.shape, b.shape) {
        (Shape::Scalar, Shape::Scalar) => (Shape::Scalar, vec![each(a.parts[0], b.parts[0])]),
        (Shape::Vector(n), Shape::Vector(m)) if n == m => {
            (a.shape, a.parts.iter().zip(&b.parts).map(|(x, y)| each(*x, *y)).collect())
        }
        (Shape::Vector(_), Shape::Scalar) => {
            (a.shape, a.parts.iter().map(|x| each(*x, b.parts[0])).collect())
        }
        (Shape::Scalar, Shape::Vector(_)) => {
            (b.shape, b.parts.iter().map(|y| each(a.parts[0], *y)).collect())
        }
        (Shape::Matrix(..), Shape::Scalar) if matches!(op, Op::Multiply | Op::Divide) => {
            (a.shape, a.parts.iter().map(|x| each(*x, b.parts[0])).collect())
        }
        (Shape::Scalar, Shape::Matrix(..)) if op == Op::Multiply => {
            (b.shape, b.parts.iter().map(|y| each(a.parts[0], *y)).collect())
        }
        // Next to a matrix a scalar or vector is a diagonal.
        (Shape::Matrix(n, m), Shape::Matrix(p, q))
            if matches!(op, Op::Add | Op::Subtract) && (n, m) == (p, q) =>
        {
            (a.shape, a.parts.iter().zip(&b.parts).map(|(x, y)| each(*x, *y)).collect())
        }
        (Shape::Matrix(n, m), Shape::Scalar | Shape::Vector(_))
            if matches!(op, Op::Add | Op::Subtract) && n == m =>
        {
            let b = matrix(b, n, pool).ok_or(()).or_else(|()| mismatch().map(|v: Value| v.parts))?;
            (
                a.shape,
                a.parts
                    .iter()
                    .zip(&b)
                    .map(|(x, y)| if op == Op::Add { pool.add(*x, *y) } else { pool.sub(*x, *y) })
                    .collect(),
            )
        }
        (Shape::Scalar | Shape::Vector(_), Shape::Matrix(n, m))
            if matches!(op, Op::Add | Op::Subtract) && n == m =>
        {
            let a = matrix(a, n, pool).ok_or(()).or_else(|()| mismatch().map(|v: Value| v.parts))?;
            (
                b.shape,
                a.iter()
                    .zip(&b.parts)
                    .map(|(x, y)| if op == Op::Add { pool.add(*x, *y) } else { pool.sub(*x, *y) })
                    .collect(),
            )
        }
        (Shape::Matrix(r, m), Shape::Vector(n)) if op == Op::Multiply && m == n => {
            let parts = (0..r)
                .map(|i| {
                    let terms: Vec<(Id, f64)> =
                        (0..m).map(|j| (pool.mul(a.parts[i * m + j], b.parts[j]), 1.0)).collect();
                    pool.sum(&terms, 0.0)
                })
                .collect();
            (if r == 1 { Shape::Scalar } else { Shape::Vector(r) }, parts)
        }
        (Shape::Matrix(r, m), Shape::Matrix(n, c)) if op == Op::Multiply && m == n => {
            let mut parts = Vec::with_capacity(r * c);
            for i in 0..r {
                for k in 0..c {
                    let terms: Vec<(Id, f64)> =
                        (0..m).map(|j| (pool.mul(a.parts[i * m + j], b.parts[j * c + k]), 1.0)).collect();
                    parts.push(pool.sum(&terms, 0.0));
                }
            }
            (Shape::Matrix(r, c), parts)
        }
        _ => return mismatch(),
    };
    Ok(Value { shape, parts, unit })
}

/// A coefficient as an n x n matrix: scalar * identity, vector = diagonal.
pub(crate) fn matrix(v: &Value, n: usize, pool: &mut Pool) -> Option<Vec<Id>> {
    let zero = pool.number(0.0);
    match v.shape {
        Shape::Scalar => Some((0..n * n).map(|k| if k / n == k % n { v.parts[0] } else { zero }).collect()),
        Shape::Vector(m) if m == n => {
            Some((0..n * n).map(|k| if k / n == k % n { v.parts[k / n] } else { zero }).collect())
        }
        Shape::Matrix(r, c) if r == n && c == n => Some(v.parts.clone()),
        _ => None,
    }
}

fn call(name: &str, args: &[Value], pool: &mut Pool, scope: &dyn Scope) -> Result1 {
    if let Some((index, table)) = scope.table(name) {
        if args.len() != table.arguments() {
            return Err(Trouble::Form(format!("table {name} takes {} argument(s)", table.arguments())));
        }
        for (arg, unit) in args.iter().zip(&table.units) {
            if arg.shape != Shape::Scalar {
                return Err(Trouble::Shape(format!("table {name} takes scalars")));
            }
            same_unit(arg.unit, Some(*unit))
                .map_err(|(a, b)| Trouble::Unit(format!("table {name} takes {b}, not {a}")))?;
        }
        let unit = table.unit;
        let ids: Vec<Id> = args.iter().map(|a| a.parts[0]).collect();
        let id = pool.table(index, 0, &ids);
        return Ok(Value::scalar(id, unit));
    }
    let count = |n: usize| {
        if args.len() == n {
            Ok(())
        } else {
            Err(Trouble::Form(format!("{name} takes {n} argument(s), not {}", args.len())))
        }
    };
    let plain = |v: &Value| match v.unit {
        Some(u) if u != Unit::ONE => Err(Trouble::Unit(format!("{name} takes a plain number, not {u}"))),
        _ => Ok(()),
    };
    let one = |fun: Fun, pool: &mut Pool| Value {
        shape: args[0].shape,
        parts: args[0].parts.iter().map(|p| pool.call(fun, &[*p])).collect(),
        unit: Some(Unit::ONE),
    };
    let simple = match name {
        "sin" => Some(Fun::Sin),
        "cos" => Some(Fun::Cos),
        "tan" => Some(Fun::Tan),
        "asin" => Some(Fun::Asin),
        "acos" => Some(Fun::Acos),
        "atan" => Some(Fun::Atan),
        "exp" => Some(Fun::Exp),
        "ln" => Some(Fun::Ln),
        "sinh" => Some(Fun::Sinh),
        "cosh" => Some(Fun::Cosh),
        "tanh" => Some(Fun::Tanh),
        "not" => Some(Fun::Not),
        _ => None,
    };
    if let Some(fun) = simple {
        count(1)?;
        plain(&args[0])?;
        return Ok(one(fun, pool));
    }
    let vectors = |n: Option<usize>| match (args[0].shape, args.last().map(|a| a.shape)) {
        (Shape::Vector(a), Some(Shape::Vector(b))) if a == b && n.is_none_or(|n| n == a) => Ok(a),
        (a, _) => Err(Trouble::Shape(format!("{name} takes vectors of one size, not {a}"))),
    };
    match name {
        "abs" => {
            count(1)?;
            Ok(Value { unit: args[0].unit, ..one(Fun::Abs, pool) })
        }
        "sign" => {
            count(1)?;
            Ok(one(Fun::Sign, pool))
        }
        "sqrt" => {
            count(1)?;
            let unit = match args[0].unit {
                Some(u) => {
                    Some(u.power(0.5).ok_or_else(|| Trouble::Unit(format!("{u} has no square root")))?)
                }
                None => None,
            };
            let parts = args[0].parts.iter().map(|p| pool.product(&[(*p, 0.5)])).collect();
            Ok(Value { shape: args[0].shape, parts, unit })
        }
        "min" | "max" => {
            count(2)?;
            let unit = same_unit(args[0].unit, args[1].unit)
                .map_err(|(a, b)| Trouble::Unit(format!("{name} mixes {a} and {b}")))?;
            if args[0].shape != args[1].shape {
                return Err(Trouble::Shape(format!("{name} takes two values of one shape")));
            }
            let fun = if name == "min" { Fun::Min } else { Fun::Max };
            let parts =
                args[0].parts.iter().zip(&args[1].parts).map(|(a, b)| pool.call(fun, &[*a, *b])).collect();
            Ok(Value { shape: args[0].shape, parts, unit })
        }
        "clamp" => {
            count(3)?;
            if args.iter().any(|a| a.shape != Shape::Scalar) {
                return Err(Trouble::Shape("clamp takes scalars".into()));
            }
            let mut unit = None;
            for a in args {
                unit = same_unit(unit, a.unit)
                    .map_err(|(a, b)| Trouble::Unit(format!("clamp mixes {a} and {b}")))?;
            }
            let low = pool.call(Fun::Max, &[args[0].parts[0], args[1].parts[0]]);
            let id = pool.call(Fun::Min, &[low, args[2].parts[0]]);
            Ok(Value { shape: Shape::Scalar, parts: vec![id], unit })
        }
        "atan2" => {
            count(2)?;
            same_unit(args[0].unit, args[1].unit)
                .map_err(|(a, b)| Trouble::Unit(format!("atan2 mixes {a} and {b}")))?;
            if args.iter().any(|a| a.shape != Shape::Scalar) {
                return Err(Trouble::Shape("atan2 takes scalars".into()));
            }
            let id = pool.call(Fun::Atan2, &[args[0].parts[0], args[1].parts[0]]);
            Ok(Value::scalar(id, Unit::ONE))
        }
        "if" => {
            count(3)?;
            if args[0].shape != Shape::Scalar || args[1].shape != args[2].shape {
                return Err(Trouble::Shape("if takes a condition and two values of one shape".into()));
            }
            let unit = same_unit(args[1].unit, args[2].unit)
                .map_err(|(a, b)| Trouble::Unit(format!("the branches of if are {a} and {b}")))?;
            let c = args[0].parts[0];
            let parts = args[1]
                .parts
                .iter()
                .zip(&args[2].parts)
                .map(|(a, b)| pool.call(Fun::If, &[c, *a, *b]))
                .collect();
            Ok(Value { shape: args[1].shape, parts, unit })
        }
        "norm" => {
            count(1)?;
            let id = pool.call(Fun::Norm, &args[0].parts);
            Ok(Value { shape: Shape::Scalar, parts: vec![id], unit: args[0].unit })
        }
        "dot" => {
            count(2)?;
            if args[0].shape == Shape::Scalar && args[1].shape == Shape::Scalar {
                return binary(Op::Multiply, &args[0], &args[1], pool);
            }
            vectors(None)?;
            let v = binary(Op::Multiply, &args[0], &args[1], pool)?;
            let terms: Vec<_> = v.parts.iter().map(|p| (*p, 1.0)).collect();
            let id = pool.sum(&terms, 0.0);
            Ok(Value { shape: Shape::Scalar, parts: vec![id], unit: v.unit })
        }
        "cross" => {
            count(2)?;
            let n = vectors(None)?;
            let unit = binary(Op::Multiply, &args[0], &args[1], pool)?.unit;
            let (a, b) = (&args[0].parts, &args[1].parts);
            let mut minor = |i: usize, j: usize| {
                let (p, q) = (pool.mul(a[i], b[j]), pool.mul(a[j], b[i]));
                pool.sub(p, q)
            };
            match n {
                2 => Ok(Value { shape: Shape::Scalar, parts: vec![minor(0, 1)], unit }),
                3 => Ok(Value {
                    shape: Shape::Vector(3),
                    parts: vec![minor(1, 2), minor(2, 0), minor(0, 1)],
                    unit,
                }),
                _ => Err(Trouble::Shape("cross takes vectors of 2 or 3".into())),
            }
        }
        _ => Err(Trouble::Unknown(format!("there is no function or table '{name}'"))),
    }
}
