//! Expressions as a shared, canonical graph. A sum carries the numeric coefficients of its terms and a constant;
//! a product carries exponents; both are sorted, so equal expressions have equal ids, like terms merge, and
//! `a - a` is zero. Products are never multiplied out. This is what elimination, units of work for the compiled
//! step, derivatives and symbolic text share; a general computer-algebra crate would do much more, allocate per
//! node, and know neither rates, sampled variables nor tables.

use std::collections::BTreeMap;

/// Index of an expression in its pool.
pub(crate) type Id = u32;

/// Functions of numbers. Truth is 1, falsehood 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Fun {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Exp,
    Ln,
    Sinh,
    Cosh,
    Tanh,
    Abs,
    Sign,
    Min,
    Max,
    /// Euclidean norm of the arguments.
    Norm,
    /// 1/x, and 0 at 0: the derivative of a norm at the origin.
    SafeInverse,
    /// Base and exponent both vary.
    Power,
    Less,
    LessEqual,
    And,
    Or,
    Not,
    /// if(condition, then, otherwise)
    If,
}

impl Fun {
    pub fn name(self) -> &'static str {
        match self {
            Fun::Sin => "sin",
            Fun::Cos => "cos",
            Fun::Tan => "tan",
            Fun::Asin => "asin",
            Fun::Acos => "acos",
            Fun::Atan => "atan",
            Fun::Atan2 => "atan2",
            Fun::Exp => "exp",
            Fun::Ln => "ln",
            Fun::Sinh => "sinh",
            Fun::Cosh => "cosh",
            Fun::Tanh => "tanh",
            Fun::Abs => "abs",
            Fun::Sign => "sign",
            Fun::Min => "min",
            Fun::Max => "max",
            Fun::Norm => "norm",
            Fun::SafeInverse => "safe_inverse",
            Fun::Power => "power",
            Fun::Less => "less",
            Fun::LessEqual => "less_equal",
            Fun::And => "both",
            Fun::Or => "either",
            Fun::Not => "not",
            Fun::If => "if",
        }
    }

    pub fn apply(self, a: &[f64]) -> f64 {
        let truth = |b: bool| f64::from(u8::from(b));
        match self {
            Fun::Sin => a[0].sin(),
            Fun::Cos => a[0].cos(),
            Fun::Tan => a[0].tan(),
            Fun::Asin => a[0].asin(),
            Fun::Acos => a[0].acos(),
            Fun::Atan => a[0].atan(),
            Fun::Atan2 => a[0].atan2(a[1]),
            Fun::Exp => a[0].exp(),
            Fun::Ln => a[0].ln(),
            Fun::Sinh => a[0].sinh(),
            Fun::Cosh => a[0].cosh(),
            Fun::Tanh => a[0].tanh(),
            Fun::Abs => a[0].abs(),
            Fun::Sign => {
                if a[0] > 0.0 {
                    1.0
                } else if a[0] < 0.0 {
                    -1.0
                } else {
                    0.0
                }
            }
            Fun::Min => a[0].min(a[1]),
            Fun::Max => a[0].max(a[1]),
            Fun::Norm => a.iter().map(|v| v * v).sum::<f64>().sqrt(),
            Fun::SafeInverse => {
                if a[0] == 0.0 {
                    0.0
                } else {
                    1.0 / a[0]
                }
            }
            Fun::Power => a[0].powf(a[1]),
            Fun::Less => truth(a[0] < a[1]),
            Fun::LessEqual => truth(a[0] <= a[1]),
            Fun::And => truth(a[0] != 0.0 && a[1] != 0.0),
            Fun::Or => truth(a[0] != 0.0 || a[1] != 0.0),
            Fun::Not => truth(a[0] == 0.0),
            Fun::If => {
                if a[0] != 0.0 {
                    a[1]
                } else {
                    a[2]
                }
            }
        }
    }
}

