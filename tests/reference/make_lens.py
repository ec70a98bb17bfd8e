"""Golden values of lens distortion: pixels of five calibrations undistorted by OpenCV.

pip install opencv-python-headless numpy; python tests/reference/make_lens.py > tests/data/lens.json

Rays (x / z, y / z) are drawn over the image, distorted and projected by OpenCV (cv2.projectPoints, cv2.fisheye.projectPoints),
and its own undistortion is held against them, iterated until it stands.
"""

import json

import cv2
import numpy as np

# Values as the makers of such cameras give them (a depth stream, a colour stream, an industrial lens, two fisheyes).
CAMERAS = [
    ("depth_mild", "brown_conrady", 640, 480, [504.1, 504.3, 320.6, 239.2], [0.0712, -0.1841, 0.0006, -0.0011, 0.0934]),
    ("colour_wide", "brown_conrady", 1280, 720, [641.7, 640.9, 644.3, 361.1], [-0.0553, 0.0671, -0.0004, 0.0007, -0.0216]),
    ("industrial_barrel", "brown_conrady", 1024, 1024, [712.0, 711.2, 498.0, 530.5], [-0.2814, 0.1173, 0.0012, -0.0008, -0.0235]),
    ("time_of_flight_rational", "brown_conrady", 640, 576, [505.1, 505.2, 331.1, 330.3],
     [4.8731, 3.0662, 0.00004, -0.00003, 0.1529, 5.2089, 4.5935, 0.8176]),
    ("fisheye", "fisheye", 848, 800, [286.2, 286.4, 421.9, 399.7], [-0.0071, 0.0432, -0.0411, 0.0077]),
]


def rays(width, height, k, count=400):
    """Undistorted rays over the image and a little less, whatever the lens does to them."""
    rng = np.random.default_rng(7)
    u, v = rng.uniform(0, width - 1, count), rng.uniform(0, height - 1, count)
    return np.stack([u, v], axis=1)


def main():
    cameras = []
    for name, model, width, height, (fx, fy, cx, cy), d in CAMERAS:
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        d = np.array(d)
        pixels = rays(width, height, k)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 500, 1e-13)
        if model == "fisheye":
            undistorted = cv2.fisheye.undistortPoints(pixels[:, None], k, d, criteria=criteria)[:, 0]
            again = cv2.fisheye.distortPoints(undistorted[:, None], k, d)[:, 0]
        else:
            undistorted = cv2.undistortPoints(pixels[:, None], k, d, criteria=criteria)[:, 0]
            solid = np.concatenate([undistorted, np.ones((len(undistorted), 1))], axis=1)
            again = cv2.projectPoints(solid[:, None], np.zeros(3), np.zeros(3), k, d)[0][:, 0]
        good = np.linalg.norm(again - pixels, axis=1) < 1e-6
        assert good.mean() > 0.7, (name, good.mean())
        chosen = np.flatnonzero(good)[:60]
        cameras.append({
            "name": name, "model": model, "width": width, "height": height,
            "intrinsics": [fx, fy, cx, cy], "coefficients": d.tolist(),
            "pixels": np.round(pixels[chosen], 9).tolist(),
            "undistorted": np.round(undistorted[chosen], 12).tolist(),
        })
    print(json.dumps({"opencv": cv2.__version__, "cameras": cameras}))


if __name__ == "__main__":
    main()
