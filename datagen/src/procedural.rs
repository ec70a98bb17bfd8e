//! An endless, seeded family of watertight solids that look like objects: rich in cavities, holes, thin parts,
//! handles and self-occlusion. Made as implicit surfaces and meshed by manifold dual contouring (`fidget`).

mod families;
mod solid;

use fidget::mesh::{Octree, Settings};
use fidget::vm::VmShape;
use geometry::{Mesh, rng};
use nalgebra::Point3;
use solid::Solid;
use std::collections::HashMap;

/// Cells along each axis are 2 to this power.
const OCTREE_DEPTH: u8 = 6;
/// A solid with fewer triangles than this is too plain, or nearly vanished: drawn again.
const MIN_TRIANGLES: usize = 1_000;
/// Loose pieces up to this share of the triangles are left out; with more the solid is drawn again.
const MAX_LOOSE: f64 = 0.1;

/// Solid number `index` of the family that belongs to `seed`: closed (every directed edge once, its opposite
/// once), of one piece, oriented outwards, at most 2 across each axis of its own frame. Same numbers, same mesh.
pub fn mesh(seed: u64, index: u64) -> Mesh {
    let mut rng = rng::stream(seed, &format!("procedural/{index}"));
    // About one draw in fifty is refused, so this ends.
    loop {
        let (solid, turn) = families::draw(&mut rng);
        if let Some(mut mesh) = mesh_of(solid) {
            // Turned as a mesh: the bounds by which the mesher skips empty space are tighter along the axes.
            mesh.vertices.iter_mut().for_each(|v| *v = turn * *v);
            return mesh;
        }
    }
}

/// The surface of a solid; `None` where it is empty, not closed, or falls apart.
fn mesh_of(solid: Solid) -> Option<Mesh> {
    let shape = VmShape::from(solid.within_unit_cube()).try_into().ok()?;
    let settings = Settings { depth: OCTREE_DEPTH, threads: None, ..Default::default() };
    let surface = Octree::build(&shape, &settings)?.walk_dual();
    let vertices = surface.vertices.iter().map(|v| Point3::new(v.x, v.y, v.z).map(f64::from)).collect();
    let triangles = surface.triangles.iter().map(|t| [t.x as u32, t.y as u32, t.z as u32]).collect();
    let mesh = largest_component(&Mesh { vertices, triangles })?;
    let finite = mesh.vertices.iter().all(|v| v.iter().all(|x| x.is_finite()));
    (finite && mesh.triangles.len() >= MIN_TRIANGLES && is_closed(&mesh) && volume(&mesh) > 0.0).then_some(mesh)
}

/// The piece with most triangles, without the others' vertices; `None` where more than a little is lost.
fn largest_component(mesh: &Mesh) -> Option<Mesh> {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for &[a, b, c] in &mesh.triangles {
        for (i, j) in [(a, b), (b, c)] {
            let (i, j) = (root(&mut parent, i), root(&mut parent, j));
            parent[i as usize] = j;
        }
    }
    let mut count = vec![0usize; mesh.vertices.len()];
    for t in &mesh.triangles {
        count[root(&mut parent, t[0]) as usize] += 1;
    }
    let largest = (0..count.len()).max_by_key(|&i| (count[i], std::cmp::Reverse(i)))?;
    if (count[largest] as f64) < (1.0 - MAX_LOOSE) * mesh.triangles.len() as f64 {
        return None;
    }
    let mut new_id = vec![u32::MAX; mesh.vertices.len()];
    let mut kept = Mesh::default();
    for t in &mesh.triangles {
        if root(&mut parent, t[0]) as usize == largest {
            kept.triangles.push(t.map(|i| {
                let id = &mut new_id[i as usize];
                if *id == u32::MAX {
                    *id = kept.vertices.len() as u32;
                    kept.vertices.push(mesh.vertices[i as usize]);
                }
                *id
            }));
        }
    }
    Some(kept)
}

/// Whether every directed edge occurs once, and its opposite once.
fn is_closed(mesh: &Mesh) -> bool {
    let mut edges = HashMap::with_capacity(mesh.triangles.len() * 3);
    for &[a, b, c] in &mesh.triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            if edge.0 == edge.1 || edges.insert(edge, ()).is_some() {
                return false;
            }
        }
    }
    mesh.triangles.iter().all(|&[a, b, c]| [(b, a), (c, b), (a, c)].iter().all(|edge| edges.contains_key(edge)))
}

fn volume(mesh: &Mesh) -> f64 {
    let signed = |&t: &[u32; 3]| {
        let [a, b, c] = mesh.corners(t).map(|p| p.coords);
        a.dot(&b.cross(&c)) / 6.0
    };
    mesh.triangles.iter().map(signed).sum()
}

#[cfg(test)]
mod tests;
