//! The console: who may do what, what fuzzing does, a client that stops reading, and the page in a real browser.
//!
//! `scripts/console-load` prints what the console costs the loop: tick lateness with 0, 1 and 5 clients in one run.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

#[path = "console/load.rs"]
mod load;
#[path = "console/page.rs"]
mod page;

use kingpin_tests::browser;
use kingpin_tests::socket::{Socket, get};
use kingpin_tests::support::{kingpin, workspace};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

static ALONE: Mutex<()> = Mutex::new(());

/// Real-time runs one after the other.
fn alone() -> MutexGuard<'static, ()> {
    ALONE.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

const TOKEN: &str = "0123456789abcdefTEST";

struct Console {
    child: Child,
    address: SocketAddr,
    name: String,
    folder: tempfile::TempDir,
}

impl Console {
    /// A console whose runs are not tripped by a slow machine.
    fn start(name: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let token = folder.path().join("token");
        std::fs::write(&token, TOKEN).unwrap();
        let name = format!("con-{name}-{}", std::process::id());
        let mut child = Command::new(kingpin())
            .args(["console", "--port", "0", "--name", &name, "--token-file"])
            .arg(&token)
            .arg("--runs")
            .arg(folder.path().join("runs"))
            .args(["--set", "rig.limits.stall_ticks=10000", "--set", "rig.limits.holding_max_s=60"])
            .args(["--set", "realtime.lock_memory=false"])
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()).unwrap();
        let address = address.parse().unwrap();
        Console { child, address, name, folder }
    }

    fn origin(&self) -> String {
        format!("http://{}", self.address)
    }

    fn client(&self) -> Socket {
        Socket::connect(self.address, Some(&self.origin())).unwrap()
    }

    fn operator(&self) -> Socket {
        let mut client = self.client();
        let answer = client.ask(&json!({"token": {"token": TOKEN}})).unwrap();
        assert_eq!(answer["may_write"], true);
        client
    }

    /// Starts a run and waits until its rig is idle and takes requests.
    fn launch(&self, operator: &mut Socket, scenario: &str, duration_s: f64) {
        let answer =
            operator.ask(&json!({"launch": {"scenario": scenario, "duration_s": duration_s}})).unwrap();
        assert!(answer["launched"].is_string(), "{answer}");
        until("the bench", || operator.ask(&json!({"parameters": {}})).unwrap()["parameters"].is_object());
        self.until_state(operator, "idle");
    }

    fn until_state(&self, client: &mut Socket, wanted: &str) {
        let code = regions::STATE_NAMES.iter().position(|name| *name == wanted).unwrap();
        client
            .ask(&json!({"subscribe": {"traces": [], "latest": ["rig_status.state"], "rate_hz": 20.0, "points_hz": 100.0}}))
            .unwrap();
        until(wanted, || client.next_frame().unwrap()["latest"][0] == code);
    }

    fn state(&self) -> Value {
        let show = |region: &str| -> Value {
            let output = Command::new(kingpin())
                .args(["table", "show", region, "--json", "--name", &self.name])
                .output();
            serde_json::from_slice(&output.unwrap().stdout).unwrap_or(Value::Null)
        };
        let (bench, parameters, status) = (show("bench"), show("parameters"), show("rig_status"));
        json!([
            bench["content"]["request_count"],
            bench["content"]["request"],
            bench["content"]["emergency_stop"],
            bench["content"]["end_tick"],
            parameters["content"],
            status["content"]["state"],
        ])
    }

    fn end_run(&self, operator: &mut Socket) {
        operator.ask(&json!({"operate": {"operation": "end"}}));
        let bench = table::Bench::new(&self.name).unwrap();
        until("the end of the run", || bench.supervisor_pid().unwrap().is_none());
    }
}

