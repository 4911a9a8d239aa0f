//! The expression language of model files: text to a syntax tree. Ordinary arithmetic with `^`, comparisons,
//! `and`/`or`/`not`, calls, vectors `[a, b]`, matrices `[[a, b], [c, d]]`, quantities (`0.05 m/s`), and `x'`
//! for the time derivative of a state. A dotted name may address a part's variable (`road.vF`) or a component
//! (`v.y`). A unit follows its number directly and reaches as far as it can: `2 N*m`.

use crate::units::Unit;

/// A syntax tree.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Ast {
    Number(f64),
    /// An inner expression in a unit.
    Quantity(Box<Ast>, Unit, f64),
    Name(String),
    /// `x'`
    Rate(String),
    Negate(Box<Ast>),
    Binary(Op, Box<Ast>, Box<Ast>),
    Call(String, Vec<Ast>),
    List(Vec<Ast>),
}

/// Binary operators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Op {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    And,
    Or,
}

#[derive(Debug, Clone, PartialEq)]
enum Token {
    Number(f64),
    Name(String),
    Rate(String),
    Symbol(&'static str),
}

/// Reads an expression.
pub(crate) fn parse(text: &str) -> Result<Ast, String> {
    let tokens = tokenise(text)?;
    let mut parser = Parser { tokens, at: 0, depth: 0 };
    let ast = parser.disjunction()?;
    if let Some(rest) = parser.tokens.get(parser.at) {
        return Err(format!("in '{text}': unexpected {}", show(rest)));
    }
    Ok(ast)
}

fn show(token: &Token) -> String {
    match token {
        Token::Number(n) => format!("number {n}"),
        Token::Name(n) => format!("name '{n}' (is an operator missing before it?)"),
        Token::Rate(n) => format!("'{n}''"),
        Token::Symbol(s) => format!("'{s}'"),
    }
}

const SYMBOLS: &[&str] = &["<=", ">=", "+", "-", "*", "/", "^", "(", ")", "[", "]", ",", "<", ">"];

fn tokenise(text: &str) -> Result<Vec<Token>, String> {
    let bytes = text.as_bytes();
    let mut tokens = Vec::new();
    let mut at = 0;
    'outer: while at < bytes.len() {
        let c = bytes[at];
        if c.is_ascii_whitespace() {
            at += 1;
        } else if c.is_ascii_digit() || (c == b'.' && bytes.get(at + 1).is_some_and(u8::is_ascii_digit)) {
            let from = at;
            while at < bytes.len() && (bytes[at].is_ascii_digit() || bytes[at] == b'.') {
                at += 1;
            }
            if at < bytes.len() && (bytes[at] | 32) == b'e' {
                let mut end = at + 1;
                if end < bytes.len() && (bytes[end] == b'+' || bytes[end] == b'-') {
                    end += 1;
                }
                if bytes.get(end).is_some_and(u8::is_ascii_digit) {
                    while bytes.get(end).is_some_and(u8::is_ascii_digit) {
                        end += 1;
                    }
                    at = end;
                }
            }
            let digits = &text[from..at];
            tokens.push(Token::Number(digits.parse().map_err(|_| format!("'{digits}' is not a number"))?));
        } else if c.is_ascii_alphabetic() || c == b'_' {
            let from = at;
            while at < bytes.len()
                && (bytes[at].is_ascii_alphanumeric()
                    || bytes[at] == b'_'
                    || (bytes[at] == b'.' && bytes.get(at + 1).is_some_and(u8::is_ascii_alphabetic)))
            {
                at += 1;
            }
            let name = text[from..at].to_string();
            if bytes.get(at) == Some(&b'\'') {
                at += 1;
                tokens.push(Token::Rate(name));
            } else {
                tokens.push(Token::Name(name));
            }
        } else {
            for symbol in SYMBOLS {
                if text[at..].starts_with(symbol) {
                    tokens.push(Token::Symbol(symbol));
                    at += symbol.len();
                    continue 'outer;
                }
            }
            let odd = text[at..].chars().next().unwrap_or('?');
            return Err(format!("in '{text}': cannot read '{odd}'"));
        }
    }
    Ok(tokens)
}

struct Parser {
    tokens: Vec<Token>,
    at: usize,
    depth: usize,
}

/// Deeper nesting than any sensible expression; bounds the recursion.
const DEPTH_MAX: usize = 200;

