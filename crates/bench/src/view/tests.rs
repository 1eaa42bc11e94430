//! Tests of requests that a hostile page or program on the same computer may send, and of the responses to
//! the page.

use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use microsig_core::render::Context;
use serde_json::Value;
use tokio::net::TcpListener;
use tokio::runtime::Runtime;

use super::server::accept;
use super::state::App;
use super::subject::Subject;
use arena::report;
use generator::runner::{GenerateOptions, generate};
use scenario;
use scoring::evaluate::{EvaluateOptions, evaluate_files};
use storage::Progress;

const SCENARIO: &str = r#"(
    name: "small",
    optics: (pixel_dim_x: 64, pixel_dim_y: 48),
    motion: flow(field: poiseuille(max_speed_um_s: 400)),
    particles: (number: count(6)),
    calibration: none,
    timing: pairs(count: 2, dt_s: 0.005),
)"#;

/// A server that runs until it is dropped.
struct Server {
    app: Arc<App>,
    _runtime: Runtime,
}

struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Server {
    fn of(subject: Subject) -> Self {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .max_blocking_threads(6)
            .enable_all()
            .build()
            .unwrap();
        let listener = runtime.block_on(TcpListener::bind((Ipv4Addr::LOCALHOST, 0))).unwrap();
        let app = Arc::new(App::new(subject, listener.local_addr().unwrap().port()).unwrap());
        runtime.spawn(accept(listener, Arc::clone(&app)));
        Server { app, _runtime: runtime }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, self.app.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// Sends bytes unchanged and reads to the end.
    fn raw(&self, request: &[u8]) -> Option<Answer> {
        let mut stream = self.connect();
        // The server may refuse before it has read all.
        let _ = stream.write_all(request);
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer);
        let end = answer.windows(4).position(|four| four == b"\r\n\r\n")?;
        let head = String::from_utf8_lossy(&answer[..end]).into_owned();
        let status = head.split(' ').nth(1)?.parse().ok()?;
        Some(Answer { status, head, body: answer[end + 4..].to_vec() })
    }

    fn send(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        let port = self.app.port;
        let host =
            if headers.contains("Host:") { String::new() } else { format!("Host: 127.0.0.1:{port}\r\n") };
        let length = body.len();
        let request = format!(
            "{method} {path} HTTP/1.1\r\n{host}{headers}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        );
        self.raw(request.as_bytes()).unwrap()
    }

    /// Sends a request as the page does.
    fn get(&self, path: &str) -> Answer {
        self.send("GET", &self.path(path), "", "")
    }

    fn path(&self, path: &str) -> String {
        format!("/{}/{path}", self.app.token)
    }

    fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        serde_json::from_slice(&answer.unchunked()).unwrap()
    }

    /// Whether the server still responds.
    fn is_alive(&self) -> bool {
        self.get("about").status == 200
    }
}

impl Answer {
    /// The body without the lengths of its chunks.
    fn unchunked(&self) -> Vec<u8> {
        if !self.head.to_ascii_lowercase().contains("transfer-encoding: chunked") {
            return self.body.clone();
        }
        let (mut rest, mut whole) = (self.body.as_slice(), Vec::new());
        while let Some(end) = rest.windows(2).position(|two| two == b"\r\n") {
            let size = std::str::from_utf8(&rest[..end]).unwrap();
            let length = usize::from_str_radix(size, 16).unwrap();
            whole.extend(&rest[end + 2..][..length]);
            rest = &rest[end + 2 + length + 2..];
            if length == 0 {
                break;
            }
        }
        whole
    }
}

fn dataset(folder: &Path) -> std::path::PathBuf {
    let scenario =
        scenario::load_text(SCENARIO, ("small.ron", folder), &[], None, &Context::default()).unwrap();
    let out = folder.join("small");
    generate(
        &scenario,
        &GenerateOptions { out: out.clone(), force: false, resume: false, progress: Progress::default() },
    )
    .unwrap();
    out
}

