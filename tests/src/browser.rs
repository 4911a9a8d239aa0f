//! A real browser: headless Chromium through chromedriver, over the WebDriver protocol (W3C), by plain HTTP.

use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A browser with one page.
pub struct Browser {
    driver: Child,
    port: u16,
    session: String,
    _profile: tempfile::TempDir,
}

/// Whether a program can be started.
fn found(program: &str) -> bool {
    Command::new(program)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Starts a browser. `None`, with what is missing said by name, when there is none; with `CI=true` that is a
/// failure.
///
/// # Panics
/// With `CI=true` when it is missing; when the driver does not do what it should.
#[allow(clippy::panic, clippy::print_stdout, clippy::expect_used)]
pub fn start(width: u32, height: u32) -> Option<Browser> {
    for program in ["chromedriver", "chromium"] {
        if !found(program) {
            if std::env::var("CI").is_ok_and(|ci| ci == "true") {
                panic!("{program} is missing (Debian: chromium, chromium-driver)");
            }
            println!("SKIPPED: {program} is missing (Debian: chromium, chromium-driver)");
            return None;
        }
    }
    let mut driver = Command::new("chromedriver")
        .args(["--port=0"])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("chromedriver");
    let mut lines = BufReader::new(driver.stdout.take().expect("its output")).lines();
    let port = loop {
        let line = lines.next().expect("chromedriver says its port").expect("a line");
        if let Some(rest) = line.split("started successfully on port ").nth(1) {
            break rest.trim_end_matches('.').trim().parse().expect("a port");
        }
    };
    let profile = tempfile::tempdir().expect("a directory");
    let mut browser = Browser { driver, port, session: String::new(), _profile: profile };
    let options = json!({"capabilities": {"alwaysMatch": {"goog:chromeOptions": {"args": [
        "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-quic",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
        format!("--window-size={width},{height}"),
        format!("--user-data-dir={}", browser._profile.path().display()),
    ]}, "goog:loggingPrefs": {"browser": "ALL"}}}});
    let session = browser.call("POST", "/session", Some(&options));
    browser.session = session["sessionId"].as_str().expect("a session").to_owned();
    Some(browser)
}

impl Browser {
    #[allow(clippy::panic, clippy::expect_used)]
    fn call(&self, method: &str, path: &str, body: Option<&Value>) -> Value {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).expect("chromedriver listens");
        stream.set_read_timeout(Some(Duration::from_secs(120))).expect("a time limit");
        let body = body.map(Value::to_string).unwrap_or_default();
        let request = format!(
            "{method} {path} HTTP/1.1\r\nHost: localhost:{}\r\nContent-Type: application/json\r\n\
             Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
            self.port,
            body.len()
        );
        stream.write_all(request.as_bytes()).expect("sent");
        let mut reader = BufReader::new(stream);
        let mut length = None;
        loop {
            let mut line = String::new();
            reader.read_line(&mut line).expect("an answer");
            if let Some(value) = line.to_ascii_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse::<usize>().ok();
            }
            if line.trim().is_empty() {
                break;
            }
        }
        let mut bytes = vec![0; length.expect("a length")];
        reader.read_exact(&mut bytes).expect("the answer");
        let mut answer: Value = serde_json::from_slice(&bytes).expect("JSON");
        let value = answer["value"].take();
        if let Some(error) = value["error"].as_str() {
            panic!("{method} {path}: {error}: {}", value["message"]);
        }
        value
    }

    fn of(&self, path: &str) -> String {
        format!("/session/{}{path}", self.session)
    }

    /// Goes to an address.
    pub fn go(&self, url: &str) {
        self.call("POST", &self.of("/url"), Some(&json!({ "url": url })));
    }

    /// Runs a script in the page: its value.
    pub fn run(&self, script: &str) -> Value {
        self.call("POST", &self.of("/execute/sync"), Some(&json!({"script": script, "args": []})))
    }

    /// Waits until an expression in the page is true.
    ///
    /// # Panics
    /// When it does not become true in time.
    #[allow(clippy::panic)]
    pub fn until(&self, what: &str, expression: &str) {
        let begin = Instant::now();
        while self.run(&format!("return !!({expression})")) != json!(true) {
            if begin.elapsed() > Duration::from_secs(90) {
                let state = self.run("return [document.querySelector('#state')?.textContent, document.querySelector('#banner')?.textContent, document.querySelector('#events')?.innerText]");
                panic!("waited in vain for {what}: {expression}; page: {state}");
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    fn element(&self, selector: &str) -> String {
        let found = self.call(
            "POST",
            &self.of("/element"),
            Some(&json!({"using": "css selector", "value": selector})),
        );
        found
            .as_object()
            .and_then(|o| o.values().next())
            .and_then(Value::as_str)
            .unwrap_or_default()
            .to_owned()
    }

    /// Clicks as a user does: what is hidden, covered or disabled cannot be clicked.
    pub fn click(&self, selector: &str) {
        let element = self.element(selector);
        // Away from the page's head, which stays on top when the page is scrolled.
        self.run(&format!("document.querySelector({}).scrollIntoView({{block: 'center'}})", json!(selector)));
        self.call("POST", &self.of(&format!("/element/{element}/click")), Some(&json!({})));
    }

    /// Types into an input, in place of what is in it, and leaves it with Enter.
    pub fn fill(&self, selector: &str, text: &str) {
        let element = self.element(selector);
        self.call("POST", &self.of(&format!("/element/{element}/clear")), Some(&json!({})));
        let keys = json!({ "text": format!("{text}\u{e007}") });
        self.call("POST", &self.of(&format!("/element/{element}/value")), Some(&keys));
    }

    /// Holds a key (WebDriver's code, such as `\u{e012}` for the left arrow) for a time.
    pub fn hold_key(&self, key: &str, time: Duration) {
        let actions = json!({"actions": [{"type": "key", "id": "keyboard", "actions": [
            {"type": "keyDown", "value": key}, {"type": "pause", "duration": time.as_millis() as u64},
            {"type": "keyUp", "value": key}]}]});
        self.call("POST", &self.of("/actions"), Some(&actions));
    }

    /// Presses at the middle of an element, moves to the side by so many pixels, stays there for a time, lets go.
    pub fn drag(&self, selector: &str, right_px: i32, time: Duration) {
        let element = json!({"element-6066-11e4-a52e-4f735466cecf": self.element(selector)});
        let actions = json!({"actions": [{"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": [
            {"type": "pointerMove", "duration": 0, "origin": element, "x": 0, "y": 0},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerMove", "duration": 200, "origin": "pointer", "x": right_px, "y": 0},
            {"type": "pause", "duration": time.as_millis() as u64},
            {"type": "pointerUp", "button": 0}]}]});
        self.run(&format!("document.querySelector({}).scrollIntoView({{block: 'center'}})", json!(selector)));
        self.call("POST", &self.of("/actions"), Some(&actions));
    }

    /// Makes the window another size.
    pub fn size(&self, width: u32, height: u32) {
        self.call("POST", &self.of("/window/rect"), Some(&json!({ "width": width, "height": height })));
    }

    /// Takes a picture of the page.
    ///
    /// # Panics
    /// When it cannot be written.
    #[allow(clippy::expect_used)]
    pub fn picture(&self, path: &Path) {
        let picture = self.call("GET", &self.of("/screenshot"), None);
        let bytes = base64(picture.as_str().unwrap_or_default());
        std::fs::write(path, bytes).expect("the picture is written");
    }

    /// What the page's scripts complained about.
    pub fn complaints(&self) -> Vec<String> {
        let log = self.call("POST", &self.of("/se/log"), Some(&json!({"type": "browser"})));
        log.as_array()
            .into_iter()
            .flatten()
            .filter(|entry| entry["level"] == "SEVERE")
            .map(|entry| entry["message"].as_str().unwrap_or_default().to_owned())
            .collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        if !self.session.is_empty() && !std::thread::panicking() {
            self.call("DELETE", &self.of(""), None);
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// Base64 (RFC 4648) to bytes.
fn base64(text: &str) -> Vec<u8> {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let digits: Vec<u32> =
        text.bytes().filter_map(|b| DIGITS.iter().position(|d| *d == b)).map(|at| at as u32).collect();
    let mut bytes = Vec::with_capacity(digits.len() * 3 / 4);
    for four in digits.chunks(4) {
        let word = four.iter().fold(0, |word, digit| word << 6 | digit) << (6 * (4 - four.len()));
        bytes.extend(&word.to_be_bytes()[1..four.len()]);
    }
    bytes
}
