//! Answers of the planner as messages.

use crate::messages::{Header, Pose, PoseArray, PoseStamped};
use crate::planner::{MadeOf, SessionInfo};
use planning::Answer;
use planning::answer::Candidate;
use serde::Serialize;
use serde_json::{Value, json};

/// What `plan` made its answer of.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Used {
    /// Where the scan came from.
    pub topic: String,
    /// Its frame.
    pub frame: String,
    /// Its time, seconds.
    pub stamp: f64,
    /// How long ago it came, seconds.
    pub age_s: f64,
    /// What it was made of.
    #[serde(flatten)]
    pub made_of: MadeOf,
    /// Why it could not be registered and is not in the session; absent where it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rejected: Option<String>,
}

/// The view to take: none where none is left, or none is worth it.
fn next(answer: &Answer) -> Option<&Candidate> {
    answer.next.as_ref().filter(|_| !answer.stop.stop)
}

/// `next_view`: the pose of the camera's optical frame (+X right, +Y down, +Z forward) in the base frame.
pub fn next_view(answer: &Answer, header: &Header) -> Option<PoseStamped> {
    let candidate = next(answer)?;
    Some(PoseStamped { header: header.clone(), pose: (&candidate.world_from_camera).into() })
}

/// `candidates`: the views that may be taken, best first.
pub fn candidates(answer: &Answer, header: &Header) -> PoseArray {
    let allowed = answer.candidates.iter().filter(|c| c.objections.is_empty());
    let poses: Vec<Pose> = allowed.map(|c| (&c.world_from_camera).into()).collect();
    PoseArray { header: header.clone(), poses }
}

/// The message of the service `plan`: JSON in one line.
pub fn report(answer: &Answer, frame: &str, session: &SessionInfo, used: Option<&Used>, notes: &[String]) -> String {
    let view = next(answer).map(|c| {
        let mut view = json!({
            "frame": frame,
            "position_m": c.world_from_camera.translation_m,
            "quaternion_xyzw": c.world_from_camera.quaternion_xyzw,
            "target_m": c.target_m,
            "score": c.score,
            "expected_gain": c.expected_gain,
        });
        if let Some(reached) = &c.reached {
            view["joints"] = json!(reached.joints);
        }
        if let Some(table) = &c.table {
            view["table"] = json!(table);
        }
        view
    });
    let report = json!({
        "next": view,
        "stop": view_is_last(answer),
        "reason": answer.reason(),
        "session": session,
        "scan": used,
        "planner": answer.planner,
        "missing": answer.missing.as_ref().map_or(Value::Null, |m| json!(m.share)),
        "notes": notes,
        "warnings": answer.warnings,
    });
    report.to_string()
}

/// Whether there is nothing more to do.
fn view_is_last(answer: &Answer) -> bool {
    next(answer).is_none()
}
