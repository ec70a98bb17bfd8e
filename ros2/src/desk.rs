//! Services done: what `plan`, `undo` and `reset` do, whatever brings the request.

use crate::answer::{Used, candidates, next_view, report};
use crate::inbox::{Inbox, Measurement, Ready};
use crate::markers::{Known, markers};
use crate::messages::{Header, MarkerArray, PoseArray, PoseStamped, TriggerResponse};
use crate::planner::{Ask, Planner, Refused, ScanRequest, SessionInfo};
use crate::{MessageError, Ros2Config, cloud, image};
use planning::Answer;
use serde::Deserialize;
use serde_json::Value;
use std::sync::atomic::AtomicBool;

/// What is to be published after `plan`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Published {
    /// None where no view is left, or none is worth it.
    pub next_view: Option<PoseStamped>,
    /// All that may be taken.
    pub candidates: PoseArray,
    /// For RViz.
    pub markers: MarkerArray,
}

/// What happens between one request and the next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Pending {
    /// A scan was added or rejected, and no view was had after it: the next `plan` takes no other first, as long as the session is still
    /// this one.
    scan_without_view: Option<SessionInfo>,
}

/// Where requests are done.
pub struct Desk<'a> {
    /// What has come.
    pub inbox: &'a Inbox,
    /// Who plans.
    pub planner: &'a dyn Planner,
    /// The node stops.
    pub stop: &'a AtomicBool,
}

fn done(message: String) -> TriggerResponse {
    TriggerResponse { success: true, message }
}

/// A refusal as a service reports it.
pub fn refused(refused: &Refused) -> TriggerResponse {
    TriggerResponse { success: false, message: format!("{}: {}", refused.code, refused.message) }
}

fn unreadable(error: &serde_json::Error) -> Refused {
    Refused { code: "internal".to_owned(), message: format!("an answer cannot be read: {error}") }
}

impl From<MessageError> for Refused {
    fn from(error: MessageError) -> Self {
        Self { code: "bad_message".to_owned(), message: error.to_string() }
    }
}

impl Desk<'_> {
    /// Takes the newest scan and plans. `changes`: settings of the session to change, an object as JSON.
    pub fn plan(
        &self,
        config: &Ros2Config,
        changes: &str,
        header: &Header,
        pending: &mut Pending,
    ) -> (TriggerResponse, Option<Published>) {
        match self.try_plan(config, changes, header, pending) {
            Ok((message, published)) => (done(message), Some(published)),
            Err(why) => (refused(&why), None),
        }
    }

    fn try_plan(
        &self,
        config: &Ros2Config,
        changes: &str,
        header: &Header,
        pending: &mut Pending,
    ) -> Result<(String, Published), Refused> {
        let mut notes = Vec::new();
        if !changes.trim().is_empty() {
            // Before the scan: they may decide whether it is taken, and what of it.
            self.planner.ask(Ask::Configure, changes.as_bytes())?;
        }
        let session = self.planner.session()?;
        // Over HTTP, scans may have been taken back or added meanwhile.
        pending.scan_without_view = pending.scan_without_view.take().filter(|then| *then == session);
        let used = match pending.scan_without_view {
            Some(_) => None,
            None => Some(self.add_scan(config, &mut notes)?),
        };
        pending.scan_without_view = Some(self.planner.session()?);
        let body = self.planner.ask(Ask::NextView, b"").map_err(|why| {
            let taken = used.as_ref().map_or_else(String::new, |used| match &used.rejected {
                None => "the scan was added, but planning failed (plan again): ".to_owned(),
                Some(reason) => format!("the scan was rejected ({reason}), and planning failed (plan again): "),
            });
            Refused { message: format!("{taken}{}", why.message), ..why }
        })?;
        let answer: Answer = serde_json::from_slice(&body).map_err(|e| unreadable(&e))?;
        let known: Known = serde_json::from_slice(&self.planner.ask(Ask::Export, b"")?).map_err(|e| unreadable(&e))?;
        let session = self.planner.session()?;
        *pending = Pending::default();
        let published = Published {
            next_view: next_view(&answer, header),
            candidates: candidates(&answer, header),
            markers: markers(known, &answer, header),
        };
        Ok((report(&answer, &header.frame_id, &session, used.as_ref(), &notes), published))
    }

    /// Adds the newest scan. One that is rejected because it cannot be registered has been taken too: it would be rejected again, whereas
    /// the next view looks elsewhere.
    fn add_scan(&self, config: &Ros2Config, notes: &mut Vec<String>) -> Result<Used, Refused> {
        #[derive(Default, Deserialize)]
        struct Added {
            #[serde(default)]
            notes: Vec<String>,
        }
        let mut ready = self.inbox.ready(config, self.stop)?;
        let ScanRequest { body, made_of } = request(&ready, config.rectified)?;
        let mut used = Used { made_of, ..ready.used };
        let added = match self.planner.ask(Ask::AddScan, &body) {
            Ok(added) => serde_json::from_slice(&added).map_err(|e| unreadable(&e)),
            Err(why) if why.code == Refused::UNREGISTERED => {
                used.rejected = Some(why.message);
                Ok(Added::default())
            }
            Err(why) => return Err(why),
        };
        self.inbox.mark_used(ready.number);
        let added = added?;
        notes.append(&mut ready.notes);
        notes.extend(added.notes);
        Ok(used)
    }

    /// Takes the last scan back, or forgets all.
    pub fn take_back(&self, ask: Ask, pending: &mut Pending) -> TriggerResponse {
        let answer = self.planner.ask(ask, b"").and_then(|body| {
            let answer: Value = serde_json::from_slice(&body).map_err(|e| unreadable(&e))?;
            Ok(answer.to_string())
        });
        match answer {
            Ok(message) => {
                *pending = Pending::default();
                done(message)
            }
            Err(why) => refused(&why),
        }
    }
}

fn request(ready: &Ready, rectified: bool) -> Result<ScanRequest, Refused> {
    match (&ready.measurement, &ready.camera) {
        (Measurement::Cloud(cloud), _) => Ok(cloud::request(cloud, &ready.placement)?),
        (Measurement::Depth(image), Some(camera)) => {
            Ok(image::request(image, camera, &ready.placement.base_from_frame, rectified)?)
        }
        (Measurement::Depth(_), None) => {
            Err(Refused { code: "no_camera_info".to_owned(), message: "no CameraInfo has come".to_owned() })
        }
    }
}

#[cfg(test)]
mod tests;
