//! `doctor`: what this host lacks for hard real time, what to do about it, and what can be expected of it.
//!
//! Facts are read from `/proc` and `/sys`; the last word is a short measurement of timer wake-ups. What a host
//! does not tell is reported as unknown, not as fine.

use super::bench::timer::{Timer, measure};
use crate::args::DoctorArgs;
use crate::exit::Exit;
use crate::output;
use serde::Serialize;
use serde_json::json;
use std::path::Path;

/// How a finding bears on real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As it should be.
    Good,
    /// Costs jitter.
    Limits,
    /// Stands against hard real time.
    Lacks,
    /// The host does not tell.
    Unknown,
}

/// One thing looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What.
    pub item: &'static str,
    /// What was found.
    pub found: String,
    /// How it bears on real time.
    pub verdict: Verdict,
    /// What to do, empty where nothing needs to be done.
    pub remedy: String,
}

fn finding(item: &'static str, found: impl Into<String>, verdict: Verdict, remedy: &str) -> Finding {
    let remedy = if verdict == Verdict::Good { "" } else { remedy };
    Finding { item, found: found.into(), verdict, remedy: remedy.to_owned() }
}

/// A host as its files describe it, below a root (`/`; another one in tests).
pub struct Host<'a>(pub &'a Path);

impl Host<'_> {
    fn read(&self, path: &str) -> Option<String> {
        std::fs::read_to_string(self.0.join(path)).ok().map(|text| text.trim().to_owned())
    }

    /// All findings from files.
    pub fn findings(&self) -> Vec<Finding> {
        vec![
            self.preemption(),
            self.isolation(),
            self.tickless(),
            self.interrupts(),
            self.governor(),
            self.idle_states(),
            self.throttling(),
            self.clock_source(),
            self.virtual_machine(),
            self.threads(),
            self.swap(),
            self.huge_pages(),
        ]
    }

    fn preemption(&self) -> Finding {
        const DO: &str =
            "boot a kernel with PREEMPT_RT (in mainline since 6.12), or at least with preempt=full";
        let version = self.read("proc/version").unwrap_or_default();
        let command_line = self.read("proc/cmdline").unwrap_or_default();
        let realtime =
            self.read("sys/kernel/realtime").as_deref() == Some("1") || version.contains("PREEMPT_RT");
        let mode = self.read("sys/kernel/debug/sched/preempt").and_then(|modes| {
            // The mode in force stands in parentheses.
            Some(modes.split_once('(')?.1.split_once(')')?.0.to_owned())
        });
        let asked = command_line.split(' ').find_map(|w| w.strip_prefix("preempt=")).map(str::to_owned);
        let (found, verdict) = if realtime {
            ("PREEMPT_RT".to_owned(), Verdict::Good)
        } else if let Some(mode) = mode.or(asked) {
            let verdict = if mode == "full" { Verdict::Limits } else { Verdict::Lacks };
            (format!("preempt={mode}, not PREEMPT_RT"), verdict)
        } else if version.contains("PREEMPT_DYNAMIC") {
            ("PREEMPT_DYNAMIC, mode not told".to_owned(), Verdict::Lacks)
        } else if version.contains("PREEMPT") {
            ("PREEMPT".to_owned(), Verdict::Limits)
        } else {
            ("no preemption".to_owned(), Verdict::Lacks)
        };
        finding("kernel preemption", found, verdict, DO)
    }

    fn isolation(&self) -> Finding {
        let cores = self.read("sys/devices/system/cpu/isolated");
        let (found, verdict) = match cores.as_deref() {
            None => ("not told".to_owned(), Verdict::Unknown),
            Some("") => ("no core is kept free of other work".to_owned(), Verdict::Lacks),
            Some(cores) => (format!("cores {cores}"), Verdict::Good),
        };
        finding(
            "isolated cores",
            found,
            verdict,
            "boot with isolcpus=managed_irq,domain,LIST and give those cores to the services in [realtime] cores",
        )
    }

    fn tickless(&self) -> Finding {
        let cores = self.read("sys/devices/system/cpu/nohz_full").unwrap_or_default();
        let none = cores.is_empty() || cores == "(null)";
        let verdict = if none { Verdict::Limits } else { Verdict::Good };
        let found = if none { "none".to_owned() } else { format!("cores {cores}") };
        finding(
            "tickless cores",
            found,
            verdict,
            "boot with nohz_full=LIST rcu_nocbs=LIST for the isolated cores",
        )
    }

    fn interrupts(&self) -> Finding {
        let isolated = self.read("sys/devices/system/cpu/isolated").filter(|c| !c.is_empty());
        let balance = self.read("proc/irq/default_smp_affinity");
        match (isolated, balance) {
            (Some(_), Some(mask)) => finding(
                "interrupts",
                format!("default affinity {mask}"),
                Verdict::Limits,
                "keep device interrupts off the isolated cores (irqaffinity=, /proc/irq/*/smp_affinity)",
            ),
            (None, _) => finding(
                "interrupts",
                "on all cores",
                Verdict::Limits,
                "isolate cores first, then boot with irqaffinity= for the others",
            ),
            (_, None) => finding("interrupts", "not told", Verdict::Unknown, ""),
        }
    }

    fn governor(&self) -> Finding {
        let found = self.read("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor");
        let (found, verdict) = match found {
            Some(governor) if governor == "performance" => (governor, Verdict::Good),
            Some(governor) => (governor, Verdict::Limits),
            None => {
                ("no frequency scaling visible (fixed, or the hypervisor's)".to_owned(), Verdict::Unknown)
            }
        };
        finding("frequency governor", found, verdict, "cpupower frequency-set -g performance")
    }

    fn idle_states(&self) -> Finding {
        let mut deepest: Option<(u64, String)> = None;
        let mut any = false;
        for state in 0..16 {
            let at =
                |what: &str| self.read(&format!("sys/devices/system/cpu/cpu0/cpuidle/state{state}/{what}"));
            let (Some(name), Some(latency)) = (at("name"), at("latency").and_then(|l| l.parse::<u64>().ok()))
            else {
                break;
            };
            any = true;
            let off = at("disable").as_deref() == Some("1");
            if !off && deepest.as_ref().is_none_or(|(l, _)| latency > *l) {
                deepest = Some((latency, name));
            }
        }
        let (found, verdict) = match deepest {
            Some((latency, name)) if latency > 20 => {
                (format!("{name} allowed, {latency} us to leave"), Verdict::Limits)
            }
            Some((latency, name)) => (format!("{name} at most, {latency} us to leave"), Verdict::Good),
            None if any => ("none allowed".to_owned(), Verdict::Good),
            None => ("not visible (the hypervisor's)".to_owned(), Verdict::Unknown),
        };
        finding(
            "idle states",
            found,
            verdict,
            "hold /dev/cpu_dma_latency open with 0 written to it, or boot with processor.max_cstate=1 idle=poll",
        )
    }

    /// The kernel's version, as far as it matters.
    fn kernel(&self) -> Option<(u32, u32)> {
        let version = self.read("proc/version")?;
        let mut numbers = version.split_ascii_whitespace().nth(2)?.split(['.', '-']);
        Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
    }

    /// Up to Linux 6.11 real-time threads together get a share of each second. From 6.12 on (but for kernels with
    /// RT_GROUP_SCHED) that setting only bounds what may be asked for; a deadline server on each core sees that ordinary
    /// tasks get theirs [commit 5f6bd380c7bd, sched/rt: Remove default bandwidth control].
    fn throttling(&self) -> Finding {
        if self.kernel() >= Some((6, 12)) {
            return self.fair_server();
        }
        let value =
            |name: &str| self.read(&format!("proc/sys/kernel/{name}")).and_then(|t| t.parse::<i64>().ok());
        let (found, verdict) = match (value("sched_rt_runtime_us"), value("sched_rt_period_us")) {
            (Some(-1), _) => ("off".to_owned(), Verdict::Good),
            (Some(runtime), Some(period)) => {
                (format!("real-time threads get {runtime} of {period} us"), Verdict::Limits)
            }
            _ => ("not told".to_owned(), Verdict::Unknown),
        };
        finding(
            "real-time throttling",
            found,
            verdict,
            "harmless while the services sleep most of the time, as they do; for spinning services sysctl kernel.sched_rt_runtime_us=-1",
        )
    }

    fn fair_server(&self) -> Finding {
        let servers = "sys/kernel/debug/sched/fair_server";
        let entries = std::fs::read_dir(self.0.join(servers)).into_iter().flatten().flatten();
        let cores: Vec<_> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        let runtime_ns = |core: &String| self.read(&format!("{servers}/{core}/runtime"))?.parse::<u64>().ok();
        let runtimes: Option<Vec<u64>> = cores.iter().map(runtime_ns).collect();
        let on = runtimes.map(|all| (all.iter().filter(|ns| **ns > 0).count(), all.iter().max().copied()));
        let (found, verdict) = match on {
            Some((_, None)) | None => {
                ("the kernel's fair servers are not visible".to_owned(), Verdict::Unknown)
            }
            Some((0, _)) => ("no core keeps time for ordinary tasks".to_owned(), Verdict::Good),
            Some((cores, Some(most_ns))) => (
                format!(
                    "{cores} cores keep up to {} ms of each second for ordinary tasks",
                    most_ns / 1_000_000
                ),
                Verdict::Limits,
            ),
        };
        finding(
            "real-time throttling",
            found,
            verdict,
            "for the cores of the services: echo 0 > /sys/kernel/debug/sched/fair_server/cpuN/runtime (sched_rt_runtime_us \
             no longer matters)",
        )
    }

    fn clock_source(&self) -> Finding {
        let source = self.read("sys/devices/system/clocksource/clocksource0/current_clocksource");
        let (found, verdict) = match source {
            Some(source) if source == "tsc" => (source, Verdict::Good),
            Some(source) if source.contains("kvm") || source.contains("pvclock") => (source, Verdict::Limits),
            Some(source) => (format!("{source}: reading the clock is a slow access"), Verdict::Lacks),
            None => ("not told".to_owned(), Verdict::Unknown),
        };
        finding(
            "clock source",
            found,
            verdict,
            "boot with clocksource=tsc tsc=reliable if the processor's TSC is invariant",
        )
    }

    fn virtual_machine(&self) -> Finding {
        let cpu = self.read("proc/cpuinfo").unwrap_or_default();
        let flags = cpu.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
        let guest = flags.split(' ').any(|flag| flag == "hypervisor");
        let stolen = self.read("proc/stat").and_then(|text| {
            let fields: Vec<f64> = text
                .lines()
                .next()?
                .split_ascii_whitespace()
                .skip(1)
                .filter_map(|f| f.parse().ok())
                .collect();
            let all: f64 = fields.iter().take(8).sum();
            fields.get(7).map(|steal| 100.0 * steal / all.max(1.0))
        });
        if guest {
            let stolen = stolen.map_or(String::new(), |s| format!(", {s:.2} % of its time stolen so far"));
            finding(
                "machine",
                format!("a virtual one{stolen}"),
                Verdict::Lacks,
                "run on the metal: a hypervisor may stop the whole machine for milliseconds",
            )
        } else {
            finding("machine", "the metal", Verdict::Good, "")
        }
    }

    fn threads(&self) -> Finding {
        match self.read("sys/devices/system/cpu/smt/active").as_deref() {
            Some("0") => finding("hyper-threading", "off", Verdict::Good, ""),
            Some(_) => finding(
                "hyper-threading",
                "on: two services may share a core's pipelines",
                Verdict::Limits,
                "boot with nosmt, or leave the sibling of each real-time core idle",
            ),
            None => finding("hyper-threading", "not told", Verdict::Unknown, ""),
        }
    }

    fn swap(&self) -> Finding {
        let used = self.read("proc/swaps").map(|text| text.lines().count().saturating_sub(1));
        match used {
            Some(0) => finding("swap", "none", Verdict::Good, ""),
            Some(count) => finding(
                "swap",
                format!("{count} areas"),
                Verdict::Limits,
                "allow memlock, so that the services lock their memory, or swapoff -a",
            ),
            None => finding("swap", "not told", Verdict::Unknown, ""),
        }
    }

    fn huge_pages(&self) -> Finding {
        let mode = self.read("sys/kernel/mm/transparent_hugepage/enabled").unwrap_or_default();
        let chosen =
            mode.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map(|(m, _)| m.to_owned());
        match chosen.as_deref() {
            Some("always") => finding(
                "transparent huge pages",
                "always: compaction may stall a core",
                Verdict::Limits,
                "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled",
            ),
            Some(mode) => finding("transparent huge pages", mode, Verdict::Good, ""),
            None => finding("transparent huge pages", "not told", Verdict::Unknown, ""),
        }
    }
}

