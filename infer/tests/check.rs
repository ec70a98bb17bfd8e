//! Views checked by somebody else: a program of `--check-with`, or the client over stdin and stdout.
#![cfg(unix)]

mod server;

use serde_json::{Value, json};
use server::{Server, sheet};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use std::time::Duration;

fn sample(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../samples").join(name).display().to_string()
}

/// A program that keeps what it is asked in `asked` and answers as many questions as it says: the first view cannot be taken, the second
/// costs a half.
fn checker(folder: &Path, questions: u32) -> String {
    let asked = folder.join("asked").display().to_string();
    let text = format!(
        r#"for question in $(seq {questions}); do
  read -r line || exit 0
  printf '%s\n' "$line" >> '{asked}'
  id=$(printf '%s' "$line" | sed 's/.*"id":"\([^"]*\)".*/\1/')
  views=$(printf '%s' "$line" | grep -o '"cell_from_camera"' | wc -l)
  said='{{"reachable":false,"reason":"elbow in the wall"}},{{"reachable":true,"cost":0.5}}'
  for view in $(seq 3 $views); do said="$said,{{\"reachable\":true}}"; done
  printf '{{"id":"%s","result":[%s]}}\n' "$id" "$said"
done
"#
    );
    let script = folder.join("checker.sh");
    std::fs::write(&script, text).expect("a file");
    format!("sh '{}'", script.display())
}

