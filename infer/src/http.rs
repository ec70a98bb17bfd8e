//! The service over HTTP/1.1, on a loopback address only. Described in `docs/openapi.yaml`.

mod body;
mod connections;
mod guard;
mod routes;

use crate::request::{Ask, Body};
use crate::service::{Fingerprint, Held, Key, Method, Patience, Refusal, Reply, Service, reading};
use connections::{Connection, Connections, Place, Taken};
use formats::program::print_line;
use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{ALLOW, CONNECTION, CONTENT_TYPE, HeaderValue, RETRY_AFTER};
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use routes::Route;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::Poll;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{Instant, sleep, timeout_at};

/// A client must have sent a request's head within this time, also on a connection kept alive.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Bodies of requests other than scans, bytes.
const SMALL: usize = 1 << 20;
/// Bodies up to this are read at once; larger ones wait for a core.
const TINY: usize = 64 << 10;
/// How often the service looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);

static OPENAPI: &str = include_str!("../../docs/openapi.yaml");

struct Server {
    service: Arc<Service>,
    /// Work at once: one per core.
    cores: Arc<Semaphore>,
    /// Who creates or ends a session waits for the disk: one at a time.
    disk: Arc<Semaphore>,
    connections: Arc<Connections>,
    stop: watch::Receiver<bool>,
}

/// Answers until `stop` is set; then what runs is answered, as far as it takes no longer than `service.stop_ms`, that which others
/// are `busy` with too. The bound address is printed for the program that started this one: port 0 is known then.
///
/// # Errors
/// The address is not loopback or cannot be bound.
pub fn serve(
    service: Arc<Service>,
    address: SocketAddr,
    stop: &'static AtomicBool,
    busy: impl Fn() -> bool,
) -> std::io::Result<()> {
    if !address.ip().is_loopback() {
        let message =
            format!("{address} is not a loopback address: the service has no authentication; use 127.0.0.1:PORT");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(cores + 3)
        .enable_io()
        .enable_time()
        .build()?;
    let (told, told_stop) = watch::channel(false);
    let [cores, disk] = [cores, 1].map(|places| Arc::new(Semaphore::new(places)));
    let server = Arc::new(Server { service, cores, disk, connections: Arc::default(), stop: told_stop });
    runtime.block_on(async {
        let listener = TcpListener::bind(address).await?;
        let _ = print_line(format_args!("listening on http://{}", listener.local_addr()?));
        let stopping = server.service.stopping.clone();
        tokio::spawn(async move {
            while !stop.load(Ordering::SeqCst) {
                sleep(LOOK).await;
            }
            stopping.set();
            told.send_replace(true);
            told.closed().await;
        });
        accept(listener, &server).await;
        let end = Instant::now() + Duration::from_millis(server.service.limits().stop_ms);
        while (server.connections.count() > 0 || busy()) && Instant::now() < end {
            sleep(LOOK / 10).await;
        }
        // Remaining work ends the next time it looks at the clock, and is answered accordingly.
        server.service.halted.set();
        let end = Instant::now() + Duration::from_secs(2);
        while (server.connections.count() > 0 || busy()) && Instant::now() < end {
            sleep(LOOK / 10).await;
        }
        Ok::<(), std::io::Error>(())
    })?;
    runtime.shutdown_timeout(Duration::from_secs(1));
    Ok(())
}

async fn accept(listener: TcpListener, server: &Arc<Server>) {
    let mut stop = server.stop.clone();
    let mut stopped = pin!(stop.wait_for(|stop| *stop));
    loop {
        let next = poll_fn(|cx| match stopped.as_mut().poll(cx) {
            Poll::Ready(_) => Poll::Ready(None),
            Poll::Pending => listener.poll_accept(cx).map(Some),
        });
        match next.await {
            None => return,
            Some(Ok((stream, _))) => match server.connections.enter(server.service.limits().connections) {
                Some(place) => drop(tokio::spawn(converse(server.clone(), stream, place))),
                // All connections are being answered; this one is closed, unread.
                None => tracing::debug!("no room for another connection"),
            },
            Some(Err(error)) => {
                // Out of file handles, or the client is gone already: neither ends the service.
                tracing::warn!("cannot accept a connection: {error}");
                sleep(LOOK).await;
            }
        }
    }
}

/// One connection, until it ends, makes room, or the service stops.
async fn converse(server: Arc<Server>, stream: TcpStream, place: Place) {
    // Small answers in one packet each: no waiting for acknowledgements.
    let _ = stream.set_nodelay(true);
    let connection = place.connection.clone();
    let mut stop = server.stop.clone();
    let respond = service_fn(|request| {
        let (server, connection) = (server.clone(), connection.clone());
        async move { Ok::<_, Infallible>(respond(server, connection, request).await) }
    });
    let mut talk = pin!(
        hyper::server::conn::http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEAD_TIME)
            .max_buf_size(64 << 10)
            .serve_connection(TokioIo::new(Taken::new(stream)), respond)
    );
    let mut end = pin!(place.connection.end.notified());
    let mut stopped = pin!(stop.wait_for(|stop| *stop));
    let mut last = false;
    let outcome = poll_fn(|cx| {
        if end.as_mut().poll(cx).is_ready() {
            return Poll::Ready(Ok(()));
        }
        if !last && stopped.as_mut().poll(cx).is_ready() {
            last = true;
            talk.as_mut().graceful_shutdown();
        }
        talk.as_mut().poll(cx)
    });
    if let Err(error) = outcome.await {
        tracing::debug!("connection ended: {error}");
    }
}

