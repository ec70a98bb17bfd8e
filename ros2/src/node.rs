//! The node on the network: topics in, services, topics out.

mod ears;
mod mouth;
mod parameters;

use crate::Ros2Config;
use crate::config::Services;
use crate::desk::{Desk, Pending, refused};
use crate::inbox::Inbox;
use crate::messages::{Header, Time, TriggerRequest, TriggerResponse};
use crate::planner::{Ask, Planner, Refused};
use ears::{Ears, listen};
use formats::config::SettingError;
use futures::executor::block_on;
use mouth::Mouth;
use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::qos::{History, QosProfile};
use ros2_client::{Context, Message, Name, Node, NodeName, NodeOptions, Server, ServiceMapping, ServiceTypeName};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

/// How often the node looks whether it shall stop.
const LOOK: Duration = Duration::from_millis(50);
/// How often it reports its status.
const TELL: Duration = Duration::from_secs(1);

impl Message for TriggerRequest {}
impl Message for TriggerResponse {}

type TriggerServer = Server<TriggerRequest, TriggerResponse>;

/// Why there is no node.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// A setting.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The network, or a name on it.
    #[error("{what}: {cause}")]
    Network {
        /// What was tried.
        what: String,
        /// What came of it.
        cause: String,
    },
}

/// An error of `ros2-client` while trying this.
fn failed<E: std::fmt::Debug>(what: impl Into<String>) -> impl FnOnce(E) -> NodeError {
    move |cause| NodeError::Network { what: what.into(), cause: format!("{cause:?}") }
}

/// A name such as `/camera/points`.
fn name(whole: &str) -> Result<Name, NodeError> {
    let (namespace, base) = whole.rsplit_once('/').unwrap_or(("", whole));
    let namespace = if namespace.is_empty() { "/" } else { namespace };
    Name::new(namespace, base).map_err(failed(whole))
}

/// Answers until `stop` is set. `ready` is called once all topics and services are there.
///
/// # Errors
/// No network, or a setting out of range.
pub fn run(
    config: &Ros2Config,
    planner: &dyn Planner,
    stop: &AtomicBool,
    ready: impl FnOnce(&str),
) -> Result<(), NodeError> {
    config.check()?;
    let (context, mut node) = join(config)?;
    let spinner = node.spinner().map_err(failed("parameter services"))?;
    let services = thread::spawn(move || block_on(spinner.spin()));
    let ended = serve(&mut node, config, planner, stop, ready);
    // Its parameter services first, then the participant that they belong to.
    drop(node);
    let _ = services.join();
    drop(context);
    ended
}

fn serve(
    node: &mut Node,
    config: &Ros2Config,
    planner: &dyn Planner,
    stop: &AtomicBool,
    ready: impl FnOnce(&str),
) -> Result<(), NodeError> {
    let inbox = Inbox::new(Duration::from_secs_f64(config.tf_kept_s));
    let ears = Ears::new(node, config)?;
    let mouth = Mouth::new(node, config)?;
    let [mut plan, mut undo, mut reset] =
        [server(node, config, "plan")?, server(node, config, "undo")?, server(node, config, "reset")?];
    let mut poll = Poll::new().map_err(failed("polling"))?;
    for (i, server) in [&mut plan, &mut undo, &mut reset].into_iter().enumerate() {
        poll.registry().register(server, Token(i), Interest::READABLE).map_err(failed("polling"))?;
    }
    let session = planner.session().map_err(failed("the session"))?;
    mouth.note(match (session.kept, session.scans) {
        (true, scans) => format!("session {} resumes with {scans} scans", session.name),
        (false, 0) => {
            format!("session {} is new: scans of an earlier run are lost (--state DIR keeps them)", session.name)
        }
        (false, scans) => format!("session {} has {scans} scans", session.name),
    });
    ready(&config.node);
    thread::scope(|scope| {
        scope.spawn(|| listen(ears, &inbox, config, stop));
        let desk = Desk { inbox: &inbox, planner, stop };
        let (mut pending, mut events) = (Pending::default(), Events::with_capacity(8));
        let mut told = Instant::now();
        mouth.status(&desk, "ready", None);
        // Asked to stop, what runs is answered, and nothing new is begun.
        let goes_on = || !stop.load(Ordering::SeqCst);
        while goes_on() {
            if let Err(error) = poll.poll(&mut events, Some(LOOK)) {
                // A signal.
                tracing::debug!("polling: {error}");
            }
            let mut busy = false;
            while goes_on()
                && let Some(id) = next_request(&plan)
            {
                busy = true;
                mouth.status(&desk, "planning", None);
                let (settings, changes) = parameters::current(node, config);
                let stamp = Time::from_nanoseconds(node.time_now().to_nanos());
                let header = Header { stamp, frame_id: config.base_frame.clone() };
                let (response, published) = guarded(|| desk.plan(&settings, &changes, &header, &mut pending));
                tell("plan", &response);
                if let Some(published) = published {
                    mouth.publish(published);
                }
                mouth.status(&desk, "ready", Some(&response));
                answer(&plan, id, response);
            }
            for (server, ask, what) in [(&undo, Ask::Undo, "undo"), (&reset, Ask::Reset, "reset")] {
                while goes_on()
                    && let Some(id) = next_request(server)
                {
                    busy = true;
                    let (response, _) = guarded(|| (desk.take_back(ask, &mut pending), None::<()>));
                    tell(what, &response);
                    mouth.status(&desk, "ready", Some(&response));
                    answer(server, id, response);
                }
            }
            if busy || told.elapsed() >= TELL {
                told = Instant::now();
                mouth.status(&desk, "ready", None);
            }
        }
        // What was said last is on its way.
        thread::sleep(LOOK);
    });
    Ok(())
}

