//! What is missing: the membrane in connected pieces, why no scan has measured each, and whether a view that may be taken
//! sees it.

use super::grid::{ExpectedVoxel, VoxelGrid};
use super::march::{Hit, Marcher};
use super::predict::COARSE;
use super::{Surface, VolumetricPlanner};
use crate::{PastScan, ScanState, Seen};
use geometry::{PinholeCamera, View};
use nalgebra::{Isometry3, Point3, Vector3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

/// Voxels of the membrane that are looked at, about, and of a hole at least and at most.
const SAMPLES: f64 = 96.0;
const OF_A_HOLE: [f64; 2] = [4.0, 48.0];
/// Pieces under this share of the whole are no holes.
const LISTED: f64 = 1e-3;
/// Directions from which each is looked at where no candidate sees it.
const DIRECTIONS: usize = 24;
/// A ray shows a voxel if it ends within this many voxels of its middle.
const NEAR: f32 = 2.0;
/// Places of the expected surface that views look at, about, where those at the boundary do not see it.
const LOOKED_AT: usize = 16;
/// Cosine to the expected normal under which a camera stands beside or behind.
const EDGE_ON: f64 = 0.2;

/// A connected piece of the surface that is expected where nothing is known yet. World frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hole {
    /// A point on it, in its middle, metres.
    pub center_m: [f64; 3],
    /// Its mean normal, outwards, of unit length; zero where it closes around.
    pub normal: [f64; 3],
    /// Its largest extent, metres.
    pub size_m: f64,
    /// Square metres.
    pub area_m2: f64,
    /// Share of the whole surface, measured and expected.
    pub share: f64,
    /// Why no scan has measured it: of most of it.
    pub unseen: Unseen,
    /// Share of it that a view can be expected to measure that may be taken: what is in sight of one, less where past scans
    /// looked and measured nothing.
    pub within_reach: f64,
    /// The allowed candidate that sees most of it, as a rank; absent where none sees any.
    pub best_candidate: Option<usize>,
}

/// Why a piece of surface was not measured: what came nearest to it in any scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Unseen {
    /// It is in no image.
    OutsideImage,
    /// It faces away from all cameras, or was seen edge-on.
    FacesAway,
    /// Something stood in front of it.
    Hidden,
    /// A camera looked at it, and measured nothing.
    NoReturn,
}

impl Unseen {
    /// For people.
    pub fn describe(self) -> &'static str {
        match self {
            Self::OutsideImage => "in no image yet",
            Self::FacesAway => "faces away from all cameras so far",
            Self::Hidden => "hidden behind other parts so far",
            Self::NoReturn => "in view, but nothing was measured there",
        }
    }
}

/// The views that may be taken.
pub struct Allowed<'a> {
    /// Ranked candidates (`world_from_camera`), best first, with their ranks.
    pub candidates: &'a [(usize, Isometry3<f64>)],
    /// Whether the camera may take any other; `None` where there are no others.
    pub others: Option<&'a dyn Fn(&View) -> bool>,
}

/// A point of the surface that is expected where nothing is known yet, and its normal, outwards; zero where that is not made out.
pub type ExpectedPoint = (Point3<f64>, Vector3<f64>);

/// A part of the expected surface that a view sees: its place in the list of their areas, and which share of it the view is expected to
/// measure, less than 1 where it would see it edge-on.
pub type SeenPart = (u32, f32);

impl VolumetricPlanner {
    /// The expected surface as it was at the last decision: a point to a voxel.
    pub fn expected_surface(&self) -> Vec<ExpectedPoint> {
        self.grid.iter().flat_map(Spot::all).map(|Spot { point, normal, .. }| (point, normal)).collect()
    }

    /// Which parts of the expected surface a camera sees from each of these poses; and their areas: the whole, and as much of it as views
    /// are believed to measure, square metres.
    pub fn seen_of_expected(&self, state: &ScanState, poses: &[Isometry3<f64>]) -> (Vec<Vec<SeenPart>>, Vec<[f64; 2]>) {
        let (Some(grid), Some(leaps)) = (&self.grid, &self.leaps) else {
            return (vec![Vec::new(); poses.len()], Vec::new());
        };
        let marcher = Marcher::new(grid, leaps, &state.sensor);
        let spots: Vec<Spot> = Spot::all(grid).collect();
        let seen = |pose: &Isometry3<f64>| {
            let eye = Point3::from(pose.translation.vector);
            let part = |(k, spot): (u32, &Spot)| {
                spot.is_seen(&marcher, &state.camera, pose).then(|| (k, spot.part_from(&eye) as f32))
            };
            (0..).zip(&spots).filter_map(part).collect()
        };
        (poses.iter().map(seen).collect(), spots.iter().map(|spot| [spot.area, spot.area * spot.belief]).collect())
    }

