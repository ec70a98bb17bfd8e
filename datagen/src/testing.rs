//! A ball for tests.

use geometry::Mesh;
use nalgebra::Point3;

const RADIUS: f64 = 0.06;

/// A closed ball of 4,800 triangles around the origin, wound outwards.
pub(crate) fn ball() -> Mesh {
    let (rings, sectors) = (40u32, 60u32);
    let at = |ring: u32, sector: u32| {
        let polar = std::f64::consts::PI * f64::from(ring) / f64::from(rings);
        let azimuth = std::f64::consts::TAU * f64::from(sector % sectors) / f64::from(sectors);
        RADIUS * Point3::new(polar.sin() * azimuth.cos(), polar.sin() * azimuth.sin(), polar.cos())
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

/// 20,000 points spread evenly over the ball.
pub(crate) fn ball_samples() -> Vec<Point3<f64>> {
    let n = 20_000;
    (0..n)
        .map(|i| {
            let (z, azimuth) = (1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n), f64::from(i) * 2.399_963_229_728_653);
            let r = (1.0 - z * z).sqrt();
            RADIUS * Point3::new(r * azimuth.cos(), r * azimuth.sin(), z)
        })
        .collect()
}
