//! Against other people's cars: the CommonRoad multi-body model on its three parameter sets (spec 3.3, Independent
//! models), driven as `kingpin vehicle simulate` drives: the shipped car file, steer angle and speed from a table.
//!
//! Lateral acceleration, yaw rate, roll: rms of the difference over the peak of the reference; wheel loads: rms over the
//! static load. Up to the first moment above 0.6 g.
//!
//! What their model leaves out or does in its own way stands in the cars' section `peer_model`;
//! `each_difference_has_a_name` switches each off in turn and shows what it is worth.

use crate::support::*;
use config::car::Car;
use tyre::Tyre;
use vehicle::{Vehicle, VehicleInput, simulate_csv};

pub struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    pub fn read(text: &str) -> Self {
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|c| c.parse().unwrap_or(f64::NAN)).collect()).collect();
        Self { names, rows }
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        let at = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows.iter().map(|r| r[at]).collect()
    }
}

/// Differences of a run from a reference.
#[derive(Debug, Clone, Copy)]
pub struct Errors {
    /// Lateral acceleration, yaw rate, roll: rms over peak; wheel loads: rms over static load.
    pub rms: [f64; 4],
    /// Where the comparison ends. [s]
    pub seconds: f64,
}

/// Limits of a comparison: from a time [s] and up to a lateral acceleration [m/s2].
pub fn errors(ours: &Table, theirs: &Table, from_s: f64, limit_m_s2: f64) -> Errors {
    const NAMES: [&str; 3] = ["ay_cg_mps2", "yawrate_rps", "roll_rad"];
    let time = theirs.column("t_s");
    let lateral = theirs.column("ay_cg_mps2");
    let first = time.iter().position(|t| *t >= from_s).unwrap();
    let end = lateral.iter().skip(first).position(|a| a.abs() > limit_m_s2).map_or(time.len(), |k| first + k);
    let mut rms = [0.0; 4];
    let count = (end - first) as f64;
    for (k, name) in NAMES.iter().enumerate() {
        let (a, b) = (ours.column(name), theirs.column(name));
        let peak = b[first..end].iter().fold(0.0f64, |m, x| m.max(x.abs()));
        rms[k] = ((first..end).map(|n| (a[n] - b[n]).powi(2)).sum::<f64>() / count).sqrt() / peak;
    }
    for wheel in ["fl", "fr", "rl", "rr"] {
        let name = format!("Fz_N_{wheel}");
        let (a, b) = (ours.column(&name), theirs.column(&name));
        rms[3] += 0.25 * (first..end).map(|n| ((a[n] - b[n]) / b[0]).powi(2)).sum::<f64>() / count;
    }
    rms[3] = rms[3].sqrt();
    Errors { rms, seconds: time[end - 1] }
}

/// The run of a car by a reference's steer angle and speed, as the command makes it.
pub fn run(car: &mut Vehicle, theirs: &Table, steer: &str) -> Table {
    let (t, steer_by, speed) = (theirs.column("t_s"), theirs.column(steer), theirs.column("v_x_mps"));
    let mut input = format!("t_s,{steer},target_speed_mps\n");
    for n in 0..t.len() {
        input += &format!("{},{},{}\n", t[n], steer_by[n], speed[n]);
    }
    let output = simulate_csv(car, &input, "input").unwrap_or_else(|e| panic!("{e:?}"));
    if let Ok(path) = std::env::var("KINGPIN_PEERS_OUTPUT") {
        std::fs::write(path, &output).unwrap();
    }
    Table::read(&output)
}

