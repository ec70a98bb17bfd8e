use super::*;

#[test]
fn the_oldest_that_keeps_waiting_makes_room() {
    let connections = Arc::<Connections>::default();
    let [first, second] = [0; 2].map(|_| connections.enter(2).expect("room"));
    first.connection.busy.store(true, Ordering::SeqCst);
    let third = connections.enter(2).expect("the second goes");
    assert_eq!(connections.count(), 2);
    third.connection.busy.store(true, Ordering::SeqCst);
    assert!(connections.enter(2).is_none(), "all are being answered");
    drop(second);
    assert_eq!(connections.count(), 2, "it had no place any longer");
    drop(first);
    assert!(connections.enter(2).is_some());
}
