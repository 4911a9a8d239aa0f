//! What the browser does on the page: draws, keeps layouts, steers by slider and gamepad, compares.

use super::*;

/// Time between the frames that the browser drew, by the stamps of its animation frames, over three seconds of watching.
pub fn frame_times(page: &browser::Browser) {
    page.run(
        "window.stamps = []; const draw = (t) => { window.stamps.push(t); if (window.stamps.length < 2000) requestAnimationFrame(draw); }; \
         requestAnimationFrame(draw)",
    );
    std::thread::sleep(Duration::from_secs(3));
    let found = page.run(
        "const s = window.stamps, d = s.slice(1).map((t, i) => t - s[i]).sort((a, b) => a - b); window.stamps.length = 2000; \
         return [d.length, d[Math.floor(.5 * (d.length - 1))], d[Math.floor(.95 * (d.length - 1))]]",
    );
    let number = |i: usize| found[i].as_f64().unwrap_or(f64::NAN);
    println!(
        "frames drawn by the browser in 3 s: {}; between frames p50 {:.1} ms, p95 {:.1} ms",
        number(0),
        number(1),
        number(2)
    );
    assert!(number(0) > 5.0, "the browser draws");
}

/// Signals are chosen, a layout saved, and both are there again after the page was loaded anew.
pub fn layouts_are_kept(page: &browser::Browser, address: &str) {
    let charts = "document.querySelectorAll('#charts .chart').length";
    let before = page.run(&format!("return {charts}")).as_u64().unwrap();
    let pick = |signal: &str| {
        page.run(&format!(
            "document.querySelector('#signal-chart').value = 'new'; const a = document.querySelector('#signal-add'); \
             a.value = '{signal}'; a.dispatchEvent(new Event('change'))"
        ))
    };
    pick("vehicle_state.roll_rad");
    page.until("the new chart", &format!("{charts} === {}", before + 1));
    pick("vehicle_state.no_such_signal");
    page.fill("#layout-name", "mine");
    page.click("#layout-save");
    page.until("the layout", "document.querySelector('#layouts').value === 'mine'");
    page.go(address);
    page.until("the token", "window.kingpin && window.kingpin.mayWrite()");
    page.click("#tab-watch");
    page.until("the charts again", &format!("{charts} === {}", before + 1));
    let choose = |name: &str| {
        page.run(&format!(
            "const l = document.querySelector('#layouts'); l.value = '{name}'; l.dispatchEvent(new Event('change'))"
        ))
    };
    choose("car");
    page.until("another layout", "document.querySelector('#charts').textContent.includes('side_slip_rad')");
    choose("mine");
    page.until(
        "one's own layout",
        "window.kingpin.traces.get('vehicle_state.roll_rad') && window.kingpin.traces.get('vehicle_state.roll_rad').n > 20",
    );
}

/// The hand wheel follows the slider to the left, a gamepad's stick to the right, and goes back when that is let go.
pub fn steering_by_slider_and_gamepad(page: &browser::Browser) {
    let angle = "window.kingpin.value('rig_measurement.steering_wheel_angle_rad')";
    page.until("the wheel at rest", &format!("Math.abs({angle}) < 0.12"));
    // Without centring the slider stays where it is left.
    page.click("#steer-centre");
    page.drag("#wheel-slider", -30, Duration::from_millis(300));
    page.until("a slider to the left", "+document.querySelector('#wheel-slider').value < -10");
    let asked = page.run("return window.kingpin.steer.wanted").as_f64().unwrap();
    assert!(asked > 0.1, "left is positive: {asked} rad");
    page.until("the wheel to follow the slider", &format!("Math.abs({angle} - {asked}) < 0.1"));
    page.click("#steer-centre");
    page.until("the wheel to centre", &format!("Math.abs({angle}) < 0.12"));
    // What the browser gives of a stick half to the right.
    page.run("navigator.getGamepads = () => [null, { connected: true, axes: [0.5, 0] }]");
    page.until("the wheel to follow the stick", &format!("{angle} < -1.2"));
    let held = page.run(&format!("return {angle}")).as_f64().unwrap();
    assert!(held > -2.0, "half the stick is half the range of 180 degrees: {held} rad");
    // Within the stick's dead zone.
    page.run("navigator.getGamepads = () => [null, { connected: true, axes: [0.03, 0] }]");
    page.until("the wheel to go back", &format!("Math.abs({angle}) < 0.12"));
    page.run("navigator.getGamepads = () => []");
}

/// Two runs chosen and compared, on the page and on the page to print.
pub fn comparing(page: &browser::Browser, console: &Console, pictures: &std::path::Path) {
    let runs = console.folder.path().join("runs");
    let first = std::fs::read_dir(&runs)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .find(|path| path.join("log.mcap").exists())
        .unwrap();
    let second = runs.join("the-same-again");
    std::fs::create_dir(&second).unwrap();
    for file in ["log.mcap", "summary.json"] {
        std::fs::copy(first.join(file), second.join(file)).unwrap();
    }
    page.click("#tab-runs");
    page.click("#runs-again");
    page.until("both runs", "document.querySelectorAll('#run-list input[type=checkbox]').length === 2");
    page.click("#compare");
    page.until(
        "what is missing",
        "document.querySelector('#compare-said').textContent === 'choose two runs'",
    );
    page.run("document.querySelectorAll('#run-list input[type=checkbox]').forEach((box) => box.click())");
    page.click("#compare");
    page.until("both curves", "document.querySelectorAll('#compare-plot .scatterlayer .trace').length === 2");
    page.picture(&pictures.join("9-compare.png"));
    let link = page.run("return document.querySelector('#compare-page').href");
    page.go(link.as_str().unwrap());
    page.until("the comparison", "+document.body.dataset.drawn > 15");
    let apart = page.run("return document.querySelector('#apart table').textContent");
    assert!(apart.as_str().unwrap().contains("0.0000"), "a run is like its copy: {apart}");
    page.picture(&pictures.join("10-comparison-page.png"));
}
