//! The kinds of solids: vessels, brackets, figures, knots, wheels, frames, furniture, and random assemblies.
//! Lengths are in the cube from -1 to 1, whose cells are 0.03 wide: walls are kept thicker than two cells.

use super::solid::{Solid, union_of};
use nalgebra::{Rotation3, Unit, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Draws a solid of any kind, upright, and a turn that leaves it standing or lays it in any way.
pub(super) fn draw(rng: &mut ChaCha8Rng) -> (Solid, Rotation3<f64>) {
    let solid = match rng.random_range(0..8) {
        0 => vessel(rng),
        1 => bracket(rng),
        2 => figure(rng),
        3 => knot(rng),
        4 => wheel(rng),
        5 => frame(rng),
        6 => furniture(rng),
        _ => assembly(rng),
    };
    let turn = if rng.random() {
        Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..TAU))
    } else {
        any_rotation(rng)
    };
    (solid, turn)
}

fn direction(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    let z: f64 = rng.random_range(-1.0..1.0);
    let angle: f64 = rng.random_range(0.0..TAU);
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

fn any_rotation(rng: &mut ChaCha8Rng) -> Rotation3<f64> {
    let axis = Unit::new_normalize(direction(rng));
    Rotation3::from_axis_angle(&axis, rng.random_range(0.0..TAU))
}

fn on_circle(angle: f64, radius: f64, z: f64) -> [f64; 3] {
    [radius * angle.cos(), radius * angle.sin(), z]
}

/// Mug, vase, bowl, jug, pot: a hollow body of revolution, perhaps with handles, a spout, a foot, a knobbed lid.
fn vessel(rng: &mut ChaCha8Rng) -> Solid {
    let height = rng.random_range(0.3..0.65);
    let radius = rng.random_range(0.25..0.5);
    let wall = rng.random_range(0.07..0.1);
    let mut outer =
        Solid::cone([0.0; 3], 2, radius * rng.random_range(0.6..1.1), radius * rng.random_range(0.6..1.1), height);
    if rng.random_bool(0.6) {
        let belly = [0.0, 0.0, rng.random_range(-0.6..0.2) * height];
        let wide = radius * rng.random_range(0.9..1.25);
        outer = outer.blend(Solid::ellipsoid(belly, [wide, wide, height * rng.random_range(0.4..0.7)]), 0.15);
    }
    let floor = -height + wall * rng.random_range(1.0..2.5);
    // Open through the top plane.
    let cavity = outer.clone().grown(-wall).intersect(Solid::below(2, floor).complement());
    let open = Solid::cylinder([0.0, 0.0, height], 2, radius * 0.5, 0.2);
    let cavity = cavity.blend(open.intersect(Solid::below(2, floor).complement()), 0.05);
    let mut body = outer;
    let first = rng.random_range(0.0..TAU);
    let handles = rng.random_range(0..3);
    for k in 0..handles {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), first + TAU * f64::from(k) / f64::from(handles));
        let (major, minor) = (height * rng.random_range(0.35..0.55), rng.random_range(0.05..0.08));
        let ring = Solid::torus([radius, 0.0, rng.random_range(-0.2..0.2) * height], 1, major, minor);
        body = body.blend(ring.moved(&turn, [0.0; 3]), 0.06);
    }
    if rng.random_bool(0.3) {
        let angle = first + rng.random_range(1.0..2.2);
        let (from, to) = (on_circle(angle, radius * 0.5, -0.4 * height), on_circle(angle, radius + 0.35, height * 0.8));
        body = body.blend(Solid::limb(from, to, 0.15, 0.07), 0.08);
    }
    if rng.random_bool(0.35) {
        body = body.blend(Solid::cylinder([0.0, 0.0, -height], 2, radius * rng.random_range(0.8..1.2), 0.05), 0.05);
    }
    let mut vessel = body.subtract(cavity);
    if rng.random_bool(0.2) {
        let lid = Solid::ellipsoid([0.0, 0.0, height], [radius * 1.05, radius * 1.05, 0.14]);
        vessel = vessel.blend(lid, 0.03).blend(Solid::sphere([0.0, 0.0, height + 0.18], 0.09), 0.05);
    }
    vessel
}

