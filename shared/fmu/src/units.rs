//! Units of FMU variables and of the bench: exponents of the SI base units, factor and offset.
//!
//! FMI 2.0 §2.2.2, FMI 3.0 §2.4.3: value in base units = factor · value + offset. FMI counts the radian as a base
//! unit, but many tools leave it out; angles and numbers are therefore taken as one dimension, which is what the SI
//! does. Where a `Unit` has no `BaseUnit` its name is read with the symbols below.

/// A unit: what it measures, and its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Exponents of kg, m, s, A, K, mol, cd.
    pub exponents: [i32; 7],
    /// Value in base units of one of it.
    pub factor: f64,
    /// Value in base units of its zero.
    pub offset: f64,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Symbols with exponents of kg, m, s, A, K; factor; offset.
#[rustfmt::skip]
const SYMBOLS: &[(&str, [i32; 5], f64, f64)] = &[
    ("1", [0; 5], 1.0, 0.0), ("-", [0; 5], 1.0, 0.0), ("%", [0; 5], 0.01, 0.0),
    ("rad", [0; 5], 1.0, 0.0), ("deg", [0; 5], DEGREE, 0.0), ("°", [0; 5], DEGREE, 0.0),
    ("rev", [0; 5], std::f64::consts::TAU, 0.0), ("rpm", [0, 0, -1, 0, 0], std::f64::consts::TAU / 60.0, 0.0),
    ("m", [0, 1, 0, 0, 0], 1.0, 0.0), ("mm", [0, 1, 0, 0, 0], 1e-3, 0.0), ("cm", [0, 1, 0, 0, 0], 1e-2, 0.0),
    ("km", [0, 1, 0, 0, 0], 1e3, 0.0),
    ("s", [0, 0, 1, 0, 0], 1.0, 0.0), ("ms", [0, 0, 1, 0, 0], 1e-3, 0.0), ("min", [0, 0, 1, 0, 0], 60.0, 0.0),
    ("h", [0, 0, 1, 0, 0], 3600.0, 0.0), ("Hz", [0, 0, -1, 0, 0], 1.0, 0.0),
    ("kg", [1, 0, 0, 0, 0], 1.0, 0.0), ("g", [1, 0, 0, 0, 0], 1e-3, 0.0), ("t", [1, 0, 0, 0, 0], 1e3, 0.0),
    ("N", [1, 1, -2, 0, 0], 1.0, 0.0), ("kN", [1, 1, -2, 0, 0], 1e3, 0.0),
    ("Nm", [1, 2, -2, 0, 0], 1.0, 0.0), ("J", [1, 2, -2, 0, 0], 1.0, 0.0), ("kJ", [1, 2, -2, 0, 0], 1e3, 0.0),
    ("W", [1, 2, -3, 0, 0], 1.0, 0.0), ("kW", [1, 2, -3, 0, 0], 1e3, 0.0),
    ("Pa", [1, -1, -2, 0, 0], 1.0, 0.0), ("kPa", [1, -1, -2, 0, 0], 1e3, 0.0),
    ("MPa", [1, -1, -2, 0, 0], 1e6, 0.0), ("bar", [1, -1, -2, 0, 0], 1e5, 0.0),
    ("A", [0, 0, 0, 1, 0], 1.0, 0.0), ("V", [1, 2, -3, -1, 0], 1.0, 0.0),
    ("K", [0, 0, 0, 0, 1], 1.0, 0.0), ("degC", [0, 0, 0, 0, 1], 1.0, 273.15), ("°C", [0, 0, 0, 0, 1], 1.0, 273.15),
    ("kph", [0, 1, -1, 0, 0], 1.0 / 3.6, 0.0), ("mph", [0, 1, -1, 0, 0], 0.447_04, 0.0),
];

impl Unit {
    /// Of a pure number.
    pub const ONE: Unit = Unit { exponents: [0; 7], factor: 1.0, offset: 0.0 };

