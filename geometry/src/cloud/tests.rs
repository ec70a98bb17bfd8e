use super::*;
use crate::golden::Golden;
use crate::rng::stream;
use rand::RngExt;
use std::collections::BTreeMap;

#[test]
fn voxel_means_equal_those_of_a_map() {
    let mut rng = stream(1, "voxels");
    for origin in [VoxelOrigin::World, VoxelOrigin::CloudMinimum] {
        let points: Vec<_> = (0..2000).map(|_| Point3::from([0; 3].map(|_| rng.random_range(-0.1..0.1)))).collect();
        let cloud = PointCloud { normals: points.iter().map(|p| p.coords).collect(), points };
        let thin = cloud.voxel_downsample(0.01, origin);
        let corner = match origin {
            VoxelOrigin::World => Point3::origin(),
            VoxelOrigin::CloudMinimum => cloud.bounding_box().0 - Vector3::repeat(0.005),
        };
        let mut voxels = BTreeMap::<[i64; 3], (Vector3<f64>, f64)>::new();
        for p in &cloud.points {
            let entry = voxels.entry(voxel_of(p, &corner, 0.01)).or_default();
            *entry = (entry.0 + p.coords, entry.1 + 1.0);
        }
        assert_eq!(thin.len(), voxels.len());
        for (p, n) in thin.points.iter().zip(&thin.normals) {
            let (sum, count) = voxels[&voxel_of(p, &corner, 0.01)];
            assert!((p.coords - sum / count).norm() < 1e-12 && (n - p.coords).norm() < 1e-12);
        }
    }
}

#[test]
fn degenerate_downsampling() {
    let mut cloud = PointCloud { points: vec![Point3::new(1.0, f64::NAN, 0.0), Point3::origin()], normals: vec![] };
    assert_eq!(cloud.voxel_downsample(0.1, VoxelOrigin::CloudMinimum).points, [Point3::origin()]);
    assert_eq!(cloud.voxel_downsample(0.0, VoxelOrigin::World).len(), 2);
    cloud.points.clear();
    assert!(cloud.voxel_downsample(0.1, VoxelOrigin::CloudMinimum).is_empty());
}

fn merged_voxels_equal(golden: &Golden, object: &str, expected: &PointCloud, within: [f64; 2]) {
    let name = |field: &str| format!("{object}.{field}");
    let scan = golden.cloud(&name("scan"));
    let mut cloud = golden.cloud(&name("existing"));
    cloud.merge(&scan);
    let grid_size = golden.f64(&name("grid_size"))[0];
    let spacing = crate::mean_spacing(&scan.points, &crate::Neighborhoods::of(&scan.points, 2));
    assert!((spacing - grid_size).abs() < 1e-8 * grid_size, "{object}: {spacing} against {grid_size}");
    let thin = cloud.voxel_downsample(grid_size, VoxelOrigin::CloudMinimum);
    assert_eq!(thin.len(), expected.len(), "{object}");
    assert!(thin.len() < cloud.len(), "{object}: nothing was averaged");
    for (p, n) in thin.points.iter().zip(&thin.normals) {
        let far = |i: &usize| (expected.points[*i] - p).norm_squared();
        let i = (0..expected.len()).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap();
        let (place, normal) = (far(&i).sqrt(), (expected.normals[i] - n).norm());
        assert!(place < within[0] && normal < within[1], "{object}: {p} {place:e} {normal:e}");
    }
}

#[test]
fn merged_voxels_equal_those_of_open3d() {
    let golden = Golden::open("scans.safetensors");
    for object in ["sphere", "torus"] {
        // Recorded in f32.
        merged_voxels_equal(&golden, object, &golden.cloud(&format!("{object}.merged")), [1e-8, 1e-7]);
    }
}

#[test]
fn bonus_merged_voxels_equal_the_published_ones() {
    let Some(golden) = Golden::bonus("f_metrics.safetensors") else { return };
    for object in ["bunny", "teapot"] {
        merged_voxels_equal(&golden, object, &golden.cloud(&format!("{object}.merged_voxelised")), [1e-12; 2]);
    }
}