    /// The holes of the surface as it was at the last decision, from a thousandth of the whole on, largest first.
    pub fn holes(&self, state: &ScanState, allowed: &Allowed) -> Vec<Hole> {
        let (Some(grid), Some(leaps)) = (&self.grid, &self.leaps) else { return Vec::new() };
        let total = (self.surface.known_m2 + self.surface.expected_m2).max(f64::MIN_POSITIVE);
        let spots: Vec<Spot> = Spot::all(grid).collect();
        let mut pieces = pieces(grid, &spots);
        pieces.retain(|piece| piece.iter().map(|spot| spot.area).sum::<f64>() >= LISTED * total);
        if pieces.is_empty() {
            return Vec::new();
        }
        let marcher = Marcher::new(grid, leaps, &state.sensor);
        let describe = |piece: &Vec<&Spot>| describe(&marcher, state, allowed, piece, self.surface);
        let mut holes: Vec<Hole> = pieces.iter().map(describe).collect();
        holes.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
        holes
    }
}

/// Views at the expected surface, straight and from two sides.
pub(super) fn views(grid: &VoxelGrid, distance: f64) -> impl Iterator<Item = View> {
    let count = grid.expected.len() + grid.backs.len();
    let spots = Spot::all(grid).step_by(count.div_ceil(LOOKED_AT).max(1));
    spots.flat_map(move |spot| {
        let normal = spot.normal.try_normalize(1e-9);
        let aside = normal.map(|n| n.cross(&if n.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() }).normalize());
        let directions = normal.zip(aside).map(|(n, a)| [n, (n + a).normalize(), (n - a).normalize()]);
        let view = move |d: Vector3<f64>| View { target: spot.point, position: spot.point + distance * d };
        directions.into_iter().flatten().map(view)
    })
}

/// What is expected, in pieces whose voxels touch.
fn pieces<'a>(grid: &VoxelGrid, spots: &'a [Spot]) -> Vec<Vec<&'a Spot>> {
    let s = grid.side;
    let first_back = grid.expected.len();
    let backs: FxHashMap<usize, usize> =
        (first_back..).zip(&grid.backs).map(|(k, back)| (back.index as usize, k)).collect();
    let place = |voxel: usize| {
        let k = grid.slot[voxel] as usize;
        let passed = grid.expected.get(k).is_some_and(|e| e.index as usize == voxel);
        if passed { Some(k) } else { backs.get(&voxel).copied() }
    };
    let mut taken = vec![false; spots.len()];
    let mut pieces = Vec::new();
    for start in 0..taken.len() {
        if std::mem::replace(&mut taken[start], true) {
            continue;
        }
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&at) = piece.get(next) {
            next += 1;
            let low = spots[at].voxel as usize - (s * s + s + 1);
            for j in 0..27 {
                if let Some(k) = place(low + j % 3 + (j / 3 % 3) * s + (j / 9) * s * s)
                    && !std::mem::replace(&mut taken[k], true)
                {
                    piece.push(k);
                }
            }
        }
        piece.sort_unstable();
        pieces.push(piece.into_iter().map(|k| &spots[k]).collect());
    }
    pieces
}

