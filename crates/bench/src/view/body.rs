//! Response bodies that are sent in pieces: streams of messages.

use std::convert::Infallible;

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use tokio::sync::mpsc::{self, Sender};

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
