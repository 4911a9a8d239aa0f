//! Units of measurement as exponents of the SI base units, so that `N*m*s/rad * rad/s` is `N*m` and a force
//! cannot be added to a speed. Radian, degree and percent have dimension 1 (SI brochure, 9th edition, 2.3.3);
//! exponents are counted in twelfths so that square and cubic roots stay exact. The algebra is small and needs
//! text in both directions, which typed-quantity crates do at compile time only; hence our own.

use std::fmt;

/// Exponents of m, kg, s, A, K, mol in twelfths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Unit {
    exponents: [i16; 6],
}

/// One twelfth is the grain of an exponent.
const GRAIN: i16 = 12;

/// No gram, tonne and tesla: `g`, `t` and `T` are gravity, time and torque to the authors of models.
/// name, scale to SI, exponents of m kg s A K mol
const KNOWN: &[(&str, f64, [i16; 6])] = &[
    ("1", 1.0, [0, 0, 0, 0, 0, 0]),
    ("rad", 1.0, [0, 0, 0, 0, 0, 0]),
    ("deg", std::f64::consts::PI / 180.0, [0, 0, 0, 0, 0, 0]),
    ("rev", 2.0 * std::f64::consts::PI, [0, 0, 0, 0, 0, 0]),
    ("percent", 0.01, [0, 0, 0, 0, 0, 0]),
    ("m", 1.0, [1, 0, 0, 0, 0, 0]),
    ("km", 1e3, [1, 0, 0, 0, 0, 0]),
    ("cm", 1e-2, [1, 0, 0, 0, 0, 0]),
    ("mm", 1e-3, [1, 0, 0, 0, 0, 0]),
    ("um", 1e-6, [1, 0, 0, 0, 0, 0]),
    ("kg", 1.0, [0, 1, 0, 0, 0, 0]),
    ("s", 1.0, [0, 0, 1, 0, 0, 0]),
    ("ms", 1e-3, [0, 0, 1, 0, 0, 0]),
    ("us", 1e-6, [0, 0, 1, 0, 0, 0]),
    ("min", 60.0, [0, 0, 1, 0, 0, 0]),
    ("h", 3600.0, [0, 0, 1, 0, 0, 0]),
    ("A", 1.0, [0, 0, 0, 1, 0, 0]),
    ("mA", 1e-3, [0, 0, 0, 1, 0, 0]),
    ("K", 1.0, [0, 0, 0, 0, 1, 0]),
    ("mol", 1.0, [0, 0, 0, 0, 0, 1]),
    ("Hz", 1.0, [0, 0, -1, 0, 0, 0]),
    ("rpm", 2.0 * std::f64::consts::PI / 60.0, [0, 0, -1, 0, 0, 0]),
    ("N", 1.0, [1, 1, -2, 0, 0, 0]),
    ("kN", 1e3, [1, 1, -2, 0, 0, 0]),
    ("J", 1.0, [2, 1, -2, 0, 0, 0]),
    ("kJ", 1e3, [2, 1, -2, 0, 0, 0]),
    ("W", 1.0, [2, 1, -3, 0, 0, 0]),
    ("kW", 1e3, [2, 1, -3, 0, 0, 0]),
    ("Pa", 1.0, [-1, 1, -2, 0, 0, 0]),
    ("kPa", 1e3, [-1, 1, -2, 0, 0, 0]),
    ("MPa", 1e6, [-1, 1, -2, 0, 0, 0]),
    ("GPa", 1e9, [-1, 1, -2, 0, 0, 0]),
    ("bar", 1e5, [-1, 1, -2, 0, 0, 0]),
    ("L", 1e-3, [3, 0, 0, 0, 0, 0]),
    ("V", 1.0, [2, 1, -3, -1, 0, 0]),
    ("Ohm", 1.0, [2, 1, -3, -2, 0, 0]),
    ("mOhm", 1e-3, [2, 1, -3, -2, 0, 0]),
    ("F", 1.0, [-2, -1, 4, 2, 0, 0]),
    ("uF", 1e-6, [-2, -1, 4, 2, 0, 0]),
    ("H", 1.0, [2, 1, -2, -2, 0, 0]),
    ("mH", 1e-3, [2, 1, -2, -2, 0, 0]),
    ("Wb", 1.0, [2, 1, -2, -1, 0, 0]),
    ("C", 1.0, [0, 0, 1, 1, 0, 0]),
];

