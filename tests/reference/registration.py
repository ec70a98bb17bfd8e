"""Golden registrations for datagen/tests/registration.rs.

    REGISTRATION_PAIRS=DIR cargo test -p datagen --test registration -- --ignored
    pip install open3d small_gicp scipy
    python registration.py DIR ../data/registration.json

Each pair is registered by Open3D's point-to-plane ICP with Tukey's weights (the nearest point within 5 mm; the constant is 4.685
times the robust scale of what is left, 0.2 mm at least, found anew until neither changes). small_gicp's
PLANE_ICP, which weighs all pairs alike, is printed beside it.
"""

import json
import sys

import numpy as np
import open3d as o3d
import small_gicp
from scipy.spatial import cKDTree

REACH = 0.005
LEAST_SCALE = 0.0002


def cloud(path):
    values = np.loadtxt(path)
    result = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(values[:, :3]))
    result.normals = o3d.utility.Vector3dVector(values[:, 3:])
    return result, values


def apart(a, b):
    left = a @ np.linalg.inv(b)
    angle = np.degrees(np.arccos(np.clip((np.trace(left[:3, :3]) - 1) / 2, -1, 1)))
    return 1e3 * np.linalg.norm(left[:3, 3]), angle


def residuals(scan, model, motion):
    points = scan[:, :3] @ motion[:3, :3].T + motion[:3, 3]
    distances, nearest = cKDTree(model[:, :3]).query(points, distance_upper_bound=REACH)
    near = np.isfinite(distances)
    pairs = model[nearest[near]]
    return np.abs(np.sum((pairs[:, :3] - points[near]) * pairs[:, 3:], axis=1))


def main(folder, out):
    registration = o3d.pipelines.registration
    pairs = []
    for number in range(10):
        model, model_values = cloud(f"{folder}/{number}-model.txt")
        scan, scan_values = cloud(f"{folder}/{number}-scan.txt")
        found, scale = np.eye(4), LEAST_SCALE
        for _ in range(20):
            found = registration.registration_icp(
                scan, model, REACH, found,
                registration.TransformationEstimationPointToPlane(registration.TukeyLoss(4.685 * scale)),
                registration.ICPConvergenceCriteria(1e-12, 1e-12, 500),
            ).transformation
            scale = max(1.4826 * np.median(residuals(scan_values, model_values, found)), LEAST_SCALE)
        other = small_gicp.align(
            model_values[:, :3], scan_values[:, :3], init_T_target_source=np.eye(4), registration_type="PLANE_ICP",
            max_correspondence_distance=0.005, downsampling_resolution=1e-4)
        print(number, "small_gicp is off Open3D by %.4f mm, %.4f degrees" % apart(other.T_target_source, found))
        pairs.append({"points": [len(model_values), len(scan_values)], "correction": found.tolist()})
    with open(out, "w") as file:
        json.dump({"made_by": f"Open3D {o3d.__version__}, tests/reference/registration.py", "pairs": pairs}, file, indent=1)
        file.write("\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