#[test]
fn strangers_are_refused() {
    let server = Server::of(Subject::default());
    assert_eq!(server.get("").status, 200);
    let token = server.app.token.to_owned();
    let port = server.app.port;
    let page = format!("/{token}/");
    let refused = |path: &str, headers: &str| server.send("GET", path, headers, "").status;
    // Without the token, or with a wrong token.
    for path in [
        "/",
        "/about",
        "/page/app.js",
        &format!("/{}/about", "0".repeat(32)),
        &format!("/{}/about", &token[1..]),
    ] {
        assert_eq!(refused(path, ""), 403, "{path}");
    }
    // Another name for this machine, as used in DNS rebinding.
    let hosts = ["evil.example", "127.0.0.1:1", "127.0.0.1", "", "[::1]"].map(str::to_owned);
    for host in hosts
        .into_iter()
        .chain(["evil.example:", "[::1]:", "127.0.0.1.evil.example:"].map(|of| format!("{of}{port}")))
    {
        assert_eq!(refused(&page, &format!("Host: {host}\r\n")), 403, "{host}");
    }
    assert_eq!(refused(&page, &format!("Host: localhost:{port}\r\n")), 200);
    // Another page's request.
    for origin in ["http://evil.example", "null", "http://127.0.0.1:1", &format!("https://127.0.0.1:{port}")]
    {
        assert_eq!(refused(&page, &format!("Origin: {origin}\r\n")), 403, "{origin}");
    }
    assert_eq!(
        server.send("POST", &format!("{page}scenario"), "Origin: http://evil.example\r\n", "x").status,
        403
    );
    // Two hosts, and no host.
    let two = format!(
        "GET {page} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nHost: evil.example\r\nConnection: close\r\n\r\n"
    );
    assert!((400..500).contains(&server.raw(two.as_bytes()).unwrap().status));
    let none = format!("GET {page} HTTP/1.1\r\nConnection: close\r\n\r\n");
    assert!((400..500).contains(&server.raw(none.as_bytes()).unwrap().status));
    assert!(server.is_alive());
}

#[test]
fn answers_forbid_what_the_page_does_not_need() {
    let server = Server::of(Subject::default());
    let head = server.get("").head.to_ascii_lowercase();
    for header in [
        "content-security-policy: default-src 'none'",
        "referrer-policy: no-referrer",
        "x-frame-options: deny",
        "cache-control: no-store",
        "x-content-type-options: nosniff",
    ] {
        assert!(head.contains(header), "{header}: {head}");
    }
}

#[test]
fn no_path_leads_out_of_the_lists() {
    let folder = tempfile::tempdir().unwrap();
    let server = Server::of(Subject::of(Some(&dataset(folder.path())), &[]).unwrap());
    assert_eq!(server.get("dataset/0").status, 200);
    for path in [
        "page/../../../../etc/passwd",
        "page/..%2f..%2f..%2f..%2fetc%2fpasswd",
        "page/%2e%2e/%2e%2e/etc/passwd",
        "page//etc/passwd",
        "page/%00",
        "page/app.js%00.html",
        "../about/../../etc/passwd",
        "dataset/1",
        "dataset/-1",
        "dataset/0x0",
        "dataset/99999999999999999999999",
        "dataset/0/frame/4",
        "dataset/0/frame/..%2fdatapackage.json",
        "dataset/0/result/0",
        "dataset/..%2f..",
        "nothing",
        "%ff%fe",
    ] {
        let status = server.get(path).status;
        assert!((400..500).contains(&status), "{path}: {status}");
    }
    assert_eq!(server.json("keys/optics..gain"), Value::Null);
    assert_eq!(server.json("keys/..%2f.."), Value::Null);
    // Rows and frames that do not exist yield no particles, not errors.
    assert_eq!(server.json("dataset/0/truth/4000000")["n"], 0);
    assert_eq!(server.json("dataset/0/particle/0/99999"), Value::Null);
    assert!(server.is_alive());
}

#[test]
fn too_much_is_refused() {
    let server = Server::of(Subject::default());
    let large = "(".repeat((1 << 20) + 1);
    for path in ["preview", "scenario"] {
        assert_eq!(server.send("POST", &server.path(path), "", &large).status, 413, "{path}");
    }
    assert!(server.is_alive());
}

#[test]
fn frames_and_truth_are_those_of_the_dataset() {
    let folder = tempfile::tempdir().unwrap();
    let out = dataset(folder.path());
    let server = Server::of(Subject::of(Some(&out), &[]).unwrap());
    let about = server.json("dataset/0");
    assert_eq!(
        (about["width"].as_u64(), about["frames"].as_u64(), about["are_pairs"].as_bool()),
        (Some(64), Some(4), Some(true))
    );
    let frame = server.get("dataset/0/frame/3");
    let image = std::fs::read(out.join("images/pair_00001_b.tif")).unwrap();
    assert_eq!(frame.body.len(), 2 * 64 * 48);
    assert!(
        image.windows(frame.body.len()).any(|part| part == frame.body.as_slice()),
        "counts as in the file"
    );
    let truth = server.json("dataset/0/truth/2");
    let table = std::fs::read_to_string(out.join("truth/tracks.csv")).unwrap();
    let rows: Vec<&str> = table.lines().skip(1).filter(|line| line.starts_with("2,")).collect();
    assert_eq!(truth["n"].as_u64(), Some(rows.len() as u64));
    let cell: Value = serde_json::from_str(rows[1].split(',').nth(3).unwrap()).unwrap();
    assert_eq!(truth["columns"]["x_px"][1], cell);
    let crop = server.json("dataset/0/particle/2/1");
    assert!(
        crop["counts"].as_array().unwrap().len() as u64
            == crop["width"].as_u64().unwrap() * crop["height"].as_u64().unwrap()
    );
    assert_eq!(server.json("dataset/0/depth")["z_um"].as_array().unwrap().len(), 51);
    assert!(server.json("dataset/0/field/0")["n"].as_u64().unwrap() > 0);
}

