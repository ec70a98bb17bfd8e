//! A plan of several views against what they bring: executed in the simulator, with parry's rays to count what each is the first to see.

mod rays;

use datagen::{RenderConfig, RenderScratch, Scene};
use geometry::sampling::sample_surface;
use geometry::{View, rng};
use nalgebra::{Isometry3, Point3, Vector3};
use planning::pose::rigid;
use planning::session::PlannedView;
use planning::{NoReturn, Scan, Session, SessionConfig};

const SAMPLES: usize = 20_000;
const VIEWS: usize = 6;
const OBJECTS: u64 = 10;

/// What the views of a plan are said to add and what they do, and what is said to be left and is, as shares of the whole surface.
#[derive(Default)]
struct Account {
    views: [[f64; 2]; VIEWS],
    left: [f64; 2],
}

/// A plan of an object after so many scans, carried out.
fn carry_out(object: u64, distance: f64, scans: usize, account: &mut Account) {
    let mesh = datagen::procedural::mesh(object, 0).normalized(0.2);
    let samples = sample_surface(&mesh, SAMPLES, &mut rng::stream(1, "samples"));
    let surface = rays::surface(&mesh);
    let scene = Scene::new(mesh);
    let config = SessionConfig { working_distance_m: distance, ..SessionConfig::default() };
    let camera = config.camera.camera();
    let mut session = Session::new(config, None).expect("settings in range");
    let mut known = vec![false; SAMPLES];
    let mut add = |session: &mut Session, pose: &Isometry3<f64>| {
        let depth = scene.render(&camera, pose, &RenderConfig::default(), &mut RenderScratch::default()).clone();
        let scan = Scan::Depth { camera, depth, world_from_camera: *pose, misses: NoReturn::Free };
        session.add_scan(scan).expect("a scan");
        let shown = rays::seen(&surface, &samples, &Point3::from(pose.translation.vector));
        let new = known.iter().zip(&shown).filter(|(known, shown)| **shown && !**known).count();
        known.iter_mut().zip(shown).for_each(|(known, shown)| *known |= shown);
        new as f64 / SAMPLES as f64
    };
    let eye = Point3::from(distance * Vector3::new(0.7, 0.5, 0.6).normalize());
    let mut pose = View { target: Point3::origin(), position: eye }.world_from_camera();
    let mut covered = 0.0;
    for _ in 1..scans {
        covered += add(&mut session, &pose);
        let next = session.next_view().expect("an answer").next.expect("a view");
        pose = rigid(&next.world_from_camera.matrix).expect("a pose").0;
    }
    covered += add(&mut session, &pose);
    let answer = session.next_view().expect("an answer");
    let plan = session.scan_plan(&answer, VIEWS, None).expect("a plan");
    let mut views: Vec<&PlannedView> = plan.views.iter().collect();
    views.sort_by_key(|view| view.chosen);
    for planned in views {
        let new = add(&mut session, &rigid(&planned.view.world_from_camera.matrix).expect("a pose").0);
        covered += new;
        let [said, does] = &mut account.views[planned.chosen];
        (*said, *does) = (*said + planned.adds, *does + new);
    }
    account.left[0] += plan.leaves;
    account.left[1] += 1.0 - covered;
}

#[test]
fn a_plan_adds_about_what_it_says() {
    for (distance, scans, [least, most]) in
        [(0.45, 1, [0.8, 1.1]), (1.2, 1, [0.8, 1.1]), (1.2, 2, [0.85, 1.15]), (0.45, 4, [0.5, 1.1])]
    {
        let mut account = Account::default();
        (0..OBJECTS).for_each(|object| carry_out(object, distance, scans, &mut account));
        let sum = |k: usize| account.views.iter().map(|view| view[k]).sum::<f64>();
        let each = 100.0 / OBJECTS as f64;
        let views: Vec<String> =
            account.views.iter().map(|[said, does]| format!("{:.1}/{:.1}", each * said, each * does)).collect();
        let ratio = sum(0) / sum(1);
        println!(
            "{distance} m, after {scans} scans: said/true {ratio:.2}, view by view {} %; left {:.1}/{:.1} %",
            views.join(" "),
            each * account.left[0],
            each * account.left[1]
        );
        assert!((least..most).contains(&ratio), "{distance} m, after {scans} scans: {ratio}");
        // View by view, where there is much to add still.
        for [said, does] in account.views.into_iter().filter(|view| view[1] > 0.02 * OBJECTS as f64) {
            assert!((0.45..1.6).contains(&(said / does)), "{distance} m, after {scans} scans: {said} of {does}");
        }
    }
}
