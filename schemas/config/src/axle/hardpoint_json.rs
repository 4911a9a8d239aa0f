//! The plain hardpoint JSON format: points by name, both sides listed, SI.
//!
//! Other keys at the top level (`frame`, `source`, …) are descriptions and are left alone, but not one that looks
//! like a key misspelt: without its stiffness a stabiliser would silently be missing. Everything that is read is
//! checked, and all that is wrong is reported together.

use serde_json::Value;

use super::{
    Axle, DoubleWishbone, DoubleWishbonePoints, FiveLink, FiveLinkPoints, Geometry, Link, Stabiliser,
    StabiliserPoints, Strut, StrutPoints, StrutReactionLine,
};
use crate::Broken;

/// Keys that mean something at the top level.
const KEYS: [&str; 12] = [
    "name",
    "type",
    "frame",
    "source",
    "rack_full_m",
    "loaded_radius",
    "static_toe_in_rad",
    "static_camber_rad",
    "arb_stiffness_Nm_per_rad",
    "spring_on",
    "left",
    "right",
];
/// Likeness (Jaro, Winkler) from which an unknown key is taken for a misspelt one.
const MISSPELT: f64 = 0.88;

/// Walks the document and collects what is wrong with it.
struct Reader<'a> {
    root: &'a Value,
    broken: Vec<Broken>,
}

impl Reader<'_> {
    fn complain(&mut self, key: &str, rule: &str) {
        self.broken.push(Broken { key: key.to_owned(), rule: rule.to_owned() });
    }

    fn number(&mut self, key: &str) -> f64 {
        match self.root.get(key).and_then(Value::as_f64) {
            Some(x) if x.is_finite() => x,
            _ => {
                self.complain(key, "must be given as a finite number");
                f64::NAN
            }
        }
    }

    fn numbers<const N: usize>(&mut self, value: Option<&Value>, key: &str) -> [f64; N] {
        let list = value.and_then(Value::as_array).map(|a| a.iter().map(Value::as_f64).collect::<Vec<_>>());
        let mut numbers = [f64::NAN; N];
        match list {
            Some(list) if list.len() == N && list.iter().all(Option::is_some) => {
                for (to, from) in numbers.iter_mut().zip(&list) {
                    *to = from.unwrap_or(f64::NAN);
                }
            }
            _ => self.complain(key, &format!("must be given as a list of {N} numbers")),
        }
        numbers
    }

    fn point(&mut self, side: &str, name: &str) -> [f64; 3] {
        let root = self.root;
        self.numbers(root.get(side).and_then(|s| s.get(name)), &format!("{side}.{name}"))
    }

    fn spin_axis(&mut self, side: &str) -> Option<[f64; 3]> {
        let given = self.root.get(side)?.get("spin_axis").is_some();
        given.then(|| self.point(side, "spin_axis"))
    }

    fn stabiliser_points(&mut self, side: &str) -> StabiliserPoints {
        StabiliserPoints {
            arb_bush_m: self.point(side, "arb_bush"),
            arb_arm_end_m: self.point(side, "arb_arm_end"),
            droplink_upper_m: self.point(side, "droplink_upper"),
        }
    }
}

/// Reads the document; the axle's own rules are checked by the caller.
pub(super) fn read(text: &str, name: &str) -> Result<Axle, Vec<Broken>> {
    let root: Value = serde_json::from_str(text)
        .map_err(|e| vec![Broken { key: String::new(), rule: format!("must be JSON: {e}") }])?;
    let mut reader = Reader { root: &root, broken: Vec::new() };
    for key in root.as_object().iter().flat_map(|object| object.keys()) {
        if !KEYS.contains(&key.as_str())
            && let Some(meant) = KEYS.iter().find(|known| strsim::jaro_winkler(known, key) >= MISSPELT)
        {
            reader.complain(key, &format!("unknown key (did you mean {meant}?)"));
        }
    }
    let kind = root.get("type").and_then(Value::as_str);
    let geometry = match kind {
        Some("double_wishbone") => {
            let [left, right] = ["left", "right"].map(|side| {
                let spin_axis = reader.spin_axis(side);
                DoubleWishbonePoints::from_named(|point| reader.point(side, point), spin_axis)
            });
            Some(Geometry::DoubleWishbone(DoubleWishbone { left, right: Some(right) }))
        }
        Some("macpherson_strut" | "strut") => {
            let [left, right] = ["left", "right"].map(|side| {
                let spin_axis = reader.spin_axis(side);
                StrutPoints::from_named(|point| reader.point(side, point), spin_axis)
            });
            let reaction_line = StrutReactionLine::StrutAxis;
            Some(Geometry::Strut(Strut { reaction_line, left, right: Some(right) }))
        }
        Some("five_link") => {
            let spring_on = root.get("spring_on").and_then(Value::as_str);
            let spring_on = Link::ALL.into_iter().find(|link| Some(link.name()) == spring_on);
            if spring_on.is_none() {
                reader.complain("spring_on", "must name one of the four links");
            }
            let [left, right] = ["left", "right"].map(|side| {
                let spin_axis = reader.spin_axis(side);
                FiveLinkPoints::from_named(|point| reader.point(side, point), spin_axis)
            });
            let right = Some(right);
            spring_on.map(|spring_on| Geometry::FiveLink(FiveLink { spring_on, left, right }))
        }
        _ => {
            reader.complain("type", "must be double_wishbone, macpherson_strut or five_link");
            None
        }
    };
    let stabiliser = root.get("arb_stiffness_Nm_per_rad").map(|_| Stabiliser {
        stiffness_n_m_per_rad: reader.number("arb_stiffness_Nm_per_rad"),
        left: reader.stabiliser_points("left"),
        right: Some(reader.stabiliser_points("right")),
    });
    let rack_stroke_m = reader.number("rack_full_m");
    let loaded_radius_m = reader.number("loaded_radius");
    let static_toe_in_rad = reader.numbers(root.get("static_toe_in_rad"), "static_toe_in_rad");
    let static_camber_rad = reader.numbers(root.get("static_camber_rad"), "static_camber_rad");
    let text_of = |key: &str| root.get(key).and_then(Value::as_str).map(str::to_owned);
    match geometry {
        Some(geometry) if reader.broken.is_empty() => Ok(Axle {
            name: text_of("name").unwrap_or_else(|| name.to_owned()),
            source: text_of("source").unwrap_or_else(|| name.to_owned()),
            rack_stroke_m,
            loaded_radius_m,
            static_toe_in_rad,
            static_camber_rad,
            geometry,
            stabiliser,
            bushings: None,
            kingpin_friction: None,
        }),
        _ => Err(reader.broken),
    }
}
