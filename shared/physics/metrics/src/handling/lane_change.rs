//! Lane changes through gates of cones: ISO 3888-1 (double lane change) and ISO 3888-2 (obstacle avoidance).
//!
//! A section is a length of track with a lane between two rows of cones. A cone is hit when the car's outline, a
//! rectangle, leaves the lane within a section. Coordinates: forward from the beginning of the first section,
//! left of the first lane's middle.

use super::{Assessment, CarFacts, Signals};

/// A section of the track with cones on both sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Begin. \[m\]
    pub from_m: f64,
    /// End. \[m\]
    pub to_m: f64,
    /// Right edge of the lane. \[m\]
    pub right_m: f64,
    /// Left edge of the lane. \[m\]
    pub left_m: f64,
}

/// A track.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Which.
    pub name: &'static str,
    /// Its sections, the first beginning at 0.
    pub gates: Vec<Gate>,
}

impl Layout {
    /// ISO 3888-1: sections of 15, 30, 25, 25, 15 and 15 m; lanes 1.1 b + 0.25, 1.2 b + 0.25 and 1.3 b + 0.25 m
    /// wide, the middle one's right edge 3.5 m left of the first one's.
    pub fn double_lane_change(width_m: f64) -> Layout {
        let b = width_m;
        let [first, middle, last] = [1.1 * b + 0.25, 1.2 * b + 0.25, 1.3 * b + 0.25];
        let right = -0.5 * first;
        Layout {
            name: "double lane change, ISO 3888-1",
            gates: vec![
                Gate { from_m: 0.0, to_m: 15.0, right_m: right, left_m: right + first },
                Gate { from_m: 45.0, to_m: 70.0, right_m: right + 3.5, left_m: right + 3.5 + middle },
                Gate { from_m: 95.0, to_m: 125.0, right_m: right, left_m: right + last },
            ],
        }
    }

    /// ISO 3888-2: sections of 12, 13.5, 11, 12.5 and 12 m; lanes 1.1 b + 0.25, b + 1 and 1.3 b + 0.25 m (at least 3 m)
    /// wide, the middle one's right edge 1 m left of the first one's left edge, the right edges of the outer ones in line.
    pub fn obstacle_avoidance(width_m: f64) -> Layout {
        let b = width_m;
        let [first, middle, last] = [1.1 * b + 0.25, b + 1.0, (1.3 * b + 0.25).max(3.0)];
        let right = -0.5 * first;
        let aside = right + first + 1.0;
        Layout {
            name: "obstacle avoidance, ISO 3888-2",
            gates: vec![
                Gate { from_m: 0.0, to_m: 12.0, right_m: right, left_m: right + first },
                Gate { from_m: 25.5, to_m: 36.5, right_m: aside, left_m: aside + middle },
                Gate { from_m: 49.0, to_m: 61.0, right_m: right, left_m: right + last },
            ],
        }
    }
}

