//! The open connections, and which of them is closed to make room for a new one.
//!
//! Connections that have not yet sent the token are closed first, then those that wait for a next request,
//! then those whose response has not advanced for a while. A browser opens few connections and reopens one
//! that was closed while it was idle, so closing does not affect a page.

use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use axum::body::{Body, Bytes};
use hyper::body::{Body as HttpBody, Frame, SizeHint};
use tokio::task::AbortHandle;

/// Time for a connection to send the token, or its next request, before it may be closed.
const GRACE: Duration = Duration::from_millis(100);

/// Time without progress after which a connection with a request may be closed: several heartbeats of an
/// open page.
const STALLED: Duration = Duration::from_secs(3);

/// What a connection is doing, in the order in which connections are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Phase {
    /// It has not sent the token.
    Unknown,
    /// It has sent the token and waits for a next request.
    Idle,
    /// A request is being answered.
    Answering,
}

/// The phase of a connection and when it began or last advanced; clones share it.
#[derive(Debug, Clone)]
pub(super) struct Activity(Arc<Mutex<(Phase, Instant)>>);

impl Activity {
    pub(super) fn new() -> Self {
        Activity(Arc::new(Mutex::new((Phase::Unknown, Instant::now()))))
    }

    fn set(&self, phase: Phase) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = (phase, Instant::now());
    }

    fn get(&self) -> (Phase, Instant) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A request with the token has arrived.
    pub(super) fn admitted(&self) {
        self.set(Phase::Answering);
    }

    /// The body of the response to an admitted request; the connection is idle when all of it is sent.
    pub(super) fn followed(self, body: Body) -> Body {
        Body::new(Followed { body, activity: self })
    }
}

/// A response body that records its progress.
struct Followed {
    body: Body,
    activity: Activity,
}

impl HttpBody for Followed {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let frame = Pin::new(&mut self.body).poll_frame(context);
        if frame.is_ready() {
            self.activity.set(Phase::Answering);
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl Drop for Followed {
    fn drop(&mut self) {
        self.activity.set(Phase::Idle);
    }
}

/// The open connections.
#[derive(Debug, Default)]
pub(super) struct Connections(Vec<(Activity, AbortHandle)>);

impl Connections {
    pub(super) fn add(&mut self, activity: Activity, task: AbortHandle) {
        self.0.retain(|(_, task)| !task.is_finished());
        self.0.push((activity, task));
    }

    /// Closes the least important connection, if there is one that may be closed.
    pub(super) fn make_room(&mut self) {
        self.0.retain(|(_, task)| !task.is_finished());
        let may_go = |(phase, since): &(Phase, Instant)| {
            since.elapsed() > if *phase == Phase::Answering { STALLED } else { GRACE }
        };
        let all = self.0.iter().enumerate().map(|(index, (activity, _))| (activity.get(), index));
        if let Some((_, index)) = all.filter(|(of, _)| may_go(of)).min() {
            self.0.remove(index).1.abort();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::TcpStream;

    use super::super::subject::Subject;
    use super::super::tests::Server;
    use super::*;

    #[test]
    fn idle_connections_do_not_keep_pages_out() {
        let server = Server::of(Subject::default());
        let ask = || {
            let start = Instant::now();
            assert!(server.is_alive());
            start.elapsed()
        };
        let alone = ask();
        // More connections than are served at once; some have started a request.
        let mut idle: Vec<TcpStream> = (0..300).map(|_| server.connect()).collect();
        idle.iter_mut().step_by(3).for_each(|stream| stream.write_all(b"GET /").unwrap());
        // Unless idle connections are closed, the page waits until their headers time out after 10 s.
        let beside = ask();
        assert!(beside < alone + Duration::from_secs(5), "{alone:?} alone, {beside:?} beside idle ones");
        // Nor do connections that have sent the token and then send nothing, or request an endless stream.
        for path in ["about", "alive"] {
            let request = format!(
                "GET {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n",
                server.path(path),
                server.app.port()
            );
            let mut known: Vec<TcpStream> = (0..200).map(|_| server.connect()).collect();
            known.iter_mut().for_each(|stream| stream.write_all(request.as_bytes()).unwrap());
            // The last one is the last to be closed to make room.
            known[199].read_exact(&mut [0; 12]).unwrap();
            let beside = ask();
            assert!(beside < alone + Duration::from_secs(5), "{beside:?} beside idle ones of {path}");
        }
    }
}