    /// Reads a unit by its name: symbols joined by `*`, `·`, `.` and `/`, with powers (`m/s^2`, `m/s2`, `N*m/rad`).
    /// `None` where a symbol is not known.
    #[must_use]
    pub fn parse(text: &str) -> Option<Unit> {
        let text: String = text.chars().filter(|c| !c.is_whitespace() && *c != '(' && *c != ')').collect();
        let text = text.replace(['·', '.'], "*").replace('²', "^2").replace('³', "^3");
        if text.is_empty() {
            return None;
        }
        let mut all = Unit::ONE;
        let mut offset = None;
        let mut parts = 0;
        for (k, quotient) in text.split('/').enumerate() {
            for term in quotient.split('*') {
                // N*m/(rad*s): everything behind the stroke divides.
                let sign = if k == 0 { 1 } else { -1 };
                let (symbol, power) = power_of(term)?;
                let (_, exponents, factor, zero) = SYMBOLS.iter().find(|(name, ..)| *name == symbol)?;
                let power = sign * power;
                for (sum, e) in all.exponents.iter_mut().zip(exponents) {
                    *sum += power * e;
                }
                all.factor *= factor.powi(power);
                if *zero != 0.0 {
                    offset = Some((*zero, power));
                }
                parts += 1;
            }
        }
        match offset {
            // A scale with a zero of its own makes sense alone only.
            Some((zero, 1)) if parts == 1 => all.offset = zero,
            Some(_) => return None,
            None => {}
        }
        Some(all)
    }

    /// Whether both measure the same.
    #[must_use]
    pub fn same_quantity(&self, other: &Unit) -> bool {
        self.exponents == other.exponents
    }
}

fn power_of(term: &str) -> Option<(&str, i32)> {
    if SYMBOLS.iter().any(|(name, ..)| *name == term) {
        return Some((term, 1));
    }
    if let Some((symbol, power)) = term.split_once('^') {
        return Some((symbol, power.parse().ok()?));
    }
    let at = term.find(|c: char| c.is_ascii_digit() || c == '-')?;
    Some((&term[..at], term[at..].parse().ok()?))
}

/// From one unit to another: target = gain · source + zero.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Conversion {
    /// Factor.
    pub gain: f64,
    /// What is added.
    pub zero: f64,
}

impl Conversion {
    /// Nothing changes.
    pub const NONE: Conversion = Conversion { gain: 1.0, zero: 0.0 };

    /// Between units of one quantity; `None` for others.
    #[must_use]
    pub fn between(source: &Unit, target: &Unit) -> Option<Conversion> {
        if !source.same_quantity(target) {
            return None;
        }
        Some(Conversion {
            gain: source.factor / target.factor,
            zero: (source.offset - target.offset) / target.factor,
        })
    }

    /// Converts. Exactly the value itself where both ends have the same unit.
    #[must_use]
    pub fn apply(&self, value: f64) -> f64 {
        self.gain * value + self.zero
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read() {
        let of = |text| Unit::parse(text).unwrap_or_else(|| panic!("{text}"));
        assert!(of("N*m").same_quantity(&of("J")));
        assert!(of("rad/s").same_quantity(&of("1/s")));
        assert!(of("m/s2").same_quantity(&of("m/s^2")));
        assert!(!of("m/s").same_quantity(&of("m/s2")));
        assert!((of("km/h").factor - 1.0 / 3.6).abs() < 1e-15);
        assert_eq!(of("bar").factor, 1e5);
        assert!(of("N/m^2").same_quantity(&of("Pa")));
        assert_eq!(Unit::parse("furlong"), None);
        assert_eq!(Unit::parse(""), None);
    }

    #[test]
    fn conversion_goes_by_factor_and_offset() {
        let (celsius, kelvin) = (Unit::parse("degC").unwrap(), Unit::parse("K").unwrap());
        let up = Conversion::between(&celsius, &kelvin).unwrap();
        let down = Conversion::between(&kelvin, &celsius).unwrap();
        assert_eq!(up.apply(20.0), 293.15);
        assert!((down.apply(293.15) - 20.0).abs() < 1e-12);
        let pascal = Unit::parse("Pa").unwrap();
        assert_eq!(Conversion::between(&pascal, &kelvin), None);
        assert_eq!(Conversion::between(&pascal, &pascal), Some(Conversion::NONE));
        assert_eq!(Conversion::between(&pascal, &Unit::parse("bar").unwrap()).unwrap().apply(5e5), 5.0);
    }
}
