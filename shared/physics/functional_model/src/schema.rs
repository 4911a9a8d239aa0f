//! JSON schema (draft 2020-12) of the model file, for completion and checks in editors. Written by hand, as the reader
//! is; a test walks both so that neither knows a key the other does not.

/// The schema's text.
pub const JSON: &str = include_str!("model.schema.json");

#[cfg(test)]
mod tests {
    #[test]
    fn every_key_of_the_reader_is_in_the_schema() {
        for key in crate::document::MODEL_KEYS.iter().chain(crate::document::PLACING_KEYS) {
            assert!(super::JSON.contains(&format!("\"{key}\": {{")), "{key} is not in the schema");
        }
    }
}
