//! The car's kinematics maps, swept with the multibody solver from the car's own hardpoints, so that car
//! and solver are one consistent thing (spec 3.1): pose of each knuckle over wheel travel and rack.

use config::axle::Axle;
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use vehicle::kinematics::{AxleKinematics, Grid, KnuckleSample};

/// Wheel travel asked for; the sweep is narrowed where the mechanism does not reach. [m]
const TRAVEL_M: f64 = 0.11;
const TRAVELS: usize = 23;
const RACKS: usize = 41;

/// Sweeps an axle. `rack_max_m`: largest rack displacement either way, 0 for an unsteered axle.
///
/// # Errors
/// Sentences that say what is wrong with the axle.
pub fn axle_kinematics(axle: &Axle, rack_max_m: f64) -> Result<AxleKinematics, Vec<String>> {
    let mut solver = Suspension::new(axle).map_err(|error| vec![error.to_string()])?;
    // A mechanism near its lock may not reach the corners of the grid: narrow it until it does.
    let mut scale = 1.0;
    while scale > 0.35 {
        if let Some((grid, sides)) = sweep(&mut solver, TRAVEL_M * scale, rack_max_m * scale.max(0.8)) {
            return AxleKinematics::from_samples(
                grid,
                &sides[0],
                &sides[1],
                [axle.spin_axis(0), axle.spin_axis(1)],
            )
            .map_err(|e| vec![e]);
        }
        scale -= 0.05;
    }
    Err(vec![
        "the suspension cannot be posed over a third of the usual travel: check the hardpoints".to_owned(),
    ])
}

fn sweep(
    solver: &mut Suspension,
    travel_max_m: f64,
    rack_max_m: f64,
) -> Option<(Grid, [Vec<KnuckleSample>; 2])> {
    let racks = if rack_max_m > 0.0 { RACKS } else { 1 };
    let grid = Grid {
        travel_min_m: -travel_max_m,
        travel_max_m,
        travels: TRAVELS,
        rack_min_m: -rack_max_m,
        rack_max_m,
        racks,
    };
    let blank = KnuckleSample {
        attitude: [1.0, 0.0, 0.0, 0.0],
        x_m: 0.0,
        y_m: 0.0,
        kingpin_direction: [0.0, 0.0, 1.0],
        kingpin_point_m: [0.0; 3],
    };
    let mut sides = [vec![blank; TRAVELS * racks], vec![blank; TRAVELS * racks]];
    let mut output = SuspensionOutput::default();
    let mut input = SuspensionInput::DESIGN;
    let mut pose = |input: &SuspensionInput, solver: &mut Suspension| {
        solver.step(input, &mut output);
        (output.status == Status::Converged).then_some(output)
    };
    solver.reset();
    input.rack_m = 0.0;
    let design = pose(&input, solver)?;
    // Snake from the middle outwards, so that each solve starts next to the one before.
    for half in [1.0_f64, -1.0] {
        solver.reset();
        pose(&SuspensionInput::DESIGN, solver)?;
        let middle = racks / 2;
        let columns: Vec<usize> =
            if half > 0.0 { (middle..racks).collect() } else { (0..middle).rev().collect() };
        for (turn, &j) in columns.iter().enumerate() {
            let rack_m = if racks == 1 { 0.0 } else { grid.rack_m(j) };
            let rows: Vec<usize> =
                if turn % 2 == 0 { (0..TRAVELS).collect() } else { (0..TRAVELS).rev().collect() };
            for i in rows {
                // To the target in steps: a jump across the map is not what Newton is for.
                let target = SuspensionInput {
                    rack_m,
                    wheel_height_m: [grid.travel_m(i); 2],
                    ..SuspensionInput::DESIGN
                };
                let from = input;
                let mut solved = None;
                for part in 1..=4 {
                    let mix = f64::from(part) / 4.0;
                    input.rack_m = from.rack_m + mix * (target.rack_m - from.rack_m);
                    for side in 0..2 {
                        input.wheel_height_m[side] = from.wheel_height_m[side]
                            + mix * (target.wheel_height_m[side] - from.wheel_height_m[side]);
                    }
                    solved = Some(pose(&input, solver)?);
                }
                let solved = solved?;
                for side in 0..2 {
                    let (now, zero) = (&solved.side[side], &design.side[side]);
                    let direction = now.upper_joint_m - now.lower_joint_m;
                    let moved = now.wheel_centre_m - zero.wheel_centre_m;
                    let point = now.lower_joint_m - zero.wheel_centre_m;
                    sides[side][i * racks + j] = KnuckleSample {
                        attitude: now.knuckle_quaternion,
                        x_m: moved.x,
                        y_m: moved.y,
                        kingpin_direction: direction.into(),
                        kingpin_point_m: point.into(),
                    };
                }
            }
        }
        input = SuspensionInput::DESIGN;
    }
    Some((grid, sides))
}
