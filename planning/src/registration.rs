//! Registration of a scan onto the cloud: point-to-plane ICP that starts from the pose given, says which motions the overlap
//! does not determine, and refuses what is not safe. The method and what it is worth: docs/registration.md.

pub mod adjust;
pub mod config;
mod gate;
mod icp;
mod information;
mod model;
mod motion;
mod prior;
pub mod registrability;
mod robust;
pub(crate) mod visible;

use crate::answer::length;
use geometry::PointCloud;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector6};
use serde::{Deserialize, Serialize};

pub use config::{About, AfterAlarm, Icp, Register, Registrability, RegistrationConfig};
pub use gate::Unsafe;
pub use information::Information;
pub use model::Model;
pub use motion::{Motion, MotionKind};
pub use prior::PoseError;

/// Coordinates in which a small motion is six lengths: rotations about `center` times `radius`, and shifts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// The middle of the object, as far as it is known.
    pub center: Point3<f64>,
    /// How far its points lie from there, roughly, metres.
    pub radius: f64,
}

impl Frame {
    /// Of the radius to the diagonal of the box: objects 0.2 m across have their points 65 mm from the centre.
    const OF_DIAGONAL: f64 = 0.325;

    /// Around the points of these clouds.
    pub fn around(clouds: &[&PointCloud]) -> Self {
        let boxes = clouds.iter().filter(|c| !c.is_empty()).map(|c| c.bounding_box());
        let whole = boxes.reduce(|(low, high), (l, h)| (low.inf(&l), high.sup(&h)));
        let (low, high) = whole.unwrap_or((Point3::origin(), Point3::origin()));
        let radius = Self::OF_DIAGONAL * (high - low).norm();
        Self { center: nalgebra::center(&low, &high), radius: radius.max(f64::MIN_POSITIVE.sqrt()) }
    }

    /// The six lengths of a motion about the centre.
    fn lengths(&self, rotation: &UnitQuaternion<f64>, shift: &Vector3<f64>) -> Vector6<f64> {
        let turn = rotation.scaled_axis() * self.radius;
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }

    /// The motion of six lengths.
    fn motion(&self, lengths: &Vector6<f64>) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let [a, b, c, x, y, z] = lengths.data.0[0];
        (UnitQuaternion::from_scaled_axis(Vector3::new(a, b, c) / self.radius), Vector3::new(x, y, z))
    }
}

/// A scan that is to be registered.
#[derive(Clone, Copy, Debug)]
pub struct Moving<'a> {
    /// Its points, with normals towards the camera, where the pose given puts them.
    pub cloud: &'a PointCloud,
    /// Area that a point stands for, square to the line of sight, square metres.
    pub footprint_m2: f64,
}

/// The outcome of a registration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Registered {
    /// Moves the scan from where the pose given puts it onto the cloud.
    #[serde(with = "as_pose")]
    pub correction: Isometry3<f64>,
    /// Root mean square of how far that moves the scan's points, metres.
    pub shift_m: f64,
    /// By how much it turns them, degrees.
    pub turn_deg: f64,
    /// Share of the scan's points that then lie within the tolerance of the cloud.
    pub fitness: f64,
    /// The same, only where the normals are alike too: opposite sides of a thin wall do not count.
    pub like_normals: f64,
    /// Root mean square distance along the normals of the pairs that ICP ended with, metres.
    pub rms_m: f64,
    /// How well the overlap determines the motion it determines least ([`Information::lambda`]).
    pub lambda: f64,
    /// Root mean square error of the points that is expected by the overlap, the noise and the robot's accuracy, metres.
    pub expected_error_m: f64,
    /// Whether the last step was small.
    pub converged: bool,
    /// The motion that the overlap determines least, if there is an overlap.
    pub weakest: Option<Motion>,
    /// Why this result must not be used; absent where it may.
    pub refused: Option<Unsafe>,
}

impl Registered {
    /// For people.
    pub fn describe(&self) -> String {
        let [shift, rms] = [self.shift_m, self.rms_m].map(length);
        let weakest = self.weakest.map_or(String::new(), |motion| format!(", may most easily {motion}"));
        format!(
            "{shift} and {:.2} degrees off, {:.0} % of it on the cloud, {rms} apart (lambda {:.1}{weakest})",
            self.turn_deg,
            100.0 * self.like_normals,
            self.lambda
        )
    }
}

/// How a scan lies on a cloud as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Share of its points within the tolerance of the cloud.
    pub share: f64,
    /// The same, only where the normals are alike too.
    pub like_normals: f64,
    /// How well that determines the motion that it determines least.
    pub lambda: f64,
}

/// [`Overlap`] of a scan that is in its place.
pub fn overlap_of(scan: &Moving, model: &Model) -> Overlap {
    let frame = Frame::around(&[model.cloud, scan.cloud]);
    let met = model.met_by(scan, &Isometry3::identity(), &frame);
    Overlap { share: met.share, like_normals: met.like_normals, lambda: met.information.lambda(frame.radius) }
}

/// A rigid motion in JSON: 4 x 4, row by row.
mod as_pose {
    use crate::pose::{Pose, rigid};
    use nalgebra::Isometry3;
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub fn serialize<S: Serializer>(motion: &Isometry3<f64>, serializer: S) -> Result<S::Ok, S::Error> {
        Pose::from(motion).matrix.serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Isometry3<f64>, D::Error> {
        let rows = <[[f64; 4]; 4]>::deserialize(deserializer)?;
        rigid(&rows).map(|(motion, _)| motion).map_err(D::Error::custom)
    }
}

/// Root mean square of how far a motion moves the points of a cloud, metres.
pub(crate) fn displacement(cloud: &PointCloud, motion: &Isometry3<f64>) -> f64 {
    let squared: f64 = cloud.points.iter().map(|p| (motion * p - p).norm_squared()).sum();
    (squared / cloud.len().max(1) as f64).sqrt()
}

/// Registers a scan onto the cloud of those before it. The answer follows from the arguments alone.
pub fn register(scan: Moving, model: &Model, error: &PoseError, config: &RegistrationConfig) -> Registered {
    let frame = Frame::around(&[model.cloud, scan.cloud]);
    let prior = prior::Prior::new(error, &frame, scan.cloud);
    let fit = icp::fit(scan.cloud, model, &frame, &prior, config);
    let correction = {
        let c = frame.center.coords;
        Isometry3::from_parts(Translation3::from(c + fit.shift - fit.rotation * c), fit.rotation)
    };
    let shift_m = displacement(scan.cloud, &correction);
    let overlap = model.met_by(&scan, &correction, &frame);
    let lambda = overlap.information.lambda(frame.radius);
    let weakest = overlap.information.weakest(&frame);
    let expected_error_m = prior.error_after(&fit, scan.footprint_m2 / model.pixel_area(), config.prior);
    let refused = config.gate.then(|| gate::judge(&fit, shift_m, expected_error_m, &prior, model.tolerance, &weakest));
    Registered {
        correction,
        shift_m,
        turn_deg: fit.rotation.angle().to_degrees(),
        fitness: overlap.share,
        like_normals: overlap.like_normals,
        rms_m: fit.rms,
        lambda,
        expected_error_m,
        converged: fit.converged,
        weakest,
        refused: refused.flatten(),
    }
}

#[cfg(test)]
mod tests;
