use super::*;

fn verdicts(line: &str, views: usize) -> Result<Vec<Verdict>, String> {
    Answered::parse(line.as_bytes()).expect("an answer").verdicts(views)
}

#[test]
fn verdicts_are_read_in_their_order() {
    let line = r#"{"id":"check-7","result":[{"reachable":true,"cost":0.3},{"reachable":true},{"reachable":false,"reason":"elbow in\nthe wall"},{"reachable":false}]}"#;
    assert_eq!(Answered::parse(line.as_bytes()).map(|a| a.number), Some(7));
    let no = |reason: &str| Verdict::Unreachable { reason: reason.to_owned() };
    let expected = [
        Verdict::Reachable { cost: 0.3 },
        Verdict::Reachable { cost: 0.0 },
        no("elbow in the wall"),
        no("not reachable"),
    ];
    assert_eq!(verdicts(line, 4).as_deref(), Ok(&expected[..]));
}

#[test]
fn what_is_wrong_with_an_answer_is_told() {
    let of = |result: &str| verdicts(&format!(r#"{{"id":"check-1","result":{result}}}"#), 1).expect_err(result);
    assert!(of("[]").contains("0 entries for 1 views"));
    assert!(of("true").contains("the result is true, expected a list"));
    assert!(of("[true]").starts_with("result[0]: true, expected an object"));
    assert!(of(r#"[{"reachable": 1}]"#).starts_with("result[0]: invalid type"));
    assert!(of(r#"[{"reachable": true, "costs": 1}]"#).contains("unknown field `costs`"));
    assert!(of(r#"[{"cost": 1}]"#).contains("missing field `reachable`"));
    let refused = verdicts(r#"{"id":"check-1","error":{"message":"no planning scene"}}"#, 1);
    assert_eq!(refused, Err("no planning scene".to_owned()));
    assert_eq!(verdicts(r#"{"id":"check-1","error":"no scene"}"#, 1), Err("no scene".to_owned()));
}

#[test]
fn what_answers_no_question_is_none() {
    for line in [
        "",
        "hello",
        "[]",
        r#"{"id":"check-1"}"#,
        r#"{"id":1,"result":[]}"#,
        r#"{"id":"7","result":[]}"#,
        r#"{"id":"check-1","result":[],"error":"x"}"#,
        r#"{"id":"check-1","method":"next_view"}"#,
    ] {
        assert!(Answered::parse(line.as_bytes()).is_none(), "{line}");
    }
}
