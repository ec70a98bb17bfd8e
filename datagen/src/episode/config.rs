//! Settings of an episode.

mod sensor;

use crate::config::check_counts;
use crate::pose_error::PoseErrorConfig;
use crate::registration::EpisodeRegistration;
use crate::scene::RenderConfig;
use formats::config::SettingError;
use geometry::PinholeCamera;
use planning::Accumulate;

/// What planners may know about a scan; what the camera measures does not depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeEvidence {
    /// Depth images with poses, whose pixels without a return are free space.
    #[default]
    DepthWithBackground,
    /// Depth images with poses, whose pixels without a return mean nothing: what most sensors give.
    Depth,
    /// Clouds with the position of their camera.
    CameraPositions,
    /// Clouds alone, one per scan.
    Clouds,
    /// One cloud of all points, and nothing else.
    Merged,
}

/// The simulated camera's image.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ImageConfig {
    /// Columns (1280).
    pub width: u32,
    /// Rows (720).
    pub height: u32,
    /// Vertical field of view (70).
    pub fov_y_deg: f64,
}

impl Default for ImageConfig {
    fn default() -> Self {
        Self { width: 1280, height: 720, fov_y_deg: 70.0 }
    }
}

impl ImageConfig {
    /// Square pixels, principal point in the centre.
    pub fn camera(&self) -> PinholeCamera {
        PinholeCamera::from_fov_y(self.width, self.height, self.fov_y_deg.to_radians())
    }
}

/// Settings of an episode (docs/method.md, 'Setting').
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeConfig {
    /// The camera.
    pub image: ImageConfig,
    /// How it measures.
    pub render: RenderConfig,
    /// Errors of the camera's pose and of its registration; absent: none.
    pub pose_error: Option<PoseErrorConfig>,
    /// Poses that are off, and scans that have to be registered; absent: scans are where their poses say.
    pub registration: Option<EpisodeRegistration>,
    /// Distance from target to camera, metres (1.2).
    pub working_distance_m: f64,
    /// Distance of the first camera from the origin, metres; absent: the working distance.
    pub initial_distance_m: Option<f64>,
    /// Draw the first view in whole degrees, as published. Off by default.
    pub initial_whole_degrees: bool,
    /// Distance under which two points count as the same surface, metres (0.002).
    pub tolerance_m: f64,
    /// Next views after the first scan (15).
    pub num_views: usize,
    /// What planners may know about a scan.
    pub evidence: EpisodeEvidence,
    /// How scans are merged into what planners see.
    pub accumulate: Accumulate,
    /// End at full coverage, as published. Off by default.
    pub stop_at_full_coverage: bool,
    /// A first scan with fewer points is void (50).
    pub min_first_points: usize,
    /// A first scan that covers less is void (0.05).
    pub min_first_coverage: f64,
    /// First views tried before the object is given up (100).
    pub max_draws: usize,
}

impl Default for EpisodeConfig {
    fn default() -> Self {
        Self {
            image: ImageConfig::default(),
            render: RenderConfig::default(),
            pose_error: None,
            registration: None,
            working_distance_m: 1.2,
            initial_distance_m: None,
            initial_whole_degrees: false,
            tolerance_m: 0.002,
            num_views: 15,
            evidence: EpisodeEvidence::DepthWithBackground,
            accumulate: Accumulate::Averaged,
            stop_at_full_coverage: false,
            min_first_points: 50,
            min_first_coverage: 0.05,
            max_draws: 100,
        }
    }
}

impl EpisodeConfig {
    /// Refuses values that cannot be meant; keys are those of the table `episode`.
    ///
    /// # Errors
    /// The key, what was found, and what was expected.
    pub fn validate(&self) -> Result<(), SettingError> {
        let lengths = [
            ("episode.working_distance_m", self.working_distance_m),
            ("episode.initial_distance_m", self.initial_distance_m.unwrap_or(1.0)),
            ("episode.tolerance_m", self.tolerance_m),
        ];
        if let Some((key, found)) = lengths.iter().find(|(_, length)| !(*length > 0.0 && length.is_finite())) {
            return Err(SettingError::new(key, found, "a length above 0"));
        }
        check_counts(&[("episode.num_views", self.num_views), ("episode.max_draws", self.max_draws)])?;
        let sides = [("episode.image.width", self.image.width), ("episode.image.height", self.image.height)];
        if let Some((key, found)) = sides.iter().find(|(_, side)| !(1..=16_384).contains(side)) {
            return Err(SettingError::new(key, found, "1 to 16,384 pixels"));
        }
        if !(self.image.fov_y_deg > 0.0 && self.image.fov_y_deg < 180.0) {
            return Err(SettingError::new(
                "episode.image.fov_y_deg",
                self.image.fov_y_deg,
                "an angle between 0 and 180",
            ));
        }
        if !(0.0..=1.0).contains(&self.min_first_coverage) {
            return Err(SettingError::new(
                "episode.min_first_coverage",
                self.min_first_coverage,
                "a share from 0 to 1",
            ));
        }
        sensor::check_render(&self.render)?;
        self.pose_error.as_ref().map_or(Ok(()), sensor::check_pose_error)?;
        if let Some(registration) = &self.registration {
            registration.validate()?;
            if self.pose_error.is_some() {
                let found = "with episode.pose_error";
                return Err(SettingError::new(
                    "episode.registration",
                    found,
                    "only one of them: drift already simulates registration",
                ));
            }
            if self.evidence == EpisodeEvidence::Merged || self.accumulate == Accumulate::Matched {
                let found = "with evidence = \"merged\" or accumulate = \"matched\"";
                return Err(SettingError::new("episode.registration", found, "separate scans, as measured"));
            }
        }
        Ok(())
    }

    /// As published: shifted scans, culled back faces, matched surface samples as the cloud, end at full coverage.
    pub fn paper() -> Self {
        Self {
            render: RenderConfig::paper(),
            accumulate: Accumulate::Matched,
            initial_whole_degrees: true,
            stop_at_full_coverage: true,
            ..Self::default()
        }
    }
}
