//! Where a surface ends it tells which side was seen: at its outline it turns away from the camera, wherever else a scan was cut off.

use nalgebra::Vector3;

/// Sine of the angle to the image from which on a normal at an edge counts: what is flatter says little, and a cut through what is flat, nothing.
const STEEP: f64 = 0.5;
/// Edge points that as many others are needed to outweigh.
const FEW: f64 = 20.0;

/// A point at an edge of a scan.
pub(super) struct EdgePoint {
    /// Of unit length, to either side.
    pub(super) normal: Vector3<f64>,
    /// Towards its neighbours.
    pub(super) inward: Vector3<f64>,
}

/// In [-1, 1]: over 0 where the surface turns away at its edges from a camera in this direction (of unit length), as at outlines of solid objects, under 0
/// where it turns towards it, as seen from behind.
pub(super) fn turning_away(edges: &[EdgePoint], camera: &Vector3<f64>) -> f64 {
    let slope = |edge: &EdgePoint| {
        let outward = (camera * edge.inward.dot(camera) - edge.inward).try_normalize(1e-12)?;
        Some(edge.normal.dot(&outward) * edge.normal.dot(camera).signum())
    };
    let steep: Vec<f64> = edges.iter().filter_map(slope).filter(|slope| slope.abs() > STEEP).collect();
    steep.iter().sum::<f64>() / (steep.len() as f64 + FEW)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The edge of a spherical cap around +z that reaches so far from its middle.
    fn cap(degrees: f64) -> Vec<EdgePoint> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let around = (0..400).map(|i| f64::from(i).to_radians() * 0.9);
        around
            .map(|turn| {
                let [x, y] = [turn.cos(), turn.sin()];
                // Down the slope is outwards.
                EdgePoint { normal: Vector3::new(x * sin, y * sin, cos), inward: Vector3::new(-x * cos, -y * cos, sin) }
            })
            .collect()
    }

    #[test]
    fn a_ball_turns_away_from_its_camera_and_towards_one_behind_it() {
        let edges = cap(80.0);
        let [front, back] = [Vector3::z(), -Vector3::z()].map(|camera| turning_away(&edges, &camera));
        assert!(front > 0.9 && (front + back).abs() < 1e-12, "{front} {back}");
        let mut either = edges;
        either.iter_mut().step_by(2).for_each(|edge| edge.normal = -edge.normal);
        assert_eq!(turning_away(&either, &Vector3::z()), front, "whichever way normals point");
    }

    #[test]
    fn a_shallow_part_that_was_cut_off_tells_nothing() {
        assert_eq!(turning_away(&cap(25.0), &Vector3::z()), 0.0);
        assert_eq!(turning_away(&[], &Vector3::z()), 0.0);
    }
}
