use super::*;
use crate::golden::Golden;
use crate::rng::stream;
use rand::RngExt;

fn boundary(cloud: &PointCloud, config: &BoundaryConfig) -> Vec<usize> {
    boundary_points(cloud, &Neighborhoods::of(&cloud.points, config.neighbors), config)
}

fn plane(pitch: f64) -> PointCloud {
    let points = (0..400).map(|i| Point3::new(f64::from(i % 20) * pitch, f64::from(i / 20) * pitch, 0.0)).collect();
    PointCloud { points, normals: vec![Vector3::z(); 400] }
}

#[test]
fn the_boundary_of_a_square_is_its_rim_and_the_rim_of_its_hole() {
    let found = boundary(&plane(0.01), &BoundaryConfig::default());
    let rim: Vec<usize> = (0..400).filter(|i| i % 20 % 19 == 0 || i / 20 % 19 == 0).collect();
    assert_eq!(found, rim);
    let mut holed = plane(0.01);
    let keep: Vec<bool> = (0..400).map(|i| !(7..13).contains(&(i % 20)) || !(7..13).contains(&(i / 20))).collect();
    let mut kept = keep.iter();
    holed.points.retain(|_| *kept.next().unwrap());
    holed.normals.truncate(holed.points.len());
    let inner = boundary(&holed, &BoundaryConfig::default())
        .into_iter()
        .filter(|&i| holed.points[i].iter().take(2).all(|x| (0.03..0.16).contains(x)))
        .count();
    assert!((16..=28).contains(&inner), "{inner} points around the hole");
}

#[test]
fn degenerate_clouds_have_an_answer() {
    let config = BoundaryConfig::default();
    assert!(boundary(&PointCloud::default(), &config).is_empty());
    let mut cloud = plane(0.0);
    assert!(boundary(&cloud, &config).is_empty(), "one spot has no directions");
    cloud = plane(0.01);
    cloud.normals[0] = Vector3::zeros();
    cloud.points[1].x = f64::NAN;
    assert!(!boundary(&cloud, &config).contains(&0), "no normal, no boundary");
    cloud.normals.clear();
    assert!(boundary(&cloud, &config).is_empty());
}

#[test]
fn the_gap_test_equals_sorted_angles() {
    let mut rng = stream(5, "boundary");
    for gap in [60.0, 120.0, 150.0, 200.0] {
        let config = BoundaryConfig { max_gap_deg: gap, ..BoundaryConfig::default() };
        for _ in 0..300 {
            let n = rng.random_range(2..9);
            let mut points = vec![Point3::origin()];
            points.extend((1..n).map(|_| Point3::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0), 0.0)));
            let mut angles: Vec<f64> = points[1..].iter().map(|p| f64::atan2(p.y, p.x).to_degrees()).collect();
            angles.sort_by(f64::total_cmp);
            angles.push(angles[0] + 360.0);
            let largest = angles.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
            if (largest - gap).abs() < 1e-3 {
                continue;
            }
            let cloud = PointCloud { normals: vec![Vector3::new(0.0, 0.0, 0.5); n], points };
            let nearby = Neighborhoods::of(&cloud.points, 30);
            let found = AngleCriterion::new(10.0, &config).is_boundary(&cloud, &nearby, 0, &mut Vec::new());
            assert_eq!(found, largest > gap, "gap {gap}, largest {largest}: {angles:?}");
        }
    }
}

const PUBLISHED: BoundaryConfig = BoundaryConfig { neighbors: 30, max_gap_deg: 120.0, published_frame: true };

/// Flags that differ from the recorded ones.
fn wrong_flags(golden: &Golden, mask: &str, cloud: &PointCloud, radius: f64, config: &BoundaryConfig) -> usize {
    let nearby = Neighborhoods::of(&cloud.points, 30);
    let criterion = AngleCriterion::new(radius, config);
    let ours: Vec<u8> =
        (0..cloud.len()).map(|i| u8::from(criterion.is_boundary(cloud, &nearby, i, &mut Vec::new()))).collect();
    let expected = golden.u8(mask);
    assert_eq!(ours.len(), expected.len(), "{mask}");
    ours.iter().zip(expected).filter(|&(a, b)| *a != b).count()
}

