//! What is wrong with the user's input: every violation at once, each with its place, key, value and rule.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Most violations that are kept; the rest are counted.
pub const VIOLATIONS_MAX: usize = 200;

/// What kind of mistake a violation is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mistake {
    /// A file, or a name of the library, that does not exist.
    NotFound,
    /// A file that is a directory, not readable, too large or not UTF-8.
    Unreadable,
    /// Not TOML (or not CSV, not JSON).
    Syntax,
    /// `extends` that leads back to itself or too deep.
    Extends,
    /// A `--set` that is not `path=value`.
    Override,
    /// A key that the section does not have.
    UnknownKey,
    /// A key that the section needs.
    MissingKey,
    /// A value of another type.
    WrongType,
    /// A number outside its range.
    OutOfRange,
    /// NaN or infinity.
    NotFinite,
    /// None of the allowed words.
    NotAChoice,
    /// A list or text of the wrong length.
    WrongLength,
    /// A rule that joins several values.
    Rule,
    /// The content of a recorded history.
    Record,
    /// The content of another referenced file (hardpoints, tyre).
    Reference,
}

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Violation {
    /// What kind of mistake.
    pub mistake: Mistake,
    /// The file, `library:...` for a shipped one, `--set` for an override.
    pub file: String,
    /// Line, counted from 1; 0: the file as a whole.
    pub line: u32,
    /// Column in characters, counted from 1; 0: the line as a whole.
    pub column: u32,
    /// Dotted key path; empty where there is none.
    pub key: String,
    /// The value as written; empty where there is none.
    pub value: String,
    /// What should be.
    pub rule: String,
    /// The name that was probably meant.
    pub suggestion: Option<String>,
}

impl Violation {
    /// About a file as a whole.
    pub fn of_file(mistake: Mistake, file: impl Into<String>, rule: impl Into<String>) -> Self {
        Self {
            mistake,
            file: file.into(),
            line: 0,
            column: 0,
            key: String::new(),
            value: String::new(),
            rule: rule.into(),
            suggestion: None,
        }
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if self.line > 0 {
            write!(f, ":{}", self.line)?;
            if self.column > 0 {
                write!(f, ":{}", self.column)?;
            }
        }
        write!(f, ": ")?;
        if !self.key.is_empty() {
            write!(f, "{}", self.key)?;
            if !self.value.is_empty() {
                write!(f, " = {}", self.value)?;
            }
            write!(f, ": ")?;
        }
        write!(f, "{}", self.rule)?;
        if let Some(meant) = &self.suggestion {
            write!(f, " (did you mean `{meant}`?)")?;
        }
        Ok(())
    }
}

/// Everything found wrong, in the order of files and lines.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Problems {
    /// The violations, at most [`VIOLATIONS_MAX`].
    pub violations: Vec<Violation>,
    /// How many more there were.
    pub more: usize,
}

impl Problems {
    /// One violation alone.
    pub fn one(violation: Violation) -> Self {
        Self { violations: vec![violation], more: 0 }
    }

    /// Notes a violation (a second one about the same key and rule at the same place is dropped).
    pub fn push(&mut self, violation: Violation) {
        if self.violations.contains(&violation) {
            return;
        }
        if self.violations.len() < VIOLATIONS_MAX {
            self.violations.push(violation);
        } else {
            self.more += 1;
        }
    }

    /// Takes over everything of `others`.
    pub fn extend(&mut self, others: Self) {
        self.more += others.more;
        for violation in others.violations {
            self.push(violation);
        }
    }

    /// Whether nothing is wrong.
    pub fn is_empty(&self) -> bool {
        self.violations.is_empty()
    }

    /// `Ok(value)` if nothing is wrong.
    pub fn or<T>(self, value: T) -> Result<T, Self> {
        if self.is_empty() { Ok(value) } else { Err(self) }
    }

    /// For programs: `{"violations": [...], "more": n}`.
    pub fn to_json(&self) -> serde_json::Value {
        serde_json::to_value(self).unwrap_or_default()
    }

    pub(crate) fn sort(&mut self) {
        self.violations.sort_by(|a, b| (&a.file, a.line, a.column).cmp(&(&b.file, b.line, b.column)));
    }
}

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, violation) in self.violations.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{violation}")?;
        }
        if self.more > 0 {
            write!(f, "\n... and {} more", self.more)?;
        }
        Ok(())
    }
}

impl std::error::Error for Problems {}
