//! `suspension curves`: alignment over wheel travel and rack, and the kinematics map of a vehicle model.

use super::arguments::SuspensionCurvesArgs;
use super::input::SIDES;
use super::page::{Figure, html};
use super::solve::{number, write_csv};
use super::{Wrong, load_axle};
use crate::commands::log::write_whole;
use crate::exit::Exit;
use crate::output;
use multibody::SuspensionOutput;
use multibody::methods::{Alignment, Curve, Over, SweptPose, curve, kinematics_map};

/// Grid of the two-dimensional map.
const MAP_TRAVELS: u32 = 33;
const MAP_RACKS: u32 = 41;

fn spread(half: f64, count: u32) -> Vec<f64> {
    // Symmetric to the last digit, with an exact zero in the middle of an odd count.
    (0..count).map(|k| half * (2.0 * f64::from(k) - f64::from(count - 1)) / f64::from(count - 1)).collect()
}

/// `kingpin suspension curves`.
pub fn curves(args: &SuspensionCurvesArgs) -> Result<Exit, Wrong> {
    let axle = load_axle(&args.axle)?;
    let rack = args.rack.unwrap_or(axle.rack_stroke_m);
    let mut wrong = Vec::new();
    for (name, value) in [("--travel", args.travel), ("--rack", rack)] {
        if !(value > 0.0 && value <= 0.5) {
            wrong.push(format!("{name} = {value}: must be in (0, 0.5] m"));
        }
    }
    if !wrong.is_empty() {
        return Err(wrong.join("\n"));
    }
    let assembled = |error| format!("{}: {error}", args.axle);
    let travels = curve(&axle, Over::Travel, &spread(args.travel, args.points)).map_err(assembled)?;
    let racks = curve(&axle, Over::Rack, &spread(rack, args.points)).map_err(assembled)?;
    let (map, design) = kinematics_map(&axle, &spread(args.travel, MAP_TRAVELS), &spread(rack, MAP_RACKS))
        .map_err(assembled)?;
    let mut missing = 0;
    for (what, curve) in [("wheel travel", &travels), ("rack", &racks)] {
        let lost = args.points as usize - curve.points.len();
        if lost > 0 {
            let ends = (curve.points.first(), curve.points.last());
            let ends = if let (Some(first), Some(last)) = ends {
                format!("reaches from {:.1} to {:.1} mm", first.at_m * 1e3, last.at_m * 1e3)
            } else {
                "reaches nothing".to_owned()
            };
            output::note(format!("{}: {what}: {ends}; {lost} points left out", args.axle));
            missing += lost;
        }
    }
    let unreached = map.iter().filter(|p| p.pose.is_none()).count();
    if unreached > 0 {
        output::note(format!(
            "{}: kinematics map: {unreached} of {} poses out of reach",
            args.axle,
            map.len()
        ));
    }
    std::fs::create_dir_all(&args.output).map_err(|e| format!("{}: {e}", args.output.display()))?;
    let file = |name: &str| args.output.join(name);
    for (name, at, curve) in [("travel.csv", "wheel_travel_m", &travels), ("rack.csv", "rack_m", &racks)] {
        let (header, rows) = curve_table(at, curve);
        write_whole(&file(name), |to| write_csv(to, &header, rows.into_iter()))?;
    }
    let (header, rows) = map_table(&map, &design);
    write_whole(&file("kinematics_map.csv"), |to| write_csv(to, &header, rows.into_iter()))?;
    let page = page(&axle.name, &travels, &racks);
    write_whole(&file("curves.html"), |to| to.write_all(page.as_bytes()).map_err(|e| e.to_string()))?;
    for name in ["travel.csv", "rack.csv", "kinematics_map.csv", "curves.html"] {
        output::line(file(name).display());
    }
    Ok(if missing + unreached > 0 { Exit::Failed } else { Exit::Done })
}

fn curve_table(at: &str, curve: &Curve) -> (Vec<String>, Vec<Vec<String>>) {
    let mut header = vec![at.to_owned()];
    for side in SIDES {
        header.extend(Alignment::NAMES.iter().map(|name| format!("{name}_{side}")));
        header.extend(Alignment::NAMES.iter().map(|name| format!("{name}_per_mm_{side}")));
    }
    let rows = curve.points.iter().map(|point| {
        let mut row = vec![number(point.at_m)];
        for k in 0..2 {
            row.extend(point.side[k].to_array().map(number));
            row.extend(point.per_mm[k].map(number));
        }
        row
    });
    (header, rows.collect())
}

