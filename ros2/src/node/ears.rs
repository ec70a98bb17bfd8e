//! Subscriptions: everything that comes is put into the inbox.

use super::{LOOK, NodeError, failed, name};
use crate::config::{Reliability, Ros2Config};
use crate::inbox::{Inbox, Measurement};
use crate::messages::{CameraInfo, Image, PointCloud2, TFMessage};
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{MessageTypeName, Node, Subscription};
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

pub(super) struct Ears {
    cloud: Option<Subscription<PointCloud2>>,
    depth: Option<Subscription<Image>>,
    info: Option<Subscription<CameraInfo>>,
    tf: Subscription<TFMessage>,
    tf_static: Subscription<TFMessage>,
    poll: Poll,
}

fn subscribe<M: DeserializeOwned + 'static>(
    node: &mut Node,
    poll: &Poll,
    topic: &str,
    (package, kind): (&str, &str),
    qos: &QosProfile,
) -> Result<Subscription<M>, NodeError> {
    let made = node.create_topic(&name(topic)?, MessageTypeName::new(package, kind), qos).map_err(failed(topic))?;
    let mut subscription = node.create_subscription(&made, None).map_err(failed(topic))?;
    // All are looked at whichever wakes the thread.
    poll.registry().register(&mut subscription, Token(0), Interest::READABLE).map_err(failed(topic))?;
    Ok(subscription)
}

impl Ears {
    pub(super) fn new(node: &mut Node, config: &Ros2Config) -> Result<Self, NodeError> {
        let poll = Poll::new().map_err(failed("polling"))?;
        let newest = QosProfile::subscription_default();
        let scans = match config.reliability {
            Reliability::BestEffort => newest.clone(),
            Reliability::Reliable => newest.clone().reliability_reliable(WhenFull::DEFAULT),
        };
        let (mut cloud, mut depth, mut info) = (None, None, None);
        if config.depth_topic.is_empty() {
            let kind = ("sensor_msgs", "PointCloud2");
            cloud = Some(subscribe(node, &poll, &config.cloud_topic, kind, &scans)?);
        } else {
            depth = Some(subscribe(node, &poll, &config.depth_topic, ("sensor_msgs", "Image"), &scans)?);
            info = Some(subscribe(node, &poll, &config.info_topic(), ("sensor_msgs", "CameraInfo"), &newest)?);
        }
        let many = newest.history(History::KeepLast { depth: 100 });
        let latched = many.clone().reliability_reliable(WhenFull::DEFAULT).durability(Durability::TransientLocal);
        let tf = subscribe(node, &poll, "/tf", ("tf2_msgs", "TFMessage"), &many)?;
        let tf_static = subscribe(node, &poll, "/tf_static", ("tf2_msgs", "TFMessage"), &latched)?;
        Ok(Self { cloud, depth, info, tf, tf_static, poll })
    }
}

/// Everything that has come on a topic: from whom, and what, or why it cannot be read.
fn drain<M: DeserializeOwned + 'static>(
    subscription: &Subscription<M>,
    mut each: impl FnMut(String, Result<M, String>),
) {
    loop {
        match subscription.take() {
            Ok(Some((message, info))) => each(format!("{:?}", info.publisher_gid()), Ok(message)),
            Ok(None) => return,
            Err(error) => each(String::new(), Err(format!("{error:?}"))),
        }
    }
}

/// Listens until `stop` is set.
pub(super) fn listen(mut ears: Ears, inbox: &Inbox, config: &Ros2Config, stop: &AtomicBool) {
    let mut events = Events::with_capacity(16);
    let scan = |sender, read: Result<Measurement, String>| match read {
        Ok(measurement) => inbox.take_scan(sender, measurement),
        Err(why) => {
            tracing::warn!("{}: {why}", config.scan_topic());
            inbox.could_not_read(why);
        }
    };
    while !stop.load(Ordering::SeqCst) {
        if let Err(error) = ears.poll.poll(&mut events, Some(LOOK)) {
            tracing::debug!("polling: {error}");
        }
        for (topic, subscription, fixed) in [("/tf", &ears.tf, false), ("/tf_static", &ears.tf_static, true)] {
            drain(subscription, |_, read| match read {
                Ok(message) => {
                    for complaint in inbox.take_transforms(&message, fixed) {
                        tracing::warn!("{topic}: {complaint}");
                    }
                }
                Err(why) => tracing::warn!("{topic}: {why}"),
            });
        }
        if let Some(info) = &ears.info {
            drain(info, |_, read| match read {
                Ok(message) => inbox.take_camera(message),
                Err(why) => tracing::warn!("{}: {why}", config.info_topic()),
            });
        }
        if let Some(cloud) = &ears.cloud {
            drain(cloud, |sender, read| scan(sender, read.map(|m| Measurement::Cloud(Arc::new(m)))));
        }
        if let Some(depth) = &ears.depth {
            drain(depth, |sender, read| scan(sender, read.map(|m| Measurement::Depth(Arc::new(m)))));
        }
    }
}