/// One node. `f64` fields are compared by their bits.
#[derive(Debug, Clone)]
pub(crate) enum Node {
    Number(f64),
    /// A parameter component.
    Parameter(u32),
    /// A scalar variable: state, algebraic, input or sampled.
    Variable(u32),
    /// Its time derivative.
    Rate(u32),
    Time,
    /// constant + sum of coefficient * term; terms are neither numbers nor sums with a single term.
    Sum(Vec<(Id, f64)>, f64),
    /// Product of base^exponent; no numeric factor, no nested product.
    Product(Vec<(Id, f64)>),
    Call(Fun, Vec<Id>),
    /// Table look-up; `along` = 0 value, 1.. derivative along that argument.
    Table {
        table: u32,
        along: u8,
        args: Vec<Id>,
    },
}

#[derive(PartialOrd, Ord, PartialEq, Eq)]
enum Key {
    Number(u64),
    Leaf(u8, u32),
    Sum(Vec<(Id, u64)>, u64),
    Product(Vec<(Id, u64)>),
    Call(Fun, Vec<Id>),
    Table(u32, u8, Vec<Id>),
}

/// The graph.
#[derive(Default)]
pub(crate) struct Pool {
    nodes: Vec<Node>,
    // Look-up only, never iterated: the order of the map cannot reach a result.
    known: BTreeMap<Key, Id>,
}

fn bits(pairs: &[(Id, f64)]) -> Vec<(Id, u64)> {
    pairs.iter().map(|(i, c)| (*i, c.to_bits())).collect()
}

impl Pool {
    pub fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    fn intern(&mut self, node: Node) -> Id {
        let key = match &node {
            Node::Number(n) => Key::Number(n.to_bits()),
            Node::Parameter(i) => Key::Leaf(0, *i),
            Node::Variable(i) => Key::Leaf(1, *i),
            Node::Rate(i) => Key::Leaf(2, *i),
            Node::Time => Key::Leaf(3, 0),
            Node::Sum(t, c) => Key::Sum(bits(t), c.to_bits()),
            Node::Product(f) => Key::Product(bits(f)),
            Node::Call(f, a) => Key::Call(*f, a.clone()),
            Node::Table { table, along, args } => Key::Table(*table, *along, args.clone()),
        };
        if let Some(id) = self.known.get(&key) {
            return *id;
        }
        let id = self.nodes.len() as Id;
        self.nodes.push(node);
        self.known.insert(key, id);
        id
    }

    pub fn number(&mut self, value: f64) -> Id {
        // -0 and 0 are one number here.
        self.intern(Node::Number(if value == 0.0 { 0.0 } else { value }))
    }

    pub fn parameter(&mut self, index: usize) -> Id {
        self.intern(Node::Parameter(index as u32))
    }

    pub fn variable(&mut self, index: usize) -> Id {
        self.intern(Node::Variable(index as u32))
    }

    pub fn rate(&mut self, index: usize) -> Id {
        self.intern(Node::Rate(index as u32))
    }

    pub fn time(&mut self) -> Id {
        self.intern(Node::Time)
    }

    pub fn as_number(&self, id: Id) -> Option<f64> {
        match self.node(id) {
            Node::Number(n) => Some(*n),
            _ => None,
        }
    }

    pub fn is_zero(&self, id: Id) -> bool {
        self.as_number(id) == Some(0.0)
    }

