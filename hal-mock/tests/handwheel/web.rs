//! The page's server over real sockets: whom it serves, and that who goes stops.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use handwheel::web::{Page, Serve, serve};
use serde_json::{Value, json};
use tungstenite::{Message, WebSocket};

use crate::program::{Board, PATIENCE};

/// A page that is open.
struct Tab(WebSocket<TcpStream>);

impl Tab {
    fn open(place: &str) -> Self {
        Self::ask(place, "/socket", &format!("http://{place}")).unwrap()
    }

    fn ask(place: &str, path: &str, origin: &str) -> Result<Self, String> {
        let stream = TcpStream::connect(place).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let request = tungstenite::http::Request::builder()
            .uri(format!("ws://{place}{path}"))
            .header("Host", place)
            .header("Origin", origin)
            .header("Connection", "Upgrade")
            .header("Upgrade", "websocket")
            .header("Sec-WebSocket-Version", "13")
            .header("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==");
        let (socket, _) = tungstenite::client(request.body(()).unwrap(), stream)
            .map_err(|error| error.to_string())?;
        Ok(Self(socket))
    }

    fn say(&mut self, what: &Value) {
        self.0.send(Message::text(what.to_string())).unwrap();
    }

    /// Reads until a message is wanted.
    fn until(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            assert!(begun.elapsed() < PATIENCE, "it never came");
            if let Message::Text(text) = self.0.read().unwrap() {
                let told: Value = serde_json::from_str(&text).unwrap();
                if wanted(&told) {
                    return told;
                }
            }
        }
    }

    fn connected(&mut self) {
        self.until(|told| told["tell"] == "board" && told["connected"] == true);
    }

    fn answer(&mut self, what: Value) -> Value {
        let mut what = what;
        what["id"] = 77.into();
        self.say(&what);
        self.until(|told| told["id"] == 77)
    }
}

/// The page of this board, by `handwheel web`'s server.
fn page_of(board: &Board, listen: &str) -> (Page, Arc<AtomicBool>) {
    let end = Arc::new(AtomicBool::new(false));
    let serving = Serve {
        listen: std::net::TcpListener::bind(listen).unwrap(),
        link: format!("tcp:{}", board.place("TCP")).parse().unwrap(),
        names: Vec::new(),
        world: None,
    };
    (serve(serving, end.clone()).unwrap(), end)
}

/// Host and port of a page's address.
fn place_of(address: &str) -> &str {
    address.split('/').nth(2).unwrap()
}

