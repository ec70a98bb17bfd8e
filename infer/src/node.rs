//! The service as a ROS 2 node (`--ros2`), beside HTTP where that is asked for.

use crate::request::{self, Body, over};
use crate::service::{Entry, Method, Open, Refusal, Reply, Service, check};
use crate::{direct, http};
use anyhow::{Context, Result};
use formats::program::print_line;
use ros2::Ros2Config;
use ros2::planner::{Ask, Planner, Refused, SessionInfo};
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// How often the service looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);

/// The session that was opened first, as HTTP shows it too.
struct First(Arc<Service>);

impl First {
    fn entry(&self) -> Result<Arc<Entry>, Refused> {
        self.0.first().map_err(told)
    }

    /// Lays settings over those of the session, for its next scan already.
    fn configure(&self, changes: &[u8]) -> Result<Reply, Refusal> {
        let changes = serde_json::from_slice(changes)
            .map_err(|e| Refusal::new(400, "bad_config", format!("config is not as expected: {e}")))?;
        let entry = self.0.first()?;
        let mut open = entry.open.blocking_lock();
        // The settings of a session that has not been read yet are on disk: it is read when it is first asked for something.
        self.work(&entry, &mut open, request::Ask::Export)?;
        let config = over(open.session().config(), Some(changes))?;
        check(&config)?;
        self.work(&entry, &mut open, request::Ask::Configure(Box::new(config)))
    }

    fn work(&self, entry: &Entry, open: &mut Open, ask: request::Ask) -> Result<Reply, Refusal> {
        let spare = self.0.memory().take(ask.work())?;
        self.0.work(entry, open, ask, None, &self.0.patience(), spare)
    }
}

fn told(refusal: Refusal) -> Refused {
    Refused { code: refusal.code.to_owned(), message: refusal.message }
}

impl Planner for First {
    fn ask(&self, ask: Ask, body: &[u8]) -> Result<Vec<u8>, Refused> {
        let method = match ask {
            Ask::Configure => return self.configure(body).map(|reply| reply.body.to_vec()).map_err(told),
            Ask::AddScan => Method::AddScan,
            Ask::NextView => Method::NextView,
            Ask::Undo => Method::Undo,
            Ask::Reset => Method::Reset,
            Ask::Export => Method::Export,
        };
        let session = self.entry()?.name();
        let reply = direct::answer(&self.0, method, Some(&session), Body::Whole(body), None).map_err(told)?;
        Ok(reply.body.to_vec())
    }

    fn session(&self) -> Result<SessionInfo, Refused> {
        let entry = self.entry()?;
        Ok(SessionInfo { name: entry.name(), scans: entry.scans(), kept: self.0.keeps_state() })
    }
}

/// Answers until `stop` is set; then what runs is answered, as far as it takes no longer than `service.stop_ms`.
///
/// # Errors
/// No network; the address of HTTP cannot be had.
pub fn serve(
    service: &Arc<Service>,
    config: &Ros2Config,
    http: Option<SocketAddr>,
    stop: &'static AtomicBool,
) -> Result<()> {
    let planner = First(Arc::clone(service));
    // Before HTTP can open another.
    planner.session().with_context(|| "the session of --ros2")?;
    thread::scope(|scope| {
        let node = scope.spawn(|| {
            let ended = ros2::node::run(config, &planner, stop, |name| {
                let _ = print_line(format_args!("listening as {name}"));
            });
            stop.store(true, Ordering::SeqCst);
            ended
        });
        let served = match http {
            Some(address) => http::serve(Arc::clone(service), address, stop, || !node.is_finished())
                .with_context(|| format!("--http {address}")),
            None => {
                wait(service, stop, || node.is_finished());
                Ok(())
            }
        };
        stop.store(true, Ordering::SeqCst);
        let ended = node.join().map_err(|_| anyhow::anyhow!("the node of --ros2 ended because of a bug"))?;
        served.and(ended.context("--ros2"))
    })
}

/// Until the node has ended: asked to stop, what runs may take `service.stop_ms`.
fn wait(service: &Service, stop: &AtomicBool, ended: impl Fn() -> bool) {
    while !stop.load(Ordering::SeqCst) && !ended() {
        thread::sleep(LOOK);
    }
    service.stopping.set();
    let mut left = Duration::from_millis(service.limits().stop_ms);
    while !ended() && !left.is_zero() {
        thread::sleep(LOOK);
        left = left.saturating_sub(LOOK);
    }
    service.halted.set();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::ServiceConfig;
    use planning::SessionConfig;
    use std::path::Path;

    fn first(folder: &Path) -> First {
        let service = Service::new(SessionConfig::default(), None, ServiceConfig::default());
        First(Arc::new(service.keeping_state(folder).expect("a folder")))
    }

    #[test]
    fn settings_are_laid_over_those_that_the_session_had_before_a_restart() {
        let place = tempfile::tempdir().expect("a folder");
        let node = first(place.path());
        node.ask(Ask::Configure, br#"{"min_points": 40}"#).expect("changed");
        for wrong in [r#"{"min_points": -1}"#, r#"{"stop_below": 7}"#, r#"{"max_points": 0}"#, "[]", "{"] {
            assert_eq!(node.ask(Ask::Configure, wrong.as_bytes()).expect_err(wrong).code, "bad_config");
        }
        drop(node);
        let node = first(place.path());
        node.ask(Ask::Configure, br#"{"stop_below": 0.1}"#).expect("changed");
        let body = node.ask(Ask::Export, b"").expect("an export");
        let export: serde_json::Value = serde_json::from_slice(&body).expect("JSON");
        let config: SessionConfig = serde_json::from_value(export["config"].clone()).expect("settings");
        assert_eq!(config, SessionConfig { min_points: 40, stop_below: 0.1, ..SessionConfig::default() });
    }
}