    /// Sum of coefficient * expression, plus a constant.
    pub fn sum(&mut self, terms: &[(Id, f64)], constant: f64) -> Id {
        let mut flat: Vec<(Id, f64)> = Vec::with_capacity(terms.len());
        let mut constant = constant;
        for &(id, c) in terms {
            if c == 0.0 {
                continue;
            }
            match self.node(id) {
                Node::Number(n) => constant += c * n,
                Node::Sum(inner, k) => {
                    constant += c * k;
                    flat.extend(inner.iter().map(|(i, d)| (*i, c * d)));
                }
                _ => flat.push((id, c)),
            }
        }
        flat.sort_by_key(|t| t.0);
        let mut merged: Vec<(Id, f64)> = Vec::with_capacity(flat.len());
        for (id, c) in flat {
            match merged.last_mut() {
                Some(last) if last.0 == id => last.1 += c,
                _ => merged.push((id, c)),
            }
        }
        merged.retain(|t| t.1 != 0.0);
        if merged.is_empty() {
            return self.number(constant);
        }
        if let [(id, c)] = merged[..]
            && c == 1.0
            && constant == 0.0
        {
            return id;
        }
        self.intern(Node::Sum(merged, if constant == 0.0 { 0.0 } else { constant }))
    }

    pub fn add(&mut self, a: Id, b: Id) -> Id {
        self.sum(&[(a, 1.0), (b, 1.0)], 0.0)
    }

    pub fn sub(&mut self, a: Id, b: Id) -> Id {
        self.sum(&[(a, 1.0), (b, -1.0)], 0.0)
    }

    pub fn scale(&mut self, a: Id, c: f64) -> Id {
        self.sum(&[(a, c)], 0.0)
    }

    /// Splits a numeric factor off: `3*x` is (3, x).
    pub fn split_factor(&mut self, id: Id) -> (f64, Id) {
        match self.node(id) {
            Node::Sum(terms, c) if *c == 0.0 && terms.len() == 1 => (terms[0].1, terms[0].0),
            // A sum with a common factor up to sign keeps its first coefficient positive: x - y and y - x share.
            Node::Sum(terms, c) if terms.iter().all(|t| t.1 == -1.0 || t.1 == 1.0) && terms[0].1 == -1.0 => {
                let (terms, c) = (terms.clone(), *c);
                let flipped: Vec<_> = terms.iter().map(|(i, k)| (*i, -k)).collect();
                (-1.0, self.sum(&flipped, -c))
            }
            _ => (1.0, id),
        }
    }

    /// Product of base^exponent.
    pub fn product(&mut self, factors: &[(Id, f64)]) -> Id {
        let mut number = 1.0;
        let mut flat: Vec<(Id, f64)> = Vec::with_capacity(factors.len());
        for &(id, e) in factors {
            if e == 0.0 {
                continue;
            }
            if let Some(n) = self.as_number(id) {
                number *= if e == 1.0 {
                    n
                } else if e == -1.0 {
                    1.0 / n
                } else {
                    n.powf(e)
                };
                continue;
            }
            let whole = e.fract() == 0.0;
            let (c, base) = if whole { self.split_factor(id) } else { (1.0, id) };
            if c != 1.0 {
                number *= c.powi(e as i32);
            }
            match self.node(base) {
                Node::Product(inner) if whole || inner.iter().all(|f| f.1.fract() != 0.0) => {
                    flat.extend(inner.iter().map(|(i, d)| (*i, d * e)));
                }
                _ => flat.push((base, e)),
            }
        }
        if number == 0.0 {
            return self.number(0.0);
        }
        flat.sort_by_key(|t| t.0);
        let mut merged: Vec<(Id, f64)> = Vec::with_capacity(flat.len());
        for (id, e) in flat {
            match merged.last_mut() {
                Some(last) if last.0 == id => last.1 += e,
                _ => merged.push((id, e)),
            }
        }
        merged.retain(|t| t.1 != 0.0);
        if merged.is_empty() {
            return self.number(number);
        }
        let core = if let [(id, e)] = merged[..]
            && e == 1.0
        {
            id
        } else {
            self.intern(Node::Product(merged))
        };
        self.sum(&[(core, number)], 0.0)
    }

    pub fn mul(&mut self, a: Id, b: Id) -> Id {
        self.product(&[(a, 1.0), (b, 1.0)])
    }

    pub fn div(&mut self, a: Id, b: Id) -> Id {
        self.product(&[(a, 1.0), (b, -1.0)])
    }

