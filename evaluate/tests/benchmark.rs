//! The whole path on a small object: paired starts, ranking, determinism, resumption.

use datagen::EpisodeConfig;
#[cfg(feature = "networks")]
use datagen::Scene;
use datagen::dataset::DatasetName;
use evaluate::batches::{self, Outcome, Watch};
use evaluate::benchmark::{episode, run};
use evaluate::config::EvaluateConfig;
use evaluate::journal::{Contents, Journal};
use evaluate::metrics::{Figure, Runs, efficiency};
use evaluate::networks::Networks;
use evaluate::objects::{Object, ObjectError, prepare};
#[cfg(feature = "networks")]
use evaluate::policies::weights_of;
use evaluate::policies::{Policy, PolicyContext, check, make};
use evaluate::record::{EpisodeKey, EpisodeRecord};
use evaluate::report;
use geometry::{Mesh, View};
use nalgebra::Point3;
use planning::{PlanError, Planner, RankedView, ScanState};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A ball with lobes: no view sees more than a part of it.
fn lobed_ball(amplitude: f64) -> Mesh {
    let (rings, sectors) = (60u32, 90u32);
    let at = |ring: u32, sector: u32| {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
        let azimuth = std::f64::consts::TAU * f64::from(sector % sectors) / f64::from(sectors);
        let radius = 1.0 + amplitude * polar.sin() * (5.0 * azimuth).cos();
        Point3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), 1.3 * polar.cos()) * radius
    };
    let mut mesh = Mesh::default();
    for ring in 0..=rings {
        mesh.vertices.extend((0..sectors).map(|sector| at(ring, sector)));
    }
    for ring in 0..rings {
        for sector in 0..sectors {
            let id = |r: u32, s: u32| (ring + r) * sectors + (sector + s) % sectors;
            mesh.triangles.push([id(0, 0), id(1, 0), id(1, 1)]);
            mesh.triangles.push([id(0, 0), id(1, 1), id(0, 1)]);
        }
    }
    mesh
}

fn config(episodes: usize) -> EvaluateConfig {
    let episode = EpisodeConfig { num_views: 8, ..EpisodeConfig::default() };
    EvaluateConfig { episodes, surface_samples: 8_000, resamples: 100, episode, ..EvaluateConfig::default() }
}

fn objects(config: &EvaluateConfig) -> Vec<Object> {
    [("lobes", 0.35), ("ball", 0.1)]
        .map(|(name, amplitude)| prepare(name, None, &lobed_ball(amplitude), config).expect("a good mesh"))
        .into_iter()
        .collect()
}

fn named(name: &str) -> Policy {
    name.parse().unwrap_or_else(|e| panic!("{e}"))
}

/// Deliberately worse than any: scans again from where it stands.
struct StayPlanner;

impl Planner for StayPlanner {
    fn name(&self) -> &str {
        "stay"
    }

    fn rank_views(&mut self, state: &ScanState, _rng: &mut ChaCha8Rng) -> Result<Vec<RankedView>, PlanError> {
        let position = Point3::from(state.scans[0].world_from_camera.translation.vector);
        let view = View { target: Point3::origin(), position };
        Ok(vec![RankedView::scored(view, 0.0)])
    }
}

#[test]
fn a_worse_policy_ranks_last_and_the_search_first() {
    let config = config(4);
    let networks = Networks::new(&config);
    let objects = objects(&config);
    let mut records: Vec<EpisodeRecord> = Vec::new();
    for object in &objects {
        let mesh = object.mesh().expect("a mesh");
        let context =
            PolicyContext { scene: &mesh.scene, samples: &mesh.samples, config: &config, networks: &networks };
        for number in 0..config.episodes {
            for policy in ["stay", "random-sphere", "benbv"] {
                let mut planner = if policy == "stay" {
                    Box::new(StayPlanner)
                } else {
                    make(&named(policy), &context).expect(policy)
                };
                let outcome =
                    episode(&object.name, mesh, planner.as_mut(), number, &config, |_| {}).expect("a good start");
                let key = EpisodeKey { object: object.name.clone(), policy: policy.to_owned(), episode: number };
                records.push(EpisodeRecord::new(key, &outcome));
            }
        }
    }
    let rank = |policy: &str| {
        let runs = Runs::of(&records, policy);
        let mean = |f| runs.column(f, config.views_if_unreached()).mean();
        efficiency(mean(Figure::FinalCoverage), mean(Figure::ViewsTo(90))).expect("episodes")
    };
    let (stay, random, search) = (rank("stay"), rank("random-sphere"), rank("benbv"));
    assert!(stay < random && random < search, "stay {stay}, random {random}, search {search}");
    for triple in records.chunks(3) {
        assert!(triple.iter().all(|r| r.views[0] == triple[0].views[0]), "every policy starts from the same view");
        assert!(triple.iter().all(|r| r.coverages[0] == triple[0].coverages[0]));
    }
}

