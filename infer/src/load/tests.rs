use super::*;
use formats::cloud::Grid;
use geometry::{DepthImage, PointCloud};

fn organised(camera: &PinholeCamera, pose: &Isometry3<f64>) -> CloudFile {
    let mut file = CloudFile::default();
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut pixels = Vec::new();
    for i in (0..width * height).filter(|i| i % 7 != 0) {
        let (column, row) = ((i % width) as f64, (i / width) as f64);
        let z = 1.0 + 0.2 * (column * 0.1).sin() + 0.001 * row;
        file.cloud.points.push(pose * camera.unproject(column, row, z));
        pixels.push(i as u32);
    }
    file.grid = Some(Grid { width, height, pixels });
    file
}

#[test]
fn an_organised_cloud_is_a_depth_image() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let pose = Isometry3::new(nalgebra::Vector3::new(1.0, 2.0, 3.0), nalgebra::Vector3::new(0.3, 0.2, 0.1));
    let moved = CloudFile { viewpoint: Some(pose), ..organised(&camera, &pose) };
    for (file, expected) in [(organised(&camera, &Isometry3::identity()), Isometry3::identity()), (moved, pose)] {
        let points = file.cloud.points.clone();
        let loaded = from_cloud_file(file, None);
        assert_eq!(loaded.reading.notes, Vec::<String>::new());
        let Scan::Depth { camera: found, depth, world_from_camera, misses } = loaded.scan else {
            panic!("a depth image was expected");
        };
        assert!((found.fx - 55.0).abs() < 1e-6 && (found.cy - 25.5).abs() < 1e-6, "{found:?}");
        assert_eq!((world_from_camera, misses), (expected, NoReturn::Unknown));
        let back = depth.to_points(&found, &world_from_camera);
        assert_eq!(back.len(), points.len());
        assert!(back.iter().zip(&points).all(|(a, b)| (a - b).norm() < 1e-5), "the points come back");
    }
}

#[test]
fn named_files_are_regular_and_keep_their_secrets() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("secret.xyz");
    std::fs::write(&path, "x y z\nhunter2 is the password").expect("a file");
    let read = |path: &Path| named_cloud(path, &named_bytes(path)?, None, None);
    let error = format!("{:#}", read(&path).expect_err("no cloud"));
    assert!(error.contains("secret.xyz") && !error.contains("hunter2"), "{error}");
    std::fs::write(&path, "1 2 3\n").expect("a file");
    assert!(read(&path).is_ok());
    for device in [Path::new("/dev/zero"), folder.path()] {
        let error = format!("{:#}", read(device).expect_err("no file"));
        assert!(error.contains("not a regular file"), "{error}");
    }
}

#[test]
fn a_cloud_of_another_geometry_stays_a_cloud() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let mut file = organised(&camera, &Isometry3::identity());
    file.cloud.points.iter_mut().for_each(|p| p.x += 0.3);
    assert!(
        matches!(from_cloud_file(file, Some(Unit::M)).scan, Scan::Cloud { from: None, .. }),
        "shifted: not from the origin"
    );
    let flat = PointCloud { points: vec![Point3::new(1.0, 2.0, 3.0)], normals: Vec::new() };
    let file = CloudFile { cloud: flat, ..Default::default() };
    let Scan::Cloud { cloud, .. } = from_cloud_file(file, Some(Unit::Mm)).scan else { panic!("a cloud was expected") };
    assert_eq!(cloud.points, vec![Point3::new(0.001, 0.002, 0.003)], "millimetres become metres");
}