    pub fn call(&mut self, fun: Fun, args: &[Id]) -> Id {
        let numbers: Vec<f64> = args.iter().filter_map(|a| self.as_number(*a)).collect();
        if numbers.len() == args.len() {
            return self.number(fun.apply(&numbers));
        }
        match fun {
            Fun::If => {
                if let Some(c) = self.as_number(args[0]) {
                    return if c != 0.0 { args[1] } else { args[2] };
                }
                if args[1] == args[2] {
                    return args[1];
                }
            }
            Fun::Norm => {
                let live: Vec<Id> = args.iter().copied().filter(|a| !self.is_zero(*a)).collect();
                if live.len() == 1 {
                    return self.call(Fun::Abs, &live);
                }
                return self.intern(Node::Call(fun, live));
            }
            // Even and odd functions drop or move a sign, so that cos(-b) and cos(b) are one node.
            Fun::Cos | Fun::Abs | Fun::Cosh => {
                let (c, rest) = self.split_factor(args[0]);
                if c < 0.0 {
                    let positive = self.scale(rest, -c);
                    return self.intern(Node::Call(fun, vec![positive]));
                }
            }
            Fun::Sin | Fun::Tan | Fun::Tanh | Fun::Sinh | Fun::Atan | Fun::Asin | Fun::Sign => {
                let (c, rest) = self.split_factor(args[0]);
                if c < 0.0 {
                    let positive = self.scale(rest, -c);
                    let inner = self.intern(Node::Call(fun, vec![positive]));
                    return self.scale(inner, -1.0);
                }
            }
            _ => {}
        }
        self.intern(Node::Call(fun, args.to_vec()))
    }

    pub fn table(&mut self, table: u32, along: u8, args: &[Id]) -> Id {
        self.intern(Node::Table { table, along, args: args.to_vec() })
    }

    /// Direct children.
    pub fn children(&self, id: Id) -> Vec<Id> {
        match self.node(id) {
            Node::Sum(t, _) | Node::Product(t) => t.iter().map(|p| p.0).collect(),
            Node::Call(_, a) | Node::Table { args: a, .. } => a.clone(),
            _ => Vec::new(),
        }
    }

    /// Every node below the roots, children before parents.
    pub fn below(&self, roots: &[Id]) -> Vec<Id> {
        let mut seen = vec![false; self.nodes.len()];
        let mut stack: Vec<Id> = roots.to_vec();
        let mut found = Vec::new();
        while let Some(id) = stack.pop() {
            if !std::mem::replace(&mut seen[id as usize], true) {
                found.push(id);
                stack.extend(self.children(id));
            }
        }
        // Children are always interned before their parents.
        found.sort_unstable();
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_expressions_are_one_node() {
        let mut pool = Pool::default();
        let (a, b) = (pool.variable(0), pool.variable(1));
        let ab = pool.mul(a, b);
        let ba = pool.mul(b, a);
        assert_eq!(ab, ba);
        let zero = pool.sub(ab, ba);
        assert!(pool.is_zero(zero));
        let twice = pool.add(a, a);
        assert_eq!(pool.split_factor(twice), (2.0, a));
        let one = pool.div(a, a);
        assert_eq!(pool.as_number(one), Some(1.0));
        let (ma, c) = (pool.scale(a, -1.0), pool.call(Fun::Cos, &[a]));
        assert_eq!(pool.call(Fun::Cos, &[ma]), c);
        let s = pool.call(Fun::Sin, &[a]);
        let minus = pool.call(Fun::Sin, &[ma]);
        let sum = pool.add(s, minus);
        assert!(pool.is_zero(sum));
    }

    #[test]
    fn roots_of_squares_are_not_cancelled() {
        let mut pool = Pool::default();
        let a = pool.variable(0);
        let square = pool.product(&[(a, 2.0)]);
        let root = pool.product(&[(square, 0.5)]);
        assert_ne!(root, a);
    }
}
