//! Poses over wheel travel and rack: alignment curves with derivatives, and the two-dimensional map of a
//! vehicle model.
//!
//! Both wheels travel together; without a stabiliser the sides do not know of each other, so a sweep of one
//! is a sweep of both. Derivatives are central differences of the solver itself over ±0.1 mm: their error is
//! of the order h²f‴/6 + ε/h, below 1e-9 rad/mm for the geometries at hand.

use config::axle::Axle;

use super::alignment::Alignment;
use crate::failure::AssemblyError;
use crate::suspension::{Status, Suspension, SuspensionInput, SuspensionOutput};

/// Half width of the difference quotient. [m]
const DIFFERENCE_M: f64 = 1e-4;
/// Longest move between two solves of a sweep. [m]
const STRIDE_M: f64 = 4e-3;

/// What a curve runs over.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Over {
    /// Wheel travel of both wheels, rack centred.
    Travel,
    /// Rack displacement, wheels at design height.
    Rack,
}

impl Over {
    /// The input with this variable at `x`, everything else at design.
    #[must_use]
    pub fn input(self, x: f64) -> SuspensionInput {
        match self {
            Self::Travel => SuspensionInput { wheel_height_m: [x; 2], ..SuspensionInput::DESIGN },
            Self::Rack => SuspensionInput { rack_m: x, ..SuspensionInput::DESIGN },
        }
    }
}

/// One point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurvePoint {
    /// Wheel travel or rack displacement. [m]
    pub at_m: f64,
    /// Alignment, left and right.
    pub side: [Alignment; 2],
    /// Derivatives per millimetre in the order of [`Alignment::NAMES`], left and right. [unit/mm]
    pub per_mm: [[f64; 8]; 2],
}

/// A curve: as far as the mechanism reaches, within the range asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// What it runs over.
    pub over: Over,
    /// Points, ascending.
    pub points: Vec<CurvePoint>,
}

/// One pose of the two-dimensional map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptPose {
    /// Wheel travel of both wheels. [m]
    pub travel_m: f64,
    /// Rack displacement. [m]
    pub rack_m: f64,
    /// The pose; `None` where the mechanism does not reach.
    pub pose: Option<SuspensionOutput>,
}

/// The axle's rigid kinematics alone: without bushings, stabiliser and friction.
#[must_use]
pub fn kinematic_axle(axle: &Axle) -> Axle {
    Axle { bushings: None, stabiliser: None, kingpin_friction: None, ..axle.clone() }
}

/// A solver that walks: it never takes a stride too long to follow, and tells whether it arrived.
struct Walker {
    solver: Suspension,
    at: SuspensionInput,
    output: SuspensionOutput,
}

impl Walker {
    fn new(axle: &Axle) -> Result<Self, AssemblyError> {
        let mut solver = Suspension::new(&kinematic_axle(axle))?;
        let mut output = SuspensionOutput::default();
        solver.step(&SuspensionInput::DESIGN, &mut output);
        Ok(Self { solver, at: SuspensionInput::DESIGN, output })
    }

    fn home(&mut self) -> SuspensionOutput {
        self.solver.reset();
        self.at = SuspensionInput::DESIGN;
        self.solver.step(&self.at, &mut self.output);
        self.output
    }

    fn to(&mut self, target: &SuspensionInput) -> Option<SuspensionOutput> {
        let from = self.at;
        let moves = [
            target.rack_m - from.rack_m,
            target.wheel_height_m[0] - from.wheel_height_m[0],
            target.wheel_height_m[1] - from.wheel_height_m[1],
        ];
        let longest = moves.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let strides = (longest / STRIDE_M).ceil().clamp(1.0, 1000.0) as u32;
        for stride in 1..=strides {
            let share = f64::from(stride) / f64::from(strides);
            let mut input = *target;
            if stride < strides {
                input.rack_m = from.rack_m + share * moves[0];
                input.wheel_height_m = [0, 1].map(|k| from.wheel_height_m[k] + share * moves[1 + k]);
            }
            self.solver.step(&input, &mut self.output);
            if self.output.status != Status::Converged {
                return None;
            }
            self.at = input;
        }
        Some(self.output)
    }
}

