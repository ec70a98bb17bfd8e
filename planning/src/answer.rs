//! The answer: ranked candidates with poses, reasons and warnings, for people and for machines.

use crate::constraints::{Exclusion, Objection};
use crate::planners::auto::Evidence;
use crate::pose::{Pose, rigid};
use crate::registration::Registered;
use crate::registration::registrability::Prediction;
use crate::stop::{Missing, Stop};
use crate::turntable::TableStop;
use crate::{CameraPose, PastScan, Plane, Reached, Surface};
use geometry::View;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// A candidate view. World frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// 0 is the best of those allowed; the excluded ones follow.
    pub rank: usize,
    /// The planner's score less the cost of travel; larger is better.
    pub score: f64,
    /// The planner's own score.
    pub planner_score: f64,
    /// What the camera looks at.
    pub target_m: [f64; 3],
    /// Where the camera stands.
    pub position_m: [f64; 3],
    /// Distance from target to camera.
    pub working_distance_m: f64,
    /// The camera's pose.
    pub world_from_camera: Pose,
    /// Where the turntable stops, and the camera's pose in the cell then; absent without a turntable.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub table: Option<TableStop>,
    /// The arm at this view; absent without an arm, and where it cannot get there.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reached: Option<Reached>,
    /// Expected new surface as a share of the whole, where it can be predicted.
    pub expected_gain: Option<f64>,
    /// Expected share of the scan that is seen already, where it can be predicted.
    pub expected_overlap: Option<f64>,
    /// Why it must not be taken; empty if it may.
    pub objections: Vec<Objection>,
    /// Which of the given views it is, from 0; absent where views are not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub given: Option<usize>,
    /// How well its scan could be registered; absent where that is not asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<Prediction>,
    /// The scan, from 1, that could not be registered yet and that the scan of this view is to hold; absent where it is for none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bridges_to: Option<usize>,
}

impl Candidate {
    /// Where the camera stands in the cell, which does not turn with the table.
    pub fn position_in_cell(&self) -> Point3<f64> {
        Point3::from(self.table.as_ref().map_or(self.position_m, |table| table.cell_from_camera.translation_m))
    }

    /// What it looks at, there.
    fn target_in_cell(&self) -> Point3<f64> {
        let target = Point3::from(self.target_m);
        let in_cell = |table: &TableStop| {
            let (to, _) = rigid(&table.cell_from_camera.matrix).ok()?;
            Some(to * self.pose().inverse() * target)
        };
        self.table.as_ref().and_then(in_cell).unwrap_or(target)
    }

    /// What it looks at, and from where, in the object's frame.
    pub(crate) fn view(&self) -> View {
        View { target: self.target_m.into(), position: self.position_m.into() }
    }

    /// The camera's pose in the object's frame.
    pub(crate) fn pose(&self) -> Isometry3<f64> {
        rigid(&self.world_from_camera.matrix).map_or_else(|_| Isometry3::identity(), |(pose, _)| pose)
    }
}

/// What was planned on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloudSummary {
    /// Scans.
    pub scans: usize,
    /// Points that were given.
    pub points_read: usize,
    /// Points planned on, after cleaning, merging and thinning.
    pub points_used: usize,
    /// Mean distance of neighbouring points.
    pub spacing_m: f64,
    /// Bounding box, smallest and largest corner.
    pub bounding_box_m: [[f64; 3]; 2],
    /// Boundary points: where the measured surface ends.
    pub boundary_points: usize,
}

/// Where a scan whose camera is not known was taken from, as far as its points tell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatedCamera {
    /// World frame, metres.
    pub position_m: [f64; 3],
    /// Degrees, seen from the middle of the scan, within which nine of ten such estimates are.
    pub off_deg: f64,
    /// Share of such estimates that are on the wrong side of the surface.
    pub wrong_side: f64,
}

impl EstimatedCamera {
    pub(crate) fn of(scan: &PastScan) -> Option<Self> {
        let CameraPose::Estimated(trust) = scan.pose else { return None };
        let position_m = scan.world_from_camera.translation.vector.into();
        Some(Self { position_m, off_deg: trust.off_deg(), wrong_side: trust.wrong_side() })
    }
}

/// What registering a scan found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScanRegistration {
    /// Which scan, from 1.
    pub scan: usize,
    /// Whether it, and its camera, were moved by the correction.
    pub moved: bool,
    /// What was found.
    #[serde(flatten)]
    pub found: Registered,
}

fn yes() -> bool {
    true
}

