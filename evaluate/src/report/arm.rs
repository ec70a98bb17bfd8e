//! The table of an arm that takes the views.

use super::table::{Row, Table, number};
use crate::config::EvaluateConfig;
use crate::journal::Contents;
use crate::metrics::{Figure, Runs};
use serde::Serialize;

/// What the views of a policy ask of the arm.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct ArmRow {
    pub policy: String,
    pub episodes: usize,
    /// Views of an episode, the first scan included.
    pub views: Option<f64>,
    pub views_out_of_reach: Option<f64>,
    /// Summed over the joints and over the way between the views that the arm takes.
    pub joint_travel_rad: Option<f64>,
}

impl Row for ArmRow {
    const HEADINGS: &'static [&'static str] = &["policy", "episodes", "views", "out of reach", "joint travel rad"];

    fn cells(&self) -> Vec<String> {
        vec![
            self.policy.clone(),
            self.episodes.to_string(),
            number(self.views, 1),
            number(self.views_out_of_reach, 1),
            number(self.joint_travel_rad, 1),
        ]
    }
}

/// One row per policy; none without an arm.
pub fn rows(contents: &Contents, config: &EvaluateConfig, policies: &[String]) -> Vec<ArmRow> {
    let carried = || contents.episodes.iter().map(|(record, _)| record).filter(|record| record.arm.is_some());
    let row = |policy: &String| {
        let runs = Runs::of(carried(), policy);
        let mean = |figure| runs.column(figure, config.views_if_unreached()).mean();
        (!runs.is_empty()).then(|| ArmRow {
            policy: policy.clone(),
            episodes: runs.len(),
            views: mean(Figure::Views),
            views_out_of_reach: mean(Figure::OutOfReach),
            joint_travel_rad: mean(Figure::JointTravel),
        })
    };
    policies.iter().filter_map(row).collect()
}

/// For readers.
pub fn table(rows: &[ArmRow]) -> Table {
    Table::of(
        "The arm",
        "Means over objects of means over episodes. Views that the arm cannot take (reach, joint limits, collisions with itself and with \
         the object) are skipped: it stays where it is. Joint travel: summed over the joints, between the views that it takes.",
        rows,
    )
}
