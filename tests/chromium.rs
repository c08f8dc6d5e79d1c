//! Headless Chromium.

#![allow(clippy::unwrap_used, clippy::missing_panics_doc, reason = "a test fails where anything is amiss")]

use crate::http::{Answer, exchange};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Upper limit of any wait on two busy cores, where software rendering takes seconds per frame.
const PATIENCE: Duration = Duration::from_secs(150);

/// Chromium with its driver, which implements the W3C WebDriver protocol.
pub struct Browser {
    driver: Child,
    address: SocketAddr,
    session: String,
    #[allow(dead_code, reason = "the profile lives as long as the browser")]
    profile: tempfile::TempDir,
}

impl Browser {
    /// `None` without Chromium.
    pub fn start() -> Option<Self> {
        Self::with(&["--disable-gpu"])
    }

    /// With WebGPU in software, which headless Chromium offers only on request. Its pictures appear on the page only if
    /// all rendering uses the same software.
    pub fn with_webgpu() -> Option<Self> {
        let software = ["--use-webgpu-adapter=swiftshader", "--use-angle=swiftshader", "--use-vulkan=swiftshader"];
        Self::with(&[&["--enable-unsafe-webgpu", "--enable-features=Vulkan"], &software[..]].concat())
    }

    fn with(drawing: &[&str]) -> Option<Self> {
        // The driver chooses and prints a free port, because a port found beforehand may be taken by another test.
        let driver = Command::new("chromedriver").arg("--port=0").stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut driver) = driver else {
            println!("skipped: no chromedriver");
            return None;
        };
        let mut lines = BufReader::new(driver.stdout.take().unwrap()).lines().map_while(Result::ok);
        let port = lines
            .find_map(|line| line.split_once("started successfully on port ")?.1.trim_end_matches('.').parse().ok());
        let port: u16 = port.expect("chromedriver says no port");
        // Keeps reading, so that further output does not block the driver.
        std::thread::spawn(move || lines.for_each(drop));
        let profile = tempfile::tempdir().unwrap();
        let address = SocketAddr::from(([127, 0, 0, 1], port));
        let mut browser = Self { driver, address, session: String::new(), profile };
        let data = format!("--user-data-dir={}", browser.profile.path().display());
        let args = [
            "--headless",
            "--no-sandbox",
            "--disable-quic",
            "--no-first-run",
            "--disable-dev-shm-usage",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--window-size=1360,940",
            &data,
        ];
        let args = [&args, drawing].concat();
        let wish = json!({ "capabilities": { "alwaysMatch": { "goog:chromeOptions": { "args": args }, "goog:loggingPrefs": { "browser": "SEVERE" } } } });
        let made = browser.call("POST", "", &wish);
        browser.session = format!("/{}", made["sessionId"].as_str().unwrap());
        let most = PATIENCE.as_millis();
        browser.call("POST", "/timeouts", &json!({ "script": most, "pageLoad": most }));
        Some(browser)
    }

    /// Sends a request of the protocol within this session.
    pub fn call(&self, method: &str, path: &str, body: &Value) -> Value {
        self.ask(method, path, body).expect(200).json()["value"].clone()
    }

    fn ask(&self, method: &str, path: &str, body: &Value) -> Answer {
        let path = format!("/session{}{path}", self.session);
        let body = if method == "POST" { body.to_string() } else { String::new() };
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{body}",
            self.address,
            body.len()
        );
        exchange(self.address, head.as_bytes(), PATIENCE)
    }

    /// Opens an address.
    pub fn open(&self, url: &str) {
        self.call("POST", "/url", &json!({ "url": url }));
    }

    /// Runs a script and returns its value.
    pub fn run(&self, script: &str) -> Value {
        self.call("POST", "/execute/sync", &json!({ "script": script, "args": [] }))
    }

    /// Waits until a script returns true.
    pub fn until(&self, script: &str) {
        let begun = Instant::now();
        while self.run(&format!("try {{ return Boolean({script}) }} catch {{ return false }}")) != true {
            if begun.elapsed() > PATIENCE {
                self.shot("failed");
                panic!("never true: {script}; the page says: {}", self.run("return document.body.innerText"));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Clicks as a person does: the element must exist and be reachable.
    pub fn click(&self, css: &str) {
        let begun = Instant::now();
        loop {
            self.until(&format!("document.querySelector('{css}') && !document.querySelector('{css}').disabled"));
            // Not under the head of the page, which stays where it is.
            self.run(&format!("document.querySelector('{css}')?.scrollIntoView({{ block: 'center' }})"));
            let found = self.ask("POST", "/element", &json!({ "using": "css selector", "value": css }));
            let clicked = match found.status {
                200 => self.ask("POST", &format!("/element/{}/click", reference(&found.json()["value"])), &json!({})),
                _ => found,
            };
            // The page may replace or move the element in the meantime.
            let moved = ["stale element reference", "no such element", "element click intercepted"].map(Value::from);
            if clicked.status != 200 && moved.contains(&clicked.json()["value"]["error"]) && begun.elapsed() < PATIENCE
            {
                continue;
            }
            clicked.expect(200);
            return;
        }
    }

    /// Reference of an element in the protocol.
    pub fn element(&self, css: &str) -> String {
        reference(&self.call("POST", "/element", &json!({ "using": "css selector", "value": css })))
    }

    /// Selects from a list.
    pub fn choose(&self, id: &str, value: &str) {
        self.run(&format!(
            "const list = document.querySelector('#{id}'); list.value = '{value}'; list.dispatchEvent(new Event('change', {{ bubbles: true }}));"
        ));
    }

    /// Types into fields, given by id and value.
    pub fn enter(&self, fields: &[(&str, &str)]) {
        for (id, value) in fields {
            self.run(&format!(
                "const e = document.getElementById('{id}'); e.value = '{value}'; e.dispatchEvent(new Event('input', {{ bubbles: true }}))"
            ));
        }
    }

    /// Opens the upload page for a kind of reconstruction.
    pub fn upload_page(&self, url: &str, method: &str) {
        self.open(&format!("{url}/#/upload"));
        self.until("document.querySelector('#photographs')");
        self.choose("method", method);
    }

    /// Sets the file of a file input.
    pub fn attach(&self, css: &str, file: &str) {
        self.call("POST", &format!("/element/{}/value", self.element(css)), &json!({ "text": file }));
    }

    /// Screenshot of an element as a PNG.
    pub fn element_shot(&self, css: &str) -> Vec<u8> {
        let text = self.call("GET", &format!("/element/{}/screenshot", self.element(css)), &Value::Null);
        decoded(text.as_str().unwrap())
    }

    /// Gives the page the width of a phone, or of the window again.
    pub fn phone(&self, narrow: bool) {
        let size = json!({ "width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": false });
        let (command, params) = match narrow {
            true => ("Emulation.setDeviceMetricsOverride", size),
            false => ("Emulation.clearDeviceMetricsOverride", json!({})),
        };
        self.call("POST", "/goog/cdp/execute", &json!({ "cmd": command, "params": params }));
    }

    /// Sets the download folder, without a prompt.
    pub fn downloads_to(&self, folder: &Path) {
        let params = json!({ "behavior": "allow", "downloadPath": folder });
        let command = json!({ "cmd": "Browser.setDownloadBehavior", "params": params });
        self.call("POST", "/goog/cdp/execute", &command);
    }

    /// Allows pages of an origin to read and write the clipboard.
    pub fn permit_clipboard(&self, origin: &str) {
        let permissions = json!(["clipboardReadWrite", "clipboardSanitizedWrite"]);
        let params = json!({ "origin": origin, "permissions": permissions });
        self.call("POST", "/goog/cdp/execute", &json!({ "cmd": "Browser.grantPermissions", "params": params }));
    }

    /// The downloaded file whose name has this end, once it is complete.
    pub fn downloaded(&self, folder: &Path, end: &str) -> PathBuf {
        let begun = Instant::now();
        loop {
            let files = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.path());
            if let Some(file) = files.into_iter().find(|f| f.to_string_lossy().ends_with(end)) {
                return file;
            }
            assert!(begun.elapsed() < PATIENCE, "no {end} came");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Saves a screenshot of the page in `target/screenshots`.
    pub fn shot(&self, name: &str) {
        let text = self.call("GET", "/screenshot", &Value::Null);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/screenshots");
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(format!("{name}.png")), decoded(text.as_str().unwrap())).unwrap();
    }

    /// Screenshots of the page in its light and dark theme.
    pub fn both(&self, name: &str) {
        for theme in ["light", "dark"] {
            let set = "document.documentElement.dataset.theme";
            if self.run(&format!(
                "return {set} || (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light')"
            )) != theme
            {
                self.run("document.querySelector('#theme').click()");
            }
            std::thread::sleep(Duration::from_millis(400));
            self.shot(&format!("{name}-{theme}"));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        if !self.session.is_empty() && !std::thread::panicking() {
            self.call("DELETE", "", &Value::Null);
        }
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// Decodes base64, as the driver sends pictures.
fn decoded(text: &str) -> Vec<u8> {
    let value = |c: u8| match c {
        b'A'..=b'Z' => c - b'A',
        b'a'..=b'z' => c - b'a' + 26,
        b'0'..=b'9' => c - b'0' + 52,
        b'+' => 62,
        _ => 63,
    };
    let clean: Vec<u8> = text.bytes().filter(|c| *c != b'=').map(value).collect();
    let four = |group: &[u8]| {
        let bits = group.iter().fold(0_u32, |sum, v| (sum << 6) | u32::from(*v)) << (6 * (4 - group.len()));
        bits.to_be_bytes()[1..group.len()].to_vec()
    };
    clean.chunks(4).flat_map(four).collect()
}

/// The reference in the protocol's description of an element.
fn reference(element: &Value) -> String {
    element.as_object().unwrap().values().next().unwrap().as_str().unwrap().to_owned()
}
