use super::*;

const MILD: Lens = Lens::BrownConrady([0.0712, -0.1841, 0.0006, -0.0011, 0.0934, 0.0, 0.0, 0.0]);
const BARREL: Lens = Lens::BrownConrady([-0.2814, 0.1173, 0.0012, -0.0008, -0.0235, 0.0, 0.0, 0.0]);
const FISHEYE: Lens = Lens::Fisheye([-0.0071, 0.0432, -0.0411, 0.0077]);

#[test]
fn distortion_is_undone() {
    for lens in [Lens::Pinhole, MILD, BARREL, FISHEYE] {
        for i in 0..200 {
            let ray = Vector2::new(f64::from(i % 20) / 20.0 - 0.5, f64::from(i / 20) / 10.0 - 0.5);
            let back = lens.undistort(lens.distort(ray)).expect("within the model");
            assert!((back - ray).norm() < 1e-9, "{lens:?} {ray:?} {back:?}");
        }
    }
}

#[test]
fn where_a_model_turns_back_there_is_no_ray() {
    // r (1 - 0.5 r2) has its largest value, 0.544, at 0.816.
    let lens = Lens::BrownConrady([-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(lens.undistort(Vector2::new(0.54, 0.0)).is_some_and(|ray| (0.7..0.82).contains(&ray.x)));
    assert_eq!(lens.undistort(Vector2::new(0.56, 0.0)), None);
    assert_eq!(Lens::Fisheye([0.0; 4]).undistort(Vector2::new(1.6, 0.0)), None, "behind the camera");
}

#[test]
fn as_opencv_has_it() {
    let text = include_str!("../../../tests/data/lens.json");
    let file: serde_json::Value = serde_json::from_str(text).expect("JSON");
    let numbers = |v: &serde_json::Value| -> Vec<f64> {
        v.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number")).collect()
    };
    for case in file["cameras"].as_array().expect("a list") {
        let mut k = numbers(&case["coefficients"]);
        let lens = match case["model"].as_str() {
            Some("fisheye") => Lens::Fisheye(k.try_into().expect("four")),
            _ => {
                k.resize(8, 0.0);
                Lens::BrownConrady(k.try_into().expect("eight"))
            }
        };
        let [fx, fy, cx, cy] = numbers(&case["intrinsics"]).try_into().expect("four");
        let pairs =
            case["pixels"].as_array().expect("pixels").iter().zip(case["undistorted"].as_array().expect("rays"));
        let mut most: f64 = 0.0;
        for (pixel, ray) in pairs {
            let (pixel, ray) = (numbers(pixel), numbers(ray));
            let at = Vector2::new((pixel[0] - cx) / fx, (pixel[1] - cy) / fy);
            let found = lens.undistort(at).unwrap_or_else(|| panic!("{} {pixel:?}", case["name"]));
            let off = Vector2::new((found.x - ray[0]) * fx, (found.y - ray[1]) * fy).norm();
            let again = lens.distort(Vector2::new(ray[0], ray[1]));
            most = most.max(off).max(((again.x - at.x) * fx).hypot((again.y - at.y) * fy));
        }
        println!("{}: {most:.1e} px off OpenCV", case["name"]);
        assert!(most < 0.05, "{}: {most} px", case["name"]);
    }
}
