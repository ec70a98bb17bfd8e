use super::*;

#[test]
fn what_is_held_is_given_back_and_no_more_is_lent_than_there_is() {
    let memory = Memory::new(1);
    let mut held = memory.take(600 << 10).expect("there is so much");
    assert_eq!((held.size(), memory.used()), (600 << 10, 600 << 10));
    let refused = memory.take(500 << 10).expect_err("there is not");
    assert!(refused.status == 507 && refused.message.contains("of 1 MiB"), "{refused:?}");
    held.resize(100 << 10).expect("less always is");
    let other = memory.take(900 << 10).expect("now there is");
    assert!(held.resize(200 << 10).is_err(), "other holds it");
    assert_eq!(held.size(), 100 << 10, "as it was");
    held.absorb(memory.take(20 << 10).expect("there is"));
    assert_eq!((held.size(), memory.used()), (120 << 10, 1020 << 10));
    held.cover(50 << 10).expect("it does already");
    assert_eq!(held.size(), 120 << 10, "never less");
    drop((held, other));
    assert_eq!(memory.used(), 0);
}
