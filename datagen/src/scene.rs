//! A mesh that can be looked at: depth images by rasterising or by ray casting, each the other's test oracle.
//!
//! The z-buffer rasteriser is the faster of the two up to about a million triangles and hardly needs a build; the
//! bounding-volume hierarchy serves larger meshes, and cameras that have part of the mesh behind them. Both
//! sample a pixel at its integer coordinate and agree to rounding.

mod patches;
mod raster;
mod rays;
mod screen;
mod triangle;

use crate::noise::NoiseConfig;
use geometry::{DepthImage, Mesh, PinholeCamera};
use nalgebra::{Isometry3, Point3};
use raster::{Projection, RasterMesh};
use rays::RayMesh;
use std::sync::OnceLock;

/// How depth images are made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Renderer {
    /// Rasterise up to a million triangles in front of the camera; else cast rays.
    #[default]
    Auto,
    /// Rasterise, whatever the size (rays only where part of the mesh is not in front of the camera).
    Raster,
    /// Cast rays, whatever the size.
    Rays,
}

/// Settings of the simulated depth camera (docs/method.md, 'Setting').
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderConfig {
    /// Whether triangles seen from behind are invisible, as in the published simulator. Default: both sides seen.
    pub cull_back_faces: bool,
    /// The published simulator's mistake: every scan displaced by one pixel along the camera's up. Default: off.
    pub pixel_shift: bool,
    /// Depth is rounded down to a multiple of this, metres; 0: not rounded.
    pub depth_quantum_m: f64,
    /// Surface nearer than this depth is not seen, metres.
    pub near_m: f64,
    /// Surface beyond this depth is not seen, metres.
    pub far_m: f64,
    /// Sensor noise; `None`: the ideal camera.
    pub noise: Option<NoiseConfig>,
    /// Rasteriser or rays.
    pub renderer: Renderer,
}

impl Default for RenderConfig {
    fn default() -> Self {
        Self {
            cull_back_faces: false,
            pixel_shift: false,
            depth_quantum_m: 0.001,
            near_m: 0.01,
            far_m: 4.0,
            noise: None,
            renderer: Renderer::Auto,
        }
    }
}

impl RenderConfig {
    /// The published simulator: shifted by a pixel, back faces culled (docs/method.md, 'Setting').
    pub fn paper() -> Self {
        Self { cull_back_faces: true, pixel_shift: true, ..Self::default() }
    }
}

/// Buffers that [`Scene::render`] reuses from call to call, and the image it made last.
#[derive(Clone, Debug, Default)]
pub struct RenderScratch {
    projection: Projection,
    image: DepthImage,
}

/// Above this number of triangles rays are faster than rasterising (measured).
const MAX_RASTER_TRIANGLES: usize = 1_000_000;

/// An object in the simulator. Shared freely between threads.
#[derive(Debug)]
pub struct Scene {
    mesh: Mesh,
    raster: RasterMesh,
    rays: OnceLock<RayMesh>,
}

impl Scene {
    /// A scene with this mesh, in metres. The hierarchy for rays is built when first needed.
    pub fn new(mesh: Mesh) -> Self {
        let raster = RasterMesh::new(&mesh);
        Self { mesh, raster, rays: OnceLock::new() }
    }

    /// The mesh, as given.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// What the camera measures from this pose. Only the window that the object fills is stored. With noise,
    /// the realisation depends on the noise's seed and the pose alone.
    pub fn depth_image(
        &self,
        camera: &PinholeCamera,
        world_from_camera: &Isometry3<f64>,
        render: &RenderConfig,
    ) -> DepthImage {
        let mut scratch = RenderScratch::default();
        self.render(camera, world_from_camera, render, &mut scratch);
        scratch.image
    }

    /// As [`Scene::depth_image`], without allocating once the scratch has grown.
    pub fn render<'s>(
        &self,
        camera: &PinholeCamera,
        world_from_camera: &Isometry3<f64>,
        render: &RenderConfig,
        scratch: &'s mut RenderScratch,
    ) -> &'s DepthImage {
        let mut shifted = *camera;
        if render.pixel_shift {
            shifted.cy -= 1.0;
        }
        let RenderScratch { projection, image } = scratch;
        image.depth.clear();
        image.size = [0, 0];
        if !self.mesh.triangles.is_empty() {
            let in_front = self.raster.project(&shifted, world_from_camera, render.near_m as f32, projection);
            let raster = match render.renderer {
                Renderer::Auto => self.mesh.triangles.len() <= MAX_RASTER_TRIANGLES,
                Renderer::Raster => true,
                Renderer::Rays => false,
            };
            if raster && in_front {
                self.raster.draw(projection, render.cull_back_faces, image);
            } else {
                let window = if in_front { projection.window() } else { [0, 0, camera.width, camera.height] };
                let rays = self.rays.get_or_init(|| RayMesh::new(&self.mesh));
                rays.cast(&shifted, world_from_camera, window, render, image);
            }
        }
        let far = render.far_m as f32;
        if projection.farthest() > far || render.noise.is_some() {
            image.depth.iter_mut().for_each(|z| *z = if *z > far { 0.0 } else { *z });
        }
        if let Some(noise) = &render.noise {
            // The noise of a pixel depends on the window.
            image.crop();
            noise.disturb(image, camera, world_from_camera);
        }
        if render.depth_quantum_m > 0.0 {
            quantize(&mut image.depth, render.depth_quantum_m, far);
        }
        image
    }
}

/// Rounds depths of up to `far` down to multiples of `quantum`, in f32 as the published simulator does.
fn quantize(depth: &mut [f32], quantum: f64, far: f32) {
    let per_quantum = (1.0 / quantum) as f32;
    // Signed integers of 32 bits are those that vector registers convert.
    if far * per_quantum < 2e9 {
        depth.iter_mut().for_each(|z| *z = (f64::from((*z * per_quantum) as i32) * quantum) as f32);
    } else {
        depth.iter_mut().for_each(|z| *z = (f64::from((*z * per_quantum) as u32) * quantum) as f32);
    }
}

/// The mesh's local frame for f32 arithmetic: the middle of its bounding box.
fn local_origin(mesh: &Mesh) -> Point3<f64> {
    let (low, high) = mesh.bounding_box();
    nalgebra::center(&low, &high)
}

#[cfg(test)]
mod tests;
