//! Who a process is: its number and start time, from `/proc`.

use crate::header::ProcessId;

/// This process.
pub fn this_process() -> ProcessId {
    let pid = std::process::id();
    ProcessId { pid, start_ticks: stat(pid).map_or(0, |s| s.start_ticks) }
}

/// Whether that very process still runs (a zombie does not).
pub fn is_alive(id: ProcessId) -> bool {
    stat(id.pid).is_some_and(|s| s.start_ticks == id.start_ticks && !matches!(s.state, b'Z' | b'X' | b'x'))
}

struct Stat {
    state: u8,
    start_ticks: u64,
}

fn stat(pid: u32) -> Option<Stat> {
    parse(&std::fs::read(format!("/proc/{pid}/stat")).ok()?)
}

/// Fields 3 and 22 of `/proc/PID/stat` [proc(5)]. Field 2, the name, may hold spaces and parentheses.
fn parse(line: &[u8]) -> Option<Stat> {
    let name_end = line.iter().rposition(|b| *b == b')')?;
    let rest = std::str::from_utf8(line.get(name_end + 1..)?).ok()?;
    let mut fields = rest.split_ascii_whitespace();
    let state = *fields.next()?.as_bytes().first()?;
    let start_ticks = fields.nth(18)?.parse().ok()?;
    Some(Stat { state, start_ticks })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn awkward_names_are_parsed() {
        let line = b"42 (a) b (c)) S 1 42 42 0 -1 4194560 100 0 0 0 5 3 0 0 20 0 1 0 98765 1000 2 18446744073709551615";
        let stat = parse(line).unwrap();
        assert_eq!((stat.state, stat.start_ticks), (b'S', 98765));
        assert!(parse(b"").is_none() && parse(b"1 (x").is_none() && parse(b"1 (x) S 1 2").is_none());
    }

    #[test]
    fn this_process_is_alive_and_a_later_namesake_is_not() {
        let me = this_process();
        assert!(me.start_ticks > 0);
        assert!(is_alive(me));
        assert!(!is_alive(ProcessId { start_ticks: me.start_ticks + 1, ..me }));
    }

    #[test]
    fn a_zombie_is_not_alive() {
        let mut child = std::process::Command::new("/bin/true").spawn().unwrap();
        let start_ticks = stat(child.id()).unwrap().start_ticks;
        let id = ProcessId { pid: child.id(), start_ticks };
        // It ends soon, but is not waited for yet.
        let dead = (0..1000).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(5));
            !is_alive(id)
        });
        child.wait().unwrap();
        assert!(dead);
    }
}
