//! `plan` without a network: messages in, a session of `planning` behind, messages out.

use super::*;
use crate::messages::{ByteArray, PointCloud2, PointField, TFMessage, Time, TransformStamped};
use formats::config::overlaid;
use planning::{Session, SessionConfig, SessionError};
use serde_json::json;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A session of the planner that needs no network; keeps what it was asked.
struct Asked {
    session: Mutex<Session>,
    bodies: Mutex<Vec<(Ask, Value)>>,
    no_view: AtomicBool,
}

impl Asked {
    fn new() -> Self {
        let config =
            SessionConfig { planner: planning::PlannerName::Farthest, working_distance_m: 0.6, ..Default::default() };
        let session = Mutex::new(Session::new(config, None).expect("a session"));
        Self { session, bodies: Mutex::default(), no_view: AtomicBool::new(false) }
    }
}

impl Planner for Asked {
    fn ask(&self, ask: Ask, body: &[u8]) -> Result<Vec<u8>, Refused> {
        use base64::Engine;
        let refused = |e: String| Refused { code: "x".to_owned(), message: e };
        let body: Value = if body.is_empty() { Value::Null } else { serde_json::from_slice(body).expect("JSON") };
        self.bodies.lock().expect("kept").push((ask, body.clone()));
        let mut session = self.session.lock().expect("kept");
        let answer = match ask {
            Ask::Configure => {
                let config = overlaid(session.config(), body, "config").map_err(refused)?;
                session.configure(config).map_err(|e| refused(e.to_string()))?;
                json!({})
            }
            Ask::AddScan => {
                let bytes = base64::engine::general_purpose::STANDARD
                    .decode(body["cloud_base64"].as_str().expect("a cloud"))
                    .expect("base64");
                let file = formats::cloud::parse_cloud("cloud.pcd".as_ref(), &bytes).expect("a PCD");
                let from: [f64; 3] = serde_json::from_value(body["from"].clone()).expect("a position");
                let scan = planning::Scan::Cloud { cloud: file.cloud, from: Some(from.into()) };
                session.add_scan(scan).map_err(|e| match e {
                    SessionError::Unregistered { .. } => {
                        Refused { code: "unregistered".to_owned(), message: e.to_string() }
                    }
                    _ => refused(e.to_string()),
                })?;
                json!({ "notes": ["read"] })
            }
            Ask::NextView if self.no_view.load(std::sync::atomic::Ordering::SeqCst) => {
                return Err(refused("it took too long".to_owned()));
            }
            Ask::NextView => {
                serde_json::to_value(session.next_view().map_err(|e| refused(e.to_string()))?).expect("JSON")
            }
            Ask::Undo if session.undo() => json!({ "scans": session.num_scans() }),
            Ask::Undo => return Err(refused("no scan".to_owned())),
            Ask::Reset => {
                session.reset();
                json!({ "scans": 0 })
            }
            Ask::Export => {
                let cloud = session.cloud();
                json!({ "points_m": cloud.points, "normals": cloud.normals, "config": session.config(), "spacing_m": 0.01,
                        "scans": session.num_scans() })
            }
        };
        Ok(answer.to_string().into_bytes())
    }

    fn session(&self) -> Result<SessionInfo, Refused> {
        let scans = self.session.lock().expect("kept").num_scans();
        Ok(SessionInfo { name: "1".to_owned(), scans, kept: false })
    }
}

fn config() -> Ros2Config {
    let [base_frame, cloud_topic] = ["base", "/points"].map(str::to_owned);
    Ros2Config { base_frame, cloud_topic, wait_s: 0.0, ..Ros2Config::default() }
}

/// A sheet 0.5 m before a camera that stands at (1, 0, 0).
fn sheet() -> PointCloud2 {
    sheet_at(0.5)
}

/// The same at this distance.
fn sheet_at(z: f32) -> PointCloud2 {
    let points = (0..900).map(|i| [(i % 30) as f32 * 0.004, (i / 30) as f32 * 0.004, z]);
    let field =
        |(i, name): (usize, &str)| PointField { name: name.to_owned(), offset: 4 * i as u32, datatype: 7, count: 1 };
    PointCloud2 {
        header: Header { stamp: Time { sec: 5, nanosec: 0 }, frame_id: "camera".to_owned() },
        height: 1,
        width: 900,
        fields: ["x", "y", "z"].into_iter().enumerate().map(field).collect(),
        point_step: 12,
        row_step: 0,
        data: ByteArray(points.flatten().flat_map(f32::to_le_bytes).collect()),
        ..PointCloud2::default()
    }
}

