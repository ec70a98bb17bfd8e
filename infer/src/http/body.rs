//! Bodies as they come in: at a rate that a program on the same machine keeps up, and in memory that is accounted for.

use crate::service::{Held, Refusal};
use http_body_util::BodyExt;
use hyper::Request;
use hyper::body::Incoming;
use hyper::header::CONTENT_LENGTH;
use std::time::Duration;
use tokio::time::{Instant, timeout_at};

/// A body is given this long, and more as it comes in.
const GRACE: Duration = Duration::from_secs(5);
/// Bytes that a body must bring in a second after that, on the mean.
const RATE: f64 = (8 << 20) as f64;
/// Of a body that is too large, so much is taken in before the answer, bytes ...
const FORGOTTEN: usize = 256 << 20;
/// ... as long as data keeps arriving, for so long.
const FORGETTING: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(250);

/// The body of a request, at most `limit` bytes, and what to do where it has more; `held` grows with it.
///
/// # Errors
/// Too large, too slow, broken off, or no memory for it.
pub async fn receive(
    request: Request<Incoming>,
    (limit, way_out): (usize, &str),
    held: &mut Held,
) -> Result<Vec<u8>, Refusal> {
    let length = request.headers().get(CONTENT_LENGTH).and_then(|v| v.to_str().ok()?.parse::<u64>().ok());
    let start = Instant::now();
    let mut body = request.into_body();
    if length.is_some_and(|n| n > limit as u64) {
        return Err(too_large(body, limit, way_out).await);
    }
    let mut bytes = Vec::new();
    loop {
        let end = start + GRACE + Duration::from_secs_f64(bytes.len() as f64 / RATE);
        let frame = timeout_at(end, body.frame()).await.map_err(|_| too_slow())?;
        let Some(frame) = frame else { return Ok(bytes) };
        let frame = frame.map_err(|e| Refusal::new(400, "bad_body", format!("the body broke off: {e}")))?;
        let Ok(data) = frame.into_data() else { continue };
        if bytes.len() + data.len() > limit {
            return Err(too_large(body, limit, way_out).await);
        }
        if bytes.len() + data.len() > bytes.capacity() {
            // Doubled, as a vector grows by itself, but asked for first.
            let more = (2 * bytes.capacity()).max(bytes.len() + data.len()).max(4096);
            timeout_at(end, held.grow(more)).await.map_err(|_| Refusal::busy())?;
            bytes.reserve_exact(more - bytes.len());
        }
        bytes.extend_from_slice(&data);
    }
}

/// Takes in, and forgets, some of what is left: a client that writes all before it reads would never see the answer.
async fn too_large(mut body: Incoming, limit: usize, way_out: &str) -> Refusal {
    let end = Instant::now() + FORGETTING;
    let mut left = FORGOTTEN;
    while left > 0 {
        let pause = end.min(Instant::now() + PAUSE);
        let Ok(Some(Ok(frame))) = timeout_at(pause, body.frame()).await else { break };
        left = left.saturating_sub(frame.data_ref().map_or(0, |data| data.len()));
    }
    let message = format!("the body is larger than {} MiB: {way_out}", limit >> 20);
    Refusal::new(413, "too_large", message)
}

fn too_slow() -> Refusal {
    let message = format!("the body did not arrive within {GRACE:?} and at {} MiB a second", RATE as usize >> 20);
    Refusal::new(408, "too_slow", message)
}