/// Plates at right angles with ribs, bosses, holes and slots.
fn bracket(rng: &mut ChaCha8Rng) -> Solid {
    let (length, width) = (rng.random_range(0.4..0.7), rng.random_range(0.25..0.5));
    let thick = rng.random_range(0.04..0.08);
    let fillet = rng.random_range(0.0..0.1);
    let rounding = rng.random_range(0.0..0.03);
    let mut solid = Solid::cuboid([0.0, 0.0, -0.3], [length, width, thick], rounding);
    let height = rng.random_range(0.3..0.45);
    let upright = match rng.random_range(0..3) {
        0 => vec![-length + thick],
        1 => vec![rng.random_range(-0.3..0.3)],
        _ => vec![-length + thick, length - thick],
    };
    for x in upright {
        solid = solid.blend(Solid::cuboid([x, 0.0, height - 0.3], [thick, width, height], rounding), fillet);
        if rng.random_bool(0.7) {
            let hole = rng.random_range(0.08..0.6 * width.min(height));
            solid = solid.subtract(Solid::cylinder([x, 0.0, height - 0.2], 0, hole, 0.2));
        }
        if rng.random_bool(0.5) {
            let toward = if x > 0.0 { -1.0 } else { 1.0 };
            let rib = Solid::limb([x, 0.0, height], [x + toward * 0.5 * length, 0.0, -0.3], 0.05, 0.05);
            solid = solid.union(rib);
        }
    }
    for _ in 0..rng.random_range(1..4) {
        let at = [rng.random_range(-0.7..0.7) * length, rng.random_range(-0.6..0.6) * width, -0.3];
        if rng.random_bool(0.4) {
            solid = solid.blend(Solid::cylinder(at, 2, 0.16, rng.random_range(0.1..0.25)), 0.03);
        }
        solid = solid.subtract(Solid::cylinder(at, 2, rng.random_range(0.06..0.11), 0.5));
    }
    if rng.random_bool(0.4) {
        let at = [rng.random_range(-0.3..0.3), rng.random_range(-0.4..0.4) * width, -0.3];
        solid = solid.subtract(Solid::cuboid(at, [0.25, 0.05, 0.3], 0.05));
    }
    solid
}

/// A body of blended limbs: animal, person, plant.
fn figure(rng: &mut ChaCha8Rng) -> Solid {
    let radii = [rng.random_range(0.2..0.4), rng.random_range(0.14..0.25), rng.random_range(0.14..0.3)];
    let mut body = Solid::ellipsoid([0.0; 3], radii);
    for _ in 0..rng.random_range(4..8) {
        let outward = direction(rng);
        let on_body = Vector3::from_fn(|k, _| outward[k] * radii[k] * 0.8);
        let (length, thick) = (rng.random_range(0.2..0.4), rng.random_range(0.07..0.12));
        let knee = on_body + outward * length;
        let bend = (outward + direction(rng) * 0.9).normalize();
        let end = knee + bend * rng.random_range(0.1..0.35);
        let thin = thick * rng.random_range(0.55..0.9);
        body = body.blend(Solid::limb(on_body.into(), knee.into(), thick, thin), 0.08);
        body = body.blend(Solid::limb(knee.into(), end.into(), thin, thin.max(0.055)), 0.04);
        if rng.random_bool(0.4) {
            let size = rng.random_range(0.09..0.2);
            body = body.blend(Solid::ellipsoid(end.into(), [size, size * rng.random_range(0.6..1.0), size]), 0.06);
        }
    }
    if rng.random_bool(0.4) {
        let wing = Solid::ellipsoid([0.0; 3], [0.5, 0.25, 0.06]).moved(&any_rotation(rng), [0.0, 0.0, 0.1]);
        body = body.blend(wing, 0.05);
    }
    body
}

/// A closed tube: torus knot, or a loop that wanders, perhaps on a base.
fn knot(rng: &mut ChaCha8Rng) -> Solid {
    let (p, q) = [(2.0, 3.0), (3.0, 2.0), (1.0, 4.0), (2.0, 5.0), (1.0, 2.0), (1.0, 3.0)][rng.random_range(0..6)];
    let (major, minor) = (rng.random_range(0.4..0.52), rng.random_range(0.18..0.28));
    let thick = rng.random_range(0.07..0.11);
    let phase = rng.random_range(0.0..TAU);
    let at = |i: usize| {
        let t = TAU * i as f64 / 36.0;
        let ring = major + minor * (q * t + phase).cos();
        on_circle(p * t, ring, minor * 1.3 * (q * t + phase).sin())
    };
    let tube = (0..36).map(|i| Solid::limb(at(i), at((i + 1) % 36), thick, thick));
    let tube = union_of(tube).unwrap_or_else(|| Solid::sphere([0.0; 3], 0.5));
    if rng.random_bool(0.4) {
        return tube.blend(Solid::cylinder([0.0, 0.0, -0.45], 2, rng.random_range(0.4..0.65), 0.08), 0.06);
    }
    tube
}

