//! The road under each wheel, from the scenario: friction by place, grade, bank.

use config::road::{Friction, Road};
use vehicle::{RoadContact, WHEELS};

/// Friction scale at a point of the road.
fn friction(friction: &Friction, x_m: f64, y_m: f64) -> f64 {
    match friction {
        Friction::Uniform { scale } => *scale,
        Friction::Split { left_scale, right_scale, outside_scale, from_x_m, to_x_m } => {
            if !(*from_x_m..*to_x_m).contains(&x_m) {
                *outside_scale
            } else if y_m > 0.0 {
                *left_scale
            } else {
                *right_scale
            }
        }
        Friction::Patches { outside_scale, patches } => patches
            .iter()
            .find(|p| (p.from_x_m..p.to_x_m).contains(&x_m) && (p.from_y_m..p.to_y_m).contains(&y_m))
            .map_or(*outside_scale, |p| p.scale),
    }
}

/// The road under wheels at `centre_m` (x, y of each, global frame).
pub fn contacts(road: &Road, centre_m: &[[f64; 2]; WHEELS]) -> [RoadContact; WHEELS] {
    let (slope_x, slope_y) = (0.01 * road.grade_percent, 0.01 * road.bank_percent);
    centre_m.map(|[x, y]| RoadContact {
        height_m: slope_x * x + slope_y * y,
        slope_x,
        slope_y,
        friction: friction(&road.friction, x, y),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn split_friction_is_split_between_its_stations() {
        let road = Road {
            friction: Friction::Split {
                left_scale: 0.3,
                right_scale: 0.9,
                outside_scale: 1.0,
                from_x_m: 10.0,
                to_x_m: 20.0,
            },
            grade_percent: 10.0,
            bank_percent: -5.0,
            crosswind: None,
        };
        let found = contacts(&road, &[[15.0, 1.0], [15.0, -1.0], [5.0, 1.0], [20.0, 1.0]]);
        assert_eq!(found.map(|c| c.friction), [0.3, 0.9, 1.0, 1.0]);
        assert!((found[0].height_m - (1.5 - 0.05)).abs() < 1e-12);
    }
}
