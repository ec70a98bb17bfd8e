use super::*;

fn wall() -> DepthImage {
    DepthImage { origin: [600, 300], size: [80, 80], depth: vec![1.2; 6400] }
}

#[test]
fn axial_noise_has_its_deviation_and_repeats() {
    let camera = PinholeCamera::default();
    let (mut near, mut again) = (wall(), wall());
    let noise = NoiseConfig::axial(0.001);
    noise.disturb(&mut near, &camera, &Isometry3::identity());
    noise.disturb(&mut again, &camera, &Isometry3::identity());
    assert_eq!(near, again, "same seed and pose, same noise");
    let deviation = |image: &DepthImage, z: f64| {
        let squares: f64 = image.depth.iter().map(|&d| (f64::from(d) - z).powi(2)).sum();
        (squares / image.depth.len() as f64).sqrt()
    };
    let at_near = deviation(&near, 1.2);
    assert!((at_near - 0.001).abs() < 5e-5, "{at_near}");
    let mut far = wall();
    far.depth.fill(2.4);
    noise.disturb(&mut far, &camera, &Isometry3::translation(0.0, 0.0, 1.0));
    let at_far = deviation(&far, 2.4);
    assert!((at_far - 0.004).abs() < 2e-4, "{at_far}");
}

#[test]
fn only_the_rim_of_a_wall_drops_out() {
    let camera = PinholeCamera::default();
    let mut image = wall();
    let noise = NoiseConfig { lateral_sigma_px: 0.0, ..NoiseConfig::default() };
    noise.disturb(&mut image, &camera, &Isometry3::identity());
    let lost: Vec<(usize, usize)> =
        image.depth.iter().enumerate().filter(|(_, z)| **z == 0.0).map(|(i, _)| (i % 80, i / 80)).collect();
    assert!(lost.iter().all(|&(c, r)| c == 0 || r == 0 || c == 79 || r == 79), "{lost:?}");
    assert!((30..100).contains(&lost.len()), "a fifth of 316 rim pixels, found {}", lost.len());
}

#[test]
fn grazing_surface_drops_out_and_jitter_widens_the_silhouette() {
    let camera = PinholeCamera::default();
    // A plane through the middle of the window, nearly containing the rays.
    let mut image = wall();
    for (i, z) in image.depth.iter_mut().enumerate() {
        *z = 1.2 + 0.015 * ((i / 80) as f32 - 40.0);
    }
    let noise = NoiseConfig { edge_dropout: 0.0, lateral_sigma_px: 0.0, ..NoiseConfig::default() };
    noise.disturb(&mut image, &camera, &Isometry3::identity());
    let lost = image.depth.iter().filter(|z| **z == 0.0).count();
    assert!(lost > 2000, "{lost} of 6400 lost at about 81 degrees");
    let mut jittered = wall();
    let noise = NoiseConfig { lateral_sigma_px: 0.7, edge_dropout: 0.0, ..NoiseConfig::default() };
    noise.disturb(&mut jittered, &camera, &Isometry3::identity());
    assert_eq!(jittered.size, [84, 84], "a margin for pixels that read the object from outside");
    assert!((0..84).any(|r| jittered.depth[r * 84 + 1] > 0.0));
}
