//! The client of the documentation.

mod server;

use server::Server;
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