impl Drop for Console {
    fn drop(&mut self) {
        let _ = Command::new(kingpin()).args(["operate", "end", "--name", &self.name]).output();
        if let Ok(bench) = table::Bench::new(&self.name) {
            let begin = Instant::now();
            while bench.supervisor_pid().is_ok_and(|pid| pid.is_some())
                && begin.elapsed() < Duration::from_secs(20)
            {
                std::thread::sleep(Duration::from_millis(50));
            }
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn until(what: &str, mut look: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !look() {
        assert!(begin.elapsed() < Duration::from_secs(90), "waited in vain for {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn writes() -> Vec<Value> {
    vec![
        json!({"set": {"settings": [["unit.assist_scale", 0.5]]}}),
        json!({"undo": {}}),
        json!({"snapshot": {"name": "mine"}}),
        json!({"steer": {"mode": 1, "angle_rad": 1.0, "torque_n_m": 0.0}}),
        json!({"operate": {"operation": "emergency_stop"}}),
        json!({"operate": {"operation": "arm"}}),
        json!({"launch": {"scenario": "slalom_120", "duration_s": 5.0}}),
    ]
}

#[test]
fn nobody_gets_in_under_another_name_or_from_another_page() {
    let console = Console::start("door");
    let (address, host) = (console.address, console.address.to_string());
    for path in ["/", "/app.js", "/plotly.js"] {
        let (status, text) = get(address, path, &[("Host", &host)]).unwrap();
        assert_eq!(status, 200, "{path}");
        assert!(text.to_ascii_lowercase().contains("content-security-policy: default-src 'none'"), "{path}");
    }
    let localhost = format!("localhost:{}", address.port());
    assert_eq!(get(address, "/", &[("Host", &localhost)]).unwrap().0, 200);
    for host in ["evil.example", "evil.example:8470", "127.0.0.1", ""] {
        assert_eq!(get(address, "/", &[("Host", host)]).unwrap().0, 403, "host {host:?}");
    }
    for path in [
        "/report/..%2f..%2fetc",
        "/report/%2e%2e",
        "/../Cargo.toml",
        "/report/nothing",
        "/compare/nothing/nothing",
        "/compare/..%2f..%2fetc/%2e%2e",
    ] {
        assert_eq!(get(address, path, &[("Host", &host)]).unwrap().0, 404, "{path}");
    }
    for origin in
        [None, Some("http://evil.example"), Some("null"), Some("file://"), Some("http://127.0.0.1:1")]
    {
        assert_eq!(Socket::connect(address, origin).err().as_deref(), Some("403"), "origin {origin:?}");
    }
    assert!(Socket::connect(address, Some(&format!("http://{localhost}"))).is_ok());
}

#[test]
fn without_the_token_nothing_is_written() {
    let console = Console::start("token");
    for shown in [None, Some(""), Some("0123456789abcdefTES"), Some("0123456789abcdefTESU")] {
        let mut client = console.client();
        if let Some(token) = shown {
            assert_eq!(client.ask(&json!({"token": {"token": token}})).unwrap()["may_write"], false);
        }
        for want in writes() {
            let answer = client.ask(&want).unwrap();
            let said = answer["error"].as_str().unwrap_or_default();
            assert!(said.contains("token"), "{want} with token {shown:?}: {answer}");
        }
        // Looking is free.
        assert!(client.ask(&json!({"signals": {}})).unwrap()["signals"].is_array());
        assert!(client.ask(&json!({"runs": {}})).unwrap()["runs"].is_array());
    }
    // With it, what is refused is refused for another reason.
    let answer = console.operator().ask(&json!({"undo": {}})).unwrap();
    assert!(answer["error"].as_str().unwrap().contains("not running"), "{answer}");
    assert!(!console.folder.path().join("runs").join("snapshots").exists());
}

#[test]
fn malformed_and_huge_messages_are_refused() {
    let console = Console::start("huge");
    let mut client = console.operator();
    for text in [
        "",
        "{",
        "null",
        "[1,2]",
        r#"{"want":{"nothing":{}}}"#,
        r#"{"id":-1,"want":{"undo":{}}}"#,
        "\u{0}\u{1}",
    ] {
        client.send(text).unwrap();
    }
    client.send_frame(2, &[0xff; 100]).unwrap();
    let mut refused = 0;
    while refused < 8 {
        let value = client.receive().expect("the connection lasts");
        if value["error"].as_str().is_some_and(|e| e.contains("not understood")) {
            refused += 1;
        }
    }
    for name in ["../../etc/passwd", "a/b", "", ".hidden", "a b"] {
        let answer = client.ask(&json!({"snapshot_read": {"name": name}})).unwrap();
        assert!(answer["error"].is_string(), "{name}");
        assert!(client.ask(&json!({"replay": {"run": name}})).unwrap()["error"].is_string(), "{name}");
    }
    let many: Vec<_> = (0..33).map(|_| "rig_status.state").collect();
    let answer = client
        .ask(&json!({"subscribe": {"traces": many, "latest": [], "rate_hz": 1e300, "points_hz": -5.0}}));
    assert!(answer.unwrap()["error"].is_string());
    for size in [9_000, 1_000_000] {
        let mut rude = console.client();
        let _ = rude.send(&"x".repeat(size));
        while let Some(value) = rude.receive() {
            assert!(
                value["frame"].is_object() || value["greeting"].is_object(),
                "{size} bytes were answered: {value}"
            );
        }
    }
    assert!(console.client().ask(&json!({"runs": {}})).is_some(), "the console goes on");
}

/// Numbers without any other dependency (xorshift64*).
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize % below
    }
}

#[test]
fn ten_thousand_fuzzed_messages_change_nothing() {
    let _alone = alone();
    let console = Console::start("fuzz");
    let mut operator = console.operator();
    console.launch(&mut operator, "slalom_120", 600.0);
    let before = console.state();
    let mut seeds: Vec<String> =
        writes().iter().map(|want| json!({"id": 1, "want": want}).to_string()).collect();
    seeds.push(json!({"id": 1, "want": {"subscribe": {"traces": ["rig_status.state"], "latest": [], "rate_hz": 1.0, "points_hz": 100.0}}}).to_string());
    seeds.push(json!({"id": 1, "want": {"seek": {"to_s": 1e9}}}).to_string());
    let seed = 20_260_101;
    println!("seed {seed}");
    let mut dice = Dice(seed);
    // Half of the messages come without the token; with it, only such that are broken for certain.
    let mut clients = [console.client(), console.operator()];
    let (mut sent, mut answered) = (0, 0);
    while sent < 10_000 {
        let with_token = sent % 2;
        let mut text = seeds[dice.roll(seeds.len())].clone().into_bytes();
        for _ in 0..1 + dice.roll(6) {
            match dice.roll(4) {
                0 => {
                    let at = dice.roll(text.len().max(1));
                    text.insert(at.min(text.len()), 32 + dice.roll(95) as u8);
                }
                1 if !text.is_empty() => {
                    text.remove(dice.roll(text.len()));
                }
                2 if !text.is_empty() => {
                    let at = dice.roll(text.len());
                    text[at] = 32 + dice.roll(95) as u8;
                }
                _ => text.truncate(dice.roll(text.len() + 1)),
            }
        }
        if with_token == 1 && serde_json::from_slice::<Value>(&text).is_ok() {
            text.push(b'}');
        }
        clients[with_token].send(&String::from_utf8(text).unwrap()).unwrap();
        sent += 1;
        // What comes back is read now and then, so that neither side fills up.
        if sent % 50 == 0 {
            for client in &mut clients {
                let answer = client.ask(&json!({"snapshots": {}})).expect("the console lives");
                answered += u64::from(answer["snapshots"].is_array());
            }
        }
    }
    assert_eq!(answered, 400);
    let whole = |pid: u32| std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let memory = whole(console.child.id());
    let memory = memory.lines().find(|line| line.starts_with("VmHWM")).unwrap_or("no VmHWM");
    println!(
        "{sent} fuzzed messages, half of them with the token: {answered} questions between them answered; {memory}"
    );
    let after = console.state();
    assert_eq!(before, after, "fuzzing changed the state of the bench");
    // The check can fail: one good message changes it.
    operator.ask(&json!({"set": {"settings": [["unit.assist_scale", 0.5]]}})).unwrap();
    until("a change", || console.state() != before);
    console.end_run(&mut operator);
}

fn many() -> Value {
    let traces = [
        "rig_measurement.steering_wheel_angle_rad",
        "rig_measurement.steering_wheel_torque_n_m",
        "rig_measurement.rack_displacement_m",
        "rig_measurement.tie_rod_force_n.left",
        "rig_measurement.tie_rod_force_n.right",
        "vehicle_state.acceleration_m_s2.y",
        "vehicle_state.velocity_m_s.x",
        "vehicle_state.angular_velocity_rad_s.z",
        "vehicle_state.roll_rad",
        "rig_status.port_energy_j",
    ];
    json!({"subscribe": {"traces": traces, "latest": ["rig_status.state"], "rate_hz": 20.0, "points_hz": 100.0}})
}

#[test]
fn a_client_that_stops_reading_slows_nobody() {
    let _alone = alone();
    let console = Console::start("stall");
    let mut operator = console.operator();
    console.launch(&mut operator, "slalom_120", 600.0);
    let mut good = console.client();
    good.ask(&many()).unwrap();
    let mut rate = |label: &str| {
        let begin = Instant::now();
        let (mut frames, mut last) = (0, -1.0);
        while begin.elapsed() < Duration::from_secs(3) {
            let frame = good.next_frame().expect("frames go on");
            let tick = frame["tick"].as_f64().unwrap();
            assert!(tick >= last, "frames are in order");
            last = tick;
            frames += 1;
        }
        println!("{label}: {:.1} frames a second", f64::from(frames) / begin.elapsed().as_secs_f64());
        frames
    };
    let before = rate("alone");
    // Five that ask for as much as there is and read nothing.
    let deaf: Vec<_> = (0..5)
        .map(|_| {
            let mut client = console.client();
            let mut want = many();
            want["subscribe"]["rate_hz"] = json!(60.0);
            want["subscribe"]["points_hz"] = json!(1000.0);
            client.send(&json!({"id": 1, "want": want}).to_string()).unwrap();
            client
        })
        .collect();
    std::thread::sleep(Duration::from_secs(5));
    let after = rate("beside five deaf ones");
    assert!(before >= 3 && after >= 3, "the page gets frames: {before} then {after} in three seconds");
    drop(deaf);
    console.end_run(&mut operator);
}

/// Where the pictures go: beside the build, for people to look at.
fn pictures() -> std::path::PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace().join("target"), Into::into);
    let folder = target.join("console-pictures");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

#[test]
fn the_page_in_a_real_browser() {
    let Some(page) = browser::start(1600, 1000) else { return };
    let _alone = alone();
    let console = Console::start("page");
    let pictures = pictures();
    let value = |name: &str| format!("window.kingpin.value('{name}')");
    page.go(&format!("{}/#token={TOKEN}", console.origin()));
    page.until("the token", "window.kingpin && window.kingpin.mayWrite()");
    assert_eq!(page.run("return location.hash"), "", "the token does not stay in the address");

    // Run: choose, get ready, arm, start.
    page.run("document.querySelector('#launch-scenario').value = 'slalom_120'");
    page.fill("#launch-duration", "600");
    page.click("#launch");
    page.until("the bench", "window.kingpin.state() === 'idle'");
    page.click("[data-operate=arm]");
    page.until("armed", "window.kingpin.state() === 'armed'");
    page.click("[data-operate=start]");
    page.until("running", "window.kingpin.state() === 'running'");
    page.picture(&pictures.join("1-run.png"));

    // Watch: curves move.
    page.click("#tab-watch");
    let torque = "rig_measurement.steering_wheel_torque_n_m";
    let trace = format!("window.kingpin.traces.get('{torque}')");
    page.until("samples", &format!("{trace} && {trace}.n > 300"));
    let samples = page.run(&format!("return {trace}.n")).as_u64().unwrap();
    page.until("more samples", &format!("{trace}.n > {samples} + 100"));
    page.until(
        "steering",
        &format!("Math.abs({}) > 0.05", value("rig_measurement.steering_wheel_angle_rad")),
    );
    let before = page.run("return window.kingpin.stats.updates").as_f64().unwrap();
    let begin = Instant::now();
    std::thread::sleep(Duration::from_secs(6));
    let updates = page.run("return window.kingpin.stats.updates").as_f64().unwrap() - before;
    let drawn = page.run(
        "const p = (l, q) => { const s = l.slice(-120).sort((a, b) => a - b); return s[Math.floor(q * (s.length - 1))]; }; \
         const s = window.kingpin.stats; return [p(s.work, .5), p(s.work, .95), p(s.intervals, .5), p(s.intervals, .95), \
         [...window.kingpin.traces.values()].filter((t) => t.n).length];",
    );
    println!(
        "{:.1} updates a second, {} signals; drawing p50 {:.1} ms, p95 {:.1} ms; between updates p50 {:.1} ms, p95 {:.1} ms",
        updates / begin.elapsed().as_secs_f64(),
        drawn[4],
        drawn[0].as_f64().unwrap(),
        drawn[1].as_f64().unwrap(),
        drawn[2].as_f64().unwrap(),
        drawn[3].as_f64().unwrap()
    );
    page.picture(&pictures.join("2-watch.png"));
    page::frame_times(&page);
    page::layouts_are_kept(&page, &format!("{}/", console.origin()));
    page.click("#tab-timing");
    page.until("timing", "document.querySelectorAll('#timing-table tr').length === 4");
    page.picture(&pictures.join("3-timing.png"));

    // Tune: a change and its effect, a refusal, undo.
    page.click("#tab-tune");
    page.until("parameters", "document.querySelectorAll('#parameters tr').length > 20");
    page.fill("[id='p-speed.offset_m_s']", "-5");
    page.until(
        "the answer",
        "document.querySelector('#tune-said').textContent.includes('speed.offset_m_s: 0 → -5')",
    );
    let speed = "Math.abs(window.kingpin.value('vehicle_state.target_speed_m_s') - (120 / 3.6 - 5)) < 0.01";
    page.until("the target speed", speed);
    page.until(
        "the car to slow down",
        &format!("{} < 120 / 3.6 - 0.5", value("vehicle_state.velocity_m_s.x")),
    );
    page.fill("[id='p-control.force.bandwidth_rad_s']", "5000");
    page.until(
        "the refusal",
        "document.querySelector('#tune-said').textContent.includes('must be in [10, 300]')",
    );
    page.picture(&pictures.join("4-tune.png"));
    page.click("#undo");
    page.until(
        "undone",
        "Math.abs(window.kingpin.value('vehicle_state.target_speed_m_s') - 120 / 3.6) < 0.01",
    );
    page.fill("#snapshot-name", "before");
    page.click("#snapshot");
    page.until(
        "the snapshot",
        "document.querySelector('#tune-said').textContent.includes('saved as before')",
    );

    // Steer by keyboard: left is left, and the car turns.
    page.click("#tab-steer");
    page.click("#steer-take");
    page.until("the wheel", "window.kingpin.steer.on");
    let yaw = page.run(&format!("return {}", value("vehicle_state.yaw_rad"))).as_f64().unwrap();
    page.hold_key("\u{e012}", Duration::from_millis(1500));
    page.until(
        "the hand wheel to follow",
        &format!(
            "{} > 0.2 || {} > {yaw} + 0.01",
            value("rig_measurement.steering_wheel_angle_rad"),
            value("vehicle_state.yaw_rad")
        ),
    );
    page.picture(&pictures.join("5-steer.png"));
    page.until("the car to turn left", &format!("{} > {yaw} + 0.01", value("vehicle_state.yaw_rad")));
    page::steering_by_slider_and_gamepad(&page);
    page.click("#steer-take");

    // Trip, acknowledge, ready again.
    page.click("#estop");
    page.until("the trip", "window.kingpin.state() === 'tripped'");
    page.click("#tab-run");
    page.until("the reason", "document.querySelector('#trip').textContent.includes('emergency stop')");
    page.picture(&pictures.join("6-tripped.png"));
    page.click("[data-operate=release]");
    page.until("released", "!document.querySelector('[data-operate=acknowledge]').disabled");
    page.click("[data-operate=acknowledge]");
    page.until("idle again", "window.kingpin.state() === 'idle'");
    page.click("[data-operate=end]");
    page.until("the end", "window.kingpin.state() === 'no bench'");

    // Runs: the report, the replay with seek and speed.
    page.click("#tab-runs");
    page.until("the run in the list", "document.querySelectorAll('button.replay').length === 1 || (document.querySelector('#runs-again').click(), false)");
    page.until("its report", "!document.querySelector('#run-list a').hidden || (document.querySelector('#runs-again').click(), false)");
    page.picture(&pictures.join("7-runs.png"));
    page.click("button.replay");
    page.until("the replay", "!document.querySelector('#replaybar').hidden");
    page.run(
        "const r = document.querySelector('#replay-at'); r.value = 3; r.dispatchEvent(new Event('input'))",
    );
    page.until("the place", "Math.abs(+document.querySelector('#replay-at').value - 3) < 2.5");
    page.until("curves of the log", &format!("{trace}.n > 200"));
    page.run("const s = document.querySelector('#replay-speed'); s.value = '5'; s.dispatchEvent(new Event('change'))");
    page.until("time goes on", "+document.querySelector('#replay-at').value > 8");
    page.picture(&pictures.join("8-replay.png"));
    // The same on a tablet.
    page.size(1024, 768);
    for tab in ["run", "watch", "tune", "timing", "steer", "runs"] {
        page.click(&format!("#tab-{tab}"));
        std::thread::sleep(Duration::from_millis(400));
        let over =
            page.run("return document.documentElement.scrollWidth - document.documentElement.clientWidth");
        page.picture(&pictures.join(format!("tablet-{tab}.png")));
        assert_eq!(over, 0, "{tab} is wider than a tablet's screen");
    }
    page.size(1600, 1000);
    page.click("#replay-live");
    page::comparing(&page, &console, &pictures);
    let complaints = page.complaints();
    assert!(complaints.is_empty(), "the page's scripts complain: {complaints:?}");
    println!("pictures in {}", pictures.display());
}
