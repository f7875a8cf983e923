//! A Chromium of its own, through chromedriver: what a person does with keys and a mouse, and sees.
//!
//! What is named by a CSS selector is waited for. Whatever goes wrong is a panic at the caller's line.

use std::fmt::Display;
use std::io::{BufRead, BufReader, copy, sink};
use std::os::unix::fs::MetadataExt;
use std::process::{Child, Command, Stdio};

use fantoccini::actions::{InputSource, KeyAction, KeyActions};
use fantoccini::elements::Element;
use fantoccini::error::{CmdError, ErrorStatus};
use fantoccini::wd::{WebDriverCompatibleCommand, WindowHandle};
use fantoccini::{Client, ClientBuilder, Locator};
use http::Method;
use hyper_util::client::legacy::connect::HttpConnector;
use serde_json::{Map, Value, json};
use tokio::runtime::{Builder, Runtime};
use url::{ParseError, Url};

use crate::{GLANCE, PATIENCE, until};

/// In CSS pixels.
const SIZE: (u32, u32) = (1280, 720);

/// See the [module](self).
pub struct Browser {
    runtime: Runtime,
    client: Client,
    /// Last: it ends after Chromium.
    _driver: Driver,
}

struct Driver(Child);

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A command of chromedriver's own.
#[derive(Debug)]
struct Own {
    path: &'static str,
    body: Value,
}

impl WebDriverCompatibleCommand for Own {
    fn endpoint(&self, base: &Url, session: Option<&str>) -> Result<Url, ParseError> {
        base.join(&format!("session/{}/{}", session.unwrap_or_default(), self.path))
    }

    fn method_and_body(&self, _: &Url) -> (Method, Option<String>) {
        (Method::POST, Some(self.body.to_string()))
    }
}

