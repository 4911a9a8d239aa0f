//! What a log says about its run: which bench, scenario and configuration, and where its clock starts.

use std::collections::BTreeMap;

/// Name of the MCAP metadata record with the header's plain fields.
pub(crate) const METADATA_NAME: &str = "kingpin";
/// Attachment with the header as JSON.
pub(crate) const HEADER_ATTACHMENT: &str = "header.json";
/// Attachment with the resolved configuration.
pub(crate) const CONFIGURATION_ATTACHMENT: &str = "configuration.toml";
/// Prefix of the attachments with the configuration's source files.
pub(crate) const SOURCE_PREFIX: &str = "source/";

/// A file the configuration was made from, as it was.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Source {
    /// Name as given by the user or by `extends`.
    pub name: String,
    /// Content.
    pub text: String,
}

/// What a log says about its run.
#[derive(Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub struct LogHeader {
    /// Name of the bench.
    pub bench: String,
    /// Name of the scenario.
    pub scenario: String,
    /// Number of the run, the same in every file of it.
    pub run_id: u64,
    /// Period of a tick. \[ns\]
    pub period_ns: u64,
    /// Wall clock at tick 0, Unix time. \[ns\]
    pub wall_start_ns: u64,
    /// Monotonic clock at tick 0. \[ns\]
    pub monotonic_start_ns: u64,
    /// Whether the run was in lockstep: then times in the log are n·T alone.
    pub lockstep: bool,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Versions of the parts: `kingpin`, `rustc`, the kernel and so on.
    pub versions: BTreeMap<String, String>,
    /// Hash of the configuration, see [`text_hash`].
    pub configuration_hash: String,
    /// How ticks were thinned out, in words; none in a log as it was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub decimation: Option<String>,
    /// Resolved configuration, TOML.
    #[serde(skip)]
    pub configuration: String,
    /// Files the configuration was made from.
    #[serde(skip)]
    pub sources: Vec<Source>,
}

impl LogHeader {
    /// Period of a tick. \[s\]
    pub fn period_s(&self) -> f64 {
        self.period_ns as f64 / 1e9
    }

    /// Start of a tick since tick 0. \[s\]
    pub fn time_s(&self, tick: u64) -> f64 {
        // The product in integers, then one division (1e-9 is no double): the nearest double to n·T.
        (u128::from(tick) * u128::from(self.period_ns)) as f64 / 1e9
    }

    /// Time stamp of a tick in the log. \[ns\]
    pub fn log_time_ns(&self, tick: u64) -> u64 {
        let start = if self.lockstep { 0 } else { self.wall_start_ns };
        start.saturating_add(tick.saturating_mul(self.period_ns))
    }

    /// Whether the configuration is the one its hash was made of.
    pub fn configuration_intact(&self) -> bool {
        self.configuration_hash == text_hash(&self.configuration)
    }

    /// The plain fields as MCAP metadata, for tools that know nothing of us.
    pub(crate) fn metadata(&self) -> BTreeMap<String, String> {
        let mut map = BTreeMap::from([
            ("bench".to_owned(), self.bench.clone()),
            ("scenario".to_owned(), self.scenario.clone()),
            ("run_id".to_owned(), format!("{:016x}", self.run_id)),
            ("period_ns".to_owned(), self.period_ns.to_string()),
            ("wall_start_ns".to_owned(), self.wall_start_ns.to_string()),
            ("monotonic_start_ns".to_owned(), self.monotonic_start_ns.to_string()),
            ("lockstep".to_owned(), self.lockstep.to_string()),
            ("seed".to_owned(), self.seed.to_string()),
            ("configuration_hash".to_owned(), self.configuration_hash.clone()),
        ]);
        if let Some(decimation) = &self.decimation {
            map.insert("decimation".to_owned(), decimation.clone());
        }
        for (part, version) in &self.versions {
            map.insert(format!("version.{part}"), version.clone());
        }
        map
    }

    /// The header as far as plain metadata tell it, when the JSON attachment is lost.
    pub(crate) fn from_metadata(map: &BTreeMap<String, String>) -> Self {
        let text = |key: &str| map.get(key).cloned().unwrap_or_default();
        let number = |key: &str| map.get(key).and_then(|v| v.parse().ok()).unwrap_or(0);
        let versions = map
            .iter()
            .filter_map(|(k, v)| Some((k.strip_prefix("version.")?.to_owned(), v.clone())))
            .collect();
        LogHeader {
            bench: text("bench"),
            scenario: text("scenario"),
            run_id: u64::from_str_radix(&text("run_id"), 16).unwrap_or(0),
            period_ns: number("period_ns"),
            wall_start_ns: number("wall_start_ns"),
            monotonic_start_ns: number("monotonic_start_ns"),
            lockstep: text("lockstep") == "true",
            seed: number("seed"),
            versions,
            configuration_hash: text("configuration_hash"),
            decimation: map.get("decimation").cloned(),
            configuration: String::new(),
            sources: Vec::new(),
        }
    }
}

/// FNV-1a, 64 bit, of a text, as 16 hexadecimal digits: tells configurations apart, protects nothing.
pub fn text_hash(text: &str) -> String {
    let hash = text
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_is_fnv_1a() {
        // Test vectors of the FNV reference (Fowler, Noll, Vo; draft-eastlake-fnv, appendix C).
        assert_eq!(text_hash(""), "cbf29ce484222325");
        assert_eq!(text_hash("a"), "af63dc4c8601ec8c");
        assert_eq!(text_hash("foobar"), "85944171f73967e8");
    }

    #[test]
    fn times_do_not_accumulate() {
        let header = LogHeader { period_ns: 1_000_000, wall_start_ns: 7, ..LogHeader::default() };
        assert_eq!(header.time_s(123_456_789), 123_456.789);
        assert!((0..10_000).all(|n| header.time_s(n).to_string() == format!("{}", n as f64 / 1000.0)));
        assert_eq!(header.log_time_ns(3), 3_000_007);
        assert_eq!(LogHeader { lockstep: true, ..header }.log_time_ns(3), 3_000_000);
    }

    #[test]
    fn metadata_carry_the_plain_fields() {
        let mut header = LogHeader {
            bench: "b".into(),
            scenario: "s".into(),
            run_id: u64::MAX - 1,
            period_ns: 250_000,
            seed: 9,
            lockstep: true,
            ..LogHeader::default()
        };
        header.versions.insert("kingpin".into(), "0.1.0".into());
        assert_eq!(LogHeader::from_metadata(&header.metadata()), header);
    }
}
