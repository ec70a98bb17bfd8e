use super::*;
use planning::{PlannerName, Scan, Session, SessionConfig};

#[test]
fn a_hostile_title_stays_text_and_nothing_is_loaded() {
    let points = (0..900).map(|i| Point3::new(f64::from(i % 30) * 0.004, f64::from(i / 30) * 0.004, 0.0)).collect();
    let config = SessionConfig { planner: PlannerName::Farthest, ..Default::default() };
    let mut session = Session::new(config, None).expect("defaults");
    let scan =
        Scan::Cloud { cloud: PointCloud { points, normals: Vec::new() }, from: Some(Point3::new(0.0, 0.0, 1.0)) };
    session.add_scan(scan).expect("a scan");
    let mut answer = session.next_view().expect("an answer");
    let hostile = "</script><script>alert(1)</script>{{data}}\"'&";
    answer.warnings.push(hostile.to_owned());
    answer.candidates[1]
        .objections
        .push(planning::constraints::Objection { constraint: planning::Constraint::Floor, reason: hostile.to_owned() });
    let input = ReportInput { title: hostile, session: &session, past: &[], coverage: &[0.3, 0.6] };
    let page = report_html(&answer, &input);
    assert!(!page.contains("<script>alert"), "the title must not become a script");
    assert_eq!(page.matches("<script").count(), 2, "the page's own two scripts");
    assert!(page.contains("&lt;script&gt;alert(1)"), "it is shown as text");
    assert!(!page.contains("http://") && !page.contains("https://"), "nothing is loaded from elsewhere");
    assert!(page.contains("<polyline"), "the coverage is drawn");
}