/// Solves at `count` steps of `step_m` to either side of design, as far as the mechanism reaches: the poses
/// in ascending order and the number of them below design.
///
/// # Errors
/// When the axle cannot be assembled.
pub fn reach(
    axle: &Axle,
    over: Over,
    step_m: f64,
    count: usize,
) -> Result<(Vec<SuspensionOutput>, usize), AssemblyError> {
    let mut walker = Walker::new(axle)?;
    let mut poses = Vec::with_capacity(2 * count + 1);
    let mut below = 0;
    for sign in [-1.0, 1.0] {
        let design = walker.home();
        if sign > 0.0 {
            below = poses.len();
            poses.reverse();
            poses.push(design);
        }
        for k in 1..=count {
            let Some(pose) = walker.to(&over.input(sign * step_m * k as f64)) else { break };
            poses.push(pose);
        }
    }
    Ok((poses, below))
}

/// The alignment curve at the given places. Places that the mechanism does not reach are left out.
///
/// # Errors
/// When the axle cannot be assembled.
pub fn curve(axle: &Axle, over: Over, places_m: &[f64]) -> Result<Curve, AssemblyError> {
    let mut walker = Walker::new(axle)?;
    let mut points = Vec::with_capacity(places_m.len());
    let mut places = places_m.to_vec();
    places.sort_by(f64::total_cmp);
    for outward in [-1.0, 1.0] {
        let design = walker.home();
        let half: Vec<f64> = places.iter().copied().filter(|x| (*x < 0.0) == (outward < 0.0)).collect();
        let ordered: Vec<f64> = if outward < 0.0 { half.into_iter().rev().collect() } else { half };
        let read =
            |output: &SuspensionOutput| [0, 1].map(|k| Alignment::read(k, &output.side[k], &design.side[k]));
        for at_m in ordered {
            let Some(low) = walker.to(&over.input(at_m - DIFFERENCE_M)) else { break };
            let Some(middle) = walker.to(&over.input(at_m)) else { break };
            let Some(high) = walker.to(&over.input(at_m + DIFFERENCE_M)) else { break };
            let (before, after) = (read(&low), read(&high));
            let per_mm = [0, 1].map(|k| {
                let (a, b) = (before[k].to_array(), after[k].to_array());
                std::array::from_fn(|c| (b[c] - a[c]) / (2e3 * DIFFERENCE_M))
            });
            points.push(CurvePoint { at_m, side: read(&middle), per_mm });
        }
    }
    points.sort_by(|a, b| a.at_m.total_cmp(&b.at_m));
    Ok(Curve { over, points })
}

/// Poses on the grid of travels × racks, row by row of travel; and the pose at design.
///
/// # Errors
/// When the axle cannot be assembled.
pub fn kinematics_map(
    axle: &Axle,
    travels_m: &[f64],
    racks_m: &[f64],
) -> Result<(Vec<SweptPose>, SuspensionOutput), AssemblyError> {
    let mut walker = Walker::new(axle)?;
    let design = walker.home();
    let mut poses = Vec::with_capacity(travels_m.len() * racks_m.len());
    for &travel_m in travels_m {
        for &rack_m in racks_m {
            let target = SuspensionInput { rack_m, wheel_height_m: [travel_m; 2], ..SuspensionInput::DESIGN };
            let mut pose = walker.to(&target);
            if pose.is_none() {
                // The way there may have led through a pose out of reach: once more, from design.
                walker.home();
                pose = walker.to(&target);
            }
            if pose.is_none() {
                walker.home();
            }
            poses.push(SweptPose { travel_m, rack_m, pose });
        }
    }
    Ok((poses, design))
}
