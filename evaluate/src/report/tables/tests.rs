use super::*;
use crate::metrics::tests::record;
use crate::record::{EpisodeKey, Timing};
use crate::report::table::write_csv;
use std::collections::BTreeSet;

fn contents() -> Contents {
    let of = |(policy, episode): (&str, usize)| {
        let coverages = [0.5, 0.6 + 0.1 * episode as f64, 0.95];
        (
            record("a", policy, episode, &coverages, &[Some(0.4), Some(0.5)]),
            Timing { episode_s: 1.0, decisions_s: vec![] },
        )
    };
    let key = EpisodeKey { object: "a, b".into(), policy: "mine".into(), episode: 0 };
    Contents {
        episodes: [("benbv", 0), ("benbv", 1), ("mine", 0), ("mine", 1)].map(of).to_vec(),
        skipped: vec![Skipped { key, reason: "\"void\"".into(), weights: None, files: None }],
    }
}

#[test]
fn no_column_stands_twice_and_every_number_is_there() {
    let (contents, config) = (contents(), EvaluateConfig::default());
    let policies = ["benbv", "mine"].map(str::to_owned);
    let missing =
        Missing { unusable: vec![("broken".to_owned(), "no faces".to_owned())], objects: 3, ..Missing::default() };
    let rows = Rows::of(&contents, &config, &policies, &missing);
    let paper = EvaluateConfig::paper();
    for table in rows.tables(&contents, &config, &policies).iter().chain(&rows.tables(&contents, &paper, &policies)) {
        let unique: BTreeSet<&String> = table.header.iter().collect();
        assert_eq!(unique.len(), table.header.len(), "{:?}: {:?}", table.title, table.header);
        assert!(table.rows.iter().all(|row| row.len() == table.header.len()), "{}", table.title);
    }
    let json = serde_json::to_value(&rows).expect("JSON");
    let row = &json["policies"][1];
    for key in ["coverage_percent", "efficiency"] {
        let of = |end: &str| row[format!("{key}{end}")].as_f64().unwrap_or_else(|| panic!("{key}{end}: {row}"));
        assert!(of("_ci_episodes_low") <= of("") && of("") <= of("_ci_episodes_high"), "{row}");
    }
    assert_eq!(json["paired"][0]["ratio"].as_f64(), Some(1.0));
    let csv = |write: &dyn Fn(&mut Vec<u8>) -> std::io::Result<()>| {
        let mut bytes = Vec::new();
        write(&mut bytes).expect("written");
        let mut reader = csv::Reader::from_reader(&bytes[..]);
        let header: Vec<String> = reader.headers().expect("header").iter().map(str::to_owned).collect();
        assert_eq!(header.iter().collect::<BTreeSet<_>>().len(), header.len(), "{header:?}");
        reader.records().collect::<Result<Vec<_>, _>>().expect("records")
    };
    for rows in [csv(&|w| write_csv(w, &rows.objects)), csv(&|w| write_csv(w, &rows.policies))] {
        assert_eq!(rows.len(), 2);
    }
    assert_eq!(csv(&|w| write_csv(w, &rows.paired)).len(), 1);
    let skipped = csv(&|w| write_csv(w, &rows.skipped));
    assert_eq!((&skipped[1][0], &skipped[1][3]), ("a, b", "\"void\""), "names are quoted");
    assert_eq!(rows.unusable(), 1);
    let broken = serde_json::json!({"object": "broken", "policy": null, "episode": null, "reason": "no faces"});
    assert_eq!(json["skipped"][0], broken);
    let tables = rows.tables(&contents, &config, &policies);
    assert_eq!(tables.last().expect("tables").rows[0], ["broken", "all", "all", "no faces"]);
}
