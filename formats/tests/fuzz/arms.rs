//! Arms (URDF).

use crate::harness::fuzz;
use formats::urdf::parse_urdf;
use nalgebra::Isometry3;
use planning::reach::Obstacles;
use planning::{Reach, RobotConfig};
use std::path::Path;

/// Through the settings' check to joint values.
#[test]
fn arms() {
    let robots = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../samples/robots"));
    let tools = [("ur5e.urdf", "tool0"), ("panda.urdf", "panda_link8"), ("six_axis.urdf", "flange")];
    let tool = |path: &Path| tools.iter().find(|(name, _)| path.ends_with(name)).map_or("tool0", |(_, tool)| tool);
    let seeds: Vec<_> = tools
        .iter()
        .map(|(name, _)| (robots.join(name), std::fs::read(robots.join(name)).expect("a sample")))
        .collect();
    fuzz("arms", &seeds, |path, bytes| {
        let Ok(read) = parse_urdf(path, bytes, tool(path)) else { return false };
        let pose = Isometry3::translation(0.3, 0.1, 0.4);
        let hand_eye = planning::pose::Pose::from(&Isometry3::identity()).matrix;
        let robot = RobotConfig { arm: read.arm, flange_from_camera: Some(hand_eye), ..RobotConfig::default() };
        if robot.check().is_err() {
            return true;
        }
        let reach = Reach::new(&robot);
        let nothing = Obstacles { measured: None, expected: None, boxes: &[], floor: None };
        if let Ok(reached) = reach.to(&pose, &nothing, &Isometry3::identity()) {
            assert!(reached.joints.iter().all(|joint| joint.value.is_finite()), "{reached:?}");
        }
        true
    });
}
