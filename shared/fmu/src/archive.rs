//! The `.fmu` file: a zip archive with `modelDescription.xml`, `binaries/<platform>/` and `resources/`.
//!
//! Entries are written below one folder only, whatever their names say, and no more than [`BYTES_MAX`] of them.

use crate::FmuError;
use crate::description::{Description, Version};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Largest archive, unpacked. [bytes]
pub const BYTES_MAX: u64 = 2 << 30;
/// Largest description. [bytes]
const XML_BYTES_MAX: u64 = 256 << 20;

/// An FMU file that was looked into.
#[derive(Debug, Clone, PartialEq)]
pub struct Fmu {
    /// The file.
    pub path: PathBuf,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
    /// What it says of itself.
    pub description: Description,
    /// Folders below `binaries/`.
    pub platforms: Vec<String>,
    /// Names of everything in it.
    names: Vec<String>,
}

/// Name of the folder for this machine's binary.
///
/// FMI 2.0 §2.3 names Linux by word length only; FMI 3.0 §2.5.1.4 by architecture.
#[must_use]
pub fn platform(version: Version) -> &'static str {
    match (version, cfg!(target_arch = "aarch64")) {
        (Version::Two, false) => "linux64",
        (Version::Three, false) => "x86_64-linux",
        (_, true) => "aarch64-linux",
    }
}

impl Fmu {
    /// Opens an FMU and reads its description.
    ///
    /// # Errors
    /// [`FmuError`] for a file that cannot be read, is no zip archive, or has no sound description.
    pub fn open(path: &Path) -> Result<Self, FmuError> {
        let io = |e: std::io::Error| FmuError::Io { path: path.to_owned(), why: e.to_string() };
        let mut file = File::open(path).map_err(io)?;
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 1 << 16];
        loop {
            let read = file.read(&mut buffer).map_err(io)?;
            if read == 0 {
                break;
            }
            hash.update(&buffer[..read]);
        }
        let mut archive = archive(path)?;
        let names: Vec<String> =
            archive.file_names().filter_map(|name| Some(name.ok()?.into_owned())).collect();
        let text = {
            let mut entry = archive
                .by_name("modelDescription.xml")
                .map_err(|_| FmuError::Xml { why: "is missing from the archive".to_owned() })?;
            let mut text = String::new();
            let read = entry.by_ref().take(XML_BYTES_MAX).read_to_string(&mut text);
            read.map_err(|e| match e.kind() {
                std::io::ErrorKind::InvalidData if !e.to_string().contains("checksum") => {
                    FmuError::Xml { why: "is not UTF-8 text".to_owned() }
                }
                _ => zip_error(path, &e),
            })?;
            text
        };
        let description = Description::parse(&text)?;
        let mut platforms: Vec<String> = names
            .iter()
            .filter_map(|name| name.strip_prefix("binaries/")?.split_once('/'))
            .filter(|(_, file)| !file.is_empty())
            .map(|(platform, _)| platform.to_owned())
            .collect();
        platforms.sort();
        platforms.dedup();
        let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Fmu { path: path.to_owned(), sha256, description, platforms, names })
    }

    /// Name of the entry with this machine's binary.
    ///
    /// # Errors
    /// [`FmuError::WrongPlatform`], [`FmuError::NeedsTool`].
    pub fn binary(&self) -> Result<String, FmuError> {
        let description = &self.description;
        if description.needs_execution_tool {
            return Err(FmuError::NeedsTool { tool: description.generation_tool.clone() });
        }
        let needed = platform(description.version);
        let name = format!("binaries/{needed}/{}.so", description.model_identifier);
        if self.names.contains(&name) {
            return Ok(name);
        }
        let mut present = self.platforms.clone();
        if present.iter().any(|p| p == needed) {
            present.push(format!("but no {}.so there", description.model_identifier));
        }
        Err(FmuError::WrongPlatform { needed: needed.to_owned(), present })
    }

    /// Writes everything into a folder, which is made.
    ///
    /// # Errors
    /// [`FmuError`] for an unsound archive or a refusing disk.
    pub fn extract(&self, folder: &Path) -> Result<(), FmuError> {
        let mut archive = archive(&self.path)?;
        let mut left = BYTES_MAX;
        for index in 0..archive.len() {
            let mut entry = archive.by_index(index).map_err(|e| zip_error(&self.path, &e))?;
            let Some(name) = entry.enclosed_name() else {
                let why = format!("entry {index} leads out of the archive");
                return Err(FmuError::Zip { path: self.path.clone(), why });
            };
            let target = folder.join(name);
            let io = |e: std::io::Error| FmuError::Io { path: target.clone(), why: e.to_string() };
            if entry.is_dir() {
                std::fs::create_dir_all(&target).map_err(io)?;
                continue;
            }
            if let Some(parent) = target.parent() {
                std::fs::create_dir_all(parent).map_err(io)?;
            }
            let mut out = File::create(&target).map_err(io)?;
            let copied = std::io::copy(&mut entry.by_ref().take(left + 1), &mut out)
                .map_err(|e| zip_error(&self.path, &e))?;
            if copied > left {
                let why = format!("is larger than {} GiB unpacked", BYTES_MAX >> 30);
                return Err(FmuError::Zip { path: self.path.clone(), why });
            }
            left -= copied;
        }
        Ok(())
    }

    /// Signs that it runs Python: files of that language, or a binary that looks for an interpreter.
    #[must_use]
    pub fn python(&self) -> Option<String> {
        let tool = &self.description.generation_tool;
        if tool.to_ascii_lowercase().contains("python") {
            return Some(format!("made by {tool}"));
        }
        let source = |name: &&String| name.starts_with("resources/") && name.ends_with(".py");
        if let Some(name) = self.names.iter().find(source) {
            return Some(name.clone());
        }
        let name = self.binary().ok()?;
        let mut archive = archive(&self.path).ok()?;
        let mut bytes = Vec::new();
        archive.by_name(&name).ok()?.take(BYTES_MAX).read_to_end(&mut bytes).ok()?;
        let signs: [&[u8]; 3] = [b"Py_Initialize", b"_Py_NoneStruct", b"libpython"];
        let sign = signs.into_iter().find(|sign| bytes.windows(sign.len()).any(|window| window == *sign))?;
        Some(format!("{} in its binary", String::from_utf8_lossy(sign)))
    }
}

fn zip_error(path: &Path, why: &impl ToString) -> FmuError {
    FmuError::Zip { path: path.to_owned(), why: why.to_string() }
}

fn archive(path: &Path) -> Result<zip::ZipArchive<File>, FmuError> {
    let file = File::open(path).map_err(|e| FmuError::Io { path: path.to_owned(), why: e.to_string() })?;
    zip::ZipArchive::new(file).map_err(|e| zip_error(path, &e))
}