/// One request; the status line and all of the answer.
fn get(place: &str, head: &str) -> (String, String) {
    let mut stream = TcpStream::connect(place).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(head.as_bytes()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    (text.lines().next().unwrap_or_default().to_owned(), text)
}

fn is_driven(state: &Value) -> bool {
    state["motors"][0]["duty"].as_f64().unwrap().abs() > 0.01
}

#[test]
fn a_tab_that_goes_without_a_word_stops_its_motor() {
    let board = Board::start(&["--web", "127.0.0.1:0"]);
    let place = place_of(board.place("page"));
    let mut tab = Tab::open(place);
    tab.connected();
    // A machine that is held up may miss the 250 ms: then once more.
    for _ in 0..3 {
        tab.answer(json!({"do": "arm"}));
        tab.answer(json!({"do": "drive", "motor": 1, "velocity": 4000}));
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_millis(400) {
            tab.say(&json!({"do": "alive"}));
            std::thread::sleep(Duration::from_millis(20));
        }
        if is_driven(&board.state()) {
            break;
        }
    }
    assert!(is_driven(&board.state()));
    drop(tab);
    board.until(|state| !is_driven(state));
    // The page leaves the board's line when nobody looks.
    board.until(|state| state["host"]["tcp"] == 0);
}

#[test]
fn the_end_of_handwheel_stops_what_its_page_drives() {
    let board = Board::start(&[]);
    let (page, end) = page_of(&board, "127.0.0.1:0");
    let mut tab = Tab::open(place_of(&page.address));
    tab.connected();
    tab.answer(json!({"do": "arm"}));
    tab.answer(json!({"do": "drive", "motor": 1, "velocity": 4000}));
    end.store(true, Ordering::Relaxed);
    page.wait();
    board.until(|state| !is_driven(state));
}

#[test]
fn it_answers_its_own_page_alone() {
    let board = Board::start(&[]);
    let (page, _end) = page_of(&board, "127.0.0.1:0");
    let place = place_of(&page.address);
    let (status, text) = get(place, &format!("GET / HTTP/1.1\r\nHost: {place}\r\n\r\n"));
    assert!(status.contains("200") && text.contains("<html"), "{status}");
    assert!(text.contains("Content-Security-Policy: default-src 'self'"));
    for (head, wanted) in [
        ("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n", "403"),
        ("GET /socket HTTP/1.1\r\nHost: evil.example\r\n\r\n", "403"),
        ("GET /../Cargo.toml HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", "404"),
        ("POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", "400"),
        ("hello\r\n\r\n", "400"),
    ] {
        assert!(get(place, head).0.contains(wanted), "{head}");
    }
    assert!(Tab::ask(place, "/socket", "http://evil.example").is_err());
    assert!(Tab::ask(place, "/", &format!("http://{place}")).is_err());
    // What is far too long ends that page, and no other.
    let (mut bad, mut good) = (Tab::open(place), Tab::open(place));
    let _ = bad.0.send(Message::text("x".repeat(1 << 20)));
    while bad.0.read().is_ok() {}
    good.connected();
}

#[test]
fn off_loopback_a_token_is_wanted() {
    let board = Board::start(&[]);
    let (page, _end) = page_of(&board, "0.0.0.0:0");
    let (start, token) = page.address.split_once("/?token=").unwrap();
    assert_eq!(token.len(), 32);
    let place = format!("127.0.0.1:{}", start.rsplit(':').next().unwrap());
    let ask =
        |target: &str| get(&place, &format!("GET {target} HTTP/1.1\r\nHost: {place}\r\n\r\n")).0;
    assert!(ask("/").contains("403") && ask("/?token=0").contains("403"));
    assert!(ask(&format!("/?token={token}")).contains("200"));
    let origin = format!("http://{place}");
    assert!(Tab::ask(&place, "/socket", &origin).is_err());
    Tab::ask(&place, &format!("/socket?token={token}"), &origin).unwrap().connected();
}

#[test]
fn a_virtual_boards_page_has_a_world_and_a_boards_has_none() {
    let board = Board::start(&["--web", "127.0.0.1:0"]);
    let place = place_of(board.place("page"));
    let mut tab = Tab::open(place);
    let jam = json!([true, null, null, null, null, null]);
    let answer = tab.answer(json!({"do": "world", "set": {"jam": jam}}));
    assert_eq!(answer, json!({"id": 77, "ok": null}));
    tab.until(|told| told["tell"] == "world" && told["state"]["overridden"]["jam"] == jam);
    assert_eq!(board.state()["overridden"]["jam"], jam);
    let answer = tab.answer(json!({"do": "world", "set": {"jams": 1}}));
    assert!(answer["error"].as_str().unwrap().contains("jams"));
    let (page, _end) = page_of(&board, "127.0.0.1:0");
    let answer =
        Tab::open(place_of(&page.address)).answer(json!({"do": "world", "set": {"jam": jam}}));
    assert!(answer["error"].as_str().unwrap().contains("virtual board"));
}

#[test]
fn an_arm_and_a_cm5_show_joints_and_servos() {
    for (personality, wanted) in [("pioneer-arm", "joints"), ("cm5", "servos")] {
        let board = Board::start(&[personality, "--web", "127.0.0.1:0"]);
        let place = place_of(board.place("page"));
        let mut tab = Tab::open(place);
        tab.connected();
        let told = tab.until(|told| told["tell"] == wanted);
        assert_eq!(told[wanted].as_array().unwrap().len(), 6, "{told}");
        let refused = tab.answer(json!({"do": "arm"}));
        assert!(refused["error"].as_str().unwrap().contains("not driven"), "{refused}");
        let stopped = tab.answer(json!({"do": "stop"}));
        match personality {
            "cm5" => assert!(stopped["error"].as_str().unwrap().contains("no stop")),
            _ => assert_eq!(stopped["ok"]["confirmed"], true, "{stopped}"),
        }
    }
}
