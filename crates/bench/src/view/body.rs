//! Response bodies that are sent in chunks: streams of messages, and large blocks, of which only a few chunks
//! are in memory at a time.

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

/// Chunks that wait to be sent.
const WAITING: usize = 2;

/// Size of a chunk of a large response, bytes.
const CHUNK: usize = 256 * 1024;

/// Maximum time for a client to receive a chunk.
const CHUNK_TIME: Duration = Duration::from_secs(10);

/// A response body with the chunks received from a channel.
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

/// A streamed response and the sender of its chunks; sending fails once the client has disconnected.
pub(super) fn stream() -> (Sender<Bytes>, Response) {
    let (sender, receiver) = mpsc::channel(WAITING);
    let kind = [(header::CONTENT_TYPE, "application/octet-stream")];
    (sender, (kind, Body::new(Channel(receiver))).into_response())
}

/// Sends a large block, as long as the client keeps reading. `permit` limits the number of such responses and
/// is held until all is sent.
pub(super) fn large(permit: OwnedSemaphorePermit, bytes: Bytes, kind: &'static str) -> Response {
    if bytes.len() <= CHUNK {
        return ([(header::CONTENT_TYPE, kind)], bytes).into_response();
    }
    let (sender, mut response) = stream();
    response.headers_mut().insert(header::CONTENT_TYPE, header::HeaderValue::from_static(kind));
    response.headers_mut().insert(header::CONTENT_LENGTH, header::HeaderValue::from(bytes.len()));
    tokio::spawn(async move {
        let _permit = permit;
        for at in (0..bytes.len()).step_by(CHUNK) {
            let piece = bytes.slice(at..bytes.len().min(at + CHUNK));
            match tokio::time::timeout(CHUNK_TIME, sender.send(piece)).await {
                Ok(Ok(())) => {}
                _ => return,
            }
        }
    });
    response
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
