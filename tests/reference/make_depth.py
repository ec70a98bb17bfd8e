"""Makes tests/data/depth.safetensors: depth images of a small mesh, cast ray by ray.

    python tests/reference/make_depth.py tests/data

The mesh is a bumpy, twice subdivided icosahedron with a piece missing, so that back faces are seen too. Every pixel's
ray meets every triangle (Moeller and Trumbore 1997, float64, NumPy alone); Open3D's `RaycastingScene` must agree but
for rounding. A pixel (column, row) is sampled at its integer coordinate; depth is along the optical axis. Recorded per
pose: the depth, and the same where rays pass through back faces. No ray may pass so close to an edge that rounding
decides.

Needs: pip install open3d numpy safetensors
"""

import sys

import numpy as np
import open3d as o3d
from safetensors.numpy import save_file

WIDTH, HEIGHT, FOCAL = 80, 60, 150.0


def mesh():
    ball = o3d.geometry.TriangleMesh.create_icosahedron(1.0).subdivide_midpoint(2)
    d = np.asarray(ball.vertices)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    radius = 0.08 * (1 + 0.15 * np.sin(4 * d[:, 0] + 1) * np.cos(3 * d[:, 1]) + 0.1 * np.sin(5 * d[:, 2]))
    vertices = (d * radius[:, None]).astype(np.float32).astype(np.float64)
    triangles = np.asarray(ball.triangles)
    centers = d[triangles].mean(1)
    return vertices, triangles[centers @ np.array([0.6, 0.0, 0.8]) < 0.85 * np.linalg.norm(centers, axis=1)]


def look(camera, target):
    """Axes right, down, forward as rows."""
    b = (camera - target) / np.linalg.norm(camera - target)
    side = np.cross([0, 0, 1.0], b)
    up = np.cross(b, side / np.linalg.norm(side))
    right = np.cross(-b, up)
    return np.stack([right, np.cross(-b, right), -b])


def rays(axes):
    columns, rows = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    d = np.stack([(columns - WIDTH / 2) / FOCAL, (rows - HEIGHT / 2) / FOCAL, np.ones(columns.shape)], 2)
    return d.reshape(-1, 3) @ axes


def cast(camera, directions, vertices, triangles, front_only):
    """Depth of each ray, 0 for none, and the least distance of a ray to an edge in barycentric coordinates."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    e1, e2, s = b - a, c - a, camera - a
    q = np.cross(s, e1)
    t_all = (q * e2).sum(1)
    depth, margin = np.zeros(len(directions)), np.inf
    for i, d in enumerate(directions):
        h = np.cross(d, e2)
        det = (h * e1).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v, t = (h * s).sum(1) / det, q @ d / det, t_all / det
        least = np.minimum(np.minimum(u, v), 1 - u - v)
        facing = det > 0 if front_only else det != 0
        margin = min(margin, np.abs(least[facing & np.isfinite(least)]).min())
        hit = facing & (least > 0) & (t > 0)
        depth[i] = t[hit].min() if hit.any() else 0
    return depth, margin


def main():
    vertices, triangles = mesh()
    out = {"vertices": vertices.astype(np.float32), "triangles": triangles.astype(np.int32),
           "width_height_focal": np.array([WIDTH, HEIGHT, FOCAL])}
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))
    poses = [([0.45, -0.1, 0.35], [0.01, 0, 0.02]), ([-0.3, 0.35, -0.2], [0, 0, 0]), ([0.1, 0.2, 0.6], [0, 0.01, 0])]
    for i, (camera, target) in enumerate(poses):
        camera, target = np.array(camera), np.array(target)
        axes = look(camera, target)
        out[f"pose{i}.camera"], out[f"pose{i}.target"] = camera, target.astype(float)
        directions = rays(axes)
        for name, front_only in [("depth", False), ("front_depth", True)]:
            depth, margin = cast(camera, directions, vertices, triangles, front_only)
            assert margin > 1e-5, margin
            if not front_only:
                both = np.hstack([np.tile(camera, (len(depth), 1)), directions]).astype(np.float32)
                theirs = scene.cast_rays(o3d.core.Tensor(both))["t_hit"].numpy()
                theirs[~np.isfinite(theirs)] = 0
                assert abs(theirs - depth).max() < 1e-5
            # As a window: first column, first row, columns, rows; everything outside saw nothing.
            image = depth.reshape(HEIGHT, WIDTH)
            rows, columns = np.flatnonzero(image.any(1)), np.flatnonzero(image.any(0))
            window = image[rows[0]:rows[-1] + 1, columns[0]:columns[-1] + 1]
            out[f"pose{i}.{name}_window"] = np.array([columns[0], rows[0], *window.shape[::-1]], np.int32)
            out[f"pose{i}.{name}"] = window.astype(np.float32)
            print(f"pose {i} {name}: {(depth > 0).sum()} hits, {window.shape}, margin {margin:.1e}")
    save_file({k: np.ascontiguousarray(v) for k, v in out.items()}, f"{sys.argv[1]}/depth.safetensors")


main()
