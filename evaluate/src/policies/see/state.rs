//! Stored points and their classes: one update per scan.

use super::graph::Graph;
use super::grid::PointGrid;
use super::params::SeeParams;
use geometry::View;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeSet;

/// Class of a stored point. Core is absorbing: density only grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Label {
    /// Not yet classified.
    New,
    /// Surrounded by enough points.
    Core,
    /// Between core and outliers: the edge of the seen surface, which proposes a view.
    Frontier,
    /// Sparse.
    Outlier,
}

/// A stored point with its proposal and the state of its view controller.
#[derive(Clone, Debug)]
pub(super) struct Stored {
    pub position: Point3<f64>,
    /// Sensor position from which it was first seen.
    pub observed_from: Point3<f64>,
    pub label: Label,
    /// Outward surface normal; frontiers only, as the next two.
    pub normal: Vector3<f64>,
    /// Tangent that points away from the known surface.
    pub frontier: Vector3<f64>,
    /// Tangent along the edge.
    pub boundary: Vector3<f64>,
    /// Position of the proposed view.
    pub view: Point3<f64>,
    /// Unit looking direction of the proposed view.
    pub looking: Vector3<f64>,
    pub scale: f64,
    pub closest: f64,
    pub may_switch: bool,
    queued_at: usize,
}

/// All that SEE remembers of an object.
#[derive(Clone)]
pub(super) struct Surface {
    pub params: SeeParams,
    pub points: Vec<Stored>,
    pub grid: PointGrid,
    /// Subset with a spacing of at least the probe step: the occluders of the optimiser.
    pub sparse: Vec<Point3<f64>>,
    sparse_grid: PointGrid,
    pub frontiers: BTreeSet<u32>,
    pub graph: Graph,
    /// Unit directions and distances of the current scan's points, seen from the sensor.
    pub scan_rays: Vec<(Vector3<f64>, f64)>,
    /// Current sensor position.
    pub sensor: Point3<f64>,
    /// The frontier point that the last view was meant for.
    pub target: Option<u32>,
    /// The last proposal; stays when there is no frontier.
    pub next: Option<View>,
    /// Whether the last update reclassified any point besides the new ones.
    pub useful: bool,
    /// No frontier is left.
    pub done: bool,
    scans: usize,
}

impl Surface {
    pub fn new(params: SeeParams) -> Self {
        Self {
            grid: PointGrid::new(params.radius),
            sparse_grid: PointGrid::new(params.probe),
            params,
            points: Vec::new(),
            sparse: Vec::new(),
            frontiers: BTreeSet::new(),
            graph: Graph::default(),
            scan_rays: Vec::new(),
            sensor: Point3::origin(),
            target: None,
            next: None,
            useful: false,
            done: false,
            scans: 0,
        }
    }

    /// Takes in one scan from a sensor position and proposes the next view.
    pub fn update(&mut self, scan: &[Point3<f64>], sensor: Point3<f64>) {
        self.scans += 1;
        self.sensor = sensor;
        self.scan_rays = scan
            .iter()
            .map(|p| {
                let ray = p - sensor;
                (ray.try_normalize(0.0).unwrap_or_else(Vector3::zeros), ray.norm())
            })
            .collect();
        if self.points.is_empty() && scan.is_empty() {
            self.done = true;
            return;
        }
        let first_new = self.points.len();
        for p in scan {
            self.insert(*p);
        }
        let mut queue = Vec::new();
        for i in first_new..self.points.len() {
            if self.reclassify(i as u32) {
                self.queue_neighbors(i as u32, &mut queue);
            }
        }
        self.useful = !queue.is_empty();
        for &i in &queue {
            self.reclassify(i);
        }
        if let Some(target) = self.target
            && self.points[target as usize].label == Label::Frontier
        {
            self.correct_view(target, scan);
        }
        for i in self.frontiers_by_view(&self.sensor, self.params.updates) {
            self.update_view(i);
        }
        for i in self.frontiers_by_view(&self.sensor, self.params.updates) {
            self.update_arcs(i);
        }
        self.select();
    }

    fn insert(&mut self, p: Point3<f64>) {
        if self.grid.any_within(&p, self.params.spacing) {
            return;
        }
        let id = self.points.len() as u32;
        self.points.push(Stored {
            position: p,
            observed_from: self.sensor,
            label: Label::New,
            normal: Vector3::zeros(),
            frontier: Vector3::zeros(),
            boundary: Vector3::zeros(),
            view: self.sensor,
            looking: Vector3::zeros(),
            scale: 1.0,
            closest: f64::INFINITY,
            may_switch: true,
            queued_at: 0,
        });
        self.grid.insert(id, p);
        if !self.sparse_grid.any_within(&p, self.params.probe) {
            self.sparse_grid.insert(id, p);
            self.sparse.push(p);
        }
    }

    /// Frontiers first, then outliers, each once per scan; the point itself included.
    fn queue_neighbors(&mut self, i: u32, queue: &mut Vec<u32>) {
        let mut near = [Vec::new(), Vec::new()];
        self.grid.within(&self.points[i as usize].position, self.params.radius, |j, _, _| {
            match self.points[j as usize].label {
                Label::Frontier => near[0].push(j),
                Label::Outlier => near[1].push(j),
                Label::New | Label::Core => {}
            }
            true
        });
        for list in &mut near {
            list.sort_unstable();
            for &mut j in list {
                let stored = &mut self.points[j as usize];
                if stored.queued_at != self.scans {
                    stored.queued_at = self.scans;
                    queue.push(j);
                }
            }
        }
    }

    /// Classifies a point anew and answers whether its class changed.
    fn reclassify(&mut self, i: u32) -> bool {
        let (mut count, mut core, mut outlier) = (0, false, false);
        let k = self.params.k;
        self.grid.within(&self.points[i as usize].position, self.params.radius, |j, _, _| {
            count += 1;
            match self.points[j as usize].label {
                Label::Core => core = true,
                Label::Outlier => outlier = true,
                Label::New | Label::Frontier => {}
            }
            count < k
        });
        let label = match (count >= k, core && outlier) {
            (true, _) => Label::Core,
            (false, true) => Label::Frontier,
            (false, false) => Label::Outlier,
        };
        let old = self.points[i as usize].label;
        if label == old {
            return false;
        }
        if old == Label::Frontier {
            self.remove_frontier(i);
        }
        if label == Label::Frontier {
            self.propose(i);
            self.frontiers.insert(i);
            self.graph.add(i);
        }
        self.points[i as usize].label = label;
        true
    }

    fn remove_frontier(&mut self, i: u32) {
        self.frontiers.remove(&i);
        self.graph.remove(i);
    }

    /// Gives a frontier up: it becomes an outlier until a neighbour changes.
    pub fn free(&mut self, i: u32) {
        self.remove_frontier(i);
        self.points[i as usize].label = Label::Outlier;
    }

    /// Up to `count` frontiers, by the distance of their views from a point, ties by number.
    pub fn frontiers_by_view(&self, from: &Point3<f64>, count: usize) -> Vec<u32> {
        let mut list: Vec<(f64, u32)> =
            self.frontiers.iter().map(|&i| ((self.points[i as usize].view - from).norm_squared(), i)).collect();
        list.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        list.into_iter().take(count).map(|x| x.1).collect()
    }
}