#[test]
fn a_position_that_an_organised_cloud_contradicts_is_said() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let file = || from_cloud_file(organised(&camera, &Isometry3::identity()), Some(Unit::Mm));
    let notes = |from| file().seen_from(Some(Origin::Point(from)), Some(Unit::Mm)).reading.notes;
    assert!(notes([1000.0, 2.0, 3.0])[0].contains("camera at (0.000, 0.000, 0.000)"));
    assert!(notes([0.0, 0.5, 0.0]).is_empty() && file().seen_from(None, None).reading.notes.is_empty());
    let cloud = CloudFile { grid: None, ..organised(&camera, &Isometry3::identity()) };
    let Loaded { scan, reading } =
        from_cloud_file(cloud, Some(Unit::Mm)).seen_from(Some(Origin::Point([1000.0, 0.0, 0.0])), Some(Unit::Mm));
    assert_eq!((scan.camera_position(), reading.notes.len()), (Some(Point3::new(1.0, 0.0, 0.0)), 0));
    let moved = |given: Option<[f64; 3]>| {
        let viewpoint = Some(Isometry3::translation(0.0, 0.0, 2.0));
        let loaded =
            from_cloud_file(CloudFile { grid: None, viewpoint, ..organised(&camera, &Isometry3::identity()) }, None);
        loaded.seen_from(given.map(Origin::Point), None)
    };
    assert_eq!(moved(Some([0.0, 0.0, 2.0])).reading.notes.len() + moved(None).reading.notes.len(), 0);
    let Loaded { scan, reading } = moved(Some([1.0, 0.0, 2.0]));
    assert_eq!(scan.camera_position(), Some(Point3::new(1.0, 0.0, 2.0)));
    assert!(reading.notes[0].contains("its camera at (0.000, 0.000, 2.000) m"), "{:?}", reading.notes);
}

#[test]
fn pixels_at_the_sensor_are_misses() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let pose = Isometry3::translation(1.0, 2.0, 3.0);
    let mut file = CloudFile { viewpoint: Some(pose), ..organised(&camera, &pose) };
    file.cloud.points[..99].fill(Point3::new(1.0, 2.0, 3.0));
    let Loaded { scan, reading } = from_cloud_file(file, None);
    let Scan::Depth { depth, .. } = scan else { panic!("a depth image was expected") };
    assert_eq!(depth.depth.iter().filter(|&&z| z > 0.0).count(), 64 * 48 - (64 * 48usize).div_ceil(7) - 99);
    assert!(reading.notes[0].contains("99 points at the sensor's position"), "{:?}", reading.notes);
}

#[test]
fn the_unit_asked_for_holds_else_the_one_named() {
    let file = |unit| {
        let cloud = PointCloud { points: vec![Point3::new(1.0, 2.0, 3.0)], normals: Vec::new() };
        from_cloud_file(CloudFile { cloud, metres_per_unit: Some(0.01), ..Default::default() }, unit)
    };
    for (unit, x, said) in [(None, 0.01, "as its columns say"), (Some(Unit::M), 1.0, "as requested (--unit)")] {
        let Loaded { scan: Scan::Cloud { cloud, .. }, reading } = file(unit) else { panic!("a cloud was expected") };
        assert_eq!((cloud.points[0].x, reading.metres_per_unit), (x, Some(x)));
        assert!(reading.notes[0].contains(said), "{:?}", reading.notes);
    }
    let camera = |unit| file(unit).seen_from(Some(Origin::Point([0.0, 0.0, 2.0])), unit).scan.camera_position();
    let metres = Some(Point3::new(0.0, 0.0, 2.0));
    assert_eq!((camera(None), camera(Some(Unit::M))), (metres, metres), "the columns' unit is not the camera's");
    assert_eq!(camera(Some(Unit::Mm)), Some(Point3::new(0.0, 0.0, 0.002)));
}

#[test]
fn a_principal_point_outside_is_said() {
    let notes = |size: [u32; 2], intrinsics| {
        let image = DepthImage { origin: [0, 0], size, depth: vec![0.0; (size[0] * size[1]) as usize] };
        let file = DepthFile { image, notes: Vec::new() };
        let camera = DepthCamera { intrinsics, lens: Lens::Pinhole, size: None, metres_per_unit: None };
        from_depth_file(file, &camera, Isometry3::identity(), NoReturn::Unknown).map(|loaded| loaded.reading.notes)
    };
    assert!(notes([32, 24], [600.0, 600.0, 640.0, 360.0]).expect("read")[0].contains("is outside"));
    assert!(notes([64, 48], [60.0, 60.0, 16.0, 12.0]).expect("read")[0].contains("far from the middle"));
    assert!(notes([128, 72], [30.0, 30.0, 32.0, 24.0]).expect("read")[0].contains("far from the middle"), "of 4 : 3");
    assert!(notes([32, 24], [30.0, 30.0, 16.0, 12.0]).expect("read").is_empty());
    assert!(notes([32, 24], [30.0, 30.0, 12.0, 16.0]).expect("read").is_empty(), "cut out of a larger one");
    assert!(notes([32, 24], [30.0, 0.0, 16.0, 12.0]).is_err() && notes([32, 24], [30.0, 30.0, f64::NAN, 1.0]).is_err());
    assert!(depth_bytes("a.png", b"", Some(0.0)).expect_err("no unit").to_string().contains("metres_per_unit"));
}