fn run_into(
    directory: &Path,
    objects: &[Object],
    config: &EvaluateConfig,
    policies: &[Policy],
    threads: usize,
    stop: &AtomicBool,
) -> Contents {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let hash = config.outcome_hash().expect("hash");
    let (journal, mut contents) = Journal::open(directory, &hash, &hash).expect("journal");
    let networks = Networks::new(config);
    pool.install(|| run(objects, policies, config, &networks, &journal, &mut contents, stop, |_| {})).expect("run");
    contents
}

#[test]
fn outputs_do_not_depend_on_threads_nor_on_a_stop_in_between() {
    let config = config(2);
    let objects = objects(&config);
    let policies = ["benbv", "random-u-sphere", "see", "farthest:60", "oracle:33"].map(named);
    let names: Vec<String> = policies.iter().map(Policy::to_string).collect();
    let (one, two) = (tempfile::tempdir().expect("dir"), tempfile::tempdir().expect("dir"));
    let never = AtomicBool::new(false);
    let straight = run_into(one.path(), &objects, &config, &policies, 1, &never);
    // The other run is first made with one object, then its last line is cut off, then it resumes with two threads.
    run_into(two.path(), &objects[..1], &config, &policies, 2, &never);
    let journal = two.path().join("journal.jsonl");
    let text = std::fs::read_to_string(&journal).expect("journal");
    std::fs::write(&journal, &text[..text.len() - 40]).expect("cut");
    let resumed = run_into(two.path(), &objects, &config, &policies, 2, &never);
    assert_eq!(straight.episodes.len(), 2 * 2 * policies.len());
    for (directory, contents) in [(&one, &straight), (&two, &resumed)] {
        report::write(directory.path(), contents, &config, &names, &objects, &report::Missing::default())
            .expect("written");
    }
    for file in [
        "episodes.jsonl",
        "views.jsonl",
        "views.csv",
        "policies.csv",
        "paired.csv",
        "summary.csv",
        "report.md",
        "report.html",
    ] {
        let read = |d: &tempfile::TempDir| std::fs::read(d.path().join(file)).expect(file);
        assert!(read(&one) == read(&two), "{file} differs");
        assert!(!read(&one).is_empty());
    }
    let html = std::fs::read_to_string(one.path().join("report.html")).expect("page");
    assert!(
        html.contains("<svg") && html.contains("getContext(\"webgl\"") && !html.contains("http://")
            || html.contains("www.w3.org")
    );
    assert!(!html.contains("src=\"http"), "the page needs nothing else");
}

#[test]
fn a_stopped_run_keeps_what_it_has() {
    let config = config(2);
    let objects = objects(&config);
    let directory = tempfile::tempdir().expect("dir");
    let stopped = run_into(directory.path(), &objects, &config, &[named("random-33")], 1, &AtomicBool::new(true));
    assert!(stopped.episodes.is_empty());
    let whole = run_into(directory.path(), &objects, &config, &[named("random-33")], 1, &AtomicBool::new(false));
    assert_eq!(whole.episodes.len(), 4);
}

#[test]
fn shifted_references_see_other_samples() {
    let config = EvaluateConfig { episode: EpisodeConfig { num_views: 1, ..config(1).episode }, ..config(1) };
    let networks = Networks::new(&config);
    let object = &objects(&config)[0];
    let mesh = object.mesh().expect("a mesh");
    let context = PolicyContext { scene: &mesh.scene, samples: &mesh.samples, config: &config, networks: &networks };
    let gains = |policy: &str| {
        let mut planner = make(&named(policy), &context).expect(policy);
        let mut gains = Vec::new();
        let keep = |d: &datagen::Decision| gains.extend(d.ranked.iter().filter_map(|r| r.gain));
        episode(&object.name, mesh, planner.as_mut(), 0, &config, keep).expect("an episode");
        gains.sort_by(f64::total_cmp);
        gains
    };
    for (exact, shifted) in [("benbv", "benbv:shifted"), ("volumetric:true", "volumetric:shifted")] {
        let (exact, shifted) = (gains(exact), gains(shifted));
        assert_ne!(exact, shifted);
        let near = exact.iter().zip(&shifted).all(|(a, b)| (a - b).abs() < 0.02);
        assert!(near && exact.len() == shifted.len() && exact.len() > 10, "{exact:?} {shifted:?}");
    }
}

