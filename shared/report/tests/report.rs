//! Reports and summaries of made-up logs whose figures are known. With KINGPIN_REPORT_DIR set the pages stay
//! there to be looked at.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use record::{LogHeader, LogReader, LogWriter, text_hash};
use regions::{
    Payload, RegionId, RigMeasurement, RigStatus, SuspensionState, Timing, VehicleState, model_flags,
    rig_flags,
};
use report::{
    Compared, Limits, Outcome, Overlay, ReportOptions, RunSummary, comparison_html, comparison_json,
    report_html, summarise,
};

const T: f64 = 1e-3;
const FORCE_N: f64 = 2400.0;
const DELAY_S: f64 = 0.004;

/// What the made-up run is to be like.
#[derive(Clone, Copy, Default)]
struct Story {
    lockstep: bool,
    /// Holding from 9.0 to 9.06 s with late commands, resuming to 9.1 s (within the share of the window that may
    /// be missing from a lag), a tick missing at 5 s, a multibody restart.
    troubled: bool,
    tripped: bool,
}

fn header(scenario: &str, lockstep: bool) -> LogHeader {
    let configuration = "[scenario]\nname = \"x\" # <script>alert('configuration')</script>\n".to_owned();
    LogHeader {
        bench: "demo".into(),
        scenario: scenario.into(),
        run_id: 0xfeed_beef,
        period_ns: 1_000_000,
        wall_start_ns: 1_760_000_000_000_000_000,
        monotonic_start_ns: 5,
        lockstep,
        seed: 7,
        versions: [("kingpin".to_owned(), "0.1.0".to_owned()), ("rustc".to_owned(), "1.95.0".to_owned())]
            .into(),
        configuration_hash: text_hash(&configuration),
        decimation: None,
        configuration,
        sources: Vec::new(),
    }
}

/// Steering of a growing slalom, three periods of 0.25 Hz from 2 s to 14 s. [-1, 1]
fn steer(t: f64) -> f64 {
    let tau = t - 2.0;
    if (0.0..12.0).contains(&tau) { (tau / 12.0) * (TAU * 0.25 * tau).sin() } else { 0.0 }
}

/// A pseudo-random number in [0, 1), a pure function of its seed.
fn noise(seed: u64) -> f64 {
    let mut x = seed.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb) >> 11) as f64 / (1_u64 << 53) as f64
}

fn timing(n: u64, service: u64, median_s: f64, compute_s: f64) -> Timing {
    let u = noise(n * 3 + service);
    let wake = median_s * (1.0 + u) + if u > 0.9995 { 2e-3 * u } else { 0.0 };
    let compute = compute_s * (1.0 + 0.4 * noise(n * 7 + service));
    let mut t = Timing::absent();
    (t.tick, t.epoch, t.wake_lateness_s, t.start_s) = (n, 1, wake, 1e-4 * service as f64 + wake);
    (t.compute_s, t.done_s, t.late_wake_count) = (compute, t.start_s + compute, n / 2000);
    if service == 0 {
        t.margin_s = 1e-4 * (1.0 + u);
    }
    t
}

