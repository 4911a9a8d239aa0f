//! The shipped axle files parse and obey every rule; broken ones are told apart, all at once.

use super::*;
use crate::Broken;

const SHIPPED: &[(&str, &str)] = &[
    ("sedan_double_wishbone", include_str!("../../../suspensions/sedan_double_wishbone.toml")),
    (
        "sedan_double_wishbone_bushings",
        include_str!("../../../suspensions/sedan_double_wishbone_bushings.toml"),
    ),
    ("compact_strut", include_str!("../../../suspensions/compact_strut.toml")),
    ("sedan_five_link", include_str!("../../../suspensions/sedan_five_link.toml")),
];

fn shipped(name: &str) -> Axle {
    let (_, text) = SHIPPED.iter().find(|(n, _)| *n == name).unwrap();
    toml::from_str(text).unwrap()
}

fn keys(axle: &Axle) -> Vec<String> {
    axle.broken().into_iter().map(|b| b.key).collect()
}

#[test]
fn shipped_axles_parse_obey_the_rules_and_round_trip() {
    for (name, text) in SHIPPED {
        let axle: Axle = toml::from_str(text).unwrap();
        assert_eq!(axle.name, *name);
        assert_eq!(axle.broken(), [], "{name}");
        let again: Axle = toml::from_str(&toml::to_string(&axle).unwrap()).unwrap();
        assert_eq!(again, axle);
    }
}

#[test]
fn unknown_and_missing_keys_are_refused() {
    let text = SHIPPED[0].1;
    for (from, to) in [
        ("uca_ball_m", "uca_bal_m"),
        ("loaded_radius_m", "loaded_radius"),
        ("type = \"double_wishbone\"", "type = \"wishbone\""),
        ("name = \"sedan_double_wishbone\"", ""),
    ] {
        assert!(toml::from_str::<Axle>(&text.replace(from, to)).is_err(), "{from} -> {to}");
    }
}

#[test]
fn a_missing_side_is_the_mirror_image() {
    let mut axle = shipped("compact_strut");
    axle.static_toe_in_rad = [0.01, 0.02];
    axle.static_camber_rad = [-0.01, 0.015];
    assert_eq!(axle.geometry.point(1, "strut_top"), Some([-0.02897, -0.541, 0.516]));
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let s = axle.spin_axis(side);
        // Toe-in: the left wheel steers right (negative), the right one left; camber + = top outward.
        assert!(((-s[0]).atan2(s[1]) + sign * axle.static_toe_in_rad[side]).abs() < 1e-15);
        assert!(((-sign * s[2]).asin() - axle.static_camber_rad[side]).abs() < 1e-15);
    }
}

#[test]
fn every_broken_rule_is_reported_with_its_key() {
    let mut axle = shipped("compact_strut");
    axle.rack_stroke_m = f64::NAN;
    axle.static_camber_rad[1] = 2.0;
    if let Geometry::Strut(g) = &mut axle.geometry {
        g.left.tierod_outer_m = g.left.tierod_inner_m;
        g.left.wheel_centre_m[1] *= -1.0;
        g.left.spin_axis = Some([0.0, 1.0, 0.01]);
    }
    axle.kingpin_friction = Some(KingpinFriction { moment_n_m: -1.0, presliding_rad: 0.01 });
    assert_eq!(
        keys(&axle),
        [
            "rack_stroke_m",
            "static_camber_rad[1]",
            "geometry.left.tierod_outer_m",
            "geometry.left.wheel_centre_m",
            "geometry.left.spin_axis",
            "kingpin_friction.moment_n_m"
        ]
    );
    let mut axle = shipped("sedan_double_wishbone_bushings");
    if let Some(bushings) = &mut axle.bushings {
        let bushing = bushings.remove("uca_front").unwrap();
        bushings.insert("uca_middle".to_owned(), Bushing { radial_n_per_m: 0.0, ..bushing });
    }
    assert_eq!(keys(&axle), ["bushings.uca_middle", "bushings.uca_middle.radial_n_per_m"]);
}

#[test]
fn mirrored_sides_are_refused() {
    let mut axle = shipped("sedan_double_wishbone");
    if let Geometry::DoubleWishbone(g) = &mut axle.geometry {
        (g.left, g.right) = (g.left.mirrored(), Some(g.left.clone()));
    }
    assert_eq!(keys(&axle), ["geometry.left.wheel_centre_m", "geometry.right.wheel_centre_m"]);
}

#[test]
fn hardpoint_json_errors_are_collected() {
    let found = Axle::from_hardpoint_json("{", "x").unwrap_err();
    assert!(found[0].rule.starts_with("must be JSON"));
    let found =
        Axle::from_hardpoint_json(r#"{"type": "double_wishbone", "rack_full_m": "x"}"#, "x").unwrap_err();
    assert_eq!(found.len(), 2 * 12 + 4, "{found:?}");
    assert!(found.iter().any(|b| b.key == "right.uca_ball"));
    assert!(found.iter().any(|b| b.key == "rack_full_m"));
    let found = Axle::from_hardpoint_json("{}", "x").unwrap_err();
    assert!(found.iter().any(|b| b.key == "type"));
    let text = r#"{"arb_stifness_Nm_per_rad": 1.0, "note": "x", "track_m": 1.5}"#;
    let found = Axle::from_hardpoint_json(text, "x").unwrap_err();
    let misspelt: Vec<&Broken> = found.iter().filter(|b| b.rule.contains("did you mean")).collect();
    assert_eq!(misspelt.len(), 1);
    assert_eq!(misspelt[0].key, "arb_stifness_Nm_per_rad");
}
