//! The service over HTTP/1.1, on a loopback address only. Described in `docs/openapi.yaml`.

use crate::service::{Body, Method, Refusal, Service};
use http_body_util::{BodyExt, Full, LengthLimitError, Limited};
use hyper::body::{Bytes, Incoming};
use hyper::header::{ALLOW, CONNECTION, CONTENT_TYPE, HOST, HeaderValue, ORIGIN};
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

/// A client must have sent a request's head within this time, also on a connection kept alive.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// A client must have sent a body within this time.
const BODY_TIME: Duration = Duration::from_secs(30);
/// No connection lives longer: one whose client does not read its answers ends here.
const CONNECTION_TIME: Duration = Duration::from_secs(300);
/// Connections at once; further ones wait to be accepted.
const CONNECTIONS: usize = 128;
/// Bodies held at once, so that memory stays within this many times the largest body.
const BODIES: usize = 16;

static OPENAPI: &str = include_str!("../../docs/openapi.yaml");

struct Server {
    service: Service,
    /// Decisions computed at once: one per core.
    cores: Semaphore,
    bodies: Semaphore,
}

/// Answers until the process ends. `ready` is called with the bound address.
///
/// # Errors
/// The address is not loopback or cannot be bound.
pub fn serve(service: Service, address: SocketAddr, ready: impl FnOnce(SocketAddr)) -> std::io::Result<()> {
    if !address.ip().is_loopback() {
        let message =
            format!("{address} is not a loopback address: the service has no authentication; use 127.0.0.1:PORT");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(cores + 2)
        .enable_io()
        .enable_time()
        .build()?;
    let server = Arc::new(Server { service, cores: Semaphore::new(cores), bodies: Semaphore::new(BODIES) });
    runtime.block_on(async {
        let listener = TcpListener::bind(address).await?;
        ready(listener.local_addr()?);
        accept(listener, server).await
    })
}

async fn accept(listener: TcpListener, server: Arc<Server>) -> std::io::Result<()> {
    let connections = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let Ok(permit) = connections.clone().acquire_owned().await else { return Ok(()) };
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                // Out of file handles, or the client is gone already: neither ends the service.
                tracing::warn!("cannot accept a connection: {error}");
                tokio::time::sleep(Duration::from_millis(50)).await;
                continue;
            }
        };
        let server = server.clone();
        tokio::spawn(async move {
            let _permit = permit;
            // Small answers in one packet each: no waiting for acknowledgements.
            let _ = stream.set_nodelay(true);
            let connection = hyper::server::conn::http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD_TIME)
                .max_buf_size(64 << 10)
                .serve_connection(
                    TokioIo::new(stream),
                    service_fn(|request| {
                        let server = server.clone();
                        async move { Ok::<_, Infallible>(respond(server, request).await) }
                    }),
                );
            match tokio::time::timeout(CONNECTION_TIME, connection).await {
                Ok(Err(error)) => tracing::debug!("connection ended: {error}"),
                Err(_) => tracing::debug!("connection ended after {CONNECTION_TIME:?}"),
                Ok(Ok(())) => {}
            }
        });
    }
}

