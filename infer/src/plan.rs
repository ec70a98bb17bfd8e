//! `--plan FILE`: several next views as a list for robots and spreadsheets: JSON, YAML or CSV by the ending of the name.

use anyhow::{Context, Result, bail};
use planning::session::{PlannedView, ScanPlan};
use planning::{Answer, PlannerName, Session};
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::ops::RangeInclusive;
use std::path::Path;

/// Views that a plan may have.
pub const VIEWS: RangeInclusive<usize> = 1..=100;

/// An answer with the plan from it.
#[derive(Debug, Serialize)]
pub struct Planned<'a> {
    #[serde(flatten)]
    answer: &'a Answer,
    /// `None` where the planner does not predict what several views see together.
    plan: Option<ScanPlan>,
}

impl<'a> Planned<'a> {
    /// The plan of at most `most` views from the answer that `session` has just given, for a camera that is at
    /// `current_m`, where the request told.
    ///
    /// # Errors
    /// A number of views out of range.
    pub fn new(
        session: &Session,
        answer: &'a Answer,
        most: usize,
        current_m: Option<[f64; 3]>,
    ) -> Result<Self, String> {
        if !VIEWS.contains(&most) {
            return Err(format!("plan_views: {most}, expected {} to {}", VIEWS.start(), VIEWS.end()));
        }
        Ok(Self { answer, plan: session.scan_plan(answer, most, current_m) })
    }
}

/// Names of the columns, and the keys of each view.
const COLUMNS: [&str; 13] = [
    "x_m",
    "y_m",
    "z_m",
    "qx",
    "qy",
    "qz",
    "qw",
    "table_stop_deg",
    "travel_m",
    "adds",
    "chosen",
    "expected_overlap",
    "joints",
];

/// Whether the name says a format, and this planner may make a plan.
///
/// # Errors
/// It does not.
pub fn check(path: &Path, planner: PlannerName) -> Result<()> {
    match ending(path).as_str() {
        "json" | "yaml" | "yml" | "csv" => {}
        found => bail!("--plan {path:?}: unknown extension .{found}, expected .json, .yaml or .csv"),
    }
    match planner {
        PlannerName::Auto | PlannerName::Volumetric => Ok(()),
        PlannerName::BenbvNet | PlannerName::Farthest => bail!("{}", no_plan(path)),
    }
}

fn no_plan(path: &Path) -> String {
    format!(
        "--plan {path:?}: only the planner volumetric predicts what several views see together; use --planner auto or volumetric"
    )
}

/// Why an answer gives none.
fn no_plan_from(path: &Path, answer: &Answer) -> String {
    match answer.planner == PlannerName::Volumetric.as_str() {
        true => format!("--plan {path:?}: not written, for what a view adds is {}", answer.stop.basis),
        false => no_plan(path),
    }
}

/// Writes the plan made from an answer.
///
/// # Errors
/// An answer that does not make out what is missing, with the reason; what the operating system refuses.
pub fn write(path: &Path, plan: Option<&ScanPlan>, answer: &Answer) -> Result<()> {
    let plan = plan.with_context(|| no_plan_from(path, answer))?;
    let views: Vec<Value> = plan.views.iter().map(view).collect();
    let text = match ending(path).as_str() {
        "csv" => csv(&views),
        other => {
            let whole = json!({
                "frame": "world_from_camera: camera +X right, +Y down, +Z forward; metres; with a turntable the camera's pose in the cell",
                "travel_m": plan.travel_m,
                "turn_deg": plan.turn_deg,
                "adds": plan.adds,
                "leaves": plan.leaves,
                "views": views,
            });
            if other == "json" { format!("{whole:#}\n") } else { yaml(&whole) }
        }
    };
    Ok(formats::run::atomic_write(path, text.as_bytes())?)
}

fn ending(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// One view: its pose in the frame that does not turn.
fn view(planned: &PlannedView) -> Value {
    let candidate = &planned.view;
    let pose = candidate.table.as_ref().map_or(&candidate.world_from_camera, |table| &table.cell_from_camera);
    let numbers = pose.translation_m.iter().chain(&pose.quaternion_xyzw).map(|x| json!(x));
    let joints = candidate.reached.as_ref().map(|reached| reached.joints.iter().map(|j| j.value).collect::<Vec<_>>());
    let others = [
        json!(candidate.table.as_ref().map(|table| table.stop_deg)),
        json!(planned.travel_m),
        json!(planned.adds),
        json!(planned.chosen),
        json!(candidate.expected_overlap),
        json!(joints),
    ];
    let entries = COLUMNS.iter().map(|name| (*name).to_owned()).zip(numbers.chain(others));
    Value::Object(entries.filter(|(_, value)| !value.is_null()).collect::<Map<_, _>>())
}

/// Joint values in one cell, with spaces between.
fn csv(views: &[Value]) -> String {
    let cell = |value: &Value| match value {
        Value::Array(values) => values.iter().map(Value::to_string).collect::<Vec<_>>().join(" "),
        Value::Null => String::new(),
        value => value.to_string(),
    };
    let row = |view: &Value| COLUMNS.map(|name| view.get(name).map_or(String::new(), cell)).join(",");
    let rows = std::iter::once(COLUMNS.join(",")).chain(views.iter().map(row));
    rows.map(|row| row + "\n").collect()
}

/// The plan as block YAML; scalars are written as in JSON, which YAML reads.
fn yaml(plan: &Value) -> String {
    let mut text = String::new();
    for (key, value) in plan.as_object().into_iter().flatten() {
        let Some(views) = value.as_array() else {
            text += &format!("{key}: {value}\n");
            continue;
        };
        text += &format!("{key}:{}\n", if views.is_empty() { " []" } else { "" });
        for view in views {
            let entries = COLUMNS.iter().filter_map(|key| Some((key, view.get(*key)?)));
            for (i, (key, value)) in entries.enumerate() {
                text += &format!("{} {key}: {value}\n", if i == 0 { "-" } else { " " });
            }
        }
    }
    text
}