/// What one of `written` is in `si`, both texts such as `mm` and `m`.
///
/// # Errors
/// A unit nobody knows, or two of different dimension.
pub fn scale_of(written: &str, si: &str) -> Result<f64, String> {
    let ((a, scale), (b, of)) = (Unit::parse(written)?, Unit::parse(si)?);
    if a != b {
        return Err(format!("'{written}' is no unit of a quantity in {si}"));
    }
    Ok(scale / of)
}

impl Unit {
    /// The unit of pure numbers.
    pub const ONE: Unit = Unit { exponents: [0; 6] };
    /// Watt.
    pub const WATT: Unit = Unit { exponents: [2 * GRAIN, GRAIN, -3 * GRAIN, 0, 0, 0] };
    /// Joule.
    pub const JOULE: Unit = Unit { exponents: [2 * GRAIN, GRAIN, -2 * GRAIN, 0, 0, 0] };
    /// Second.
    pub const SECOND: Unit = Unit { exponents: [0, 0, GRAIN, 0, 0, 0] };
    /// Radian per second (1/s).
    pub const PER_SECOND: Unit = Unit { exponents: [0, 0, -GRAIN, 0, 0, 0] };

    /// Unit and scale to SI of a name such as `N` or `mm`; `None` when nobody knows it.
    pub fn named(name: &str) -> Option<(Unit, f64)> {
        KNOWN.iter().find(|k| k.0 == name).map(|k| (Unit { exponents: k.2.map(|e| e * GRAIN) }, k.1))
    }

    /// Reads a unit such as `N*m*s/rad`, `kg*m^2`, `1/s`, `N/(m/s)`. Returns the unit and its scale to SI.
    ///
    /// # Errors
    /// A sentence that names the piece that is not a unit.
    pub fn parse(text: &str) -> Result<(Unit, f64), String> {
        let mut reader = Reader { text: text.as_bytes(), at: 0 };
        let parsed = reader.product()?;
        reader.skip();
        if reader.at < reader.text.len() {
            return Err(format!("'{text}' is not a unit: cannot read '{}'", &text[reader.at..]));
        }
        Ok(parsed)
    }

    /// Product of two units.
    #[must_use]
    pub fn times(self, other: Unit) -> Unit {
        Unit { exponents: std::array::from_fn(|i| self.exponents[i] + other.exponents[i]) }
    }

    /// Quotient of two units.
    #[must_use]
    pub fn over(self, other: Unit) -> Unit {
        Unit { exponents: std::array::from_fn(|i| self.exponents[i] - other.exponents[i]) }
    }

    /// Power; `None` when an exponent would not be a twelfth.
    pub fn power(self, exponent: f64) -> Option<Unit> {
        let mut exponents = [0; 6];
        for i in 0..6 {
            let e = f64::from(self.exponents[i]) * exponent;
            if (e - e.round()).abs() > 1e-9 || e.abs() > 1e4 {
                return None;
            }
            exponents[i] = e.round() as i16;
        }
        Some(Unit { exponents })
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if *self == Unit::ONE {
            return f.write_str("1");
        }
        for name in ["N", "W", "Pa", "V", "Ohm", "F", "H", "Hz", "Wb"] {
            if Unit::named(name).is_some_and(|(u, _)| u == *self) {
                return f.write_str(if name == "Hz" { "rad/s" } else { name });
            }
        }
        for (text, num, den) in
            [("N*m", "J", "1"), ("N*m*s/rad", "J", "Hz"), ("N*s/m", "N", ""), ("N/m", "Pa", "")]
        {
            let matches = match text {
                "N*s/m" => Unit { exponents: [0, GRAIN, -GRAIN, 0, 0, 0] } == *self,
                "N/m" => Unit { exponents: [0, GRAIN, -2 * GRAIN, 0, 0, 0] } == *self,
                _ => match (Unit::named(num), Unit::named(den)) {
                    (Some((n, _)), Some((d, _))) => n.over(d) == *self,
                    _ => false,
                },
            };
            if matches {
                return f.write_str(text);
            }
        }
        const BASE: [&str; 6] = ["m", "kg", "s", "A", "K", "mol"];
        let part = |sign: i16| {
            let mut pieces = Vec::new();
            for (name, e) in BASE.iter().zip(self.exponents) {
                let e = e * sign;
                if e <= 0 {
                    continue;
                }
                if e == GRAIN {
                    pieces.push((*name).to_string());
                } else if e % GRAIN == 0 {
                    pieces.push(format!("{name}^{}", e / GRAIN));
                } else {
                    pieces.push(format!("{name}^({e}/{GRAIN})"));
                }
            }
            pieces
        };
        let (over, under) = (part(1), part(-1));
        let top = if over.is_empty() { "1".to_string() } else { over.join("*") };
        f.write_str(&top)?;
        for piece in under {
            write!(f, "/{piece}")?;
        }
        Ok(())
    }
}

