use super::*;
use std::collections::BTreeSet;

#[test]
fn starts_are_all_different_and_the_next_lies_far_away() {
    for scans in 2..40 {
        let all: BTreeSet<usize> = (0..scans).map(|n| start(n, scans)).collect();
        assert_eq!(all.len(), scans, "{scans}");
    }
    for scans in [8, 10, 36] {
        let apart = start(1, scans).abs_diff(start(0, scans));
        assert!(4 * apart.min(scans - apart) > scans, "{apart} of {scans}");
    }
}