/// The next view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// The view to take; `None` where none is left.
    pub next: Option<Candidate>,
    /// Whether it is worth taking.
    pub stop: Stop,
    /// Which planner decided.
    pub planner: String,
    /// Why that one.
    pub planner_reason: String,
    /// What was known of the scans.
    pub evidence: Evidence,
    /// The cameras that were not given and had to be estimated, each with its doubt.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub estimated_cameras: Vec<EstimatedCamera>,
    /// What registering each scan found, oldest first; absent where nothing was registered.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub registrations: Vec<ScanRegistration>,
    /// What was planned on.
    pub cloud: CloudSummary,
    /// The known and the expected surface, where the planner makes them out.
    pub surface: Option<Surface>,
    /// What is missing of the surface, where the planner makes it out.
    pub missing: Option<Missing>,
    /// What the object stands on, where that was found or given; it is taken away from the scans.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Plane>,
    /// False where the deadline passed before all views were scored, and the best so far was asked for.
    #[serde(default = "yes")]
    pub complete: bool,
    /// All candidates, best first, excluded ones last.
    pub candidates: Vec<Candidate>,
    /// How many candidates each constraint rules out.
    pub excluded: Vec<Exclusion>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

impl Answer {
    /// For a terminal.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        let mut line = |content: String| {
            text.push_str(&content);
            text.push('\n');
        };
        let cloud = &self.cloud;
        let spacing = length(cloud.spacing_m);
        line(format!(
            "{} of {} points from {} scan{}, {spacing} apart, {} at the boundary",
            cloud.points_used,
            cloud.points_read,
            cloud.scans,
            if cloud.scans == 1 { "" } else { "s" },
            cloud.boundary_points
        ));
        if let Some(surface) = &self.surface {
            let [known, expected] = [surface.known_m2, surface.expected_m2].map(area);
            line(format!("surface: {known} measured, {expected} expected where nothing is known yet"));
        }
        if let Some(Plane { normal, offset_m }) = &self.support {
            line(format!("stands on the plane {} . p = {offset_m:.4} m, which is removed", triple(normal)));
        }
        if let Some(missing) = &self.missing {
            describe_missing(missing, &mut line);
        }
        line(format!("planner {}: {}", self.planner, self.planner_reason));
        if let Some(worst) = self.estimated_cameras.iter().max_by(|a, b| a.off_deg.total_cmp(&b.off_deg)) {
            let wrong = self.estimated_cameras.iter().map(|c| c.wrong_side).fold(0.0, f64::max);
            line(format!(
                "cameras estimated: {}, each within {:.0} degrees in nine of ten cases, on the wrong side of the surface in up \
                 to {:.0} %; known positions (--from, --depth) give better results",
                self.estimated_cameras.len(),
                worst.off_deg,
                100.0 * wrong
            ));
        }
        for warning in &self.warnings {
            line(format!("warning: {warning}"));
        }
        match &self.next {
            Some(next) => describe_next(next, &self.stop, &mut line),
            None => line(format!("no next view: {}", self.no_view_reason())),
        }
        let allowed = self.candidates.iter().filter(|c| c.objections.is_empty());
        for candidate in allowed.skip(1).take(4) {
            line(format!(
                "  then {}: score {:.3}, camera {}{}",
                candidate.rank,
                candidate.score,
                triple(&candidate.position_in_cell().coords.into()),
                candidate
                    .table
                    .as_ref()
                    .map_or(String::new(), |table| format!(", table at {} degrees", table.stop_deg))
            ));
        }
        if self.next.is_some() && !self.excluded.is_empty() {
            line(format!("excluded: {}", self.describe_exclusions()));
        }
        text
    }

    /// In a sentence what the next view is good for, or why there is none.
    pub fn reason(&self) -> String {
        let Some(next) = &self.next else { return format!("No next view: {}.", self.no_view_reason()) };
        let percent = |share: f64| match 100.0 * share {
            p if p < 0.95 => "less than 1 %".to_owned(),
            p => format!("{p:.0} %"),
        };
        let bridges = |scan| {
            format!("Bridges to scan {scan}, which could not be registered: it sees surface of both it and the cloud. ")
        };
        let mut text = next.bridges_to.map_or_else(String::new, bridges);
        text += &match next.expected_gain {
            Some(gain) => format!("Sees {} of the surface for the first time", percent(gain)),
            None => "Looks beyond the boundary of what was measured".to_owned(),
        };
        let holes = self.missing.iter().flat_map(|missing| &missing.holes);
        if let Some(hole) = holes.into_iter().find(|hole| hole.best_candidate == Some(next.rank)) {
            let _ = write!(text, " (a part {} across, {})", length(hole.size_m), hole.unseen.describe());
        }
        if let Some(overlap) = next.expected_overlap {
            let _ = write!(text, "; {} of its scan overlaps known surface", percent(overlap));
        }
        if self.stop.stop {
            text += ". Not worth it: no view is expected to reach the stop level";
        }
        text + "."
    }

    /// Why there is no next view.
    pub fn no_view_reason(&self) -> String {
        if self.candidates.is_empty() {
            return "the measured surface has no boundary to look beyond: at its spacing it is closed".to_owned();
        }
        format!("all {} candidates are excluded: {}", self.candidates.len(), self.describe_exclusions())
    }

    fn describe_exclusions(&self) -> String {
        let parts: Vec<String> = self
            .excluded
            .iter()
            .map(|e| {
                let alone = if e.alone > 0 { format!(" ({} of them it alone)", e.alone) } else { String::new() };
                format!("{} excludes {}{alone}", e.constraint.setting(), e.candidates)
            })
            .collect();
        parts.join("; ")
    }
}

