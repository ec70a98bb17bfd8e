use super::*;

#[test]
fn cropping_keeps_every_return() {
    let mut image = DepthImage { origin: [7, 3], size: [4, 3], depth: vec![0.0; 12] };
    (image.depth[5], image.depth[10]) = (1.0, 2.0);
    let whole = image.clone();
    image.crop();
    assert_eq!(image, DepthImage { origin: [8, 4], size: [2, 2], depth: vec![1.0, 0.0, 0.0, 2.0] });
    assert!((0..20).all(|c| (0..20).all(|r| image.at(c, r) == whole.at(c, r))));
    image.depth.fill(0.0);
    image.crop();
    assert_eq!(image, DepthImage::default());
}