fn join(config: &Ros2Config) -> Result<(Context, Node), NodeError> {
    let environment = std::env::var("ROS_DOMAIN_ID").ok();
    let domain = config.domain(environment.as_deref())?;
    let mut participant =
        DomainParticipantBuilder::new(domain).socket_receive_buffer_size(config.receive_buffer_mib << 20);
    if !config.interfaces.is_empty() {
        participant = participant.with_only_networks(config.interfaces.iter().copied());
    }
    let participant = participant.build().map_err(failed(format!("domain {domain}")))?;
    let context = Context::from_domain_participant(participant).map_err(failed(format!("domain {domain}")))?;
    let (namespace, base) = config.node_name();
    let named = NodeName::new(namespace, base).map_err(failed(&config.node))?;
    let options = parameters::declare(NodeOptions::new(), config);
    let node = context.new_node(named, options).map_err(failed(&config.node))?;
    Ok((context, node))
}

fn server(node: &mut Node, config: &Ros2Config, base: &str) -> Result<TriggerServer, NodeError> {
    let mapping = match config.services {
        Services::FastRtps => ServiceMapping::Enhanced,
        Services::CycloneDds => ServiceMapping::Cyclone,
    };
    let whole = format!("{}/{base}", config.node);
    let qos = QosProfile::publisher_default().history(History::KeepLast { depth: 10 });
    node.create_server(mapping, &name(&whole)?, &ServiceTypeName::new("std_srvs", "Trigger"), qos.clone(), qos)
        .map_err(failed(whole))
}

fn next_request(server: &TriggerServer) -> Option<ros2_client::RmwRequestId> {
    loop {
        match server.receive_request() {
            Ok(request) => return request.map(|(id, _)| id),
            Err(error) => tracing::warn!("a request that cannot be read: {error:?}"),
        }
    }
}

fn answer(server: &TriggerServer, id: ros2_client::RmwRequestId, response: TriggerResponse) {
    if let Err(error) = server.send_response(id, response) {
        tracing::warn!("an answer that cannot be sent: {error:?}");
    }
}

fn tell(what: &str, response: &TriggerResponse) {
    match response.success {
        true => tracing::info!("{what}: {}", response.message),
        false => tracing::warn!("{what}: {}", response.message),
    }
}

/// A panic costs the request alone.
fn guarded<T>(work: impl FnOnce() -> (TriggerResponse, Option<T>)) -> (TriggerResponse, Option<T>) {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|_| {
        let message = "this is a bug; the session is unchanged".to_owned();
        (refused(&Refused { code: "internal".to_owned(), message }), None)
    })
}
