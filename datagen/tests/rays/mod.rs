//! What a camera sees, by parry's rays, which share no code with the planner or the simulator.

use geometry::Mesh;
use nalgebra::{Point3, Vector3};
use parry3d::query::{Ray, RayCast};
use parry3d::shape::TriMesh;

fn glam(v: &Vector3<f64>) -> parry3d::math::Vector {
    parry3d::math::Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

/// What rays meet.
pub fn surface(mesh: &Mesh) -> TriMesh {
    TriMesh::new(mesh.vertices.iter().map(|v| glam(&v.coords)).collect(), mesh.triangles.clone()).expect("triangles")
}

/// Where a ray from an eye meets it first.
pub fn hit(surface: &TriMesh, eye: &Point3<f64>, direction: &Vector3<f64>) -> Option<Point3<f64>> {
    let direction = direction.normalize();
    let t = surface.cast_local_ray(&Ray::new(glam(&eye.coords), glam(&direction)), f32::MAX, false)?;
    Some(eye + f64::from(t) * direction)
}

/// Which samples of it nothing hides from an eye there.
pub fn seen(surface: &TriMesh, samples: &[Point3<f64>], eye: &Point3<f64>) -> Vec<bool> {
    samples.iter().map(|p| hit(surface, eye, &(p - eye)).is_some_and(|met| (met - p).norm() < 5e-4)).collect()
}