/// Figures of a drive through a track that begins `start_m` ahead of the origin, on the line y = 0.
pub fn lane_change(signals: &Signals, layout: &Layout, start_m: f64, car: &CarFacts) -> Assessment {
    let mut out = Assessment::new(layout.name);
    let n = signals.len();
    let end = layout.gates.last().map_or(0.0, |gate| gate.to_m);
    let corners = [
        (car.front_m, 0.5 * car.width_m),
        (car.front_m, -0.5 * car.width_m),
        (-car.rear_m, 0.5 * car.width_m),
        (-car.rear_m, -0.5 * car.width_m),
    ];
    // Distance from each section's cones, least over the passage; negative: hit.
    let mut clearance = vec![f64::INFINITY; layout.gates.len()];
    let mut hits = 0_u32;
    let (mut entry, mut exit) = (None, None);
    let mut touching = vec![false; 2 * layout.gates.len()];
    for i in 0..n {
        let (s, c) = signals.yaw_rad[i].sin_cos();
        let nose = signals.x_m[i] + c * car.front_m - start_m;
        let tail = signals.x_m[i] - c * car.rear_m - start_m;
        if nose >= 0.0 && entry.is_none() {
            entry = Some(i);
        }
        if tail >= end && exit.is_none() {
            exit = Some(i);
        }
        for (g, gate) in layout.gates.iter().enumerate() {
            let mut least = [f64::INFINITY; 2];
            // The four sides, walked in steps: a cone may meet a side between its corners.
            for (a, b) in [(0, 1), (1, 3), (3, 2), (2, 0)] {
                for step in 0..=8 {
                    let part = f64::from(step) / 8.0;
                    let along = corners[a].0 + part * (corners[b].0 - corners[a].0);
                    let across = corners[a].1 + part * (corners[b].1 - corners[a].1);
                    let x = signals.x_m[i] + c * along - s * across - start_m;
                    let y = signals.y_m[i] + s * along + c * across;
                    if (gate.from_m..=gate.to_m).contains(&x) {
                        least[0] = f64::min(least[0], gate.left_m - y);
                        least[1] = f64::min(least[1], y - gate.right_m);
                    }
                }
            }
            for (row, value) in least.into_iter().enumerate() {
                clearance[g] = clearance[g].min(value);
                let touches = value < 0.0;
                if touches && !touching[2 * g + row] {
                    hits += 1;
                }
                if value.is_finite() {
                    touching[2 * g + row] = touches;
                }
            }
        }
    }
    let speed_at = |i: Option<usize>| i.map(|i| 3.6 * signals.speed_m_s[i]);
    let through = entry.is_some() && exit.is_some();
    out.condition("track driven to its end", f64::from(u8::from(through)), 1.0, 1.0, "1");
    out.figure("entry speed", speed_at(entry), "km/h");
    out.figure("exit speed", speed_at(exit), "km/h");
    let time = entry.zip(exit).map(|(a, b)| (b - a) as f64 * signals.sample_time_s);
    out.figure("time in the track", time, "s");
    for (g, name) in
        ["clearance in the first lane", "clearance in the middle lane", "clearance in the last lane"]
            .into_iter()
            .enumerate()
    {
        out.figure(name, clearance.get(g).copied(), "m");
    }
    out.figure("rows of cones left", Some(f64::from(hits)), "1");
    let inside = |values: &[f64]| entry.zip(exit).map(|(a, b)| crate::statistics::peak(&values[a..b]));
    out.figure("largest lateral acceleration", inside(&signals.lateral_acceleration_m_s2), "m/s²");
    out.figure("largest hand-wheel angle", inside(&signals.hand_wheel_angle_rad).map(f64::to_degrees), "°");
    out.figure("largest hand-wheel torque", inside(&signals.hand_wheel_torque_n_m), "N·m");
    out.rule("no cone hit", &["rows of cones left"], |v| v[0] == 0.0);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAR: CarFacts = CarFacts {
        steering_ratio: 16.0,
        wheelbase_m: 2.7,
        mass_kg: 1500.0,
        width_m: 1.8,
        front_m: 2.0,
        rear_m: 2.4,
    };

    /// A car that slides along y(x) without turning.
    fn drive(y: impl Fn(f64) -> f64) -> Signals {
        let n = 4000;
        let x: Vec<f64> = (0..n).map(|i| i as f64 * 0.05).collect();
        let zero = vec![0.0; n];
        Signals {
            sample_time_s: 0.05 * 3.6 / 80.0,
            y_m: x.iter().map(|x| y(*x - 20.0)).collect(),
            x_m: x,
            speed_m_s: vec![80.0 / 3.6; n],
            hand_wheel_angle_rad: zero.clone(),
            hand_wheel_torque_n_m: zero.clone(),
            lateral_acceleration_m_s2: zero.clone(),
            yaw_rate_rad_s: zero.clone(),
            yaw_rad: zero.clone(),
            roll_rad: zero.clone(),
            side_slip_rad: zero,
        }
    }

    #[test]
    fn the_ideal_line_clears_by_half_the_free_width() {
        let layout = Layout::double_lane_change(1.8);
        let lane = |x: f64| {
            // Change between 17.5 and 42.4 m, back between 72.5 and 92.9 m: the car's ends reach past its middle.
            let part = ((x - 17.5) / 24.9).clamp(0.0, 1.0) - ((x - 72.5) / 20.4).clamp(0.0, 1.0);
            (3.5 + 0.05 * 1.8) * part
        };
        let out = lane_change(&drive(lane), &layout, 20.0, &CAR);
        assert!(out.valid() && out.rulings[0].kept == Ok(true), "{out:?}");
        assert!((out.value("clearance in the first lane").unwrap() - (0.1 * 0.9 + 0.125)).abs() < 1e-9);
        assert!(
            (out.value("clearance in the middle lane").unwrap() - (0.2 * 0.9 + 0.125)).abs() < 1e-9,
            "{out:?}"
        );
        assert!((out.value("entry speed").unwrap() - 80.0).abs() < 1e-9);
        assert!((out.value("time in the track").unwrap() - (125.0 + 4.4) / (80.0 / 3.6)).abs() < 0.01);
    }

    #[test]
    fn straight_on_hits_the_middle_gate_and_half_a_drive_is_withheld() {
        let layout = Layout::obstacle_avoidance(1.8);
        let out = lane_change(&drive(|_| 0.0), &layout, 20.0, &CAR);
        assert_eq!(out.rulings[0].kept, Ok(false));
        assert_eq!(out.value("rows of cones left"), Some(1.0));
        let half = drive(|_| 0.0).part(0..600);
        let out = lane_change(&half, &layout, 20.0, &CAR);
        assert!(out.rulings[0].kept.is_err(), "{out:?}");
    }
}
