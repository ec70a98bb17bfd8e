//! Who may ask: programs on this machine, no page in a browser.

use crate::service::Refusal;
use hyper::header::{HOST, HeaderValue, ORIGIN};
use hyper::{Request, Version};

/// A page in a browser must not reach the service: neither from another origin nor by a name that resolves here.
///
/// # Errors
/// The request comes from elsewhere, or is meant for somebody else.
pub fn local_only<B>(request: &Request<B>) -> Result<(), Refusal> {
    let bad_host = |message: &str| Err(Refusal::new(400, "bad_host", message));
    let mut hosts = request.headers().get_all(HOST).iter();
    match (hosts.next(), hosts.next()) {
        (_, Some(_)) => return bad_host("more than one Host header"),
        (None, None) if request.version() == Version::HTTP_11 => return bad_host("no Host header"),
        _ => {}
    }
    if request.uri().authority().is_some_and(|a| !is_local(a.as_str()) || request.uri().scheme_str() != Some("http")) {
        return Err(Refusal::new(421, "misdirected", "the request's address belongs to another service"));
    }
    let header = |name: &str| request.headers().get(name).map(|v: &HeaderValue| v.to_str().unwrap_or("?"));
    let foreign_host = header(HOST.as_str()).is_some_and(|host| !is_local(host));
    let origin = header(ORIGIN.as_str());
    let foreign_origin = origin.is_some_and(|o| !o.strip_prefix("http://").is_some_and(is_local));
    // Browsers leave the origin out where a page only shows what it fetches.
    let site = header("sec-fetch-site").is_some_and(|site| !matches!(site, "same-origin" | "none"));
    match foreign_host || foreign_origin || (site && origin.is_none()) {
        true => Err(Refusal::new(403, "not_local", "only programs on this machine may ask: use http://127.0.0.1:PORT")),
        false => Ok(()),
    }
}

fn is_local(authority: &str) -> bool {
    let host = authority.rsplit_once(':').filter(|(_, port)| port.bytes().all(|b| b.is_ascii_digit()));
    let host = host.map_or(authority, |(host, _)| host);
    matches!(host.to_ascii_lowercase().as_str(), "localhost" | "127.0.0.1" | "[::1]")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_local_programs_get_in() {
        let status = |uri: &str, headers: &[(&str, &str)]| {
            let request = headers.iter().fold(Request::builder().uri(uri), |r, (k, v)| r.header(*k, *v));
            local_only(&request.body(()).expect("a request")).map_or_else(|r| r.status, |()| 200)
        };
        let host = ("host", "127.0.0.1:8350");
        assert_eq!(status("/health", &[host]), 200);
        assert_eq!(status("/health", &[("host", "LOCALHOST")]), 200);
        assert_eq!(status("/health", &[]), 400, "HTTP/1.1 has a host");
        assert_eq!(status("/health", &[host, host]), 400, "one");
        assert_eq!(status("/health", &[("host", "evil.example")]), 403);
        assert_eq!(status("http://127.0.0.1:8350/health", &[host]), 200);
        assert_eq!(status("http://evil.example/health", &[host]), 421);
        assert_eq!(status("/health", &[host, ("origin", "http://evil.example")]), 403);
        assert_eq!(status("/health", &[host, ("origin", "null")]), 403);
        assert_eq!(status("/health", &[host, ("sec-fetch-site", "cross-site")]), 403, "an image of a foreign page");
        assert_eq!(status("/health", &[host, ("sec-fetch-site", "none")]), 200, "typed by a person");
        let own = [host, ("origin", "http://localhost:3000"), ("sec-fetch-site", "cross-site")];
        assert_eq!(status("/health", &own), 200, "a page that this machine serves");
    }
}
