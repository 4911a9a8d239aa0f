//! The car's kinematics maps, swept with the multibody solver from the car's own hardpoints, so that car
//! and solver are one consistent thing (spec 3.1): pose of each knuckle over wheel travel and rack.

use config::axle::Axle;
use multibody::{Status, Suspension, SuspensionInput, SuspensionOutput};
use std::path::Path;
use vehicle::kinematics::{AxleKinematics, Grid, KnuckleSample};

/// Wheel travel asked for; the sweep is narrowed where the mechanism does not reach. [m]
const TRAVEL_M: f64 = 0.11;
const TRAVELS: usize = 23;
const RACKS: usize = 41;

/// Raised when the sweep changes, so that maps of an older program are not taken.
const VERSION: u64 = 1;
/// Words of a sample, and of the grid before the samples.
const SAMPLE_WORDS: usize = 12;
const GRID_WORDS: usize = 6;

/// Sweeps an axle. `rack_max_m`: largest rack displacement either way, 0 for an unsteered axle.
///
/// # Errors
/// Sentences that say what is wrong with the axle.
pub fn axle_kinematics(axle: &Axle, rack_max_m: f64) -> Result<AxleKinematics, Vec<String>> {
    axle_kinematics_in(axle, rack_max_m, None)
}

/// The same, with the samples of an earlier sweep of this very axle taken from a directory if they are there, and put
/// there if not: a restarted service must not sweep again while the car drives on. The samples are the same bits.
///
/// # Errors
/// As [`axle_kinematics`]; a directory that cannot be used costs only time.
pub fn axle_kinematics_in(
    axle: &Axle,
    rack_max_m: f64,
    directory: Option<&Path>,
) -> Result<AxleKinematics, Vec<String>> {
    let file = directory.map(|directory| directory.join(cache_name(axle, rack_max_m)));
    let kept = file.as_ref().and_then(|file| read_samples(&std::fs::read(file).ok()?));
    let (grid, sides) = match kept {
        Some(kept) => kept,
        None => {
            let swept = sample_axle(axle, rack_max_m)?;
            if let Some(file) = &file {
                // Whole or not at all; two services may do it at once.
                let draft = file.with_extension(std::process::id().to_string());
                let _ = std::fs::write(&draft, write_samples(&swept.0, &swept.1))
                    .and_then(|()| std::fs::rename(&draft, file));
            }
            swept
        }
    };
    AxleKinematics::from_samples(grid, &sides[0], &sides[1], [axle.spin_axis(0), axle.spin_axis(1)])
        .map_err(|e| vec![e])
}

/// Beginning of the names of kept sweeps.
pub(crate) const CACHE_PREFIX: &str = "kinematics-";

/// FNV-1a of everything that the sweep depends on.
fn cache_name(axle: &Axle, rack_max_m: f64) -> String {
    let text = serde_json::to_vec(axle).unwrap_or_default();
    let numbers = [VERSION, rack_max_m.to_bits(), TRAVEL_M.to_bits(), TRAVELS as u64, RACKS as u64];
    let bytes = text.into_iter().chain(numbers.iter().flat_map(|n| n.to_le_bytes()));
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{CACHE_PREFIX}{hash:016x}.f64")
}

fn write_samples(grid: &Grid, sides: &[Vec<KnuckleSample>; 2]) -> Vec<u8> {
    let mut words = vec![
        grid.travel_min_m,
        grid.travel_max_m,
        grid.travels as f64,
        grid.rack_min_m,
        grid.rack_max_m,
        grid.racks as f64,
    ];
    for s in sides.iter().flatten() {
        words.extend(s.attitude);
        words.extend([s.x_m, s.y_m]);
        words.extend(s.kingpin_direction);
        words.extend(s.kingpin_point_m);
    }
    let sum = words.iter().fold(0_u64, |sum, word| sum.rotate_left(1) ^ word.to_bits());
    words.push(f64::from_bits(sum));
    words.iter().flat_map(|word| word.to_bits().to_le_bytes()).collect()
}

fn read_samples(bytes: &[u8]) -> Option<(Grid, [Vec<KnuckleSample>; 2])> {
    let (chunks, rest) = bytes.as_chunks::<8>();
    let mut words: Vec<f64> = chunks.iter().map(|b| f64::from_bits(u64::from_le_bytes(*b))).collect();
    let sum = words.pop()?.to_bits();
    let found = words.iter().fold(0_u64, |sum, word| sum.rotate_left(1) ^ word.to_bits());
    if !rest.is_empty() || sum != found || words.len() < GRID_WORDS {
        return None;
    }
    let grid = Grid {
        travel_min_m: words[0],
        travel_max_m: words[1],
        travels: words[2] as usize,
        rack_min_m: words[3],
        rack_max_m: words[4],
        racks: words[5] as usize,
    };
    let count = grid.travels.checked_mul(grid.racks)?;
    if words.len() != GRID_WORDS + 2 * SAMPLE_WORDS * count {
        return None;
    }
    let sample = |w: &[f64]| KnuckleSample {
        attitude: [w[0], w[1], w[2], w[3]],
        x_m: w[4],
        y_m: w[5],
        kingpin_direction: [w[6], w[7], w[8]],
        kingpin_point_m: [w[9], w[10], w[11]],
    };
    let samples: Vec<_> = words[GRID_WORDS..].chunks_exact(SAMPLE_WORDS).map(sample).collect();
    let (left, right) = samples.split_at(count);
    Some((grid, [left.to_vec(), right.to_vec()]))
}

fn sample_axle(axle: &Axle, rack_max_m: f64) -> Result<(Grid, [Vec<KnuckleSample>; 2]), Vec<String>> {
    // What gives way under load is compliance, not kinematics (`compliance`): the sweep is that of rigid joints.
    let rigid = Axle { bushings: None, ..axle.clone() };
    let mut solver = Suspension::new(&rigid).map_err(|error| vec![error.to_string()])?;
    // A mechanism near its lock may not reach the corners of the grid: narrow it until it does.
    let mut scale = 1.0;
    while scale > 0.35 {
        if let Some(swept) = sweep(&mut solver, TRAVEL_M * scale, rack_max_m * scale.max(0.8)) {
            return Ok(swept);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_samples_are_the_same_bits_and_spoilt_ones_are_not_taken() {
        let axle = config::load::<Axle>("sedan_double_wishbone").map(|l| l.value);
        let axle = axle.unwrap_or_else(|problems| panic!("{problems}"));
        let (grid, sides) = sample_axle(&axle, axle.rack_stroke_m).unwrap_or_else(|e| panic!("{e:?}"));
        let mut bytes = write_samples(&grid, &sides);
        assert_eq!(read_samples(&bytes), Some((grid, sides)));
        assert_eq!(read_samples(&bytes[..bytes.len() - 8]), None);
        bytes[1000] ^= 1;
        assert_eq!(read_samples(&bytes), None);
        assert_ne!(cache_name(&axle, 0.07), cache_name(&axle, 0.08));
    }
}
