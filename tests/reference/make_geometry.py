"""Makes the golden files of the crate `geometry`: tests/data/{boundary,views,scans,scores}.safetensors.

    python tests/reference/make_geometry.py tests/data

The inputs are synthetic: noisy one-sided scans of a bumpy sphere and of a torus, planes, and random numbers. The
expected values come from public libraries, which the published BENBV code is built on, and not from this repository:

- boundary.safetensors: Open3D's tensor `compute_boundary_points` (120 degrees, 30 neighbours), its hybrid neighbour
  search, and the same criterion from its definition in float64 (`plain_mask`: gaps of arctan2 in the tangent plane).
- views.safetensors: SciPy's `kmeans2` on the boundary; member nearest to the mean, greedy order, outward direction and
  turned normal (SciPy's `Rotation`), written from their definition; density from SciPy's k-d tree.
- scans.safetensors: Open3D's normals (20 neighbours, both orientations), spacing, voxel average and cloud distances;
  coverage, overlap, Chamfer and Hausdorff distance from those.
- scores.safetensors: the score from its definition.

Needs: pip install open3d numpy scipy safetensors
"""

import sys

import numpy as np
import open3d as o3d
from safetensors.numpy import save_file
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

NEIGHBORS, NORMAL_NEIGHBORS, GAP_DEG, CLUSTERS, DISTANCE, TOLERANCE = 30, 20, 120.0, 20, 1.2, 0.002


def f32(values):
    """Rounded to float32, held as float64: what a test reads is what was used here."""
    return np.asarray(values).astype(np.float32).astype(np.float64)


def bumpy_sphere(rng, count):
    d = rng.standard_normal((count, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    radius = 0.036 * (1 + 0.12 * np.sin(5 * d[:, 0]) * np.cos(4 * d[:, 1] + 1) + 0.08 * np.sin(7 * d[:, 2]))
    return d * radius[:, None], d


def torus(rng, count):
    u, v = rng.uniform(0, 2 * np.pi, (2, 4 * count))
    keep = rng.uniform(0, 1, 4 * count) * 1.4 < 1 + 0.4 * np.cos(v)  # Even over the surface.
    u, v = u[keep][:count], v[keep][:count]
    n = np.stack([np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)], 1)
    return np.stack([0.035 * np.cos(u), 0.035 * np.sin(u), 0 * u], 1) + 0.014 * n, n


def one_sided(rng, surface, count, camera, noise=2e-4):
    """About so many points of the side that faces the camera, displaced along their normals."""
    p, n = surface(rng, count)
    towards = camera - p
    facing = (n * towards).sum(1) / np.linalg.norm(towards, axis=1) > 0.2
    p, n = p[facing], n[facing]
    return f32(p + noise * rng.standard_normal((len(p), 1)) * n)


def cloud_of(points, normals=None):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is not None:
        cloud.normals = o3d.utility.Vector3dVector(normals)
    return cloud


def oriented(points, camera):
    """Normals as the scanner gives them: all turned along the direction from the origin to the camera."""
    cloud = cloud_of(points)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NORMAL_NEIGHBORS))
    cloud.orient_normals_to_align_with_direction(camera)
    return np.asarray(cloud.normals).copy()


def voxel_mean(points, normals, size):
    thin = cloud_of(points, normals).voxel_down_sample(size)
    return np.asarray(thin.points).copy(), np.asarray(thin.normals).copy()


def spacing(points):
    return float(np.mean(cloud_of(points).compute_nearest_neighbor_distance()))


def tensor_cloud(points, normals):
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(np.float32)))
    cloud.point.normals = o3d.core.Tensor(normals.astype(np.float32))
    return cloud


def mean_neighbor_distance(points):
    return float(cKDTree(points).query(points, k=NEIGHBORS)[0][:, 1:].mean())


def open3d_mask(points, normals, radius):
    _, mask = tensor_cloud(points, normals).compute_boundary_points(radius, NEIGHBORS, GAP_DEG)
    return mask.numpy().astype(np.uint8)


