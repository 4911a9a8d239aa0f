//! `suspension compliance`: what the bushings of an axle give, as the figures of a car file's `[front.compliance]`.

use super::arguments::SuspensionComplianceArgs;
use super::{Wrong, load_axle};
use crate::exit::Exit;
use crate::output;
use serde_json::json;

/// Lag written where the axle does not say one. [s]
const LAG_S: f64 = 0.005;

pub fn compliance(args: &SuspensionComplianceArgs) -> Result<Exit, Wrong> {
    if !(0.0..=50_000.0).contains(&args.load_n) {
        return Err(format!("--load-n = {}: must be in [0, 50000] N", args.load_n));
    }
    let axle = load_axle(&args.axle)?;
    let c = assembly::axle_compliance(&axle, args.load_n, LAG_S)
        .map_err(|faults| format!("{}: {}", args.axle, faults.join("; ")))?;
    let figures = [
        ("lag_s", c.lag_s),
        ("steer_per_fx_rad_n", c.steer_per_fx_rad_n),
        ("steer_per_fy_rad_n", c.steer_per_fy_rad_n),
        ("steer_per_mz_rad_n_m", c.steer_per_mz_rad_n_m),
        ("inclination_per_fx_rad_n", c.inclination_per_fx_rad_n),
        ("inclination_per_fy_rad_n", c.inclination_per_fy_rad_n),
        ("inclination_per_mz_rad_n_m", c.inclination_per_mz_rad_n_m),
        ("x_per_fx_m_n", c.x_per_fx_m_n),
        ("y_per_fy_m_n", c.y_per_fy_m_n),
    ];
    if args.json {
        let map: serde_json::Map<String, serde_json::Value> =
            figures.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
        output::json(&json!({ "axle": axle.name, "load_n": args.load_n, "compliance": map }));
        return Ok(Exit::Done);
    }
    output::line(format!("# {}: bushings only, {} N on each wheel", axle.name, args.load_n));
    output::line("[front.compliance]");
    for (name, value) in figures {
        output::line(format!("{name} = {value:.3e}"));
    }
    Ok(Exit::Done)
}
