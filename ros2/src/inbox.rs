//! What has come and waits to be asked for: the newest scan, its camera, the transforms.

use crate::Ros2Config;
use crate::answer::Used;
use crate::cloud::Placement;
use crate::messages::{CameraInfo, Header, Image, PointCloud2, TFMessage};
use crate::planner::Refused;
use crate::transforms::{Found, TransformError, Transforms, plain};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Transforms farther apart than this are interpolated, and it is said.
const GAP_S: f64 = 0.5;
/// Cameras and publishers that are remembered at most.
const MOST: usize = 256;
/// How often who waits looks whether the node stops.
const LOOK: Duration = Duration::from_millis(100);

/// A scan as it came.
#[derive(Clone, Debug)]
pub enum Measurement {
    /// A cloud.
    Cloud(Arc<PointCloud2>),
    /// A depth image.
    Depth(Arc<Image>),
}

impl Measurement {
    fn header(&self) -> &Header {
        match self {
            Self::Cloud(cloud) => &cloud.header,
            Self::Depth(image) => &image.header,
        }
    }
}

#[derive(Clone, Debug)]
struct Arrived {
    number: u64,
    measurement: Measurement,
    at: Instant,
}

struct Received {
    newest: Option<Arrived>,
    count: u64,
    cameras: BTreeMap<String, Arc<CameraInfo>>,
    transforms: Transforms,
    /// When each publisher of scans sent its last, and in which frame.
    senders: BTreeMap<String, (Instant, String)>,
    /// Why the last message that could not be read could not.
    unread: Option<String>,
}

/// What has come.
pub struct Inbox {
    received: Mutex<Received>,
    changed: Condvar,
    used: AtomicU64,
}

/// A scan that can be taken.
#[derive(Clone, Debug)]
pub struct Ready {
    /// To tell it was used.
    pub number: u64,
    /// The scan.
    pub measurement: Measurement,
    /// The camera of a depth image.
    pub camera: Option<Arc<CameraInfo>>,
    /// Where it was taken.
    pub placement: Placement,
    /// Which one it is.
    pub used: Used,
    /// What a user should know.
    pub notes: Vec<String>,
}

/// Why there is no scan, and whether waiting may help.
struct NotYet {
    refused: Refused,
    may_come: bool,
}

impl NotYet {
    fn new(code: &str, message: String) -> Self {
        Self { refused: Refused { code: code.to_owned(), message }, may_come: true }
    }
}

impl Inbox {
    /// Empty.
    pub fn new(tf_kept: Duration) -> Self {
        let received = Received {
            newest: None,
            count: 0,
            cameras: BTreeMap::new(),
            transforms: Transforms::new(tf_kept),
            senders: BTreeMap::new(),
            unread: None,
        };
        Self { received: Mutex::new(received), changed: Condvar::new(), used: AtomicU64::new(0) }
    }

    fn lock(&self) -> MutexGuard<'_, Received> {
        self.received.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A scan has come from this publisher; the one before is dropped, taken or not.
    pub fn take_scan(&self, sender: String, measurement: Measurement) {
        let mut received = self.lock();
        let at = Instant::now();
        received.count += 1;
        if received.senders.len() >= MOST {
            received.senders.clear();
        }
        received.senders.insert(sender, (at, measurement.header().frame_id.clone()));
        received.newest = Some(Arrived { number: received.count, measurement, at });
        received.unread = None;
        self.changed.notify_all();
    }

    /// A camera has sent its calibration.
    pub fn take_camera(&self, info: CameraInfo) {
        let mut received = self.lock();
        if received.cameras.len() < MOST || received.cameras.contains_key(&info.header.frame_id) {
            received.cameras.insert(info.header.frame_id.clone(), Arc::new(info));
        }
        self.changed.notify_all();
    }

    /// Transforms have come; what there is to complain of is returned.
    pub fn take_transforms(&self, message: &TFMessage, fixed: bool) -> Vec<String> {
        let complaints = self.lock().transforms.take(message, fixed);
        self.changed.notify_all();
        complaints
    }

    /// A message on the topic of scans could not be read.
    pub fn could_not_read(&self, why: String) {
        self.lock().unread = Some(why);
    }

    /// The scan of this number has been added to the session.
    pub fn mark_used(&self, number: u64) {
        self.used.fetch_max(number, Ordering::SeqCst);
    }

    /// Scans that have come, and seconds since the last one.
    pub fn arrivals(&self) -> (u64, Option<f64>) {
        let received = self.lock();
        (received.count, received.newest.as_ref().map(|n| n.at.elapsed().as_secs_f64()))
    }