fn compare(section: &Car, tyres: &Tyre, name: &str, file: &str, note: &str) -> Option<Errors> {
    let theirs = Table::read(&reference(&format!("vehicle/crmb_{name}_{file}.csv"))?);
    let four = [tyres.clone(), tyres.clone(), tyres.clone(), tyres.clone()];
    let mut car = Vehicle::new(section, maps(section), four, 1e-3).unwrap_or_else(|e| panic!("{e:?}"));
    let ours = run(&mut car, &theirs, "delta_road_rad");
    // The circle starts in a turn: give it time to get there.
    let from = if file.starts_with("circle") { 15.0 } else { 0.0 };
    let e = errors(&ours, &theirs, from, 0.6 * 9.81);
    let p = e.rms.map(|x| 100.0 * x);
    println!(
        "{name:12} {file:22} to {:5.2} s  ay {:5.2} %  yaw rate {:5.2} %  roll {:5.2} %  loads {:5.2} %  {note}",
        e.seconds, p[0], p[1], p[2], p[3]
    );
    Some(e)
}

/// The same from the reference's own state at its first row (it hunts about straight ahead), with the sign of camber in
/// the shifts as abrupt as theirs.
fn compare_from_their_state(
    section: &Car,
    tyres: &Tyre,
    name: &str,
    file: &str,
    to_s: f64,
) -> Option<Errors> {
    let (ours, theirs) = from_their_state(section, tyres, name, file, to_s)?;
    let e = errors(&ours, &theirs, 0.0, 0.6 * 9.81);
    let p = e.rms.map(|x| 100.0 * x);
    println!(
        "{name:12} {file:22} to {:5.2} s  ay {:5.2} %  yaw rate {:5.2} %  roll {:5.2} %  loads {:5.2} %  from their state",
        e.seconds, p[0], p[1], p[2], p[3]
    );
    Some(e)
}

/// Our run from their first state, and their record.
fn from_their_state(
    section: &Car,
    tyres: &Tyre,
    name: &str,
    file: &str,
    to_s: f64,
) -> Option<(Table, Table)> {
    let mut theirs = Table::read(&reference(&format!("vehicle/crmb_{name}_{file}.csv"))?);
    theirs.rows.retain(|r| r[0] <= to_s);
    let mut section = section.clone();
    section.peer_model.as_mut().unwrap().shift_transition_rad = 0.0;
    let four = [tyres.clone(), tyres.clone(), tyres.clone(), tyres.clone()];
    let mut car = Vehicle::new(&section, maps(&section), four, 1e-3).unwrap_or_else(|e| panic!("{e:?}"));
    let (steer, speed) = (theirs.column("delta_road_rad"), theirs.column("v_x_mps"));
    let mut input = VehicleInput { target_speed_m_s: Some(speed[0]), ..VehicleInput::default() };
    car.reset(speed[0], &input);
    let mut state = vec![0.0; car.state_len()];
    car.save_state(&mut state);
    let first = |column: &str| theirs.column(column)[0];
    // Numbers of the state: position 0..3, velocity 3..6, angular 6..9, attitude 9..13, travel 13..17, rate 17..21.
    let roll = first("roll_rad");
    state[4] = first("v_y_mps");
    (state[6], state[8]) = (first("rollrate_rps"), first("yawrate_rps"));
    (state[9], state[10]) = ((0.5 * roll).cos(), (0.5 * roll).sin());
    for (k, wheel) in ["fl", "fr", "rl", "rr"].iter().enumerate() {
        let out = theirs.column(&format!("susp_defl_m_{wheel}"));
        (state[13 + k], state[17 + k]) = (-out[0], -(out[1] - out[0]) / 0.01);
    }
    car.load_state(&state);
    let mut text = "ay_cg_mps2,yawrate_rps,roll_rad,Fz_N_fl,Fz_N_fr,Fz_N_rl,Fz_N_rr\n".to_owned();
    for n in 0..steer.len() {
        let o = car.output();
        let fz = o.wheels.map(|w| w.fz_n);
        text += &format!(
            "{},{},{},{},{},{},{}\n",
            o.lateral_acceleration_cg_m_s2, o.yaw_rate_rad_s, o.roll_rad, fz[0], fz[1], fz[2], fz[3]
        );
        let (from, to) = (steer[n], steer[(n + 1).min(steer.len() - 1)]);
        for k in 1..=10 {
            let now = from + (to - from) * f64::from(k) / 10.0;
            input.rack_displacement_m = Some(car.kinematics()[0].rack_for_mean_steer_m(now));
            input.target_speed_m_s = Some(speed[n]);
            car.step(&input);
        }
    }
    Some((Table::read(&text), theirs))
}