/// The vehicle's map: pose of each knuckle, kingpin axis, alignment. Poses out of reach have empty fields.
fn map_table(map: &[SweptPose], design: &SuspensionOutput) -> (Vec<String>, Vec<Vec<String>>) {
    const POSE: [&str; 14] = [
        "wheel_centre_x_m",
        "wheel_centre_y_m",
        "wheel_centre_z_m",
        "q0",
        "q1",
        "q2",
        "q3",
        "steer_rad",
        "kingpin_lower_x_m",
        "kingpin_lower_y_m",
        "kingpin_lower_z_m",
        "kingpin_upper_x_m",
        "kingpin_upper_y_m",
        "kingpin_upper_z_m",
    ];
    let mut header = vec!["wheel_travel_m".to_owned(), "rack_m".to_owned()];
    for side in SIDES {
        header.extend(POSE.iter().chain(&Alignment::NAMES).map(|name| format!("{name}_{side}")));
    }
    let rows = map.iter().map(|at| {
        let mut row = vec![number(at.travel_m), number(at.rack_m)];
        for k in 0..2 {
            let Some(pose) = &at.pose else {
                row.extend(std::iter::repeat_n(String::new(), POSE.len() + Alignment::NAMES.len()));
                continue;
            };
            let side = &pose.side[k];
            row.extend(side.wheel_centre_m.iter().map(|x| number(*x)));
            row.extend(side.knuckle_quaternion.map(number));
            row.push(number(side.steer_rad));
            row.extend(side.lower_joint_m.iter().chain(side.upper_joint_m.iter()).map(|x| number(*x)));
            row.extend(Alignment::read(k, side, &design.side[k]).to_array().map(number));
        }
        row
    });
    (header, rows.collect())
}

fn page(name: &str, travels: &Curve, racks: &Curve) -> String {
    const TITLES: [&str; 8] = [
        "Toe (+ in)",
        "Camber (+ top outward)",
        "Caster (+ top rearward)",
        "Kingpin inclination (+ top inboard)",
        "Scrub radius (+ patch outboard)",
        "Caster trail (+ axis ahead)",
        "Wheel-centre recession (+ rearward)",
        "Half-track change (+ outward)",
    ];
    let mut figures = Vec::new();
    for (curve, over) in [(travels, "wheel travel, both wheels"), (racks, "rack")] {
        let at: Vec<f64> = curve.points.iter().map(|p| p.at_m * 1e3).collect();
        for (c, title) in TITLES.iter().enumerate() {
            let angle = c < 4;
            let scale = if angle { 180.0 / std::f64::consts::PI } else { 1e3 };
            let unit = if angle { "°" } else { "mm" };
            let mut figure = Figure::new(&format!("{title} over {over}"), &format!("{over} in mm"), unit);
            let mut slope = Figure::new(
                &format!("{title}: change per mm of {over}"),
                &format!("{over} in mm"),
                &format!("{unit}/mm"),
            );
            for (k, side) in ["left", "right"].iter().enumerate() {
                let value: Vec<f64> = curve.points.iter().map(|p| scale * p.side[k].to_array()[c]).collect();
                let change: Vec<f64> = curve.points.iter().map(|p| scale * p.per_mm[k][c]).collect();
                let dash = ["solid", "dash"][k];
                figure.curve(side, &at, &value, 1 + k, dash);
                slope.curve(side, &at, &change, 1 + k, dash);
            }
            figures.extend([figure, slope]);
        }
    }
    let about = "Rigid kinematics of the hardpoints: no bushings, no load. Solved by the multibody model.";
    html(&format!("{name}: alignment curves"), about, &[], &figures)
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn places_are_symmetric_with_an_exact_middle() {
        let places = spread(0.07, 41);
        assert_eq!((places[0], places[20], places[40]), (-0.07, 0.0, 0.07));
        assert!((0..41).all(|k| places[k] == -places[40 - k]));
    }
}
