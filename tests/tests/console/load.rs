//! What the console costs the loop, and how a difference is told from chance.

use super::*;

/// Time the console's process has had of the processors. [s]
fn processor_s(pid: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    let after = stat.rsplit(") ").next().unwrap_or_default();
    let ticks: f64 = after.split(' ').skip(11).take(2).filter_map(|n| n.parse::<f64>().ok()).sum();
    ticks / 100.0
}

fn at(sorted: &[f64], share: f64) -> f64 {
    sorted.get((share * (sorted.len() as f64 - 1.0)).round() as usize).copied().unwrap_or(f64::NAN)
}

/// Whether spells with different numbers of clients differ by more than chance: rounds hold one spell of each kind, in
/// any order if the clients do not matter. The share of random orders within rounds whose means lie at least as far
/// apart (permutation test with blocks).
fn by_chance(rounds: &[[f64; 3]]) -> f64 {
    let spread = |rounds: &[[f64; 3]]| {
        let mean = |k: usize| rounds.iter().map(|r| r[k]).sum::<f64>() / rounds.len() as f64;
        let means = [mean(0), mean(1), mean(2)];
        means.iter().copied().fold(f64::MIN, f64::max) - means.iter().copied().fold(f64::MAX, f64::min)
    };
    let (found, mut dice, mut further) = (spread(rounds), Dice(7), 0);
    const ORDERS: usize = 20_000;
    for _ in 0..ORDERS {
        let mut other = rounds.to_vec();
        for round in &mut other {
            round.swap(2, dice.roll(3));
            round.swap(1, dice.roll(2));
        }
        further += usize::from(spread(&other) >= found);
    }
    further as f64 / ORDERS as f64
}

#[test]
fn a_difference_is_told_from_chance() {
    let mut dice = Dice(3);
    let mut round = |step: f64| {
        let mut noise = || dice.roll(1000) as f64 / 1000.0;
        let whole = 10.0 * noise();
        [whole + noise(), whole + noise(), whole + noise() + step]
    };
    let alike: Vec<_> = (0..8).map(|_| round(0.0)).collect();
    let apart: Vec<_> = (0..8).map(|_| round(1.0)).collect();
    assert!(by_chance(&alike) > 0.05, "{}", by_chance(&alike));
    assert!(by_chance(&apart) < 0.01, "{}", by_chance(&apart));
}