struct Reader<'a> {
    text: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn skip(&mut self) {
        while self.at < self.text.len() && self.text[self.at].is_ascii_whitespace() {
            self.at += 1;
        }
    }

    fn peek(&mut self) -> Option<u8> {
        self.skip();
        self.text.get(self.at).copied()
    }

    fn product(&mut self) -> Result<(Unit, f64), String> {
        let (mut unit, mut scale) = self.factor()?;
        while let Some(op @ (b'*' | b'/')) = self.peek() {
            self.at += 1;
            let (u, s) = self.factor()?;
            if op == b'*' {
                unit = unit.times(u);
                scale *= s;
            } else {
                unit = unit.over(u);
                scale /= s;
            }
        }
        Ok((unit, scale))
    }

    fn factor(&mut self) -> Result<(Unit, f64), String> {
        let (unit, scale) = match self.peek() {
            Some(b'(') => {
                self.at += 1;
                let inner = self.product()?;
                if self.peek() != Some(b')') {
                    return Err("unit: ')' expected".into());
                }
                self.at += 1;
                inner
            }
            Some(c) if c.is_ascii_alphanumeric() => {
                let from = self.at;
                while self.at < self.text.len() && self.text[self.at].is_ascii_alphanumeric() {
                    self.at += 1;
                }
                let name = String::from_utf8_lossy(&self.text[from..self.at]).into_owned();
                Unit::named(&name).ok_or_else(|| format!("'{name}' is not a known unit"))?
            }
            _ => return Err("unit expected, such as N*m or kg*m^2".into()),
        };
        if self.peek() == Some(b'^') {
            self.at += 1;
            self.skip();
            let from = self.at;
            while self.at < self.text.len()
                && (self.text[self.at].is_ascii_digit() || self.text[self.at] == b'-')
            {
                self.at += 1;
            }
            let digits = String::from_utf8_lossy(&self.text[from..self.at]).into_owned();
            let e: i32 = digits.parse().map_err(|_| format!("unit: '{digits}' is not a whole exponent"))?;
            let unit = unit.power(f64::from(e)).ok_or("unit: exponent too large")?;
            return Ok((unit, scale.powi(e)));
        }
        Ok((unit, scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_multiply_and_scale() {
        let (loss, _) = Unit::parse("N*m*s/rad").unwrap();
        let (speed, _) = Unit::parse("rad/s").unwrap();
        assert_eq!(loss.times(speed), Unit::parse("N*m").unwrap().0);
        let (_, kmh) = Unit::parse("km/h").unwrap();
        assert!((kmh - 1.0 / 3.6).abs() < 1e-15);
        assert_eq!(Unit::parse("N/(m/s)").unwrap(), Unit::parse("N*s/m").unwrap());
        assert_eq!(Unit::parse("L/min").unwrap().0, Unit::parse("m^3/s").unwrap().0);
        assert!(Unit::parse("furlong").unwrap_err().contains("furlong"));
        assert!(Unit::parse("N*").is_err());
    }

    #[test]
    fn printed_units_read_back() {
        for text in ["N", "N*m", "kg*m^2", "m/s^2", "N*s/m", "N*m*s/rad", "m^3/s", "1/Pa", "A", "1"] {
            let unit = Unit::parse(text).unwrap().0;
            assert_eq!(Unit::parse(&unit.to_string()).unwrap().0, unit, "{text} printed as {unit}");
        }
    }
}
