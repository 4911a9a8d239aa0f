//! Vehicle and multibody stepped again from the log, as if they had never died: each with the inputs that the
//! log says it used. If what the log holds is the same bit for bit, no restart made a jump.

use assembly::{ServiceKind, build};
use config::ResolvedBench;
use record::LogReader;
use regions::{NO_TICK, RegionId, model_flags};
use runtime::{Bound, Model, region_specs};
use table::{Read, RegionWriter, Table, TableInfo};

/// Columns that tell of restarts and waits, not of the state.
const NOT_STATE: [&str; 2] = ["flags", "held_count"];

/// What stepping again showed.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize)]
pub struct Replayed {
    /// Ticks compared.
    pub ticks: u64,
    /// Ticks in which a word differs.
    pub different: u64,
    /// The first of them and its column.
    pub first: Option<(u64, String)>,
    /// Why it could not be done to the end.
    pub stopped: Option<String>,
}

struct Source {
    region: &'static str,
    used: usize,
    writer: RegionWriter,
}

/// Steps a service again. `spoilt`: ticks whose published words a campaign falsified.
pub fn replay(
    kind: ServiceKind,
    resolved: &ResolvedBench,
    log: &LogReader,
    spoilt: impl Fn(u64) -> bool,
) -> Result<Replayed, String> {
    let timing = &resolved.scenario.timing;
    let info = TableInfo { run_id: 1, period_ns: timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(timing.period_s()), info).map_err(|e| e.to_string())?;
    let model = build(kind, resolved).map_err(|e| e.to_string())?;
    let mut bound: Bound<dyn Model> = Bound::new(model, &table, false).map_err(|e| e.to_string())?;
    let (name, output, inputs): (_, _, &[(RegionId, &str)]) = match kind {
        ServiceKind::Vehicle => {
            ("vehicle_state", RegionId::VehicleState, &[(RegionId::RigMeasurement, "used_rig_measurement")])
        }
        _ => (
            "suspension_state",
            RegionId::SuspensionState,
            &[
                (RegionId::RigMeasurement, "used_rig_measurement"),
                (RegionId::VehicleState, "used_vehicle_state"),
            ],
        ),
    };
    let logged = log.region(name).map_err(|e| e.to_string())?;
    let column = |name: &str| logged.column_index(name).map_err(|e| e.to_string());
    let flags = column("flags")?;
    let skip: Vec<usize> = NOT_STATE.iter().map(|name| column(name)).collect::<Result<_, _>>()?;
    let mut sources = Vec::new();
    for (id, used) in inputs {
        let writer = table.claim_writer(*id as usize).map_err(|e| e.to_string())?;
        sources.push(Source { region: id.region().name, used: column(used)?, writer });
    }
    // What came on the side: the start of the manoeuvre's clock, and the parameters by the version it ran on.
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(|e| e.to_string())?;
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).map_err(|e| e.to_string())?;
    let (asked, tuned) = (log.region("bench").ok(), log.region("parameters").ok());
    let versions = log.column_u64("parameters", "version").unwrap_or_default();
    let on_version = column("parameters_version")?;
    let reader = table.reader(output as usize).clone();
    let mut words = vec![0; reader.words()];
    let mut result = Replayed::default();
    for (row, &tick) in logged.ticks.iter().enumerate() {
        let was = logged.row(row);
        for source in &mut sources {
            let used = was[source.used];
            if used != tick || used == NO_TICK {
                continue;
            }
            let Some(input) = log.region(source.region).ok().and_then(|r| r.at_tick(tick)) else {
                result.stopped = Some(format!("{} of tick {tick} is not in the log", source.region));
                return Ok(result);
            };
            let _ = source.writer.write(tick, input);
        }
        if let Some(asked) = asked {
            let row = asked.ticks.partition_point(|&t| t <= tick).max(1) - 1;
            if row < asked.ticks.len() {
                let _ = bench.write(tick, asked.row(row));
            }
        }
        if let Some(row) = versions.iter().position(|&version| version == was[on_version])
            && let Some(tuned) = tuned
        {
            let _ = parameters.write(tick, tuned.row(row));
        }
        let caught_up = was[flags] & model_flags::CAUGHT_UP != 0;
        bound.tick(0, tick, caught_up).map_err(|e| e.to_string())?;
        if spoilt(tick) || reader.read(tick, &mut words) != Read::Ready {
            continue;
        }
        result.ticks += 1;
        let differs = (0..words.len()).find(|&i| words[i] != was[i] && !skip.contains(&i));
        if let Some(i) = differs {
            result.different += 1;
            result.first.get_or_insert_with(|| (tick, logged.columns[i].name.clone()));
        }
    }
    Ok(result)
}
