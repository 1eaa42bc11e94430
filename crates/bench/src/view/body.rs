//! Answers that are sent piece by piece: streams of messages, and large blocks of which few are in memory at
//! a time.

use std::convert::Infallible;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use hyper::body::Frame;
use tokio::sync::OwnedSemaphorePermit;
use tokio::sync::mpsc::{self, Receiver, Sender};

/// Pieces that wait to be sent.
const WAITING: usize = 2;

/// A piece of a large answer, bytes.
const PIECE: usize = 256 * 1024;

/// How long a reader may take over a piece.
const PATIENCE: Duration = Duration::from_secs(10);

/// A body of what a channel brings.
pub(super) struct Channel(Receiver<Bytes>);

impl hyper::body::Body for Channel {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        self.0.poll_recv(context).map(|piece| piece.map(|piece| Ok(Frame::data(piece))))
    }
}

/// A stream and where to write it; writing fails once the reader is gone.
pub(super) fn stream() -> (Sender<Bytes>, Response) {
    let (sender, receiver) = mpsc::channel(WAITING);
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (sender, (kind, Body::new(Channel(receiver))).into_response())
}

/// Sends a large block to a reader that reads; `place` is one of the few for such answers, held until it is
/// sent.
pub(super) fn large(place: OwnedSemaphorePermit, bytes: Bytes, kind: &'static str) -> Response {
    if bytes.len() <= PIECE {
        return ([(header::CONTENT_TYPE, kind)], bytes).into_response();
    }
    let (sender, mut response) = stream();
    response.headers_mut().insert(header::CONTENT_TYPE, header::HeaderValue::from_static(kind));
    response.headers_mut().insert(header::CONTENT_LENGTH, header::HeaderValue::from(bytes.len()));
    tokio::spawn(async move {
        let _place = place;
        for at in (0..bytes.len()).step_by(PIECE) {
            let piece = bytes.slice(at..bytes.len().min(at + PIECE));
            match tokio::time::timeout(PATIENCE, sender.send(piece)).await {
                Ok(Ok(())) => {}
                _ => return,
            }
        }
    });
    response
}

/// A message of a stream: lengths of JSON and block (32 bits, little endian), then both.
pub(super) fn message(json: &serde_json::Value, block: &[u8]) -> Bytes {
    let json = json.to_string();
    let mut bytes = Vec::with_capacity(8 + json.len() + block.len());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend((block.len() as u32).to_le_bytes());
    bytes.extend(json.as_bytes());
    bytes.extend(block);
    Bytes::from(bytes)
}