#[test]
fn one_pose_of_several_is_asked_for_by_name_or_number() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("poses.log");
    let matrix = |z: i32| format!("1 0 0 0\n0 1 0 0\n0 0 1 {z}\n0 0 0 1\n");
    std::fs::write(&path, format!("5 5 6\n{}6 6 7\n{}", matrix(3), matrix(4))).expect("written");
    let at =
        |suffix: &str| read_pose("--pose", &format!("{}{suffix}", path.display())).map(|(pose, _)| pose.translation.z);
    assert_eq!((at(":5").ok(), at(":6").ok(), at(":06").ok()), (Some(3.0), Some(4.0), Some(4.0)));
    let several = format!("{:#}", at("").expect_err("which?"));
    assert!(several.contains("found 2 poses") && several.contains("such as ") && several.contains("poses.log:5"));
    for none in [":0", ":1", ":9"] {
        assert!(format!("{:#}", at(none).expect_err("none")).contains("no such pose among the 2"), "{none}");
    }
    assert_eq!(poses(&path).expect("both").len(), 2);
    std::fs::write(&path, format!("{}{}", matrix(3), matrix(4))).expect("written");
    assert_eq!((at(":0").ok(), at(":1").ok()), (Some(3.0), Some(4.0)), "without names they are counted");
    let several = format!("{:#}", at("").expect_err("which?"));
    assert!(several.contains("poses.log:0 to 1"), "{several}");
    let conf = dir.path().join("bun.conf");
    std::fs::write(&conf, "bmesh a.ply 0 0 0 0 0 0 1\n").expect("written");
    assert!(poses(&conf).expect_err("scans").to_string().contains("poses of range images"));
}

#[test]
fn a_cloud_takes_the_position_of_its_pose_and_lies_ahead() {
    let dir = tempfile::tempdir().expect("a folder");
    let (cloud, pose) = (dir.path().join("a.xyz"), dir.path().join("pose.txt"));
    std::fs::write(&cloud, "0 0 1\n0.1 0 1\n0 0.1 1\n0 0 -1\n").expect("written");
    let rows = |z: i32| format!("1 0 0 0.5\n0 1 0 0\n0 0 1 {z}\n0 0 0 1\n");
    std::fs::write(&pose, rows(0)).expect("written");
    let text = pose.display().to_string();
    let loaded = cloud_from(&cloud, None, &text).expect("ahead");
    assert_eq!(loaded.scan.camera_position(), Some(Point3::new(0.5, 0.0, 0.0)));
    std::fs::write(&pose, rows(2)).expect("written");
    let error = cloud_from(&cloud, None, &text).expect_err("behind").to_string();
    assert!(error.contains("0 % of the points") && error.contains("the inverse"), "{error}");
}

#[test]
fn a_pose_is_asked_for_by_the_name_of_its_image() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("scene_camera.json");
    let of = |key: &str, mm: u32| {
        format!("\"{key}\": {{\"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, 1], \"cam_t_w2c\": [0, 0, -{mm}]}}")
    };
    std::fs::write(&path, format!("{{{}, {}}}", of("1", 3000), of("2", 4000))).expect("written");
    let at =
        |wanted: &str| read_pose("--pose", &format!("{}:{wanted}", path.display())).map(|(pose, _)| pose.translation.z);
    for (wanted, z) in [("1", 3.0), ("000001", 3.0), ("000001.png", 3.0), ("depth/000002.png", 4.0)] {
        assert!((at(wanted).expect(wanted) - z).abs() < 1e-9, "{wanted}");
    }
    let error = format!("{:#}", at("0").expect_err("no image is called so"));
    assert!(error.contains("scene_camera.json:NAME, such as"), "{error}");
}