#[cfg(feature = "networks")]
#[test]
fn the_network_of_the_published_size_comes_with_the_source() {
    let config = config(1);
    let networks = Networks::new(&config);
    let weights = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights");
    let policy = format!("benbv-net:{}", weights.join("benbv-net-paper-scale").display());
    let scene = Scene::new(Mesh::default());
    make(&named(&policy), &PolicyContext { scene: &scene, samples: &[], config: &config, networks: &networks })
        .expect("loads");
    assert_ne!(weights_of(&named(&policy), &config, &networks), weights_of(&named("benbv-net"), &config, &networks));
    let size = |name: &str| std::fs::metadata(weights.join(name).join("model.safetensors")).expect("there").len();
    assert!(size("benbv-net") + size("benbv-net-paper-scale") < 24_000_000);
}

#[cfg(feature = "networks")]
#[test]
fn episodes_with_other_weights_do_not_count() {
    let config = EvaluateConfig { episode: EpisodeConfig { num_views: 1, ..config(1).episode }, ..config(1) };
    let networks = Networks::new(&config);
    let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/benbv-net");
    let copy = tempfile::tempdir().expect("dir");
    for file in ["checkpoint.toml", "model.safetensors"] {
        std::fs::copy(bundled.join(file), copy.path().join(file)).expect("copied");
    }
    let policy = format!("benbv-net:{}", copy.path().display());
    let of = |policy: &str| weights_of(&named(policy), &config, &networks);
    let before = of(&policy);
    assert_eq!((before.is_some(), &before), (true, &of("benbv-net")), "the same weights, wherever they lie");
    assert_eq!(of("volumetric"), None);
    let objects = &objects(&config)[..1];
    let directory = tempfile::tempdir().expect("dir");
    let policies = [named("benbv-net"), named(&policy)];
    let contents = run_into(directory.path(), objects, &config, &policies, 1, &AtomicBool::new(false));
    let records: Vec<&EpisodeRecord> = contents.episodes.iter().map(|(r, _)| r).collect();
    assert_eq!((records.len(), &records[0].views), (2, &records[1].views), "the same network chooses the same");
    assert!(records.iter().all(|r| r.weights == before));
    let weights = copy.path().join("model.safetensors");
    let mut bytes = std::fs::read(&weights).expect("read");
    *bytes.last_mut().expect("bytes") ^= 1;
    std::fs::write(&weights, bytes).expect("written");
    assert_ne!(of(&policy), before);
    let mut contents = evaluate::journal::read(directory.path()).expect("read");
    assert_eq!(contents.forget_other_weights("benbv-net", of("benbv-net").as_deref()), 0);
    assert_eq!(contents.forget_other_weights(&policy, of(&policy).as_deref()), 1);
    let missing = check(&named("benbv-net:no/such"), &config, &networks).expect_err("refused").to_string();
    assert!(missing.contains("no/such"), "{missing}");
}

#[cfg(feature = "networks")]
#[test]
fn an_episode_that_cannot_be_run_notes_its_weights() {
    let episode = EpisodeConfig { min_first_coverage: 1.0, max_draws: 1, ..config(1).episode };
    let config = EvaluateConfig { episode, ..config(1) };
    let directory = tempfile::tempdir().expect("dir");
    let policies = [named("benbv-net")];
    let stop = AtomicBool::new(false);
    let mut contents = run_into(directory.path(), &objects(&config)[..1], &config, &policies, 1, &stop);
    let weights = weights_of(&policies[0], &config, &Networks::new(&config));
    assert!(contents.skipped.len() == 1 && contents.skipped[0].weights == weights && weights.is_some());
    contents.forget_other_weights("benbv-net", weights.as_deref());
    assert_eq!(contents.skipped.len(), 1);
    contents.forget_other_weights("benbv-net", Some("retrained"));
    assert!(contents.skipped.is_empty(), "it is tried again");
}

#[test]
fn what_the_settings_cannot_make_is_found_without_an_object() {
    let config = config(1);
    let networks = Networks::new(&config);
    let message =
        |name: &str| check(&named(name), &config, &networks).err().unwrap_or_else(|| panic!("{name}")).to_string();
    for policy in ["benbv:7", "farthest:7", "oracle:7", "benbv:0"] {
        assert!(message(policy).contains("multiple"), "{}", message(policy));
    }
    assert!(message("volumetric:learned").contains("learn_forecasts"), "{}", message("volumetric:learned"));
    check(&named("benbv:60"), &config, &networks).expect("a multiple of three");
}

/// Counts episodes and asks to stop after so many.
struct StopAfter<'a>(usize, &'a AtomicBool, AtomicUsize);

