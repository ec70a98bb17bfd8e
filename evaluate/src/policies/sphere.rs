//! Sets of directions from which cameras look at the workspace's centre, the origin.

use nalgebra::{Point3, Vector3};

pub use geometry::sphere::{fibonacci, view_at};

/// Unit vector at a polar angle from +z and an azimuth from +x, both in degrees.
pub fn direction_deg(polar: f64, azimuth: f64) -> Vector3<f64> {
    let (polar, azimuth) = (polar.to_radians(), azimuth.to_radians());
    Vector3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos())
}

/// The 40 directions of Random U-Sphere: polar angles 30 to 150 in steps of 30, azimuths in steps of 45 degrees.
pub fn latitude_longitude() -> Vec<Vector3<f64>> {
    (1..=5)
        .flat_map(|ring| (0..8).map(move |sector| direction_deg(30.0 * f64::from(ring), 45.0 * f64::from(sector))))
        .collect()
}

/// The 33 directions of PC-NBV, y up.
pub fn pc_nbv_33() -> Vec<Vector3<f64>> {
    let ring = |elevation: f64| {
        (0..8).map(move |i| {
            let (a, b) = (elevation.to_radians(), 45f64.to_radians() * f64::from(i));
            Vector3::new(b.sin() * a.cos(), -a.sin(), b.cos() * a.cos())
        })
    };
    std::iter::once(Vector3::y()).chain([-60.0, -30.0, 0.0, 30.0].into_iter().flat_map(ring)).collect()
}

/// Number of the direction nearest to a position seen from the origin; the first of equals.
pub fn nearest_direction(directions: &[Vector3<f64>], position: &Point3<f64>) -> Option<usize> {
    let cosine = |i: usize| directions[i].dot(&position.coords);
    (0..directions.len()).reduce(|best, i| if cosine(i) > cosine(best) { i } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_have_their_sizes_and_unit_length() {
        for (set, size) in [(fibonacci(500), 500), (latitude_longitude(), 40), (pc_nbv_33(), 33)] {
            assert_eq!(set.len(), size);
            assert!(set.iter().all(|d| (d.norm() - 1.0).abs() < 1e-12));
            for (i, d) in set.iter().enumerate() {
                assert!(set[..i].iter().all(|e| (d - e).norm() > 1e-3), "{d} twice");
                assert_eq!(nearest_direction(&set, &Point3::from(1.3 * d)), Some(i));
            }
        }
    }

    #[test]
    fn pc_nbv_rows_equal_the_published_table() {
        let set = pc_nbv_33();
        for (row, expected) in [
            (0, [0.0, 1.0, 0.0]),
            (1, [0.0, 0.866_025, 0.5]),
            (2, [0.353_553, 0.866_025, 0.353_553]),
            (12, [0.612_372, 0.5, -0.612_372]),
            (17, [0.0, 0.0, 1.0]),
            (32, [-0.612_372, -0.5, 0.612_372]),
        ] {
            assert!((set[row] - Vector3::from(expected)).norm() < 1e-5, "row {row}: {}", set[row]);
        }
        assert!(set.iter().all(|d| d.y > -0.51), "nothing below elevation -30 degrees");
    }
}
