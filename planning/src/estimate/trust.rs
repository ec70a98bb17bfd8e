//! How far an estimated camera may be off.

/// How well the density of a cloud's points determines its camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// Root of the share of the density that the camera does not explain, in [0, 1].
    pub misfit: f64,
    /// The same, of undisturbed points, over that of the best camera on the other side of the surface, and what its edges say: in [0, 1], 1 where
    /// both sides are as likely.
    pub against_other_side: f64,
    /// How well the normals determine a direction: how many there are that differ by 15 degrees and more, times the mean square of all along the
    /// direction in which they point least. Of what is seen of a ball about 5; 0 for faces that share a direction, along which the
    /// density says nothing of the camera.
    pub span: f64,
}

/// Misfit, and degrees within which nine of ten estimates on the right side were: 830 simulated scans of 66 objects at 0.6
/// and 1.2 m (the example `camera_estimate` of `datagen`).
const OFF_DEG: [(f64, [f64; 1]); 6] =
    [(0.05, [3.0]), (0.07, [4.5]), (0.09, [6.0]), (0.10, [10.0]), (0.12, [16.0]), (0.15, [27.0])];

/// How well the normals determine a direction, and the same of 1,490 scans, 457 of them of flat-faced parts (plates, brackets, stairs, beams): those
/// explain the density well from many directions.
const OFF_BY_SPAN_DEG: [(f64, [f64; 1]); 4] = [(0.05, [36.0]), (0.3, [30.0]), (0.6, [15.0]), (1.0, [3.0])];

/// What speaks against the other side, and the share of estimates that were on the wrong one: 2,071 simulated scans of 66 objects at 0.3 to 2 m.
const WRONG_SIDE: [(f64, [f64; 1]); 5] =
    [(0.35, [0.005]), (0.6, [0.03]), (0.75, [0.11]), (0.87, [0.15]), (0.95, [0.35])];

impl Trust {
    /// Angle at the middle of the cloud, degrees, within which the true camera is in nine of ten cases, where it is on the
    /// right side of the surface.
    pub fn off_deg(&self) -> f64 {
        interpolated(&OFF_DEG, self.misfit)[0].max(interpolated(&OFF_BY_SPAN_DEG, self.span)[0])
    }

    /// Share of such estimates that are on the wrong side of the surface.
    pub fn wrong_side(&self) -> f64 {
        interpolated(&WRONG_SIDE, self.against_other_side)[0]
    }
}

/// Linear between the points of a table, constant beyond its ends.
pub(crate) fn interpolated<const N: usize>(table: &[(f64, [f64; N])], at: f64) -> [f64; N] {
    let above = table.partition_point(|(x, _)| *x < at);
    match (above.checked_sub(1).map(|i| table[i]), table.get(above)) {
        (Some((x0, y0)), Some((x1, y1))) => std::array::from_fn(|k| y0[k] + (y1[k] - y0[k]) * (at - x0) / (x1 - x0)),
        (Some((_, y)), None) | (None, Some(&(_, y))) => y,
        (None, None) => [f64::NAN; N],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubt_grows_with_misfit_and_with_the_other_side() {
        let off = |misfit| Trust { misfit, against_other_side: 0.5, span: 5.0 }.off_deg();
        assert_eq!([off(0.0), off(0.5)], [3.0, 27.0]);
        assert!((off(0.06) - 3.75).abs() < 1e-12);
        let flat = |span| Trust { misfit: 0.01, against_other_side: 0.5, span }.off_deg();
        assert!(flat(0.0) == 36.0 && (flat(0.8) - 9.0).abs() < 1e-12, "{} {}", flat(0.0), flat(0.8));
        let wrong = |against_other_side| Trust { misfit: 0.1, against_other_side, span: 5.0 }.wrong_side();
        assert_eq!([wrong(0.2), wrong(1.0)], [0.005, 0.35]);
        assert!((wrong(0.81) - 0.13).abs() < 1e-12);
    }
}