impl Parser {
    fn take(&mut self, symbol: &str) -> bool {
        if matches!(self.tokens.get(self.at), Some(Token::Symbol(s)) if *s == symbol) {
            self.at += 1;
            return true;
        }
        false
    }

    fn take_word(&mut self, word: &str) -> bool {
        if matches!(self.tokens.get(self.at), Some(Token::Name(n)) if n == word) {
            self.at += 1;
            return true;
        }
        false
    }

    fn disjunction(&mut self) -> Result<Ast, String> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err("expression is nested too deeply".into());
        }
        let mut left = self.conjunction()?;
        while self.take_word("or") {
            left = Ast::Binary(Op::Or, Box::new(left), Box::new(self.conjunction()?));
        }
        self.depth -= 1;
        Ok(left)
    }

    fn conjunction(&mut self) -> Result<Ast, String> {
        let mut left = self.comparison()?;
        while self.take_word("and") {
            left = Ast::Binary(Op::And, Box::new(left), Box::new(self.comparison()?));
        }
        Ok(left)
    }

    fn comparison(&mut self) -> Result<Ast, String> {
        if self.take_word("not") {
            return Ok(Ast::Call("not".into(), vec![self.comparison()?]));
        }
        let left = self.sum()?;
        for (symbol, op) in
            [("<=", Op::LessEqual), (">=", Op::GreaterEqual), ("<", Op::Less), (">", Op::Greater)]
        {
            if self.take(symbol) {
                return Ok(Ast::Binary(op, Box::new(left), Box::new(self.sum()?)));
            }
        }
        Ok(left)
    }

    fn sum(&mut self) -> Result<Ast, String> {
        let mut left = self.product()?;
        loop {
            if self.take("+") {
                left = Ast::Binary(Op::Add, Box::new(left), Box::new(self.product()?));
            } else if self.take("-") {
                left = Ast::Binary(Op::Subtract, Box::new(left), Box::new(self.product()?));
            } else {
                return Ok(left);
            }
        }
    }

    fn product(&mut self) -> Result<Ast, String> {
        let mut left = self.sign()?;
        loop {
            if self.take("*") {
                left = Ast::Binary(Op::Multiply, Box::new(left), Box::new(self.sign()?));
            } else if self.take("/") {
                left = Ast::Binary(Op::Divide, Box::new(left), Box::new(self.sign()?));
            } else {
                return Ok(left);
            }
        }
    }

    fn sign(&mut self) -> Result<Ast, String> {
        self.depth += 1;
        if self.depth > DEPTH_MAX {
            return Err("expression is nested too deeply".into());
        }
        let result = if self.take("-") {
            Ok(Ast::Negate(Box::new(self.sign()?)))
        } else if self.take("+") {
            self.sign()
        } else {
            self.power()
        };
        self.depth -= 1;
        result
    }

    fn power(&mut self) -> Result<Ast, String> {
        let base = self.atom()?;
        if self.take("^") {
            return Ok(Ast::Binary(Op::Power, Box::new(base), Box::new(self.sign()?)));
        }
        Ok(base)
    }

    fn atom(&mut self) -> Result<Ast, String> {
        if self.take("(") {
            let inner = self.disjunction()?;
            if !self.take(")") {
                return Err("')' is missing".into());
            }
            return Ok(inner);
        }
        if self.take("[") {
            let mut items = vec![self.disjunction()?];
            while self.take(",") {
                items.push(self.disjunction()?);
            }
            if !self.take("]") {
                return Err("']' is missing".into());
            }
            return self.with_unit(Ast::List(items));
        }
        match self.tokens.get(self.at).cloned() {
            Some(Token::Number(n)) => {
                self.at += 1;
                self.with_unit(Ast::Number(n))
            }
            Some(Token::Rate(name)) => {
                self.at += 1;
                Ok(Ast::Rate(name))
            }
            Some(Token::Name(name)) => {
                self.at += 1;
                if self.take("(") {
                    let mut args = Vec::new();
                    if !self.take(")") {
                        args.push(self.disjunction()?);
                        while self.take(",") {
                            args.push(self.disjunction()?);
                        }
                        if !self.take(")") {
                            return Err(format!("')' is missing after the arguments of {name}"));
                        }
                    }
                    return Ok(Ast::Call(name, args));
                }
                Ok(Ast::Name(name))
            }
            Some(other) => Err(format!("unexpected {}", show(&other))),
            None => Err("the expression ends too early".into()),
        }
    }

    /// A unit directly after a number or a list.
    fn with_unit(&mut self, inner: Ast) -> Result<Ast, String> {
        let Some((mut unit, mut scale)) = self.unit_factor() else {
            return Ok(inner);
        };
        loop {
            let divide = match self.tokens.get(self.at) {
                Some(Token::Symbol("*")) => false,
                Some(Token::Symbol("/")) => true,
                _ => break,
            };
            self.at += 1;
            let Some((u, s)) = self.unit_factor() else {
                self.at -= 1;
                break;
            };
            unit = if divide { unit.over(u) } else { unit.times(u) };
            scale = if divide { scale / s } else { scale * s };
        }
        Ok(Ast::Quantity(Box::new(inner), unit, scale))
    }

    fn unit_factor(&mut self) -> Option<(Unit, f64)> {
        // "1/s" after a number: the 1 is part of the unit.
        if let (Some(Token::Number(n)), Some(Token::Symbol("/"))) =
            (self.tokens.get(self.at), self.tokens.get(self.at + 1))
            && *n == 1.0
            && matches!(self.tokens.get(self.at.wrapping_sub(1)), Some(Token::Number(_) | Token::Symbol("]")))
        {
            self.at += 1;
            return Some((Unit::ONE, 1.0));
        }
        if let (Some(Token::Symbol("(")), true) = (self.tokens.get(self.at), self.at > 0) {
            // "N/(m/s)" only continues a unit; a bracket never starts one.
            if !matches!(self.tokens.get(self.at - 1), Some(Token::Symbol("/" | "*"))) {
                return None;
            }
            let from = self.at;
            self.at += 1;
            let mut result = self.unit_factor();
            while let Some((u, s)) = result {
                if self.take(")") {
                    return Some((u, s));
                }
                let divide = if self.take("*") {
                    false
                } else if self.take("/") {
                    true
                } else {
                    break;
                };
                result = self
                    .unit_factor()
                    .map(|(v, t)| if divide { (u.over(v), s / t) } else { (u.times(v), s * t) });
            }
            self.at = from;
            return None;
        }
        let Some(Token::Name(name)) = self.tokens.get(self.at) else {
            return None;
        };
        let (unit, scale) = Unit::named(name)?;
        if matches!(self.tokens.get(self.at + 1), Some(Token::Symbol("("))) {
            return None;
        }
        self.at += 1;
        if let (Some(Token::Symbol("^")), Some(Token::Number(e))) =
            (self.tokens.get(self.at), self.tokens.get(self.at + 1))
            && let Some(powered) = unit.power(*e)
        {
            let scale = scale.powf(*e);
            self.at += 2;
            return Some((powered, scale));
        }
        Some((unit, scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantities_take_their_unit_and_no_more() {
        let Ast::Quantity(inner, unit, scale) = parse("-12 N*m").unwrap_negated() else { panic!("quantity") };
        assert_eq!((*inner, scale), (Ast::Number(12.0), 1.0));
        assert_eq!(unit, Unit::parse("N*m").unwrap().0);
        let Ast::Binary(Op::Less, _, right) = parse("norm(v) < 0.05 m/s").unwrap() else { panic!("less") };
        assert!(matches!(*right, Ast::Quantity(..)));
        // N here is a name: no number stands before it.
        assert!(matches!(parse("-N^2/D0").unwrap(), Ast::Binary(Op::Divide, ..) | Ast::Negate(_)));
        assert!(matches!(parse("[1, 0] m/s").unwrap(), Ast::Quantity(..)));
        assert!(matches!(parse("5 1/s").unwrap(), Ast::Quantity(..)));
        assert!(matches!(parse("2 N/(m/s)").unwrap(), Ast::Quantity(..)));
    }

    trait Negated {
        fn unwrap_negated(self) -> Ast;
    }
    impl Negated for Result<Ast, String> {
        fn unwrap_negated(self) -> Ast {
            match self.unwrap() {
                Ast::Negate(inner) => *inner,
                other => other,
            }
        }
    }

    #[test]
    fn mistakes_are_named() {
        assert!(parse("2 x").unwrap_err().contains("operator missing"));
        assert!(parse("(a + b").unwrap_err().contains("')'"));
        assert!(parse("a $ b").unwrap_err().contains('$'));
        assert!(parse("").is_err());
    }
}