fn write_run(path: &Path, scenario: &str, story: Story) {
    let mut log = LogWriter::create(path, &header(scenario, story.lockstep)).unwrap();
    let (mut x, mut y, mut yaw) = (0.0, 0.0, 0.0_f64);
    log.event(0, "state", "idle → armed → starting");
    for n in 0..15_000_u64 {
        let t = n as f64 * T;
        let holding = story.troubled && (9000..9060).contains(&n);
        let tripped = story.tripped && n >= 12_000;
        let (s, late) = (steer(t), steer(t - DELAY_S));
        let speed = 22.2 + 0.1 * (0.5 * t).sin();
        let yaw_rate = 0.33 * steer(t - 0.05);
        yaw += yaw_rate * T;
        x += speed * yaw.cos() * T;
        y += speed * yaw.sin() * T;

        let mut m = RigMeasurement::absent();
        (m.tick, m.time_s, m.flags) = (n, t, rig_flags::VIRTUAL);
        m.steering_wheel_angle_rad = 1.4 * steer(t - 0.002);
        m.steering_wheel_torque_n_m = 3.5 * steer(t - 0.03) + 0.4 * (s - steer(t - 0.02)).signum();
        m.rack_displacement_m = 0.011 * s + 2e-5 * (noise(n) - 0.5);
        m.tie_rod_force_n = [FORCE_N * late, -0.8 * FORCE_N * late].map(|f| f + 2.0 * (noise(n + 9) - 0.5));
        m.vertical_stroke_m = [-0.012 * steer(t - 0.008), 0.012 * steer(t - 0.008)];
        log.write(RegionId::RigMeasurement, n, m.words());

        let mut v = VehicleState::absent();
        (v.tick, v.time_s, v.used_rig_measurement) = (n, t + T, n);
        v.flags = if holding { model_flags::HELD_INPUT } else { 0 };
        v.manoeuvre_active = u64::from((2.0..14.0).contains(&t));
        (v.steering_wheel_angle_command_rad, v.target_speed_m_s) = (1.4 * s, 22.222);
        v.position_m = [x, y, 0.5];
        v.velocity_m_s = [speed, -0.2 * s, 0.0];
        v.angular_velocity_rad_s = [0.0, 0.0, yaw_rate];
        v.acceleration_m_s2 = [0.0, 22.2 * yaw_rate, 0.0];
        (v.roll_rad, v.side_slip_rad) = (0.04 * steer(t - 0.1), -0.02 * steer(t - 0.06));
        if !(story.troubled && n == 5000) {
            log.write(RegionId::VehicleState, n, v.words());
        }

        let mut suspension = SuspensionState::absent();
        (suspension.tick, suspension.time_s, suspension.iterations, suspension.residual_m) =
            (n, t + T, 3, 1e-13);
        suspension.tie_rod_force_n = [FORCE_N * s, -0.8 * FORCE_N * s];
        log.write(RegionId::SuspensionState, n, suspension.words());

        let mut r = RigStatus::absent();
        (r.tick, r.time_s) = (n, t);
        r.flags = rig_flags::VIRTUAL | if holding { rig_flags::LATE_COMMAND } else { 0 };
        r.state = match n {
            _ if tripped => 8,
            _ if holding => 5,
            0..200 => 1,
            200..500 => 2,
            500..1500 => 3,
            9060..9100 if story.troubled => 6,
            14_700.. => 7,
            _ => 4,
        };
        if tripped {
            (r.trip_code, r.trip_tick, r.trip_limit, r.trip_value) = (3, 12_000, 9000.0, 9120.5);
        }
        r.late_command_count = if story.troubled { n.saturating_sub(9000).min(60) } else { 0 };
        r.tie_rod_force_command_n = suspension.tie_rod_force_n;
        r.tie_rod_force_applied_n = suspension.tie_rod_force_n;
        r.true_tie_rod_force_n = [FORCE_N * steer(t - 0.003), -0.8 * FORCE_N * steer(t - 0.003)];
        r.ball_height_applied_m = [-0.012 * s, 0.012 * s];
        (r.port_energy_j, r.loop_delay_s, r.true_rack_displacement_m) = (0.05 * t, DELAY_S, 0.011 * s);
        log.write(RegionId::RigStatus, n, r.words());

        log.write(RegionId::RigTiming, n, timing(n, 0, 6e-6, 18e-6).words());
        log.write(RegionId::VehicleTiming, n, timing(n, 1, 9e-6, 120e-6).words());
        log.write(RegionId::MultibodyTiming, n, timing(n, 2, 12e-6, 60e-6).words());
    }
    if story.troubled {
        log.event(9000, "holding", "inputs stale: <img src=x onerror=alert(1)>");
        log.event(9050, "service", serde_json::json!({ "name": "multibody", "signal": "SIGKILL" }));
    }
    log.finish().unwrap();
}

