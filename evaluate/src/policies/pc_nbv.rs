//! PC-NBV over its 33 views: the one of which the network expects the most new surface.

use super::Radius;
use super::sphere::{nearest_direction, pc_nbv_33, view_at};
use model::pc_nbv::VIEWS;
use model::pc_nbv_model::PcNbvModel;
use nalgebra::{Point3, Vector3};
use planning::planner::checked;
use planning::{PlanError, Planner, RankedView, ScanState};
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// PC-NBV as a policy.
pub struct PcNbvPlanner {
    name: String,
    network: PcNbvModel,
    radius: Radius,
    /// As published: the whole cloud, and used views stay on offer.
    published: bool,
    directions: Vec<Vector3<f64>>,
    state: [f32; VIEWS],
    /// Scans whose views are marked.
    marked: usize,
}

impl PcNbvPlanner {
    /// With these weights. `published`: unmasked, with the whole cloud, 0.3 m farther from the centre.
    pub fn new(name: &str, network: PcNbvModel, published: bool) -> Self {
        let radius = if published { Radius::Paper } else { Radius::Working };
        let name = name.to_owned();
        Self { name, network, radius, published, directions: pc_nbv_33(), state: [0.0; VIEWS], marked: 0 }
    }

    /// As many points as the network was trained on, unless driven as published.
    fn input(&self, state: &ScanState, rng: &mut ChaCha8Rng) -> Vec<Point3<f64>> {
        let points = &state.cloud.points;
        let wanted = self.network.checkpoint().network.points;
        match points.len() {
            n if self.published || n == wanted => points.clone(),
            n if n > wanted => points.sample(rng, wanted).copied().collect(),
            0 => Vec::new(),
            // Fewer are repeated at random.
            n => (0..wanted).filter_map(|i| if i < n { points.get(i) } else { points.choose(rng) }).copied().collect(),
        }
    }
}

impl Planner for PcNbvPlanner {
    fn name(&self) -> &str {
        &self.name
    }

    /// Empty when every view was used, or the cloud is too small for the network.
    fn rank_views(&mut self, state: &ScanState, rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        for scan in state.scans.iter().skip(self.marked) {
            let position = Point3::from(scan.world_from_camera.translation.vector);
            if let Some(i) = nearest_direction(&self.directions, &position) {
                self.state[i] = 1.0;
            }
        }
        self.marked = state.scans.len();
        let gains = self
            .network
            .predict(&self.input(state, rng), &self.state)
            .map_err(|e| PlanError::failed(&self.name, e.to_string()))?;
        let radius = self.radius.metres(state);
        let mut views: Vec<RankedView> = (0..VIEWS)
            .filter(|&i| self.published || self.state[i] == 0.0)
            .map(|i| {
                let gain = f64::from(gains[i]);
                RankedView { gain: Some(gain), ..RankedView::scored(view_at(&self.directions[i], radius), gain) }
            })
            .collect();
        views.sort_by(|a, b| b.score.total_cmp(&a.score));
        checked(&self.name, views, PlanError::no_view(&self.name, "all 33 views were used"))
    }

    fn reset(&mut self) {
        self.state = [0.0; VIEWS];
        self.marked = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::rng::stream;
    use model::checkpoint::Checkpoint;
    use model::encode::EncodeConfig;
    use model::{PcNbvNet, PcNbvNetConfig};

    #[test]
    fn the_network_sees_as_many_points_as_it_was_trained_on() {
        let config = PcNbvNetConfig { points: 20, ..PcNbvNetConfig::default() };
        let net = config.init(&model::device::open("cpu").expect("cpu"));
        let network = PcNbvModel::new(net, Checkpoint::new::<PcNbvNet>(config, EncodeConfig::default()));
        let sees = |published: bool, points: u32| {
            let planner = PcNbvPlanner::new("pc-nbv", network.clone(), published);
            let mut state = ScanState::default();
            state.cloud.points = (0..points).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
            planner.input(&state, &mut stream(1, "test/pc-nbv")).len()
        };
        assert_eq!([sees(false, 100), sees(false, 20), sees(false, 5), sees(false, 0)], [20, 20, 20, 0]);
        assert_eq!(sees(true, 100), 100, "published: all of them");
    }
}
