//! What was done with a scan's points.

use crate::registration::Registered;

/// What was done with a scan's points.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ScanReport {
    /// Points given.
    pub read: usize,
    /// With a coordinate that is not finite (pixels without a return, in organised clouds).
    pub not_finite: usize,
    /// With a coordinate beyond [`super::FARTHEST_M`], as the marks of some sensors for no return are.
    #[serde(default)]
    pub out_of_range: usize,
    /// Nearer or farther than the sensor measures.
    #[serde(default)]
    pub beyond_sensor: usize,
    /// Pixels in the middle of a jump in depth.
    #[serde(default)]
    pub mixed_pixels: usize,
    /// On what the object stands on, or under it.
    #[serde(default)]
    pub on_support: usize,
    /// Outside the region of interest.
    pub outside_region: usize,
    /// Dropped as far from all others.
    pub outliers: usize,
    /// Dropped as equal to another.
    #[serde(default)]
    pub duplicates: usize,
    /// Dropped by thinning.
    pub thinned: usize,
    /// Normals that were missing and were estimated.
    #[serde(default)]
    pub normals_estimated: usize,
    /// Normals that pointed away from the camera and were turned.
    #[serde(default)]
    pub normals_turned: usize,
    /// Whether the normals given were ignored: too few, or not standing on the surface.
    #[serde(default)]
    pub normals_ignored: bool,
    /// Used for planning.
    pub used: usize,
    /// What registering it found, where that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub registration: Option<Box<Registered>>,
}

impl ScanReport {
    /// One line for people.
    pub fn describe(&self) -> String {
        let mut line = format!("{} points", self.read);
        let parts = [
            (self.not_finite, "without a position"),
            (self.out_of_range, "farther than a million metres from the origin"),
            (self.beyond_sensor, "out of the sensor's range"),
            (self.mixed_pixels, "mixed of two depths"),
            (self.on_support, "of the support"),
            (self.outside_region, "outside the region"),
            (self.duplicates, "given twice"),
            (self.thinned, "thinned out"),
            (self.outliers, "outliers dropped"),
        ];
        for (count, what) in parts.into_iter().filter(|(count, _)| *count > 0) {
            line += &format!(", {count} {what}");
        }
        if self.used != self.read {
            line = format!("{line}: {} used", self.used);
        }
        self.registration.as_ref().map_or(line.clone(), |found| format!("{line}; {}", found.describe()))
    }
}