/// A measured lateral acceleration: the bench's, 40 ms earlier and 5 % larger, at 50 Hz.
fn measured() -> Overlay {
    let time_s: Vec<f64> = (0..700).map(|i| 0.5 + f64::from(i) * 0.02).collect();
    let value = time_s.iter().map(|t| 1.05 * 22.2 * 0.33 * steer(t + 0.04 - T - 0.05)).collect();
    Overlay {
        title: "measured <car bus>".into(),
        unit: "m/s^2".into(),
        time_s,
        value,
        target: "vehicle_state.acceleration_m_s2.y".into(),
    }
}

fn keep(name: &str, page: &str) {
    if let Some(dir) = std::env::var_os("KINGPIN_REPORT_DIR") {
        std::fs::write(PathBuf::from(dir).join(name), page).unwrap();
    }
}

/// The page without the library's script, which is somebody else's text.
fn own_part(page: &str) -> String {
    page.replace(report::plotly_js(), "")
}

#[test]
fn the_figures_of_a_known_run() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story::default());
    let log = LogReader::open(&path).unwrap();
    let summary = summarise(&log, &[measured()], &Limits::default());
    assert_eq!((summary.ticks, summary.end_state.as_deref()), (15_000, Some("stopping")));
    assert!((summary.duration_s - 15.0).abs() < 1e-9);
    assert_eq!(summary.state_ticks["armed"], 300);
    assert!((summary.speed_m_s.unwrap().mean - 22.2).abs() < 0.1);

    // The largest swing of t/12·sin within 12 s, found on the same grid.
    let swing = (0..15_000)
        .map(|n| steer(n as f64 * T))
        .fold((0.0, 0.0), |(a, b): (f64, f64), v| (a.min(v), b.max(v)));
    let left = &summary.force_tracking[0];
    let amplitude = FORCE_N * 0.5 * (swing.1 - swing.0);
    assert!((left.amplitude.unwrap() / amplitude - 1.0).abs() < 1e-3, "{left:?}");
    let late = |n: u64| (steer(n as f64 * T) - steer(n as f64 * T - DELAY_S)).abs();
    let peak = 100.0 * FORCE_N * (2000..14_000).map(late).fold(0.0, f64::max) / amplitude;
    assert!((left.error_max_percent.unwrap() / peak - 1.0).abs() < 0.02, "{left:?} {peak}");
    assert!((left.lag_s.unwrap() - DELAY_S).abs() < 2e-4, "{left:?}");
    assert!((summary.true_force_tracking[1].lag_s.unwrap() - 0.003).abs() < 2e-4);
    assert!((summary.height_tracking[0].lag_s.unwrap() - 0.008).abs() < 2e-4);

    let o = &summary.overlays[0];
    assert!((o.lag_s.unwrap() - 0.04).abs() < 0.003, "{o:?}");
    assert!((o.normalised_rms_error_percent.unwrap() - 100.0 * (1.0 - 1.0 / 1.05)).abs() < 0.5, "{o:?}");
    assert!(o.rms_error.unwrap() > o.rms_error_aligned.unwrap());

    // 0.4 N·m of friction each way, less what the torque comes late: 2 · 3.5 ω 0.028 s of half the envelope.
    let feel = summary.torque_over_angle;
    let width = 0.8 - 7.0 * TAU * 0.25 * 0.028 * 0.5;
    assert!((feel.width_n_m.unwrap() - width).abs() < 0.05, "{feel:?}");
    assert!((feel.gradient.unwrap() / 2.5 - 1.0).abs() < 0.25, "{feel:?}");

    let compute = summary.timing[1].compute_s.unwrap();
    assert!((120e-6..=168e-6).contains(&compute.p50) && compute.max <= 168e-6);
    assert!(summary.passed, "{:#?}", summary.verdicts);
    assert!(
        summary.verdicts.iter().any(|v| v.name == "Tie-rod force lag left" && v.outcome == Outcome::Pass)
    );

    let json = serde_json::to_string_pretty(&summary).unwrap();
    assert_eq!(serde_json::from_str::<RunSummary>(&json).unwrap(), summary);
}

