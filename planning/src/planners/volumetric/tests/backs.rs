use super::*;
use crate::CameraPose;
use crate::estimate::Trust;

/// Half the sides of a steel plate of 100 x 100 x 1.5 mm: less than half a voxel thick.
const PLATE: [f64; 3] = [0.05, 0.05, 0.00075];

/// Where a ray from `eye` meets the plate, and the normal there.
fn met(eye: &Point3<f64>, ray: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
    let (mut from, mut to, mut axis) = (0.0, f64::INFINITY, 0);
    for k in 0..3 {
        let faces = [-PLATE[k], PLATE[k]].map(|x| (x - eye[k]) / ray[k]);
        to = f64::min(to, faces[0].max(faces[1]));
        if faces[0].min(faces[1]) > from {
            (from, axis) = (faces[0].min(faces[1]), k);
        }
    }
    (from < to).then(|| (from, Vector3::ith(axis, -ray[axis].signum())))
}

/// The plate scanned from these positions, metres, with the background behind it.
fn scanned(eyes: &[[f64; 3]]) -> ScanState {
    let mut state = ball(NoReturn::Free);
    (state.scans, state.num_scans, state.cloud) = (Vec::new(), eyes.len(), PointCloud::default());
    state.given_views = [1.2, -1.2].map(|z| from_z(z).world_from_camera()).into();
    for eye in eyes.iter().copied().map(Point3::from) {
        let pose = View { target: Point3::origin(), position: eye }.world_from_camera();
        let (origin, size) = ([440, 160], [400, 400]);
        let look = |i: u32| {
            let ray = state.camera.unproject(f64::from(440 + i % 400), f64::from(160 + i / 400), 1.0).coords;
            met(&eye, &(pose * ray))
        };
        let depth: Vec<f32> = (0..160_000).map(|i| look(i).map_or(0.0, |(z, _)| z as f32)).collect();
        let depth = DepthImage { origin, size, depth };
        state.cloud.points.extend(depth.to_points(&state.camera, &pose));
        state.cloud.normals.extend((0..160_000).filter_map(look).map(|(_, normal)| normal));
        let seen = Seen::Depth { camera: state.camera, depth, misses: NoReturn::Free };
        state.scans.push(Arc::new(PastScan { world_from_camera: pose, seen, pose: Default::default(), veil: None }));
    }
    state
}

/// Share of the whole that is missing, and what the views from the front and from the back are told to bring and score by.
fn told(eyes: &[[f64; 3]]) -> (f64, [[f64; 2]; 2]) {
    let mut planner = VolumetricPlanner::default();
    let forecasts = planner.forecast(&scanned(eyes), &mut rng::stream(1, "plate"));
    (1.0 - planner.surface().covered(), [0, 1].map(|i| [forecasts.views[i].reported_gain, forecasts.views[i].gain]))
}

const FRONT: [f64; 3] = [0.0, 0.0, 1.2];
const EDGE: [f64; 3] = [1.2, 0.0, 0.0];
const BACK: [f64; 3] = [0.0, 0.0, -1.2];

#[test]
fn the_back_of_a_plate_is_missing_though_a_look_along_it_shows_free_space_behind() {
    let (missing, [front, back]) = told(&[FRONT, EDGE]);
    assert!((missing - 0.5).abs() < 0.1, "half of it is: {missing}");
    assert!((back[0] - 0.5).abs() < 0.1 && back[1] > 0.4, "a look at it brings all that is missing: {back:?}");
    assert!(front[0] < 0.05 && front[1] < 0.05, "another at its front nothing: {front:?}");
    let state = scanned(&[FRONT, EDGE]);
    let mut planner = VolumetricPlanner::default();
    planner.forecast(&state, &mut rng::stream(1, "plate"));
    let views: Vec<(usize, nalgebra::Isometry3<f64>)> = state.given_views.iter().copied().enumerate().collect();
    let holes = planner.holes(&state, &Allowed { candidates: &views, others: None });
    let hole = holes.first().expect("a hole");
    assert!((hole.area_m2 - 0.01).abs() < 0.002 && hole.normal[2] < -0.95, "one hole, its back: {hole:?}");
    assert!(hole.unseen == Unseen::FacesAway && hole.best_candidate == Some(1), "{hole:?}");
    assert!(hole.within_reach > 0.9, "{hole:?}");
}

#[test]
fn a_back_that_was_measured_at_a_flat_angle_is_known() {
    // At a cosine of 0.15, less than what counts as having looked; the front's points are six times as many in a voxel.
    let (front, flat) = ([0.0, 0.0, 0.3], [0.295, 0.0, -0.045]);
    let [(without, _), (with, _)] = [told(&[front, EDGE]), told(&[front, EDGE, flat])];
    assert!(with < 0.2 * without, "{without} {with}");
}

#[test]
fn a_back_that_was_looked_at_is_missing_no_more() {
    let (missing, [_, back]) = told(&[FRONT, EDGE, BACK]);
    assert!(missing < 0.05 && back[0] < 0.05, "{missing} {back:?}");
}

#[test]
fn a_back_whose_points_thinning_left_out_is_missing_no_more() {
    let mut state = scanned(&[FRONT, EDGE, BACK]);
    // Nearer to points of the front than the radius that thins.
    state.cloud = scanned(&[FRONT, EDGE]).cloud;
    let mut planner = VolumetricPlanner::default();
    planner.forecast(&state, &mut rng::stream(1, "plate"));
    let missing = 1.0 - planner.surface().covered();
    assert!(missing < 0.05, "{missing}");
}