fn describe(marcher: &Marcher, state: &ScanState, allowed: &Allowed, voxels: &[&Spot], whole: Surface) -> Hole {
    let area: f64 = voxels.iter().map(|v| v.area).sum();
    let mean = voxels.iter().map(|v| v.point.coords * v.area).sum::<Vector3<f64>>() / area;
    let from_mean = |v: &&&Spot| (v.point.coords - mean).norm_squared();
    let center = voxels.iter().min_by(|a, b| from_mean(a).total_cmp(&from_mean(b))).map_or(mean.into(), |v| v.point);
    let normal = voxels.iter().map(|v| v.normal * v.area).sum::<Vector3<f64>>().try_normalize(1e-3 * area);
    let farthest = voxels.iter().map(|v| (v.point - center).norm()).fold(0.0, f64::max);
    let looked_at = (SAMPLES * area / whole.expected_m2).clamp(OF_A_HOLE[0], OF_A_HOLE[1]) as usize;
    let samples: Vec<&Spot> = voxels.iter().copied().step_by(voxels.len().div_ceil(looked_at)).collect();
    let mut reached = vec![0.0; samples.len()];
    let mut best: Option<(usize, f64)> = None;
    for (rank, pose) in allowed.candidates {
        let eye = Point3::from(pose.translation.vector);
        let part = |spot: &&Spot| if spot.is_seen(marcher, &state.camera, pose) { spot.part_from(&eye) } else { 0.0 };
        let seen: Vec<f64> = samples.iter().map(part).collect();
        reached.iter_mut().zip(&seen).for_each(|(all, one)| *all = one.max(*all));
        let seen = seen.iter().sum();
        if seen > best.map_or(0.0, |(_, most)| most) {
            best = Some((*rank, seen));
        }
    }
    if let Some(may_be_taken) = allowed.others {
        for (reached, spot) in reached.iter_mut().zip(&samples).filter(|(reached, _)| **reached < 1.0) {
            let views = spot.directions().map(|direction| View {
                target: spot.point,
                position: spot.point + state.working_distance * direction,
            });
            for view in views {
                let part = spot.part_from(&view.position);
                if part > *reached && spot.is_measured(marcher, &view.position) && may_be_taken(&view) {
                    *reached = part;
                }
            }
        }
    }
    let believed: f64 = samples.iter().zip(&reached).map(|(spot, reached)| spot.belief * reached).sum();
    Hole {
        center_m: center.coords.into(),
        normal: normal.unwrap_or_default().into(),
        size_m: 2.0 * farthest + marcher.grid().voxel,
        area_m2: area,
        share: area / (whole.known_m2 + whole.expected_m2),
        unseen: why(marcher, &samples, state),
        within_reach: believed / samples.len().max(1) as f64,
        best_candidate: best.map(|(rank, _)| rank),
    }
}

/// What holds of most of the samples.
fn why(marcher: &Marcher, samples: &[&Spot], state: &ScanState) -> Unseen {
    let reasons = [Unseen::OutsideImage, Unseen::FacesAway, Unseen::Hidden, Unseen::NoReturn];
    let nearest = |spot: &&Spot| state.scans.iter().map(|scan| spot.why(marcher, scan)).max();
    let found: Vec<Option<Unseen>> = samples.iter().map(nearest).collect();
    let count = |reason: &Unseen| found.iter().filter(|f| **f == Some(*reason)).count();
    reasons.into_iter().max_by_key(count).unwrap_or(Unseen::OutsideImage)
}

/// A voxel of the membrane, or of the surface that holds its own back.
pub(super) struct Spot {
    voxel: u32,
    is_back: bool,
    pub(super) point: Point3<f64>,
    pub(super) normal: Vector3<f64>,
    /// Square metres.
    area: f64,
    belief: f64,
}

impl Spot {
    /// Those of the membrane, then the backs.
    pub(super) fn all(grid: &VoxelGrid) -> impl Iterator<Item = Self> {
        grid.expected.iter().map(|e| Self::of(grid, e, false)).chain(grid.backs.iter().map(|e| Self::of(grid, e, true)))
    }

    pub(super) fn of(grid: &VoxelGrid, expected: &ExpectedVoxel, is_back: bool) -> Self {
        let normal = Vector3::from(expected.normal).cast();
        let (area, belief) = (expected.area() * grid.voxel.powi(2), f64::from(expected.belief));
        Self { voxel: expected.index, is_back, point: grid.middle(expected.index), normal, area, belief }
    }

