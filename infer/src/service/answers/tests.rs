use super::*;

/// A key of a request that says no more than a session.
fn key(name: &str, session: &str) -> Key {
    Key::new(name, Method::Undo, Some(session), &Fingerprint::default()).expect("a key")
}

fn reply(bytes: usize) -> Result<Reply, Refusal> {
    Ok(Reply::new(200, vec![b' '; bytes]))
}

#[test]
fn the_same_request_gets_the_same_answer_and_another_none() {
    let mut answers = Answers::default();
    answers.keep(Some(key("a", "1")), &reply(10));
    assert_eq!(answers.find(Some(&key("a", "1"))).expect("kept"), reply(10));
    assert_eq!(answers.find(Some(&key("a", "2"))).expect("known").expect_err("another").status, 409);
    assert!(answers.find(Some(&key("b", "1"))).is_none() && answers.find(None).is_none());
    answers.keep(Some(key("b", "1")), &Err(Refusal::busy()));
    assert!(answers.find(Some(&key("b", "1"))).is_none(), "to be tried again");
    for bad in ["", "a b", "\u{e4}", &"x".repeat(129)] {
        assert!(Key::new(bad, Method::Undo, None, &Fingerprint::default()).is_err(), "{bad}");
    }
}

#[test]
fn memory_is_bounded() {
    let mut answers = Answers::default();
    for i in 0..1000 {
        answers.keep(Some(key(&i.to_string(), "1")), &reply(100_000));
    }
    assert!(answers.memory() <= BYTES && answers.kept.len() <= ANSWERS, "{}", answers.memory());
    assert!(answers.find(Some(&key("999", "1"))).is_some(), "the newest stays");
    assert!(answers.find(Some(&key("9", "1"))).is_none(), "the oldest does not");
}

#[test]
fn a_request_has_the_same_key_in_every_program_that_reads_it_from_disk() {
    let body: Fingerprint = serde_json::from_str(r#"{"a": [1, 2.5, "x"]}"#).expect("JSON");
    let key = Key::new("k", Method::AddScan, Some("1"), &body).expect("a key");
    assert_eq!(key.asked, "86c2c0cf858e1f962b2a3d0a1951900ce4f23fbdcf23280d9f4be0f202f59b26");
    for other in [
        Key::new("k", Method::AddScan, Some("2"), &body),
        Key::new("k", Method::NextView, Some("1"), &body),
        Key::new("k", Method::AddScan, None, &body),
        Key::new("k", Method::AddScan, Some("1"), &Fingerprint::default()),
    ] {
        assert_ne!(other.expect("a key"), key);
    }
    // As programs wrote it that hashed in 64 bits: it is read, and is another request.
    let old: Kept =
        toml::from_str("status = 200\nbody = \"{}\"\nkey = { name = \"k\", asked = \"00ff00ff00ff00ff\" }\n")
            .expect("read");
    let refused = Answers::from_disk(vec![old]).find(Some(&key)).expect("known").expect_err("another");
    assert_eq!(refused.code, "key_reused");
}
