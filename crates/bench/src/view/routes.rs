//! The requests that the server answers. Every path starts with the token; datasets, frames and results are
//! identified by index.

use std::convert::Infallible;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{DefaultBodyLimit, Path, RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use futures_util::stream::unfold;
use include_dir::{Dir, include_dir};
use serde_json::{Value, json};
use tokio::sync::mpsc::{self, Sender};

use super::result::Filter;
use super::state::App;
use super::{board, editor, keys, preview};
use storage::error::{Error, Result};

/// Maximum body of a request (a scenario), bytes.
const MAX_BODY: usize = 1 << 20;

/// Interval of heartbeats to an open page.
const HEARTBEAT: std::time::Duration = std::time::Duration::from_secs(1);

type Shared = State<Arc<App>>;

/// All routes, relative to the token.
pub(super) fn all() -> Router<Arc<App>> {
    Router::new()
        .route("/page/{name}", get(|Path(name): Path<String>| async move { page(&name) }))
        .route("/alive", get(alive))
        .route("/about", get(about))
        .route("/keys", get(|| key(String::new())))
        .route("/keys/{path}", get(|Path(path): Path<String>| key(path)))
        .route("/scenario", get(start).post(save))
        .route("/preview", post(preview_of))
        .route("/dataset/{dataset}", get(dataset))
        .route("/dataset/{dataset}/frame/{frame}", get(frame))
        .route("/dataset/{dataset}/truth/{frame}", get(truth))
        .route("/dataset/{dataset}/field/{pair}", get(field))
        .route("/dataset/{dataset}/depth", get(depth))
        .route("/dataset/{dataset}/particle/{frame}/{row}", get(particle))
        .route("/dataset/{dataset}/result/{tracker}", get(result))
        .route("/dataset/{dataset}/result/{tracker}/score", get(score))
        .route("/dataset/{dataset}/result/{tracker}/frame/{frame}", get(points))
        .route("/dataset/{dataset}/result/{tracker}/vectors/{pair}", get(vectors))
        .route("/dataset/{dataset}/result/{tracker}/worst", get(worst))
        .route("/board/{dataset}/{tracker}", get(entry))
        .layer(DefaultBodyLimit::max(MAX_BODY))
}

/// The folder `page/`.
pub(super) static PAGE: Dir<'static> = include_dir!("$CARGO_MANIFEST_DIR/src/view/page");

/// Content and media type of the page's file `name`.
pub(super) fn file(name: &str) -> Option<(&'static [u8], &'static str)> {
    let file = PAGE.get_file(name)?;
    let kind = match name.rsplit_once('.')?.1 {
        "html" => "text/html; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "svg" => "image/svg+xml",
        _ => "text/plain; charset=utf-8",
    };
    Some((file.contents(), kind))
}

/// The page.
pub(super) async fn index() -> Response {
    page("index.html")
}

fn page(name: &str) -> Response {
    match file(name) {
        Some((bytes, kind)) => ([(header::CONTENT_TYPE, kind)], bytes).into_response(),
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

fn json_response(value: &Value) -> Response {
    ([(header::CONTENT_TYPE, "application/json")], value.to_string()).into_response()
}

/// A key of the scenario language; null if it does not exist, as happens while the user is typing.
async fn key(path: String) -> Response {
    json_response(&keys::at(&path).unwrap_or(Value::Null))
}

/// An error as JSON, for files that cannot be shown.
fn refused(error: &Error) -> Response {
    let text = json!({ "error": error.to_string() }).to_string();
    (StatusCode::UNPROCESSABLE_ENTITY, [(header::CONTENT_TYPE, "application/json")], text).into_response()
}

/// Runs a job on a worker thread and sends its result, of this media type.
async fn send<T: Into<Body> + Send + 'static>(
    kind: &'static str,
    of: impl FnOnce() -> Result<Option<T>> + Send + 'static,
) -> Response {
    match tokio::task::spawn_blocking(of).await {
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
        Ok(Ok(Some(body))) => ([(header::CONTENT_TYPE, kind)], body.into()).into_response(),
        Ok(Ok(None)) => StatusCode::NOT_FOUND.into_response(),
        Ok(Err(error)) => refused(&error),
    }
}

/// Runs a job on a worker thread and sends its result as JSON.
async fn work(app: Arc<App>, of: impl FnOnce(&App) -> Result<Option<Value>> + Send + 'static) -> Response {
    send("application/json", move || of(&app).map(|value| value.map(|value| value.to_string()))).await
}

/// Chunks that wait to be sent.
const WAITING: usize = 2;

/// A streamed response and the sender of its chunks; sending fails once the client has disconnected.
pub(super) fn stream() -> (Sender<Bytes>, Response) {
    let (sender, receiver) = mpsc::channel(WAITING);
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    let chunks = unfold(receiver, async |mut all| Some((Ok::<_, Infallible>(all.recv().await?), all)));
    (sender, (kind, Body::from_stream(chunks)).into_response())
}

/// A message of a stream: lengths of JSON and block (32 bit, little endian), then JSON and block.
pub(super) fn message(json: &serde_json::Value, block: &[u8]) -> Bytes {
    let json = json.to_string();
    let mut bytes = Vec::with_capacity(8 + json.len() + block.len());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend((block.len() as u32).to_le_bytes());
    bytes.extend(json.as_bytes());
    bytes.extend(block);
    Bytes::from(bytes)
}

/// A stream of one byte per second, which lasts as long as the page is open.
async fn alive(State(app): Shared) -> Response {
    let (viewer, (sender, response)) = (app.viewer(), stream());
    tokio::spawn(async move {
        let _viewer = viewer;
        // A closed page closes the channel.
        while tokio::time::timeout(HEARTBEAT, sender.closed()).await.is_err() {
            if sender.send(Bytes::from_static(b".")).await.is_err() {
                return;
            }
        }
    });
    response
}

async fn about(State(app): Shared) -> Response {
    json_response(&board::about(&app))
}

async fn start(State(app): Shared) -> Response {
    work(app, |app| editor::about(&app.subject).map(Some)).await
}

async fn save(State(app): Shared, text: String) -> Response {
    work(app, move |app| editor::save(&app.subject, &text).map(Some)).await
}

async fn preview_of(State(app): Shared, text: String) -> Response {
    let (cancellation, (sender, response)) = (app.next_preview(), stream());
    let (reader, unread) = (sender.clone(), cancellation.clone());
    let watch = tokio::spawn(async move {
        reader.closed().await;
        unread.cancel();
    });
    tokio::task::spawn_blocking(move || {
        preview::run(&app, &text, cancellation, sender);
        watch.abort();
    });
    response
}

async fn dataset(State(app): Shared, Path(dataset): Path<usize>) -> Response {
    work(app, move |app| app.dataset(dataset)?.map(|open| open.about()).transpose()).await
}

async fn frame(State(app): Shared, Path((dataset, frame)): Path<(usize, usize)>) -> Response {
    send("application/octet-stream", move || {
        app.dataset(dataset)?.map_or(Ok(None), |open| open.counts(frame))
    })
    .await
}

async fn truth(State(app): Shared, Path((dataset, frame)): Path<(usize, u32)>) -> Response {
    work(app, move |app| app.dataset(dataset)?.map(|open| open.truth(frame)).transpose()).await
}

async fn field(State(app): Shared, Path((dataset, pair)): Path<(usize, u32)>) -> Response {
    work(app, move |app| app.dataset(dataset)?.map(|open| open.field(pair)).transpose()).await
}

async fn depth(State(app): Shared, Path(dataset): Path<usize>) -> Response {
    work(app, move |app| app.dataset(dataset)?.map(|open| open.depth()).transpose()).await
}

async fn particle(State(app): Shared, Path((dataset, frame, row)): Path<(usize, u32, usize)>) -> Response {
    work(app, move |app| app.dataset(dataset)?.map(|open| open.particle(frame, row)).transpose()).await
}

async fn result(State(app): Shared, Path((dataset, tracker)): Path<(usize, usize)>) -> Response {
    work(app, move |app| Ok(app.result(dataset, tracker)?.map(|open| open.about()))).await
}

async fn score(State(app): Shared, Path((dataset, tracker)): Path<(usize, usize)>) -> Response {
    work(app, move |app| Ok(app.result(dataset, tracker)?.map(|open| json!(open.score)))).await
}

async fn points(State(app): Shared, Path((dataset, tracker, frame)): Path<(usize, usize, u32)>) -> Response {
    work(app, move |app| Ok(app.result(dataset, tracker)?.map(|open| open.frame(frame)))).await
}

async fn vectors(State(app): Shared, Path((dataset, tracker, pair)): Path<(usize, usize, u32)>) -> Response {
    work(app, move |app| Ok(app.result(dataset, tracker)?.map(|open| open.vectors(pair)))).await
}

async fn worst(
    State(app): Shared,
    Path((dataset, tracker)): Path<(usize, usize)>,
    query: RawQuery,
) -> Response {
    let Some(filter) = filter(query.0.as_deref().unwrap_or_default()) else {
        return StatusCode::BAD_REQUEST.into_response();
    };
    work(app, move |app| Ok(app.result(dataset, tracker)?.map(|open| open.worst(&filter)))).await
}

/// Parses a filter such as `kind=0&by=1&z=-10,20&snr=3,&overlap=,0.5&switches=1`; `None` if it is malformed.
fn filter(query: &str) -> Option<Filter> {
    let all = [f64::NEG_INFINITY, f64::INFINITY];
    let mut filter = Filter { kind: None, by: 0, z_um: all, snr: all, overlap: all, switches: false };
    let range = |text: &str| -> Option<[f64; 2]> {
        let (low, high) = text.split_once(',')?;
        let bound = |text: &str, open: f64| {
            if text.is_empty() { Some(open) } else { text.parse().ok().filter(|x: &f64| x.is_finite()) }
        };
        Some([bound(low, all[0])?, bound(high, all[1])?])
    };
    for part in query.split('&').filter(|part| !part.is_empty()) {
        match part.split_once('=')? {
            ("kind", value) => filter.kind = Some(value.parse().ok().filter(|kind| *kind < 3)?),
            ("by", value) => filter.by = value.parse().ok().filter(|by| *by < 3)?,
            ("z", value) => filter.z_um = range(value)?,
            ("snr", value) => filter.snr = range(value)?,
            ("overlap", value) => filter.overlap = range(value)?,
            ("switches", value) => filter.switches = value == "1",
            _ => return None,
        }
    }
    Some(filter)
}

async fn entry(State(app): Shared, Path((dataset, tracker)): Path<(usize, usize)>) -> Response {
    work(app, move |app| board::entry(app, dataset, tracker)).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_read_or_refused() {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        let none = Filter { kind: None, by: 0, z_um: all, snr: all, overlap: all, switches: false };
        assert_eq!(filter(""), Some(none));
        let narrow =
            Filter { kind: Some(2), by: 1, z_um: [-10.0, 20.5], snr: [3.0, all[1]], switches: true, ..none };
        assert_eq!(filter("kind=2&by=1&z=-10,20.5&snr=3,&switches=1"), Some(narrow));
        for wrong in ["kind=3", "by=9", "z=1", "z=a,b", "snr=nan,1", "x=1", "kind", "z=%00,1"] {
            assert_eq!(filter(wrong), None, "{wrong}");
        }
    }
}