/// Neighbourhoods, from that of the first point on, that differ from the recorded ones.
fn wrong_neighborhoods(golden: &Golden, name: &str, nearby: &Neighborhoods) -> usize {
    let sorted = |ids: &mut dyn Iterator<Item = i32>| {
        let mut ids: Vec<i32> = ids.collect();
        ids.sort_unstable();
        ids
    };
    let expected = golden.i32(&format!("{name}.neighbour_index"));
    let differ = |&(i, known): &(usize, &[i32])| {
        let count = known.iter().filter(|&&j| j >= 0).count();
        sorted(&mut known.iter().copied().filter(|&j| j >= 0))
            != sorted(&mut nearby.ids(i)[..count].iter().map(|&j| j as i32))
    };
    expected.chunks_exact(30).enumerate().filter(differ).count()
}

#[test]
fn masks_and_neighborhoods_equal_those_of_open3d() {
    let golden = Golden::open("boundary.safetensors");
    for name in ["sphere", "torus"] {
        let mut cloud = golden.cloud_of(name);
        let nearby = Neighborhoods::of(&cloud.points, 30);
        let radius = golden.f64(&format!("{name}.radius"))[0];
        assert!((nearby.mean_distance() - radius).abs() < 1e-6 * radius, "{name}: radius");
        assert_eq!(wrong_neighborhoods(&golden, name, &nearby), 0, "{name}");
        for (i, count) in golden.indices(&format!("{name}.neighbour_count")).into_iter().enumerate() {
            let within = nearby.distances2(i).iter().filter(|&&d2| f64::from(d2).sqrt() < radius).count();
            assert_eq!(within, count, "{name}: within the radius of point {i}");
        }
        let wrong = |mask: &str, cloud: &PointCloud, config: &BoundaryConfig| {
            wrong_flags(&golden, &format!("{name}.{mask}"), cloud, radius, config)
        };
        assert_eq!(wrong("mask", &cloud, &PUBLISHED), 0, "{name}");
        assert_eq!(wrong("plain_mask", &cloud, &BoundaryConfig::default()), 0, "{name}");
        cloud.normals.iter_mut().for_each(|n| *n *= 0.25);
        assert_eq!(wrong("quarter_mask", &cloud, &PUBLISHED), 0, "{name}: short normals");
        assert_eq!(wrong("plain_mask", &cloud, &BoundaryConfig::default()), 0, "{name}: short normals");
    }
}

#[test]
fn flat_masks_equal_those_of_open3d() {
    let golden = Golden::open("boundary.safetensors");
    for name in ["z", "minus_z", "tilt1e-3", "x", "diag111", "half_length_tilt"] {
        let points = golden.points(&format!("flat.{name}.points"));
        let normal = golden.points(&format!("flat.{name}.normal"))[0].coords;
        let cloud = PointCloud { normals: vec![normal; points.len()], points };
        for (mask, config) in [("mask", PUBLISHED), ("plain_mask", BoundaryConfig::default())] {
            let wrong = wrong_flags(&golden, &format!("flat.{name}.{mask}"), &cloud, 0.006, &config);
            assert_eq!(wrong, 0, "{name}.{mask}");
        }
    }
}

#[test]
fn bonus_masks_equal_the_published_ones() {
    if let Some(golden) = Golden::bonus("b_boundary.safetensors") {
        for name in ["bunny_after1", "horse_after3", "teapot_after2"] {
            let cloud = golden.cloud_of(name);
            let nearby = Neighborhoods::of(&cloud.points, 30);
            let radius = golden.f64(&format!("{name}.radius"))[0];
            assert!((nearby.mean_distance() - radius).abs() < 1e-6 * radius, "{name}: radius");
            let differ = wrong_neighborhoods(&golden, name, &nearby);
            assert!(differ * 200 < cloud.len(), "{name}: {differ} neighbourhoods differ");
            let wrong = wrong_flags(&golden, &format!("{name}.mask"), &cloud, radius, &PUBLISHED);
            assert!(wrong * 200 <= cloud.len(), "{name}: {wrong} of {} differ", cloud.len());
            println!("{name}: {wrong} of {} boundary flags differ", cloud.len());
        }
    }
    if let Some(golden) = Golden::bonus("b_boundary_flat.safetensors") {
        let radius = golden.f64("radius")[0];
        for name in ["z", "minus_z", "tilt1e-3", "x", "diag111", "half_length_tilt"] {
            let wrong = wrong_flags(&golden, &format!("{name}.mask"), &golden.cloud_of(name), radius, &PUBLISHED);
            assert!(wrong <= 1, "{name}: {wrong} of 256 differ");
        }
    }
}