/// What this process may do, which files do not tell.
fn permissions() -> Vec<Finding> {
    use rustix::process::{Resource, getrlimit};
    let refused = std::thread::spawn(|| {
        let wish = runtime::realtime::Wish { core: None, priority: Some(60), lock_memory: false };
        runtime::realtime::apply(&wish)
    })
    .join()
    .unwrap_or_default();
    let priority = match refused.first() {
        None => finding("real-time priority", "SCHED_FIFO 60 granted", Verdict::Good, ""),
        Some(_) => finding(
            "real-time priority",
            "refused",
            Verdict::Lacks,
            "add `@realtime - rtprio 95` to /etc/security/limits.d/realtime.conf and yourself to that group",
        ),
    };
    // The table of a bench at 1 kHz and the services' own memory, rounded up.
    const NEEDED_MIB: u64 = 256;
    let lock = getrlimit(Resource::Memlock).current;
    let root = rustix::process::geteuid().is_root();
    let memory = match lock {
        _ if root => finding("locked memory", "root: without limit", Verdict::Good, ""),
        None => finding("locked memory", "without limit", Verdict::Good, ""),
        Some(bytes) => {
            let verdict = if bytes >= NEEDED_MIB << 20 { Verdict::Good } else { Verdict::Limits };
            finding(
                "locked memory",
                format!("{} MiB", bytes >> 20),
                verdict,
                "add `@realtime - memlock unlimited` to /etc/security/limits.d/realtime.conf",
            )
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let verdict = if cores >= 6 { Verdict::Good } else { Verdict::Limits };
    let number = finding(
        "cores",
        format!("{cores}"),
        verdict,
        "six: one each for rig, vehicle, multibody, two for the rest, one spare; with fewer, services share cores",
    );
    vec![priority, memory, number]
}

/// What can be expected of wake-ups like these.
fn expectation(p999_us: f64, max_us: f64, lacks: usize) -> String {
    let grade = if lacks == 0 && max_us < 100.0 {
        "hard real time at 1 kHz and 4 kHz is plausible; confirm with `kingpin bench jitter --load` for an hour"
    } else if p999_us < 150.0 && max_us < 500.0 {
        "1 kHz will hold with rare late commands, each counted and held; 4 kHz will lose some"
    } else if p999_us < 500.0 {
        "1 kHz runs with some late commands in ten thousand; the rig may hold now and then when the host stalls it"
    } else {
        "not for hardware: expect late commands every second and holding now and then; lockstep is not affected"
    };
    format!("p99.9 {p999_us:.0} us, max {max_us:.0} us in this measurement: {grade}")
}

/// `kingpin doctor`.
pub fn doctor(args: &DoctorArgs) -> Exit {
    let mut findings = Host(Path::new("/")).findings();
    findings.extend(permissions());
    let count = (args.seconds * 1000.0).round().max(100.0) as usize;
    let timer = Timer { core: None, priority: Some(60), period_ns: 1_000_000, spin_ns: 0 };
    let measured = measure(timer, count);
    let us = |q: f64| measured.quantile_ns(q) * 1e-3;
    let lacks = findings.iter().filter(|f| f.verdict == Verdict::Lacks).count();
    let expected = expectation(us(0.999), us(1.0), lacks);
    if args.json {
        output::json(&json!({
            "findings": findings,
            "wake_up_us": {"samples": count, "p50": us(0.5), "p99": us(0.99), "p99_9": us(0.999), "max": us(1.0)},
            "lacks": lacks,
            "expectation": expected,
        }));
        return Exit::Done;
    }
    let mark = |v: Verdict| match v {
        Verdict::Good => "good",
        Verdict::Limits => "limits",
        Verdict::Lacks => "LACKS",
        Verdict::Unknown => "?",
    };
    let rows: Vec<_> = findings
        .iter()
        .map(|f| vec![mark(f.verdict).to_owned(), f.item.to_owned(), f.found.clone()])
        .collect();
    output::line(output::columns(&rows).trim_end());
    output::line(format!(
        "\ntimer wake-ups at 1 kHz for {:.1} s: p50 {:.1} us, p99 {:.1} us, p99.9 {:.1} us, max {:.1} us",
        count as f64 * 1e-3,
        us(0.5),
        us(0.99),
        us(0.999),
        us(1.0)
    ));
    let todo: Vec<_> = findings.iter().filter(|f| !f.remedy.is_empty()).collect();
    if !todo.is_empty() {
        output::line("\nTo do, in this order:");
        for verdict in [Verdict::Lacks, Verdict::Limits] {
            for f in todo.iter().filter(|f| f.verdict == verdict) {
                output::line(format!("  {}: {}", f.item, f.remedy));
            }
        }
    }
    output::line(format!("\nWhat to expect: {expected}"));
    Exit::Done
}

#[cfg(test)]
mod tests {
    use super::*;

    fn host(files: &[(&str, &str)]) -> Vec<Finding> {
        let root =
            std::env::temp_dir().join(format!("kingpin-doctor-{}-{}", std::process::id(), files.len()));
        for (path, text) in files {
            let path = root.join(path);
            std::fs::create_dir_all(path.parent().unwrap_or(&root)).unwrap_or(());
            std::fs::write(path, text).unwrap_or(());
        }
        let findings = Host(&root).findings();
        let _ = std::fs::remove_dir_all(&root);
        findings
    }

    fn verdict(findings: &[Finding], item: &str) -> Option<Verdict> {
        findings.iter().find(|f| f.item == item).map(|f| f.verdict)
    }

    #[test]
    fn a_tuned_host_is_good_and_an_untold_one_is_not() {
        let tuned = host(&[
            ("proc/version", "Linux version 6.12.1 #1 SMP PREEMPT_RT"),
            ("sys/devices/system/cpu/isolated", "2-5\n"),
            ("sys/devices/system/cpu/nohz_full", "2-5\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
            ("sys/kernel/debug/sched/fair_server/cpu0/runtime", "0\n"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
            ("sys/devices/system/cpu/cpu0/cpuidle/state0/name", "POLL\n"),
            ("sys/devices/system/cpu/cpu0/cpuidle/state0/latency", "0\n"),
            ("sys/devices/system/cpu/smt/active", "0\n"),
            ("proc/cpuinfo", "flags\t\t: fpu tsc\n"),
        ]);
        for item in [
            "kernel preemption",
            "isolated cores",
            "tickless cores",
            "frequency governor",
            "idle states",
            "real-time throttling",
            "clock source",
            "hyper-threading",
            "machine",
        ] {
            assert_eq!(verdict(&tuned, item), Some(Verdict::Good), "{item}");
        }
        let dark = host(&[("proc/version", "Linux version 6.1.0 #1 SMP PREEMPT_DYNAMIC")]);
        assert_eq!(verdict(&dark, "kernel preemption"), Some(Verdict::Lacks));
        for item in ["isolated cores", "frequency governor", "clock source", "real-time throttling"] {
            assert_eq!(verdict(&dark, item), Some(Verdict::Unknown), "{item}");
        }
        let older =
            [("proc/version", "Linux version 6.1.0-35-rt"), ("proc/sys/kernel/sched_rt_runtime_us", "-1")];
        assert_eq!(verdict(&host(&older), "real-time throttling"), Some(Verdict::Good));
        let newer = [
            ("proc/version", "Linux version 6.18.44-1"),
            ("proc/sys/kernel/sched_rt_runtime_us", "-1"),
            ("sys/kernel/debug/sched/fair_server/cpu0/runtime", "0"),
            ("sys/kernel/debug/sched/fair_server/cpu1/runtime", "50000000"),
        ];
        let found = host(&newer);
        assert_eq!(verdict(&found, "real-time throttling"), Some(Verdict::Limits));
        assert!(found.iter().any(|f| f.found.starts_with("1 cores keep up to 50 ms")));
        assert_eq!(verdict(&host(&newer[..2]), "real-time throttling"), Some(Verdict::Unknown));
        let guest = host(&[
            ("proc/cpuinfo", "flags\t\t: fpu hypervisor tsc\n"),
            ("proc/stat", "cpu  80 0 10 5 0 0 0 5 0 0\n"),
            ("sys/kernel/debug/sched/preempt", "none (voluntary) full\n"),
        ]);
        assert_eq!(verdict(&guest, "machine"), Some(Verdict::Lacks));
        assert!(guest.iter().any(|f| f.found.contains("5.00 %")));
        assert!(guest.iter().any(|f| f.found.contains("preempt=voluntary")));
    }
}
