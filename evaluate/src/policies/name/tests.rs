use super::*;

#[test]
fn every_listed_name_is_one_and_stays_as_written() {
    let listed = POLICIES.iter().chain(RECORDED_POLICIES).map(|(name, _)| *name);
    for name in listed.chain(PAPER_POLICIES.iter().copied()) {
        let policy: Policy = name.parse().unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(policy.to_string(), name);
    }
    let kind = |name: &str| name.parse::<Policy>().map(|p| p.kind);
    assert_eq!(kind("random-sphere:1.50"), Ok(Kind::RandomSphere(Radius::Fixed(1.5))));
    assert_eq!(kind("benbv-net:a:b"), Ok(Kind::BenbvNet(Some("a:b".into()))));
    assert_eq!(kind("farthest:60"), Ok(Kind::FarthestAmong(60)));
    assert_eq!(kind("farthest:1.5"), Ok(Kind::FarthestOnSphere(Radius::Fixed(1.5))));
    assert_eq!(kind("oracle"), kind("oracle:60"));
    let gain = Refined { source: Source::Shifted, gain: true, overlap: false };
    assert_eq!(kind("volumetric:shifted-gain"), Ok(Kind::Volumetric(Some(gain))));
    let oracle = Kind::Oracle { among: Among::Candidates(60), radius: Radius::Working, min_overlap: 0.3 };
    assert_eq!(kind("oracle:60:0.3"), Ok(oracle));
}

#[test]
fn bad_names_are_refused_with_the_way_out() {
    let message = |name: &str| name.parse::<Policy>().expect_err(name).to_string();
    let unknown = message("bnbv");
    assert!(unknown.contains("did you mean \"benbv\"?") && unknown.contains("--list-policies"), "{unknown}");
    assert!(message("random-shpere:1.5").contains("did you mean \"random-sphere:1.5\"?"));
    assert!(!message("quite-another-thing").contains("did you mean"));
    assert!(message("benbv:many").contains("multiple"));
    assert!(message("random-sphere:-1").contains("radius") && message("random-33:inf").contains("radius"));
    assert!(message("see:fast").contains("r010"));
    assert!(message("auto:images").contains("camera-positions") && message("random:2").contains("expected nothing"));
    assert!(message("pc-nbv:fast").contains("paper"));
    assert!(message("random-boundary:2").contains("expected nothing"));
    assert!(message("volumetric:best").contains("learned") && message("volumetric:true-x").contains("learned"));
    for least in ["x", "30", "2", "-1", "nan", "inf"] {
        let text = message(&format!("oracle:60:{least}"));
        assert!(text.contains("overlap from 0 to 1, e.g. 60:0.3"), "{text}");
    }
    for family in ["benbv", "farthest", "oracle"] {
        let text = message(&format!("{family}:3000000000"));
        assert!(text.contains("3000000000") && text.contains("up to 10,000,000"), "{text}");
    }
    for good in ["oracle:60:0", "oracle:60:1", "benbv:10000000", "farthest:0.5"] {
        good.parse::<Policy>().unwrap_or_else(|e| panic!("{e}"));
    }
}

#[test]
fn an_own_policy_has_a_name_that_no_other_has() {
    let own = |version: Option<&str>| {
        Own::new(version.map(str::to_owned), || Box::new(planning::VolumetricPlanner::new(Default::default())))
    };
    let mine = Policy::own("mine", own(None)).expect("a name");
    assert!((mine.name(), mine.is_own(), mine.may_have_changed()) == ("mine", true, true));
    assert!(!Policy::own("mine", own(Some("1"))).expect("a name").may_have_changed(), "it has a version");
    assert!(!"benbv".parse::<Policy>().expect("ours").is_own());
    for taken in ["benbv", "benbv:60", "oracle:sphere", "random-33:x"] {
        assert_eq!(Policy::own(taken, own(None)), Err(NameError::Taken { name: taken.to_owned() }));
    }
    for odd in ["", "a b", "a|b", "a\nb"] {
        assert_eq!(Policy::own(odd, own(None)), Err(NameError::Odd { name: odd.to_owned() }));
    }
}
