//! A growing hash grid: points are added scan by scan and asked for in small balls.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

/// Points of a cell, with their indices.
type Cell = Vec<(u32, Point3<f64>)>;

/// Points by cell. Cells are visited in lexicographic order and points in order of insertion, so that no answer depends
/// on the hash.
#[derive(Clone)]
pub(super) struct PointGrid {
    cell: f64,
    cells: FxHashMap<(i32, i32, i32), Cell>,
    all: Vec<(u32, Point3<f64>)>,
}

impl PointGrid {
    /// An empty grid of this cell edge in metres.
    pub fn new(cell: f64) -> Self {
        Self { cell: cell.max(1e-9), cells: FxHashMap::default(), all: Vec::new() }
    }

    fn key(&self, p: &Point3<f64>) -> (i32, i32, i32) {
        let f = |x: f64| (x / self.cell).floor() as i32;
        (f(p.x), f(p.y), f(p.z))
    }

    /// Adds a point under a number of the caller's.
    pub fn insert(&mut self, id: u32, p: Point3<f64>) {
        self.cells.entry(self.key(&p)).or_default().push((id, p));
        self.all.push((id, p));
    }

    /// Calls `visit(id, point, squared distance)` for every point in the closed ball until it answers false.
    pub fn within(&self, p: &Point3<f64>, radius: f64, mut visit: impl FnMut(u32, &Point3<f64>, f64) -> bool) {
        let r2 = radius * radius;
        let reach = nalgebra::Vector3::repeat(radius);
        let (low, high) = (self.key(&(p - reach)), self.key(&(p + reach)));
        for x in low.0..=high.0 {
            for y in low.1..=high.1 {
                for z in low.2..=high.2 {
                    for (id, q) in self.cells.get(&(x, y, z)).into_iter().flatten() {
                        let d2 = (q - p).norm_squared();
                        if d2 <= r2 && !visit(*id, q, d2) {
                            return;
                        }
                    }
                }
            }
        }
    }

    /// Whether any point lies in the closed ball.
    pub fn any_within(&self, p: &Point3<f64>, radius: f64) -> bool {
        let mut found = false;
        self.within(p, radius, |_, _, _| {
            found = true;
            false
        });
        found
    }

    /// The k nearest points, nearest first, ties by number; all of them if there are fewer.
    pub fn nearest(&self, p: &Point3<f64>, k: usize) -> Vec<(u32, Point3<f64>)> {
        let mut radius = self.cell;
        let mut found: Vec<(f64, u32, Point3<f64>)> = Vec::new();
        while found.len() < k {
            found.clear();
            if radius > 6.0 * self.cell {
                found.extend(self.all.iter().map(|(id, q)| ((q - p).norm_squared(), *id, *q)));
                break;
            }
            self.within(p, radius, |id, q, d2| {
                found.push((d2, id, *q));
                true
            });
            radius *= 1.4;
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.into_iter().take(k).map(|(_, id, q)| (id, q)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn equals_brute_force() {
        let mut rng = geometry::rng::stream(1, "grid");
        let points: Vec<_> =
            (0..500).map(|_| Point3::new(rng.random::<f64>(), rng.random(), rng.random::<f64>() * 0.1) * 0.2).collect();
        let mut grid = PointGrid::new(0.01);
        for (i, p) in points.iter().enumerate() {
            grid.insert(i as u32, *p);
        }
        for q in points.iter().step_by(17) {
            let mut by_distance: Vec<_> =
                points.iter().enumerate().map(|(i, p)| ((p - q).norm_squared(), i as u32)).collect();
            by_distance.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            for k in [1, 7, 40, 600] {
                let expected: Vec<_> = by_distance.iter().take(k).map(|x| x.1).collect();
                let found: Vec<_> = grid.nearest(q, k).into_iter().map(|x| x.0).collect();
                assert_eq!(found, expected);
            }
            let mut found = Vec::new();
            grid.within(q, 0.023, |id, _, _| {
                found.push(id);
                true
            });
            found.sort_unstable();
            let mut expected: Vec<_> = by_distance.iter().filter(|x| x.0 <= 0.023 * 0.023).map(|x| x.1).collect();
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
    }
}
