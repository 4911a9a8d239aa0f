//! Units of signals and variables: the same quantity or not, and what to multiply by.

/// A unit: SI base dimensions as exponents, and its size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Quantity; units convert within one only.
    pub quantity: &'static str,
    /// SI value of one unit.
    pub scale: f64,
    /// SI value of zero of the unit.
    pub zero: f64,
}

/// SI value of any quantity.
pub const ANY: Unit = Unit { quantity: "any quantity", scale: 1.0, zero: 0.0 };

const fn unit(quantity: &'static str, scale: f64) -> Unit {
    Unit { quantity, scale, zero: 0.0 }
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;
const TURN_PER_MINUTE: f64 = std::f64::consts::TAU / 60.0;
const G: f64 = 9.806_65;

/// Spellings seen in DBC files and in the table, without blanks, lower case where case says nothing.
const UNITS: &[(&str, Unit)] = &[
    ("si", ANY),
    ("1", unit("number", 1.0)),
    ("-", unit("number", 1.0)),
    ("%", unit("number", 0.01)),
    ("km/h", unit("speed", 1.0 / 3.6)),
    ("kph", unit("speed", 1.0 / 3.6)),
    ("kmh", unit("speed", 1.0 / 3.6)),
    ("mph", unit("speed", 0.447_04)),
    ("m/s", unit("speed", 1.0)),
    ("mm/s", unit("speed", 1e-3)),
    ("m/s2", unit("acceleration", 1.0)),
    ("m/s^2", unit("acceleration", 1.0)),
    ("m/s²", unit("acceleration", 1.0)),
    ("m/s/s", unit("acceleration", 1.0)),
    ("g", unit("acceleration", G)),
    ("rad", unit("angle", 1.0)),
    ("deg", unit("angle", DEGREE)),
    ("degree", unit("angle", DEGREE)),
    ("degrees", unit("angle", DEGREE)),
    ("°", unit("angle", DEGREE)),
    ("rad/s", unit("angular velocity", 1.0)),
    ("deg/s", unit("angular velocity", DEGREE)),
    ("deg/sec", unit("angular velocity", DEGREE)),
    ("degree/s", unit("angular velocity", DEGREE)),
    ("°/s", unit("angular velocity", DEGREE)),
    ("rpm", unit("angular velocity", TURN_PER_MINUTE)),
    ("1/min", unit("angular velocity", TURN_PER_MINUTE)),
    ("u/min", unit("angular velocity", TURN_PER_MINUTE)),
    ("n*m", unit("torque", 1.0)),
    ("n·m", unit("torque", 1.0)),
    ("nm", unit("torque", 1.0)),
    ("cnm", unit("torque", 0.01)),
    ("n", unit("force", 1.0)),
    ("kn", unit("force", 1e3)),
    ("pa", unit("pressure", 1.0)),
    ("hpa", unit("pressure", 1e2)),
    ("kpa", unit("pressure", 1e3)),
    ("mpa", unit("pressure", 1e6)),
    ("bar", unit("pressure", 1e5)),
    ("mbar", unit("pressure", 1e2)),
    ("psi", unit("pressure", 6_894.757_293_168)),
    ("m", unit("length", 1.0)),
    ("mm", unit("length", 1e-3)),
    ("cm", unit("length", 1e-2)),
    ("km", unit("length", 1e3)),
    ("s", unit("time", 1.0)),
    ("sec", unit("time", 1.0)),
    ("ms", unit("time", 1e-3)),
    ("v", unit("voltage", 1.0)),
    ("mv", unit("voltage", 1e-3)),
    ("a", unit("current", 1.0)),
    ("ma", unit("current", 1e-3)),
    ("w", unit("power", 1.0)),
    ("kw", unit("power", 1e3)),
    ("j", unit("energy", 1.0)),
    ("k", unit("temperature", 1.0)),
    ("degc", Unit { quantity: "temperature", scale: 1.0, zero: 273.15 }),
    ("°c", Unit { quantity: "temperature", scale: 1.0, zero: 273.15 }),
    ("c", Unit { quantity: "temperature", scale: 1.0, zero: 273.15 }),
    ("kg", unit("mass", 1.0)),
];

/// The unit of that spelling. Empty: none is stated.
pub fn parse(text: &str) -> Option<Unit> {
    let plain: String = text.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_lowercase();
    UNITS.iter().find(|(name, _)| *name == plain).map(|(_, unit)| *unit)
}

/// Factor and offset from one unit to another of the same quantity: y = x · factor + offset.
pub fn conversion(from: Unit, to: Unit) -> Option<(f64, f64)> {
    if from.quantity != to.quantity {
        return None;
    }
    if from == to {
        return Some((1.0, 0.0));
    }
    Some((from.scale / to.scale, (from.zero - to.zero) / to.scale))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn units_convert_within_a_quantity_only() {
        let between = |a: &str, b: &str| conversion(parse(a).unwrap(), parse(b).unwrap());
        assert!((between("m/s", "km/h").unwrap().0 - 3.6).abs() < 1e-12);
        assert!((between("rad/s", "rpm").unwrap().0 - 9.549_296_585_513_72).abs() < 1e-12);
        assert_eq!(between("K", "degC").unwrap(), (1.0, -273.15));
        assert_eq!(between("N*m", "Nm").unwrap(), (1.0, 0.0));
        assert_eq!(between("N*m", "N"), None);
        assert_eq!(between("deg", "deg/s"), None);
        assert!(parse("").is_none() && parse("furlong").is_none());
    }

    #[test]
    fn every_spelling_stands_once() {
        for (i, (name, _)) in UNITS.iter().enumerate() {
            assert!(UNITS[..i].iter().all(|(other, _)| other != name), "{name}");
            assert_eq!(parse(name), Some(UNITS[i].1), "{name}");
        }
    }
}
