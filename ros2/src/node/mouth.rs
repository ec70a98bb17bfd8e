//! Publishers.

use super::{NodeError, failed, name};
use crate::Ros2Config;
use crate::desk::{Desk, Published};
use crate::messages::{MarkerArray, PoseArray, PoseStamped, Text, TriggerResponse};
use ros2_client::qos::{Durability, QosProfile};
use ros2_client::{MessageTypeName, Node, Publisher};
use serde::Serialize;
use serde_json::json;
use std::cell::RefCell;

pub(super) struct Mouth {
    next_view: Publisher<PoseStamped>,
    candidates: Publisher<PoseArray>,
    markers: Publisher<MarkerArray>,
    status: Publisher<Text>,
    topic: String,
    note: RefCell<String>,
    last: RefCell<Option<TriggerResponse>>,
}

fn publisher<M: Serialize>(
    node: &mut Node,
    topic: &str,
    (package, kind): (&str, &str),
    qos: &QosProfile,
) -> Result<Publisher<M>, NodeError> {
    let made = node.create_topic(&name(topic)?, MessageTypeName::new(package, kind), qos).map_err(failed(topic))?;
    node.create_publisher(&made, None).map_err(failed(topic))
}

fn say<M: Serialize>(publisher: &Publisher<M>, message: M) {
    if let Err(error) = publisher.publish(message) {
        tracing::warn!("a message that cannot be sent: {:?}", error.forget_data());
    }
}

impl Mouth {
    pub(super) fn new(node: &mut Node, config: &Ros2Config) -> Result<Self, NodeError> {
        // A pose moves a robot: who comes late does not get the last one.
        let now = QosProfile::publisher_default();
        let latched = now.clone().durability(Durability::TransientLocal);
        let at = |topic: &str| format!("{}/{topic}", config.node);
        Ok(Self {
            next_view: publisher(node, &at("next_view"), ("geometry_msgs", "PoseStamped"), &now)?,
            candidates: publisher(node, &at("candidates"), ("geometry_msgs", "PoseArray"), &now)?,
            markers: publisher(node, &at("markers"), ("visualization_msgs", "MarkerArray"), &latched)?,
            status: publisher(node, &at("status"), ("std_msgs", "String"), &latched)?,
            topic: config.scan_topic().to_owned(),
            note: RefCell::default(),
            last: RefCell::default(),
        })
    }

    /// Said with every status from now on.
    pub(super) fn note(&self, note: String) {
        tracing::info!("{note}");
        *self.note.borrow_mut() = note;
    }

    pub(super) fn publish(&self, published: Published) {
        say(&self.candidates, published.candidates);
        say(&self.markers, published.markers);
        if let Some(pose) = published.next_view {
            say(&self.next_view, pose);
        }
    }

    /// How the node is, as JSON.
    pub(super) fn status(&self, desk: &Desk, state: &str, last: Option<&TriggerResponse>) {
        if let Some(response) = last {
            *self.last.borrow_mut() = Some(response.clone());
        }
        let last = self.last.borrow();
        let (arrived, age_s) = desk.inbox.arrivals();
        let status = json!({
            "state": state,
            "note": *self.note.borrow(),
            "session": desk.planner.session().ok(),
            "scans_on_topic": { "topic": self.topic, "arrived": arrived, "last_s_ago": age_s },
            "last_refusal": last.as_ref().filter(|r| !r.success).map(|r| &r.message),
        });
        say(&self.status, Text { data: status.to_string() });
    }
}
