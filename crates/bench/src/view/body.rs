//! Response bodies that are sent in pieces: streams of messages.

use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use http_body::Frame;
use tokio::sync::mpsc::{self, Receiver, Sender};

/// Chunks that wait to be sent.
const WAITING: usize = 2;

/// A response body with the chunks received from a channel.
pub(super) struct Channel(Receiver<Bytes>);

impl http_body::Body for Channel {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.0.poll_recv(context).map(|piece| piece.map(|piece| Ok(Frame::data(piece))))
    }
}

/// A streamed response and the sender of its chunks; sending fails once the client has disconnected.
pub(super) fn stream() -> (Sender<Bytes>, Response) {
    let (sender, receiver) = mpsc::channel(WAITING);
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (sender, (kind, Body::new(Channel(receiver))).into_response())
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
