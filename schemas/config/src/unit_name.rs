//! Units as they stand at the end of key names: `mass_kg`, `speed_km_h`.

/// Unit suffixes of key names and how the unit is printed, longest first.
const SUFFIXES: &[(&str, &str)] = &[
    ("n_m_s_per_rad", "N·m·s/rad"),
    ("n_m_s_rad", "N·m·s/rad"),
    ("n_m_per_rad", "N·m/rad"),
    ("n_m_per_deg", "N·m/deg"),
    ("n_m_rad", "N·m/rad"),
    ("n_m_deg", "N·m/deg"),
    ("m_per_rev", "m/rev"),
    ("mm_per_rev", "mm/rev"),
    ("n_s_per_mm", "N·s/mm"),
    ("n_s_per_m", "N·s/m"),
    ("n_s_mm", "N·s/mm"),
    ("n_s_m", "N·s/m"),
    ("n_per_mm", "N/mm"),
    ("n_per_m", "N/m"),
    ("rad_s2", "rad/s²"),
    ("deg_s2", "deg/s²"),
    ("kg_m3", "kg/m³"),
    ("kg_m2", "kg·m²"),
    ("kg_mm2", "kg·mm²"),
    ("rad_m", "rad·m"),
    ("deg_s", "deg/s"),
    ("rad_s", "rad/s"),
    ("km_h", "km/h"),
    ("kmh", "km/h"),
    ("kph", "km/h"),
    ("mph", "mph"),
    ("m_s2", "m/s²"),
    ("m_s", "m/s"),
    ("mm_s", "mm/s"),
    ("n_mm", "N/mm"),
    ("n_m", "N·m or N/m"),
    ("nm", "N·m"),
    ("l_min", "L/min"),
    ("per_s", "1/s"),
    ("percent", "%"),
    ("ticks", "ticks"),
    ("mpa", "MPa"),
    ("kpa", "kPa"),
    ("bar", "bar"),
    ("psi", "psi"),
    ("pa", "Pa"),
    ("rpm", "1/min"),
    ("deg", "deg"),
    ("rad", "rad"),
    ("rev", "rev"),
    ("khz", "kHz"),
    ("hz", "Hz"),
    ("min", "min"),
    ("ms", "ms"),
    ("us", "µs"),
    ("ns", "ns"),
    ("lbs", "lb"),
    ("lb", "lb"),
    ("kg", "kg"),
    ("g", "g"),
    ("t", "t"),
    ("km", "km"),
    ("mm", "mm"),
    ("cm", "cm"),
    ("cm2", "cm²"),
    ("mm2", "mm²"),
    ("m2", "m²"),
    ("m3", "m³"),
    ("inch", "in"),
    ("ft", "ft"),
    ("kn", "kN"),
    ("kw", "kW"),
    ("w", "W"),
    ("m", "m"),
    ("n", "N"),
    ("s", "s"),
];

/// Splits a key into its stem and its unit, if its end is one: `mass_kg` → (`mass`, `kg`).
pub(crate) fn split(key: &str) -> Option<(&str, &'static str)> {
    SUFFIXES
        .iter()
        .filter_map(|(suffix, unit)| {
            let stem = key.strip_suffix(suffix)?.strip_suffix('_')?;
            (!stem.is_empty()).then_some((stem, *unit))
        })
        .min_by_key(|(stem, _)| stem.len())
}

/// Unit of a value by the end of its key, as printed.
pub fn unit_of_key(key: &str) -> Option<&'static str> {
    split(key).map(|(_, unit)| unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_suffix_counts() {
        assert_eq!(split("mass_kg"), Some(("mass", "kg")));
        assert_eq!(split("speed_km_h"), Some(("speed", "km/h")));
        assert_eq!(split("damping_n_s_m"), Some(("damping", "N·s/m")));
        assert_eq!(split("stiffness_n_m_rad"), Some(("stiffness", "N·m/rad")));
        assert_eq!(split("name"), None);
        assert_eq!(split("kg"), None);
    }
}