/// A wall at 1 m through a lens, as a file of 64 x 48 pixels, and the calibration of that lens.
fn distorted(folder: &Path) -> (std::path::PathBuf, String) {
    let camera = PinholeCamera { width: 64, height: 48, fx: 50.0, fy: 50.0, cx: 31.5, cy: 23.5 };
    let lens = Lens::named("plumb_bob", &[-0.28, 0.11, 0.001, -0.001, -0.02]).expect("a lens");
    let mut depth = Vec::new();
    for row in 0..48 {
        for column in 0..64 {
            let at = camera.unproject(f64::from(column), f64::from(row), 1.0);
            let ray = lens.undistort(at.coords.xy()).expect("in the model");
            // The wall leans: z = 1 + x / 2.
            depth.push((1.0 / (1.0 - 0.5 * ray.x)) as f32);
        }
    }
    let image = folder.join("d.png");
    let seen = DepthImage { origin: [0, 0], size: [64, 48], depth };
    formats::depth::write_depth(&image, &seen, 64, 48, 1e-4).expect("an image");
    let file = folder.join("camera.yaml");
    let text = "image_width: 64\nimage_height: 48\ncamera_matrix: {rows: 3, cols: 3, data: [50, 0, 31.5, 0, 50, 23.5, 0, 0, 1]}\n\
                distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.11, 0.001, -0.001, -0.02]}\n";
    std::fs::write(&file, text).expect("a calibration");
    (image, file.display().to_string())
}

#[test]
fn a_calibrated_lens_is_undone_on_reading() {
    let folder = tempfile::tempdir().expect("a folder");
    let (image, file) = distorted(folder.path());
    let camera = DepthCamera::from(formats::camera::read_camera(&file).expect("a calibration"));
    let off = |camera: DepthCamera| {
        let loaded = depth(&image, Some(1e-4), "0,0,0,0,0,0,1", Some(GivenCamera::File(camera)), NoReturn::Unknown)
            .expect("an image");
        let Scan::Depth { camera, depth, .. } = loaded.scan else { panic!("a depth image") };
        let points = depth.to_points(&camera, &Isometry3::identity());
        assert!(points.len() > 2_500);
        points.iter().map(|p| (p.z - 1.0 - 0.5 * p.x).abs()).fold(0.0, f64::max)
    };
    let (undone, ignored) = (off(camera), off(DepthCamera { lens: Lens::Pinhole, ..camera }));
    assert!(undone < 5e-4 && ignored > 0.02, "{undone} m off the wall, {ignored} m with the lens ignored");
    let other = Some(GivenCamera::File(DepthCamera { size: Some([128, 96]), ..camera }));
    let error = format!("{:#}", depth(&image, None, "0,0,0,0,0,0,1", other, NoReturn::Unknown).expect_err("a size"));
    assert!(error.contains("d.png\": 64 x 48 pixels, but the camera was calibrated for 128 x 96"), "{error}");
}

