use super::*;

/// A view at `position` of the origin.
fn from(position: [f64; 3]) -> View {
    View { target: Point3::origin(), position: Point3::from(position) }
}

/// Which of the constraints objects to each of these views.
fn objected(config: &ConstraintsConfig, views: &[[f64; 3]], known: &Surroundings) -> Vec<Vec<Constraint>> {
    config.check().expect("a valid configuration");
    let constraints = |v: &[f64; 3]| config.objections(&from(*v), Some(0.25), known);
    views.iter().map(|v| constraints(v).iter().map(|o| o.constraint).collect()).collect()
}

fn sphere(radius: f64) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    // Fibonacci sphere.
    let count = 4000;
    let normals: Vec<Vector3<f64>> = (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let turn = i as f64 * 2.399_963_229_728_653;
            Vector3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z)
        })
        .collect();
    (normals.iter().map(|n| Point3::from(n * radius)).collect(), normals)
}

#[test]
fn nothing_objects_by_default() {
    let known = Surroundings { current: Some(Point3::origin()), ..Default::default() };
    let views = [[0.0, 0.0, -9.0], [1e-9, 0.0, 0.0], [50.0, 0.0, 0.0]];
    assert!(objected(&Default::default(), &views, &known).iter().all(Vec::is_empty), "off by default");
}

#[test]
fn each_limit_rules_out_its_own_view() {
    use Constraint as C;
    let default = || ConstraintsConfig { clearance_m: Some(0.0), ..ConstraintsConfig::default() };
    let (points, normals) = sphere(1.0);
    let spacing = (4.0 * std::f64::consts::PI / 4000.0f64).sqrt();
    let known = Surroundings {
        bounds: [Point3::new(-1.0, -1.0, -1.0), Point3::new(1.0, 1.0, 1.0)],
        points: &points,
        normals: &normals,
        spacing,
        current: Some(Point3::new(2.0, 0.0, 0.0)),
        visited: vec![Point3::new(0.0, 2.0, 0.0)],
    };
    // Setting, a view that stays, a view that goes, the constraint that says so.
    let cases = [
        (
            ConstraintsConfig { workspace_m: Some([[0.0; 3], [2.0; 3]]), ..default() },
            [1., 1., 1.],
            [1., 1., -1.],
            C::Workspace,
        ),
        (ConstraintsConfig { floor_height_m: Some(0.5), ..default() }, [2., 0., 0.6], [2., 0., 0.4], C::Floor),
        (
            ConstraintsConfig { up: [0., 1., 0.], floor_height_m: Some(0.5), ..default() },
            [2., 0.6, 0.],
            [2., 0.4, 9.],
            C::Floor,
        ),
        (
            ConstraintsConfig { keep_out_m: vec![[[0.0; 3], [1.0; 3]]], ..default() },
            [1., 1., 1.1],
            [1., 1., 0.9],
            C::KeepOut,
        ),
        (ConstraintsConfig { min_tilt_deg: Some(10.0), ..default() }, [1., 0., 1.], [1., 0., 0.], C::Tilt),
        (ConstraintsConfig { max_tilt_deg: Some(60.0), ..default() }, [1., 0., 1.], [0.1, 0., 2.], C::Tilt),
        (ConstraintsConfig { max_travel_m: Some(1.0), ..default() }, [2.5, 0., 0.], [-2., 0., 0.], C::Travel),
        (ConstraintsConfig { visited_radius_m: Some(0.5), ..default() }, [2., 0., 0.], [0.1, 2., 0.], C::Visited),
        (ConstraintsConfig { clearance_m: Some(0.2), ..default() }, [1.3, 0., 0.], [1.1, 0., 0.], C::Clearance),
        (ConstraintsConfig { clearance_m: Some(0.2), ..default() }, [0., 0., 1.3], [0.1, 0., 0.], C::Clearance),
    ];
    for (config, stays, goes, expected) in cases {
        assert_eq!(objected(&config, &[stays, goes], &known), vec![vec![], vec![expected]], "{config:?}");
    }
    let strict = ConstraintsConfig { min_overlap: 0.3, ..default() };
    assert_eq!(objected(&strict, &[[2.0, 0.0, 0.0]], &known), vec![vec![C::Overlap]], "0.25 expected, 0.3 required");
    let lax = ConstraintsConfig { min_overlap: 0.2, ..default() };
    assert_eq!(objected(&lax, &[[2.0, 0.0, 0.0]], &known), vec![vec![]], "0.25 expected, 0.2 required");
}

#[test]
fn winding_number_is_one_inside_and_zero_outside() {
    let (points, normals) = sphere(1.0);
    let spacing = (4.0 * std::f64::consts::PI / 4000.0f64).sqrt();
    let known = Surroundings { points: &points, normals: &normals, spacing, ..Default::default() };
    for radius in [0.0, 0.5, 0.8] {
        let winding = known.near(&Point3::new(0.0, radius, 0.0)).1;
        assert!((winding - 1.0).abs() < 0.01, "inside at {radius}: {winding}");
    }
    for radius in [1.2, 3.0] {
        assert!(known.near(&Point3::new(radius, 0.0, 0.0)).1.abs() < 0.01, "outside at {radius}");
    }
    let inward: Vec<_> = normals.iter().map(|n| -n).collect();
    let room = Surroundings { normals: &inward, ..known };
    assert!(room.near(&Point3::origin()).1 < -0.9, "in a room, whose walls face the camera, one may stand");
}

#[test]
fn travel_costs_by_the_metre() {
    let config = ConstraintsConfig { travel_weight_per_m: 0.5, ..Default::default() };
    let known = Surroundings { current: Some(Point3::new(1.0, 0.0, 0.0)), ..Default::default() };
    assert_eq!(config.travel_cost(&from([3.0, 0.0, 0.0]), &known), 1.0, "two metres at 0.5");
    assert_eq!(config.travel_cost(&from([3.0, 0.0, 0.0]), &Default::default()), 0.0, "unknown start");
}

#[test]
fn exclusions_tell_apart_what_is_excluded_once() {
    let objection = |constraint| Objection { constraint, reason: String::new() };
    let floor = [objection(Constraint::Floor)];
    let both = [objection(Constraint::Floor), objection(Constraint::Tilt)];
    let counts = count_exclusions([&floor[..], &both[..], &[]]);
    assert_eq!(
        counts,
        vec![
            Exclusion { constraint: Constraint::Floor, candidates: 2, alone: 1 },
            Exclusion { constraint: Constraint::Tilt, candidates: 1, alone: 0 },
        ],
        "the floor objects to two, to one of them alone"
    );
}
