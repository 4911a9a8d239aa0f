//! Dumps a study's signals as CSV: `dump N` for manoeuvre N.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]
use rig_control::study::{MANOEUVRES, Study};

fn main() {
    let (rig, unit) = load();
    let which: usize = std::env::args().nth(1).and_then(|a| a.parse().ok()).unwrap_or(0);
    let t = Study::new(&rig, &unit).trace(&MANOEUVRES[which]).expect("study");
    println!("t,c0,r0,t0,c1,r1,t1,steer,h,hr");
    for i in 0..t.time_s.len() {
        let [a, b] = &t.sides;
        println!(
            "{:.3},{:.2},{:.2},{:.2},{:.2},{:.2},{:.2},{:.6},{:.6},{:.6}",
            t.time_s[i],
            a.command_n[i],
            a.reading_n[i],
            a.true_n[i],
            b.command_n[i],
            b.reading_n[i],
            b.true_n[i],
            t.steer_error_rad[i],
            a.height_command_m[i],
            a.height_reading_m[i]
        );
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
