//! Which path and method ask for what.

use crate::service::{Method, Refusal};
use hyper::Method as Verb;

/// What a request is for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Route {
    /// The description of the service.
    Description,
    /// A method, and the session it is for.
    Ask(Method, Option<String>),
}

/// The route of a method and a path.
///
/// # Errors
/// No such path, or another method.
pub fn route(verb: &Verb, path: &str) -> Result<Route, Refusal> {
    let parts: Vec<&str> = path.strip_prefix('/').unwrap_or(path).split('/').collect();
    let ask = |method| Route::Ask(method, None);
    let of = |method, id: &str| Route::Ask(method, Some(id.to_owned()));
    let (allow, found): (&'static str, Vec<(Verb, Route)>) = match parts[..] {
        ["openapi.yaml"] => ("GET", vec![(Verb::GET, Route::Description)]),
        ["health"] => ("GET", vec![(Verb::GET, ask(Method::Health))]),
        ["sessions"] => ("GET, POST", vec![(Verb::GET, ask(Method::List)), (Verb::POST, ask(Method::Create))]),
        ["sessions", id] => ("DELETE", vec![(Verb::DELETE, of(Method::Delete, id))]),
        ["sessions", id, "scans"] => ("POST", vec![(Verb::POST, of(Method::AddScan, id))]),
        ["sessions", id, "next"] => ("POST", vec![(Verb::POST, of(Method::NextView, id))]),
        ["sessions", id, "undo"] => ("POST", vec![(Verb::POST, of(Method::Undo, id))]),
        ["sessions", id, "reset"] => ("POST", vec![(Verb::POST, of(Method::Reset, id))]),
        ["sessions", id, "export"] => ("GET", vec![(Verb::GET, of(Method::Export, id))]),
        ["sessions", id, "mesh"] => ("GET", vec![(Verb::GET, of(Method::Mesh, id))]),
        _ => return Err(Refusal::new(404, "no_such_path", "no such path; see /openapi.yaml")),
    };
    found.into_iter().find(|(v, _)| v == verb).map(|(_, route)| route).ok_or_else(|| Refusal {
        allow: Some(allow),
        ..Refusal::new(405, "wrong_method", format!("this path answers {}", allow.replace(", ", " and ")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_path_says_what_it_answers() {
        assert_eq!(route(&Verb::POST, "/sessions/3/next"), Ok(Route::Ask(Method::NextView, Some("3".to_owned()))));
        for (path, allow) in [
            ("/openapi.yaml", "GET"),
            ("/health", "GET"),
            ("/sessions", "GET, POST"),
            ("/sessions/1", "DELETE"),
            ("/sessions/1/scans", "POST"),
            ("/sessions/1/next", "POST"),
            ("/sessions/1/undo", "POST"),
            ("/sessions/1/reset", "POST"),
            ("/sessions/1/export", "GET"),
            ("/sessions/1/mesh", "GET"),
        ] {
            let refusal = route(&Verb::PUT, path).expect_err("no path is put to");
            assert_eq!((refusal.status, refusal.allow), (405, Some(allow)), "{path}");
        }
        for path in ["/", "//health", "/sessions/", "/sessions/1/next/"] {
            assert_eq!(route(&Verb::GET, path).expect_err(path).status, if path == "/sessions/" { 405 } else { 404 });
        }
    }
}
