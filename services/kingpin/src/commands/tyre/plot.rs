//! `tyre plot`: what a tyre does, as figures in one page that needs nothing but itself.

use super::{PlotArgs, load_tyre, mode_of, write_text};
use crate::commands::suspension::page::{Figure, Table, html};
use crate::exit::Exit;
use tyre::{Contact, Tyre, UseMode};

/// Points of a curve.
const POINTS: usize = 121;
/// Loads that are drawn by default, of the nominal one.
const LOAD_SHARES: [f64; 5] = [0.25, 0.5, 1.0, 1.5, 2.0];
const ALPHA_MAX_DEG: f64 = 15.0;
const KAPPA_MAX: f64 = 0.3;

fn spread(from: f64, to: f64) -> Vec<f64> {
    (0..POINTS).map(|k| from + (to - from) * k as f64 / (POINTS - 1) as f64).collect()
}

/// A tyre at a pressure and speed.
struct Bench<'a> {
    tyre: &'a Tyre,
    mode: UseMode,
    pressure_pa: f64,
    speed_m_s: f64,
}

impl Bench<'_> {
    fn contact(&self, load_n: f64, kappa: f64, alpha_deg: f64, gamma_deg: f64) -> Contact {
        Contact {
            vertical_load_n: load_n,
            slip_ratio: kappa,
            slip_angle_rad: alpha_deg.to_radians(),
            camber_rad: gamma_deg.to_radians(),
            turn_slip_per_m: 0.0,
            speed_m_s: self.speed_m_s,
            pressure_pa: self.pressure_pa,
            friction_scale: [1.0; 2],
        }
    }

    fn forces(&self, load_n: f64, kappa: f64, alpha_deg: f64, gamma_deg: f64) -> tyre::Forces {
        self.tyre.steady_state(&self.contact(load_n, kappa, alpha_deg, gamma_deg), self.mode)
    }
}

