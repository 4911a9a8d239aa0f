//! Which of our figures stands for which figure of the thesis on the bench whose concept Kingpin follows.
//!
//! Its chapter 5.1 shows tie-rod forces of four manoeuvres, command and measurement (figures 5.3 to 5.6); its chapter 5.3
//! a growing slalom at 80 km/h of two cars, on the road and on the bench (5.21 to 5.38). A virtual rig produces all that
//! is the bench's; what is the road's needs a measured record (`[[compare]]` in the scenario) and is drawn into the same
//! figure.

use serde_json::Value;

use crate::overlay::Overlay;
use crate::published::{PUBLISHED_TRACKING, published_for};
use crate::run::Run;

/// One figure of the source.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SourceFigure {
    /// Its number, e.g. `5.25`.
    pub number: &'static str,
    /// What it shows.
    pub shows: String,
    /// Titles of our figures that show it.
    pub ours: Vec<&'static str>,
    /// What our figure lacks; empty if nothing.
    pub lacks: String,
}

/// Titles of our figures, as the drawer gives them.
pub(crate) mod title {
    pub const ANGLE: &str = "Steering-wheel angle";
    pub const ACCELERATION: &str = "Lateral acceleration";
    pub const FORCE_LEFT: &str = "Tie-rod force, left";
    pub const FORCE_RIGHT: &str = "Tie-rod force, right";
    pub const FORCE_ERROR: &str = "Tie-rod force error (command − load cell)";
    pub const TORQUE_ANGLE: &str = "Steering torque over angle";
    pub const TORQUE_ACCELERATION: &str = "Steering torque over lateral acceleration";
}

use title::{ACCELERATION, ANGLE, FORCE_ERROR, FORCE_LEFT, FORCE_RIGHT, TORQUE_ACCELERATION, TORQUE_ANGLE};

/// What one figure of the slalom shows, and our figures of the same.
type Slalom = (&'static str, &'static str, &'static [&'static str], Option<&'static [&'static str]>);

/// Figures of one car: number, what, ours, and the measured signals that it is of if it is the road's.
const STRUT: [Slalom; 9] = [
    ("5.21", "steering angle", &[ANGLE], None),
    ("5.22", "lateral acceleration on the road", &[ACCELERATION], Some(&[LATERAL])),
    ("5.23", "lateral acceleration on the bench", &[ACCELERATION], None),
    ("5.24", "tie-rod forces on the road", &[FORCE_LEFT, FORCE_RIGHT], Some(&[TIE_LEFT, TIE_RIGHT])),
    ("5.25", "tie-rod forces on the bench", &[FORCE_LEFT, FORCE_RIGHT], None),
    ("5.31", "steering torque over angle on the road", &[TORQUE_ANGLE], Some(&[TORQUE])),
    ("5.32", "steering torque over angle on the bench", &[TORQUE_ANGLE], None),
    (
        "5.33",
        "steering torque over lateral acceleration on the road",
        &[TORQUE_ACCELERATION],
        Some(&[TORQUE, LATERAL]),
    ),
    ("5.34", "steering torque over lateral acceleration on the bench", &[TORQUE_ACCELERATION], None),
];
/// The same nine of the other car.
const WISHBONE: [&str; 9] = ["5.26", "5.27", "5.28", "5.29", "5.30", "5.35", "5.36", "5.37", "5.38"];

pub(crate) const LATERAL: &str = "vehicle_state.acceleration_m_s2.y";
pub(crate) const TORQUE: &str = "rig_measurement.steering_wheel_torque_n_m";
pub(crate) const STEERING: &str = "rig_measurement.steering_wheel_angle_rad";
const TIE_LEFT: &str = "rig_measurement.tie_rod_force_n.left";
const TIE_RIGHT: &str = "rig_measurement.tie_rod_force_n.right";

/// The source's figures that this run reproduces, and a sentence on how near the run is to the source's.
pub(crate) fn source_figures(run: &Run<'_>, overlays: &[Overlay]) -> (String, Vec<SourceFigure>) {
    let scenario = &run.log.header.scenario;
    if let Some(published) = published_for(scenario) {
        let place = PUBLISHED_TRACKING.iter().position(|p| p.key == published.key).unwrap_or(0);
        let number = ["5.3", "5.4", "5.5", "5.6"][place];
        let figure = SourceFigure {
            number,
            shows: format!(
                "tie-rod forces left and right, command, measurement and error: {}",
                published.manoeuvre
            ),
            ours: vec![FORCE_LEFT, FORCE_RIGHT, FORCE_ERROR],
            lacks: String::new(),
        };
        return (format!("This run is the manoeuvre of the source's figure {number}."), vec![figure]);
    }
    let kind = suspension(run);
    let growing = scenario.to_lowercase().replace('-', "_").contains("growing_slalom");
    let cars: &[bool] = match kind.as_deref() {
        Some("strut") => &[true],
        Some("double_wishbone") => &[false],
        _ => &[true, false],
    };
    let car = match kind.as_deref() {
        Some("strut") => "the source's car with struts",
        Some("double_wishbone") => "the source's car with double wishbones",
        _ => "both of the source's cars, which had struts and double wishbones",
    };
    let said = if growing {
        format!("This run is the growing slalom at 80 km/h; figures of {car}.")
    } else {
        format!("Another manoeuvre than the source's: the same kinds of figure, numbered as those of {car}.")
    };
    let mut found = Vec::new();
    for &strut in cars {
        for ((number, shows, ours, road), other) in STRUT.iter().zip(WISHBONE) {
            let missing: Vec<&str> = road
                .iter()
                .flat_map(|signals| signals.iter())
                .filter(|signal| !overlays.iter().any(|o| o.target == **signal))
                .copied()
                .collect();
            found.push(SourceFigure {
                number: if strut { number } else { other },
                shows: format!("{shows} ({})", if strut { "struts" } else { "double wishbones" }),
                ours: ours.to_vec(),
                lacks: if missing.is_empty() {
                    String::new()
                } else {
                    format!("the road's curve: no measured record of {}", missing.join(", "))
                },
            });
        }
    }
    (said, found)
}

/// Numbers of the source's figures that one of ours stands for.
pub(crate) fn numbers_for(figures: &[SourceFigure], ours: &str) -> String {
    let numbers: Vec<&str> =
        figures.iter().filter(|f| f.lacks.is_empty() && f.ours.contains(&ours)).map(|f| f.number).collect();
    numbers.join(", ")
}

/// Type of the front suspension by the resolved configuration.
fn suspension(run: &Run<'_>) -> Option<String> {
    let configuration: Value = serde_json::from_str(&run.log.header.configuration).ok()?;
    configuration["front_axle"]["geometry"]["type"].as_str().map(str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_of_the_source_is_there_once() {
        let mut numbers: Vec<&str> = STRUT.iter().map(|f| f.0).chain(WISHBONE).collect();
        numbers.sort_unstable();
        let expected: Vec<String> = (21..=38).map(|n| format!("5.{n}")).collect();
        assert_eq!(numbers, expected);
    }
}
