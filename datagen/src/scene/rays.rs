//! Depth images by ray casting. The only file that speaks glam, parry's vector type.

use super::{RenderConfig, local_origin};
use geometry::{DepthImage, Mesh, PinholeCamera};
use nalgebra::{Isometry3, Point3};
use parry3d::math::Vector;
use parry3d::query::{Ray, RayCast, RayCullingMode};
use parry3d::shape::TriMesh;

/// The mesh in a bounding-volume hierarchy, in f32 about the middle of its bounding box.
#[derive(Debug)]
pub(super) struct RayMesh {
    mesh: Option<TriMesh>,
    origin: Point3<f64>,
}

impl RayMesh {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let origin = local_origin(mesh);
        let vertices = mesh.vertices.iter().map(|v| v - origin).map(|v| glam(&v)).collect();
        // The one error that remains for indices in range is a mesh without triangles: it is never hit.
        Self { mesh: TriMesh::new(vertices, mesh.triangles.clone()).ok(), origin }
    }

    /// Casts the rays of a window (first column, first row, columns, rows) into `image`.
    pub(super) fn cast(
        &self,
        camera: &PinholeCamera,
        world_from_camera: &Isometry3<f64>,
        [column0, row0, columns, rows]: [u32; 4],
        render: &RenderConfig,
        image: &mut DepthImage,
    ) {
        image.origin = [column0, row0];
        image.size = [columns, rows];
        image.depth.clear();
        image.depth.resize((columns * rows) as usize, 0.0);
        let Some(mesh) = &self.mesh else { return };
        let rotation = world_from_camera.rotation.to_rotation_matrix();
        let center = world_from_camera.translation.vector - self.origin.coords;
        let reach = (render.far_m - render.near_m) as f32;
        for row in 0..rows {
            for column in 0..columns {
                // With this direction the ray's parameter is the depth.
                let ahead = camera.unproject(f64::from(column0 + column), f64::from(row0 + row), 1.0);
                let direction = rotation * ahead.coords;
                let ray = Ray::new(glam(&(center + direction * render.near_m)), glam(&direction));
                let hit = if render.cull_back_faces {
                    mesh.cast_local_ray_with_culling(&ray, reach, RayCullingMode::IgnoreBackfaces)
                        .map(|hit| hit.time_of_impact)
                } else {
                    mesh.cast_local_ray(&ray, reach, false)
                };
                if let Some(t) = hit {
                    image.depth[(row * columns + column) as usize] = (f64::from(t) + render.near_m) as f32;
                }
            }
        }
    }
}

fn glam(v: &nalgebra::Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}
