//! Which view sees which frontier, and the choice among the proposals.

use super::state::Surface;
use geometry::View;
use std::collections::BTreeMap;

/// Directed graph over frontiers: an arc from i to j when the view of i sees frontier j.
#[derive(Clone, Default)]
pub(super) struct Graph {
    arcs: BTreeMap<u32, Vec<u32>>,
}

impl Graph {
    pub fn add(&mut self, i: u32) {
        self.arcs.insert(i, Vec::new());
    }

    /// Removes a node and every arc that touches it.
    pub fn remove(&mut self, i: u32) {
        if self.arcs.remove(&i).is_some() {
            for list in self.arcs.values_mut() {
                list.retain(|&j| j != i);
            }
        }
    }

    pub fn set_arcs(&mut self, i: u32, to: Vec<u32>) {
        self.arcs.insert(i, to);
    }

    /// Number of frontiers that the view of i sees besides its own.
    pub fn sees(&self, i: u32) -> usize {
        self.arcs.get(&i).map_or(0, Vec::len)
    }

    fn seen_from(&self, j: u32) -> impl Iterator<Item = u32> + '_ {
        self.arcs.iter().filter(move |(_, to)| to.contains(&j)).map(|(&i, _)| i)
    }
}

impl Surface {
    /// Stays local: the proposal nearest to the sensor, or one that also sees its frontier and sees more frontiers per
    /// metre of travel.
    pub(super) fn select(&mut self) {
        let Some(&nearest) = self.frontiers_by_view(&self.sensor, 1).first() else {
            self.done = true;
            return;
        };
        self.done = false;
        let (mut best, mut best_ratio) = (nearest, 0.0);
        for i in self.graph.seen_from(nearest) {
            let sees = self.graph.sees(i);
            if sees > self.graph.sees(nearest) {
                let ratio = sees as f64 / ((self.sensor - self.points[i as usize].view).norm() + 0.001);
                if ratio > best_ratio {
                    (best, best_ratio) = (i, ratio);
                }
            }
        }
        self.target = Some(best);
        self.next = Some(self.proposal(best));
    }

    /// The view that a frontier proposes.
    pub(super) fn proposal(&self, i: u32) -> View {
        let stored = &self.points[i as usize];
        View { target: stored.view + self.params.distance * stored.looking, position: stored.view }
    }
}
