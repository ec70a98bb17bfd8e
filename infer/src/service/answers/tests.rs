use super::*;

fn reply(bytes: usize) -> Result<Reply, Refusal> {
    Ok(Reply::new(200, vec![b' '; bytes]))
}

#[test]
fn the_same_request_gets_the_same_answer_and_another_none() {
    let mut answers = Answers::default();
    let key = |name: &str, asked| Key::new(name, asked).expect("a key");
    answers.keep(Some(key("a", 1)), &reply(10));
    assert_eq!(answers.find(Some(&key("a", 1))).expect("kept"), reply(10));
    assert_eq!(answers.find(Some(&key("a", 2))).expect("known").expect_err("another").status, 409);
    assert!(answers.find(Some(&key("b", 1))).is_none() && answers.find(None).is_none());
    answers.keep(Some(key("b", 1)), &Err(Refusal::busy()));
    assert!(answers.find(Some(&key("b", 1))).is_none(), "to be tried again");
    for bad in ["", "a b", "\u{e4}", &"x".repeat(129)] {
        assert!(Key::new(bad, 0).is_err(), "{bad}");
    }
}

#[test]
fn memory_is_bounded() {
    let mut answers = Answers::default();
    for i in 0..1000 {
        answers.keep(Some(Key::new(&i.to_string(), i).expect("a key")), &reply(100_000));
    }
    assert!(answers.memory() <= BYTES && answers.kept.len() <= ANSWERS, "{}", answers.memory());
    assert!(answers.find(Some(&Key::new("999", 999).expect("a key"))).is_some(), "the newest stays");
    assert!(answers.find(Some(&Key::new("9", 9).expect("a key"))).is_none(), "the oldest does not");
}
