//! Runs scenarios in this thread and prints tracking figures; with DUMP=file.csv also the signals.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]
use metrics::tracking::tracking;

fn main() {
    let mut scenarios = Vec::new();
    let mut sets = Vec::new();
    for a in std::env::args().skip(1) {
        if a.contains('=') { sets.push(a) } else { scenarios.push(a) }
    }
    for name in &scenarios {
        let resolved = match config::ResolvedBench::load(name, &sets) {
            Ok(r) => r,
            Err(e) => {
                println!("{e}");
                return;
            }
        };
        let start = std::time::Instant::now();
        let t = assembly::closed_loop::trace(&resolved).expect("run");
        let wall = start.elapsed().as_secs_f64();
        let mut line = format!("{name:28}");
        for side in 0..2 {
            match tracking(&t.force_command_n[side], &t.force_reading_n[side], &t.active, t.period_s) {
                Ok(r) => {
                    line += &format!(
                        " | max {:6.2} rms {:5.2} % of {:5.0} N rms {:4.1} N lag {:5.2}",
                        r.error_max_percent,
                        r.error_rms_percent,
                        r.amplitude,
                        r.error_rms,
                        1e3 * r.lag_s
                    )
                }
                Err(e) => line += &format!(" | {e}"),
            }
        }
        let h = tracking(&t.height_command_m[0], &t.height_reading_m[0], &t.active, t.period_s);
        let e: Vec<f64> = (0..t.time_s.len())
            .filter(|&i| t.active[i])
            .map(|i| t.angle_command_rad[i] - t.angle_reading_rad[i])
            .filter(|v| v.is_finite())
            .collect();
        println!(
            "{line} | h {:5.2} ms | angle max {:.4} rms {:.5} rad | E {:.2} J est {:.2} ms{} | {:.1} s",
            h.map_or(f64::NAN, |h| 1e3 * h.lag_s),
            metrics::statistics::peak(&e),
            metrics::statistics::rms(&e),
            t.energy_j.last().unwrap(),
            1e3 * t.loop_delay_s.iter().rev().find(|v| v.is_finite()).copied().unwrap_or(f64::NAN),
            t.trip.map_or(String::new(), |t| format!(" TRIP {t:?}")),
            wall
        );
        if let Ok(file) = std::env::var("DUMP") {
            let mut text =
                String::from("t,active,fcl,frl,ftl,fcr,frr,ftr,ac,ar,tq,tqc,rack,rackt,vl,vr,hc,hr,ay\n");
            for i in 0..t.time_s.len() {
                text += &format!(
                    "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n",
                    t.time_s[i],
                    u8::from(t.active[i]),
                    t.force_command_n[0][i],
                    t.force_reading_n[0][i],
                    t.force_true_n[0][i],
                    t.force_command_n[1][i],
                    t.force_reading_n[1][i],
                    t.force_true_n[1][i],
                    t.angle_command_rad[i],
                    t.angle_reading_rad[i],
                    t.torque_n_m[i],
                    t.torque_command_n_m[i],
                    t.rack_m[i],
                    t.rack_true_m[i],
                    t.valve[0][i],
                    t.valve[1][i],
                    t.height_command_m[0][i],
                    t.height_reading_m[0][i],
                    t.lateral_m_s2[i]
                );
            }
            std::fs::write(file, text).unwrap();
        }
    }
}