/// Gear, pulley, spoked wheel or turbine with hub and bore.
fn wheel(rng: &mut ChaCha8Rng) -> Solid {
    let radius = rng.random_range(0.5..0.65);
    let half = rng.random_range(0.07..0.22);
    let hub = rng.random_range(0.14..0.22);
    let bore = hub * rng.random_range(0.4..0.6);
    let spokes = rng.random_range(3..8);
    let around = |k: i32, n: i32| Rotation3::from_axis_angle(&Vector3::z_axis(), TAU * f64::from(k) / f64::from(n));
    let mut solid = Solid::cylinder([0.0; 3], 2, hub, half * rng.random_range(1.0..2.0));
    match rng.random_range(0..3) {
        0 => {
            // Disk with holes, or thin between rim and hub.
            let mut disk = Solid::cylinder([0.0; 3], 2, radius, half);
            for side in [-1.0, 1.0] {
                let groove = Solid::cylinder([0.0, 0.0, side * half], 2, radius - 0.1, half * 0.6);
                disk = disk.subtract(groove);
            }
            solid = solid.union(disk);
            for k in 0..spokes {
                let hole = Solid::cylinder([(radius + hub) / 2.0, 0.0, 0.0], 2, rng.random_range(0.06..0.11), 1.0);
                solid = solid.subtract(hole.moved(&around(k, spokes), [0.0; 3]));
            }
        }
        1 => {
            let rim = Solid::cylinder([0.0; 3], 2, radius, half);
            solid = solid.union(rim.subtract(Solid::cylinder([0.0; 3], 2, radius - 0.11, 1.0)));
            let thick = rng.random_range(0.045..0.07);
            for k in 0..spokes {
                let spoke = Solid::limb([0.0; 3], [radius - 0.05, 0.0, 0.0], thick * 1.4, thick);
                solid = solid.blend(spoke.moved(&around(k, spokes), [0.0; 3]), 0.03);
            }
        }
        _ => {
            let pitch = Rotation3::from_axis_angle(&Vector3::x_axis(), rng.random_range(0.3..1.0));
            for k in 0..spokes {
                let blade =
                    Solid::cuboid([radius * 0.55, 0.0, 0.0], [radius * 0.5, 0.15, 0.045], 0.03).moved(&pitch, [0.0; 3]);
                solid = solid.blend(blade.moved(&around(k, spokes), [0.0; 3]), 0.03);
            }
        }
    }
    let teeth = rng.random_range(8..15);
    if rng.random_bool(0.5) {
        let rim = Solid::cylinder([0.0; 3], 2, radius + 0.04, half);
        solid = solid.union(rim.subtract(Solid::cylinder([0.0; 3], 2, radius - 0.07, 1.0)));
        for k in 0..teeth {
            let tooth =
                Solid::cuboid([radius + 0.08, 0.0, 0.0], [0.09, 0.9 * radius / f64::from(teeth) + 0.03, half], 0.02);
            solid = solid.union(tooth.moved(&around(k, teeth), [0.0; 3]));
        }
    }
    solid.subtract(Solid::cylinder([0.0; 3], 2, bore, 1.0))
}

/// Rods along the edges of a block, with struts, corner balls, and something inside.
fn frame(rng: &mut ChaCha8Rng) -> Solid {
    let half: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.3..0.55));
    let thick = rng.random_range(0.05..0.08);
    let corner = |i: usize| std::array::from_fn(|k| if i >> k & 1 == 1 { half[k] } else { -half[k] });
    let mut rods = Vec::new();
    for i in 0..8 {
        for k in 0..3 {
            if i >> k & 1 == 0 {
                rods.push(Solid::limb(corner(i), corner(i | 1 << k), thick, thick));
            }
        }
        if rng.random_bool(0.3) {
            rods.push(Solid::sphere(corner(i), thick * 1.9));
        }
    }
    for _ in 0..rng.random_range(0..4) {
        let (i, j) = (rng.random_range(0..8), rng.random_range(0..8));
        if i != j {
            rods.push(Solid::limb(corner(i), corner(j), thick * 0.9, thick * 0.9));
        }
    }
    let mut solid = union_of(rods).unwrap_or_else(|| Solid::sphere([0.0; 3], 0.5));
    if rng.random_bool(0.6) {
        let size = half.map(|h| h * rng.random_range(0.4..0.8));
        let inside = if rng.random() { Solid::ellipsoid([0.0; 3], size) } else { Solid::cuboid([0.0; 3], size, 0.05) };
        solid = solid.blend(inside, 0.05).union(Solid::limb(corner(0), corner(7), thick, thick));
    }
    if rng.random_bool(0.4) {
        let side = rng.random_range(0..3);
        let mut panel = half;
        panel[side] = 0.05;
        let mut center = [0.0; 3];
        center[side] = if rng.random() { half[side] } else { -half[side] };
        solid = solid.union(Solid::cuboid(center, panel, 0.0));
    }
    solid
}

