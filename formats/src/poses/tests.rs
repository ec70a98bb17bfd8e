use super::*;
use nalgebra::Point3;

/// sin and cos of 45 degrees: a quarter turn about z takes x to y, and back takes x to -y.
const H: &str = "0.7071067811865476";

fn read(text: &str) -> PoseFile {
    parse_poses("poses".as_ref(), text.as_bytes()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn refused(text: &str) -> String {
    parse_poses("poses".as_ref(), text.as_bytes()).expect_err(text).to_string()
}

/// Every pose takes (1, 0, 0) of the camera to `expected` of the world.
fn takes(text: &str, expected: [f64; 3], count: usize) -> PoseFile {
    let file = read(text);
    assert_eq!(file.poses.len(), count, "{text}");
    for pose in &file.poses {
        let found = pose.world_from_camera * Point3::new(1.0, 0.0, 0.0);
        assert!((found - Point3::from(expected)).norm() < 1e-9, "{found} instead of {expected:?}: {text}");
    }
    file
}

/// The quarter turn and (1, 2, 3): (1, 0, 0) becomes (0, 1, 0) and then (1, 3, 3).
const FORWARD: [f64; 3] = [1.0, 3.0, 3.0];
/// Of its inverse: (1, 0, 0) less (1, 2, 3) is (0, -2, -3), turned back (-2, 0, -3).
const INVERSE: [f64; 3] = [-2.0, 0.0, -3.0];

#[test]
fn rows_and_lines_are_world_from_camera() {
    takes("0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n", FORWARD, 1);
    let relative = "\u{feff}# saved by hand\r\n\r\n0,-1,0,1 # first row\r\n1;0;0;2\r\n 0\t0 1 3\r\n0 0 0 1\r\n\r\n";
    takes(&format!("{relative}{}", &relative[3..]), FORWARD, 2);
    takes(&format!("12.5 1 2 3 0 0 {H} {H}\n"), FORWARD, 1);
    takes(
        &format!("# time x y z qx qy qz qw\r\n\r\n1e9 1 2 3 0 0 {H} {H}\r\n2e9, 1, 2, 3, 0, 0, {H}, {H}"),
        FORWARD,
        2,
    );
    let log = "0 0 1\n0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n";
    takes(log, FORWARD, 1);
    let file = takes(&format!("# log\r\n{}\r\n{}", log, log.replace("0 0 1\n0 -1", "7 7 8\n0 -1")), FORWARD, 2);
    assert_eq!(file.poses[1].name.as_deref(), Some("7"));
}

#[test]
fn one_matrix_per_line_is_world_from_camera() {
    let kitti = "0 -1 0 1 1 0 0 2 0 0 1 3\n";
    takes(kitti, FORWARD, 1);
    takes(&format!("# poses\r\n{kitti}\r\n{}", kitti.replace(' ', ", ")), FORWARD, 2);
    takes("0 -1 0 1 1 0 0 2 0 0 1 3 0 0 0 1\n", FORWARD, 1);
    for (text, said) in [
        ("0 1 0 0 -1 0 0 0 0 0 1 0 1 2 3 1\n", "line 1: found world_from_camera: the last row must be 0 0 0 1"),
        ("0 -1 0 1 1 0 0 2 0 0 2 3\n", "line 1: found world_from_camera is not a rigid motion"),
        ("1 0 0 1 0 1 0 2 0 0 1 3 4\n", "line 1: found 13 numbers"),
        ("1 0 0 1\n1 0 0 0 0 1 0 0 0 0 1 0\n", "line 2: found 12 numbers"),
        ("1 1 2 3 0 0 0 1 4 7\n", "line 1: found 10 numbers"),
    ] {
        assert!(refused(text).contains(said), "{said:?} not in: {}", refused(text));
    }
}

#[test]
fn names_above_a_table_say_its_order_and_unit() {
    let euroc = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []";
    let moving =
        ", v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_a_RS_S_x [m s^-2]";
    let (w_first, w_last) = (format!("1,2,3,{H},0,0,{H}"), format!("1,2,3,0,0,{H},{H}"));
    takes(&format!("{euroc}\r\n1403636580838555648,{w_first}\r\n"), FORWARD, 1);
    takes(&format!("{euroc}{moving}\n7,{w_first},9,9,9,9,9\n8,{w_first},9,9,9,9,9\n"), FORWARD, 2);
    for (names, row) in [
        ("# timestamp tx ty tz qw qx qy qz", format!("7,{w_first}")),
        ("timestamp,tx,ty,tz,qw,qx,qy,qz", format!("7,{w_first}")),
        (
            "% time;position.x;position.y;position.z;orientation.w;orientation.x;orientation.y;orientation.z",
            format!("7,{w_first}"),
        ),
        ("# tx ty tz qw qx qy qz", format!("7,{w_first}")),
        ("# tx ty tz qw qx qy qz", w_first.clone()),
        ("# time tx ty tz qw qx qy qz\n# 1 pose", format!("7,{w_first}")),
        ("# format: time tx ty tz qw qx qy qz (of the camera)", format!("7,{w_first}")),
        ("# frame x y z [mm] qx qy qz qw", format!("7,1000,2000,3000,0,0,{H},{H}")),
        ("# time qx qy qz qw x y z", format!("7,0,0,{H},{H},1,2,3")),
        ("# time tx ty tz x y z w", format!("7,{w_last}")),
        ("# time x y z qx qy qz qw", format!("7,{w_last}")),
        ("# the poses of the camera, by hand", format!("7,{w_last}")),
        ("# frame x[mm] y[mm] z[mm] qx qy qz qw", format!("7,1000,2000,3000,0,0,{H},{H}")),
        ("# frame, x_cm, y_cm, z_cm, qx, qy, qz, qw", format!("7,100,200,300,0,0,{H},{H}")),
    ] {
        takes(&format!("{names}\n{row}\n"), FORWARD, 1);
    }
    let contradicts = "line 2: found names in line 1: ";
    for (names, said) in [
        ("# time x y z roll pitch yaw id", "x, y, z, but no qx, qy, qz, qw, are named"),
        ("# time lat lon alt qw qx qy qz", "qx, qy, qz, qw, but no x, y, z, are named"),
        ("# time x[mm] y[mm] z[m] qx qy qz qw", "different units of x, y and z"),
        ("# time x[px] y[px] z[px] qx qy qz qw", "the unit \"px\", which is not known"),
    ] {
        let message = refused(&format!("{names}\n7,{w_last}\n"));
        assert!(message.contains(&format!("{contradicts}{said}")), "{message}");
    }
    let many = refused(&format!("# time x vx y vy z vz qx qy qz qw\n7,{w_last}\n"));
    assert!(many.contains("line 2: found 8 numbers under 11 names in line 1"), "{many}");
}

#[test]
fn a_conf_turns_the_other_way_and_shifts_as_written() {
    // Back by a quarter, (1, 0, 0) becomes (0, -1, 0), and (1, 1, 3) with the translation.
    let expected = [1.0, 1.0, 3.0];
    let file = takes(&format!("bmesh a.ply 1 2 3 0 0 {H} {H}\n"), expected, 1);
    assert!(file.of_scans && file.poses[0].name.as_deref() == Some("a.ply"));
    let viewer = "camera -0.0172 -0.0936 -0.734  -0.0461723 0.970603 -0.235889 0.0124573";
    takes(&format!("{viewer}\r\n\r\nbmesh a.ply  1 2 3 0 0 {H} {H} \r\nmesh b.ply 1 2 3 0 0 {H} {H}"), expected, 2);
}

#[test]
fn colmap_is_camera_from_world() {
    takes(&format!("1 {H} 0 0 {H} 1 2 3 1 a.png\n\n"), INVERSE, 1);
    let points = "# Image list\r\n#   IMAGE_ID, QW, ...\r\n\r\n";
    let two = format!(
        "{points}3 {H} 0 0 {H} 1 2 3 1 left eye.png\r\n10.5 20.5 -1 30.5 40.5 7\r\n4 {H} 0 0 {H} 1 2 3 1 0004\r\n\r\n5 {H} 0 0 {H} \
         1 2 3 1 c.png\r\n6 {H} 0 0 {H} 1 2 3 1 d.png\r\n"
    );
    let file = takes(&two, INVERSE, 4);
    let names: Vec<_> = file.poses.iter().filter_map(|p| p.name.as_deref()).collect();
    assert_eq!(names, ["left eye.png", "0004", "c.png", "d.png"]);
}

#[test]
fn bop_is_camera_from_world_in_millimetres() {
    let r = "[0, -1, 0, 1, 0, 0, 0, 0, 1]";
    let camera = format!(
        "\"cam_K\": [500, 0, 320, 0, 510, 240, 0, 0, 1], \"depth_scale\": 0.1, \"cam_R_w2c\": {r}, \
                          \"cam_t_w2c\": [1000, 2000, 3000]"
    );
    let file = takes(&format!("{{\"10\": {{{camera}}},\r\n \"9\": {{{camera}, \"extra\": null}}}}"), INVERSE, 2);
    assert_eq!(file.poses[0].intrinsics, Some([500.0, 510.0, 320.0, 240.0]));
    assert_eq!(file.poses[0].name.as_deref(), Some("9"), "by number, not as text");
    assert_eq!(file.poses[0].metres_per_unit, Some(0.001 * 0.1));
    let scale = |scale: &str| format!("{{\"1\": {{{}}}}}", camera.replace("\"depth_scale\": 0.1, ", scale));
    assert_eq!(read(&scale("")).poses[0].metres_per_unit, None);
    assert!(refused(&scale("\"depth_scale\": 0, ")).contains("image 1: found a depth_scale of 0"));
    let truth = format!("{{\"cam_R_m2c\": {r}, \"cam_t_m2c\": [1000, 2000, 3000], \"obj_id\": 4}}");
    takes(&format!("{{\"0\": [{truth}]}}"), INVERSE, 1);
    takes(&format!("\n{{ \"3\": [{truth}], \"000004\": [{truth}] }}\r\n"), INVERSE, 2);
    assert!(refused(&format!("{{\"0\": [{truth}, {truth}]}}")).contains("image 0: found 2 objects"));
    let without = "{\"0\": {\"cam_K\": [500, 0, 320, 0, 510, 240, 0, 0, 1], \"depth_scale\": 1.0}}";
    assert!(refused(without).contains("scene_gt.json"));
}

#[test]
fn open3d_is_camera_from_world_by_columns() {
    let camera = "{\"class_name\": \"PinholeCameraParameters\", \"extrinsic\": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1], \
                  \"intrinsic\": {\"height\": 480, \"width\": 640, \"intrinsic_matrix\": [500, 0, 0, 0, 510, 0, 320, 240, 1]}, \
                  \"version_major\": 1}";
    let file = takes(camera, INVERSE, 1);
    assert_eq!(file.poses[0].intrinsics, Some([500.0, 510.0, 320.0, 240.0]));
    assert_eq!(file.poses[0].size, Some([640, 480]));
    let unknown = camera.replace("640", "-1").replace("480", "-1");
    assert_eq!(read(&unknown).poses[0].size, None);
    let bare = "{\"extrinsic\": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]}";
    takes(
        &format!("{{\"class_name\": \"PinholeCameraTrajectory\",\r\n\"parameters\": [{camera}, {bare}]}}"),
        INVERSE,
        2,
    );
}

#[test]
fn a_camera_matrix_with_the_poses_is_checked_like_that_of_a_calibration() {
    let open3d = |k: &str| {
        let extrinsic = "[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]";
        format!("{{\"parameters\": [{{\"extrinsic\": {extrinsic}, \"intrinsic\": {{\"intrinsic_matrix\": {k}}}}}]}}")
    };
    let bop = |k: &str| {
        format!("{{\"3\": {{\"cam_K\": {k}, \"cam_R_w2c\": [1, 0, 0, 0, 1, 0, 0, 0, 1], \"cam_t_w2c\": [0, 0, 0]}}}}")
    };
    let by_rows = "[500, 0, 320, 0, 510, 240, 0, 0, 1]";
    let by_columns = "[500, 0, 0, 0, 510, 0, 320, 240, 1]";
    let expected = Some([500.0, 510.0, 320.0, 240.0]);
    assert_eq!(read(&open3d(by_columns)).poses[0].intrinsics, expected);
    assert_eq!(read(&bop(by_rows)).poses[0].intrinsics, expected);
    assert_eq!(read(&open3d("[0, 0, 0, 0, 0, 0, 0, 0, 0]")).poses[0].intrinsics, None, "not known to Open3D");
    let own = "{\"world_from_camera\": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], \"intrinsics\": [0, 0, 8, 6]}";
    for (text, said) in [
        (open3d(by_rows), "parameters 0: found camera matrix [500.0, 0.0, 0.0, 0.0, 510.0, 0.0, 320.0, 240.0, 1.0]"),
        (bop(by_columns), "image 3: found camera matrix [500.0, 0.0, 0.0, 0.0, 510.0, 0.0, 320.0, 240.0, 1.0]"),
        (bop(&by_rows.replace("500, 0", "500, 9")), "image 3: found a skew of 9, expected no skew"),
        (open3d(&by_columns.replace("510", "-510")), "found fx, fy, cx, cy = [500.0, -510.0, 320.0, 240.0]"),
        (bop(&by_rows.replace("500", "0")), "found fx, fy, cx, cy = [0.0, 510.0, 320.0, 240.0]"),
        (own.to_owned(), "found fx, fy, cx, cy = [0.0, 0.0, 8.0, 6.0], expected fx, fy, cx, cy in pixels: finite"),
    ] {
        assert!(refused(&text).contains(said), "{said:?} not in: {}", refused(&text));
    }
}

#[test]
fn our_json_is_world_from_camera() {
    let m = "[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]";
    takes(m, FORWARD, 1);
    takes(&format!("[{m}, {{\"world_from_camera\": {m}}}]"), FORWARD, 2);
    let file = takes(
        &format!("{{\r\n\"world_from_camera\": {m}, \"intrinsics\": [1, 2, 3, 4], \"name\": \"a\"}}"),
        FORWARD,
        1,
    );
    assert_eq!((file.poses[0].intrinsics, file.poses[0].name.as_deref()), (Some([1.0, 2.0, 3.0, 4.0]), Some("a")));
}

#[test]
fn what_is_none_is_refused_with_its_line() {
    let matrix = "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n";
    for (text, said) in [
        ("1 2 3\n4 5 6\n", "line 2: found 3 numbers"),
        ("# nothing\n\n", "found no pose"),
        ("\n\na b c d\n", "line 3: found a b c d"),
        ("1 0 0 1\n0 1 0 2\n", "line 2: the file ends here, expected 4 rows of a matrix, found 2"),
        ("0 0 1\n", "found 0"),
        (&format!("{matrix}0 0 1\n{matrix}"), "line 9: found a matrix unlike those before it"),
        (&matrix.replace("0 0 1 3", "0 0 -1 3"), "line 4: found world_from_camera is not a rigid motion"),
        (&matrix.replace("0 0 0 1", "1 2 3 1"), "line 4: found world_from_camera: the last row must be 0 0 0 1"),
        ("1 1 2 3 0 0 0 2\n", "line 1: found a quaternion of length 2"),
        ("bmesh a.ply 1 2 3 0 0 0\n", "line 1: found 6 numbers after a.ply"),
        ("bmesh a.ply 1 2 3 0 0 0 1\nbmash b.ply 1 2 3 0 0 0 1\n", "line 2: found bmash"),
        ("1 1 0 0 0 1 2 3 1 a.png\n\n2 1 0 0 0 1 2 3\n", "line 3: found 2 1 0 0 0 1 2 3, expected IMAGE_ID QW"),
        ("1 0 0 0 0 1 2 3 1 a.png\n", "line 1: found a quaternion of length 0"),
        ("{\"a\": 1}", "key \"a\": found no number of an image"),
        ("[[[1, 0]]]", "pose 0: found"),
        ("{\n\"parameters\": [\n}", "line 3"),
        ("{\"parameters\": [{\"extrinsic\": [1, 2]}]}", "parameters 0: found"),
        ("{\"world_from_camera\": [[1]], \"x\": 1}", "expected a 4 x 4 matrix"),
    ] {
        let message = refused(text);
        assert!(message.starts_with("\"poses\"") && message.contains(said), "{said:?} not in: {message}");
    }
    assert!(
        parse_poses("poses".as_ref(), b"1 2 \xff").expect_err("no number").to_string().contains("line 1: found 1 2")
    );
}

#[test]
fn a_key_given_twice_is_no_pose() {
    let rows = "[[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]";
    let twice = format!("{{\"world_from_camera\": {rows},\n\"world_from_camera\": {rows}}}");
    let error = parse_poses(Path::new("a.json"), twice.as_bytes()).expect_err("which?").to_string();
    assert!(error.contains("line 2: found key \"world_from_camera\" a second time"), "{error}");
}

#[test]
fn what_is_expected_is_what_the_format_has() {
    let by_rows = refused("{\"extrinsic\": [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1]}");
    let said = "found extrinsic: the last row must be 0 0 0 1, expected a rigid motion, camera_from_world, 4 x 4, column by column";
    assert!(by_rows.contains(said) && !by_rows.contains("row by row"), "{by_rows}");
    let double = "[2, 0, 0, 0, 2, 0, 0, 0, 2]";
    let camera = refused(&format!("{{\"7\": {{\"cam_R_w2c\": {double}, \"cam_t_w2c\": [0, 0, 900]}}}}"));
    let truth = refused(&format!("{{\"7\": [{{\"cam_R_m2c\": {double}, \"cam_t_m2c\": [0, 0, 900]}}]}}"));
    for (error, r, t) in [(camera, "cam_R_w2c", "cam_t_w2c"), (truth, "cam_R_m2c", "cam_t_m2c")] {
        assert!(error.contains(&format!("image 7: found {r} is not a rigid motion")), "{error}");
        assert!(
            error.contains("expected a rotation, 3 x 3") && error.contains(&format!("{t} in millimetres")),
            "{error}"
        );
    }
    assert!(
        refused("[[[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]]").contains("4 x 4, row by row, metres")
    );
}

#[test]
fn text_of_any_system_is_read() {
    let expected = read("0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n");
    let text = "# by hand\n0 -1 0 1.D0\n1 0 0 .2D+01\n0 0 1 3.\n0 0 0 1\n";
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(text.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let latin = [b"# f\xfcr alle\n", text.as_bytes()].concat();
    for bytes in [wide, latin, text.replace('\n', "\r").into_bytes()] {
        assert_eq!(parse_poses("poses".as_ref(), &bytes).expect("poses"), expected, "{bytes:?}");
    }
    let colmap = read("# Image list\r1 1 0 0 0 1.0D+00 2 3 1 a.png\r\r2 1 0 0 0 1 2 3 1 b.png\r10.5 20.5 -1\r");
    let names: Vec<_> = colmap.poses.iter().filter_map(|p| p.name.as_deref()).collect();
    assert_eq!((names, colmap.poses[0].world_from_camera.translation.x), (vec!["a.png", "b.png"], -1.0));
    let json = "\u{feff}[[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]";
    let swapped: Vec<u8> = json.encode_utf16().flat_map(u16::to_be_bytes).collect();
    assert_eq!(parse_poses("poses".as_ref(), &swapped).expect("a pose"), expected);
}
