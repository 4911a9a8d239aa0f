//! Logs made for tests: every word of every region differs from its neighbours and from tick to tick.
#![allow(dead_code)]

use std::path::Path;

use record::{LogHeader, LogWriter, Source, text_hash};
use regions::{ALL, Kind, RegionId};

/// A header as a run writes it.
pub fn header(lockstep: bool) -> LogHeader {
    let configuration = "[scenario]\nname = \"lane change\"\n".to_owned();
    LogHeader {
        decimation: None,
        bench: "test".into(),
        scenario: "lane_change".into(),
        run_id: 0x1234_5678_9abc_def0,
        period_ns: 1_000_000,
        wall_start_ns: 1_760_000_000_123_456_789,
        monotonic_start_ns: 987_654_321,
        lockstep,
        seed: 42,
        versions: [("kingpin".to_owned(), "0.1.0".to_owned())].into(),
        configuration_hash: text_hash(&configuration),
        configuration,
        sources: vec![Source { name: "cars/mid.toml".into(), text: "mass_kg = 1500.0\n".into() }],
    }
}

/// The words of a region at a tick: a counter's word is unlike any other, numbers include NaN, infinities,
/// negative zero, denormals and counters above 2^53.
pub fn words(id: RegionId, tick: u64) -> Vec<u64> {
    let columns = id.region().layout.columns();
    let mut words: Vec<u64> = columns
        .iter()
        .map(|column| {
            let mixed =
                (tick * 4099 + column.word as u64 * 31 + id as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            match column.kind {
                Kind::U64 => mixed,
                Kind::F64 => match mixed % 11 {
                    0 => f64::NAN.to_bits(),
                    1 => f64::NEG_INFINITY.to_bits(),
                    2 => (-0.0_f64).to_bits(),
                    3 => 5e-324_f64.to_bits(),
                    _ => (mixed as i64 as f64 * 1e-12).to_bits(),
                },
            }
        })
        .collect();
    words[0] = tick;
    words
}

/// The regions a log carries.
pub fn logged() -> impl Iterator<Item = RegionId> {
    ALL.into_iter().filter(|id| id.region().logged())
}

/// Writes ticks of all logged regions with a flush every 50.
pub fn write_ticks(log: &mut LogWriter, ticks: impl Iterator<Item = u64>) {
    for tick in ticks {
        for id in logged() {
            log.write(id, tick, &words(id, tick));
        }
        if tick % 50 == 49 {
            log.flush();
        }
    }
}

/// A whole log.
pub fn write_log(path: &Path, ticks: impl Iterator<Item = u64>) {
    let mut log = LogWriter::create(path, &header(false)).unwrap();
    log.event(0, "state", "armed");
    write_ticks(&mut log, ticks);
    log.event(7, "trip", serde_json::json!({ "code": 3, "limit_n": 9000.0 }));
    log.finish().unwrap();
}
