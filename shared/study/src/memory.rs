//! A whole run in lockstep in this thread, with every region of every tick kept in memory as a log.
//!
//! The models, their order and the requests of the supervisor are those of `kingpin run --lockstep`: arm, start, the
//! scenario's duration, the soft stop. About 2.5 MB per second of a run at 1 kHz.

use assembly::plan::RunPlan;
use assembly::{AssemblyError, ServiceKind, build, build_can};
use config::ResolvedBench;
use record::{LogHeader, LogReader, Source, text_hash};
use regions::{ALL, Parameters, Payload, RegionId};
use runtime::lockstep::Chain;
use runtime::{Bound, region_specs};
use std::collections::BTreeMap;
use table::{Read, Table, TableInfo};

/// Ticks between two looks at whether to go on.
const LOOK: u64 = 256;

/// Somebody asked a run to end early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Interrupted;

/// Why there is no run.
#[derive(Debug)]
pub enum RunFault {
    /// The configuration cannot be built.
    Assembly(AssemblyError),
    /// The loop broke off, or could not begin.
    Broken(String),
    /// Ended early on request.
    Interrupted,
}

impl std::fmt::Display for RunFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RunFault::Assembly(error) => write!(f, "{error}"),
            RunFault::Broken(why) => f.write_str(why),
            RunFault::Interrupted => f.write_str("ended early on request"),
        }
    }
}

impl std::error::Error for RunFault {}

impl From<AssemblyError> for RunFault {
    fn from(error: AssemblyError) -> Self {
        RunFault::Assembly(error)
    }
}

fn refused(fault: impl std::fmt::Display) -> RunFault {
    RunFault::Broken(fault.to_string())
}

/// Makes a run. `look` is called every 256 ticks with the ticks done and all of them, and may end the run.
///
/// # Errors
/// A configuration that cannot be built, a loop that breaks off, and the end that `look` asked for.
pub fn run(
    resolved: &ResolvedBench,
    mut look: impl FnMut(u64, u64) -> Result<(), Interrupted>,
) -> Result<LogReader, RunFault> {
    let scenario = &resolved.scenario;
    let timing = &scenario.timing;
    let period_s = timing.period_s();
    let info = TableInfo { run_id: 1, period_ns: timing.period_ns(), t0_ns: 1 };
    let table = Table::create_local(&region_specs(period_s), info).map_err(refused)?;
    let bind = |model| Bound::new(model, &table, true).map_err(refused);
    let mut models = Vec::new();
    for kind in [ServiceKind::Rig, ServiceKind::Vehicle, ServiceKind::Multibody] {
        models.push(bind(build(kind, resolved)?)?);
    }
    let mut order = vec![(0, 0), (1, 0), (2, 0), (0, 1)];
    if let Some(model) = build_can(resolved, None, false)? {
        models.push(bind(model)?);
        order.push((3, 0));
    }
    let mut chain = Chain::new(models, order);
    let mut bench = table.claim_writer(RegionId::Bench as usize).map_err(refused)?;
    let mut parameters = table.claim_writer(RegionId::Parameters as usize).map_err(refused)?;
    let schedule = params::Schedule::new(resolved).map_err(|faults| {
        let faults: Vec<String> = faults.iter().map(ToString::to_string).collect();
        RunFault::Broken(faults.join("\n"))
    })?;
    let plan = RunPlan::new(scenario.ticks(), period_s, resolved.rig.limits.stop_fade_s);
    let kept: Vec<RegionId> = ALL.into_iter().filter(|id| id.region().logged()).collect();
    let readers: Vec<_> = kept.iter().map(|&id| table.reader(id as usize).clone()).collect();
    let mut words = vec![0; kept.iter().map(|id| id.region().layout.words()).max().unwrap_or(0)];
    let mut rows: Vec<(RegionId, Vec<u64>, Vec<u64>)> =
        kept.into_iter().map(|id| (id, Vec::new(), Vec::new())).collect();
    for n in 0..plan.end {
        if n.is_multiple_of(LOOK) {
            look(n, plan.end).map_err(|Interrupted| RunFault::Interrupted)?;
        }
        // Sole writer, in order: cannot be refused.
        let _ = bench.write(n, plan.at(n).words());
        let (version, values) = schedule.at(n);
        let _ = parameters.write(n, Parameters { tick: n, version, value: *values }.words());
        chain.tick(n).map_err(refused)?;
        for (reader, (id, ticks, kept)) in readers.iter().zip(&mut rows) {
            let words = &mut words[..id.region().layout.words()];
            if reader.read(n, words) == Read::Ready {
                ticks.push(n);
                kept.extend_from_slice(words);
            }
        }
    }
    look(plan.end, plan.end).map_err(|Interrupted| RunFault::Interrupted)?;
    Ok(LogReader::in_memory(header(resolved), rows))
}

/// What a log says about such a run.
fn header(resolved: &ResolvedBench) -> LogHeader {
    let configuration = resolved.canonical_json();
    LogHeader {
        bench: "memory".to_owned(),
        scenario: resolved.scenario.name.clone(),
        run_id: 1,
        period_ns: resolved.scenario.timing.period_ns(),
        lockstep: true,
        seed: resolved.scenario.seed,
        versions: BTreeMap::from([
            ("kingpin".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("configuration_sha256".to_owned(), resolved.hash()),
        ]),
        configuration_hash: text_hash(&configuration),
        configuration,
        sources: resolved
            .sources
            .iter()
            .map(|source| Source { name: source.name.clone(), text: source.text.clone() })
            .collect(),
        ..LogHeader::default()
    }
}
