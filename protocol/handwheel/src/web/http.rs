//! As much of HTTP as the page needs: one request a connection, who may ask, and the files.

use std::io::{self, Read, Write};
use std::net::{IpAddr, TcpStream};
use std::time::{Duration, Instant};

/// The longest request, and how long it may take.
const LONGEST: usize = 8192;
const PATIENCE: Duration = Duration::from_secs(5);

/// What is served: path, type, content.
macro_rules! files {
    ($($path:literal $kind:ident $file:literal,)*) => {
        &[$(($path, $kind, include_str!(concat!("page/", $file)))),*]
    };
}
const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const FILES: &[(&str, &str, &str)] = files! {
    "/chart.js" SCRIPT "chart.js",
    "/curve.js" SCRIPT "curve.js",
    "/field.js" SCRIPT "field.js",
    "/files.js" SCRIPT "files.js",
    "/guard.js" SCRIPT "guard.js",
    "/" HTML "index.html",
    "/lcd.js" SCRIPT "lcd.js",
    "/link.js" SCRIPT "link.js",
    "/linkpage.js" SCRIPT "linkpage.js",
    "/main.js" SCRIPT "main.js",
    "/motors.js" SCRIPT "motors.js",
    "/others.js" SCRIPT "others.js",
    "/outputs.js" SCRIPT "outputs.js",
    "/samples.js" SCRIPT "samples.js",
    "/scene.js" SCRIPT "scene.js",
    "/selftune.js" SCRIPT "selftune.js",
    "/sensors.js" SCRIPT "sensors.js",
    "/settings.js" SCRIPT "settings.js",
    "/socket.js" SCRIPT "socket.js",
    "/strip.js" SCRIPT "strip.js",
    "/style.css" CSS "style.css",
    "/tune.js" SCRIPT "tune.js",
    "/ui.js" SCRIPT "ui.js",
    "/world.js" SCRIPT "world.js",
};

/// A request.
pub(super) struct Request {
    pub(super) path: String,
    /// Behind the question mark.
    query: String,
    host: Option<String>,
    origin: Option<String>,
    /// The key of a WebSocket's handshake, if that is asked for.
    pub(super) key: Option<String>,
}

/// Whom the server answers.
pub(super) struct Gate {
    /// Names besides loopback's and addresses.
    pub(super) names: Vec<String>,
    /// What must be known by those who ask for the page or its socket.
    pub(super) token: Option<String>,
}

/// An answer's status line, and a line for people.
type Refusal = (&'static str, &'static str);

impl Request {
    /// Reads one from a connection. `None` if it is none.
    pub(super) fn read(stream: &mut TcpStream) -> io::Result<Option<Self>> {
        let end = Instant::now() + PATIENCE;
        let mut bytes = Vec::new();
        loop {
            let mut buffer = [0; 1024];
            stream.set_read_timeout(Some(Duration::from_millis(200)))?;
            match stream.read(&mut buffer) {
                Ok(0) => return Ok(None),
                Ok(count) => bytes.extend_from_slice(buffer.get(..count).unwrap_or_default()),
                Err(error) if is_for_now(&error) => {}
                Err(error) => return Err(error),
            }
            match Self::parse(&bytes) {
                Ok(Some(request)) => return Ok(Some(request)),
                Ok(None) if bytes.len() < LONGEST && Instant::now() < end => {}
                _ => return Ok(None),
            }
        }
    }

    fn parse(bytes: &[u8]) -> Result<Option<Self>, httparse::Error> {
        let mut headers = [httparse::EMPTY_HEADER; 64];
        let mut request = httparse::Request::new(&mut headers);
        if request.parse(bytes)?.is_partial() {
            return Ok(None);
        }
        if request.method != Some("GET") {
            return Err(httparse::Error::Token);
        }
        let target = request.path.unwrap_or_default();
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let all = |name: &'static str| {
            let is_it =
                move |header: &&httparse::Header<'_>| header.name.eq_ignore_ascii_case(name);
            let values = request.headers.iter().filter(is_it);
            values.map(|header| String::from_utf8_lossy(header.value).trim().to_owned())
        };
        // Of two, nobody knows which counts.
        if all("host").count() > 1 || all("origin").count() > 1 {
            return Err(httparse::Error::HeaderName);
        }
        let upgrades = all("upgrade").any(|value| value.eq_ignore_ascii_case("websocket"));
        Ok(Some(Self {
            path: path.to_owned(),
            query: query.to_owned(),
            host: all("host").next(),
            origin: all("origin").next(),
            key: all("sec-websocket-key").next().filter(|_| upgrades),
        }))
    }
}

