//! Which columns of a log are meant: by name, by region or field, or by a pattern.

use crate::error::LogError;
use crate::reader::LogReader;

/// The selected columns as (region, column). Each entry of `selection` is a region (`rig_status`), a field
/// (`vehicle_state.position_m`), a signal (`vehicle_state.position_m.x`), or a pattern over whole names in which `*`
/// stands for any text and `?` for one character (`*force_n*`, `vehicle_state.*_rad_s.z`). In the order of the entries,
/// each column once; nothing selected: all.
pub(crate) fn select(log: &LogReader, selection: &[String]) -> Result<Vec<(usize, usize)>, LogError> {
    let all = || {
        log.regions()
            .iter()
            .enumerate()
            .flat_map(|(r, region)| (0..region.columns.len()).map(move |c| (r, c)))
    };
    if selection.is_empty() {
        return Ok(all().collect());
    }
    let mut selected: Vec<(usize, usize)> = Vec::new();
    for wanted in selection {
        let pattern = wanted.contains(['*', '?']);
        let found: Vec<(usize, usize)> = all()
            .filter(|&(r, c)| {
                let region = &log.regions()[r];
                let full = format!("{}.{}", region.name, region.columns[c].name);
                if pattern {
                    matches(wanted.as_bytes(), full.as_bytes())
                } else {
                    full == *wanted
                        || full.strip_prefix(wanted.as_str()).is_some_and(|rest| rest.starts_with('.'))
                }
            })
            .collect();
        if found.is_empty() {
            if !pattern {
                // The same search by name gives the error its suggestions.
                log.signal(wanted)?;
            }
            return Err(LogError::UnknownSignal { name: wanted.clone(), known: Vec::new() });
        }
        for column in found {
            if !selected.contains(&column) {
                selected.push(column);
            }
        }
    }
    Ok(selected)
}

/// Whether a pattern fits a whole text. On a mismatch behind a `*` that star takes one character more; earlier stars
/// never need to be looked at again, so the time is bounded by the product of the lengths.
fn matches(pattern: &[u8], text: &[u8]) -> bool {
    let (mut p, mut t) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        match pattern.get(p) {
            Some(b'*') => {
                star = Some((p, t));
                p += 1;
            }
            Some(&c) if c == b'?' || c == text[t] => {
                p += 1;
                t += 1;
            }
            _ => {
                let Some((at, taken)) = star else { return false };
                star = Some((at, taken + 1));
                p = at + 1;
                t = taken + 1;
            }
        }
    }
    pattern[p..].iter().all(|&c| c == b'*')
}

/// The descriptions of a region's columns, if this program has the same layout as the log.
pub(crate) fn docs_of(region: &str, layout_hash: &str) -> Vec<(String, &'static str)> {
    regions::REGIONS
        .iter()
        .filter(|known| known.name == region && format!("{:016x}", known.layout.hash()) == layout_hash)
        .flat_map(|known| known.layout.columns())
        .map(|column| (column.name, column.doc))
        .collect()
}

/// A unit as measurement tools print it.
pub(crate) fn pretty(unit: &str) -> String {
    unit.replace("^2", "²").replace("^3", "³").replace('*', "·")
}

#[cfg(test)]
mod tests {
    use super::matches;

    #[test]
    fn patterns_fit_whole_names() {
        let fits = |pattern: &str, text: &str| matches(pattern.as_bytes(), text.as_bytes());
        assert!(fits("*", "") && fits("*", "a.b") && fits("a*c", "abbc") && fits("a?c", "abc"));
        assert!(fits("*force_n*", "rig.tie_rod_force_n.left") && fits("*a*b", "xaxbxab"));
        assert!(!fits("a*c", "abcd") && !fits("a?c", "ac") && !fits("*force", "forces") && !fits("", "a"));
    }
}