    /// What a ray from `eye` meets up to so many voxels beyond it, and how far the eye is, voxels.
    fn looked_at<'a>(&self, marcher: &'a Marcher, eye: &Point3<f64>, beyond: f32) -> (Hit<'a>, f32) {
        let grid = marcher.grid();
        let [from, to] = [eye, &self.point].map(|p| Vector3::from(grid.local(p)));
        let distance = (to - from).norm();
        // No farther back than the grid reaches.
        let near = (distance - 2.0 * grid.side as f32).max(0.0);
        let ray = (to - from) / distance.max(f32::MIN_POSITIVE);
        let [hit] = marcher.follow(&from.into(), &[ray.into()], near, distance + beyond);
        (hit, distance)
    }

    fn is_in_sight(&self, marcher: &Marcher, eye: &Point3<f64>) -> bool {
        if self.is_back {
            // Surface does not stop a ray from behind: enough that nothing does before.
            let before = || self.looked_at(marcher, eye, -NEAR).0;
            return self.cosine(eye) > EDGE_ON && matches!(before(), Hit::Nothing { .. });
        }
        let (hit, distance) = self.looked_at(marcher, eye, NEAR);
        matches!(hit, Hit::Expected { at, .. } if (at - distance).abs() <= NEAR)
    }

    /// Cosine of the angle at which a ray from `eye` meets it; 1 where its normal is not made out.
    fn cosine(&self, eye: &Point3<f64>) -> f64 {
        let ray = eye - self.point;
        match self.normal.try_normalize(1e-9) {
            Some(normal) => normal.dot(&ray) / ray.norm().max(f64::MIN_POSITIVE),
            None => 1.0,
        }
    }

    /// The solid angle under which it is seen from `eye`, steradians.
    pub(super) fn angle(&self, eye: &Point3<f64>) -> f64 {
        self.area * self.cosine(eye).max(0.0) / (eye - self.point).norm_squared().max(f64::MIN_POSITIVE)
    }

    /// What a view from `eye` that sees it is expected to measure of it, square metres.
    pub(super) fn measured_area(&self, eye: &Point3<f64>) -> f64 {
        self.area * self.part_from(eye)
    }

    /// Which part of it a view from `eye` that sees it is expected to measure: as in a forecast, less where it would be seen edge-on.
    fn part_from(&self, eye: &Point3<f64>) -> f64 {
        (self.cosine(eye) / f64::from(COARSE)).clamp(0.0, 1.0)
    }

    /// Whether it is in sight of `eye`, near enough and not too flat for the sensor.
    fn is_measured(&self, marcher: &Marcher, eye: &Point3<f64>) -> bool {
        let distance = (eye - self.point).norm() / marcher.grid().voxel;
        marcher.measures(distance as f32, self.cosine(eye).max(0.0) as f32) && self.is_in_sight(marcher, eye)
    }

    pub(super) fn is_seen(&self, marcher: &Marcher, camera: &PinholeCamera, pose: &Isometry3<f64>) -> bool {
        in_image(camera, pose, &self.point) && self.is_measured(marcher, &Point3::from(pose.translation.vector))
    }

    fn is_outside(&self, scan: &PastScan) -> bool {
        matches!(&scan.seen, Seen::Depth { camera, .. } if !in_image(camera, &scan.world_from_camera, &self.point))
    }

    /// Whether a scan looked at it.
    pub(super) fn was_in_sight(&self, marcher: &Marcher, scan: &PastScan) -> bool {
        !self.is_outside(scan) && self.is_in_sight(marcher, &Point3::from(scan.world_from_camera.translation.vector))
    }

    fn why(&self, marcher: &Marcher, scan: &PastScan) -> Unseen {
        let eye = Point3::from(scan.world_from_camera.translation.vector);
        let ray = eye - self.point;
        if self.is_outside(scan) {
            return Unseen::OutsideImage;
        }
        if self.normal != Vector3::zeros() && self.normal.dot(&ray) < EDGE_ON * ray.norm() {
            return Unseen::FacesAway;
        }
        if self.is_in_sight(marcher, &eye) { Unseen::NoReturn } else { Unseen::Hidden }
    }

    /// Directions over the half space that it faces.
    fn directions(&self) -> impl Iterator<Item = Vector3<f64>> {
        let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
        let all = (0..2 * DIRECTIONS).map(move |i| {
            let z = 1.0 - (i as f64 + 0.5) / DIRECTIONS as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            Vector3::new(r * cos, r * sin, z)
        });
        let normal = self.normal;
        all.filter(move |d| normal == Vector3::zeros() || d.dot(&normal) > EDGE_ON)
    }
}

fn in_image(camera: &PinholeCamera, pose: &Isometry3<f64>, point: &Point3<f64>) -> bool {
    let local = pose.inverse() * point;
    let pixel = camera.project(&local);
    let inside = |x: f64, size: u32| x > -0.5 && x < f64::from(size) - 0.5;
    local.z > 0.0 && inside(pixel.x, camera.width) && inside(pixel.y, camera.height)
}