impl Gate {
    /// Whether a request may be answered: a browser on some other site's behalf may not. A name could be that
    /// site's, and lead here.
    pub(super) fn check(&self, request: &Request) -> Result<(), Refusal> {
        let host = request.host.as_deref().ok_or(("400 Bad Request", "no Host"))?;
        let name = name_of(host);
        let is_ours = name.parse::<IpAddr>().is_ok()
            || name.eq_ignore_ascii_case("localhost")
            || self.names.iter().any(|allowed| name.eq_ignore_ascii_case(allowed));
        if !is_ours {
            return Err((
                "403 Forbidden",
                "not for this Host: take the address, or --allow-host NAME",
            ));
        }
        let is_socket = request.path == "/socket";
        if is_socket {
            let origin = request.origin.as_deref().and_then(|origin| origin.split_once("://"));
            if origin.is_none_or(|(_, of)| !of.eq_ignore_ascii_case(host)) {
                return Err((
                    "403 Forbidden",
                    "the socket is for the page that this server serves",
                ));
            }
        }
        let is_known = |token: &String| {
            let given = request.query.split('&').find_map(|part| part.strip_prefix("token="));
            given.is_some_and(|given| is_same(given.as_bytes(), token.as_bytes()))
        };
        if (is_socket || request.path == "/") && !self.token.as_ref().is_none_or(is_known) {
            return Err((
                "403 Forbidden",
                "the token is wrong or missing: take the address as it was printed",
            ));
        }
        Ok(())
    }
}

/// A host without its port.
fn name_of(host: &str) -> &str {
    match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    }
}

/// Compares without telling by the time how much is right.
fn is_same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

/// Answers with a file, or says that there is none.
pub(super) fn answer(stream: &mut TcpStream, path: &str) -> io::Result<()> {
    match FILES.iter().find(|(name, ..)| *name == path) {
        Some((_, kind, content)) => send(stream, "200 OK", kind, content),
        None => refuse(stream, ("404 Not Found", "nothing here")),
    }
}

/// Says in one line why not.
pub(super) fn refuse(stream: &mut TcpStream, (status, why): Refusal) -> io::Result<()> {
    send(stream, status, "text/plain; charset=utf-8", &format!("{why}\n"))
}

fn send(stream: &mut TcpStream, status: &str, kind: &str, content: &str) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
         Content-Security-Policy: default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'\r\n\r\n",
        content.len()
    );
    stream.set_write_timeout(Some(PATIENCE))?;
    stream.write_all(head.as_bytes())?;
    stream.write_all(content.as_bytes())
}

/// Whether a read or a write has only found nothing yet.
pub(super) fn is_for_now(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(head: &str) -> Request {
        Request::parse(head.as_bytes()).unwrap().unwrap()
    }

    fn check(gate: &Gate, head: &str) -> Result<(), Refusal> {
        gate.check(&request(&format!("GET {head}\r\n\r\n")))
    }

    const OPEN: Gate = Gate { names: Vec::new(), token: None };

    #[test]
    fn the_page_is_for_addresses_loopback_and_allowed_names() {
        for host in
            ["127.0.0.1:5080", "localhost:5080", "[::1]:5080", "192.168.1.7:5080", "10.0.0.1"]
        {
            assert_eq!(check(&OPEN, &format!("/ HTTP/1.1\r\nHost: {host}")), Ok(()), "{host}");
        }
        for host in ["evil.example", "127.0.0.1.evil.example:5080", "localhost.evil.example", ""] {
            let refused = check(&OPEN, &format!("/ HTTP/1.1\r\nHost: {host}"));
            assert_eq!(refused.unwrap_err().0, "403 Forbidden", "{host}");
        }
        assert!(check(&OPEN, "/ HTTP/1.1").is_err());
        let named = Gate { names: vec!["robot.local".into()], token: None };
        assert_eq!(check(&named, "/ HTTP/1.1\r\nHost: Robot.local:5080"), Ok(()));
    }

    #[test]
    fn a_socket_is_for_the_page_of_the_same_host() {
        let ask = |origin: &str| {
            check(&OPEN, &format!("/socket HTTP/1.1\r\nHost: 127.0.0.1:5080{origin}"))
        };
        assert_eq!(ask("\r\nOrigin: http://127.0.0.1:5080"), Ok(()));
        for origin in [
            "",
            "\r\nOrigin: http://127.0.0.1:5081",
            "\r\nOrigin: http://evil.example",
            "\r\nOrigin: null",
        ] {
            assert!(ask(origin).is_err(), "{origin}");
        }
    }

    #[test]
    fn a_token_is_wanted_for_the_page_and_its_socket() {
        let gate = Gate { names: Vec::new(), token: Some("secret".into()) };
        let ask = |target: &str| {
            check(&gate, &format!("{target} HTTP/1.1\r\nHost: 10.0.0.1\r\nOrigin: http://10.0.0.1"))
        };
        for target in
            ["/?token=secret", "/socket?token=secret", "/socket?a=b&token=secret", "/main.js"]
        {
            assert_eq!(ask(target), Ok(()), "{target}");
        }
        for target in ["/", "/socket", "/?token=", "/?token=secre", "/socket?token=secrets"] {
            assert!(ask(target).is_err(), "{target}");
        }
    }

    #[test]
    fn what_is_doubtful_is_no_request() {
        for head in [
            "POST / HTTP/1.1\r\nHost: a\r\n\r\n",
            "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nHost: evil.example\r\n\r\n",
            "GET / HTTP/1.1\r\nOrigin: a\r\nOrigin: b\r\n\r\n",
            "\u{5e}\u{2}\r\n\r\n",
        ] {
            assert!(!matches!(Request::parse(head.as_bytes()), Ok(Some(_))), "{head}");
        }
        assert!(matches!(Request::parse(b"GET / HTTP/1.1\r\nHost: a"), Ok(None)));
    }
}