#[test]
fn scores_are_those_of_evaluate() {
    let folder = tempfile::tempdir().unwrap();
    let out = dataset(folder.path());
    // Every third true particle is missed, the others are off by up to half a pixel, and some points are
    // ghosts.
    let table = std::fs::read_to_string(out.join("truth/tracks.csv")).unwrap();
    let mut result = "frame,track,x_px,y_px,z_um\n".to_owned();
    for (k, line) in table.lines().skip(1).enumerate().filter(|(k, _)| k % 3 != 0) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |k: usize| cells[k].parse::<f64>().unwrap();
        let off = 0.5 * (k % 5) as f64 / 4.0;
        // Some tracks continue under another number in the second frame of their pair.
        let track = number(2) + if number(0) % 2.0 == 1.0 && k % 2 == 0 { 1000.0 } else { 0.0 };
        let at = [number(3) + off, number(4), number(5) - 2.0 * off];
        result += &format!("{},{track},{},{},{}\n", cells[0], at[0], at[1], at[2]);
        result += &format!("{},-1,{},{},0\n", cells[0], (7 * k) % 64, (11 * k) % 48);
    }
    let path = folder.path().join("mine.csv");
    std::fs::write(&path, result).unwrap();
    let server = Server::of(Subject::of(Some(&out), std::slice::from_ref(&path)).unwrap());
    let expected: Value = serde_json::from_str(
        &report::json(&evaluate_files(&out, &path, &EvaluateOptions::default()).unwrap().score).unwrap(),
    )
    .unwrap();
    let about = server.json("dataset/0/result/0");
    assert_eq!(about["score"], expected);
    assert_eq!(server.json("dataset/0/result/0/score"), expected);
    // The points of all frames add up to the counts of the score.
    let (mut kinds, mut switches) = ([0u64; 3], 0);
    for frame in 0..4 {
        let points = server.json(&format!("dataset/0/result/0/frame/{frame}"));
        points["kind"]
            .as_array()
            .unwrap()
            .iter()
            .for_each(|kind| kinds[kind.as_u64().unwrap() as usize] += 1);
        switches += points["is_switch"].as_array().unwrap().iter().filter(|s| s.as_u64() == Some(1)).count();
    }
    let count = |name: &str| expected["detection"][name].as_u64().unwrap();
    assert_eq!(kinds, [count("tp"), count("fn"), count("fp")]);
    assert_eq!(switches as u64, expected["clear"]["id_switches"].as_u64().unwrap());
    assert!(kinds.iter().all(|n| *n > 0), "{kinds:?}");
    let worst = server.json("dataset/0/result/0/worst?kind=0&by=0");
    assert_eq!(worst["of"].as_u64(), Some(kinds[0]));
    let dx = worst["columns"]["dx_px"].as_array().unwrap();
    let first = dx[0].as_f64().unwrap();
    assert!(dx.iter().all(|dx| dx.as_f64().unwrap() <= first + 1e-12), "{dx:?}");
    assert_eq!(server.get("dataset/0/result/0/worst?kind=7").status, 400);
    let entry = server.json("board/0/0");
    assert_eq!(entry["scores"]["detection.f1"], expected["detection"]["f1"]);
    let columns = server.json("about")["columns"].clone();
    let better = |path: &str| {
        columns.as_array().unwrap().iter().find(|c| c["path"] == path).unwrap()["better"].clone()
    };
    let said = ["detection.f1", "detection.rmse_xy_px", "field.nodes.response"].map(better);
    assert_eq!(said, ["greater", "smaller", "near_one"]);
}

#[test]
fn an_unlinked_result_has_no_switches_and_what_is_missed_comes_first() {
    let folder = tempfile::tempdir().unwrap();
    let out = dataset(folder.path());
    let table = std::fs::read_to_string(out.join("truth/tracks.csv")).unwrap();
    let mut result = "frame,x_px,y_px\n0,1,1\n".to_owned();
    for line in table.lines().skip(2) {
        let cells: Vec<&str> = line.split(',').collect();
        result += &format!("{},{},{}\n", cells[0], cells[3], cells[4]);
    }
    let path = folder.path().join("mine.csv");
    std::fs::write(&path, result).unwrap();
    let server = Server::of(Subject::of(Some(&out), &[path]).unwrap());
    assert_eq!(server.json("dataset/0/result/0")["is_linked"], false);
    assert_eq!(server.json("dataset/0/result/0/worst?switches=1")["of"], 0);
    let kinds = &server.json("dataset/0/result/0/worst?by=0")["columns"]["kind"];
    let kinds: Vec<u64> = kinds.as_array().unwrap().iter().map(|kind| kind.as_u64().unwrap()).collect();
    assert_eq!(kinds[..3], [1, 2, 0]);
}