#[test]
fn a_path_makes_a_line_scanners_scan_of_a_cloud() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let cloud = CloudFile { grid: None, ..organised(&camera, &Isometry3::identity()) };
    let points = cloud.cloud.len();
    let origin = Origin::parse("0,0,500..100,0,500").expect("a path");
    match from_cloud_file(cloud, Some(Unit::Mm)).seen_from(Some(origin), Some(Unit::Mm)).scan {
        Scan::Lines { cloud, path } => {
            assert_eq!((cloud.len(), path), (points, [Point3::new(0.0, 0.0, 0.5), Point3::new(0.1, 0.0, 0.5)]));
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(Origin::parse("1,2,3"), Ok(Origin::Point([1.0, 2.0, 3.0])));
    for (text, why) in
        [("1,2,3..1,2,3", "two different points"), ("1,2..3,4,5", "2 numbers"), ("1,2,x", "not a number")]
    {
        assert!(Origin::parse(text).expect_err(text).contains(why), "{text}");
    }
}

#[test]
fn an_organised_cloud_in_its_sensors_frame_is_placed_by_the_pose_of_its_file_or_the_one_given() {
    let camera = PinholeCamera { width: 64, height: 48, fx: 55.0, fy: 50.0, cx: 30.0, cy: 25.5 };
    let posed = |x: f64| Isometry3::new(nalgebra::Vector3::new(x, 2.0, 3.0), nalgebra::Vector3::new(0.3, 0.2, 0.1));
    let pose_of = |loaded: &Loaded| match &loaded.scan {
        Scan::Depth { world_from_camera, .. } => *world_from_camera,
        other => panic!("{other:?}"),
    };
    let own = |viewpoint| CloudFile { viewpoint, ..organised(&camera, &Isometry3::identity()) };
    let loaded = from_cloud_file(own(Some(posed(1.0))), None);
    assert_eq!(pose_of(&loaded), posed(1.0));
    assert!(loaded.reading.notes[0].contains("VIEWPOINT was taken for the pose"), "{:?}", loaded.reading.notes);

    for (viewpoint, notes) in [(None, 0), (Some(posed(1.0)), 0), (Some(posed(1.5)), 1)] {
        let loaded = placed(own(viewpoint), None, &posed(1.0)).expect("placed");
        assert_eq!((pose_of(&loaded), loaded.reading.notes.len()), (posed(1.0), notes), "{:?}", loaded.reading.notes);
    }
    let both = placed(own(Some(posed(1.5))), None, &posed(1.0)).expect("placed").reading.notes;
    assert!(both[0].contains("at (1.500, 2.000, 3.000) m (VIEWPOINT): the pose given was used instead"), "{both:?}");

    let moved = || CloudFile { viewpoint: Some(posed(1.0)), ..organised(&camera, &posed(1.0)) };
    let same = placed(moved(), None, &posed(1.0)).expect("the same pose twice");
    assert_eq!((pose_of(&same), same.reading.notes.len()), (posed(1.0), 0));
    let error = placed(moved(), None, &posed(1.5)).expect_err("points that are placed already");
    assert!(error.contains("VIEWPOINT, at (1.000, 2.000, 3.000) m: omit --pose"), "{error}");
}

#[test]
fn a_unit_that_is_not_known_is_asked_for() {
    let bytes = b"x [secret],y [secret],z [secret]\n1000,2000,3000\n";
    let error = cloud_bytes("a.csv", bytes, None, None).expect_err("which unit?").to_string();
    assert!(error.contains("a.csv\": the unit [secret] of its columns is not known: give --unit"), "{error}");
    let error = named_cloud(Path::new("a.csv"), bytes, None, None).expect_err("which unit?").to_string();
    assert!(error.contains("give the unit") && !error.contains("secret"), "{error}");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.csv");
    std::fs::write(&path, bytes).expect("written");
    assert!(cloud(&path, None, None).is_err() && cloud_from(&path, None, "0,0,0,0,0,0,1").is_err());
    let given = Some(Unit::Mm);
    for read in
        [cloud_bytes("a.csv", bytes, given, None), named_cloud(&path, bytes, given, None), cloud(&path, given, None)]
    {
        let Scan::Cloud { cloud, .. } = read.expect("in millimetres").scan else { panic!("a cloud") };
        assert_eq!(cloud.points[0], Point3::new(1.0, 2.0, 3.0));
    }
}

/// An image of 64 x 48 pixels, a metre away in steps of a tenth of a millimetre.
fn in_tenths(folder: &Path) -> std::path::PathBuf {
    let image = folder.join("d.png");
    let seen = DepthImage { origin: [0, 0], size: [64, 48], depth: vec![1.0; 64 * 48] };
    formats::depth::write_depth(&image, &seen, 64, 48, 1e-4).expect("an image");
    image
}

#[test]
fn the_unit_that_a_file_of_cameras_says_counts_unless_one_is_given() {
    let folder = tempfile::tempdir().expect("a folder");
    let image = in_tenths(folder.path());
    let file = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        path.display().to_string()
    };
    let rotation = "\"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, 1], \"cam_t_w2c\": [0, 0, 0]";
    let k = "\"cam_K\": [50, 0, 31.5, 0, 50, 23.5, 0, 0, 1]";
    let scene = file("scene.json", &format!("{{\"0\": {{{k}, \"depth_scale\": 0.1, {rotation}}}}}"));
    let all =
        "{\"cx\": 31.5, \"cy\": 23.5, \"depth_scale\": 0.1, \"fx\": 50, \"fy\": 50, \"height\": 48, \"width\": 64}";
    let all = DepthCamera::from(formats::camera::read_camera(&file("camera.json", all)).expect("BOP's"));
    let read = |unit, pose: &str, camera: Option<DepthCamera>| {
        let Loaded { scan, reading } =
            depth(&image, unit, pose, camera.map(GivenCamera::File), NoReturn::Unknown).expect("an image");
        let Scan::Depth { depth, .. } = scan else { panic!("a depth image") };
        (depth.depth[0], reading.notes)
    };
    for (pose, camera) in [(&scene[..], None), ("0,0,0,0,0,0,1", Some(all))] {
        let (z, notes) = read(None, pose, camera);
        assert_eq!(z, 1.0, "{pose}");
        assert!(notes[0].contains("read in units of 0.0001 m"), "{notes:?}");
        let (z, notes) = read(Some(0.001), pose, camera);
        assert_eq!(z, 10.0, "{pose}");
        assert!(notes[0].contains("read in units of 0.001 m as --depth-unit says"), "{notes:?}");
    }
    // The image's own file counts before that of the camera.
    let other = DepthCamera { metres_per_unit: Some(0.5), ..all };
    assert_eq!(read(None, &scene, Some(other)).0, 1.0);
}

