//! Blocks that come with the product: `use = "library/NAME.toml"`.

/// Text of a library block.
pub(crate) fn resolve(_name: &str) -> Option<String> {
    None
}
