//! The server: access control, limits, and shutdown.
//!
//! It listens on 127.0.0.1, by default on a free port. Every path starts with a token of 128 random bits,
//! `Host` must be the loopback address with the server's port (which prevents access by DNS rebinding), and
//! `Origin`, if present, must be this server. Refused requests get a status from 400 to 499 without a reason.
//! Bodies are limited.

use std::net::Ipv4Addr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::serve::ListenerExt;
use tokio::net::TcpListener;

use super::routes;
use super::state::App;
use super::subject::Subject;
use storage::error::{Error, Result};
use storage::on_interrupt;

#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct ViewOptions {
    /// Port [default: a free one]
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    pub port: u16,
    /// Keep running after the last page is closed
    #[arg(long)]
    pub stay: bool,
}

#[derive(Debug, Clone)]
pub struct Served {
    /// The page's address, with the token.
    pub address: String,
    pub title: String,
}

/// Number of worker threads for long jobs.
const WORKERS: usize = 6;

/// Serves pages until the program is interrupted or the last page is closed; `announce` is called with the
/// address.
pub fn serve(
    subject: Subject,
    options: ViewOptions,
    announce: impl FnOnce(&Served) -> Result<()>,
) -> Result<()> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(WORKERS)
        .enable_io()
        .enable_time()
        .build()
        .map_err(|e| Error::input(format!("threads of the server: {e}")))?;
    let result = runtime.block_on(async {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, options.port))
            .await
            .map_err(|e| Error::input(format!("--port {}: {e}", options.port)))?;
        let at = listener.local_addr().map_err(|e| Error::input(format!("port: {e}")))?;
        let app = Arc::new(App::new(subject, at.port())?);
        let end = Arc::clone(&app);
        on_interrupt(move || end.end());
        announce(&Served { address: app.address(), title: app.title() })?;
        let accepting = tokio::spawn(accept(listener, Arc::clone(&app)));
        if options.stay {
            app.ended().await;
        } else {
            app.ended_or_left().await;
        }
        accepting.abort();
        Ok(())
    });
    // Running jobs are abandoned.
    runtime.shutdown_timeout(Duration::from_millis(200));
    result
}

/// The routes with access control.
pub(super) fn router(app: &Arc<App>) -> Router {
    Router::new()
        .nest(&format!("/{}", app.token), routes::all())
        // Paths of the page are relative, so its own address ends with a slash.
        .route(&format!("/{}/", app.token), get(routes::index))
        .layer(from_fn_with_state(Arc::clone(app), guard))
        .with_state(Arc::clone(app))
}

pub(super) async fn accept(listener: TcpListener, app: Arc<App>) {
    let listener = listener.tap_io(|stream| drop(stream.set_nodelay(true)));
    // It never returns: errors of single connections are ignored.
    let _ = axum::serve(listener, router(&app)).await;
}

/// Passes a request on if it is addressed to this server and has the token.
async fn guard(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    with_headers(match admitted(&app, &request) {
        Ok(()) => next.run(request).await,
        Err(status) => status.into_response(),
    })
}

fn admitted(app: &App, request: &Request) -> std::result::Result<(), StatusCode> {
    let uri = request.uri();
    let authority = uri.authority().map(ToString::to_string);
    let is_meant = is_meant(app.port, authority.as_deref(), request.headers());
    if is_meant && is_token(&app.token, uri.path()) { Ok(()) } else { Err(StatusCode::FORBIDDEN) }
}

/// Whether `Host` and `Origin` name this server.
fn is_meant(port: u16, authority: Option<&str>, headers: &HeaderMap) -> bool {
    let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
    let is_own = |host: &str| own.iter().any(|own| own.eq_ignore_ascii_case(host));
    let one = |name: header::HeaderName| -> Option<Option<&str>> {
        let mut values = headers.get_all(name).iter();
        match (values.next(), values.next()) {
            (None, _) => Some(None),
            (Some(value), None) => value.to_str().ok().map(Some),
            (Some(_), Some(_)) => None,
        }
    };
    let host = match (authority, one(header::HOST)) {
        (Some(authority), Some(_)) => authority,
        (None, Some(Some(host))) => host,
        _ => return false,
    };
    let from_here = match one(header::ORIGIN) {
        Some(None) => true,
        Some(Some(origin)) => origin.strip_prefix("http://").is_some_and(is_own),
        None => false,
    };
    is_own(host) && from_here
}

/// Whether the first part of a path is the token; the comparison takes constant time.
fn is_token(token: &str, path: &str) -> bool {
    let given = path.strip_prefix('/').unwrap_or(path).split('/').next().unwrap_or_default().as_bytes();
    let differences = token.bytes().zip(given).fold(0, |all, (a, b)| all | (a ^ b));
    given.len() == token.len() && differences == 0
}

/// Adds security headers: no caching, no content from other origins, no framing.
fn with_headers(mut answer: Response) -> Response {
    const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; \
                          connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    let headers = answer.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::CACHE_CONTROL, "no-store"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    answer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_compared_in_full() {
        assert!(is_token("abc", "/abc/x") && is_token("abc", "/abc"));
        for wrong in ["", "/", "/ab/c", "/abcd/x", "/abd/", "/x/abc", "//abc"] {
            assert!(!is_token("abc", wrong), "{wrong}");
        }
    }
}
