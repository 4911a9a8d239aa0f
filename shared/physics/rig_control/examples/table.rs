//! Prints the force-tracking table: published figures beside ours, nominal, varied, and part by part.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]
use rig_control::study::{MANOEUVRES, Study};

/// Switches one compensation off.
type Change = fn(&mut config::rig::Switches);

fn main() {
    let (rig, unit) = load();
    let nominal = Study::new(&rig, &unit);
    let show = |label: &str, study: &Study| {
        println!("{label}");
        for m in &MANOEUVRES {
            let r = study.run(m).expect("study");
            let f = r.figures();
            let p = m.published;
            let s = &r.sides;
            println!(
                "  {:32} max {:5.2} rms {:5.2} | max {:5.2} rms {:5.2}  ratio {:4.2} {:4.2} {:4.2} {:4.2}  true rms {:4.2} {:4.2} amp {:6.0} {:6.0} lag {:5.2} {:5.2} est {:5.2} h {:5.2} ms steer {:.4} E {:6.3} W sat {}",
                m.name,
                f[0],
                f[1],
                f[2],
                f[3],
                f[0] / p[0],
                f[1] / p[1],
                f[2] / p[2],
                f[3] / p[3],
                s[0].true_rms_percent,
                s[1].true_rms_percent,
                s[0].amplitude_n,
                s[1].amplitude_n,
                1e3 * s[0].force_lag_s,
                1e3 * s[1].force_lag_s,
                1e3 * s[0].estimated_lag_s,
                1e3 * s[0].height_lag_s,
                r.steer_error_rad,
                r.energy_w,
                r.saturated_ticks
            );
        }
    };
    show("nominal", &nominal);
    if std::env::args().len() > 1 {
        return;
    }
    for (label, g, k, d) in [
        ("gain +20 %", 1.2, 1.0, 1.0),
        ("gain -20 %", 0.8, 1.0, 1.0),
        ("stiffness +20 %", 1.0, 1.2, 1.0),
        ("stiffness -20 %", 1.0, 0.8, 1.0),
        ("delay +20 %", 1.0, 1.0, 1.2),
        ("delay -20 %", 1.0, 1.0, 0.8),
        ("all +20 %", 1.2, 1.2, 1.2),
        ("all -20 %", 0.8, 0.8, 0.8),
    ] {
        show(label, &nominal.clone().with_plant(g, k, d));
    }
    let off: [(&str, Change); 7] = [
        ("without force conversion", |s| s.force_conversion = false),
        ("without rack feed-forward", |s| s.rack_feed_forward = false),
        ("without inertia feed-forward", |s| s.inertia_feed_forward = false),
        ("without delay compensation", |s| s.delay_compensation = false),
        ("without force-rate feed-forward", |s| s.force_rate_feed_forward = false),
        ("without pressure compensation", |s| s.pressure_compensation = false),
        ("without gain adaptation", |s| s.gain_adaptation = false),
    ];
    for (label, change) in off {
        let mut study = nominal.clone();
        change(&mut study.switches);
        show(label, &study);
    }
}

fn load() -> (config::rig::Rig, config::unit::SteeringUnit) {
    let base = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../schemas/");
    let read = |name: &str| std::fs::read_to_string(format!("{base}{name}")).expect("file");
    let mut rig: toml::Value = toml::from_str(&read("rigs/virtual.toml")).expect("rig");
    // SET="control.steer.bandwidth_rad_s=80 control.force.bandwidth_rad_s=100"
    for pair in std::env::var("SET").unwrap_or_default().split_whitespace() {
        let (key, value) = pair.split_once('=').expect("key=value");
        let mut at = &mut rig;
        for part in key.split('.') {
            at = at.get_mut(part).expect("known key");
        }
        *at = match value.parse() {
            Ok(number) => toml::Value::Float(number),
            Err(_) => toml::Value::Boolean(value == "true"),
        };
    }
    (rig.try_into().expect("rig"), toml::from_str(&read("units/column_eps.toml")).expect("unit"))
}