def plain_mask(points, normals, radius):
    """The criterion in float64, whatever the length of the normal."""
    distances, ids = cKDTree(points).query(points, k=NEIGHBORS)
    mask = np.zeros(len(points), np.uint8)
    for i, n in enumerate(normals / np.linalg.norm(normals, axis=1, keepdims=True)):
        near = ids[i][(distances[i] < radius) & (ids[i] != i)]
        if len(near):
            u = np.cross(n, np.eye(3)[np.argmin(abs(n))])
            u /= np.linalg.norm(u)
            d = points[near] - points[i]
            angles = np.sort(np.arctan2(d @ np.cross(n, u), d @ u))
            gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
            mask[i] = gaps.max() > np.radians(GAP_DEG)
    return mask


def scans():
    """Clouds as a planner meets them: one scan, and two averaged, whose normals are not of unit length any more."""
    rng = np.random.default_rng(20240607)
    camera = np.array([0.5, -0.4, 1.0])
    sphere = one_sided(rng, bumpy_sphere, 2600, camera)
    first, second = np.array([0.2, 0.3, 1.1]), np.array([1.0, -0.3, 0.4])
    rings = [one_sided(rng, torus, 1500, c) for c in (first, second)]
    both = np.concatenate(rings), np.concatenate([oriented(r, c) for r, c in zip(rings, (first, second))])
    merged = voxel_mean(*both, spacing(rings[0]))
    return {"sphere": (sphere, f32(oriented(sphere, camera))), "torus": tuple(map(f32, merged))}


def boundary(clouds):
    out = {}
    for name, (points, normals) in clouds.items():
        radius = mean_neighbor_distance(points)
        search = o3d.core.nns.NearestNeighborSearch(o3d.core.Tensor(points.astype(np.float32)))
        search.hybrid_index(radius)
        ids, _, counts = search.hybrid_search(o3d.core.Tensor(points[:60].astype(np.float32)), radius, NEIGHBORS)
        out |= {
            f"{name}.points": points.astype(np.float32), f"{name}.normals": normals.astype(np.float32),
            f"{name}.radius": np.array([radius]), f"{name}.mask": open3d_mask(points, normals, radius),
            f"{name}.plain_mask": plain_mask(points, normals, radius),
            f"{name}.quarter_mask": open3d_mask(points, 0.25 * normals, radius),  # Short normals distort its frame.
            f"{name}.neighbour_index": ids.numpy().astype(np.int32),
            f"{name}.neighbour_count": counts.numpy().astype(np.int32),
        }
        least = np.linalg.norm(normals, axis=1).min()
        flags = [out[f"{name}.{mask}"] for mask in ("mask", "plain_mask", "quarter_mask")]
        print(f"{name}: {len(points)} points, boundary {[int(f.sum()) for f in flags]}, differences from the first"
              f" {[int((f != flags[0]).sum()) for f in flags]}, least normal {least:.2f}")
    rng = np.random.default_rng(5)
    diagonal = np.ones(3) / np.sqrt(3)
    tilt = np.array([1e-3, 2e-3, 1.0])
    planes = {"z": np.array([0, 0, 1.0]), "minus_z": np.array([0, 0, -1.0]), "tilt1e-3": tilt / np.linalg.norm(tilt),
              "x": np.array([1.0, 0, 0]), "diag111": diagonal, "half_length_tilt": np.array([0.3, 0.2, 0.3])}
    for name, normal in planes.items():
        n = normal / np.linalg.norm(normal)
        u = np.cross(n, np.eye(3)[np.argmin(abs(n))])
        u /= np.linalg.norm(u)
        # Jittered, away from exact ties.
        at = np.stack(np.meshgrid(np.arange(16), np.arange(16)), 2).reshape(-1, 2) + rng.uniform(-0.2, 0.2, (256, 2))
        points = f32(0.002 * (at[:, :1] * u + at[:, 1:] * np.cross(n, u)))
        normals = f32(np.tile(normal, (256, 1)))
        masks = [mask(points, normals, 0.006) for mask in (open3d_mask, plain_mask)]
        out |= {f"flat.{name}.points": points.astype(np.float32), f"flat.{name}.normal": normals[:1].astype(np.float32),
                f"flat.{name}.mask": masks[0], f"flat.{name}.plain_mask": masks[1]}
        print(f"flat {name}: {masks[0].sum()}, by the definition {masks[1].sum()}")
    return out


