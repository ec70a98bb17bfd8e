//! A mesh that can be looked at: depth images by rasterising or by ray casting, each the other's test oracle.
//!
//! The z-buffer rasteriser is the faster of the two up to about a million triangles and needs no build; the
//! bounding-volume hierarchy serves larger meshes, and cameras that have part of the mesh behind them. Both
//! sample a pixel at its integer coordinate and agree to rounding.

mod raster;
mod rays;

use crate::noise::NoiseConfig;
use geometry::{DepthImage, Mesh, PinholeCamera};
use nalgebra::{Isometry3, Point3};
use raster::{Projection, RasterMesh};
use rays::RayMesh;
use std::collections::HashMap;
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

/// Settings of the simulated depth camera (method, 'Setting'; baselines, section 2).
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
    /// The published simulator: shifted by a pixel, back faces culled (baselines, section 2).
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

/// Above this number of triangles rays are faster than rasterising (geometry, section 1).
const MAX_RASTER_TRIANGLES: usize = 1_000_000;

/// An object in the simulator. Shared freely between threads.
#[derive(Debug)]
pub struct Scene {
    mesh: Mesh,
    raster: RasterMesh,
    rays: OnceLock<RayMesh>,
    solid: OnceLock<bool>,
}

impl Scene {
    /// A scene with this mesh, in metres. The hierarchy for rays is built when first needed.
    pub fn new(mesh: Mesh) -> Self {
        let raster = RasterMesh::new(&mesh);
        Self { mesh, raster, rays: OnceLock::new(), solid: OnceLock::new() }
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
                let cull = render.cull_back_faces || self.is_solid();
                raster::fill(projection, &self.mesh.triangles, cull, image);
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
            noise.disturb(image, camera, world_from_camera);
        }
        if render.depth_quantum_m > 0.0 {
            quantize(&mut image.depth, render.depth_quantum_m);
        }
        image
    }

    /// Whether the mesh is closed and consistently oriented outwards: every directed edge once and its opposite
    /// once, every component of positive volume. Back faces of such a mesh are never seen, so that culling them
    /// changes no image.
    pub fn is_solid(&self) -> bool {
        *self.solid.get_or_init(|| is_solid(&self.mesh))
    }
}

/// Rounds depths down to multiples of `quantum`, in f32 as the published simulator does.
fn quantize(depth: &mut [f32], quantum: f64) {
    let per_quantum = (1.0 / quantum) as f32;
    for z in depth {
        *z = (f64::from((*z * per_quantum) as u32) * quantum) as f32;
    }
}

/// Whether the directed edges cancel in a hashed sum: false for all but some one in 2^64 open or inconsistent
/// meshes, at a twentieth of the time of the exact test.
fn edges_cancel(mesh: &Mesh) -> bool {
    let mix = |x: u64| {
        let x = (x ^ (x >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9)
    };
    let hash = |v: &Point3<f64>| [v.x, v.y, v.z].iter().fold(1, |h, x| mix(h ^ (x + 0.0).to_bits()));
    let hashes: Vec<u64> = mesh.vertices.iter().map(hash).collect();
    let mut sum = 0u64;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| hashes[i as usize]);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let edge = mix(from.min(to).rotate_left(21) ^ from.max(to));
            sum = if from < to { sum.wrapping_add(edge) } else { sum.wrapping_sub(edge) };
        }
    }
    sum == 0
}

fn is_solid(mesh: &Mesh) -> bool {
    if !edges_cancel(mesh) {
        return false;
    }
    // Corners that differ only in their normals are one vertex here.
    let mut ids = HashMap::with_capacity(mesh.vertices.len());
    let welded: Vec<u32> = mesh
        .vertices
        .iter()
        .enumerate()
        .map(|(i, v)| *ids.entry([v.x, v.y, v.z].map(|x| (x + 0.0).to_bits())).or_insert(i as u32))
        .collect();
    let mut component: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    fn root(component: &mut [u32], mut i: u32) -> u32 {
        while component[i as usize] != i {
            component[i as usize] = component[component[i as usize] as usize];
            i = component[i as usize];
        }
        i
    }
    let mut edges = Vec::with_capacity(mesh.triangles.len() * 3);
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| welded[i as usize]);
        if a == b || b == c || c == a {
            continue;
        }
        for (from, to) in [(a, b), (b, c), (c, a)] {
            // Undirected edge first, direction in the lowest bit: a closed mesh has each once in both directions.
            edges.push((u64::from(from.min(to)) << 33) | (u64::from(from.max(to)) << 1) | u64::from(from > to));
            let (i, j) = (root(&mut component, from), root(&mut component, to));
            component[i as usize] = j;
        }
    }
    edges.sort_unstable();
    if !edges.len().is_multiple_of(2) || edges.chunks_exact(2).any(|e| e[0] & 1 == 1 || e[0] + 1 != e[1]) {
        return false;
    }
    if edges.windows(2).any(|e| e[0] == e[1]) {
        return false;
    }
    let mut volume = vec![0.0; mesh.vertices.len()];
    for &t in &mesh.triangles {
        let [a, b, c] = mesh.corners(t).map(|p| p - mesh.vertices[0]);
        volume[root(&mut component, welded[t[0] as usize]) as usize] += a.dot(&b.cross(&c));
    }
    mesh.triangles.iter().all(|t| volume[root(&mut component, welded[t[0] as usize]) as usize] > 0.0)
}

/// The mesh's local frame for f32 arithmetic: the middle of its bounding box.
fn local_origin(mesh: &Mesh) -> Point3<f64> {
    let (low, high) = mesh.bounding_box();
    nalgebra::center(&low, &high)
}

#[cfg(test)]
mod tests;