fn questions(folder: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(folder.join("asked")).expect("it was asked");
    text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

fn infer(arguments: &[&str]) -> Output {
    let scan = sample("scan1.ply");
    Command::new(env!("CARGO_BIN_EXE_infer"))
        .args(["--scan", &scan, "--from", "0.0762,-0.5734,1.0514", "--json"])
        .args(arguments)
        .output()
        .expect("infer runs")
}

/// Of an answer, its candidates by what the checker said of them.
fn said(answer: &Value) -> (Vec<&Value>, Vec<&Value>) {
    let candidates = answer["candidates"].as_array().expect("a list");
    let refused = json!([{ "constraint": "caller", "reason": "elbow in the wall" }]);
    let paid = |c: &Value| c["planner_score"].as_f64().zip(c["score"].as_f64()).map_or(0.0, |(own, all)| own - all);
    (
        candidates.iter().filter(|c| c["objections"] == refused).collect(),
        candidates.iter().filter(|c| (paid(c) - 0.5).abs() < 1e-9).collect(),
    )
}

#[test]
fn a_program_says_which_views_can_be_taken() {
    let folder = tempfile::tempdir().expect("a folder");
    let command = checker(folder.path(), 1);
    let output = infer(&["--check-with", &command]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).expect("an answer");
    let asked = questions(folder.path());
    let views = asked[0]["params"]["views"].as_array().expect("views");
    assert_eq!((asked.len(), &asked[0]["method"]), (1, &json!("check_views")));
    assert!(views.len() > 10 && views[0]["table_stop_deg"].is_null() && views[0]["joints"].is_null(), "{}", views[0]);
    let (refused, dear) = said(&answer);
    assert_eq!((refused.len(), dear.len()), (1, 1));
    assert_eq!(refused[0]["world_from_camera"], views[0]["cell_from_camera"], "the first that was asked about");
    assert_eq!(dear[0]["world_from_camera"], views[1]["cell_from_camera"]);
    assert_ne!(answer["next"]["world_from_camera"], views[0]["cell_from_camera"]);
}

#[test]
fn with_an_arm_the_program_is_told_the_flange_and_the_joints() {
    let folder = tempfile::tempdir().expect("a folder");
    let command = checker(folder.path(), 1);
    let urdf = sample("robots/ur5e.urdf");
    let base = "robot.cell_from_base=[[1,0,0,0.55],[0,1,0,0],[0,0,1,-0.2],[0,0,0,1]]";
    let hand = "0,0.05,0.03,0,0,0,1";
    let arm = ["--robot", &urdf, "--tool", "tool0", "--flange-from-camera", hand, "--distance", "0.5", "--set", base];
    let output = infer(&[&["--check-with", &command][..], &arm].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let asked = questions(folder.path());
    for view in asked[0]["params"]["views"].as_array().expect("views") {
        let at = |pose: &str, row: usize, column: usize| view[pose]["matrix"][row][column].as_f64().expect("a number");
        assert_eq!(view["joints"].as_array().map(Vec::len), Some(6), "{view}");
        // base_from_flange * flange_from_camera, the hand-eye calibration being a shift alone; the base stands at (0.55, 0, -0.2).
        for (row, base) in [0.55, 0.0, -0.2].into_iter().enumerate() {
            let [y, z, p] = [1, 2, 3].map(|column| at("base_from_flange", row, column));
            let camera = base + p + 0.05 * y + 0.03 * z;
            assert!((camera - at("cell_from_camera", row, 3)).abs() < 1e-9, "{view}");
        }
    }
}

#[test]
fn a_program_that_does_not_answer_is_an_error_and_no_hang() {
    let fails = |arguments: &[&str], expected: &str| {
        let output = infer(arguments);
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && told.contains(expected), "{expected}: {told}");
        assert!(output.stdout.is_empty());
    };
    fails(&["--check-with", "true"], "--check-with 'true': it ended, or closed its stdout, instead of answering");
    fails(&["--check-with", "exec sleep 100 > /dev/null"], "closed its stdout");
    fails(&["--check-with", "echo hello; cat > /dev/null"], "it wrote \"hello\", expected");
    fails(&["--check-with", "cat > /dev/null", "--check-timeout", "0.2"], "no answer within 0.2 s (--check-timeout)");
    fails(
        &["--check-with", r#"read -r x; echo '{"id":"check-1","result":[{"reachable":true}]}'"#],
        "the result has 1 entries for",
    );
    fails(&["--check-with", r#"read -r x; echo '{"id":"check-1","error":"no planning scene"}'"#], "no planning scene");
}

#[test]
fn a_program_that_hangs_is_ended_with_all_that_it_started() {
    let folder = tempfile::tempdir().expect("a folder");
    let fifo = folder.path().join("fifo");
    assert!(Command::new("mkfifo").arg(&fifo).status().is_ok_and(|status| status.success()), "mkfifo runs");
    // Once it runs it says what is no answer, and goes on.
    let started = "echo up; echo hello >&3; exec sleep 600 3>&-";
    let command = format!("sh -c '{started}' 3>&1 > '{}' 2> /dev/null; true", fifo.display());
    let (sender, read) = std::sync::mpsc::channel();
    std::thread::spawn(move || sender.send(std::fs::read(fifo).expect("a pipe")));
    let output = infer(&["--check-with", &command]);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && told.contains("it wrote \"hello\""), "{told}");
    // The pipe ends with the last process that could write to it.
    assert_eq!(read.recv_timeout(Duration::from_secs(60)).expect("it is ended"), b"up\n");
}

#[test]
fn the_service_asks_the_program_for_every_session_and_starts_it_again() {
    let folder = tempfile::tempdir().expect("a folder");
    // It ends after each answer.
    let command = checker(folder.path(), 1);
    let server = Server::start_with(&["--check-with", &command]);
    let body = sheet(30);
    for session in ["1", "2"] {
        assert_eq!(server.ask("POST", "/sessions", "").0, 201);
        assert_eq!(server.ask("POST", &format!("/sessions/{session}/scans"), &body).0, 200);
        for _ in 0..2 {
            let (status, answer) = server.ask("POST", &format!("/sessions/{session}/next"), "");
            if status == 502 {
                // It may have ended only after it was asked again.
                assert_eq!(answer["error"]["code"], "check_failed");
                continue;
            }
            assert_eq!((status, said(&answer).0.len()), (200, 1), "{answer}");
        }
    }
    let without = Server::start();
    assert_eq!(without.ask("POST", "/sessions", "").0, 201);
    assert_eq!(without.ask("POST", "/sessions/1/scans", &body).0, 200);
    let (status, answer) = without.ask("POST", "/sessions/1/next", r#"{"check": true}"#);
    assert_eq!((status, &answer["error"]["code"]), (400, &json!("no_check")), "over HTTP nobody is asked back");
}

/// `infer --serve` and what is written to it and read from it.
struct Lines {
    process: Child,
    input: Option<ChildStdin>,
    output: BufReader<ChildStdout>,
}

impl Lines {
    /// With one scan.
    fn start() -> Self {
        let mut process = Command::new(env!("CARGO_BIN_EXE_infer"))
            .args(["--serve", "--planner", "farthest"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let (input, output) = (process.stdin.take(), BufReader::new(process.stdout.take().expect("piped")));
        let mut lines = Self { process, input, output };
        lines.write(&json!({ "method": "create" }));
        lines.read();
        let scan: Value = serde_json::from_str(&sheet(30)).expect("JSON");
        lines.write(&json!({ "method": "add_scan", "session": "1", "params": scan }));
        assert_eq!(lines.read()["result"]["scans"], 1);
        lines
    }

    fn write(&mut self, line: &Value) {
        writeln!(self.input.as_mut().expect("open"), "{line}").expect("the service reads");
    }

    fn read(&mut self) -> Value {
        let mut line = String::new();
        self.output.read_line(&mut line).expect("the service writes");
        serde_json::from_str(&line).expect("JSON")
    }

    /// Asks for the next view; the question that comes back.
    fn next_view(&mut self, more: Value) -> Value {
        let mut params = json!({ "check": true });
        params.as_object_mut().expect("an object").extend(more.as_object().expect("an object").clone());
        self.write(&json!({ "id": "mine", "method": "next_view", "session": "1", "params": params }));
        let question = self.read();
        assert_eq!(question["method"], "check_views", "{question}");
        question
    }
}

#[test]
fn the_client_is_asked_while_its_request_is_answered() {
    let mut lines = Lines::start();
    let question = lines.next_view(json!({}));
    let views = question["params"]["views"].as_array().expect("views").len();
    let mut result = vec![json!({ "reachable": true }); views];
    result[0] = json!({ "reachable": false, "reason": "elbow in the wall" });
    result[1] = json!({ "reachable": true, "cost": 0.5 });
    lines.write(&json!({ "id": question["id"], "result": result }));
    let answer = lines.read();
    assert_eq!(answer["id"], "mine");
    let (refused, dear) = said(&answer["result"]);
    assert_eq!((refused.len(), dear.len()), (1, 1), "{answer}");
    assert_eq!(refused[0]["world_from_camera"], question["params"]["views"][0]["cell_from_camera"]);
    lines.write(&json!({ "id": "free", "method": "next_view", "session": "1" }));
    let answer = lines.read();
    assert!(answer["id"] == "free" && said(&answer["result"]).0.is_empty(), "not asked for, not asked");
    // Something else in place of the answer: an error, and the line is answered in its turn.
    lines.next_view(json!({}));
    lines.write(&json!({ "id": "health", "method": "health" }));
    let failed = lines.read();
    assert_eq!((&failed["id"], &failed["error"]["code"]), (&json!("mine"), &json!("check_failed")), "{failed}");
    assert!(failed["error"]["message"].as_str().is_some_and(|m| m.contains("the answer to check_views was expected")));
    assert_eq!(lines.read()["id"], "health");
    // Too late: an error, and what comes then is no request.
    let question = lines.next_view(json!({ "deadline_ms": 300 }));
    let late = lines.read();
    assert_eq!(late["error"]["code"], "deadline", "{late}");
    lines.write(&json!({ "id": question["id"], "result": result }));
    lines.write(&json!({ "id": "health", "method": "health" }));
    assert_eq!(lines.read()["id"], "health");
    let question = lines.next_view(json!({}));
    lines.write(&json!({ "id": question["id"], "error": { "message": "the arm is off" } }));
    assert!(lines.read()["error"]["message"].as_str().is_some_and(|m| m.contains("the arm is off")));
    // Gone: an error to whoever reads still, and the end.
    lines.next_view(json!({}));
    lines.input = None;
    assert_eq!(lines.read()["error"]["code"], "check_failed");
    assert!(lines.process.wait().expect("ends").success());
}