def representatives(points, labels):
    chosen = []
    for label in dict.fromkeys(labels):
        members = np.flatnonzero(labels == label)
        mean = points[members].mean(0)
        chosen.append(members[np.argmin(np.linalg.norm(points[members] - mean, axis=1))])
    return np.array(chosen)


def greedy_order(points):
    order, rest = [0], list(range(1, len(points)))
    while rest:
        nearest = min(rest, key=lambda i: np.linalg.norm(points[i] - points[order[-1]]))
        order.append(nearest)
        rest.remove(nearest)
    return np.array(order)


def density(points, targets):
    value = 1 / (cKDTree(points).query(targets, k=NEIGHBORS)[0].mean(1) + 1e-6)
    return value / value.max()


def inertia(points, labels):
    return sum(((points[labels == l] - points[labels == l].mean(0)) ** 2).sum() for l in set(labels))


def views(clouds):
    out = {}
    for name, (points, normals) in clouds.items():
        index = np.flatnonzero(open3d_mask(points, normals, mean_neighbor_distance(points)))
        rim = points[index]
        _, labels = kmeans2(rim, CLUSTERS, minit="++", seed=123)
        chosen = representatives(rim, labels)
        order = greedy_order(rim[chosen])
        ids = index[chosen][order]
        targets, n = points[ids], normals[ids] / np.linalg.norm(normals[ids], axis=1, keepdims=True)
        near = cKDTree(points).query(targets, k=NEIGHBORS)[1][:, 1:]
        u = targets - points[near].mean(1)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        angle = np.radians(np.array([-45.0, 0.0, 45.0])[np.arange(len(ids)) % 3])[:, None]
        axis = np.cross(u, n)  # As long as the sine between them: the published turn is shortened by it.
        unit = axis / np.linalg.norm(axis, axis=1, keepdims=True)
        padded = np.concatenate([points, np.zeros((4096 - len(points), 3))])
        ends = [inertia(rim, kmeans2(rim, CLUSTERS, minit="++", iter=10, seed=s)[1]) for s in range(100)]
        out |= {
            f"{name}.boundary_index": index.astype(np.int32), f"{name}.kmeans_label": labels.astype(np.int32),
            f"{name}.representative_index": index[chosen].astype(np.int32),
            f"{name}.nearest_sort_order": order.astype(np.int32), f"{name}.view_u": u,
            f"{name}.view_camera": targets + DISTANCE * Rotation.from_rotvec(angle * axis).apply(n),
            f"{name}.view_camera_unit_axis": targets + DISTANCE * Rotation.from_rotvec(angle * unit).apply(n),
            f"{name}.angle_deg": np.degrees(angle[:, 0]), f"{name}.density": density(points, targets),
            f"{name}.density_padded4096": density(padded, targets), f"{name}.kmeans_inertia": np.array([np.mean(ends)]),
        }
        print(f"{name}: {len(ids)} views, sine {np.linalg.norm(axis, axis=1).min():.3f}"
              f" to {np.linalg.norm(axis, axis=1).max():.3f}, k-means {np.mean(ends):.3e} +- {np.std(ends):.1e}")
    rng = np.random.default_rng(9)
    seeds = 0.05 * np.array([[x, y, z] for x in range(3) for y in range(2) for z in range(2)])
    groups = f32(np.concatenate([s + 0.004 * rng.uniform(-1, 1, (12, 3)) for s in seeds])[rng.permutation(144)])
    _, labels = kmeans2(groups, seeds, minit="matrix")
    return out | {"groups.points": groups.astype(np.float32), "groups.label": labels.astype(np.int32)}


