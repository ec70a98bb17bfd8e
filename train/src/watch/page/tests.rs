use super::super::record::{EpochRecord, StepRecord};
use super::*;
use crate::metrics::RankingMetrics;

fn records(n: u64) -> Vec<Record> {
    let mut out = Vec::new();
    for i in 1..=n {
        out.push(Record::Step(StepRecord {
            step: i,
            epoch: 0,
            loss: 1.0 / i as f64,
            learning_rate: 1e-3,
            gradient_norm: f64::NAN,
            samples: 8,
            seconds: 0.1,
            wait_seconds: 0.0,
        }));
    }
    out.push(Record::Epoch(EpochRecord {
        step: n,
        epoch: 0,
        train_loss: 0.5,
        valid_loss: 0.4,
        valid: RankingMetrics { decisions: 10, regret: 0.01, random_regret: 0.04, ..Default::default() },
        best: true,
        learning_rate: 1e-3,
        seconds: 3.0,
        samples_per_second: 12.0,
    }));
    out.push(Record::Message { step: n, text: "a <script> & more".into() });
    out
}

#[test]
fn the_page_is_self_contained_and_reloads_until_done() {
    let page = render("run <1>", &records(20), Some(1220));
    assert!(page.contains("<svg") && page.contains("http-equiv=\"refresh\""));
    assert!(page.contains("Step 20 of 1220, about 2 min left") && page.contains("smoothed"));
    assert!(page.contains("0.250"), "the relative regret");
    assert!(page.contains("a &lt;script&gt; &amp; more") && page.contains("run &lt;1&gt;"));
    assert!(!page.contains("<script") && !page.contains("src=") && !page.contains("href="));
    assert!(!page.contains("Gradient norm"), "a curve without a finite point is left out");
    assert!(!render("run", &records(20), None).contains("http-equiv"));
    assert!(render("empty", &[], Some(7)).contains("</html>"));
}

#[test]
fn a_long_run_keeps_a_small_page() {
    assert!(render("long", &records(50_000), Some(60_000)).len() < 400_000);
}