async fn respond(server: Arc<Server>, request: Request<Incoming>) -> Response<Full<Bytes>> {
    if request.method() == hyper::Method::GET && request.uri().path() == "/openapi.yaml" {
        return text(StatusCode::OK, "application/yaml", OPENAPI.into());
    }
    match answer(server, request).await {
        Ok((status, value)) => json(status, value.to_string()),
        Err(refusal) => {
            let status = StatusCode::from_u16(refusal.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
            let mut response = json(status, refusal.to_json().to_string());
            if status == StatusCode::METHOD_NOT_ALLOWED {
                response.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, POST, DELETE"));
            }
            if matches!(status, StatusCode::PAYLOAD_TOO_LARGE | StatusCode::REQUEST_TIMEOUT) {
                // What is left of the body is not read.
                response.headers_mut().insert(CONNECTION, HeaderValue::from_static("close"));
            }
            response
        }
    }
}

async fn answer(server: Arc<Server>, request: Request<Incoming>) -> Result<(StatusCode, serde_json::Value), Refusal> {
    local_only(&request)?;
    let (method, session) = route(request.method(), request.uri().path())?;
    let limit = server.service.limits().body;
    let too_large = || {
        let message = format!("the body is larger than {} MiB: send fewer points, or thin them", limit >> 20);
        Refusal::new(413, "too_large", message)
    };
    let length =
        request.headers().get(hyper::header::CONTENT_LENGTH).and_then(|v| v.to_str().ok()?.parse::<u64>().ok());
    if length.is_some_and(|n| n > limit as u64) {
        return Err(too_large());
    }
    let busy = || Refusal::new(503, "stopping", "the service is stopping");
    let has_body = request.method() == hyper::Method::POST;
    let body = if has_body {
        let late = || Refusal::new(408, "too_slow", format!("the body did not arrive within {BODY_TIME:?}"));
        let receive = async {
            let _place = server.bodies.acquire().await.map_err(|_| busy())?;
            // Waiting for a place is the service's time, not the client's.
            let collect = Limited::new(request.into_body(), limit).collect();
            match tokio::time::timeout(BODY_TIME, collect).await {
                Err(_) => Err(late()),
                Ok(Err(error)) if error.downcast_ref::<LengthLimitError>().is_some() => Err(too_large()),
                Ok(Err(error)) => Err(Refusal::new(400, "bad_body", error.to_string())),
                Ok(Ok(collected)) => Ok(collected.to_bytes()),
            }
        };
        receive.await?
    } else {
        Bytes::new()
    };
    let permit = server.cores.acquire().await.map_err(|_| busy())?;
    let worker = server.clone();
    let outcome = tokio::task::spawn_blocking(move || {
        worker.service.handle(method, session.as_deref(), Body::Bytes(&body), false)
    })
    .await;
    drop(permit);
    let internal = |_| Refusal::new(500, "internal", "this request failed inside the service; others are not affected");
    let value = outcome.map_err(internal)??;
    Ok((if method == Method::Create { StatusCode::CREATED } else { StatusCode::OK }, value))
}

/// A page in a browser must not reach the service: neither from another origin nor by a name that resolves here.
fn local_only(request: &Request<Incoming>) -> Result<(), Refusal> {
    let is_local = |authority: &str| {
        let host = authority.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit()));
        let host = host.map_or(authority, |(host, _)| host);
        matches!(host, "localhost" | "127.0.0.1" | "[::1]")
    };
    let header = |name| request.headers().get(name).map(|v: &HeaderValue| v.to_str().unwrap_or("?"));
    let foreign_host = header(HOST).is_some_and(|host| !is_local(host));
    let foreign_origin = header(ORIGIN).is_some_and(|o| !o.strip_prefix("http://").is_some_and(is_local));
    match foreign_host || foreign_origin {
        true => Err(Refusal::new(403, "not_local", "only this machine may ask: use http://127.0.0.1:PORT")),
        false => Ok(()),
    }
}

fn route(method: &hyper::Method, path: &str) -> Result<(Method, Option<String>), Refusal> {
    let parts: Vec<&str> = path.trim_matches('/').split('/').collect();
    let name = |name: &str| Some(name.to_owned());
    let (expected, found) = match parts[..] {
        ["health"] => (vec![hyper::Method::GET], vec![(Method::Health, None)]),
        ["sessions"] => {
            (vec![hyper::Method::GET, hyper::Method::POST], vec![(Method::List, None), (Method::Create, None)])
        }
        ["sessions", id] => (vec![hyper::Method::DELETE], vec![(Method::Delete, name(id))]),
        ["sessions", id, "scans"] => (vec![hyper::Method::POST], vec![(Method::AddScan, name(id))]),
        ["sessions", id, "next"] => (vec![hyper::Method::POST], vec![(Method::NextView, name(id))]),
        ["sessions", id, "undo"] => (vec![hyper::Method::POST], vec![(Method::Undo, name(id))]),
        ["sessions", id, "reset"] => (vec![hyper::Method::POST], vec![(Method::Reset, name(id))]),
        ["sessions", id, "export"] => (vec![hyper::Method::GET], vec![(Method::Export, name(id))]),
        _ => {
            let message = "no such path; see /openapi.yaml";
            return Err(Refusal::new(404, "no_such_path", message));
        }
    };
    let at = expected.iter().position(|m| m == method);
    at.map(|i| found[i].clone()).ok_or_else(|| {
        let names: Vec<&str> = expected.iter().map(hyper::Method::as_str).collect();
        Refusal::new(405, "wrong_method", format!("this path answers {}", names.join(" and ")))
    })
}

fn json(status: StatusCode, body: String) -> Response<Full<Bytes>> {
    text(status, "application/json", body.into())
}

fn text(status: StatusCode, kind: &'static str, body: Bytes) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(body));
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}