/// `kingpin tyre plot`.
pub fn plot(args: &PlotArgs) -> Result<Exit, String> {
    let tyre = load_tyre(&args.tir)?;
    let info = tyre.info();
    let nominal = info.nominal_load_n;
    let mut loads = args.loads_n.clone();
    if loads.is_empty() {
        let [low, high] = info.load_range_n;
        loads = LOAD_SHARES.map(|share| share * nominal).to_vec();
        loads.retain(|load| (low..=high.max(nominal)).contains(load));
    }
    let pressure_pa = args.pressure_pa.unwrap_or(info.inflation_pressure_pa);
    let mut wrong = Vec::new();
    let mut require = |holds: bool, what: String| {
        if !holds {
            wrong.push(what);
        }
    };
    for load in &loads {
        require(*load > 0.0 && *load <= 1e5, format!("--loads-n: {load}: must be in (0, 1e5] N"));
    }
    require(loads.len() <= 7, "--loads-n: must be seven loads at most".to_owned());
    require(
        pressure_pa > 0.0 && pressure_pa <= 2e6,
        format!("--pressure-pa = {pressure_pa}: must be in (0, 2e6] Pa"),
    );
    let speed_m_s = args.speed_mps;
    require(
        speed_m_s.abs() > 0.1 && speed_m_s.abs() <= 150.0,
        format!("--speed-mps = {speed_m_s}: must be from 0.1 to 150 m/s either way"),
    );
    if !wrong.is_empty() {
        return Err(wrong.join("\n"));
    }
    let bench = Bench { tyre: &tyre, mode: mode_of(&args.use_mode)?, pressure_pa, speed_m_s };
    let facts = [
        ("file", info.file_name.clone()),
        ("formula", format!("{:?}", info.version)),
        ("measured for", info.side.map_or("not told".to_owned(), |side| format!("{side:?} side"))),
        ("unloaded radius", format!("{:.4} m", info.unloaded_radius_m)),
        ("nominal load", format!("{nominal:.0} N")),
        ("loads it is valid for", format!("{:.0} to {:.0} N", info.load_range_n[0], info.load_range_n[1])),
        ("pressure here, of the file", format!("{pressure_pa:.0}, {:.0} Pa", info.inflation_pressure_pa)),
        ("keys the file leaves out", format!("{}", info.substituted.len())),
    ];
    let mut rows = vec![vec!["what".to_owned(), "value".to_owned()]];
    rows.extend(facts.iter().map(|(what, value)| vec![(*what).to_owned(), value.clone()]));
    let mut values = vec![
        ["load", "Kya", "Kxk", "muy", "mux", "trail", "sigma x", "sigma y", "Rl", "Re"]
            .map(str::to_owned)
            .to_vec(),
    ];
    let units = ["N", "N/rad", "N", "-", "-", "mm", "m", "m", "m", "m"];
    values.push(units.map(str::to_owned).to_vec());
    for load in &loads {
        let c = bench.contact(*load, 0.0, -0.5, 0.0);
        let f = tyre.steady_state(&c, bench.mode);
        let s = tyre.shape(&c, &f);
        values.push(vec![
            format!("{load:.0}"),
            format!("{:.0}", f.cornering_stiffness_n_rad),
            format!("{:.0}", f.longitudinal_slip_stiffness_n),
            format!("{:.3}", f.mu_y),
            format!("{:.3}", f.mu_x),
            format!("{:.1}", 1e3 * f.trail_m),
            format!("{:.3}", s.relaxation_length_m[0]),
            format!("{:.3}", s.relaxation_length_m[1]),
            format!("{:.4}", s.loaded_radius_m),
            format!("{:.4}", s.effective_rolling_radius_m),
        ]);
    }
    let tables = [
        Table { title: "The tyre".to_owned(), rows },
        Table { title: "Without slip, by load".to_owned(), rows: values },
    ];
    let about = format!(
        "Axes ISO-W: alpha < 0 gives Fy > 0, kappa > 0 drives. Use mode {}, {speed_m_s} m/s, {:.0} kPa.",
        args.use_mode,
        pressure_pa * 1e-3
    );
    let title = format!("Tyre {}", args.tir);
    Ok(write_text(&args.output, &html(&title, &about, &tables, &figures(&bench, &loads, nominal))))
}

