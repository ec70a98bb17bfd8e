"""How long planning takes from Python, over how long it takes in Rust: the table in docs/python.md."""

import time

import numpy as np

import benbv
from benbv import _benbv


def ball(count: int) -> np.ndarray:
    """Points of the upper half of a bumpy ball, float32."""
    rng = np.random.default_rng(0)
    v = rng.normal(size=(count, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    v[:, 2] = np.abs(v[:, 2])
    return (v * (0.1 + 0.01 * np.sin(5 * v[:, :1]) * np.cos(4 * v[:, 1:2]))).astype(np.float32)


def python_seconds(points: np.ndarray, origin: tuple[float, float, float]) -> tuple[float, float]:
    session = benbv.Session()
    start = time.perf_counter()
    session.add_points(points, origin=origin)
    added = time.perf_counter()
    session.next_view()
    return added - start, time.perf_counter() - added


if __name__ == "__main__":
    origin = (0.05, -0.02, 1.2)
    print("| points | add, Rust | add, Python | next view, Rust | next view, Python | Python over Rust |")
    print("|---|---|---|---|---|---|")
    for count, repeats in ((5_000, 15), (100_000, 9), (1_000_000, 7)):
        points = ball(count)
        pairs = [(_benbv.rust_seconds(points, origin), python_seconds(points, origin)) for _ in range(repeats)]
        rust, python = np.median([r for r, _ in pairs], axis=0), np.median([p for _, p in pairs], axis=0)
        times = " | ".join(f"{1000 * t:.1f} ms" for t in (rust[0], python[0], rust[1], python[1]))
        print(f"| {count:,} | {times} | {sum(python) / sum(rust):.3f} |")
