//! Clients: that of the documentation, and one that cannot plan after each scan.

mod server;

use serde_json::json;
use server::{Server, sheet};
use std::process::Command;

#[test]
fn the_python_client_works() {
    let server = Server::start();
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/client.py");
    let run = Command::new("python3").args([client, &format!("http://{}", server.address)]).output();
    let Ok(output) = run else {
        println!("skipped: there is no python3 here to run docs/client.py with");
        return;
    };
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(text.contains("'scans': 1") && text.contains("next view: [["), "{text}");
    assert_eq!(server.ask("GET", "/health", "").1["sessions"], 0, "the client closes its session");
}

#[test]
fn several_views_are_planned_at_once_and_the_surface_comes_as_triangles() {
    let server = Server::start_with(&["--planner", "volumetric"]);
    let id = server.session();
    let next = format!("/sessions/{id}/next");
    server.ask("POST", &format!("/sessions/{id}/scans"), &sheet(30));
    let (_, first) = server.ask("POST", &next, "{}");
    assert!(first["next"].is_object() && first.get("plan").is_none(), "{first}");
    let (_, mut planned) = server.ask("POST", &next, r#"{"plan_views": 3}"#);
    let plan = planned["plan"].take();
    let views = plan["views"].as_array().expect("views");
    assert!((1..=3).contains(&views.len()) && plan["adds"].as_f64() > Some(0.0), "{plan}");
    let candidates = planned["candidates"].as_array().expect("candidates");
    assert!(
        views.iter().all(|v| candidates.iter().any(|c| c["world_from_camera"] == v["world_from_camera"])),
        "{plan}"
    );
    planned.as_object_mut().expect("an answer").remove("plan");
    assert_eq!(planned, first, "the answer itself is the same");
    let (status, none) = server.ask("POST", &next, r#"{"plan_views": 0}"#);
    assert_eq!((status, &none["error"]["code"]), (400, &json!("bad_plan_views")));
    let (_, mesh) = server.ask("GET", &format!("/sessions/{id}/mesh"), "");
    let count = |key: &str| mesh[key].as_array().expect("a list").len();
    assert!(
        count("triangles") > 500 && count("vertices_m") == count("rim") && count("rim") == count("normals"),
        "{mesh}"
    );
    let last = mesh["triangles"].as_array().expect("a list").iter().flat_map(|t| t.as_array().expect("three"));
    assert_eq!(last.filter_map(|i| i.as_u64()).max(), Some(count("vertices_m") as u64 - 1), "indices of the vertices");
    let (_, blind) = server.ask("POST", &next, r#"{"plan_views": 3, "config": {"planner": "farthest"}}"#);
    assert!(blind.get("plan").is_some_and(|plan| plan.is_null()), "it does not say what views see together: {blind}");
}