/// The parts of a preview: their JSON and the lengths of their blocks.
fn parts(server: &Server, text: &str) -> Vec<(Value, usize)> {
    let answer = server.send("POST", &server.path("preview"), "", text);
    assert_eq!(answer.status, 200);
    let (body, mut parts, mut at) = (answer.unchunked(), Vec::new(), 0);
    while at < body.len() {
        let length = |from: usize| u32::from_le_bytes(body[from..from + 4].try_into().unwrap()) as usize;
        let (json, block) = (length(at), length(at + 4));
        parts.push((serde_json::from_slice(&body[at + 8..][..json]).unwrap(), block));
        at += 8 + json + block;
    }
    parts
}

#[test]
fn a_preview_shows_what_generate_makes() {
    let folder = tempfile::tempdir().unwrap();
    let out = dataset(folder.path());
    let server = Server::of(Subject::of(Some(&out), &[]).unwrap());
    let parts = parts(&server, SCENARIO);
    let names: Vec<&str> = parts.iter().map(|(part, _)| part["part"].as_str().unwrap()).collect();
    assert_eq!(names, ["checked", "frame", "frame", "depth", "numbers", "end"]);
    assert_eq!(parts[1].1, 2 * 64 * 48);
    let facts = server.json("dataset/0");
    let numbers = &parts[4].0;
    assert_eq!(numbers["a_pi_px"], facts["a_pi_px"]);
    assert_eq!(numbers["snr"], facts["snr"]);
    // Frame A of the preview equals the first image, byte by byte. A busy machine may render only some of
    // the particles.
    let image = server.get("dataset/0/frame/0").body;
    let is_the_image = || {
        let answer = server.send("POST", &server.path("preview"), "", SCENARIO).unchunked();
        answer.windows(image.len()).any(|part| part == image.as_slice())
    };
    assert!((0..10).any(|_| is_the_image()));
}

#[test]
fn problems_of_a_text_have_their_places() {
    let server = Server::of(Subject::default());
    let text = "(\n    name: \"\u{b5}\u{1f600}\", // \u{1f600}\n    optics: (gian: 3),\n    motion: flow(field: poiseuille()),\n    timing: pairs(count: 2),\n)";
    let parts = parts(&server, text);
    let problems = parts[0].0["problems"].as_array().unwrap();
    let gain = problems.iter().find(|p| p["message"].as_str().unwrap().contains("gian")).unwrap();
    assert_eq!(gain["line"].as_u64(), Some(3));
    let units: Vec<u16> = text.encode_utf16().collect();
    let from = gain["from"].as_u64().unwrap() as usize;
    assert_eq!(String::from_utf16(&units[from..from + 4]).unwrap(), "gian");
    assert!(server.is_alive());
}

#[test]
fn only_the_scenario_that_is_open_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("new.ron");
    let server = Server::of(Subject::of(Some(&file), &[]).unwrap());
    let save = |server: &Server, text: &str| server.send("POST", &server.path("scenario"), "", text).status;
    assert!(!file.exists() && server.json("scenario")["may_save"] == true);
    assert_eq!(save(&server, SCENARIO), 200);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), SCENARIO);
    let start = Server::of(Subject::default());
    assert_eq!(save(&start, SCENARIO), 422);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
#[ignore = "slow: .ci/full"]
fn the_last_page_that_is_closed_ends_the_program() {
    let server = Server::of(Subject::default());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let within = |s: u64, stream: Option<TcpStream>| {
        let app = Arc::clone(&server.app);
        let ended = runtime
            .block_on(async { tokio::time::timeout(Duration::from_secs(s), app.ended_or_left()).await });
        drop(stream);
        ended.is_ok()
    };
    assert!(!within(6, None), "it waits for the first page");
    let mut stream = server.connect();
    let request =
        format!("GET {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", server.path("alive"), server.app.port);
    stream.write_all(request.as_bytes()).unwrap();
    let mut byte = [0];
    stream.read_exact(&mut byte).unwrap();
    assert!(!within(7, Some(stream)), "a page is open");
    assert!(within(9, None), "the page is closed");
    // As Ctrl-C does.
    server.app.end();
    assert!(within(1, None));
}