/// Chair, table, stool or shelf.
fn furniture(rng: &mut ChaCha8Rng) -> Solid {
    let (length, width): (f64, f64) = (rng.random_range(0.3..0.55), rng.random_range(0.25..0.45));
    let seat = rng.random_range(-0.1..0.3);
    let thick = rng.random_range(0.04..0.07);
    let leg = rng.random_range(0.045..0.08);
    let splay = rng.random_range(0.0..0.12);
    let round = rng.random_bool(0.3);
    let top = |z: f64| {
        if round {
            Solid::cylinder([0.0, 0.0, z], 2, length.max(width), thick)
        } else {
            Solid::cuboid([0.0, 0.0, z], [length, width, thick], 0.03)
        }
    };
    let mut solid = top(seat);
    let foot = -0.6;
    let inset = if round { 0.65 } else { 0.88 };
    for (sx, sy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
        let (x, y) = (sx * length * inset, sy * width * inset);
        let down = [x + sx * splay, y + sy * splay, foot];
        solid = solid.union(Solid::limb([x, y, seat], down, leg, leg * 0.9));
    }
    if rng.random_bool(0.4) {
        let z = rng.random_range(foot + 0.1..seat - 0.15);
        solid = solid.union(Solid::cuboid([0.0, 0.0, z], [length * inset, width * inset, 0.045], 0.02));
    }
    if rng.random_bool(0.6) {
        let (back, lean) = (rng.random_range(0.3..0.55), rng.random_range(0.0..0.1));
        let (low, high) = (seat, (seat + back).min(0.75));
        for sy in [-1.0, 1.0] {
            let y = sy * width * 0.85;
            solid = solid.union(Solid::limb([-length * 0.9, y, low], [-length * 0.9 - lean, y, high], leg, leg * 0.9));
        }
        let slats = rng.random_range(1..4);
        for k in 0..slats {
            let z = high - f64::from(k) * (high - low) / f64::from(slats + 1);
            solid = solid.union(Solid::cuboid([-length * 0.9 - lean * 0.8, 0.0, z], [0.05, width * 0.9, 0.055], 0.03));
        }
        if rng.random_bool(0.4) {
            for sy in [-1.0, 1.0] {
                let z = (low + high) / 2.0;
                let y = sy * width * 0.85;
                solid = solid.union(Solid::limb([-length * 0.9, y, z], [length * 0.7, y, z], 0.055, 0.055));
                solid = solid.union(Solid::limb([length * 0.7, y, z], [length * 0.7, y, seat], 0.055, 0.055));
            }
        }
    }
    solid
}

/// Blended random solids with bites taken out, bored through, or hollowed and opened.
fn assembly(rng: &mut ChaCha8Rng) -> Solid {
    let place = |rng: &mut ChaCha8Rng, reach: f64| <[f64; 3]>::from(direction(rng) * rng.random_range(0.0..reach));
    let part = |rng: &mut ChaCha8Rng| {
        let size: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.12..0.38));
        let solid = match rng.random_range(0..4) {
            0 => Solid::ellipsoid([0.0; 3], size),
            1 => Solid::cuboid([0.0; 3], size, 0.05),
            2 => Solid::torus([0.0; 3], 2, rng.random_range(0.22..0.38), rng.random_range(0.07..0.13)),
            _ => Solid::cone([0.0; 3], 2, size[0], size[1], size[2]),
        };
        solid.moved(&any_rotation(rng), [0.0; 3])
    };
    let still = Rotation3::identity();
    let mut solid = part(rng);
    for _ in 0..rng.random_range(2..6) {
        solid = solid.blend(part(rng).moved(&still, place(rng, 0.45)), rng.random_range(0.02..0.15));
    }
    if rng.random_bool(0.3) {
        let inside = solid.clone().grown(-rng.random_range(0.075..0.1));
        solid = solid.subtract(inside);
        let opening = direction(rng) * 0.45;
        solid = solid.subtract(Solid::sphere(opening.into(), rng.random_range(0.2..0.32)));
    }
    for _ in 0..rng.random_range(0..3) {
        let bite = part(rng).moved(&still, place(rng, 0.5));
        solid = solid.subtract(bite);
    }
    for _ in 0..rng.random_range(0..3) {
        let bore = Solid::cylinder([0.0; 3], 2, rng.random_range(0.07..0.15), 2.0);
        solid = solid.subtract(bore.moved(&any_rotation(rng), place(rng, 0.3)));
    }
    solid
}