fn describe_next(next: &Candidate, stop: &Stop, line: &mut impl FnMut(String)) {
    let which = next.given.map_or(String::new(), |i| format!(" (number {i} of those given, from 0)"));
    line(format!("next view: score {:.3}{which}", next.score));
    let [target, camera] = [next.target_in_cell(), next.position_in_cell()].map(|p| triple(&p.coords.into()));
    line(format!("  target  {target}"));
    line(format!("  camera  {camera}   ({} from the target)", length(next.working_distance_m)));
    let (what, pose) = match &next.table {
        Some(table) => {
            line(format!("  turn the table to {} degrees", table.stop_deg));
            ("cell_from_camera", &table.cell_from_camera)
        }
        None => ("world_from_camera", &next.world_from_camera),
    };
    line(format!("  {what} (+X right, +Y down, +Z forward; metres)"));
    for row in &pose.matrix {
        line(format!("    [{:10.6} {:10.6} {:10.6} {:10.6}]", row[0], row[1], row[2], row[3]));
    }
    let [x, y, z, w] = pose.quaternion_xyzw;
    line(format!("  quaternion x {x:.6} y {y:.6} z {z:.6} w {w:.6}"));
    if let Some(reached) = &next.reached {
        let joints: Vec<String> = reached.joints.iter().map(|j| format!("{} {:.4}", j.name, j.value)).collect();
        line(format!("  joints {} (rad, of sliding ones m; travel {:.2})", joints.join(", "), reached.travel));
    }
    let mut benefit = String::new();
    let _ = match next.expected_gain {
        Some(gain) => write!(benefit, "  expected gain {:.1} % of the surface ({})", 100.0 * gain, stop.basis),
        None => write!(benefit, "  expected gain {}", stop.basis),
    };
    if let Some(overlap) = next.expected_overlap {
        let _ = write!(benefit, ", overlap {:.0} %", 100.0 * overlap);
    }
    if let Some(expected) = &next.registration {
        let _ = write!(benefit, ", {}", expected.describe());
    }
    line(benefit);
    if stop.stop {
        let last = if stop.last_added.is_some() { ", nor did the last scan" } else { "" };
        line(format!("  not worth it: no view is expected to add as much as --stop-below{last}"));
    }
}

fn describe_missing(missing: &Missing, line: &mut impl FnMut(String)) {
    const SHOWN: usize = 3;
    let percent = |x: f64| format!("{:.1} %", 100.0 * x);
    let [low, high] = missing.between.map(percent);
    let mut text = format!("missing: {} of the surface ({low} to {high})", percent(missing.share));
    if missing.out_of_reach_share > 0.0 {
        let _ = write!(text, ", and {} that no allowed view sees", percent(missing.out_of_reach_share));
    }
    line(text);
    for hole in missing.holes.iter().take(SHOWN) {
        let reach = match hole.within_reach {
            r if r <= 0.0 => ", out of reach".to_owned(),
            r if r < 0.9 => format!(", {:.0} % of it within reach", 100.0 * r),
            _ => String::new(),
        };
        let (at, size) = (triple(&hole.center_m), length(hole.size_m));
        line(format!("  {} around {at}, {size} across: {}{reach}", percent(hole.share), hole.unseen.describe()));
    }
    if missing.holes.len() > SHOWN {
        line(format!("  and {} smaller ones", missing.holes.len() - SHOWN));
    }
}

fn triple(p: &[f64; 3]) -> String {
    format!("{:.4} {:.4} {:.4}", p[0], p[1], p[2])
}

/// An area in the unit that a person reads most easily.
fn area(square_metres: f64) -> String {
    match square_metres {
        m2 if m2 >= 0.1 => format!("{m2:.2} m2"),
        m2 => format!("{:.1} cm2", m2 * 1e4),
    }
}

/// A length in the unit that a person reads most easily.
pub fn length(metres: f64) -> String {
    match metres.abs() {
        m if m >= 1.0 => format!("{metres:.2} m"),
        m if m >= 0.01 => format!("{:.1} cm", metres * 100.0),
        _ => format!("{:.2} mm", metres * 1000.0),
    }
}
