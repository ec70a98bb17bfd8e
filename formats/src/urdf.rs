//! Arms from URDF: the chain of joints from the root to a link, with the collision geometry of its links. A reader of our own for the few
//! elements that matter: what reads all of URDF brings an XML library and a serialiser with it.

mod mesh;
mod xml;

use crate::{FormatError, Place, text};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use planning::reach::{Arm, Joint, JointKind, Link, balls_of_box, balls_of_cylinder, balls_of_mesh};
use std::path::Path;
use xml::Element;

/// An arm as its file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct UrdfArm {
    /// From the root to the tool.
    pub arm: Arm,
    /// What a user should know: geometry that is not read.
    pub notes: Vec<String>,
}

const EXPECTED: &str = "a URDF: <robot> with <link> and <joint>";

/// Reads the arm that ends in the link `tool`.
///
/// # Errors
/// A file that cannot be read, is no URDF, or has no serial chain of known joints to that link.
pub fn read_urdf(path: &Path, tool: &str) -> Result<UrdfArm, FormatError> {
    parse_urdf(path, &crate::file::read(path)?, tool)
}

/// [`read_urdf`] on bytes at hand; `path` stands in the errors.
///
/// # Errors
/// As [`read_urdf`].
pub fn parse_urdf(path: &Path, bytes: &[u8], tool: &str) -> Result<UrdfArm, FormatError> {
    let text = text::decode(bytes);
    let root =
        xml::parse(&text).map_err(|(line, found)| FormatError::syntax(path, Place::Line(line), found, EXPECTED))?;
    if root.has_name("xacro:") {
        return Err(FormatError::syntax(path, Place::File, "xacro macros", "a plain URDF: run xacro on it first"));
    }
    if root.name != "robot" {
        return Err(FormatError::syntax(path, Place::File, format!("<{}>", root.name), EXPECTED));
    }
    let links: Vec<&Element> = root.children_named("link").collect();
    let joints: Vec<&Element> = root.children_named("joint").collect();
    let wrong = |element: &Element, found: String, expected: &str| {
        let name = element.attribute("name").unwrap_or_default();
        FormatError::syntax(path, Place::Part(format!("{} {name:?}", element.name)), found, expected)
    };
    let names = || links.iter().filter_map(|l| l.attribute("name")).collect::<Vec<_>>().join(", ");
    if !links.iter().any(|l| l.attribute("name") == Some(tool)) {
        let found = format!("no link {tool:?}");
        return Err(FormatError::syntax(path, Place::File, found, format!("one of its links: {}", names())));
    }
    let mut notes = Vec::new();
    let mut link = |name: &str| -> Result<Link, FormatError> {
        let mut named = links.iter().filter(|l| l.attribute("name") == Some(name));
        let Some(element) = named.next().filter(|_| named.next().is_none()) else {
            let found = format!("no link {name:?}, or more than one");
            return Err(FormatError::syntax(path, Place::File, found, "every link that a joint names, once"));
        };
        let mut balls_m = Vec::new();
        for collision in element.children_named("collision") {
            let shape = collision.child("geometry").and_then(|g| g.children.first());
            let Some(shape) = shape else {
                return Err(wrong(element, "no geometry".into(), "box, cylinder, capsule, sphere"));
            };
            let number = |key: &str| {
                let value = shape.attribute(key).and_then(|t| text::number(t.trim()));
                value
                    .filter(|x| x.is_finite() && *x >= 0.0)
                    .ok_or_else(|| wrong(element, format!("{} without {key}", shape.name), "a length in metres"))
            };
            let balls = match shape.name.as_str() {
                "sphere" => vec![[0.0, 0.0, 0.0, number("radius")?]],
                "cylinder" => balls_of_cylinder(number("radius")?, number("length")?),
                "capsule" => balls_of_cylinder(number("radius")?, number("length")? + 2.0 * number("radius")?),
                "box" => {
                    let [x, y, z] = triple(shape.attribute("size"))
                        .ok_or_else(|| wrong(element, "box without size".into(), "x y z"))?;
                    balls_of_box(&[[-0.5 * x, -0.5 * y, -0.5 * z], [0.5 * x, 0.5 * y, 0.5 * z]])
                }
                "mesh" => match mesh::collision_mesh(path, shape) {
                    Ok((mesh, note)) => {
                        notes.extend(note.map(|note| format!("link {name}: {note}")));
                        balls_of_mesh(&mesh)
                    }
                    Err(why) => {
                        notes.push(format!("link {name}: {why}; collisions of this link are not checked"));
                        continue;
                    }
                },
                other => return Err(wrong(element, format!("<{other}>"), "box, cylinder, capsule, sphere")),
            };
            let frame = origin(collision).map_err(|found| wrong(element, found, "numbers"))?;
            balls_m.extend(balls.into_iter().map(|[x, y, z, r]| {
                let p = frame * Point3::new(x, y, z);
                [p.x, p.y, p.z, r]
            }));
        }
        Ok(Link { name: name.to_owned(), balls_m })
    };
    // From the tool back to the root.
    let mut chain = Vec::new();
    let mut at = tool.to_owned();
    let before = |link: &str| {
        let moves = |joint: &&&Element| joint.child("child").and_then(|c| c.attribute("link")) == Some(link);
        let mut moving = joints.iter().filter(moves);
        (moving.next(), moving.next())
    };
    while let (Some(joint), other) = before(&at) {
        if let Some(other) = other {
            return Err(wrong(other, format!("a second joint that moves link {at:?}"), "one joint before each link"));
        }
        if chain.len() > joints.len() {
            return Err(wrong(joint, "a chain that closes".into(), "a tree of links"));
        }
        let parent = joint.child("parent").and_then(|p| p.attribute("link"));
        let parent = parent.ok_or_else(|| wrong(joint, "no parent".into(), "<parent link=...>"))?.to_owned();
        let kind = match joint.attribute("type") {
            Some("fixed") => JointKind::Fixed,
            Some("revolute" | "continuous") => JointKind::Revolute,
            Some("prismatic") => JointKind::Prismatic,
            other => {
                let found = format!("type {:?}", other.unwrap_or_default());
                return Err(wrong(joint, found, "fixed, revolute, continuous or prismatic"));
            }
        };
        if let Some(mimic) = joint.child("mimic").and_then(|m| m.attribute("joint")) {
            return Err(wrong(joint, format!("it follows joint {mimic}"), "an independent joint"));
        }
        let frame = joint.child("origin");
        let part = |key| match frame.and_then(|o| o.attribute(key)) {
            None => Ok([0.0; 3]),
            Some(text) => triple(Some(text)).ok_or_else(|| wrong(joint, format!("{key} {text:?}"), "three numbers")),
        };
        let axis = match joint.child("axis").map(|a| triple(a.attribute("xyz"))) {
            None => [1.0, 0.0, 0.0],
            // Exporters give a joint that does not move an axis of zeros.
            _ if kind == JointKind::Fixed => [1.0, 0.0, 0.0],
            Some(Some(axis)) if axis.iter().any(|x| *x != 0.0) => axis,
            _ => return Err(wrong(joint, "an axis that is none".into(), "three numbers, not all zero")),
        };
        let limit =
            |key: &str| joint.child("limit").and_then(|l| l.attribute(key)).and_then(|t| text::number(t.trim()));
        let limits = match (kind, joint.attribute("type")) {
            (JointKind::Fixed, _) => [0.0, 0.0],
            (_, Some("continuous")) => [-std::f64::consts::PI, std::f64::consts::PI],
            _ => match (limit("lower"), limit("upper")) {
                (Some(low), Some(high)) if low <= high => [low, high],
                (Some(low), Some(high)) => {
                    return Err(wrong(joint, format!("limits {low} to {high}"), "lower not above upper"));
                }
                _ => return Err(wrong(joint, "no limits".into(), "<limit lower=... upper=...>, two numbers")),
            },
        };
        let name = joint.attribute("name").unwrap_or_default().to_owned();
        chain.push(Joint { name, kind, xyz_m: part("xyz")?, rpy_rad: part("rpy")?, axis, limits, link: link(&at)? });
        at = parent;
    }
    chain.reverse();
    let base = link(&at)?;
    if !chain.iter().any(|j| j.kind != JointKind::Fixed) {
        let found = format!("no joint that moves between {at:?} and {tool:?}");
        return Err(FormatError::syntax(path, Place::File, found, "the arm's last link as the tool"));
    }
    Ok(UrdfArm { arm: Arm { base, joints: chain }, notes })
}

fn triple(text: Option<&str>) -> Option<[f64; 3]> {
    let numbers: Option<Vec<f64>> = text?.split_whitespace().map(text::number).collect();
    numbers?.try_into().ok().filter(|v: &[f64; 3]| v.iter().all(|x| x.is_finite()))
}

fn origin(element: &Element) -> Result<Isometry3<f64>, String> {
    let Some(origin) = element.child("origin") else { return Ok(Isometry3::identity()) };
    let part = |key| match origin.attribute(key) {
        None => Ok([0.0; 3]),
        Some(text) => triple(Some(text)).ok_or_else(|| format!("{key} {text:?}")),
    };
    let ([x, y, z], [roll, pitch, yaw]) = (part("xyz")?, part("rpy")?);
    Ok(Isometry3::from_parts(Vector3::new(x, y, z).into(), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

#[cfg(test)]
mod tests;
