//! OpenCRG files of a road: read whole with what they include, checked, and carried as they are, so that a log holds
//! the road that it was driven on.

use crate::problem::{Mistake, Problems, Violation};
use opencrg::{CrgGrid, Error, LoadOptions};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::io;
use std::path::Path;

/// Largest OpenCRG file. [bytes]
pub const SURFACE_BYTES_MAX: u64 = 256 << 20;

/// An OpenCRG file and those that it includes (`$ROAD_CRG_FILE`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFiles {
    /// The file, then the included ones, by the names that the including files say.
    pub files: Vec<DataFile>,
}

/// A file of bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DataFile {
    /// Name.
    pub name: String,
    /// Content: as text where it is text, else in hexadecimal.
    #[serde(serialize_with = "write_bytes", deserialize_with = "read_bytes")]
    pub bytes: Vec<u8>,
}

impl SurfaceFiles {
    /// Reads a file and what it includes, relative to its directory, and checks them.
    ///
    /// # Errors
    /// Files that cannot be read or are not OpenCRG, or use what the reader does not know.
    pub fn read(path: &Path) -> Result<Self, Problems> {
        let name = path.display().to_string();
        let fail = |mistake, rule: String| Problems::one(Violation::of_file(mistake, name.clone(), rule));
        let bytes = read_bounded(path).map_err(|error| {
            let lost = error.kind() == io::ErrorKind::NotFound;
            fail(if lost { Mistake::NotFound } else { Mistake::Unreadable }, error.to_string())
        })?;
        let mut files = vec![DataFile { name: name.clone(), bytes: bytes.clone() }];
        let directory = path.parent().unwrap_or(Path::new(""));
        let parsed = CrgGrid::from_bytes_with(&bytes, &LoadOptions::default(), |included| {
            let bytes = read_bounded(&directory.join(included))?;
            files.push(DataFile { name: included.to_owned(), bytes: bytes.clone() });
            Ok(bytes)
        });
        match parsed {
            Ok(_) => Ok(Self { files }),
            Err(Error::Syntax { line, reason }) => Err(Problems::one(Violation {
                line: u32::try_from(line).unwrap_or(0),
                ..Violation::of_file(Mistake::Reference, name, format!("is not OpenCRG: {reason}"))
            })),
            Err(error) => Err(fail(Mistake::Reference, format!("cannot be used as OpenCRG: {error}"))),
        }
    }

    /// The grid.
    ///
    /// # Errors
    /// As [`Self::read`]; only for files that did not come from there.
    pub fn grid(&self) -> Result<CrgGrid, String> {
        let Some(main) = self.files.first() else { return Err("no OpenCRG file".to_owned()) };
        let loaded = CrgGrid::from_bytes_with(&main.bytes, &LoadOptions::default(), |included| {
            let file = self.files[1..].iter().find(|file| file.name == included);
            file.map(|file| file.bytes.clone()).ok_or_else(|| io::ErrorKind::NotFound.into())
        });
        loaded.map_err(|error| format!("{}: {error}", main.name))
    }
}

fn read_bounded(path: &Path) -> io::Result<Vec<u8>> {
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        return Err(io::Error::other("is not a regular file"));
    }
    if about.len() > SURFACE_BYTES_MAX {
        return Err(io::Error::other(format!("is too large: at most {SURFACE_BYTES_MAX} bytes")));
    }
    std::fs::read(path)
}

const HEX: &str = "hex:";
const TEXT: &str = "text:";

fn write_bytes<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => format!("{TEXT}{text}"),
        Err(_) => {
            let digit = |n: u8| char::from_digit(u32::from(n), 16).unwrap_or('0');
            let digits = bytes.iter().flat_map(|byte| [digit(byte >> 4), digit(byte & 15)]);
            HEX.chars().chain(digits).collect()
        }
    };
    serializer.serialize_str(&text)
}

fn read_bytes<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
    let text = String::deserialize(deserializer)?;
    if let Some(text) = text.strip_prefix(TEXT) {
        return Ok(text.as_bytes().to_vec());
    }
    let digits: Option<Vec<u8>> = text
        .strip_prefix(HEX)
        .and_then(|digits| digits.chars().map(|c| c.to_digit(16).map(|d| d as u8)).collect());
    match digits {
        Some(digits) if digits.len() % 2 == 0 => Ok(digits.chunks(2).map(|d| d[0] << 4 | d[1]).collect()),
        _ => Err(serde::de::Error::custom("neither text nor hexadecimal")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_go_through_json_as_they_are() {
        for bytes in [b"$ROAD_CRG\n".to_vec(), (0..=255).collect()] {
            let file = DataFile { name: "a".to_owned(), bytes };
            let text = serde_json::to_string(&file).unwrap();
            assert_eq!(serde_json::from_str::<DataFile>(&text).unwrap(), file);
        }
    }
}