fn inbox() -> Inbox {
    let inbox = Inbox::new(Duration::from_secs(60));
    let mut transform = TransformStamped { child_frame_id: "camera".to_owned(), ..TransformStamped::default() };
    transform.header.frame_id = "base".to_owned();
    transform.transform.translation.x = 1.0;
    inbox.take_transforms(&TFMessage { transforms: vec![transform] }, true);
    inbox
}

fn come(inbox: &Inbox, cloud: PointCloud2) {
    inbox.take_scan("a".to_owned(), Measurement::Cloud(Arc::new(cloud)));
}

fn header() -> Header {
    Header { stamp: Time { sec: 9, nanosec: 0 }, frame_id: "base".to_owned() }
}

#[test]
fn the_newest_scan_is_planned_on_and_what_was_used_is_said() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    let mut pending = Pending::default();
    let (early, _) = desk.plan(&config(), "", &header(), &mut pending);
    assert_eq!(early.message, "no_scan: nothing has arrived on /points");
    come(&inbox, PointCloud2 { width: 7, ..sheet() });
    come(&inbox, sheet());
    let (said, published) = desk.plan(&config(), "", &header(), &mut pending);
    assert!(said.success, "{}", said.message);
    let report: Value = serde_json::from_str(&said.message).expect("JSON");
    assert_eq!((&report["scan"]["returns"], &report["scan"]["frame"]), (&json!(900), &json!("camera")));
    assert_eq!(
        (&report["scan"]["stamp"], &report["notes"], &report["stop"]),
        (&json!(5.0), &json!(["read"]), &json!(false))
    );
    let published = published.expect("messages");
    let pose = published.next_view.expect("a view");
    let p = pose.pose.position;
    assert_eq!(json!([p.x, p.y, p.z]), report["next"]["position_m"]);
    assert_eq!((pose.header, published.candidates.poses.len() > 1), (header(), true));
    assert_eq!(planner.bodies.lock().expect("kept")[0].1["from"], json!([1.0, 0.0, 0.0]));
    let (again, _) = desk.plan(&config(), "", &header(), &mut pending);
    assert!(again.message.starts_with("no_new_scan: the newest scan on /points"), "{}", again.message);
}

#[test]
fn a_scan_that_got_no_view_is_planned_on_before_another_is_taken() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    let mut pending = Pending::default();
    come(&inbox, sheet());
    planner.no_view.store(true, std::sync::atomic::Ordering::SeqCst);
    let (late, published) = desk.plan(&config(), "", &header(), &mut pending);
    assert_eq!(late.message, "x: the scan was added, but planning failed (plan again): it took too long");
    assert_eq!(published, None);
    planner.no_view.store(false, std::sync::atomic::Ordering::SeqCst);
    come(&inbox, sheet());
    let (said, _) = desk.plan(&config(), "", &header(), &mut pending);
    assert!(said.success && planner.session().expect("one").scans == 1, "{}", said.message);
    let (next, _) = desk.plan(&config(), "", &header(), &mut pending);
    assert!(next.success && planner.session().expect("one").scans == 2, "{}", next.message);
    assert_eq!(desk.take_back(Ask::Undo, &mut pending).message, r#"{"scans":1}"#);
    assert_eq!(desk.take_back(Ask::Reset, &mut pending).message, r#"{"scans":0}"#);
    assert_eq!(
        desk.take_back(Ask::Undo, &mut pending),
        refused(&Refused { code: "x".into(), message: "no scan".into() })
    );
}

#[test]
fn scans_that_come_and_go_over_http_end_the_wait_for_a_view() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    let mut pending = Pending::default();
    let mut plan = || desk.plan(&config(), "", &header(), &mut pending).0;
    let scans = || planner.session().expect("one").scans;
    let no_view = |yes| planner.no_view.store(yes, std::sync::atomic::Ordering::SeqCst);

    come(&inbox, sheet());
    no_view(true);
    assert!(!plan().success && scans() == 1);
    planner.ask(Ask::Undo, b"").expect("taken back");
    let empty = plan().message;
    assert!(empty.starts_with("no_new_scan: "), "not stuck without a scan: {empty}");
    come(&inbox, sheet());
    assert!(!plan().success && scans() == 1);
    let added = planner.bodies.lock().expect("kept").iter().find(|(ask, _)| *ask == Ask::AddScan).cloned();
    planner.ask(Ask::AddScan, added.expect("one").1.to_string().as_bytes()).expect("added");
    no_view(false);
    come(&inbox, sheet());
    let said = plan();
    assert!(said.success && scans() == 3, "planned on the scan that came last: {}", said.message);
}

