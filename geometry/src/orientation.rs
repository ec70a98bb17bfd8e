//! Consistent orientation of normals where no camera position is known (after Hoppe et al. 1992).

use crate::PointCloud;
use crate::neighbors::Neighborhoods;
use nalgebra::Vector3;

const BUCKETS: usize = 1 << 12;

/// Flips normals so that neighbours agree and connected pieces face outwards: a spanning tree over the `neighbors`
/// nearest points (10), most parallel normals first, carries the sign from point to point; each connected piece then
/// takes the sign with which its normals point away from the cloud's centroid, distant points counting more.
/// Thin sheets, seen from both sides at less than a few spacings, can go wrong (11 % of the Statue of Liberty's
/// points); where camera positions are known, [`crate::orient_normals_toward`] is right everywhere.
///
/// The neighbourhoods are those of `neighbors + 1` points, or more.
pub fn orient_normals_consistent(cloud: &mut PointCloud, neighborhoods: &Neighborhoods, neighbors: usize) {
    if !cloud.has_normals() || cloud.is_empty() {
        return;
    }
    let n = cloud.len();
    let k = neighborhoods.k().min(neighbors + 1);
    let edges = (0..n as u32).flat_map(|i| {
        let others = neighborhoods.ids(i as usize)[..k].iter().copied();
        others.filter(move |&j| j != i && j != u32::MAX).map(move |j| (i, j))
    });
    let mut forest = SignedForest::new(n);
    for (i, j) in by_parallelism(edges.collect(), &cloud.normals) {
        let opposed = cloud.normals[i as usize].dot(&cloud.normals[j as usize]) < 0.0;
        forest.join(i, j, opposed);
    }
    let centroid = mean(cloud);
    let mut votes = vec![0.0; n];
    for i in 0..n {
        let (root, flipped) = forest.root(i as u32);
        let outward = cloud.normals[i].dot(&(cloud.points[i].coords - centroid));
        if outward.is_finite() {
            votes[root as usize] += if flipped { -outward } else { outward };
        }
    }
    for i in 0..n {
        let (root, flipped) = forest.root(i as u32);
        if flipped != (votes[root as usize] < 0.0) {
            cloud.normals[i] = -cloud.normals[i];
        }
    }
}

/// Mean of the finite points.
fn mean(cloud: &PointCloud) -> Vector3<f64> {
    let finite = || cloud.points.iter().filter(|p| p.iter().all(|x| x.is_finite()));
    finite().fold(Vector3::zeros(), |sum, p| sum + p.coords) / finite().count().max(1) as f64
}

/// The edges by rising 1 - |cos| of their normals, in buckets; edges of a bucket keep their order.
fn by_parallelism(edges: Vec<(u32, u32)>, normals: &[Vector3<f64>]) -> Vec<(u32, u32)> {
    let bucket = |&(i, j): &(u32, u32)| {
        let deviation = 1.0 - normals[i as usize].dot(&normals[j as usize]).abs();
        // Square root: most edges are nearly parallel, and tell apart by angle.
        ((deviation.max(0.0).sqrt() * BUCKETS as f64) as usize).min(BUCKETS - 1)
    };
    let mut next = [0usize; BUCKETS + 1];
    edges.iter().for_each(|edge| next[bucket(edge) + 1] += 1);
    for b in 1..=BUCKETS {
        next[b] += next[b - 1];
    }
    let mut sorted = vec![(0, 0); edges.len()];
    for edge in &edges {
        let slot = &mut next[bucket(edge)];
        sorted[*slot] = *edge;
        *slot += 1;
    }
    sorted
}

/// Disjoint sets whose members know their sign relative to the root.
struct SignedForest {
    parent: Vec<u32>,
    opposed: Vec<bool>,
}

impl SignedForest {
    fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect(), opposed: vec![false; n] }
    }

    /// Root of the member's set, and whether the member's sign is opposed to the root's.
    fn root(&mut self, mut i: u32) -> (u32, bool) {
        let mut opposed = false;
        loop {
            let parent = self.parent[i as usize];
            if parent == i {
                return (i, opposed);
            }
            // Halve the path.
            let sign = self.opposed[i as usize] ^ self.opposed[parent as usize];
            if self.parent[parent as usize] != parent {
                self.parent[i as usize] = self.parent[parent as usize];
                self.opposed[i as usize] = sign;
            }
            opposed ^= self.opposed[i as usize];
            i = self.parent[i as usize];
        }
    }

    fn join(&mut self, i: u32, j: u32, opposed: bool) {
        let ((a, a_opposed), (b, b_opposed)) = (self.root(i), self.root(j));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.parent[high as usize] = low;
            self.opposed[high as usize] = opposed ^ a_opposed ^ b_opposed;
        }
    }
}

#[cfg(test)]
mod tests;