/// What the console costs the loop: spells with 0, 1 and 5 clients in one run, in turns and in changing order, so that
/// the machine's other work falls on all alike. Prints; judges nothing. `scripts/console-load` runs it.
#[test]
#[ignore = "takes minutes and only prints: scripts/console-load"]
fn load_on_the_loop_with_0_1_and_5_clients() {
    let _alone = alone();
    let number = |name: &str, or: usize| std::env::var(name).ok().and_then(|v| v.parse().ok()).unwrap_or(or);
    let (rounds, spell_s) = (number("KINGPIN_ROUNDS", 8), number("KINGPIN_SPELL_S", 5));
    let console = Console::start("load");
    let mut operator = console.operator();
    console.launch(&mut operator, "slalom_120", 3600.0);
    operator
        .ask(&json!({"subscribe": {"traces": [], "latest": [], "rate_hz": 2.0, "points_hz": 1.0}}))
        .unwrap();
    let stop = std::sync::atomic::AtomicBool::new(false);
    let mut spells: Vec<(usize, u64, u64)> = Vec::new();
    let mut cost = [(0.0, 0.0); 3];
    const CLIENTS: [u32; 3] = [0, 1, 5];
    // The newest tick there is: frames that came meanwhile are read first.
    let tick = |operator: &mut Socket| {
        operator.ask(&json!({"runs": {}})).unwrap();
        operator.next_frame().unwrap()["tick"].as_u64().unwrap()
    };
    let mut dice = Dice(11);
    std::thread::scope(|scope| {
        for _ in 0..rounds {
            let mut order = [0, 1, 2];
            order.swap(2, dice.roll(3));
            order.swap(1, dice.roll(2));
            for kind in order {
                stop.store(false, std::sync::atomic::Ordering::Relaxed);
                let threads: Vec<_> = (0..CLIENTS[kind])
                    .map(|_| {
                        scope.spawn(|| {
                            let mut client = console.client();
                            client.ask(&many()).unwrap();
                            while !stop.load(std::sync::atomic::Ordering::Relaxed) {
                                client.next_frame().unwrap();
                            }
                        })
                    })
                    .collect();
                std::thread::sleep(Duration::from_millis(300));
                let (begin, before) = (Instant::now(), processor_s(console.child.id()));
                let from = tick(&mut operator);
                std::thread::sleep(Duration::from_secs(spell_s as u64));
                spells.push((kind, from, tick(&mut operator)));
                cost[kind].0 += processor_s(console.child.id()) - before;
                cost[kind].1 += begin.elapsed().as_secs_f64();
                stop.store(true, std::sync::atomic::Ordering::Relaxed);
                threads.into_iter().for_each(|thread| thread.join().unwrap());
            }
        }
    });
    console.end_run(&mut operator);
    let runs = console.folder.path().join("runs");
    let run =
        std::fs::read_dir(&runs).unwrap().map(|e| e.unwrap().path()).find(|p| p.join("log.mcap").exists());
    let log = record::LogReader::open(&run.unwrap()).unwrap();
    println!(
        "{rounds} rounds of spells of {spell_s} s with 0, 1 and 5 clients of 10 signals at 20 Hz, in changing order"
    );
    println!(
        "{:<34} {:>7} {:>8} {:>9} {:>9} {:>9} {:>22}",
        "[us]", "clients", "ticks", "p50", "p99.9", "max", "console's processor"
    );
    for (label, region, name) in [
        ("rig: wake-up after its tick", "rig_timing", "wake_lateness_s"),
        ("vehicle: wake-up after its tick", "vehicle_timing", "wake_lateness_s"),
        ("multibody: done after the tick", "multibody_timing", "done_s"),
    ] {
        let ticks = &log.region(region).unwrap().ticks;
        let values = log.column(region, name).unwrap();
        let within = |(_, from, to): &(usize, u64, u64)| {
            let mut found: Vec<f64> = ticks
                .iter()
                .zip(&values)
                .filter(|(t, v)| (from..to).contains(t) && v.is_finite())
                .map(|(_, v)| 1e6 * v)
                .collect();
            found.sort_by(f64::total_cmp);
            found
        };
        let each: Vec<Vec<f64>> = spells.iter().map(within).collect();
        for (kind, clients) in CLIENTS.into_iter().enumerate() {
            let mut all: Vec<f64> =
                spells.iter().zip(&each).filter(|(s, _)| s.0 == kind).flat_map(|(_, v)| v.clone()).collect();
            all.sort_by(f64::total_cmp);
            println!(
                "{label:<34} {clients:>7} {:>8} {:>9.0} {:>9.0} {:>9.0} {:>20.1} %",
                all.len(),
                at(&all, 0.5),
                at(&all, 0.999),
                at(&all, 1.0),
                100.0 * cost[kind].0 / cost[kind].1
            );
        }
        for (what, share) in [("p50", 0.5), ("p99", 0.99), ("p99.9", 0.999)] {
            let rounds: Vec<[f64; 3]> = (0..rounds)
                .map(|round| {
                    [0, 1, 2].map(|kind| {
                        let here = 3 * round..3 * round + 3;
                        let place = here.clone().find(|&i| spells[i].0 == kind).unwrap();
                        at(&each[place], share).ln()
                    })
                })
                .collect();
            println!("{:<34} {what}: {:.2} of all orders lie as far apart by chance", "", by_chance(&rounds));
        }
    }
}