async fn respond(
    server: Arc<Server>,
    connection: Arc<Connection>,
    request: Request<Incoming>,
) -> Response<Full<Bytes>> {
    let answer = match guard::local_only(&request).and_then(|()| routes::route(request.method(), request.uri().path()))
    {
        Ok(Route::Description) => return text(StatusCode::OK, "application/yaml", OPENAPI.into()),
        Ok(Route::Ask(method, session)) => answer(&server, &connection, method, session, request).await,
        Err(refusal) => Err(refusal),
    };
    connection.busy.store(false, Ordering::SeqCst);
    match answer {
        Ok(Reply { status, body }) => {
            text(StatusCode::from_u16(status).unwrap_or(StatusCode::OK), "application/json", accounted(&server, body))
        }
        Err(refusal) => refused(&refusal),
    }
}

/// An answer that counts as held until its client has taken it. One that there is no room to account for is small, or another
/// reference to what a session holds.
fn accounted(server: &Server, body: Bytes) -> Bytes {
    struct Accounted(Bytes, #[allow(dead_code, reason = "given back when dropped")] Held);
    impl AsRef<[u8]> for Accounted {
        fn as_ref(&self) -> &[u8] {
            &self.0
        }
    }
    match server.service.memory().take(body.len()) {
        Ok(held) => Bytes::from_owner(Accounted(body, held)),
        Err(_) => body,
    }
}

fn refused(refusal: &Refusal) -> Response<Full<Bytes>> {
    let status = StatusCode::from_u16(refusal.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    let mut response = text(status, "application/json", refusal.to_json().to_string().into());
    let headers = response.headers_mut();
    if let Some(allow) = refusal.allow {
        headers.insert(ALLOW, HeaderValue::from_static(allow));
    }
    if matches!(refusal.status, 503 | 507) {
        headers.insert(RETRY_AFTER, HeaderValue::from_static("1"));
    }
    if matches!(refusal.status, 408 | 413 | 503) {
        // What is left of the body is not read.
        headers.insert(CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

async fn answer(
    server: &Arc<Server>,
    connection: &Connection,
    method: Method,
    session: Option<String>,
    request: Request<Incoming>,
) -> Result<Reply, Refusal> {
    let service = &server.service;
    match method {
        Method::Health => return service.health(),
        Method::List => return service.list(),
        _ if service.stopping.is_set() => return Err(Refusal::stopping()),
        _ => {}
    }
    let mut patience = service.patience();
    // Dropped with this future when the client hangs up.
    let _gone = patience.gone.set_on_drop();
    // A key that is no text is as bad as none.
    let name = request.headers().get("idempotency-key").map(|name| name.to_str().unwrap_or_default().to_owned());
    let most = match method {
        Method::AddScan => (service.limits().body(), "thin the scan, or raise service.body_mib"),
        _ => (SMALL, "only those of scans may be"),
    };
    let mut held = service.memory().nothing();
    let bytes = body::receive(request, most, &mut held).await?;
    connection.busy.store(true, Ordering::SeqCst);
    let room = bytes.capacity() + reading(method, bytes.len());
    timeout_at(patience.end().into(), held.grow(room)).await.map_err(|_| service.memory().full())?;
    let keep = service.keeps_state();
    let (asked, bytes_len) = (session.clone(), bytes.len());
    let read = move || -> Result<(Option<Ask>, Option<Key>), Refusal> {
        // What is no JSON counts as no body: it is refused, or ends a session, which takes none.
        let body = || serde_json::from_slice::<Fingerprint>(&bytes).unwrap_or_default();
        let key = name.map(|name| Key::new(&name, method, asked.as_deref(), &body())).transpose()?;
        if method == Method::Delete {
            return Ok((None, key));
        }
        Ok((Some(Ask::parse(method, Body::Whole(&bytes), false, keep)?), key))
    };
    let (ask, key) = if method == Method::AddScan || bytes_len > TINY {
        in_turn(&server.cores, &patience, read).await??
    } else {
        read()?
    };
    let Some(ask) = ask else {
        let name = session.unwrap_or_default();
        let mut open = match service.entry(Some(&name)) {
            Ok(entry) => {
                let free = timeout_at(patience.end().into(), entry.open.clone().lock_owned()).await;
                Some(free.map_err(|_| Refusal::busy())?)
            }
            Err(_) => None,
        };
        let worker = server.clone();
        let end = move || worker.service.delete(&name, open.as_deref_mut(), key);
        return in_turn(&server.disk, &patience, end).await?;
    };
    patience.set(ask.deadline_ms(), service.limits().max_deadline_ms)?;
    if let Ask::Create(request) = ask {
        let worker = server.clone();
        return in_turn(&server.disk, &patience, move || worker.service.create(request, key)).await?;
    }
    let entry = service.entry(session.as_deref())?;
    // What was read is less than might have been.
    let work = ask.work();
    held.shrink(work);
    timeout_at(patience.end().into(), held.grow(work)).await.map_err(|_| service.memory().full())?;
    let end = patience.end().into();
    let mut open = timeout_at(end, entry.open.clone().lock_owned()).await.map_err(|_| Refusal::busy())?;
    let (worker, told) = (server.clone(), patience.clone());
    let work = move || worker.service.work(&entry, &mut open, ask, key, &told, held);
    in_turn(&server.cores, &patience, work).await?
}

/// Waits for one of these places, as long as the request may take, and works on a thread of its own; also after its client has gone,
/// until it notices.
async fn in_turn<T: Send + 'static>(
    places: &Arc<Semaphore>,
    patience: &Patience,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, Refusal> {
    let place = timeout_at(patience.end().into(), places.clone().acquire_owned()).await;
    let Ok(Ok(place)) = place else { return Err(Refusal::busy()) };
    if patience.halted.is_set() {
        return Err(Refusal::stopping());
    }
    let task = tokio::task::spawn_blocking(move || {
        let _place = place;
        work()
    });
    task.await.map_err(|_| Refusal::internal())
}

fn text(status: StatusCode, kind: &'static str, body: Bytes) -> Response<Full<Bytes>> {
    let mut response = Response::new(Full::new(body));
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}