const CARS: [&str; 3] = ["ford_escort", "bmw_320i", "vw_vanagon"];

#[test]
fn commonroad_cars_below_six_tenths_of_g() {
    // Their car hunts about straight ahead (roll by 0.004 rad, 0.2 m/s2: the step of the shifts at zero camber), ours starts
    // at rest: that start is most of what is left, and more than 3 % of a small peak. `started_in_their_own_hunting`
    // shows it. [lateral acceleration, yaw rate, roll, loads]
    let bounds = [
        ("circle_R80", [0.03; 4]),
        ("slalom_0p3Hz_grow_80", [0.03; 4]),
        ("step_steer_80_lin", [0.03, 0.03, 0.045, 0.03]),
        ("step_steer_80_1p2deg", [0.03, 0.03, 0.04, 0.03]),
        ("step_steer_80_high", [0.03, 0.03, 0.05, 0.03]),
        ("swd_0p7Hz_80_1deg", [0.06, 0.03, 0.08, 0.03]),
        ("swd_0p7Hz_80_2deg", [0.03, 0.03, 0.045, 0.03]),
        ("swd_0p7Hz_80_2.4deg", [0.03, 0.03, 0.045, 0.03]),
        ("swd_0p7Hz_80_2.8deg", [0.032, 0.03, 0.05, 0.03]),
    ];
    let mut broken = Vec::new();
    for name in CARS {
        let section = car(name);
        let t = tyre(&section.front.tyre_file);
        let last = if name == "vw_vanagon" { "2.8deg" } else { "2.4deg" };
        for (file, bound) in bounds.into_iter().filter(|(f, _)| !f.ends_with(last)) {
            let Some(e) = compare(&section, &t, name, file, "") else { continue };
            if !e.rms.iter().zip(bound).all(|(f, b)| *f <= b) {
                broken.push(format!("{name} {file}: {:.4?} above {bound:?}", e.rms));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn started_in_their_own_hunting() {
    let mut broken = Vec::new();
    for name in CARS {
        let section = car(name);
        let t = tyre(&section.front.tyre_file);
        let most = if name == "vw_vanagon" { "swd_0p7Hz_80_2.4deg" } else { "swd_0p7Hz_80_2.8deg" };
        // After the small sine with dwell both hunt again, no longer in step: to the end of the steering there.
        for (file, to_s) in [
            ("slalom_0p3Hz_grow_80", 1e3),
            ("step_steer_80_lin", 1e3),
            ("step_steer_80_1p2deg", 1e3),
            ("step_steer_80_high", 1e3),
            ("swd_0p7Hz_80_1deg", 3.0),
            ("swd_0p7Hz_80_2deg", 1e3),
            (most, 1e3),
        ] {
            let Some(e) = compare_from_their_state(&section, &t, name, file, to_s) else { continue };
            if !e.rms.iter().all(|f| *f <= 0.03) {
                broken.push(format!("{name} {file}: {:.4?}", e.rms));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

/// Why the small sine with dwell is compared from their state to the end of its steering only: after it their car hunts again
/// about straight ahead, a limit cycle of the shifts that change sign with camber. Ours does so too, as large and as fast;
/// only its phase, set where the two leave the turn at their own last hundredths of roll, is another. Moved in time by less than
/// half its period, ours is theirs.
#[test]
fn the_hunting_after_a_small_dwell_is_theirs_but_for_its_phase() {
    let file = "swd_0p7Hz_80_1deg";
    for name in CARS {
        let section = car(name);
        let t = tyre(&section.front.tyre_file);
        let Some((ours, theirs)) = from_their_state(&section, &t, name, file, 1e3) else { return };
        let end = theirs.rows.len();
        // Half a second of room for the shift on either side.
        let window = 400..end - 50;
        for (column, what) in [("ay_cg_mps2", "lateral acceleration"), ("roll_rad", "roll")] {
            let (a, b) = (ours.column(column), theirs.column(column));
            let peak = b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            let rms = |f: &dyn Fn(usize) -> f64| {
                let sum: f64 = window.clone().map(|n| f(n).powi(2)).sum();
                (sum / window.len() as f64).sqrt() / peak
            };
            let shifted = |c: &[f64], d: &[f64]| {
                (-50..=50i32)
                    .map(|k| (rms(&|n| c[(n as i32 + k) as usize] - d[n]), 10 * k))
                    .fold((f64::MAX, 0), |m, x| if x.0 < m.0 { x } else { m })
            };
            let (mine, yours, between) = (rms(&|n| a[n]), rms(&|n| b[n]), rms(&|n| a[n] - b[n]));
            let best = shifted(&a, &b);
            println!(
                "{name:12} {what:20} after 4 s, of the peak: theirs {:.2} %, ours {:.2} %, difference {:.2} %; ours moved by {} ms {:.2} %",
                100.0 * yours,
                100.0 * mine,
                100.0 * between,
                best.1,
                100.0 * best.0
            );
            assert!((mine / yours - 1.0).abs() < 0.1, "{name} {what}: hunts by {mine}, theirs by {yours}");
            assert!(best.0 < 0.03, "{name} {what}: {:.4} also when moved in time", best.0);
        }
    }
}

/// What happens in a run, in order: wheels that keep less than a `share` of their load, changes of sign of the yaw rate, the
/// lateral acceleration passing 0.6 g either way.
fn events(run: &Table, share: f64) -> Vec<(f64, String)> {
    let time = run.column("t_s");
    let mut found = Vec::new();
    for wheel in ["fl", "fr", "rl", "rr"] {
        let load = run.column(&format!("Fz_N_{wheel}"));
        if let Some(n) = load.iter().position(|f| *f < share * load[0]) {
            found.push((time[n], format!("{wheel} light")));
        }
    }
    for (name, level) in [("yawrate_rps", 0.15), ("ay_cg_mps2", 5.886)] {
        let value = run.column(name);
        let mut side = 0.0;
        for n in 0..value.len() {
            if value[n].abs() > level && value[n].signum() != side {
                side = value[n].signum();
                found.push((time[n], format!("{name} beyond {}", level * side)));
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found
}

#[test]
fn at_the_limit_the_same_sequence_of_events() {
    for name in CARS {
        let section = car(name);
        let t = tyre(&section.front.tyre_file);
        let most = if name == "vw_vanagon" { "swd_0p7Hz_80_2.4deg" } else { "swd_0p7Hz_80_2.8deg" };
        for file in ["step_steer_80_high", "swd_0p7Hz_80_2deg", most, "circle_R80"] {
            let Some(text) = reference(&format!("vehicle/crmb_{name}_{file}.csv")) else { continue };
            let theirs = Table::read(&text);
            let four = [t.clone(), t.clone(), t.clone(), t.clone()];
            let mut car = Vehicle::new(&section, maps(&section), four, 1e-3).unwrap();
            let run_of = run(&mut car, &theirs, "delta_road_rad");
            let (ours, theirs) = (events(&run_of, 0.15), events(&theirs, 0.15));
            println!("{name} {file}: theirs {theirs:?}\n    ours {ours:?}");
            // The circle rises by 0.25 m/s2 and second: the same difference of level takes longer there.
            let late = if file.starts_with("circle") { 4.0 } else { 0.2 };
            for (when, what) in &theirs {
                assert!(
                    ours.iter().any(|(t, w)| w == what && (t - when).abs() < late)
                        || (what.ends_with("light") && light_near(&run_of, &what[..2], *when)),
                    "{name} {file}: {what} at {when} s is not in {ours:?}"
                );
            }
        }
    }
}

/// Whether a wheel keeps less than a third of its load within 0.3 s of a time.
fn light_near(run: &Table, wheel: &str, when: f64) -> bool {
    let (time, load) = (run.column("t_s"), run.column(&format!("Fz_N_{wheel}")));
    time.iter().zip(&load).any(|(t, f)| (t - when).abs() < 0.3 && *f < 0.33 * load[0])
}

#[test]
fn each_difference_has_a_name() {
    type Change = fn(&mut Car);
    let switches: [(&str, Change); 8] = [
        ("as shipped", |_| {}),
        ("shifts by side, not by camber", |c| {
            c.peer_model.as_mut().unwrap().shifts_follow_inclination = false;
        }),
        ("slip at the contacts", |c| c.peer_model.as_mut().unwrap().slip_at_centre_of_gravity = false),
        ("independent wheels", |c| c.peer_model.as_mut().unwrap().rigid_axles = false),
        ("springs shifted by roll", |c| c.peer_model.as_mut().unwrap().springs_without_side_shift = false),
        ("yaw about the whole car's centre", |c| {
            c.peer_model.as_mut().unwrap().yaw_about_sprung_centre = false;
        }),
        ("tyres lean with their wheels", |c| {
            let p = c.peer_model.as_mut().unwrap();
            p.front_inclination_per_travel_rad_m = None;
            p.rear_inclination_per_travel_rad_m = None;
        }),
        ("gyroscopic moments", |c| c.peer_model.as_mut().unwrap().no_gyroscopic_moments = false),
    ];
    let mut worth = [0.0f64; 8];
    for name in CARS {
        let file = car(name).front.tyre_file;
        let (t, text) = (tyre(&file), tyre_text(&file));
        // As a real tyre's: one for the left side, its mirror image on the right.
        let handed = Tyre::from_tir(&text.replace("LONGVL", "TYRESIDE = 'LEFT'\nLONGVL"), "handed").unwrap();
        let mut shipped = [0.0; 4];
        for (k, (what, change)) in switches.into_iter().enumerate() {
            let mut section = car(name);
            change(&mut section);
            let tyre = if k == 1 { &handed } else { &t };
            let Some(e) = compare(&section, tyre, name, "swd_0p7Hz_80_2deg", what) else { return };
            if k == 0 {
                shipped = e.rms;
            }
            worth[k] = (0..4).fold(worth[k], |most, i| most.max(e.rms[i] / shipped[i]));
        }
    }
    for ((what, _), worth) in switches.into_iter().zip(worth).skip(1) {
        println!("{what}: at most {worth:.2} times the difference");
        assert!(worth > 1.02, "{what} makes no difference");
    }
}

/// Roll in steady turning on R = 80 m at 5 m/s2, against the matched reference (thesis 2.3.6): within 10 %.
#[test]
fn roll_on_the_circle_at_five() {
    for name in CARS {
        let Some(text) = reference(&format!("vehicle/crmb_{name}_circle_R80.csv")) else { continue };
        let theirs = Table::read(&text);
        let section = car(name);
        let ours = run(&mut build(&section), &theirs, "delta_road_rad");
        let roll_at_five = |t: &Table| {
            let (a, roll, time) = (t.column("ay_cg_mps2"), t.column("roll_rad"), t.column("t_s"));
            let n = (0..a.len()).find(|n| time[*n] > 15.0 && a[*n].abs() >= 5.0).unwrap();
            roll[n].to_degrees()
        };
        let (found, expect) = (roll_at_five(&ours), roll_at_five(&theirs));
        println!("{name}: roll {found:.3} deg at 5 m/s2, reference {expect:.3} deg");
        assert!((found / expect - 1.0).abs() < 0.1, "{name}: {found} against {expect}");
    }
}