#[test]
fn trouble_fails_and_says_where() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "lane_change_120", Story { troubled: true, tripped: true, ..Story::default() });
    let log = LogReader::open(&path).unwrap();
    let limits = Limits { force_lag_max_s: Some(0.003), ..Limits::default() };
    let summary = summarise(&log, &[], &limits);
    assert!(!summary.passed);
    let found = |name: &str| summary.verdicts.iter().find(|v| v.name == name).unwrap();
    for name in ["No trip", "Log complete", "Commands in time", "Tie-rod force lag right"] {
        assert!(found(name).failed(), "{name}: {:?}", found(name));
    }
    assert!(found("No trip").found.contains("code 3 at 12.000 s"));
    assert_eq!(summary.log.first_gap["vehicle_state"], (5000, 5000));
    assert_eq!((summary.log.missing_ticks["vehicle_state"], summary.log.missing_ticks["rig_status"]), (1, 0));
    assert_eq!(summary.flag_ticks["rig: late command"], 60);
    assert_eq!(summary.late_command_count, Some(60));
    assert_eq!(summary.trip.unwrap().value, Some(9120.5));
    // A published manoeuvre is judged by half its published figures.
    assert_eq!(found("Tie-rod force error left, peak").limit, "≤ 4.38 %");
}

#[test]
fn lockstep_says_nothing_about_real_time() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story { lockstep: true, ..Story::default() });
    let log = LogReader::open(&path).unwrap();
    let summary = summarise(&log, &[], &Limits::default());
    let commands = summary.verdicts.iter().find(|v| v.name == "Commands in time").unwrap();
    assert_eq!(commands.outcome, Outcome::Withheld);
    assert!(summary.passed, "withheld is not failed");
    let page = own_part(&report_html(&log, &ReportOptions::default()));
    assert!(page.contains("says nothing about real time") && !page.contains("Wake-up lateness"));
}

#[test]
fn the_page_needs_nothing_and_trusts_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story { troubled: true, ..Story::default() });
    let log = LogReader::open(&path).unwrap();
    let strange = Overlay { target: "vehicle_state.roll_rad".into(), unit: "deg".into(), ..measured() };
    let options = ReportOptions {
        title: Some("Growing slalom </title><script>alert('title')</script>".into()),
        description: Some("A <b>bold</b> & \"quoted\" description.".into()),
        overlays: vec![measured(), strange],
        limits: Limits::default(),
    };
    let page = report_html(&log, &options);
    keep("troubled.html", &page);
    assert!(page.len() < 8_000_000, "{} bytes", page.len());
    let own = own_part(&page);
    for foreign in ["<script>alert", "<img", "<b>bold", "http://", "https://", "<link", "src=\""] {
        assert!(!own.contains(foreign), "{foreign} in the page");
    }
    assert!(own.contains("default-src 'none'"));
    assert_eq!(own.matches("<script").count(), 3, "data, library, own script");
    for heading in [
        "Steering-wheel angle",
        "Speed",
        "Lateral acceleration",
        "Yaw rate",
        "Tie-rod force, left",
        "Tie-rod force, right",
        "Tie-rod force error",
        "Rack displacement",
        "Steering torque over angle",
        "Ball heights",
        "Path of the car",
        "Bench state, flags and events",
        "Wake-up lateness",
        "Compute time",
        "Arrival of the command",
        "Resolved configuration",
    ] {
        assert!(own.contains(heading), "{heading}");
    }
    assert!(own.contains("withheld: unit deg does not fit rad of the bench"));
    // The data are JSON; every curve has as many x as y and the peak of the record is among its points.
    let data = own.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap();
    let figures: serde_json::Value = serde_json::from_str(data).unwrap();
    let mut curves = 0;
    for figure in figures.as_array().unwrap() {
        for trace in figure["data"].as_array().unwrap() {
            assert_eq!(trace["x"].as_array().unwrap().len(), trace["y"].as_array().unwrap().len());
            curves += 1;
        }
    }
    assert!(curves > 25, "{curves}");
}

