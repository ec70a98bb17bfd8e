use super::*;
use planning::reach::JointValue;
use planning::{Missing, PlannerName, Reached, Scan, Session, SessionConfig, TurntableConfig};

#[test]
fn a_hostile_title_stays_text_and_nothing_is_loaded() {
    let points = (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0)).collect();
    let config = SessionConfig { planner: PlannerName::Farthest, ..Default::default() };
    let mut session = Session::new(config, None).expect("defaults");
    let scan = Scan::Cloud {
        cloud: geometry::PointCloud { points, normals: Vec::new() },
        from: Some(Point3::new(0.0, 0.0, 1.0)),
    };
    session.add_scan(scan).expect("a scan");
    let mut answer = session.next_view().expect("an answer");
    let hostile = "</script><script>alert(1)</script>{{data}}\"'&";
    answer.warnings.push(hostile.to_owned());
    answer.candidates[1]
        .objections
        .push(planning::constraints::Objection { constraint: planning::Constraint::Floor, reason: hostile.to_owned() });
    let input = ReportInput { title: hostile, session: &session, coverage: &[0.3, 0.6] };
    let page = report_html(&answer, &input);
    assert!(!page.contains("<script>alert"), "the title must not become a script");
    assert_eq!(page.matches("<script").count(), 3, "the data, the viewer, the program");
    assert!(page.contains("&lt;script&gt;alert(1)"), "it is shown as text");
    assert!(!page.contains("http://") && !page.contains("https://"), "nothing is loaded from elsewhere");
    assert!(page.contains("<polyline"), "the coverage is drawn");
}

#[test]
fn what_a_robot_is_driven_by_is_told_in_the_cell_with_the_stop_and_the_joints() {
    let points = (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0)).collect();
    let cloud = geometry::PointCloud { points, normals: Vec::new() };
    let turntable = Some(TurntableConfig { stops_deg: vec![30.0], ..Default::default() });
    let config = SessionConfig { planner: PlannerName::Farthest, turntable, ..Default::default() };
    let mut session = Session::new(config, None).expect("settings in range");
    session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.06, 0.06, 1.0)) }).expect("a scan");
    let mut answer = session.next_view().expect("an answer");
    answer.missing = Some(Missing { share: 0.25, between: [0.2, 0.4], out_of_reach_share: 0.125, holes: Vec::new() });
    let next = answer.next.as_mut().expect("a view");
    let joints = vec![JointValue { name: "<elbow>".to_owned(), value: 0.5 }];
    next.reached = Some(Reached { joints, travel: 0.5 });
    let row = |pose: &Pose| pose.matrix[0].map(|x| format!("{x:10.6}")).join(" ");
    let (in_cell, turned) = (next.table.as_ref().expect("a stop"), row(&next.world_from_camera));
    let in_cell = row(&in_cell.cell_from_camera);
    assert_ne!(in_cell, turned, "a twelfth of a turn apart");
    let html = side(&answer, &[]);
    for told in ["turn the table to 30 degrees", "cell_from_camera", &in_cell, "&lt;elbow&gt; 0.5000"] {
        assert!(html.contains(told), "{told}: {html}");
    }
    assert!(!html.contains("world_from_camera") && !html.contains(&turned), "{html}");
    for (name, share) in [("missing", "25.0 %"), ("out of reach", "12.5 %")] {
        assert!(html.contains(&format!("<dt>{name}</dt><dd>{share}</dd>")), "{html}");
    }
    let data = page_data(&answer, &ReportInput { title: "a", session: &session, coverage: &[] });
    let first = &data["candidates"][0];
    assert_eq!((&first["stop"], &first["at"]), (&json!(30.0), &json!(answer.candidates[0].position_in_cell())));
}

#[test]
fn the_page_tells_which_scan_saw_a_point_first_and_what_is_expected() {
    // A sheet seen in two halves that overlap by a strip.
    let half = |from: i32| -> Vec<Point3<f64>> {
        let at = |i: i32| Point3::new(f64::from(from + i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0);
        (0..900).map(at).collect()
    };
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    for from in [0, 20] {
        let cloud = geometry::PointCloud { points: half(from), normals: Vec::new() };
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(0.1, 0.06, 1.0)) }).expect("a scan");
    }
    let first = first_scans(&session);
    let cloud = session.cloud();
    assert_eq!(first.len(), cloud.len());
    for (p, first) in cloud.points.iter().zip(&first) {
        assert_eq!(*first, u32::from(p.x > 0.118), "{p}");
    }
    let answer = session.next_view().expect("an answer");
    let expected = session.expected_surface(&answer);
    assert!(!expected.is_empty(), "the back of a sheet is not known");
    let page = report_html(&answer, &ReportInput { title: "a", session: &session, coverage: &[] });
    assert!(page.contains(&*escape(&answer.reason())), "{}", answer.reason());
    let data = page_data(&answer, &ReportInput { title: "a", session: &session, coverage: &[] });
    let born = STANDARD.decode(data["born"].as_str().expect("text")).expect("base64");
    assert_eq!(born, first.into_iter().flat_map(u32::to_le_bytes).collect::<Vec<u8>>(), "as the page reads them");
}

#[test]
fn the_replay_goes_from_scan_to_scan_whatever_they_are_of() {
    // The sheet in two halves again, the first by a line scanner, which counts as several cameras.
    let half = |from: i32| geometry::PointCloud {
        points: (0..900)
            .map(|i| Point3::new(f64::from(from + i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0))
            .collect(),
        normals: Vec::new(),
    };
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    let path = [Point3::new(0.0, 0.06, 1.0), Point3::new(0.116, 0.06, 1.0)];
    session.add_scan(Scan::Lines { cloud: half(0), path }).expect("a scan");
    session.add_scan(Scan::Cloud { cloud: half(20), from: Some(Point3::new(0.1, 0.06, 1.0)) }).expect("a scan");
    for (p, first) in session.cloud().points.iter().zip(first_scans(&session)) {
        assert_eq!(first, u32::from(p.x > 0.118), "{p}");
    }
    let answer = session.next_view().expect("an answer");
    let data = page_data(&answer, &ReportInput { title: "a", session: &session, coverage: &[] });
    let of_scans: Vec<u64> =
        data["past"].as_array().expect("a list").iter().filter_map(|camera| camera["scan"].as_u64()).collect();
    assert_eq!((&data["scans"], of_scans.len()), (&json!(2), session.state().scans.len()));
    assert!(of_scans.len() > 2 && of_scans[0] == 0 && of_scans.ends_with(&[0, 1]), "{of_scans:?}");
}

#[test]
fn the_first_scan_of_a_point_is_told_whatever_the_number_of_scans() {
    let mut session = Session::new(SessionConfig::default(), None).expect("defaults");
    // Patches of 36 points side by side, one a scan.
    let left = |scan: u32| 0.024 * f64::from(scan);
    for scan in 0..260 {
        let at = |i: u32| Point3::new(left(scan) + 0.004 * f64::from(i % 6), 0.004 * f64::from(i / 6), 0.0);
        let cloud = geometry::PointCloud { points: (0..36).map(at).collect(), normals: Vec::new() };
        session.add_scan(Scan::Cloud { cloud, from: Some(Point3::new(left(scan), 0.0, 1.0)) }).expect("a scan");
    }
    for (p, first) in session.cloud().points.iter().zip(first_scans(&session)) {
        assert!((left(first) - 0.002..left(first + 1) - 0.002).contains(&p.x), "{p}: scan {first}");
    }
}
