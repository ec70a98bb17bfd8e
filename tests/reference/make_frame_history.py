"""Makes tests/data/frame_history.bin in the format that the authors publish, and frame_history.safetensors, what it
says. No part of this repository reads or writes here.

    python tests/reference/make_frame_history.py tests/data

Per frame, little endian, no header: u64 N; N x 6 f64 (position, normal); 12 f64 (current target, current camera, next
target, next camera); 20 x 6 f64 (target, camera); 20 f64 (scores). The frames are those of a growing patch of a sphere.

Needs: pip install numpy safetensors
"""

import struct
import sys

import numpy as np
from safetensors.numpy import save_file

rng = np.random.default_rng(11)
history, tensors, current = b"", {}, np.array([[0, 0, 0], [0.3, 0.2, 1.1]])
for i, count in enumerate((61, 70, 83)):
    normals = rng.standard_normal((count, 3)) + [0, 0, 1.5]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.hstack([0.08 * normals + 1e-3 * rng.standard_normal((count, 3)), normals])
    targets = points[rng.choice(count, 20, replace=False)]
    views = np.stack([targets[:, :3], targets[:, :3] + 1.2 * targets[:, 3:]], 1)
    scores = rng.uniform(0, 1, 20)
    chosen = views[scores.argmax()]
    history += struct.pack("<Q", count)
    for values in (points, current, chosen, views, scores):
        history += np.ascontiguousarray(values, "<f8").tobytes()
    tensors |= {f"frame{i}.points": points, f"frame{i}.current_view_target_camera": current,
                f"frame{i}.next_view_target_camera": chosen, f"frame{i}.nbv_list": views, f"frame{i}.score": scores}
    current = chosen
with open(f"{sys.argv[1]}/frame_history.bin", "wb") as file:
    file.write(history)
save_file({k: np.ascontiguousarray(v) for k, v in tensors.items()}, f"{sys.argv[1]}/frame_history.safetensors")
