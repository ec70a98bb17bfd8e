//! Overlap expected of a view: how far it may be missed, and a rough estimate from the cloud alone where the planner
//! predicts none.

use crate::ScanState;
use geometry::{PointCloud, View};
use nalgebra::Isometry3;

/// By how much an expected overlap is taken to be missed where a least one is asked for, after this many scans: what nobody
/// expected early turns up in the image. Of 78 first next views on 26 objects, 8 had an overlap under 0.2 where 0.3 were asked
/// for without it, 2 with it, none with the caution of [`crate::RankedView::cautious_overlap`] beside it.
pub fn margin(scans: usize) -> f64 {
    match scans {
        0 | 1 => 0.1,
        2 => 0.05,
        _ => 0.0,
    }
}

/// Points that one scan of this cloud usually shows: an even share, and no fewer than a third of the cloud (a
/// scan shows about that much of a closed object).
pub fn usual_scan(cloud: &PointCloud, scans: usize) -> f64 {
    cloud.len() as f64 / scans.clamp(1, 3) as f64
}

/// Measured points that the view would see again from this pose of its camera, over the points that a scan usually has. Points
/// count if they face the camera, lie in the image and are not behind others (cells of the image about three points wide).
pub fn estimate(state: &ScanState, view: &View, world_from_camera: &Isometry3<f64>, usual_scan: f64) -> f64 {
    let (cloud, camera, sensor) = (&state.cloud, &state.camera, &state.sensor);
    let camera_from_world = world_from_camera.inverse();
    let distance = (view.position - view.target).norm();
    let (low, high) = cloud.bounding_box();
    // Points per area of the box's mid-section, as if spread over it: only sets the size of a cell.
    let cell = 3.0 * ((high - low).norm() / (cloud.len().max(1) as f64).sqrt());
    let facing = cloud.points.iter().zip(&cloud.normals).filter_map(|(p, n)| {
        let local = camera_from_world * p;
        let pixel = camera.project(&local);
        let seen = local.z > 0.0
            && (view.position - p).dot(n) > 0.1 * n.norm() * (view.position - p).norm()
            && sensor.measures(&view.position, p, n)
            && (0.0..f64::from(camera.width)).contains(&pixel.x)
            && (0.0..f64::from(camera.height)).contains(&pixel.y);
        let scale = distance / (camera.fx * cell.max(f64::MIN_POSITIVE));
        seen.then(|| ([pixel.x, pixel.y].map(|x| (x * scale).floor() as i64), local.z))
    });
    let facing: Vec<_> = facing.collect();
    let mut front = std::collections::HashMap::new();
    for (key, depth) in &facing {
        front.entry(*key).and_modify(|z: &mut f64| *z = z.min(*depth)).or_insert(*depth);
    }
    let visible = facing.iter().filter(|(key, depth)| *depth <= front[key] + 2.0 * cell).count() as f64;
    (visible / usual_scan.max(visible).max(1.0)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SensorConfig;
    use nalgebra::{Point3, Vector3};

    #[test]
    fn a_sheet_is_seen_from_its_front_only() {
        let points: Vec<_> =
            (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.003, f64::from(i / 30) * 0.003, 0.0)).collect();
        let cloud = PointCloud { normals: vec![Vector3::z(); points.len()], points };
        let target = Point3::new(0.045, 0.045, 0.0);
        let usual = usual_scan(&cloud, 1);
        let mut state = ScanState { cloud, ..ScanState::default() };
        let from = |state: &ScanState, offset: Vector3<f64>| {
            let view = View { target, position: target + offset };
            estimate(state, &view, &view.world_from_camera(), usual)
        };
        assert_eq!(from(&state, Vector3::new(0.0, 0.0, 1.2)), 1.0, "all of it from the front");
        assert_eq!(from(&state, Vector3::new(0.0, 0.0, -1.2)), 0.0, "nothing from behind");
        let near = from(&state, Vector3::new(0.0, 0.0, 0.03));
        assert!(near > 0.05 && near < 0.9, "the part in the image from close by: {near}");
        state.sensor = SensorConfig { max_range_m: Some(1.0), ..SensorConfig::default() };
        assert_eq!(from(&state, Vector3::new(0.0, 0.0, 1.2)), 0.0, "out of the sensor's range");
        state.sensor = SensorConfig { max_incidence_deg: Some(60.0), ..SensorConfig::default() };
        assert_eq!(from(&state, Vector3::new(1.2, 0.0, 0.3)), 0.0, "too flat for it");
    }

    #[test]
    fn what_is_behind_does_not_count() {
        let sheet =
            |z: f64| (0..900).map(move |i| Point3::new(f64::from(i % 30) * 0.003, f64::from(i / 30) * 0.003, z));
        let points: Vec<_> = sheet(0.0).chain(sheet(-0.2)).collect();
        let cloud = PointCloud { normals: vec![Vector3::z(); points.len()], points };
        let target = Point3::new(0.045, 0.045, 0.0);
        let view = View { target, position: target + Vector3::new(0.0, 0.0, 1.2) };
        let usual = cloud.len() as f64;
        let share = estimate(&ScanState { cloud, ..ScanState::default() }, &view, &view.world_from_camera(), usual);
        assert!((share - 0.5).abs() < 0.1, "the front sheet is half of the cloud: {share}");
    }
}