    /// The newest scan that has not been used, with its camera and its place; waits for what may still come, until `stop`.
    ///
    /// # Errors
    /// Why there is none.
    pub fn ready(&self, config: &Ros2Config, stop: &AtomicBool) -> Result<Ready, Refused> {
        let end = Instant::now() + config.wait();
        let mut received = self.lock();
        let mut chosen = None;
        loop {
            let found =
                self.choose(&received, config, &mut chosen).and_then(|arrived| placed(&received, config, arrived));
            let NotYet { refused, may_come } = match found {
                Ok(ready) => return Ok(ready),
                Err(why) => why,
            };
            let left = end.saturating_duration_since(Instant::now());
            if !may_come || left.is_zero() || stop.load(Ordering::SeqCst) {
                return Err(refused);
            }
            let waited = self.changed.wait_timeout(received, left.min(LOOK));
            received = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Chosen once: a scan that waits for its transform is not left for a newer one, which would wait as well.
    fn choose(
        &self,
        received: &Received,
        config: &Ros2Config,
        chosen: &mut Option<Arrived>,
    ) -> Result<Arrived, NotYet> {
        if let Some(arrived) = chosen {
            return Ok(arrived.clone());
        }
        let topic = config.scan_topic();
        let unread = received
            .unread
            .as_ref()
            .map_or(String::new(), |why| format!("; the last message there could not be read: {why}"));
        let Some(newest) = &received.newest else {
            return Err(NotYet::new("no_scan", format!("nothing has arrived on {topic}{unread}")));
        };
        let age = newest.at.elapsed().as_secs_f64();
        if newest.number <= self.used.load(Ordering::SeqCst) {
            let message = format!(
                "the newest scan on {topic}, {age:.1} s ago, has already been used: none has arrived since{unread}"
            );
            return Err(NotYet::new("no_new_scan", message));
        }
        if age > config.max_age_s {
            let most = config.max_age_s;
            let message = format!(
                "the newest scan on {topic} arrived {age:.1} s ago; scans older than {most} s are not used (ros2.max_age_s){unread}"
            );
            return Err(NotYet::new("stale_scan", message));
        }
        Ok(chosen.insert(newest.clone()).clone())
    }
}

/// The scan with its camera and its place.
fn placed(received: &Received, config: &Ros2Config, arrived: Arrived) -> Result<Ready, NotYet> {
    let Header { stamp, frame_id } = arrived.measurement.header().clone();
    let mut notes = Vec::new();
    let camera = match &arrived.measurement {
        Measurement::Cloud(_) => None,
        Measurement::Depth(_) => Some(received.cameras.get(&frame_id).cloned().ok_or_else(|| {
            let known: Vec<&str> = received.cameras.keys().map(String::as_str).collect();
            let message =
                format!("no CameraInfo of {frame_id:?} has arrived on {} (of others: {known:?})", config.info_topic());
            NotYet::new("no_camera_info", message)
        })?),
    };
    if frame_id.is_empty() {
        let message = format!("the scan on {} names no frame: header.frame_id is empty", config.scan_topic());
        return Err(NotYet { may_come: false, ..NotYet::new("no_frame", message) });
    }
    let at = (stamp.nanoseconds() != 0).then(|| stamp.nanoseconds());
    if at.is_none() {
        notes.push("the scan has no time: the newest transforms were used".to_owned());
    }
    let base = &config.base_frame;
    let mut lookup = |frame: &str| -> Result<Found, NotYet> {
        let found = received.transforms.lookup(base, frame, at).map_err(|why: TransformError| NotYet {
            may_come: why.may_come(),
            ..NotYet::new("no_transform", format!("the position of {frame:?} in {base:?} is unknown: {why}"))
        })?;
        if let Some((gap, child)) = found.gap.as_ref().filter(|g| g.0 > GAP_S) {
            let note = format!("where {child:?} was is interpolated between transforms {gap:.1} s apart");
            if !notes.contains(&note) {
                notes.push(note);
            }
        }
        Ok(found)
    };
    let (sensor, is_image) = (config.sensor_frame.as_str(), camera.is_some());
    // An image is in the frame of its camera; where that is named, its header's need not be known.
    let base_from_frame = lookup(if is_image && !sensor.is_empty() { sensor } else { &frame_id })?.pose;
    let in_base = sensor.is_empty() && plain(base) == plain(&frame_id);
    let base_from_sensor = match sensor {
        // Points in the base frame were brought there from somewhere.
        "" if in_base && !is_image => None,
        sensor if is_image || sensor.is_empty() => Some(base_from_frame),
        sensor => Some(lookup(sensor)?.pose),
    };
    if in_base {
        notes.push(match &camera {
            None => format!(
                "the scan is already in {base:?}, but its camera's position is unknown: name its frame (ros2.sensor_frame)"
            ),
            Some(_) => format!(
                "the image is in {base:?}, so its camera is taken to stand in the origin of that frame: if it does not, name its \
                 frame (ros2.sensor_frame)"
            ),
        });
    }
    let recent = |at: &Instant| at.elapsed().as_secs_f64() <= config.max_age_s;
    let others: Vec<&str> = received.senders.values().filter(|s| recent(&s.0)).map(|s| s.1.as_str()).collect();
    if others.len() > 1 {
        notes.push(format!(
            "{} publishers send on {} (in frames {others:?}): the newest scan was taken, in {frame_id:?}",
            others.len(),
            config.scan_topic()
        ));
    }
    let used = Used {
        topic: config.scan_topic().to_owned(),
        frame: frame_id,
        stamp: stamp.nanoseconds() as f64 * 1e-9,
        age_s: arrived.at.elapsed().as_secs_f64(),
        ..Used::default()
    };
    let placement = Placement { base_from_frame, base_from_sensor };
    Ok(Ready { number: arrived.number, measurement: arrived.measurement, camera, placement, used, notes })
}

#[cfg(test)]
mod tests;