#[test]
fn what_is_thicker_than_its_voxels_has_no_back_in_its_front() {
    let mut planner = VolumetricPlanner::default();
    planner.forecast(&ball(NoReturn::Free), &mut rng::stream(1, "ball"));
    assert!(planner.grid.expect("a grid").backs.is_empty());
}

/// A ball of 10 cm with bumps of 1 cm, each scan of which holds points that its bumps hide, as noise or poses that are off make them: rays to them
/// pass through the bumps, and normals turned to the camera point inwards.
fn bumpy(eyes: &[[f64; 3]]) -> ScanState {
    let mut state = ball(NoReturn::Free);
    (state.scans, state.num_scans, state.cloud) = (Vec::new(), eyes.len(), PointCloud::default());
    let radius = |n: &Vector3<f64>| 0.1 + 0.01 * (8.0 * n.x).sin() * (6.0 * n.y).cos();
    let at = |n: Vector3<f64>| Point3::from(n * radius(&n));
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    for eye in eyes.iter().copied().map(Point3::from) {
        let mut seen = Vec::new();
        for i in 0..40_000 {
            let z = 1.0 - (f64::from(i) + 0.5) / 20_000.0;
            let (sin, cos) = (golden * f64::from(i)).sin_cos();
            let n = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            let p = at(n);
            if n.dot(&(eye - p)) < 0.02 {
                continue;
            }
            let across = n.cross(&Vector3::x()).normalize();
            let [u, v] = [across, n.cross(&across)].map(|t| at((n + 1e-4 * t).normalize()) - p);
            let normal = u.cross(&v).normalize();
            seen.push(p);
            state.cloud.points.push(p);
            state.cloud.normals.push(normal * normal.dot(&(eye - p)).signum());
        }
        let pose = View { target: Point3::origin(), position: eye }.world_from_camera();
        let scan = PastScan { world_from_camera: pose, seen: Seen::Points(seen), pose: Default::default(), veil: None };
        state.scans.push(Arc::new(scan));
    }
    state
}

#[test]
fn rays_through_bumps_make_a_ball_no_thin_part() {
    let mut planner = VolumetricPlanner::default();
    let eyes = [[0.0, -0.5, 0.3], [0.5, 0.4, 0.2], [-0.5, 0.0, 0.0], [-0.1, 0.6, -0.2], [0.3, -0.5, -0.4]];
    planner.forecast(&bumpy(&eyes), &mut rng::stream(1, "ball"));
    let grid = planner.grid.expect("a grid");
    let share = grid.backs.len() as f64 / grid.surface.len() as f64;
    assert!(share < 0.01, "{} of {}", grid.backs.len(), grid.surface.len());
}

#[test]
fn normals_that_point_inwards_at_the_rim_make_no_backs() {
    let mut state = ball(NoReturn::Free);
    let eye = state.scans[0].world_from_camera.translation.vector;
    let PointCloud { points, normals } = &mut state.cloud;
    for (p, n) in points.iter().zip(normals).filter(|(p, n)| n.dot(&(eye - p.coords).normalize()) < 0.2) {
        *n = -p.coords.normalize();
    }
    let mut planner = VolumetricPlanner::default();
    planner.forecast(&state, &mut rng::stream(1, "ball"));
    assert!(planner.grid.expect("a grid").backs.is_empty());
}

#[test]
fn what_is_mostly_backs_is_looked_at_from_behind_next() {
    let mut state = scanned(&[FRONT, EDGE]);
    state.given_views = Default::default();
    let ranked = VolumetricPlanner::default().rank_views(&state, &mut rng::stream(1, "plate")).expect("views");
    let first = &ranked[0];
    assert!(first.view.direction().z < -0.6, "{first:?}");
    assert!(first.gain.expect("a gain") > 0.4, "{first:?}");
    // Of its front that view sees nothing, and of its edges little.
    assert!(first.overlap.expect("an overlap") < 0.1, "{first:?}");
}

#[test]
fn where_cameras_are_estimated_nothing_is_said_of_backs() {
    let mut state = scanned(&[FRONT, EDGE]);
    let trust = Trust { misfit: 0.1, against_other_side: 0.5, span: 5.0 };
    for scan in &mut state.scans {
        Arc::make_mut(scan).pose = CameraPose::Estimated(trust);
    }
    let mut planner = VolumetricPlanner::default();
    planner.forecast(&state, &mut rng::stream(1, "plate"));
    assert!(planner.grid.expect("a grid").backs.is_empty());
}

#[test]
fn what_was_seen_from_above_on_all_sides_is_looked_at_from_below() {
    let above = [[0.85, 0.0], [-0.85, 0.0], [0.0, 0.85], [0.0, -0.85]].map(|[x, y]| [x, y, 0.85]);
    let eyes: Vec<[f64; 3]> = [FRONT].into_iter().chain(above).collect();
    for count in [1, 5] {
        let mut state = scanned(&eyes[..count]);
        state.given_views = Default::default();
        let forecasts = VolumetricPlanner::default().forecast(&state, &mut rng::stream(1, "plate"));
        let of_rim = forecasts.views.iter().filter(|f| f.view.direction().z > -0.2);
        let most = of_rim.map(|f| f.reported_gain).fold(0.0, f64::max);
        let ranked = VolumetricPlanner::default().rank(&forecasts);
        assert!(ranked[0].view.direction().z < -0.3, "after {count}: {:?}, {most} from above", ranked[0]);
        assert!(ranked[0].gain > Some(0.2), "after {count}: {:?}", ranked[0]);
    }
}