fn figures(bench: &Bench<'_>, loads: &[f64], nominal: f64) -> Vec<Figure> {
    let alphas = spread(-ALPHA_MAX_DEG, ALPHA_MAX_DEG);
    let kappas = spread(-KAPPA_MAX, KAPPA_MAX);
    let of = |xs: &[f64], value: &dyn Fn(f64) -> f64| xs.iter().map(|x| value(*x)).collect::<Vec<_>>();
    let mut all = Vec::new();
    type Value = fn(&tyre::Forces) -> f64;
    let by_alpha: [(&str, &str, Value); 4] = [
        ("Lateral force", "Fy [N]", |f| f.fy_n),
        ("Aligning torque", "Mz [N m]", |f| f.mz_n_m),
        ("Overturning moment", "Mx [N m]", |f| f.mx_n_m),
        ("Pneumatic trail", "trail [mm]", |f| 1e3 * f.trail_m),
    ];
    for (title, axis, value) in by_alpha {
        let mut figure = Figure::new(title, "slip angle alpha [deg]", axis);
        for (k, load) in loads.iter().enumerate() {
            let y = of(&alphas, &|a| value(&bench.forces(*load, 0.0, a, 0.0)));
            figure.curve(&format!("{load:.0} N"), &alphas, &y, k, "solid");
        }
        all.push(figure);
    }
    let by_kappa: [(&str, &str, Value); 2] = [
        ("Longitudinal force", "Fx [N]", |f| f.fx_n),
        ("Rolling resistance moment", "My [N m]", |f| f.my_n_m),
    ];
    for (title, axis, value) in by_kappa {
        let mut figure = Figure::new(title, "slip ratio kappa [-]", axis);
        for (k, load) in loads.iter().enumerate() {
            let y = of(&kappas, &|x| value(&bench.forces(*load, x, 0.0, 0.0)));
            figure.curve(&format!("{load:.0} N"), &kappas, &y, k, "solid");
        }
        all.push(figure);
    }
    let mut figure = Figure::new("Combined slip at nominal load", "Fx [N]", "Fy [N]");
    for (k, alpha) in [-1.0, -2.0, -4.0, -8.0].into_iter().enumerate() {
        let forces: Vec<_> = spread(-1.0, 1.0)
            .iter()
            // Close together where the force changes fast.
            .map(|x| bench.forces(nominal, x * x.abs() * 0.6, alpha, 0.0))
            .collect();
        let (x, y): (Vec<f64>, Vec<f64>) = forces.iter().map(|f| (f.fx_n, f.fy_n)).unzip();
        figure.curve(&format!("alpha {alpha} deg"), &x, &y, k, "solid");
    }
    all.push(figure);
    let combined: [(&str, &str, Value); 2] = [
        ("Lateral force when braking and driving, nominal load", "Fy [N]", |f| f.fy_n),
        ("Aligning torque when braking and driving, nominal load", "Mz [N m]", |f| f.mz_n_m),
    ];
    for (title, axis, value) in combined {
        let mut figure = Figure::new(title, "slip ratio kappa [-]", axis);
        for (k, alpha) in [-1.0, -2.0, -4.0, -8.0].into_iter().enumerate() {
            let y = of(&kappas, &|x| value(&bench.forces(nominal, x, alpha, 0.0)));
            figure.curve(&format!("alpha {alpha} deg"), &kappas, &y, k, "solid");
        }
        all.push(figure);
    }
    let mut figure = Figure::new("Camber, nominal load", "slip angle alpha [deg]", "Fy [N]");
    for (k, gamma) in [-6.0, -3.0, 0.0, 3.0, 6.0].into_iter().enumerate() {
        let y = of(&alphas, &|a| bench.forces(nominal, 0.0, a, gamma).fy_n);
        figure.curve(&format!("gamma {gamma} deg"), &alphas, &y, k, "solid");
    }
    all.push(figure);
    let top = loads.iter().fold(nominal, |top, load| top.max(*load));
    let sweep = spread(0.02 * top, top);
    let at = |load: f64| {
        let c = bench.contact(load, 0.0, 0.0, 0.0);
        let f = bench.tyre.steady_state(&c, bench.mode);
        (f, bench.tyre.shape(&c, &f))
    };
    let mut figure = Figure::new("Slip stiffnesses", "load [N]", "[N/rad], [N]");
    figure.curve(
        "cornering |Kya|",
        &sweep,
        &of(&sweep, &|l| at(l).0.cornering_stiffness_n_rad.abs()),
        0,
        "solid",
    );
    figure.curve(
        "longitudinal Kxk",
        &sweep,
        &of(&sweep, &|l| at(l).0.longitudinal_slip_stiffness_n),
        1,
        "solid",
    );
    all.push(figure);
    let mut figure = Figure::new("Relaxation lengths", "load [N]", "sigma [m]");
    figure.curve("lateral", &sweep, &of(&sweep, &|l| at(l).1.relaxation_length_m[1]), 0, "solid");
    figure.curve("longitudinal", &sweep, &of(&sweep, &|l| at(l).1.relaxation_length_m[0]), 1, "solid");
    all.push(figure);
    let mut figure = Figure::new("Radii", "load [N]", "[m]");
    figure.curve("loaded Rl", &sweep, &of(&sweep, &|l| at(l).1.loaded_radius_m), 0, "solid");
    figure.curve("effective Re", &sweep, &of(&sweep, &|l| at(l).1.effective_rolling_radius_m), 1, "solid");
    all.push(figure);
    all
}
