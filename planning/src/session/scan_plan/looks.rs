//! What views of a plan find of the surface that is expected, one after the other.

use crate::Surface;
use crate::planners::volumetric::SeenPart;
use crate::stop::Missing;

/// Which share of what bulges behind a part of the membrane the first look at it finds, and which share of what is left of the part another
/// look from the side or the back: with these, plans carried out in the simulator add about what they say (datagen/tests/scan_plan.rs).
const BULGING: f64 = 2.0 / 3.0;
const AGAIN: f64 = 0.5;

/// What views find of the surface that is expected. A membrane closes what is open, and the surface that bulges behind it is larger: the first
/// view of a part finds as much of it as the membrane has area there, and most of the rest; each further one a share of what is left, less where
/// it looks as one before it did. As in holes, what is seen edge-on counts in proportion. What the allowed views see together is within reach,
/// and the last that sees a part finds what is left of that.
pub(super) struct Looks {
    parts: Vec<Part>,
    /// Which share of what it sees of a part the first view finds.
    first: f64,
    /// From shares of the whole as the membrane makes it out to those told.
    scale: f64,
}

/// A part of the membrane, and shares of the whole as the membrane makes it out.
#[derive(Clone, Default)]
struct Part {
    /// As much of it as views are believed to measure.
    area: f64,
    /// What the allowed views see of that, what those taken see, and what they find.
    within_reach: f64,
    shown: f64,
    found: f64,
    is_seen: bool,
    /// Allowed views that see it and are not taken.
    views_left: usize,
}

impl Looks {
    /// `seen` is what the allowed views see, and `areas` are the whole and the believed area of each part, square metres; `surface` is what the
    /// membrane makes out, `told` and `missing` what that amounts to.
    pub fn new(
        seen: &[Vec<SeenPart>],
        areas: &[[f64; 2]],
        surface: &Surface,
        told: &Surface,
        missing: &Missing,
    ) -> Self {
        let whole = (surface.known_m2 + surface.expected_m2).max(f64::MIN_POSITIVE);
        let part = |[_, believed]: &[f64; 2]| Part { area: believed / whole, ..Part::default() };
        let mut parts: Vec<Part> = areas.iter().map(part).collect();
        for &(k, share) in seen.iter().flatten() {
            let part = &mut parts[k as usize];
            part.views_left += 1;
            part.within_reach = part.within_reach.max(f64::from(share) * part.area);
        }
        let membrane = (areas.iter().map(|[area, _]| area).sum::<f64>() / whole).max(f64::MIN_POSITIVE);
        // Before the last scan had its say, which raises what is within reach alone.
        let expected = (1.0 - told.covered()).max(f64::MIN_POSITIVE);
        let bulge = (expected / membrane).max(1.0);
        let within_reach = membrane * (1.0 - missing.out_of_reach_share / expected);
        // That was told from samples, and with views that are no candidates.
        let within_reach = parts.iter().map(|part| part.within_reach).sum::<f64>().max(within_reach);
        Self {
            parts,
            first: (1.0 + BULGING * (bulge - 1.0)) / bulge,
            scale: missing.share / within_reach.max(f64::MIN_POSITIVE),
        }
    }

    /// Of the membrane, what no view has seen before, in proportion where it is edge-on.
    pub fn unseen(&self, view: &[SeenPart]) -> f64 {
        let parts = view.iter().map(|&(k, share)| (&self.parts[k as usize], f64::from(share)));
        parts.filter(|(part, _)| !part.is_seen).map(|(part, share)| share * part.area).sum()
    }

    /// What the view finds, as a share of the whole as it is told; `apart` is how different it looks from those before it: 0 alike, 1 from the
    /// side or the back.
    pub fn take(&mut self, view: &[SeenPart], apart: f64) -> f64 {
        let mut all = 0.0;
        for &(k, share) in view {
            let part = &mut self.parts[k as usize];
            part.views_left -= 1;
            part.shown = part.shown.max(f64::from(share) * part.area);
            let finds = match part.is_seen {
                _ if part.views_left == 0 => 1.0,
                false => self.first,
                true => AGAIN * apart,
            };
            let found = finds * (part.shown - part.found);
            part.found += found;
            part.is_seen = true;
            all += found;
        }
        self.scale * all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_find_what_they_see_in_part_and_all_of_them_what_is_within_reach() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a}, not {b}");
        let surface = Surface { known_m2: 0.75, expected_m2: 0.25 };
        let told = Surface { known_m2: 0.75, expected_m2: 0.5 };
        let areas = [[0.0625; 2]; 4];
        // The second part is seen by all, the third edge-on, the last by none: 2.5 of 4 are within reach.
        let seen: [Vec<SeenPart>; 3] = [vec![(0, 1.0), (1, 0.5)], vec![(1, 1.0), (2, 0.5)], vec![(1, 0.5)]];
        let out_of_reach_share = 0.15;
        // As it is told without and with regard to what the last scan added.
        for share in [0.25, 0.5] {
            let missing = Missing { share, between: [0.0, 1.0], out_of_reach_share, holes: Vec::new() };
            let mut looks = Looks::new(&seen, &areas, &surface, &told, &missing);
            near(looks.unseen(&seen[0]), 0.09375);
            let first = looks.take(&seen[0], 1.0);
            // The first part wholly, since no other view sees it; of the second, 1 of 1.6 and most of the rest of what is seen.
            near(first, share / 2.5 * (1.0 + 0.5 * (1.0 + 0.6 * BULGING) / 1.6));
            near(looks.unseen(&seen[1]), 0.03125);
            let second = looks.take(&seen[1], 0.8);
            assert!(second > 0.0 && first + second < share, "{first} and {second} of {share}");
            near(first + second + looks.take(&seen[2], 0.0), share);
        }
    }
}
