//! Published tie-rod force tracking of the hydraulic bench whose concept Kingpin follows, to stand beside ours.
//!
//! Command against load cell, in per cent of the manoeuvre's amplitude, on hardware (thesis on that bench,
//! chapter 5.1; retold in the bench's specification, 4.4).

/// One manoeuvre's published figures. [%]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedTracking {
    /// Manoeuvre with speed and steering frequency.
    pub manoeuvre: &'static str,
    /// Parts of a scenario's name that tell it is this manoeuvre.
    pub key: &'static str,
    /// Largest and root mean square error, left.
    pub left: (f64, f64),
    /// Largest and root mean square error, right.
    pub right: (f64, f64),
}

/// All published manoeuvres.
pub const PUBLISHED_TRACKING: [PublishedTracking; 4] = [
    PublishedTracking {
        manoeuvre: "on-centre, 120 km/h, 0.2 Hz",
        key: "on_centre",
        left: (2.44, 0.85),
        right: (2.71, 0.84),
    },
    PublishedTracking {
        manoeuvre: "slalom, 120 km/h, 0.3 Hz",
        key: "slalom",
        left: (5.62, 1.03),
        right: (3.51, 0.86),
    },
    PublishedTracking {
        manoeuvre: "lane change, 120 km/h, 1 Hz",
        key: "lane_change",
        left: (8.76, 2.44),
        right: (7.28, 2.09),
    },
    PublishedTracking {
        manoeuvre: "sine with dwell, 80 km/h, 0.7 Hz",
        key: "sine_with_dwell",
        left: (6.87, 1.66),
        right: (6.32, 0.99),
    },
];

/// The published manoeuvre a scenario is, by its name. The growing slalom and measured lane changes are
/// other manoeuvres: they have no published tracking.
pub fn published_for(scenario: &str) -> Option<&'static PublishedTracking> {
    let name = scenario.to_lowercase().replace('-', "_");
    if ["growing", "measured", "double", "iso", "replay"].iter().any(|other| name.contains(other)) {
        return None;
    }
    PUBLISHED_TRACKING.iter().find(|published| name.contains(published.key))
}

/// The largest published error of any manoeuvre and side: peak and root mean square. \[%\]
pub(crate) fn worst_published() -> (f64, f64) {
    let sides = PUBLISHED_TRACKING.iter().flat_map(|p| [p.left, p.right]);
    sides.fold((0.0, 0.0), |(peak, rms), side| (f64::max(peak, side.0), f64::max(rms, side.1)))
}

#[cfg(test)]
mod tests {
    use super::published_for;

    #[test]
    fn scenarios_are_recognised_by_name_and_others_are_not_taken_for_them() {
        assert_eq!(published_for("lane_change_120").map(|p| p.key), Some("lane_change"));
        assert_eq!(published_for("on-centre").map(|p| p.key), Some("on_centre"));
        assert_eq!(published_for("growing_slalom"), None);
        assert_eq!(published_for("measured_double_lane_change"), None);
    }
}
