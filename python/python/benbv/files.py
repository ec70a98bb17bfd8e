"""Clouds, depth images, meshes, poses, arms and calibrations from files; `docs/formats.md` says which."""

from __future__ import annotations

import json
import os
import warnings
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _benbv


@dataclass(frozen=True)
class Cloud:
    """A cloud as its file holds it, in the file's unit and frame."""

    points: NDArray[np.float64]
    """(N, 3)."""
    normals: NDArray[np.float64] | None
    """(N, 3), zero where the file gives none; None where it gives none at all."""
    metres_per_unit: float | None
    """The unit that the file names, if it does."""
    notes: tuple[str, ...]
    """What was guessed in reading, and what was left out."""


@dataclass(frozen=True)
class Calibration:
    """A calibrated camera. `add_depth` takes the fields of these names."""

    intrinsics: tuple[float, float, float, float]
    """fx, fy, cx, cy in pixels."""
    distortion: tuple[float, ...]
    """Coefficients in OpenCV's order; none of a lens without distortion."""
    distortion_model: str
    """`brown_conrady` or `fisheye`."""
    size: tuple[int, int] | None
    """Columns and rows of the image that it was calibrated for, where the file says so."""
    metres_per_unit: float | None = None
    """Of its depth images as they are stored, where the file says so (BOP's `depth_scale`). `read_depth` takes it as well; what that
    returns is in metres and needs it no more."""


def read_camera(path: str | PathLike[str]) -> Calibration:
    """Reads a calibration: ROS CameraInfo, OpenCV FileStorage or Kalibr's camchain (YAML; `FILE:cam1` selects one of several),
    RealSense's, Open3D's or BOP's intrinsics (JSON)."""
    size, intrinsics, model, coefficients, metres_per_unit = _benbv.read_camera(os.fspath(path))
    return Calibration(intrinsics, tuple(coefficients), model, size, metres_per_unit)


def read_arm(path: str | PathLike[str], tool: str) -> dict[str, Any]:
    """Reads the serial arm of a URDF that ends in the link `tool`, as the settings have it: `{"robot": {"arm": read_arm(...),
    "flange_from_camera": [[...]]}}`. What is not read of it (COLLADA meshes) is a warning."""
    text, notes = _benbv.read_arm(path, tool)
    for note in notes:
        warnings.warn(f"{path}: {note}", stacklevel=2)
    arm: dict[str, Any] = json.loads(text)
    return arm


def read_cloud(path: str | PathLike[str]) -> Cloud:
    """Reads PLY, PCD, XYZ, TXT, CSV or NPY. Points without a position are left out."""
    points, normals, unit, notes = _benbv.read_cloud(path)
    return Cloud(points, normals, unit, tuple(notes))


def read_depth(path: str | PathLike[str], metres_per_unit: float | None = None) -> NDArray[np.float32]:
    """Reads a depth image, PNG (16-bit grey) or NPY: (height, width) in metres, 0 where a pixel has no return.

    Without `metres_per_unit` integers are millimetres and floats metres; what is odd about them is a warning.
    """
    image, notes = _benbv.read_depth(path, metres_per_unit)
    for note in notes:
        warnings.warn(f"{path}: {note}", stacklevel=2)
    return image


def read_mesh(path: str | PathLike[str]) -> tuple[NDArray[np.float64], NDArray[np.uint32]]:
    """Reads OFF, OBJ, PLY or STL: vertices (N, 3) in the file's unit, and faces (M, 3), indices of vertices."""
    return _benbv.read_mesh(path)


def read_poses(path: str | PathLike[str]) -> list[NDArray[np.float64]]:
    """Reads poses of cameras in any format of `docs/formats.md`: (4, 4) `world_from_camera` each."""
    return _benbv.read_poses(path)