#[test]
fn a_good_run_to_look_at() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story::default());
    let log = LogReader::open(&path).unwrap();
    let options = ReportOptions {
        description: Some(
            "Sine steering of growing amplitude at 0.25 Hz and 80 km/h, closed loop on the virtual rig."
                .into(),
        ),
        overlays: vec![measured()],
        ..ReportOptions::default()
    };
    let page = report_html(&log, &options);
    keep("good.html", &page);
    assert!(own_part(&page).contains("PASS"));
}

#[test]
fn logs_with_little_in_them_make_a_page_too() {
    let dir = tempfile::tempdir().unwrap();
    let empty = dir.path().join("empty.mcap");
    LogWriter::create(&empty, &header("empty", false)).unwrap().finish().unwrap();
    let log = LogReader::open(&empty).unwrap();
    let summary = summarise(&log, &[measured()], &Limits::default());
    assert!(!summary.passed, "an empty log is not a pass");
    assert!(own_part(&report_html(&log, &ReportOptions::default())).contains("FAIL"));

    // One region only, with ticks as a corrupt log could have them.
    let odd = dir.path().join("odd.mcap");
    let mut log = LogWriter::create(&odd, &header("odd", false)).unwrap();
    for tick in [3, u64::MAX - 1] {
        let mut m = RigMeasurement::absent();
        m.tick = tick;
        log.write(RegionId::RigMeasurement, tick, m.words());
    }
    log.finish().unwrap();
    let log = LogReader::open(&odd).unwrap();
    assert!(report_html(&log, &ReportOptions::default()).len() > 1000);
}

#[test]
fn the_force_budget_finds_the_delay_and_adds_up() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story::default());
    let log = LogReader::open(&path).unwrap();
    let budget = &summarise(&log, &[], &Limits::default()).force_budget[1];
    assert!((budget.delay_s.unwrap() - 0.003).abs() < 1e-4, "{budget:?}");
    let whole = budget.rms_n.unwrap();
    let sum: f64 = budget.parts.iter().map(|p| p.share_n).sum();
    assert!((sum / whole - 1.0).abs() < 1e-9 && (budget.sum_of_shares_n.unwrap() / whole - 1.0).abs() < 1e-9);
    let part = |name: &str| budget.parts.iter().find(|p| p.name.contains(name)).unwrap();
    assert!(part("delay").share_n / whole > 0.99, "{budget:#?}");
    // What is asked at 3 ms of delay, straight from the run's law, while it steers and the bench runs.
    let law = |n: u64| 0.8 * FORCE_N * (steer(n as f64 * T) - steer(n as f64 * T - 0.003));
    let expected = ((2000..14_000).map(|n| law(n).powi(2)).sum::<f64>() / 12_000.0).sqrt();
    assert!((whole / expected - 1.0).abs() < 0.01, "{whole} {expected}");
    // The reading's noise is even over 2 N.
    assert!((part("force cell: rest").rms_n / (1.0 / 3_f64.sqrt()) - 1.0).abs() < 0.05, "{budget:#?}");
    let page = own_part(&report_html(&log, &ReportOptions::default()));
    assert!(page.contains("Tie-rod force error, where it comes from") && page.contains("3.00 ms"));
}

#[test]
fn figures_of_the_source_are_named_and_what_lacks_is_said() {
    let dir = tempfile::tempdir().unwrap();
    let page = |scenario: &str, overlays: Vec<Overlay>| {
        let path = dir.path().join(format!("{scenario}{}.mcap", overlays.len()));
        write_run(&path, scenario, Story::default());
        let log = LogReader::open(&path).unwrap();
        own_part(&report_html(&log, &ReportOptions { overlays, ..ReportOptions::default() }))
    };
    let slalom = page("growing_slalom_80", Vec::new());
    for number in 21..=38 {
        assert!(slalom.contains(&format!("<td>5.{number}</td>")), "5.{number}");
    }
    assert!(slalom.contains("Source: figures 5.23, 5.28."), "the bench's lateral acceleration");
    assert!(slalom.contains("no measured record of vehicle_state.acceleration_m_s2.y"));
    // With the record of the road its figures are there too.
    assert!(page("growing_slalom_80", vec![measured()]).contains("Source: figures 5.22, 5.23, 5.27, 5.28."));
    for (scenario, number) in [
        ("on_centre_120", "5.3"),
        ("slalom_120", "5.4"),
        ("lane_change_120", "5.5"),
        ("sine_with_dwell_80", "5.6"),
    ] {
        let page = page(scenario, Vec::new());
        assert!(page.contains(&format!("manoeuvre of the source&#39;s figure {number}.")), "{scenario}");
        assert_eq!(page.matches(&format!("Source: figure {number}.")).count(), 3, "{scenario}");
    }
}