def scan_pair():
    out = {}
    for seed, (name, surface) in enumerate({"sphere": bumpy_sphere, "torus": torus}.items()):
        rng = np.random.default_rng(71 + 10 * seed)
        before, camera = np.array([0.1, 0.4, 1.1]), np.array([0.9, 0.5, -0.6])
        existing, scan = (one_sided(rng, surface, 1300, c) for c in (before, camera))
        existing_normals, scan_normals = f32(oriented(existing, before)), oriented(scan, camera)
        toward = cloud_of(scan, scan_normals)
        toward.orient_normals_towards_camera_location(camera)
        size = spacing(scan)
        merged, merged_normals = voxel_mean(
            np.concatenate([existing, scan]), np.concatenate([existing_normals, f32(scan_normals)]), size)
        model = f32(voxel_mean(surface(rng, 1400)[0], np.zeros((1400, 3)), size)[0])
        distance = lambda a, b: np.asarray(cloud_of(a).compute_point_cloud_distance(cloud_of(b)))
        gap, nearest = cKDTree(merged).query(model)
        found = gap < TOLERANCE
        assert np.array_equal(found, distance(model, merged) < TOLERANCE)
        matched = model[found]
        out |= {
            f"{name}.existing": np.hstack([existing, existing_normals]).astype(np.float32),
            f"{name}.scan": np.hstack([scan, scan_normals]).astype(np.float32), f"{name}.camera": camera,
            # Only where the two orientations differ.
            f"{name}.turned": np.flatnonzero((np.asarray(toward.normals) * scan_normals).sum(1) < 0).astype(np.int32),
            f"{name}.grid_size": np.array([size]), f"{name}.model": model.astype(np.float32),
            f"{name}.merged": np.hstack([merged, merged_normals]).astype(np.float32),
            f"{name}.matched": np.flatnonzero(found).astype(np.int32),
            f"{name}.matched_to": nearest[found].astype(np.int32),
            f"{name}.coverage": np.array([found.mean()]),
            f"{name}.overlap": np.array([(distance(scan, existing) < TOLERANCE).mean()]),
        }
        for pair, a, b in [("matched_model", matched, model), ("scan_existing", scan, existing)]:
            there, back = distance(a, b), distance(b, a)
            out[f"{name}.cd_{pair}_m"] = np.array([(there.mean() + back.mean()) / 2])
            out[f"{name}.hd_{pair}_m"] = np.array([max(there.max(), back.max())])
        # Nothing within rounding of the tolerance.
        assert min(abs(d - TOLERANCE).min() for d in (gap, distance(scan, existing))) > 2e-7
        print(f"{name}: {len(existing)} and {len(scan)} points, {len(merged)} merged at {size * 1e3:.2f} mm, model "
              f"{len(model)}, coverage {found.mean():.3f}, overlap {out[f'{name}.overlap'][0]:.3f}, "
              f"{len(out[f'{name}.turned'])} turned")
    return out


def scores():
    rng = np.random.default_rng(3)
    edges = np.array([0.0, 0.1, 0.4, 0.45, 0.5, 0.7, 1.0])
    rows = np.stack(np.meshgrid(edges, edges, edges), 3).reshape(-1, 3)
    coverage, overlap, current = np.concatenate([rows, rng.uniform(0, 1, (100, 3))]).T.copy()
    response = np.where(overlap < 0.4, -6.25 * overlap**2 + 5 * overlap, -4 * overlap**2 + 4 * overlap)
    response[(overlap >= 0.4) & (overlap <= 0.5)] = 1
    weight = 1 / (1 + np.exp(-10 * (current - 0.5)))
    return dict(coverage=coverage, overlap=overlap, current_coverage=current,
                score=weight * coverage + (1 - weight) * response)


def main():
    clouds = scans()
    for name, tensors in [
        ("boundary", boundary(clouds)), ("views", views(clouds)), ("scans", scan_pair()), ("scores", scores()),
    ]:
        save_file({k: np.ascontiguousarray(v) for k, v in tensors.items()}, f"{sys.argv[1]}/{name}.safetensors")


main()