/// Registers scans, and rules out no view for what its scan would see.
const REFINE: &str = r#"{"registration": {"register": "refine", "registrability": "off"}}"#;

#[test]
fn after_a_rejected_scan_the_next_view_is_planned_and_the_next_scan_taken() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    let mut pending = Pending::default();
    let mut plan = |changes: &str| desk.plan(&config(), changes, &header(), &mut pending);
    let scans = || planner.session().expect("one").scans;
    come(&inbox, sheet());
    let (first, _) = plan(REFINE);
    assert!(first.success && !first.message.contains("rejected"), "{}", first.message);
    come(&inbox, sheet_at(0.9));
    let (said, published) = plan("");
    assert!(said.success, "{}", said.message);
    let report: Value = serde_json::from_str(&said.message).expect("JSON");
    let why = report["scan"]["rejected"].as_str().expect("a reason");
    assert!(why.contains("cannot be registered"), "{why}");
    assert_eq!((&report["stop"], &report["session"]["scans"]), (&json!(false), &json!(1)));
    assert!(published.expect("messages").next_view.is_some());
    let (again, _) = plan("");
    assert!(again.message.starts_with("no_new_scan: "), "not rejected twice: {}", again.message);
    come(&inbox, sheet());
    let (next, _) = plan(r#"{"registration": {"register": "off"}}"#);
    assert!(next.success && scans() == 2, "{}", next.message);
}

#[test]
fn a_rejected_scan_that_got_no_view_is_told_and_not_added_again() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    let mut pending = Pending::default();
    let mut plan = |changes: &str| desk.plan(&config(), changes, &header(), &mut pending).0;
    let no_view = |yes| planner.no_view.store(yes, std::sync::atomic::Ordering::SeqCst);
    come(&inbox, sheet());
    assert!(plan(REFINE).success);
    come(&inbox, sheet_at(0.9));
    no_view(true);
    let late = plan("").message;
    assert!(late.starts_with("x: the scan was rejected (the scan cannot be registered"), "{late}");
    assert!(late.ends_with("), and planning failed (plan again): it took too long"), "{late}");
    no_view(false);
    let said = plan("");
    let report: Value = serde_json::from_str(&said.message).expect("JSON");
    assert_eq!((said.success, &report["scan"]), (true, &Value::Null));
    let adds = planner.bodies.lock().expect("kept").iter().filter(|(ask, _)| *ask == Ask::AddScan).count();
    assert_eq!(adds, 2);
}

#[test]
fn settings_hold_for_the_scan_of_the_same_plan_and_wrong_ones_cost_none() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    come(&inbox, sheet());
    let plan = |changes: &str| desk.plan(&config(), changes, &header(), &mut Pending::default()).0;
    let wrong = plan(r#"{"stop_below": 7}"#).message;
    assert!(wrong.contains("stop_below = 7: expected a share from 0 to 1"), "{wrong}");
    let few = plan(r#"{"min_points": 1000}"#).message;
    assert!(few.contains("too few points to plan on"), "{few}");
    let said = plan(r#"{"min_points": 30}"#);
    assert!(said.success && planner.session().expect("one").scans == 1, "{}", said.message);
    let asked: Vec<Ask> = planner.bodies.lock().expect("kept").iter().map(|(ask, _)| *ask).collect();
    let [configure, add] = [Ask::Configure, Ask::AddScan];
    assert_eq!(asked, [configure, configure, add, configure, add, Ask::NextView, Ask::Export]);
}

#[test]
fn markers_are_of_the_base_frame_and_lists_have_points() {
    let (inbox, planner, stop) = (inbox(), Asked::new(), AtomicBool::new(false));
    let desk = Desk { inbox: &inbox, planner: &planner, stop: &stop };
    come(&inbox, sheet());
    let (_, published) = desk.plan(&config(), "", &header(), &mut Pending::default());
    let markers = published.expect("messages").markers.markers;
    let names: Vec<&str> = markers.iter().map(|m| m.ns.as_str()).collect();
    assert_eq!(names, ["", "cloud", "boundary", "candidates", "next_view"]);
    assert_eq!(markers[0].action, crate::messages::Marker::DELETE_ALL);
    assert!(markers.iter().all(|m| m.header == header()));
    assert!(markers[1..].iter().all(|m| !m.points.is_empty() && m.scale.x > 0.0 && m.color.a == 1.0));
    // Eight edges of two points for each candidate; one more line for the next view.
    assert_eq!(markers[3].points.len() % 16, 0);
    assert_eq!(markers[3].points.len(), markers[3].colors.len());
    assert_eq!(markers[4].points.len(), 18);
}
