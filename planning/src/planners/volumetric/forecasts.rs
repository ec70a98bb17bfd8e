//! What the planner expects of views, and of the surface.

use geometry::View;

/// What the planner expects of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewForecast {
    /// The view.
    pub view: View,
    /// Which of the given views it is; `None` where views are not given.
    pub given: Option<usize>,
    /// What the score counts, as a share of the whole: the surface that its points would cover within the tolerance and that no point
    /// covers yet, expected or measured, and half of what pixels see that enter unknown space without meeting any.
    pub gain: f64,
    /// The gain to tell: the expected surface in its image as a share of the whole, at most what is missing, and less where
    /// past scans looked and measured nothing.
    pub reported_gain: f64,
    /// Overlap of its scan with the cloud, within the tolerance, which the score counts; `None` where nothing is expected to
    /// be seen.
    pub overlap: Option<f64>,
    /// The overlap to tell: the share of its scan that shows surface which was measured already, however densely.
    pub reported_overlap: Option<f64>,
    /// The same if some of what is beyond turns out to be surface: wings and legs that nothing told of.
    pub cautious_overlap: Option<f64>,
    /// Share of the measured surface in its image that lies within the tolerance of a point; 1 where there is none.
    pub dense: f64,
    /// Angle at the target between the view and the nearest past camera, in half turns.
    pub novelty: f64,
    /// Measured surface in its image, square metres.
    pub known_m2: f64,
    /// Surface expected in unknown space in its image, as far as it is believed, square metres.
    pub expected_m2: f64,
    /// Pixels by what they show, as shares of all that show something: those that enter unknown space before they meet
    /// surface, those of them that meet the membrane, those that meet surface from its front, the same behind unknown
    /// space, and the covered share of both.
    pub pixels: [f64; 5],
}

/// What it expects of all candidates.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forecasts {
    /// The candidates, in their order.
    pub views: Vec<ViewForecast>,
    /// The whole surface, without the backs of thin parts: to the tolerance most lie where their fronts do.
    pub surface: Surface,
    /// Whether views at the boundary see little of what is missing: then gain alone counts, and the last candidates look at that.
    pub elsewhere: bool,
}

/// The surface as far as it is known, and as far as it is expected where nothing is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Surface {
    /// Measured, square metres.
    pub known_m2: f64,
    /// Expected in unknown space, square metres: a membrane closes what is open.
    pub expected_m2: f64,
}

impl Surface {
    /// Share of the whole that is measured.
    pub fn covered(&self) -> f64 {
        self.known_m2 / (self.known_m2 + self.expected_m2).max(f64::MIN_POSITIVE)
    }
}
