//! Rules that join several fields of a section, collected all at once.

/// One broken rule, by the dotted key path of the value it speaks of (`axle.left.tierod_inner[1]`).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Broken {
    /// Dotted key path from the section's root; array entries as `[i]`.
    pub key: String,
    /// The rule, worded so that `<key> = <value>: <rule>` reads as a sentence: "must be ...".
    pub rule: String,
}

/// Collects broken rules while walking a section.
#[derive(Debug, Default)]
pub struct Checker {
    path: Vec<String>,
    found: Vec<Broken>,
}

impl Checker {
    /// Notes a broken rule at `key` (relative to where the checker stands) unless `holds`.
    pub fn require(&mut self, holds: bool, key: &str, rule: impl Into<String>) {
        if !holds {
            self.path.push(key.to_owned());
            let key = self.path.iter().filter(|part| !part.is_empty()).fold(String::new(), |path, part| {
                if path.is_empty() || part.starts_with('[') { path + part } else { path + "." + part }
            });
            self.path.pop();
            self.found.push(Broken { key, rule: rule.into() });
        }
    }

    /// Walks into `key` (`"[2]"` for an array entry) for the rules of `inside`.
    pub fn within(&mut self, key: &str, inside: impl FnOnce(&mut Self)) {
        self.path.push(key.to_owned());
        inside(self);
        self.path.pop();
    }

    /// Everything found, in the order of the walk.
    pub fn into_found(self) -> Vec<Broken> {
        self.found
    }
}

/// Rules of a section beyond type and range of single fields. All are reported, not the first only.
pub trait Check {
    /// Walks the section and notes each broken rule.
    fn check(&self, checker: &mut Checker);

    /// The broken rules of this section.
    fn broken(&self) -> Vec<Broken> {
        let mut checker = Checker::default();
        self.check(&mut checker);
        checker.into_found()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_paths_are_dotted_and_indexed() {
        let mut checker = Checker::default();
        checker.within("left", |c| c.within("point", |c| c.require(false, "[1]", "must be positive")));
        checker.require(true, "fine", "must be fine");
        checker.require(false, "mass_kg", "must be positive");
        let keys: Vec<_> = checker.into_found().into_iter().map(|b| b.key).collect();
        assert_eq!(keys, ["left.point[1]", "mass_kg"]);
    }
}