impl Browser {
    /// Starts it, with an empty tab.
    pub fn start() -> Self {
        let mut driver = Command::new("chromedriver")
            .args(["--port=0", "--log-level=SEVERE"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver: run .ci/chromium");
        let mut out = BufReader::new(driver.stdout.take().unwrap());
        let driver = Driver(driver);
        let port = loop {
            let mut line = String::new();
            assert!(out.read_line(&mut line).unwrap() > 0, "chromedriver has ended at its start");
            if let Some((_, port)) = line.trim_end_matches(['.', '\n']).split_once("on port ")
                && line.contains("successfully")
            {
                break port.to_owned();
            }
        };
        std::thread::spawn(move || copy(&mut out, &mut sink()));

        let mut arguments = vec!["--headless=new".to_owned()];
        arguments.push(format!("--window-size={},{}", SIZE.0, SIZE.1));
        // Root has no sandbox; a container's /dev/shm is small.
        if std::fs::metadata("/proc/self").is_ok_and(|process| process.uid() == 0) {
            arguments.extend(["--no-sandbox", "--disable-dev-shm-usage"].map(str::to_owned));
        }
        let wanted = Map::from_iter([
            ("goog:chromeOptions".to_owned(), json!({ "args": arguments })),
            ("goog:loggingPrefs".to_owned(), json!({ "browser": "ALL" })),
        ]);
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let address = format!("http://127.0.0.1:{port}");
        let mut builder = ClientBuilder::new(HttpConnector::new());
        let client = runtime
            .block_on(builder.capabilities(wanted).connect(&address))
            .expect("Chromium starts");
        Self { runtime, client, _driver: driver }
    }

    #[track_caller]
    fn run<T>(&self, what: impl Display, future: impl Future<Output = Result<T, CmdError>>) -> T {
        let limited = async { tokio::time::timeout(2 * PATIENCE, future).await };
        match self.runtime.block_on(limited) {
            Ok(Ok(value)) => value,
            Ok(Err(error)) => panic!("{what}: {error}"),
            Err(_) => panic!("{what}: Chromium does not answer"),
        }
    }

    #[track_caller]
    fn own(&self, path: &'static str, body: Value) -> Value {
        self.run(path, self.client.issue_cmd(Own { path, body }))
    }

    #[track_caller]
    fn devtools(&self, command: &str, parameters: Value) {
        self.own("goog/cdp/execute", json!({ "cmd": command, "params": parameters }));
    }

    /// Opens an address in this tab.
    #[track_caller]
    pub fn open(&self, address: &str) {
        let screen =
            json!({ "width": SIZE.0, "height": SIZE.1, "deviceScaleFactor": 1, "mobile": false });
        self.devtools("Emulation.setDeviceMetricsOverride", screen);
        if let Some(file) = std::env::var_os("SABOTAGE") {
            let source = std::fs::read_to_string(file).expect("SABOTAGE");
            self.devtools("Page.addScriptToEvaluateOnNewDocument", json!({ "source": source }));
        }
        self.run(address, self.client.goto(address));
    }

    /// What a dark or a light desktop makes of the page.
    #[track_caller]
    pub fn prefers(&self, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.devtools("Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// This window.
    #[track_caller]
    pub fn window(&self) -> WindowHandle {
        self.run("this window", self.client.window())
    }

    /// A new window, which is used from now on; the one before stays in view.
    #[track_caller]
    pub fn new_window(&self) {
        let made = self.run("a new window", self.client.new_window(false));
        self.switch_to(&made.handle);
    }

    /// A new tab in this window, which hides the one that was in view, and is used from now on.
    #[track_caller]
    pub fn new_tab(&self) {
        let made = self.run("a new tab", self.client.new_window(true));
        self.switch_to(&made.handle);
    }

    /// Uses this window, or tab, from now on.
    #[track_caller]
    pub fn switch_to(&self, window: &WindowHandle) {
        self.run("that window", self.client.switch_to_window(window.clone()));
    }

    /// Closes this window.
    #[track_caller]
    pub fn close_window(&self) {
        self.run("closing", self.client.close_window());
    }

    #[track_caller]
    fn element(&self, selector: &str) -> Element {
        let wait = self.client.wait().at_most(PATIENCE).every(GLANCE);
        self.run(selector, wait.for_element(Locator::Css(selector)))
    }

    /// Clicks on the middle of it, once it is in view.
    #[track_caller]
    pub fn click(&self, selector: &str) {
        let element = self.element(selector);
        until(&format!("{selector} in view"), || {
            let click = async {
                match element.click().await {
                    Ok(()) => Ok(Some(())),
                    Err(CmdError::Standard(error))
                        if error.error == ErrorStatus::ElementNotInteractable =>
                    {
                        Ok(None)
                    }
                    Err(error) => Err(error),
                }
            };
            self.run(selector, click)
        });
    }

    /// Types behind what an input holds.
    #[track_caller]
    pub fn type_into(&self, selector: &str, text: &str) {
        let element = self.element(selector);
        self.run(selector, element.send_keys(text));
    }

    /// Types in place of what an input holds.
    #[track_caller]
    pub fn enter(&self, selector: &str, text: &str) {
        self.js(
            "const it = document.querySelector(arguments[0]); it.focus(); it.select();",
            &[json!(selector)],
        );
        self.type_into(selector, text);
    }

    /// Presses a key and lets it go, whatever has the focus.
    #[track_caller]
    pub fn press(&self, value: char) {
        let keys = KeyActions::new("keys".to_owned())
            .then(KeyAction::Down { value })
            .then(KeyAction::Up { value });
        self.run("a key", self.client.perform_actions(keys));
    }

    /// What a script returns; an error of its own is a panic.
    #[track_caller]
    pub fn js(&self, script: &str, arguments: &[Value]) -> Value {
        self.run(script, self.client.execute(script, arguments.to_vec()))
    }

    /// What an async function's body returns.
    #[track_caller]
    pub fn js_async(&self, body: &str) -> Value {
        let script = format!(
            "const done = arguments[arguments.length - 1];
             (async () => {{ {body} }})().then((ok) => done([ok ?? null]), (error) => done(String(error)));"
        );
        match self.run(body, self.client.execute_async(&script, Vec::new())) {
            Value::Array(mut ok) => ok.remove(0),
            error => panic!("{body}: {error}"),
        }
    }

    /// A property of what the selector names, or null.
    #[track_caller]
    pub fn property(&self, selector: &str, name: &str) -> Value {
        let script = "return document.querySelector(arguments[0])?.[arguments[1]] ?? null;";
        self.js(script, &[json!(selector), json!(name)])
    }

    /// An attribute of what the selector names, or "".
    #[track_caller]
    pub fn attribute(&self, selector: &str, name: &str) -> String {
        let script = "return document.querySelector(arguments[0])?.getAttribute(arguments[1]);";
        self.js(script, &[json!(selector), json!(name)]).as_str().unwrap_or_default().to_owned()
    }

    /// The text of what the selector names, or "".
    #[track_caller]
    pub fn text(&self, selector: &str) -> String {
        self.property(selector, "textContent").as_str().unwrap_or_default().to_owned()
    }

    /// How many the selector names.
    #[track_caller]
    pub fn count(&self, selector: &str) -> u64 {
        let script = "return document.querySelectorAll(arguments[0]).length;";
        self.js(script, &[json!(selector)]).as_u64().unwrap()
    }

    /// A PNG of what is in view.
    #[track_caller]
    pub fn screenshot(&self) -> Vec<u8> {
        self.run("a screenshot", self.client.screenshot())
    }

    /// What went wrong in scripts since this was asked last.
    #[track_caller]
    pub fn errors(&self) -> Vec<String> {
        let log = self.own("se/log", json!({ "type": "browser" }));
        let entries = log.as_array().unwrap().iter();
        entries.filter(|entry| entry["level"] == "SEVERE").map(Value::to_string).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let close = self.client.clone().close();
        // It may have ended with its last window.
        let _ = self.runtime.block_on(async { tokio::time::timeout(PATIENCE, close).await });
    }
}