#[test]
fn a_measured_torque_loop_is_laid_over_the_benchs() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("log.mcap");
    write_run(&path, "growing_slalom_80", Story::default());
    let log = LogReader::open(&path).unwrap();
    // The bench's own loop with a tenth more torque, as a record of 200 Hz.
    let record = |target: &str, unit: &str, scale: f64| {
        let signal = log.signal(target).unwrap();
        let every = |v: &[f64]| v.iter().copied().step_by(5).collect::<Vec<f64>>();
        Overlay {
            title: format!("measured: {target}"),
            unit: unit.to_owned(),
            time_s: every(&signal.time_s),
            value: every(&signal.value).iter().map(|v| v * scale).collect(),
            target: target.to_owned(),
        }
    };
    let angle = record("rig_measurement.steering_wheel_angle_rad", "rad", 1.0);
    let torque = record("rig_measurement.steering_wheel_torque_n_m", "N*m", 1.1);
    let summary = summarise(&log, &[angle.clone(), torque.clone()], &Limits::default());
    let [found] = &summary.record_loops[..] else { panic!("{:?}", summary.record_loops) };
    assert!((found.gradient_error_percent.unwrap() - 100.0 * (1.0 / 1.1 - 1.0)).abs() < 2.0, "{found:?}");
    assert!((found.width_error_percent.unwrap() - 100.0 * (1.0 / 1.1 - 1.0)).abs() < 6.0, "{found:?}");
    let page = own_part(&report_html(
        &log,
        &ReportOptions { overlays: vec![angle, torque], ..ReportOptions::default() },
    ));
    assert!(page.contains("Steering-torque loops against the record"));
    assert!(page.contains("Source: figures 5.31, 5.32, 5.35, 5.36."));
}

#[test]
fn runs_are_compared_on_one_page() {
    let dir = tempfile::tempdir().unwrap();
    let open = |name: &str, story: Story| {
        let path = dir.path().join(format!("{name}.mcap"));
        write_run(&path, "growing_slalom_80", story);
        LogReader::open(&path).unwrap()
    };
    let (a, b) = (open("a", Story::default()), open("b", Story { tripped: true, ..Story::default() }));
    let compared =
        |name: &str, log| Compared { name: name.to_owned(), log, options: ReportOptions::default() };
    let runs = [compared("first <run>", &a), compared("again", &a), compared("tripped", &b)];
    let page = comparison_html(&runs);
    keep("comparison.html", &page);
    let own = own_part(&page);
    for said in [
        "first &lt;run&gt;",
        "Side by side",
        "minus the first run",
        "resolved configurations are equal",
        "FAIL",
    ] {
        assert!(own.contains(said), "{said}");
    }
    assert!(!own.contains("<run>") && !own.contains("http://") && !own.contains("https://"));
    let json = comparison_json(&runs);
    let rows = json["figures"].as_array().unwrap();
    let row = |name: &str| rows.iter().find(|row| row["figure"] == name).unwrap();
    assert_eq!(row("Peak steering torque")["minus_first"][1], 0.0);
    // A tripped run is judged up to its trip: less of the growing error is seen.
    assert!(row("Force error felt, left, rms")["minus_first"][2].as_f64().unwrap() < -0.5);
    assert_eq!(json["configuration_differences"].as_array().unwrap().len(), 0);
}