impl Watch for StopAfter<'_> {
    fn done(&self, _key: &EpisodeKey) {
        if self.2.fetch_add(1, Ordering::SeqCst) + 1 == self.0 {
            self.1.store(true, Ordering::SeqCst);
        }
    }

    fn unusable(&self, _object: &str, _reason: &ObjectError) {}
}

/// Runs `random-33` on the built-in objects and these files, stopped after so many episodes.
fn run_batches(config: &EvaluateConfig, stop_after: usize) -> (Outcome, Contents) {
    let directory = tempfile::tempdir().expect("dir");
    let sources = evaluate::objects::list(config).expect("objects");
    let (journal, mut contents) = Journal::open(directory.path(), "h", "h").expect("journal");
    let networks = Networks::new(config);
    let stop = AtomicBool::new(false);
    let watch = StopAfter(stop_after, &stop, AtomicUsize::new(0));
    let policies = [named("random-33")];
    let outcome =
        batches::run(&sources, &policies, config, &networks, &journal, &mut contents, &stop, &watch).expect("run");
    (outcome, contents)
}

#[test]
fn asked_to_stop_after_the_last_episode_nothing_is_left() {
    let mut config = config(2);
    config.dataset.name = DatasetName::Procedural;
    config.dataset.objects = Some(2);
    config.surface_samples = 3_000;
    config.episode.num_views = 1;
    let (outcome, contents) = run_batches(&config, 4);
    assert_eq!((outcome.left, outcome.shown.len(), contents.episodes.len()), (0, 2, 4));
    assert_eq!(outcome.anything(&contents), Ok(()));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let (outcome, contents) = pool.install(|| run_batches(&config, 1));
    assert_eq!((outcome.left, outcome.asked, contents.episodes.len()), (3, 4, 1), "asked to stop before the last one");
}

#[test]
fn a_stopped_run_reports_what_it_has_and_resumes_to_the_same_bytes() {
    let mut config = config(2);
    config.dataset.name = DatasetName::Procedural;
    config.dataset.objects = Some(2);
    config.surface_samples = 3_000;
    config.episode.num_views = 1;
    let networks = Networks::new(&config);
    let folders = [tempfile::tempdir().expect("dir"), tempfile::tempdir().expect("dir")];
    let run = |folder: usize, stop_after: usize| {
        let stop = AtomicBool::new(false);
        let watch = StopAfter(stop_after, &stop, AtomicUsize::new(0));
        evaluate::run::run(folders[folder].path(), &[named("random-33")], &config, &networks, &stop, &watch)
            .expect("run")
    };
    let report = |folder: usize| std::fs::read_to_string(folders[folder].path().join("report.md")).expect("a report");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let stopped = pool.install(|| run(0, 1));
    assert!(matches!(stopped, evaluate::run::Ended::Stopped { done: 1, left: 3 }));
    let preliminary = report(0);
    let headline = "Preliminary report, unfinished: 3 of 4 episodes left. 1 episodes of 1 policies";
    assert!(preliminary.starts_with(&format!("# Results\n\n{headline}")), "{preliminary}");
    assert!(preliminary.contains("0 episodes could not be run."), "{preliminary}");
    let page = std::fs::read_to_string(folders[0].path().join("report.html")).expect("a page");
    assert!(page.contains(headline), "the page says so too");
    let compared = || report::folder::read(folders[0].path()).expect("a folder").unfinished;
    assert_eq!(compared().as_deref(), Some("unfinished: 3 of 4 episodes left"));
    run(0, usize::MAX);
    run(1, usize::MAX);
    assert_ne!(report(0), preliminary);
    assert_eq!(compared(), None);
    assert!(report(0).contains(", 0 episodes not run.") && !report(0).contains("unfinished"), "{}", report(0));
    assert_eq!(report(0), report(1), "the final report does not depend on the stop");
}

#[test]
fn a_run_without_any_usable_object_says_why() {
    let meshes = tempfile::tempdir().expect("dir");
    std::fs::write(meshes.path().join("empty.off"), "OFF\n0 0 0\n").expect("written");
    std::fs::write(meshes.path().join("broken.off"), "OFF\n3 1 0\n0 0\n").expect("written");
    let mut config = config(1);
    config.dataset.name = DatasetName::Folder;
    config.dataset.root = Some(meshes.path().to_owned());
    let (outcome, contents) = run_batches(&config, usize::MAX);
    assert_eq!((outcome.left, outcome.unusable.len()), (0, 2));
    let message = outcome.anything(&contents).expect_err("nothing ran").to_string();
    assert!(message.contains("empty: ") && message.contains("broken: "), "{message}");
}
