//! The list of regions as the table wants it.

use table::RegionSpec;

/// A specification for every region, in the order of `RegionId`, for a period. [s]
pub fn region_specs(period_s: f64) -> Vec<RegionSpec> {
    regions::REGIONS
        .iter()
        .map(|region| RegionSpec {
            name: region.name,
            version: region.layout.version,
            layout_hash: region.layout.hash(),
            words: region.layout.words(),
            depth: region.depth(period_s),
        })
        .collect()
}