#[test]
fn intrinsics_of_a_pose_file_are_of_the_size_that_it_says() {
    let folder = tempfile::tempdir().expect("a folder");
    let image = in_tenths(folder.path());
    let pose = folder.path().join("pose.json");
    let read = |size: [u32; 2]| {
        let text = format!(
            "{{\"extrinsic\": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], \"intrinsic\": {{\"width\": {}, \"height\": {}, \
             \"intrinsic_matrix\": [50, 0, 0, 0, 50, 0, 31.5, 23.5, 1]}}}}",
            size[0], size[1]
        );
        std::fs::write(&pose, text).expect("written");
        depth(&image, Some(1e-4), &pose.display().to_string(), None, NoReturn::Unknown)
    };
    assert!(read([64, 48]).is_ok());
    let error = format!("{:#}", read([128, 96]).expect_err("of another size"));
    assert!(error.contains("64 x 48 pixels, but the camera was calibrated for 128 x 96"), "{error}");
}

#[test]
fn the_intrinsics_of_the_image_itself_count_unless_others_are_asked_for() {
    let folder = tempfile::tempdir().expect("a folder");
    let (image, file) = distorted(folder.path());
    let pose = folder.path().join("pose.json");
    let rows = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
    let text = format!("{{\"world_from_camera\": {rows}, \"intrinsics\": [60, 61, 30, 22]}}");
    std::fs::write(&pose, text).expect("written");
    let pose = pose.display().to_string();
    let calibrated = DepthCamera::from(formats::camera::read_camera(&file).expect("a calibration"));
    let camera_of = |given| placed_camera(&image, &pose, given).expect("a camera").1;
    let found = camera_of(Some(GivenCamera::File(calibrated)));
    assert_eq!((found.intrinsics, found.lens), ([60.0, 61.0, 30.0, 22.0], calibrated.lens));
    assert_eq!(camera_of(Some(GivenCamera::Intrinsics([50.0; 4]))).intrinsics, [50.0; 4], "as asked");
    let notes = |intrinsics| {
        let given = Some(GivenCamera::Intrinsics(intrinsics));
        let loaded = depth(&image, Some(1e-4), &pose, given, NoReturn::Unknown).expect("an image");
        loaded.reading.notes.into_iter().filter(|note| note.contains("--intrinsics")).collect::<Vec<_>>()
    };
    assert_eq!(notes([60.0, 61.0, 30.0, 22.0]), Vec::<String>::new());
    let said = notes([50.0, 50.0, 31.5, 23.5]);
    assert!(said.len() == 1 && said[0].contains("[60.0, 61.0, 30.0, 22.0]"), "{said:?}");
}
