//! What a region looks like, and the checked name of a bench. No region is known here: the list is the caller's.

use crate::TableError;

/// The layout of one region. Two processes share a region only if every field agrees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegionSpec {
    /// Name, `[a-z0-9_]{1,64}`; part of the segment's name.
    pub name: &'static str,
    /// Version of the layout.
    pub version: u32,
    /// Hash over the names, types and order of the fields.
    pub layout_hash: u64,
    /// Payload, in 8-byte words; at least 1.
    pub words: usize,
    /// Ticks of history; a power of two, at least 2.
    pub depth: usize,
}

impl RegionSpec {
    /// Checks name, words and depth.
    ///
    /// # Errors
    /// [`TableError::Spec`], naming the rule.
    pub fn check(&self) -> Result<(), TableError> {
        let rule = if !is_name(self.name, 64, |b| b == b'_') {
            "the name must match [a-z0-9_]{1,64}"
        } else if self.words == 0 || self.words > 1 << 24 {
            "words must be in [1, 2^24]"
        } else if !self.depth.is_power_of_two() || self.depth < 2 || self.depth > 1 << 24 {
            "depth must be a power of two in [2, 2^24]"
        } else {
            return Ok(());
        };
        Err(TableError::Spec { region: self.name.to_owned(), rule })
    }

    /// The part that two sides must agree on.
    pub fn layout(&self) -> Layout {
        Layout {
            version: self.version,
            hash: self.layout_hash,
            words: self.words as u64,
            depth: self.depth as u64,
        }
    }
}

/// Version, hash and size of a region, as a specification or a segment's header says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Version of the layout.
    pub version: u32,
    /// Hash of the layout.
    pub hash: u64,
    /// Payload words.
    pub words: u64,
    /// Ticks of history.
    pub depth: u64,
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "version {}, layout hash {:016x}, {} words, depth {}",
            self.version, self.hash, self.words, self.depth
        )
    }
}

/// What all regions of a table have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TableInfo {
    /// Identifies this run in logs and reports.
    pub run_id: u64,
    /// Period of a tick. \[ns\], at least 1
    pub period_ns: u64,
    /// Start of tick 0 on `CLOCK_MONOTONIC`. \[ns\]; 0 = not started yet, see [`crate::Table::set_t0`]
    pub t0_ns: u64,
}

/// The name of a bench, `[a-z0-9_-]{1,40}`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BenchName(String);

impl BenchName {
    /// Checks a name.
    ///
    /// # Errors
    /// [`TableError::BenchName`].
    pub fn new(name: &str) -> Result<Self, TableError> {
        if is_name(name, 40, |b| b == b'_' || b == b'-') {
            Ok(BenchName(name.to_owned()))
        } else {
            Err(TableError::BenchName { name: name.chars().take(80).collect() })
        }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl std::fmt::Display for BenchName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

fn is_name(name: &str, length_max: usize, extra: impl Fn(u8) -> bool) -> bool {
    (1..=length_max).contains(&name.len())
        && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || extra(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bench_names() {
        for good in ["a", "rig-1_left", &"x".repeat(40)] {
            assert!(BenchName::new(good).is_ok(), "{good}");
        }
        for bad in ["", "A", "a.b", "a/b", "../x", "a b", "ä", &"x".repeat(41), &"x".repeat(100_000)] {
            assert!(matches!(BenchName::new(bad), Err(TableError::BenchName { .. })), "{bad}");
        }
    }

    #[test]
    fn specs() {
        let good = RegionSpec { name: "vehicle_state", version: 1, layout_hash: 1, words: 3, depth: 4 };
        assert!(good.check().is_ok());
        for bad in [
            RegionSpec { name: "a.b", ..good },
            RegionSpec { words: 0, ..good },
            RegionSpec { words: usize::MAX, ..good },
            RegionSpec { depth: 1, ..good },
            RegionSpec { depth: 6, ..good },
        ] {
            assert!(matches!(bad.check(), Err(TableError::Spec { .. })), "{bad:?}");
        }
    }
}
