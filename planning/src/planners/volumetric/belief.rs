//! How far it is believed that a view would measure what is expected: less where scans looked and measured nothing. Dark and
//! shiny parts return nothing to other views either, and beside the rim that an object stands on, the membrane of its
//! underside bulges into view, which the underside does not.

use super::holes::Spot;
use super::march::Marcher;
use crate::ScanState;
use rayon::prelude::*;

/// What is left of it after each scan that measured nothing there, or each piece of a line scan, which look from different sides; the first
/// may have met its edge. On a recorded toy on a table the gains told after four to
/// nine scans were 1.3 to 4 times the true ones without it (docs/log.md).
const LEFT: f32 = 0.5;

/// For each voxel of the membrane, a share.
pub(super) fn beliefs(marcher: &Marcher, state: &ScanState) -> Vec<f32> {
    let grid = marcher.grid();
    let of = |k: usize| {
        let spot = Spot::of(grid, &grid.expected[k], false);
        let looked = state.scans.iter().filter(|scan| spot.was_in_sight(marcher, scan)).count();
        LEFT.powi(looked.saturating_sub(1) as i32)
    };
    (0..grid.expected.len()).into_par_iter().map(of).collect()
}
